//! Observer of the parts' load on the track, with deadbeat compensation of it.
//!
//! Parts of a twentieth of the track's mass absorb as much power as a drive of Q = 25 needs without
//! them (docs/theory-real-parts.md#t10.5). A hopper that opens changes that faster than the gain
//! estimate follows. The observer is of Luenberger's kind (1971), with the load and its rate as
//! disturbance states and the prediction error of the envelope, a phasor, as input. The next output
//! compensates the load within one cycle (deadbeat control). Parts also shift the track's phase,
//! and impacts follow it: an output that leads holds the phase as the amplitude is held.
//!
//! The gains differ along the held motion and across it. An impact at a third of the cycle shows
//! two thirds of its effect in the cycle's mean. Across the motion, more of the error is scatter
//! that does not repeat. Blanked impacts limit the envelope gain to 1.1.

use core::f32::consts::{PI, TAU};

use num_complex::Complex32 as Complex;

use super::envelope::absolute;

/// Observer gains along and across the held motion: for envelope, load per cycle, and its change.
const OBSERVER_GAINS: [[f32; 2]; 3] = [[1.0, 0.9], [0.6, 0.4], [0.04, 0.02]];
/// Share of the output's lead by which the held phase yields per cycle: it decays over 200 cycles.
const PHASE_YIELD_SHARE: f32 = 1.0 / 200.0;

/// Phase of the impacts in the cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImpactPhase {
    /// Mean of `e^(-i phase)` over the impacts, with the phase of the output.
    pub at: Complex,
    /// Whether no part strikes: the motion is then acceleration over the square of the frequency.
    pub silent: bool,
}

/// Estimates of envelope and load: phasors in m, a quarter turn ahead of the motion, so that a
/// drive at its resonance has a real envelope.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observer {
    /// Envelope at the end of the last cycle.
    envelope: Complex,
    /// Load: its change of the envelope in a cycle, and the change of that per cycle.
    load: Complex,
    load_rate: Complex,
    /// Steady envelope of the running cycle's output.
    output_envelope: Complex,
    /// Phasor of size 1 at which the phase is held.
    held_phase: Complex,
}

impl Observer {
    /// The observer of a steady envelope, `amplitude` and the unloaded `driven` in m.
    pub fn at(amplitude: f32, driven: f32, keep: f32) -> Self {
        let real = |number: f32| Complex::new(number, 0.0);
        Self {
            envelope: real(amplitude),
            load: real((1.0 - keep) * (amplitude - driven)),
            load_rate: real(0.0),
            output_envelope: real(driven),
            held_phase: real(1.0),
        }
    }

    /// Load, in m of the amplitude that the drive would have without it.
    pub fn load(&self, keep: f32) -> f32 {
        -(self.load * self.held_phase.conj()).re / (1.0 - keep)
    }

    /// Processes the mean motion of a cycle; `keep`: share of the envelope that survives it, 0..1.
    /// Returns the unloaded envelope (m) that gives the next cycle the mean amplitude `goal` (m).
    pub fn cycle(&mut self, motion: Complex, struck: ImpactPhase, goal: f32, keep: f32) -> Complex {
        // A cycle's fundamental has half of a drift, and of a jump the rest of the cycle after it.
        // The ends of the cycle add the conjugate term.
        let ends = Complex::new(0.0, 0.25 / PI);
        // Angle from the impact to half a turn.
        let since = libm::atan2f(struck.at.im, -struck.at.re);
        let early = Complex::new(-since / TAU, 0.25 / PI) * absolute(struck.at);
        let mean = |drift: Complex, jump: Complex| {
            let all = drift + jump;
            all * 0.5 + all.conj() * ends + jump * early
        };
        let drift = (self.output_envelope - self.envelope) * (1.0 - keep);
        let mut missed = motion - self.envelope - mean(drift, self.load);
        if struck.silent {
            // A motion that drifts has a larger acceleration, by this.
            missed += (drift + self.load) * Complex::new(0.0, 1.0 / PI);
        }
        let missed = missed * self.held_phase.conj();
        let [envelope, load, rate] = OBSERVER_GAINS.map(|[along, across]| {
            Complex::new(missed.re * along, missed.im * across) * self.held_phase
        });
        self.envelope += drift + self.load + envelope;
        self.load_rate += rate;
        self.load += load + self.load_rate;
        let goal = self.held_phase * goal - self.load * early;
        (goal - self.envelope * keep - self.load) / (1.0 - keep)
    }

    /// Limits the requested envelope to `high` and the track's direction; size (m), lead (rad).
    pub fn limit_output(&mut self, wanted: Complex, high: f32) -> [f32; 2] {
        let against = wanted * self.held_phase.conj();
        let mut driven = if against.re > 0.0 {
            against
        } else {
            Complex::default()
        };
        let length = absolute(driven);
        if length > high {
            driven *= high / length;
        }
        self.output_envelope = driven * self.held_phase;
        let length = length.min(high);
        if length <= 0.0 {
            return [0.0; 2];
        }
        let turned =
            Complex::new(length, -PHASE_YIELD_SHARE * self.output_envelope.im) * self.held_phase;
        self.held_phase = turned / absolute(turned);
        [
            length,
            libm::atan2f(self.output_envelope.im, self.output_envelope.re),
        ]
    }
}
