//! Settings from a measurement of the board, set by `--apply` or by hand.

use std::time::Duration;

use kband_control::wire::Request;

use super::drive::rest;
use super::kept;
use crate::board::{Address, BoardSettings, Emulated, Link};
use crate::desk::Desk;
use crate::refusal::Refusal;
use crate::report::{Field, Format, View, columns};

/// How a board is measured, and what is done with the settings that the measurement offers.
pub(super) struct Commissioning<'a> {
    pub address: &'a Address,
    pub apply: bool,
    pub within: Duration,
    pub format: Format,
    pub desk: &'a Desk,
}

impl Commissioning<'_> {
    /// The link to the board, whose drive runs, and its settings.
    pub fn open(&self) -> Result<(Link, BoardSettings), Refusal> {
        let mut link = self.address.open(Emulated::Running)?;
        let settings = BoardSettings::read(&mut link)?;
        Ok((link, settings))
    }

    /// Prints what was found with notes below it. With `--apply` it sets and saves the offered
    /// settings on the board, in this order; else it notes the commands to set them by hand.
    pub fn conclude<R>(
        &self,
        (mut link, mut settings): (Link, BoardSettings),
        offered: &[(&str, f32)],
        mut notes: Vec<String>,
        view: View<'_, R>,
        found: R,
    ) -> Result<(), Refusal> {
        if self.apply {
            rest(&mut link)?;
            let offered = offered.iter().map(|(key, value)| (key.to_string(), *value));
            let offered: Vec<_> = offered.collect();
            let taken = settings
                .change(&mut link, &offered)
                .and_then(|()| kept(&mut link, true, self.address));
            link.tell(&Request::Enable(true))?;
            notes.push(taken?);
        } else {
            let options = self.address.options();
            notes.push("nothing was changed; to set it, with the drive at rest:".into());
            notes.extend(offered.iter().enumerate().map(|(n, (key, value))| {
                let last = n + 1 == offered.len();
                let save = if last { " --save" } else { "" };
                format!("  kband settings set {key} {value}{save}{options}")
            }));
        }
        let applied = Field::json(columns::APPLIED, |_| self.apply);
        let view = view.and(View::of(vec![applied]));
        let found = [found];
        let report = view.printout(&found).notes(notes);
        report.json(&view.object(&found[0]))?.print(self.format)
    }
}
