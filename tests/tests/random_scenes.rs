//! Random feeders that are what the controller is told they are, in both fidelities: what must hold whatever the scene.
//! `KBAND_SCENES` and `KBAND_SEED` say how many and which.

use std::f64::consts::TAU;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::atomic::{AtomicU64, Ordering};

use kband::control::{Fault, Limits, State, TRANSITIONS, Target};
use kband::feeder::STANDARD_GRAVITY;
use kband::plant::{ClosedLoop, EnvelopeLoop, Moment, Scene, Strike};
use kband_tests::states::Random;

/// Cycles of a window in which a lock that is told is held against the parts' impacts.
const WINDOW: u32 = 120;

fn one_of<T: Copy>(random: &mut Random, all: &[T]) -> T {
    all[(random.bits() % all.len() as u64) as usize]
}

/// A feeder of any size, tuned near its resonance, with parts of the lot told.
fn scene(random: &mut Random) -> Scene {
    let mut scene = Scene::default();
    let frequency = one_of(
        random,
        &[
            20.0, 25.0, 33.3, 50.0, 50.0, 60.0, 77.0, 100.0, 120.0, 150.0,
        ],
    );
    // Amplitude in mm at k = 0.35.
    let unit = 1e3 * STANDARD_GRAVITY / (0.35 * (TAU * frequency).powi(2));
    let settings = &mut scene.settings;
    settings.frequency = frequency as f32;
    settings.incline = random.between(-5.0, 10.0) as f32;
    settings.quality = random.scale(5.0, 50.0) as f32;
    let detuned = random.between(-0.3, 0.3) / f64::from(settings.quality);
    settings.resonance = (frequency * (1.0 + detuned)) as f32;
    settings.envelope = (f64::from(settings.quality) / std::f64::consts::PI) as f32;
    let middle = random.between(0.1, 0.45);
    let half = one_of(random, &[0.0, 0.005, 0.02, 0.05]);
    settings.restitution_low = (middle - half) as f32;
    settings.restitution_high = (middle + half) as f32;
    settings.scatter = one_of(random, &[0.0, 0.0, 0.03, 0.06]);
    settings.gain = (unit * random.scale(3.0, 8.0)) as f32;
    settings.amplitude_limit = (unit * random.scale(3.0, 8.0)) as f32;
    settings.acceleration_limit = (random.scale(3.0, 8.0) * STANDARD_GRAVITY / 0.35) as f32;
    settings.safe_amplitude = (0.2 * unit) as f32;
    settings.soft_start = random.scale(0.1, 1.0) as f32;
    settings.output_maximum = random.between(0.7, 1.0) as f32;
    settings.sensitivity = 0.1;
    settings.capture_attempts = f32::from((random.bits() % 9) as u8);
    scene.drive.resonance = settings.resonance;
    scene.drive.quality = settings.quality;
    scene.drive.gain = settings.gain;
    scene.target = match random.bits() % 6 {
        0 | 1 => Target::Locked {
            order: 1 + (random.bits() % 2) as u8,
        },
        2 => Target::K(random.between(0.25, 1.1) as f32),
        3 => Target::Amplitude((unit * random.between(0.3, 1.4)) as f32),
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

/// What a run came to.
#[derive(Debug, PartialEq)]
struct End {
    state: State,
    fault: Option<Fault>,
    limits: Limits,
    /// Of all that the controller commanded and saw.
    bits: u64,
    /// What must not be.
    wrong: Vec<String>,
}

/// Parts that keep the rhythm of a lock over a window: `(strikes, sums of cosine and sine of their phases)` each.
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

    fn locked(&self, order: u8) -> usize {
        let wanted = f64::from(WINDOW) / f64::from(order);
        let keeps = |(count, cosines, sines): &&(f64, f64, f64)| {
            (count - wanted).abs() <= 3.0 && cosines.hypot(*sines) > 0.97 * count
        };
        self.parts.iter().filter(keeps).count()
    }
}

fn run(scene: &Scene, seconds: f64, mut cycle: impl FnMut() -> (Moment, Vec<Strike>)) -> End {
    let settings = &scene.settings;
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
        if report.reference > 1.0001 * ceiling {
            say(format!("reference {} beyond the limit", report.reference));
        }
        // The limit may be exceeded by 2 %, and noise reads as 1 % of it at most.
        if report.amplitude > 1.03 * ceiling {
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
        if let Some(before) = before.filter(|before| *before != report.state) {
            let known =
                |way: &&kband::control::Transition| way.from == before && way.to == report.state;
            if !TRANSITIONS.iter().any(|way| known(&way)) {
                say(format!("{before:?} went to {:?}", report.state));
            }
        }
        if before != Some(report.state) {
            rhythm = Rhythm::anew(scene.parts.len());
        }
        before = Some(report.state);
        if report.state == State::Locked {
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

/// A number told by the environment.
fn told(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).map_or(otherwise, |value| value.parse().expect("a whole number"))
}

#[test]
fn whatever_the_feeder_is_told_of_itself_it_keeps_to_its_rules() {
    let (count, seed) = (told("KBAND_SCENES", 200), told("KBAND_SEED", 1));
    let next = AtomicU64::new(0);
    let work = || {
        let mut found = Vec::new();
        loop {
            let n = next.fetch_add(1, Ordering::Relaxed);
            if n >= count {
                return found;
            }
            let mut random = Random::new(seed.wrapping_mul(1_000_003).wrapping_add(n));
            let scene = scene(&mut random);
            let seconds = random.between(3.0, 8.0) * 50.0 / f64::from(scene.settings.frequency);
            // Bits do not depend on the thread nor on what ran before.
            let ends = [envelope(&scene, seconds), envelope(&scene, seconds)];
            found.push((
                n,
                scene.target,
                scene.parts.len(),
                ends,
                waveform(&scene, seconds),
            ));
        }
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mut found: Vec<_> = std::thread::scope(|scope| {
        let all: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        all.into_iter()
            .flat_map(|thread| thread.join().unwrap())
            .collect()
    });
    found.sort_by_key(|(n, ..)| *n);
    let (mut wrong, mut apart, mut refused) = (Vec::new(), Vec::new(), 0);
    for (n, target, parts, [fast, again], slow) in found {
        let (Some(fast), Some(again), Some(slow)) = (fast, again, slow) else {
            refused += 1;
            continue;
        };
        let name = format!("scene {n}, {target:?}, {parts} parts");
        if fast != again {
            wrong.push(format!("{name}: not the same bits again"));
        }
        for (fidelity, end) in [("envelope", &fast), ("waveform", &slow)] {
            for what in &end.wrong {
                wrong.push(format!("{name}, {fidelity}: {what}"));
            }
        }
        if (fast.state, fast.fault) != (slow.state, slow.fault) {
            let ends = format!(
                "{name}: {:?} {:?} {:?} by the envelope, {:?} {:?} {:?} by the waveform",
                fast.state, fast.fault, fast.limits, slow.state, slow.fault, slow.limits
            );
            // Which kick captures is a matter of noise, and so is whether an impact is loud enough at the threshold of hearing.
            let by_chance = |end: &End| {
                let states = [State::Holding, State::Capturing, State::Locked, State::Lost];
                end.fault.is_none() && (states.contains(&end.state) || end.limits == Limits::DEAF)
            };
            if by_chance(&fast) && by_chance(&slow) {
                apart.push(ends);
            } else {
                wrong.push(ends);
            }
        }
    }
    println!(
        "{count} scenes, {refused} refused, {} end apart",
        apart.len()
    );
    for one in apart.iter().chain(&wrong) {
        println!("{one}");
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(10 * refused < count, "{refused} of {count} refused");
    // Measured: 9 of 200, 3 of them captures under way in one of the two, 6 deaf in one.
    assert!(100 * apart.len() as u64 <= 8 * count, "{apart:#?}");
}
