//! The map of kicks: share of a lot, 0..1, that each kick captures, by simulation.

use kband::regime::capture::{Kick, KickSettings, Plan};

use super::{Task, captures};
use crate::desk::Desk;
use crate::picture::{Axis, Grid, Panel, Picture};
use crate::refusal::Refusal;
use crate::report::number;

/// Share of the lot's parts that each kick captures, over factor and length.
pub(super) struct Kicks {
    pub(super) factors: Vec<f64>,
    /// Number of cycles of hold, or of descent after the hold in `slow`.
    pub(super) lengths: Vec<u16>,
    /// Shape of the kicks. `Some`: a hold of this length, then a descent; its end is this share of
    /// the range from the target to the factor.
    pub(super) slow: Option<(u16, f32)>,
    pub(super) shares: Vec<f64>,
}

pub(super) const LENGTH_COUNT: usize = 48;

impl Kicks {
    pub(super) fn draw(task: &Task<'_>, plan: &Plan, desk: &Desk) -> Result<Self, Refusal> {
        let best = plan.best().map_or(Kick::NONE, |best| best.kick).settings();
        let slow = (best.descent > 40).then(|| {
            let release_share = (best.release - 1.0) / (best.factor - 1.0);
            (best.hold, release_share)
        });
        let longest = task.arguments.longest.unwrap_or(match slow {
            Some(_) => (2 * usize::from(best.descent)).max(120),
            None => (10.0 * task.arguments.time_constant) as usize + LENGTH_COUNT / 4,
        });
        let factors: Vec<f64> = task.arguments.factor.values().collect();
        let lengths = (0..LENGTH_COUNT).map(|n| (n * longest / (LENGTH_COUNT - 1)) as u16);
        let mut map = Self {
            factors,
            lengths: lengths.collect(),
            slow,
            shares: Vec::new(),
        };
        let columns = map.lengths.len();
        map.shares = desk.try_map("capture map", map.factors.len() * columns, |cell| {
            let Ok(kick) = map.kick(cell) else {
                return Ok(0.0);
            };
            let mut locked = 0_u32;
            for part in 0..task.arguments.parts {
                locked += u32::from(captures(task.lot.part(part as u32), task.drive, kick)?);
            }
            Ok(f64::from(locked) / task.arguments.parts as f64)
        })?;
        Ok(map)
    }

    pub(super) fn kick(&self, cell: usize) -> Result<Kick, kband::feeder::OutOfRange> {
        let factor = self.factors[cell / self.lengths.len()] as f32;
        let length = self.lengths[cell % self.lengths.len()];
        Kick::build(match self.slow {
            None => KickSettings {
                factor,
                hold: length,
                descent: 0,
                release: 1.0,
            },
            Some((hold, release_share)) => KickSettings {
                factor,
                hold,
                descent: length,
                release: (1.0 + (factor - 1.0) * release_share).clamp(1.0, factor),
            },
        })
    }

    /// Every kick of the map with its captured share, except those beyond the drive's limit.
    pub(super) fn cells(&self) -> Vec<(KickSettings, f64)> {
        let cells = self.shares.iter().enumerate();
        let cell = |(cell, share): (usize, &f64)| Some((self.kick(cell).ok()?.settings(), *share));
        cells.filter_map(cell).collect()
    }

    pub(super) fn picture(&self, task: &Task<'_>, plan: &Plan) -> Picture {
        let span = |values: &[f64]| {
            let (first, last) = (values[0], values[values.len() - 1]);
            let half = 0.5 * (last - first) / (values.len().max(2) - 1) as f64;
            (first - half, last + half)
        };
        let lengths = self.lengths.iter().map(|length| f64::from(*length));
        let lengths: Vec<f64> = lengths.collect();
        let (left, right) = span(&lengths);
        let (bottom, top) = span(&self.factors);
        let is_slow = self.slow.is_some();
        let title = if is_slow {
            "descent of the amplitude"
        } else {
            "hold"
        };
        let mut panel = Panel::new(
            Axis::new(title, "drive cycles", left, right),
            Axis::new("factor of the amplitude", "", bottom, top),
        )
        .height(420.0)
        .heat(
            Grid::new(self.lengths.len(), self.shares.clone()),
            Axis::new("share of the parts captured", "", 0.0, 1.0),
        );
        let place = |kick: KickSettings| {
            let length = if is_slow { kick.descent } else { kick.hold };
            (f64::from(length), f64::from(kick.factor))
        };
        let planned = plan.best().map(|best| place(best.kick.settings()));
        if let Some((x, y)) = planned.filter(|(x, y)| *x <= right && *y <= top) {
            panel = panel.markers("planned as on the board", 1, vec![(x, y)]);
        }
        let shape = match self.slow {
            None => "rectangular kicks".to_string(),
            Some((hold, release_share)) => format!(
                "kicks held {hold} cycles, then falling to {:.0} % of the way down",
                100.0 * (1.0 - release_share)
            ),
        };
        Picture::new(format!("Kicks that capture parts in lock of order {}", task.lot.order))
            .caption(format!(
                "R = {}, k = {}, amplitude within {} %, time constant {} cycles; {shape}; {} parts each",
                task.restitution(),
                number(task.lot.k, 4),
                task.arguments.amplitude_error,
                task.arguments.time_constant,
                task.arguments.parts
            ))
            .panel(panel)
    }
}
