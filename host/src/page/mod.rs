//! HTML pages for the browser: one file with style, script and the numbers as JSON. A content
//! policy forbids other sources. The script only draws results that were computed here.

use serde_json::Value as Json;

use crate::picture::{escape, page_colours};
use crate::provenance;

const STYLE: &str = include_str!("page.css");
/// Charts with a cursor, sliders over precomputed values, and the colour switch.
const CHARTS: &str = include_str!("charts.js");
const NO_SCRIPT: &str = "<noscript><p class=\"note\">The pictures of this page are drawn by its script, which this browser does not run; \
the words and tables are all here.</p></noscript>\n";
/// Beginning of every page, which identifies pages of kband.
const HEAD: &str = "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"generator\" content=\"kband";

/// Whether a file with this beginning is a page of kband.
pub fn own(begin: &str) -> bool {
    begin.starts_with(HEAD)
}

/// The JSON numbers in a page of kband.
pub fn data_of(page: &str) -> Option<Json> {
    let (_, rest) = page.split_once("id=\"data\">")?;
    serde_json::from_str(rest.split_once("</script>")?.0).ok()
}

#[derive(Clone, Debug)]
pub struct Page {
    title: String,
    body: String,
    data: Json,
    script: &'static str,
}

impl Page {
    /// A page whose `script` draws the figures of `data`.
    pub fn new(title: &str, data: Json, script: &'static str) -> Self {
        Self {
            title: title.into(),
            body: String::new(),
            data,
            script,
        }
    }

    pub fn section(mut self, heading: &str, content: &str) -> Self {
        let heading = escaped(heading);
        self.body += &format!("<section>\n<h2>{heading}</h2>\n{content}</section>\n");
        self
    }

    pub fn to_html(&self) -> String {
        let title = escaped(&self.title);
        // Within a script element only `<` could end it.
        let data = self.data.to_string().replace('<', "\\u003c");
        format!(
            "{HEAD} {version}\">
<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">
<meta name=\"color-scheme\" content=\"light dark\">
<meta name=\"provenance\" content=\"{provenance}\">
<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; \
script-src 'unsafe-inline'; img-src data:\">
<title>{title}</title>
<style>
{colours}{STYLE}</style>
</head>
<body>
<header>
<h1>{title}</h1>
<button type=\"button\" id=\"colours\" aria-pressed=\"false\">dark or light</button>
</header>
<main>
{no_script}{body}</main>
<script type=\"application/json\" id=\"data\">{data}</script>
<script>
{CHARTS}{script}</script>
</body>
</html>
",
            version = env!("CARGO_PKG_VERSION"),
            provenance = escaped(&provenance::line()),
            colours = page_colours(),
            no_script = if self.data.is_null() { "" } else { NO_SCRIPT },
            body = self.body,
            script = self.script,
        )
    }
}

/// A figure for the page's script: name, caption, and place of its sliders.
pub fn figure(name: &str, caption: &str) -> String {
    let caption = escaped(caption);
    format!(
        "<figure id=\"{name}\">\n<div class=\"controls\"></div>\n<div class=\"plot\" tabindex=\"0\" role=\"img\" aria-label=\"{caption}\"></div>\n\
         <output class=\"reading\"></output>\n<ul class=\"legend\"></ul>\n<figcaption>{caption}</figcaption>\n\
         <details class=\"numbers\"><summary>the numbers of this picture</summary></details>\n</figure>\n"
    )
}

pub fn table(heads: &[&str], rows: &[Vec<String>]) -> String {
    let line = |cells: &mut dyn Iterator<Item = String>, element: &str| {
        let cells = cells.map(|cell| format!("<{element}>{}</{element}>", escaped(&cell)));
        format!("<tr>{}</tr>\n", cells.collect::<String>())
    };
    let head = line(&mut heads.iter().map(ToString::to_string), "th");
    let body = rows.iter().map(|row| line(&mut row.iter().cloned(), "td"));
    let body: String = body.collect();
    format!(
        "<div class=\"wide\"><table>\n<thead>{head}</thead>\n<tbody>\n{body}</tbody>\n</table></div>\n"
    )
}

pub fn paragraphs(lines: &[String]) -> String {
    let paragraph = |line: &String| format!("<p>{}</p>\n", escaped(line));
    lines.iter().map(paragraph).collect()
}

pub fn folded(summary: &str, text: &str) -> String {
    let [summary, text] = [summary, text].map(escaped);
    format!("<details><summary>{summary}</summary>\n<pre>{text}</pre>\n</details>\n")
}

fn escaped(text: &str) -> String {
    escape(text).replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn texts_are_escaped_and_load_no_other_file() {
        let evil = "</script><img src=\"https://x.invalid/a.png\"> & more";
        let content = paragraphs(&[evil.into()]) + &folded(evil, evil) + &figure("one", evil);
        let page = Page::new(evil, json!({ "name": evil }), "").section(evil, &content);
        let html = page.to_html();
        assert!(own(&html) && !own("<!doctype html><html>"));
        assert!(!html.contains("<img") && !html.contains("src=\""));
        assert_eq!(html.matches("</script>").count(), 2);
        assert_eq!(html.matches("<script").count(), 2);
        let data = data_of(&html).unwrap();
        assert_eq!(data["name"], evil);
    }
}
