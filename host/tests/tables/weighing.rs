//! Mass flow in g/s of random feeders without a scale: estimated and simulated
//! (docs/theory-real-parts.md#t10.5). The parts have 2 to 20 % of the track's mass.

use kband::arithmetic::Noise;
use kband::feeder::OutOfRange;
use kband_control::{Report, Target};
use kband_plant::{Change, ClosedLoop, Disturbance, Moment, Scene};
use rayon::prelude::*;

pub const HEAD: &str = "| Hz | Q | R | s | parts | share of the track | in gear | weighed | g | g told | error | g/s | g/s told | error |";
/// Times of the fall of the parts, of the start of the evaluation, and of the end, s.
const PHASE_TIMES: [f64; 3] = [2.0, 8.0, 28.0];

fn feeder(noise: &mut Noise) -> Scene {
    let mut between = |low: f32, high: f32| low + (high - low) * noise.uniform();
    let mut scene = Scene {
        target: Target::Gear { order: 1 },
        ..Scene::default()
    };
    let frequency = between(40.0, 100.0);
    let quality = between(10.0, 50.0);
    let restitution = between(0.1, 0.3);
    let scatter = between(0.0, 0.03);
    let share = between(0.02, 0.2);
    let count = between(12.0, 24.99) as usize;
    let settings = &mut scene.settings;
    (settings.frequency, settings.resonance) = (frequency, frequency);
    (settings.quality, settings.gain) = (quality, 20.0);
    settings.incline = between(0.0, 4.0);
    settings.amplitude_ratio = between(1.0, 2.0);
    settings.restitution_low = restitution - 0.01;
    settings.restitution_high = restitution + 0.01;
    settings.scatter = scatter;
    settings.tangential_restitution = 0.0;
    settings.track_mass = between(2.0, 40.0);
    settings.track_length = between(200.0, 800.0);
    scene.drive.resonance = frequency;
    scene.drive.quality = quality;
    scene.drive.gain = 20.0;
    scene.drive.mass = settings.track_mass;
    scene.friction = Some([between(0.3, 0.6); 2]);
    let mut part = |_| restitution + between(-0.01, 0.01);
    scene.parts = (0..count).map(&mut part).collect();
    scene.scatter = (0..count).map(|_| scatter).collect();
    let weights: Vec<f32> = (0..count).map(|_| between(0.5, 1.5)).collect();
    let sum: f32 = weights.iter().sum();
    let all = share * scene.drive.mass * 1e3;
    scene.masses = weights.iter().map(|weight| weight / sum * all).collect();
    scene.waiting = count as u8;
    let dump = Disturbance {
        at: PHASE_TIMES[0],
        change: Change::Dump(1.0),
    };
    scene.disturbances = std::iter::once(dump).collect();
    scene.seed = u64::from(noise.bits());
    scene
}

#[derive(Default)]
struct Weighed {
    estimated: f64,
    mass: f64,
    flow: f64,
    speed: f64,
    gear: f64,
    cycles: f64,
}

fn run(scene: &Scene) -> Result<Weighed, OutOfRange> {
    let mut all = Weighed::default();
    let mut began = None;
    let mut take = |moment: &Moment| {
        if moment.time < PHASE_TIMES[1] {
            return true;
        }
        let (time, origin) = *began.get_or_insert((moment.time, moment.displacement));
        let report: &Report = &moment.report;
        all.cycles += 1.0;
        all.gear += f64::from(report.in_gear);
        if let Some(load) = report.load {
            all.estimated += 1.0;
            all.mass += f64::from(load.mass);
            all.flow += f64::from(load.flow);
        }
        all.speed = (moment.displacement - origin) / (moment.time - time).max(1e-9) * 1e3;
        moment.time < PHASE_TIMES[2]
    };
    let mut closed = ClosedLoop::build(scene)?;
    while take(&closed.cycle()) {}
    all.mass /= all.estimated;
    all.flow /= all.estimated;
    all.gear /= all.cycles;
    all.estimated /= all.cycles;
    Ok(all)
}

/// Rows of the manual's table; panics if the error of mass or flow exceeds 4 %.
pub fn table(feeders: usize, seed: u64) -> Result<Vec<String>, OutOfRange> {
    let mut noise = Noise::new(seed);
    let scenes: Vec<Scene> = (0..feeders).map(|_| feeder(&mut noise)).collect();
    scenes.par_iter().map(row).collect()
}

fn row(scene: &Scene) -> Result<String, OutOfRange> {
    let result = run(scene)?;
    let mass: f64 = scene.masses.iter().map(|mass| f64::from(*mass)).sum();
    let flow = mass * result.speed / f64::from(scene.settings.track_length);
    let settings = &scene.settings;
    let percent = |estimated: f64, truth: f64| {
        let error = estimated / truth - 1.0;
        assert!(error.abs() < 0.04, "{estimated} for {truth}: {scene:?}");
        format!("{:+.1} %", error * 100.0)
    };
    let mut estimated = ["-"; 4].map(String::from);
    if result.estimated > 0.0 {
        let [weighed, flows] = [format!("{:.0}", result.mass), format!("{:.1}", result.flow)];
        let [off, away] = [percent(result.mass, mass), percent(result.flow, flow)];
        estimated = [weighed, off, flows, away];
    }
    let [weighed, off, flows, away] = estimated;
    Ok(format!(
        "| {:.1} | {:.1} | {:.2} | {:.3} | {} | {:.1} % | {:.3} | {:.2} | {mass:.0} | {weighed} | {off} | {flow:.1} | {flows} | {away} |",
        settings.frequency,
        settings.quality,
        0.5 * (settings.restitution_low + settings.restitution_high),
        settings.scatter,
        scene.parts.len(),
        mass * 0.1 / f64::from(settings.track_mass),
        result.gear,
        result.estimated,
    ))
}
