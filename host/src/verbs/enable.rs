//! `kband enable`: gives a drive back the enable that the desk withdrew.

use super::status::BoardStatus;
use crate::arguments::Printed;
use crate::board::{Address, Emulated};
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};
use kband_control::wire::Request;

/// End the stop by kband disable. The drive runs again if the board's enable input is on.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband enable
  kband enable --on /dev/ttyACM0

The desk cannot start a machine whose enable input is off. A drive starts at the rising edge of \
the enable only: after power-on or a fault, switch the input off and on.")]
pub struct Arguments {
    #[command(flatten)]
    address: Address,

    #[command(flatten)]
    printed: Printed,
}

/// Gives it and says what came of it.
pub fn run(arguments: &Arguments, _desk: &Desk) -> Result<Exit, Refusal> {
    let mut link = arguments.address.open(Emulated::Running)?;
    link.tell(&Request::Enable(true))?;
    let status = BoardStatus::ask(&mut link)?;
    status.printout()?.print(arguments.printed.format)?;
    Ok(Exit::Done)
}
