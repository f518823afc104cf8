//! Observer of the parts' load on the track, with deadbeat compensation of it.
//!
//! Parts of a twentieth of the track's mass absorb as much power as a drive of Q = 25 needs without
//! them (docs/theory-real-parts.md#t10.5). A hopper that opens changes that faster than the gain
//! estimate follows. The observer is a Luenberger observer (1971). Its disturbance states are the
//! load and its rate; its input is the prediction error of the envelope, a phasor. The next output
//! compensates the load within one cycle (deadbeat control). Parts also shift the track's phase,
//! and impacts follow it. So a phase lead of the output holds the phase as the amplitude is held.
//!
//! The gains differ along the held motion and across it. An impact at a third of the cycle has two
//! thirds of its effect in the cycle's mean. Across the motion, more of the error is scatter that
//! does not repeat. Blanked impacts limit the envelope gain to 1.1.

use super::envelope::absolute;
use core::f32::consts::{PI, TAU};
use num_complex::Complex32 as Complex;

/// Observer gains along and across the held motion: for envelope, load per cycle, and its change.
const OBSERVER_GAINS: [[f32; 2]; 3] = [[1.0, 0.9], [0.6, 0.4], [0.04, 0.02]];
/// Share of the lead by which the held phase moves per cycle: the lead decays over 200 cycles.
const PHASE_YIELD_SHARE: f32 = 1.0 / 200.0;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImpactPhase {
    /// Mean of `e^(-i phase)` over the impacts, with the phase of the output.
    pub at: Complex,
    /// Whether no part strikes: the motion is then acceleration over the square of the frequency.
    pub silent: bool,
}

/// Estimates of envelope and load as phasors in m, a quarter turn ahead of the motion.
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
    pub fn from_amplitude(amplitude: f32, driven: f32, decay: f32) -> Self {
        let real = |number: f32| Complex::new(number, 0.0);
        Self {
            envelope: real(amplitude),
            load: real((1.0 - decay) * (amplitude - driven)),
            load_rate: real(0.0),
            output_envelope: real(driven),
            held_phase: real(1.0),
        }
    }

    /// Load, in m of the amplitude that the drive would have without it.
    pub fn load(&self, decay: f32) -> f32 {
        -(self.load * self.held_phase.conj()).re / (1.0 - decay)
    }

    /// Processes the mean motion of a cycle; `decay`: share of the envelope that survives it, 0..1.
    /// Returns the unloaded envelope (m) that gives the next cycle the mean amplitude `goal` (m).
    pub fn cycle(
        &mut self,
        motion: Complex,
        impact: ImpactPhase,
        goal: f32,
        decay: f32,
    ) -> Complex {
        // A cycle's fundamental contains half of a drift, and of a jump the part after it. The ends
        // of the cycle add the conjugate term.
        let ends = Complex::new(0.0, 0.25 / PI);
        // Angle from the impact to half a turn.
        let since = libm::atan2f(impact.at.im, -impact.at.re);
        let before_impact = Complex::new(-since / TAU, 0.25 / PI) * absolute(impact.at);
        let mean = |drift: Complex, jump: Complex| {
            let all = drift + jump;
            all * 0.5 + all.conj() * ends + jump * before_impact
        };
        let drift = (self.output_envelope - self.envelope) * (1.0 - decay);
        let mut innovation = motion - self.envelope - mean(drift, self.load);
        if impact.silent {
            // Under a drifting motion the acceleration is larger by this term.
            innovation += (drift + self.load) * Complex::new(0.0, 1.0 / PI);
        }
        let innovation = innovation * self.held_phase.conj();
        let [envelope, load, rate] = OBSERVER_GAINS.map(|[along, across]| {
            Complex::new(innovation.re * along, innovation.im * across) * self.held_phase
        });
        self.envelope += drift + self.load + envelope;
        self.load_rate += rate;
        self.load += load + self.load_rate;
        let goal = self.held_phase * goal - self.load * before_impact;
        (goal - self.envelope * decay - self.load) / (1.0 - decay)
    }

    /// Limits the requested envelope to `high` and the track's direction; size (m), lead (rad).
    pub fn limit_output(&mut self, requested: Complex, high: f32) -> [f32; 2] {
        let relative = requested * self.held_phase.conj();
        let mut driven = Complex::default();
        if relative.re > 0.0 {
            driven = relative;
        }
        let length = absolute(driven);
        if length > high {
            driven *= high / length;
        }
        self.output_envelope = driven * self.held_phase;
        let length = length.min(high);
        if length <= 0.0 {
            return [0.0; 2];
        }
        let rotated =
            Complex::new(length, -PHASE_YIELD_SHARE * self.output_envelope.im) * self.held_phase;
        self.held_phase = rotated / absolute(rotated);
        let lead = libm::atan2f(self.output_envelope.im, self.output_envelope.re);
        [length, lead]
    }
}
