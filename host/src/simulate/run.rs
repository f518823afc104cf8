//! Runs of a scene with progress and Ctrl-C, with the controller here or on a board.

use std::path::Path;

use kband_scene::{DEFAULT, Fidelity, Outcome, SceneFile, Watch, at_line, cycles, table};
use toml::Table;

use super::schema;
use crate::board::{BoardLoop, Link};
use crate::desk::{Desk, Progress};
use crate::refusal::Result;
use crate::{file, provenance};

pub(crate) struct SceneText {
    pub name: String,
    text: String,
    pub table: Table,
}

impl SceneText {
    /// Reads a file; without a path, the default scene.
    pub fn read(path: Option<&Path>) -> Result<Self> {
        let (name, text) = match path {
            Some(path) => (path.display().to_string(), file::read_text(path)?),
            None => ("the default scene".into(), DEFAULT.into()),
        };
        let table = table(&text).map_err(|refusal| refusal.at(&name))?;
        Ok(Self { name, text, table })
    }

    /// The scene of the table with changes. The provenance of its results contains its values.
    pub fn scene(&self, table: &Table) -> Result<SceneFile> {
        provenance::scene(table, schema::unit);
        SceneFile::from_table(table.clone())
            .map_err(|refusal| at_line(refusal, &self.text).at(&self.name))
    }
}

/// Runs a scene to its end at a fidelity, with observers and a progress bar.
pub fn run_watched(
    file: &SceneFile,
    fidelity: Fidelity,
    watch: Watch<'_>,
    desk: &Desk,
) -> Result<Outcome> {
    run_with_progress(file, desk, |check_stop| {
        Outcome::run(file, fidelity, watch, check_stop)
    })
}

/// Runs a scene to its end with its controller on the board at `link`, sample by sample.
pub fn run_on(link: Link, file: &SceneFile, watch: Watch<'_>, desk: &Desk) -> Result<Outcome> {
    let mut board = BoardLoop::start(link, &file.scene)?;
    run_with_progress(file, desk, |check_stop| {
        Outcome::from_cycles(file, || board.cycle(), watch, check_stop)
    })
}

fn run_with_progress(
    file: &SceneFile,
    desk: &Desk,
    run: impl FnOnce(kband_scene::ProgressCheck<'_>) -> Result<Outcome>,
) -> Result<Outcome> {
    let progress = Progress::new("simulating", cycles(file) as u64);
    run(&mut |done| {
        progress.advance(done);
        desk.check_stop()
    })
}
