//! `kband serve`: a Modbus TCP server for the registers of a simulated feeder or a board.

#[cfg_attr(not(feature = "mqtt"), path = "serve/no_broker.rs")]
mod broker;
mod drive;
mod gateway;
mod mqtt;
mod network;

use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use kband_bus::Answer;

use self::drive::Simulated;
use self::gateway::Gateway;
use self::mqtt::Publisher;
use self::network::{Shared, accept};
use crate::arguments;
use crate::board::{Address, BoardMessage};
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal, Result};
use crate::simulate::SceneText;

/// Time between two steps of the simulation.
const STEP: Duration = Duration::from_millis(5);
/// Longest simulated time of one step, after a pause of the process.
const LONGEST_STEP: Duration = Duration::from_millis(200);

/// Serve the registers of a simulated feeder, or with --on those of a board, on Modbus TCP.
///
/// The simulation is that of kband simulate, in real time from power-on; the enable input is on
/// after 0.5 s. A PLC's program can thus be tested without a machine. Registers and rules are those
/// of a board: kband registers. If the scene leaves the bus off, the bus may command and
/// acknowledge (bus 2). Saved values are lost at the end.
///
/// With --on kband is a gateway to a board, whose own server answers over the link. The settings
/// bus and bus_address give the authority, as on its serial bus. Both share one control word and
/// bus_timeout. If strap or PIN make the link read-only, clients can only read.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband serve
  kband serve my.toml --modbus 127.0.0.1:1502
  kband serve my.toml --modbus 0.0.0.0:1502 --for 600
  kband serve --on /dev/ttyACM0
  kband serve --on /dev/ttyACM0 --mqtt broker.plant:1883 --topic line3/feeder

Modbus TCP has no password: on another address than the loopback, everybody on that network can \
command the feeder. Ctrl-C ends it.")]
pub struct Arguments {
    /// Scene to simulate. Default: the built-in scene.
    #[arg(value_name = "SCENE.toml", conflicts_with = "on")]
    scene: Option<PathBuf>,
    #[command(flatten)]
    address: Address,
    /// Address and port to listen at; port 0 selects a free one.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:1502", value_parser = arguments::socket)]
    modbus: SocketAddr,
    /// Also publish to this MQTT broker: readings once a second, and events.
    ///
    /// Messages are JSON with the names of kband monitor: TOPIC/readings and TOPIC/event.
    /// TOPIC/status is online, or offline by the last will. kband subscribes to nothing. It retries
    /// a missing broker each second.
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1, default_missing_value = "127.0.0.1:1883")]
    mqtt: Option<String>,
    /// Topic of the messages.
    #[arg(long, value_name = "TOPIC", default_value = "kband", requires = "mqtt")]
    topic: String,
    /// Duration in s.
    #[arg(long = "for", value_name = "SECONDS", value_parser = arguments::within(0.1, 1e6, "s"))]
    limit: Option<f64>,
}

trait Feeder: Send {
    fn name(&self) -> String;

    /// Answers a request of unit, function and data in the same form; returns whether it did.
    fn answer(&mut self, adu: &[u8], answer: &mut Answer) -> bool;

    /// Works between two requests, `passed` after the last call; refused if the feeder is lost.
    fn advance(&mut self, passed: Duration) -> Result<()>;

    /// Frequency, last drive cycle, and new events; refused if the feeder is lost.
    fn news(&mut self) -> Result<Vec<BoardMessage>>;
}

fn open(arguments: &Arguments) -> Result<Box<dyn Feeder>> {
    if arguments.address.on.is_some() {
        let mut gateway = Gateway::open(&arguments.address)?;
        if let Some(next) = gateway.reads_only()? {
            eprintln!("note: clients only read: {next}");
        }
        return Ok(Box::new(gateway));
    }
    arguments.address.refuse_emulated_options()?;
    let read = SceneText::read(arguments.scene.as_deref())?;
    let file = read.scene(&read.table)?;
    Ok(Box::new(Simulated::build(&file.scene)?))
}

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let listener = TcpListener::bind(arguments.modbus).map_err(|error| {
        let next = "give another address or port: --modbus 127.0.0.1:1503";
        Refusal::new(format!("{}: {error}", arguments.modbus), next)
    })?;
    let mut publisher = match &arguments.mqtt {
        Some(address) => Some(Publisher::begin(address, &arguments.topic)?),
        None => None,
    };
    let feeder = open(arguments)?;
    let name = feeder.name();
    let shared = Arc::new(Shared::new(feeder));
    let address = accept(listener, &shared).map_err(|error| {
        let cause = format!("{}: {error}", arguments.modbus);
        Refusal::new(cause, "give another address or port")
    })?;
    println!(
        "{name} answers Modbus TCP at {address}, any unit; kband registers lists its registers"
    );
    if !address.ip().is_loopback() {
        println!("note: everybody on this network may command it");
    }
    let limit = arguments.limit.map(Duration::from_secs_f64);
    let start = Instant::now();
    let mut last = start;
    let mut end = Ok(());
    while end.is_ok()
        && desk.check_stop().is_ok()
        && limit.is_none_or(|limit| start.elapsed() < limit)
    {
        std::thread::sleep(STEP);
        let now = Instant::now();
        let passed = (now - last).min(LONGEST_STEP);
        last = now;
        end = shared.with(|feeder| {
            feeder.advance(passed)?;
            let publisher = publisher.as_mut();
            publisher.map_or(Ok(()), |publisher| publisher.publish(feeder))
        });
    }
    shared.stop();
    let [requests, clients] = [&shared.requests, &shared.clients];
    let [requests, clients] = [requests, clients].map(|count| count.load(Ordering::Relaxed));
    println!("ended: {requests} requests of {clients} clients");
    end.map(|()| Exit::Done)
}
