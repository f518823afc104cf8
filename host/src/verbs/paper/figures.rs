//! The figures of the paper, drawn from the map: the model, a motion, and the regimes over k.

use std::f64::consts::{PI, TAU};

use kband::impact::{Kernel, Map, Orbit, OrbitEvent, PartState, Tangential, TangentialSettings};
use kband::regime::{Lock, band};

use crate::desk::Desk;
use crate::picture::{Axis, Panel, Picture, Unit};
use crate::refusal::Refusal;
use crate::report::number;

/// The track of Figs. 1 and 2: the built-in feeder's.
const TRACK: TangentialSettings = TangentialSettings {
    restitution: 0.3,
    amplitude_ratio: 1.5,
    phase_lead: 0.0,
    incline_tangent: 0.052_407_779_283_041_2,
};

/// One moment of a part, in units of b along the track and normal to it, in the laboratory.
#[derive(Clone, Copy)]
struct Moment {
    time: f64,
    along: f64,
    normal: f64,
    track: f64,
}

/// A part on its way: moments of some flights, and the times at which it strikes.
struct Way {
    k: f64,
    moments: Vec<Moment>,
    impacts: Vec<f64>,
}

/// `flights` flights of a part near the lock in the middle of the first band, let settle from
/// `apart` of its phase.
fn way(restitution: f64, apart: f64, flights: usize) -> Result<Way, Refusal> {
    const STEPS: u32 = 60;
    let k = 0.5 * (band::flip(restitution, 1)? + band::birth(restitution, 1)?);
    let map = Map::build(k, restitution)?;
    let tangential = Tangential::build(k, TRACK)?;
    let lock = Lock::at(k, restitution, 1)?.map(|lock| lock.state());
    let PartState { phase, velocity } = lock.unwrap_or(PartState {
        phase: 0.5,
        velocity: 0.5,
    });
    let mut launch = Map::state(phase + apart, velocity)?;
    let eta = TRACK.amplitude_ratio;
    let (mut clock, mut along, mut phi) = (launch.phase, 0.0, 0.0);
    let mut found = Way {
        k,
        moments: Vec::new(),
        impacts: vec![clock],
    };
    for _ in 0..flights {
        let impact = map.impact(launch);
        let (t, d) = (launch.phase, impact.flight);
        for step in 0..=STEPS {
            let s = d * f64::from(step) / f64::from(STEPS);
            let ridden = |t: f64, s: f64| (t + s).sin() - t.sin();
            let lift = (t.cos() + launch.velocity) * s - 0.5 * k * s * s;
            let drift = (phi + eta * t.cos()) * s - 0.5 * k * TRACK.incline_tangent * s * s;
            found.moments.push(Moment {
                time: clock + s,
                along: along + eta * t.sin() + drift,
                normal: t.sin() + lift,
                track: t.sin() + ridden(t, s),
            });
        }
        along += tangential.distance(launch, &impact, phi);
        phi = tangential.after(launch, &impact, phi);
        clock += d;
        found.impacts.push(clock);
        launch = impact.next;
    }
    Ok(found)
}

/// Fig. 1: the model. The track at the ends of its stroke, the stroke, and the path of a part, in
/// the laboratory.
pub(super) fn model(restitution: f64) -> Result<Picture, Refusal> {
    let way = way(restitution, 0.0, 4)?;
    let slope = TRACK.incline_tangent.atan();
    // From along and normal to the track to horizontal and vertical.
    let turned = |along: f64, normal: f64| {
        (
            along * slope.cos() - normal * slope.sin(),
            along * slope.sin() + normal * slope.cos(),
        )
    };
    let path: Vec<_> = way
        .moments
        .iter()
        .map(|moment| turned(moment.along, moment.normal))
        .collect();
    let far = path.last().map_or(10.0, |end| end.0) + 3.0;
    let top = path.iter().map(|point| point.1).fold(1.0, f64::max);
    let eta = TRACK.amplitude_ratio;
    let surface = |normal: f64| vec![turned(-3.0, normal), turned(far, normal)];
    let stroke = (0..=60).map(|n| {
        let tau = TAU * f64::from(n) / 60.0;
        turned(eta * (tau + TRACK.phase_lead).sin(), tau.sin())
    });
    let panel = Panel::new(
        Axis::new("horizontal, in b", Unit::NONE, -3.5, far + 0.5),
        Axis::new("vertical, in b", Unit::NONE, -2.0, top + 1.5),
    )
    .height(380.0)
    .line("track at the ends of its stroke", 1, surface(-1.0))
    .line("track at the ends of its stroke", 1, surface(1.0))
    .line(
        "stroke: a sin(ωt+γ) along, b sin ωt normal",
        2,
        stroke.collect(),
    )
    .line("part, in free flight between impacts", 0, path)
    .note(
        0.5 * far,
        top + 0.8,
        "gravity g straight down; α is the slope of the track",
    );
    Ok(Picture::new("The model (Fig. 1)")
        .caption(format!(
            "R = {}, k = {}, η = {}, γ = 0, α = {}°: a locked part over four flights, seen from the laboratory",
            number(restitution, 4),
            number(way.k, 4),
            number(eta, 3),
            number(slope.to_degrees(), 3)
        ))
        .panel(panel))
}

/// Fig. 2: the motion in time. Track and part, the times of impact and the flights between them.
pub(super) fn motion(restitution: f64) -> Result<Picture, Refusal> {
    let way = way(restitution, 0.4, 6)?;
    let of = |value: fn(&Moment) -> f64| -> Vec<(f64, f64)> {
        way.moments
            .iter()
            .map(|moment| (moment.time, value(moment)))
            .collect()
    };
    let (track, part) = (of(|m| m.track), of(|m| m.normal));
    let height = of(|m| m.normal - m.track);
    let (first, last) = (way.impacts[0], way.impacts[way.impacts.len() - 1]);
    let top = |points: &[(f64, f64)]| points.iter().map(|point| point.1).fold(1.0, f64::max);
    let axis = || Axis::new("τ = ω t", Unit::RADIANS, first - 0.5, last + 0.5).in_pi();
    let mut above = Panel::new(
        axis(),
        Axis::new(
            "normal to the track, in b",
            Unit::NONE,
            -1.3,
            top(&part) + 0.4,
        ),
    )
    .height(260.0)
    .line("track, sin τ", 1, track)
    .line("part", 0, part);
    for (n, time) in way.impacts.iter().enumerate() {
        above = above.caption(*time, format!("τ{n}"));
    }
    let below = Panel::new(
        axis(),
        Axis::new("u, in b", Unit::NONE, -0.1, top(&height) + 0.3),
    )
    .height(180.0)
    .line("height above the track, equation (7b)", 0, height)
    .markers(
        "impacts, where u = 0",
        2,
        way.impacts.iter().map(|time| (*time, 0.0)).collect(),
    );
    Ok(Picture::new("A motion (Fig. 2)")
        .caption(format!(
            "R = {}, k = {}: a part thrown 0.4 rad beside the lock; each impact follows from the one before by (8) and (9)",
            number(restitution, 4),
            number(way.k, 4)
        ))
        .panel(above)
        .panel(below))
}

/// Fig. 3: phases of impact over k, with the bands.
pub(super) fn regimes(restitution: f64, desk: &Desk) -> Result<Picture, Refusal> {
    const COLUMNS: usize = 840;
    let (low, high) = (0.05, 1.1 * band::birth(restitution, 1)?);
    let columns = desk.try_map("Fig. 3", COLUMNS, |column| -> Result<Columns, Refusal> {
        let k = low + (high - low) * (column as f64 + 0.5) / COLUMNS as f64;
        let map = Map::build(k, restitution)?;
        let mut starts = vec![None];
        for order in 1..=3 {
            // Below its band an orbit of the cascade or of the chaos behind it is met from the
            // lock's phase. A little beside it, or the unstable orbit itself would be drawn.
            starts.extend(Lock::at(k, restitution, order)?.map(|lock| {
                let PartState { phase, velocity } = lock.state();
                Some(PartState {
                    phase: phase + 1e-3,
                    velocity,
                })
            }));
        }
        let mut found = Columns::default();
        for start in starts {
            let (rests, phases) = settled(&map, start);
            let place = if rests {
                &mut found.resting
            } else {
                &mut found.hopping
            };
            place.extend(phases.into_iter().map(|phase| (k, phase)));
        }
        Ok(found)
    })?;
    let mut panel = Panel::new(
        Axis::new("k = g cos α / (b ω²)", Unit::NONE, low, high),
        Axis::new("phase of impact", Unit::RADIANS, -0.5 * PI, 1.5 * PI).in_pi(),
    )
    .height(460.0);
    for order in 1..=3 {
        let (flip, birth) = (
            band::flip(restitution, order)?,
            band::birth(restitution, order)?,
        );
        if flip > low {
            panel = panel
                .strip("stable period 1", flip, birth)
                .caption(0.5 * (flip + birth), format!("r={order}"));
        }
    }
    let points = |of: fn(&Columns) -> &Vec<(f64, f64)>| -> Vec<(f64, f64)> {
        columns.iter().flat_map(of).copied().collect()
    };
    let resting = points(|found| &found.resting);
    let hopping = points(|found| &found.hopping);
    let shown = panel
        .clone()
        .heading("Parts that hop and never rest")
        .density("impacts", hopping);
    let rested = panel
        .heading("Parts that come to rest: impacts between two rests, chatter left out")
        .density("impacts", resting);
    Ok(Picture::new("Regimes over k (Fig. 3)")
        .caption(format!(
            "R = {}, from rest and from the locks r = 1, 2, 3",
            number(restitution, 4)
        ))
        .panel(shown)
        .panel(rested))
}

#[derive(Default)]
struct Columns {
    hopping: Vec<(f64, f64)>,
    resting: Vec<(f64, f64)>,
}

/// Whether the settled orbit from `start` (else from rest) rests, and the phases at which it
/// strikes.
fn settled(map: &Map, start: Option<PartState>) -> (bool, Vec<f64>) {
    let mut orbit = match start {
        Some(state) => Orbit::new(map, state),
        None => Orbit::from_rest(map),
    };
    orbit.watch(1500, &mut ());
    let (mut rests, mut phases) = (false, Vec::new());
    for event in orbit.take(160) {
        match event {
            // The last hops of a chatter all strike at the phase of rest.
            OrbitEvent::Impact(impact) if impact.next.velocity > 1e-3 => {
                let phase = impact.next.phase;
                phases.push(if phase > 1.5 * PI { phase - TAU } else { phase });
            }
            OrbitEvent::Impact(_) => {}
            OrbitEvent::Rest { .. } | OrbitEvent::LiftOff { .. } => rests = true,
        }
    }
    (rests, phases)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drawn_part_strikes_the_track_it_is_drawn_over() {
        for restitution in [0.05, 0.2, 0.5, 0.95] {
            let way = way(restitution, 0.05, 6).unwrap();
            assert_eq!(way.impacts.len(), 7);
            for moment in &way.moments {
                assert!(moment.normal > moment.track - 1e-12);
                if way.impacts.contains(&moment.time) {
                    assert!((moment.normal - moment.track).abs() < 1e-9);
                }
            }
            // No step of the path where flights meet.
            for pair in way.moments.windows(2) {
                assert!((pair[1].along - pair[0].along).abs() < 0.5, "{restitution}");
            }
        }
    }
}
