//! `kband lock`: makes a board's link read-only behind a PIN.

use kband_control::wire::{Pin, Request};

use crate::arguments::pin;
use crate::board::{Address, Emulated};
use crate::desk::Desk;
use crate::refusal::{Exit, Result};

/// Save the settings of a board with a PIN. Then its link is read-only without that PIN.
///
/// Stopping the drive stays possible. To remove a forgotten PIN, erase the settings with a debug
/// probe.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband lock 4711
  kband lock --none
  kband lock 4711 --on /dev/ttyACM0

The drive must be at rest. Each start of the board locks the link; kband unlock unlocks it.")]
pub struct Arguments {
    #[command(flatten)]
    address: Address,
    /// PIN, 4 to 8 digits.
    #[arg(value_parser = pin, required_unless_present = "none")]
    pin: Option<Pin>,
    /// Remove the PIN.
    #[arg(long, conflicts_with = "pin")]
    none: bool,
}

pub fn run(arguments: &Arguments, _desk: &Desk) -> Result<Exit> {
    let mut link = arguments.address.open(Emulated::Running)?;
    link.command(&Request::Lock(arguments.pin))?;
    let name = link.name();
    match arguments.pin {
        Some(_) => println!("{name} is locked: kband unlock PIN lets the desk change it"),
        None => println!("{name} has no PIN: the desk may change it"),
    }
    Ok(Exit::Done)
}
