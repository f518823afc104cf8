//! What is around the chip: the track on the bridge, the accelerometer on the converter, and what was seen.

use kband::control::{Settings, phase_step};
use kband::plant::{Bench, Scene};

use super::clocks::{Cause, TICKS};

/// Ticks between two steps of the simulated track.
pub const STEP: u64 = TICKS / kband::control::SAMPLE_RATE as u64;

/// The bridge's mean over its supply at full output: a duty of 93 %.
pub const FULL: f32 = 0.86;

/// What was seen of the chip from outside.
#[derive(Clone, Debug, PartialEq)]
pub enum Seen {
    /// The bridge is driven (`true`) or open.
    Bridge(bool),
    /// The output "drive on".
    DriveOn(bool),
    /// The lamp READY.
    Ready(bool),
    /// The lamp FAULT.
    Fault(bool),
    /// The chip was reset.
    Reset(Cause),
    /// The core does nothing any more: a fault within a fault.
    LockedUp,
}

/// The track, and what was seen.
#[derive(Clone, Debug)]
pub struct World {
    /// The simulated track with its sensor.
    pub bench: Bench,
    step: u32,
    angular: f32,
    /// When the track is stepped next.
    pub due: u64,
    /// Share of its supply that the sensor has: signal and middle are parts of it.
    pub sensor_supply: f32,
    /// Drift of the sensor's voltage, in V.
    pub sensor_offset: f32,
    /// The bridge's mean over its supply at which the drive moves by its `gain`: what the board takes for full output.
    pub full: f32,
    /// Cycles of the timer between an edge of the bridge and the time in which the converter samples: the fewest.
    pub clear: u32,
    /// What the sensor gives now, in steps of a converter of 12 bits.
    pub reading: u16,
    /// What the other channels of the converter get.
    pub analogue: [u16; 19],
    held: f32,
    since: u64,
    sum: f64,
    /// Bridge, "drive on", READY and FAULT as they were seen last.
    last: [bool; 4],
    /// What was seen, and when.
    pub trace: Vec<(u64, Seen)>,
    /// Largest displacement of the track in m since it was last forgotten.
    pub peak: f32,
    /// Largest mean of the bridge's output over a step since then, and its share of time at a constant value.
    pub loudest: f32,
    /// What no chip may be made to do, with the time.
    pub violations: Vec<(u64, String)>,
    /// Ticks with the bridge driven while the core was outside its specification.
    pub outside: u64,
}

impl Default for World {
    fn default() -> Self {
        Self::new(&Scene::default()).expect("the default scene is accepted")
    }
}

impl World {
    /// The world of a scene.
    pub fn new(scene: &Scene) -> Result<Self, kband::feeder::OutOfRange> {
        let Settings { frequency, .. } = scene.settings;
        Ok(Self {
            bench: Bench::build(scene)?,
            step: phase_step(frequency),
            angular: std::f32::consts::TAU * frequency,
            due: STEP,
            sensor_supply: 1.0,
            sensor_offset: 0.0,
            full: FULL,
            clear: u32::MAX,
            reading: 2048,
            analogue: [0; 19],
            held: 0.0,
            since: 0,
            sum: 0.0,
            last: [false; 4],
            trace: Vec::new(),
            peak: 0.0,
            loudest: 0.0,
            violations: Vec::new(),
            outside: 0,
        })
    }

    /// The bridge gives this from now on.
    pub fn drive(&mut self, output: f32, now: u64) {
        self.sum += f64::from(self.held) * now.saturating_sub(self.since) as f64;
        (self.held, self.since) = (output, now);
    }

    /// The track moves by a step.
    pub fn advance(&mut self) {
        self.drive(self.held, self.due);
        let mean = (self.sum / STEP as f64) as f32;
        self.sum = 0.0;
        self.bench.hold(mean / self.full, self.step);
        let reading = f32::from(self.bench.sample().0);
        let drift = self.sensor_offset * (4096.0 / 3.3);
        self.reading = (reading * self.sensor_supply + drift) as u16;
        self.bench.forget_strikes();
        let [x, _] = self.bench.plant().motion();
        self.peak = self.peak.max(x.abs());
        self.loudest = self.loudest.max(mean.abs());
        self.due += STEP;
    }

    /// Amplitude of the track now in m.
    #[must_use]
    pub fn amplitude(&self) -> f32 {
        let [x, v] = self.bench.plant().motion();
        x.hypot(v / self.angular)
    }

    /// Something is seen.
    pub fn see(&mut self, now: u64, seen: Seen) {
        self.trace.push((now, seen));
    }

    /// The bridge, "drive on" and the two lamps are looked at; what is another than before is seen.
    pub fn look(&mut self, now: u64, levels: [bool; 4]) {
        if levels == self.last {
            return;
        }
        let seen = [Seen::Bridge, Seen::DriveOn, Seen::Ready, Seen::Fault];
        for ((seen, level), last) in seen.into_iter().zip(levels).zip(self.last) {
            if level != last {
                self.see(now, seen(level));
            }
        }
        self.last = levels;
    }

    /// Something that no chip may be made to do.
    pub fn violate(&mut self, now: u64, what: String) {
        if self.violations.len() < 32 && self.violations.iter().all(|(_, old)| *old != what) {
            self.violations.push((now, what));
        }
    }
}
