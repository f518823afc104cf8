//! Many launches on one track of several tones, side by side.

use super::first::quick;
use super::launch::Launch;
use super::search;
use super::track::Track;
use crate::arithmetic::lane::simd::Simd;
use crate::arithmetic::lane::{Lane, WIDEST};
use crate::impact::double::step::Landing;
use crate::impact::kernel::{Impact, PartState};

/// The impacts of parts that lose nothing, in the widest registers of this CPU.
pub(super) fn impacts(track: &Track, states: &[PartState], impacts: &mut [Impact<PartState>]) {
    let width = if states.len() > 1 {
        Simd::widest()
    } else {
        Simd::None
    };
    impacts_in(width, track, states, impacts);
}

/// The same in registers of a width that this CPU has.
fn impacts_in(simd: Simd, track: &Track, states: &[PartState], impacts: &mut [Impact<PartState>]) {
    match simd {
        #[cfg(target_arch = "x86_64")]
        Simd::Avx512 => x86::all_avx512(track, states, impacts),
        #[cfg(target_arch = "x86_64")]
        Simd::Avx2 => x86::all_avx2(track, states, impacts),
        _ => all::<f64>(track, states, impacts),
    }
}

#[inline(always)]
fn all<L: Lane>(track: &Track, states: &[PartState], impacts: &mut [Impact<PartState>]) {
    for (states, impacts) in states.chunks(L::WIDTH).zip(impacts.chunks_mut(L::WIDTH)) {
        if track.wave.is_of_two() {
            register::<L, 2>(track, states, impacts);
        } else {
            register::<L, 3>(track, states, impacts);
        }
    }
}

/// The impacts of one register; lanes beyond the states repeat the first.
#[inline(always)]
fn register<L: Lane, const N: usize>(
    track: &Track,
    states: &[PartState],
    impacts: &mut [Impact<PartState>],
) {
    let Some(first) = states.first() else {
        return;
    };
    let (mut phases, mut velocities) = ([first.phase; WIDEST], [first.velocity; WIDEST]);
    for (n, state) in states.iter().enumerate().take(L::WIDTH) {
        phases[n] = state.phase;
        velocities[n] = state.velocity;
    }
    let launch = Launch::<L>::new::<N>(track, L::load(&phases, 0), L::load(&velocities, 0));
    let rests = launch.rests(track);
    let (landing, certain) = quick::<L, N>(track, &launch);
    let sure = L::bits(certain & !rests);
    let (flights, ends, arrivals) = (
        landing.flight.to_array(),
        landing.phase.to_array(),
        landing.arrival.to_array(),
    );
    for (n, (state, impact)) in states
        .iter()
        .zip(impacts.iter_mut())
        .enumerate()
        .take(L::WIDTH)
    {
        *impact = if sure >> n & 1 == 1 {
            landed(
                Landing {
                    flight: flights[n],
                    phase: ends[n],
                    arrival: arrivals[n],
                },
                false,
            )
        } else {
            alone::<N>(track, *state)
        };
    }
}

/// A launch of which the quick forms are not certain, or none at all.
#[cold]
fn alone<const N: usize>(track: &Track, state: PartState) -> Impact<PartState> {
    let launch = Launch::new::<N>(track, state.phase, state.velocity);
    if f64::any(launch.rests(track)) {
        return Impact {
            flight: 0.0,
            next: state,
            grazes: false,
        };
    }
    let (landing, grazes) = search::landing::<N>(track, &launch);
    landed(landing, grazes)
}

fn landed(landing: Landing<f64>, grazes: bool) -> Impact<PartState> {
    Impact {
        flight: landing.flight,
        next: PartState {
            phase: landing.phase,
            velocity: landing.arrival,
        },
        grazes,
    }
}

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
mod x86 {
    use super::{Impact, PartState, Track, all};
    use crate::arithmetic::lane::avx2::Avx2;
    use crate::arithmetic::lane::avx512::Avx512;

    pub(super) fn all_avx2(track: &Track, states: &[PartState], impacts: &mut [Impact<PartState>]) {
        #[target_feature(enable = "avx2")]
        fn inner(track: &Track, states: &[PartState], impacts: &mut [Impact<PartState>]) {
            all::<Avx2>(track, states, impacts);
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
                    continue;
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
