//! Look-up in the manual: its pages, sections, and tables of words.

macro_rules! pages {
    ($($name:literal)*) => {
        /// The searched pages, by name.
        pub const PAGES: &[(&str, &str)] =
            &[$(($name, include_str!(concat!("../../../../docs/", $name)))),*];
    };
}

pages! {
    "glossary.md"
    "faults.md"
    "theory-model.md"
    "theory-impacts.md"
    "theory-bands.md"
    "theory-capture.md"
    "theory-transport.md"
    "theory-real-parts.md"
}

/// A word of the glossary.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Word {
    /// Its symbols, as in formulas.
    pub symbols: Vec<String>,
    /// The term.
    pub term: String,
    /// Its unit; empty for a pure notion.
    pub unit: String,
    /// Its names in the sources and in machine-readable output.
    pub names: Vec<String>,
    /// Its meaning, as Markdown.
    pub meaning: String,
}

impl Word {
    /// The section that its meaning refers to, as Markdown.
    pub fn section(&self) -> Option<String> {
        let (_, link) = self.meaning.rsplit_once("](")?;
        let (page, anchor) = link.split_once(')')?.0.split_once('#')?;
        anchored(self::page(page)?, anchor)
    }
}

/// The text of a page.
pub fn page(name: &str) -> Option<&'static str> {
    let found = PAGES.iter().find(|(page, _)| *page == name);
    found.map(|(_, text)| *text)
}

/// Every word of the glossary, in its order.
pub fn words() -> impl Iterator<Item = Word> {
    page("glossary.md")
        .unwrap_or_default()
        .lines()
        .filter_map(word)
}

/// A row of the glossary's tables of five columns.
fn word(line: &str) -> Option<Word> {
    let cells = line.strip_prefix('|')?.strip_suffix('|')?;
    let cells: Vec<&str> = cells.split('|').map(str::trim).collect();
    let [symbols, term, unit, names, meaning] = cells[..] else {
        return None;
    };
    let heading = symbols == "symbol" || symbols.starts_with("---");
    (!heading).then(|| Word {
        symbols: quoted(symbols),
        term: term.into(),
        unit: unit.into(),
        names: quoted(names),
        meaning: meaning.into(),
    })
}

/// Texts between backquotes.
fn quoted(cell: &str) -> Vec<String> {
    cell.split('`').skip(1).step_by(2).map(Into::into).collect()
}

/// The section after an anchor: `<a id=...>`, or the slug of a heading.
fn anchored(page: &str, anchor: &str) -> Option<String> {
    let mark = format!("<a id=\"{anchor}\"></a>");
    let heading = match page.split_once(&mark) {
        Some((_, after)) => after.lines().find(|line| !line.is_empty())?,
        None => page
            .lines()
            .find(|line| line.starts_with("## ") && slug(line) == anchor)?,
    };
    sections(page, heading).into_iter().next()
}

/// The anchor that a heading has on a page.
fn slug(heading: &str) -> String {
    let words = heading.trim_start_matches(['#', ' ']).to_lowercase();
    let kept = words
        .chars()
        .filter(|c| c.is_alphanumeric() || " -".contains(*c));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

/// The sections whose headings begin with `heading`, each up to the next heading.
pub fn sections(page: &str, heading: &str) -> Vec<String> {
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
            section.push_str(line);
            section.push('\n');
        }
    }
    sections
}

/// The numbers of the sections `## Fault N: ...` or `## Limit N: ...`.
pub fn numbers(heading: &str) -> String {
    let faults = page("faults.md").unwrap_or_default();
    let numbers: Vec<&str> = faults
        .lines()
        .filter_map(|line| line.strip_prefix(heading)?.split(':').next())
        .collect();
    numbers.join(", ")
}

/// The section of the fault or limit of this name.
pub fn fault_or_limit(name: &str) -> Option<String> {
    let faults = page("faults.md")?;
    let heading = faults.lines().find(|line| {
        let title = line
            .strip_prefix("## ")
            .and_then(|line| line.split_once(": "));
        title.is_some_and(|(_, title)| title.eq_ignore_ascii_case(name))
    })?;
    sections(faults, heading).into_iter().next()
}

/// The text on a state or a regime: the sentences after its name in bold.
pub fn state(name: &str) -> Option<String> {
    let faults = page("faults.md")?;
    let states = sections(faults, "## States").concat() + &sections(faults, "## Regimes").concat();
    let mut said = states.split("**").skip(1);
    while let (Some(title), Some(text)) = (said.next(), said.next()) {
        if title.eq_ignore_ascii_case(name) {
            let text = text.split("\n\n").next().unwrap_or_default();
            return Some(format!("**{title}**{}\n", text.trim_end()));
        }
    }
    None
}

/// The text on an event of the log: its row.
pub fn event(name: &str) -> Option<String> {
    let events = sections(page("faults.md")?, "## Events").concat();
    let row = events.lines().find_map(|line| {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        match cells[..] {
            [_, event, meaning] if event.eq_ignore_ascii_case(name) => Some(meaning.to_string()),
            _ => None,
        }
    })?;
    Some(format!("**{name}**: {row}\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_word_that_refers_to_a_section_finds_it() {
        let mut found = 0;
        for word in words() {
            if word.meaning.contains("](") && !word.meaning.contains(".md)") {
                let section = word.section();
                assert!(section.is_some_and(|text| text.len() > 80), "{}", word.term);
                found += 1;
            }
        }
        assert!(found > 20, "{found}");
    }
}
