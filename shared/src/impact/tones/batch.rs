//! Many launches on one track of several tones, side by side where the CPU has registers for it.

use super::first::first_impact;
use super::launch::Launch;
#[cfg(target_arch = "x86_64")]
use super::sorted;
use super::track::Track;
use crate::arithmetic::lane::simd::Simd;
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
        Simd::Avx512 => sorted::all_avx512(track, states, impacts),
        #[cfg(target_arch = "x86_64")]
        Simd::Avx2 => sorted::all_avx2(track, states, impacts),
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
