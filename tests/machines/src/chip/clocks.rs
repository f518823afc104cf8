//! Model of clocks and resets (RM0090, chapter 7, RCC of the STM32F405).

/// Ticks of emulated time per second: every clock of the board has a whole number of them.
pub const TICKS: u64 = 1_008_000_000;
/// Frequency of the internal oscillator, Hz.
const INTERNAL: u32 = 16_000_000;
/// Start-up time of the crystal, ticks: 2 ms (DS8626, table 37).
const CRYSTAL_START: u64 = TICKS / 500;
/// Start-up time of the PLL, ticks: 0.2 ms (DS8626, table 41).
const PLL_START: u64 = TICKS / 5000;
/// Highest frequency of the core, Hz (DS8626, table 14).
pub const FASTEST: u32 = 168_000_000;

/// Bits of CR (7.3.1).
const HSION: u32 = 1;
const HSIRDY: u32 = 1 << 1;
const HSEON: u32 = 1 << 16;
const HSERDY: u32 = 1 << 17;
const CSSON: u32 = 1 << 19;
const PLLON: u32 = 1 << 24;
const PLLRDY: u32 = 1 << 25;
/// The source of the PLL (7.3.2).
const FROM_CRYSTAL: u32 = 1 << 22;
/// Flag of the clock security system and its acknowledgement (7.3.4).
const CSSF: u32 = 1 << 7;
const CSSC: u32 = 1 << 23;
/// Bits of CSR (7.3.21).
const LSION: u32 = 1;
const LSIRDY: u32 = 1 << 1;
const REMOVE: u32 = 1 << 24;

/// Cause of a reset (7.3.21).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// Power-on, which sets the flags of brown-out and pin too.
    Power,
    /// The supply fell below the brown-out level that the option bytes set.
    BrownOut,
    /// The reset pin, or a debugger.
    Pin,
    /// The firmware, or a debugger, by the core's register.
    Software,
    /// The independent watchdog.
    Watchdog,
    /// The window watchdog.
    Window,
}

impl Cause {
    fn flags(self) -> u32 {
        const PIN: u32 = 1 << 26;
        match self {
            Self::Power => 1 << 27 | 1 << 25 | PIN,
            Self::BrownOut => 1 << 25 | PIN,
            Self::Pin => PIN,
            Self::Software => 1 << 28 | PIN,
            Self::Watchdog => 1 << 29 | PIN,
            Self::Window => 1 << 30 | PIN,
        }
    }
}

/// The registers, and the crystal.
#[derive(Clone, Debug)]
pub struct Clocks {
    /// Frequency of the crystal, Hz; 0: it does not oscillate.
    pub crystal: u32,
    control: u32,
    pll: u32,
    configuration: u32,
    interrupts: u32,
    status: u32,
    /// Other registers by word: resets, enables, backup domain.
    others: [u32; 36],
    crystal_ready: u64,
    pll_ready: u64,
}

impl Default for Clocks {
    fn default() -> Self {
        let mut clocks = Self {
            crystal: 8_000_000,
            control: 0,
            pll: 0,
            configuration: 0,
            interrupts: 0,
            status: 0,
            others: [0; 36],
            crystal_ready: u64::MAX,
            pll_ready: u64::MAX,
        };
        clocks.reset();
        clocks
    }
}

impl Clocks {
    /// Resets the registers; the flags of the causes stay.
    pub fn reset(&mut self) {
        self.control = 0x83;
        self.pll = 0x2400_3010;
        self.configuration = 0;
        self.interrupts = 0;
        self.others = [0; 36];
        self.others[0x30 / 4] = 0x0010_0000;
        self.status &= !(LSION | LSIRDY);
        self.crystal_ready = u64::MAX;
        self.pll_ready = u64::MAX;
    }

    /// Sets the flags of a reset's cause.
    pub fn note(&mut self, cause: Cause) {
        self.status |= cause.flags();
    }

    /// Reads a register at tick `now`.
    pub fn read(&self, offset: u32, now: u64) -> u32 {
        match offset {
            0x00 => self.control(now),
            0x04 => self.pll,
            // A requested clock switch takes effect at once.
            0x08 => self.configuration & !0xc | (self.configuration & 3) << 2,
            0x0c => self.interrupts,
            0x74 => self.status,
            offset => self.others.get(offset as usize / 4).copied().unwrap_or(0),
        }
    }

    fn control(&self, now: u64) -> u32 {
        let mut value = self.control & !(HSIRDY | HSERDY | PLLRDY);
        if value & HSION != 0 {
            value |= HSIRDY;
        }
        if now >= self.crystal_ready {
            value |= HSERDY;
        }
        if now >= self.pll_ready {
            value |= PLLRDY;
        }
        value
    }

    /// Writes a register at tick `now`.
    pub fn write(&mut self, offset: u32, value: u32, now: u64) {
        match offset {
            0x00 => self.set_control(value, now),
            // It is writable only with the PLL off (7.3.2).
            0x04 if self.control & PLLON == 0 => self.pll = value,
            0x08 => self.configuration = value,
            0x0c => {
                if value & CSSC != 0 {
                    self.interrupts &= !CSSF;
                }
            }
            0x74 => {
                if value & REMOVE != 0 {
                    self.status &= 3;
                }
                let on = value & LSION;
                self.status = self.status & !3 | on | on << 1;
            }
            0x04 => {}
            offset => {
                if let Some(place) = self.others.get_mut(offset as usize / 4) {
                    *place = value;
                }
            }
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
            let fed = self.pll & FROM_CRYSTAL == 0 || now >= self.crystal_ready;
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
        if self.pll & FROM_CRYSTAL != 0 {
            self.pll_ready = u64::MAX;
        }
        let seen = ran && self.control & CSSON != 0;
        if seen {
            self.interrupts |= CSSF;
            self.control &= !(HSEON | CSSON);
            if self.pll & FROM_CRYSTAL != 0 {
                self.control &= !PLLON;
            }
            self.configuration &= !3;
            self.control |= HSION;
        }
        seen
    }

    /// Whether the security system's interrupt is pending.
    pub fn security(&self) -> bool {
        self.interrupts & CSSF != 0
    }

    /// Frequency of the core at tick `now`, Hz; 0: none.
    pub fn core(&self, now: u64) -> u32 {
        let system = match self.configuration & 3 {
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

    fn pll_out(&self) -> u32 {
        let source = if self.pll & FROM_CRYSTAL != 0 {
            self.crystal
        } else {
            INTERNAL
        };
        let (m, n) = (self.pll & 0x3f, self.pll >> 6 & 0x1ff);
        let p = 2 * ((self.pll >> 16 & 3) + 1);
        (u64::from(source) * u64::from(n) / u64::from(m.max(2) * p)) as u32
    }

    /// Divider of a bus clock; `upper` is APB2.
    pub fn divider(&self, upper: bool) -> u32 {
        let code = self.configuration >> if upper { 13 } else { 10 } & 7;
        if code < 4 { 1 } else { 2 << (code - 4) }
    }

    /// Divider from the core's clock to that of a bus's timers (7.2).
    pub fn timer_divider(&self, upper: bool) -> u32 {
        match self.divider(upper) {
            1 => 1,
            divider => divider / 2,
        }
    }

    /// Whether the peripheral at `address` has its clock (7.3.10 to 7.3.14); true for those without
    /// a clock enable.
    pub fn enabled(&self, address: u32) -> bool {
        let enabled = |register: usize, bit: u32| self.others[register / 4] >> bit & 1 == 1;
        match address {
            0x4002_0000..0x4002_2400 => enabled(0x30, (address - 0x4002_0000) / 0x400),
            0x4002_3000..0x4002_3400 => enabled(0x30, 12),
            0x4002_6000..0x4002_6800 => enabled(0x30, 21 + (address >> 10 & 1)),
            0x4000_0000..0x4000_2400 => enabled(0x40, address >> 10 & 0xf),
            0x4000_2c00..0x4000_3000 => enabled(0x40, 11),
            0x4000_3800..0x4000_4000 => enabled(0x40, 14 + (address >> 10 & 1)),
            0x4000_4400..0x4000_5400 => enabled(0x40, 17 + (address - 0x4000_4400) / 0x400),
            0x4000_7000..0x4000_7400 => enabled(0x40, 28),
            0x4000_7400..0x4000_7800 => enabled(0x40, 29),
            0x4001_0000..0x4001_0800 => enabled(0x44, address >> 10 & 1),
            0x4001_1000..0x4001_1800 => enabled(0x44, 4 + (address >> 10 & 1)),
            0x4001_2000..0x4001_2400 => (8..11).any(|bit| enabled(0x44, bit)),
            0x4001_3800..0x4001_3c00 => enabled(0x44, 14),
            _ => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The board's clocks: 8 MHz / 4 * 168 / 2, APB1 by 4, APB2 by 2.
    fn board() -> Clocks {
        let mut clocks = Clocks::default();
        clocks.write(0x00, 0x83 | HSEON, 0);
        assert_eq!(clocks.read(0, CRYSTAL_START - 1) & HSERDY, 0);
        let now = CRYSTAL_START;
        assert_ne!(clocks.read(0, now) & HSERDY, 0);
        clocks.write(0x04, 4 | 168 << 6 | FROM_CRYSTAL | 7 << 24, now);
        clocks.write(0x00, 0x83 | HSEON | PLLON, now);
        assert_eq!(clocks.read(0, now) & PLLRDY, 0);
        clocks.write(0x08, 2 | 0b101 << 10 | 0b100 << 13, now + PLL_START);
        clocks
    }

    #[test]
    fn another_crystal_gives_another_clock() {
        let mut clocks = board();
        let now = TICKS;
        assert_eq!(clocks.core(now), 168_000_000);
        assert_eq!((clocks.divider(false), clocks.divider(true)), (4, 2));
        assert_eq!(
            (clocks.timer_divider(false), clocks.timer_divider(true)),
            (2, 1)
        );
        assert_eq!(clocks.read(8, now) & 0xc, 8);
        clocks.crystal = 12_000_000;
        assert_eq!(clocks.core(now), 252_000_000);
    }

    #[test]
    fn a_crystal_that_stops_is_seen_by_the_security_system_alone() {
        let mut clocks = board();
        assert!(!clocks.crystal_stops(TICKS));
        assert_eq!(clocks.core(TICKS), 0);
        let mut clocks = board();
        clocks.write(0, clocks.read(0, TICKS) | CSSON, TICKS);
        assert!(clocks.crystal_stops(TICKS));
        assert!(clocks.security());
        assert_eq!(clocks.core(TICKS), 16_000_000);
        clocks.write(0x0c, CSSC, TICKS);
        assert!(!clocks.security());
    }

    #[test]
    fn a_dead_crystal_never_becomes_ready() {
        let mut clocks = Clocks {
            crystal: 0,
            ..Clocks::default()
        };
        clocks.write(0, 0x83 | HSEON, 0);
        assert_eq!(clocks.read(0, 100 * TICKS) & HSERDY, 0);
    }

    #[test]
    fn causes_of_resets_add_up_until_they_are_removed() {
        let mut clocks = Clocks::default();
        clocks.note(Cause::Power);
        clocks.reset();
        assert_eq!(clocks.read(0x74, 0), 0x0e00_0000);
        clocks.note(Cause::Watchdog);
        assert_eq!(clocks.read(0x74, 0), 0x2e00_0000);
        clocks.write(0x74, REMOVE, 0);
        assert_eq!(clocks.read(0x74, 0), 0);
    }

    #[test]
    fn a_peripheral_has_the_clock_of_its_own_bit() {
        for (address, register, bit) in [
            (0x4002_0000, 0x30, 0),
            (0x4002_0400, 0x30, 1),
            (0x4001_0000, 0x44, 0),
            (0x4001_2000, 0x44, 8),
            (0x4000_4400, 0x40, 17),
            (0x4000_4800, 0x40, 18),
            (0x4000_7000, 0x40, 28),
            (0x4000_7400, 0x40, 29),
            (0x4000_2c00, 0x40, 11),
            (0x4001_3800, 0x44, 14),
        ] {
            let mut clocks = Clocks::default();
            assert!(!clocks.enabled(address), "{address:#x}");
            clocks.write(register, 1 << bit, 0);
            assert!(clocks.enabled(address), "{address:#x}");
        }
        assert!(
            Clocks::default().enabled(0x4000_3000),
            "the watchdog needs none"
        );
    }
}
