//! Model of the flash, its controller and its accelerator (RM0090, chapter 3; DS8626, tables 39 and
//! 40). The controller of the STM32G474 is in `flash/pages.rs`.

use std::collections::BTreeSet;
use std::ops::Range;

use super::clocks::TICKS;
use super::kind::Kind;
use kband::arithmetic::Noise;

mod pages;

pub const START: u32 = 0x0800_0000;
const SIZE: usize = 1024 * 1024;
pub const RANGE: Range<u32> = START..START + SIZE as u32;

const KEYS: [u32; 2] = [0x4567_0123, 0xcdef_89ab];
const OPTION_KEYS: [u32; 2] = [0x0819_2a3b, 0x4c5d_6e7f];
/// Bits of ACR (3.9.1).
const PREFETCH: u32 = 1 << 8;
const INSTRUCTION_CACHE: u32 = 1 << 9;
const DATA_CACHE: u32 = 1 << 10;
const RESET_INSTRUCTIONS: u32 = 1 << 11;
const RESET_DATA: u32 = 1 << 12;
const PROGRAM: u32 = 1;
const ERASE_SECTOR: u32 = 1 << 1;
const START_ERASING: u32 = 1 << 16;
const LOCKED: u32 = 1 << 31;
/// Error bits of the status register: parallelism, sequence.
const WRONG_SIZE: u32 = 1 << 6;
const WRONG_SEQUENCE: u32 = 1 << 7;
const ERRORS: u32 = 0xf0;
const BUSY: u32 = 1 << 16;
/// Bits of OPTCR (3.9.10).
const OPTIONS_LOCKED: u32 = 1;
const OPTIONS_START: u32 = 1 << 1;
const SOFTWARE_WATCHDOG: u32 = 1 << 5;
/// Factory value of OPTCR: brown-out reset off, watchdog started by software.
const OPTIONS: u32 = 0x0fff_aaed;
/// Option bits of that register, without its lock and its start bit.
const OPTION_BYTES: u32 = 0x0fff_ffec;
/// Number of cached lines of 16 bytes: instructions, data (3.5.2).
const LINES: [usize; 2] = [64, 8];
/// Duration of programming a word, ticks: 16 us (DS8626, flash memory programming).
const WORD_TIME: u64 = 16 * TICKS / 1_000_000;
/// Typical durations of an erasure, ms (DS8626, flash memory programming). Columns: 16, 64 and 128
/// KiB; rows: by bytes, half words and words. The longest durations are twice as long.
const ERASE_TIMES: [[u64; 3]; 3] = [[400, 1200, 2000], [300, 700, 1300], [250, 550, 1000]];

/// Size of the longest word that a chip programs at once, bytes; a sector is larger.
const LONGEST_WORD: usize = 8;

/// Compares the next key of a sequence; returns whether it completed the right sequence.
fn turn(count: &mut usize, keys: [u32; 2], key: u32) -> bool {
    let right = keys.get(*count) == Some(&key);
    *count = if right { *count + 1 } else { keys.len() + 1 };
    *count == keys.len()
}

/// Offsets of a sector of the STM32F405.
pub fn sector(number: usize) -> Option<Range<usize>> {
    match number {
        0..=3 => Some(number * 0x4000..(number + 1) * 0x4000),
        4 => Some(0x1_0000..0x2_0000),
        5..=11 => Some((number - 4) * 0x2_0000..(number - 3) * 0x2_0000),
        _ => None,
    }
}

/// Cached lines; a new one replaces the oldest (on silicon the least recently used).
#[derive(Clone, Debug, Default)]
struct Lines {
    lines: Vec<usize>,
    oldest: usize,
    /// Whether each line of the flash is cached, and behind them a place for no line.
    cached: Vec<bool>,
}

impl Lines {
    fn new(count: usize, bytes: usize) -> Self {
        Self {
            lines: vec![bytes / 16; count],
            oldest: 0,
            cached: vec![false; bytes / 16 + 1],
        }
    }

    fn clear(&mut self) {
        self.lines.fill(self.cached.len() - 1);
        self.cached.fill(false);
    }

    /// Whether the line of an address is cached; it is cached from now on.
    #[inline]
    fn has(&mut self, address: u32) -> bool {
        let line = (address - START) as usize >> 4;
        if std::mem::replace(&mut self.cached[line], true) {
            return true;
        }
        let oldest = std::mem::replace(&mut self.lines[self.oldest], line);
        self.cached[oldest] = false;
        self.oldest += 1;
        if self.oldest == self.lines.len() {
            self.oldest = 0;
        }
        false
    }
}

/// The flash, erased at first.
#[derive(Clone, Debug, Default)]
pub struct Flash {
    pub bytes: Vec<u8>,
    kind: Kind,
    /// Address and mask of bits that stay 1 when programmed, on the STM32F405.
    pub worn: Option<(u32, u32)>,
    /// Number of words programmed and sectors erased.
    pub operations: u64,
    pub erasures: u32,
    /// Whether operations take the longest time of the data sheet instead of the typical one.
    pub slow: bool,
    /// Duration of an erasure in ticks that overrides the data sheet.
    pub erases_in: Option<u64>,
    /// Sectors with an incomplete last erasure. They may read as erased, but not reliably.
    pub weak: Vec<Range<usize>>,
    pub programmed_weak: bool,
    /// Whether a word of the STM32G474 was programmed with the data cache on. A read of the other
    /// bank may then corrupt the cache; `embassy-stm32` 0.6.0 switches it off (flash/g.rs).
    pub programmed_cached: bool,
    /// A sector that was erased while the data cache held parts of it: reads may return old data.
    stale: Option<Range<usize>>,
    under_way: Option<(usize, Vec<u8>)>,
    /// Duration of the last erasure, ticks.
    duration: u64,
    keys: usize,
    option_keys: usize,
    access: u32,
    control: u32,
    status: u32,
    option_control: u32,
    pub options: u32,
    /// Tick until which the controller is busy.
    pub busy: u64,
    /// First half of a word of the STM32G474, with its offset.
    half: Option<(usize, u32)>,
    /// Offsets of words with two wrong bits, and the register that reports their reads.
    torn: BTreeSet<usize>,
    code: u32,
    instructions: Lines,
    data: Lines,
    /// Lines of the last instruction fetch and of the last data read.
    current: [u32; 2],
}

impl Flash {
    pub fn new(kind: Kind) -> Self {
        let mut flash = Self {
            bytes: vec![0xff; kind.facts().identity.1 as usize * 1024],
            kind,
            options: match kind {
                Kind::Stm32f405 => OPTIONS & OPTION_BYTES,
                Kind::Stm32g474 => pages::OPTIONS,
            },
            instructions: Lines::new(LINES[0], RANGE.len()),
            data: Lines::new(LINES[1], RANGE.len()),
            ..Self::default()
        };
        flash.reset();
        flash
    }

    pub fn reset(&mut self) {
        (self.keys, self.control, self.status) = (0, LOCKED, 0);
        (self.option_keys, self.option_control) = (0, self.options | OPTIONS_LOCKED);
        (self.access, self.busy, self.stale) = (0, 0, None);
        (self.half, self.code) = (None, 0);
        if self.kind == Kind::Stm32g474 {
            self.access = INSTRUCTION_CACHE | DATA_CACHE;
        }
        self.instructions.clear();
        self.data.clear();
        self.current = [u32::MAX; 2];
    }

    /// Brown-out level in the coding of the option bytes.
    pub fn brown_out(&self) -> u32 {
        match self.kind {
            Kind::Stm32f405 => self.options >> 2 & 3,
            Kind::Stm32g474 => self.options >> 8 & 7,
        }
    }

    /// Whether the independent watchdog runs from reset on.
    pub fn hardware_watchdog(&self) -> bool {
        let by_software = match self.kind {
            Kind::Stm32f405 => SOFTWARE_WATCHDOG,
            Kind::Stm32g474 => pages::SOFTWARE_WATCHDOG,
        };
        self.options & by_software == 0
    }

    pub fn status_offset(&self) -> u32 {
        match self.kind {
            Kind::Stm32f405 => 0x0c,
            Kind::Stm32g474 => 0x10,
        }
    }

    /// Whether an access of the memory at `offset` waits at tick `now`. A bank of the STM32G474
    /// can be read while the other one is programmed or erased.
    pub fn is_busy(&self, offset: usize, now: u64) -> bool {
        now < self.busy && (self.kind == Kind::Stm32f405 || self.shares_bank(offset))
    }

    /// Sets the option bytes as if programmed and loaded.
    pub fn set_options(&mut self, options: u32) {
        let bytes = match self.kind {
            Kind::Stm32f405 => OPTION_BYTES,
            Kind::Stm32g474 => !0,
        };
        self.options = options & bytes;
        self.option_control = options | OPTIONS_LOCKED;
    }

    pub fn latency(&self) -> u32 {
        self.access & 7
    }

    /// Whether prefetch, instruction cache and data cache are on.
    fn accelerator(&self) -> [bool; 3] {
        [PREFETCH, INSTRUCTION_CACHE, DATA_CACHE].map(|bit| self.access & bit != 0)
    }

    /// Number of wait cycles of the core for a line of instructions.
    #[inline]
    pub fn fetch(&mut self, address: u32) -> u32 {
        let line = address >> 4;
        let last = std::mem::replace(&mut self.current[0], line);
        if line == last {
            return 0;
        }
        let [prefetch, cached, _] = self.accelerator();
        if cached && self.instructions.has(address) {
            return 0;
        }
        // A line of 16 bytes takes two reads of 8 bytes with the flash in two banks.
        let reads = 1 + u32::from(self.kind == Kind::Stm32g474);
        let latency = reads * self.latency();
        // The prefetch loads the next line while the core executes this one, in 4 to 8 cycles.
        if prefetch && line == last.wrapping_add(1) {
            latency.saturating_sub(4)
        } else {
            latency
        }
    }

    /// Number of wait cycles of the core for a data read, and whether the data may be outdated.
    pub fn read(&mut self, address: u32) -> (u32, bool) {
        let line = address >> 4;
        let at = (address - START) as usize;
        let old = (self.stale.as_ref()).is_some_and(|sector| sector.contains(&at));
        let last = std::mem::replace(&mut self.current[1], line);
        let [_, _, cached] = self.accelerator();
        if line == last || cached && self.data.has(address) {
            return (0, old);
        }
        (self.latency(), old)
    }

    /// Reads a register by its offset at tick `now`.
    pub fn register(&self, offset: u32, now: u64) -> u32 {
        match (self.kind, offset) {
            (_, 0x00) => self.access,
            (_, offset) if offset == self.status_offset() => {
                self.status | (u32::from(now < self.busy) * BUSY)
            }
            (Kind::Stm32f405, 0x10) => self.control,
            (Kind::Stm32f405, 0x14) => self.option_control,
            (Kind::Stm32g474, 0x14) => self.control | pages::OPTION_LOCK,
            (Kind::Stm32g474, 0x18) => self.code,
            (Kind::Stm32g474, 0x20) => self.options,
            _ => 0,
        }
    }

    /// Writes a register. The option bytes of the STM32G474 cannot be written here.
    pub fn set_register(&mut self, offset: u32, value: u32, now: u64) {
        match (self.kind, offset) {
            (_, 0x00) => {
                self.access = value & 0x707;
                if value & RESET_INSTRUCTIONS != 0 {
                    self.instructions.clear();
                }
                if value & RESET_DATA != 0 {
                    self.data.clear();
                    self.stale = None;
                }
            }
            (Kind::Stm32f405, 0x04) | (Kind::Stm32g474, 0x08) => {
                let opens = turn(&mut self.keys, KEYS, value);
                self.control &= !(u32::from(opens) * LOCKED);
            }
            (Kind::Stm32f405, 0x0c) => self.status &= !(value & ERRORS),
            (Kind::Stm32g474, 0x10) => self.status &= !(value & pages::ERRORS),
            (Kind::Stm32f405, 0x10) | (Kind::Stm32g474, 0x14) => self.set_control(value, now),
            (Kind::Stm32f405, 0x08) => {
                let opens = turn(&mut self.option_keys, OPTION_KEYS, value);
                self.option_control &= !(u32::from(opens) * OPTIONS_LOCKED);
            }
            (Kind::Stm32f405, 0x14) if self.option_control & OPTIONS_LOCKED == 0 => {
                self.option_control = value & !OPTIONS_START;
                if value & OPTIONS_LOCKED != 0 {
                    self.option_keys = 0;
                }
                if value & OPTIONS_START != 0 {
                    // Silicon loads them at the next reset, which follows; the model at once.
                    self.options = value & OPTION_BYTES;
                    self.busy = now + self.erasure(0);
                }
            }
            (Kind::Stm32g474, 0x18) => self.code &= !(value & pages::DOUBLE_ERROR),
            _ => {}
        }
    }

    fn set_control(&mut self, value: u32, now: u64) {
        if self.control & LOCKED != 0 {
            return;
        }
        self.control = value & !START_ERASING;
        self.half = None;
        if value & LOCKED != 0 {
            self.keys = 0;
        } else if value & START_ERASING != 0 {
            match self.kind {
                Kind::Stm32f405 => self.erase(now),
                Kind::Stm32g474 => self.erase_page(now),
            }
        }
    }

    fn time(&self, typical: u64) -> u64 {
        if self.slow { 2 * typical } else { typical }
    }

    /// Duration of an erasure by its table row and the parallelism in the control register.
    fn erasure(&self, what: usize) -> u64 {
        let width = (self.control >> 8 & 3).min(2) as usize;
        let usual = self.time(ERASE_TIMES[width][what] * (TICKS / 1000));
        self.erases_in.unwrap_or(usual)
    }

    fn erase(&mut self, now: u64) {
        let number = self.control as usize >> 3 & 0xf;
        if self.control & ERASE_SECTOR != 0
            && let Some(range) = sector(number)
        {
            let size = usize::from(number >= 4) + usize::from(number >= 5);
            self.erase_sector(range, self.erasure(size), now);
        } else {
            self.status |= WRONG_SEQUENCE;
        }
    }

    fn erase_sector(&mut self, range: Range<usize>, duration: u64, now: u64) {
        self.under_way = Some((range.start, self.bytes[range.clone()].to_vec()));
        self.bytes[range.clone()].fill(0xff);
        self.erasures += 1;
        self.weak.retain(|weak| *weak != range);
        self.stale = (self.access & DATA_CACHE != 0).then_some(range);
        self.operations += 1;
        (self.duration, self.busy) = (duration, now + duration);
    }

    /// Marks the erasure in progress at tick `now` as incomplete, because the supply is too low.
    pub fn weaken(&mut self, now: u64) {
        if now < self.busy
            && let Some((at, before)) = &self.under_way
            && before.len() > LONGEST_WORD
        {
            self.weak.push(*at..*at + before.len());
        }
    }

    /// Cuts the supply at tick `now`. An operation in progress leaves each bit old or new. In the
    /// last quarter of an erasure all bits read as erased already.
    pub fn supply_goes(&mut self, now: u64) {
        self.weaken(now);
        let Some((at, before)) = self.under_way.take().filter(|_| now < self.busy) else {
            return;
        };
        let left = self.busy - now;
        self.busy = 0;
        if before.len() > LONGEST_WORD && 4 * left < self.duration {
            return;
        }
        if self.kind == Kind::Stm32g474 {
            self.tear(at, before.len());
        }
        let mut noise = Noise::new(now);
        for (place, before) in self.bytes[at..].iter_mut().zip(before) {
            let mask = noise.bits() as u8;
            *place = *place & mask | before & !mask;
        }
    }

    /// Programs a word: bits change from 1 to 0 only.
    pub fn program(&mut self, offset: usize, size: u32, value: u32, now: u64) {
        if self.kind == Kind::Stm32g474 {
            return self.program_word(offset, size, value, now);
        }
        if self.control & (LOCKED | PROGRAM) != PROGRAM {
            return self.status |= WRONG_SEQUENCE;
        }
        if 1 << (self.control >> 8 & 3) != size {
            return self.status |= WRONG_SIZE;
        }
        self.programmed_weak |= self.weak.iter().any(|range| range.contains(&offset));
        let at = START + offset as u32;
        let worn = self.worn.filter(|(address, _)| *address == at);
        let value = value | worn.map_or(0, |(_, bits)| bits);
        let places = &mut self.bytes[offset..offset + size as usize];
        self.under_way = Some((offset, places.to_vec()));
        for (place, byte) in places.iter_mut().zip(value.to_le_bytes()) {
            *place &= byte;
        }
        self.operations += 1;
        self.busy = now.max(self.busy) + self.time(WORD_TIME);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open() -> Flash {
        let mut flash = Flash::new(Kind::Stm32f405);
        for key in KEYS {
            flash.set_register(0x04, key, 0);
        }
        assert_eq!(flash.register(0x10, 0) & LOCKED, 0);
        flash
    }

    #[test]
    fn a_word_takes_16_us_and_only_clears_bits() {
        let mut flash = open();
        flash.program(8, 4, 0, 0);
        assert_eq!(flash.register(0x0c, 0), WRONG_SEQUENCE);
        flash.set_register(0x0c, ERRORS, 0);
        flash.set_register(0x10, PROGRAM | 2 << 8, 0);
        flash.program(8, 4, 0x00ff_00f0, 0);
        assert_eq!(flash.register(0x0c, WORD_TIME - 1), BUSY);
        assert_eq!(flash.register(0x0c, WORD_TIME), 0);
        flash.program(8, 4, 0xffff_ffff, WORD_TIME);
        assert_eq!(flash.bytes[8..12], [0xf0, 0, 0xff, 0]);
        flash.program(8, 1, 0, 0);
        assert_eq!(flash.register(0x0c, TICKS) & ERRORS, WRONG_SIZE);
    }

    #[test]
    fn an_interrupted_write_is_torn_and_a_finished_one_is_not() {
        let mut flash = open();
        flash.set_register(0x10, PROGRAM | 2 << 8, 0);
        flash.program(8, 4, 0, 0);
        flash.supply_goes(WORD_TIME);
        assert_eq!(flash.bytes[8..12], [0; 4]);
        flash.set_register(0x10, ERASE_SECTOR | START_ERASING, WORD_TIME);
        flash.bytes[..0x4000].fill(0xff);
        flash.under_way = Some((0, vec![0; 0x4000]));
        flash.supply_goes(WORD_TIME + 1);
        let ones: u32 = flash.bytes[..0x4000].iter().map(|b| b.count_ones()).sum();
        assert!((0x8000..0x1_8000).contains(&ones), "{ones}");
    }

    #[test]
    fn cached_data_is_stale_after_an_erasure() {
        let mut flash = open();
        flash.set_register(0x00, 5 | DATA_CACHE, 0);
        flash.set_register(0x10, ERASE_SECTOR | 11 << 3 | START_ERASING, 0);
        let place = START + 0xe_0000;
        assert!(flash.read(place).1);
        flash.set_register(0x00, 5, 0);
        flash.set_register(0x00, 5 | RESET_DATA, 0);
        flash.set_register(0x00, 5 | DATA_CACHE, 0);
        assert!(!flash.read(place).1);
    }
}
