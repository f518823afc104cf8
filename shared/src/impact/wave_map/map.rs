//! The impact map in f64 on a track of several tones.

use super::first::first_impact;
use super::launch::{ChatterLimits, Launch};
use super::track::Track;
use crate::feeder::OutOfRange;
use crate::impact::double::Map;
use crate::impact::double::step::build_impact;
use crate::impact::kernel::{Impact, Kernel, PartState, WaveKernel};
use crate::impact::wave::{Tone, Wave};

/// The impact map in f64 for one [`Wave`], one k and one restitution.
///
/// With the sine alone it is the map of [`Map`], to rounding.
///
/// Nodes of a sine table give the fundamental, addition theorems its harmonics: no impact needs a
/// trigonometric call. The edges where the push passes k decide which interval a flight
/// meets; no step does. The certificate covers |S| <= 1 + e + e3 and up to three humps in a turn.
/// It misses an impact only if an earlier touch is within rounding, and then flags it.
///
/// ```
/// use kband::impact::{Kernel, Tone, Wave, WaveMap};
/// let wave = Wave::build(Tone { amplitude: 0.15, angle: 2.356 }, Tone::default())?;
/// let map = WaveMap::on(wave, 0.35, 0.2)?;
/// let mut state = WaveMap::state(0.5, 0.45)?;
/// for _ in 0..100 {
///     state = map.impact(state).next;
/// }
/// // Locked: once in every period, at psi = 2 pi k R/(1 + R).
/// assert!((state.velocity - 0.366_519_142_918_809).abs() < 1e-12);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaveMap {
    track: Track,
    restitution: f64,
    chatter: ChatterLimits,
}

impl WaveMap {
    /// The map for a wave, k within 0.001..=1000 and a restitution within 0..=1; an error names the
    /// parameter out of range.
    pub fn on(wave: Wave, k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        Map::build(k, restitution)?;
        Ok(Self {
            track: Track::new(wave, k),
            restitution,
            chatter: ChatterLimits::EXACT,
        })
    }

    pub(crate) fn with_coarse_chatter(self) -> Self {
        let chatter = ChatterLimits::COARSE;
        Self { chatter, ..self }
    }

    /// Its wave.
    pub fn wave(&self) -> &Wave {
        &self.track.wave
    }

    /// k of this map.
    pub fn k(&self) -> f64 {
        self.track.k
    }

    /// Restitution of this map.
    pub fn restitution(&self) -> f64 {
        self.restitution
    }

    #[inline(always)]
    fn launch<const N: usize>(&self, state: PartState) -> Launch {
        Launch::new::<N>(&self.track, state.phase, state.velocity)
    }

    #[inline(always)]
    pub(in crate::impact) fn impact_with_restitution(
        &self,
        restitution: f64,
        state: PartState,
    ) -> Impact {
        let landing = if self.track.wave.is_of_two() {
            first_impact::<2>(&self.track, &self.launch::<2>(state))
        } else {
            first_impact::<3>(&self.track, &self.launch::<3>(state))
        };
        build_impact(restitution, state, landing)
    }

    /// The next contact of a part with this mean restitution. It is an impact with the velocity of
    /// an elastic part, or rest if a chatter's closed form is exact to f64.
    pub fn hop(&self, restitution: f64, state: PartState) -> Hop {
        if self.track.wave.is_of_two() {
            self.hop_of::<2>(restitution, state)
        } else {
            self.hop_of::<3>(restitution, state)
        }
    }

    #[inline(always)]
    fn hop_of<const N: usize>(&self, restitution: f64, state: PartState) -> Hop {
        let launch = self.launch::<N>(state);
        if let Some(chatter) = launch.time_to_rest(&self.track, restitution, self.chatter) {
            return Hop::Rest(chatter);
        }
        let landing = first_impact::<N>(&self.track, &launch);
        Hop::Impact(build_impact(1.0, state, landing))
    }

    /// Time in rad from rest at `phase` to lift-off, and its phase; `None` if it rests for ever.
    pub fn throw(&self, phase: f64) -> Option<(f64, f64)> {
        self.track.throw(phase)
    }
}

/// The next contact of a hopping part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Hop {
    /// It chatters to rest within this time, in rad.
    Rest(f64),
    /// It flies and strikes the track; the velocity is the arrival speed.
    Impact(Impact),
}

impl Kernel for WaveMap {
    type State = PartState;

    const NAME: &'static str = "f64-tones";

    /// The map of the sine alone; [`WaveMap::on`] takes a wave.
    fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        Self::on(Wave::sine(), k, restitution)
    }

    fn state(phase: f64, velocity: f64) -> Result<PartState, OutOfRange> {
        Map::state(phase, velocity)
    }

    fn observe(state: PartState) -> PartState {
        state
    }

    #[inline]
    fn impact(&self, state: PartState) -> Impact {
        self.impact_with_restitution(self.restitution, state)
    }
}

impl WaveKernel for WaveMap {
    fn on_tones([second, third]: [Tone; 2], k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        Self::on(Wave::build(second, third)?, k, restitution)
    }
}
