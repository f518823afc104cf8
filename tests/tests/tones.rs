//! Tracks of several tones: the golden impacts, an independent map, and properties of every impact.

use std::f64::consts::TAU;
use std::sync::Mutex;

use kband::arithmetic::Phase;
use kband::impact::{
    Kernel, Map, OrbitEvent, PartState, Single, Tangent, Tone, Wave, WaveKernel, WaveMap,
    WaveOrbit, WaveSingle,
};
use kband_tests::states::Random;
use kband_tests::tones::{Kind, NAMES, Seen, Tally, Track, edge, soak, track};

fn number(text: &str) -> f64 {
    text.parse().unwrap()
}

fn wave([e, th, e3, th3]: [f64; 4]) -> Wave {
    Wave::build(tone(e, th), tone(e3, th3)).unwrap()
}

/// One row of the reference.
struct Golden {
    class: &'static str,
    map: WaveMap,
    state: PartState,
    flight: f64,
    next: PartState,
    condition: f64,
}

fn golden() -> impl Iterator<Item = Golden> {
    include_str!("../reference/tones.csv")
        .lines()
        .skip(1)
        .map(|line| {
            let field: Vec<&'static str> = line.split(',').collect();
            let at = |n: usize| number(field[n]);
            Golden {
                class: field[0],
                map: WaveMap::on(wave([at(3), at(4), at(5), at(6)]), at(1), at(2)).unwrap(),
                state: WaveMap::state(at(7), at(8)).unwrap(),
                flight: at(9),
                next: PartState::new(at(10), at(11)),
                condition: at(12),
            }
        })
}

#[test]
fn every_golden_impact_has_the_right_root() {
    let mut counted = 0;
    for (n, golden) in golden().enumerate() {
        let Golden {
            class,
            map,
            state,
            flight,
            next,
            condition,
        } = golden;
        for impact in [map.impact(state), map.search(state)] {
            // The right root at any condition number: another one is at least 1e-3 away.
            assert!(
                (impact.flight / flight - 1.0).abs() < 1e-6,
                "row {n} {class} {map:?} {state:?}: {flight} {impact:?}"
            );
            if condition < 100.0 {
                assert!(
                    (impact.flight / flight - 1.0).abs() < 1e-12,
                    "row {n} {class} {map:?} {state:?}: {flight} {impact:?}"
                );
                let error = (impact.next.velocity - next.velocity).abs();
                assert!(
                    error <= 1e-12 * next.velocity.max(1e-3 * flight),
                    "{n} {impact:?} {next:?}"
                );
                let error = (impact.next.phase - next.phase).abs();
                assert!(error < 1e-12 * flight.max(1.0), "{n} {impact:?}");
                counted += 1;
            }
        }
    }
    assert!(counted > 2_500, "{counted}");
}

/// An impact without a graze flag is the first, within rounding; `soak --tones` tests more.
#[test]
fn no_impact_is_missed_in_any_arithmetic() {
    let each = 20_000;
    let wrong = Mutex::new(String::new());
    let tallies = soak(each, 81, 2, |cause| {
        let mut wrong = wrong.lock().unwrap();
        wrong.push_str(cause);
        wrong.push('\n');
    });
    let wrong = wrong.into_inner().unwrap();
    assert!(wrong.is_empty(), "{wrong}");
    for (kind, Tally(seen)) in tallies {
        for (name, seen) in NAMES.iter().zip(seen) {
            let Seen {
                launches,
                flagged,
                doubtful,
                ..
            } = seen;
            let least = if kind == Kind::Wide { each / 2 } else { each };
            assert!(launches >= least, "{name} {kind:?}: {launches}");
            let most = match (kind, *name) {
                (Kind::Edge, _) => launches / 4,
                (Kind::Grazing, _) => launches,
                _ => launches / 1000,
            };
            assert!(
                flagged + doubtful < most.max(10),
                "{name} {kind:?}: {seen:?}"
            );
        }
    }
}

/// Accuracy of a microcontroller kernel.
struct Held {
    /// Error of a flight of up to 6 rad with a condition below 30: RMS and largest, rad.
    golden: [f64; 2],
    /// Rounding of a height.
    height: f64,
}

/// Golden impacts: the right root in every row without a graze flag, within the kernel's accuracy.
fn golden_in<K: WaveKernel>(held: &Held) {
    let (mut squares, mut largest, mut counted, mut flagged) = (0.0, 0.0_f64, 0.0, 0);
    for (n, row) in golden().enumerate() {
        let Golden { map, state, .. } = row;
        let tones = [map.wave().second(), map.wave().third()];
        let kernel = K::on_tones(tones, map.k(), map.restitution()).unwrap();
        let impact = kernel.impact(K::state(state.phase, state.velocity).unwrap());
        let error = (impact.flight - row.flight).abs();
        if impact.grazes {
            flagged += 1;
        } else if row.class == "grazing" && error > 1e-3 {
            // With another rounding a launch touches where the exact one just misses, or the
            // reverse.
            let slow = K::observe(impact.next).velocity.min(row.next.velocity);
            assert!(slow < 0.02, "{n} {impact:?} {}", row.flight);
            flagged += 1;
        } else if row.condition < 30.0 && row.flight < 6.0 {
            squares += error * error;
            counted += 1.0;
            largest = largest.max(error);
            let error = (K::observe(impact.next).velocity - row.next.velocity).abs();
            assert!(error < 8.0 * held.golden[1], "{n} {} {impact:?}", row.class);
        } else {
            // If the end of a flight depends on every digit, only the stretch is checked.
            let hanging = held.height * row.condition * (1.0 + row.flight * row.flight);
            assert!(
                error < 1e-3 + hanging,
                "{n} {} {impact:?} {}",
                row.class,
                row.flight
            );
        }
    }
    let rms = f64::sqrt(squares / counted);
    assert!(
        rms < held.golden[0] && largest < held.golden[1],
        "{}: {rms:e} {largest:e}",
        K::NAME
    );
    assert!(counted > 600.0 && flagged < 220, "{counted} {flagged}");
}

const SINGLE: Held = Held {
    golden: [8e-7, 8e-6],
    height: 1e-5,
};

#[test]
fn golden_impacts_in_f32() {
    golden_in::<WaveSingle>(&SINGLE);
}

/// The push is level to 2e-11 and the velocity nearly 0.
///
/// A rounding decides between a hop of no step and a throw of twenty turns. Found by seed 7.
#[test]
fn a_launch_from_a_level_push_is_said_to_graze_in_f32() {
    let second = Tone::new(0.114_249_847_130_849_96, 3.092_621_153_433_101_6);
    let k = 0.012_204_137_630_760_67;
    let start = WaveSingle::state(6.178_004_592_814_933, 3.028_766_118_052_361e-26).unwrap();
    let tones = [second, Tone::default()];
    let impact = WaveSingle::on_tones(tones, k, 1.0).unwrap().impact(start);
    let thrown = WaveMap::on_tones(tones, k, 1.0).unwrap();
    let thrown = thrown.impact(WaveSingle::observe(start));
    assert!(
        thrown.flight > 126.0 && impact.grazes,
        "{impact:?} {thrown:?}"
    );
    // With a hop's velocity rounding decides nothing.
    let start = WaveSingle::state(6.178_004_592_814_933, 1e-6).unwrap();
    let impact = WaveSingle::on_tones(tones, k, 1.0).unwrap().impact(start);
    assert!(!impact.grazes && impact.flight > 126.0, "{impact:?}");
}

fn tone(amplitude: f64, angle: f64) -> Tone {
    Tone { amplitude, angle }
}

/// The gap over a hump is level for 0.1 rad, 1.5e-7 above 0, half a rad before the impact.
///
/// That is within the roundings of f32. Found by seed 20261127.
#[test]
fn a_flight_that_is_level_with_a_hump_is_said_to_graze_in_f32() {
    let tones = [
        tone(0.246_266_911_271_959_54, 1.163_124_047_413_816_5),
        tone(0.073_840_432_567_521_93, 2.725_558_356_411_393),
    ];
    let single = WaveSingle::on_tones(tones, 0.455_613_970_756_530_76, 0.5).unwrap();
    let at = |velocity| single.impact(WaveSingle::state(4.725_681_662_626_832, velocity).unwrap());
    assert!(at(1.652_770_400_047_302_2).grazes);
    // 1e-3 faster it is well above, 1e-3 slower well below.
    let [above, below] = [at(1.653_8), at(1.651_8)];
    assert!(
        !above.grazes && !below.grazes && above.flight - below.flight > 0.1,
        "{above:?} {below:?}"
    );
}

/// This part nearly rests on the track at the near root of the parabola.
///
/// From there Householder's steps lead 1468 rad away and back, over which f32 sums the distance
/// from launch. Found by seed 20261128.
#[test]
fn steps_that_stray_lose_no_digits_in_f32() {
    let tones = [
        tone(0.077_611_366_286_873_82, 1.514_443_180_465_87),
        Tone::default(),
    ];
    let k = 0.369_701_445_102_691_65;
    let start = WaveSingle::state(1.629_070_890_210_085_7, 0.000_190_977_909_369_394_18).unwrap();
    let impact = WaveSingle::on_tones(tones, k, 0.5).unwrap().impact(start);
    let expected = WaveMap::on_tones(tones, k, 0.5).unwrap();
    let expected = expected.impact(WaveSingle::observe(start));
    // Ten roundings of a rise of 1 over 3 rad, divided by an arrival speed of 1.3.
    let off = (impact.flight - expected.flight).abs();
    assert!(off < 1.5e-6, "{off:e}");
}

/// Launches within a few steps of the throwing edge, including the last step before a hump.
fn thrown_at_the_edge_in<K: WaveKernel>() {
    let mut random = Random::new(27);
    let mut thrown = 0;
    while thrown < 200 {
        let tones = [random.between(0.05, 0.3), random.between(-3.0, 3.0)];
        let k = f64::from(random.between(0.3, 0.9) as f32);
        let second = Tone::new(tones[0], tones[1]);
        let kernel = K::on_tones([second, Tone::default()], k, 1.0).unwrap();
        let track = Track::of(k, [tones[0], tones[1], 0.0, 0.0]);
        let Some(phase) = edge(&track, &mut random) else {
            continue;
        };
        if -track.at(phase)[3] < 0.2 {
            continue;
        }
        let psi = random.scale(3e-8, 1e-6);
        let flown = track.first_impact(phase, psi);
        // Any other flight is far from this one.
        if flown.clearance < 1e9 || flown.arrival < 0.02 {
            continue;
        }
        thrown += 1;
        for step in -8..8 {
            let phase = Phase::from_radians(phase).bits().wrapping_add_signed(step);
            let start = K::state(Phase::from_bits(phase).radians(), psi).unwrap();
            let impact = kernel.impact(start);
            assert!(
                (impact.flight - flown.duration).abs() < 2e-3,
                "{} {track:?} {step} {:?}: {impact:?} {flown:?}",
                K::NAME,
                K::observe(start)
            );
        }
    }
}

#[test]
fn what_is_launched_one_step_before_a_hump_is_thrown() {
    thrown_at_the_edge_in::<WaveSingle>();
}

#[test]
fn one_tone_keeps_its_bits() {
    let mut random = Random::new(3);
    for _ in 0..20_000 {
        let (k, restitution) = (random.between(0.02, 1.2), random.between(0.0, 1.0));
        let start = Single::state(random.between(0.0, TAU), random.scale(1e-7, 20.0)).unwrap();
        let one = Single::build(k, restitution).unwrap().impact(start);
        let tones = [Tone::new(0.0, 1.0); 2];
        let same = WaveSingle::on_tones(tones, k, restitution).unwrap();
        assert_eq!(one, same.impact(start));
    }
}

#[test]
fn one_tone_is_the_map_of_the_sine() {
    let mut random = Random::new(1);
    for _ in 0..20_000 {
        let (k, restitution) = (random.between(0.02, 1.2), random.between(0.0, 1.0));
        let state = Map::state(random.between(0.0, TAU), random.scale(1e-12, 10.0)).unwrap();
        let one = Map::build(k, restitution).unwrap().impact(state);
        let same = WaveMap::build(k, restitution).unwrap().impact(state);
        let push = (state.phase.sin() - k).abs();
        if one.grazes || same.grazes || push < 1e-12 {
            continue;
        }
        // Roundings times a condition number of up to 1e3.
        let limit = 1e-12 * one.flight.max(1.0);
        assert!(
            (one.flight - same.flight).abs() < limit,
            "{k} {state:?} {one:?} {same:?}"
        );
        assert!((one.next.velocity - same.next.velocity).abs() < limit);
    }
}

/// `det J = R^2 psi/psi'`, with the Jacobian from central differences of the map.
#[test]
fn determinant_is_r_squared_psi_over_psi_next() {
    let mut random = Random::new(4);
    let mut counted = 0;
    for _ in 0..20_000 {
        let (track, wave) = track(&mut random);
        let restitution = random.between(0.05, 1.0);
        let map = WaveMap::on(wave, track.k, restitution).unwrap();
        let state = PartState::new(random.between(0.1, TAU - 0.1), random.between(0.1, 4.0));
        let impact = map.impact(state);
        let arrival = impact.next.velocity / restitution;
        if impact.flight > 20.0 || arrival < 0.2 || !(0.1..TAU - 0.1).contains(&impact.next.phase) {
            continue;
        }
        const STEP: f64 = 1e-5;
        let at = |phase: f64, velocity: f64| {
            let impact = map.impact(PartState::new(
                state.phase + phase,
                state.velocity + velocity,
            ));
            (impact.flight + phase, impact.next.velocity, impact.flight)
        };
        let ends = [at(STEP, 0.0), at(-STEP, 0.0), at(0.0, STEP), at(0.0, -STEP)];
        if ends.iter().any(|end| (end.2 - impact.flight).abs() > 0.01) {
            // A graze lies in between.
            continue;
        }
        let slope = |a: (f64, f64, f64), b: (f64, f64, f64)| {
            ((a.0 - b.0) / (2.0 * STEP), (a.1 - b.1) / (2.0 * STEP))
        };
        let (by_phase, by_velocity) = (slope(ends[0], ends[1]), slope(ends[2], ends[3]));
        let products = (by_phase.0 * by_velocity.1, by_phase.1 * by_velocity.0);
        let expected = restitution * restitution * state.velocity / impact.next.velocity;
        let scale = products.0.abs() + products.1.abs() + expected;
        // Third derivatives of up to 1e3 times the step squared, and roundings over the step.
        let error = (products.0 - products.1 - expected).abs();
        assert!(
            error < 1e-4 * scale,
            "{track:?} {state:?} {error} of {scale}"
        );
        counted += 1;
    }
    assert!(counted > 8_000, "{counted}");
}

/// `det J = R^2 psi/psi'` of the tangent map itself.
///
/// So the sum of an orbit's exponents is `2 ln R` plus the difference of its ends.
#[test]
fn the_tangent_on_tones_has_its_determinant() {
    let mut random = Random::new(44);
    let mut counted = 0;
    for _ in 0..400 {
        let (track, wave) = track(&mut random);
        let restitution = random.between(0.3, 1.0);
        let map = WaveMap::on(wave, track.k, restitution).unwrap();
        let start = PartState::new(random.between(0.0, TAU), random.between(0.5, 4.0));
        let (mut state, mut sum) = (start, 0.0);
        for n in 0..40 {
            let impact = map.impact(state);
            let Some(tangent) = Tangent::on_tones(&map, state, &impact) else {
                break;
            };
            if impact.next.velocity < 1e-3 || impact.grazes {
                break;
            }
            let [[a, b], [c, d]] = tangent.jacobian;
            let expected = restitution * restitution * state.velocity / impact.next.velocity;
            let scale = (a * d).abs() + (b * c).abs();
            let error = (a * d - b * c - expected).abs() / scale;
            assert!(error < 1e-11, "{track:?} {state:?} {error:e}");
            if scale < 1e4 * expected {
                sum += (a * d - b * c).ln();
                counted += 1;
            } else {
                sum += expected.ln();
            }
            state = impact.next;
            let ends = (start.velocity / state.velocity).ln();
            let flights = f64::from(n + 1);
            assert!((sum - 2.0 * flights * restitution.ln() - ends).abs() < 1e-6 * flights);
        }
    }
    assert!(counted > 4_000, "{counted}");
}

/// lambda1 + lambda2 = 2 ln R on two and three tones.
///
/// Both exponents come from a frame that the tangents carry, orthogonalised after every impact. In
/// gear both are below 0, in wide chaos the first is above.
#[test]
fn the_exponents_on_tones_sum_to_twice_the_log_of_restitution() {
    const IMPACTS: u32 = 5_000;
    for (tones, k, restitution, chaotic) in [
        ([0.15, 2.356, 0.0, 0.0], 0.35, 0.2, false),
        ([0.15, 2.356, 0.07, 5.74], 0.35, 0.2, true),
        ([0.15, 2.356, 0.0, 0.0], 0.2, 0.9, true),
        ([0.15, 2.356, 0.07, 5.74], 0.05, 0.9, true),
    ] {
        let map = WaveMap::on(wave(tones), k, restitution).unwrap();
        let mut state = WaveMap::state(0.5, 0.45).unwrap();
        for _ in 0..500 {
            state = map.impact(state).next;
        }
        let first = state;
        let (mut along, mut across) = ([1.0, 0.0], [0.0, 1.0]);
        let mut sums = [0.0; 2];
        for _ in 0..IMPACTS {
            let impact = map.impact(state);
            assert!(impact.flight > 0.0, "{state:?} rests");
            let [[a, b], [c, d]] = Tangent::on_tones(&map, state, &impact).unwrap().jacobian;
            let image = |[x, y]: [f64; 2]| [a * x + b * y, c * x + d * y];
            let (u, v): ([f64; 2], [f64; 2]) = (image(along), image(across));
            let longer = u[0].hypot(u[1]);
            along = u.map(|x| x / longer);
            let shared = along[0] * v[0] + along[1] * v[1];
            let rest = [v[0] - shared * along[0], v[1] - shared * along[1]];
            let shorter = rest[0].hypot(rest[1]);
            across = rest.map(|x| x / shorter);
            sums[0] += longer.ln();
            sums[1] += shorter.ln();
            state = impact.next;
        }
        let [larger, smaller] = sums.map(|sum| sum / f64::from(IMPACTS));
        let ends = (first.velocity / state.velocity).ln() / f64::from(IMPACTS);
        let off = larger + smaller - ends - 2.0 * restitution.ln();
        assert!(off.abs() < 1e-9, "{off:e}");
        assert_eq!(larger > 0.0, chaotic, "{larger}");
    }
}

/// Resting parts are thrown where the push rises through k, in the next window.
#[test]
fn a_resting_part_is_thrown_by_the_next_window() {
    let mut random = Random::new(9);
    let mut windows = [0; 4];
    for _ in 0..4_000 {
        let (track, wave) = track(&mut random);
        let map = WaveMap::on(wave, track.k, 0.3).unwrap();
        let excess = |phase: f64| -track.at(phase)[2] - track.k;
        let mut phases: Vec<f64> = Vec::new();
        for n in 0..64 {
            let phase = TAU * f64::from(n) / 64.0;
            let velocity = 0.0;
            let mut orbit = WaveOrbit::new(&map, PartState { phase, velocity });
            if let Some(OrbitEvent::Impact(_)) = orbit.next() {
                assert!(excess(phase) > -1e-12);
                continue;
            }
            let Some(OrbitEvent::LiftOff {
                wait,
                phase: thrown,
            }) = orbit.next()
            else {
                assert!(wave.highest_throw() <= track.k);
                continue;
            };
            assert!(wait < TAU && excess(thrown).abs() < 1e-9);
            assert!(excess(thrown + 1e-4) > excess(thrown - 1e-4));
            // No earlier phase throws the part.
            let earlier = (1..200).map(|m| excess(phase + wait * f64::from(m) / 200.0));
            assert!(earlier.fold(f64::MIN, f64::max) < 1e-9);
            if !phases.contains(&thrown) {
                phases.push(thrown);
            }
        }
        windows[phases.len()] += 1;
    }
    // One window a turn, two and three.
    assert!(
        windows[1] > 1000 && windows[2] > 500 && windows[3] > 20,
        "{windows:?}"
    );
}
