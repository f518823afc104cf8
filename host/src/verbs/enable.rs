//! `kband enable`: gives a drive back the enable that the desk withdrew.

use super::status::BoardStatus;
use crate::arguments::Printed;
use crate::board::{Address, Emulated};
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};
use kband_control::wire::Request;

/// Give the drive of a board back the enable that the desk withdrew; the enable input has to be
/// given too.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband enable
  kband enable --on /dev/ttyACM0

The desk can never start a machine whose enable input is not given, and a drive starts by an edge of the enable alone: \
after power-on, and after a fault, the input itself has to be withdrawn and given.")]
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
