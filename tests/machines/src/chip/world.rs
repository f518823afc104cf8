//! The chip's surroundings: track on the bridge, accelerometer on the converter, and a trace of the
//! outputs.

use kband_control::{Settings, phase_step};
use kband_plant::{Bench, Scene};

use super::clocks::{Cause, TICKS};

/// Interval between two steps of the simulated track, ticks.
pub const STEP: u64 = TICKS / kband_control::SAMPLE_RATE as u64;

/// Mean bridge voltage over its supply at which the drive moves by its `gain`: the board's full
/// output, a duty of 93 %.
const FULL_OUTPUT_DUTY: f32 = 0.86;

/// Events observed from outside the chip.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// The bridge is driven (`true`) or open.
    Bridge(bool),
    DriveOn(bool),
    Ready(bool),
    Fault(bool),
    BusDriver(bool),
    Reset(Cause),
    /// The core has stopped: a fault within a fault (lock-up).
    LockedUp,
}

#[derive(Clone, Debug)]
pub struct World {
    pub bench: Bench,
    step: u32,
    angular: f32,
    /// Tick of the next step of the track.
    pub due: u64,
    /// Supply of the sensor over its nominal one; signal and mid-scale are proportional to it.
    pub sensor_supply: f32,
    /// Drift of the sensor's voltage, V.
    pub sensor_offset: f32,
    /// Fewest timer cycles between an edge of the bridge and the converter's sampling time.
    pub min_edge_distance: u32,
    /// Sensor reading, counts of a converter of 12 bits.
    pub reading: u16,
    /// Reading of the current sensor, counts.
    pub current: u16,
    held: f32,
    since: u64,
    sum: f64,
    /// Last levels of bridge, "drive on", READY, FAULT and the fieldbus's driver enable.
    last: [bool; 5],
    pub trace: Vec<(u64, Event)>,
    /// Largest displacement of the track since its last reset, m.
    pub peak: f32,
    /// Accesses that no program may make, with their ticks.
    pub violations: Vec<(u64, String)>,
    /// Number of ticks with the bridge driven while the core was outside its specification.
    pub outside: u64,
}

impl Default for World {
    fn default() -> Self {
        Self::new(&Scene::default()).expect("the default scene is accepted")
    }
}

impl World {
    pub fn new(scene: &Scene) -> Result<Self, kband::feeder::OutOfRange> {
        let Settings { frequency, .. } = scene.settings;
        Ok(Self {
            bench: Bench::build(scene)?,
            step: phase_step(frequency),
            angular: std::f32::consts::TAU * frequency,
            due: STEP,
            sensor_supply: 1.0,
            sensor_offset: 0.0,
            min_edge_distance: u32::MAX,
            reading: 2048,
            current: 0,
            held: 0.0,
            since: 0,
            sum: 0.0,
            last: [false; 5],
            trace: Vec::new(),
            peak: 0.0,
            violations: Vec::new(),
            outside: 0,
        })
    }

    /// Sets the bridge's output from tick `now` on.
    pub fn drive(&mut self, output: f32, now: u64) {
        self.sum += f64::from(self.held) * now.saturating_sub(self.since) as f64;
        (self.held, self.since) = (output, now);
    }

    pub fn advance(&mut self) {
        self.drive(self.held, self.due);
        let mean = (self.sum / STEP as f64) as f32;
        self.sum = 0.0;
        self.bench.hold(mean / FULL_OUTPUT_DUTY, self.step);
        let reading = f32::from(self.bench.sample().0);
        let drift = self.sensor_offset * (4096.0 / 3.3);
        self.reading = (reading * self.sensor_supply + drift) as u16;
        self.current = self.bench.current().0;
        self.bench.forget_strikes();
        let [x, _] = self.bench.motion();
        self.peak = self.peak.max(x.abs());
        self.due += STEP;
    }

    /// Amplitude of the track, m.
    pub fn amplitude(&self) -> f32 {
        let [x, v] = self.bench.motion();
        x.hypot(v / self.angular)
    }

    pub fn record(&mut self, now: u64, event: Event) {
        self.trace.push((now, event));
    }

    /// Records an event for each level that has changed: bridge, "drive on", both lamps, bus.
    pub fn record_changes(&mut self, now: u64, levels: [bool; 5]) {
        if levels == self.last {
            return;
        }
        let events = [
            Event::Bridge,
            Event::DriveOn,
            Event::Ready,
            Event::Fault,
            Event::BusDriver,
        ];
        for ((event, level), last) in events.into_iter().zip(levels).zip(self.last) {
            if level != last {
                self.record(now, event(level));
            }
        }
        self.last = levels;
    }

    /// Records an access that no program may make, once per kind.
    pub fn violate(&mut self, now: u64, what: impl Into<String>) {
        let what = what.into();
        if self.violations.len() < 32 && self.violations.iter().all(|(_, old)| *old != what) {
            self.violations.push((now, what));
        }
    }
}
