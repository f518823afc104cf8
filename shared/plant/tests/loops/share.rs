//! The estimated share in gear of many parts against the plant's own.

use kband_control::Target;
use kband_plant::{Change, ClosedLoop, EnvelopeLoop, Scene};

use super::fidelity::{changes, listen, lot};

/// Crowds of 1, 6 and 24 parts, of one restitution or of a range.
#[test]
fn share_of_a_crowd_is_within_three_errors() {
    for (range, scatter, k) in [
        ([0.1, 0.3], 0.03, 0.383),
        ([0.2, 0.2], 0.05, 0.403),
        ([0.3, 0.3], 0.05, 0.4438),
        ([0.4, 0.4], 0.05, 0.5015),
        ([0.5, 0.5], 0.05, 0.5516),
        ([0.3, 0.3], 0.10, 0.4438),
        ([0.5, 0.5], 0.10, 0.5516),
        ([0.3, 0.3], 0.05, 0.48),
    ] {
        let mut all = std::vec![];
        for parts in [1, 6, 24] {
            for seed in 0..2 {
                let told = listen(&lot(range, scatter, k, parts, 5 + seed), false);
                let apart = told.heard - told.truth;
                let what = format!("{range:?} {scatter} {parts}: {told:?}");
                assert!(told.deaf < 150, "{what}");
                assert!(apart.abs() < 3.0 * told.error, "{what}");
                all.push(apart);
            }
        }
        // Single runs scatter by 0.02 to 0.035; the mean of six errs by 0.01, and twice that is
        // allowed.
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        assert!(mean.abs() < 0.03 + 0.02, "{range:?} {scatter}: {mean}");
    }
}

#[test]
fn parts_that_hop_and_rest_are_neither_in_gear_nor_locked() {
    for (restitution, scatter, k) in [
        (0.25, 0.03, 0.49),
        (0.3, 0.05, 0.523),
        (0.35, 0.05, 0.58),
        (0.4, 0.05, 0.635),
        (0.4, 0.0, 0.635),
        (0.2, 0.0, 0.4314),
    ] {
        for parts in [1, 3, 24] {
            let told = listen(&lot([restitution; 2], scatter, k, parts, 100), false);
            let out = told.truth < 0.02 && told.heard < 0.03 && told.locked == 0;
            assert!(out, "{restitution} {parts}: {told:?}");
        }
    }
}

#[test]
fn both_plants_give_the_same_share() {
    for (range, scatter, k) in [([0.1, 0.3], 0.03, 0.383), ([0.4, 0.4], 0.05, 0.5015)] {
        let scene = lot(range, scatter, k, 12, 9);
        let [slow, fast] = [true, false].map(|waveform| {
            let told = listen(&scene, waveform);
            told.heard - told.truth
        });
        // The noise differs, so each plant is compared with its own truth; a run scatters by up
        // to 0.03.
        assert!(slow.abs() < 0.05 && fast.abs() < 0.05, "{slow} {fast}");
    }
}

/// Parts that leave gear for good strike all over the turn; the fit must not assign them to
/// noise.
#[test]
fn changed_parts_are_not_fitted_as_noise() {
    for (restitution, scatter) in [(0.6, 0.1), (0.7, 0.05)] {
        for seed in 100..104 {
            let mut scene = lot([0.18, 0.22], 0.0, 0.393, 1, seed);
            let other = [Change::Restitution(restitution), Change::Scatter(scatter)];
            scene.disturbances = changes(other.map(|change| (4.0, change)));
            let mut whole = ClosedLoop::build(&scene).unwrap();
            let mut geared = std::vec![];
            for _ in 0..600 {
                let report = whole.cycle().report;
                geared.push(report.in_gear - report.in_gear_error > 0.5);
            }
            assert!(geared[150..200].iter().all(|geared| *geared), "{seed}");
            // The energy before the change is forgotten over 256 cycles.
            let still = geared[400..].iter().filter(|geared| **geared).count();
            assert_eq!(still, 0, "{restitution} {seed}");
        }
    }
}

/// A lot configured too wide must not pass for one out of gear.
#[test]
fn share_of_an_unknown_lot_has_a_large_error() {
    for restitution in [0.12, 0.2, 0.28] {
        let mut scene = lot([restitution; 2], 0.03, 0.383, 4, 11);
        scene.settings.restitution_low = 0.1;
        scene.settings.restitution_high = 0.3;
        let told = listen(&scene, false);
        let covers = (told.heard - told.truth).abs() < 2.5 * told.error;
        assert!(covers || told.deaf > 2000, "{restitution}: {told:?}");
    }
}

#[test]
fn without_a_reader_of_ready_no_other_bit_changes() {
    for target in [Target::Gear { order: 1 }, Target::K(0.42)] {
        let scene = Scene {
            target,
            ..lot([0.18, 0.22], 0.04, 0.42, 2, 1)
        };
        let mut read = EnvelopeLoop::build(&scene).unwrap();
        let mut unread = read.clone();
        unread.watch_ready(false);
        for _ in 0..700 {
            // As text, in which numbers that are none are equal.
            let (one, other) = (read.cycle(), unread.cycle());
            assert_eq!(format!("{one:?}"), format!("{other:?}"));
        }
        let estimated = read.controller().estimated_share();
        assert!(estimated.is_some_and(|share| share.share > 0.5));
        assert!(read.controller().is_ready());
        let depends = matches!(target, Target::Gear { .. });
        assert_eq!(unread.controller().is_ready(), !depends);
    }
}
