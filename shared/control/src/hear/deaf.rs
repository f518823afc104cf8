//! Detector of a sensor that misses impacts.
//!
//! Inputs per cycle: the speeds at which the map predicts impacts (m/s), the noise (m/s^2), the
//! ratio of detected to due impacts, and their concentration. Counters have hysteresis.

/// Minimum height of an impact's ringing over its speed, in 1/s: a third of a bare track's.
const MIN_RINGING_PER_SPEED: f32 = 10.0;
/// Height of an impact's ringing over its speed on a bare track, in 1/s.
const BARE: f32 = 30.0;
/// Predicted height over the detection threshold above which an impact must be detected.
const MIN_LOUDNESS_MARGIN: f32 = 2.0;
/// Threshold of the onset detector over the RMS of the noise.
const THRESHOLD: f32 = 6.0;
/// Ratio of detected to due impacts below which the parts count as silent.
const MAX_SILENT_RATE: f32 = 0.25;
/// Ratio of detected to due impacts above which the parts count as detected.
const MIN_DETECTED_RATE: f32 = 0.5;
/// Concentration of the phases below which detections may be noise: random phases exceed it rarely.
const MIN_CONCENTRATION: f32 = 0.6;
/// Successive silent cycles until detection: twice the memory of the rate, below a kick's delay.
const SILENT_CYCLES: u8 = 32;
/// Successive cycles with detected parts that end it: the memory of the impact rate.
const DETECTED_CYCLES: u8 = 16;

/// Measurements and predictions of one cycle.
#[derive(Clone, Copy, Debug)]
pub struct ImpactEvidence {
    /// Whether the drive holds a setpoint and detections matter.
    pub listening: bool,
    /// Whether the target is one lock of all parts.
    pub together: bool,
    /// Whether the amplitude is at its setpoint.
    pub near: bool,
    /// Ratio of detected to due impacts of one part.
    pub rate: f32,
    /// Concentration of the impacts' phases, 0..1.
    pub concentration: f32,
    /// Predicted speed of impact of parts thrown from rest, in m/s.
    pub thrown: f32,
    /// Predicted speed of impact of locked parts, in m/s.
    pub locked: f32,
    /// Whether a kick has thrown the parts.
    pub kicked: bool,
    /// RMS of the noise in the residual in m/s^2.
    pub noise: f32,
}

/// Detector of missing impacts.
#[derive(Clone, Copy, Debug, Default)]
pub struct MissedImpactDetector {
    silent: u8,
    heard: u8,
    pub missed_impacts: bool,
    pub crowd: bool,
}

impl MissedImpactDetector {
    pub fn cycle(&mut self, sound: &ImpactEvidence) {
        let threshold = THRESHOLD * sound.noise;
        let loud = |speed: f32| MIN_RINGING_PER_SPEED * speed;
        self.crowd = sound.together && MIN_LOUDNESS_MARGIN * BARE * sound.locked < threshold;
        // Such a lock is never detected; detections without a phase are then noise.
        let hopeless = loud(sound.locked) < threshold;
        let noise = self.crowd || hopeless && sound.concentration < MIN_CONCENTRATION;
        if !sound.listening {
            *self = Self {
                crowd: self.crowd,
                ..Self::default()
            };
            return;
        }
        self.heard = if sound.rate > MIN_DETECTED_RATE && !noise {
            self.heard.saturating_add(1)
        } else {
            0
        };
        if self.heard >= DETECTED_CYCLES || (self.heard > 0 && !self.missed_impacts) {
            (self.silent, self.missed_impacts) = (0, false);
            return;
        }
        if !sound.near {
            return;
        }
        let must = loud(sound.thrown) > MIN_LOUDNESS_MARGIN * threshold
            || (sound.kicked && loud(sound.locked) > MIN_LOUDNESS_MARGIN * threshold);
        if noise || (sound.rate < MAX_SILENT_RATE && (must || hopeless)) {
            self.silent = self.silent.saturating_add(1);
        } else if !self.missed_impacts {
            self.silent = 0;
        }
        self.missed_impacts |= self.silent >= SILENT_CYCLES;
    }
}

#[cfg(test)]
mod tests {
    use proptest::collection::vec;
    use proptest::prelude::*;

    use super::*;
    use crate::testing::seeded;

    const SOUND: ImpactEvidence = ImpactEvidence {
        listening: true,
        together: false,
        near: true,
        rate: 0.0,
        concentration: 0.0,
        thrown: 0.15,
        locked: 0.15,
        kicked: false,
        noise: 0.1,
    };

    fn deaf_after(cycles: u8, sound: &ImpactEvidence) -> bool {
        let mut deafness = MissedImpactDetector::default();
        (0..cycles).for_each(|_| deafness.cycle(sound));
        deafness.missed_impacts
    }

    #[test]
    fn silence_is_deafness_only_where_the_map_says_that_it_is_loud() {
        type Change = fn(&mut ImpactEvidence);
        let cases: [(Change, u8, bool); 10] = [
            (|_| {}, 31, false),
            (|_| {}, 32, true),
            // Thrown from rest too softly for detection, until a kick has thrown the parts.
            (|sound| sound.thrown = 0.1, 200, false),
            (|sound| (sound.thrown, sound.kicked) = (0.1, true), 32, true),
            (|sound| sound.near = false, 200, false),
            // Noise above the height of a lock; detections without a phase are noise, too.
            (|sound| sound.noise = 0.3, 32, true),
            (
                |sound| (sound.noise, sound.rate, sound.concentration) = (0.3, 1.5, 0.3),
                32,
                true,
            ),
            (
                |sound| (sound.noise, sound.rate, sound.concentration) = (0.3, 1.5, 0.9),
                200,
                false,
            ),
            (|sound| sound.rate = 0.3, 200, false),
            (|sound| sound.listening = false, 200, false),
        ];
        for (n, (change, cycles, deaf)) in cases.into_iter().enumerate() {
            let mut sound = SOUND;
            change(&mut sound);
            assert_eq!(deaf_after(cycles, &sound), deaf, "{n}");
        }
    }

    #[test]
    fn coincident_impacts_do_not_count_as_one_part() {
        let crowd = |together, noise| ImpactEvidence {
            together,
            noise,
            rate: 1.0,
            concentration: 1.0,
            ..SOUND
        };
        assert!(deaf_after(32, &crowd(true, 1.6)));
        for (together, noise, only) in [(true, 1.6, true), (true, 1.4, false), (false, 1.6, false)]
        {
            let mut deafness = MissedImpactDetector::default();
            deafness.cycle(&crowd(together, noise));
            assert_eq!(deafness.crowd, only, "{together} {noise}");
        }
    }

    proptest! {
        #![proptest_config(seeded())]
        /// 32 silent cycles begin it, 16 cycles with detected parts end it.
        #[test]
        fn only_cycles_in_a_row_begin_and_end_it(runs in vec((0..3_usize, 1..40_u8), 40)) {
            let mut deafness = MissedImpactDetector::default();
            let (mut rows, mut deaf) = ([0; 3], false);
            for (kind, cycles) in runs {
                for _ in 0..cycles {
                    let rate = [0.0, 0.4, 0.9][kind];
                    deafness.cycle(&ImpactEvidence { rate, ..SOUND });
                    let row = rows[kind] + 1;
                    rows = [0; 3];
                    rows[kind] = row;
                    deaf = if deaf { rows[2] < 16 } else { rows[0] >= 32 };
                    prop_assert_eq!(deafness.missed_impacts, deaf);
                }
            }
        }
    }
}
