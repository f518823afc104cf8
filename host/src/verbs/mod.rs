//! The command line: one file per verb, those of the map in `map`, those of a board in `board`. A
//! verb is a module with `Arguments` (the doc comment is the help, `after_help` the example) and
//! `run(arguments, desk) -> Result<Exit>`. A line in the list below names it.

mod bench;
pub mod board;
mod design;
mod explain;
mod idle;
pub mod map;
mod registers;
mod report;
mod simulate;

use std::error::Error as _;
use std::process::ExitCode;
use std::sync::LazyLock;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, FromArgMatches, Parser};
use kband_control::wire::{SCHEMA, VERSION};

use crate::desk::Desk;
use crate::refusal::{Exit, Refusal, Result};
use crate::report::when;
use crate::{arguments, file, provenance};

macro_rules! verbs {
    ($($verb:ident => $($module:ident)::+,)*) => {
        #[derive(Debug, clap::Subcommand)]
        enum Verb {
            $($verb($($module)::+::Arguments),)*
        }

        impl Verb {
            fn run(&self, desk: &Desk) -> Result<Exit> {
                match self {
                    $(Self::$verb(arguments) => $($module)::+::run(arguments, desk),)*
                }
            }
        }
    };
}

verbs! {
    Bands => map::bands,
    Basins => map::basins,
    Bench => bench,
    Capture => map::capture,
    Cascade => map::cascade,
    Commission => board::commission,
    Design => design,
    Diagram => map::diagram,
    Disable => board::disable,
    Enable => board::enable,
    Explain => explain,
    Exponent => map::exponent,
    Flash => board::flash,
    Gear => map::gear,
    Identify => board::identify,
    Impacts => map::impacts,
    Lock => board::lock,
    Margins => map::margins,
    Monitor => board::monitor,
    Paper => map::paper,
    Recipe => board::recipe,
    Registers => registers,
    Report => report,
    Serve => board::serve,
    Settings => board::settings,
    Simulate => simulate,
    Status => board::status,
    Target => board::target,
    Transport => map::transport,
    Unlock => board::unlock,
    Update => board::update,
}

/// Simulate and operate vibratory feeders: parts on a vibrating track, and the drive that keeps
/// them in step.
#[derive(Debug, Parser)]
#[command(
    name = "kband",
    version = version(),
    subcommand_required = false,
    after_help = "Start here:
  kband                                    simulate the built-in feeder: mm, g, mm/s, parts a minute
  kband explain restitution                how to measure it: drop a part
  kband simulate --print-scene > my.toml   write the built-in feeder to a file, for your changes
  kband simulate my.toml                   simulate your feeder
  kband bands --restitution 0.2 --frequency 50   the amplitudes in mm at which parts lock
Each verb has examples: kband help VERB

Files: an output that you name overwrites an older file. An output with a default name, as the \
picture of kband simulate, overwrites only a file that kband wrote. An input is never overwritten. \
`-` as scene, rows or settings is standard input. `-` as output is standard output; messages then go \
to standard error."
)]
struct CommandLine {
    /// Number of threads; the result does not depend on it [default: number of cores].
    #[arg(long, global = true, display_order = 1000, value_name = "N",
          value_parser = arguments::count(1, 1024))]
    threads: Option<usize>,
    #[command(subcommand)]
    verb: Option<Verb>,
}

fn version() -> &'static str {
    static WORDS: LazyLock<String> = LazyLock::new(|| {
        let version = env!("CARGO_PKG_VERSION");
        format!("{version} (link version {VERSION}, schema {SCHEMA:08x})")
    });
    &WORDS
}

fn command() -> clap::Command {
    // A phase or an incline may be negative, in every verb.
    CommandLine::command().mut_subcommands(|verb| verb.allow_negative_numbers(true))
}

/// Runs `kband` on the arguments of the process; the binary's `main`.
pub fn main() -> ExitCode {
    let mut whole = command();
    let matches = whole.try_get_matches_from_mut(std::env::args_os());
    let line = matches.and_then(|matches| Ok((CommandLine::from_arg_matches(&matches)?, matches)));
    let (line, matches) = match line {
        Ok(parsed) => parsed,
        Err(message) => {
            // Help and version have status 0, a bad option 2. A failure to print has no remedy.
            match refused(&message) {
                Some(refusal) => eprintln!("{refusal}"),
                None => {
                    let _ = message.print();
                }
            }
            return ExitCode::from(message.exit_code() as u8);
        }
    };
    let (verb, given) = match matches.subcommand() {
        Some((name, given)) => (whole.find_subcommand(name), given),
        None => (None, &matches),
    };
    provenance::begin(std::env::args_os(), verb.unwrap_or(&whole), given);
    let checked = verb.map_or(Ok(()), |verb| idle::check(verb.get_name(), given));
    match checked.and_then(|()| run(&line)) {
        Ok(Exit::Done) => ExitCode::SUCCESS,
        Ok(Exit::CheckFailed) => ExitCode::from(1),
        Err(_) if file::is_reader_closed() => ExitCode::SUCCESS,
        Err(refusal) => {
            eprintln!("{refusal}");
            ExitCode::from(refusal.status())
        }
    }
}

/// An error of clap in the form of every refusal; `None` for help and version.
fn refused(message: &clap::Error) -> Option<Refusal> {
    let context = |kind| match message.get(kind) {
        Some(ContextValue::String(word)) if !word.is_empty() => vec![word.as_str()],
        Some(ContextValue::Strings(context)) => context.iter().map(String::as_str).collect(),
        _ => Vec::new(),
    };
    let closest = |kind, otherwise: &str| match context(kind).last() {
        // The last suggestion of clap is the most similar.
        Some(closest) => format!("did you mean {closest}? {otherwise}"),
        None => otherwise.into(),
    };
    if message.kind() == ErrorKind::InvalidSubcommand {
        let given = context(ContextKind::InvalidSubcommand).concat();
        let next = closest(ContextKind::SuggestedSubcommand, "kband --help lists all");
        return Some(Refusal::new(format!("there is no verb '{given}'"), next));
    }
    if message.kind() == ErrorKind::MissingSubcommand {
        let verb = context(ContextKind::InvalidSubcommand).concat();
        let actions = context(ContextKind::ValidSubcommand).join("|");
        let (cause, next) = ("alone does nothing", "--help shows more");
        let refusal = Refusal::new(format!("{verb} {cause}"), format!("{verb} {next}"));
        return Some(refusal.accepting(format!("{verb} {actions}")));
    }
    let all = context(ContextKind::InvalidArg);
    let option = *all.first()?;
    let key = option.split(' ').next().unwrap_or(option);
    let value = context(ContextKind::InvalidValue).concat();
    match message.kind() {
        ErrorKind::MissingRequiredArgument => {
            let are = if all.len() == 1 { "is" } else { "are" };
            let otherwise = || "; in place of --k, --b takes the amplitude in mm";
            let amplitude = when(all.contains(&"--k <K>"), otherwise);
            let cause = format!("{} {are} missing", all.join(" and "));
            let next = format!("--help describes it, with an example{amplitude}");
            Some(Refusal::new(cause, next))
        }
        ErrorKind::ArgumentConflict => {
            let others = context(ContextKind::PriorArg).join(", ");
            let cause = format!("{option} and {others} exclude each other");
            Some(Refusal::new(cause, "leave one of them out"))
        }
        ErrorKind::UnknownArgument => {
            let cause = format!("there is no option or operand '{option}' here");
            let otherwise = "--help lists the options of this verb";
            let next = closest(ContextKind::SuggestedArg, otherwise);
            Some(Refusal::new(cause, next))
        }
        ErrorKind::InvalidValue | ErrorKind::ValueValidation => {
            let accepted = match message.get(ContextKind::ValidValue) {
                Some(ContextValue::Strings(names)) => names.join(", "),
                _ => message.source().map_or(String::new(), ToString::to_string),
            };
            if value.is_empty() {
                let takes = when(!accepted.is_empty(), || format!(": {accepted}"));
                let cause = format!("{option} needs a value{takes}");
                return Some(Refusal::new(cause, "see --help"));
            }
            let accepted = accepted.trim_start_matches("accepted: ");
            let next = format!("change {key} and run again; see --help");
            Some(Refusal::value(key, value, accepted, next))
        }
        _ => None,
    }
}

/// The arguments of a verb in a text, for a page with results of several verbs.
fn read<A: clap::Args>(options: &str) -> Result<A> {
    let command = A::augment_args(clap::Command::new("kband").no_binary_name(true));
    let matches = command.try_get_matches_from(options.split_whitespace());
    let arguments = matches.and_then(|matches| A::from_arg_matches(&matches));
    arguments.map_err(|error| Refusal::new(error.to_string(), "see kband --help"))
}

fn run(line: &CommandLine) -> Result<Exit> {
    let desk = Desk::new(line.threads);
    desk.listen_for_interruption();
    match &line.verb {
        Some(verb) => verb.run(&desk),
        None => simulate::run(&simulate::Arguments::default(), &desk),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent_with_a_help_line_and_an_example_for_each_verb() {
        command().debug_assert();
        for verb in command().get_subcommands() {
            let name = verb.get_name();
            assert!(verb.get_about().is_some(), "{name} has no help");
            let help = verb.get_after_help().map(ToString::to_string);
            let example = format!("kband {name}");
            assert!(help.is_some_and(|help| help.contains(&example)), "{name}");
        }
    }
}
