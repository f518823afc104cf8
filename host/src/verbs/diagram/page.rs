//! A diagram as table, CSV and picture.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

use kband::impact::PartState;
use kband::regime::Lock;

use super::Arguments;
use super::branch::{Branch, Stretch, height};
use super::over::Over;
use crate::arguments::Range;
use crate::ending::FILLS;
use crate::picture::{Axis, Fill, Panel, Picture};
use crate::refusal::Refusal;
use crate::report::{Printout, Rows, Table, columns, number};

pub(super) struct Diagram {
    pub(super) over: Over,
    pub(super) range: Range,
    /// Whether velocities are drawn, else phases.
    pub(super) velocity: bool,
    pub(super) values: Vec<f64>,
    pub(super) branches: Vec<Branch>,
    pub(super) bands: Vec<Stretch>,
}

impl Diagram {
    pub(super) fn report(self: &Arc<Self>) -> Result<Printout, Refusal> {
        let mut table = Table::new(&[
            columns::START,
            columns::FROM.in_unit(self.over.column().unit()),
            columns::TO.in_unit(self.over.column().unit()),
            columns::REGIME,
        ]);
        let mut left_out = 0;
        let mut listed = Vec::new();
        for branch in &self.branches {
            for (first, last, ending) in branch.regimes() {
                let (low, high) = (self.values[first], self.values[last]);
                listed.push(serde_json::json!({
                    "start": branch.start,
                    "from": low,
                    "to": high,
                    "regime": ending.name(),
                }));
                // Chaos is full of narrow windows; the table to read shows what is wider than them.
                if 100 * (last - first + 1) >= self.values.len() {
                    let start = branch.start.name();
                    table.push([start.into(), low.into(), high.into(), ending.name().into()]);
                } else {
                    left_out += 1;
                }
            }
        }
        let drawn: usize = self
            .branches
            .iter()
            .flat_map(|branch| &branch.columns)
            .map(|column| column.states.len())
            .sum();
        let mut report = Printout::new(table).heading(format!(
            "Regimes over {} = {}..{} ({} columns), {}",
            self.over.column().name(),
            number(self.range.low, 6),
            number(self.range.high, 6),
            self.range.count,
            self.over.fixed()
        ));
        if left_out > 0 {
            report = report.note(format!(
                "{left_out} narrower stretches are left out here; --format json has them"
            ));
        }
        for band in &self.bands {
            report = report.note(format!(
                "the period-1 orbit of order {} attracts from {} to {}",
                band.order,
                number(band.low, 6),
                number(band.high, 6)
            ));
        }
        let rows = Arc::clone(self);
        report
            .note(format!(
                "{drawn} impacts; --out FILE.svg draws them, FILE.csv lists them"
            ))
            .csv(
                &[
                    columns::START,
                    self.over.column(),
                    columns::PHASE,
                    columns::VELOCITY,
                    columns::REGIME,
                ],
                move |out| rows.impacts(out),
            )
            .json(&serde_json::json!({
                "over": self.over.column().name(),
                "bands": self.bands,
                "regimes": listed,
            }))
    }

    /// Every impact that is drawn.
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

    pub(super) fn shown(&self, state: PartState) -> f64 {
        height(self.velocity, state)
    }

    pub(super) fn picture(&self, arguments: &Arguments) -> Picture {
        let columns = self.branches.iter().flat_map(|branch| &branch.columns);
        let states = columns.flat_map(|column| &column.states);
        let (low, high) = states.fold((0.0, 0.1), |(low, high): (f64, f64), state| {
            let y = self.shown(*state);
            (low.min(y), high.max(y))
        });
        let room = 0.05 * (high - low);
        let y_axis = if self.velocity {
            Axis::new("velocity ψ after impact", "b·ω", 0.0, high + room)
        } else {
            Axis::new(
                "impact phase t",
                "rad",
                (low - room).max(-PI),
                (high + room).min(PI),
            )
            .in_pi()
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
            self.over.fixed(),
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
            // One legend serves all panels.
            let named = |name: &'static str| if place == 0 { name } else { "" };
            let heights = branch.columns.iter().map(|column| {
                let states = column.states.iter();
                states.map(|state| self.shown(*state) as f32).collect()
            });
            let mut panel = Panel::new(self.over.axis(self.range), y_axis.clone())
                .heading(branch.start.words())
                .height(if self.branches.len() == 1 {
                    420.0
                } else {
                    240.0
                });
            for band in &self.bands {
                panel = panel.strip(
                    named("band: the period-1 orbit attracts"),
                    band.low,
                    band.high,
                );
            }
            panel = panel.columns(named("impacts, few to many"), heights.collect());
            if !names.is_empty() {
                panel = panel.ribbon(self.ribbon(branch), if place == 0 { &names } else { &[] });
            }
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

    /// The regimes of a branch as a ribbon, each column as wide as the next.
    pub(super) fn ribbon(&self, branch: &Branch) -> Vec<(f64, f64, Fill)> {
        let half = 0.5 * (self.range.high - self.range.low) / (self.values.len() - 1) as f64;
        let mut ribbon: Vec<(f64, f64, Fill)> = Vec::new();
        for (first, last, ending) in branch.regimes() {
            let (low, high) = (self.values[first] - half, self.values[last] + half);
            let Some(found) = ending.fill() else {
                continue;
            };
            match ribbon.last_mut() {
                Some((_, end, fill)) if *fill == found => *end = high,
                _ => ribbon.push((low, high, found)),
            }
        }
        ribbon
    }

    /// The period-1 branch of an order over the columns: where it attracts, and where it repels
    /// below its flip.
    pub(super) fn period_one(&self, order: u32) -> [Vec<(f64, f64)>; 2] {
        if !self.bands.iter().any(|band| band.order == order) {
            return [Vec::new(), Vec::new()];
        }
        let on = |keep: &dyn Fn(&Lock) -> bool| {
            let point = |x: f64| {
                let (k, restitution) = self.over.at(x);
                let lock = Lock::build(k, restitution, order).ok().flatten();
                let shown = lock.filter(|lock| lock.is_first_return() && keep(lock));
                let y = shown.map_or(f64::NAN, |lock| self.shown(lock.state()));
                (x, y)
            };
            self.values.iter().map(|x| point(*x)).collect::<Vec<_>>()
        };
        let below_flip = |lock: &Lock| !lock.attracts() && lock.state().phase < FRAC_PI_2;
        [on(&Lock::attracts), on(&below_flip)]
    }
}
