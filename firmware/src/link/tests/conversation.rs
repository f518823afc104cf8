//! Long random conversations: every answer, report and saved setting keeps its bits.

use std::format;

use kband::arithmetic::Noise;
use kband_control::wire::crc32;

use super::draw::{below, choose, request};
use super::*;

/// Checksum of a conversation with each seed. Copy the printed ones after an intended change.
const CHECKSUMS: [u32; 4] = [0x621c_0a6b, 0xc347_f2d1, 0xafe2_f712, 0x0760_6508];
const REQUESTS: u32 = 6_000;

/// Settings with which the drive still runs, and some that are refused.
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

/// Inputs that are good in most cycles; enable changes in a tenth of the calls.
fn inputs(noise: &mut Noise, before: Inputs) -> Inputs {
    let enable = before.enable != (below(noise, 10) == 0);
    let mut inputs = Inputs {
        enable,
        link_heard: below(noise, 10) > 0,
        ..Inputs::default()
    };
    match below(noise, 300) {
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
    let (mut noise, mut board) = (Noise::new(seed), Board::new());
    let (mut now, mut output) = (Inputs::default(), 0.0);
    let (mut done, mut holding) = (0, 0);
    let mut sum = 0;
    let mut add = |bytes: &[u8]| sum = crc32(&[&u32::to_le_bytes(sum), bytes].concat());
    for _ in 0..REQUESTS {
        now = inputs(&mut noise, now);
        for _ in 0..below(&mut noise, 60) {
            add(&board.follow(now, &mut output).unwrap_or_default());
        }
        let setting = choose(&mut noise, &SETTINGS);
        let response = board.ask_now(&request(&mut noise, setting, 20));
        done += u32::from(response == Response::Done);
        holding += u32::from(board.state() == State::Holding);
        add(format!("{response:?} {:?}", board.station.report()).as_bytes());
        if below(&mut noise, 100) == 0 {
            let start = [StartCause::Ordinary, StartCause::PowerOn, StartCause::Reset];
            let (saved, start) = (board.saved(), choose(&mut noise, &start));
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
