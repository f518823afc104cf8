//! Flash and its controller (RM0090, 3.5 to 3.9).

/// Where it lies.
pub const START: u32 = 0x0800_0000;
/// Its bytes.
const SIZE: usize = 1024 * 1024;
/// Its addresses.
pub const RANGE: std::ops::Range<u32> = START..START + SIZE as u32;
/// The registers of its controller.
pub const REGISTERS: std::ops::Range<u32> = 0x4002_3c00..0x4002_3c18;

const KEYS: [u32; 2] = [0x4567_0123, 0xcdef_89ab];
/// Bits of the control register.
const PROGRAM: u32 = 1;
const ERASE_SECTOR: u32 = 1 << 1;
const ERASE_ALL: u32 = 1 << 2;
const START_ERASING: u32 = 1 << 16;
const LOCKED: u32 = 1 << 31;
/// Errors of the status register: parallelism, sequence.
const WRONG_SIZE: u32 = 1 << 6;
const WRONG_SEQUENCE: u32 = 1 << 7;
const ERRORS: u32 = 0xf0;
const BUSY: u32 = 1 << 16;
/// The watchdog is started by software.
const OPTIONS: u32 = 0x0fff_aaed;

/// A flash; erased at first.
#[derive(Clone, Debug)]
pub struct Flash {
    /// What it holds.
    pub bytes: Vec<u8>,
    /// Bits that stay 1 although they are programmed, by address: worn out.
    pub worn: Option<(u32, u32)>,
    /// Words programmed and sectors erased so far.
    pub operations: u64,
    keys: usize,
    control: u32,
    status: u32,
}

impl Default for Flash {
    fn default() -> Self {
        Self {
            bytes: vec![0xff; SIZE],
            worn: None,
            operations: 0,
            keys: 0,
            control: LOCKED,
            status: 0,
        }
    }
}

impl Flash {
    /// What a reset does to the controller.
    pub fn reset(&mut self) {
        (self.keys, self.control, self.status) = (0, LOCKED, 0);
    }

    /// A register by its offset.
    pub fn register(&mut self, offset: u32) -> u32 {
        match offset {
            0x0c => {
                // Busy for one look after each operation.
                let status = self.status;
                self.status &= !BUSY;
                status
            }
            0x10 => self.control,
            0x14 => OPTIONS,
            _ => 0,
        }
    }

    /// Writes a register.
    pub fn set_register(&mut self, offset: u32, value: u32) {
        match offset {
            0x04 => {
                let right = KEYS.get(self.keys) == Some(&value);
                self.keys = if right { self.keys + 1 } else { KEYS.len() + 1 };
                if self.keys == KEYS.len() {
                    self.control &= !LOCKED;
                }
            }
            0x0c => self.status &= !(value & ERRORS),
            0x10 if self.control & LOCKED == 0 => {
                self.control = value & !START_ERASING;
                if value & LOCKED != 0 {
                    self.keys = 0;
                    return;
                }
                if value & START_ERASING != 0 {
                    self.erase();
                }
            }
            _ => {}
        }
    }

    fn erase(&mut self) {
        if self.control & ERASE_ALL != 0 {
            self.bytes.fill(0xff);
        } else if self.control & ERASE_SECTOR != 0 {
            let number = self.control as usize >> 3 & 0xf;
            let sector = match number {
                0..=3 => number * 0x4000..(number + 1) * 0x4000,
                4 => 0x1_0000..0x2_0000,
                5..=11 => (number - 4) * 0x2_0000..(number - 3) * 0x2_0000,
                _ => return self.status |= WRONG_SEQUENCE,
            };
            self.bytes[sector].fill(0xff);
        } else {
            return self.status |= WRONG_SEQUENCE;
        }
        self.operations += 1;
        self.status |= BUSY;
    }

    /// Programs: bits go from 1 to 0 only.
    pub fn program(&mut self, offset: usize, size: u32, value: u32) {
        if self.control & (LOCKED | PROGRAM) != PROGRAM {
            self.status |= WRONG_SEQUENCE;
            return;
        }
        if 1 << (self.control >> 8 & 3) != size {
            self.status |= WRONG_SIZE;
            return;
        }
        let worn = match self.worn {
            Some((address, bits)) if address == START + offset as u32 => bits,
            _ => 0,
        };
        let value = (value | worn).to_le_bytes();
        for (place, byte) in self.bytes[offset..]
            .iter_mut()
            .zip(value)
            .take(size as usize)
        {
            *place &= byte;
        }
        self.operations += 1;
        self.status |= BUSY;
    }
}
