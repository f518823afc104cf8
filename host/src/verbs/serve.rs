//! `kband serve`: a simulated feeder behind the registers of a board, on Modbus TCP.

mod drive;
mod network;

use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use self::drive::Drive;
use self::network::{Shared, accept};
use crate::arguments;
use crate::desk::Desk;
use crate::file;
use crate::refusal::{Exit, Refusal};
use crate::simulate::{DEFAULT, SceneFile};

/// Time between two steps of the simulation.
const STEP: Duration = Duration::from_millis(5);
/// Longest time that one step makes up for, after the process was held up.
const LONGEST_STEP: Duration = Duration::from_millis(200);

/// Simulate a feeder in real time behind the registers of a board, on Modbus TCP.
///
/// It is the same controller on the same track as in kband simulate, from power-on, with the enable
/// input given after 0.5 s. So a PLC's program can be tested before there is a machine. Registers and
/// rules are those of a board: kband registers. Where the scene leaves the bus off, it has the
/// authority to command and to acknowledge (bus 2). Nothing that is saved outlasts the run.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband serve
  kband serve my.toml --modbus 127.0.0.1:1502
  kband serve my.toml --modbus 0.0.0.0:1502 --for 600

Modbus TCP has no password: on another address than the loopback everybody on that network may command the simulation. \
Ctrl-C ends it.")]
pub struct Arguments {
    /// Scene to simulate; without one, the default scene.
    #[arg(value_name = "SCENE.toml")]
    scene: Option<PathBuf>,

    /// Address and port to listen at; port 0 takes a free one.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:1502", value_parser = arguments::socket)]
    modbus: SocketAddr,

    /// End by itself after this many seconds.
    #[arg(long = "for", value_name = "SECONDS", value_parser = arguments::within(0.1, 1e6, "s"))]
    limit: Option<f64>,
}

/// Serves until the time is over or Ctrl-C.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let file = match &arguments.scene {
        Some(path) => {
            let text = file::read_text(path)?;
            SceneFile::parse(&text).map_err(|refusal| refusal.at(path.display()))?
        }
        None => SceneFile::parse(DEFAULT)?,
    };
    let drive = Drive::build(&file.scene)?;
    let listener = TcpListener::bind(arguments.modbus).map_err(|error| {
        Refusal::new(
            format!("{}: {error}", arguments.modbus),
            "give another address or port: --modbus 127.0.0.1:1503",
        )
    })?;
    let shared = Arc::new(Shared::new(drive));
    let address = accept(listener, &shared).map_err(|error| {
        Refusal::new(
            format!("{}: {error}", arguments.modbus),
            "give another address or port",
        )
    })?;
    println!(
        "a simulated feeder answers Modbus TCP at {address}, any unit; kband registers lists its registers"
    );
    if !address.ip().is_loopback() {
        println!("note: everybody on this network may command it");
    }
    let limit = arguments.limit.map(Duration::from_secs_f64);
    let begun = Instant::now();
    let mut last = begun;
    while desk.go_on().is_ok() && limit.is_none_or(|limit| begun.elapsed() < limit) {
        std::thread::sleep(STEP);
        let now = Instant::now();
        let passed = (now - last).min(LONGEST_STEP);
        last = now;
        shared.with(|served| served.drive.advance(passed.as_secs_f64()));
    }
    shared.stop();
    let (requests, clients) =
        shared.with(|served| (served.server.counters().requests, served.clients));
    println!("ended: {requests} requests of {clients} clients");
    Ok(Exit::Done)
}
