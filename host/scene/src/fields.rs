//! Numbers and flags of a scene besides the controller's settings: one table for parser and schema.

use kband_plant::{Change, Scene};

/// A number of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Field {
    /// Key in the scene.
    pub key: &'static str,
    /// Smallest and largest accepted value.
    pub range: [f32; 2],
    /// Unit; empty for a pure number.
    pub unit: &'static str,
    /// Meaning.
    pub meaning: &'static str,
}

const fn field(
    key: &'static str,
    range: [f32; 2],
    unit: &'static str,
    meaning: &'static str,
) -> Field {
    Field {
        key,
        range,
        unit,
        meaning,
    }
}

impl Field {
    /// The accepted range in words.
    pub fn accepted(&self) -> String {
        let [low, high] = self.range;
        format!("{low}..{high} {}", self.unit).trim_end().into()
    }
}

/// A number of a scene's plant, and its key in the scene.
pub type Model = (Field, fn(&mut Scene) -> &mut f32);

macro_rules! models {
    ($(#[$doc:meta])* $table:ident
     $($key:literal $low:literal..$high:literal $unit:literal $meaning:literal $part:ident.$item:ident;)*) => {
        $(#[$doc])*
        pub const $table: &[Model] = &[
            $((field($key, [$low, $high], $unit, $meaning), |scene| &mut scene.$part.$item)),*
        ];
    };
}

models! {
    /// Keys of `[sensor]`: true properties of the accelerometer, besides its settings.
    SENSOR

    "noise" 0.0..100.0 "m/s^2" "RMS of the accelerometer's noise." sensor.noise;
    "ringing" 0.0..1e5 "1/s" "Ringing in m/s^2 for an impact of 1 m/s." sensor.ringing;
    "ringing_frequency" 500.0..9000.0 "Hz" "Frequency of the ringing." sensor.ringing_frequency;
    "ringing_decay" 0.05..50.0 "ms" "Decay time of the ringing." sensor.ringing_decay;
    "hum" 0.0..100.0 "m/s^2" "Amplitude of the mains hum in the accelerometer signal." sensor.hum;
}

models! {
    /// Keys of `[plant]`: true properties of drive and accelerometer.
    PLANT

    "resonance" 5.0..500.0 "Hz" "Resonance frequency of the drive as it is." drive.resonance;
    "quality" 1.0..200.0 "" "Quality factor of the resonance as it is (Q)." drive.quality;
    "gain" 0.001..100.0 "mm" "Track amplitude at resonance for full output, as it is." drive.gain;
    "sensitivity" 0.1..10.0 "" "Sensitivity of the accelerometer over the configured one." sensor.sensitivity;
    "second_gain" 0.0..100.0 "mm" "Track amplitude at twice the drive frequency for full output, as it is; 0: as the one resonance has it." drive.second_gain;
    "second_lag" -180.0..180.0 "degrees" "Lag of the track behind the output at twice the drive frequency, as it is." drive.second_lag;
    "third_gain" 0.0..100.0 "mm" "The same at three times the drive frequency." drive.third_gain;
    "third_lag" -180.0..180.0 "degrees" "Lag of the track behind the output there, as it is." drive.third_lag;
    "second_quality" 0.5..200.0 "" "Quality factor of the drive's modes near two and three times its frequency." drive.second_quality;
    "mains" 10.0..400.0 "Hz" "Frequency of the mains." drive.mains;
    "ripple" 0.0..0.5 "" "Ripple of the drive's bus at twice the mains' frequency, over its mean." drive.ripple;
    "mass" 0.001..1e5 "kg" "Mass that swings with the track, as it is (M)." drive.mass;
    "current_gain" 0.001..100.0 "mm/A" "Track amplitude at resonance per ampere of the current's amplitude, as it is." drive.current_gain;
}

/// Mass of a part, in `[part]`.
pub const MASS: Field = field(
    "mass",
    [0.0, 1e6],
    "g",
    "Mass of a part (m); 0: it pushes nothing.",
);

/// Range of the mean restitution of a part in the plant; below 0 most impacts do not bounce.
pub const ACTUAL_RESTITUTION: [f32; 2] = [-0.5, 1.0];

/// Scatter of restitution, in `[part]` and in a disturbance.
pub const SCATTER: Field = field(
    "scatter",
    [0.0, 0.5],
    "",
    "Standard deviation of a part's restitution from impact to impact (s); bodies that tumble have 0.27 to 0.52.",
);

/// A number that a disturbance may set, and the resulting change.
pub type Number = (Field, fn(f32) -> Change);

macro_rules! changes {
    ($($field:expr => $change:ident;)*) => {
        /// All numbers that a disturbance may set.
        pub const CHANGES: &[Number] = &[$(($field, Change::$change)),*];
    };
}

changes! {
    field("gain", [0.0, 10.0], "", "Gain of the drive over the one at the start.") => Gain;
    field("restitution", ACTUAL_RESTITUTION, "", "Mean restitution of all parts (R), before clipping at 0.") => Restitution;
    SCATTER => Scatter;
    field("noise", [0.0, 100.0], "m/s^2", "RMS of the accelerometer's noise.") => Noise;
    field("sensitivity", [0.0, 10.0], "", "Sensitivity of the accelerometer over the configured one.") => Sensitivity;
    field("ripple", [0.0, 0.5], "", "Ripple of the drive's bus at twice the mains' frequency, over its mean.") => Ripple;
    field("hum", [0.0, 100.0], "m/s^2", "Amplitude of the mains hum in the accelerometer signal.") => Hum;
    field("dump", [0.0, 1e4], "s", "The parts that wait in the hopper fall onto the track, evenly within so many seconds.") => Dump;
}

/// A flag that a disturbance may set: key, meaning, resulting change.
pub type Flag = (&'static str, &'static str, fn(bool) -> Change);

macro_rules! flags {
    ($($key:literal $meaning:literal $change:ident;)*) => {
        /// All flags that a disturbance may set.
        pub const FLAGS: &[Flag] = &[$(($key, $meaning, Change::$change)),*];
    };
}

flags! {
    "enable" "The enable input." Enable;
    "sensor_lost" "Whether the accelerometer's reading stands still." SensorLost;
    "sensor_inverted" "Whether the accelerometer's sign is turned." SensorInverted;
    "over_temperature" "The over-temperature input." OverTemperature;
    "stack_low" "The stack warning." StackLow;
    "over_current" "The over-current input." OverCurrent;
    "supply_low" "The supply monitor of the board." SupplyLow;
    "clock_failed" "Whether the crystal has failed and the board runs on its own oscillator." ClockFailed;
    "control_late" "Whether the board switched the drive off because its control came too late." ControlLate;
    "link" "Whether the link brings frames." Link;
    "brown_out" "Whether the board's supply sags: it starts anew, its drive off until enabled anew." BrownOut;
}

/// Tables of a scene file with settings: name, keys, and how many of the first keys are required.
const SETTINGS: [(&str, &str, usize); 4] = [
    (
        "track",
        "frequency incline amplitude_ratio phase_lead gravity track_length",
        3,
    ),
    (
        "drive",
        "resonance quality gain output_maximum amplitude_limit acceleration_limit safe_amplitude \
         second_tone second_gain second_lag third_tone third_gain third_lag track_mass \
         gain_tolerance load_tolerance current_sensitivity current_gain",
        3,
    ),
    (
        "sensor",
        "sensitivity sensor_zero sensor_rest converter_reference converter_bits",
        0,
    ),
    (
        "controller",
        "soft_start soft_stop envelope amplitude_error capture_attempts link_timeout tracking \
         scatter contact",
        0,
    ),
];

/// Settings in a table, each with whether it is required.
pub fn settings(table: &str) -> impl Iterator<Item = (&'static str, bool)> {
    let own = SETTINGS
        .into_iter()
        .filter(move |(name, ..)| *name == table);
    own.flat_map(|(_, keys, required)| {
        let keys = keys.split(' ').enumerate();
        keys.map(move |(n, key)| (key, n < required))
    })
}

pub(crate) fn section_with(key: &str) -> Option<&'static str> {
    let mut tables = SETTINGS.into_iter();
    let table = tables.find(|(_, keys, _)| keys.split(' ').any(|own| own == key));
    table.map(|(name, ..)| name)
}
