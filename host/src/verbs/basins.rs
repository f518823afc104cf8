//! `kband basins`: which start ends in which regime.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::sync::Arc;

use kband::impact::{Event, Kernel, Map, Orbit, State};
use kband::regime::Lock;
use kband::regime::lock::HIGHEST_ORDER;
use serde_json::json;

use crate::arguments::{self, Drawn, Printed};
use crate::desk::Desk;
use crate::picture::{Axis, Grid, Panel, Picture, Tone, Unit};
use crate::refusal::{Exit, Refusal};
use crate::report::{Column, Report, Table, number};

/// Which regime a part ends in, by the phase and velocity it starts with.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband basins --k 0.43 --restitution 0.2
  kband basins --k 0.43 --restitution 0.2 --grid 400 --out basins.png
  kband basins --k 0.7 --restitution 0.5 --velocity 4 --out basins.csv

The table says how many starts end in each regime; CSV has a row for each start.")]
pub struct Arguments {
    /// k = g cos(alpha) / (b w^2).
    #[arg(long, value_parser = arguments::within(0.001, 1000.0, ""))]
    k: f64,

    /// Restitution of the part.
    #[arg(long, value_name = "R", value_parser = arguments::within(0.0, 0.999, ""))]
    restitution: f64,

    /// Starts along each side of the grid.
    #[arg(long, value_name = "N", default_value = "200", value_parser = arguments::count(2, 4000))]
    grid: usize,

    /// Velocity at the upper edge of the grid, units of b w.
    #[arg(long, value_name = "PSI", default_value = "3", value_parser = arguments::within(1e-6, 1000.0, "b w"))]
    velocity: f64,

    /// Impacts after which a start that has not settled counts as undecided.
    #[arg(long, value_name = "N", default_value = "6000", value_parser = arguments::count(10, 10_000_000))]
    impacts: usize,

    #[command(flatten)]
    printed: Printed,

    #[command(flatten)]
    drawn: Drawn,
}

/// Where a start ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum End {
    /// One impact every so many drive cycles.
    Locked(u32),
    /// Another orbit that repeats after so many impacts.
    Periodic(u32),
    HopAndRest,
    Rest,
    Undecided,
}

impl End {
    fn name(self) -> String {
        match self {
            Self::Locked(order) => format!("locked, r = {order}"),
            Self::Periodic(impacts) => format!("periodic, {impacts} impacts"),
            Self::HopAndRest => "hops, rests, is thrown again".into(),
            Self::Rest => "rests for ever".into(),
            Self::Undecided => "chaotic or undecided".into(),
        }
    }

    fn tone(self) -> Tone {
        match self {
            Self::Locked(1) => Tone::Locked,
            Self::Locked(_) => Tone::Doubled,
            Self::Periodic(_) => Tone::Periodic,
            Self::HopAndRest => Tone::HopAndRest,
            Self::Rest => Tone::Rest,
            Self::Undecided => Tone::Chaotic,
        }
    }
}

/// The track, and what is known of it before any start is followed.
struct Basins {
    map: Map,
    /// The attracting period-1 orbits, by order from 1 on.
    locks: Vec<Option<Lock>>,
    /// Where a part thrown off from rest ends: every part that rests once shares it, as nothing of its
    /// past is left.
    after_rest: End,
    impacts: usize,
}

impl Basins {
    fn new(k: f64, restitution: f64, impacts: usize) -> Result<Self, Refusal> {
        let map = Map::build(k, restitution)?;
        let mut locks = Vec::new();
        for order in 1..=HIGHEST_ORDER {
            let Some(lock) = Lock::at(k, restitution, order)? else {
                break;
            };
            locks.push(Some(lock).filter(|lock| lock.attracts() && lock.is_first_return()));
        }
        let mut basins = Self {
            map,
            locks,
            after_rest: if k < 1.0 { End::HopAndRest } else { End::Rest },
            impacts,
        };
        if k < 1.0 {
            basins.after_rest = basins.follow(Orbit::from_rest(&map));
        }
        Ok(basins)
    }

    fn end(&self, start: State) -> End {
        self.follow(Orbit::new(&self.map, start))
    }

    /// Follows the orbit until it is known where it ends.
    fn follow(&self, orbit: Orbit<'_>) -> End {
        let (mut count, mut kept_at, mut keep_next) = (0, 0, 16);
        let mut kept: Option<State> = None;
        let mut returned: Option<usize> = None;
        for event in orbit {
            let impact = match event {
                Event::Impact(impact) => impact,
                Event::Rest { .. } => return self.after_rest,
                Event::LiftOff { .. } => continue,
            };
            count += 1;
            if count >= self.impacts {
                break;
            }
            let state = impact.next;
            let order = (impact.flight / TAU).round() as usize;
            if let Some(Some(lock)) = order.checked_sub(1).and_then(|n| self.locks.get(n))
                && lock.distance(state) < 1e-5
            {
                return End::Locked(lock.order());
            }
            // A state that comes back twice, to the last bits, after the same number of impacts repeats;
            // once can happen by chance in chaos. The state kept moves on at powers of two, so that it
            // leaves the transient behind (Brent).
            if kept.is_some_and(|kept| near(kept, state)) {
                match returned {
                    None => returned = Some(count - kept_at),
                    Some(period) if count - kept_at == 2 * period => {
                        return End::Periodic(period as u32);
                    }
                    Some(_) => {}
                }
            }
            if count == keep_next {
                (kept, kept_at, keep_next) = (Some(state), count, 2 * keep_next);
                returned = None;
            }
        }
        End::Undecided
    }
}

fn near(a: State, b: State) -> bool {
    let apart = (a.phase - b.phase).abs();
    apart.min(TAU - apart).max((a.velocity - b.velocity).abs()) < 1e-9
}

/// Draws the basins.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let output = arguments.drawn.output()?;
    let basins = Basins::new(arguments.k, arguments.restitution, arguments.impacts)?;
    let side = arguments.grid;
    // The starts are the middles of the cells.
    let phase = move |column: usize| TAU * (column as f64 + 0.5) / side as f64;
    let top = arguments.velocity;
    let velocity = move |row: usize| top * (row as f64 + 0.5) / side as f64;
    Map::state(0.0, top)?;
    let rows = desk.map("basins", side, |row| {
        (0..side)
            .map(|column| {
                basins.end(State {
                    phase: phase(column),
                    velocity: velocity(row),
                })
            })
            .collect::<Vec<_>>()
    })?;
    let ends: Arc<[End]> = rows.into_iter().flatten().collect();
    let mut counts: BTreeMap<End, usize> = BTreeMap::new();
    for end in ends.iter() {
        *counts.entry(*end).or_default() += 1;
    }
    let share = |count: usize| count as f64 / ends.len() as f64;
    let mut table = Table::new(&[
        Column::new("regime", ""),
        Column::new("share", "%").digits(4),
        Column::new("starts", ""),
    ]);
    for (end, count) in &counts {
        table.push([end.name().into(), (100.0 * share(*count)).into(), (*count).into()]);
    }
    let shares: Vec<_> = counts
        .iter()
        .map(|(end, count)| json!({"regime": end.name(), "share": share(*count), "starts": count}))
        .collect();
    let listed = Arc::clone(&ends);
    let report = Report::new(table)
        .heading(format!(
            "Where parts end at k = {}, R = {}: {side} x {side} starts, phase 0..2 pi, velocity 0..{} b w",
            number(arguments.k, 6),
            number(arguments.restitution, 6),
            number(top, 6)
        ))
        .note(format!("A part that starts from rest: {}", basins.after_rest.name()))
        .json(&json!({
            "k": arguments.k,
            "restitution": arguments.restitution,
            "shares": shares,
            "from_rest": basins.after_rest.name(),
        }))?
        .csv(move |out| {
            writeln!(out, "phase (rad),velocity (b w),regime")?;
            for (n, end) in listed.iter().enumerate() {
                let (phase, velocity) = (phase(n % side), velocity(n / side));
                writeln!(
                    out,
                    "{},{},\"{}\"",
                    number(phase, 17),
                    number(velocity, 17),
                    end.name()
                )?;
            }
            Ok(())
        });
    report.print(arguments.printed.format)?;
    output.write(&report, || picture(arguments, &basins, &ends, &counts))?;
    Ok(Exit::Done)
}

fn picture(
    arguments: &Arguments,
    basins: &Basins,
    ends: &[End],
    counts: &BTreeMap<End, usize>,
) -> Picture {
    // Regimes that share a tone share a line of the legend.
    let mut legend: Vec<(Tone, String, usize)> = Vec::new();
    for (end, count) in counts {
        match legend.iter_mut().find(|(tone, ..)| *tone == end.tone()) {
            Some((_, name, sum)) => {
                *sum += count;
                *name = if end.tone() == Tone::Periodic {
                    "periodic otherwise".into()
                } else {
                    "locked, r > 1".into()
                };
            }
            None => legend.push((end.tone(), end.name(), *count)),
        }
    }
    let words: Vec<(Tone, String)> = legend
        .into_iter()
        .map(|(tone, name, count)| {
            let share = 100.0 * count as f64 / ends.len() as f64;
            (tone, format!("{name}: {share:.1} %"))
        })
        .collect();
    let names: Vec<(Tone, &str)> =
        words.iter().map(|(tone, name)| (*tone, name.as_str())).collect();
    let tones = ends.iter().map(|end| end.tone()).collect();
    let locks = basins
        .locks
        .iter()
        .flatten()
        .map(Lock::state)
        .filter(|state| state.velocity <= arguments.velocity)
        .map(|state| (state.phase, state.velocity))
        .collect();
    let panel = Panel::new(
        Axis::new("phase t of the drive at the start", Unit::RADIANS, 0.0, TAU).in_pi(),
        Axis::new("velocity ψ at the start", Unit::VELOCITY, 0.0, arguments.velocity),
    )
    .height(560.0)
    .classes(Grid::new(arguments.grid, tones), &names)
    .markers("the locked orbit", 1, locks);
    Picture::new("Where a part ends, by how it starts").width(780.0).panel(panel).caption(format!(
        "k = {}, R = {}; {} × {} starts, up to {} impacts each",
        number(arguments.k, 6),
        number(arguments.restitution, 6),
        arguments.grid,
        arguments.grid,
        arguments.impacts
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shares(k: f64, restitution: f64) -> BTreeMap<End, f64> {
        let basins = Basins::new(k, restitution, 2000).unwrap();
        let mut shares = BTreeMap::new();
        for row in 0..40 {
            for column in 0..40 {
                let start = State {
                    phase: TAU * (f64::from(column) + 0.5) / 40.0,
                    velocity: 3.0 * (f64::from(row) + 0.5) / 40.0,
                };
                *shares.entry(basins.end(start)).or_default() += 1.0 / 1600.0;
            }
        }
        shares
    }

    #[test]
    fn shares_of_the_reference_case() {
        // Physics, section 7: 33 % lock, 64 % rest and relaunch, 3 % otherwise. Another placing of the
        // 40 x 40 starts moves the shares by the cells on the basin's edge, about 2 %.
        let shares = shares(0.43, 0.2);
        assert!((shares[&End::Locked(1)] - 0.33).abs() < 0.02, "{shares:?}");
        assert!((shares[&End::HopAndRest] - 0.64).abs() < 0.02, "{shares:?}");
    }

    #[test]
    fn below_0_4117_rest_leads_to_the_lock() {
        let shares = shares(0.405, 0.2);
        assert!(shares[&End::Locked(1)] > 0.95, "{shares:?}");
    }

    #[test]
    fn above_1_a_part_rests_for_ever_or_locks() {
        // Physics, section 11: k = 1.2, R = 0.8 locks.
        let shares = shares(1.2, 0.8);
        assert!(shares[&End::Rest] > 0.1 && shares[&End::Locked(1)] > 0.05, "{shares:?}");
        assert!(!shares.contains_key(&End::HopAndRest));
    }
}
