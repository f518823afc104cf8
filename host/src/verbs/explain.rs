//! `kband explain`: the manual's paragraph on a word, a fault or a limit.

use clap::ValueEnum;

use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};
use crate::report;

/// Print what the manual says on a word, the states, a fault or a limit.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband explain k
  kband explain capture
  kband explain fault 4")]
pub struct Arguments {
    /// The word; without it, the list of them.
    #[arg(value_enum)]
    topic: Option<Topic>,

    /// Number of the fault or limit; without it, all of them.
    #[arg(value_name = "N")]
    number: Option<u8>,
}

/// What can be explained.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Topic {
    /// The number that is controlled.
    K,
    /// Restitution, and why it is an interval.
    #[value(alias = "r")]
    Restitution,
    /// Where parts lock to the drive.
    #[value(alias = "lock")]
    Band,
    /// Period doublings.
    Cascade,
    /// Flights that never repeat.
    Chaos,
    /// Two regimes at one setting.
    Basin,
    /// The kick that brings parts into lock.
    #[value(alias = "kick")]
    Capture,
    /// What the drive is doing, and what it does next.
    State,
    /// What stopped the drive.
    Fault,
    /// What holds the drive back.
    Limit,
}

const MODEL: &str = include_str!("../../../docs/theory-model.md");
const BANDS: &str = include_str!("../../../docs/theory-bands.md");
const CAPTURE: &str = include_str!("../../../docs/theory-capture.md");
const FAULTS: &str = include_str!("../../../docs/faults.md");

/// Prints the section.
pub fn run(arguments: &Arguments, _desk: &Desk) -> Result<Exit, Refusal> {
    report::print(&match arguments.topic {
        Some(topic) => text(topic, arguments.number)?,
        None => topics(),
    })?;
    Ok(Exit::Done)
}

/// What can be explained, a line each.
fn topics() -> String {
    Topic::value_variants()
        .iter()
        .filter_map(ValueEnum::to_possible_value)
        .map(|topic| {
            let help = topic.get_help().map(ToString::to_string);
            let (name, help) = (topic.get_name(), help.unwrap_or_default());
            format!("kband explain {name:<12} {help}\n")
        })
        .collect()
}

fn text(topic: Topic, number: Option<u8>) -> Result<String, Refusal> {
    let (page, headings): (_, &[_]) = match topic {
        Topic::K => (MODEL, &["## 1.2 "]),
        Topic::Restitution => (MODEL, &["## 1.4 "]),
        Topic::Band => (BANDS, &["## 5."]),
        Topic::Cascade => (BANDS, &["## 6.1 ", "## 6.2 "]),
        Topic::Chaos => (BANDS, &["## 6.3 "]),
        Topic::Basin => (CAPTURE, &["## 7.1 ", "## 7.2 "]),
        Topic::Capture => (CAPTURE, &["## 7.3 ", "## 7.4 ", "## 7.5 "]),
        Topic::State => (FAULTS, &["## States"]),
        Topic::Fault => (FAULTS, &["## Fault "]),
        Topic::Limit => (FAULTS, &["## Limit "]),
    };
    let many = matches!(topic, Topic::Fault | Topic::Limit);
    match number {
        Some(number) if many => {
            let heading = headings.concat();
            let found = sections(page, &format!("{heading}{number}:"));
            found.into_iter().next().ok_or_else(|| {
                Refusal::value(
                    format!(
                        "number of the {}",
                        if topic == Topic::Fault {
                            "fault"
                        } else {
                            "limit"
                        }
                    ),
                    number,
                    numbers(page, &heading),
                    "leave the number out to read about all of them",
                )
            })
        }
        Some(number) => Err(Refusal::value(
            "number",
            number,
            "a number after fault or limit only",
            "leave the number out",
        )),
        None => Ok(headings
            .iter()
            .flat_map(|heading| sections(page, heading))
            .collect::<Vec<_>>()
            .join("\n")),
    }
}

/// The sections whose headings begin so, each up to the next heading.
fn sections(page: &str, heading: &str) -> Vec<String> {
    let mut sections: Vec<String> = Vec::new();
    let mut within = false;
    for line in page.lines() {
        if line.starts_with("# ") || line.starts_with("## ") {
            within = line.starts_with(heading);
            if within {
                sections.push(String::new());
            }
        }
        let shown = within && !line.starts_with("<a id=");
        if let (true, Some(section)) = (shown, sections.last_mut()) {
            section.push_str(line.trim_start_matches("## "));
            section.push('\n');
        }
    }
    for section in &mut sections {
        section.truncate(section.trim_end().len());
        section.push('\n');
    }
    sections
}

fn numbers(page: &str, heading: &str) -> String {
    let numbers: Vec<&str> = page
        .lines()
        .filter_map(|line| line.strip_prefix(heading)?.split(':').next())
        .collect();
    numbers.join(", ")
}

#[cfg(test)]
mod tests {
    use kband::control::{Fault, Limits};

    use super::*;

    #[test]
    fn every_word_has_its_section() {
        for topic in Topic::value_variants() {
            let text = text(*topic, None).unwrap();
            assert!(text.len() > 100, "{topic:?}: {text}");
            assert!(!text.contains("<a id="), "{topic:?}: {text}");
        }
    }

    #[test]
    fn every_section_of_the_theory_that_a_word_names_is_there() {
        for (page, numbers) in [
            (MODEL, &["1.2", "1.4"][..]),
            (BANDS, &["5.1", "5.2", "5.3", "5.4", "6.1", "6.2", "6.3"]),
            (CAPTURE, &["7.1", "7.2", "7.3", "7.4", "7.5"]),
        ] {
            for number in numbers {
                assert_eq!(
                    sections(page, &format!("## {number} ")).len(),
                    1,
                    "{number}"
                );
            }
        }
    }

    #[test]
    fn every_fault_and_limit_has_its_paragraph_with_cause_and_remedy() {
        let titled = |topic, number, name: &str| {
            let text = text(topic, Some(number)).unwrap();
            let title = text.lines().next().unwrap_or_default().to_string();
            assert!(title.ends_with(&format!(" {number}: {name}")), "{title}");
            assert!(
                text.contains("**Cause.**") && text.contains("**Remedy.**"),
                "{title}"
            );
        };
        for fault in Fault::ALL {
            titled(Topic::Fault, fault.number(), fault.name());
        }
        for limit in Limits::ALL {
            titled(Topic::Limit, limit.number(), limit.name());
        }
        assert_eq!(sections(FAULTS, "## Fault ").len(), Fault::ALL.len());
        assert_eq!(sections(FAULTS, "## Limit ").len(), Limits::ALL.len());
    }

    #[test]
    fn an_unknown_number_is_refused_with_the_known_ones() {
        let message = text(Topic::Fault, Some(7)).unwrap_err().to_string();
        assert!(message.contains("1, 2, 3, 4, 5, 6, 8, 9, 10"), "{message}");
        assert!(text(Topic::K, Some(1)).is_err());
    }
}
