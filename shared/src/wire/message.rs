//! Messages between board and desk.

use serde::{Deserialize, Serialize};

use super::report::{Identification, Load, Margin, Report, Shape};
use crate::control;

/// Request from the desk to the board.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Request<'a> {
    /// Read the setting with this number, from 0; refused beyond the last.
    Setting(u8),
    /// Read the setting with this key.
    Get(&'a str),
    /// Change a setting; refused outside its range. It applies at once while the drive is off.
    Set {
        /// The setting's key.
        key: &'a str,
        /// Its new value.
        value: f32,
    },
    /// Save settings and target for the next start; refused while the drive runs, and beyond 60
    /// saves an hour.
    Save,
    /// Set all settings to their defaults; refused while the drive runs.
    Defaults,
    /// Set a target; refused outside its range.
    Target(Target),
    /// Withhold the drive over the link, or permit it again; starts and acknowledges nothing else.
    Enable(bool),
    /// Send telemetry with this period in drive cycles; 0 ends it. Refused where the line is too
    /// slow.
    Telemetry(u16),
    /// Read the first record of the event log from this number on.
    Event(u32),
    /// Test the board's own parts; refused while the drive runs.
    SelfTest,
    /// Read the counters of the link since the start.
    Counters,
    /// Read the firmware's last message before its last reset.
    LastWords,
    /// Sign of life of the desk.
    Alive,
    /// Simulate the plant at the desk, with a new controller for this target; refused while the
    /// drive runs.
    ///
    /// The drive remains off until the next reset.
    Simulate {
        /// Target of the controller.
        target: Target,
        /// Cause of the controller's start.
        start: StartCause,
    },
    /// Readings of the simulated converter, for a signal path and a controller like those of the
    /// drive.
    Samples {
        /// Difference of each reading to the previous one as a zigzag varint ([`write_reading`]).
        codes: &'a [u8],
        /// Inputs at the end of a drive cycle, with its last reading.
        end: Option<Inputs>,
    },
    /// Read the progress of the identification ([`Target::Identify`]).
    Identification,
    /// Read the board's target.
    Held,
    /// Read a saved fault: this number of faults before the newest.
    Fault(u8),
    /// Read the board's present inputs and outputs.
    Status,
    /// Save settings and target with this PIN, or without one; refused while the drive runs.
    ///
    /// A PIN makes the link read-only.
    Lock(Option<Pin>),
    /// Permit changes by the desk until the board's next start.
    Unlock(Pin),
}

/// A PIN of 4 to 8 digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pin(u32);

impl Pin {
    /// PIN of these digits; `None` unless they are 4 to 8 digits.
    #[must_use]
    pub fn parse(digits: &str) -> Option<Self> {
        if !(4..=8).contains(&digits.len()) {
            return None;
        }
        // A leading 1 preserves zeros at the front.
        let number = digits.bytes().try_fold(1, |number: u32, digit| {
            (digit.is_ascii_digit()).then(|| 10 * number + u32::from(digit - b'0'))
        });
        number.map(Self)
    }

    /// Stored number: the digits after a leading 1.
    #[must_use]
    pub fn number(self) -> u32 {
        self.0
    }

    /// PIN of a stored number; `None` for any other number.
    #[must_use]
    pub fn numbered(number: u32) -> Option<Self> {
        let power = 10_u32.checked_pow(number.checked_ilog10()?)?;
        let digits = (10_000..=100_000_000).contains(&power) && number / power == 1;
        digits.then_some(Self(number))
    }
}

/// Rights of the desk on the link.
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

/// Inputs of a real or simulated board.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Inputs {
    /// State of the enable input.
    pub enable: bool,
    /// State of the over-temperature input.
    pub over_temperature: bool,
    /// Whether the link received a frame in this cycle.
    pub link_heard: bool,
    /// Whether the stack nearly overflowed.
    pub stack_low: bool,
    /// Whether the over-current input opened the bridge.
    pub over_current: bool,
    /// Whether late control in several cycles switched the drive off.
    pub control_late: bool,
    /// Whether the supply is below what the chip needs.
    pub supply_low: bool,
    /// Whether the crystal's clock failed.
    pub clock_failed: bool,
}

impl From<control::Inputs> for Inputs {
    fn from(inputs: control::Inputs) -> Self {
        Self {
            enable: inputs.enable,
            over_temperature: inputs.over_temperature,
            link_heard: inputs.link_heard,
            stack_low: inputs.stack_low,
            over_current: inputs.over_current,
            control_late: inputs.control_late,
            supply_low: inputs.supply_low,
            clock_failed: inputs.clock_failed,
        }
    }
}

impl From<Inputs> for control::Inputs {
    fn from(inputs: Inputs) -> Self {
        Self {
            enable: inputs.enable,
            over_temperature: inputs.over_temperature,
            link_heard: inputs.link_heard,
            stack_low: inputs.stack_low,
            over_current: inputs.over_current,
            control_late: inputs.control_late,
            supply_low: inputs.supply_low,
            clock_failed: inputs.clock_failed,
            withheld: false,
            held_off: false,
            chatters: false,
        }
    }
}

/// Writes a reading as difference to the previous one, a zigzag varint.
///
/// Returns the number of bytes, 0 where there is no room for three.
pub fn write_reading(room: &mut [u8], before: u16, code: u16) -> usize {
    let difference = i32::from(code) - i32::from(before);
    let mut left = ((difference << 1) ^ (difference >> 31)) as u32;
    let Some(room) = room.get_mut(..3) else {
        return 0;
    };
    let mut used = 0;
    while left >= 0x80 {
        room[used] = left as u8 | 0x80;
        left >>= 7;
        used += 1;
    }
    room[used] = left as u8;
    used + 1
}

/// Removes the next reading after `before` from the front of `codes`; `None` at the end, or for an
/// invalid reading.
pub fn read_reading(codes: &mut &[u8], before: u16) -> Option<u16> {
    let mut left = 0_u32;
    for shift in [0, 7, 14] {
        let (&byte, rest) = codes.split_first()?;
        *codes = rest;
        left |= u32::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            let difference = (left >> 1) as i32 ^ -((left & 1) as i32);
            return u16::try_from(i32::from(before) + difference).ok();
        }
    }
    None
}

/// Adds an output's bits to the hash of a cycle's outputs, which begins at 0 (FNV-1a by words,
/// and a rotation).
#[must_use]
pub fn fold_output(check: u32, output: f32) -> u32 {
    (check ^ output.to_bits())
        .wrapping_mul(0x0100_0193)
        .rotate_left(5)
}

/// Response from the board to the desk.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Response<'a> {
    /// Done.
    Done,
    /// Refused; nothing was changed.
    Refused(Refusal<'a>),
    /// A setting.
    Setting(Setting<'a>),
    /// A record of the event log, or none from that number on.
    Event(Option<Record>),
    /// Result of the test.
    SelfTest(SelfTest),
    /// The counters.
    Counters(Counters),
    /// Last message before the reset, if any.
    LastWords(Option<&'a str>),
    /// One drive cycle; sent without a request while telemetry is on.
    Telemetry(Telemetry),
    /// A drive cycle of the simulation ended.
    Cycle {
        /// Hash of all outputs of the cycle ([`fold_output`]).
        outputs: u32,
        /// Report of the controller.
        report: Report,
    },
    /// Progress of the identification; a result is reported but applied nowhere.
    Identification(Identification),
    /// Target of the board.
    Held(Target),
    /// A saved fault; `None` beyond the oldest.
    Fault(Option<KeptFault>),
    /// Present inputs and outputs.
    Status(Status),
}

/// Inputs and outputs of a board in its last drive cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Inputs; `enable` is the input itself, without the link.
    pub inputs: Inputs,
    /// Whether the desk permits the drive ([`Request::Enable`]).
    pub permitted: bool,
    /// Rights of the desk.
    pub access: Access,
    /// Whether READY is on: the target is reached.
    pub ready: bool,
    /// Mean of the acceleration over the cycle in m/s^2; about 0 where `sensor_zero` is right.
    pub mean: f32,
    /// Time since the start in s.
    pub seconds: u32,
}

/// Reason for a refused request.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Refusal<'a> {
    /// Unknown setting.
    Unknown,
    /// Value outside the range of its parameter.
    OutOfRange {
        /// Name of the parameter.
        parameter: &'a str,
        /// Accepted range in words, with the unit.
        accepted: &'a str,
    },
    /// The drive runs.
    Running,
    /// The memory of the settings failed.
    Store,
    /// No simulation runs, or its readings do not end with the board's cycle.
    OutOfStep,
    /// Too many writes to the memory of the settings within the last hour.
    TooOften,
    /// The link is read-only.
    ReadOnly(Access),
    /// Wrong PIN.
    WrongPin,
    /// Too many wrong PINs: waiting time in s.
    Wait(u16),
    /// Telemetry too fast for the line: shortest possible period in drive cycles.
    Faster(u16),
    /// Supply low now, or within the last 100 ms: nothing was saved.
    SupplyLow,
}

/// A setting with its range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setting<'a> {
    /// Number, from 0.
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

/// Target; [`control::Target`] on the line.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Target {
    /// Lock of this order: drive cycles per impact.
    Locked(u8),
    /// Chaotic.
    Chaotic,
    /// Value of k.
    K(f32),
    /// Normal amplitude b in mm.
    Amplitude(f32),
    /// Conveying speed in mm/s.
    Speed(f32),
    /// Identification of the parts' restitution.
    Identify,
    /// Gear of this order: drive cycles per flight.
    Gear(u8),
    /// Value of k, with upper tones of the track.
    Tones(f32, Shape),
    /// Flow of parts in gear, in g/s.
    Flow(f32),
}

impl From<control::Target> for Target {
    fn from(target: control::Target) -> Self {
        match target {
            control::Target::Locked { order } => Self::Locked(order),
            control::Target::Chaotic => Self::Chaotic,
            control::Target::K(k) => Self::K(k),
            control::Target::Amplitude(amplitude) => Self::Amplitude(amplitude),
            control::Target::Speed(speed) => Self::Speed(speed),
            control::Target::Flow(flow) => Self::Flow(flow),
            control::Target::Identify => Self::Identify,
            control::Target::Gear { order } => Self::Gear(order),
            control::Target::Tones { k, shape } => Self::Tones(k, shape.into()),
        }
    }
}

impl From<Target> for control::Target {
    fn from(target: Target) -> Self {
        match target {
            Target::Locked(order) => Self::Locked { order },
            Target::Chaotic => Self::Chaotic,
            Target::K(k) => Self::K(k),
            Target::Amplitude(amplitude) => Self::Amplitude(amplitude),
            Target::Speed(speed) => Self::Speed(speed),
            Target::Flow(flow) => Self::Flow(flow),
            Target::Identify => Self::Identify,
            Target::Gear(order) => Self::Gear { order },
            Target::Tones(k, shape) => Self::Tones {
                k,
                shape: shape.into(),
            },
        }
    }
}

/// Cause of a controller's start; [`control::StartCause`] on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum StartCause {
    /// Requested by a user: an enable input that is already on counts.
    Ordinary,
    /// Reset by watchdog or brown-out.
    Reset,
    /// The stored settings were refused.
    Refused,
    /// Power-up: off until the enable input has been off.
    PowerOn,
    /// Three resets in a row.
    Repeated,
    /// Damaged program in the flash.
    ImageDamaged,
}

impl From<control::StartCause> for StartCause {
    fn from(start: control::StartCause) -> Self {
        match start {
            control::StartCause::Ordinary => Self::Ordinary,
            control::StartCause::Reset => Self::Reset,
            control::StartCause::Refused => Self::Refused,
            control::StartCause::PowerOn => Self::PowerOn,
            control::StartCause::Repeated => Self::Repeated,
            control::StartCause::ImageDamaged => Self::ImageDamaged,
        }
    }
}

impl From<StartCause> for control::StartCause {
    fn from(start: StartCause) -> Self {
        match start {
            StartCause::Ordinary => Self::Ordinary,
            StartCause::Reset => Self::Reset,
            StartCause::Refused => Self::Refused,
            StartCause::PowerOn => Self::PowerOn,
            StartCause::Repeated => Self::Repeated,
            StartCause::ImageDamaged => Self::ImageDamaged,
        }
    }
}

/// Measurements and decisions of one drive cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Telemetry {
    /// Cycles since the start.
    pub cycle: u32,
    /// Measured k; infinite at rest.
    pub k: f32,
    /// Measured normal amplitude of the track (symbol b) in m.
    pub amplitude: f32,
    /// Setpoint of the amplitude, in m; 0 without one.
    pub setpoint: f32,
    /// Phase lead of the track over the output, in rad.
    pub lead: f32,
    /// Output of the drive as a share of full output.
    pub output: f32,
    /// Measured shape of the track's motion: its upper tones.
    pub shape: Shape,
    /// Second and third tone of the output, sine and cosine of its multiple phase, as shares of
    /// full output.
    pub overtones: [[f32; 2]; control::UPPER],
    /// Mean number of detected impacts per cycle.
    pub rate: f32,
    /// Mean phase of the track at the detected impacts, in rad.
    pub phase: f32,
    /// Confidence that the parts are in the requested lock, 0..1.
    pub confidence: f32,
    /// Estimated share of the parts' time in gear, 0..=1.
    pub in_gear: f32,
    /// Standard error of that share; infinite for a lower bound.
    pub in_gear_error: f32,
    /// Predicted share of time in gear at the setpoint, 0..1; 0 for a target other than gear.
    pub expected_in_gear: f32,
    /// Margin of the parts to the loss of gear; `None` without an estimate.
    pub margin: Option<Margin>,
    /// Estimated load of the track; `None` out of gear, or without a configured mass of the track.
    pub load: Option<Load>,
    /// Number of the state ([`control::State`]).
    pub state: u8,
    /// Number of the fault ([`control::Fault`]), 0 for none.
    pub fault: u8,
    /// Bits of the limits ([`control::Limits`]).
    pub limits: u16,
}

/// Largest size of a frame of telemetry, in bytes.
pub const TELEMETRY_FRAME: usize = 135;

impl From<&control::Report> for Telemetry {
    fn from(report: &control::Report) -> Self {
        Self {
            cycle: report.cycle,
            k: report.k,
            amplitude: report.amplitude,
            setpoint: report.setpoint,
            lead: report.lead,
            output: report.command.amplitude,
            shape: report.shape.into(),
            overtones: (report.command.overtones).map(|tone| [tone.sine, tone.cosine]),
            rate: report.rate,
            phase: report.phase,
            confidence: report.confidence,
            in_gear: report.in_gear,
            in_gear_error: report.in_gear_error,
            expected_in_gear: report.expected_in_gear,
            margin: report.margin.map(Into::into),
            load: report.load.map(Into::into),
            state: report.state.number(),
            fault: report.fault.map_or(0, control::Fault::number),
            limits: report.limits.bits(),
        }
    }
}

/// A record of the event log.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Number of the record; earlier missing numbers were overwritten.
    pub number: u32,
    /// Drive cycle of the event.
    pub cycle: u32,
    /// Number of the event ([`control::Event`]).
    pub event: u8,
    /// Number of the fault at that time, 0 for none.
    pub fault: u8,
    /// Mass of the parts in g; 0 for any event but [`control::Event::Weighed`].
    pub mass: f32,
    /// Flow in g/s; 0 without a configured length of the track.
    pub flow: f32,
}

/// A fault saved over a loss of power.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct KeptFault {
    /// Number among all faults of the board.
    pub number: u32,
    /// Seconds from the board's start to the fault.
    pub seconds: u32,
    /// Number of the fault ([`control::Fault`]).
    pub fault: u8,
    /// Number of the state before the fault ([`control::State`]).
    pub state: u8,
    /// Measured amplitude of the track in m.
    pub amplitude: f32,
    /// Amplitude predicted from the output, in m.
    pub expected: f32,
    /// Output of the drive as a share of full output.
    pub output: f32,
    /// Lowest reading of the converter in the cycle.
    pub low: u16,
    /// Highest reading of the converter in the cycle.
    pub high: u16,
}

/// Condition of the memory of the settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Kept {
    /// The settings and the target in use.
    InUse,
    /// Other settings, or another target, than those in use.
    Others,
    /// Never saved.
    #[default]
    Never,
    /// Damaged settings, or those of another firmware.
    Damaged,
}

/// Set-up of the chip outside its program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetUp {
    /// Supply voltage for reset by brown-out, in mV; 0 where the option bytes disable it.
    pub brown_out: u16,
    /// Whether the option bytes start the watchdog at power-up.
    pub watchdog: bool,
    /// Largest number of core cycles of a sample; 0 without a counter.
    pub sample: u32,
    /// Largest number of core cycles of a drive cycle's control; 0 without a counter.
    pub control: u32,
}

/// Result of the self-test.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SelfTest {
    /// Whether the accelerometer reads zero acceleration, within gravity and noise.
    pub sensor: bool,
    /// Condition of the memory of the settings.
    pub settings: Kept,
    /// Number of stack bytes never used.
    pub stack_free: u32,
    /// Number of drive cycles with late control.
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
    /// Frames shorter than any message, or not COBS, or with a wrong CRC.
    pub corrupt: u32,
    /// Frames of another version or schema.
    pub foreign: u32,
    /// Frames with a correct CRC and an unknown message.
    pub unknown: u32,
    /// Requests beyond the number answered per drive cycle.
    pub flooded: u32,
    /// Telemetry rows dropped because the line's buffer was full.
    pub rows_dropped: u32,
    /// Answers dropped because the line's buffer was full for 100 ms.
    pub answers_dropped: u32,
}

impl Counters {
    /// Number of frames received, read or refused; each counts once.
    #[must_use]
    pub fn frames(&self) -> u64 {
        let Self {
            requests,
            oversized,
            corrupt,
            foreign,
            unknown,
            flooded,
            rows_dropped: _,
            answers_dropped: _,
        } = *self;
        let all = [requests, oversized, corrupt, foreign, unknown, flooded];
        all.into_iter().map(u64::from).sum()
    }
}
