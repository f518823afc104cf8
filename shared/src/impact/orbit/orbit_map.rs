//! What an orbit asks of a map: the next contact of a part, and its throw from rest.

use super::release::Release;
use crate::arithmetic::lane::sine_cosine;
use crate::impact::double::Map;
use crate::impact::kernel::{Kernel, PartState};
use crate::impact::wave::{Tone, Wave, in_turn};
use crate::impact::wave_map::{Hop, WaveMap};

/// The map of an orbit: [`Map`] on a track of one tone, [`WaveMap`] on one of several.
pub trait OrbitMap: Kernel<State = PartState> {
    /// k of the track and restitution of the part.
    fn parameters(&self) -> [f64; 2];

    /// Motion of the track; `None` is a sine.
    fn wave(&self) -> Option<&Wave>;

    /// Downward acceleration of the track (symbol A) at a phase in 0..2 pi, in `b w^2`.
    fn push(&self, phase: f64) -> f64;

    /// The tones of the track, each with its number.
    fn tones(&self) -> impl Iterator<Item = (f64, Tone)>;

    /// The next contact of a part with this mean restitution. The velocity after an impact is still
    /// without the factor of [`OrbitMap::kept`].
    fn hop(&self, restitution: f64, state: PartState) -> Hop;

    /// Factor on the velocity that [`OrbitMap::hop`] gives, and restitution, with a mean restitution
    /// and one that was drawn.
    fn kept(&self, mean: f64, drawn: Option<f64>) -> [f64; 2];

    /// Time in rad from rest at `phase` to lift-off, and its phase; `None` where the part rests for
    /// ever.
    fn throw(&self, phase: f64) -> Option<(f64, f64)>;

    /// The release of a part that the track throws at `phase`; `None` where the map finds no flight.
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
    fn kept(&self, mean: f64, drawn: Option<f64>) -> [f64; 2] {
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

    fn kept(&self, mean: f64, drawn: Option<f64>) -> [f64; 2] {
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
    /// `None` where the map finds no flight there.
    pub fn release(&self, phase: f64) -> Option<Release<PartState>> {
        // Rounding may put the edge before the crossing that the map finds, where the part still
        // rests. On the flat top of a very short window the difference exceeds an ulp.
        let mut late = 0.0;
        for _ in 0..40 {
            let launch = PartState::new(in_turn(phase + late), 0.0);
            let impact = self.impact_with_restitution(1.0, launch);
            if impact.flight > 0.0 {
                return Some(Release { launch, impact });
            }
            late = if late == 0.0 {
                f64::EPSILON * phase.max(1.0)
            } else {
                2.0 * late
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
    fn one_tone_orbit_matches_the_sine() {
        for (k, restitution) in [(0.9, 0.5), (0.43, 0.2), (0.2, 0.8), (0.7, 0.0), (1.5, 0.5)] {
            let one = Map::build(k, restitution).unwrap();
            let same = WaveMap::build(k, restitution).unwrap();
            let start = Map::state(2.0, 0.5).unwrap();
            // Compares until rounding, which an orbit amplifies, separates them.
            for (a, b) in Orbit::new(&one, start)
                .zip(Orbit::new(&same, start))
                .take(12)
            {
                let difference = match (a, b) {
                    (OrbitEvent::Impact(a), OrbitEvent::Impact(b)) => (a.flight - b.flight).abs(),
                    (OrbitEvent::Rest { phase: a, .. }, OrbitEvent::Rest { phase: b, .. })
                    | (
                        OrbitEvent::LiftOff { phase: a, .. },
                        OrbitEvent::LiftOff { phase: b, .. },
                    ) => (a - b).abs(),
                    other => panic!("{k} {restitution}: {other:?}"),
                };
                assert!(difference < 1e-6, "{k} {restitution}: {a:?} {b:?}");
            }
            let ended = Orbit::from_rest(&same).next().is_none();
            assert_eq!(ended, k >= 1.0);
        }
    }

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
                    // A rest and a lift-off may take no time, but never without a flight after.
                    idle = if passed > 0.0 { 0 } else { idle + 1 };
                    assert!(idle < 3, "{map:?}");
                }
            }
        }
    }
}
