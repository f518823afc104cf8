//! The loop's second form, for tracks that parts load: it tells by what the amplitude lacks how much they take.
//!
//! Parts of a twentieth of the track's mass take as much power as a drive of Q = 25 does without them (docs/theory-real-parts.md#t10.5). A
//! hopper that opens changes that within some cycles, too fast for a loop that learns it over thirty. The observer goes along with the
//! envelope, puts down what is missing to a load, and the output makes up for it in the next cycle: it must not wait for
//! the phase's wrap.

/// How much of what a cycle's amplitude was off its prediction goes into the envelope, and, over what one cycle changes of
/// it, into the load. With a gain told wrong by 0.7 to 1.4 the loop settles at Q 10 to 50; `the_amplitude_is_held_under_a_load_that_comes`
/// fails where either is half or one and a half times as large.
const CORRECTS: [f32; 2] = [0.9, 0.7];

/// Envelope and load as the readings have them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Observer {
    /// Amplitude in m at the end of the last cycle.
    amplitude: f32,
    /// Amplitude in m that the load would take off a drive that runs on with it.
    load: f32,
}

impl Observer {
    /// An envelope that stands at an amplitude in m, and a load in m.
    pub fn at(amplitude: f32, load: f32) -> Self {
        Self { amplitude, load }
    }

    /// What the load takes, in m of the amplitude that the drive would have without it.
    pub fn load(&self) -> f32 {
        self.load
    }

    /// Takes the mean amplitude of a cycle that was driven towards `driven`, by a drive that keeps so much of its envelope over a cycle; gives
    /// the amplitude that the output has to stand for, so that the next cycle ends at `goal`. All in m.
    pub fn cycle(&mut self, measured: f32, driven: f32, goal: f32, keep: f32) -> f32 {
        let [envelope, load] = CORRECTS;
        let predicted = keep * self.amplitude + (1.0 - keep) * (driven - self.load);
        let missed = measured - 0.5 * (self.amplitude + predicted);
        self.amplitude = predicted + envelope * missed;
        self.load -= load * missed / (1.0 - keep);
        (goal - keep * self.amplitude) / (1.0 - keep) + self.load
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A drive of each Q that is loaded within a second by `most` of the track's mass in 24 parts, locked at k = 0.43: how far the amplitude
    /// gets from its setpoint.
    fn dumped(quality: f32, most: f32, gain: f32) -> [f32; 2] {
        let keep = libm::expf(-core::f32::consts::PI / quality);
        let mut observer = Observer::at(1.0, 0.0);
        let (mut amplitude, mut driven) = (1.0_f32, 1.0_f32);
        let mut worst = [0.0_f32; 2];
        for cycle in 0..300 {
            let share = libm::floorf(((cycle - 100) as f32 / 50.0).clamp(0.0, 1.0) * 24.0) / 24.0;
            // d(1/Q) = 2 m/M k cos t0.
            let load = quality * 2.0 * most * share * 0.43 * 0.9;
            let next = keep * amplitude + (1.0 - keep) * (gain * driven - load * amplitude);
            let measured = 0.5 * (amplitude + next);
            amplitude = next;
            driven = observer.cycle(measured, driven, 1.0, keep).max(0.0);
            let span = usize::from(cycle >= 200);
            if cycle >= 50 {
                worst[span] = worst[span].max((measured - 1.0).abs());
            }
        }
        worst
    }

    #[test]
    fn the_amplitude_is_held_under_a_load_that_comes() {
        for quality in [10.0, 25.0, 50.0] {
            for gain in [0.7, 1.0, 1.4] {
                for (most, held) in [(0.02, 0.005), (0.05, 0.012), (0.1, 0.022), (0.2, 0.045)] {
                    let [dip, after] = dumped(quality, most, gain);
                    assert!(dip < held, "{quality} {gain} {most}: {dip}");
                    assert!(after < 1e-3, "{quality} {gain} {most}: {after}");
                }
            }
        }
    }
}
