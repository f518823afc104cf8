//! Long random conversations: every answer, report and saved setting keeps its bits.

use std::format;

use kband_control::wire::{Pin, crc32};

use super::*;

/// Checksum of a conversation with each seed. Copy the printed ones after an intended change.
const CHECKSUMS: [u32; 4] = [0x5c12_44eb, 0xe699_6d03, 0xcc15_1a42, 0x10bb_a9ca];
const REQUESTS: u32 = 6_000;

/// A linear congruential generator (Knuth's MMIX).
struct Random(u64);

impl Random {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 = (self.0.wrapping_mul(6_364_136_223_846_793_005))
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % limit
    }

    fn choose<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len() as u64) as usize]
    }

    fn target(&mut self) -> Target {
        self.choose(&[
            Target::Amplitude(0.2),
            Target::K(0.4),
            Target::Gear { order: 1 },
            Target::Locked { order: 1 },
            Target::Locked { order: 9 },
            Target::Chaotic,
        ])
    }

    fn request(&mut self) -> Request<'static> {
        const SETTINGS: [(&str, f32); 10] = [
            ("frequency", 60.0),
            ("frequency", 600.0),
            ("amplitude_limit", 0.3),
            ("restitution_high", 0.24),
            ("restitution_high", 0.1),
            ("link_timeout", 0.5),
            ("bus", 1.0),
            ("bus", 0.0),
            ("soft_start", 0.1),
            ("colour", 1.0),
        ];
        const BUS: [&[u8]; 5] = [
            &[1, 3, 0, 0, 0, 8],
            &[1, 4, 0, 0, 0, 20],
            &[1, 6, 0, 0, 0, 1],
            &[1, 6, 0, 1, 0, 0],
            &[1, 99],
        ];
        let pin = Pin::parse(self.choose(&["1234", "0000"])).unwrap();
        let (key, value) = self.choose(&SETTINGS);
        let number = self.below(9) as u8;
        let recipe = Recipe::of(self.target(), &Settings::default());
        let recipe = (RecipeName::parse("caps").unwrap(), recipe);
        match self.below(27) {
            0 => Request::Setting(10 * number),
            1 => Request::Get(key),
            2..5 => Request::set(key, value),
            5 => Request::Save,
            6 if self.below(10) == 0 => Request::Defaults,
            7 => Request::Target(self.target()),
            8..11 => Request::Enable(self.below(4) > 0),
            11 => Request::Telemetry(u16::from(number)),
            12 => Request::Event(u32::from(number)),
            13 => Request::SelfTest,
            14 => Request::Counters,
            15 => Request::Alive,
            16 if self.below(20) == 0 => simulate(self.target()),
            17 => Request::Held,
            18 => Request::Fault(number),
            19 => Request::Status,
            20 if self.below(20) == 0 => Request::Lock(Some(pin)),
            21 => Request::Unlock(pin),
            22 => Request::Recipe(number),
            23 => Request::SetRecipe {
                number,
                recipe: (self.below(3) > 0).then_some(recipe),
            },
            24 => Request::SaveRecipes,
            25 => Request::UseRecipe(number),
            _ => Request::Bus(self.choose(&BUS)),
        }
    }

    /// Inputs that are good in most cycles; enable changes in a tenth of the calls.
    fn inputs(&mut self, before: Inputs) -> Inputs {
        let enable = before.enable != (self.below(10) == 0);
        let mut inputs = Inputs {
            enable,
            link_heard: self.below(10) > 0,
            ..Inputs::default()
        };
        match self.below(300) {
            0 => inputs.over_temperature = true,
            1 => inputs.over_current = true,
            2 => inputs.supply_low = true,
            3 => inputs.control_late = true,
            4 => inputs.clock_failed = true,
            5 => inputs.held_off = true,
            6 => inputs.chatters = true,
            _ => {}
        }
        inputs
    }
}

impl Board {
    /// A drive cycle of a track that follows the commands with its time constant. `output` is the
    /// command that it has followed so far.
    fn follow(&mut self, inputs: Inputs, output: &mut f32) -> Option<Vec<u8>> {
        let (settings, report) = (self.station.settings(), self.station.report());
        let angular = core::f32::consts::TAU * report.frequency;
        *output += (report.command.amplitude - *output) * core::f32::consts::PI / settings.quality;
        let cycle = Cycle {
            quadrature: -settings.gain * 1e-3 * *output * angular * angular,
            low: 2000,
            high: 2100,
            ..sensed((20_000.0 / report.frequency) as u16)
        };
        self.station.cycle(&cycle, inputs);
        self.station.plan_step();
        let telemetry = self.service.tick(&self.station).map(<[u8]>::to_vec);
        self.keep_fault();
        telemetry
    }
}

fn converse(seed: u64) -> u32 {
    let (mut random, mut board) = (Random(seed), Board::new());
    let (mut inputs, mut output) = (Inputs::default(), 0.0);
    let (mut done, mut holding) = (0, 0);
    let mut sum = 0;
    let mut add = |bytes: &[u8]| sum = crc32(&[&u32::to_le_bytes(sum), bytes].concat());
    for _ in 0..REQUESTS {
        inputs = random.inputs(inputs);
        for _ in 0..random.below(60) {
            add(&board.follow(inputs, &mut output).unwrap_or_default());
        }
        let response = board.ask_now(&random.request());
        done += u32::from(response == Response::Done);
        holding += u32::from(board.state() == State::Holding);
        add(format!("{response:?} {:?}", board.station.report()).as_bytes());
        if random.below(100) == 0 {
            let start = [StartCause::Ordinary, StartCause::PowerOn, StartCause::Reset];
            let (saved, start) = (board.saved(), random.choose(&start));
            add(format!("{saved:?} {:?}", board.saved_recipes()).as_bytes());
            board = Board::started(saved, start);
        }
    }
    let lively = done > REQUESTS / 10 && holding > 10;
    assert!(lively, "{done} requests done, {holding} while holding");
    sum
}

#[test]
fn a_random_conversation_keeps_its_bits() {
    let sums = [1, 2, 3, 4].map(converse);
    assert_eq!(sums, CHECKSUMS, "{sums:#x?}");
}
