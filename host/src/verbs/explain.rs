//! `kband explain`: the manual's text on a term.

mod manual;
mod plain;

use crate::desk::Desk;
use crate::refusal::{Exit, Refusal, Result};
use crate::report::{self, columns};
use manual::Word;

/// Print the manual's text on a word, state, event, fault or limit.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband explain k
  kband explain flip
  kband explain in gear
  kband explain capturing
  kband explain fault 4

It knows every word and symbol of the glossary, and every state, event, regime, fault and limit.")]
pub struct Arguments {
    /// The word or words; `fault N` or `limit N` for a number. Without a word: the list of them.
    #[arg(value_name = "WORD")]
    words: Vec<String>,
}

/// Terms with a paragraph or more in the manual, one a line: name, help, other names, page, and
/// beginnings of the headings of its sections.
const TOPICS: &str = include_str!("explain/topics.tsv");

fn topics() -> impl Iterator<Item = [&'static str; 5]> {
    let cells = |line: &'static str| line.split('\t').collect::<Vec<_>>().try_into().ok();
    TOPICS.lines().filter_map(cells)
}

pub fn run(arguments: &Arguments, _desk: &Desk) -> Result<Exit> {
    report::print(&match arguments.words.as_slice() {
        [] => list(),
        words => plain::plain(&text(words)?),
    })
    .map(|()| Exit::Done)
}

fn list() -> String {
    let mut text = String::new();
    for [name, help, ..] in topics() {
        text.push_str(&format!("kband explain {name:<16} {help}\n"));
    }
    text.push_str("\nAnd every word of the glossary, every state, event, regime, fault and limit by its name.\n");
    text
}

/// The manual's text on these words, as Markdown.
fn text(words: &[String]) -> Result<String> {
    if let [kind, number] = words
        && let Ok(number) = number.parse::<u32>()
    {
        return numbered(kind, number);
    }
    let query = words.join(" ");
    let name = query.trim().to_lowercase().replace('_', " ");
    // An option has hyphens, for example --second-tone.
    let spoken = name.trim_start_matches('-').replace('-', " ");
    explained(query.trim(), &name)
        .or_else(|| explained(&spoken, &spoken))
        .ok_or_else(|| unknown(query.trim(), &name))
}

/// Explanation of one word, as typed and in lower case; `None` if unknown.
fn explained(query: &str, name: &str) -> Option<String> {
    let is_other = |others: &str| others.split(", ").any(|other| other == name);
    let rows = glossary(query, name);
    let mut parts: Vec<String> = rows.iter().map(entry).collect();
    parts.extend(manual::state(name));
    parts.extend(manual::event(name));
    parts.extend(manual::fault_or_limit(name));
    match topics().find(|[topic, _, others, ..]| *topic == name || is_other(others)) {
        Some([.., page, headings]) => {
            let page = manual::page(page).unwrap_or_default();
            let sections = |heading| manual::sections(page, heading);
            parts.extend(headings.split("; ").flat_map(sections));
        }
        None => parts.extend(rows.iter().filter_map(Word::section)),
    }
    if parts.is_empty() {
        parts.extend(output(name));
    }
    parts.dedup();
    (!parts.is_empty()).then(|| parts.join("\n"))
}

fn output(name: &str) -> Option<String> {
    let (name, unit, meaning) = columns::entry(&name.replace(' ', "_"))?;
    let unit = report::when(!unit.is_empty(), || format!(" Unit: {unit}."));
    Some(format!("**{name}**: {meaning}{unit}\n"))
}

/// Matching words of the glossary: symbols by exact spelling, terms and names in any case.
fn glossary(query: &str, name: &str) -> Vec<Word> {
    let symbols = manual::words().filter(|word| word.symbols.iter().any(|symbol| symbol == query));
    let symbols: Vec<Word> = symbols.collect();
    if !symbols.is_empty() {
        return symbols;
    }
    let is = |text: &str| text.to_lowercase().replace('_', " ") == name;
    let is_match = |word: &Word| {
        is(&word.term)
            || word.term.split(", ").any(is)
            || word.symbols.iter().chain(&word.names).any(|text| is(text))
    };
    manual::words().filter(is_match).collect()
}

fn entry(word: &Word) -> String {
    let mut line = format!("**{}**", word.term);
    if !word.symbols.is_empty() {
        line.push_str(&format!(" ({})", word.symbols.join(", ")));
    }
    line.push_str(&format!(": {}.", word.meaning));
    if !word.unit.is_empty() && word.unit != "1" {
        line.push_str(&format!(" Unit: {}.", word.unit));
    }
    line.push('\n');
    line
}

fn numbered(kind: &str, number: u32) -> Result<String> {
    let heading = match kind.to_lowercase().as_str() {
        "fault" => "## Fault ",
        "limit" => "## Limit ",
        _ => {
            let accepted = "a number after fault or limit only";
            let next = "leave the number out";
            return Err(Refusal::value("number", number, accepted, next));
        }
    };
    let faults = manual::page("faults.md").unwrap_or_default();
    let sections = manual::sections(faults, &format!("{heading}{number}:"));
    sections.into_iter().next().ok_or_else(|| {
        let key = format!("number of the {}", kind.to_lowercase());
        let next = "leave the number out to read about all of them";
        Refusal::value(key, number, manual::numbers(heading), next)
    })
}

fn unknown(query: &str, name: &str) -> Refusal {
    let topics: Vec<&str> = topics().map(|[name, ..]| name).collect();
    let terms = manual::words().map(|word| word.term);
    let terms = terms.chain(topics.iter().map(ToString::to_string));
    let like = terms.map(|term| (strsim::jaro_winkler(&term, name), term));
    let mut like: Vec<_> = like.filter(|(likeness, _)| *likeness > 0.85).collect();
    like.sort_by(|a, b| b.0.total_cmp(&a.0));
    let next = match like.first() {
        Some((_, term)) => {
            format!("did you mean '{term}'? kband explain alone lists what is explained at length")
        }
        None => "kband explain alone lists what is explained at length".into(),
    };
    let topics = topics.join(", ");
    let accepted = format!("{topics}, and every word of the glossary");
    Refusal::value("WORD", query, accepted, next)
}

#[cfg(test)]
mod tests {
    use kband_control::{Event, Fault, Limits, State};

    use super::*;

    fn explanation(words: &str) -> Result<String> {
        let words: Vec<String> = words.split(' ').map(Into::into).collect();
        text(&words).map(|text| plain::plain(&text))
    }

    #[test]
    fn every_topic_and_every_name_of_it_has_its_section() {
        assert_eq!(topics().count(), TOPICS.lines().count());
        for [name, _, others, page, headings] in topics() {
            for heading in headings.split("; ") {
                let sections = manual::sections(manual::page(page).unwrap(), heading);
                assert!(!sections.is_empty(), "{name}: {page} {heading}");
            }
            for name in others.split_terminator(", ").chain([name]) {
                let text = explanation(name).unwrap();
                assert!(text.len() > 200, "{name}: {text}");
                for raw in ["**", "](", "`", "<a id"] {
                    assert!(!text.contains(raw), "{name}: {raw} in {text}");
                }
            }
        }
    }

    #[test]
    fn each_fault_and_limit_has_a_cause_and_a_remedy() {
        let titled = |kind: &str, number: u8, name: &str| {
            let text = explanation(&format!("{kind} {number}")).unwrap();
            let title = text.lines().next().unwrap_or_default().to_string();
            assert!(title.ends_with(&format!(" {number}: {name}")), "{title}");
            for part in ["Cause.", "Remedy."] {
                assert!(text.contains(part), "{title}");
            }
            assert!(explanation(name).unwrap().contains(&title), "{title}");
        };
        for fault in Fault::ALL {
            titled("fault", fault.number(), fault.name());
        }
        for limit in Limits::ALL {
            titled("limit", limit.number(), limit.name());
        }
        let faults = manual::page("faults.md").unwrap();
        let count = |heading| manual::sections(faults, heading).len();
        assert_eq!(count("## Fault "), Fault::ALL.len());
        assert_eq!(count("## Limit "), Limits::ALL.len());
    }

    #[test]
    fn every_word_of_glossary_and_outputs_is_explained() {
        let listed = |word: Word| [word.symbols, word.names, vec![word.term]].concat();
        let glossary = manual::words().flat_map(listed);
        let states = State::ALL.iter().map(|state| state.name());
        let events = Event::ALL.iter().map(|event| event.name());
        let regimes = crate::ending::FILLS.iter().map(|(_, name)| *name);
        let printed = "amplitude b, regime, in gear, estimated, estimated margin, conveying speed, throw, peak, \
                       k2, k1, chaos edge, reached from rest, lost, setpoint, flip, lot, \
                       order, gear, throw number, irregular, bounce, jam, percent, crawl";
        let written = columns::ENTRIES.iter().map(|(name, ..)| *name);
        let outputs = states.chain(events).chain(regimes).chain(written);
        let outputs = outputs.chain(printed.split(", ")).map(String::from);
        let glossary = glossary
            .filter(|name| !name.is_empty())
            .map(|name| (name, 15));
        for (name, least) in glossary.chain(outputs.map(|name| (name, 0))) {
            let text = explanation(&name);
            assert!(text.is_ok_and(|text| text.len() > least), "{name}");
        }
    }
}
