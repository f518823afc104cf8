//! Branches of the bifurcation diagram: the impacts of every column, from each kind of start.
//!
//! A column is a pair of k and restitution. A branch starts every column from rest, or at the final
//! state of the column before: continuation upwards or downwards. Bisection locates the columns
//! between which the period-1 orbits attract. Heights are velocities in `b w`, or phases in rad.

use kband::impact::{ContactTime, Kernel, Map, Observer, Orbit, OrbitEvent, PartState};
use kband::regime::Lock;
use kband::regime::classify::Regime;
use serde::Serialize;

use super::{Arguments, ColumnStart, Over};
use crate::desk::Desk;
use crate::ending::{self, Endings, Gears, InGear, MAX_ORBIT_IMPACTS};
use crate::picture::Fill;
use crate::refusal::Result;

/// Number of ordinates that a picture keeps, 32 MiB. Those of a larger one are computed again, which
/// takes 1.2 to 1.6 times as long.
const MAX_KEPT_ORDINATES: usize = 8 << 20;

/// Largest number of events in a period that is recognized, to bound memory.
const MAX_PERIOD_EVENTS: usize = 4096;

pub(super) struct Branch {
    pub(super) start: ColumnStart,
    pub(super) columns: Vec<Column>,
}

impl Branch {
    /// Stretches of columns with the same ending: first and last column.
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

pub(super) struct Column {
    /// Start of the part; `None` from rest.
    pub(super) from: Option<PartState>,
    /// Number of impacts drawn.
    pub(super) count: usize,
    /// Their lowest and highest ordinate.
    pub(super) span: [f64; 2],
    /// Their ordinates, for a picture of at most [`MAX_KEPT_ORDINATES`]; else empty.
    pub(super) ordinates: Vec<f32>,
    pub(super) ending: Ending,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Ending {
    Regime(Regime),
    /// Share of time in gear, for restitution that scatters.
    InGear(Option<InGear>),
}

impl Ending {
    /// Whether neighbouring columns have the same name: one regime, or shares in gear that round to
    /// the same tenth.
    fn is_one_with(self, other: Self) -> bool {
        let tenth = |gear: InGear| (gear.order, (10.0 * gear.share).round() as u32);
        match (self, other) {
            (Self::Regime(one), Self::Regime(other)) => one == other,
            (Self::InGear(one), Self::InGear(other)) => one.map(tenth) == other.map(tenth),
            _ => false,
        }
    }

    pub(super) fn name(self) -> String {
        match self {
            Self::Regime(regime) => ending::describe_regime(regime, MAX_ORBIT_IMPACTS),
            Self::InGear(Some(gear)) => {
                format!("in gear about {:.1}, r = {}", gear.share, gear.order)
            }
            Self::InGear(None) => "rests for ever".into(),
        }
    }

    /// Fill of the regime; `None` with scatter.
    pub(super) fn fill(self) -> Option<Fill> {
        match self {
            Self::Regime(regime) => Some(ending::fill(regime)),
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

/// All branches over columns of k and restitution.
///
/// A followed branch is one task, because each column needs the one before. From rest, each column
/// is a task.
pub(super) fn follow(
    arguments: &Arguments,
    tracks: &[(f64, f64)],
    contact: ContactTime,
    starts: &[ColumnStart],
    draws: bool,
    desk: &Desk,
) -> Result<Vec<Branch>> {
    let columns = 0..tracks.len();
    let all = arguments.impacts * tracks.len() * starts.len();
    let keeps = draws && all <= MAX_KEPT_ORDINATES;
    let mut tasks: Vec<(ColumnStart, Vec<usize>)> = Vec::new();
    for &start in starts {
        match start {
            ColumnStart::Rest => tasks.extend(columns.clone().map(|column| (start, vec![column]))),
            ColumnStart::Up => tasks.push((start, columns.clone().collect())),
            ColumnStart::Down => tasks.push((start, columns.clone().rev().collect())),
        }
    }
    // Threads take tasks from both ends of the list, where the long tasks are.
    tasks.sort_by_key(|(start, _)| match start {
        ColumnStart::Up => 0,
        ColumnStart::Rest => 1,
        ColumnStart::Down => 2,
    });
    let results = desk.try_map("diagram", tasks.len(), |task| -> Result<_> {
        let (start, order) = &tasks[task];
        let mut state = None;
        let simulate = |&column: &usize| {
            desk.check_stop()?;
            let (from, stream) = (state, stream(*start, column));
            let (mut count, mut span) = (0, [f64::INFINITY, f64::NEG_INFINITY]);
            let mut ordinates = Vec::with_capacity(if keeps { arguments.impacts } else { 0 });
            let add = |impact: PartState| {
                let y = arguments.show.ordinate(impact);
                count += 1;
                span = [span[0].min(y), span[1].max(y)];
                ordinates.extend(keeps.then_some(y as f32));
            };
            let ending;
            (state, ending) = simulate(arguments, tracks[column], contact, stream, from, add)?;
            Ok(Column {
                from,
                count,
                span,
                ordinates,
                ending,
            })
        };
        let simulated = order.iter().map(simulate);
        let mut simulated = simulated.collect::<Result<Vec<Column>>>()?;
        if *start == ColumnStart::Down {
            simulated.reverse();
        }
        Ok((*start, simulated))
    })?;
    let none = |start: &ColumnStart| Branch {
        start: *start,
        columns: Vec::new(),
    };
    let mut branches: Vec<Branch> = starts.iter().map(none).collect();
    for (start, columns) in results {
        if let Some(branch) = branches.iter_mut().find(|branch| branch.start == start) {
            branch.columns.extend(columns);
        }
    }
    // With scatter there is no final regime.
    if arguments.scatter.scatter == 0.0 {
        classify(tracks, contact, &mut branches, desk)?;
    }
    Ok(branches)
}

fn classify(
    tracks: &[(f64, f64)],
    contact: ContactTime,
    branches: &mut [Branch],
    desk: &Desk,
) -> Result<()> {
    let columns = tracks.len();
    let endings = desk.spread("regimes", columns, |places| {
        let group: Vec<_> = places.iter().map(|n| tracks[*n]).collect();
        Endings::from_tracks(&group, MAX_ORBIT_IMPACTS, contact)
    })?;
    // The orbits of all branches share blocks: a full block has the lowest cost per orbit.
    let mut hopping: Vec<(&mut Column, usize, PartState)> = Vec::new();
    for branch in branches {
        for (n, column) in branch.columns.iter_mut().enumerate() {
            match column.from {
                Some(from) => hopping.push((column, n, from)),
                None => column.ending = Ending::Regime(endings[n].from_rest()),
            }
        }
    }
    let starts: Vec<_> = hopping.iter().map(|(_, n, from)| (*n, *from)).collect();
    let ends = desk.spread("regimes", starts.len(), |places| {
        let starts: Vec<_> = places.iter().map(|place| starts[*place]).collect();
        Ok(ending::of_each(&endings, starts.into_iter()))
    })?;
    for ((column, ..), end) in hopping.into_iter().zip(ends) {
        column.ending = Ending::Regime(end);
    }
    Ok(())
}

/// Number of the random stream of a column.
pub(super) fn stream(start: ColumnStart, column: usize) -> u64 {
    (column as u64) << 2 | start as u64
}

/// Simulates the impacts of one column of k and restitution; `from` is `None` for a start from
/// rest. Passes the state after each impact that is drawn to `draw`. Returns the final state, `None`
/// after a rest without end, and the ending.
pub(super) fn simulate(
    arguments: &Arguments,
    (k, restitution): (f64, f64),
    contact: ContactTime,
    stream: u64,
    from: Option<PartState>,
    mut draw: impl FnMut(PartState),
) -> Result<(Option<PartState>, Ending)> {
    let map = Map::build(k, restitution)?;
    let mut orbit = match from {
        Some(from) => Orbit::new(&map, from),
        None => Orbit::from_rest(&map),
    }
    .with_contact(contact);
    if let Some(scatter) = arguments.scatter.stream(restitution, stream)? {
        orbit = orbit.scattering(scatter)?;
    }
    let total = arguments.settle + arguments.impacts;
    let (mut count, mut last) = (0, from);
    // Without scatter the classifier decides the ending.
    let scatters = arguments.scatter.scatter > 0.0;
    let mut gears = scatters.then(Gears::start_now).transpose()?;
    let mut take = |before: PartState, event: OrbitEvent| {
        let is_settled = count >= arguments.settle;
        if let OrbitEvent::Impact(impact) = event {
            count += 1;
            last = Some(impact.next);
            if is_settled {
                draw(impact.next);
            }
        }
        if let Some(gears) = gears.as_mut().filter(|_| is_settled) {
            match event {
                OrbitEvent::Impact(impact) => gears.impact(before, &impact),
                OrbitEvent::Rest { chatter, phase } => gears.rest(before, chatter, phase),
                OrbitEvent::LiftOff { wait, phase } => gears.lift_off(wait, phase),
            }
        }
        count
    };
    // Without scatter, an orbit is periodic once a state returns with all its bits (Brent's
    // method).
    let (mut saved, mut save_next, mut since) = (None, 16, Vec::new());
    let mut done = 0;
    while done < total
        && let before = orbit.state()
        && let Some(event) = orbit.next()
    {
        done = take(before, event);
        if scatters {
            continue;
        }
        if saved.is_some() {
            since.push((before, event));
        }
        if since.len() > MAX_PERIOD_EVENTS {
            saved = None;
            since.clear();
        }
        if let OrbitEvent::Impact(impact) = event {
            if saved == Some(impact.next) {
                for (before, event) in since.iter().cycle() {
                    if done == total {
                        break;
                    }
                    done = take(*before, *event);
                }
            } else if done >= save_next {
                saved = Some(impact.next);
                save_next = 2 * done;
                since.clear();
            }
        }
    }
    let hops = count == total;
    let ending = Ending::InGear(gears.and_then(|gears| gears.longest()).filter(|_| hops));
    Ok((last.filter(|_| hops), ending))
}

/// Stretches of columns in which the period-1 orbits of orders 1 to 5 attract.
///
/// Bisection between two columns locates each edge.
pub(super) fn bands(over: Over, contact: ContactTime, values: &[f64]) -> Vec<Stretch> {
    let mut bands = Vec::new();
    for order in 1..=5 {
        let attracts = |x: f64| {
            let (k, restitution) = over.at(x);
            let lock = Lock::with_contact(k, restitution, order, contact).ok();
            let is_stable = |lock: Lock| lock.attracts() && lock.is_first_return();
            lock.flatten().is_some_and(is_stable)
        };
        let edge = |mut inside: f64, mut outside: f64| {
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
        let mut start: Option<f64> = None;
        for (n, x) in values.iter().enumerate() {
            match (attracts(*x), start) {
                (true, None) => start = Some(if n == 0 { *x } else { edge(*x, values[n - 1]) }),
                (false, Some(low)) => {
                    let high = edge(values[n - 1], *x);
                    bands.push(Stretch { order, low, high });
                    start = None;
                }
                _ => {}
            }
        }
        if let (Some(low), Some(&high)) = (start, values.last()) {
            bands.push(Stretch { order, low, high });
        }
    }
    bands
}
