//! Plausibility of gain and sensor: drives that are sharper, blunter or stronger than configured.

use kband_control::{Fault, Target};
use kband_plant::{ClosedLoop, DriveModel, EnvelopeLoop, Scene};

/// Fault that stops a scene in the envelope plant within some cycles.
fn fault(scene: &Scene, cycles: usize) -> Option<Fault> {
    let mut closed = EnvelopeLoop::build(scene).unwrap();
    (0..cycles).find_map(|_| closed.cycle().report.fault)
}

#[test]
fn gain_error_selects_the_sensor_fault() {
    let scene = |gain| Scene {
        target: Target::Amplitude(0.15),
        drive: DriveModel {
            gain,
            ..DriveModel::default()
        },
        ..Scene::default()
    };
    for gain in [0.5, 2.0] {
        assert_eq!(fault(&scene(gain), 400), None, "{gain}");
    }
    for gain in [1.0 / 3.0, 0.25, 3.0] {
        let found = fault(&scene(gain), 400);
        assert_eq!(found, Some(Fault::SensorImplausible), "{gain}");
    }
    assert_eq!(fault(&scene(0.1), 400), Some(Fault::NoResponse));
}

#[test]
fn any_quality_starts_captures_and_stops_without_fault() {
    for (quality, lot) in [(5.0, 0.2), (25.0, 0.2), (120.0, 0.2), (25.0, 0.5)] {
        let mut scene = Scene::default();
        scene.settings.restitution_low = lot - 0.01;
        scene.settings.restitution_high = lot + 0.01;
        (scene.settings.quality, scene.drive.quality) = (quality, quality);
        scene.parts = core::iter::repeat_n(lot, 24).collect();
        let mut closed = ClosedLoop::build(&scene).unwrap();
        for _ in 0..600 {
            assert_eq!(closed.cycle().report.fault, None, "Q {quality} R {lot}");
        }
    }
}
