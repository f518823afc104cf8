//! Effects of the link on a drive, on the flashed image: a flood, much telemetry, a stuck line, and
//! requests that could start a machine.

use kband_control::wire::{
    MAX_FRAME_BYTES, Outgoing, Receiver, Refusal, Request, Response, read_answer,
};
use kband_control::{Event, Fault, Limits, StartCause, State, Target};
use kband_machines::chip::gpio::Wire;
use kband_machines::chip::kind::Kind;
use kband_machines::chip::world::Seen;
use kband_machines::hazards::Hazard;
use kband_machines::rig::{Act, Rig};

/// A machine of this frequency in Hz with saved settings, at rest; no link timeout.
fn machine(frequency: f32, target: Target) -> Rig {
    machine_on(Kind::default(), frequency, target)
}

/// The same on this chip.
fn machine_on(kind: Kind, frequency: f32, target: Target) -> Rig {
    let mut hazard = Hazard::of("line", frequency, target);
    let settings = &mut hazard.scene.settings;
    settings.link_timeout = 0.0;
    // Within the acceleration limit at each of these frequencies.
    settings.safe_amplitude = 0.005;
    hazard.scene.sensor.noise = 0.04;
    hazard.commissioned(kind)
}

/// Stack of the board's image in bytes.
const STACK_BYTES: usize = 55 << 10;

// A frame fits the ring buffer of the port.
const _: () = assert!(MAX_FRAME_BYTES <= 512);

/// Target of a machine of this frequency in Hz.
fn target(frequency: f32) -> Target {
    if frequency < 30.0 {
        Target::Amplitude(0.9)
    } else {
        Target::K(0.41)
    }
}

/// The machine after some seconds in the run.
fn running(frequency: f32, target: Target, seconds: f64) -> Rig {
    start(machine(frequency, target), frequency, seconds)
}

fn start(mut rig: Rig, frequency: f32, seconds: f64) -> Rig {
    rig.at(1.1, Act::Enable(true)).run(1.1 + seconds);
    assert_eq!(rig.opens_after(1.2), None, "{frequency} Hz: it runs");
    rig
}

/// One request of each kind that does not change the drive.
fn requests() -> Vec<Request<'static>> {
    vec![
        Request::Setting(3),
        Request::Get("frequency"),
        Request::set("gain", 1.0),
        Request::Save,
        Request::Defaults,
        Request::Target(Target::K(f32::NAN)),
        Request::Telemetry(10),
        Request::Event(0),
        Request::SelfTest,
        Request::Counters,
        Request::LastWords,
        Request::Alive,
        Request::Simulate {
            target: Target::K(0.4),
            start: StartCause::Ordinary,
        },
        Request::Samples {
            codes: &[],
            end: None,
        },
        Request::Identification,
        Request::Held,
        Request::Fault(0),
        Request::Status,
        Request::Lock(None),
        Request::Enable(true),
    ]
}

/// Amplitudes of the track every 0.1 s, mm.
fn amplitudes(rig: &mut Rig, times: u32) -> Vec<f64> {
    let began = rig.time();
    let seen = (1..=times).map(|n| {
        // Between two steps of the track.
        let step = (20_000.0 * (began + 0.1 * f64::from(n))).floor();
        rig.run((step + 0.5) / 20_000.0);
        assert!(rig.amplitude() > 1e-3, "it runs");
        rig.amplitude()
    });
    seen.collect()
}

/// Largest relative difference between corresponding amplitudes.
fn apart(one: &[f64], other: &[f64]) -> f64 {
    assert_eq!(one.len(), other.len());
    let ratios = one.iter().zip(other).map(|(a, b)| (a / b - 1.0).abs());
    ratios.fold(0.0, f64::max)
}

/// Responses received from byte `from` on.
fn responses(rig: &Rig, from: usize) -> Vec<(u8, String)> {
    let mut receiver = Receiver::new();
    let mut found = Vec::new();
    for byte in rig.sent().split_off(from) {
        if let Some(Ok(inside)) = receiver.push(byte)
            && let Ok(Outgoing::Response { sequence, response }) = read_answer(inside)
        {
            found.push((sequence, format!("{response:?}")));
        }
    }
    found
}

fn counters(rig: &mut Rig) -> kband_control::wire::Counters {
    rig.request(&Request::Counters, |response| match response {
        Response::Counters(counters) => counters,
        other => panic!("{other:?}"),
    })
}

fn report(rig: &mut Rig) -> (State, Option<Fault>, Limits) {
    let before = rig.sent().len();
    rig.request_done(&Request::Telemetry(10));
    rig.run(rig.time() + 2.5);
    rig.request_done(&Request::Telemetry(0));
    let mut receiver = Receiver::new();
    let mut last = None;
    for byte in rig.sent().split_off(before) {
        if let Some(Ok(inside)) = receiver.push(byte)
            && let Ok(Outgoing::Response {
                response: Response::Telemetry(row),
                ..
            }) = read_answer(inside)
        {
            last = Some(row);
        }
    }
    let row = last.expect("telemetry");
    (
        State::numbered(row.state).unwrap(),
        Fault::numbered(row.fault),
        Limits::from_bits(row.limits).unwrap(),
    )
}

/// Number of cycles whose control came late since the start.
fn missed_cycles(rig: &mut Rig) -> u32 {
    rig.request(&Request::SelfTest, |response| match response {
        Response::SelfTest(test) => test.missed,
        other => panic!("{other:?}"),
    })
}

/// A flood of requests must neither hang the link nor delay the control.
#[test]
fn a_thousand_pipelined_requests_are_answered() {
    let chips = [5.0, 50.0, 130.0, 500.0].map(|frequency| (Kind::Stm32f405, frequency));
    for (kind, frequency) in chips.into_iter().chain([(Kind::Stm32g474, 130.0)]) {
        let machine = machine_on(kind, frequency, target(frequency));
        let ready = start(machine, frequency, 2.5);
        let silent = amplitudes(&mut ready.clone(), 45);
        let mut rig = ready;
        let before = rig.sent().len();
        let mut bytes = Vec::new();
        for request in requests().iter().cycle().take(1000) {
            bytes.extend(rig.frame(request));
        }
        rig.act(&Act::Link(bytes));
        let flooded = amplitudes(&mut rig, 45);
        assert_eq!(flooded, silent, "{frequency} Hz: b has the same bits");
        assert_eq!(rig.resets().len(), 1, "{frequency} Hz");
        let answers = responses(&rig, before).len() as u32;
        let counters = counters(&mut rig);
        // A drive cycle answers 32 requests and counts the others. The port's ring loses some of
        // those that arrive faster than answers leave.
        assert!(answers >= 190, "{frequency} Hz: {answers}");
        assert!(
            answers + 12 >= counters.requests,
            "{frequency} Hz: {answers}"
        );
        assert_eq!(counters.answers_dropped, 0, "{frequency} Hz");
        rig.act(&Act::Enable(false));
        rig.run(rig.time() + 2.0);
        // Each of two saves at rest takes 5 ms: when commissioned, and after the run.
        let saving = 2 * (0.006 * frequency) as u32;
        let late = missed_cycles(&mut rig);
        let free = rig.stack_free();
        assert!(free > STACK_BYTES / 4, "{frequency} Hz: {free} bytes");
        assert!(late <= saving, "{frequency} Hz: {late} cycles came late");
    }
}

/// The fastest telemetry that the line carries must not affect the drive.
#[test]
fn telemetry_as_fast_as_the_line_carries_does_not_move_b() {
    for frequency in [5.0, 20.0, 60.0, 63.0, 67.0, 100.0, 130.0, 300.0, 500.0] {
        let ready = running(frequency, target(frequency), 1.5);
        let (began, silent) = (ready.time(), amplitudes(&mut ready.clone(), 30));
        let mut rig = ready;
        let fewest = rig.request(&Request::Telemetry(1), |response| match response {
            Response::Done => 1,
            Response::Refused(Refusal::Faster(fewest)) => fewest,
            other => panic!("{other:?}"),
        });
        assert_eq!(fewest > 1, frequency > 64.0, "{frequency} Hz: {fewest}");
        rig.request_done(&Request::Telemetry(fewest));
        let (from, first) = (rig.sent().len(), rig.time());
        // Requests that must be answered meanwhile. The driver of the port (embassy-stm32 0.6.0,
        // usart/buffered.rs) loses a byte that arrives just while it reads DR because of IDLE, or
        // writes SR because of TC. Delays over the 87 us of a byte keep that phase from repeating.
        for n in 1..=25 {
            let frame = rig.frame(&Request::Setting(4));
            let delay = 87e-6 * (0.618 * f64::from(n)).fract();
            rig.at(first + 0.1 * f64::from(n) + delay, Act::Link(frame));
        }
        let rest = ((3.0 - (first - began)) / 0.1).floor() as u32;
        let offset = 30 - rest;
        rig.run(began + 0.1 * f64::from(offset));
        let busy = amplitudes(&mut rig, rest);
        let silent = &silent[offset as usize..];
        assert_eq!(busy, silent, "{frequency} Hz: b has the same bits");
        let lasted = rig.time() - first;
        let came = responses(&rig, from);
        let rows = came.iter().filter(|(sequence, _)| *sequence == 0).count();
        let due = lasted * f64::from(frequency) / f64::from(fewest);
        assert!(rows as f64 > 0.98 * due - 3.0, "{frequency} Hz: {rows}");
        let answers = came.len() - rows;
        let counted = counters(&mut rig);
        assert!(
            answers >= 20,
            "{frequency} Hz: {answers} answers, {counted:?}"
        );
        assert_eq!(counted.answers_dropped, 0);
        assert_eq!(rig.resets().len(), 1, "{frequency} Hz");
    }
}

/// In gear a telemetry frame has margin and load. Frames beyond the line's rate must be dropped,
/// not waited for.
#[test]
fn telemetry_beyond_the_line_rate_is_dropped() {
    let mut hazard = Hazard::of("line in gear", 50.0, Target::Gear { order: 1 });
    hazard.scene.parts = kband_plant::Scene::default().parts;
    hazard.scene.settings.link_timeout = 0.0;
    hazard.scene.settings.track_mass = 10.0;
    let mut rig = hazard.commissioned(Kind::default());
    rig.at(1.1, Act::Enable(true)).run(4.0);
    let silent = amplitudes(&mut rig.clone(), 40);
    rig.request_done(&Request::Telemetry(1));
    let from = rig.sent().len();
    // The answers take the line's remaining rate, and more.
    let mut bytes = Vec::new();
    for _ in 0..600 {
        bytes.extend(rig.frame(&Request::Setting(4)));
    }
    rig.act(&Act::Link(bytes));
    let flooded = amplitudes(&mut rig, 40);
    let rows: Vec<_> = responses(&rig, from)
        .into_iter()
        .filter(|(sequence, _)| *sequence == 0)
        .collect();
    assert!(
        rows.iter().any(|(_, row)| row.contains("margin: Some")),
        "in gear"
    );
    assert!(
        rows.iter().any(|(_, row)| row.contains("load: Some")),
        "weighed"
    );
    let counted = counters(&mut rig);
    assert!(counted.rows_dropped > 0);
    // Under load a plan ends in a later cycle. From then on the impacts differ, and b by their
    // noise: measured 4.4e-4, and 4.0e-4 where the load begins 16 s later.
    assert!(apart(&flooded, &silent) < 1e-3);
    assert_eq!(rig.resets().len(), 1);
}

/// The port sends nothing, as with a failed transmitter. Then it is dead completely.
#[test]
fn a_hung_link_is_a_limit_and_never_a_reset() {
    let mut hazard = Hazard::of("hung", 50.0, Target::Amplitude(0.2));
    hazard.scene.settings.link_timeout = 0.8;
    let mut rig = hazard.commissioned(Kind::default());
    rig.at(1.1, Act::Enable(true));
    let alive = |rig: &mut Rig, from: f64, to: f64| {
        let mut time = from;
        while time < to {
            let frame = rig.frame(&Request::Setting(4));
            rig.at(time, Act::Link(frame));
            time += 0.1;
        }
    };
    alive(&mut rig, 1.0, 6.0);
    rig.run(3.0);
    rig.chip.board.serials[1].stuck = true;
    rig.run(6.0);
    assert!((rig.amplitude() - 0.2).abs() < 0.005, "{}", rig.amplitude());
    assert_eq!(rig.resets().len(), 1);
    rig.chip.board.serials[1].stuck = false;
    alive(&mut rig, 6.0, 6.5);
    rig.run(6.6);
    assert!(counters(&mut rig).answers_dropped > 5);
    // The port's interrupt is masked: it neither receives nor sends.
    let interrupt = 38;
    rig.act(&Act::Store(
        0xe000_e180 + 4 * (interrupt / 32),
        1 << (interrupt % 32),
    ));
    let from = rig.time();
    rig.run(from + 5.0);
    assert_eq!(rig.resets().len(), 1, "{:?}", rig.resets());
    let safe = f64::from(hazard.scene.settings.safe_amplitude);
    assert!(
        (rig.amplitude() / safe - 1.0).abs() < 0.05,
        "{}",
        rig.amplitude()
    );
    assert_eq!(rig.seen_after(3.0, &Seen::Bridge(false)), None);
}

/// With the input on since power-on no request may close the bridge.
#[test]
fn no_request_starts_a_machine_whose_input_is_on() {
    let mut rig = machine(50.0, Target::Amplitude(0.2));
    rig.act(&Act::Volts(0.0));
    rig.act(&Act::Enable(true));
    rig.run(rig.time() + 0.3);
    rig.act(&Act::Volts(3.3));
    let on = rig.time();
    rig.run(on + 0.5);
    let set = Request::set("soft_start", 0.3);
    for request in [
        set,
        Request::Defaults,
        Request::Enable(false),
        Request::Enable(true),
        Request::Target(Target::Amplitude(0.3)),
        set,
        Request::Save,
        Request::Enable(true),
    ] {
        rig.request_done(&request);
        rig.run(rig.time() + 0.2);
    }
    rig.run(rig.time() + 2.0);
    assert_eq!(rig.seen_after(on, &Seen::Bridge(true)), None);
    // Half a second without the input acknowledges the fault after `Defaults`. Then an edge of the
    // input starts it.
    rig.act(&Act::Enable(false));
    rig.run(rig.time() + 0.6);
    rig.act(&Act::Enable(true));
    rig.run(rig.time() + 0.2);
    assert!(rig.seen_after(on, &Seen::Bridge(true)).is_some());
    // The link may restore the enable that it withheld.
    rig.request_done(&Request::Enable(false));
    rig.run(rig.time() + 1.5);
    let stopped = rig.time();
    assert_eq!(rig.opens_after(stopped), Some(0.0));
    rig.request_done(&Request::Enable(true));
    rig.run(rig.time() + 0.2);
    assert!(rig.seen_after(stopped, &Seen::Bridge(true)).is_some());
}

/// Withdrawing and restoring the link's enable must not acknowledge a fault.
#[test]
fn the_link_acknowledges_no_fault() {
    let mut rig = running(50.0, Target::Amplitude(0.2), 1.0);
    let fault = rig.time();
    rig.act(&Act::ThermalSwitch(false));
    rig.run(fault + 0.2);
    rig.act(&Act::ThermalSwitch(true));
    assert_eq!(rig.opens_after(fault + 0.1), Some(0.0));
    for _ in 0..3 {
        rig.request_done(&Request::Enable(false));
        rig.run(rig.time() + 1.0);
        rig.request_done(&Request::Enable(true));
        rig.run(rig.time() + 1.0);
    }
    assert_eq!(rig.seen_after(fault + 0.1, &Seen::Bridge(true)), None);
    let (state, fault, _) = report(&mut rig);
    assert_eq!((state, fault), (State::Fault, Some(Fault::OverTemperature)));
    let acknowledged = Event::Acknowledged.number();
    let mut late = rig
        .events()
        .into_iter()
        .filter(|record| record.cycle >= 100);
    assert!(late.all(|record| record.event != acknowledged));
}

/// A `Set` between two faults must not clear their times.
#[test]
fn the_third_fault_in_a_minute_locks_out_in_spite_of_settings() {
    let mut rig = running(50.0, Target::Amplitude(0.2), 0.5);
    for fault in 1..=3 {
        rig.act(&Act::ThermalSwitch(false));
        rig.run(rig.time() + 0.1);
        rig.act(&Act::ThermalSwitch(true));
        rig.act(&Act::Enable(false));
        rig.run(rig.time() + 0.8);
        if fault < 3 {
            rig.request_done(&Request::set("soft_start", 0.3));
        }
        let from = rig.time();
        rig.act(&Act::Enable(true));
        rig.run(from + 0.4);
        let closes = rig.seen_after(from, &Seen::Bridge(true));
        assert_eq!(closes.is_some(), fault < 3, "fault {fault}: {closes:?}");
    }
}

/// Three successive resets must end at rest, not in a loop of resets.
#[test]
fn three_resets_end_at_rest_with_fault_and_link() {
    let mut rig = running(50.0, Target::Amplitude(0.2), 1.0);
    let from = rig.time();
    rig.act(&Act::Converts(false));
    rig.run(from + 3.0);
    let resets = rig.resets().len();
    assert_eq!(resets, 4, "power-on and three: {:?}", rig.resets());
    let rest = rig.resets()[3].0;
    assert!(rest < from + 0.2, "{rest}");
    let lamp = rig.seen_after(rest, &Seen::Fault(true));
    assert!(lamp.is_some_and(|time| time < rest + 0.2), "{lamp:?}");
    assert_eq!(rig.seen_after(from + 0.01, &Seen::Bridge(true)), None);
    // The link answers, and the clock paces the telemetry.
    let (state, fault, _) = report(&mut rig);
    assert_eq!((state, fault), (State::Fault, Some(Fault::RepeatedResets)));
    rig.run(rig.time() + 12.0);
    assert_eq!(rig.resets().len(), resets, "{:?}", rig.resets());
    // After repair and acknowledgement it starts as after power-on.
    rig.act(&Act::Converts(true));
    rig.act(&Act::Enable(false));
    let off = rig.time();
    rig.run(off + 0.4);
    assert_eq!(rig.resets().len(), resets, "half a second acknowledges");
    rig.run(off + 1.0);
    assert_eq!(rig.resets().len(), resets + 1);
    rig.act(&Act::Enable(true));
    rig.run(off + 2.0);
    assert!(rig.seen_after(off, &Seen::Bridge(true)).is_some());
    assert!((rig.amplitude() - 0.2).abs() < 0.01, "{}", rig.amplitude());
}

/// PC1 to ground makes the link read-only; it may still withhold the drive.
#[test]
fn the_strap_makes_the_link_read_only() {
    let mut rig = machine(50.0, Target::Amplitude(0.2));
    let set = Request::set("soft_start", 0.3);
    rig.request_done(&set);
    rig.act(&Act::Wire(2, 1, Wire::Low));
    let refused = |rig: &mut Rig, request: &Request<'_>| {
        rig.request(request, |response| {
            matches!(response, Response::Refused(Refusal::ReadOnly(_)))
        })
    };
    for request in [
        set,
        Request::Defaults,
        Request::Save,
        Request::Target(Target::Amplitude(0.9)),
        Request::Lock(None),
    ] {
        assert!(refused(&mut rig, &request), "{request:?}");
    }
    rig.request_done(&Request::Enable(false));
    rig.act(&Act::Wire(2, 1, Wire::Open));
    rig.request_done(&set);
}
