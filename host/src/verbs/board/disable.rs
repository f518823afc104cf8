//! `kband disable`: brings a drive to rest and keeps it there.

use std::time::{Duration, Instant};

use kband_control::State;
use kband_control::wire::Request;

use super::status::BoardStatus;
use crate::arguments::FormatArguments;
use crate::board::{Address, Emulated};
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal, Result};

/// Stop the drive of a board softly. It stays at rest until kband enable or the board's next reset.
///
/// This is no emergency stop: cut the power for that.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband disable
  kband disable --on /dev/ttyACM0")]
pub struct Arguments {
    #[command(flatten)]
    address: Address,
    #[command(flatten)]
    printed: FormatArguments,
}

/// Longest wait for rest: longer than the slowest soft stop.
const REST_TIMEOUT: Duration = Duration::from_secs(30);

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let mut link = arguments.address.open(Emulated::Running)?;
    link.command(&Request::Enable(false))?;
    let end = Instant::now() + REST_TIMEOUT;
    loop {
        let status = BoardStatus::request(&mut link)?;
        if matches!(status.state(), Some(State::Off | State::Fault)) {
            status.printout().print(arguments.printed.format)?;
            return Ok(Exit::Done);
        }
        if Instant::now() > end || desk.check_stop().is_err() {
            let cause = "the enable is withdrawn, but the drive has not come to rest yet";
            let next = "withdraw the enable input, or cut the power; kband status shows its state";
            return Err(Refusal::new(cause, next));
        }
    }
}
