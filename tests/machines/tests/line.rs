//! The link on the flashed image: a stuck line, a board at rest after resets, the strap.

use kband_control::wire::{Refusal, Request, Response};
use kband_control::{Fault, Target};
use kband_machines::chip::gpio::Wire;
use kband_machines::chip::kind::Kind;
use kband_machines::chip::world::Seen;
use kband_machines::hazards::Hazard;
use kband_machines::rig::{Act, Rig};

/// A machine with saved settings, at rest; no link timeout.
fn machine() -> Rig {
    let mut hazard = Hazard::of("line", 50.0, Target::Amplitude(0.2));
    hazard.scene.settings.link_timeout = 0.0;
    hazard.commissioned(Kind::default())
}

fn counters(rig: &mut Rig) -> kband_control::wire::Counters {
    rig.request(&Request::Counters, |response| match response {
        Response::Counters(counters) => counters,
        other => panic!("{other:?}"),
    })
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

/// Three successive resets must end at rest, not in a loop of resets.
#[test]
fn three_resets_end_at_rest_with_fault_and_link() {
    let mut rig = machine();
    rig.at(1.1, Act::Enable(true)).run(2.1);
    assert!(rig.chip.is_driven());
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
    // The link answers.
    let repeated = Fault::RepeatedResets.number();
    assert_eq!(rig.kept_fault(0), Some(repeated));
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
    let mut rig = machine();
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
