//! Tests of the arithmetics, launch by launch. tests/tests/first_impact.rs proves the impacts.

use core::f64::consts::{FRAC_PI_2, TAU};
use std::format;
use std::string::String;

use super::*;
use crate::feeder::OutOfRange;

/// Kinds of launch.
const KINDS: [&str; 8] = [
    "fast",
    "slow",
    "without a hump",
    "past a crest",
    "low",
    "at the edge of a hump",
    "touching a crest",
    "wide",
];

/// Phase in rad at which the track throws a resting part; that of the sine if it throws none.
fn lift_off(tones: [Tone; 2], k: f64) -> f64 {
    let map = WaveMap::on_tones(tones, k, 0.8).unwrap();
    let thrown = map.throw(1.5 * core::f64::consts::PI);
    thrown.map_or(libm::asin(k), |(_, phase)| phase)
}

/// k, phase in rad and velocity in `b w` of launch `n` of a kind, on a track of these tones.
fn launch(kind: usize, n: u32, tones: [Tone; 2]) -> [f64; 3] {
    let [w, x, y, z] = [0.414_214, 0.618_034, 0.732_051, 0.236_068]
        .map(|factor| (f64::from(n) * factor).rem_euclid(1.0));
    let (k, phase) = (0.02 + 0.96 * x, TAU * w);
    // After d, at a crest, the part is at this height and slope over the track.
    let past_crest = |height: f64, slope: f64| {
        let d = FRAC_PI_2 + TAU * libm::floor(1.0 + 3.0 * z) - phase;
        let k = 2.0 * (1.0 + height - libm::sin(phase) - slope * d) / (d * d);
        [k, phase, k * d + slope - libm::cos(phase)]
    };
    match KINDS[kind] {
        "fast" => [k, phase, 20.0 * y],
        "slow" => [k, phase, 3.0 * libm::exp10(-7.0 * y)],
        "without a hump" => [1.0 + 3.0 * x, phase, 20.0 * y],
        "past a crest" => past_crest(0.02 * (x - 0.5), 0.4 * (y - 0.5)),
        "low" => [k, phase, 3.0 * y],
        "at the edge of a hump" => {
            let off = (z - 0.5).signum() * libm::exp10(-12.0 * w);
            let velocity = if x < 0.2 { 0.0 } else { libm::exp10(-10.0 * y) };
            [k, lift_off(tones, k) + off, velocity]
        }
        "touching a crest" => past_crest((x - 0.5).signum() * libm::exp10(-9.0 * y), 1e-3 * z),
        _ => [3.0 * libm::exp10(-2.7 * x), phase, 60.0 * y * y],
    }
}

/// Of launches that are rarely within rounding of a touch.
#[test]
fn a_wave_of_one_tone_has_the_impacts_of_the_sine() {
    let mut compared = 0;
    for n in 0..24_000 {
        let [k, phase, velocity] = launch(n as usize % 4, n, [Tone::default(); 2]);
        if k < 0.02 || velocity < 0.0 {
            continue;
        }
        let state = Map::state(phase, velocity).unwrap();
        let actual = WaveMap::build(k, 0.8).unwrap().impact(state);
        let expected = Map::build(k, 0.8).unwrap().impact(state);
        if actual.grazes || expected.grazes {
            continue;
        }
        compared += 1;
        let speed_error = (actual.next.velocity - expected.next.velocity).abs();
        let error = speed_error.max((actual.flight - expected.flight).abs());
        assert!(error < 1e-9, "{k:e} {state:?}: {error:e}");
    }
    assert!(compared > 18_000);
}

/// Hash (FNV-1a) of the flights, states and flags of some 12 thousand impacts, a line for each kind.
fn hashes<K: Kernel>(
    label: &str,
    tones: [Tone; 2],
    build: impl Fn([Tone; 2], f64) -> Result<K, OutOfRange>,
) -> String {
    let mut lines = String::new();
    for (kind, name) in KINDS.iter().enumerate() {
        let (mut hash, mut count) = (0xcbf2_9ce4_8422_2325_u64, 0);
        for [k, phase, velocity] in (0..12_000).map(|n| launch(kind, n, tones)) {
            let (Ok(kernel), Ok(state)) = (build(tones, k), K::state(phase, velocity)) else {
                continue;
            };
            let impact = kernel.impact(state);
            let next = K::observe(impact.next);
            let words = [impact.flight, next.phase, next.velocity].map(f64::to_bits);
            for word in words.into_iter().chain([u64::from(impact.grazes)]) {
                hash = (hash ^ word).wrapping_mul(0x100_0000_01b3);
            }
            count += 1;
        }
        assert!(count > 5_000, "{} {name}: {count}", K::NAME);
        lines += &format!("{} {label}, {name}: {hash:016x} of {count}\n", K::NAME);
    }
    lines
}

/// The bits are those of bits.txt. `KBAND_ACCEPT=1` writes it after an intended change.
#[test]
fn every_arithmetic_keeps_its_bits() {
    let sine = [Tone::default(); 2];
    let two = [Tone::new(0.15, 2.356), Tone::default()];
    let three = [Tone::new(0.3, 1.0), Tone::new(0.1, 5.74)];
    let single = |tones, k| Single::on_tones(tones, k, 0.8);
    let double = |tones, k| WaveMap::on_tones(tones, k, 0.8);
    let actual = [
        hashes("one tone", sine, |_, k| Integer::build(k, 0.8)),
        hashes("one tone", sine, single),
        hashes("two tones", two, single),
        hashes("three tones", three, single),
        hashes("one tone", sine, |_, k| Map::build(k, 0.8)),
        hashes("two tones", two, double),
        hashes("three tones", three, double),
    ]
    .concat();
    if std::env::var_os("KBAND_ACCEPT").is_some() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/src/impact/bits.txt");
        std::fs::write(file, &actual).unwrap();
        return;
    }
    let accepted = include_str!("bits.txt");
    for (line, accepted) in actual.lines().zip(accepted.lines()) {
        assert_eq!(line, accepted);
    }
    assert_eq!(actual.len(), accepted.len(), "lines at the end");
}
