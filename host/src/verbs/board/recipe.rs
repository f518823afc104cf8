//! `kband recipe`: up to seven recipes on a board, each a target and the settings of its parts.

mod page;

use std::path::PathBuf;

use serde_json::json;

use kband_control::wire::{Request, Response, Stored};
use kband_control::{Recipe, RecipeName, Settings};
use kband_scene::at_line;

pub use self::page::{Entry, export};
use super::settings::check_flash;
use super::status::{self, BoardStatus};
use super::target;
use crate::board::{Address, BoardSettings, Emulated, Link};
use crate::desk::Desk;
use crate::file::{self, Destination};
use crate::refusal::{Exit, Refusal, Result};
use crate::report::columns::{IN_USE, NAME, RECIPE, TARGET};
use crate::report::{Format, Printout, Table, shortest};
use crate::simulate::describe;

/// List, save, use, delete, export and import the recipes of a board.
///
/// A recipe has a number from 1 to 7 and a name. It holds the target, and the settings of the
/// parts: restitution, scatter, length, contact time, soft start and soft stop. It holds no
/// settings of the machine. Saving and deleting need the drive at rest; using a recipe does not.
///
/// The inputs PC6, PC7 and PC8 of the board also select a recipe: wired to ground they count 1, 2
/// and 4. With all of them open the saved target is in use.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband recipe list
  kband recipe save 1 'M3 screws' --on /dev/ttyACM0
  kband recipe use 1 --on /dev/ttyACM0
  kband recipe export recipes.toml --on qemu --flash-image board.flash
  kband recipe import recipes.toml")]
pub struct Arguments {
    #[command(subcommand)]
    action: Action,
    #[command(flatten)]
    address: Address,
    /// Form of the result on standard output.
    #[arg(long, value_enum, default_value_t = Format::Table, global = true)]
    format: Format,
}

/// What is done with the recipes.
#[derive(Clone, Debug, clap::Subcommand)]
enum Action {
    /// Print all recipes, and the one in use.
    #[command(after_help = "Example:\n  kband recipe list --format json")]
    List,
    /// Save the present target and settings of the parts as a recipe.
    #[command(after_help = "Example:\n  kband recipe save 1 'M3 screws'")]
    Save {
        /// Number of the recipe.
        #[arg(value_parser = number())]
        number: u8,
        /// Name of the recipe, 1 to 14 printable characters of ASCII.
        #[arg(value_parser = name)]
        name: RecipeName,
    },
    /// Use a recipe until another target is set; 0: the saved target with its parts.
    #[command(after_help = "Example:\n  kband recipe use 1")]
    Use {
        /// Number of the recipe.
        #[arg(value_parser = clap::value_parser!(u8).range(0..=i64::from(Recipe::COUNT)))]
        number: u8,
    },
    /// Delete a recipe.
    #[command(after_help = "Example:\n  kband recipe delete 1")]
    Delete {
        /// Number of the recipe.
        #[arg(value_parser = number())]
        number: u8,
    },
    /// Write all recipes to a text file, which can be edited and imported.
    #[command(after_help = "Example:\n  kband recipe export recipes.toml")]
    Export {
        /// The file; `-` for standard output.
        #[arg(value_name = "FILE.toml")]
        file: PathBuf,
    },
    /// Save the recipes of a file: all of them, or none if one is refused.
    ///
    /// Recipes whose numbers the file does not name stay.
    #[command(after_help = "Example:\n  kband recipe import recipes.toml")]
    Import {
        /// A file as export writes it; `-` for standard input.
        #[arg(value_name = "FILE.toml")]
        file: PathBuf,
    },
}

fn number() -> clap::builder::RangedI64ValueParser<u8> {
    clap::value_parser!(u8).range(1..=i64::from(Recipe::COUNT))
}

fn name(text: &str) -> Result<RecipeName, String> {
    RecipeName::parse(text).ok_or_else(|| format!("accepted: {}", RecipeName::ACCEPTED))
}

pub(crate) fn run(arguments: &Arguments, _desk: &Desk) -> Result<Exit> {
    let address = &arguments.address;
    // Checks that need no board come first.
    let mut text = String::new();
    let mut entries = Vec::new();
    if let Action::Import { file } = &arguments.action {
        text = file::read_text(file)?;
        entries = Entry::parse(&text).map_err(|refusal| refusal.at(file.display()))?;
    }
    let export = match &arguments.action {
        Action::Export { file } => Some(Destination::output(file, "toml")?.durable()),
        _ => None,
    };
    let saves = matches!(
        arguments.action,
        Action::Save { .. } | Action::Delete { .. } | Action::Import { .. }
    );
    if saves {
        check_flash(address, "recipes")?;
    }
    let state = match arguments.action {
        Action::Use { .. } => Emulated::Running,
        _ => Emulated::AtRest,
    };
    let mut link = address.open(state)?;
    let note = match &arguments.action {
        Action::List => None,
        Action::Save { number, name } => {
            let settings = BoardSettings::read(&mut link)?.configured();
            let recipe = Recipe::of(link.target()?, &settings);
            save(&mut link, &[(*number, Some((*name, recipe)))])?;
            let target = describe(recipe.target);
            Some(format!("saved recipe {number}: {target}"))
        }
        Action::Use { number } => {
            link.command(&Request::UseRecipe(*number))?;
            let target = describe(link.target()?);
            match stored(&mut link, *number)? {
                Stored::Recipe(name, _) => {
                    eprintln!("recipe {number} ({}) is in use: {target}", name.text());
                }
                _ => eprintln!("the saved target is in use: {target}"),
            }
            return status::show(&mut link, arguments.format);
        }
        Action::Delete { number } => {
            if stored(&mut link, *number)? == Stored::None {
                let cause = format!("{} has no recipe {number}", link.name());
                return Err(Refusal::new(cause, "kband recipe list shows all"));
            }
            save(&mut link, &[(*number, None)])?;
            Some(format!("deleted recipe {number}"))
        }
        Action::Export { .. } => {
            let mut entries = Vec::new();
            for number in 1..=Recipe::COUNT {
                match stored(&mut link, number)? {
                    Stored::None => {}
                    Stored::Recipe(name, recipe) => entries.push((number, name, recipe)),
                    Stored::Newer => {
                        eprintln!("note: recipe {number} is of a newer firmware and is left out")
                    }
                }
            }
            let text = page::export(&entries, link.image());
            if let Some(export) = &export {
                export.write_bytes(text.as_bytes())?;
            }
            export.map(|export| format!("wrote {}", export.path().display()))
        }
        Action::Import { file } => {
            let settings = BoardSettings::read(&mut link)?.configured();
            for entry in &entries {
                let refused = |refusal| at_line(refusal, &text).at(file.display());
                check(entry, &settings).map_err(refused)?;
            }
            let change = |entry: &Entry| (entry.number, Some((entry.name, entry.recipe)));
            let requested: Vec<_> = entries.iter().map(change).collect();
            save(&mut link, &requested)?;
            Some(format!("saved {} recipes", requested.len()))
        }
    };
    list(&mut link, note)?.print(arguments.format)?;
    Ok(Exit::Done)
}

/// Refuses a recipe that does not fit the machine with these settings; the refusal has its key.
fn check(entry: &Entry, settings: &Settings) -> Result<()> {
    let recipe = &entry.recipe;
    let settings = recipe
        .applied_to(settings)
        .map_err(|refused| entry.at(refused.parameter, refused.into()))?;
    let checked = target::check(recipe.target, &settings).map(|_| ());
    checked.map_err(|refusal| entry.at("target", refusal))
}

pub(super) fn stored(link: &mut Link, number: u8) -> Result<Stored> {
    link.request(&Request::Recipe(number), |response| match response {
        Response::Recipe(stored) => Ok(stored),
        other => Err(Refusal::new(
            format!("the board answered the request for a recipe with {other:?}"),
            "reset the board",
        )),
    })?
}

/// Number of a recipe, and its content; `None` deletes it.
type Change = (u8, Option<(RecipeName, Recipe)>);

/// Changes the recipes of a board and saves them: all, or none if one is refused.
fn save(link: &mut Link, requested: &[Change]) -> Result<()> {
    let mut before: Vec<Change> = Vec::new();
    for &(number, _) in requested {
        let recipe = match stored(link, number)? {
            Stored::None => None,
            Stored::Recipe(name, recipe) => Some((name, recipe)),
            Stored::Newer => {
                let cause = format!("recipe {number} of {} is a newer firmware's", link.name());
                let next = "flash that firmware again, or take another number";
                return Err(Refusal::new(cause, next));
            }
        };
        before.push((number, recipe));
    }
    let set = |link: &mut Link, changes: &[Change]| {
        let mut changes = changes.iter();
        changes
            .try_for_each(|&(number, recipe)| link.command(&Request::SetRecipe { number, recipe }))
    };
    let done = set(link, requested).and_then(|()| link.command(&Request::SaveRecipes));
    if done.is_err() {
        // A second refusal would repeat the first.
        let _ = set(link, &before);
    }
    done
}

fn list(link: &mut Link, note: Option<String>) -> Result<Printout> {
    let in_use = BoardStatus::request(link)?.recipe();
    let mut table = Table::new(&[RECIPE, NAME, TARGET, IN_USE]);
    let mut rows = Vec::new();
    for number in 1..=Recipe::COUNT {
        let (name, recipe) = match stored(link, number)? {
            Stored::None => continue,
            Stored::Recipe(name, recipe) => (name.text().to_string(), Some(recipe)),
            Stored::Newer => ("of a newer firmware".to_string(), None),
        };
        let target = recipe.as_ref().map(|recipe| describe(recipe.target));
        let target = target.unwrap_or_default();
        let used = number == in_use;
        let values = recipe.as_ref().map_or(&[][..], |recipe| &recipe.values);
        let settings = Recipe::KEYS.iter().zip(values);
        let settings = settings.map(|(key, value)| json!({"key": key, "value": shortest(*value)}));
        let settings: Vec<_> = settings.collect();
        rows.push(json!({"recipe": number, "name": name, "target": target, "in_use": used, "settings": settings}));
        let number = u32::from(number).into();
        table.push([number, name.into(), target.into(), used.into()]);
    }
    Ok(Printout::new(table).notes(note).json(rows))
}
