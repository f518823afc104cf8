//! `kband disable`: brings a drive to rest, and keeps it there.

use std::time::{Duration, Instant};

use kband_control::State;
use kband_control::wire::Request;

use super::status::BoardStatus;
use crate::arguments::Printed;
use crate::board::{Address, Emulated};
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};

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
    printed: Printed,
}

/// Longest wait for rest: the slowest soft stop and then some.
const REST_TIMEOUT: Duration = Duration::from_secs(30);

/// Withdraws the enable and waits for rest.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let mut link = arguments.address.open(Emulated::Running)?;
    link.tell(&Request::Enable(false))?;
    let end = Instant::now() + REST_TIMEOUT;
    loop {
        let status = BoardStatus::ask(&mut link)?;
        if matches!(status.state(), Some(State::Off | State::Fault)) {
            status.printout()?.print(arguments.printed.format)?;
            return Ok(Exit::Done);
        }
        if Instant::now() > end || desk.go_on().is_err() {
            return Err(Refusal::new(
                "the enable is withdrawn, but the drive has not come to rest yet",
                "withdraw the enable input, or cut the power; kband status shows its state",
            ));
        }
    }
}
