//! `kband live`: the dashboard in the terminal.

use std::path::PathBuf;

use crate::arguments;
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};

/// A dashboard in the terminal: k against the band, regime, impact phases, faults; keys change the target.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband live
  kband live my.toml --speed 4

Keys: q quits, e takes the enable away or gives it, 1 to 8 ask for a lock of that order, x for chaos,
+ and - change k, c captures anew, p pauses.")]
pub struct Arguments {
    /// Scene to simulate in real time; without one, the default scene.
    #[arg(value_name = "SCENE.toml")]
    scene: Option<PathBuf>,

    /// Seconds of the simulation for one second of the clock.
    #[arg(long, value_name = "FACTOR", default_value = "1", value_parser = arguments::within(0.01, 100.0, ""))]
    speed: f64,

    /// End by itself after this many seconds of the clock.
    #[arg(long = "for", value_name = "SECONDS", value_parser = arguments::within(0.1, 1e6, "s"))]
    limit: Option<f64>,

    /// Panic in the middle, for the test that the terminal is restored.
    #[cfg(debug_assertions)]
    #[arg(long, hide = true)]
    panic: bool,
}

/// Shows the dashboard.
#[cfg(feature = "live")]
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    use std::io::IsTerminal;
    use std::time::Duration;

    use crate::file;
    use crate::live::{self, Pace, Simulation};
    use crate::simulate::{DEFAULT, SceneFile};

    let (name, file) = match &arguments.scene {
        Some(path) => {
            let name = path.display().to_string();
            let text = file::read_text(path)?;
            (name.clone(), SceneFile::parse(&text).map_err(|refusal| refusal.at(name))?)
        }
        None => ("the default scene".into(), SceneFile::parse(DEFAULT)?),
    };
    let mut source = Simulation::build(&name, &file)?;
    if !std::io::stdout().is_terminal() {
        return Err(Refusal::new(
            "standard output is not a terminal",
            "run kband live in a terminal; kband simulate writes a trace and a picture",
        ));
    }
    let pace = Pace {
        speed: arguments.speed,
        limit: arguments.limit.map(Duration::from_secs_f64),
    };
    #[cfg(debug_assertions)]
    if arguments.panic {
        live::run(&mut live::Panics(source), pace, desk)?;
        return Ok(Exit::Done);
    }
    live::run(&mut source, pace, desk)?;
    Ok(Exit::Done)
}

/// Says what is missing.
#[cfg(not(feature = "live"))]
pub fn run(_arguments: &Arguments, _desk: &Desk) -> Result<Exit, Refusal> {
    Err(Refusal::new(
        "this kband was built without its dashboard",
        "build it with it: cargo install --path host --features live",
    ))
}
