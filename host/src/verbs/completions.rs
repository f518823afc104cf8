//! `kband completions`: shell completions.

use clap_complete::Shell;

use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};
use crate::report;

/// Print the completion script for a shell.
#[derive(Clone, Debug, clap::Args)]
#[command(
    after_help = "Example:\n  kband completions bash > ~/.local/share/bash-completion/completions/kband"
)]
pub struct Arguments {
    /// The shell.
    #[arg(value_enum)]
    shell: Shell,
}

/// Prints the script.
pub fn run(arguments: &Arguments, _desk: &Desk) -> Result<Exit, Refusal> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut super::command(), "kband", &mut script);
    report::print(&String::from_utf8_lossy(&script))?;
    Ok(Exit::Done)
}
