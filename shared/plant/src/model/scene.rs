//! Scene: the true plant, the controller's settings and target, and the disturbances over time.
//!
//! It is the input of both simulations. [`Scene::check`] names the first parameter out of range.

use super::law::Law;
use heapless::Vec;
use kband::feeder::{OutOfRange, STANDARD_GRAVITY, Track, accept};
use kband::impact::{ContactTime, FrictionSettings, TangentialSettings};
use kband_control::{Settings, StartCause, Target};

/// Largest number of parts of a plant.
pub const PARTS: usize = 24;
/// Largest number of disturbances of a scene.
pub const DISTURBANCES: usize = 32;

/// One number for each part of a scene.
pub type Parts = Vec<f32, PARTS>;
/// Disturbances of a scene in order of time.
pub type Disturbances = Vec<Disturbance, DISTURBANCES>;

/// The true drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveModel {
    /// Resonance frequency in Hz.
    pub resonance: f32,
    /// Quality factor (symbol Q).
    pub quality: f32,
    /// Track amplitude at resonance for full output, in mm.
    pub gain: f32,
    /// Track amplitude in mm at full output at twice the frequency; 0: the resonance's response.
    pub second_gain: f32,
    /// Lag of the track behind the output at twice the drive's frequency, in degrees.
    pub second_lag: f32,
    /// Track amplitude in mm at full output at three times it; 0: the resonance's response.
    pub third_gain: f32,
    /// Lag of the track behind the output at three times the drive's frequency, in degrees.
    pub third_lag: f32,
    /// Quality factor of the modes above the resonance.
    pub second_quality: f32,
    /// Mains frequency in Hz; its second harmonic is the ripple on the drive's bus.
    pub mains: f32,
    /// Ripple of the drive's bus at twice the mains frequency, amplitude over mean.
    pub ripple: f32,
    /// Mass in kg that swings with the track (symbol M).
    pub mass: f32,
    /// Track amplitude at resonance per ampere, in mm/A: the force is proportional to the current.
    pub current_gain: f32,
}

impl Default for DriveModel {
    fn default() -> Self {
        Self {
            resonance: 50.0,
            quality: 25.0,
            gain: 1.0,
            second_gain: 0.0,
            second_lag: 90.0,
            third_gain: 0.0,
            third_lag: 90.0,
            second_quality: 25.0,
            mains: 50.0,
            ripple: 0.0,
            mass: 10.0,
            current_gain: 0.5,
        }
    }
}

/// The true accelerometer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorModel {
    /// RMS of its noise in m/s^2.
    pub noise: f32,
    /// Sensitivity over the configured one.
    pub sensitivity: f32,
    /// Height of the ringing over the speed of the impact, in 1/s.
    pub ringing: f32,
    /// Frequency of the ringing in Hz.
    pub ringing_frequency: f32,
    /// Decay time of the ringing in ms.
    pub ringing_decay: f32,
    /// Amplitude of the mains hum in the reading, in m/s^2.
    pub hum: f32,
}

impl Default for SensorModel {
    fn default() -> Self {
        Self {
            noise: 0.15,
            sensitivity: 1.0,
            ringing: 30.0,
            ringing_frequency: 2400.0,
            ringing_decay: 1.0,
            hum: 0.0,
        }
    }
}

/// A change of the plant, its inputs or the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    /// The enable input.
    Enable(bool),
    /// The target.
    Target(Target),
    /// Gain of the drive over its initial gain.
    Gain(f32),
    /// Mean restitution of all parts.
    Restitution(f32),
    /// Standard deviation of the restitution of all parts from impact to impact.
    Scatter(f32),
    /// RMS of the accelerometer's noise in m/s^2.
    Noise(f32),
    /// Ripple of the drive's bus over its mean.
    Ripple(f32),
    /// Amplitude of the mains' hum in the accelerometer's reading, in m/s^2.
    Hum(f32),
    /// The accelerometer's reading is stuck (`true`) or valid.
    SensorLost(bool),
    /// The accelerometer's sign is inverted (`true`) or right.
    SensorInverted(bool),
    /// Sensitivity of the accelerometer over the configured one.
    Sensitivity(f32),
    /// The over-temperature input.
    OverTemperature(bool),
    /// The link delivers frames (`true`) or is silent.
    Link(bool),
    /// The stack warning.
    StackLow(bool),
    /// The over-current input.
    OverCurrent(bool),
    /// The supply monitor of the board.
    SupplyLow(bool),
    /// The crystal fails (`true`), and the board runs on its internal oscillator.
    ClockFailed(bool),
    /// The board switches the drive off after a missed control deadline.
    ControlLate(bool),
    /// The supply of the board sags (`true`), and its controller restarts as after a brown-out.
    BrownOut(bool),
    /// The hopper drops its [waiting](Scene::waiting) parts onto the track within so many seconds.
    Dump(f32),
    /// The first so many parts are on the track from now on; the others are not.
    Parts(u8),
}

/// A change at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disturbance {
    /// Time in s from the start of the scene.
    pub at: f64,
    /// The change.
    pub change: Change,
}

/// A whole scene.
///
/// ```
/// use kband_plant::{Change, Disturbance, Scene};
/// let mut scene = Scene::default();
/// scene.parts = [0.19, 0.2, 0.21].into_iter().collect();
/// let weaker = Disturbance {
///     at: 5.0,
///     change: Change::Gain(0.8),
/// };
/// scene.disturbances = std::iter::once(weaker).collect();
/// assert!(scene.check().is_ok());
/// scene.sensor.ringing_frequency = 50.0;
/// assert_eq!(scene.check().unwrap_err().accepted, "500..9000 Hz");
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Settings of the controller.
    pub settings: Settings,
    /// Requested target.
    pub target: Target,
    /// Cause of the controller's start.
    pub start: StartCause,
    /// The true drive.
    pub drive: DriveModel,
    /// The true accelerometer.
    pub sensor: SensorModel,
    /// Mean restitution of each part before clipping at 0, -0.5..=1: below 0 most do not bounce.
    pub parts: Parts,
    /// Standard deviation of each part's restitution (symbol s), 0..=0.5; 0 without an entry.
    pub scatter: Parts,
    /// Coefficients of sliding and sticking friction on the track (symbols mu, mu_s), 0..=10.
    /// `None`: the configured tangential restitution.
    pub friction: Option<[f32; 2]>,
    /// Duration of an impact in ms, 0 to 7 % of a drive cycle. Parts with mass have none.
    pub contact: f32,
    /// Mass of each part in g (symbol m), 0..=1e6. Parts without an entry have none.
    pub masses: Parts,
    /// Number of parts, the last ones, that wait in the hopper until a [`Change::Dump`].
    pub waiting: u8,
    /// Seed of noise and scatter.
    pub seed: u64,
    /// Disturbances in order of time.
    pub disturbances: Disturbances,
}

impl Default for Scene {
    /// The paper's application: 50 Hz, 3 degrees, eta 1.5, lot 0.18..0.22, one part of R = 0.2.
    fn default() -> Self {
        Self {
            settings: Settings::default(),
            target: Target::Locked { order: 1 },
            start: StartCause::Ordinary,
            drive: DriveModel::default(),
            sensor: SensorModel::default(),
            parts: core::iter::once(0.2).collect(),
            scatter: Parts::new(),
            friction: None,
            contact: 0.0,
            masses: Parts::new(),
            waiting: 0,
            seed: 1,
            disturbances: Vec::new(),
        }
    }
}

impl Scene {
    /// Mass of a part over that of the track (symbol m/M).
    pub(crate) fn mass_share(&self, part: usize) -> f64 {
        let mass = self.masses.get(part).copied().unwrap_or(0.0);
        f64::from(mass) * 1e-3 / f64::from(self.drive.mass)
    }

    /// Acceleration in m/s^2 along the accelerometer's axis at rest, by the settings.
    pub(crate) fn rest(&self) -> f32 {
        let settings = &self.settings;
        if settings.sensor_rest <= 0.0 {
            return 0.0;
        }
        let mean_signal = settings.sensor_rest - settings.sensor_zero;
        mean_signal / settings.sensitivity * STANDARD_GRAVITY as f32
    }

    /// The target, and those that disturbances set later, as listed.
    pub fn targets(&self) -> impl Iterator<Item = Target> + '_ {
        let changes = self.disturbances.iter();
        let later = changes.filter_map(|disturbance| match disturbance.change {
            Change::Target(target) => Some(target),
            _ => None,
        });
        core::iter::once(self.target).chain(later)
    }

    pub(crate) fn has_mass(&self) -> bool {
        self.masses.iter().any(|mass| *mass > 0.0)
    }

    pub(crate) fn contact_time(&self) -> Result<ContactTime, OutOfRange> {
        ContactTime::from_milliseconds(self.contact.into(), self.settings.frequency.into())
    }

    /// The accelerometer, with the ringing weakened by the contact time.
    pub(crate) fn effective_sensor(&self) -> SensorModel {
        let mut sensor = self.sensor;
        if self.contact > 0.0 {
            sensor.ringing *= ringing_share(sensor.ringing_frequency * self.contact * 1e-3);
        }
        sensor
    }

    pub(crate) fn law(&self, track: &Track) -> Law {
        match self.friction {
            Some([sliding, sticking]) => {
                Law::Friction(FrictionSettings::on(track, sticking.into(), sliding.into()))
            }
            None => {
                let factor = f64::from(self.settings.tangential_restitution);
                Law::Restitution(TangentialSettings::on(track, factor))
            }
        }
    }

    /// Checks the scene without its settings; an error names the first parameter out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let within = |parameter, value: f32, [low, high]: [f32; 2], accepted| {
            let accepts = (low..=high).contains(&value);
            accept(parameter, f64::from(value), accepts, accepted).map(|_| ())
        };
        let (drive, sensor) = (&self.drive, &self.sensor);
        let (quality, current) = (drive.second_quality, drive.current_gain);
        let (ringing, decay) = (sensor.ringing_frequency, sensor.ringing_decay);
        let degrees = ([-180.0, 180.0], "-180..180 degrees");
        let millimetres = ([0.0, 100.0], "0..100 mm");
        let hertz = ([5.0, 500.0], "5..500 Hz");
        let amperes = ([1e-3, 100.0], "0.001..100 mm/A");
        let noise_range = ([0.0, 100.0], "0..100 m/s^2");
        let sensitive = ([0.1, 10.0], "0.1..10");
        let ringing_range = ([0.0, 1e5], "0..100000 1/s");
        let high = ([500.0, 9000.0], "500..9000 Hz");
        for (parameter, value, (range, accepted)) in [
            ("drive resonance", drive.resonance, hertz),
            ("drive quality", drive.quality, ([1.0, 200.0], "1..200")),
            ("drive gain", drive.gain, ([1e-3, 100.0], "0.001..100 mm")),
            ("drive second_gain", drive.second_gain, millimetres),
            ("drive second_lag", drive.second_lag, degrees),
            ("drive third_gain", drive.third_gain, millimetres),
            ("drive third_lag", drive.third_lag, degrees),
            ("drive second_quality", quality, ([0.5, 200.0], "0.5..200")),
            ("drive mains", drive.mains, ([10.0, 400.0], "10..400 Hz")),
            ("drive ripple", drive.ripple, ([0.0, 0.5], "0..0.5")),
            ("drive mass", drive.mass, ([0.001, 1e5], "0.001..100000 kg")),
            ("drive current_gain", current, amperes),
            ("sensor hum", sensor.hum, noise_range),
            ("sensor noise", sensor.noise, noise_range),
            ("sensor sensitivity", sensor.sensitivity, sensitive),
            ("sensor ringing", sensor.ringing, ringing_range),
            ("sensor ringing_frequency", ringing, high),
            ("sensor ringing_decay", decay, ([0.05, 50.0], "0.05..50 ms")),
        ] {
            within(parameter, value, range, accepted)?;
        }
        for &restitution in &self.parts {
            within("part restitution", restitution, [-0.5, 1.0], "-0.5..1")?;
        }
        for &scatter in &self.scatter {
            within("part scatter", scatter, [0.0, 0.5], "0..0.5")?;
        }
        for &mass in &self.masses {
            within("part mass", mass, [0.0, 1e6], "0..1000000 g")?;
        }
        let total: f32 = self.masses.iter().take(self.parts.len()).sum();
        let accepted = "0..the mass that swings with the track";
        let mass_range = [0.0, 1e3 * drive.mass];
        within("part mass, of all parts", total, mass_range, accepted)?;
        let count = ([0.0, self.parts.len() as f32], "0..the number of parts");
        let waiting = f32::from(self.waiting);
        within("parts in the hopper", waiting, count.0, count.1)?;
        self.contact_time()?;
        if self.contact > 0.0 && self.has_mass() {
            let accepted =
                "0 with part mass: a track that recoils is simulated with impacts in no time";
            within("part contact", self.contact, [0.0, 0.0], accepted)?;
        }
        if let Some([sliding, sticking]) = self.friction {
            within("part friction", sliding, [0.0, 10.0], "0..10")?;
            let (range, accepted) = ([sliding, 10.0], "the friction of sliding..10");
            within("part sticking friction", sticking, range, accepted)?;
        }
        for &Disturbance { at, change } in &self.disturbances {
            let accepts = (0.0..=1e8).contains(&at);
            accept("disturbance at", at, accepts, "0..100000000 s")?;
            let (parameter, value, (range, accepted)) = match change {
                Change::Gain(gain) => ("disturbance gain", gain, ([0.0, 10.0], "0..10")),
                Change::Restitution(r) => ("disturbance restitution", r, ([-0.5, 1.0], "-0.5..1")),
                Change::Scatter(s) => ("disturbance scatter", s, ([0.0, 0.5], "0..0.5")),
                Change::Noise(n) => ("disturbance noise", n, ([0.0, 100.0], "0..100 m/s^2")),
                Change::Sensitivity(s) => ("disturbance sensitivity", s, ([0.0, 10.0], "0..10")),
                Change::Ripple(ripple) => ("disturbance ripple", ripple, ([0.0, 0.5], "0..0.5")),
                Change::Dump(time) => ("disturbance dump", time, ([0.0, 1e4], "0..10000 s")),
                Change::Parts(parts) => ("disturbance parts", f32::from(parts), count),
                Change::Hum(hum) => ("disturbance hum", hum, ([0.0, 100.0], "0..100 m/s^2")),
                _ => continue,
            };
            within(parameter, value, range, accepted)?;
        }
        Ok(())
    }
}

/// Ringing after a contact of so many of its periods, over the ringing after an impulse.
///
/// The force is half a sine. Its spectrum gives 0.79 at half a period, 1/3 at one, 0 at 1.5.
fn ringing_share(periods: f32) -> f32 {
    let double = 2.0 * periods;
    let difference = 1.0 - double * double;
    if difference.abs() < 1e-3 {
        return 0.25 * core::f32::consts::PI;
    }
    (libm::cosf(core::f32::consts::PI * periods) / difference).abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::PI;

    /// Amplitude of an undamped oscillator after a force of half a sine, by numerical integration.
    #[test]
    fn ringing_share_is_that_of_half_a_sine() {
        const STEPS: i32 = 20_000;
        for periods in [0.01, 0.25, 0.5, 0.7, 1.0, 1.3, 1.5, 1.9] {
            let mut sums = [0.0; 2];
            for n in 0..STEPS {
                let share = (f64::from(n) + 0.5) / f64::from(STEPS);
                let force = 0.5 * PI * libm::sin(PI * share) / f64::from(STEPS);
                let angle = 2.0 * PI * periods * share;
                sums[0] += force * libm::cos(angle);
                sums[1] += force * libm::sin(angle);
            }
            let expected = libm::hypot(sums[0], sums[1]);
            let actual = f64::from(ringing_share(periods as f32));
            let difference = (actual - expected).abs();
            assert!(difference < 1e-3, "{periods}: {actual} {expected}");
        }
    }

    #[test]
    fn contact_that_no_plant_has_is_refused() {
        let with = |contact: f32, mass: f32| {
            let scene = Scene {
                contact,
                masses: core::iter::once(mass).collect(),
                ..Scene::default()
            };
            scene.check().map_err(|refused| refused.parameter)
        };
        assert_eq!(with(1.4, 0.0), Ok(()));
        assert_eq!(with(1.41, 0.0), Err("contact"));
        assert_eq!(with(0.1, 10.0), Err("part contact"));
        assert_eq!(with(0.0, 10.0), Ok(()));
    }

    fn disturb(scene: &mut Scene, at: f64, change: Change) {
        scene.disturbances = core::iter::once(Disturbance { at, change }).collect();
    }

    /// The range in the text of a refusal is accepted with both ends, and no value beyond.
    #[test]
    fn each_number_accepts_its_range_and_nothing_else() {
        let setters: [fn(&mut Scene, f32); 30] = [
            |it, number| it.drive.resonance = number,
            |it, number| it.drive.quality = number,
            |it, number| it.drive.gain = number,
            |it, number| it.drive.second_gain = number,
            |it, number| it.drive.second_lag = number,
            |it, number| it.drive.third_gain = number,
            |it, number| it.drive.third_lag = number,
            |it, number| it.drive.second_quality = number,
            |it, number| it.drive.mains = number,
            |it, number| it.drive.ripple = number,
            |it, number| it.drive.mass = number,
            |it, number| it.drive.current_gain = number,
            |it, number| it.sensor.hum = number,
            |it, number| it.sensor.noise = number,
            |it, number| it.sensor.sensitivity = number,
            |it, number| it.sensor.ringing = number,
            |it, number| it.sensor.ringing_frequency = number,
            |it, number| it.sensor.ringing_decay = number,
            |it, number| it.parts[0] = number,
            |it, number| it.scatter.extend([number]),
            |it, number| {
                it.drive.mass = 1e5;
                it.masses.extend([number]);
            },
            |it, number| it.friction = Some([number, 10.0]),
            |it, number| disturb(it, 1.0, Change::Gain(number)),
            |it, number| disturb(it, 1.0, Change::Restitution(number)),
            |it, number| disturb(it, 1.0, Change::Scatter(number)),
            |it, number| disturb(it, 1.0, Change::Noise(number)),
            |it, number| disturb(it, 1.0, Change::Sensitivity(number)),
            |it, number| disturb(it, 1.0, Change::Ripple(number)),
            |it, number| disturb(it, 1.0, Change::Dump(number)),
            |it, number| disturb(it, 1.0, Change::Hum(number)),
        ];
        for (n, set) in setters.into_iter().enumerate() {
            let check = |value| {
                let mut scene = Scene::default();
                set(&mut scene, value);
                scene.check()
            };
            let refused = check(f32::NAN).unwrap_err();
            let (parameter, accepted) = (refused.parameter, refused.accepted);
            let of_disturbance = parameter.starts_with("disturbance ");
            assert_eq!(of_disturbance, n >= 22, "{parameter}");
            let range = accepted.split(' ').next().unwrap();
            let (low, high) = range.split_once("..").unwrap();
            let [low, high] = [low, high].map(|end| end.parse::<f32>().unwrap());
            for value in [low, high] {
                assert_eq!(check(value), Ok(()), "{parameter} {value}");
            }
            for value in [low.next_down(), high.next_up(), f32::INFINITY] {
                let refused = check(value).unwrap_err();
                assert_eq!(refused.parameter, parameter, "{value}");
            }
        }
    }

    #[test]
    fn a_disturbance_needs_its_parts_and_a_time() {
        let check = |at: f64, change| {
            let mut scene = Scene::default();
            disturb(&mut scene, at, change);
            scene.check().map_err(|refused| refused.parameter)
        };
        let count = Scene::default().parts.len() as u8;
        assert_eq!(check(1.0, Change::Parts(count)), Ok(()));
        let more = check(1.0, Change::Parts(count + 1));
        assert_eq!(more, Err("disturbance parts"));
        for at in [-1.0, f64::NAN, 1e9] {
            let early = check(at, Change::Enable(true));
            assert_eq!(early, Err("disturbance at"), "{at}");
        }
    }
}
