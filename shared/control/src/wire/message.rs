//! Messages between board and desk.

use crate::{
    Fault, GearMargin, Identification, Inputs, Load, Recipe, RecipeName, Report, Shape, StartCause,
    Target, UPPER,
};
use serde::{Deserialize, Serialize};

/// Request from the desk to the board.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Request<'a> {
    /// Reads the setting of this index, from 0; an error past the last one.
    Setting(u8),
    /// Reads the setting with this key.
    Get(&'a str),
    /// Changes a setting; an error outside its range. With the drive off it takes effect at once.
    Set {
        /// The setting's key.
        key: &'a str,
        /// New value.
        value: f32,
    },
    /// Saves settings and target durably; an error while the drive runs, or beyond 60 an hour.
    Save,
    /// Resets all settings to their defaults; an error while the drive runs.
    Defaults,
    /// Sets a new target; an error outside its range.
    Target(Target),
    /// Stops the drive, or removes the link's stop; it starts and acknowledges nothing else.
    Enable(bool),
    /// Sends telemetry every so many drive cycles; 0 ends it. An error beyond the line's capacity.
    Telemetry(u16),
    /// Reads the first record of the event log from this number on.
    Event(u32),
    /// Runs the self-test; an error while the drive runs.
    SelfTest,
    /// Reads the link's counters since the start.
    Counters,
    /// Reads the firmware's last message before its last reset.
    LastWords,
    /// Keeps the link alive, without effect.
    Alive,
    /// Begins a simulation of the plant by the desk, with a new controller for this target. An
    /// error while the drive runs. The drive stays off until the next reset.
    Simulate {
        /// Requested target.
        target: Target,
        /// Cause of the controller's start.
        start: StartCause,
    },
    /// Readings of the simulated converter, for the board's signal path and controller.
    Samples {
        /// Difference of each reading to the one before, as a zigzag varint ([`write_reading`]).
        codes: &'a [u8],
        /// Inputs at the end of a drive cycle, with its last reading.
        end: Option<Inputs>,
    },
    /// Reads the progress of the identification of the parts' restitution ([`Target::Identify`]).
    Identification,
    /// Reads the board's target.
    Held,
    /// Reads a fault from non-volatile memory; the number counts back from the newest fault.
    Fault(u8),
    /// Reads the board's present inputs and outputs.
    Status,
    /// Saves settings and target with this PIN, or without one. With a PIN the link becomes
    /// read-only. An error while the drive runs.
    Lock(Option<Pin>),
    /// Gives the desk write access until the board's next start.
    Unlock(Pin),
    /// Reads a recipe, numbered from 1.
    Recipe(u8),
    /// Changes a recipe, or deletes it, until the board's next reset; an error if it does not
    /// fit the machine, or while the drive runs.
    SetRecipe {
        /// Number of the recipe, from 1.
        number: u8,
        /// Its name and content; `None` deletes it.
        recipe: Option<(RecipeName, Recipe)>,
    },
    /// Saves all recipes, with the last saved settings and target. An error as for
    /// [`Request::Save`], and if no settings were saved.
    SaveRecipes,
    /// Uses a recipe, also while the drive runs; 0: the saved target and its parts.
    UseRecipe(u8),
    /// A Modbus request: unit, function and data. Without full access it only reads.
    Bus(&'a [u8]),
}

impl<'a> Request<'a> {
    /// A change of the setting with this key.
    pub const fn set(key: &'a str, value: f32) -> Self {
        Self::Set { key, value }
    }
}

/// A PIN of 4 to 8 digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pin(u32);

impl Pin {
    /// The PIN with these digits; `None` unless 4 to 8 digits.
    pub fn parse(digits: &str) -> Option<Self> {
        if !(4..=8).contains(&digits.len()) {
            return None;
        }
        // A leading 1 preserves leading zeros.
        let number = digits.bytes().try_fold(1, |number: u32, digit| {
            (digit.is_ascii_digit()).then(|| 10 * number + u32::from(digit - b'0'))
        });
        number.map(Self)
    }

    /// Stored number: the digits after a leading 1.
    pub fn number(self) -> u32 {
        self.0
    }

    /// The PIN with this stored number; `None` if invalid.
    pub fn from_number(number: u32) -> Option<Self> {
        let power = 10_u32.checked_pow(number.checked_ilog10()?)?;
        let digits = (10_000..=100_000_000).contains(&power) && number / power == 1;
        digits.then_some(Self(number))
    }
}

/// Access of the desk over the link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Access {
    /// Read, set, save and simulate.
    #[default]
    Full,
    /// Read, and stop the drive: the board's strap is wired to ground.
    Strapped,
    /// Read, and stop the drive, until the PIN is entered.
    Locked,
}

/// Writes the difference of a reading to the one before; number of bytes, 0 without room.
pub fn write_reading(buffer: &mut [u8], before: u16, code: u16) -> usize {
    let difference = i32::from(code) - i32::from(before);
    postcard::to_slice(&difference, buffer).map_or(0, |bytes| bytes.len())
}

/// Reads the next reading after `before` from the front of `codes`; `None` at the end or invalid.
pub fn read_reading(codes: &mut &[u8], before: u16) -> Option<u16> {
    let (difference, rest) = postcard::take_from_bytes::<i32>(codes).ok()?;
    *codes = rest;
    u16::try_from(i32::from(before).checked_add(difference)?).ok()
}

/// Updates the check of a cycle's outputs with the bits of an output; 0 at the start of a cycle.
pub fn update_output_check(check: u32, output: f32) -> u32 {
    ((check ^ output.to_bits()).wrapping_mul(0x0100_0193)).rotate_left(5)
}

/// Response from the board to the desk.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Response<'a> {
    /// The request was carried out.
    Done,
    /// The request was rejected without effect.
    Refused(Refusal<'a>),
    /// A setting.
    Setting(Setting<'a>),
    /// A record of the event log; `None` if there is none from that number on.
    Event(Option<Record>),
    /// Result of the self-test.
    SelfTest(SelfTest),
    /// The counters.
    Counters(Counters),
    /// Last message before the reset; `None` without one.
    LastWords(Option<&'a str>),
    /// One drive cycle; sent without a request while telemetry is on.
    Telemetry(Telemetry),
    /// End of a drive cycle of the simulation.
    Cycle {
        /// Check of all outputs of the cycle ([`update_output_check`]).
        outputs: u32,
        /// The controller's report.
        report: Report,
    },
    /// Progress of the identification; a result is reported only, never applied.
    Identification(Identification),
    /// The board's target.
    Held(Target),
    /// A stored fault; `None` if there is none of that age.
    Fault(Option<FaultRecord>),
    /// The board's present inputs and outputs.
    Status(Status),
    /// A recipe.
    Recipe(Stored),
    /// Answer of Modbus: unit, function and data; empty if there is none.
    Bus(&'a [u8]),
}

/// A stored recipe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Stored {
    /// There is no recipe of this number.
    #[default]
    None,
    /// Its name and content.
    Recipe(RecipeName, Recipe),
    /// A newer firmware saved it; this one keeps it but cannot use it.
    Newer,
}

/// Inputs and outputs of a board in its last drive cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Inputs; enable is the state of the input itself.
    pub inputs: Inputs,
    /// Whether the desk permits the drive ([`Request::Enable`]).
    pub permitted: bool,
    /// Access of the desk.
    pub access: Access,
    /// Whether READY is on: the target is reached.
    pub ready: bool,
    /// Mean acceleration over the cycle in m/s^2; about 0 if `sensor_zero` is right.
    pub mean: f32,
    /// Amplitude of the drive's current in A; 0 without a current sensor.
    pub current: f32,
    /// Time since the start in s.
    pub seconds: u32,
    /// Number of the recipe in use; 0 for none.
    pub recipe: u8,
}

/// Reason for a rejected request.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Refusal<'a> {
    /// No such setting.
    Unknown,
    /// A value outside its parameter's range.
    OutOfRange {
        /// Name of the parameter.
        parameter: &'a str,
        /// Accepted range, in words, with the unit.
        accepted: &'a str,
    },
    /// Rejected while the drive runs.
    Running,
    /// The non-volatile memory failed.
    Store,
    /// No simulation is active, or its readings end at a different sample than the board's cycle.
    OutOfStep,
    /// Too many writes of the non-volatile memory in the last hour.
    TooOften,
    /// The link is read-only.
    ReadOnly(Access),
    /// The PIN is wrong.
    WrongPin,
    /// Too many wrong PINs; the next attempt is possible after this number of seconds.
    Wait(u16),
    /// Telemetry exceeds the line's capacity; the smallest number of drive cycles per row.
    Faster(u16),
    /// The supply is low, or was within the last 100 ms; nothing was saved.
    SupplyLow,
    /// There is no recipe of this number, or a newer firmware saved it.
    NoRecipe,
    /// No settings were saved yet, or they are damaged; recipes are saved together with them.
    NoSettings,
    /// The fieldbus is in control; the setting `bus` ends that.
    NotInControl,
}

/// A setting with its range and unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setting<'a> {
    /// Index, from 0.
    pub number: u8,
    /// Key.
    pub key: &'a str,
    /// Unit.
    pub unit: &'a str,
    /// Value.
    pub value: f32,
    /// Smallest accepted value.
    pub low: f32,
    /// Largest accepted value.
    pub high: f32,
    /// Value on first start.
    pub default: f32,
}

/// One drive cycle in the controller's quantities.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Telemetry {
    /// Cycles since the start.
    pub cycle: u32,
    /// Measured k; infinite at rest.
    pub k: f32,
    /// Measured normal amplitude of the track (symbol b) in m.
    pub amplitude: f32,
    /// Amplitude setpoint of the target in m; 0 without one.
    pub setpoint: f32,
    /// Phase lead of the track over the output, in rad.
    pub lead: f32,
    /// Output of the drive over full output.
    pub output: f32,
    /// Measured upper tones of the track.
    pub shape: Shape,
    /// Upper tones of the output along sine and cosine of the multiplied phase, over full output.
    pub overtones: [[f32; 2]; UPPER],
    /// Detected impacts per cycle.
    pub rate: f32,
    /// Mean phase of the track at the detected impacts, in rad.
    pub phase: f32,
    /// Confidence that the parts are in the requested lock, 0..1.
    pub confidence: f32,
    /// Estimated share of the parts' time in gear, 0..=1.
    pub in_gear: f32,
    /// Standard error of that share; infinite if it is a lower bound.
    pub in_gear_error: f32,
    /// Predicted share of time in gear at the setpoint, 0..1; 0 for a target other than gear.
    pub expected_in_gear: f32,
    /// Gear band or chaotic band, lowest and highest k; `None` for another target.
    pub target_band: Option<[f32; 2]>,
    /// Stability margin of gear; `None` without an estimate.
    pub margin: Option<GearMargin>,
    /// Estimated load of the track; `None` out of gear or without a configured mass of the track.
    pub load: Option<Load>,
    /// Number of the state ([`crate::State`]).
    pub state: u8,
    /// Number of the fault ([`Fault`]), 0 for none.
    pub fault: u8,
    /// Bits of the limits ([`crate::Limits`]).
    pub limits: u16,
}

/// Largest size of a telemetry frame in bytes.
pub const TELEMETRY_FRAME: usize = 144;

impl From<&Report> for Telemetry {
    fn from(report: &Report) -> Self {
        Self {
            cycle: report.cycle,
            k: report.k,
            amplitude: report.amplitude,
            setpoint: report.setpoint,
            lead: report.lead,
            output: report.command.amplitude,
            shape: report.shape,
            overtones: report.command.overtones,
            rate: report.rate,
            phase: report.phase,
            confidence: report.confidence,
            in_gear: report.in_gear,
            in_gear_error: report.in_gear_error,
            expected_in_gear: report.expected_in_gear,
            target_band: report.target_band,
            margin: report.margin,
            load: report.load,
            state: report.state.number(),
            fault: report.fault.map_or(0, Fault::number),
            limits: report.limits.bits(),
        }
    }
}

/// A record of the event log.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Number; missing numbers before it were overwritten.
    pub number: u32,
    /// Drive cycle of the event.
    pub cycle: u32,
    /// Number of the event ([`crate::Event`]).
    pub event: u8,
    /// Number of the fault at that time, 0 for none.
    pub fault: u8,
    /// Mass of the parts in g for [`crate::Event::Weighed`], else 0.
    pub mass: f32,
    /// Flow of the parts in g/s for the same event; 0 without a configured length of the track.
    pub flow: f32,
}

/// A fault stored in non-volatile memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FaultRecord {
    /// Number among all faults of the board.
    pub number: u32,
    /// Seconds from the board's start to the fault.
    pub seconds: u32,
    /// Number of the fault ([`Fault`]).
    pub fault: u8,
    /// Number of the state before the fault ([`crate::State`]).
    pub state: u8,
    /// Measured amplitude of the track in m.
    pub amplitude: f32,
    /// Amplitude predicted from the output, in m.
    pub expected: f32,
    /// Output of the drive over full output.
    pub output: f32,
    /// Lowest reading of the converter in the cycle.
    pub low: u16,
    /// Highest reading of the converter in the cycle.
    pub high: u16,
}

/// Content of the non-volatile memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum SavedSettings {
    /// The present settings and target.
    InUse,
    /// Other settings or another target.
    Different,
    /// Nothing was ever saved.
    #[default]
    Never,
    /// Damaged content, or content of another firmware.
    Damaged,
}

/// Set-up of the chip outside the program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetUp {
    /// Brown-out reset threshold in mV; 0 if it is off in the option bytes.
    pub brown_out: u16,
    /// Whether the option bytes start the watchdog at power-on.
    pub watchdog: bool,
    /// Largest number of core cycles of a sample; 0 if not counted.
    pub sample: u32,
    /// Largest number of core cycles of the control of a drive cycle; 0 if not counted.
    pub control: u32,
}

/// Result of the self-test.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SelfTest {
    /// Whether the accelerometer's reading agrees with its zero, within gravity and noise.
    pub sensor: bool,
    /// Content of the non-volatile memory.
    pub settings: SavedSettings,
    /// Number of stack bytes never used.
    pub stack_free: u32,
    /// Number of drive cycles with a missed control deadline.
    pub missed: u32,
    /// Set-up of the chip.
    pub set_up: SetUp,
}

/// Counters of the link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counters {
    /// Requests read.
    pub requests: u32,
    /// Frames longer than any message.
    pub oversized: u32,
    /// Frames shorter than any message, not COBS, or with a wrong CRC.
    pub corrupt: u32,
    /// Frames with another version or schema.
    pub foreign: u32,
    /// Valid frames with an unknown message.
    pub unknown: u32,
    /// Requests beyond the number answered per drive cycle.
    pub flooded: u32,
    /// Telemetry rows dropped because the line's buffer was full.
    pub rows_dropped: u32,
    /// Responses dropped because they did not fit within 100 ms.
    pub answers_dropped: u32,
}

impl Counters {
    /// Number of received frames, each counted once.
    pub fn frames(&self) -> u64 {
        let valid = [self.requests, self.unknown, self.flooded];
        let invalid = [self.oversized, self.corrupt, self.foreign];
        valid.into_iter().chain(invalid).map(u64::from).sum()
    }
}
