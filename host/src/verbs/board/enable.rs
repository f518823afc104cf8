//! `kband enable`: ends the stop by `kband disable`.

use super::status;
use crate::arguments::FormatArguments;
use crate::board::{Address, Emulated};
use crate::desk::Desk;
use crate::refusal::{Exit, Result};
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
    printed: FormatArguments,
}

pub fn run(arguments: &Arguments, _desk: &Desk) -> Result<Exit> {
    let mut link = arguments.address.open(Emulated::Running)?;
    link.command(&Request::Enable(true))?;
    status::show(&mut link, arguments.printed.format)
}
