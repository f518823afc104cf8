//! The first-return map of dead parts (R and Rt to 0, equation 38) at one k.

use std::f64::consts::PI;

use kband::transport::Inelastic;
use serde_json::json;

use super::{Arguments, Computed, Feeder};
use crate::desk::Desk;
use crate::picture::{Axis, Panel, Picture, Unit};
use crate::refusal::Refusal;
use crate::report::{Printout, Table, columns, number};

const POINTS: usize = 2001;

pub(super) fn computed(
    feeder: Feeder,
    arguments: &Arguments,
    desk: &Desk,
) -> Result<Computed, Refusal> {
    let k = feeder.single_k(arguments)?;
    let dead = Inelastic::build(k)?;
    let Some(lift_off) = dead.lift_off() else {
        return Err(Refusal::value(
            "k",
            number(k, 6),
            "below 1: above it the track never throws a dead part",
            "give a smaller k",
        ));
    };
    let flights = desk.map("flights", POINTS, |n| {
        // From lift-off to where the track stops throwing, both ends left out by a hair.
        let part = (n as f64 + 0.5) / POINTS as f64;
        let launch = lift_off + (PI - 2.0 * lift_off) * part;
        dead.flight(launch).map(|flight| (launch, flight))
    })?;
    let mut table = Table::new(&[
        columns::LAUNCH,
        columns::NEXT_LAUNCH,
        columns::FLIGHT,
        columns::LANDING,
        columns::REST,
        columns::VELOCITY,
    ]);
    let settings = feeder.settings;
    let mut rows = Vec::new();
    let (mut straight, mut rested) = (Vec::new(), Vec::new());
    for (launch, flight) in flights.iter().flatten() {
        let velocity = dead.velocity(
            flight.flight,
            settings.amplitude_ratio,
            settings.incline_tangent,
        );
        table.push([
            (*launch).into(),
            flight.next.into(),
            flight.flight.into(),
            flight.landing.into(),
            flight.wait.into(),
            velocity.into(),
        ]);
        rows.push(json!({
            "launch": launch, "next_launch": flight.next, "flight": flight.flight,
            "landing": flight.landing, "rest": flight.wait, "velocity": velocity,
        }));
        let missing = (*launch, f64::NAN);
        let point = (*launch, flight.next);
        straight.push(if flight.wait > 0.0 { missing } else { point });
        rested.push(if flight.wait > 0.0 { point } else { missing });
    }
    let share =
        rested.iter().filter(|point| point.1.is_finite()).count() as f64 / rows.len().max(1) as f64;
    let report = Printout::new(table)
        .heading(format!(
            "First-return map of dead parts at k = {}",
            number(k, 6)
        ))
        .note(format!(
            "{:.1} % of the launch phases lead to a rest, and so to arcsin k = {} rad",
            100.0 * share,
            number(lift_off, 6)
        ))
        .json(&json!({ "k": k, "lift_off": lift_off, "rest_share": share, "rows": rows }))?;
    let picture = move || {
        let room = 0.03 * (PI - 2.0 * lift_off);
        let axis =
            |label: &str| Axis::new(label, Unit::RADIANS, lift_off - room, PI - lift_off + room);
        let panel = Panel::new(axis("phase of launch"), axis("phase of the next launch"))
            .height(560.0)
            .line(
                "next launch = launch",
                6,
                vec![(lift_off, lift_off), (PI - lift_off, PI - lift_off)],
            )
            .line(
                "lands where the track throws: flies on at once",
                0,
                straight,
            )
            .line("lands, rests, is thrown off at arcsin k", 1, rested);
        Picture::new("First-return map of dead parts (R, Rt → 0)")
            .caption(format!("k = {}", number(k, 6)))
            .width(720.0)
            .panel(panel)
    };
    Ok((report, Box::new(picture)))
}
