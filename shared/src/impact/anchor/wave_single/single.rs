//! The impact map in f32 on a track of several tones.

use super::harmonics::Parts;
use super::launch::Launch;
use super::search::{bisect, candidate, may_leave, search};
use super::track::Track;
use crate::arithmetic::Phase;
use crate::feeder::{OutOfRange, accept_in};
use crate::impact::anchor::approach::fall;
use crate::impact::anchor::candidate::Candidate;
use crate::impact::anchor::flight::{Ballistic, STEPS_PER_RADIAN, smaller};
use crate::impact::anchor::sine_track::SineTrack;
use crate::impact::anchor::single::{self, SingleState, land_found, land_near};
use crate::impact::anchor::solve::Found;
use crate::impact::kernel::{
    Impact, Kernel, Landing, MAX_VELOCITY, PartState, WaveKernel, accept_phase, accept_velocity,
};
use crate::impact::set_up::SetUp;
use crate::impact::wave::{Tone, accept_tones};

/// The impact map in f32, on a track of one to three tones (`f32`).
///
/// The phase is an integer, so it never drifts. Everything else is f32. The resolution of f32 at
/// the flight time limits the error. Measured against the f64 map from the same 400 000 states, k
/// 0.02..0.98:
///
/// | velocities | phase error: median | p99 | max (rad) | velocity: max |
/// |---|---|---|---|---|
/// | 0..20 | 1.8e-6 | 5.3e-5 | 3.4e-4 | 2.5e-4 |
/// | 0..3 | 2.2e-7 | 8.6e-6 | 8.6e-5 | 4.7e-5 |
/// | 3e-7..3, logarithmic | 6e-9 | 3.1e-6 | 3.9e-4 | 6.9e-5 |
///
/// The first impact is the right one down to a gap of 1e-5 over a hump, times the flight time above
/// 1 rad. Nearer ones are flagged. An impact takes about 190 instructions on a Cortex-M4F, at
/// most 302 on any locked or chaotic orbit tried.
///
/// Range: k 0.005..=4, restitution 0..=1, velocity 0..=60. With a restitution above 0.96 an impact
/// may leave faster, by at most 2.5. Its velocity is then right. `Single::state` refuses it, and a
/// launch from it is limited to 60.
///
/// On several tones the last step, of up to 0.02 rad, leaves a thousandth of itself. It leaves more
/// where the track's third derivative is large relative to the arrival speed, a few 1e-5 rad. The
/// set-up uses f32 and integers, for the planner on a board. It takes about 6 000 instructions of a
/// Cortex-M4F, where an impact takes some 400, and 200 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Single {
    track: TrackKind,
    restitution: f32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum TrackKind {
    Sine(SineTrack),
    Tones(Track),
}

impl Single {
    fn on(track: TrackKind, restitution: f64) -> Result<Self, OutOfRange> {
        accept_in("restitution", restitution, 0.0..=1.0, "0..1")?;
        Ok(Self {
            track,
            restitution: restitution as f32,
        })
    }

    /// One flight and the impact that ends it. A resting part stays: flight 0.
    #[inline(always)]
    pub fn land(&self, state: SingleState) -> Landing<SingleState> {
        self.land_at(state, self.restitution)
    }

    /// [`Single::land`] with another restitution, 0..=1, at the impact.
    #[inline(always)]
    pub(crate) fn land_at(&self, state: SingleState, restitution: f32) -> Landing<SingleState> {
        match &self.track {
            TrackKind::Sine(track) => track.land(state, restitution),
            TrackKind::Tones(track) => land(track, state, restitution),
        }
    }

    pub(crate) fn throws(&self, phase: Phase) -> bool {
        match &self.track {
            TrackKind::Sine(track) => track.throws(phase.bits()),
            TrackKind::Tones(track) => track.throws(phase.bits()),
        }
    }

    /// Next lift-off phase of a part that rests at `phase`; `None` if it rests for ever.
    pub(crate) fn lift_off(&self, phase: Phase) -> Option<Phase> {
        match &self.track {
            TrackKind::Sine(track) => (track.hump > 0).then(|| Phase::from_bits(track.lift_off)),
            TrackKind::Tones(track) => track.lift_off(phase.bits()).map(Phase::from_bits),
        }
    }
}

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
    if let Some(approach) = fall(track, phase, height, rise) {
        return land_near(phase, &approach, restitution);
    }
    land_low(&flight, velocity, &parts, restitution)
}

#[inline(never)]
fn land_low(
    flight: &Ballistic<'_, Track>,
    velocity: f32,
    parts: &Parts,
    restitution: f32,
) -> Landing<SingleState> {
    let Ballistic { track, phase, .. } = *flight;
    let throws = track.throws(phase);
    if velocity == 0.0 && !throws {
        let phase = Phase::from_bits(phase);
        return Landing::at_rest(SingleState { phase, velocity });
    }
    let launch = Launch::new(track, phase, velocity, parts, throws);
    if !launch.is_undecided()
        && let Some((candidate, limits)) = candidate(track, &launch)
    {
        let landing = match candidate {
            Candidate::Hop { flight, arrival } => {
                single::land_short(phase, flight, arrival, restitution, false)
            }
            Candidate::Near(approach) => land_near(phase, &approach, restitution),
        };
        if limits.contain(track, &launch, landing.steps) {
            return landing;
        }
    }
    land_by_search(flight, &launch, restitution)
}

#[inline(never)]
fn land_by_search(
    flight: &Ballistic<'_, Track>,
    launch: &Launch,
    restitution: f32,
) -> Landing<SingleState> {
    let (root, grazes, bracket) = search(launch, flight);
    let grazes = grazes || launch.is_undecided();
    let landing = land_found(flight, restitution, root, grazes);
    if matches!(root, Found::Near { .. })
        && may_leave(&bracket, landing.steps, landing.next.velocity)
    {
        let (time, speed) = bisect(launch, flight, &bracket);
        let steps = (time * STEPS_PER_RADIAN) as i64;
        return single::landing(flight.phase, steps, speed, restitution, true);
    }
    landing
}

impl Kernel for Single {
    type State = SingleState;

    const NAME: &'static str = "f32";

    /// The map of the sine alone; [`WaveKernel::on_tones`] takes tones.
    fn build(k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        let track = SineTrack::new(&SetUp::build(k)?);
        Self::on(TrackKind::Sine(track), restitution)
    }

    fn state(phase: f64, velocity: f64) -> Result<SingleState, OutOfRange> {
        accept_phase(phase)?;
        accept_velocity(velocity)?;
        Ok(SingleState {
            phase: Phase::from_radians(phase),
            velocity: velocity as f32,
        })
    }

    fn observe(state: SingleState) -> PartState {
        PartState::new(state.phase.radians(), f64::from(state.velocity))
    }

    #[inline]
    fn impact(&self, state: SingleState) -> Impact<SingleState> {
        self.land(state).impact()
    }
}

impl WaveKernel for Single {
    fn on_tones([second, third]: [Tone; 2], k: f64, restitution: f64) -> Result<Self, OutOfRange> {
        if second.amplitude == 0.0 && third.amplitude == 0.0 {
            accept_tones(second, third)?;
            return Self::build(k, restitution);
        }
        let track = Track::build(second, third, k)?;
        Self::on(TrackKind::Tones(track), restitution)
    }
}
