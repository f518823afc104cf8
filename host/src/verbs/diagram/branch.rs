//! The impacts of every column, and where along the columns period 1 attracts.

use kband::impact::{Ended, Impact, Map, Observer, Orbit, OrbitEvent, PartState, Scatter};
use kband::regime::Lock;
use kband::regime::classify::Regime;
use serde::Serialize;

use super::over::Over;
use super::{Arguments, ColumnStart};
use crate::desk::Desk;
use crate::ending::{self, Endings, FOLLOWED, Gears, InGear};
use crate::picture::Fill;
use crate::refusal::Refusal;

impl Branch {
    /// The stretches of one ending, as first and last column.
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

/// The impacts of one column, and what they are part of.
#[derive(Clone)]
pub(super) struct Struck {
    pub(super) impacts: Vec<PartState>,
    pub(super) ending: Ending,
}

/// What a column is.
#[derive(Clone, Copy, Debug)]
pub(super) enum Ending {
    /// It ends in a regime.
    Regime(Regime),
    /// Its restitution scatters, and it is in gear for a share of the time.
    InGear(Option<InGear>),
}

impl Ending {
    /// Whether a column beside another is named with it: of one regime, or in gear within the same tenth.
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
            Self::Regime(regime) => ending::told(regime, FOLLOWED),
            Self::InGear(Some(gear)) => {
                format!("in gear about {:.1}, r = {}", gear.share, gear.order)
            }
            Self::InGear(None) => "rests for ever".into(),
        }
    }

    /// Its fill; what scatters has none.
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

/// All branches: a followed one is one task, as each column needs the one before it; those from rest
/// are a task each column.
pub(super) fn follow(
    arguments: &Arguments,
    starts: &[ColumnStart],
    maps: &[Map],
    desk: &Desk,
) -> Result<Vec<Branch>, Refusal> {
    let (settle, impacts) = (arguments.settle, arguments.impacts);
    let mut tasks: Vec<(ColumnStart, usize)> = Vec::new();
    for start in starts {
        if *start != ColumnStart::Rest {
            tasks.push((*start, 0));
        }
    }
    if starts.contains(&ColumnStart::Rest) {
        tasks.extend((0..maps.len()).map(|column| (ColumnStart::Rest, column)));
    }
    // What scatters has no ending.
    let constant = if arguments.scatter.scatter == 0.0 {
        maps.len()
    } else {
        0
    };
    let endings: Vec<Endings> = maps[..constant]
        .iter()
        .map(|map| Endings::new(map.k(), map.restitution(), FOLLOWED))
        .collect::<Result<_, _>>()?;
    let one = |start: ColumnStart, column: usize, state: &mut Option<PartState>| {
        let map = &maps[column];
        let stream = (column as u64) << 2 | start as u64;
        let scatter = arguments.scatter.stream(map.restitution(), stream)?;
        let Some(endings) = endings.get(column) else {
            return column_in_gear(map, state, settle, impacts, scatter);
        };
        let impacts = column_of(map, state, settle, impacts);
        // Where it ends is asked of its start; a branch that is followed starts where the one before it ended.
        let followed = state.filter(|_| start != ColumnStart::Rest);
        let ending = followed.map_or(endings.from_rest(), |state| endings.of(state));
        let ending = Ending::Regime(ending);
        Ok::<_, Refusal>(Struck { impacts, ending })
    };
    let work = |task: usize| -> Result<Vec<Struck>, Refusal> {
        let (start, column) = tasks[task];
        let mut order: Vec<usize> = (0..maps.len()).collect();
        match start {
            ColumnStart::Rest => return Ok(vec![one(start, column, &mut None)?]),
            ColumnStart::Up => {}
            ColumnStart::Down => order.reverse(),
        }
        let mut columns = Vec::with_capacity(maps.len());
        let mut state = None;
        for column in &order {
            desk.go_on()?;
            columns.push(one(start, *column, &mut state)?);
        }
        if start == ColumnStart::Down {
            columns.reverse();
        }
        Ok(columns)
    };
    let results = desk.try_map("diagram", tasks.len(), work)?;
    let mut branches: Vec<Branch> = starts
        .iter()
        .map(|start| Branch {
            start: *start,
            columns: Vec::new(),
        })
        .collect();
    for ((start, _), columns) in tasks.iter().zip(results) {
        if let Some(branch) = branches.iter_mut().find(|branch| branch.start == *start) {
            branch.columns.extend(columns);
        }
    }
    Ok(branches)
}

/// The impacts of one column whose restitution scatters, as [`column_of`] has them, and in which gear they are.
fn column_in_gear(
    map: &Map,
    state: &mut Option<PartState>,
    settle: usize,
    impacts: usize,
    scatter: Option<Scatter>,
) -> Result<Struck, Refusal> {
    let mut orbit = match *state {
        Some(state) => Orbit::new(map, state),
        None => Orbit::from_rest(map),
    };
    if let Some(scatter) = scatter {
        orbit = orbit.scattering(scatter)?;
    }
    let mut struck = Landings::default();
    let mut gears = Gears::watched()?;
    let mut ended = orbit.watch(settle as u64, &mut ());
    if ended != Ended::RestsForEver {
        ended = orbit.watch(impacts as u64, &mut (&mut struck, &mut gears));
    }
    let rests = ended == Ended::RestsForEver;
    *state = (!rests).then(|| orbit.state());
    Ok(Struck {
        impacts: struck.0,
        ending: Ending::InGear(gears.longest().filter(|_| !rests)),
    })
}

/// The states just after the impacts.
#[derive(Default)]
struct Landings(Vec<PartState>);

impl Observer for Landings {
    fn impact(&mut self, _: PartState, impact: &Impact<PartState>) {
        self.0.push(impact.next);
    }
}

/// The impacts of one column after `settle` others, from `state` or from rest where it is `None`;
/// `state` is left where they end, `None` where the part rests for ever.
pub(super) fn column_of(
    map: &Map,
    state: &mut Option<PartState>,
    settle: usize,
    impacts: usize,
) -> Vec<PartState> {
    let orbit = match *state {
        Some(state) => Orbit::new(map, state),
        None => Orbit::from_rest(map),
    };
    let mut struck = Vec::with_capacity(impacts);
    let mut count = 0;
    for event in orbit {
        if let OrbitEvent::Impact(impact) = event {
            count += 1;
            if count > settle {
                struck.push(impact.next);
            }
            if count >= settle + impacts {
                *state = Some(impact.next);
                return struck;
            }
        }
    }
    *state = None;
    struck
}

/// Where along the columns the period-1 orbits of the first orders attract, each edge located by
/// bisection between two columns.
pub(super) fn bands(over: Over, values: &[f64]) -> Vec<Stretch> {
    let mut bands = Vec::new();
    for order in 1..=5 {
        let attracts = |x: f64| {
            let (k, restitution) = over.at(x);
            Lock::at(k, restitution, order)
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
