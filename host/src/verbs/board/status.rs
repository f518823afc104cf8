//! `kband status`: present state of a board.

mod board_status;

use std::io::{IsTerminal, Write, stdout};
use std::time::Duration;

use crate::arguments::FormatArguments;
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
    printed: FormatArguments,
}

const POLL_INTERVAL: Duration = Duration::from_millis(500);

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let mut link = arguments.address.open(Emulated::Running)?;
    let mut cache = CauseCache::default();
    let on_screen =
        arguments.live && arguments.printed.format == Format::Table && stdout().is_terminal();
    loop {
        let status = BoardStatus::request(&mut link)?.with_causes(&mut link, &mut cache)?;
        if on_screen {
            // Moves the cursor to the upper left and clears the screen. The next line reports a
            // closed terminal.
            let _ = write!(stdout(), "\x1b[H\x1b[J");
            report::print(&status.screen())?;
        } else {
            status.printout()?.print(arguments.printed.format)?;
        }
        if !arguments.live || desk.check_stop().is_err() {
            return Ok(Exit::Done);
        }
        std::thread::sleep(POLL_INTERVAL);
        if desk.check_stop().is_err() {
            return Ok(Exit::Done);
        }
    }
}
