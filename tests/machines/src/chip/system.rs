//! Model of the core's own peripherals: interrupts, faults, SysTick, cycle counter (ARM DDI 0403E,
//! chapters B1 to B3, C1).

pub const NMI: u16 = 2;
pub const HARD_FAULT: u16 = 3;
const SYSTICK: u16 = 15;
const INTERRUPTS: u16 = 16;
/// Priority below any other: no exception is active.
const IDLE: i32 = 256;

#[derive(Clone, Debug, Default)]
pub struct System {
    pending: u128,
    enabled: u128,
    active: u128,
    lines: u128,
    /// Priority of each exception, sixteen in a row.
    priorities: [[u8; 16]; 7],
    vectors: u32,
    /// Configurable fault status (CFSR).
    pub fault_status: u32,
    access: u32,
    /// Memory protection: control, region number, and base address and attributes of each region.
    pub(super) protection: u32,
    region: usize,
    regions: [(u32, u32); 8],
    tick_control: u32,
    tick_reload: u32,
    /// Tick at which SysTick next wraps.
    pub tick_due: u64,
    tick_left: u64,
    cycles_from: u64,
    counts: bool,
    /// Debug exception and monitor control: vector catch of a reset, trace enable.
    pub debug: u32,
}

impl System {
    pub fn new() -> Self {
        Self {
            enabled: (1 << INTERRUPTS) - 1,
            tick_due: u64::MAX,
            ..Self::default()
        }
    }

    pub fn reset(&mut self) {
        *self = Self {
            debug: self.debug,
            ..Self::new()
        };
    }

    pub fn pend(&mut self, number: u16) {
        self.pending |= 1 << number;
    }

    /// Sets an interrupt's line; a rising edge makes it pending.
    pub fn line(&mut self, interrupt: u16, high: bool) {
        let bit = 1_u128 << (INTERRUPTS + interrupt);
        if high {
            self.pending |= bit & !self.lines;
            self.lines |= bit;
        } else {
            self.lines &= !bit;
        }
    }

    fn priority(&self, number: u16) -> i32 {
        match number {
            NMI => -2,
            HARD_FAULT => -1,
            number => self.priorities.as_flattened()[usize::from(number)].into(),
        }
    }

    /// Priority and number of the first exception of a set; number 0 of an empty one.
    fn first(&self, mut set: u128) -> (i32, u16) {
        let mut first = (IDLE, 0);
        while set != 0 {
            let number = set.trailing_zeros() as u16;
            set &= set - 1;
            first = first.min((self.priority(number), number));
        }
        first
    }

    /// Priority of the active exception (B1.5.4), with the mask of the core (PRIMASK).
    pub fn running(&self, mask: bool) -> i32 {
        let active = self.first(self.active).0;
        if mask { active.min(0) } else { active }
    }

    /// The exception to enter next.
    pub fn due(&self, mask: bool) -> Option<u16> {
        let pending = self.pending & self.enabled;
        if pending == 0 {
            return None;
        }
        let (priority, number) = self.first(pending);
        (priority < self.running(mask)).then_some(number)
    }

    pub fn enter(&mut self, number: u16) {
        self.pending &= !(1 << number);
        self.active |= 1 << number;
    }

    /// Leaves an exception; a line that is still high makes it pending again.
    pub fn leave(&mut self, number: u16) {
        let bit = 1_u128 << number;
        self.active &= !bit;
        self.pending |= self.lines & bit;
    }

    pub fn vector(&self, number: u16) -> u32 {
        self.vectors + 4 * u32::from(number)
    }

    /// Whether a no-access region of the memory protection covers an address below the RAM
    /// (B3.5.3). Other regions are not modelled.
    pub fn is_guarded(&self, address: u32) -> bool {
        self.protection & 1 == 1
            && self.regions.iter().any(|&(base, attributes)| {
                let size = 2_u64 << (attributes >> 1 & 0x1f);
                let within = (u64::from(base)..u64::from(base) + size).contains(&address.into());
                attributes & 1 == 1 && attributes >> 24 & 7 == 0 && within
            })
    }

    /// Wraps SysTick; a core cycle takes `cycle` ticks.
    pub fn tick(&mut self, cycle: u64) {
        self.tick_due += (u64::from(self.tick_reload) + 1) * self.tick_step(cycle).max(1);
        self.tick_control |= 1 << 16;
        if self.tick_control & 2 != 0 {
            self.pend(SYSTICK);
        }
    }

    /// Duration of a SysTick count, ticks: one or eight core cycles.
    fn tick_step(&self, cycle: u64) -> u64 {
        let cycles = if self.tick_control & 4 != 0 { 1 } else { 8 };
        cycles * cycle
    }

    /// Changes the core's cycle at tick `now` from `old` to `new` ticks; 0 stops it.
    pub fn rescale(&mut self, now: u64, old: u64, new: u64) {
        if self.tick_control & 1 == 0 {
            return;
        }
        let left = self.tick_due.saturating_sub(now);
        self.tick_left = left.checked_div(old).unwrap_or(self.tick_left);
        let due = now + self.tick_left * new;
        self.tick_due = if new > 0 { due } else { u64::MAX };
    }

    /// Suspends all counters for some ticks while the core is halted.
    pub fn pause(&mut self, ticks: u64) {
        self.tick_due = self.tick_due.saturating_add(ticks);
    }

    /// Reads a register; a core cycle takes `cycle` ticks, and `cycles` of them have passed.
    pub fn read(&mut self, address: u32, now: u64, cycle: u64, cycles: u64) -> u32 {
        let bits = |set: u128, from: u32| (set >> (16 + 8 * from)) as u32;
        match address {
            0xe000_1000 => 0x4000_0000 | u32::from(self.counts),
            0xe000_1004 if self.counts => cycles.wrapping_sub(self.cycles_from) as u32,
            0xe000_1004 => self.cycles_from as u32,
            0xe000_e010 => {
                let value = self.tick_control;
                self.tick_control &= !(1 << 16);
                value
            }
            0xe000_e014 => self.tick_reload,
            0xe000_e018 if self.tick_due != u64::MAX => {
                (self.tick_due.saturating_sub(now) / self.tick_step(cycle).max(1)) as u32
                    & 0xff_ffff
            }
            0xe000_e100..0xe000_e110 | 0xe000_e180..0xe000_e190 => {
                bits(self.enabled, address & 0xf)
            }
            0xe000_e200..0xe000_e210 | 0xe000_e280..0xe000_e290 => {
                bits(self.pending, address & 0xf)
            }
            0xe000_e300..0xe000_e310 => bits(self.active, address - 0xe000_e300),
            0xe000_e400..0xe000_e460 => self.priority_word(address - 0xe000_e400 + 16),
            0xe000_ed00 => 0x410f_c241,
            0xe000_ed04 => {
                let (_, handled) = self.first(self.active);
                u32::from(handled) | ((self.pending >> SYSTICK & 1) as u32) << 26
            }
            0xe000_ed08 => self.vectors,
            0xe000_ed18..0xe000_ed24 => self.priority_word(address - 0xe000_ed18 + 4),
            0xe000_ed28 => self.fault_status,
            0xe000_ed88 => self.access,
            0xe000_ed94 => self.protection,
            0xe000_edfc => self.debug,
            _ => 0,
        }
    }

    fn priority_word(&self, first: u32) -> u32 {
        let at = first as usize;
        let all = self.priorities.as_flattened();
        let bytes = [0, 1, 2, 3].map(|n| all.get(at + n).copied().unwrap_or(0));
        u32::from_le_bytes(bytes)
    }

    /// Writes a register of `size` bytes; returns whether it requests a reset.
    pub fn write(
        &mut self,
        address: u32,
        size: u32,
        value: u32,
        now: u64,
        cycle: u64,
        cycles: u64,
    ) -> bool {
        let bits = |from: u32| u128::from(value) << (16 + 8 * from);
        let mut set_priorities = |first: u32| {
            let all = self.priorities.as_flattened_mut().iter_mut();
            let bytes = value.to_le_bytes().into_iter().take(size as usize);
            for (place, byte) in all.skip(first as usize).zip(bytes) {
                *place = byte & 0xf0;
            }
        };
        match address {
            0xe000_1000 => {
                let counts = value & 1 == 1 && self.debug >> 24 & 1 == 1;
                if counts != self.counts {
                    self.cycles_from = cycles.wrapping_sub(self.cycles_from);
                    self.counts = counts;
                }
            }
            0xe000_1004 => {
                let value = u64::from(value);
                let counted = cycles.wrapping_sub(value);
                self.cycles_from = if self.counts { counted } else { value };
            }
            0xe000_e010 => {
                let started = value & 1 == 1 && self.tick_control & 1 == 0;
                self.tick_control = self.tick_control & 1 << 16 | value & 7;
                if value & 1 == 0 {
                    self.tick_due = u64::MAX;
                } else if started {
                    self.restart_tick(now, cycle);
                }
            }
            0xe000_e014 => self.tick_reload = value & 0xff_ffff,
            0xe000_e018 => {
                self.tick_control &= !(1 << 16);
                if self.tick_control & 1 == 1 {
                    self.restart_tick(now, cycle);
                }
            }
            0xe000_e100..0xe000_e110 => self.enabled |= bits(address - 0xe000_e100),
            0xe000_e180..0xe000_e190 => self.enabled &= !bits(address - 0xe000_e180),
            0xe000_e200..0xe000_e210 => self.pending |= bits(address - 0xe000_e200),
            0xe000_e280..0xe000_e290 => self.pending &= !bits(address - 0xe000_e280),
            0xe000_e400..0xe000_e460 => set_priorities(address - 0xe000_e400 + 16),
            0xe000_ed18..0xe000_ed24 => set_priorities(address - 0xe000_ed18 + 4),
            0xe000_ed08 => self.vectors = value & !0x7f,
            0xe000_ed0c => return value >> 16 == 0x5fa && value & 4 != 0,
            0xe000_ed28 => self.fault_status &= !value,
            0xe000_ed88 => self.access = value,
            0xe000_ed94 => self.protection = value & 7,
            0xe000_ed98 => self.region = (value & 7) as usize,
            0xe000_ed9c => self.regions[self.region].0 = value & !0x1f,
            0xe000_eda0 => self.regions[self.region].1 = value,
            0xe000_edfc => self.debug = value,
            _ => {}
        }
        false
    }

    /// Whether the floating-point unit is on (CPACR).
    pub fn float(&self) -> bool {
        self.access >> 20 & 0xf == 0xf
    }

    fn restart_tick(&mut self, now: u64, cycle: u64) {
        let step = self.tick_step(cycle);
        let due = now + (u64::from(self.tick_reload) + 1) * step;
        self.tick_due = if step > 0 { due } else { u64::MAX };
    }
}
