//! Digital inputs: enable, recipe selection, and the supply's supervision.

pub mod enable;
pub mod selector;
pub mod supply;
