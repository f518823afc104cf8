//! Division of the flash of the STM32F405: loader, state of an update, two slots.

use core::ops::Range;

/// Addresses of the state of an update: the last three quarters of sector 0.
pub const STATE: Range<u32> = 0x0800_1000..0x0800_4000;
/// Addresses of the slot whose program runs: sectors 5 to 7.
pub const ACTIVE: Range<u32> = 0x0802_0000..0x0808_0000;
/// Addresses of the slot for an update: sectors 8 to 11.
pub const UPDATE: Range<u32> = 0x0808_0000..0x0810_0000;
/// Size of a sector of the slots, bytes.
pub const SECTOR: u32 = 128 * 1024;
/// Number of the first sector of the slots.
pub const FIRST_SECTOR: u32 = 5;
