//! Division of the flash of the STM32F405: loader, state of an update, two slots. That of the
//! STM32G474: loader, key, one slot.

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

/// The STM32G474.
pub mod stm32g474 {
    use super::Range;

    /// Name of the board.
    pub const BOARD: &str = "stm32g474re";
    /// Address of the page with the public key, behind the loader.
    pub const KEY: u32 = 0x0800_5800;
    /// Addresses of the program's slot.
    pub const SLOT: Range<u32> = 0x0800_6000..0x0807_e000;
    /// Offset in the slot of a word with the address of the program's CRC-32, behind the vectors.
    pub const END: u32 = 0x1d8;
    /// Size of a page, bytes.
    pub const PAGE: u32 = 2 * 1024;
    /// Addresses of the RAM.
    pub const RAM: Range<u32> = 0x2000_0000..0x2002_0000;
    /// Address of a [`crate::note::Note`], behind all data of the program.
    pub const NOTE: u32 = 0x2001_ff00;
}
