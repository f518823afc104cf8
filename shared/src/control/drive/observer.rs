//! The loop's second form, for tracks that parts load: it tells by what the motion lacks how much they take.
//!
//! Parts of a twentieth of the track's mass take as much power as a drive of Q = 25 does without them (docs/theory-real-parts.md#t10.5). A
//! hopper that opens changes that within some cycles, too fast for a loop that learns it over thirty. The observer goes along with the
//! envelope, puts down what is missing to a load and to its rate, and the output makes up for it in the next cycle: it must not wait for
//! the phase's wrap. Parts push against the track's phase too, and strike with it: it is held as the amplitude is, by an output that leads.

use core::f32::consts::{PI, TAU};

use num_complex::Complex32 as Complex;

use super::envelope::size;

/// How much of what a cycle's motion was off its prediction, along the held motion and across it, goes into the envelope, into what the load takes of
/// it in a cycle, and into the change of that. Of an impact at a third of the cycle the cycle's mean shows two thirds, and its end all. A load
/// that comes takes along the motion; what is across it is by more of it the scatter of parts that strike early or late, which the next cycle has
/// another way. At 1.4 of the envelope a true motion would be held best, but the reading of what blanked impacts leave alternates from 1.1 on.
const CORRECTS: [[f32; 2]; 3] = [[1.0, 0.9], [0.6, 0.4], [0.04, 0.02]];
/// Share of the output's lead that the held phase gives way by in a cycle: the track comes to where the output need not lead.
const GIVES_WAY: f32 = 1.0 / 200.0;

/// When in the cycle the parts strike.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Struck {
    /// Mean of `e^(-i phase)` of the output at the impacts.
    pub at: Complex,
    /// Whether no part strikes: the motion is then the acceleration's, over the square of the frequency.
    pub silent: bool,
}

/// Envelope and load as the readings have them: phasors in m, a quarter turn before the motion, so that a drive at its resonance
/// brings about the real number that its output stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observer {
    /// The envelope at the end of the last cycle.
    envelope: Complex,
    /// What the load adds to it in a cycle, and the change of that.
    jump: Complex,
    rate: Complex,
    /// What the output stands for in the cycle under way.
    driven: Complex,
    /// Where the phase is held: a number of size 1.
    held: Complex,
}

impl Observer {
    /// An envelope that stands at an amplitude in m under an output that stands for `driven`.
    pub fn at(amplitude: f32, driven: f32, keep: f32) -> Self {
        let real = |number: f32| Complex::new(number, 0.0);
        Self {
            envelope: real(amplitude),
            jump: real((1.0 - keep) * (amplitude - driven)),
            rate: real(0.0),
            driven: real(driven),
            held: real(1.0),
        }
    }

    /// What the load takes, in m of the amplitude that the drive would have without it.
    pub fn load(&self, keep: f32) -> f32 {
        -(self.jump * self.held.conj()).re / (1.0 - keep)
    }

    /// Takes the mean motion of a cycle of a drive that keeps so much of its envelope over one; gives what the output has to stand for, so that
    /// the next cycle has `goal` for its mean amplitude. All in m.
    pub fn cycle(&mut self, motion: Complex, struck: Struck, goal: f32, keep: f32) -> Complex {
        // A cycle's fundamental has of a drift half, and of a jump what is left of the cycle; the ends of the cycle add the rest.
        let ends = Complex::new(0.0, 0.25 / PI);
        // From the impact to half a turn.
        let since = libm::atan2f(struck.at.im, -struck.at.re);
        let early = Complex::new(-since / TAU, 0.25 / PI) * size(struck.at);
        let mean = |drift: Complex, jump: Complex| {
            let all = drift + jump;
            all * 0.5 + all.conj() * ends + jump * early
        };
        let drift = (self.driven - self.envelope) * (1.0 - keep);
        let mut missed = motion - self.envelope - mean(drift, self.jump);
        if struck.silent {
            // A motion that drifts is accelerated by as much more.
            missed += (drift + self.jump) * Complex::new(0.0, 1.0 / PI);
        }
        let missed = missed * self.held.conj();
        let [envelope, load, rate] = CORRECTS
            .map(|[along, across]| Complex::new(missed.re * along, missed.im * across) * self.held);
        self.envelope += drift + self.jump + envelope;
        self.rate += rate;
        self.jump += load + self.rate;
        let goal = self.held * goal - self.jump * early;
        (goal - self.envelope * keep - self.jump) / (1.0 - keep)
    }

    /// The part of that which is driven: up to a size, never against the track; gives its size and how far it leads.
    pub fn drive(&mut self, wanted: Complex, high: f32) -> [f32; 2] {
        let against = wanted * self.held.conj();
        let mut driven = if against.re > 0.0 {
            against
        } else {
            Complex::default()
        };
        let length = size(driven);
        if length > high {
            driven *= high / length;
        }
        self.driven = driven * self.held;
        let length = length.min(high);
        if length <= 0.0 {
            return [0.0; 2];
        }
        let turned = Complex::new(length, -GIVES_WAY * self.driven.im) * self.held;
        self.held = turned / size(turned);
        [length, libm::atan2f(self.driven.im, self.driven.re)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples of a cycle.
    const SAMPLES: usize = 200;
    /// Phase of the track at the impacts.
    const STRUCK: f32 = 0.45;

    /// A cycle of a drive whose envelope goes towards `driven`, thrown by `jump` where the track has the phase of the impacts; its
    /// fundamental, sample by sample, and the envelope at its end.
    fn cycle(mut envelope: Complex, driven: Complex, keep: f32, jump: Complex) -> [Complex; 2] {
        let left = libm::powf(keep, 1.0 / SAMPLES as f32);
        let (mut sum, at) = (Complex::default(), (STRUCK + 0.5 * PI) / TAU);
        for n in 0..SAMPLES {
            let before = n as f32 / SAMPLES as f32;
            let after = (n + 1) as f32 / SAMPLES as f32;
            if (before..after).contains(&at) {
                envelope += jump;
            }
            let middle = (before + after) * 0.5 * TAU;
            let turn = Complex::new(libm::cosf(middle), libm::sinf(middle));
            // The motion is a quarter turn behind.
            let shown = (Complex::new(0.0, -1.0) * envelope * turn).im;
            sum += turn.conj() * (Complex::new(0.0, 1.0) * shown);
            envelope = driven + (envelope - driven) * left;
        }
        [sum * Complex::new(0.0, 2.0 / SAMPLES as f32), envelope]
    }

    /// A drive of each Q that is loaded within a second by `most` of the track's mass in 24 parts, locked at k = 0.43: how far the amplitude
    /// gets from its setpoint, before and after.
    fn dumped(quality: f32, most: f32, gain: f32) -> [f32; 2] {
        let keep = libm::expf(-PI / quality);
        let mut observer = Observer::at(1.0, 1.0, keep);
        let (mut envelope, mut driven) = (Complex::new(1.0, 0.0), Complex::new(1.0, 0.0));
        let mut worst = [0.0_f32; 2];
        for n in 0..400 {
            let share = libm::floorf(((n as f32 - 150.0) / 50.0).clamp(0.0, 1.0) * 24.0) / 24.0;
            let track = envelope / size(envelope);
            let force = Complex::new(libm::cosf(STRUCK), -libm::sinf(STRUCK));
            let jump = track * force * (-TAU * most * share * 0.43);
            let [motion, end] = cycle(envelope, driven * gain, keep, jump);
            envelope = end;
            if n >= 100 {
                let span = usize::from(n >= 300);
                worst[span] = worst[span].max((size(motion) - 1.0).abs());
            }
            let at = track * Complex::new(0.0, 1.0) * force;
            let struck = Struck {
                at: if share > 0.0 {
                    at * Complex::new(-1.0, 0.0)
                } else {
                    Complex::default()
                },
                silent: false,
            };
            let wanted = observer.cycle(motion, struck, 1.0, keep);
            let [length, lead] = observer.drive(wanted, f32::INFINITY);
            driven = Complex::new(libm::cosf(lead), libm::sinf(lead)) * length;
        }
        worst
    }

    #[test]
    fn the_amplitude_is_held_under_a_load_that_comes() {
        for quality in [10.0, 25.0, 50.0] {
            for gain in [0.7, 1.0, 1.4] {
                // What one part takes before the loop can answer; where the gain is told wrong, what was learned of it is learned anew.
                let held = if gain == 1.0 {
                    [0.0027, 0.0067, 0.0133, 0.0267]
                } else {
                    [0.0097, 0.014, 0.0215, 0.041]
                };
                for (most, held) in [0.02, 0.05, 0.1, 0.2].into_iter().zip(held) {
                    let [dip, after] = dumped(quality, most, gain);
                    assert!(dip < held, "{quality} {gain} {most}: {dip}");
                    assert!(after < 1e-4, "{quality} {gain} {most}: {after}");
                }
            }
        }
    }
}
