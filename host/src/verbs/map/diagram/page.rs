//! A diagram as table, CSV and picture.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

use kband::impact::{ContactTime, PartState};
use kband::regime::Lock;

use super::Arguments;
use super::branch::{Branch, Stretch};
use super::over::Over;
use crate::arguments::Range;
use crate::ending::FILLS;
use crate::picture::{Axis, Panel, Picture};
use crate::refusal::Refusal;
use crate::report::columns::{FROM, PHASE, REGIME, START, TO, VELOCITY};
use crate::report::{Printout, Rows, Table, number};

pub(super) struct Diagram {
    pub(super) over: Over,
    /// Parameters that are equal in every column, in words.
    pub(super) fixed: String,
    pub(super) contact: ContactTime,
    pub(super) range: Range,
    /// Whether velocities are drawn instead of phases.
    pub(super) velocity: bool,
    pub(super) values: Vec<f64>,
    pub(super) branches: Vec<Branch>,
    pub(super) bands: Vec<Stretch>,
}

impl Diagram {
    pub(super) fn report(self: &Arc<Self>) -> Result<Printout, Refusal> {
        let unit = self.over.column().unit;
        let mut table = Table::new(&[START, FROM.in_unit(unit), TO.in_unit(unit), REGIME]);
        let mut left_out = 0;
        let mut regimes = Vec::new();
        for branch in &self.branches {
            for (first, last, ending) in branch.regimes() {
                let (low, high) = (self.values[first], self.values[last]);
                regimes.push(serde_json::json!({
                    "start": branch.start.name(),
                    "from": low,
                    "to": high,
                    "regime": ending.name(),
                }));
                // Chaos contains many narrow windows; the text table leaves them out.
                if 100 * (last - first + 1) >= self.values.len() {
                    let start = branch.start.name();
                    table.push([start.into(), low.into(), high.into(), ending.name().into()]);
                } else {
                    left_out += 1;
                }
            }
        }
        let drawn = self.branches.iter().flat_map(|branch| &branch.columns);
        let drawn: usize = drawn.map(|column| column.states.len()).sum();
        let mut report = Printout::new(table).heading(format!(
            "Regimes over {} = {}..{} ({} columns), {}",
            self.over.column().name,
            number(self.range.low, 6),
            number(self.range.high, 6),
            self.range.count,
            self.fixed
        ));
        if left_out > 0 {
            report = report.note(format!(
                "{left_out} narrower stretches are left out here; --format json has them"
            ));
        }
        for band in &self.bands {
            let (order, [low, high]) = (band.order, [band.low, band.high].map(|x| number(x, 6)));
            report = report.note(format!(
                "the period-1 orbit of order {order} attracts from {low} to {high}"
            ));
        }
        let rows = Arc::clone(self);
        let impact_columns = [START, self.over.column(), PHASE, VELOCITY, REGIME];
        let count = format!("{drawn} impacts; --out FILE.svg draws them, FILE.csv lists them");
        report
            .note(count)
            .csv(&impact_columns, move |out| rows.impacts(out))
            .json(&serde_json::json!({
                "over": self.over.column().name,
                "bands": self.bands,
                "regimes": regimes,
            }))
    }

    fn impacts(&self, rows: &mut dyn Rows) -> Result<(), Refusal> {
        for branch in &self.branches {
            let start = branch.start.name();
            for (x, column) in self.values.iter().zip(&branch.columns) {
                for state in &column.states {
                    rows.row(&[
                        start.into(),
                        (*x).into(),
                        state.phase.into(),
                        state.velocity.into(),
                        column.ending.name().into(),
                    ])?;
                }
            }
        }
        Ok(())
    }

    /// Ordinate of a state: velocity in `b w`, or phase in rad, -pi..pi.
    fn height(&self, state: PartState) -> f64 {
        match self.velocity {
            true => state.velocity,
            // Locked parts strike shortly after phase 0, chaotic ones on both sides of it.
            false if state.phase > PI => state.phase - TAU,
            false => state.phase,
        }
    }

    pub(super) fn picture(&self, arguments: &Arguments) -> Picture {
        let columns = self.branches.iter().flat_map(|branch| &branch.columns);
        let states = columns.flat_map(|column| &column.states);
        let heights = states.map(|state| self.height(*state)).chain([0.0, 0.1]);
        let y_axis = if self.velocity {
            Axis::over_values("velocity ψ after impact", "b·ω", heights)
        } else if self.contact.is_instant() {
            Axis::over_values("impact phase t", "rad", heights).in_pi()
        } else {
            Axis::over_values("phase t after the contact", "rad", heights).in_pi()
        };
        let mut picture = Picture::new(format!(
            "Impact {} over {}",
            if self.velocity { "velocity" } else { "phase" },
            match self.over {
                Over::K { .. } => "k",
                Over::Amplitude { .. } => "amplitude",
                Over::Restitution { .. } => "restitution",
            }
        ))
        .caption(format!(
            "{}{}; {} impacts in each of {} columns, after {} to settle",
            self.fixed,
            match arguments.scatter.scatter {
                0.0 => String::new(),
                scatter => format!(", scattering by {scatter}"),
            },
            arguments.impacts,
            self.range.count,
            arguments.settle
        ));
        let mut names = Vec::new();
        for (fill, name) in FILLS {
            let mut columns = self.branches.iter().flat_map(|branch| &branch.columns);
            if columns.any(|column| column.ending.fill() == Some(fill)) {
                names.push((fill, name));
            }
        }
        for (place, branch) in self.branches.iter().enumerate() {
            let named = |name: &'static str| if place == 0 { name } else { "" };
            let heights = branch.columns.iter().map(|column| {
                let states = column.states.iter();
                states.map(|state| self.height(*state) as f32).collect()
            });
            let is_only = self.branches.len() == 1;
            let height = if is_only { 420.0 } else { 240.0 };
            let mut panel = Panel::new(self.over.axis(self.range), y_axis.clone())
                .heading(branch.start.describe())
                .height(height);
            let strip = named("band: the period-1 orbit attracts");
            for band in &self.bands {
                panel = panel.strip(strip, band.low, band.high);
            }
            panel = panel.columns(named("impacts, few to many"), heights.collect());
            let fills = self.values.iter().zip(&branch.columns);
            let fills = fills.filter_map(|(x, column)| Some((*x, column.ending.fill()?)));
            let names = if place == 0 { &*names } else { &[] };
            panel = panel.ribbon_of_points([self.range.low, self.range.high], fills, names);
            for order in 1..=5 {
                let [attracting, repelling] = self.period_one(order);
                panel = panel
                    .line(named("period-1 orbit, attracting"), 1, attracting)
                    .line(named("period-1 orbit, repelling"), 2, repelling);
            }
            for band in &self.bands {
                let middle = 0.5 * (band.low + band.high);
                panel = panel.caption(middle, format!("r = {}", band.order));
                for edge in [band.low, band.high] {
                    if self.range.low < edge && edge < self.range.high {
                        panel = panel.mark(edge, number(edge, 4));
                    }
                }
            }
            picture = picture.panel(panel);
        }
        picture
    }

    /// The period-1 branch of an order over the columns: its attracting part, and the repelling
    /// part below its flip.
    fn period_one(&self, order: u32) -> [Vec<(f64, f64)>; 2] {
        if !self.bands.iter().any(|band| band.order == order) {
            return [Vec::new(), Vec::new()];
        }
        let on = |filter: &dyn Fn(&Lock) -> bool| {
            let point = |x: f64| {
                let (k, restitution) = self.over.at(x);
                let lock = Lock::with_contact(k, restitution, order, self.contact).ok();
                let lock = lock.flatten();
                let stable = lock.filter(|lock| lock.is_first_return() && filter(lock));
                let y = stable.map_or(f64::NAN, |lock| self.height(lock.state()));
                (x, y)
            };
            self.values.iter().map(|x| point(*x)).collect::<Vec<_>>()
        };
        let below_flip = |lock: &Lock| !lock.attracts() && lock.state().phase < FRAC_PI_2;
        [on(&Lock::attracts), on(&below_flip)]
    }
}
