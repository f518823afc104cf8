//! Runs of a scene with progress and Ctrl-C, here or with the controller on a board.

use kband_scene::{Fidelity, Outcome, SceneFile, Watch, cycles};

use crate::board::{BoardLoop, Link};
use crate::desk::{Desk, Progress};
use crate::refusal::Refusal;

/// Runs a scene to its end in its own fidelity, with progress.
pub fn run(file: &SceneFile, desk: &Desk) -> Result<Outcome, Refusal> {
    watched(file, file.fidelity.unwrap_or_default(), Watch::DRAWN, desk)
}

/// Runs a scene to its end in a fidelity, watched, with progress.
pub fn watched(
    file: &SceneFile,
    fidelity: Fidelity,
    watch: Watch<'_>,
    desk: &Desk,
) -> Result<Outcome, Refusal> {
    shown(file, desk, |go_on| {
        Outcome::run(file, fidelity, watch, go_on)
    })
}

/// Runs a scene to its end with its controller on the board at the end of `link`, with progress.
pub fn run_on(
    link: Link,
    file: &SceneFile,
    watch: Watch<'_>,
    desk: &Desk,
) -> Result<Outcome, Refusal> {
    let mut board = BoardLoop::start(link, &file.scene)?;
    let cycle = || {
        let moment = board.cycle()?;
        Ok((moment, board.plant().strikes().to_vec()))
    };
    shown(file, desk, |go_on| Outcome::of(file, cycle, watch, go_on))
}

fn shown(
    file: &SceneFile,
    desk: &Desk,
    run: impl FnOnce(kband_scene::GoOn<'_>) -> Result<Outcome, Refusal>,
) -> Result<Outcome, Refusal> {
    let progress = Progress::new("simulating", cycles(file) as u64);
    let outcome = run(&mut |done| {
        progress.advance(done);
        desk.go_on()
    });
    progress.finish();
    outcome
}
