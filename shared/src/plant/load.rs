//! What parts with mass push on the track, as one force at the drive's frequency.
//!
//! An impact that changes a part's velocity by `(1 + R) s` gives the track the momentum `m (1 + R) s`; of one impact in each cycle, at
//! the phase t0, the fundamental is `-2 m g cos(alpha) cos(tau - t0)`. A part that lies on the track presses on it with
//! `m (g cos(alpha) + x'')`.

use core::f64::consts::FRAC_1_PI;

use num_complex::Complex64 as Complex;

use super::recurrence::turn;
use super::scene::{PARTS, Scene};

/// A rest of a part on the track.
#[derive(Clone, Copy, Debug)]
pub struct Rest {
    /// Phases of the output at its beginning and end, in rad.
    pub phases: [f64; 2],
    /// The track's amplitude in m.
    pub amplitude: f64,
    /// Lead of the track before the output in rad.
    pub lead: f64,
}

/// The push of a cycle, as the `G` of an acceleration `Im(G e^(i phase))` of the track in m/s^2. The parts of a cycle meet the track as the
/// push of the one before moves it; the track then moves as they pushed it.
#[derive(Clone, Debug)]
pub struct TrackLoad {
    shares: [f64; PARTS],
    angular: f64,
    /// Impacts and rests of the cycle under way, and what pushes it.
    gathered: [Complex; 2],
    pushing: [Complex; 2],
}

impl TrackLoad {
    /// The load of a scene at rest.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        Self {
            shares: core::array::from_fn(|part| scene.mass_share(part)),
            angular: 1.0,
            gathered: [Complex::new(0.0, 0.0); 2],
            pushing: [Complex::new(0.0, 0.0); 2],
        }
    }

    /// Mass of a part over that of the track.
    #[must_use]
    pub fn share(&self, part: usize) -> f64 {
        self.shares.get(part).copied().unwrap_or(0.0)
    }

    /// Has the parts weigh so much of the track's mass in all.
    #[cfg(test)]
    pub(super) fn heap(&mut self, total: f64) {
        let sum: f64 = self.shares.iter().sum();
        for share in &mut self.shares {
            *share *= total / sum;
        }
    }

    /// Begins a cycle at an angular frequency in rad/s; the push of the one before.
    pub fn begin(&mut self, angular: f64) -> Complex {
        self.angular = angular;
        let [struck, lain] = self.pushing;
        struck + lain
    }

    /// Ends what the parts do in the cycle; their push.
    pub fn settle(&mut self) -> Complex {
        self.pushing = core::mem::take(&mut self.gathered);
        let [struck, lain] = self.pushing;
        struck + lain
    }

    /// What impacts push this cycle.
    #[must_use]
    pub fn struck(&self) -> Complex {
        self.pushing[0]
    }

    /// An impact that would change a part's velocity by so many m/s on a track that gives no way, at a phase of the output.
    pub fn strike(&mut self, part: usize, change: f64, phase: f64) {
        let share = self.share(part);
        let jump = share / (1.0 + share) * change;
        let size = -jump * self.angular * FRAC_1_PI;
        self.gathered[0] += Complex::new(0.0, size) * turn(-phase);
    }

    /// A rest of a part.
    pub fn lie(&mut self, part: usize, rest: Rest, normal_gravity: f64) {
        let Rest {
            phases: [from, until],
            amplitude,
            lead,
        } = rest;
        let inertia = amplitude * self.angular * self.angular;
        // The integrals of e^(-i x) and of sin(x + lead) e^(-i x) from one phase to the other.
        let straight = (turn(-until) - turn(-from)) * Complex::new(0.0, 1.0);
        let doubled = (turn(-2.0 * until) - turn(-2.0 * from)) * Complex::new(0.0, 0.5);
        let swung = (turn(lead) * (until - from) - turn(-lead) * doubled) * Complex::new(0.0, -0.5);
        let force = straight * -normal_gravity + swung * inertia;
        self.gathered[1] += force * Complex::new(0.0, FRAC_1_PI * self.share(part));
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::TAU;

    use super::*;

    fn load() -> TrackLoad {
        let scene = Scene {
            masses: core::iter::once(500.0).collect(),
            ..Scene::default()
        };
        let mut load = TrackLoad::new(&scene);
        load.begin(314.0);
        load
    }

    /// A part of 5 % of the track's mass that strikes once in a cycle at the phase t0 pushes with twice its weight.
    #[test]
    fn the_fundamental_of_a_locked_part_is_twice_its_weight() {
        let mut load = load();
        let (gravity, phase) = (9.8, 0.7);
        // The momentum of a cycle's weight; an impact on a track that gives way moves the part by less.
        let change = gravity * TAU / 314.0 * 1.05;
        load.strike(0, change, phase);
        let found = load.settle();
        for n in 0..8 {
            let at = TAU * f64::from(n) / 8.0;
            let expected = -2.0 * 0.05 * gravity * libm::cos(at - phase);
            assert!(((found * turn(at)).im - expected).abs() < 1e-12);
        }
    }

    /// Such a part that never leaves the track is so much more mass: its push is against the acceleration.
    #[test]
    fn a_part_that_lies_is_mass_of_the_track() {
        let mut load = load();
        let (amplitude, lead) = (1e-4, -1.5);
        let rest = Rest {
            phases: [1.0, 1.0 + TAU],
            amplitude,
            lead,
        };
        load.lie(0, rest, 9.8);
        let found = load.settle();
        let expected = turn(lead) * (0.05 * amplitude * 314.0 * 314.0);
        assert!((found - expected).norm_sqr() < 1e-24, "{found} {expected}");
    }
}
