//! Motion of the track within a cycle, for the simulation of the parts.
//!
//! The solution of the drive is evaluated in closed form at any time of the cycle. Times are in
//! steps of 2^-32 turns of the output, phases and delays in rad. Lift-off of a resting part is
//! where the track's acceleration rises through k (docs/theory-impacts.md#t4.2).

use super::load::Rest;
use super::recurrence::{Recurrence, Swinging};
use super::upper::UpperEnvelope;
use crate::model::drive::Swing;
use crate::model::part::{Track, WaveCache, wrap_angle};
use core::f64::consts::{FRAC_PI_2, TAU};
use kband::arithmetic::Phase;
use kband::impact::{Kernel, Map, Wave, WaveMap};

#[derive(Clone, Copy)]
pub(crate) struct TrackMotion<'a> {
    swinging: Swinging<'a>,
    upper: Option<&'a UpperEnvelope>,
    time: i64,
}

impl<'a> TrackMotion<'a> {
    /// Motion from a drive; `time`: that of the last output sample.
    pub fn new(drive: &'a Recurrence, upper: Option<&'a UpperEnvelope>, time: i64) -> Self {
        Self {
            swinging: drive.swinging(),
            upper,
            time,
        }
    }

    #[inline]
    pub fn swing(&self, time: u64) -> Swing {
        let ticks = time as i64 - self.time;
        let swing = self.swinging.at(ticks);
        let Some(upper) = self.upper else {
            return swing;
        };
        let drive = self.swinging.drive;
        let phase = Phase::from_bits(drive.phase.wrapping_add(ticks as u32));
        upper.complete(swing, ticks as f64 * drive.tuning.per_step, phase)
    }

    /// Wave of a swing; `None` for a sine.
    #[inline]
    pub fn wave<'w>(&self, swing: &Swing, waves: &'w mut WaveCache) -> Option<&'w Wave> {
        self.upper.and_then(|_| waves.shape(swing.shape))
    }

    pub fn output_phase(&self, time: u64) -> f64 {
        let ticks = (time as i64 - self.time) as u32;
        Phase::from_bits(self.swinging.drive.phase.wrapping_add(ticks)).radians()
    }

    pub fn rest(&self, from: u64, until: u64) -> Rest {
        let duration = until.saturating_sub(from);
        let swing = self.swing(from + duration / 2);
        let middle = self.output_phase(from + duration / 2);
        let half = 0.5 * duration as f64 / Phase::TURN * TAU;
        Rest {
            phases: [middle - half, middle + half],
            amplitude: f64::from(swing.amplitude),
            lead: swing.phase.radians() - middle,
        }
    }

    /// First lift-off of a part at rest in `from..=end`.
    pub fn thrown(
        &self,
        track: &Track<'_>,
        waves: &mut WaveCache,
        from: u64,
        end: u64,
    ) -> Option<(Swing, u64)> {
        let k = |swing: &Swing| track.k(swing.amplitude.into());
        let began = self.swing(from);
        if self.upper.is_some_and(|upper| upper.tones > 0) {
            let after = |swing: Swing, waves: &mut WaveCache| {
                let phase = began.phase.radians();
                let wait = match waves.shape(swing.shape) {
                    Some(wave) => WaveMap::on(*wave, k(&swing), 1.0).ok()?.throw(phase)?.0,
                    None => Map::build(k(&swing), 1.0).ok()?.wait(phase)?,
                };
                let time = from + (wait / TAU * Phase::TURN) as u64;
                (time <= end).then_some(time)
            };
            // If the present amplitude throws no part, that at the end of the cycle may.
            let time = after(began, waves).or_else(|| after(self.swing(end), waves))?;
            let time = after(self.swing(time), waves)?;
            return Some((self.swing(time), time));
        }
        let phase = began.phase.radians();
        if libm::sin(phase) > k(&began) {
            return Some((began, from));
        }
        // A growing amplitude first throws at the crest; search back from there to arcsin k.
        let ahead = |angle: f64| (wrap_angle(angle) / TAU * Phase::TURN) as u64;
        let crest = from + ahead(FRAC_PI_2 - phase);
        if crest > end + (1 << 30) {
            return None;
        }
        let at_crest = k(&self.swing(crest));
        if at_crest >= 1.0 {
            return None;
        }
        let mut time = crest - ahead(FRAC_PI_2 - libm::asin(at_crest)).min(crest - from);
        for _ in 0..8 {
            let swing = self.swing(time);
            let excess = libm::sin(swing.phase.radians()) - k(&swing);
            if excess > 0.0 {
                return (time <= end).then_some((swing, time));
            }
            // Move past the crossing of a slowly changing amplitude.
            time += (1 << 20) + (-excess / TAU * Phase::TURN).min(Phase::TURN / 16.0) as u64;
        }
        None
    }
}
