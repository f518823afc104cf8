//! `kband recipe`: target and parts of seven kinds, kept by a board under numbers and names.

mod page;

use std::path::PathBuf;

use serde_json::json;

use kband_control::wire::{Request, Response, Stored};
use kband_control::{Recipe, RecipeName, Settings};

pub use self::page::{Entry, export};
use super::settings::check_flash;
use super::status::BoardStatus;
use super::target;
use crate::board::{Address, BoardSettings, Emulated, Link};
use crate::desk::Desk;
use crate::file::{self, Destination};
use crate::refusal::{Exit, Refusal};
use crate::report::{Format, Printout, Table, columns, shortest};
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

/// Carries out the action.
pub fn run(arguments: &Arguments, _desk: &Desk) -> Result<Exit, Refusal> {
    let address = &arguments.address;
    // Checks that need no board come first.
    let entries = match &arguments.action {
        Action::Import { file } => {
            let text = file::read_text(file)?;
            Entry::parse(&text).map_err(|refusal| refusal.at(file.display()))?
        }
        _ => Vec::new(),
    };
    let export = match &arguments.action {
        Action::Export { file } => Some(Destination::output(file, "toml")?),
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
    match &arguments.action {
        Action::List => list(&mut link, &[])?.print(arguments.format)?,
        Action::Save { number, name } => {
            let settings = BoardSettings::read(&mut link)?.known();
            let recipe = Recipe::of(link.held()?, &settings);
            save(&mut link, &[(*number, Some((*name, recipe)))])?;
            let note = format!("saved recipe {number}: {}", describe(recipe.target));
            list(&mut link, &[note])?.print(arguments.format)?;
        }
        Action::Use { number } => {
            link.tell(&Request::UseRecipe(*number))?;
            let target = describe(link.held()?);
            match stored(&mut link, *number)? {
                Stored::Recipe(name, _) => {
                    eprintln!("recipe {number} ({}) is in use: {target}", name.text());
                }
                _ => eprintln!("the saved target is in use: {target}"),
            }
            let status = BoardStatus::ask(&mut link)?;
            status.printout()?.print(arguments.format)?;
        }
        Action::Delete { number } => {
            if stored(&mut link, *number)? == Stored::None {
                return Err(Refusal::new(
                    format!("{} has no recipe {number}", link.name()),
                    "kband recipe list shows all",
                ));
            }
            save(&mut link, &[(*number, None)])?;
            list(&mut link, &[format!("deleted recipe {number}")])?.print(arguments.format)?;
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
                let note = format!("wrote {}", export.path().display());
                list(&mut link, &[note])?.print(arguments.format)?;
            }
        }
        Action::Import { file } => {
            let settings = BoardSettings::read(&mut link)?.known();
            for entry in &entries {
                check(entry, &settings).map_err(|refusal| refusal.at(file.display()))?;
            }
            let wanted: Vec<_> = entries
                .iter()
                .map(|entry| (entry.number, Some((entry.name, entry.recipe))))
                .collect();
            save(&mut link, &wanted)?;
            let note = format!("saved {} recipes", wanted.len());
            list(&mut link, &[note])?.print(arguments.format)?;
        }
    }
    Ok(Exit::Done)
}

/// Refused with its line if a recipe of a file does not fit the machine with these settings.
fn check(entry: &Entry, settings: &Settings) -> Result<(), Refusal> {
    let recipe = &entry.recipe;
    let settings = recipe.applied_to(settings).map_err(|refused| {
        let line = entry.line(refused.parameter);
        Refusal::from(refused).at(format!("line {line}"))
    })?;
    let checked = target::check(recipe.target, &settings);
    checked.map_err(|refusal| refusal.at(format!("line {}", entry.line("target"))))?;
    Ok(())
}

pub(super) fn stored(link: &mut Link, number: u8) -> Result<Stored, Refusal> {
    link.ask(&Request::Recipe(number), |response| match response {
        Response::Recipe(stored) => Ok(stored),
        other => Err(Refusal::new(
            format!("the board answered the request for a recipe with {other:?}"),
            "reset the board",
        )),
    })?
}

/// A number, and its recipe or none.
type Change = (u8, Option<(RecipeName, Recipe)>);

/// Changes the recipes of a board and saves them: all of them, or none if one is refused.
fn save(link: &mut Link, wanted: &[Change]) -> Result<(), Refusal> {
    let mut before: Vec<Change> = Vec::new();
    for (number, _) in wanted {
        before.push(match stored(link, *number)? {
            Stored::None => (*number, None),
            Stored::Recipe(name, recipe) => (*number, Some((name, recipe))),
            Stored::Newer => {
                return Err(Refusal::new(
                    format!("recipe {number} of {} is a newer firmware's", link.name()),
                    "flash that firmware again, or take another number",
                ));
            }
        });
    }
    let set = |link: &mut Link, changes: &[Change]| {
        changes
            .iter()
            .try_for_each(|&(number, recipe)| link.tell(&Request::SetRecipe { number, recipe }))
    };
    let done = set(link, wanted).and_then(|()| link.tell(&Request::SaveRecipes));
    if done.is_err() {
        // A second refusal would repeat the first.
        let _ = set(link, &before);
    }
    done
}

fn list(link: &mut Link, notes: &[String]) -> Result<Printout, Refusal> {
    let in_use = BoardStatus::ask(link)?.recipe();
    let mut table = Table::new(&[
        columns::RECIPE,
        columns::NAME,
        columns::TARGET,
        columns::IN_USE,
    ]);
    let mut rows = Vec::new();
    for number in 1..=Recipe::COUNT {
        let (name, recipe) = match stored(link, number)? {
            Stored::None => continue,
            Stored::Recipe(name, recipe) => (name.text().to_string(), Some(recipe)),
            Stored::Newer => ("of a newer firmware".to_string(), None),
        };
        let target = recipe.map_or_else(String::new, |recipe| describe(recipe.target));
        let used = number == in_use;
        table.push([
            u32::from(number).into(),
            name.as_str().into(),
            target.as_str().into(),
            used.into(),
        ]);
        let values = recipe.map(|recipe| recipe.values).unwrap_or_default();
        let settings: Vec<_> = Recipe::KEYS
            .iter()
            .zip(values)
            .filter(|_| recipe.is_some())
            .map(|(key, value)| json!({"key": key, "value": shortest(value)}))
            .collect();
        rows.push(json!({"recipe": number, "name": name, "target": target, "in_use": used, "settings": settings}));
    }
    Printout::new(table).notes(notes).json(&rows)
}
