//! Branches of the bifurcation diagram: the impacts of every column, from each kind of start.
//!
//! A column is a pair of k and restitution. A branch starts every column from rest, or at the final
//! state of the column before: continuation upwards or downwards. Bisection locates the columns
//! between which the period-1 orbits attract. Heights are velocities in `b w`, or phases in rad.

use std::collections::BTreeSet;
use std::f64::consts::{PI, TAU};

use kband::impact::{ContactTime, Impact, Observer, PartState, Scatter, StopReason};
use kband::regime::Lock;
use kband::regime::classify::Regime;
use serde::Serialize;

use super::column::{self, Impacts, Keep};
use super::over::Over;
use super::{Arguments, ColumnStart, Show};
use crate::desk::Desk;
use crate::ending::{self, Endings, Gears, InGear, TOGETHER};
use crate::picture::Fill;
use crate::refusal::Refusal;

impl Branch {
    /// Runs of neighbouring columns with one ending: first and last column.
    pub(super) fn regimes(&self) -> Vec<(usize, usize, Ending)> {
        let mut regimes: Vec<(usize, usize, Ending)> = Vec::new();
        for (n, column) in self.columns.iter().enumerate() {
            match regimes.last_mut() {
                Some((_, last, ending)) if ending.is_one_with(column.ending) => *last = n,
                _ => regimes.push((n, n, column.ending)),
            }
        }
        regimes
    }
}

/// The impacts of one start, column by column.
pub(super) struct Branch {
    pub(super) start: ColumnStart,
    pub(super) columns: Vec<Struck>,
}

/// The impacts of one column, and its ending.
pub(super) struct Struck {
    pub(super) impacts: Impacts,
    pub(super) ending: Ending,
    gear: Option<u32>,
}

/// How a column ends.
#[derive(Clone, Copy, Debug)]
pub(super) enum Ending {
    /// A regime, decided over a number of impacts.
    Regime(Regime, usize),
    /// Its restitution scatters, and it is in gear for a share of the time.
    InGear(Option<InGear>),
}

impl Ending {
    /// Whether neighbouring columns have one name: the same regime, or shares in gear that round to
    /// the same tenth.
    fn is_one_with(self, other: Self) -> bool {
        let tenth = |gear: InGear| (gear.order, (10.0 * gear.share).round() as u32);
        match (self, other) {
            (Self::Regime(one, _), Self::Regime(other, _)) => one == other,
            (Self::InGear(one), Self::InGear(other)) => one.map(tenth) == other.map(tenth),
            _ => false,
        }
    }

    pub(super) fn name(self) -> String {
        match self {
            Self::Regime(regime, impacts) => ending::describe_regime(regime, impacts),
            Self::InGear(Some(gear)) => {
                format!("in gear about {:.1}, r = {}", gear.share, gear.order)
            }
            Self::InGear(None) => "rests for ever".into(),
        }
    }

    /// Its fill; `None` with scattering restitution.
    pub(super) fn fill(self) -> Option<Fill> {
        match self {
            Self::Regime(regime, _) => Some(ending::fill(regime)),
            Self::InGear(_) => None,
        }
    }
}

/// The stretch of columns where the period-1 orbit of an order attracts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Stretch {
    pub(super) order: u32,
    pub(super) low: f64,
    pub(super) high: f64,
}

/// The columns to simulate.
pub(super) struct Flown<'a> {
    pub(super) arguments: &'a Arguments,
    /// k and restitution of each column.
    pub(super) tracks: &'a [(f64, f64)],
    pub(super) contact: ContactTime,
    pub(super) keep: Keep,
}

impl Flown<'_> {
    fn impacts(&self, states: Vec<PartState>, period: Option<usize>, count: usize) -> Impacts {
        let height = |state| height(self.arguments.show == Show::Velocity, state);
        Impacts::new(states, period, count, self.keep, height)
    }

    /// All branches. A followed branch is one task, because each column needs the one before it;
    /// from rest each column is a task.
    pub(super) fn follow(
        &self,
        starts: &[ColumnStart],
        desk: &Desk,
    ) -> Result<Vec<Branch>, Refusal> {
        let columns = self.tracks.len();
        let build = |(k, restitution): &(f64, f64)| Endings::seen(*k, *restitution, self.contact);
        let tracks: Vec<Endings> = self.tracks.iter().map(build).collect::<Result<_, _>>()?;
        let mut tasks: Vec<(ColumnStart, usize)> = Vec::new();
        for start in starts {
            match start {
                ColumnStart::Rest => tasks.extend((0..columns).map(|column| (*start, column))),
                ColumnStart::Up | ColumnStart::Down => tasks.push((*start, 0)),
            }
        }
        // Threads take tasks from both ends: the long tasks are there.
        tasks.sort_by_key(|(start, _)| match start {
            ColumnStart::Up => 0,
            ColumnStart::Rest => 1,
            ColumnStart::Down => 2,
        });
        let work = |task: usize| -> Result<Vec<Struck>, Refusal> {
            let (start, column) = tasks[task];
            let mut order: Vec<usize> = (0..columns).collect();
            match start {
                ColumnStart::Rest => order = vec![column],
                ColumnStart::Up => {}
                ColumnStart::Down => order.reverse(),
            }
            let mut flown = Vec::with_capacity(order.len());
            let mut state = None;
            for column in &order {
                desk.go_on()?;
                flown.push(self.column(start, *column, &tracks[*column], &mut state)?);
            }
            if start == ColumnStart::Down {
                flown.reverse();
            }
            Ok(flown)
        };
        let results = desk.try_map("diagram", tasks.len(), work)?;
        let none = |start: &ColumnStart| Branch {
            start: *start,
            columns: Vec::new(),
        };
        let mut branches: Vec<Branch> = starts.iter().map(none).collect();
        for ((start, _), columns) in tasks.iter().zip(results) {
            if let Some(branch) = branches.iter_mut().find(|branch| branch.start == *start) {
                branch.columns.extend(columns);
            }
        }
        self.separate_transients(&tracks, &mut branches, desk)?;
        Ok(branches)
    }

    /// Chaos in a gear that does not hold may be a transient. The gears are tried side by side.
    fn separate_transients(
        &self,
        tracks: &[Endings],
        branches: &mut [Branch],
        desk: &Desk,
    ) -> Result<(), Refusal> {
        let columns = branches
            .iter()
            .flat_map(|branch| branch.columns.iter().enumerate());
        let gears: BTreeSet<(usize, u32)> = columns
            .filter_map(|(column, struck)| Some((column, struck.gear?)))
            .collect();
        let gears: Vec<_> = gears.into_iter().collect();
        desk.spread("diagram", gears.len(), TOGETHER, |places| {
            ending::hold(tracks, &places.iter().map(|n| gears[*n]).collect());
            Ok(vec![(); places.len()])
        })?;
        for branch in branches {
            for (struck, track) in branch.columns.iter_mut().zip(tracks) {
                if let (Some(order), Ending::Regime(regime, _)) = (struck.gear, &mut struck.ending)
                    && !track.holds(order)
                {
                    *regime = Regime::Undecided;
                }
            }
        }
        Ok(())
    }

    fn column(
        &self,
        start: ColumnStart,
        column: usize,
        endings: &Endings,
        state: &mut Option<PartState>,
    ) -> Result<Struck, Refusal> {
        let Arguments {
            settle, impacts, ..
        } = *self.arguments;
        let restitution = endings.map().restitution();
        let stream = (column as u64) << 2 | start as u64;
        let scatter = self.arguments.scatter.stream(restitution, stream)?;
        if let Some(scatter) = scatter {
            return self.column_in_gear(endings, state, scatter);
        }
        let flown = column::flown(endings, state, settle, impacts);
        Ok(Struck {
            impacts: self.impacts(flown.states, flown.period, flown.count),
            ending: Ending::Regime(flown.regime, column::classified_impacts(settle, impacts)),
            gear: flown.gear,
        })
    }

    /// The impacts of one column whose restitution scatters, and their gear.
    fn column_in_gear(
        &self,
        endings: &Endings,
        state: &mut Option<PartState>,
        scatter: Scatter,
    ) -> Result<Struck, Refusal> {
        let (settle, impacts) = (self.arguments.settle, self.arguments.impacts);
        let mut orbit = endings.orbit(*state).scattering(scatter)?;
        let mut struck = Landings::default();
        let mut gears = Gears::watched()?;
        let mut ended = orbit.watch(settle as u64, &mut ());
        if ended != StopReason::RestsForEver {
            ended = orbit.watch(impacts as u64, &mut (&mut struck, &mut gears));
        }
        let rests = ended == StopReason::RestsForEver;
        *state = (!rests).then(|| orbit.state());
        let count = struck.0.len();
        Ok(Struck {
            impacts: self.impacts(struck.0, None, count),
            ending: Ending::InGear(gears.longest().filter(|_| !rests)),
            gear: None,
        })
    }
}

/// The states just after the impacts.
#[derive(Default)]
struct Landings(Vec<PartState>);

impl Observer for Landings {
    fn impact(&mut self, _: PartState, impact: &Impact<PartState>) {
        self.0.push(impact.next);
    }
}

/// Ordinate of a state in the diagram: velocity in `b w`, or phase in rad, -pi..pi.
pub(super) fn height(velocity: bool, state: PartState) -> f64 {
    match velocity {
        true => state.velocity,
        // Locked parts strike shortly after phase 0, chaotic ones on both sides of it.
        false if state.phase > PI => state.phase - TAU,
        false => state.phase,
    }
}

/// Stretches of columns in which the period-1 orbits of orders 1 to 5 attract.
///
/// Bisection between two columns locates each edge.
pub(super) fn bands(over: Over, contact: ContactTime, values: &[f64]) -> Vec<Stretch> {
    let mut bands = Vec::new();
    for order in 1..=5 {
        let attracts = |x: f64| {
            let (k, restitution) = over.at(x);
            Lock::with_contact(k, restitution, order, contact)
                .ok()
                .flatten()
                .is_some_and(|lock| lock.attracts() && lock.is_first_return())
        };
        let edge = |inside: f64, outside: f64| {
            let (mut inside, mut outside) = (inside, outside);
            for _ in 0..60 {
                let middle = 0.5 * (inside + outside);
                if attracts(middle) {
                    inside = middle
                } else {
                    outside = middle
                }
            }
            inside
        };
        let mut begun: Option<f64> = None;
        for (n, x) in values.iter().enumerate() {
            match (attracts(*x), begun) {
                (true, None) => begun = Some(if n == 0 { *x } else { edge(*x, values[n - 1]) }),
                (false, Some(low)) => {
                    let high = edge(values[n - 1], *x);
                    bands.push(Stretch { order, low, high });
                    begun = None;
                }
                _ => {}
            }
        }
        if let (Some(low), Some(high)) = (begun, values.last()) {
            bands.push(Stretch {
                order,
                low,
                high: *high,
            });
        }
    }
    bands
}
