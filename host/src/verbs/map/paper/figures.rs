//! Figures of the paper, computed from the map: the model and a motion.

use std::f64::consts::TAU;

use kband::impact::{Kernel, Map, PartState, Tangential, TangentialSettings};
use kband::regime::band;

use super::lock::lock;
use crate::picture::{Axis, Panel, Picture};
use crate::refusal::Result;
use crate::report::number;

/// The track of Figs. 1 and 2: that of the default feeder.
const TRACK: TangentialSettings = TangentialSettings {
    restitution: 0.3,
    amplitude_ratio: 1.5,
    phase_lead: 0.0,
    incline_tangent: 0.052_407_779_283_041_2,
};

struct Trajectory {
    k: f64,
    /// Time, position along and normal to the track, and height of the track.
    moments: Vec<[f64; 4]>,
    impacts: Vec<f64>,
}

impl Trajectory {
    fn points(&self, point: impl Fn(&[f64; 4]) -> (f64, f64)) -> Vec<(f64, f64)> {
        self.moments.iter().map(point).collect()
    }
}

/// Path of `flights` flights near the lock in the middle of the first band, with an initial phase
/// error of `phase_offset`.
fn trajectory(restitution: f64, phase_offset: f64, flights: usize) -> Result<Trajectory> {
    const STEPS: u32 = 60;
    let k = 0.5 * (band::flip(restitution, 1)? + band::birth(restitution, 1)?);
    let map = Map::build(k, restitution)?;
    let tangential = Tangential::build(k, TRACK)?;
    let PartState { phase, velocity } = lock(k, restitution, 1)?.state();
    let mut launch = Map::state(phase + phase_offset, velocity)?;
    let eta = TRACK.amplitude_ratio;
    let (mut clock, mut along, mut phi) = (launch.phase, 0.0, 0.0);
    let (mut moments, mut impacts) = (Vec::new(), vec![clock]);
    for _ in 0..flights {
        let impact = map.impact(launch);
        let (t, d) = (launch.phase, impact.flight);
        for step in 0..=STEPS {
            let s = d * f64::from(step) / f64::from(STEPS);
            let lift = (t.cos() + launch.velocity) * s - 0.5 * k * s * s;
            let drift = (phi + eta * t.cos()) * s - 0.5 * k * TRACK.incline_tangent * s * s;
            let place = along + eta * t.sin() + drift;
            moments.push([clock + s, place, t.sin() + lift, (t + s).sin()]);
        }
        along += tangential.distance(launch, &impact, phi);
        phi = tangential.velocity_after_impact(launch, &impact, phi);
        clock += d;
        impacts.push(clock);
        launch = impact.next;
    }
    Ok(Trajectory {
        k,
        moments,
        impacts,
    })
}

fn max_height(points: &[(f64, f64)]) -> f64 {
    points.iter().map(|point| point.1).fold(1.0, f64::max)
}

/// Fig. 1: the model. The track at the ends of its stroke, the stroke, and the path of a part, in
/// the laboratory frame.
pub(super) fn model(restitution: f64) -> Result<Picture> {
    let trajectory = trajectory(restitution, 0.0, 4)?;
    let slope = TRACK.incline_tangent.atan();
    // From coordinates along and normal to the track to horizontal and vertical ones.
    let turned = |along: f64, normal: f64| {
        (
            along * slope.cos() - normal * slope.sin(),
            along * slope.sin() + normal * slope.cos(),
        )
    };
    let path = trajectory.points(|[_, along, normal, _]| turned(*along, *normal));
    let right_end = path.last().map_or(10.0, |end| end.0) + 3.0;
    let max_height = max_height(&path);
    let eta = TRACK.amplitude_ratio;
    let surface = |normal: f64| vec![turned(-3.0, normal), turned(right_end, normal)];
    let stroke = (0..=60).map(|n| {
        let tau = TAU * f64::from(n) / 60.0;
        turned(eta * (tau + TRACK.phase_lead).sin(), tau.sin())
    });
    let horizontal = Axis::new("horizontal, in b", "", -3.5, right_end + 0.5);
    let vertical = Axis::new("vertical, in b", "", -2.0, max_height + 1.5);
    let ends = "track at the ends of its stroke";
    let motion = "stroke: a sin(ωt+γ) along, b sin ωt normal";
    let panel = Panel::new(horizontal, vertical)
        .height(380.0)
        .line(ends, 1, surface(-1.0))
        .line(ends, 1, surface(1.0))
        .line(motion, 2, stroke.collect())
        .line("part, in free flight between impacts", 0, path);
    Ok(Picture::new("The model (Fig. 1)")
        .caption(format!(
            "R = {}, k = {}, η = {}, γ = 0, α = {}°: a locked part over four flights, seen from the \
             laboratory; gravity g points straight down, α is the slope of the track",
            number(restitution, 4),
            number(trajectory.k, 4),
            number(eta, 3),
            number(slope.to_degrees(), 3)
        ))
        .panel(panel))
}

/// Fig. 2: the motion in time. Track and part, the times of impact and the flights between them.
pub(super) fn motion(restitution: f64) -> Result<Picture> {
    let trajectory = trajectory(restitution, 0.4, 6)?;
    let track = trajectory.points(|[time, .., track]| (*time, *track));
    let part = trajectory.points(|[time, _, normal, _]| (*time, *normal));
    let height = trajectory.points(|[time, _, normal, track]| (*time, normal - track));
    let first = trajectory.impacts[0];
    let last = trajectory.impacts[trajectory.impacts.len() - 1];
    let axis = || Axis::new("τ = ω t", "rad", first - 0.5, last + 0.5).in_pi();
    let top = max_height(&part) + 0.4;
    let normal = Axis::new("normal to the track, in b", "", -1.3, top);
    let mut above = Panel::new(axis(), normal)
        .height(260.0)
        .line("track, sin τ", 1, track)
        .line("part", 0, part);
    for (n, time) in trajectory.impacts.iter().enumerate() {
        above = above.caption(*time, format!("τ{n}"));
    }
    let u = Axis::new("u, in b", "", -0.1, max_height(&height) + 0.3);
    let impacts = trajectory.impacts.iter().map(|time| (*time, 0.0));
    let below = Panel::new(axis(), u)
        .height(180.0)
        .line("height above the track, equation (7b)", 0, height)
        .markers("impacts, where u = 0", 2, impacts.collect());
    Ok(Picture::new("A motion (Fig. 2)")
        .caption(format!(
            "R = {}, k = {}: a part thrown 0.4 rad beside the lock; each impact follows from the one before by (8) and (9)",
            number(restitution, 4),
            number(trajectory.k, 4)
        ))
        .panel(above)
        .panel(below))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drawn_part_strikes_the_track_it_is_drawn_over() {
        for restitution in [0.05, 0.2, 0.5, 0.95] {
            let trajectory = trajectory(restitution, 0.05, 6).unwrap();
            assert_eq!(trajectory.impacts.len(), 7);
            for [time, _, normal, track] in &trajectory.moments {
                assert!(*normal > track - 1e-12);
                if trajectory.impacts.contains(time) {
                    assert!((normal - track).abs() < 1e-9);
                }
            }
            // The path is continuous from flight to flight.
            for pair in trajectory.moments.windows(2) {
                assert!((pair[1][1] - pair[0][1]).abs() < 0.5, "{restitution}");
            }
        }
    }
}
