//! The controller against the simulated feeder: from standstill to the lock, in virtual time.
//!
//! `cargo run --release -p kband-plant --example closed_loop`

use std::error::Error;

use kband_control::{State, Target};
use kband_plant::{ClosedLoop, Scene};

/// Runs a scene and prints every change of the controller's state.
///
/// Ends at the `wanted` state, or after `cycles` drive cycles.
fn run(scene: &Scene, wanted: State, cycles: u32) -> Result<State, Box<dyn Error>> {
    let mut closed = ClosedLoop::build(scene)?;
    let mut state = State::Off;
    for _ in 0..cycles {
        let moment = closed.cycle();
        let report = moment.report;
        if report.state != state {
            state = report.state;
            println!(
                "{:6.2} s  {:<10} b = {:.4} mm, k = {:.4}",
                moment.time,
                state.name(),
                report.amplitude * 1e3,
                report.k
            );
        }
        if state == wanted {
            break;
        }
    }
    Ok(state)
}

fn main() -> Result<(), Box<dyn Error>> {
    let scene = Scene {
        target: Target::Locked { order: 1 },
        ..Scene::default()
    };
    run(&scene, State::Locked, 500)?;
    Ok(())
}

#[test]
fn it_locks() {
    let state = run(&Scene::default(), State::Locked, 500).unwrap();
    assert_eq!(state, State::Locked);
}
