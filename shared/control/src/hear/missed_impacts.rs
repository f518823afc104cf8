//! Detector of a sensor that misses impacts.
//!
//! Inputs per cycle: the speeds at which the map predicts impacts (m/s), the noise (m/s^2), the
//! ratio of detected to due impacts, and their concentration. Counters have hysteresis.

use super::onset::OnsetDetector;
use crate::saturate::consecutive;

/// Minimum height of an impact's ringing over its speed, in 1/s: a third of a bare track's.
const MIN_RINGING_PER_SPEED: f32 = 10.0;
/// Height of an impact's ringing over its speed on a bare track, in 1/s.
const BARE_TRACK_RINGING_PER_SPEED: f32 = 30.0;
/// Predicted height over the detection threshold above which an impact must be detected.
const MIN_LOUDNESS_MARGIN: f32 = 2.0;
/// Ratio of detected to due impacts below which the parts count as silent.
const MAX_SILENT_RATE: f32 = 0.25;
/// Ratio of detected to due impacts above which the parts count as detected.
const MIN_DETECTED_RATE: f32 = 0.5;
/// Concentration of the phases below which detections may be noise: random phases exceed it rarely.
const MIN_CONCENTRATION: f32 = 0.6;
/// Successive silent cycles until detection: twice the memory of the rate, below a kick's delay.
const SILENT_CYCLES: u8 = 32;
/// Successive cycles with detected parts that end it: the memory of the impact rate.
const DETECTED_CYCLES: u32 = 16;

#[derive(Clone, Copy, Debug)]
pub struct ImpactEvidence {
    /// Whether the drive holds a setpoint and detections matter.
    pub listening: bool,
    /// Whether the target is one lock of all parts.
    pub single_lock: bool,
    pub at_setpoint: bool,
    /// Ratio of detected to due impacts of one part.
    pub rate: f32,
    /// Concentration of the impacts' phases, 0..1.
    pub concentration: f32,
    /// Predicted speed of impact of parts thrown from rest, in m/s.
    pub speed_from_rest: f32,
    /// Predicted speed of impact of locked parts, in m/s.
    pub locked: f32,
    pub kicked: bool,
    /// RMS of the noise in the residual in m/s^2.
    pub noise: f32,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct MissedImpactDetector {
    silent_cycles: u8,
    detected_cycles: u32,
    pub missed_impacts: bool,
    pub merges_impacts: bool,
}

impl MissedImpactDetector {
    pub fn cycle(&mut self, evidence: &ImpactEvidence) {
        let threshold = OnsetDetector::THRESHOLD as f32 * evidence.noise;
        let min_height = |speed: f32| MIN_RINGING_PER_SPEED * speed;
        self.merges_impacts = evidence.single_lock
            && MIN_LOUDNESS_MARGIN * BARE_TRACK_RINGING_PER_SPEED * evidence.locked < threshold;
        // Such a lock is never detected, so detections without a phase are noise.
        let is_undetectable = min_height(evidence.locked) < threshold;
        let noise =
            self.merges_impacts || is_undetectable && evidence.concentration < MIN_CONCENTRATION;
        if !evidence.listening {
            *self = Self {
                merges_impacts: self.merges_impacts,
                ..Self::default()
            };
            return;
        }
        let is_detected = evidence.rate > MIN_DETECTED_RATE && !noise;
        self.detected_cycles = consecutive(self.detected_cycles, is_detected);
        if self.detected_cycles >= DETECTED_CYCLES
            || (self.detected_cycles > 0 && !self.missed_impacts)
        {
            (self.silent_cycles, self.missed_impacts) = (0, false);
            return;
        }
        if !evidence.at_setpoint {
            return;
        }
        let must_detect = min_height(evidence.speed_from_rest) > MIN_LOUDNESS_MARGIN * threshold
            || (evidence.kicked && min_height(evidence.locked) > MIN_LOUDNESS_MARGIN * threshold);
        if noise || (evidence.rate < MAX_SILENT_RATE && (must_detect || is_undetectable)) {
            self.silent_cycles = self.silent_cycles.saturating_add(1);
        } else if !self.missed_impacts {
            self.silent_cycles = 0;
        }
        self.missed_impacts |= self.silent_cycles >= SILENT_CYCLES;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::with;

    const EVIDENCE: ImpactEvidence = ImpactEvidence {
        listening: true,
        single_lock: false,
        at_setpoint: true,
        rate: 0.0,
        concentration: 0.0,
        speed_from_rest: 0.15,
        locked: 0.15,
        kicked: false,
        noise: 0.1,
    };

    fn is_missed_after(cycles: u8, evidence: &ImpactEvidence) -> bool {
        let mut detector = MissedImpactDetector::default();
        (0..cycles).for_each(|_| detector.cycle(evidence));
        detector.missed_impacts
    }

    #[test]
    fn missed_impacts_are_detected_only_where_predicted_audible() {
        let noisy = |noise, rate, concentration| ImpactEvidence {
            noise,
            rate,
            concentration,
            ..EVIDENCE
        };
        let soft = with(EVIDENCE, |it| it.speed_from_rest = 0.1);
        for (cycles, evidence, missed) in [
            (31, EVIDENCE, false),
            (32, EVIDENCE, true),
            // Thrown from rest too softly for detection, until a kick has thrown the parts.
            (200, soft, false),
            (32, with(soft, |it| it.kicked = true), true),
            (200, with(EVIDENCE, |it| it.at_setpoint = false), false),
            (200, with(EVIDENCE, |it| it.listening = false), false),
            (200, with(EVIDENCE, |it| it.rate = 0.3), false),
            // Noise above the height of a lock; detections without a phase are noise, too.
            (32, noisy(0.3, 0.0, 0.0), true),
            (32, noisy(0.3, 1.5, 0.3), true),
            (200, noisy(0.3, 1.5, 0.9), false),
        ] {
            assert_eq!(is_missed_after(cycles, &evidence), missed, "{evidence:?}");
        }
    }

    #[test]
    fn coincident_impacts_do_not_count_as_one_part() {
        let merges_impacts = |single_lock, noise| ImpactEvidence {
            single_lock,
            noise,
            rate: 1.0,
            concentration: 1.0,
            ..EVIDENCE
        };
        assert!(is_missed_after(32, &merges_impacts(true, 1.6)));
        for (single_lock, noise, only) in
            [(true, 1.6, true), (true, 1.4, false), (false, 1.6, false)]
        {
            let mut detector = MissedImpactDetector::default();
            detector.cycle(&merges_impacts(single_lock, noise));
            assert_eq!(detector.merges_impacts, only, "{single_lock} {noise}");
        }
    }
}
