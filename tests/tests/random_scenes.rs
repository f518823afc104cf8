//! Random feeders in both fidelities, configured correctly or wrongly: invariants of every scene.
//!
//! `KBAND_SCENES` and `KBAND_SEED` select number and seed; `KBAND_SCENE` prints the course of one
//! scene. `KBAND_ACCEPT` writes the scenes whose fidelities end differently to
//! `tests/random_scenes.md`, each with the reason.

use std::f64::consts::TAU;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::atomic::{AtomicU64, Ordering};

use kband::feeder::STANDARD_GRAVITY;
use kband_control::{Fault, Limits, SAMPLE_RATE, State, TRANSITIONS, Target};
use kband_plant::{Change, ClosedLoop, Disturbance, EnvelopeLoop, Moment, Scene, Strike};
use kband_tests::root;
use kband_tests::states::Random;

/// Drive cycles of a window in which a reported lock is compared with the parts' impacts.
const WINDOW: u32 = 120;

fn one_of<T: Copy>(random: &mut Random, all: &[T]) -> T {
    all[(random.bits() % all.len() as u64) as usize]
}

/// A feeder of any size, tuned near its resonance, with parts of the configured lot.
fn scene(random: &mut Random) -> Scene {
    let mut scene = Scene::default();
    let frequency = one_of(
        random,
        &[
            20.0, 25.0, 33.3, 50.0, 50.0, 60.0, 77.0, 100.0, 120.0, 150.0, 200.0,
        ],
    );
    let square = (TAU * frequency).powi(2);
    // Amplitude in mm at k = 0.35.
    let unit = 1e3 * STANDARD_GRAVITY / (0.35 * square);
    let settings = &mut scene.settings;
    settings.frequency = frequency as f32;
    settings.incline = random.between(-10.0, 10.0) as f32;
    settings.quality = random.scale(5.0, 100.0) as f32;
    let detuned = random.between(-0.3, 0.3) / f64::from(settings.quality);
    settings.resonance = (frequency * (1.0 + detuned)) as f32;
    let cycles = f64::from(settings.quality) / std::f64::consts::PI;
    settings.envelope = (cycles * random.between(0.5, 1.5)).max(1.0) as f32;
    let middle = random.between(0.1, 0.45);
    let half = one_of(random, &[0.0, 0.005, 0.02, 0.05]);
    settings.restitution_low = (middle - half) as f32;
    settings.restitution_high = (middle + half) as f32;
    settings.scatter = one_of(random, &[0.0, 0.0, 0.03, 0.06]);
    settings.gain = (unit * random.scale(2.0, 8.0)) as f32;
    settings.amplitude_limit = (unit * random.scale(3.0, 8.0)) as f32;
    settings.acceleration_limit = (random.scale(3.0, 8.0) * STANDARD_GRAVITY / 0.35) as f32;
    settings.safe_amplitude = (0.2 * unit) as f32;
    settings.soft_start = random.scale(0.05, 2.0) as f32;
    settings.soft_stop = random.scale(0.05, 1.0) as f32;
    settings.output_maximum = random.between(0.5, 1.0) as f32;
    settings.sensitivity = 0.1;
    settings.capture_attempts = f32::from((random.bits() % 13) as u8);
    if random.bits().is_multiple_of(5) {
        settings.tracking = random.between(0.0, 0.05 * frequency) as f32;
    }
    scene.drive.resonance = settings.resonance;
    scene.drive.quality = settings.quality;
    scene.drive.gain = settings.gain;
    scene.drive.mains = one_of(random, &[50.0, 60.0]);
    // Relative to the acceleration at k = 0.35; the default accelerometer has 5e-3.
    scene.sensor.noise = (1e-3 * unit * square * random.scale(1e-4, 6e-3)) as f32;
    scene.target = match random.bits() % 6 {
        0 | 1 => Target::Locked {
            order: 1 + (random.bits() % 2) as u8,
        },
        2 => Target::K(random.between(0.2, 1.2) as f32),
        3 => Target::Amplitude((unit * random.between(0.3, 1.5)) as f32),
        _ => Target::Gear { order: 1 },
    };
    let parts = one_of(random, &[1, 1, 3, 8, 24]);
    let (low, high) = (settings.restitution_low, settings.restitution_high);
    scene.parts = (0..parts)
        .map(|_| random.between(f64::from(low), f64::from(high) + 1e-9) as f32)
        .collect();
    scene.scatter = std::iter::repeat_n(settings.scatter, parts).collect();
    scene.seed = random.bits();
    scene
}

/// An unreasonable target; some are refused.
fn wild(random: &mut Random) -> Target {
    match random.bits() % 9 {
        0 => Target::Locked {
            order: (random.bits() % 10) as u8,
        },
        1 => Target::K(random.between(-0.1, 2.0) as f32),
        2 => Target::Amplitude(random.between(-0.1, 2.0) as f32),
        3 => Target::Chaotic,
        4 => Target::Speed(one_of(random, &[0.0, 50.0, -50.0, 1e6, f32::NAN])),
        5 => Target::Identify,
        6 => Target::K(f32::NAN),
        7 => Target::Gear {
            order: (random.bits() % 4) as u8,
        },
        _ => Target::Locked { order: 1 },
    }
}

/// A feeder with a wrong configuration and with disturbances, up to one every cycle.
fn hostile(random: &mut Random) -> Scene {
    let mut scene = scene(random);
    let settings = &mut scene.settings;
    let square = (TAU * f64::from(settings.frequency)).powi(2);
    let unit = 1e3 * STANDARD_GRAVITY / (0.35 * square);
    let middle = random.between(0.02, 0.8);
    let half = one_of(random, &[0.0, 0.005, 0.02, 0.05]);
    settings.restitution_low = (middle - half).max(0.0) as f32;
    settings.restitution_high = (middle + half).min(0.99) as f32;
    settings.resonance = settings.frequency * random.between(0.94, 1.06) as f32;
    settings.amplitude_limit = (unit * random.scale(0.8, 8.0)) as f32;
    settings.acceleration_limit = (random.scale(0.8, 8.0) * STANDARD_GRAVITY / 0.35) as f32;
    settings.safe_amplitude = settings.safe_amplitude.min(0.2 * settings.amplitude_limit);
    scene.target = one_of(
        random,
        &[
            scene.target,
            Target::Chaotic,
            Target::Speed(60.0),
            Target::Identify,
        ],
    );
    let mixed = random.bits().is_multiple_of(3);
    for part in &mut scene.parts {
        *part = if mixed {
            one_of(random, &[0.1, 0.6])
        } else {
            middle as f32
        };
    }
    let (drive, sensor) = (&mut scene.drive, &mut scene.sensor);
    drive.resonance = scene.settings.resonance * random.between(0.97, 1.03) as f32;
    drive.quality *= random.scale(0.7, 1.4) as f32;
    drive.gain *= random.scale(0.5, 2.0) as f32;
    drive.ripple = one_of(random, &[0.0, 0.0, 0.1, 0.5]);
    sensor.noise *= random.scale(1.0, 10.0) as f32;
    let acceleration = 1e-3 * unit * square;
    sensor.hum = match random.bits() % 5 {
        0 => (acceleration * random.scale(0.01, 0.5)) as f32,
        _ => 0.0,
    };
    sensor.sensitivity = random.between(0.8, 1.25) as f32;
    let noise = sensor.noise;
    let pace = one_of(random, &[0.05, 1.5, 1.5]);
    let mut at = 0.0;
    for _ in 0..1 + random.bits() % 31 {
        at += random.between(0.0, pace) * 50.0 / f64::from(scene.settings.frequency);
        let yes = random.bits().is_multiple_of(2);
        let pick = random.bits() % 20;
        let target = wild(random);
        let mut share = |low: f64, high: f64| random.scale(low, high) as f32;
        let change = match pick {
            0..=2 => Change::Target(target),
            3 => Change::Enable(yes),
            4 => Change::Gain(share(0.3, 3.0)),
            5 => Change::Restitution(share(0.01, 1.0)),
            6 => Change::Noise(noise * share(0.1, 10.0)),
            7 => Change::Ripple(share(0.01, 0.5)),
            8 => Change::Hum(share(0.01, 1.0) * acceleration as f32),
            9 => Change::SensorLost(yes),
            10 => Change::SensorInverted(yes),
            11 => Change::Sensitivity(share(0.3, 3.0)),
            12 => Change::OverTemperature(yes),
            13 => Change::Link(yes),
            14 => Change::Scatter(share(0.01, 0.3)),
            15 => Change::OverCurrent(yes),
            16 => Change::SupplyLow(yes),
            17 => Change::ControlLate(yes),
            18 => Change::BrownOut(yes),
            _ => Change::StackLow(yes),
        };
        let happened = Disturbance { at, change };
        scene.disturbances.push(happened).expect("fewer than 32");
    }
    scene
}

/// Result of a run.
#[derive(Debug, PartialEq)]
struct End {
    state: State,
    fault: Option<Fault>,
    limits: Limits,
    /// Hash of all commands and measurements of the controller.
    bits: u64,
    /// Violations.
    wrong: Vec<String>,
}

/// Rhythm of the parts over a window: number of strikes, sums of cosine and sine of their phases.
#[derive(Default)]
struct Rhythm {
    cycles: u32,
    parts: Vec<(f64, f64, f64)>,
}

impl Rhythm {
    fn anew(parts: usize) -> Self {
        Self {
            cycles: 0,
            parts: vec![(0.0, 0.0, 0.0); parts],
        }
    }

    fn take(&mut self, strikes: &[Strike]) {
        self.cycles += 1;
        for strike in strikes {
            let (count, cosines, sines) = &mut self.parts[usize::from(strike.part)];
            let phase = (strike.time as u32) as f64 / 4_294_967_296.0 * TAU;
            *count += 1.0;
            *cosines += phase.cos();
            *sines += phase.sin();
        }
    }

    /// Number of parts in lock.
    ///
    /// With random restitution a part may leave its lock for a hop or two in a window, and its
    /// phase wanders.
    fn locked(&self, order: u8) -> usize {
        let wanted = f64::from(WINDOW) / f64::from(order);
        let keeps = |(count, cosines, sines): &&(f64, f64, f64)| {
            (count - wanted).abs() <= 8.0 && cosines.hypot(*sines) > 0.9 * count
        };
        self.parts.iter().filter(keeps).count()
    }
}

fn run(scene: &Scene, seconds: f64, mut cycle: impl FnMut() -> (Moment, Vec<Strike>)) -> End {
    let settings = &scene.settings;
    // A disturbance may change the amplitude for a while, and parts may leave a lock undetected.
    let calm = scene.disturbances.is_empty();
    let restarts = |happened: &Disturbance| matches!(happened.change, Change::BrownOut(_));
    let restarts = scene.disturbances.iter().any(restarts);
    let ceiling = 1e-3 * settings.amplitude_limit;
    let order = match scene.target {
        Target::Locked { order } => order,
        _ => 1,
    };
    let mut bits = DefaultHasher::new();
    let mut wrong = Vec::new();
    let mut before = None;
    let mut rhythm = Rhythm::anew(scene.parts.len());
    loop {
        let (moment, strikes) = cycle();
        let report = moment.report;
        let mut say = |what: String| {
            if wrong.len() < 4 {
                wrong.push(format!(
                    "{what} at {:.2} s in {:?}",
                    moment.time, report.state
                ));
            }
        };
        let amplitude = report.command.amplitude;
        (amplitude.to_bits(), report.amplitude.to_bits()).hash(&mut bits);
        (report.phase.to_bits(), report.in_gear.to_bits()).hash(&mut bits);
        if !(0.0..=settings.output_maximum).contains(&amplitude) {
            say(format!("output {amplitude}"));
        }
        let told = [
            report.amplitude,
            report.reference,
            report.lead,
            report.frequency,
        ];
        if !told.iter().all(|number| number.is_finite()) {
            say(format!("{told:?}"));
        }
        if report.reference > 1.0001 * ceiling {
            say(format!("reference {} beyond the limit", report.reference));
        }
        // Measured amplitudes may exceed the limit by 2 %, and noise adds at most 1 %.
        if calm && report.amplitude > 1.03 * ceiling {
            say(format!("amplitude {} beyond {ceiling}", report.amplitude));
        }
        let off = matches!(report.state, State::Off | State::Fault);
        if off && (amplitude != 0.0 || !report.command.immediate) {
            say("driven".into());
        }
        if (report.state == State::Fault) != report.fault.is_some() {
            say(format!("fault {:?}", report.fault));
        }
        if !(0.0..=1.0).contains(&report.in_gear) || report.in_gear_error.is_nan() {
            say(format!(
                "in gear {} +- {}",
                report.in_gear, report.in_gear_error
            ));
        }
        if let Some(before) = before.filter(|before| *before != report.state && !restarts) {
            let known =
                |way: &&kband_control::Transition| way.from == before && way.to == report.state;
            if !TRANSITIONS.iter().any(|way| known(&way)) {
                say(format!("{before:?} went to {:?}", report.state));
            }
        }
        if before != Some(report.state) {
            rhythm = Rhythm::anew(scene.parts.len());
        }
        before = Some(report.state);
        if report.state == State::Locked && calm {
            rhythm.take(&strikes);
            if rhythm.cycles == WINDOW {
                let locked = rhythm.locked(order);
                if 2 * locked < scene.parts.len() {
                    say(format!("locked with {locked} of {}", scene.parts.len()));
                }
                rhythm = Rhythm::anew(scene.parts.len());
            }
        }
        if moment.time >= seconds {
            return End {
                state: report.state,
                fault: report.fault,
                limits: report.limits,
                bits: bits.finish(),
                wrong,
            };
        }
    }
}

fn envelope(scene: &Scene, seconds: f64) -> Option<End> {
    let mut closed = EnvelopeLoop::build(scene).ok()?;
    Some(run(scene, seconds, || {
        let moment = closed.cycle();
        (moment, closed.strikes().to_vec())
    }))
}

fn waveform(scene: &Scene, seconds: f64) -> Option<End> {
    let mut closed = ClosedLoop::build(scene).ok()?;
    Some(run(scene, seconds, || {
        let moment = closed.cycle();
        (moment, closed.plant().strikes().to_vec())
    }))
}

/// Prints the turning points of a scene's course, in both fidelities.
fn tell(scene: &Scene, seconds: f64) {
    println!("{scene:#?}\n{seconds} s");
    let (mut fast, mut slow) = (
        EnvelopeLoop::build(scene).unwrap(),
        ClosedLoop::build(scene).unwrap(),
    );
    type Cycle<'a> = &'a mut dyn FnMut() -> (Moment, Vec<Strike>);
    let mut courses: [(&str, Cycle<'_>); 2] = [
        ("envelope", &mut || {
            let moment = fast.cycle();
            (moment, fast.strikes().to_vec())
        }),
        ("waveform", &mut || {
            let moment = slow.cycle();
            (moment, slow.plant().strikes().to_vec())
        }),
    ];
    for (name, cycle) in &mut courses {
        let (mut before, mut strikes, mut cycles) = (None, 0, 0);
        loop {
            let (moment, struck) = cycle();
            let report = moment.report;
            strikes += struck.len();
            cycles += 1;
            let now = (report.state, report.limits, report.fault);
            if before != Some(now) || moment.time >= seconds {
                println!(
                    "{name} {:.3} s, {cycles} cycles, {strikes} strikes: {report:?}",
                    moment.time
                );
                (strikes, cycles) = (0, 0);
            }
            before = Some(now);
            if moment.time >= seconds {
                break;
            }
        }
    }
}

/// A number from the environment.
fn environment_number(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).map_or(otherwise, |value| value.parse().expect("a whole number"))
}

/// A scene, its name, and the ends in both fidelities, the envelope twice; `None` if it is refused.
struct Played {
    name: String,
    scene: Scene,
    seconds: f64,
    ends: Option<[End; 3]>,
}

/// Plays `count` scenes drawn from a seed, on every core.
fn play(count: u64, drawn: impl Fn(u64) -> (Scene, f64) + Sync) -> Vec<Played> {
    let next = AtomicU64::new(0);
    let work = || {
        let mut found = Vec::new();
        loop {
            let n = next.fetch_add(1, Ordering::Relaxed);
            if n >= count {
                return found;
            }
            let (scene, seconds) = drawn(n);
            let parts = scene.parts.len();
            let played = Played {
                name: format!("scene {n}, {:?}, {parts} parts", scene.target),
                // Bits depend neither on the thread nor on earlier runs.
                ends: envelope(&scene, seconds)
                    .zip(envelope(&scene, seconds))
                    .zip(waveform(&scene, seconds))
                    .map(|((fast, again), slow)| [fast, again, slow]),
                scene,
                seconds,
            };
            found.push((n, played));
        }
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mut found: Vec<_> = std::thread::scope(|scope| {
        let all: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        all.into_iter()
            .flat_map(|thread| thread.join().unwrap())
            .collect()
    });
    found.sort_by_key(|(n, _)| *n);
    found.into_iter().map(|(_, played)| played).collect()
}

/// Violations within one scene.
fn broken(name: &str, [fast, again, slow]: &[End; 3], wrong: &mut Vec<String>) {
    if fast != again {
        wrong.push(format!("{name}: not the same bits again"));
    }
    for (fidelity, end) in [("envelope", fast), ("waveform", slow)] {
        for what in &end.wrong {
            wrong.push(format!("{name}, {fidelity}: {what}"));
        }
    }
}

/// Number of noise seeds that may show that an end depends on the noise.
const OTHER_SEEDS: u64 = 24;

/// Share of the time with ringing from which the onset detector takes a crowd's ringing for noise.
/// The closed form of its median is valid up to here.
const CROWDED: f64 = 0.4;

/// Share of the time with ringing above the noise, without overlap of impacts, and its RMS in
/// m/s^2.
fn ringing(scene: &Scene, seconds: f64) -> (f64, f64) {
    let Ok(mut closed) = EnvelopeLoop::build(scene) else {
        return (0.0, 0.0);
    };
    let decay = 1e-3 * f64::from(scene.sensor.ringing_decay);
    let (mut filled, mut energy, mut time) = (0.0, 0.0, 0.0);
    while time < seconds {
        time = closed.cycle().time;
        for strike in closed.strikes() {
            let height = f64::from(scene.sensor.ringing) * strike.speed;
            let above = (height / f64::from(scene.sensor.noise)).max(1.0).ln();
            filled += decay * above;
            energy += 0.25 * decay * height * height;
        }
    }
    (filled / seconds, (energy / seconds).sqrt())
}

/// RMS in m/s^2 of the drive's own acceleration after the onset detector's high-passes.
///
/// Where it dominates the noise, the detector's median depends on the phase of the ringing. The
/// closed form ignores that: +-14 % for a part that strikes once a cycle at 100 Hz and rings for a
/// fifth of it.
fn swing(scene: &Scene, seconds: f64) -> f64 {
    let Ok(mut closed) = EnvelopeLoop::build(scene) else {
        return 0.0;
    };
    let mut moment = closed.cycle();
    while moment.time < seconds {
        moment = closed.cycle();
    }
    let turn = TAU * f64::from(scene.settings.frequency);
    // The corner as a share of the sample rate, times 2 pi.
    let left = 1.0 - 0.27;
    let (sine, cosine) = (turn / f64::from(SAMPLE_RATE)).sin_cos();
    // Gain of (1 - c)(1 - 1/z) / (1 - (1 - c)/z), twice.
    let passed = 2.0 * left * left * (1.0 - cosine);
    let square = passed / ((1.0 - left * cosine).powi(2) + (left * sine).powi(2));
    f64::from(moment.report.amplitude) * turn * turn * square / std::f64::consts::SQRT_2
}

/// Reason why the fidelities end differently; `None` if none of these applies:
///
/// - Another seed of the noise lets one fidelity end like the other; the first such seed is given.
/// - Impacts are near the detection threshold, and the envelope ends alike with ringing 1/20 higher
///   or lower. That is the error of the detector's closed form; it is 1/7 where the drive's swing
///   is the noise.
/// - One fidelity passes through the other's final state.
/// - The ringing of a crowd never ends; its share taken as noise, and its level.
fn excused(scene: &Scene, seconds: f64, fast: &End, slow: &End) -> Option<String> {
    let came_to = |end: &End| (end.state, end.fault);
    for other in 1..=OTHER_SEEDS {
        let mut scene = scene.clone();
        scene.seed = scene.seed.wrapping_add(other);
        if envelope(&scene, seconds).is_some_and(|end| came_to(&end) == came_to(slow)) {
            return Some(format!("with seed + {other} the envelope ends so too"));
        }
        if waveform(&scene, seconds).is_some_and(|end| came_to(&end) == came_to(fast)) {
            return Some(format!("with seed + {other} the waveform ends so too"));
        }
    }
    let other = |change: &dyn Fn(&mut Scene)| {
        let mut scene = scene.clone();
        change(&mut scene);
        envelope(&scene, seconds).is_some_and(|end| came_to(&end) == came_to(slow))
    };
    let heights = |heights: [f32; 2]| {
        let same = |height: &f32| other(&|scene| scene.sensor.ringing *= height);
        heights.into_iter().find(same)
    };
    if let Some(height) = heights([0.95, 1.05]) {
        return Some(format!(
            "with ringing {height} as high the envelope ends so too"
        ));
    }
    let swing = swing(scene, seconds);
    if swing > f64::from(scene.sensor.noise)
        && let Some(height) = heights([0.85, 1.15])
    {
        return Some(format!(
            "the drive's own swing, {swing:.2} m/s^2, is the noise: with ringing {height} as high the envelope ends so too"
        ));
    }
    for longer in [1.1, 1.25, 1.5, 2.0] {
        let seconds = seconds * longer;
        let ends = [envelope(scene, seconds)?, waveform(scene, seconds)?];
        if came_to(&ends[0]) == came_to(&ends[1]) {
            let state = ends[0].state.name();
            return Some(format!("{longer} times as long both end {state}"));
        }
    }
    let (filled, rms) = ringing(scene, seconds);
    if filled <= CROWDED {
        return None;
    }
    let never = format!("ringing of {rms:.2} m/s^2 is never over");
    let noisier = |share: &f64| {
        other(&|scene| scene.sensor.noise = scene.sensor.noise.hypot((share * rms) as f32))
    };
    if let Some(share) = [0.25, 0.5, 1.0].into_iter().find(noisier) {
        return Some(format!(
            "{never}: with {share} of it as noise the envelope ends so too"
        ));
    }
    let softer = |share: &f32| {
        let mut scene = scene.clone();
        scene.sensor.ringing *= share;
        waveform(&scene, seconds).is_some_and(|end| came_to(&end) == came_to(fast))
    };
    [0.85_f32, 0.7, 0.5]
        .into_iter()
        .find(softer)
        .map(|share| format!("{never}: with {share} of it the waveform ends so too"))
}

fn random(seed: u64, n: u64) -> Random {
    Random::new(seed.wrapping_mul(1_000_003).wrapping_add(n))
}

/// Duration of a scene in s, from its number of cycles.
fn length(random: &mut Random, scene: &Scene) -> f64 {
    random.between(3.0, 8.0) * 50.0 / f64::from(scene.settings.frequency)
}

#[test]
fn a_feeder_keeps_to_its_rules_under_any_settings() {
    let (count, seed) = (
        environment_number("KBAND_SCENES", 200),
        environment_number("KBAND_SEED", 1),
    );
    let drawn = |n: u64| {
        let mut random = random(seed, n);
        let scene = scene(&mut random);
        let seconds = length(&mut random, &scene);
        (scene, seconds)
    };
    if std::env::var_os("KBAND_SCENE").is_some() {
        let (scene, seconds) = drawn(environment_number("KBAND_SCENE", 0));
        return tell(&scene, seconds);
    }
    let (mut wrong, mut apart, mut refused) = (Vec::new(), Vec::new(), 0);
    let mut unexplained = Vec::new();
    for played in play(count, drawn) {
        let (name, Some(ends)) = (&played.name, &played.ends) else {
            refused += 1;
            continue;
        };
        broken(name, ends, &mut wrong);
        let [fast, _, slow] = ends;
        if (fast.state, fast.fault) != (slow.state, slow.fault) {
            let end = |end: &End| match end.fault {
                Some(fault) => format!("fault: {}", fault.name()),
                None => {
                    let limits = Limits::ALL
                        .into_iter()
                        .filter(|one| end.limits.contains(*one));
                    let names: Vec<_> = limits.map(Limits::name).collect();
                    [&[end.state.name()], &names[..]].concat().join(", ")
                }
            };
            let ends = format!("| {name} | {} | {} |", end(fast), end(slow));
            // The next kick's capture, or the loudness of an impact at the threshold: the reason
            // must be shown.
            match excused(&played.scene, played.seconds, fast, slow) {
                Some(why) => apart.push(format!("{ends} {why} |")),
                None => unexplained.push(format!("{ends} none known |")),
            }
        }
    }
    let summary = format!(
        "{count} scenes of seed {seed}, {refused} refused, {} end apart, and {} for no reason that is known",
        apart.len(),
        unexplained.len()
    );
    println!("{summary}");
    if std::env::var_os("KBAND_ACCEPT").is_some() {
        let rows: Vec<_> = apart.iter().chain(&unexplained).cloned().collect();
        let text = format!(
            "# Random scenes that end apart in the two fidelities\n\n\
            Written by `KBAND_ACCEPT=1 KBAND_SCENES={count} KBAND_SEED={seed} cargo test --release -p kband-tests --test random_scenes`: \
            {summary}.\n\n\
            | scene | by the envelope | by the waveform | what its end hangs on |\n|---|---|---|---|\n{}\n",
            rows.join("\n")
        );
        std::fs::write(root().join("tests/random_scenes.md"), text).unwrap();
    }
    for one in apart.iter().chain(&unexplained).chain(&wrong) {
        println!("{one}");
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(10 * refused < count, "{refused} of {count} refused");
    // Measured: 40 of 2000. Three standard deviations of a count of that rate.
    let expected = 0.02 * count as f64;
    let most = expected + 3.0 * expected.sqrt();
    assert!(apart.len() as f64 <= most, "{apart:#?}");
    assert!(unexplained.is_empty(), "{unexplained:#?}");
}

#[test]
fn a_misconfigured_feeder_keeps_to_its_rules() {
    let (count, seed) = (
        environment_number("KBAND_SCENES", 200) / 2,
        environment_number("KBAND_SEED", 1),
    );
    let (mut wrong, mut refused, mut faults, mut other) = (Vec::new(), 0, 0, 0);
    let drawn = |n: u64| {
        let mut random = random(seed ^ 0x5eed, n);
        let scene = hostile(&mut random);
        let seconds = length(&mut random, &scene);
        (scene, seconds)
    };
    for played in play(count, drawn) {
        let Some(ends) = &played.ends else {
            refused += 1;
            continue;
        };
        broken(&played.name, ends, &mut wrong);
        let [fast, _, slow] = ends;
        faults += u32::from(slow.fault.is_some());
        other += u32::from(fast.fault != slow.fault);
    }
    println!(
        "{count} hostile scenes, {refused} refused, {faults} end in a fault, {other} in another one by the envelope"
    );
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(2 * refused < count, "{refused} of {count} refused");
    assert!(20 * u64::from(faults) > count, "{faults} of {count}");
    assert!(10 * u64::from(other) <= count, "{other} of {count}");
}

/// Parts at 150 Hz that mostly hop and rest; the drive's swing and their ringing drown a single
/// part.
///
/// The detector measures only groups that lock and strike at once.
#[test]
fn the_loudest_rhythm_of_a_crowd_is_not_reported_as_a_lock() {
    let mut scene = Scene::default();
    let settings = &mut scene.settings;
    (settings.frequency, settings.incline) = (150.0, -6.659);
    (settings.restitution_low, settings.restitution_high) = (0.399, 0.409);
    (settings.resonance, settings.quality, settings.gain) = (150.875, 31.87, 0.0712);
    (settings.amplitude_limit, settings.acceleration_limit) = (0.2, 300.0);
    (settings.safe_amplitude, settings.sensitivity) = (0.006, 0.01);
    settings.envelope = 14.5;
    scene.drive.resonance = settings.resonance;
    scene.drive.quality = settings.quality;
    scene.drive.gain = settings.gain;
    scene.sensor.noise = 0.0042;
    scene.target = Target::Locked { order: 2 };
    let mut wrong = Vec::new();
    for seed in 1..=6 {
        let mut random = Random::new(seed);
        scene.parts = (0..24)
            .map(|_| random.between(0.399, 0.409) as f32)
            .collect();
        scene.seed = seed;
        let ends = [envelope(&scene, 12.0), waveform(&scene, 12.0)];
        for (fidelity, end) in ["envelope", "waveform"].into_iter().zip(ends) {
            let end = end.expect("a scene that is accepted");
            println!("seed {seed}, {fidelity}: {:?} {:?}", end.state, end.limits);
            for what in end.wrong {
                wrong.push(format!("seed {seed}, {fidelity}: {what}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
