//! Search in the manual: pages, sections, and the glossary's tables.

macro_rules! pages {
    ($($name:literal)*) => {
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

pub struct Word {
    pub symbols: Vec<String>,
    pub term: String,
    /// Unit; empty for a concept without one.
    pub unit: String,
    /// Names in the sources and in machine-readable output.
    pub names: Vec<String>,
    pub meaning: String,
}

impl Word {
    pub fn section(&self) -> Option<String> {
        let (_, link) = self.meaning.rsplit_once("](")?;
        let (page, anchor) = link.split_once(')')?.0.split_once('#')?;
        anchored(self::page(page)?, anchor)
    }
}

pub fn page(name: &str) -> Option<&'static str> {
    let entry = PAGES.iter().find(|(page, _)| *page == name);
    entry.map(|(_, text)| *text)
}

/// All entries of the glossary, in order.
pub fn words() -> impl Iterator<Item = Word> {
    let glossary = page("glossary.md").unwrap_or_default();
    glossary.lines().filter_map(word)
}

fn word(line: &str) -> Option<Word> {
    let cells = line.strip_prefix('|')?.strip_suffix('|')?;
    let cells: Vec<&str> = cells.split('|').map(str::trim).collect();
    let [symbols, term, unit, names, meaning] = cells[..] else {
        return None;
    };
    (symbols != "symbol" && !symbols.starts_with("---")).then(|| Word {
        symbols: quoted(symbols),
        term: term.into(),
        unit: unit.into(),
        names: quoted(names),
        meaning: meaning.into(),
    })
}

fn quoted(cell: &str) -> Vec<String> {
    cell.split('`').skip(1).step_by(2).map(Into::into).collect()
}

/// The section after an anchor: `<a id=...>`, or the slug of a heading.
fn anchored(page: &str, anchor: &str) -> Option<String> {
    let heading = match page.split_once(&format!("<a id=\"{anchor}\"></a>")) {
        Some((_, after)) => after.lines().find(|line| !line.is_empty())?,
        None => page
            .lines()
            .find(|line| line.starts_with("## ") && slug(line) == anchor)?,
    };
    sections(page, heading).into_iter().next()
}

fn slug(heading: &str) -> String {
    let title = heading.trim_start_matches(['#', ' ']).to_lowercase();
    let letters = title.chars();
    let letters = letters.filter(|c| c.is_alphanumeric() || " -".contains(*c));
    letters.map(|c| if c == ' ' { '-' } else { c }).collect()
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
        let is_text = within && !line.starts_with("<a id=");
        if let (true, Some(section)) = (is_text, sections.last_mut()) {
            section.push_str(line);
            section.push('\n');
        }
    }
    sections
}

/// The numbers of the sections `## Fault N: ...` or `## Limit N: ...`.
pub fn numbers(heading: &str) -> String {
    let numbers = page("faults.md").unwrap_or_default().lines();
    let numbers = numbers.filter_map(|line| line.strip_prefix(heading)?.split(':').next());
    numbers.collect::<Vec<_>>().join(", ")
}

pub fn fault_or_limit(name: &str) -> Option<String> {
    let faults = page("faults.md")?;
    let heading = faults.lines().find(|line| {
        let title = line.strip_prefix("## ");
        let title = title.and_then(|line| line.split_once(": "));
        title.is_some_and(|(_, title)| title.eq_ignore_ascii_case(name))
    })?;
    sections(faults, heading).into_iter().next()
}

/// Text on a state or regime: the sentences after its name in bold.
pub fn state(name: &str) -> Option<String> {
    let faults = page("faults.md")?;
    let states = sections(faults, "## States").concat() + &sections(faults, "## Regimes").concat();
    let mut pieces = states.split("**").skip(1);
    while let (Some(title), Some(text)) = (pieces.next(), pieces.next()) {
        if title.eq_ignore_ascii_case(name) {
            let text = text.split("\n\n").next().unwrap_or_default();
            return Some(format!("**{title}**{}\n", text.trim_end()));
        }
    }
    None
}

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
        let mut count = 0;
        for word in words() {
            if word.meaning.contains("](") && !word.meaning.contains(".md)") {
                let section = word.section();
                assert!(section.is_some_and(|text| text.len() > 80), "{}", word.term);
                count += 1;
            }
        }
        assert!(count > 20, "{count}");
    }
}
