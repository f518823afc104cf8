//! Interface of an orbit to a map: the next contact of a part, and its throw from rest.

use super::release::Release;
use crate::arithmetic::vector::sine_cosine;
use crate::impact::double::Map;
use crate::impact::kernel::{Kernel, PartState};
use crate::impact::wave::{Tone, Wave, in_turn};
use crate::impact::wave_map::{Hop, WaveMap};

/// The map of an orbit: [`Map`] on a track of one tone, [`WaveMap`] on one of several.
pub trait OrbitMap: Kernel<State = PartState> {
    fn parameters(&self) -> [f64; 2];

    /// Motion of the track; `None` is a sine.
    fn wave(&self) -> Option<&Wave>;

    /// Downward acceleration of the track (symbol A) at a phase in 0..2 pi, in `b w^2`.
    fn push(&self, phase: f64) -> f64;

    /// The tones of the track, each with its number.
    fn tones(&self) -> impl Iterator<Item = (f64, Tone)>;

    /// The next contact of a part with this mean restitution. The velocity after an impact is still
    /// without the factor of [`OrbitMap::restitution_factor`].
    fn hop(&self, restitution: f64, state: PartState) -> Hop;

    /// Factor on the velocity that [`OrbitMap::hop`] gives, and the restitution of the impact.
    /// Inputs are the mean restitution and a drawn one.
    fn restitution_factor(&self, mean: f64, drawn: Option<f64>) -> [f64; 2];

    /// Time in rad from rest at `phase` to lift-off, and its phase; `None` if the part rests for
    /// ever.
    fn throw(&self, phase: f64) -> Option<(f64, f64)>;

    /// The release of a part that the track throws at `phase`; `None` if the map finds no flight.
    fn release(&self, phase: f64) -> Option<Release<PartState>>;
}

impl OrbitMap for Map {
    #[inline]
    fn parameters(&self) -> [f64; 2] {
        [self.k(), self.restitution()]
    }

    #[inline]
    fn wave(&self) -> Option<&Wave> {
        None
    }

    #[inline]
    fn push(&self, phase: f64) -> f64 {
        sine_cosine(phase).0
    }

    #[inline]
    fn tones(&self) -> impl Iterator<Item = (f64, Tone)> {
        [(1.0, Tone::new(1.0, 0.0))].into_iter()
    }

    /// A chatter's closed form uses the map's restitution.
    #[inline]
    fn hop(&self, _: f64, state: PartState) -> Hop {
        match self.time_to_rest(state) {
            Some(chatter) => Hop::Rest(chatter),
            None => Hop::Impact(self.impact(state)),
        }
    }

    #[inline]
    fn restitution_factor(&self, mean: f64, drawn: Option<f64>) -> [f64; 2] {
        let factor = drawn.map_or(1.0, |drawn| drawn / mean);
        [factor, self.restitution() * factor]
    }

    fn throw(&self, phase: f64) -> Option<(f64, f64)> {
        Some((self.wait(phase)?, self.lift_off()?))
    }

    fn release(&self, phase: f64) -> Option<Release<PartState>> {
        Release::build(self, phase, 0.0)
    }
}

impl OrbitMap for WaveMap {
    #[inline]
    fn parameters(&self) -> [f64; 2] {
        [self.k(), self.restitution()]
    }

    #[inline]
    fn wave(&self) -> Option<&Wave> {
        Some(WaveMap::wave(self))
    }

    fn push(&self, phase: f64) -> f64 {
        WaveMap::wave(self).push(phase)
    }

    fn tones(&self) -> impl Iterator<Item = (f64, Tone)> {
        WaveMap::wave(self).tones()
    }

    fn hop(&self, restitution: f64, state: PartState) -> Hop {
        WaveMap::hop(self, restitution, state)
    }

    fn restitution_factor(&self, mean: f64, drawn: Option<f64>) -> [f64; 2] {
        [drawn.unwrap_or(mean); 2]
    }

    fn throw(&self, phase: f64) -> Option<(f64, f64)> {
        WaveMap::throw(self, phase)
    }

    fn release(&self, phase: f64) -> Option<Release<PartState>> {
        WaveMap::release(self, phase)
    }
}

impl WaveMap {
    /// The release of an elastic part that the track throws at `phase`, see [`WaveMap::throw`].
    ///
    /// `None` if the map finds no flight there.
    pub fn release(&self, phase: f64) -> Option<Release<PartState>> {
        // Rounding may put the edge before the crossing that the map finds, where the part still
        // rests. On the flat top of a very short window the difference exceeds an ulp.
        let mut delay = 0.0;
        for _ in 0..40 {
            let launch = PartState::new(in_turn(phase + delay), 0.0);
            let impact = self.impact_with_restitution(1.0, launch);
            if impact.flight > 0.0 {
                return Some(Release { launch, impact });
            }
            delay = if delay == 0.0 {
                f64::EPSILON * phase.max(1.0)
            } else {
                2.0 * delay
            };
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::orbit::{Orbit, OrbitEvent};

    #[test]
    fn every_restitution_keeps_hopping() {
        for n in 0..200 {
            let spread = |factor: f64| (f64::from(n) * factor).rem_euclid(1.0);
            let tone = |a: f64, b: f64| Tone::new(0.5 * spread(a), 6.0 * spread(b));
            let wave = Wave::build(tone(0.618, 0.414), tone(0.732, 0.236)).unwrap();
            for restitution in [0.0, 0.3, 0.9, 1.0] {
                let k = 0.05 + 1.1 * spread(0.303) * wave.highest_throw();
                let map = WaveMap::on(wave, k, restitution).unwrap();
                let mut idle = 0;
                for event in Orbit::from_rest(&map).take(300) {
                    let passed = match event {
                        OrbitEvent::Impact(impact) => impact.flight,
                        OrbitEvent::Rest { chatter, .. } => chatter,
                        OrbitEvent::LiftOff { wait, .. } => wait,
                    };
                    assert!(passed >= 0.0 && passed.is_finite());
                    // A rest and a lift-off may take no time, but a flight always follows.
                    idle = if passed > 0.0 { 0 } else { idle + 1 };
                    assert!(idle < 3, "{map:?}");
                }
            }
        }
    }
}
