//! Unmodified images of the boards on the emulated chip, with the simulated track on its bridge.

use kband_control::State;
use kband_control::wire::{Request, Response};
use kband_plant::Scene;
use kband_tests::chip::clocks::Cause;
use kband_tests::chip::kind::Kind;
use kband_tests::chip::world::Event;
use kband_tests::desk_amplitude;
use kband_tests::rig::{Act, Rig};

/// A board with the machine's settings, saved at its first start, and the target lock.
fn commissioned(kind: Kind) -> Rig {
    let mut rig = Rig::boot_on(kind);
    rig.run(0.3);
    rig.request_done(&Request::Target(kband_control::Target::Locked { order: 1 }));
    // The desk sends one request and is then silent.
    rig.request_done(&Request::set("link_timeout", 0.0));
    rig.request_done(&Request::Save);
    rig
}

fn from_power_on_to_lock_it_does_what_the_desk_does(kind: Kind) {
    let mut rig = commissioned(kind);
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
