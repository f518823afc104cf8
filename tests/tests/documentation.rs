//! Consistency of pages and sources: links, anchors, citations, section numbers, names and sentence
//! lengths.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use kband_tests::root;

fn collect(folder: &Path, ends: &[&str], files: &mut Vec<PathBuf>) {
    let entries = fs::read_dir(folder).expect("a folder of the project is read");
    for path in entries.flatten().map(|entry| entry.path()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if path.is_dir() {
            if name != "target" && name != ".git" {
                collect(&path, ends, files);
            }
        } else if ends.iter().any(|end| name.ends_with(end)) {
            files.push(path);
        }
    }
}

/// The text of a file of the project, by its path from the root.
fn text(path: impl AsRef<Path>) -> String {
    let read = fs::read_to_string(root().join(path));
    read.expect("a text of the project is read")
}

/// The project's files with one of these endings, and their texts.
fn texts(ends: &[&str]) -> Vec<(PathBuf, String)> {
    let mut paths = Vec::new();
    collect(&root(), ends, &mut paths);
    paths.sort();
    let read = |path: PathBuf| (path.clone(), text(path));
    paths.into_iter().map(read).collect()
}

fn relative(path: &Path) -> String {
    let inside = path.strip_prefix(root()).unwrap_or(path);
    inside.display().to_string()
}

/// The identifiers of a page's `<a id="...">`.
fn explicit_anchors(page: &str) -> impl Iterator<Item = &str> {
    let parts = page.split("<a id=\"").skip(1);
    parts.filter_map(|rest| rest.split('"').next())
}

/// The heading's identifier in GitHub and mdBook.
fn slug(heading: &str) -> String {
    let letters = heading.trim().to_lowercase();
    let letters = letters.chars().filter_map(|c| match c {
        ' ' => Some('-'),
        c if c.is_alphanumeric() || c == '-' || c == '_' => Some(c),
        _ => None,
    });
    letters.collect()
}

fn anchors(page: &str) -> BTreeSet<String> {
    let headings = page.lines().filter(|line| line.starts_with('#'));
    let slugs = headings.map(|line| slug(line.trim_start_matches('#')));
    let explicit = explicit_anchors(page).map(str::to_owned);
    slugs.chain(explicit).collect()
}

/// Reason why a link from a folder is broken; `None` if it is valid.
fn link_error(from: &Path, link: &str, own: &Path) -> Option<String> {
    let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
    let other = from.join(file);
    let target = if file.is_empty() { own } else { &other };
    if !target.exists() {
        return Some(format!("{}: no file for {link}", relative(own)));
    }
    if anchor.is_empty() {
        return None;
    }
    let page = fs::read_to_string(target).unwrap_or_default();
    let exists = anchors(&page).contains(anchor);
    (!exists).then(|| format!("{}: no anchor for {link}", relative(own)))
}

/// Targets within the project of a text's markdown links.
fn links(text: &str) -> impl Iterator<Item = &str> {
    let ends = text.split("](").skip(1);
    let targets = ends.filter_map(|rest| rest.split(')').next());
    targets.filter(|link| !link.contains("://") && !link.contains(char::is_whitespace))
}

/// The pages of the manual that a text cites, with their anchors.
fn citations(text: &str) -> impl Iterator<Item = &str> {
    let inside = |c: char| c.is_ascii_alphanumeric() || "-_./#".contains(c);
    text.match_indices("docs/").filter_map(move |(start, _)| {
        let rest = &text[start..];
        let end = rest.find(|c| !inside(c)).unwrap_or(rest.len());
        let cited = rest[..end].trim_end_matches(['.', '/', '#']);
        cited.contains(".md").then_some(cited)
    })
}

#[test]
fn every_link_and_citation_leads_to_its_anchor() {
    let (mut wrong, mut pages, mut of_theory) = (Vec::new(), 0, 0);
    for (path, text) in texts(&[".rs", ".md", ".toml", ".sh"]) {
        if path.extension().is_some_and(|ending| ending == "md") {
            pages += 1;
            let folder = path.parent().expect("a page lies in a folder");
            wrong.extend(links(&text).filter_map(|link| link_error(folder, link, &path)));
        }
        for cited in citations(&text) {
            of_theory += usize::from(cited.contains("#t"));
            wrong.extend(link_error(&root(), cited, &path));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(pages > 15 && of_theory >= 20, "{pages} pages, {of_theory}");
}

#[test]
fn the_sections_of_the_theory_have_the_numbers_of_their_anchors() {
    let mut anchors = BTreeSet::new();
    for (path, text) in texts(&[".md"]) {
        for (place, _) in text.match_indices("<a id=\"t") {
            let anchor = explicit_anchors(&text[place..]).next().expect("an anchor");
            let heading = text[place..].lines().find(|line| line.starts_with('#'));
            let heading = heading.unwrap_or_default().trim_start_matches('#').trim();
            let number = heading.split(' ').next().unwrap_or_default();
            let page = relative(&path);
            assert_eq!(&anchor[1..], number.trim_end_matches('.'), "{page}");
            let is_new = anchors.insert(anchor.to_owned());
            assert!(is_new, "{page}: {anchor} is taken");
        }
    }
    assert!(anchors.len() > 40, "{anchors:?}");
}

#[test]
fn the_summary_names_every_page_of_the_manual() {
    let (docs, summary) = (root().join("docs"), text("docs/SUMMARY.md"));
    let named: BTreeSet<&str> = links(&summary).collect();
    for (path, _) in texts(&[".md"]) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if path.parent() == Some(&docs) && name != "SUMMARY.md" {
            assert!(named.contains(&*name), "SUMMARY.md does not name {name}");
        }
    }
}

/// Every name in backquotes of the glossary's fourth column.
fn names_in_the_code(glossary: &str) -> Vec<&str> {
    let rows = glossary.lines().filter(|line| line.starts_with('|'));
    let cells = rows.filter_map(|row| row.split('|').nth(4));
    let quoted = cells.flat_map(|cell| cell.split('`').skip(1).step_by(2));
    quoted.flat_map(|name| name.split("::")).collect()
}

#[test]
fn every_name_of_the_glossary_is_in_the_sources() {
    let glossary = text("docs/glossary.md");
    let sources = texts(&[".rs"]);
    let inside = |c: char| c.is_alphanumeric() || c == '_';
    let texts = sources.iter().map(|(_, text)| text);
    let words: BTreeSet<&str> = texts.flat_map(|text| text.split(|c| !inside(c))).collect();
    let mut names = names_in_the_code(&glossary);
    assert!(names.len() > 40, "{names:?}");
    names.retain(|name| !words.contains(name));
    assert_eq!(names, [""; 0], "not in the sources");
}

/// The glossary explains the names of regimes and states in tables, legends and `kband status`.
#[test]
fn every_regime_and_state_that_is_shown_is_explained() {
    let glossary = text("docs/glossary.md");
    for (_, name) in kband_host::ending::FILLS {
        let row = format!("| {name}");
        assert!(glossary.contains(&row), "no '{name}' in docs/glossary.md");
    }
    let faults = text("docs/faults.md").to_lowercase();
    for state in kband_control::State::ALL {
        let name = format!("**{}**", state.name().to_lowercase());
        assert!(faults.contains(&name), "no {name} in docs/faults.md");
    }
}

/// Mentions of numbered faults or limits without their name, as in "fault 6 (over-temperature)".
fn misnamed(page: &str, word: &str, name: impl Fn(u8) -> Option<&'static str>) -> Vec<String> {
    let mut items = Vec::new();
    for after in page.split(&format!("{word} ")).skip(1) {
        let digits = after.len() - after.trim_start_matches(|c: char| c.is_ascii_digit()).len();
        let (number, rest) = after.split_at(digits);
        let Ok(number) = number.parse() else { continue };
        let inside = rest.strip_prefix(" (");
        let documented = inside.and_then(|rest| rest.split(')').next());
        // A quoted command may use the number alone.
        let command = rest.starts_with('`');
        if !command && (documented.is_none() || documented != name(number)) {
            items.push(format!("{word} {number}{}", rest.get(..30).unwrap_or(rest)));
        }
    }
    items
}

#[test]
fn every_number_of_a_fault_has_its_name() {
    use kband_control::{Fault, Limits};
    let fault = |number| Fault::numbered(number).map(Fault::name);
    let limit = |number| {
        let mut all = Limits::ALL.into_iter();
        all.find(|limit| limit.number() == number).map(Limits::name)
    };
    for name in ["safety.md", "wiring.md", "commissioning.md", "link.md"] {
        let items = misnamed(&text(format!("docs/{name}")), "fault", fault);
        assert!(items.is_empty(), "{name}: {items:?}");
    }
    let items = misnamed(&text("docs/safety.md"), "limit", limit);
    assert!(items.is_empty(), "{items:?}");
    // The headings that `kband explain` prints.
    let faults = text("docs/faults.md");
    for fault in Fault::ALL {
        let heading = format!("\n## Fault {}: {}\n", fault.number(), fault.name());
        assert!(faults.contains(&heading), "{heading}");
    }
}

/// Largest number of words in a sentence, and largest mean over a page.
const MAX_SENTENCE_WORDS: usize = 35;
const MAX_MEAN_SENTENCE_WORDS: usize = 20;

/// Largest number of words in a part of the manual, tables and code included.
const MAX_PART_WORDS: usize = 8000;

/// The paragraphs and list items of a page, without code, formulas, tables, headings and pictures.
fn paragraphs(page: &str) -> Vec<String> {
    let mut items = vec![String::new()];
    let mut code = false;
    for line in page.lines() {
        let text = line.trim();
        let fence = line.starts_with("```");
        code ^= fence;
        let in_paragraph = items.last().is_some_and(|last| !last.is_empty());
        let formula = line.starts_with("    ") && !in_paragraph;
        let other = text.starts_with(['|', '#', '<']) || text.starts_with("![");
        if fence || code || formula || other || text.is_empty() {
            items.push(String::new());
            continue;
        }
        let numbered = text
            .split_once(". ")
            .filter(|(number, _)| number.bytes().all(|digit| digit.is_ascii_digit()))
            .map(|(_, item)| item);
        match (text.strip_prefix("- ").or(numbered), items.last_mut()) {
            (None, Some(last)) => *last += &format!(" {text}"),
            (item, _) => items.push(item.unwrap_or(text).to_owned()),
        }
    }
    items
}

/// A paragraph with each code span as one word and each link as its text.
fn prose(paragraph: &str) -> String {
    let spans = paragraph.split('`').enumerate();
    let plain = spans.map(|(n, span)| if n % 2 == 1 { "code" } else { span });
    let plain: String = plain.collect();
    let mut links = plain.split("](");
    let mut text = links.next().unwrap_or_default().to_owned();
    for rest in links {
        text += rest.split_once(')').map_or(rest, |(_, after)| after);
    }
    text
}

/// Whether a word ends its sentence; an initial or an abbreviated journal does not.
fn ends_a_sentence(word: &str) -> bool {
    const ABBREVIATIONS: &str = "Figs. Helv. Phys. Dyn. Syst. Meas. Proc. e.g.";
    let word = word.trim_matches(['(', ')', '"', '*']);
    let initial = word.len() == 2 && word.starts_with(|c: char| c.is_ascii_uppercase());
    word.ends_with(['.', '!', '?'])
        && !initial
        && !ABBREVIATIONS.split(' ').any(|short| short == word)
}

fn sentences(page: &str) -> Vec<Vec<String>> {
    let mut items = Vec::new();
    for paragraph in paragraphs(page) {
        let mut sentence = Vec::new();
        for word in prose(&paragraph).split_whitespace() {
            if word.contains(char::is_alphanumeric) {
                sentence.push(word.to_owned());
            }
            if ends_a_sentence(word) {
                items.push(std::mem::take(&mut sentence));
            }
        }
        items.push(sentence);
    }
    items.retain(|sentence| !sentence.is_empty());
    items
}

#[test]
fn sentences_of_the_manual_are_short() {
    let mut pages = 0;
    let mut wrong = Vec::new();
    for (path, text) in texts(&[".md"]) {
        let name = relative(&path);
        let others = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md"];
        if !name.starts_with("docs/") && !others.contains(&name.as_str()) {
            continue;
        }
        pages += 1;
        let sentences = sentences(&text);
        let words: usize = sentences.iter().map(Vec::len).sum();
        if words > MAX_MEAN_SENTENCE_WORDS * sentences.len() {
            let count = sentences.len();
            wrong.push(format!("{name}: {words} words in {count} sentences"));
        }
        let long = |words: &&Vec<String>| words.len() > MAX_SENTENCE_WORDS;
        let long = sentences.iter().filter(long);
        wrong.extend(long.map(|sentence| format!("{name}: {}", sentence.join(" "))));
    }
    assert!(pages > 15, "{pages} pages");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn tuned_constants_are_in_the_files_that_the_table_names() {
    let mut constants = 0;
    let page = text("docs/tuning.md");
    for row in page.lines().filter(|line| line.starts_with("| `")) {
        let mut cells = row.split(" | ");
        let names = cells.next().expect("a cell of names");
        let file = cells.next().expect("a cell of a file").trim_matches('`');
        let source = text(file);
        for name in names.split('`').skip(1).step_by(2) {
            let defined = format!("const {name}: ");
            assert!(source.contains(&defined), "{name} in {file}");
            constants += 1;
        }
    }
    assert!(constants > 100, "{constants}");
}

#[test]
fn parts_of_the_manual_keep_their_length() {
    let summary = text("docs/SUMMARY.md");
    for part in ["Guide", "Theory", "Internals"] {
        let split = summary.split_once(&format!("\n# {part}\n"));
        let (_, after) = split.expect("a part of the manual");
        let chapters = after.split("\n# ").next().unwrap_or_default();
        // The page of tuned constants is a reference table.
        let pages = links(chapters).filter(|page| *page != "tuning.md");
        let pages: Vec<String> = pages.map(|page| text(format!("docs/{page}"))).collect();
        assert!(pages.len() > 4, "{part}: {} pages", pages.len());
        let words = pages.iter().map(|page| page.split_whitespace().count());
        let words: usize = words.sum();
        assert!(words <= MAX_PART_WORDS, "{part}: {words} words");
    }
}
