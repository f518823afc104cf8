//! `kband status`: how a board is just now.

mod board_status;

use std::io::{IsTerminal, Write, stdout};
use std::time::Duration;

use crate::arguments::Printed;
use crate::board::{Address, Emulated};
use crate::causes::CauseCache;
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};
use crate::report::{self, Format};
pub(super) use board_status::BoardStatus;

/// Print the present state of a board: inputs, readings, amplitude, margins, faults, and the next
/// step.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband status
  kband status --on /dev/ttyACM0 --live
  kband status --on qemu --format json")]
pub struct Arguments {
    #[command(flatten)]
    address: Address,

    /// Repeat twice a second, until Ctrl-C.
    #[arg(long)]
    live: bool,

    #[command(flatten)]
    printed: Printed,
}

const POLL_INTERVAL: Duration = Duration::from_millis(500);

/// Asks and prints.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let mut link = arguments.address.open(Emulated::Running)?;
    let mut cache = CauseCache::default();
    let on_screen =
        arguments.live && arguments.printed.format == Format::Table && stdout().is_terminal();
    loop {
        let status = BoardStatus::ask(&mut link)?.with_causes(&mut link, &mut cache)?;
        if on_screen {
            // To the upper left, and what was there is gone; a terminal that is closed is noticed
            // by the next line.
            let _ = write!(stdout(), "\x1b[H\x1b[J");
            report::print(&status.screen())?;
        } else {
            status.printout()?.print(arguments.printed.format)?;
        }
        if !arguments.live || desk.go_on().is_err() {
            return Ok(Exit::Done);
        }
        std::thread::sleep(POLL_INTERVAL);
        if desk.go_on().is_err() {
            return Ok(Exit::Done);
        }
    }
}
