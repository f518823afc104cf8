//! Share of time in gear under the controller, by the simulated motion of the parts.

use kband::feeder::STANDARD_GRAVITY;
use kband::impact::TangentialSettings;
use kband::transport::locked;
use kband_control::{Controller, Shape, StartCause, Target, UpperTone};
use kband_host::desk::Desk;
use kband_host::simulate::{DEFAULT, Distribution, Fidelity, Runs, SceneFile};
use kband_plant::Scene;

pub struct Row {
    /// Restitution: lowest and highest of the lot.
    restitution: (f32, f32),
    scatter: f32,
    parts: u8,
    /// Second and third tone that the drive affords, and limit of the acceleration in g; 0: none.
    drives: &'static [[f32; 3]],
}

const ONE_TONE: [f32; 3] = [0.0; 3];
const TWO_TONES: [f32; 3] = [0.15, 0.0, 0.0];
const STRONG_TWO_TONES: [f32; 3] = [0.25, 0.0, 0.0];
const THREE_TONES: [f32; 3] = [0.3, 0.06, 5.0];

const fn row(restitution: f32, scatter: f32, drives: &'static [[f32; 3]]) -> Row {
    Row {
        restitution: (restitution, restitution),
        scatter,
        parts: 1,
        drives,
    }
}

pub const ROWS: [Row; 7] = [
    row(0.2, 0.05, &[ONE_TONE, TWO_TONES]),
    row(0.3, 0.05, &[ONE_TONE, TWO_TONES]),
    row(0.4, 0.05, &[ONE_TONE, TWO_TONES]),
    row(0.5, 0.05, &[ONE_TONE, TWO_TONES]),
    row(0.3, 0.10, &[ONE_TONE, TWO_TONES, STRONG_TWO_TONES]),
    row(0.5, 0.10, &[ONE_TONE, STRONG_TWO_TONES, THREE_TONES]),
    Row {
        restitution: (0.1, 0.3),
        scatter: 0.03,
        parts: 12,
        drives: &[ONE_TONE, TWO_TONES],
    },
];

/// Rows for these lots: `count` runs of 60 s each, with the targets of lock and of gear.
pub fn table(lots: &[Row], count: usize) -> Vec<String> {
    let desk = Desk::new(None);
    let mut rows = Vec::new();
    for lot in lots {
        let (low, high) = lot.restitution;
        let parts = if low == high {
            format!("{low}")
        } else {
            format!("{low}..{high}, {} parts", lot.parts)
        };
        let gear = lot.drives.iter().map(|&drive| ("gear", GEAR, drive));
        for (name, target, drive) in std::iter::once(("lock", LOCK, ONE_TONE)).chain(gear) {
            let file = scene(lot, target, drive);
            let runs = Runs::run(&file, count, Fidelity::Envelope, &desk).unwrap();
            let (expected, k, Shape { second, third }, peak) = planned(&file.scene);
            let [afforded, third_afforded, _] = drive;
            let cells = [
                parts.clone(),
                digits(f64::from(lot.scatter), 2),
                name.into(),
                match third_afforded {
                    0.0 => digits(f64::from(afforded), 2),
                    _ => format!("{afforded}, {third_afforded}"),
                },
                share(runs.in_gear()),
                share(runs.in_gear_estimated()),
                share(runs.in_gear_coverage()),
                share(expected),
                digits(k, 4),
                tone(second),
                tone(third),
                digits(peak, 3),
                runs.speed()
                    .map_or("-".into(), |speed| digits(1e3 * speed, 4)),
                digits(lock_speed(&file.scene), 4),
            ];
            rows.push(format!("| {} |", cells.join(" | ")));
        }
    }
    rows
}

const LOCK: Target = Target::Locked { order: 1 };
const GEAR: Target = Target::Gear { order: 1 };

fn share(value: Option<f64>) -> String {
    value.map_or("-".into(), |share| format!("{share:.3}"))
}

fn tone(tone: UpperTone) -> String {
    match f64::from(tone.ratio) {
        0.0 => "-".into(),
        e => format!("{}, {}", digits(e, 3), digits(f64::from(tone.phase), 3)),
    }
}

/// A number with this many significant digits, without trailing zeros; a dash for NaN.
fn digits(value: f64, digits: i32) -> String {
    if value == 0.0 || !value.is_finite() {
        return "-".into();
    }
    let scale = 10_f64.powi(digits - 1 - value.abs().log10().floor() as i32);
    ((value * scale).round() / scale).to_string()
}

fn scene(row: &Row, target: Target, drive: [f32; 3]) -> SceneFile {
    let mut file = SceneFile::parse(DEFAULT).unwrap();
    file.duration = 60.0;
    let (low, high) = row.restitution;
    let scene = &mut file.scene;
    scene.target = target;
    let settings = &mut scene.settings;
    (settings.restitution_low, settings.restitution_high) = row.restitution;
    settings.scatter = row.scatter;
    let [second_tone, third_tone, limit] = drive;
    (settings.second_tone, settings.third_tone) = (second_tone, third_tone);
    if limit > 0.0 {
        settings.acceleration_limit = limit * STANDARD_GRAVITY as f32;
    }
    scene.drive.second_gain = settings.second_gain;
    scene.drive.second_lag = settings.second_lag;
    if third_tone > 0.0 {
        scene.drive.third_gain = settings.third_gain;
        scene.drive.third_lag = settings.third_lag;
    }
    scene.parts = (0..row.parts).map(|_| 0.5 * (low + high)).collect();
    scene.scatter = scene.parts.iter().map(|_| row.scatter).collect();
    file.distribution = Some(Distribution::Uniform { low, high });
    file.check().unwrap();
    file
}

/// The controller's plan: expected share, k, tones, and peak acceleration in g.
fn planned(scene: &Scene) -> (Option<f64>, f64, Shape, f64) {
    let settings = &scene.settings;
    let mut controller = Controller::build(settings, scene.target, StartCause::Ordinary).unwrap();
    while scene.target != LOCK && controller.plan_step() {}
    let plan = controller.gear();
    let shape = plan.map_or(Shape::SINE, |plan| {
        let [second, third] = plan.tones.map(|[ratio, phase]| UpperTone { ratio, phase });
        Shape { second, third }
    });
    let setpoint = controller.setpoint();
    let angular = std::f64::consts::TAU * f64::from(settings.frequency);
    let [_, peak] = shape.peaks();
    let peak = f64::from(setpoint) * angular * angular * f64::from(peak) / STANDARD_GRAVITY;
    let expected = plan.map(|plan| f64::from(plan.share));
    (expected, f64::from(controller.k(setpoint)), shape, peak)
}

/// Mean speed of the lot's parts in gear over its interval, mm/s (equation 21: equal at every k).
fn lock_speed(scene: &Scene) -> f64 {
    let settings = &scene.settings;
    let (lot, track) = (settings.lot().unwrap(), settings.track().unwrap());
    let along = TangentialSettings::on(&track, f64::from(settings.tangential_restitution));
    let unit = 1e3 * track.velocity_unit(track.amplitude(1.0));
    const PARTS: u32 = 1000;
    let speeds = (0..PARTS).map(|n| {
        let share = (f64::from(n) + 0.5) / f64::from(PARTS);
        let restitution = lot.low() + (lot.high() - lot.low()) * share;
        locked::velocity_in_phase(1, 1.0, restitution, &along)
    });
    unit * speeds.sum::<f64>() / f64::from(PARTS)
}
