//! A flood of frames to the board's image while the drive runs: no late sample, no late control,
//! every request for counters answered.
//!
//! `KBAND_FRAMES` sets the number of frames (default ten thousand), `KBAND_SEED` the seed;
//! `tests/run.sh --soak` sends a million.

use kband_control::Target;
use kband_control::wire::Request;
use kband_tests::chip::kind::Kind;
use kband_tests::chip::{DEADLINE, LINK, SAMPLE};
use kband_tests::number;
use kband_tests::rig::{Act, Rig};
use kband_tests::states::Random;

/// Bytes per slice of the run at 115200 baud, and the slice's duration in s.
const SLICE: usize = 1152;
const SLICE_DURATION: f64 = 0.1;

/// A frame of the flood with its end; mostly invalid ones, because answers occupy the line.
fn frame(rig: &mut Rig, random: &mut Random) -> Vec<u8> {
    let requests = [
        Request::Alive,
        Request::Counters,
        Request::Status,
        Request::Held,
        Request::set("amplitude_limit", 0.5),
        Request::Save,
        Request::SelfTest,
        Request::Target(Target::K(f32::NAN)),
        Request::Target(Target::Amplitude(1e9)),
        Request::Get("nothing"),
        Request::Fault(0),
    ];
    let any = random.bits();
    let mut frame = rig.frame(&requests[(any >> 16) as usize % requests.len()]);
    let at = (any >> 24) as usize % (frame.len() - 3);
    match any % 16 {
        // Random bytes, rarely longer than any frame.
        kind @ 0..=11 => {
            let long = kind == 11 && any >> 32 & 15 == 0;
            let short = (any >> 8) as usize % 4 + 1;
            let size = if long { 600 } else { short };
            let byte = |_| random.bits() as u8 | 1;
            (0..size).map(byte).chain([0]).collect()
        }
        12 => {
            // Another byte that does not end a frame.
            frame[at] = (frame[at] ^ (1 << (any % 8))).max(1);
            frame
        }
        13 => {
            frame.drain(1..2 + at);
            frame
        }
        _ => frame,
    }
}

fn a_flood_of_frames_delays_no_sample_and_is_counted(kind: Kind) {
    let frames = number("KBAND_FRAMES", 10_000);
    let mut random = Random::new(number("KBAND_SEED", 1));
    let mut rig = Rig::boot_on(kind);
    rig.run(0.3);
    rig.request_done(&Request::Target(Target::K(0.41)));
    rig.request_done(&Request::Save);
    rig.at(1.0, Act::Enable(true));
    for half in 2..=8 {
        rig.run(f64::from(half) * 0.5);
        rig.request_done(&Request::Alive);
    }
    rig.request_done(&Request::Telemetry(1));
    let held = rig.amplitude();
    let began = rig.time();
    rig.chip.forget_handlers();
    let lost = rig.chip.board.link.lost;
    let before = rig.counters();
    let (mut sent, mut counts, mut sent_bytes) = (0_u64, 1_u64, 0);
    let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
    while sent < frames {
        let mut bytes = Vec::with_capacity(2 * SLICE);
        while bytes.len() < SLICE && sent < frames {
            bytes.extend(frame(&mut rig, &mut random));
            sent += 1;
        }
        sent_bytes += bytes.len();
        let lasts = SLICE_DURATION * bytes.len() as f64 / SLICE as f64;
        rig.act(&Act::Link(bytes));
        rig.run(rig.time() + lasts);
        (low, high) = (low.min(rig.amplitude()), high.max(rig.amplitude()));
        // Discards the output so far.
        rig.chip.board.link.sent.clear();
        if counts * 500 < sent {
            rig.counters();
            counts += 1;
        }
    }
    let after = rig.counters();
    counts += 1;
    let counted = after.frames() - before.frames();
    let lost = rig.chip.board.link.lost - lost;
    let (sampling, port) = (rig.chip.handler(SAMPLE), rig.chip.handler(LINK));
    let lasted = rig.time() - began;
    println!(
        "flood: {sent} frames in {lasted:.1} s, {counted} counted, {lost} bytes lost; a sample \
         {} cycles at most of {DEADLINE}, the port {}",
        sampling.longest, port.longest,
    );
    // The port loses a byte that completes between its reads of status and data. If that byte ends
    // a frame, two frames merge. A lost request is repeated.
    assert!(sent + counts - 1 <= counted + lost, "{counted}, {lost}");
    assert!(counted <= sent + counts + lost, "{counted}, {lost}");
    let few = (lost as f64) < 0.01 * sent_bytes as f64;
    assert!(few, "{lost} of {sent_bytes}");
    assert!(after.corrupt > before.corrupt && after.requests > before.requests);
    assert!(sampling.longest < DEADLINE, "{sampling:?}");
    let due = 19_990.0 * lasted - 100.0;
    assert!(sampling.count as f64 > due, "{sampling:?} in {lasted} s");
    assert!(low > 0.98 * held && high < 1.02 * held);
    assert_eq!(rig.resets().len(), 1);
    assert!(rig.status().ready, "it holds its target");
    rig.act(&Act::Enable(false)).run_for(3.0);
    assert_eq!(rig.self_test().missed, 0, "cycles whose control came late");
}

kband_tests::on_both! {
    a_flood_of_frames_delays_no_sample_and_is_counted,
}
