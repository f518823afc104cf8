//! Interface of an orbit to a map: the next contact of a part, its throw from rest, and its
//! release, the flight of a part that the track throws off from rest.

use crate::arithmetic::vector::sine_cosine;
use crate::impact::double::Map;
use crate::impact::kernel::{Impact, Kernel, PartState};
use crate::impact::wave::{Tone, Wave, in_turn};
use crate::impact::wave_map::{Hop, WaveMap};

/// The map of an orbit: [`Map`] on a track of one tone, [`WaveMap`] on one of several.
pub trait OrbitMap: Kernel<State = PartState> {
    fn parameters(&self) -> [f64; 2];

    /// Motion of the track; `None` is a sine.
    fn wave(&self) -> Option<&Wave>;

    /// Downward acceleration of the track (symbol A) at a phase in 0..2 pi, in `b w^2`.
    #[inline]
    fn push(&self, phase: f64) -> f64 {
        let sine = || sine_cosine(phase).0;
        self.wave().map_or_else(sine, |wave| wave.push(phase))
    }

    /// The tones of the track, each with its number.
    fn tones(&self) -> impl Iterator<Item = (f64, Tone)>;

    /// The next contact of a part with this mean restitution. The velocity after an impact is still
    /// without the factor of [`OrbitMap::restitution_factor`].
    fn hop(&self, restitution: f64, state: PartState) -> Hop;

    /// Factor on the velocity that [`OrbitMap::hop`] gives, and the restitution of the impact.
    /// Inputs are the mean restitution and a drawn one.
    fn restitution_factor(&self, mean: f64, drawn: Option<f64>) -> [f64; 2];

    /// Time in rad from rest at `phase` to lift-off, and its phase; `None` if there is none.
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
    /// The release of an elastic part thrown at `phase`; `None` if the map finds no flight there.
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

/// A part thrown off from rest: its launch and the flight that follows.
///
/// The launch is at `sin t = k` going up with velocity 0, independent of the earlier motion
/// (docs/theory-impacts.md#t4.2). So launch and flight depend on k and the restitution alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Release<S> {
    /// The state at launch.
    pub launch: S,
    /// The flight from there.
    pub impact: Impact<S>,
}

/// Delay of a lift-off in rad, for arithmetics coarser than f64.
///
/// It exceeds their rounding of `arcsin k` and of a phase, so that the part always leaves the
/// track. It omits a launch velocity of at most half its square, 5e-9 `b w`.
pub const LIFT_OFF_DELAY: f64 = 1e-4;

impl<S: Copy> Release<S> {
    /// The release `delay` rad (0, or [`LIFT_OFF_DELAY`]) after `lift_off`, `arcsin k` in rad.
    /// `None` if the kernel finds no flight there.
    pub fn build<K: Kernel<State = S>>(kernel: &K, lift_off: f64, delay: f64) -> Option<Self> {
        let launch = K::state(lift_off + delay, 0.0).ok()?;
        let impact = kernel.impact(launch);
        (impact.flight > 0.0).then_some(Self { launch, impact })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::anchor::Single;
    use crate::impact::integer::Integer;
    use crate::impact::orbit::Orbit;

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
                    let passed = event.duration();
                    assert!(passed >= 0.0 && passed.is_finite());
                    // A rest and a lift-off may take no time, but a flight always follows.
                    idle = if passed > 0.0 { 0 } else { idle + 1 };
                    assert!(idle < 3, "{map:?}");
                }
            }
        }
    }

    /// Flights from rest at k evenly and down to rounding below 1, where the top of the sine is
    /// flat.
    fn flights<K: Kernel>(delay: f64) -> impl Iterator<Item = (f64, Option<f64>)> {
        (0..40_000).map(move |step| {
            let part = (f64::from(step) * 0.618_034).rem_euclid(1.0);
            let ks = [0.005 + 0.994 * part, 1.0 - libm::exp10(-15.9 * part)];
            let k = ks[step as usize % 2].max(0.005);
            let kernel = K::build(k, 0.3).unwrap();
            let release = Release::build(&kernel, libm::asin(k), delay);
            (k, release.map(|release| release.impact.flight))
        })
    }

    #[test]
    fn resting_part_lifts_off_in_every_arithmetic() {
        for (k, flight) in flights::<Map>(0.0) {
            assert!(flight.is_some(), "{k:e}");
        }
        let coarse = flights::<Single>(LIFT_OFF_DELAY).chain(flights::<Integer>(LIFT_OFF_DELAY));
        for (k, flight) in coarse {
            // So near to the top of the sine the track's push ends within the delay.
            let is_flat = k > 1.0 - LIFT_OFF_DELAY * LIFT_OFF_DELAY;
            assert!(flight.is_some() || is_flat, "{k:e}");
        }
    }
}
