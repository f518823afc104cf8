//! The flashed image on its chip, from power-on to every way to end operation: each is safe. The time
//! until the bridge opens.

use kband_control::wire::{Request, Response, SavedSettings};
use kband_control::{State, Target};
use kband_plant::Scene;
use kband_tests::chip::Hang;
use kband_tests::chip::clocks::Cause;
use kband_tests::chip::kind::Kind;
use kband_tests::chip::world::Event;
use kband_tests::desk_amplitude;
use kband_tests::hazards::Hazard;
use kband_tests::images;
use kband_tests::rig::{Act, Rig};

/// A machine that runs at a small amplitude at 3 s.
fn machine() -> Hazard {
    let mut hazard = Hazard::new("ends", 50.0, Target::Amplitude(0.2))
        .with(|scene| scene.settings.link_timeout = 0.0);
    hazard.from = 3.0;
    hazard
}

/// Its board at 3 s, running.
fn running() -> Rig {
    let rig = machine().before(Kind::default());
    assert!((rig.amplitude() - 0.2).abs() < 0.01, "{}", rig.amplitude());
    assert_eq!(rig.resets().len(), 1, "{:?}", rig.resets());
    rig
}

#[test]
fn the_bridge_opens_in_time_for_every_cause() {
    let rig = running();
    let (window, software) = (Some(Cause::Window), Some(Cause::Software));
    for (name, act, upper_limit, reset) in [
        ("samples stop", Act::Converts(false), 5e-3, window),
        ("the crystal stops", Act::CrystalStops, 1e-3, software),
        ("over-current", Act::OverCurrent(true), 1e-3, None),
        ("the supply sags", Act::Volts(2.8), 1e-3, None),
        ("a debugger halts", Act::Halt, 5e-3, None),
        ("all hangs", Act::Hang(Hang::Everything), 5e-3, window),
        // Four cycles of 20 ms, and the present one.
        ("the control hangs", Act::Hang(Hang::Thread), 0.1, None),
        ("too hot", Act::ThermalSwitch(false), 0.04, None),
    ] {
        let mut rig = rig.clone();
        rig.tolerant = true;
        rig.at(3.0, act.clone()).run(3.2);
        let opens = rig.opening_after(3.0);
        let (fault, resets) = (rig.faults_after(3.0), rig.resets());
        println!("{name}: bridge open after {opens:?} s, FAULT at {fault:?} s, resets {resets:?}");
        let in_time = opens.is_some_and(|time| time <= upper_limit);
        assert!(in_time, "{name}: {opens:?}");
        // The bridge stays open, even with the enable input on.
        if act != Act::Halt {
            rig.run(4.5);
        }
        assert_eq!(rig.closes_after(3.0 + upper_limit), None, "{name}");
        let resets = rig.resets();
        let is_recorded = |cause| resets[1..].iter().any(|reset| reset.1 == cause);
        assert!(reset.is_none_or(is_recorded), "{name}: {resets:?}");
    }
}

#[test]
fn a_stack_that_is_nearly_used_up_stops_the_drive() {
    let mut rig = running();
    // In the last eighth of the stack; each cycle checks some words of it, and 80 cycles check all
    // of them.
    let written = images::symbol(&images::feeder_on(Kind::default()), "_stack_end") + 512;
    rig.at(3.0, Act::Store(written, 0)).run(4.7);
    assert!(rig.opening_after(3.0).is_some());
    assert_eq!(rig.resets().len(), 1, "{:?}", rig.resets());
    rig.run(4.9);
    assert_eq!(rig.stored_fault(0), Some(10));
}

#[test]
fn a_reset_by_the_pin_while_it_drives_is_a_fault() {
    let mut rig = running();
    rig.chip.reset(Cause::Pin);
    rig.run(3.5);
    assert_eq!(rig.resets()[1].1, Cause::Pin);
    assert!(rig.faults_after(3.0).is_some());
    assert_eq!(rig.closes_after(3.001), None);
}

#[test]
fn a_link_that_waits_for_ever_is_no_reset() {
    let mut rig = running();
    rig.request_done(&Request::Telemetry(1));
    let from = rig.time() + 0.01;
    // A stray write to control register 1 of the port: it disables the transmit request.
    rig.at(from, Act::Store(0x4000_440c, 0)).run(from + 1.6);
    assert_eq!(rig.resets().len(), 1, "{:?}", rig.resets());
    assert_eq!(rig.opening_after(from), None, "it drives on");
}

#[test]
fn a_dead_or_a_wrong_crystal_is_a_fault_and_no_hang() {
    let right = Rig::boot_on(Kind::Stm32f405).chip.board.clocks.crystal;
    for crystal in [right, 0, 4_000_000, 12_000_000, 16_000_000, 25_000_000] {
        let mut rig = Rig::boot_on(Kind::Stm32f405);
        rig.chip.board.clocks.crystal = crystal;
        rig.at(0.5, Act::Enable(true)).run(1.0);
        assert_eq!(rig.chip.board.clock(), 168_000_000, "{crystal}");
        // The lamp alone is no proof, because it is also on while the board has no settings.
        assert!(rig.faults_after(0.0).is_some(), "{crystal}");
        assert_eq!(rig.closes_after(0.0), None, "{crystal}");
        assert_eq!(rig.resets().len(), 1, "{crystal}: {:?}", rig.resets());
        let reported = rig.status().inputs.clock_failed;
        assert_eq!(reported, crystal != right, "{crystal}");
    }
}

#[test]
fn damaged_settings_never_drive() {
    let mut rig = machine().commissioned(Kind::default());
    // The mark of the bank is before the first record.
    let settings = Kind::default().facts().settings + 32;
    assert_eq!(rig.stored(), SavedSettings::InUse);
    for bit in [0, 3 * 8 + 1, 60 * 8, 110 * 8 + 5, 242 * 8] {
        let mut rig = rig.clone();
        rig.chip.flash_mut()[settings + bit / 8] ^= 1 << (bit % 8);
        rig.at(1.1, Act::Volts(0.0)).at(1.5, Act::Volts(3.3));
        rig.at(2.0, Act::Enable(true)).at(2.5, Act::Enable(false));
        rig.at(3.2, Act::Enable(true)).run(4.0);
        assert_eq!(rig.closes_after(1.1), None, "bit {bit}");
        assert!(rig.faults_after(1.5).is_some(), "bit {bit}");
        assert_eq!(rig.stored(), SavedSettings::Damaged, "bit {bit}");
    }
}

fn from_power_on_to_lock_it_does_what_the_desk_does(kind: Kind) {
    let mut rig = Rig::boot_on(kind);
    rig.run(0.3);
    rig.request_done(&Request::Target(Target::Locked { order: 1 }));
    // The desk sends one request and is then silent.
    rig.request_done(&Request::set("link_timeout", 0.0));
    rig.request_done(&Request::Save);
    // The enable input acknowledges the start without settings; then the board starts.
    rig.at(1.5, Act::Enable(true)).run(1.5);
    assert_eq!(rig.resets(), [(0.0, Cause::Power)]);
    assert_eq!(rig.find_time(0.0, &Event::Bridge(true)), None);
    rig.run(9.0);
    let begins = rig.find_time(1.5, &Event::Bridge(true)).unwrap();
    assert!(begins < 1.6, "{begins} s");
    assert!(rig.find_time(1.5, &Event::Ready(true)).is_some());
    let (board, scene) = (rig.amplitude(), Scene::default());
    let desk = desk_amplitude(&scene, 500, State::Locked);
    assert!((board / desk - 1.0).abs() < 0.02, "{board} {desk}");
    assert!(rig.peak() < 0.3);
    // One reset, no fault, and the highest core clock with its wait states.
    assert_eq!(rig.resets().len(), 1);
    assert_eq!(rig.find_time(1.4, &Event::Fault(true)), None);
    assert_eq!(rig.chip.board.clock(), kind.facts().fastest[0]);
    let wait_states = if kind == Kind::Stm32f405 { 5 } else { 4 };
    assert_eq!(rig.chip.board.flash.latency(), wait_states);
    // The board answers the desk.
    rig.request(&Request::SelfTest, |response| {
        assert!(matches!(response, Response::Refused(_)), "it runs");
    });
    rig.request_done(&Request::Alive);
}

kband_tests::on_both! {
    from_power_on_to_lock_it_does_what_the_desk_does,
}
