//! The impact map under criterion: `cargo bench -p kband-host`.
//!
//! Independent impacts on the workloads of `kband bench`, and orbits on one tone and on two: each
//! impact from the end of the one before, which a CPU cannot overlap. Then what commands are made
//! of: exponents, shares in gear, cascades, drive cycles. All times are CPU times of the thread.

use std::hint::black_box;
use std::time::Duration;

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion, Throughput, criterion_group, criterion_main};
use kband::impact::{Hybrid, Integer, Kernel, Map, Scatter, Single, Tone, WaveKernel, WaveMap};
use kband::regime::cascade::Cascade;
use kband::regime::exponent::{ExponentSettings, measure, measure_together, start_near_lock};
use kband::regime::gear::shares_from_rest;
use kband_control::Target;
use kband_host::bench::baseline::Textbook;
use kband_host::bench::workload::WORKLOADS;
use kband_host::bench::{contestants, cpu_time};
use kband_plant::{EnvelopeLoop, Scene};

/// Launches of a workload.
const LAUNCHES: usize = 4096;
/// Second tone, within a drive's limits; it keeps parts of restitution 0.1 to 0.5 in gear.
const SECOND: Tone = Tone::new(0.15, 2.356);

fn independent(criterion: &mut Criterion) {
    for (name, launches) in WORKLOADS {
        let mut group = criterion.benchmark_group(name);
        group.throughput(Throughput::Elements(1));
        for mut contestant in contestants(&launches(LAUNCHES)) {
            group.bench_function(contestant.name(), |bencher| {
                // A pass times itself, without its preparation; an iteration is one impact of it.
                bencher.iter_custom(|passes| {
                    let nanoseconds: f64 = (0..passes).map(|_| contestant.pass()).sum();
                    Duration::from_nanos(nanoseconds as u64)
                });
            });
        }
        group.finish();
    }
}

/// A lock, chaos in gear, and a lively part that flies over many cycles: none ever rests.
fn orbits(criterion: &mut Criterion) {
    for (name, k, restitution) in [
        ("lock", 0.43, 0.2),
        ("chaos", 0.34, 0.2),
        ("wide chaos", 0.2, 0.95),
    ] {
        let tones = [SECOND, Tone::default()];
        let mut group = criterion.benchmark_group(name);
        orbit(&mut group, Textbook::build(k, restitution));
        orbit(&mut group, Map::build(k, restitution));
        orbit(&mut group, Hybrid::build(k, restitution));
        orbit(&mut group, Single::build(k, restitution));
        orbit(&mut group, Integer::build(k, restitution));
        group.finish();
        let mut group = criterion.benchmark_group(format!("{name}, two tones"));
        orbit(&mut group, WaveMap::on_tones(tones, k, restitution));
        orbit(&mut group, Single::on_tones(tones, k, restitution));
        group.finish();
    }
}

fn orbit<K: Kernel, E: std::fmt::Debug>(
    group: &mut BenchmarkGroup<'_, WallTime>,
    kernel: Result<K, E>,
) {
    let kernel = kernel.expect("k and restitution are within range");
    let mut state = K::state(0.7, 0.36).expect("within range");
    timed(group, K::NAME, || {
        state = black_box(kernel.impact(state).next)
    });
}

/// Measures the CPU time of `work`.
fn timed(group: &mut BenchmarkGroup<'_, WallTime>, name: &str, mut work: impl FnMut()) {
    group.bench_function(name, |bencher| {
        bencher.iter_custom(|times| {
            let begun = cpu_time();
            (0..times).for_each(|_| work());
            cpu_time().saturating_sub(begun)
        });
    });
}

/// Exponents an impact, shares in gear a drive period, and whole cascades.
fn measurements(criterion: &mut Criterion) {
    const IMPACTS: u32 = 2000;
    const ORBITS: usize = 8;
    const PERIODS: f64 = 250.0;
    let settings = ExponentSettings {
        settle: 0,
        impacts: IMPACTS,
    };
    for (name, k) in [("exponent, lock", 0.43), ("exponent, chaos", 0.34)] {
        let map = Map::build(k, 0.2).expect("within range");
        let start = start_near_lock(&map, 1);
        let mut group = criterion.benchmark_group(name);
        group.throughput(Throughput::Elements(IMPACTS.into()));
        timed(&mut group, "alone", || {
            black_box(measure(&map, start, settings).expect("within range"));
        });
        group.throughput(Throughput::Elements((ORBITS as u64) * u64::from(IMPACTS)));
        timed(&mut group, "side by side", || {
            let found = measure_together(&map, [start; ORBITS], settings);
            black_box(found.expect("within range"));
        });
        group.finish();
    }
    let mut group = criterion.benchmark_group("gear");
    group.throughput(Throughput::Elements(PERIODS as u64));
    for (name, k) in [("in gear", 0.42), ("out of gear", 0.5)] {
        let tones = [SECOND, Tone::default()];
        let map = WaveMap::on_tones(tones, k, 0.3).expect("within range");
        let scatter = Scatter::build(0.3, 0.05, 1).expect("within range");
        timed(&mut group, name, || {
            shares_from_rest(&map, &[scatter], 1, PERIODS, |_, share| {
                black_box(share);
            })
            .expect("within range");
        });
    }
    group.finish();
    let mut group = criterion.benchmark_group("cascade");
    timed(&mut group, "6 doublings", || {
        black_box(Cascade::locate(0.2, 1, 6).expect("within range"));
    });
    group.finish();
}

/// Drive cycles of the closed loop in gear, with the detection of gear for READY and without, and
/// at a fixed amplitude.
fn closed_loop(criterion: &mut Criterion) {
    const CYCLES: u32 = 250;
    let mut group = criterion.benchmark_group("closed loop");
    group.throughput(Throughput::Elements(CYCLES.into()));
    for (name, target, ready) in [
        ("gear, READY read", Target::Gear { order: 1 }, true),
        ("gear, READY unread", Target::Gear { order: 1 }, false),
        ("fixed amplitude", Target::Amplitude(0.23), true),
    ] {
        let scene = Scene {
            target,
            ..Scene::default()
        };
        let mut closed = EnvelopeLoop::build(&scene).expect("within range");
        closed.watch_ready(ready);
        // The plan and the first estimate of the share are done.
        (0..500).for_each(|_| closed.advance());
        timed(&mut group, name, || {
            (0..CYCLES).for_each(|_| closed.advance())
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    targets = independent, orbits, measurements, closed_loop
}
criterion_main!(benches);
