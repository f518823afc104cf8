//! Record of a commissioning: read, extended by a step, and written as a page or as JSON.

use std::fs;

use serde_json::{Map, Value as Json, json};

use crate::file::Destination;
use crate::page::{self, Page};
use crate::provenance;
use crate::refusal::Refusal;

const FIGURES: &str = include_str!("record.js");

#[derive(Clone, Debug, Default)]
pub(super) struct Record {
    pub steps: Vec<Json>,
}

impl Record {
    /// Opens the record in a file, or a new one if the file is missing. Any other file is refused,
    /// because it would be overwritten.
    ///
    /// It does not use [`crate::file`], which forbids writing to an input: this file is both.
    pub fn open(target: &Destination) -> Result<Self, Refusal> {
        let path = target.path();
        target.ends_in("RECORD", &["html", "htm", "json"])?;
        if !path.exists() {
            return Ok(Self::default());
        }
        let text = fs::read_to_string(path)
            .map_err(|error| Refusal::file(path, &error, "give another name"))?;
        Self::read(&text).ok_or_else(|| {
            Refusal::new(
                format!(
                    "{} is there already, and is no record of a commissioning",
                    path.display()
                ),
                "give another name",
            )
        })
    }

    /// Reads a record from a page or from JSON.
    fn read(text: &str) -> Option<Self> {
        let data = if page::own(text) {
            page::data_of(text)?
        } else {
            serde_json::from_str(text).ok()?
        };
        let steps = data.get("commissioning")?.as_array()?.clone();
        Some(Self { steps })
    }

    pub fn write(&self, target: &Destination) -> Result<(), Refusal> {
        let data = provenance::add(json!({"commissioning": self.steps}), Map::new());
        let text = if target.ending() == "json" {
            format!("{data:#}\n")
        } else {
            self.page(data).to_html()
        };
        target.write_bytes(text.as_bytes())
    }

    fn page(&self, data: Json) -> Page {
        let cell = |value: &Json| match value {
            Json::Null => "-".to_string(),
            Json::String(text) => text.clone(),
            Json::Number(number) => number
                .as_f64()
                .map_or("-".into(), |number| crate::report::number(number, 4)),
            other => other.to_string(),
        };
        let readings = [
            ("state", "state"),
            ("fault", "fault"),
            ("target", "target"),
            ("enable input", "enable_input"),
            ("mean acceleration / m/s\u{b2}", "mean_acceleration"),
            ("b / mm", "b"),
            ("setpoint / mm", "setpoint_b"),
            ("k", "k"),
            ("output", "output"),
            ("in gear estimated", "in_gear_estimated"),
        ];
        let mut heads = vec!["step"];
        heads.extend(readings.map(|(name, _)| name));
        let row = |step: &Json| {
            let mut row = vec![cell(&step["step"])];
            row.extend(readings.map(|(_, key)| cell(&step["status"][key])));
            row
        };
        let rows: Vec<Vec<String>> = self.steps.iter().map(row).collect();
        let (changed, all) = self.settings(&cell);
        let setting_heads = ["key", "before", "after", "unit"];
        let about = format!(
            "{} steps, the settings before those of the first, after those of the last.",
            self.steps.len()
        );
        let settings = if changed.is_empty() {
            page::paragraphs(&["No setting differs between the first step and the last.".into()])
        } else {
            page::table(&setting_heads, &changed)
        } + "<details><summary>all settings</summary>\n"
            + &page::table(&setting_heads, &all)
            + "</details>\n";
        let settings = page::paragraphs(&[about]) + &settings;
        let mut page = Page::new("Record of a commissioning", data, FIGURES)
            .section("Settings that were changed", &settings)
            .section("Readings", &page::table(&heads, &rows));
        for (n, step) in self.steps.iter().enumerate() {
            let [time, image] = [&step["time_utc"], &step["image"]].map(cell);
            let mut lines = vec![format!("{time}, image {image}")];
            lines.extend(step["note"].as_str().map(String::from));
            page = page.section(
                &format!("Step {}: {}", n + 1, cell(&step["step"])),
                &(page::paragraphs(&lines)
                    + &page::figure(&format!("amplitude-{n}"), "Amplitude of the track over time, and setpoint of the target.")
                    + &page::figure(&format!("shares-{n}"), "Output of the drive as a share of the full one, and estimated share of time in gear.")),
            );
        }
        page
    }

    /// Settings before and after: the changed ones, and all.
    fn settings(&self, cell: &dyn Fn(&Json) -> String) -> (Vec<Vec<String>>, Vec<Vec<String>>) {
        let settings =
            |step: Option<&Json>| step.map_or(Json::Null, |step| step["settings"].clone());
        let [before, after] = [self.steps.first(), self.steps.last()].map(settings);
        let row = |key: &String| {
            let value = |settings: &Json| cell(&settings[key]["value"]);
            let unit = cell(&after[key]["unit"]);
            vec![key.clone(), value(&before), value(&after), unit]
        };
        let keys = after.as_object().into_iter().flat_map(Map::keys);
        let all: Vec<Vec<String>> = keys.map(row).collect();
        let changed = all.iter().filter(|row| row[1] != row[2]).cloned().collect();
        (changed, all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_grows_and_is_read_back_from_page_and_json() {
        let step = |gain: f64| {
            json!({"step": "a <b>", "note": null, "status": {"k": 0.41},
                "settings": {"gain": {"value": gain, "unit": "mm"}, "quality": {"value": 25.0, "unit": ""}}, "telemetry": []})
        };
        let mut record = Record::default();
        record.steps.extend([step(1.0), step(1.25)]);
        let data = json!({"commissioning": record.steps});
        let html = record.page(data.clone()).to_html();
        assert!(html.contains("<td>gain</td><td>1</td><td>1.25</td><td>mm</td>"));
        for text in [html, data.to_string()] {
            assert_eq!(Record::read(&text).unwrap().steps, record.steps);
        }
        for text in ["", "{}", "[1]", "<!doctype html>", "{\"commissioning\": 3}"] {
            assert!(Record::read(text).is_none(), "{text}");
        }
    }
}
