//! The impact map under criterion: `cargo bench -p kband-host`.
//!
//! Independent impacts on the workloads of `kband bench`, and orbits on one tone and on two: each
//! impact from the end of the one before, which a CPU cannot overlap.

use std::hint::black_box;
use std::time::Duration;

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion, Throughput, criterion_group, criterion_main};
use kband::impact::{Hybrid, Integer, Kernel, Map, Single, Tone, WaveKernel, WaveMap, WaveSingle};
use kband_host::bench::baseline::Textbook;
use kband_host::bench::contestants;
use kband_host::bench::workload::WORKLOADS;

/// Launches of a workload.
const LAUNCHES: usize = 4096;
/// Second tone, within a drive's limits; it keeps parts of restitution 0.1 to 0.5 in gear.
const SECOND: Tone = Tone {
    amplitude: 0.15,
    angle: 2.356,
};

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
        orbit(&mut group, WaveMap::on_tones(tones, k, restitution));
        orbit(&mut group, WaveSingle::on_tones(tones, k, restitution));
        group.finish();
    }
}

fn orbit<K: Kernel, E: std::fmt::Debug>(
    group: &mut BenchmarkGroup<'_, WallTime>,
    kernel: Result<K, E>,
) {
    let kernel = kernel.expect("k and restitution are within range");
    let mut state = K::state(0.7, 0.36).expect("within range");
    group.bench_function(K::NAME, |bencher| {
        bencher.iter(|| state = black_box(kernel.impact(state).next));
    });
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    targets = independent, orbits
}
criterion_main!(benches);
