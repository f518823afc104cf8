//! The link of the flashed image: a flood, a stuck line, a board at rest after resets, and requests
//! that could start a machine.

use kband_control::wire::{Outgoing, Receiver, Refusal, Request, Response, read_answer};
use kband_control::{Fault, StartCause, Target};
use kband_machines::chip::gpio::Wire;
use kband_machines::chip::kind::Kind;
use kband_machines::chip::world::Event;
use kband_machines::hazards::Hazard;
use kband_machines::rig::{Act, Rig};

/// A machine with saved settings, at rest; no link timeout.
fn machine() -> Rig {
    let mut hazard = Hazard::new("line", 50.0, Target::Amplitude(0.2));
    hazard.scene.settings.link_timeout = 0.0;
    hazard.commissioned(Kind::default())
}

/// The same machine at 0.2 mm, 1 s after its enable input turned on.
fn running() -> Rig {
    let mut rig = machine();
    rig.at(1.1, Act::Enable(true)).run(2.1);
    assert!(rig.chip.is_driven());
    rig
}

/// Requests of each kind that does not change the drive, with telemetry every `cycles`.
fn requests(cycles: u16) -> [Request<'static>; 20] {
    [
        Request::Setting(3),
        Request::Get("frequency"),
        Request::set("gain", 1.0),
        Request::Save,
        Request::Defaults,
        Request::Target(Target::K(f32::NAN)),
        Request::Telemetry(cycles),
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
    let values = (1..=times).map(|n| {
        // Between two steps of the track.
        let step = (20_000.0 * (began + 0.1 * f64::from(n))).floor();
        rig.run((step + 0.5) / 20_000.0).amplitude()
    });
    values.collect()
}

#[test]
fn a_thousand_pipelined_requests_are_answered() {
    let boards = [5.0, 130.0, 500.0].map(|frequency| (Kind::Stm32f405, frequency));
    for (kind, frequency) in boards.into_iter().chain([(Kind::Stm32g474, 50.0)]) {
        let slow = frequency < 30.0;
        let target = if slow {
            Target::Amplitude(0.9)
        } else {
            Target::K(0.41)
        };
        let mut hazard = Hazard::new("flood", frequency, target);
        hazard.scene.settings.link_timeout = 0.0;
        // Within the acceleration limit at each of these frequencies.
        hazard.scene.settings.safe_amplitude = 0.005;
        hazard.scene.sensor.noise = 0.04;
        let mut rig = hazard.commissioned(kind);
        rig.at(1.1, Act::Enable(true)).run(3.6);
        let silent = amplitudes(&mut rig.clone(), 45);
        assert!(silent.iter().all(|amplitude| *amplitude > 4e-4), "it runs");
        let before = rig.sent().len();
        let mut bytes = Vec::new();
        // At the full rate of the line.
        let telemetry = (frequency / 50.0).ceil() as u16;
        for request in requests(telemetry).iter().cycle().take(1000) {
            bytes.extend(rig.frame(request));
        }
        let flooded = amplitudes(rig.act(&Act::Link(bytes)), 45);
        assert_eq!(flooded, silent, "{frequency} Hz: the amplitude's bits");
        assert_eq!(rig.resets().len(), 1, "{frequency} Hz");
        let mut receiver = Receiver::new();
        let (mut answers, mut rows) = (0, 0);
        for byte in rig.sent().split_off(before) {
            if let Some(Ok(inside)) = receiver.push(byte)
                && let Ok((sequence, Outgoing::Response(_))) = read_answer(inside)
            {
                rows += u32::from(sequence == 0);
                answers += u32::from(sequence != 0);
            }
        }
        let counters = rig.counters();
        // The board answers 32 requests in a drive cycle and counts the others. The port's ring
        // buffer loses some requests that arrive faster than answers leave.
        assert!(answers >= 190, "{frequency} Hz: {answers}");
        assert!(answers + 12 >= counters.requests, "{frequency} Hz");
        assert_eq!(counters.answers_dropped, 0, "{frequency} Hz");
        assert!(rows > 0, "{frequency} Hz");
        // With so many answers the line has no room for telemetry.
        let dropped = counters.rows_dropped > 0;
        assert_eq!(dropped, frequency > 30.0, "{frequency} Hz");
        rig.act(&Act::Enable(false)).run_for(2.0);
        let late = rig.self_test().missed;
        // Each of two saves at rest takes 5 ms: during commissioning, and after the run.
        let saving = 2 * (0.006 * frequency) as u32;
        assert!(late <= saving, "{frequency} Hz: {late} cycles came late");
    }
}

#[test]
fn no_request_starts_a_machine_whose_input_is_on() {
    let mut rig = machine();
    rig.act(&Act::Volts(0.0)).act(&Act::Enable(true));
    let on = rig.run_for(0.3).time();
    rig.act(&Act::Volts(3.3)).run_for(0.5);
    let set = Request::set("soft_start", 0.3);
    let target = Request::Target(Target::Amplitude(0.3));
    let [off, back] = [false, true].map(Request::Enable);
    for request in [
        set,
        Request::Defaults,
        off,
        back,
        target,
        set,
        Request::Save,
        back,
    ] {
        rig.request_done(&request).run_for(0.2);
    }
    rig.run_for(2.0);
    assert_eq!(rig.find_time(on, &Event::Bridge(true)), None);
    // Half a second without the input acknowledges the fault; an edge then starts it.
    rig.act(&Act::Enable(false)).run_for(0.6);
    rig.act(&Act::Enable(true)).run_for(0.2);
    assert!(rig.find_time(on, &Event::Bridge(true)).is_some());
}

#[test]
fn the_link_acknowledges_no_fault() {
    let mut rig = running();
    let fault = rig.time();
    rig.act(&Act::ThermalSwitch(false)).run_for(0.2);
    rig.act(&Act::ThermalSwitch(true));
    assert_eq!(rig.opening_after(fault + 0.1), Some(0.0));
    for _ in 0..3 {
        rig.request_done(&Request::Enable(false)).run_for(1.0);
        rig.request_done(&Request::Enable(true)).run_for(1.0);
    }
    assert_eq!(rig.find_time(fault + 0.1, &Event::Bridge(true)), None);
    assert_eq!(rig.find_time(fault + 0.1, &Event::Fault(false)), None);
    assert_eq!(rig.stored_fault(0), Some(Fault::OverTemperature.number()));
}

#[test]
fn the_third_fault_in_a_minute_locks_out_in_spite_of_settings() {
    let mut rig = running();
    for fault in 1..=3 {
        rig.act(&Act::ThermalSwitch(false)).run_for(0.1);
        rig.act(&Act::ThermalSwitch(true));
        rig.act(&Act::Enable(false)).run_for(0.8);
        if fault < 3 {
            rig.request_done(&Request::set("soft_start", 0.3));
        }
        let from = rig.time();
        rig.act(&Act::Enable(true)).run(from + 0.4);
        let closes = rig.find_time(from, &Event::Bridge(true));
        assert_eq!(closes.is_some(), fault < 3, "fault {fault}: {closes:?}");
    }
}

/// The port sends nothing, as with a failed transmitter; then it neither receives nor sends.
#[test]
fn a_hung_link_is_a_limit_and_never_a_reset() {
    let mut hazard = Hazard::new("hung", 50.0, Target::Amplitude(0.2));
    hazard.scene.settings.link_timeout = 0.8;
    let mut rig = hazard.commissioned(Kind::default());
    rig.at(1.1, Act::Enable(true));
    let alive = |rig: &mut Rig, from: f64, frames: u32| {
        for n in 0..frames {
            let frame = rig.frame(&Request::Setting(4));
            rig.at(from + 0.1 * f64::from(n), Act::Link(frame));
        }
    };
    alive(&mut rig, 1.0, 50);
    rig.run(3.0);
    rig.chip.board.link.stuck = true;
    rig.run(6.0);
    assert!((rig.amplitude() - 0.2).abs() < 0.005, "{}", rig.amplitude());
    assert_eq!(rig.resets().len(), 1);
    rig.chip.board.link.stuck = false;
    alive(&mut rig, 6.0, 5);
    rig.run(6.6);
    assert!(rig.counters().answers_dropped > 5);
    // The port's interrupt (38) is masked: it neither receives nor sends.
    rig.act(&Act::Store(0xe000_e184, 1 << 6)).run_for(5.0);
    assert_eq!(rig.resets().len(), 1, "{:?}", rig.resets());
    let safe = f64::from(hazard.scene.settings.safe_amplitude);
    let share = rig.amplitude() / safe;
    assert!((share - 1.0).abs() < 0.05, "{share}");
    assert_eq!(rig.find_time(3.0, &Event::Bridge(false)), None);
}

#[test]
fn three_resets_end_at_rest_with_fault_and_link() {
    let mut rig = running();
    let from = rig.time();
    rig.act(&Act::Converts(false)).run(from + 3.0);
    let resets = rig.resets().len();
    assert_eq!(resets, 4, "power-on and three: {:?}", rig.resets());
    let rest = rig.resets()[3].0;
    assert!(rest < from + 0.2, "{rest}");
    let lamp = rig.find_time(rest, &Event::Fault(true));
    assert!(lamp.is_some_and(|time| time < rest + 0.2), "{lamp:?}");
    assert_eq!(rig.find_time(from + 0.01, &Event::Bridge(true)), None);
    let repeated = Fault::RepeatedResets.number();
    assert_eq!(rig.stored_fault(0), Some(repeated));
    rig.run_for(12.0);
    assert_eq!(rig.resets().len(), resets, "{:?}", rig.resets());
    // After repair and acknowledgement the board starts as after power-on.
    rig.act(&Act::Converts(true)).act(&Act::Enable(false));
    let off = rig.time();
    rig.run(off + 0.4);
    assert_eq!(rig.resets().len(), resets, "half a second acknowledges");
    rig.run(off + 1.0);
    assert_eq!(rig.resets().len(), resets + 1);
    rig.act(&Act::Enable(true)).run(off + 2.0);
    assert!(rig.find_time(off, &Event::Bridge(true)).is_some());
    assert!((rig.amplitude() - 0.2).abs() < 0.01, "{}", rig.amplitude());
}

#[test]
fn the_strap_makes_the_link_read_only() {
    let mut rig = machine();
    let set = Request::set("soft_start", 0.3);
    rig.request_done(&set);
    rig.act(&Act::Wire(2, 1, Wire::Low));
    for request in [
        set,
        Request::Defaults,
        Request::Save,
        Request::Target(Target::Amplitude(0.9)),
        Request::Lock(None),
    ] {
        rig.request(&request, |response| {
            let refused = matches!(response, Response::Refused(Refusal::ReadOnly(_)));
            assert!(refused, "{request:?}: {response:?}");
        });
    }
    rig.request_done(&Request::Enable(false));
    rig.act(&Act::Wire(2, 1, Wire::Open)).request_done(&set);
}
