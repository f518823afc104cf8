//! Settings of the controller: track, drive, sensor and parts.

use core::f32::consts::TAU;
use kband::feeder::{OutOfRange, Restitution, Track, TrackSettings, accept};
use kband::impact::ContactTime;

/// One setting: its key, unit, accepted range and default.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// Its name in settings, scenes and refusals.
    pub name: &'static str,
    /// Unit of its value; empty for a pure number.
    pub unit: &'static str,
    /// Smallest accepted value.
    pub low: f32,
    /// Largest accepted value.
    pub high: f32,
    /// Value on first start.
    pub default: f32,
    /// Accepted range in words, with the unit.
    pub accepted: &'static str,
    /// Its description.
    pub meaning: &'static str,
}

macro_rules! settings {
    ($($(#[doc = $doc:literal])+ $name:ident = $default:literal, $low:literal..$high:literal $unit:literal;)+) => {
        /// The controller's settings, in SI units unless the key says otherwise.
        ///
        /// Each setting is a number, so that flash and link store and transfer them by key.
        /// [`Settings::check`] must accept all of them before use.
        ///
        /// ```
        /// use kband_control::Settings;
        /// let mut settings = Settings::default();
        /// settings.set("frequency", 60.0)?;
        /// let refused = settings.set("frequency", 600.0).unwrap_err();
        /// assert_eq!(refused.accepted, "5.0..500.0 Hz");
        /// assert_eq!(settings.get("frequency"), Some(60.0));
        /// assert!((settings.lot()?.middle() - 0.2).abs() < 1e-8);
        /// # Ok::<(), kband::feeder::OutOfRange>(())
        /// ```
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct Settings {
            $($(#[doc = $doc])+ #[doc = concat!("\n\nRange ", $low, "..", $high, " ", $unit, ", default ", $default, ".")] pub $name: f32,)+
        }

        impl Settings {
            /// All keys, in the order of [`Settings::get`] and [`Settings::set`].
            pub const KEYS: &'static [Key] = &[$(Key {
                name: stringify!($name),
                unit: $unit,
                low: $low,
                high: $high,
                default: $default,
                accepted: concat!($low, "..", $high, " ", $unit),
                meaning: concat!($($doc,)+),
            },)+];

            /// The values in the order of [`Settings::KEYS`].
            pub fn values(&self) -> [f32; Self::KEYS.len()] {
                [$(self.$name,)+]
            }

            fn slot(&mut self, name: &str) -> Option<&mut f32> {
                match name {
                    $(stringify!($name) => Some(&mut self.$name),)+
                    _ => None,
                }
            }
        }

        impl Default for Settings {
            fn default() -> Self {
                Self { $($name: $default,)+ }
            }
        }
    };
}

settings! {
    /// Drive frequency.
    frequency = 50.0, 5.0..500.0 "Hz";
    /// Incline of the track (symbol alpha), positive where parts climb.
    incline = 3.0, -60.0..60.0 "degrees";
    /// Amplitude parallel to the track over the amplitude normal to it (symbol eta).
    amplitude_ratio = 1.5, 0.0..100.0 "";
    /// Phase lead of the parallel motion (symbol gamma).
    phase_lead = 0.0, -180.0..180.0 "degrees";
    /// Gravity.
    gravity = 9.80665, 0.1..30.0 "m/s^2";
    /// Low bound of the parts' restitution normal to the track (symbol R).
    restitution_low = 0.18, 0.0..1.0 "";
    /// High bound of the parts' restitution.
    restitution_high = 0.22, 0.0..1.0 "";
    /// Standard deviation of a part's restitution from impact to impact (symbol s), for the gear
    /// target.
    scatter = 0.05, 0.0..0.3 "";
    /// Restitution along the track (symbol Rt), for the speed target.
    tangential_restitution = 0.3, 0.0..0.99 "";
    /// Resonance frequency of the drive.
    resonance = 50.0, 5.0..500.0 "Hz";
    /// Quality factor of the drive's resonance (symbol Q).
    quality = 25.0, 1.0..200.0 "";
    /// Track amplitude at resonance for full output.
    gain = 1.0, 0.001..100.0 "mm";
    /// Largest output (Umax), as a share of full output.
    output_maximum = 0.95, 0.01..1.0 "";
    /// Hard limit of the track's normal amplitude (symbol b).
    amplitude_limit = 1.0, 0.001..100.0 "mm";
    /// Hard limit of the track's normal peak acceleration.
    acceleration_limit = 120.0, 0.1..1000.0 "m/s^2";
    /// Amplitude without a setpoint or link.
    safe_amplitude = 0.05, 0.0..100.0 "mm";
    /// Duration of the soft start from rest to the setpoint.
    soft_start = 0.4, 0.02..60.0 "s";
    /// Duration of the soft stop from the setpoint to rest.
    soft_stop = 0.4, 0.02..60.0 "s";
    /// Time constant of a change of amplitude during a capture kick.
    envelope = 5.0, 1.0..100.0 "cycles";
    /// Error of the track's amplitude that the plan of a kick must bear, as a share of it.
    amplitude_error = 0.02, 0.0..0.2 "";
    /// Kicks tried before the controller reports that the parts are not captured.
    capture_attempts = 8.0, 0.0..50.0 "";
    /// Sensitivity of the accelerometer at the converter's input.
    sensitivity = 0.1, 0.001..10.0 "V/g";
    /// Voltage of the accelerometer at zero acceleration.
    sensor_zero = 1.65, 0.0..5.0 "V";
    /// Reference voltage of the converter.
    converter_reference = 3.3, 1.0..5.0 "V";
    /// Resolution of the converter.
    converter_bits = 12.0, 8.0..12.0 "bits";
    /// Silence of the link after which the drive goes to its safe amplitude; 0: never.
    link_timeout = 2.0, 0.0..3600.0 "s";
    /// Half width of the band in which the drive frequency may follow the resonance; 0: off.
    tracking = 0.0, 0.0..50.0 "Hz";
    /// Largest second tone that the drive affords, its amplitude over that of the first (symbol e);
    /// 0: none.
    second_tone = 0.0, 0.0..0.5 "";
    /// Track amplitude at twice the drive frequency for full output; 0: as the one resonance has
    /// it.
    second_gain = 0.5, 0.0..100.0 "mm";
    /// Lag of the track behind the output at twice the drive frequency.
    second_lag = 90.0, -180.0..180.0 "degrees";
    /// Largest third tone that the drive affords, its amplitude over that of the first (symbol e3);
    /// 0: none. Needs a second tone.
    third_tone = 0.0, 0.0..0.5 "";
    /// Track amplitude at three times the drive frequency for full output; 0: as the one resonance
    /// has it.
    third_gain = 0.25, 0.0..100.0 "mm";
    /// Lag of the track behind the output at three times the drive frequency.
    third_lag = 90.0, -180.0..180.0 "degrees";
    /// Mass that swings with the track (symbol M), 1 + eta^2 times its kilograms, for weighing the
    /// parts and for holding the amplitude under them; 0: unknown.
    track_mass = 0.0, 0.0..100000.0 "kg";
    /// Length of the track on which parts are, for grams per second; 0: unknown.
    track_length = 0.0, 0.0..100000.0 "mm";
    /// Mean voltage of the accelerometer at rest, as measured at commissioning; 0: not measured,
    /// and not tested.
    sensor_rest = 0.0, 0.0..5.0 "V";
    /// Factor by which measured and expected amplitude may differ in the test swing of each start;
    /// 2.5: none is made.
    gain_tolerance = 2.5, 1.1..2.5 "";
    /// Factor by which they may differ while the drive runs, also under the heaviest load.
    load_tolerance = 2.5, 1.1..2.5 "";
    /// Sensitivity of the current sensor at the converter's input; 0: none is wired.
    current_sensitivity = 0.0, 0.0..10.0 "V/A";
    /// Track amplitude at resonance per ampere of current; 0: not measured, and not tested.
    current_gain = 0.0, 0.0..100.0 "mm/A";
    /// Authority of the fieldbus: 0 reads only; 1 also runs the drive and sets target and settings;
    /// 2 also acknowledges faults. Above 0 the bus is in control, and the link reads only.
    bus = 0.0, 0.0..2.0 "";
    /// Address of the board on the fieldbus (Modbus RTU); 0: off.
    bus_address = 0.0, 0.0..247.0 "";
    /// Rate of the fieldbus.
    bus_baud = 19200.0, 9600.0..115200.0 "baud";
    /// Parity of the fieldbus: 0 none, with two stop bits; 1 odd; 2 even.
    bus_parity = 2.0, 0.0..2.0 "";
    /// Silence of the fieldbus in control after which the drive goes to its safe amplitude; 0:
    /// never.
    bus_timeout = 2.0, 0.0..3600.0 "s";
    /// Duration of an impact, from touching the track until the part is back where it touched it;
    /// 0: none.
    contact = 0.0, 0.0..14.0 "ms";
    /// Length of a part along the track, for parts a minute; 0: not configured.
    part_length = 0.0, 0.0..10000.0 "mm";
}

/// Share of the hard limits that the reference uses on a track with heavy parts. Impacts that are
/// not heard raise its amplitude unmeasured: by 8 % at 5 % of its mass, with a weak sensor.
const REFERENCE_SHARE_UNDER_LOAD: f32 = 0.95;
/// The same with upper tones, which parts that leave gear raise too, by 23 % of the acceleration.
const REFERENCE_SHARE_ON_TONES: f32 = 0.9;

impl Settings {
    /// The configured lot of parts.
    pub fn lot(&self) -> Result<Restitution, OutOfRange> {
        let [low, high] = [self.restitution_low, self.restitution_high].map(f64::from);
        Restitution::interval(low, high)
    }

    /// The configured duration of an impact; none if it is out of range.
    #[inline(never)]
    pub fn contact_time(&self) -> ContactTime {
        ContactTime::from_milliseconds(f64::from(self.contact), f64::from(self.frequency))
            .unwrap_or_default()
    }

    /// The configured track.
    pub fn track(&self) -> Result<Track, OutOfRange> {
        Track::build(TrackSettings {
            frequency: f64::from(self.frequency),
            incline: f64::from(self.incline),
            amplitude_ratio: f64::from(self.amplitude_ratio),
            phase_lead: f64::from(self.phase_lead),
            gravity: f64::from(self.gravity),
        })
    }

    /// Largest safe amplitude in mm that both hard limits allow at the highest drive frequency.
    pub fn largest_safe_amplitude(&self) -> f32 {
        let highest = TAU * (self.frequency + self.tracking);
        let by_acceleration = 1e3 * self.acceleration_limit / (highest * highest);
        self.amplitude_limit.min(by_acceleration)
    }

    /// Share of the hard limits that the reference uses, 0..1.
    pub(crate) fn reference_share(&self) -> f32 {
        match self.upper_tones() {
            _ if self.track_mass <= 0.0 => 1.0,
            0 => REFERENCE_SHARE_UNDER_LOAD,
            _ => REFERENCE_SHARE_ON_TONES,
        }
    }

    /// Largest amplitude in mm and acceleration in m/s^2 of the reference, within the hard limits.
    pub(crate) fn reference_limits(&self) -> [f32; 2] {
        let share = self.reference_share();
        [self.amplitude_limit, self.acceleration_limit].map(|limit| share * limit)
    }

    /// Tones above the first that the settings allow: 0, 1 or 2.
    pub fn upper_tones(&self) -> usize {
        let tones = [self.second_tone, self.third_tone];
        tones.iter().take_while(|tone| **tone > 0.0).count()
    }

    /// Whether the fieldbus is in control, and not the link: `bus` and `bus_address` are above 0.
    pub fn bus_controls(&self) -> bool {
        self.bus >= 1.0 && self.bus_address >= 1.0
    }

    /// The value of a key; `None` for an unknown one.
    pub fn get(&self, name: &str) -> Option<f32> {
        let mut copy = *self;
        copy.slot(name).copied()
    }

    /// Sets a key. Errors: an unknown key, or a value outside its range; nothing changes then.
    pub fn set(&mut self, name: &str, value: f32) -> Result<(), OutOfRange> {
        let Some(key) = Self::KEYS.iter().find(|key| key.name == name) else {
            return Err(OutOfRange {
                parameter: "settings key",
                value: f64::from(value),
                accepted: "the known keys only",
            });
        };
        key.accept(value)?;
        if let Some(slot) = self.slot(name) {
            *slot = value;
        }
        Ok(())
    }

    /// The error names the first parameter out of range, alone or against a related one.
    pub fn check(&self) -> Result<(), OutOfRange> {
        for (key, value) in Self::KEYS.iter().zip(self.values()) {
            key.accept(value)?;
        }
        let value = |parameter| self.get(parameter).unwrap_or_default();
        let require = |parameter, accepts, accepted| {
            accept(parameter, f64::from(value(parameter)), accepts, accepted).map(|_| ())
        };
        let accepts = self.restitution_low <= self.restitution_high;
        let accepted = "restitution_low..1: the interval is reversed";
        require("restitution_high", accepts, accepted)?;
        let accepts = self.safe_amplitude <= self.largest_safe_amplitude();
        let accepted =
            "0..what amplitude_limit and acceleration_limit allow at frequency + tracking";
        require("safe_amplitude", accepts, accepted)?;
        let highest = self.frequency + self.tracking;
        // 7 % of a cycle in ms, times the highest frequency.
        let accepted = "0..7 % of a drive cycle at frequency + tracking, in ms";
        require("contact", self.contact * highest <= 70.0, accepted)?;
        let lowest = (self.frequency - self.tracking).max(5.0);
        let accepts = (highest - lowest) * self.quality <= 200.0 * lowest;
        let accepted =
            "0 to a band of 200 widths of the resonance, the lowest frequency over quality";
        require("tracking", accepts, accepted)?;
        let accepts = self.third_tone == 0.0 || self.second_tone > 0.0;
        let accepted = "0 without a second tone: set second_tone first";
        require("third_tone", accepts, accepted)?;
        let (zero, rest) = (self.sensor_zero, self.sensor_rest);
        let accepted = "below converter_reference";
        require("sensor_zero", zero < self.converter_reference, accepted)?;
        require("sensor_rest", rest < self.converter_reference, accepted)?;
        let accepts = self.current_gain == 0.0 || self.current_sensitivity > 0.0;
        let accepted = "0 without a current sensor: set current_sensitivity first";
        require("current_gain", accepts, accepted)?;
        for parameter in ["bus", "bus_address", "bus_baud", "bus_parity"] {
            let accepts = value(parameter) == libm::truncf(value(parameter));
            require(parameter, accepts, "a whole number")?;
        }
        Ok(())
    }
}

impl Key {
    fn accept(&self, value: f32) -> Result<(), OutOfRange> {
        let accepts = (self.low..=self.high).contains(&value);
        accept(self.name, f64::from(value), accepts, self.accepted).map(|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_refuses_what_is_outside_and_keeps_its_value() {
        for key in Settings::KEYS {
            let mut settings = Settings::default();
            let beyond = [key.low - 1.0, key.high * 1.01 + 1.0];
            for bad in beyond.into_iter().chain([f32::NAN, f32::INFINITY]) {
                assert_eq!(settings.set(key.name, bad).unwrap_err().parameter, key.name);
            }
            assert_eq!(settings, Settings::default());
            assert_eq!(settings.check(), Ok(()));
            settings.set(key.name, key.high).unwrap();
            assert_eq!(settings.get(key.name), Some(key.high));
        }
        assert!(Settings::default().set("colour", 1.0).is_err());
    }

    #[test]
    fn incompatible_settings_are_named() {
        // The first key is refused until the last value is set.
        for case in [
            "restitution_high 0.22, restitution_low 0.3, restitution_low 0.22",
            // 7 % of a cycle of 60 Hz are 1.167 ms.
            "contact 1.2, tracking 10, tracking 5",
            "safe_amplitude 0.21, amplitude_limit 0.2, safe_amplitude 0.2",
            // 1 mm at 50 Hz is 98.7 m/s^2.
            "safe_amplitude 1, acceleration_limit 98, acceleration_limit 99",
            "tracking 50, quality 200, tracking 10",
            "third_tone 0.1, second_tone 0.1",
            "sensor_zero 3.3, converter_reference 3.3, sensor_zero 3.29",
            "sensor_rest 3.3, converter_reference 3.3, sensor_rest 3.29",
            "current_gain 0.5, current_sensitivity 0.1",
            "bus 0.5, bus 1",
            "bus_address 1.5, bus_address 17",
            "bus_baud 19200.5, bus_baud 38400",
            "bus_parity 1.5, bus_parity 1",
        ] {
            let pairs = case.split(", ").map(|pair| pair.split_once(' ').unwrap());
            let values = pairs.map(|(key, value)| (key, value.parse().unwrap()));
            let values: std::vec::Vec<(&str, f32)> = values.collect();
            let mut settings = Settings::default();
            let (last, first) = values.split_last().unwrap();
            for (key, value) in first {
                settings.set(key, *value).unwrap();
            }
            assert_eq!(settings.check().unwrap_err().parameter, values[0].0);
            settings.set(last.0, last.1).unwrap();
            assert_eq!(settings.check(), Ok(()), "{last:?}");
        }
    }
}
