//! The chip but for its core: memory, peripherals and what is wired to them (RM0090, chapter 2).

use super::bridge::{Bridge, Came};
use super::check::Check;
use super::clocks::{Cause, Clocks, FASTEST, TICKS};
use super::converter::Converter;
use super::core::Bus;
use super::flash::{self, Flash};
use super::gpio::{Mode, Port, Wire};
use super::power::{LOWEST, Power, Supply};
use super::serial::Serial;
use super::system::{Asks, NMI, System};
use super::voltage::Voltage;
use super::watchdog::{Independent, WINDOW_CONTROL, Window};
use super::world::{STEP, Seen, World};

/// Where the RAM lies.
pub const MEMORY: u32 = 0x2000_0000;
const MEMORY_SIZE: usize = 128 * 1024;
const COUPLED: u32 = 0x1000_0000;
const COUPLED_SIZE: usize = 64 * 1024;
/// Identity of the chip, what stops with the core (38.16), flash size (39.2).
const IDENTITY: u32 = 0xe004_2000;
const STOPS_LOWER: u32 = 0xe004_2008;
const STOPS_UPPER: u32 = 0xe004_200c;
const FLASH_SIZE: u32 = 0x1fff_7a20;
/// Interrupts (12.2, table 62).
const WINDOW: u16 = 0;
const MONITOR: u16 = 1;
/// That of line 0, of the lines that a pin may have.
const EDGE: u16 = 6;
const CONVERTED: u16 = 18;
const TIMER_BREAK: u16 = 24;
const TIMER_UPDATE: u16 = 25;
const SERIAL: u16 = 37;
/// The line of the supply monitor in EXTI (12.2.5).
const MONITOR_LINE: u32 = 1 << 16;

/// Everything but the core.
#[derive(Clone, Debug)]
pub struct Board {
    /// Ticks since the beginning.
    pub now: u64,
    /// Cycles of the core since the beginning.
    pub cycles: u64,
    /// When something happens next.
    pub next: u64,
    /// Ticks that a cycle of the core takes; 0: it has no clock.
    pub cycle: u64,
    /// Cycles that the core waits for a memory, on top of its own.
    pub stall: u32,
    /// An interrupt may be due.
    pub attention: bool,
    /// Looks in a row at the status of the busy flash, with nothing written and nothing else read of registers between but the
    /// count of the window watchdog.
    pub looks: u32,
    /// Whether the floating-point unit is on.
    pub float: bool,
    /// A reset that is due.
    pub reset: Option<Cause>,
    /// Whether the supply is there.
    pub supplied: bool,
    /// Identity of the chip and its flash in KiB.
    pub identity: (u32, u32),
    /// Whether the core is halted by a debugger.
    pub halted: bool,
    /// Whether conversions are triggered; a converter that fails has none.
    pub converts: bool,
    /// The supply goes with this operation of the flash, counted from 1.
    pub cut_at: Option<u64>,
    /// Clocks.
    pub clocks: Clocks,
    /// Supply.
    pub power: Power,
    /// Flash.
    pub flash: Flash,
    /// RAM.
    pub ram: Vec<u8>,
    coupled: Vec<u8>,
    /// Ports A to I.
    pub ports: Vec<Port>,
    /// TIM1.
    pub bridge: Bridge,
    /// ADC1.
    pub converter: Converter,
    /// DAC.
    pub voltage: Voltage,
    /// CRC.
    pub check: Check,
    /// Memory that answers below the RAM; none on this chip.
    pub below: Vec<u8>,
    /// USART1 to USART3.
    pub serials: [Serial; 3],
    /// IWDG.
    pub watchdog: Independent,
    /// WWDG.
    pub window: Window,
    /// The core's own peripherals.
    pub system: System,
    /// External interrupts: masks, edges, pending.
    lines: [u32; 6],
    monitor: bool,
    configuration: [u32; 8],
    /// What stops with the core.
    stops: [u32; 3],
    /// What is around.
    pub world: World,
}

impl Default for Board {
    fn default() -> Self {
        Self {
            now: 0,
            cycles: 0,
            next: 0,
            cycle: 63,
            stall: 0,
            attention: false,
            looks: 0,
            float: false,
            reset: None,
            supplied: true,
            identity: (0x1007_6413, 1024),
            halted: false,
            converts: true,
            cut_at: None,
            clocks: Clocks::default(),
            power: Power::default(),
            flash: Flash::default(),
            ram: vec![0; MEMORY_SIZE],
            coupled: vec![0; COUPLED_SIZE],
            ports: (0..9).map(Port::new).collect(),
            bridge: Bridge::default(),
            converter: Converter::default(),
            voltage: Voltage::default(),
            check: Check::default(),
            below: Vec::new(),
            serials: Default::default(),
            watchdog: Independent::default(),
            window: Window::default(),
            system: System::default(),
            lines: [0; 6],
            monitor: false,
            configuration: [0; 8],
            stops: [0; 3],
            world: World::default(),
        }
    }
}

impl Board {
    /// The registers as a reset leaves them; the RAM and what a debugger set stay.
    pub fn reset(&mut self, cause: Cause) {
        self.world.see(self.now, Seen::Reset(cause));
        self.clocks.reset();
        self.clocks.note(cause);
        self.power.reset();
        self.flash.reset();
        self.ports.iter_mut().for_each(Port::reset);
        self.bridge.reset();
        self.converter.reset();
        self.voltage.reset();
        self.check = Check::default();
        self.serials.iter_mut().for_each(Serial::reset);
        self.watchdog
            .reset(self.flash.hardware_watchdog(), self.now);
        self.window.reset();
        self.system.reset();
        self.lines = [0; 6];
        self.monitor = false;
        self.configuration = [0; 8];
        self.reset = None;
        self.float = false;
        self.stall = 0;
        if cause == Cause::Power {
            self.stops = [0; 3];
        }
        self.refresh();
    }

    /// What the RAM holds where the supply was gone: noise.
    pub fn scramble(&mut self, seed: u64) {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        for byte in self.ram.iter_mut().chain(&mut self.coupled) {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            *byte = (state >> 24) as u8;
        }
    }

    /// The core's clock in Hz.
    #[must_use]
    pub fn clock(&self) -> u32 {
        self.clocks.core(self.now)
    }

    /// Follows what was changed: clocks, lines, what is seen, when something happens next.
    pub fn refresh(&mut self) {
        self.clock_tree();
        self.interrupts();
        self.look();
        self.schedule();
    }

    fn clock_tree(&mut self) {
        let core = self.clock();
        let cycle = if core == 0 {
            0
        } else {
            TICKS / u64::from(core)
        };
        if cycle != self.cycle {
            self.system.rescale(self.now, self.cycle, cycle);
            self.cycle = cycle;
            if core > FASTEST {
                let what = format!("the core at {} MHz", core / 1_000_000);
                self.world.violate(self.now, what);
            }
        }
        let stopped = self.halted && self.stops[2] & 1 != 0;
        let timer = cycle * u64::from(self.clocks.timer_divider(true));
        self.bridge
            .set_cycle(if stopped { 0 } else { timer }, self.now);
        for (serial, upper) in self.serials.iter_mut().zip([true, false, false]) {
            serial.set_cycle(cycle * u64::from(self.clocks.divider(upper)));
        }
    }

    /// Ticks of a cycle of APB1.
    fn lower(&self) -> u64 {
        self.cycle * u64::from(self.clocks.divider(false))
    }

    fn upper(&self) -> u64 {
        self.cycle * u64::from(self.clocks.divider(true))
    }

    fn interrupts(&mut self) {
        let system = &mut self.system;
        system.line(WINDOW, self.window.interrupts());
        system.line(MONITOR, self.lines[5] & self.lines[0] & MONITOR_LINE != 0);
        system.line(EDGE, self.lines[5] & self.lines[0] & 1 != 0);
        system.line(CONVERTED, self.converter.interrupts());
        let [update, broke] = self.bridge.interrupts();
        system.line(TIMER_UPDATE, update);
        system.line(TIMER_BREAK, broke);
        for (number, serial) in (SERIAL..).zip(&self.serials) {
            system.line(number, serial.interrupts());
        }
        if self.clocks.security() {
            system.pend(NMI);
        }
        self.attention = true;
    }

    /// The track gets what the bridge gives from `at` on; whether that is driven.
    fn drive(&mut self, at: u64) -> bool {
        let gates = [8, 7].map(|pin| self.ports[0].mode(pin) == Mode::Function(1));
        let driven = self.supplied && self.bridge.driven() && gates.contains(&true);
        let output = if driven { self.bridge.output(at) } else { 0.0 };
        self.world.drive(output, at);
        driven
    }

    /// What is seen from outside, and what must not be.
    fn look(&mut self) {
        let lamp = |port: usize, pin: usize| self.ports[port].output(pin) == Some(true);
        let outputs = [lamp(2, 3), lamp(2, 2), lamp(1, 11)];
        let driven = self.drive(self.now);
        let [drive_on, ready, fault] = outputs.map(|on| on && self.supplied);
        self.world.look(self.now, [driven, drive_on, ready, fault]);
    }

    fn schedule(&mut self) {
        if !self.supplied {
            self.next = self.world.due;
            return;
        }
        let lower = self.lower();
        let mut next = self.world.due.min(self.watchdog.due());
        if !self.halted {
            next = next.min(self.system.tick_due());
        }
        next = next
            .min(self.bridge.due())
            .min(self.converter.due())
            .min(self.window.due(lower))
            .min(self.window.warns(lower));
        for serial in &self.serials {
            next = next.min(serial.due());
        }
        self.next = next;
    }

    /// Everything that is due happens, in the order of time up to `now`. An instruction ends later than what is due within
    /// it: track, bridge and converter go by the time at which each is due, whatever the core executes.
    pub fn happen(&mut self) {
        let now = self.now;
        loop {
            let track = self.world.due;
            let (bridge, converter) = if self.supplied {
                (self.bridge.due(), self.converter.due())
            } else {
                (u64::MAX, u64::MAX)
            };
            let due = track.min(bridge).min(converter);
            if due > now {
                break;
            }
            if due == track {
                self.world.advance();
                self.check_supply(STEP);
            } else if due == bridge {
                let came = self.bridge.turn();
                self.came(came, due);
                self.drive(due);
            } else {
                self.convert(due);
            }
        }
        if !self.supplied {
            self.schedule();
            return;
        }
        while !self.halted && self.cycle > 0 && self.system.tick_due() <= now {
            self.system.tick(self.cycle);
        }
        for serial in &mut self.serials {
            while serial.due() <= now {
                serial.happen(now);
            }
        }
        self.watch();
        self.refresh();
    }

    /// The conversions that are due at `at` end.
    fn convert(&mut self, at: u64) {
        let (reading, others) = (self.world.reading, self.world.analogue);
        let reference = (1.21 / self.power.volts * 4096.0) as u16;
        self.converter.end(at, |channel| match channel {
            1 => reading,
            16 => (0.76 / 3.3 * 4096.0) as u16,
            17 => reference.min(4095),
            channel => others.get(channel as usize).copied().unwrap_or(0),
        });
    }

    fn watch(&mut self) {
        let lower = self.lower();
        if self.watchdog.due() <= self.now {
            self.reset = Some(Cause::Watchdog);
        }
        if self.window.warns(lower) <= self.now {
            self.window.warn();
        }
        if self.window.due(lower) <= self.now {
            self.reset = Some(Cause::Window);
        }
    }

    fn came(&mut self, came: Came, at: u64) {
        if came.trigger && self.converts {
            let upper = self.upper();
            self.converter.trigger(at, upper);
            if self.bridge.driven() {
                let sampled = self.converter.samples(upper) / self.cycle.max(1);
                let clear = self.bridge.clear(sampled as u32);
                self.world.clear = self.world.clear.min(clear);
            }
        }
    }

    /// A pin is wired to something else. An edge at a line that listens to it is pending (12.2.4), where the line is
    /// not masked: the manual's figure leaves open whether a masked line remembers.
    pub fn wire(&mut self, port: usize, pin: usize, wire: Wire) {
        let before = self.ports[port].level(pin);
        self.ports[port].wires[pin] = wire;
        let after = self.ports[port].level(pin);
        let chosen = self.configuration[2 + pin / 4] >> (4 * (pin % 4)) & 0xf;
        if before != after && chosen as usize == port {
            let edges = self.lines[if after { 2 } else { 3 }];
            self.lines[5] |= edges & self.lines[0] & 1 << pin;
        }
    }

    /// The level at the break input is looked at.
    pub fn break_input(&mut self, clock_failed: bool) {
        // A pin that is not the timer's gives it nothing.
        let ours = self.ports[1].mode(12) == Mode::Function(1);
        let high = ours && self.ports[1].level(12);
        if self.bridge.break_input(high, clock_failed) {
            self.look();
        }
    }

    /// The crystal stops.
    pub fn crystal_stops(&mut self) {
        let seen = self.clocks.crystal_stops(self.now);
        self.clock_tree();
        if seen {
            self.break_input(true);
        }
        self.refresh();
    }

    /// The supply is another from now on.
    pub fn set_volts(&mut self, volts: f64) {
        self.power.volts = volts;
        let below = self.power.look();
        if self.power.too_low_for_flash() {
            self.flash.weaken(self.now);
        }
        if below != self.monitor {
            self.monitor = below;
            let edges = self.lines[if below { 2 } else { 3 }];
            self.lines[5] |= edges & MONITOR_LINE;
        }
        match self.power.supply(self.flash.brown_out(), !self.supplied) {
            Supply::Enough => {}
            Supply::BrownOut => self.reset = Some(Cause::BrownOut),
            Supply::Gone => self.reset = Some(Cause::Power),
        }
        self.refresh();
    }

    /// Cycles of the core pass.
    #[inline]
    pub fn spend(&mut self, cycles: u32) {
        let cycles = u64::from(cycles + std::mem::take(&mut self.stall));
        self.cycles += cycles;
        self.now += cycles * self.cycle;
    }

    /// Time passes in which the core does nothing, up to `until`, or a reset.
    pub fn pass(&mut self, until: u64) {
        while self.now < until && self.reset.is_none() {
            self.now = self.next.clamp(self.now, until);
            if self.next <= self.now {
                self.happen();
            }
        }
    }

    /// Time passes with the core halted, up to `until`: what the debugger stops stands still.
    pub fn stand(&mut self, until: u64) {
        let from = self.now;
        self.pass(until);
        let ticks = self.now - from;
        self.system.stands(ticks);
        if self.stops[1] >> 12 & 1 == 1 {
            self.watchdog.stands(ticks);
        }
        if self.stops[1] >> 11 & 1 == 1 {
            self.window.stands(ticks);
        }
        self.schedule();
    }

    /// The core is outside its specification with the bridge driven: so many ticks more.
    fn check_supply(&mut self, ticks: u64) {
        if self.power.volts < LOWEST && self.clock() > 60_000_000 && self.bridge.driven() {
            self.world.outside += ticks;
        }
    }

    /// How long nothing changes that a core sees which looks at nothing but the flash's status and the window watchdog's count.
    #[must_use]
    pub fn is_still_until(&self) -> u64 {
        let counts = self.window.counts_at(self.now, self.lower());
        self.next.min(self.flash.busy()).min(counts)
    }

    /// The flash is busy: whoever reads it waits.
    fn wait_for_flash(&mut self) {
        if self.flash.busy() > self.now && self.cycle > 0 {
            let until = self.flash.busy();
            self.pass(until);
        }
    }

    fn unclocked(&mut self, address: u32, what: &str) -> bool {
        if self.clocks.enabled(address) {
            return false;
        }
        let what = format!("{what} {address:#010x}, whose clock is off");
        self.world.violate(self.now, what);
        true
    }

    fn register(&mut self, address: u32) -> u32 {
        if self.now >= self.next {
            self.happen();
        }
        if self.unclocked(address, "reads") {
            return 0;
        }
        let (now, lower) = (self.now, self.lower());
        let offset = address & 0x3ff;
        match address {
            flash::STATUS if self.flash.busy() > now => {
                self.looks = self.looks.saturating_add(1);
                self.attention = true;
            }
            WINDOW_CONTROL => {}
            _ => self.looks = 0,
        }
        match address {
            0x4000_2c00..0x4000_3000 => self.window.read(offset, now, lower),
            0x4000_3000..0x4000_3400 => self.watchdog.read(offset, now),
            0x4000_4400..0x4000_4c00 => {
                self.serials[1 + (address - 0x4000_4400) as usize / 0x400].read(offset)
            }
            0x4000_7000..0x4000_7400 => self.power.read(offset),
            0x4000_7400..0x4000_7800 => self.voltage.read(offset),
            0x4001_0000..0x4001_0400 => self.bridge.read(offset, now),
            0x4001_1000..0x4001_1400 => self.serials[0].read(offset),
            0x4001_2000..0x4001_2400 => self.converter.read(offset),
            0x4001_3800..0x4001_3c00 => self.word(|board| &mut board.configuration, offset),
            0x4001_3c00..0x4001_4000 => self.word(|board| &mut board.lines, offset),
            0x4002_0000..0x4002_2400 => {
                self.ports[(address - 0x4002_0000) as usize / 0x400].read(offset)
            }
            0x4002_3000..0x4002_3400 => self.check.read(offset),
            0x4002_3800..0x4002_3c00 => self.clocks.read(offset, now),
            0x4002_3c00..0x4002_4000 => self.flash.register(offset, now),
            _ => {
                let what = format!("reads {address:#010x}, of which there is no model");
                self.world.violate(now, what);
                0
            }
        }
    }

    fn word<const N: usize>(
        &mut self,
        words: impl Fn(&mut Self) -> &mut [u32; N],
        offset: u32,
    ) -> u32 {
        words(self).get(offset as usize / 4).copied().unwrap_or(0)
    }

    fn set_register(&mut self, address: u32, value: u32) {
        if self.now >= self.next {
            self.happen();
        }
        if self.unclocked(address, "writes") {
            return;
        }
        let (now, lower, upper) = (self.now, self.lower(), self.upper());
        let operations = self.flash.operations;
        let offset = address & 0x3ff;
        match address {
            0x4000_2c00..0x4000_3000 => self.window.write(offset, value, now, lower),
            0x4000_3000..0x4000_3400 => self.watchdog.write(offset, value, now),
            0x4000_4400..0x4000_4c00 => {
                self.serials[1 + (address - 0x4000_4400) as usize / 0x400]
                    .write(offset, value, now);
            }
            0x4000_7000..0x4000_7400 => self.power.write(offset, value),
            0x4000_7400..0x4000_7800 => self.voltage.write(offset, value),
            0x4001_0000..0x4001_0400 => {
                let came = self.bridge.write(offset, value, now);
                self.came(came, now);
                self.break_input(false);
            }
            0x4001_1000..0x4001_1400 => self.serials[0].write(offset, value, now),
            0x4001_2000..0x4001_2400 => self.converter.write(offset, value, now, upper),
            0x4001_3800..0x4001_3c00 => {
                if let Some(word) = self.configuration.get_mut(offset as usize / 4) {
                    *word = value;
                }
            }
            0x4001_3c00..0x4001_4000 => match offset {
                0x14 => self.lines[5] &= !value,
                0x10 => self.lines[5] |= value & self.lines[0],
                offset => {
                    if let Some(word) = self.lines.get_mut(offset as usize / 4) {
                        *word = value;
                    }
                }
            },
            0x4002_0000..0x4002_2400 => {
                self.ports[(address - 0x4002_0000) as usize / 0x400].write(offset, value);
                self.break_input(false);
            }
            0x4002_3000..0x4002_3400 => {
                // The bus waits for the unit.
                self.stall += 4;
                self.check.write(offset, value);
                return;
            }
            0x4002_3800..0x4002_3c00 => self.clocks.write(offset, value, now),
            0x4002_3c00..0x4002_4000 => self.flash.set_register(offset, value, now),
            _ => {
                let what = format!("writes {address:#010x}, of which there is no model");
                self.world.violate(now, what);
            }
        }
        self.operated(operations);
        self.watch();
        self.refresh();
    }

    /// An operation of the flash was begun, beyond the `before` that there were: the supply may go with it.
    fn operated(&mut self, before: u64) {
        if self.flash.operations == before {
            return;
        }
        if self.power.too_low_for_flash() {
            let what = format!("works on the flash at {:.2} V", self.power.volts);
            self.world.violate(self.now, what);
        }
        if std::mem::take(&mut self.flash.programmed_weak) {
            let what = "programs a sector whose erasure did not end".to_owned();
            self.world.violate(self.now, what);
        }
        if self
            .cut_at
            .is_some_and(|count| self.flash.operations >= count)
        {
            self.cut_at = None;
            self.reset = Some(Cause::Power);
        }
    }

    fn own(&mut self, address: u32) -> u32 {
        self.looks = 0;
        match address {
            IDENTITY => self.identity.0,
            0xe004_2004 => self.stops[0],
            STOPS_LOWER => self.stops[1],
            STOPS_UPPER => self.stops[2],
            address => self.system.read(address, self.now, self.cycle, self.cycles),
        }
    }

    fn set_own(&mut self, address: u32, size: u32, value: u32) -> Asks {
        match address {
            0xe004_2004 => self.stops[0] = value,
            STOPS_LOWER => self.stops[1] = value,
            STOPS_UPPER => self.stops[2] = value,
            address => {
                let (now, cycle, cycles) = (self.now, self.cycle, self.cycles);
                let asks = self.system.write(address, size, value, now, cycle, cycles);
                self.attention = true;
                self.schedule();
                return asks;
            }
        }
        Asks::Nothing
    }

    /// What lies outside the RAM.
    #[inline(never)]
    fn load_elsewhere(&mut self, address: u32, size: u32) -> Option<u32> {
        match address >> 28 {
            1 if self.system.is_guarded(address) => None,
            1 if address >= self.lowest() => {
                number(&self.below, (address - self.lowest()) as usize, size)
            }
            0 if address < 0x0010_0000 || flash::RANGE.contains(&address) => {
                self.wait_for_flash();
                let at = (address & 0x000f_ffff) as usize;
                let (stall, old) = self.flash.read(flash::START + at as u32);
                self.stall += stall;
                if old {
                    let what = "reads data that its cache kept over an erasure".to_owned();
                    self.world.violate(self.now, what);
                }
                number(&self.flash.bytes, at, size)
            }
            1 if address < COUPLED + COUPLED_SIZE as u32 => {
                number(&self.coupled, (address - COUPLED) as usize, size)
            }
            1 => match address & !3 {
                FLASH_SIZE => Some(self.identity.1 << 16 >> (8 * (address & 3))),
                0x1fff_7a10..=0x1fff_7a1c => Some(0x0039_0020),
                0x1fff_c000..=0x1fff_c00c => Some(self.flash.options() >> 8 & 0xffff),
                _ => None,
            },
            4 | 5 => Some(self.register(address & !3) >> (8 * (address & 3))),
            0xe => Some(self.own(address & !3) >> (8 * (address & 3))),
            _ => None,
        }
    }

    #[inline(never)]
    fn store_elsewhere(&mut self, address: u32, size: u32, value: u32) -> Option<()> {
        let lowest = self.lowest();
        match address >> 28 {
            1 if self.system.is_guarded(address) => None,
            1 if address >= lowest => {
                put(&mut self.below, (address - lowest) as usize, size, value)
            }
            0 if flash::RANGE.contains(&address) => {
                self.wait_for_flash();
                let (now, before) = (self.now, self.flash.operations);
                let at = (address - flash::START) as usize;
                self.flash.program(at, size, value, now);
                self.operated(before);
                Some(())
            }
            1 => put(
                &mut self.coupled,
                address.wrapping_sub(COUPLED) as usize,
                size,
                value,
            ),
            4 | 5 => {
                let word = address & !3;
                let value = if size == 4 {
                    value
                } else {
                    // A part of a register is written with the rest as it is, but where a write of 0 does nothing.
                    let shift = 8 * (address & 3);
                    let mask = (1_u32 << (8 * size)).wrapping_sub(1) << shift;
                    self.register(word) & !mask | value << shift & mask
                };
                self.set_register(word, value);
                Some(())
            }
            0xe => {
                match self.set_own(address, size, value) {
                    Asks::Reset => self.reset = Some(Cause::Software),
                    Asks::Float(on) => self.float = on,
                    Asks::Nothing => {}
                }
                Some(())
            }
            _ => None,
        }
    }

    /// Where the memory below the RAM begins.
    fn lowest(&self) -> u32 {
        MEMORY - self.below.len() as u32
    }

    /// An instruction: what it waits for its line is counted with the line.
    #[inline(never)]
    fn fetch_elsewhere(&mut self, address: u32) -> Option<u32> {
        if address < 0x0010_0000 || flash::RANGE.contains(&address) {
            self.wait_for_flash();
            return number(&self.flash.bytes, (address & 0x000f_ffff) as usize, 2);
        }
        self.load_elsewhere(address, 2)
    }
}

/// Bytes of a memory as a number.
#[inline]
fn number(bytes: &[u8], at: usize, size: u32) -> Option<u32> {
    let bytes = bytes.get(at..)?;
    match size {
        4 => bytes.first_chunk().map(|word| u32::from_le_bytes(*word)),
        2 => bytes
            .first_chunk()
            .map(|half| u16::from_le_bytes(*half).into()),
        1 => bytes.first().map(|byte| (*byte).into()),
        _ => None,
    }
}

#[inline]
fn put(bytes: &mut [u8], at: usize, size: u32, value: u32) -> Option<()> {
    let bytes = bytes.get_mut(at..)?;
    match size {
        4 => *bytes.first_chunk_mut()? = value.to_le_bytes(),
        2 => *bytes.first_chunk_mut()? = (value as u16).to_le_bytes(),
        1 => *bytes.first_mut()? = value as u8,
        _ => return None,
    }
    Some(())
}

impl Bus for Board {
    #[inline]
    fn load(&mut self, address: u32, size: u32) -> Option<u32> {
        let at = address.wrapping_sub(MEMORY) as usize;
        number(&self.ram, at, size).or_else(|| self.load_elsewhere(address, size))
    }

    #[inline]
    fn store(&mut self, address: u32, size: u32, value: u32) -> Option<()> {
        self.looks = 0;
        let at = address.wrapping_sub(MEMORY) as usize;
        put(&mut self.ram, at, size, value).or_else(|| self.store_elsewhere(address, size, value))
    }

    #[inline]
    fn fetch(&mut self, address: u32) -> Option<u16> {
        let at = address.wrapping_sub(MEMORY) as usize;
        let half = number(&self.ram, at, 2).or_else(|| self.fetch_elsewhere(address));
        half.map(|half| half as u16)
    }

    #[inline]
    fn line(&mut self, address: u32) {
        if flash::RANGE.contains(&address) {
            self.wait_for_flash();
            self.stall += self.flash.fetch(address);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SYSTEM_CONFIGURATION_CLOCK: (u32, u32) = (0x4002_3844, 1 << 14);
    const CHOICE: u32 = 0x4001_3808;
    const MASK: u32 = 0x4001_3c00;
    const RISING: u32 = 0x4001_3c08;
    const FALLING: u32 = 0x4001_3c0c;
    const PENDING: u32 = 0x4001_3c14;

    #[test]
    fn an_edge_is_pending_where_an_unmasked_line_listens_to_it() {
        let mut board = Board::default();
        let mut pends = |mask: u32, edges: [u32; 2], port: u32, wire: Wire| {
            board.store(
                SYSTEM_CONFIGURATION_CLOCK.0,
                4,
                SYSTEM_CONFIGURATION_CLOCK.1,
            );
            board.store(CHOICE, 4, port);
            board.store(MASK, 4, mask);
            board.store(RISING, 4, edges[0]);
            board.store(FALLING, 4, edges[1]);
            board.wire(1, 0, wire);
            let pending = board.load(PENDING, 4) == Some(1);
            board.store(PENDING, 4, 1);
            assert_eq!(board.load(PENDING, 4), Some(0), "a one clears it");
            pending
        };
        assert!(pends(1, [1, 0], 1, Wire::High));
        assert!(!pends(1, [1, 0], 1, Wire::Low), "falling");
        assert!(!pends(1, [0, 1], 1, Wire::High), "rising");
        assert!(pends(1, [0, 1], 1, Wire::Low));
        assert!(!pends(0, [1, 1], 1, Wire::High), "masked");
        assert!(!pends(1, [1, 1], 1, Wire::High), "as before");
        assert!(!pends(1, [1, 1], 0, Wire::Low), "port A's");
    }
}
