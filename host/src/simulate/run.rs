//! Runs of a scene with progress and Ctrl-C. The controller runs in this process or on a board
//! (processor in the loop); the plant always runs here.

use kband_scene::{Fidelity, Outcome, SceneFile, Watch, cycles};

use crate::board::{BoardLoop, Link};
use crate::desk::{Desk, Progress};
use crate::refusal::Refusal;

/// Runs a scene to its end at its own fidelity (default: envelope), with a progress bar.
pub fn run(file: &SceneFile, desk: &Desk) -> Result<Outcome, Refusal> {
    let fidelity = file.fidelity.unwrap_or_default();
    run_watched(file, fidelity, Watch::FOR_PICTURE, desk)
}

/// Runs a scene to its end at a fidelity, with observers and a progress bar.
pub fn run_watched(
    file: &SceneFile,
    fidelity: Fidelity,
    watch: Watch<'_>,
    desk: &Desk,
) -> Result<Outcome, Refusal> {
    run_with_progress(file, desk, |check_stop| {
        Outcome::run(file, fidelity, watch, check_stop)
    })
}

/// Runs a scene to its end with its controller on the board at `link`, sample by sample, with a
/// progress bar.
pub fn run_on(
    link: Link,
    file: &SceneFile,
    watch: Watch<'_>,
    desk: &Desk,
) -> Result<Outcome, Refusal> {
    let mut board = BoardLoop::start(link, &file.scene)?;
    run_with_progress(file, desk, |check_stop| {
        Outcome::from_cycles(file, || board.cycle(), watch, check_stop)
    })
}

fn run_with_progress(
    file: &SceneFile,
    desk: &Desk,
    run: impl FnOnce(kband_scene::ProgressCheck<'_>) -> Result<Outcome, Refusal>,
) -> Result<Outcome, Refusal> {
    let progress = Progress::new("simulating", cycles(file) as u64);
    let outcome = run(&mut |done| {
        progress.advance(done);
        desk.check_stop()
    });
    progress.finish();
    outcome
}
