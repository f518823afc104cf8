//! `kband unlock`: permits changes of a board that is locked by a PIN.

use kband_control::wire::{Pin, Request};

use crate::arguments::pin;
use crate::board::{Address, Emulated};
use crate::desk::Desk;
use crate::refusal::{Exit, Result};

/// Unlock a board with its PIN. The desk may change the board until its next start or kband lock.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband unlock 4711
  kband unlock 4711 --on /dev/ttyACM0

After five wrong PINs the board waits for a minute.")]
pub struct Arguments {
    #[command(flatten)]
    address: Address,
    /// PIN, 4 to 8 digits.
    #[arg(value_parser = pin)]
    pin: Pin,
}

pub fn run(arguments: &Arguments, _desk: &Desk) -> Result<Exit> {
    let mut link = arguments.address.open(Emulated::Running)?;
    link.command(&Request::Unlock(arguments.pin))?;
    let name = link.name();
    println!("{name}: the desk may change it until its next start");
    Ok(Exit::Done)
}
