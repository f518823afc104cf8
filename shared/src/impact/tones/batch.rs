//! Many launches on one track of several tones, side by side.
//!
//! They are sorted by the kind of their flights, so that all lanes of a register take the same path.

use super::first::{Kind, first_impact};
use super::launch::Launch;
use super::search;
use super::track::Track;
use crate::arithmetic::lane::queue::Queue;
use crate::arithmetic::lane::simd::Simd;
use crate::arithmetic::lane::{COLUMN, Lane};
use crate::impact::double::step::impact_of;
use crate::impact::kernel::{Impact, PartState};

/// The impacts of parts that lose nothing, in the widest registers of this CPU.
pub(super) fn impacts(track: &Track, states: &[PartState], impacts: &mut [Impact<PartState>]) {
    impacts_in(Simd::widest(), track, states, impacts);
}

/// The same in registers of a width, or the widest that this CPU has.
pub(super) fn impacts_in(
    simd: Simd,
    track: &Track,
    states: &[PartState],
    impacts: &mut [Impact<PartState>],
) {
    match simd.min(Simd::widest()) {
        _ if states.len() < 2 => all_alone(track, states, impacts),
        #[cfg(target_arch = "x86_64")]
        Simd::Avx512 => x86::all_avx512(track, states, impacts),
        #[cfg(target_arch = "x86_64")]
        Simd::Avx2 => x86::all_avx2(track, states, impacts),
        _ => all_alone(track, states, impacts),
    }
}

/// One after the other.
fn all_alone(track: &Track, states: &[PartState], impacts: &mut [Impact<PartState>]) {
    for (state, impact) in states.iter().zip(impacts) {
        *impact = if track.wave.is_of_two() {
            alone::<2>(track, *state)
        } else {
            alone::<3>(track, *state)
        };
    }
}

fn alone<const N: usize>(track: &Track, state: PartState) -> Impact<PartState> {
    let launch = Launch::new::<N>(track, state.phase, state.velocity);
    impact_of(1.0, state, first_impact::<N>(track, &launch))
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

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
mod x86 {
    use super::{Impact, PartState, Track, all};
    use crate::arithmetic::lane::avx2::Avx2;
    use crate::arithmetic::lane::avx512::Avx512;
    use crate::arithmetic::lane::twice::Twice;

    pub(super) fn all_avx2(track: &Track, states: &[PartState], impacts: &mut [Impact<PartState>]) {
        #[target_feature(enable = "avx2")]
        fn inner(track: &Track, states: &[PartState], impacts: &mut [Impact<PartState>]) {
            all::<Twice<Avx2>>(track, states, impacts);
        }
        // SAFETY: this width is chosen only where the CPU has AVX2.
        unsafe { inner(track, states, impacts) }
    }

    pub(super) fn all_avx512(
        track: &Track,
        states: &[PartState],
        impacts: &mut [Impact<PartState>],
    ) {
        #[target_feature(enable = "avx512f,avx512dq,avx2")]
        fn inner(track: &Track, states: &[PartState], impacts: &mut [Impact<PartState>]) {
            all::<Avx512>(track, states, impacts);
        }
        // SAFETY: this width is chosen only where the CPU has AVX-512 F and DQ.
        unsafe { inner(track, states, impacts) }
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;
    use crate::impact::kernel::Kernel;
    use crate::impact::tones::WaveMap;
    use crate::impact::wave::{Tone, Wave};

    #[test]
    fn every_lane_is_the_map_bit_for_bit_in_every_width() {
        let mut uncertain = 0;
        for n in 0..300 {
            let spread = |factor: f64| (f64::from(n) * factor).rem_euclid(1.0);
            let tone = |a: f64, b: f64| Tone {
                amplitude: 0.5 * spread(a),
                angle: 6.0 * spread(b),
            };
            let third = if n % 2 == 0 {
                tone(0.732, 0.236)
            } else {
                Tone::default()
            };
            let wave = Wave::build(tone(0.618, 0.414), third).unwrap();
            let map = WaveMap::on(wave, 0.03 + 1.4 * spread(0.303), 1.0).unwrap();
            let states: Vec<PartState> = (0..61)
                .map(|m| {
                    let spread = |factor: f64| (f64::from(61 * n + m) * factor).rem_euclid(1.0);
                    let velocity = if m % 7 == 0 {
                        0.0
                    } else {
                        libm::pow(10.0, 5.0 * spread(0.123_7) - 3.5)
                    };
                    WaveMap::state(7.0 * spread(0.618_034), velocity).unwrap()
                })
                .collect();
            let mut impacts = std::vec![map.impact(states[0]); states.len()];
            for simd in Simd::ALL {
                if simd > Simd::widest() {
                    std::println!("this CPU has no {simd:?}");
                }
                impacts_in(simd, map.track(), &states, &mut impacts);
                for (state, impact) in states.iter().zip(&impacts) {
                    assert_eq!(map.impact(*state), *impact, "{simd:?} {map:?} {state:?}");
                }
            }
            uncertain += impacts.iter().filter(|impact| impact.flight == 0.0).count();
        }
        assert!(uncertain > 100, "{uncertain}");
    }
}
