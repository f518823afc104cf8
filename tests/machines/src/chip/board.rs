//! Model of the chip without its core: memory, peripherals and external connections (RM0090,
//! chapter 2).

use super::bridge::Bridge;
use super::check::Check;
use super::clocks::{Cause, Clocks, START_CYCLE, TICKS};
use super::converter::Converter;
use super::core::NO_LINE;
use super::flash::{self, Flash};
use super::gpio::{Mode, Port, Wire};
use super::kind::{Block, Kind};
use super::power::{Power, Supply};
use super::serial::Serial;
use super::system::{NMI, System};
use super::voltage::Voltage;
use super::watchdog::{Independent, Window};
use super::world::{Event, STEP, World};
use super::{set_word, word};
use kband::arithmetic::Noise;

pub const MEMORY: u32 = 0x2000_0000;
const MEMORY_SIZE: usize = 128 * 1024;
/// Addresses: flash size of the STM32F405 in the upper half (39.2), identity of the chip, debug
/// freeze registers of both buses (38.16).
const FLASH_SIZE: u32 = 0x1fff_7a20;
const IDENTITY: u32 = 0xe004_2000;
const STOPS_LOWER: u32 = 0xe004_2008;
const STOPS_UPPER: u32 = 0xe004_200c;
/// Interrupt numbers (12.2, table 62).
const WINDOW: u16 = 0;
const MONITOR: u16 = 1;
/// Interrupt number of EXTI line 0.
const EDGE: u16 = 6;
const CONVERTED: u16 = 18;
const TIMER_BREAK: u16 = 24;
const TIMER_UPDATE: u16 = 25;
const LINK: u16 = 38;
const FIELDBUS: u16 = 52;
/// EXTI line of the supply monitor (12.2.5).
const MONITOR_LINE: u32 = 1 << 16;
/// Breaks of TIM1 by the chip itself in SYSCFG_CFGR2 of the STM32G474 (RM0440, 10.2.8): core
/// lock-up, supply monitor, two wrong bits in the flash.
const BREAKS: usize = 0x1c / 4;
const BREAK_BY_LOCKUP: u32 = 1;
const BREAK_BY_MONITOR: u32 = 1 << 2;
const BREAK_BY_FLASH: u32 = 1 << 3;

#[derive(Clone, Debug)]
pub struct Board {
    pub kind: Kind,
    /// Time since the start, ticks.
    pub now: u64,
    /// Number of core cycles since the start.
    pub(super) cycles: u64,
    /// Tick of the next event.
    pub(super) next: u64,
    /// Duration of a core cycle, ticks; 0 without a clock.
    pub cycle: u64,
    /// Core cycles spent waiting for memory, beyond an instruction's own.
    pub stall: u32,
    /// Whether an interrupt may be due.
    pub attention: bool,
    /// Whether the floating-point unit is on.
    pub float: bool,
    /// Address / 16 of the fetched line of the flash, from its fetch to the next flash operation.
    pub fetched: u32,
    pub reset: Option<Cause>,
    pub supplied: bool,
    /// Identity of the chip, and its flash size in KiB.
    pub identity: (u32, u32),
    /// Whether the core is halted by a debugger.
    pub halted: bool,
    /// Whether conversions are triggered; false for a failed converter.
    pub converts: bool,
    /// Number of the flash operation, from 1, at which the supply fails.
    pub cut_at: Option<u64>,
    pub clocks: Clocks,
    power: Power,
    pub flash: Flash,
    pub ram: Vec<u8>,
    /// Ports A to I.
    pub ports: Vec<Port>,
    /// TIM1.
    pub bridge: Bridge,
    converter: Converter,
    /// DAC.
    pub voltage: Voltage,
    check: Check,
    /// Memory below the RAM; this chip has none.
    pub memory_below_ram: Vec<u8>,
    /// USART2.
    pub link: Serial,
    /// UART4.
    pub fieldbus: Serial,
    /// IWDG.
    pub watchdog: Independent,
    window: Window,
    pub(super) system: System,
    /// EXTI registers: masks, edges, pending.
    lines: [u32; 6],
    monitor: bool,
    configuration: [u32; 8],
    stops: [u32; 2],
    pub world: World,
}

impl Board {
    pub fn new(kind: Kind) -> Self {
        Self {
            kind,
            now: 0,
            cycles: 0,
            next: 0,
            cycle: START_CYCLE,
            stall: 0,
            attention: false,
            float: false,
            fetched: NO_LINE,
            reset: None,
            supplied: true,
            identity: kind.facts().identity,
            halted: false,
            converts: true,
            cut_at: None,
            clocks: Clocks::new(kind),
            power: Power::new(kind),
            flash: Flash::new(kind),
            ram: vec![0; MEMORY_SIZE],
            ports: vec![Port::default(); 9],
            bridge: Bridge::new(kind),
            converter: Converter::new(kind),
            voltage: Voltage::default(),
            check: Check::default(),
            memory_below_ram: Vec::new(),
            link: Serial::new(kind),
            fieldbus: Serial::new(kind),
            watchdog: Independent::new(),
            window: Window::new(kind),
            system: System::new(),
            lines: [0; 6],
            monitor: false,
            configuration: [0; 8],
            stops: [0; 2],
            world: World::default(),
        }
    }

    /// Resets the registers; the RAM and the debugger's settings stay.
    pub fn reset(&mut self, cause: Cause) {
        self.world.record(self.now, Event::Reset(cause));
        self.clocks.reset();
        self.clocks.note(cause);
        self.power.reset();
        self.flash.reset();
        self.ports.iter_mut().for_each(Port::reset);
        self.bridge.reset();
        self.converter = Converter::new(self.kind);
        self.voltage = Voltage::default();
        self.check = Check::default();
        self.link.reset();
        self.fieldbus.reset();
        self.watchdog
            .reset(self.flash.hardware_watchdog(), self.now);
        self.window = Window::new(self.kind);
        self.system.reset();
        self.lines = [0; 6];
        self.monitor = false;
        self.configuration = [0; 8];
        self.reset = None;
        self.float = false;
        self.stall = 0;
        if cause == Cause::Power {
            self.stops = [0; 2];
        }
        self.refresh();
    }

    /// Fills the RAM with noise, as after a loss of the supply.
    pub fn scramble(&mut self, seed: u64) {
        let mut noise = Noise::new(seed);
        for byte in &mut self.ram {
            *byte = noise.bits() as u8;
        }
    }

    /// Frequency of the core's clock, Hz.
    pub fn clock(&self) -> u32 {
        self.clocks.core(self.now)
    }

    /// Updates clocks, lines, trace and the next event after a change.
    pub fn refresh(&mut self) {
        self.clock_tree();
        self.interrupts();
        self.update_trace();
        self.schedule();
    }

    fn clock_tree(&mut self) {
        let core = self.clock();
        let cycle = TICKS.checked_div(core.into()).unwrap_or(0);
        if cycle != self.cycle {
            self.system.rescale(self.now, self.cycle, cycle);
            self.cycle = cycle;
        }
        if core > self.power.fastest() {
            let [core, limit] = [core, self.power.fastest()].map(|clock| clock / 1_000_000);
            let what = format!("the core at {core} MHz, above its limit of {limit} MHz");
            self.world.violate(self.now, what);
        }
        // TIM1 of the STM32F405.
        let stopped = self.halted && self.stops[1] & 1 != 0;
        let timer = cycle * u64::from(self.clocks.timer_divider());
        self.bridge
            .set_cycle(if stopped { 0 } else { timer }, self.now);
        self.link.cycle = self.lower();
        self.fieldbus.cycle = self.lower();
    }

    /// Duration of an APB1 cycle, ticks.
    fn lower(&self) -> u64 {
        self.cycle * u64::from(self.clocks.divider(false))
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
        system.line(LINK, self.link.interrupts());
        system.line(FIELDBUS, self.fieldbus.interrupts());
        if self.clocks.security() {
            system.pend(NMI);
        }
        self.attention = true;
    }

    /// Drives the track with the bridge's output from tick `at`; returns whether it is driven.
    fn drive(&mut self, at: u64) -> bool {
        let ours = Mode::Function(self.kind.facts().timer_function);
        let gates = [8, 7].map(|pin| self.ports[0].mode(pin) == ours);
        let driven = self.supplied && self.bridge.driven() && gates.contains(&true);
        let output = if driven { self.bridge.output(at) } else { 0.0 };
        self.world.drive(output, at);
        driven
    }

    fn update_trace(&mut self) {
        let lamp = |port: usize, pin: usize| self.ports[port].output(pin) == Some(true);
        let outputs = [lamp(2, 3), lamp(2, 2), lamp(1, 11), lamp(2, 12)];
        let driven = self.drive(self.now);
        let [drive_on, ready, fault, bus_driver] = outputs.map(|on| on && self.supplied);
        let levels = [driven, drive_on, ready, fault, bus_driver];
        self.world.record_changes(self.now, levels);
    }

    fn schedule(&mut self) {
        if !self.supplied {
            self.next = self.world.due;
            return;
        }
        let lower = self.lower();
        let tick = if self.halted {
            u64::MAX
        } else {
            self.system.tick_due
        };
        self.next = (self.world.due.min(tick))
            .min(self.watchdog.due())
            .min(self.bridge.due())
            .min(self.converter.due)
            .min(self.window.due(lower))
            .min(self.window.warns(lower))
            .min(self.link.due())
            .min(self.fieldbus.due());
    }

    pub(super) fn run_due(&mut self) {
        if self.next <= self.now {
            self.run_events();
        }
    }

    /// Executes all events up to `now` in order of time. An instruction may end after an event.
    /// Track, bridge and converter use the event's own time.
    fn run_events(&mut self) {
        let now = self.now;
        loop {
            let track = self.world.due;
            let (bridge, converter) = if self.supplied {
                (self.bridge.due(), self.converter.due)
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
                let triggers = self.bridge.turn();
                self.trigger(triggers, due);
                self.drive(due);
            } else {
                self.convert();
            }
        }
        if !self.supplied {
            self.schedule();
            return;
        }
        while !self.halted && self.cycle > 0 && self.system.tick_due <= now {
            self.system.tick(self.cycle);
        }
        for serial in [&mut self.link, &mut self.fieldbus] {
            while serial.due() <= now {
                serial.run_events(now);
            }
        }
        self.watch();
        self.refresh();
    }

    fn convert(&mut self) {
        let [accelerometer, current] = self.kind.facts().channels;
        self.converter.end(|channel| match channel {
            channel if channel == accelerometer => self.world.reading,
            channel if channel == current => self.world.current,
            _ => 0,
        });
    }

    fn watch(&mut self) {
        let lower = self.lower();
        if self.watchdog.due() <= self.now {
            self.reset = Some(Cause::Watchdog);
        }
        if self.window.warns(lower) <= self.now {
            self.window.early = true;
        }
        if self.window.due(lower) <= self.now {
            self.reset = Some(Cause::Window);
        }
    }

    /// Triggers the converter at tick `at` if the bridge does.
    fn trigger(&mut self, triggers: bool, at: u64) {
        if triggers && self.converts {
            let upper = self.cycle * u64::from(self.clocks.divider(true));
            self.converter.trigger(at, upper);
            if self.bridge.driven() {
                let sampled = self.converter.samples(upper) / self.cycle.max(1);
                let clear = self.bridge.clear(sampled as u32);
                self.world.min_edge_distance = self.world.min_edge_distance.min(clear);
            }
        }
    }

    /// Changes the external level of a pin. An edge at an unmasked EXTI line becomes pending
    /// (12.2.4). The manual leaves open whether a masked line latches edges; here it does not.
    pub fn set_wire(&mut self, port: usize, pin: usize, wire: Wire) {
        let before = self.ports[port].level(pin);
        self.ports[port].wires[pin] = wire;
        let after = self.ports[port].level(pin);
        let chosen = self.configuration[2 + pin / 4] >> (4 * (pin % 4)) & 0xf;
        if before != after && chosen as usize == port {
            let edges = self.lines[if after { 2 } else { 3 }];
            self.lines[5] |= edges & self.lines[0] & 1 << pin;
        }
    }

    /// Updates the break input and the break by the chip itself, as by a failed clock.
    pub fn break_input(&mut self, by_chip: bool) {
        // A pin without the timer's function does not reach the timer.
        let ours = self.ports[1].mode(12) == Mode::Function(self.kind.facts().timer_function);
        let high = ours && self.ports[1].level(12);
        let by_chip = by_chip || self.is_break(BREAK_BY_MONITOR) && self.power.below;
        if self.bridge.break_input(high, by_chip) {
            self.update_trace();
        }
    }

    fn is_break(&self, cause: u32) -> bool {
        self.kind == Kind::Stm32g474 && self.configuration[BREAKS] & cause != 0
    }

    /// Records a lock-up of the core, which may be connected to the break of TIM1.
    pub fn locks_up(&mut self) {
        self.world.record(self.now, Event::LockedUp);
        self.break_input(self.is_break(BREAK_BY_LOCKUP));
    }

    pub fn crystal_stops(&mut self) {
        let detected = self.clocks.crystal_stops(self.now);
        self.clock_tree();
        if detected {
            self.break_input(true);
        }
        self.refresh();
    }

    /// Follows the supply monitor's output with its EXTI line and the break.
    fn follow_monitor(&mut self) {
        let below = self.power.below;
        if below != self.monitor {
            self.monitor = below;
            let edges = self.lines[if below { 2 } else { 3 }];
            self.lines[5] |= edges & MONITOR_LINE;
        }
        self.break_input(false);
    }

    pub fn set_volts(&mut self, volts: f64) {
        self.power.volts = volts;
        self.power.update();
        if self.power.too_low_for_flash() {
            self.flash.weaken(self.now);
        }
        self.follow_monitor();
        match self.power.supply(self.flash.brown_out(), !self.supplied) {
            Supply::Enough => {}
            Supply::BrownOut => self.reset = Some(Cause::BrownOut),
            Supply::Gone => self.reset = Some(Cause::Power),
        }
        self.refresh();
    }

    #[inline]
    pub fn spend(&mut self, cycles: u32) {
        let cycles = u64::from(cycles + std::mem::take(&mut self.stall));
        self.cycles += cycles;
        self.now += cycles * self.cycle;
    }

    /// Advances the time without the core, to tick `until` or to a reset.
    pub fn pass(&mut self, until: u64) {
        while self.now < until && self.reset.is_none() {
            self.now = self.next.clamp(self.now, until);
            self.run_due();
        }
    }

    /// Advances the time with the core halted, to tick `until`; frozen peripherals stop.
    pub fn pass_halted(&mut self, until: u64) {
        let from = self.now;
        self.pass(until);
        let ticks = self.now - from;
        self.system.pause(ticks);
        if self.stops[0] >> 12 & 1 == 1 {
            self.watchdog.suspend(ticks);
        }
        if self.stops[0] >> 11 & 1 == 1 {
            self.window.pause(ticks);
        }
        self.schedule();
    }

    /// Adds ticks with the bridge driven and the core outside its specification.
    fn check_supply(&mut self, ticks: u64) {
        let lowest = self.kind.facts().lowest;
        if self.power.volts < lowest && self.clock() > 60_000_000 && self.bridge.driven() {
            self.world.outside += ticks;
        }
    }

    /// Reports a read of a flash word with two wrong bits (RM0440, 3.3.7).
    #[inline]
    fn check_word(&mut self, offset: usize) {
        if self.flash.reads_torn(offset) {
            self.report_word();
        }
    }

    #[cold]
    fn report_word(&mut self) {
        self.system.pend(NMI);
        self.attention = true;
        self.break_input(self.is_break(BREAK_BY_FLASH));
    }

    #[cold]
    fn wait_for_flash(&mut self, address: u32) {
        let offset = (address & 0x000f_ffff) as usize;
        if self.flash.is_busy(offset, self.now) && self.cycle > 0 {
            self.pass(self.flash.busy);
        }
    }

    /// Block and offset of a register that the program accesses, after the events that are due;
    /// `None` without a model or without a clock.
    fn reach(&mut self, at: u32, what: &str) -> Option<(Block, u32)> {
        self.run_due();
        let place = self.kind.place(at);
        let why = match place {
            Some((block, _)) if self.clocks.enabled(block) => return place,
            Some(_) => "whose clock is off",
            None => "of which there is no model",
        };
        let what = format!("{what} {at:#010x}, {why}");
        self.world.violate(self.now, what);
        None
    }

    fn register(&mut self, at: u32) -> u32 {
        let Some((block, offset)) = self.reach(at, "reads") else {
            return 0;
        };
        let (now, lower) = (self.now, self.lower());
        match block {
            Block::Window => self.window.read(offset, now, lower),
            Block::Watchdog => self.watchdog.read(offset, now),
            Block::Link => self.link.read(offset),
            Block::Fieldbus => self.fieldbus.read(offset),
            Block::Power => self.power.read(offset),
            Block::Voltage => self.voltage.read(offset),
            Block::Bridge => self.bridge.read(offset, now),
            Block::Converter => self.converter.read(offset),
            Block::Configuration => word(&self.configuration, offset),
            Block::Lines => word(&self.lines, offset),
            Block::Port(number) => self.ports[number].read(offset),
            Block::Check => self.check.read(offset),
            Block::Clocks => self.clocks.read(offset, now),
            Block::Flash => {
                if offset == self.flash.status_offset() {
                    self.skip_flash_wait();
                }
                self.flash.register(offset, now)
            }
        }
    }

    /// Delays a read of the busy flash's status until something changes. A program waits for the
    /// flash in a loop that reads only this status and the window watchdog's count.
    fn skip_flash_wait(&mut self) {
        let counts = self.window.counts_at(self.now, self.lower());
        let until = self.next.min(self.flash.busy).min(counts);
        let ticks = until.saturating_sub(self.now);
        self.stall += ticks.checked_div(self.cycle).unwrap_or(0) as u32;
    }

    fn set_register(&mut self, at: u32, value: u32) {
        let Some((block, offset)) = self.reach(at, "writes") else {
            return;
        };
        let (now, lower) = (self.now, self.lower());
        let operations = self.flash.operations;
        match block {
            Block::Window => self.window.write(offset, value, now, lower),
            Block::Watchdog => self.watchdog.write(offset, value, now),
            Block::Link => self.link.write(offset, value, now),
            Block::Fieldbus => self.fieldbus.write(offset, value, now),
            Block::Power => {
                self.power.write(offset, value);
                self.follow_monitor();
            }
            Block::Voltage => self.voltage.write(offset, value),
            Block::Bridge => {
                let triggers = self.bridge.write(offset, value, now);
                self.trigger(triggers, now);
                self.break_input(false);
            }
            Block::Converter => self.converter.write(offset, value),
            Block::Configuration => {
                set_word(&mut self.configuration, offset, value);
                self.break_input(false);
            }
            Block::Lines => match offset {
                0x14 => self.lines[5] &= !value,
                0x10 => self.lines[5] |= value & self.lines[0],
                offset => set_word(&mut self.lines, offset, value),
            },
            Block::Port(number) => {
                self.ports[number].write(offset, value);
                self.break_input(false);
            }
            Block::Check => {
                // The bus waits for the unit.
                self.stall += 4;
                self.check.write(offset, value);
                return;
            }
            Block::Clocks => self.clocks.write(offset, value, now),
            Block::Flash => {
                self.flash.set_register(offset, value, now);
                self.fetched = NO_LINE;
            }
        }
        self.operated(operations);
        self.watch();
        self.refresh();
    }

    /// Counts new flash operations beyond the `before` earlier ones; the supply may fail with one.
    fn operated(&mut self, before: u64) {
        if self.flash.operations == before {
            return;
        }
        if self.power.too_low_for_flash() {
            let what = format!("works on the flash at {:.2} V", self.power.volts);
            self.world.violate(self.now, what);
        }
        if std::mem::take(&mut self.flash.programmed_weak) {
            let what = "programs a sector whose erasure did not end";
            self.world.violate(self.now, what);
        }
        if std::mem::take(&mut self.flash.programmed_cached) {
            let what = "programs the flash with its data cache on";
            self.world.violate(self.now, what);
        }
        if (self.cut_at).is_some_and(|count| self.flash.operations >= count) {
            self.cut_at = None;
            self.reset = Some(Cause::Power);
        }
    }

    fn own(&mut self, address: u32) -> u32 {
        match address {
            IDENTITY => self.identity.0,
            STOPS_LOWER => self.stops[0],
            STOPS_UPPER => self.stops[1],
            address => self.system.read(address, self.now, self.cycle, self.cycles),
        }
    }

    fn set_own(&mut self, address: u32, size: u32, value: u32) {
        match address {
            STOPS_LOWER => self.stops[0] = value,
            STOPS_UPPER => self.stops[1] = value,
            address => {
                let (now, cycle, cycles) = (self.now, self.cycle, self.cycles);
                if self.system.write(address, size, value, now, cycle, cycles) {
                    self.reset = Some(Cause::Software);
                }
                self.float = self.system.float();
                self.attention = true;
                self.schedule();
            }
        }
    }

    #[inline(never)]
    fn load_elsewhere(&mut self, address: u32, size: u32) -> Option<u32> {
        let lowest = self.lowest();
        match address >> 28 {
            1 if self.system.is_guarded(address) => None,
            1 if address >= lowest => {
                number(&self.memory_below_ram, (address - lowest) as usize, size)
            }
            0 if address < 0x0010_0000 || flash::RANGE.contains(&address) => {
                self.wait_for_flash(address);
                let at = (address & 0x000f_ffff) as usize;
                let (stall, old) = self.flash.read(flash::START + at as u32);
                self.stall += stall;
                if old {
                    let what = "reads data that its cache kept over an erasure";
                    self.world.violate(self.now, what);
                }
                self.check_word(at);
                number(&self.flash.bytes, at, size)
            }
            1 if address & !3 == FLASH_SIZE => Some(self.identity.1 << 16 >> (8 * (address & 3))),
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
                let at = (address - lowest) as usize;
                put(&mut self.memory_below_ram, at, size, value)
            }
            0 if flash::RANGE.contains(&address) => {
                self.wait_for_flash(address);
                let (now, before) = (self.now, self.flash.operations);
                let at = (address - flash::START) as usize;
                self.flash.program(at, size, value, now);
                self.fetched = NO_LINE;
                self.operated(before);
                Some(())
            }
            4 | 5 => {
                let word = address & !3;
                let value = if size == 4 {
                    value
                } else {
                    // A partial write of a register keeps the rest, unless writing 0 has no effect.
                    let shift = 8 * (address & 3);
                    let mask = (1_u32 << (8 * size)).wrapping_sub(1) << shift;
                    self.register(word) & !mask | value << shift & mask
                };
                self.set_register(word, value);
                Some(())
            }
            0xe => {
                self.set_own(address, size, value);
                Some(())
            }
            _ => None,
        }
    }

    fn lowest(&self) -> u32 {
        MEMORY - self.memory_below_ram.len() as u32
    }
}

#[inline]
fn number(bytes: &[u8], at: usize, size: u32) -> Option<u32> {
    let bytes = bytes.get(at..)?;
    match size {
        4 => bytes.first_chunk().map(|word| u32::from_le_bytes(*word)),
        2 => (bytes.first_chunk()).map(|half| u16::from_le_bytes(*half).into()),
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

/// The bus of the core; `None` for an address without memory or peripheral.
impl Board {
    /// Reads 1, 2 or 4 bytes.
    #[inline]
    pub fn load(&mut self, address: u32, size: u32) -> Option<u32> {
        let at = address.wrapping_sub(MEMORY) as usize;
        number(&self.ram, at, size).or_else(|| self.load_elsewhere(address, size))
    }

    /// Writes 1, 2 or 4 bytes.
    #[inline]
    pub fn store(&mut self, address: u32, size: u32, value: u32) -> Option<()> {
        let at = address.wrapping_sub(MEMORY) as usize;
        put(&mut self.ram, at, size, value).or_else(|| self.store_elsewhere(address, size, value))
    }

    /// The next two halfwords of a program in the flash.
    #[inline(always)]
    pub fn fetch_both(&self, address: u32) -> Option<u32> {
        let at = address.wrapping_sub(flash::START) as usize;
        let bytes = self.flash.bytes.get(at..)?.first_chunk()?;
        Some(u32::from_le_bytes(*bytes))
    }

    /// Whether no operation of the flash keeps the core waiting.
    #[inline(always)]
    pub fn is_idle(&self) -> bool {
        self.now >= self.flash.busy
    }

    /// Fetches two bytes of an instruction from anywhere, once the flash is idle.
    #[cold]
    pub fn fetch(&mut self, address: u32) -> Option<u16> {
        let half = if address < 0x0010_0000 || flash::RANGE.contains(&address) {
            self.wait_for_flash(address);
            number(&self.flash.bytes, (address & 0x000f_ffff) as usize, 2)
        } else {
            self.load(address, 2)
        };
        half.map(|half| half as u16)
    }

    /// Called when an instruction is in another line of 16 bytes than the previous one.
    #[inline(always)]
    pub fn line(&mut self, address: u32) {
        if flash::RANGE.contains(&address) {
            if !self.is_idle() {
                self.wait_for_flash(address);
            }
            self.stall += self.flash.fetch(address);
            let offset = (address - flash::START) as usize & !0xf;
            self.check_word(offset);
            self.check_word(offset + 8);
        }
    }
}
