//! Model of TIM1 as the timer of a half bridge (RM0090, chapter 17; RM0440, chapter 28).

use super::clocks::START_CYCLE;
use super::kind::Kind;
use super::word;

/// Bits of CR1, SR, EGR, BDTR.
const ENABLE: u32 = 1;
const UPDATE_OFF: u32 = 1 << 1;
const PRELOAD: u32 = 1 << 7;
const UPDATE: u32 = 1;
const BREAK: u32 = 1 << 7;
/// Flag of a break by the chip itself, on the STM32G474. While it is set, the outputs stay off.
const SYSTEM_BREAK: u32 = 1 << 13;
const BREAK_ON: u32 = 1 << 12;
const BREAK_HIGH: u32 = 1 << 13;
const AUTOMATIC: u32 = 1 << 14;
/// Main output enable (17.4.18).
const MAIN_OUTPUT: u32 = 1 << 15;

#[derive(Clone, Debug, Default)]
pub struct Bridge {
    kind: Kind,
    registers: [u32; 20],
    /// Active values of prescaler, reload and comparison, loaded at the last update.
    prescaler: u32,
    reload: u32,
    compare: u32,
    repetition: u32,
    /// Count and direction (downwards) at tick `since`.
    count: u32,
    down: bool,
    since: u64,
    /// Duration of a timer clock cycle, ticks; 0 without a clock.
    cycle: u64,
}

impl Bridge {
    pub fn new(kind: Kind) -> Self {
        let mut registers = [0; 20];
        registers[0x2c / 4] = 0xffff;
        Self {
            kind,
            registers,
            reload: 0xffff,
            cycle: START_CYCLE,
            ..Self::default()
        }
    }

    pub fn reset(&mut self) {
        *self = Self {
            cycle: self.cycle,
            ..Self::new(self.kind)
        };
    }

    fn word(&self, offset: usize) -> u32 {
        self.registers[offset / 4]
    }

    pub fn runs(&self) -> bool {
        self.word(0) & ENABLE != 0 && self.cycle > 0
    }

    fn is_centred(&self) -> bool {
        self.word(0) >> 5 & 3 != 0
    }

    pub fn set_cycle(&mut self, cycle: u64, now: u64) {
        if cycle != self.cycle {
            self.catch_up(now);
            (self.cycle, self.since) = (cycle, now);
        }
    }

    fn count_ticks(&self) -> u64 {
        self.cycle * u64::from(self.prescaler + 1)
    }

    fn place(&self, now: u64) -> u32 {
        if !self.runs() {
            return self.count;
        }
        let steps = ((now - self.since) / self.count_ticks()) as u32;
        if self.down {
            self.count.saturating_sub(steps)
        } else {
            (self.count + steps).min(self.reload)
        }
    }

    /// Advances the count to tick `now`, with its fraction, so a register write shifts no edge.
    fn catch_up(&mut self, now: u64) {
        self.count = self.place(now);
        if self.runs() {
            self.since = now - (now - self.since) % self.count_ticks();
        } else {
            self.since = now;
        }
    }

    pub fn due(&self) -> u64 {
        if !self.runs() || self.reload == 0 {
            return u64::MAX;
        }
        let steps = if self.down {
            self.count
        } else {
            self.reload.saturating_sub(self.count) + u32::from(!self.is_centred())
        };
        self.since + u64::from(steps) * self.count_ticks()
    }

    /// Reverses the counter at its end; returns whether it triggers (update, CR2.MMS = 2).
    pub fn turn(&mut self) -> bool {
        self.since = self.due();
        if self.is_centred() {
            self.count = if self.down { 0 } else { self.reload };
            self.down = !self.down;
        } else {
            self.count = 0;
        }
        if self.repetition > 0 {
            self.repetition -= 1;
            return false;
        }
        if self.word(0) & UPDATE_OFF != 0 {
            return false;
        }
        self.update();
        self.registers[0x10 / 4] |= UPDATE;
        if self.word(0x44) & AUTOMATIC != 0 && self.word(0x10) & BREAK == 0 {
            self.registers[0x44 / 4] |= MAIN_OUTPUT;
        }
        self.word(4) >> 4 & 7 == 2
    }

    /// Loads the preloaded values at an update (17.3.1).
    fn update(&mut self) {
        self.prescaler = self.word(0x28) & 0xffff;
        self.reload = self.word(0x2c) & 0xffff;
        self.compare = self.word(0x34) & 0xffff;
        self.repetition = self.word(0x30) & 0xff;
        self.count = self.count.min(self.reload);
    }

    pub fn read(&self, offset: u32, now: u64) -> u32 {
        match offset {
            0x24 => self.place(now),
            0x00 => self.word(0) & !0x10 | u32::from(self.down && self.is_centred()) << 4,
            offset => word(&self.registers, offset),
        }
    }

    /// Writes a register; returns whether a software event appears on the trigger output.
    pub fn write(&mut self, offset: u32, value: u32, now: u64) -> bool {
        let Some(&old) = self.registers.get(offset as usize / 4) else {
            return false;
        };
        self.catch_up(now);
        let lock = self.word(0x44) >> 8 & 3;
        let value = match offset {
            0x10 => old & value,
            0x14 => {
                if value & 1 != 0 {
                    self.update();
                    (self.count, self.down, self.since) = (0, false, now);
                    self.registers[0x10 / 4] |= UPDATE;
                }
                return value & 1 != 0 && matches!(self.word(4) >> 4 & 7, 0 | 2);
            }
            0x24 => {
                (self.count, self.since) = (value & 0xffff, now);
                return false;
            }
            0x44 => {
                // Bits that a lock level protects (17.4.18); the level itself is written once.
                let preserved = match lock {
                    0 => 0,
                    1 => 0x73ff,
                    _ => 0x7fff,
                };
                let off = self.word(0x10) & SYSTEM_BREAK != 0;
                (old & preserved | value & !preserved) & !(u32::from(off) * MAIN_OUTPUT)
            }
            // Polarity is protected from level 2 on.
            0x20 if lock >= 2 => old & 0xaaaa | value & !0xaaaa,
            // Idle levels are protected from level 1 on.
            0x04 if lock >= 1 => old & 0x7f00 | value & !0x7f00,
            _ => value,
        };
        self.registers[offset as usize / 4] = value;
        match offset {
            0x00 if old & ENABLE == 0 => self.since = now,
            0x2c if self.word(0) & PRELOAD == 0 => self.reload = value & 0xffff,
            0x34 if self.word(0x18) & 8 == 0 => self.compare = value & 0xffff,
            _ => {}
        }
        false
    }

    /// A break: disables the outputs without any clock (17.3.12).
    fn fail(&mut self, flag: u32) {
        self.registers[0x44 / 4] &= !MAIN_OUTPUT;
        self.registers[0x10 / 4] |= flag;
    }

    /// Applies the level of the break input, and a break by the chip such as the clock security
    /// system's. Returns whether they opened the bridge.
    pub fn break_input(&mut self, high: bool, by_chip: bool) -> bool {
        let word = self.word(0x44);
        let active = word & BREAK_ON != 0 && high == (word & BREAK_HIGH != 0);
        let driven = word & MAIN_OUTPUT != 0;
        // A break by the chip requires the break enable (17.3.12).
        let by_chip = by_chip && word & BREAK_ON != 0;
        if active {
            self.fail(BREAK);
        }
        if by_chip {
            self.fail(match self.kind {
                Kind::Stm32f405 => BREAK,
                Kind::Stm32g474 => SYSTEM_BREAK,
            });
        }
        (active || by_chip) && driven
    }

    pub fn enabled(&self) -> bool {
        self.word(0x44) & MAIN_OUTPUT != 0
    }

    /// Whether the outputs and both channels are enabled, so that one of the gates is always high.
    pub fn driven(&self) -> bool {
        self.enabled() && self.word(0x20) & 5 != 0
    }

    pub fn switch_on(&mut self) {
        self.registers[0x44 / 4] |= MAIN_OUTPUT;
    }

    /// Mean bridge voltage over its supply, -1..1. A stopped counter leaves one switch closed.
    pub fn output(&self, now: u64) -> f32 {
        if !self.driven() {
            return 0.0;
        }
        if !self.runs() {
            let high = self.place(now) < self.compare;
            return if high { 1.0 } else { -1.0 };
        }
        (2.0 * f64::from(self.compare.min(self.reload)) / f64::from(self.reload.max(1)) - 1.0)
            as f32
    }

    /// Number of counts between the nearest edge, including dead time, and the first `sampled`
    /// counts after the bottom. The compare value is that of the neighbouring periods.
    pub fn clear(&self, sampled: u32) -> u32 {
        let (_, compare, dead) = self.period();
        let compare = compare.min(self.reload);
        compare.saturating_sub(sampled.max(dead))
    }

    /// Requested interrupts: update, break.
    pub fn interrupts(&self) -> [bool; 2] {
        let both = self.word(0x10) & self.word(0x0c);
        [both & UPDATE != 0, both & BREAK != 0]
    }

    /// Period in timer counts, its high part, and the dead time in counts.
    pub fn period(&self) -> (u32, u32, u32) {
        let turns = if self.is_centred() { 2 } else { 1 };
        let dead = match self.word(0x44) & 0xff {
            code @ 0..0x80 => code,
            code @ 0x80..0xc0 => 2 * (64 + (code & 0x3f)),
            code @ 0xc0..0xe0 => 8 * (32 + (code & 0x1f)),
            code => 16 * (32 + (code & 0x1f)),
        };
        (
            turns * self.reload * (self.prescaler + 1),
            self.compare,
            dead,
        )
    }
}
