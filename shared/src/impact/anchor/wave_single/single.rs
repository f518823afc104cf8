//! The impact map in f32 on a track of several tones.

use super::flight::Ballistic;
use super::harmonics::{Harmonics, Parts};
use super::launch::Launch;
use super::search::{Candidate, bisect, candidate, has_left, search};
use super::track::Track;
use crate::arithmetic::Phase;
use crate::feeder::{OutOfRange, accept};
use crate::impact::anchor::approach::fall;
use crate::impact::anchor::flight::{STEPS_PER_RADIAN, smaller};
use crate::impact::anchor::single::Single;
use crate::impact::anchor::single::{self, MAX_VELOCITY, SingleState, land_found, steps_after};
use crate::impact::anchor::solve::Found;
use crate::impact::kernel::{Impact, Kernel, Landing, PartState, WaveKernel};
use crate::impact::wave::Tone;

/// The impact map in f32 on a track of two or three tones (`f32-tones`).
///
/// With one tone it is [`Single`], bit for bit.
///
/// The last step, of up to 0.02 rad, leaves a thousandth of itself. It leaves more where the
/// track's third derivative is large relative to the arrival speed, a few 1e-5 rad.
///
/// The set-up uses f32 and integers, for the planner on a board. It takes about 6 000 instructions
/// of a Cortex-M4F, where an impact takes some 400, and 200 bytes.
///
/// ```
/// use kband::impact::{Kernel, Single, Tone, WaveKernel, WaveMap, WaveSingle};
/// let tones = [Tone { amplitude: 0.15, angle: 2.356 }, Tone::default()];
/// let track = WaveSingle::on_tones(tones, 0.35, 0.2)?;
/// let map = WaveMap::on_tones(tones, 0.35, 0.2)?;
/// let start = Single::state(0.7, 0.36)?;
/// let expected = map.impact(Single::observe(start)).flight;
/// assert!((track.land(start).flight() - expected).abs() < 1e-5);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaveSingle {
    track: TrackKind,
    restitution: f32,
}

/// The track's shape: a sine or several tones.
#[derive(Clone, Copy, Debug, PartialEq)]
enum TrackKind {
    Sine(Single),
    Tones(Track),
}

impl WaveSingle {
    /// One flight and the impact that ends it. A resting part stays: flight 0.
    #[inline(always)]
    pub fn land(&self, state: SingleState) -> Landing<SingleState> {
        self.land_at(state, self.restitution)
    }

    /// [`WaveSingle::land`] with another restitution, 0..=1, at the impact.
    #[inline(always)]
    pub(crate) fn land_at(&self, state: SingleState, restitution: f32) -> Landing<SingleState> {
        match &self.track {
            TrackKind::Sine(single) => single.land_at(state, restitution),
            TrackKind::Tones(track) => land(track, state, restitution),
        }
    }

    /// Whether a part that rests at `phase` is thrown off there.
    pub(crate) fn throws(&self, phase: Phase) -> bool {
        match &self.track {
            TrackKind::Sine(single) => single.throws(phase),
            TrackKind::Tones(track) => track.throws(phase.bits()),
        }
    }

    /// Next lift-off phase of a part that rests at `phase`; `None` where it rests for ever.
    pub(crate) fn lift_off(&self, phase: Phase) -> Option<Phase> {
        match &self.track {
            TrackKind::Sine(single) => single.lift_off(),
            TrackKind::Tones(track) => track.lift_off(phase.bits()).map(Phase::from_bits),
        }
    }
}

/// The impact on a track of several tones.
#[inline(always)]
fn land(track: &Track, state: SingleState, restitution: f32) -> Landing<SingleState> {
    let velocity = smaller(state.velocity, MAX_VELOCITY as f32);
    let phase = state.phase.bits();
    let parts = track.tones.at(phase);
    let (height, rise) = (parts.sines(1.0, 1.0), velocity + parts.cosines(2.0, 3.0));
    let flight = Ballistic {
        track,
        phase,
        height,
        rise,
    };
    if let Some(approach) = fall::<Ballistic<'_>>(track, phase, height, rise) {
        let steps = steps_after(phase, &approach);
        return single::landing(phase, steps, approach.arrival(), restitution, false);
    }
    land_low(&flight, velocity, &parts, restitution)
}

/// The impact of a flight that is not tall.
#[inline(never)]
fn land_low(
    flight: &Ballistic<'_>,
    velocity: f32,
    parts: &Parts,
    restitution: f32,
) -> Landing<SingleState> {
    let Ballistic { track, phase, .. } = *flight;
    let throws = track.throws(phase);
    if velocity == 0.0 && !throws {
        return Landing {
            steps: 0,
            next: SingleState {
                phase: Phase::from_bits(phase),
                velocity,
            },
            grazes: false,
        };
    }
    let launch = Launch::new(track, phase, velocity, parts, throws);
    if !launch.is_level()
        && let Some((candidate, limits)) = candidate(track, &launch)
    {
        match candidate {
            Candidate::Hop { flight, arrival } => {
                let landing = single::land_short(phase, flight, arrival, restitution, false);
                if limits.contain(track, &launch, landing.steps) {
                    return landing;
                }
            }
            Candidate::Near(approach) => {
                let steps = steps_after(phase, &approach);
                if limits.contain(track, &launch, steps) {
                    return single::landing(phase, steps, approach.arrival(), restitution, false);
                }
            }
        }
    }
    land_by_search(flight, &launch, restitution)
}

#[inline(never)]
fn land_by_search(
    flight: &Ballistic<'_>,
    launch: &Launch,
    restitution: f32,
) -> Landing<SingleState> {
    let Ballistic { track, phase, .. } = *flight;
    let (found, grazes, bracket) = search(track, launch, flight);
    let grazes = grazes || launch.is_level();
    let landing = land_found(track.k, restitution, phase, flight, found, grazes);
    if matches!(found, Found::Near { .. })
        && has_left(&bracket, landing.steps, landing.next.velocity)
    {
        let (time, speed) = bisect(track, launch, flight, &bracket);
        let steps = (time * STEPS_PER_RADIAN) as i64;
        return single::landing(phase, steps, speed, restitution, true);
    }
    landing
}

impl Kernel for WaveSingle {
    type State = SingleState;

    const NAME: &'static str = "f32-tones";

    /// The map of the sine alone; [`WaveKernel::on_tones`] takes tones.
    fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        Self::on_tones([Tone::default(); 2], k, restitution)
    }

    fn state(phase: f64, velocity: f64) -> Result<SingleState, OutOfRange> {
        Single::state(phase, velocity)
    }

    #[inline]
    fn is_in_range(state: SingleState) -> bool {
        Single::is_in_range(state)
    }

    fn observe(state: SingleState) -> PartState {
        Single::observe(state)
    }

    #[inline]
    fn impact(&self, state: SingleState) -> Impact<SingleState> {
        self.land(state).impact()
    }
}

impl WaveKernel for WaveSingle {
    fn on_tones(tones: [Tone; 2], k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        let is_accepted = (0.0..=1.0).contains(&restitution);
        accept("restitution", restitution, is_accepted, "0..1")?;
        let [second, third] = tones;
        let track = if second.amplitude == 0.0 && third.amplitude == 0.0 {
            Harmonics::build(second, third)?;
            TrackKind::Sine(Single::build(k, restitution)?)
        } else {
            TrackKind::Tones(Track::build(second, third, k)?)
        };
        Ok(Self {
            track,
            restitution: restitution as f32,
        })
    }
}
