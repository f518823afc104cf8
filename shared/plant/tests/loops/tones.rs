//! Tests: the closed loop on drives with two and three tones, in both plants.

use super::fidelity::{changes, drive_of};
use kband_control::{Event, Limits, Report, Settings, Shape, State, Target, UpperTone};
use kband_plant::{Change, ClosedLoop, EnvelopeLoop, Scene};

const TWO_TONES: Shape = Shape::of_two(UpperTone::new(0.15, 2.356));

/// As [`TWO_TONES`], with a third tone.
const THREE_TONES: Shape = Shape::new(TWO_TONES.second, UpperTone::new(0.06, -1.0));

/// The default feeder with a second tone, whose settings match the true drive.
fn scene(change: impl Fn(&mut Settings)) -> Scene {
    scene_of(TWO_TONES, change)
}

fn scene_of(shape: Shape, change: impl Fn(&mut Settings)) -> Scene {
    let mut scene = Scene {
        target: Target::Tones { k: 0.35, shape },
        ..Scene::default()
    };
    scene.settings.second_tone = 0.25;
    scene.settings.third_tone = shape.third.ratio;
    change(&mut scene.settings);
    scene.drive = drive_of(&scene.settings);
    scene.drive.second_quality = scene.settings.quality;
    scene
}

/// Largest difference of an upper tone of two shapes, over the first tone's amplitude.
fn shape_distance(a: Shape, b: Shape) -> f32 {
    let part = |tone: UpperTone| {
        let (sine, cosine) = libm::sincosf(tone.phase);
        (tone.ratio * cosine, tone.ratio * sine)
    };
    let pairs = a.tones().map(part).into_iter().zip(b.tones().map(part));
    let distances = pairs.map(|((x, y), (u, v))| libm::hypotf(x - u, y - v));
    distances.fold(0.0, f32::max)
}

/// Name of a drive, and the changes of its settings against the scene's.
type Drive = (&'static str, fn(&mut Settings));

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
    let drives = |shape| DRIVES.map(|(name, change)| (shape, name, change));
    for (configured, name, change) in [TWO_TONES, THREE_TONES].into_iter().flat_map(drives) {
        let scene = scene_of(configured, change);
        let mut closed = ClosedLoop::build(&scene).unwrap();
        let mut envelope = EnvelopeLoop::build(&scene).unwrap();
        let mut max_ratio = 0.0_f32;
        for n in 0..400 {
            let (slow, fast) = (closed.cycle().report, envelope.cycle().report);
            let (amplitude, produced) = closed.plant().tones();
            if n > 20 {
                max_ratio = max_ratio.max(produced.second.ratio);
            }
            if n < 300 {
                continue;
            }
            // Tolerance in e: 0.3 % of the first tone, four times the effect of noise.
            for shape in [slow.shape, fast.shape] {
                let distance = shape_distance(shape, configured);
                assert!(distance < 3e-3, "{name} {n}: {shape:?}");
            }
            // One resonance far above the drive's frequency (docs/theory-real-parts.md#t10.3).
            let (frequency, resonance) = (scene.settings.frequency, scene.settings.resonance);
            let stiff = (resonance / frequency) * (resonance / frequency);
            let sample = core::f32::consts::TAU * frequency / 20e3;
            let mut off = configured;
            if stiff > 1.0 {
                off.second.phase += 0.75 * stiff * sample;
                off.third.phase += 4.0 / 3.0 * stiff * sample;
            }
            let distance = shape_distance(produced, off);
            assert!(distance < 3e-3, "{name} {n}: {produced:?} {off:?}");
            assert!((amplitude / slow.amplitude - 1.0).abs() < 0.06, "{name}");
            assert_eq!(slow.state, State::Holding);
            assert_eq!(slow.limits, Limits::default());
        }
        let relative = max_ratio / TWO_TONES.second.ratio;
        assert!(relative < 1.06, "{name}: {relative}");
    }
}

/// A drive whose response at two or three times its frequency is wrong by a factor and an angle in
/// degrees. Cycle of its event, largest ratio of that tone over the requested one, last report.
fn run_misconfigured(third: bool, factor: f32, degrees: f32) -> (Option<usize>, f32, Report) {
    let configured = if third { THREE_TONES } else { TWO_TONES };
    let mut scene = scene_of(configured, |_| ());
    let (drive, tone) = (&mut scene.drive, usize::from(third));
    *[&mut drive.second_gain, &mut drive.third_gain][tone] *= factor;
    *[&mut drive.second_lag, &mut drive.third_lag][tone] += degrees;
    let event = [Event::SecondToneUnlike, Event::ThirdToneUnlike][tone];
    let mut closed = ClosedLoop::build(&scene).unwrap();
    let (mut cycle, mut max_ratio) = (None, 0.0_f32);
    for n in 0..400 {
        let report = closed.cycle().report;
        if cycle.is_none() && report.events.iter().any(|e| e == event) {
            cycle = Some(n);
        }
        if n > 20 {
            let produced = closed.plant().tones().1.tones()[tone];
            max_ratio = max_ratio.max(produced.ratio / configured.tones()[tone].ratio);
        }
    }
    (cycle, max_ratio, closed.controller().report())
}

#[test]
fn large_drive_errors_are_reported_small_ones_corrected() {
    misconfigured_tone_is_noticed(false);
    misconfigured_tone_is_noticed(true);
}

fn misconfigured_tone_is_noticed(third: bool) {
    let configured = if third { THREE_TONES } else { TWO_TONES };
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
        let (cycle, max_ratio, report) = run_misconfigured(third, factor, degrees);
        assert_eq!(cycle.is_some(), noticed, "{factor} {degrees}: {cycle:?}");
        let (case, shape) = (format!("{factor} {degrees}: {cycle:?}"), report.shape);
        assert!(cycle.is_none_or(|n| n < 150), "{case}");
        assert!(shape_distance(shape, configured) < 5e-3, "{case} {shape:?}");
        assert!(report.limits == Limits::default());
        // During adaptation e may be larger; the peak acceleration stays limited.
        assert!(max_ratio < 1.5, "{third} {factor} {degrees}: {max_ratio}");
    }
    // Beyond the loop's stability margins the tone is switched off, which limits the drive.
    let (cycle, _, report) = run_misconfigured(third, 1.0, -150.0);
    assert!(cycle.is_some() && report.limits.contains(Limits::SECOND_TONE));
    let tone = report.shape.tones()[usize::from(third)];
    assert!(tone.ratio < 0.01, "{:?}", report.shape);
}

#[test]
fn second_tone_is_reduced_first_at_a_limit() {
    let last = |scene: &Scene, cycles: usize| {
        let mut closed = ClosedLoop::build(scene).unwrap();
        let mut pushes = 0.0_f32;
        for n in 0..cycles {
            closed.cycle();
            let (amplitude, tone) = closed.plant().tones();
            if n > 20 {
                let [_, push] = tone.peaks();
                pushes = pushes.max(push * amplitude * 98_696.0);
            }
        }
        (closed.controller().report(), pushes)
    };
    // Acceleration limit: 28 m/s^2 with one tone, 43 with both.
    let weak = scene(|s| s.acceleration_limit = 36.0);
    let (report, push) = last(&weak, 300);
    assert!(report.limits.contains(Limits::SECOND_TONE) && (report.k - 0.35).abs() < 0.005);
    let second = report.shape.second;
    assert!((0.03..0.14).contains(&second.ratio), "{second:?}");
    assert!(push < 36.0 * 1.03, "{push}");
    // Link lost: the upper tone is switched off at once, before the amplitude falls.
    let mut lost = scene(|s| s.link_timeout = 0.5);
    lost.disturbances = changes([(4.0, Change::Link(false))]);
    let (report, _) = last(&lost, 275);
    assert!(report.limits.contains(Limits::LINK_LOST), "{report:?}");
    assert!(report.shape.second.ratio < 0.02, "{report:?}");
    // Fault: no output of any tone.
    let mut hot = scene(|_| ());
    hot.disturbances = changes([(4.0, Change::OverTemperature(true))]);
    let (report, _) = last(&hot, 210);
    assert_eq!(report.state, State::Fault);
    let command = report.command;
    assert_eq!(command.amplitude, 0.0);
    assert_eq!(command.overtones, <[[f32; 2]; 2]>::default());
}
