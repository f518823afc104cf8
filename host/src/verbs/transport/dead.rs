//! The first-return map of dead parts (R and Rt to 0, equation 38) at one k.

use std::f64::consts::PI;

use kband::transport::{Inelastic, InelasticFlight};
use serde_json::json;

use super::{Arguments, Computed, Feeder};
use crate::desk::Desk;
use crate::picture::{Axis, Panel, Picture};
use crate::refusal::Refusal;
use crate::report::{fields, number};

const POINTS: usize = 2001;

/// Phase of launch, flight, and velocity along the track.
type Flown = (f64, InelasticFlight, f64);

fields! {
    /// The flights of a dead part.
    fn flights(flown: Flown) {
        all LAUNCH => flown.0;
        all NEXT_LAUNCH => flown.1.next;
        all FLIGHT => flown.1.flight;
        all LANDING => flown.1.landing;
        all REST => flown.1.wait;
        all VELOCITY => flown.2;
    }
}

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
    let settings = feeder.settings;
    let flown = desk.map("flights", POINTS, |n| {
        // From lift-off to where the track stops throwing, both ends left out by a hair.
        let part = (n as f64 + 0.5) / POINTS as f64;
        let launch = lift_off + (PI - 2.0 * lift_off) * part;
        let flight = dead.flight(launch)?;
        let (ratio, incline) = (settings.amplitude_ratio, settings.incline_tangent);
        let velocity = dead.velocity(flight.flight, ratio, incline);
        Some((launch, flight, velocity))
    })?;
    let flown: Vec<Flown> = flown.into_iter().flatten().collect();
    let line = |rests: bool| -> Vec<(f64, f64)> {
        let next = |flight: &InelasticFlight| match (flight.wait > 0.0) == rests {
            true => flight.next,
            false => f64::NAN,
        };
        let points = flown.iter();
        points
            .map(|(launch, flight, _)| (*launch, next(flight)))
            .collect()
    };
    let (straight, rested) = (line(false), line(true));
    let view = flights();
    let rows: Vec<_> = flown.iter().map(|flown| view.object(flown)).collect();
    let share = rested.iter().filter(|point| point.1.is_finite()).count() as f64
        / flown.len().max(1) as f64;
    let report = view
        .printout(&flown)
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
        let axis = |label: &str| Axis::new(label, "rad", lift_off - room, PI - lift_off + room);
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
