//! Tests of the controller's reaction to detected and missing impacts.

use super::fidelity::{changes, unwatched};
use kband_control::{Event, Limits, State};
use kband_plant::{Change, EnvelopeLoop, Scene};

#[test]
fn parts_that_scatter_are_kicked_sixty_times_an_hour_at_most() {
    for (restitution, scatter) in [(0.2_f32, 0.05), (0.3, 0.05)] {
        let mut scene = Scene {
            parts: core::iter::once(restitution).collect(),
            scatter: core::iter::once(scatter).collect(),
            ..Scene::default()
        };
        scene.settings.restitution_low = restitution - 0.02;
        scene.settings.restitution_high = restitution + 0.02;
        let mut closed = unwatched(&scene);
        let mut kicks = 0;
        for _ in 0..180_000 {
            closed.advance();
            let begun = |event| event == Event::KickBegun;
            kicks += u32::from(closed.controller().events().iter().any(begun));
        }
        assert_eq!(closed.controller().report().fault, None);
        assert!((2..=60).contains(&kicks), "{kicks}");
    }
}

#[test]
fn board_missing_impacts_holds_and_captures_after_recovery() {
    for disturbed in [Change::Noise(3.0), Change::Noise(1.5)] {
        let scene = Scene {
            disturbances: changes([(0.0, disturbed), (20.0, Change::Noise(0.15))]),
            ..Scene::default()
        };
        let mut closed = EnvelopeLoop::build(&scene).unwrap();
        let (mut deaf, mut kicks) = (0, 0);
        for _ in 0..1000 {
            let report = closed.cycle().report;
            deaf += u32::from(report.limits.contains(Limits::DEAF));
            kicks += u32::from(report.attempts > 0);
        }
        assert!(deaf > 900, "{disturbed:?}: {deaf}");
        assert_eq!(kicks, 0, "{disturbed:?}");
        let last = (0..1000).map(|_| closed.cycle().report).last().unwrap();
        assert_eq!(last.state, State::Locked);
        assert_eq!(last.limits, Limits::default());
    }
    // No impact is detected at all: the setpoint is held.
    let mut empty = Scene::default();
    empty.parts.clear();
    let mut closed = EnvelopeLoop::build(&empty).unwrap();
    let last = (0..3000).map(|_| closed.cycle().report).last().unwrap();
    assert_eq!((last.state, last.attempts), (State::Limiting, 0));
    assert_eq!(last.limits, Limits::DEAF);
    assert!((last.amplitude / last.setpoint - 1.0).abs() < 0.01);
}
