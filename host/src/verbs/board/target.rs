//! `kband target`: sets or prints the target of a board.

use clap::ValueEnum;
use kband_control::wire::Request;
use kband_control::{NoSetpoint, Settings, StartCause, State, Target};

use super::settings::check_flash;
use super::status::{self, BoardStatus};
use crate::arguments::{self, FormatArguments};
use crate::board::{Address, BoardSettings, Emulated};
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal, Result};
use crate::simulate::{describe, within_reach};

/// Set the target of a board. Without a target, print the board's state.
///
/// The target is in use at once. --save saves it with all settings, beyond a loss of power; the
/// drive must be at rest for it.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband target
  kband target gear
  kband target order 2 --on /dev/ttyACM0
  kband target mm 0.23
  kband target mm/s 88
  kband target k 0.41
  kband target identify

If the link is silent for link_timeout, the board reduces its amplitude to safe_amplitude. kband \
monitor and kband status --live keep the link alive; link_timeout 0 needs none.")]
pub struct Arguments {
    /// Kind of the target.
    #[arg(value_enum)]
    kind: Option<Kind>,
    /// Value of the target: drive cycles of a flight for gear and order (default 1), k, mm, mm/s,
    /// g/s or parts a minute.
    #[arg(allow_negative_numbers = true, value_parser = arguments::number)]
    value: Option<f64>,
    /// Also save it, beyond a loss of power.
    #[arg(long)]
    save: bool,
    #[command(flatten)]
    address: Address,
    #[command(flatten)]
    printed: FormatArguments,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Kind {
    /// Parts in gear, for the largest share of time that their scatter allows.
    Gear,
    /// Parts in lock, with one impact in this number of drive cycles.
    Order,
    /// A value of k.
    K,
    /// An amplitude in mm.
    Mm,
    /// A conveying speed in mm/s.
    #[value(name = "mm/s")]
    MmPerS,
    /// Flow of parts in gear in grams per second.
    #[value(name = "g/s")]
    GPerS,
    /// Parts a minute, touching each other; needs the setting part_length.
    #[value(name = "parts/min")]
    PartsPerMinute,
    /// Chaotic motion of the parts.
    Chaos,
    /// Estimation of the parts' restitution from their impacts.
    Identify,
}

impl Kind {
    pub fn target(self, value: Option<f64>) -> Result<Target> {
        let name = self
            .to_possible_value()
            .map_or_else(String::new, |value| value.get_name().to_string());
        let order = || {
            let order = value.unwrap_or(1.0);
            if (1.0..=8.0).contains(&order) && order.fract() == 0.0 {
                return Ok(order as u8);
            }
            Err(Refusal::value(
                format!("number of {name}"),
                order,
                "a whole number of drive cycles, 1..8",
                format!("kband target {name} 1"),
            ))
        };
        let number = |unit: &str, example: &str| {
            let finite = value
                .map(|value| value as f32)
                .filter(|value| value.is_finite());
            finite.ok_or_else(|| {
                let cause = format!("{name} needs a number{unit}");
                Refusal::new(cause, format!("kband target {name} {example}"))
            })
        };
        let alone = |target: Target| match value {
            None => Ok(target),
            Some(value) => Err(Refusal::value(
                format!("number of {name}"),
                value,
                "no number",
                format!("kband target {name}"),
            )),
        };
        match self {
            Self::Gear => order().map(|order| Target::Gear { order }),
            Self::Order => order().map(|order| Target::Locked { order }),
            Self::K => number("", "0.41").map(Target::K),
            Self::Mm => number(" in mm", "0.23").map(Target::Amplitude),
            Self::MmPerS => number(" in mm/s", "88").map(Target::Speed),
            Self::GPerS => number(" in g/s", "50").map(Target::Flow),
            Self::PartsPerMinute => number(" of parts a minute", "120").map(Target::PartsPerMinute),
            Self::Chaos => alone(Target::Chaotic),
            Self::Identify => alone(Target::Identify),
        }
    }
}

/// Refuses a number that no settings accept, before a port is opened.
fn in_range(target: Target) -> Result<()> {
    // Other limits depend on the board's settings: amplitude, track, length of a part.
    let mut keys = Settings::KEYS.iter();
    let limit = keys.find(|key| key.name == "amplitude_limit");
    let settings = Settings {
        amplitude_limit: limit.map_or(f32::INFINITY, |key| key.high),
        track_mass: 1.0,
        track_length: 1.0,
        part_length: 1.0,
        ..Settings::default()
    };
    kband_control::Controller::build(&settings, target, StartCause::Ordinary)?;
    Ok(())
}

/// Refuses a target that the board would refuse, or that its drive does not reach. Returns the
/// reason if no setpoint exists, as far as the board's `settings` show it.
pub(super) fn check(target: Target, settings: &Settings) -> Result<Option<NoSetpoint>> {
    let built = kband_control::Controller::build(settings, target, StartCause::Ordinary);
    let controller = built.map_err(|refused| match target {
        Target::Amplitude(_) => Refusal::from(refused).then(format!(
            "amplitude_limit is {} mm on this board: choose less, or change it (kband settings)",
            settings.amplitude_limit
        )),
        Target::Flow(_) | Target::PartsPerMinute(_)
            if Settings::default().get(refused.parameter).is_some() =>
        {
            let next = format!("kband settings set {} first", refused.parameter);
            Refusal::from(refused).then(next)
        }
        _ => refused.into(),
    })?;
    within_reach(&controller).map_err(|refused| {
        refused.then(
            "choose another target, or correct gain, output_maximum or the limits: kband settings",
        )
    })?;
    Ok(controller.no_setpoint())
}

pub fn run(arguments: &Arguments, _desk: &Desk) -> Result<Exit> {
    let target = arguments.kind.map(|kind| kind.target(arguments.value));
    let target = target.transpose()?;
    if let Some(target) = target {
        in_range(target)?;
    }
    let address = &arguments.address;
    if arguments.save {
        check_flash(address, "a target")?;
    }
    let mut link = address.open(match arguments.save {
        true => Emulated::AtRest,
        false => Emulated::Running,
    })?;
    if arguments.save {
        let state = BoardStatus::request(&mut link)?.state();
        if !matches!(state, Some(State::Off | State::Fault)) {
            let name = link.name();
            let cause = format!("{name} is running its drive, and keeps nothing meanwhile");
            let next = "kband disable first, or leave --save out";
            return Err(Refusal::new(cause, next));
        }
    }
    if let Some(target) = target {
        let settings = BoardSettings::read(&mut link)?.configured();
        let nothing = check(target, &settings)?;
        link.command(&Request::Target(target))?;
        eprintln!("the target is now {}", describe(target));
        if let Some(why) = nothing {
            eprintln!("note: no amplitude serves it: {why}");
        }
    }
    if arguments.save {
        link.command(&Request::Save)?;
        eprintln!("saved: the board starts with it, and with its settings, from now on");
    }
    status::show(&mut link, arguments.printed.format)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// recipe/page.rs has the other targets.
    #[test]
    fn a_target_is_a_word_and_its_number() {
        for (kind, value, target) in [
            (Kind::Gear, None, Target::Gear { order: 1 }),
            (Kind::GPerS, Some(50.0), Target::Flow(50.0)),
            (Kind::PartsPerMinute, Some(9.0), Target::PartsPerMinute(9.0)),
            (Kind::Identify, None, Target::Identify),
        ] {
            assert_eq!(kind.target(value), Ok(target));
            assert_eq!(in_range(target), Ok(()));
        }
    }

    /// tests/wrong_inputs.txt has the targets that a board with default settings refuses.
    #[test]
    fn a_target_that_a_board_cannot_reach_is_refused_with_the_remedy() {
        let settings = Settings::default();
        assert!(check(Target::Amplitude(0.2), &settings).is_ok());
        let flow = check(Target::Flow(50.0), &settings);
        let message = flow.unwrap_err().to_string();
        for expected in ["track_mass = 0", "kband settings set track_mass"] {
            assert!(message.contains(expected), "{message}");
        }
        let weak = Settings {
            gain: 0.2,
            ..settings
        };
        let message = check(Target::K(0.41), &weak).unwrap_err().to_string();
        for expected in [
            "b = 0.2420 mm",
            "up to 0.1900 mm (k from 0.5222)",
            "kband settings",
        ] {
            assert!(message.contains(expected), "{message}");
        }
    }
}
