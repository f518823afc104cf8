//! Launches sorted by the kind of their flights, so that all lanes of a register take the same path.

use super::first::Kind;
use super::launch::Launch;
use super::search;
use super::track::Track;
use crate::arithmetic::lane::avx2::Avx2;
use crate::arithmetic::lane::avx512::Avx512;
use crate::arithmetic::lane::queue::Queue;
use crate::arithmetic::lane::twice::Twice;
use crate::arithmetic::lane::{COLUMN, Lane};
use crate::impact::double::step::impact_of;
use crate::impact::kernel::{Impact, PartState};

/// The impacts of parts that lose nothing, in registers of AVX2 two by two.
#[allow(unsafe_code)]
pub(super) fn all_avx2(track: &Track, states: &[PartState], impacts: &mut [Impact<PartState>]) {
    #[target_feature(enable = "avx2")]
    fn inner(track: &Track, states: &[PartState], impacts: &mut [Impact<PartState>]) {
        all::<Twice<Avx2>>(track, states, impacts);
    }
    // SAFETY: this width is chosen only where the CPU has AVX2.
    unsafe { inner(track, states, impacts) }
}

/// The same in registers of AVX-512.
#[allow(unsafe_code)]
pub(super) fn all_avx512(track: &Track, states: &[PartState], impacts: &mut [Impact<PartState>]) {
    #[target_feature(enable = "avx512f,avx512dq,avx2")]
    fn inner(track: &Track, states: &[PartState], impacts: &mut [Impact<PartState>]) {
        all::<Avx512>(track, states, impacts);
    }
    // SAFETY: this width is chosen only where the CPU has AVX-512 F and DQ.
    unsafe { inner(track, states, impacts) }
}

#[inline(always)]
fn all<L: Lane>(track: &Track, states: &[PartState], impacts: &mut [Impact<PartState>]) {
    for (states, impacts) in states.chunks(COLUMN).zip(impacts.chunks_mut(COLUMN)) {
        if track.wave.is_of_two() {
            column::<L, 2>(track, states, impacts);
        } else {
            column::<L, 3>(track, states, impacts);
        }
    }
}

/// The impacts of at most a column of launches.
#[inline(always)]
fn column<L: Lane, const N: usize>(
    track: &Track,
    states: &[PartState],
    impacts: &mut [Impact<PartState>],
) {
    let [mut phases, mut velocities, mut sines, mut cosines] = [[0.0; COLUMN]; 4];
    for ((phase, velocity), state) in phases.iter_mut().zip(&mut velocities).zip(states) {
        (*phase, *velocity) = (state.phase, state.velocity);
    }
    let mut kinds = [const { Queue::EMPTY }; Kind::ALL.len()];
    for at in (0..states.len().min(COLUMN)).step_by(L::WIDTH) {
        let launch = Launch::<L>::new::<N>(track, L::load(&phases, at), L::load(&velocities, at));
        let held = u32::MAX >> (32 - (states.len() - at).min(L::WIDTH));
        let [sine, cosine] = launch.parts[0];
        sine.store(&mut sines, at);
        cosine.store(&mut cosines, at);
        for (kind, queue) in Kind::of::<L, N>(track, &launch).into_iter().zip(&mut kinds) {
            queue.push_bits(at, L::bits(kind) & held);
        }
    }
    let [_, _, onces, lows] = &mut kinds;
    lows.fill_from(onces, L::WIDTH);
    for (kind, queue) in Kind::ALL.into_iter().zip(&mut kinds) {
        for (lanes, count) in queue.registers(L::WIDTH) {
            let launch = Launch::with::<N>(
                track,
                L::pick(&phases, lanes),
                L::pick(&velocities, lanes),
                L::pick(&sines, lanes),
                L::pick(&cosines, lanes),
            );
            let (landing, certain) = kind.landing::<L, N>(track, &launch);
            let sure = L::bits(certain & !launch.rests(track));
            let (flights, ends, arrivals) = (
                landing.flight.to_array(),
                landing.phase.to_array(),
                landing.arrival.to_array(),
            );
            for (n, &lane) in lanes.iter().enumerate().take(count) {
                let lane = usize::from(lane);
                let (Some(state), Some(impact)) = (states.get(lane), impacts.get_mut(lane)) else {
                    continue;
                };
                *impact = if sure >> n & 1 == 1 {
                    Impact {
                        flight: flights[n],
                        next: PartState {
                            phase: ends[n],
                            velocity: arrivals[n],
                        },
                        grazes: false,
                    }
                } else {
                    uncertain::<N>(track, *state)
                };
            }
        }
    }
}

/// A launch of which its kind's form is not certain, or none at all.
#[cold]
fn uncertain<const N: usize>(track: &Track, state: PartState) -> Impact<PartState> {
    let launch = Launch::new::<N>(track, state.phase, state.velocity);
    let rests = f64::any(launch.rests(track));
    let landing = (!rests).then(|| search::landing::<N>(track, &launch));
    impact_of(1.0, state, landing)
}
