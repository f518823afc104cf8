//! Settings proposed by a measurement on the board, set by `--apply` or by hand.

use std::time::Duration;

use kband_control::wire::Request;

use super::drive::rest;
use super::save_if_requested;
use crate::board::{Address, BoardSettings, Emulated, Link};
use crate::desk::Desk;
use crate::refusal::Refusal;
use crate::report::{Field, Format, View, columns};

/// Address of the board and time limit of a measurement, and whether to set the proposed settings.
pub(super) struct Commissioning<'a> {
    pub address: &'a Address,
    pub apply: bool,
    pub within: Duration,
    pub format: Format,
    pub desk: &'a Desk,
}

impl Commissioning<'_> {
    /// The link to the board, with a running drive, and the board's settings.
    pub fn open(&self) -> Result<(Link, BoardSettings), Refusal> {
        let mut link = self.address.open(Emulated::Running)?;
        let settings = BoardSettings::read(&mut link)?;
        Ok((link, settings))
    }

    /// Prints the result with notes. With `--apply` it sets and saves the proposed settings on the
    /// board, in this order; else it prints the commands for them.
    pub fn conclude<R>(
        &self,
        (mut link, mut settings): (Link, BoardSettings),
        offered: &[(&str, f32)],
        mut notes: Vec<String>,
        view: View<'_, R>,
        value: R,
    ) -> Result<(), Refusal> {
        if self.apply {
            rest(&mut link)?;
            let offered = offered.iter().map(|(key, value)| (key.to_string(), *value));
            let offered: Vec<_> = offered.collect();
            let result = settings
                .change(&mut link, &offered)
                .and_then(|()| save_if_requested(&mut link, true, self.address));
            link.command(&Request::Enable(true))?;
            notes.push(result?);
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
        let view = view.and(View::from_fields(vec![applied]));
        let value = [value];
        let report = view.printout(&value).notes(notes);
        report.json(&view.object(&value[0]))?.print(self.format)
    }
}
