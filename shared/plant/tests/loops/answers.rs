//! Tests of the controller's reaction to detected and missing impacts.

use kband_control::{Event, Identification, Limits, State, Target, Unidentified};
use kband_plant::{Change, Disturbance, EnvelopeLoop, Scene};

/// Outcome of a scene of one part or several, within a number of cycles; `None` without one.
fn identified(scene: &Scene, cycles: usize) -> Option<Identification> {
    let mut closed = EnvelopeLoop::build(scene).unwrap();
    (0..cycles).find_map(|_| match closed.cycle().report.identification {
        Identification::Idle | Identification::Listening { .. } => None,
        ended => Some(ended),
    })
}

#[test]
fn identification_finds_restitution_and_scatter() {
    for (restitution, scatter) in [(0.1, 0.02), (0.3, 0.02), (0.3, 0.05), (0.5, 0.02)] {
        let mut scene = Scene {
            target: Target::Identify,
            parts: core::iter::once(restitution).collect(),
            scatter: core::iter::once(scatter).collect(),
            seed: 101,
            ..Scene::default()
        };
        scene.settings.scatter = scatter;
        let found = identified(&scene, 4500);
        let Some(Identification::Found(found)) = found else {
            panic!("{restitution} {scatter}: {found:?}");
        };
        assert!((found.restitution - restitution).abs() < 0.02, "{found:?}");
        assert!((found.scatter / scatter - 1.0).abs() < 0.3, "{found:?}");
    }
}

#[test]
fn an_identification_ends_with_a_reason_where_it_finds_nothing() {
    let scene = Scene {
        target: Target::Identify,
        ..Scene::default()
    };
    let mut empty = scene.clone();
    empty.parts.clear();
    let mut lined = scene.clone();
    lined.sensor.ringing = 0.5;
    let mut noisy = scene.clone();
    noisy.sensor.noise = 5.0;
    for (scene, why) in [
        (empty, Unidentified::Quiet),
        (lined, Unidentified::Quiet),
        (noisy, Unidentified::Unsteady),
    ] {
        let ended = identified(&scene, 4500);
        assert_eq!(ended, Some(Identification::NotFound(why)));
    }
}

/// Kicks begun in each of some hours, and whether a fault occurred.
fn kicks_in_hours(scene: &Scene, hours: usize) -> std::vec::Vec<u32> {
    let mut closed = EnvelopeLoop::build(scene).unwrap();
    let hour = || {
        let mut kicks = 0;
        for _ in 0..180_000 {
            closed.advance();
            let begun = |event| event == Event::KickBegun;
            kicks += u32::from(closed.controller().events().iter().any(begun));
        }
        assert_eq!(closed.controller().report().fault, None);
        kicks
    };
    core::iter::repeat_with(hour).take(hours).collect()
}

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
        let kicks = kicks_in_hours(&scene, 1);
        assert!((2..=60).contains(&kicks[0]), "{kicks:?}");
    }
}

#[test]
fn deaf_board_holds_and_captures_after_recovery() {
    for disturbed in [Change::Noise(3.0), Change::Noise(1.5)] {
        let at = |at, change| Disturbance { at, change };
        let scene = Scene {
            disturbances: [at(0.0, disturbed), at(20.0, Change::Noise(0.15))]
                .into_iter()
                .collect(),
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
        assert_eq!(
            (last.state, last.limits),
            (State::Locked, Limits::default())
        );
    }
    // No impact is detected at all: the setpoint is held.
    let mut empty = Scene::default();
    empty.parts.clear();
    let mut closed = EnvelopeLoop::build(&empty).unwrap();
    let last = (0..3000).map(|_| closed.cycle().report).last().unwrap();
    assert_eq!(
        (last.state, last.limits, last.attempts),
        (State::Limiting, Limits::DEAF, 0)
    );
    assert!((last.amplitude / last.setpoint - 1.0).abs() < 0.01);
}
