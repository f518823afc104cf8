//! Predicts the chatter of a part that the track throws from rest once a cycle.
//!
//! The map computes impact after impact; the rest time is extrapolated as a geometric series.

use core::f32::consts::TAU;
use kband::impact::{ContactTime, Kernel, LIFT_OFF_DELAY, Release, Single};

/// Largest number of predicted impacts; further ones are too faint for detection.
pub const IMPACTS: usize = 16;

/// Impacts of one part from its first landing until it rests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BounceTrain {
    /// Phase of the first landing in rad, counted from the cycle of the lift-off.
    pub landing: f32,
    lift_off: f32,
    /// Time from the first landing to rest, in rad; infinite if it never rests.
    pub rest: f32,
    /// Time from the first landing in rad (infinite: none), and speed over the first impact's.
    pub impacts: [(f32, f32); IMPACTS],
}

impl BounceTrain {
    /// Predicts the chatter at k and this restitution; `None` if the part is not thrown.
    #[inline(never)]
    pub fn simulate(k: f64, restitution: f32, contact: ContactTime) -> Option<Self> {
        let restitution = restitution.max(1e-3);
        let map = Single::build(k, f64::from(restitution)).ok()?;
        if k >= 1.0 {
            return None;
        }
        let lift_off = libm::asin(k);
        let Release { mut impact, .. } = Release::build(&map, lift_off, LIFT_OFF_DELAY)?;
        let landing = (lift_off + LIFT_OFF_DELAY + impact.flight) as f32;
        let first = impact.next.velocity;
        if first <= 0.0 {
            return None;
        }
        let (mut time, mut rest) = (0.0, f32::INFINITY);
        let mut impacts = [(f32::INFINITY, 0.0); IMPACTS];
        for slot in &mut impacts {
            let speed = impact.next.velocity / first;
            *slot = (time, speed);
            let mut launch = impact.next;
            let mut contact_time = 0.0;
            if !contact.is_instant() {
                let impact_state = Single::observe(launch);
                let launch_state = contact.launch(f64::from(restitution), impact_state, k, None);
                contact_time = contact.radians() as f32;
                launch = Single::state(launch_state.phase, launch_state.velocity).ok()?;
                if launch_state.velocity == 0.0 {
                    rest = time + contact_time;
                    break;
                }
            }
            impact = map.impact(launch);
            let flight = impact.flight as f32 + contact_time;
            time += flight;
            if time > TAU {
                break;
            }
            if flight < 0.02 {
                rest = time + flight * restitution / (1.0 - restitution);
                break;
            }
            // Remaining hops form nearly a geometric series.
            rest = time + flight / (1.0 - restitution).max(0.02);
        }
        if time > TAU {
            rest = f32::INFINITY;
        }
        Some(Self {
            landing,
            lift_off: lift_off as f32,
            rest,
            impacts,
        })
    }

    /// Whether the part rests before its next lift-off.
    pub fn rests(&self) -> bool {
        self.landing + self.rest < TAU + self.lift_off
    }
}
