//! The estimated share in gear of one part against the plant's own.

use core::f64::consts::TAU;

use kband::regime::classify::Regime;
use kband::regime::gear::GearWatch;
use kband_control::{GearMargin, Target};
use kband_plant::{EnvelopeLoop, Scene};

use super::fidelity::record;

/// True and estimated share in gear, cycles with a detected lock, and the last margin.
struct Heard {
    truth: f64,
    heard: f64,
    locked: usize,
    margin: Option<GearMargin>,
}

/// One part at a fixed k for a minute, several runs.
fn listen(restitution: f32, scatter: f32, k: f32, runs: u64) -> Heard {
    const CYCLES: usize = 3000;
    const SETTLED: usize = 250;
    let mut all = Heard {
        truth: 0.0,
        heard: 0.0,
        locked: 0,
        margin: None,
    };
    for seed in 0..runs {
        let mut scene = Scene {
            target: Target::K(k),
            seed: 100 + seed,
            parts: core::iter::once(restitution).collect(),
            scatter: core::iter::once(scatter).collect(),
            ..Scene::default()
        };
        scene.settings.scatter = scatter;
        scene.settings.restitution_low = restitution;
        scene.settings.restitution_high = restitution;
        let mut closed = EnvelopeLoop::build(&scene).unwrap();
        let mut watch = GearWatch::build(1).unwrap();
        for cycle in 0..CYCLES {
            let report = closed.cycle().report;
            if cycle == SETTLED {
                watch.begin(cycle as f64 * TAU);
            }
            record(core::slice::from_mut(&mut watch), closed.strikes());
            if cycle >= SETTLED {
                let share = f64::from(report.in_gear) / (CYCLES - SETTLED) as f64;
                all.heard += share / runs as f64;
                let locked = report.regime.is_some_and(|heard| {
                    matches!(heard.regime, Regime::Locked { .. }) && heard.confidence > 0.5
                });
                all.locked += usize::from(locked);
            }
            all.margin = report.margin.or(all.margin);
        }
        all.truth += watch.share(CYCLES as f64 * TAU).share() / runs as f64;
    }
    all
}

/// The rows of the manual's table with one tone.
#[test]
fn gear_of_one_part_is_estimated_within_its_error() {
    for (restitution, scatter, k) in [
        (0.2, 0.05, 0.41),
        (0.3, 0.05, 0.45),
        (0.4, 0.05, 0.50),
        (0.5, 0.05, 0.55),
        (0.3, 0.10, 0.44),
        (0.5, 0.10, 0.58),
        (0.2, 0.03, 0.42),
    ] {
        let found = listen(restitution, scatter, k, 6);
        let apart = found.heard - found.truth;
        // Three standard errors of the true share over these runs are 0.03 to 0.06; the
        // estimate errs by 0.03.
        assert!(apart.abs() < 0.035, "{restitution} {scatter}: {apart}");
        let margin = found.margin.unwrap();
        let error = (margin.restitution - restitution).abs();
        assert!(
            error < 4.0 * margin.error + 0.002,
            "{restitution} {scatter}: {margin:?}"
        );
        assert!((margin.scatter / scatter - 1.0).abs() < 0.25, "{margin:?}");
    }
}

#[test]
fn parts_that_hop_and_rest_are_neither_in_gear_nor_locked() {
    let quiet = [
        (0.25, 0.03, 0.49),
        (0.3, 0.05, 0.523),
        (0.35, 0.05, 0.58),
        (0.4, 0.05, 0.635),
        (0.4, 0.0, 0.635),
        (0.2, 0.0, 0.4314),
    ];
    for (restitution, scatter, k) in quiet {
        let found = listen(restitution, scatter, k, 1);
        assert!(found.truth < 0.02, "{restitution} {k}: {}", found.truth);
        assert!(found.heard < 0.03, "{restitution} {k}: {}", found.heard);
        assert_eq!(found.locked, 0, "{restitution} {k}");
    }
}
