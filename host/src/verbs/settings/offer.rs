//! What a measurement of the board offers as settings: taken by the board, or by hand.

use serde::Serialize;

use kband::wire::Request;

use super::drive::rest;
use super::kept;
use crate::board::{Address, BoardSettings, Link};
use crate::refusal::Refusal;
use crate::report::{Format, Printout, Table};

/// Two settings that a measurement offers, in an order in which the board takes them.
pub(super) struct Offer {
    pub keys: [&'static str; 2],
    pub values: [f32; 2],
}

impl Offer {
    /// With `apply` has the board take and keep them; what became of them, or how to take them by
    /// hand.
    pub fn conclude(
        &self,
        link: &mut Link,
        settings: &mut BoardSettings,
        address: &Address,
        apply: bool,
    ) -> Result<Vec<String>, Refusal> {
        let [first, second] = self.keys;
        let [a, b] = self.values;
        if !apply {
            let options = address.options();
            return Ok(vec![
                "nothing was changed; to take it, with the drive at rest:".into(),
                format!("  kband settings set {first} {a}{options}"),
                format!("  kband settings set {second} {b} --save{options}"),
            ]);
        }
        rest(link)?;
        let taken = settings
            .change(link, &[(first.to_string(), a), (second.to_string(), b)])
            .and_then(|()| kept(link, true, address));
        link.tell(&Request::Enable(true))?;
        Ok(vec![taken?])
    }
}

/// Prints what was measured, with notes below it.
pub(super) fn print(
    table: Table,
    notes: &[String],
    json: &impl Serialize,
    format: Format,
) -> Result<(), Refusal> {
    notes
        .iter()
        .fold(Printout::new(table), |printout, note| {
            printout.note(note.as_str())
        })
        .json(json)?
        .print(format)
}
