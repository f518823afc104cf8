//! Models of the two watchdogs (RM0090, chapters 21 and 22; RM0440, chapters 42 and 43).

use super::clocks::TICKS;
use super::kind::Kind;

/// The independent watchdog, with its own oscillator.
#[derive(Clone, Debug, Default)]
pub struct Independent {
    /// Frequency of its oscillator, Hz: 17 to 47 kHz, typically 32 kHz (DS8626, table 40).
    pub clock: f64,
    running: bool,
    open: bool,
    prescaler: u32,
    reload: u32,
    count: f64,
    since: u64,
    /// Tick until which a register is transferred to its clock domain (21.4.4).
    busy: u64,
}

impl Independent {
    pub fn new() -> Self {
        Self {
            clock: 32_000.0,
            reload: 0xfff,
            count: 4095.0,
            ..Self::default()
        }
    }

    /// Resets the registers. The option bytes may start it at once (21.3.1).
    pub fn reset(&mut self, by_hardware: bool, now: u64) {
        *self = Self {
            clock: self.clock,
            running: by_hardware,
            since: now,
            ..Self::new()
        };
    }

    pub fn read(&self, offset: u32, now: u64) -> u32 {
        match offset {
            0x04 => self.prescaler,
            0x08 => self.reload,
            0x0c => u32::from(now < self.busy) * 3,
            _ => 0,
        }
    }

    pub fn write(&mut self, offset: u32, value: u32, now: u64) {
        match (offset, value & 0xffff) {
            (0x00, 0x5555) => self.open = true,
            (0x00, 0xaaaa) => {
                self.open = false;
                self.feed(now);
            }
            (0x00, 0xcccc) => {
                self.open = false;
                self.running = true;
                self.feed(now);
            }
            (0x00, _) => self.open = false,
            (0x04, value) if self.open => {
                self.count = self.left(now);
                self.since = now;
                self.prescaler = value & 7;
                self.busy = now + self.passes();
            }
            (0x08, value) if self.open => {
                self.reload = value & 0xfff;
                self.busy = now + self.passes();
            }
            _ => {}
        }
    }

    fn passes(&self) -> u64 {
        (5.0 / self.clock * TICKS as f64) as u64
    }

    fn feed(&mut self, now: u64) {
        self.count = f64::from(self.reload);
        self.since = now;
    }

    /// Duration of a count, ticks.
    fn step(&self) -> f64 {
        f64::from(4_u32 << self.prescaler.min(6)) / self.clock * TICKS as f64
    }

    fn left(&self, now: u64) -> f64 {
        self.count - (now - self.since) as f64 / self.step()
    }

    /// Tick of its reset.
    pub fn due(&self) -> u64 {
        if self.running {
            self.since + (self.count.max(0.0) * self.step()) as u64 + 1
        } else {
            u64::MAX
        }
    }

    /// Suspends it for some ticks: a debugger halts the core and freezes it.
    pub fn suspend(&mut self, ticks: u64) {
        self.since += ticks;
    }
}

/// The window watchdog, on the clock of APB1.
#[derive(Clone, Debug, Default)]
pub struct Window {
    /// Bits of the prescaler in the configuration.
    prescaler: u32,
    control: u32,
    configuration: u32,
    pub early: bool,
    since: u64,
    /// Whether a write has caused its reset: too early, or below 0x40.
    reset_reason: bool,
}

impl Window {
    pub fn new(kind: Kind) -> Self {
        Self {
            prescaler: kind.facts().window_prescaler,
            control: 0x7f,
            configuration: 0x7f,
            ..Self::default()
        }
    }

    /// Whether it runs; only a reset stops it.
    pub fn running(&self) -> bool {
        self.control & 0x80 != 0
    }

    /// Duration of a count in ticks; `cycle` is that of an APB1 cycle.
    fn step(&self, cycle: u64) -> u64 {
        let code = self.configuration & self.prescaler;
        (cycle * 4096) << (code >> self.prescaler.trailing_zeros())
    }

    fn count(&self, now: u64, cycle: u64) -> u32 {
        if !self.running() {
            return self.control & 0x7f;
        }
        // The prescaler runs freely: a feed does not restart the current count.
        let step = self.step(cycle).max(1);
        let passed = now / step - self.since / step;
        (self.control & 0x7f).saturating_sub(passed.min(0x7f) as u32)
    }

    /// Tick of the next change of the count.
    pub fn counts_at(&self, now: u64, cycle: u64) -> u64 {
        if !self.running() {
            return u64::MAX;
        }
        let step = self.step(cycle).max(1);
        (now / step + 1) * step
    }

    pub fn read(&self, offset: u32, now: u64, cycle: u64) -> u32 {
        match offset {
            0x00 => self.control & 0x80 | self.count(now, cycle),
            0x04 => self.configuration,
            0x08 => self.early.into(),
            _ => 0,
        }
    }

    /// Writes a register. A reload outside the window, or below 0x40, causes a reset (22.3).
    pub fn write(&mut self, offset: u32, value: u32, now: u64, cycle: u64) {
        match offset {
            0x00 => {
                let running = self.running();
                let soon = running && self.count(now, cycle) > self.configuration & 0x7f;
                self.control = value & 0xff | u32::from(running) << 7;
                self.since = now;
                self.reset_reason |= soon || self.running() && self.control & 0x40 == 0;
            }
            0x04 => {
                self.control = self.control & 0x80 | self.count(now, cycle);
                self.since = now;
                self.configuration = value & (0x27f | self.prescaler);
            }
            0x08 => self.early &= value & 1 == 1,
            _ => {}
        }
    }

    /// Tick of its reset: the count falls from 0x40 to 0x3f.
    pub fn due(&self, cycle: u64) -> u64 {
        if self.reset_reason {
            return 0;
        }
        if !self.running() || cycle == 0 {
            return u64::MAX;
        }
        self.after((self.control & 0x7f).saturating_sub(0x3f), cycle)
    }

    /// Tick of its early warning, if enabled.
    pub fn warns(&self, cycle: u64) -> u64 {
        let is_enabled = self.configuration >> 9 & 1 == 1 && !self.early;
        if !self.running() || !is_enabled || cycle == 0 {
            return u64::MAX;
        }
        self.after((self.control & 0x7f).saturating_sub(0x40), cycle)
    }

    fn after(&self, counts: u32, cycle: u64) -> u64 {
        let step = self.step(cycle).max(1);
        (self.since / step + u64::from(counts)) * step
    }

    pub fn interrupts(&self) -> bool {
        self.early && self.configuration >> 9 & 1 == 1
    }

    pub fn pause(&mut self, ticks: u64) {
        self.since += ticks;
    }
}
