//! Drivers that the boards share: core, clocks, timers, watchdogs and log.

pub mod chip;
pub mod cortex;
pub mod log;
pub mod stm32;
