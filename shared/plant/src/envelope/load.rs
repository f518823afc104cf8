//! Fundamental of the force of parts with mass on the track (docs/theory-real-parts.md#t10.5).
//!
//! An impact that changes a part's velocity by `(1 + R) s` gives the track the momentum
//! `m (1 + R) s`. With one impact a cycle at phase t0 the fundamental is
//! `-2 m g cos(alpha) cos(tau - t0)`. A part at rest presses with `m (g cos(alpha) + x'')`.

use super::recurrence::turn;
use crate::model::scene::{PARTS, Scene};
use core::f64::consts::FRAC_1_PI;
use num_complex::Complex64 as Complex;

#[derive(Clone, Copy, Debug)]
pub struct Rest {
    /// Output phases at its start and end, in rad.
    pub phases: [f64; 2],
    /// The track's amplitude in m.
    pub amplitude: f64,
    /// Phase lead of the track over the output in rad.
    pub lead: f64,
}

/// Force of a cycle, as the complex `G` of a track acceleration `Im(G e^(i phase))` in m/s^2. Parts
/// move on a track under the last cycle's force; then this cycle's force acts on the track.
#[derive(Clone, Debug)]
pub struct TrackLoad {
    shares: [f64; PARTS],
    angular: f64,
    /// Sums of the current cycle for impacts and rests, and the applied force.
    sums: [Complex; 2],
    force_terms: [Complex; 2],
}

impl TrackLoad {
    pub fn new(scene: &Scene) -> Self {
        Self {
            shares: core::array::from_fn(|part| scene.mass_share(part)),
            angular: 1.0,
            sums: [Complex::ZERO; 2],
            force_terms: [Complex::ZERO; 2],
        }
    }

    /// Mass of a part over that of the track.
    pub fn share(&self, part: usize) -> f64 {
        self.shares.get(part).copied().unwrap_or(0.0)
    }

    /// Begins a cycle at an angular frequency in rad/s and returns the last cycle's force.
    pub fn begin(&mut self, angular: f64) -> Complex {
        self.angular = angular;
        self.force_terms[0] + self.force_terms[1]
    }

    /// Ends the parts' motion in the cycle and returns their force.
    pub fn settle(&mut self) -> Complex {
        self.force_terms = core::mem::take(&mut self.sums);
        self.force_terms[0] + self.force_terms[1]
    }

    pub fn impact_force(&self) -> Complex {
        self.force_terms[0]
    }

    /// Adds an impact at an output phase; `change`: the part's velocity on a fixed track, in m/s.
    pub fn strike(&mut self, part: usize, change: f64, phase: f64) {
        let share = self.share(part);
        let jump = share / (1.0 + share) * change;
        let size = -jump * self.angular * FRAC_1_PI;
        self.sums[0] += Complex::new(0.0, size) * turn(-phase);
    }

    pub fn add_rest(&mut self, part: usize, rest: Rest, normal_gravity: f64) {
        let [from, until] = rest.phases;
        let inertia = rest.amplitude * self.angular * self.angular;
        // Integrals of e^(-i x) and of sin(x + lead) e^(-i x) between the phases.
        let weight_term = (turn(-until) - turn(-from)) * Complex::new(0.0, 1.0);
        let doubled = (turn(-2.0 * until) - turn(-2.0 * from)) * Complex::new(0.0, 0.5);
        let inertia_term = (turn(rest.lead) * (until - from) - turn(-rest.lead) * doubled)
            * Complex::new(0.0, -0.5);
        let force = weight_term * -normal_gravity + inertia_term * inertia;
        self.sums[1] += force * Complex::new(0.0, FRAC_1_PI * self.share(part));
    }
}
