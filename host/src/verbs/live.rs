//! `kband live`: the dashboard in the terminal.

use std::path::PathBuf;

use crate::arguments;
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};

/// Show a dashboard in the terminal: k against the band, regime, impact phases, faults. Keys change
/// the target.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband live
  kband live my.toml --speed 4
  kband live --on /dev/ttyACM0
  kband live --on qemu

Keys: q quits, e switches the enable off or on, 1 to 8 request a lock of that order, x requests \
chaos, + and - change k, c starts a new capture, p pauses.")]
pub struct Arguments {
    /// Scene to simulate in real time. Default: the built-in scene.
    #[arg(value_name = "SCENE.toml", conflicts_with = "on")]
    scene: Option<PathBuf>,

    /// Show a board instead: qemu (the emulated CPU with the default scene) or a serial port.
    #[arg(long, value_name = "qemu or /dev/PORT")]
    on: Option<String>,

    /// Image for --on qemu. Default: the image that cargo builds here.
    #[arg(long, value_name = "FILE", requires = "on")]
    image: Option<PathBuf>,

    /// File that keeps the settings of --on qemu between runs. It is created if missing.
    #[arg(long, value_name = "FILE", requires = "on")]
    flash_image: Option<PathBuf>,

    /// Simulated seconds for one second of the clock.
    #[arg(long, value_name = "FACTOR", conflicts_with = "on", default_value = "1", value_parser = arguments::within(0.01, 100.0, ""))]
    speed: f64,

    /// Duration in s of the clock.
    #[arg(long = "for", value_name = "SECONDS", value_parser = arguments::within(0.1, 1e6, "s"))]
    limit: Option<f64>,
}

/// Shows the dashboard.
#[cfg(feature = "live")]
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    use std::io::IsTerminal;
    use std::time::Duration;

    use crate::board::{Address, Emulated};
    use crate::live::{self, Board, Pace, Source};

    let is_terminal = std::io::stdout().is_terminal();
    let mut source: Box<dyn Source> = match &arguments.on {
        // A board is not bothered where nobody will see it.
        Some(on) if is_terminal => {
            let address = Address {
                flash_image: arguments.flash_image.clone(),
                ..Address::of(on, arguments.image.as_deref())
            };
            Box::new(Board::start(address.open(Emulated::Running)?)?)
        }
        _ => Box::new(simulation(arguments)?),
    };
    if !is_terminal {
        return Err(Refusal::new(
            "standard output is not a terminal",
            "run kband live in a terminal; kband simulate writes a trace and a picture, kband monitor prints a board",
        ));
    }
    let pace = Pace {
        speed: arguments.speed,
        limit: arguments.limit.map(Duration::from_secs_f64),
    };
    live::run(&mut *source, pace, desk)?;
    Ok(Exit::Done)
}

#[cfg(feature = "live")]
fn simulation(arguments: &Arguments) -> Result<crate::live::Simulation, Refusal> {
    let read = crate::simulate::SceneText::read(arguments.scene.as_deref())?;
    crate::live::Simulation::build(&read.name, &read.scene(&read.table)?)
}

/// Says what is missing.
#[cfg(not(feature = "live"))]
pub fn run(_arguments: &Arguments, _desk: &Desk) -> Result<Exit, Refusal> {
    Err(Refusal::new(
        "this kband was built without the dashboard",
        "install it with: cargo install --path host --features live",
    ))
}
