//! Tests: the closed loop on drives with two and three tones, in both plants.

use kband_control::{Event, Limits, Report, Settings, Shape, State, Target, UpperTone};
use kband_plant::{Change, ClosedLoop, EnvelopeLoop, Scene};

use super::fidelity::changes;

const TOLD: Shape = Shape::of_two(UpperTone::new(0.15, 2.356));

/// As [`TOLD`], with a third tone.
const THREE: Shape = Shape::new(TOLD.second, UpperTone::new(0.06, -1.0));

/// The default feeder with a second tone, whose settings match the true drive.
fn scene(change: impl Fn(&mut Settings)) -> Scene {
    scene_of(TOLD, change)
}

/// As [`scene`], with a given shape.
fn scene_of(shape: Shape, change: impl Fn(&mut Settings)) -> Scene {
    let mut scene = Scene {
        target: Target::Tones { k: 0.35, shape },
        ..Scene::default()
    };
    scene.settings.second_tone = 0.25;
    scene.settings.third_tone = shape.third.ratio;
    change(&mut scene.settings);
    scene.drive.resonance = scene.settings.resonance;
    scene.drive.quality = scene.settings.quality;
    scene.drive.gain = scene.settings.gain;
    scene.drive.second_gain = scene.settings.second_gain;
    scene.drive.second_lag = scene.settings.second_lag;
    scene.drive.third_gain = scene.settings.third_gain;
    scene.drive.third_lag = scene.settings.third_lag;
    scene.drive.second_quality = scene.settings.quality;
    scene
}

/// Largest difference of an upper tone of two shapes, over the first tone's amplitude.
fn apart(a: Shape, b: Shape) -> f32 {
    let part = |tone: UpperTone| {
        let (sine, cosine) = libm::sincosf(tone.phase);
        (tone.ratio * cosine, tone.ratio * sine)
    };
    let distance = |(a, b)| {
        let ((x, y), (u, v)) = (part(a), part(b));
        libm::hypotf(x - u, y - v)
    };
    let pairs = a.tones().into_iter().zip(b.tones());
    pairs.map(distance).fold(0.0, f32::max)
}

/// Name of a drive, and what its settings have that the scene's have not.
type Drive = (&'static str, fn(&mut Settings));

/// Drives of all kinds.
const DRIVES: [Drive; 6] = [
    ("modes at the multiples of the frequency", |_| ()),
    ("modes below them", |s| {
        (s.second_lag, s.third_lag) = (30.0, 60.0);
    }),
    ("modes that move against it", |s| {
        (s.second_lag, s.third_lag) = (-150.0, -100.0);
    }),
    ("springs far above", |s| {
        (s.quality, s.resonance, s.gain) = (3.0, 150.0, 2.0);
        (s.second_gain, s.third_gain) = (0.0, 0.0);
    }),
    ("a voice coil", |s| {
        (s.quality, s.resonance, s.gain) = (1.0, 10.0, 30.0);
        (s.second_gain, s.third_gain) = (0.0, 0.0);
    }),
    ("300 Hz", |s| {
        (s.frequency, s.resonance) = (300.0, 300.0);
        (s.gain, s.second_gain, s.safe_amplitude) = (0.03, 0.015, 0.005);
        s.third_gain = 0.0075;
        s.acceleration_limit = 300.0;
    }),
];

#[test]
fn every_drive_holds_two_tones_and_three_in_both_fidelities() {
    let shapes = [TOLD, THREE].into_iter();
    for (told, (name, change)) in shapes.flat_map(|told| DRIVES.map(|drive| (told, drive))) {
        let scene = scene_of(told, change);
        let mut closed = ClosedLoop::build(&scene).unwrap();
        let mut envelope = EnvelopeLoop::build(&scene).unwrap();
        let mut most = 0.0_f32;
        for n in 0..400 {
            let (slow, fast) = (closed.cycle().report, envelope.cycle().report);
            let (amplitude, made) = closed.plant().tones();
            if n > 20 {
                most = most.max(made.second.ratio);
            }
            if n < 300 {
                continue;
            }
            // Tolerance in e: 0.3 % of the first tone's amplitude, four times the effect of the
            // reading's noise.
            for shape in [slow.shape, fast.shape] {
                assert!(apart(shape, told) < 3e-3, "{name} {n}: {shape:?}");
            }
            // One resonance far above the drive's frequency (docs/theory-real-parts.md#t10.3, stiff
            // drives).
            let (frequency, resonance) = (scene.settings.frequency, scene.settings.resonance);
            let stiff = (resonance / frequency) * (resonance / frequency);
            let sample = core::f32::consts::TAU * frequency / 20e3;
            let mut off = told;
            if stiff > 1.0 {
                off.second.phase += 0.75 * stiff * sample;
                off.third.phase += 4.0 / 3.0 * stiff * sample;
            }
            assert!(apart(made, off) < 3e-3, "{name} {n}: {made:?} {off:?}");
            assert!((amplitude / slow.amplitude - 1.0).abs() < 0.06, "{name}");
            assert_eq!(slow.state, State::Holding);
            assert_eq!(slow.limits, Limits::default());
        }
        assert!(most < 1.06 * TOLD.second.ratio, "{name}: {most}");
    }
}

/// A drive whose response at two or three times its frequency differs from the settings by a factor
/// and an angle in degrees.
///
/// Returns the cycle of the event for it, the largest ratio of that tone over the requested one,
/// and the last report.
fn told_wrong(third: bool, factor: f32, degrees: f32) -> (Option<usize>, f32, Report) {
    let told = if third { THREE } else { TOLD };
    let mut scene = scene_of(told, |_| ());
    let drive = &mut scene.drive;
    let (gain, lag) = if third {
        (&mut drive.third_gain, &mut drive.third_lag)
    } else {
        (&mut drive.second_gain, &mut drive.second_lag)
    };
    *gain *= factor;
    *lag += degrees;
    let event = [Event::SecondToneUnlike, Event::ThirdToneUnlike][usize::from(third)];
    let tone = usize::from(third);
    let mut closed = ClosedLoop::build(&scene).unwrap();
    let (mut noted, mut most) = (None, 0.0_f32);
    for n in 0..400 {
        let report = closed.cycle().report;
        if noted.is_none() && report.events.iter().any(|e| e == event) {
            noted = Some(n);
        }
        if n > 20 {
            let made = closed.plant().tones().1.tones()[tone];
            most = most.max(made.ratio / told.tones()[tone].ratio);
        }
    }
    (noted, most, closed.controller().report())
}

#[test]
fn large_drive_errors_are_reported_small_ones_corrected() {
    for third in [false, true] {
        told_wrong_is_noticed(third);
    }
}

fn told_wrong_is_noticed(third: bool) {
    let told = if third { THREE } else { TOLD };
    for (factor, degrees, noticed) in [
        (1.0, 0.0, false),
        (1.2, 8.0, false),
        (0.8, -8.0, false),
        (2.0, 0.0, true),
        (0.5, 0.0, true),
        (1.0, 30.0, true),
        (1.0, -30.0, true),
        (2.0, 30.0, true),
        (0.5, -30.0, true),
    ] {
        let (noted, most, report) = told_wrong(third, factor, degrees);
        assert_eq!(noted.is_some(), noticed, "{factor} {degrees}: {noted:?}");
        let (what, shape) = (format!("{factor} {degrees}: {noted:?}"), report.shape);
        assert!(noted.is_none_or(|n| n < 150), "{what}");
        assert!(apart(shape, told) < 5e-3, "{what} {shape:?}");
        assert!(report.limits == Limits::default());
        // During adaptation e may be larger; the peak acceleration stays limited.
        assert!(most < 1.5, "{third} {factor} {degrees}: {most}");
    }
    // Beyond the loop's stability margins the tone is switched off, which limits the drive.
    let (noted, _, report) = told_wrong(third, 1.0, -150.0);
    assert!(noted.is_some() && report.limits.contains(Limits::SECOND_TONE));
    let tone = report.shape.tones()[usize::from(third)];
    assert!(tone.ratio < 0.01, "{:?}", report.shape);
}

#[test]
fn the_second_tone_goes_first_where_a_limit_stands_in_its_way() {
    let last = |scene: &Scene, cycles: usize| {
        let mut closed = ClosedLoop::build(scene).unwrap();
        let (mut outputs, mut pushes) = (0.0_f32, 0.0_f32);
        for n in 0..cycles {
            closed.cycle_shown(|sample| outputs = outputs.max(sample.output.abs()));
            let (amplitude, tone) = closed.plant().tones();
            if n > 20 {
                let [_, push] = tone.peaks();
                pushes = pushes.max(push * amplitude * 98_696.0);
            }
        }
        (closed.controller().report(), outputs, pushes)
    };
    // Output limit: the first tone has priority, the second gets the rest.
    let mut weak = scene(|s| (s.output_maximum, s.second_gain) = (0.35, 0.5));
    let (report, most, _) = last(&weak, 300);
    assert!(report.limits.contains(Limits::SECOND_TONE), "{report:?}");
    assert!(!report.limits.contains(Limits::OUTPUT));
    let second = report.shape.second;
    assert!(most <= 0.35, "{most}");
    assert!((report.k - 0.35).abs() < 0.005, "{report:?}");
    assert!((0.05..0.14).contains(&second.ratio), "{second:?}");
    // Acceleration limit: 28 m/s^2 with one tone, 43 with both.
    weak = scene(|s| s.acceleration_limit = 36.0);
    let (report, _, push) = last(&weak, 300);
    assert!(report.limits.contains(Limits::SECOND_TONE) && (report.k - 0.35).abs() < 0.005);
    let second = report.shape.second;
    assert!((0.03..0.14).contains(&second.ratio), "{second:?}");
    assert!(push < 36.0 * 1.03, "{push}");
    // Link lost: the upper tone is switched off at once, before the amplitude falls.
    let mut lost = scene(|s| s.link_timeout = 0.5);
    lost.disturbances = changes([(4.0, Change::Link(false))]);
    let (report, _, _) = last(&lost, 275);
    assert!(report.limits.contains(Limits::LINK_LOST), "{report:?}");
    assert!(report.shape.second.ratio < 0.02, "{report:?}");
    // Fault: no output of any tone.
    let mut hot = scene(|_| ());
    hot.disturbances = changes([(4.0, Change::OverTemperature(true))]);
    let (report, _, _) = last(&hot, 210);
    assert_eq!(report.state, State::Fault);
    let command = report.command;
    assert_eq!(
        (command.amplitude, command.overtones),
        (0.0, Default::default())
    );
}
