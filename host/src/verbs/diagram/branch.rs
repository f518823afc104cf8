//! Branches of the bifurcation diagram: the impacts of every column, from each kind of start.
//!
//! A column is a pair of k and restitution. A branch starts every column from rest, or at the final
//! state of the column before: continuation upwards or downwards. Bisection locates the columns
//! between which the period-1 orbits attract. Heights are velocities in `b w`, or phases in rad.

use std::f64::consts::{PI, TAU};

use kband::impact::{ContactTime, Kernel, Map, Observer, Orbit, OrbitEvent, PartState};
use kband::regime::Lock;
use kband::regime::classify::Regime;
use serde::Serialize;

use super::over::Over;
use super::{Arguments, ColumnStart};
use crate::desk::Desk;
use crate::ending::{self, Endings, FOLLOWED, Gears, InGear, TOGETHER};
use crate::picture::Fill;
use crate::refusal::Refusal;

/// The impacts of one start, column by column.
pub(super) struct Branch {
    pub(super) start: ColumnStart,
    pub(super) columns: Vec<Column>,
}

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

/// The impacts of one column, and its ending.
pub(super) struct Column {
    /// Where its part starts; `None` from rest.
    from: Option<PartState>,
    /// The states after the impacts that are drawn.
    pub(super) states: Vec<PartState>,
    pub(super) ending: Ending,
}

/// How a column ends.
#[derive(Clone, Copy, Debug)]
pub(super) enum Ending {
    /// A regime.
    Regime(Regime),
    /// Its restitution scatters, and it is in gear for a share of the time.
    InGear(Option<InGear>),
}

impl Ending {
    /// Whether neighbouring columns have one name: the same regime, or shares in gear that round to
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
            Self::Regime(regime) => ending::describe_regime(regime, FOLLOWED),
            Self::InGear(Some(gear)) => {
                format!("in gear about {:.1}, r = {}", gear.share, gear.order)
            }
            Self::InGear(None) => "rests for ever".into(),
        }
    }

    /// Its fill; `None` with scattering restitution.
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
/// A followed branch is one task, because each column needs the one before it; from rest each
/// column is a task.
pub(super) fn follow(
    arguments: &Arguments,
    tracks: &[(f64, f64)],
    contact: ContactTime,
    starts: &[ColumnStart],
    desk: &Desk,
) -> Result<Vec<Branch>, Refusal> {
    let columns = tracks.len();
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
    let results = desk.try_map("diagram", tasks.len(), |task| -> Result<_, Refusal> {
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
            let stream = (*column as u64) << 2 | start as u64;
            flown.push(fly(
                arguments,
                tracks[*column],
                contact,
                stream,
                &mut state,
            )?);
        }
        if start == ColumnStart::Down {
            flown.reverse();
        }
        Ok(flown)
    })?;
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
    // What scatters has no final regime.
    if arguments.scatter.scatter == 0.0 {
        classify(tracks, contact, &mut branches, desk)?;
    }
    Ok(branches)
}

/// Decides the final regimes of all columns.
fn classify(
    tracks: &[(f64, f64)],
    contact: ContactTime,
    branches: &mut [Branch],
    desk: &Desk,
) -> Result<(), Refusal> {
    let columns = tracks.len();
    let endings = desk.spread("regimes", columns, TOGETHER, |places| {
        let of: Vec<_> = places.iter().map(|n| tracks[*n]).collect();
        Endings::of_tracks(&of, FOLLOWED, contact)
    })?;
    // The orbits of all branches fly together: a full block costs the least per orbit.
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
    let ends = desk.spread("regimes", starts.len(), TOGETHER, |places| {
        let starts: Vec<_> = places.iter().map(|place| starts[*place]).collect();
        Ok(ending::of_each(&endings, starts.into_iter()))
    })?;
    for ((column, ..), end) in hopping.into_iter().zip(ends) {
        column.ending = Ending::Regime(end);
    }
    Ok(())
}

/// Simulates the impacts of one column of k and restitution from `state`, or from rest for `None`.
/// The final state replaces `state`, `None` after a rest for ever.
fn fly(
    arguments: &Arguments,
    (k, restitution): (f64, f64),
    contact: ContactTime,
    stream: u64,
    state: &mut Option<PartState>,
) -> Result<Column, Refusal> {
    let map = Map::build(k, restitution)?;
    let from = *state;
    let mut orbit = match from {
        Some(from) => Orbit::new(&map, from),
        None => Orbit::from_rest(&map),
    }
    .with_contact(contact);
    if let Some(scatter) = arguments.scatter.stream(restitution, stream)? {
        orbit = orbit.scattering(scatter)?;
    }
    let total = arguments.settle + arguments.impacts;
    let (mut states, mut count, mut last) = (Vec::new(), 0, from);
    // Without scatter a regime is the ending, which the classifier decides.
    let scatters = arguments.scatter.scatter > 0.0;
    let mut gears = scatters.then(Gears::watched).transpose()?;
    let mut take = |before: PartState, event: OrbitEvent| {
        count += usize::from(matches!(event, OrbitEvent::Impact(_)));
        match event {
            OrbitEvent::Impact(impact) => {
                last = Some(impact.next);
                if count > arguments.settle {
                    states.push(impact.next);
                    if let Some(gears) = &mut gears {
                        gears.impact(before, &impact);
                    }
                }
            }
            OrbitEvent::Rest { chatter, phase } => {
                if let Some(gears) = gears.as_mut().filter(|_| count >= arguments.settle) {
                    gears.rest(before, chatter, phase);
                }
            }
            OrbitEvent::LiftOff { wait, phase } => {
                if let Some(gears) = gears.as_mut().filter(|_| count >= arguments.settle) {
                    gears.lift_off(wait, phase);
                }
            }
        }
        count
    };
    // An orbit without scatter that returns to the bits of a state repeats itself (Brent's method).
    let (mut kept, mut keep_next, mut since) = (None, 16, Vec::new());
    let mut done = 0;
    while done < total
        && let before = orbit.state()
        && let Some(event) = orbit.next()
    {
        done = take(before, event);
        if scatters {
            continue;
        }
        since.push((before, event));
        if let OrbitEvent::Impact(impact) = event {
            if kept == Some(impact.next) {
                for (before, event) in since.iter().cycle() {
                    if done == total {
                        break;
                    }
                    done = take(*before, *event);
                }
            } else if done >= keep_next {
                kept = Some(impact.next);
                keep_next = 2 * done;
                since.clear();
            }
        }
    }
    let hops = count == total;
    *state = last.filter(|_| hops);
    Ok(Column {
        from,
        states,
        ending: Ending::InGear(gears.and_then(|gears| gears.longest()).filter(|_| hops)),
    })
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
