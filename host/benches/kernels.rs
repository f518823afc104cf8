//! The kernels and workloads of `kband bench` under criterion: `cargo bench -p kband-host`.

use std::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use kband_host::bench::contest::contestants;
use kband_host::bench::workload::Workload;

/// Launches of a workload.
const LAUNCHES: usize = 4096;

fn kernels(criterion: &mut Criterion) {
    for workload in Workload::ALL {
        let launches = workload.launches(LAUNCHES);
        let mut group = criterion.benchmark_group(workload.name());
        group.throughput(Throughput::Elements(1));
        for mut contestant in contestants(workload, &launches) {
            let name = contestant.name();
            group.bench_function(name, |bencher| {
                // A turn times itself, without its preparation; an iteration is one impact of it.
                bencher.iter_custom(|turns| {
                    let nanoseconds: f64 = (0..turns)
                        .map(|n| contestant.turn(n as usize % contestant.turns().max(1)))
                        .sum();
                    Duration::from_nanos(nanoseconds as u64)
                });
            });
        }
        group.finish();
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    targets = kernels
}
criterion_main!(benches);
