//! The feeder drive application over small traits.
#![no_std]
