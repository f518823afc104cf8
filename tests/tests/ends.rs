//! Every end of operation is safe: the flashed image on its chip, and the time until its bridge
//! opens.

use std::sync::OnceLock;

use kband_control::Target;
use kband_control::wire::{Kept, Request, Response};
use kband_tests::chip::Hang;
use kband_tests::chip::clocks::Cause;
use kband_tests::chip::kind::Kind;
use kband_tests::chip::world::Seen;
use kband_tests::images::{self, feeder};
use kband_tests::rig::{Act, Rig};

/// A board at 0.4 s with saved settings and a small amplitude as target.
fn commissioned() -> Rig {
    let mut rig = Rig::boot(&feeder());
    rig.run(0.3);
    rig.request_done(&Request::Target(Target::Amplitude(0.2)));
    rig.request_done(&Request::set("link_timeout", 0.0));
    rig.request_done(&Request::Save);
    rig
}

/// The same board at 3 s, running since 1.2 s.
fn running() -> Rig {
    static RUNNING: OnceLock<Rig> = OnceLock::new();
    let play = || {
        let mut rig = commissioned();
        rig.at(1.2, Act::Enable(true)).run(3.0);
        assert!((rig.amplitude() - 0.2).abs() < 0.01, "{}", rig.amplitude());
        assert_eq!(rig.resets().len(), 1, "{:?}", rig.resets());
        rig
    };
    RUNNING.get_or_init(play).clone()
}

#[test]
fn the_bridge_opens_in_time_whatever_ends() {
    let rig = running();
    let (window, software) = (Some(Cause::Window), Some(Cause::Software));
    for (name, act, most, reset) in [
        ("samples stop", Act::Converts(false), 5e-3, window),
        ("the crystal stops", Act::CrystalStops, 1e-3, software),
        ("over-current", Act::OverCurrent(true), 1e-3, None),
        ("the supply sags", Act::Volts(2.8), 1e-3, None),
        ("a debugger halts", Act::Halt, 5e-3, None),
        ("all hangs", Act::Hang(Hang::Everything), 5e-3, window),
        // Four cycles of 20 ms, and the current one.
        ("the control hangs", Act::Hang(Hang::Thread), 0.1, None),
        ("too hot", Act::ThermalSwitch(false), 0.04, None),
    ] {
        let mut rig = rig.clone();
        rig.tolerant = true;
        rig.at(3.0, act.clone()).run(3.2);
        let opens = rig.opens_after(3.0);
        let since = |time: f64| time - 3.0;
        println!(
            "{name}: bridge open after {opens:?} s, FAULT after {:?} s, reset after {:?} s",
            rig.seen_after(3.0, &Seen::Fault(true)).map(since),
            rig.resets().get(1).map(|(time, _)| since(*time)),
        );
        assert!(opens.is_some_and(|time| time <= most), "{name}: {opens:?}");
        // It stays open, even with the enable input set.
        if act != Act::Halt {
            rig.run(4.5);
        }
        let again = rig.seen_after(3.0 + most, &Seen::Bridge(true));
        assert_eq!(again, None, "{name}");
        let resets = rig.resets();
        let seen = |cause| resets[1..].iter().any(|seen| seen.1 == cause);
        assert!(reset.is_none_or(seen), "{name}: {resets:?}");
    }
}

#[test]
fn the_cause_of_an_open_bridge_is_reported_and_kept() {
    let rig = running();
    for (act, number) in [(Act::OverCurrent(true), 11), (Act::Volts(2.8), 14)] {
        let mut rig = rig.clone();
        rig.at(3.0, act.clone()).run(3.03);
        // Lamp and log follow within a cycle and the writing of a record.
        assert!(rig.seen_after(3.0, &Seen::Fault(true)).is_some(), "{act:?}");
        // The record waits until the supply has been good for 100 ms.
        rig.at(3.1, Act::Volts(3.3)).run(3.4);
        assert_eq!(rig.kept_fault(0), Some(number), "{act:?}");
    }
}

#[test]
fn a_stack_that_is_nearly_used_up_stops_the_drive() {
    let mut rig = running();
    // In the last eighth of the stack; each cycle checks some words of it, all of them in 80
    // cycles.
    let written = images::symbol(&feeder(), "_stack_end") + 512;
    rig.at(3.0, Act::Store(written, 0)).run(4.7);
    assert!(rig.opens_after(3.0).is_some());
    assert_eq!(rig.resets().len(), 1, "{:?}", rig.resets());
    rig.run(4.9);
    assert_eq!(rig.kept_fault(0), Some(10));
}

#[test]
fn a_reset_by_the_pin_while_it_drives_is_a_fault() {
    let mut rig = running();
    rig.chip.reset(Cause::Pin);
    rig.run(3.5);
    assert_eq!(rig.resets()[1].1, Cause::Pin);
    assert!(rig.seen_after(3.0, &Seen::Fault(true)).is_some());
    assert_eq!(rig.seen_after(3.001, &Seen::Bridge(true)), None);
}

#[test]
fn a_link_that_waits_for_ever_is_no_reset() {
    let mut rig = running();
    rig.request_done(&Request::Telemetry(1));
    let from = rig.time() + 0.01;
    // A stray write to control register 1 of the port: it disables the transmit request.
    rig.at(from, Act::Store(0x4000_440c, 0)).run(from + 1.6);
    assert_eq!(rig.resets().len(), 1, "{:?}", rig.resets());
    assert_eq!(rig.opens_after(from), None, "it drives on");
}

#[test]
fn a_dead_or_a_wrong_crystal_is_a_fault_and_no_hang() {
    let right = Rig::boot(&feeder()).chip.board.clocks.crystal;
    for crystal in [right, 0, 4_000_000, 12_000_000, 16_000_000, 25_000_000] {
        let mut rig = Rig::boot(&feeder());
        rig.chip.board.clocks.crystal = crystal;
        rig.at(0.5, Act::Enable(true)).run(1.0);
        assert_eq!(rig.chip.board.clock(), 168_000_000, "{crystal}");
        // The lamp alone proves nothing: it is on while the board has no settings.
        let fault = rig.seen_after(0.0, &Seen::Fault(true));
        assert!(fault.is_some(), "{crystal}");
        assert_eq!(rig.seen_after(0.0, &Seen::Bridge(true)), None, "{crystal}");
        assert_eq!(rig.resets().len(), 1, "{crystal}: {:?}", rig.resets());
        let told = rig.request(&Request::Status, |response| match response {
            Response::Status(status) => status.inputs.clock_failed,
            other => panic!("{other:?}"),
        });
        assert_eq!(told, crystal != right, "{crystal}");
    }
}

#[test]
fn a_board_does_not_start_by_itself() {
    let mut rig = commissioned();
    rig.at(0.9, Act::Enable(true));
    rig.run(0.9);
    // Power fails and returns with the enable input set.
    rig.at(1.0, Act::Volts(0.0))
        .at(1.5, Act::Volts(3.3))
        .run(3.0);
    assert_eq!(rig.seen_after(1.0, &Seen::Bridge(true)), None);
    rig.at(3.0, Act::Enable(false))
        .at(3.6, Act::Enable(true))
        .run(5.0);
    assert!(rig.seen_after(3.6, &Seen::Bridge(true)).is_some());
    assert!((rig.amplitude() - 0.2).abs() < 0.01, "the target is kept");
}

#[test]
fn damaged_settings_never_drive() {
    let mut rig = commissioned();
    rig.run(0.5);
    // The bank's mark is before the first record.
    let settings = Kind::default().facts().settings + 32;
    assert_eq!(rig.kept(), Kept::InUse);
    for bit in [0, 3 * 8 + 1, 60 * 8, 110 * 8 + 5, 242 * 8] {
        let mut rig = rig.clone();
        rig.chip.flash_mut()[settings + bit / 8] ^= 1 << (bit % 8);
        rig.at(1.0, Act::Volts(0.0))
            .at(1.5, Act::Volts(3.3))
            .at(2.0, Act::Enable(true))
            .at(2.5, Act::Enable(false))
            .at(3.2, Act::Enable(true))
            .run(4.0);
        assert_eq!(rig.seen_after(1.0, &Seen::Bridge(true)), None, "bit {bit}");
        let fault = rig.seen_after(1.5, &Seen::Fault(true));
        assert!(fault.is_some(), "bit {bit}");
        assert_eq!(rig.kept(), Kept::Damaged, "bit {bit}");
    }
}
