//! Model of clocks and resets (RM0090, chapter 7, RCC of the STM32F405; RM0440, chapter 7).

use super::kind::{Block, Kind};
use super::{set_word, word};

/// Ticks of emulated time per second: the period of every clock of the board is an integer number
/// of them.
pub const TICKS: u64 = 85_680_000_000;
/// Frequency of the internal oscillator, Hz.
const INTERNAL: u32 = 16_000_000;
/// Duration of a core cycle after a reset, ticks.
pub const START_CYCLE: u64 = TICKS / INTERNAL as u64;
/// Start-up time of the crystal, ticks: 2 ms (DS8626, table 37).
const CRYSTAL_START: u64 = TICKS / 500;
/// Start-up time of the PLL, ticks: 0.2 ms (DS8626, table 41).
const PLL_START: u64 = TICKS / 5000;

/// Bits of CR (7.3.1).
const HSEON: u32 = 1 << 16;
const HSERDY: u32 = 1 << 17;
const CSSON: u32 = 1 << 19;
const PLLON: u32 = 1 << 24;
const PLLRDY: u32 = 1 << 25;
/// Flag of the clock security system and its acknowledgement (7.3.4).
const CSSF: u32 = 1 << 7;
const CSSC: u32 = 1 << 23;
/// Bits of CSR (7.3.21).
const LSION: u32 = 1;
const LSIRDY: u32 = 1 << 1;

#[derive(Debug)]
struct Layout {
    /// Offsets of PLLCFGR and CSR.
    pll: u32,
    status: u32,
    /// Bits of CR: the internal oscillator is on, and ready.
    internal: [u32; 2],
    /// CR, PLLCFGR, CFGR, and a register of clock enables with its offset, after a reset.
    first: [u32; 3],
    first_enables: (u32, u32),
    /// Code of the internal oscillator in CFGR; crystal and PLL follow it.
    internal_code: u32,
    /// Positions of the dividers of APB1 and APB2 in CFGR.
    dividers: [u32; 2],
    /// Mask and value of the PLL's source in PLLCFGR: the crystal.
    from_crystal: (u32, u32),
    remove: u32,
}

/// RM0090, 7.3.
const STM32F405: Layout = Layout {
    pll: 0x04,
    status: 0x74,
    internal: [1, 1 << 1],
    first: [0x83, 0x2400_3010, 0],
    first_enables: (0x30, 0x0010_0000),
    internal_code: 0,
    dividers: [10, 13],
    from_crystal: (1 << 22, 1 << 22),
    remove: 1 << 24,
};

/// RM0440, 7.4.
const STM32G474: Layout = Layout {
    pll: 0x0c,
    status: 0x94,
    internal: [1 << 8, 1 << 10],
    first: [0x500, 0x1000, 0x5],
    first_enables: (0x48, 0x100),
    internal_code: 1,
    dividers: [8, 11],
    from_crystal: (3, 3),
    remove: 1 << 23,
};

/// Cause of a reset (7.3.21).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// Power-on, which sets the flags of brown-out and pin too.
    Power,
    /// The supply fell below the brown-out level of the option bytes.
    BrownOut,
    /// The reset pin, or a debugger.
    Pin,
    /// The firmware or a debugger, through the core's register.
    Software,
    Watchdog,
    Window,
}

impl Cause {
    fn flags(self, kind: Kind) -> u32 {
        const PIN: u32 = 1 << 26;
        match (self, kind) {
            (Self::Power, Kind::Stm32f405) => 1 << 27 | 1 << 25 | PIN,
            (Self::BrownOut, Kind::Stm32f405) => 1 << 25 | PIN,
            // The STM32G474 has one flag for both.
            (Self::Power | Self::BrownOut, Kind::Stm32g474) => 1 << 27 | PIN,
            (Self::Pin, _) => PIN,
            (Self::Software, _) => 1 << 28 | PIN,
            (Self::Watchdog, _) => 1 << 29 | PIN,
            (Self::Window, _) => 1 << 30 | PIN,
        }
    }
}

#[derive(Clone, Debug)]
pub struct Clocks {
    /// Frequency of the crystal, Hz; 0: it does not oscillate.
    pub crystal: u32,
    kind: Kind,
    layout: &'static Layout,
    control: u32,
    pll: u32,
    configuration: u32,
    interrupts: u32,
    status: u32,
    /// Other registers by word: resets, enables, backup domain.
    others: [u32; 40],
    crystal_ready: u64,
    pll_ready: u64,
}

impl Clocks {
    /// Builds the clocks of a chip after a reset, with a crystal of 8 MHz.
    pub fn new(kind: Kind) -> Self {
        let layout = match kind {
            Kind::Stm32f405 => &STM32F405,
            Kind::Stm32g474 => &STM32G474,
        };
        let [control, pll, configuration] = layout.first;
        let mut others = [0; 40];
        let (register, enables) = layout.first_enables;
        set_word(&mut others, register, enables);
        Self {
            crystal: 8_000_000,
            kind,
            layout,
            control,
            pll,
            configuration,
            interrupts: 0,
            status: 0,
            others,
            crystal_ready: u64::MAX,
            pll_ready: u64::MAX,
        }
    }

    /// Resets the registers; the flags of the causes stay.
    pub fn reset(&mut self) {
        *self = Self {
            crystal: self.crystal,
            status: self.status & !(LSION | LSIRDY),
            ..Self::new(self.kind)
        };
    }

    pub fn note(&mut self, cause: Cause) {
        self.status |= cause.flags(self.kind);
    }

    /// Reads a register at tick `now`.
    pub fn read(&self, offset: u32, now: u64) -> u32 {
        match offset {
            0x00 => self.control(now),
            offset if offset == self.layout.pll => self.pll,
            offset if offset == self.layout.status => self.status,
            // A requested clock switch takes effect at once.
            0x08 => self.configuration & !0xc | (self.configuration & 3) << 2,
            0x0c => self.interrupts,
            // CRRCR of the STM32G474: its oscillator of 48 MHz is ready at once.
            0x98 => self.others[0x98 / 4] | (self.others[0x98 / 4] & 1) << 1,
            offset => word(&self.others, offset),
        }
    }

    fn control(&self, now: u64) -> u32 {
        let [on, ready] = self.layout.internal;
        let flag = |set: bool, bit: u32| u32::from(set) * bit;
        self.control & !(ready | HSERDY | PLLRDY)
            | flag(self.control & on != 0, ready)
            | flag(now >= self.crystal_ready, HSERDY)
            | flag(now >= self.pll_ready, PLLRDY)
    }

    /// Writes a register at tick `now`.
    pub fn write(&mut self, offset: u32, value: u32, now: u64) {
        match offset {
            0x00 => self.set_control(value, now),
            // It is writable only with the PLL off (7.3.2).
            offset if offset == self.layout.pll => {
                if self.control & PLLON == 0 {
                    self.pll = value;
                }
            }
            offset if offset == self.layout.status => {
                if value & self.layout.remove != 0 {
                    self.status &= 3;
                }
                let on = value & LSION;
                self.status = self.status & !3 | on | on << 1;
            }
            0x08 => self.configuration = value,
            0x0c => {
                if value & CSSC != 0 {
                    self.interrupts &= !CSSF;
                }
            }
            offset => set_word(&mut self.others, offset, value),
        }
    }

    fn set_control(&mut self, value: u32, now: u64) {
        let risen = value & !self.control;
        self.control = value;
        if value & HSEON == 0 {
            self.crystal_ready = u64::MAX;
        } else if risen & HSEON != 0 && self.crystal > 0 {
            self.crystal_ready = now + CRYSTAL_START;
        }
        if value & PLLON == 0 {
            self.pll_ready = u64::MAX;
        } else if risen & PLLON != 0 {
            let fed = !self.uses_crystal() || now >= self.crystal_ready;
            self.pll_ready = if fed { now + PLL_START } else { u64::MAX };
        }
    }

    /// Stops the crystal; returns whether the security system detects it. Then the internal
    /// oscillator clocks the core, TIM1 gets its break and the core an NMI (7.2.7). Otherwise there
    /// is no clock.
    pub fn crystal_stops(&mut self, now: u64) -> bool {
        let ran = now >= self.crystal_ready;
        self.crystal = 0;
        self.crystal_ready = u64::MAX;
        if self.uses_crystal() {
            self.pll_ready = u64::MAX;
        }
        let detected = ran && self.control & CSSON != 0;
        if detected {
            self.interrupts |= CSSF;
            self.control &= !(HSEON | CSSON);
            if self.uses_crystal() {
                self.control &= !PLLON;
            }
            self.configuration = self.configuration & !3 | self.layout.internal_code;
            self.control |= self.layout.internal[0];
        }
        detected
    }

    /// Whether the security system's interrupt is pending.
    pub fn security(&self) -> bool {
        self.interrupts & CSSF != 0
    }

    /// Frequency of the core at tick `now`, Hz; 0: none.
    pub fn core(&self, now: u64) -> u32 {
        let code = self.configuration & 3;
        let system = match code.wrapping_sub(self.layout.internal_code) {
            0 => INTERNAL,
            1 if now >= self.crystal_ready => self.crystal,
            2 if now >= self.pll_ready => self.pll_out(),
            _ => 0,
        };
        let divided = match self.configuration >> 4 & 0xf {
            code @ 8..=11 => code - 7,
            code @ 12.. => code - 6,
            _ => 0,
        };
        system >> divided
    }

    fn uses_crystal(&self) -> bool {
        let (mask, value) = self.layout.from_crystal;
        self.pll & mask == value
    }

    fn pll_out(&self) -> u32 {
        let crystal = self.uses_crystal();
        let source = if crystal { self.crystal } else { INTERNAL };
        let pll = self.pll;
        let (m, n, p) = match self.kind {
            Kind::Stm32f405 => ((pll & 0x3f).max(2), pll >> 6 & 0x1ff, pll >> 16 & 3),
            // Its output R has an enable (RM0440, 7.4.4).
            Kind::Stm32g474 if pll >> 24 & 1 == 0 => return 0,
            Kind::Stm32g474 => ((pll >> 4 & 0xf) + 1, pll >> 8 & 0x7f, pll >> 25 & 3),
        };
        (u64::from(source) * u64::from(n) / u64::from(m * 2 * (p + 1))) as u32
    }

    /// Divider of a bus clock; `upper` is APB2.
    pub fn divider(&self, upper: bool) -> u32 {
        let code = self.configuration >> self.layout.dividers[usize::from(upper)] & 7;
        if code < 4 { 1 } else { 2 << (code - 4) }
    }

    /// Divider from the core's clock to that of the timers of APB2 (7.2).
    pub fn timer_divider(&self) -> u32 {
        (self.divider(true) / 2).max(1)
    }

    /// Whether a block has its clock (7.3.10 to 7.3.14; RM0440, 7.4.13 to 7.4.19); true for those
    /// without a clock enable.
    pub fn enabled(&self, block: Block) -> bool {
        let (register, bits) = match (self.kind, block) {
            (Kind::Stm32f405, Block::Port(number)) => (0x30, 1 << number),
            (Kind::Stm32f405, Block::Check) => (0x30, 1 << 12),
            (Kind::Stm32f405, Block::Window) => (0x40, 1 << 11),
            (Kind::Stm32f405, Block::Link) => (0x40, 1 << 17),
            (Kind::Stm32f405, Block::Fieldbus) => (0x40, 1 << 19),
            (Kind::Stm32f405, Block::Power) => (0x40, 1 << 28),
            (Kind::Stm32f405, Block::Voltage) => (0x40, 1 << 29),
            (Kind::Stm32f405, Block::Bridge) => (0x44, 1),
            (Kind::Stm32f405, Block::Converter) => (0x44, 7 << 8),
            (Kind::Stm32f405, Block::Configuration) => (0x44, 1 << 14),
            (Kind::Stm32g474, Block::Check) => (0x48, 1 << 12),
            (Kind::Stm32g474, Block::Port(number)) => (0x4c, 1 << number),
            (Kind::Stm32g474, Block::Converter) => (0x4c, 1 << 13),
            (Kind::Stm32g474, Block::Voltage) => (0x4c, 1 << 16),
            (Kind::Stm32g474, Block::Window) => (0x58, 1 << 11),
            (Kind::Stm32g474, Block::Link) => (0x58, 1 << 17),
            (Kind::Stm32g474, Block::Fieldbus) => (0x58, 1 << 19),
            (Kind::Stm32g474, Block::Power) => (0x58, 1 << 28),
            (Kind::Stm32g474, Block::Configuration) => (0x60, 1),
            (Kind::Stm32g474, Block::Bridge) => (0x60, 1 << 11),
            _ => return true,
        };
        word(&self.others, register) & bits != 0
    }
}
