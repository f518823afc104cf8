//! `kband settings`: the settings of a board.

mod commission;
mod offer;
mod sensor;
mod upper_tone;

use std::path::{Path, PathBuf};
use std::time::Duration;

use kband_control::wire::Request;
use kband_scene::{toml_number, toml_table};

use self::offer::Commissioning;
use crate::arguments;
use crate::board::{Address, BoardSetting, BoardSettings, Emulated, Link};
use crate::desk::Desk;
use crate::file::{self, Destination};
use crate::refusal::{Exit, Refusal, Result};
use crate::report::{Format, fields, shortest};

/// List, change, save, export and import the settings of a board.
///
/// The board checks every value; a refused value changes nothing. A changed setting is in use at
/// once, until the board's next reset. A saved one stays. Both need the drive at rest.
///
/// --on qemu is a board that starts with each command. It keeps saved settings in the file that
/// --flash-image names.
#[derive(Clone, Debug, clap::Args)]
#[command(
    arg_required_else_help = false,
    after_help = "Examples:
  kband settings list
  kband settings set restitution_low 0.25 --on /dev/ttyACM0
  kband settings save --on /dev/ttyACM0
  kband settings set restitution_high 0.3 --save --on qemu --flash-image board.flash
  kband settings export mine.toml --on qemu --flash-image board.flash
  kband settings import mine.toml --save"
)]
pub struct Arguments {
    #[command(subcommand)]
    action: Action,
    #[command(flatten)]
    address: Address,
    /// Form of the result on standard output.
    #[arg(long, value_enum, default_value_t = Format::Table, global = true)]
    format: Format,
}

/// What is done with the settings.
#[derive(Clone, Debug, clap::Subcommand)]
enum Action {
    /// Print all settings with unit, accepted range and default.
    #[command(after_help = "Example:\n  kband settings list --format csv")]
    List,
    /// Print one setting.
    #[command(after_help = "Example:\n  kband settings get frequency")]
    Get {
        /// Key of the setting.
        key: String,
    },
    /// Change one setting until the board's next reset.
    #[command(after_help = "Example:\n  kband settings set incline -2.5")]
    Set {
        /// Key of the setting.
        key: String,
        /// New value in the unit of the setting.
        #[arg(allow_negative_numbers = true, value_parser = arguments::number)]
        value: f64,
        /// Also save all present settings, beyond a loss of power.
        #[arg(long)]
        save: bool,
    },
    /// Save the present settings, beyond a loss of power.
    #[command(after_help = "Example:\n  kband settings save")]
    Save,
    /// Write all settings to a text file, which can be edited and imported.
    #[command(after_help = "Example:\n  kband settings export mine.toml")]
    Export {
        /// The file; `-` for standard output.
        #[arg(value_name = "FILE.toml")]
        file: PathBuf,
    },
    /// Set the settings of a file: all of them, or none if one is refused.
    ///
    /// Settings that the file does not name keep their values.
    #[command(after_help = "Example:\n  kband settings import mine.toml --save")]
    Import {
        /// A file as export writes it; `-` for standard input.
        #[arg(value_name = "FILE.toml")]
        file: PathBuf,
        /// Also save them, beyond a loss of power.
        #[arg(long)]
        save: bool,
    },
    /// Estimate the restitution of the parts on a board, and print the proposed interval.
    ///
    /// It needs parts of one kind on the track, and the enable input on. The board lets the parts
    /// chatter and estimates their restitution; this takes about a minute. It changes nothing
    /// without --apply.
    #[command(
        after_help = "Examples:\n  kband settings commission --on /dev/ttyACM0\n  kband settings commission --sensor --on /dev/ttyACM0\n  kband settings commission --second-tone --on /dev/ttyACM0"
    )]
    Commission {
        /// Set and save the proposed values; the drive is stopped for it.
        #[arg(long)]
        apply: bool,
        /// Measure the accelerometer at rest and at the present target instead, and propose
        /// sensor_rest, gain, their tolerances and, with a current sensor, current_gain.
        #[arg(long, conflicts_with_all = ["second_tone", "third_tone"])]
        sensor: bool,
        /// Measure the track's response at twice the drive's frequency instead, and propose
        /// second_gain and second_lag.
        #[arg(long)]
        second_tone: bool,
        /// Measure the response at three times the drive's frequency: third_gain and third_lag.
        #[arg(long, conflicts_with = "second_tone")]
        third_tone: bool,
        /// Time limit in s.
        #[arg(long, value_name = "S", default_value = "300", value_parser = arguments::within(1.0, 86_400.0, "s"))]
        within: f64,
    },
}

pub(crate) fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let address = &arguments.address;
    // Checks that need no board come first.
    let text = match &arguments.action {
        Action::Import { file, .. } => Some(Imported::read(file)?),
        _ => None,
    };
    let target = match &arguments.action {
        Action::Export { file } => Some(Destination::output(file, "toml")?.durable()),
        _ => None,
    };
    let saves = matches!(
        arguments.action,
        Action::Save
            | Action::Set { save: true, .. }
            | Action::Import { save: true, .. }
            | Action::Commission { apply: true, .. }
    );
    if saves {
        check_flash(address, "settings")?;
    }
    if let Action::Commission {
        apply,
        sensor,
        second_tone,
        third_tone,
        within,
    } = arguments.action
    {
        let commissioning = Commissioning {
            address,
            apply,
            within: Duration::from_secs_f64(within),
            format: arguments.format,
            desk,
        };
        if second_tone || third_tone {
            upper_tone::run(usize::from(third_tone), &commissioning)?;
        } else if sensor {
            sensor::run(&commissioning)?;
        } else {
            commission::run(&commissioning)?;
        }
        return Ok(Exit::Done);
    }
    let mut link = address.open(Emulated::AtRest)?;
    let mut settings = BoardSettings::read(&mut link)?;
    let (rows, notes): (Vec<&BoardSetting>, Vec<String>) = match &arguments.action {
        Action::List => (settings.iter().collect(), vec![]),
        Action::Get { key } => {
            let setting = settings.get(key)?;
            (vec![setting], vec![setting.meaning().to_string()])
        }
        Action::Set { key, value, save } => {
            let setting = settings.get(key)?.clone();
            let value = setting.accept(*value)?;
            settings.change(&mut link, &[(key.clone(), value)])?;
            let was = format!("{key} was {}", setting.value);
            let saved = save_if_requested(&mut link, *save, address)?;
            (vec![settings.get(key)?], vec![was, saved])
        }
        Action::Save => {
            let saved = save_if_requested(&mut link, true, address)?;
            (settings.iter().collect(), vec![saved])
        }
        Action::Export { .. } => {
            let text = export(&settings, link.image());
            if let Some(target) = &target {
                target.write_bytes(text.as_bytes())?;
            }
            let note = target.map(|target| format!("wrote {}", target.path().display()));
            (settings.iter().collect(), note.into_iter().collect())
        }
        Action::Import { file, save } => {
            let requested = text.unwrap_or_default().requested(&settings, file)?;
            let before = settings.clone();
            let change = settings.change(&mut link, &requested);
            change.map_err(|refusal| refusal.at(file.display()))?;
            let both = settings.iter().zip(before.iter());
            let changed = both.filter(|(now, then)| now.value.to_bits() != then.value.to_bits());
            let changed: Vec<&BoardSetting> = changed.map(|(now, _)| now).collect();
            let (all, count) = (requested.len(), changed.len());
            let counts = format!("{all} settings in the file, {count} changed");
            let saved = save_if_requested(&mut link, *save, address)?;
            (changed, vec![counts, saved])
        }
        // Handled above: it needs the drive to run.
        Action::Commission { .. } => return Ok(Exit::Done),
    };
    let rows: Vec<BoardSetting> = rows.into_iter().cloned().collect();
    let report = view().printout(&rows).notes(notes);
    report.print(arguments.format).map(|()| Exit::Done)
}

/// Saves, if requested; returns a message on how long the values last.
fn save_if_requested(link: &mut Link, save: bool, address: &Address) -> Result<String> {
    if save {
        link.command(&Request::Save)?;
        return Ok("saved: the board starts with these settings from now on".into());
    }
    Ok(if address.is_emulated() {
        "lost at the end of this emulated board: add --save and --flash-image FILE to keep settings"
            .into()
    } else {
        format!(
            "in use until the board's next reset; save it with: kband settings save{}",
            address.options()
        )
    })
}

fields! {
    fn view(setting: BoardSetting) {
        all KEY => setting.key.clone();
        all VALUE => shortest(setting.value);
        all UNIT => setting.unit.clone();
        all LOW => shortest(setting.low);
        all HIGH => shortest(setting.high);
        all DEFAULT => shortest(setting.default);
        json MEANING => setting.meaning();
    }
}

/// Refuses saving on an emulated board without a flash.
pub(super) fn check_flash(address: &Address, saved: &str) -> Result<()> {
    if address.is_emulated() && address.flash_image.is_none() {
        let cause = format!("the emulated board has no flash to keep {saved} in");
        let next = "name a file for it: --flash-image board.flash";
        return Err(Refusal::new(cause, next));
    }
    Ok(())
}

pub(super) fn export(settings: &BoardSettings, image: &str) -> String {
    let mut text = format!(
        "# Settings of a board with kband {image}.\n\
         # kband settings import FILE.toml sets them on a board; a key left out keeps its value.\n\n"
    );
    for setting in settings.iter() {
        let assigned = format!("{} = {:?}", setting.key, setting.value);
        let (accepted, meaning) = (setting.accepted(), setting.meaning());
        text += &format!("{assigned:<32} # {accepted}; {meaning}\n");
    }
    text
}

/// A parsed file of settings, each a number.
#[derive(Debug, Default)]
pub struct Imported(Vec<(String, f64)>);

impl Imported {
    fn read(file: &Path) -> Result<Self> {
        Self::parse(&file::read_text(file)?).map_err(|refusal| refusal.at(file.display()))
    }

    /// The settings of a text: a key and a number each.
    pub fn parse(text: &str) -> Result<Self> {
        let next = "correct this line; kband settings export shows a whole file";
        let table = toml_table(text, next)?;
        let mut all = Vec::new();
        for (key, value) in table {
            let Some(number) = toml_number(&value) else {
                return Err(Refusal::value(
                    key,
                    value.to_string().replace('\n', " "),
                    "a number",
                    "write the setting as key = number; kband settings export shows a whole file",
                ));
            };
            all.push((key, number));
        }
        if all.is_empty() {
            let next = "kband settings export shows a whole file";
            return Err(Refusal::new("there is no setting in it", next));
        }
        Ok(Self(all))
    }

    /// Checked settings for the board: every key exists, and every value is within its range.
    fn requested(&self, settings: &BoardSettings, file: &Path) -> Result<Vec<(String, f32)>> {
        let accept = |(key, value): &(String, f64)| {
            let setting = settings.get(key)?;
            Ok((key.clone(), setting.accept(*value)?))
        };
        let requested: Result<_> = self.0.iter().map(accept).collect();
        requested.map_err(|refusal| refusal.at(file.display()))
    }
}
