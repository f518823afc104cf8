//! A board without an operating system: the controller in a sample interrupt and a main loop.
//!
//! The controller needs a converter reading every 50 us, an output that holds its value, and the
//! inputs once a drive cycle. The simulated feeder replaces these three; the rest runs on a
//! microcontroller. There `static` replaces `let`, and a critical section guards the mailbox.
//!
//! `cargo run --release -p kband-plant --example board`

use kband_control::{
    Command, Controller, Cycle, PLAN_SLICES, Settings, Signal, StartCause, State, Target,
};
use kband_plant::{Bench, Scene};
use std::error::Error;

/// Data exchanged between the interrupt and the main loop.
#[derive(Default)]
struct Mailbox {
    /// A drive cycle not yet taken by the main loop.
    cycle: Option<Cycle>,
    /// A command not yet taken by the interrupt.
    command: Option<Command>,
}

/// Runs every 50 us, at the end of a conversion. On a microcontroller the registers of converter and
/// power stage take the place of the feeder.
fn sample_interrupt(signal: &mut Signal, feeder: &mut Bench, mailbox: &mut Mailbox) {
    if let Some(command) = mailbox.command.take() {
        signal.command(command);
    }
    let before = signal.phase();
    let sampled = signal.sample(feeder.sample());
    let step = (signal.phase() - before).bits();
    feeder.hold(sampled.output, step);
    if sampled.wrapped {
        mailbox.cycle = Some(signal.cycle().clone());
    }
}

/// Runs without end on a board; here until the parts are locked, at most `seconds`.
fn run(settings: &Settings, seconds: u32) -> Result<State, Box<dyn Error>> {
    let mut feeder = Bench::build(&Scene::default())?;
    let mut mailbox = Mailbox::default();
    let mut signal = Signal::build(settings)?;
    let target = Target::Locked { order: 1 };
    let mut controller = Controller::build(settings, target, StartCause::Ordinary)?;
    let mut state = State::Off;
    for _ in 0..seconds * 20_000 {
        sample_interrupt(&mut signal, &mut feeder, &mut mailbox);
        let Some(cycle) = mailbox.cycle.take() else {
            continue;
        };
        let report = controller.cycle(&cycle, &feeder.inputs());
        mailbox.command = Some(report.command);
        // In the remaining time of the drive cycle.
        (0..PLAN_SLICES).all(|_| controller.plan_step());
        state = report.state;
        if state == State::Locked {
            let (cycles, kicks) = (report.cycle, report.attempts);
            println!("locked after {cycles} drive cycles and {kicks} kicks");
            break;
        }
    }
    Ok(state)
}

fn main() -> Result<(), Box<dyn Error>> {
    let state = run(&Settings::default(), 10)?;
    println!("{}", state.name());
    Ok(())
}

#[test]
fn it_locks() {
    let state = run(&Settings::default(), 10).unwrap();
    assert_eq!(state, State::Locked);
}
