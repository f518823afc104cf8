//! Trial scenes of the emulated board, and the trace that must equal the desk's bit for bit.

use core::fmt;
use kband_control::{Report, Shape, StartCause, Target, UpperTone};
use kband_plant::{Change, Disturbance, Scene};

/// A scene and its number of drive cycles.
#[derive(Clone, Copy, Debug)]
pub struct Trial {
    /// Number of drive cycles.
    pub cycles: u32,
    /// Builds the scene.
    pub scene: fn() -> Scene,
}

impl Trial {
    /// The trial of this name on the command line. "link" and "run" are the default scene without
    /// end, the first with its drive off.
    pub fn named(name: &str) -> Option<Self> {
        let (cycles, scene): (u32, fn() -> Scene) = match name {
            "default" => (500, powered),
            "eventful" => (500, eventful),
            "scattering" => (250, scattering),
            "two-tones" => (200, two_tones),
            "link" => (u32::MAX, linked),
            "run" => (u32::MAX, running),
            _ => return None,
        };
        Some(Self { cycles, scene })
    }
}

/// The default scene from power-on. The enable input comes on once the board runs: an input that is
/// on earlier starts nothing.
fn powered() -> Scene {
    let changes = [(0.0, Change::Enable(false)), (0.1, Change::Enable(true))];
    let mut scene = Scene {
        start: StartCause::PowerOn,
        ..Scene::default()
    };
    disturb(&mut scene, changes);
    scene
}

fn disturb<const COUNT: usize>(scene: &mut Scene, changes: [(f64, Change); COUNT]) {
    let changes = changes.map(|(at, change)| Disturbance { at, change });
    scene.disturbances.extend(changes);
}

/// Parts with scattered restitution, the second more than the first; from 3 s both scatter more.
fn scattering() -> Scene {
    let mut scene = powered();
    scene.target = Target::K(0.43);
    scene.parts = [0.2, 0.3].into_iter().collect();
    scene.scatter = [0.05, 0.1].into_iter().collect();
    // Loud enough to affect the measured amplitude.
    scene.sensor.ringing = 100.0;
    disturb(&mut scene, [(3.0, Change::Scatter(0.15))]);
    scene
}

/// A drive with a second tone and a response other than configured. The parts reach gear on it.
fn two_tones() -> Scene {
    let mut scene = powered();
    scene.settings.second_tone = 0.2;
    scene.drive.second_gain = 0.6;
    scene.drive.second_lag = 80.0;
    scene.parts = [0.2, 0.3].into_iter().collect();
    scene.target = Target::Tones {
        k: 0.35,
        shape: Shape::of_two(UpperTone::new(0.15, 2.356)),
    };
    scene
}

/// The default scene with the target of the desk's built-in scene, gear of order 1.
fn geared(mut scene: Scene) -> Scene {
    scene.target = Target::Gear { order: 1 };
    scene
}

/// The default scene for the real link: its own link is silent, and the enable input is off.
fn linked() -> Scene {
    let mut scene = geared(Scene::default());
    let changes = [Change::Link(false), Change::Enable(false)];
    disturb(&mut scene, changes.map(|change| (0.0, change)));
    scene
}

/// The default scene from power-on for the real link: its own link is silent.
fn running() -> Scene {
    let mut scene = geared(powered());
    let (at, change) = (0.0, Change::Link(false));
    let first = Disturbance { at, change };
    scene.disturbances.insert(0, first).ok();
    scene
}

/// Each event once: targets, drift, another lot of parts, a stop, a lost sensor.
fn eventful() -> Scene {
    let mut scene = powered();
    scene.parts = [0.2, 0.18, 0.22].into_iter().collect();
    let changes = [
        (1.015, Change::Gain(0.8)),
        (2.015, Change::Target(Target::Chaotic)),
        (3.015, Change::Restitution(0.3)),
        (3.515, Change::Noise(0.5)),
        (4.015, Change::Target(Target::K(0.6))),
        (5.015, Change::Enable(false)),
        (6.015, Change::Enable(true)),
        (7.015, Change::Link(false)),
        (8.515, Change::Link(true)),
        (9.015, Change::SensorLost(true)),
        (9.515, Change::Enable(false)),
    ];
    disturb(&mut scene, changes);
    scene
}

/// A row of the trace: cycle, k, lead, tones of the track, output of the drive and its tones,
/// state, fault, limits and events. Single-precision numbers appear as their bits.
#[derive(Clone, Copy, Debug)]
pub struct TraceRow<'a>(pub &'a Report);

impl fmt::Display for TraceRow<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let report = self.0;
        write!(formatter, "{}", report.cycle)?;
        let tones = report.shape.numbers().into_iter();
        let tones = tones.zip(report.command.overtones);
        let first = [report.k, report.lead, report.command.amplitude];
        for number in (first.into_iter()).chain(tones.flat_map(|(a, b)| a.into_iter().chain(b))) {
            write!(formatter, " {:08x}", number.to_bits())?;
        }
        write!(
            formatter,
            " {} {} {:04x}",
            report.state.number(),
            report.fault.map_or(0, |fault| fault.number()),
            report.limits.bits(),
        )?;
        for event in report.events.iter() {
            write!(formatter, " {}", event.number())?;
        }
        Ok(())
    }
}
