//! Settings from a measurement of the board, set by `--apply` or by hand.

use serde::Serialize;

use kband_control::wire::Request;

use super::drive::rest;
use super::kept;
use crate::board::{Address, BoardSettings, Link};
use crate::refusal::Refusal;
use crate::report::{Format, Printout, Table};

/// Settings from a measurement, in an order that the board accepts.
pub(super) struct Offer {
    pub keys: Vec<&'static str>,
    pub values: Vec<f32>,
}

impl Offer {
    /// With `apply` sets and saves them on the board. Returns a message with the result, or with
    /// the commands to set them by hand.
    pub fn conclude(
        &self,
        link: &mut Link,
        settings: &mut BoardSettings,
        address: &Address,
        apply: bool,
    ) -> Result<Vec<String>, Refusal> {
        let pairs = self.keys.iter().zip(&self.values);
        if !apply {
            let options = address.options();
            let mut notes = vec!["nothing was changed; to take it, with the drive at rest:".into()];
            notes.extend(pairs.enumerate().map(|(n, (key, value))| {
                let last = n + 1 == self.keys.len();
                let save = if last { " --save" } else { "" };
                format!("  kband settings set {key} {value}{save}{options}")
            }));
            return Ok(notes);
        }
        rest(link)?;
        let offered: Vec<_> = pairs
            .map(|(key, value)| (key.to_string(), *value))
            .collect();
        let taken = settings
            .change(link, &offered)
            .and_then(|()| kept(link, true, address));
        link.tell(&Request::Enable(true))?;
        Ok(vec![taken?])
    }
}

/// Prints the measurement, with notes below it.
pub(super) fn print(
    table: Table,
    notes: &[String],
    json: &impl Serialize,
    format: Format,
) -> Result<(), Refusal> {
    Printout::new(table).notes(notes).json(json)?.print(format)
}
