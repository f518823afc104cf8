//! `kband man`: manual pages.

use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};
use crate::report;

/// Print the manual page of kband, or of one of its verbs.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband man > ~/.local/share/man/man1/kband.1
  kband man bands | man -l -")]
pub struct Arguments {
    /// The verb; without one, kband itself.
    verb: Option<String>,
}

/// Prints the page.
pub fn run(arguments: &Arguments, _desk: &Desk) -> Result<Exit, Refusal> {
    let mut command = super::command();
    command.build();
    let page = match &arguments.verb {
        None => command,
        Some(name) => {
            let names = command.get_subcommands();
            let names: Vec<&str> = names.map(|verb| verb.get_name()).collect();
            let known = names.join(", ");
            let Some(verb) = command.find_subcommand(name) else {
                return Err(Refusal::value(
                    "VERB",
                    name,
                    known,
                    "kband --help describes each verb",
                ));
            };
            verb.clone()
        }
    };
    let mut text = Vec::new();
    clap_mangen::Man::new(page)
        .render(&mut text)
        .map_err(|error| {
            Refusal::new(
                format!("the manual page: {error}"),
                "report this bug to the makers of kband",
            )
        })?;
    report::print(&String::from_utf8_lossy(&text))?;
    Ok(Exit::Done)
}
