//! What board and desk say to each other.

use serde::{Deserialize, Serialize};

use super::report::{Identification, Load, Margin, Report, Shape};
use crate::control;

/// What the desk asks of the board.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Request<'a> {
    /// The setting of this number, from 0; refused past the last one.
    Setting(u8),
    /// The setting of this key.
    Get(&'a str),
    /// A new value for a setting; refused outside its range. It counts at once where the drive is off.
    Set {
        /// The setting's key.
        key: &'a str,
        /// Its new value.
        value: f32,
    },
    /// Keeps the settings and the target beyond a loss of power; refused while the drive runs, and more than 60
    /// times an hour.
    Save,
    /// Takes the defaults for all settings; refused while the drive runs.
    Defaults,
    /// A new target; refused outside its range.
    Target(Target),
    /// Withholds the drive, or gives back what the link withheld; it starts nothing else and
    /// acknowledges nothing.
    Enable(bool),
    /// Telemetry every so many drive cycles from now on; 0 ends it. Refused where the line cannot
    /// carry so much.
    Telemetry(u16),
    /// The first record of the event log from this number on.
    Event(u32),
    /// A test of the board's own parts; refused while the drive runs.
    SelfTest,
    /// What was counted on the link since the start.
    Counters,
    /// What the firmware said last before its last reset.
    LastWords,
    /// Nothing, but the desk is there.
    Alive,
    /// From now on the desk simulates the plant, with a controller started anew for this target; refused
    /// while the drive runs. The drive stays off until the next reset.
    Simulate {
        /// What is wanted of the parts.
        target: Target,
        /// Why the controller starts.
        start: StartCause,
    },
    /// Readings of the simulated converter, for a signal path and a controller as they run the drive.
    Samples {
        /// Each reading's difference to the one before as a zigzag varint ([`write_reading`]).
        codes: &'a [u8],
        /// With the last reading of a drive cycle: the inputs at its end.
        end: Option<Inputs>,
    },
    /// How far the identification of the parts' restitution has come ([`Target::Identify`]).
    Identification,
    /// The target that the board holds.
    Held,
    /// The fault kept beyond a loss of power that is so many faults older than the newest.
    Fault(u8),
    /// The board's inputs and outputs as they are now.
    Status,
    /// Saves settings and target with this PIN, or without one, and makes the link read-only where
    /// there is one; refused while the drive runs.
    Lock(Option<Pin>),
    /// Lets the desk change the board until its next start.
    Unlock(Pin),
}

/// A PIN of 4 to 8 digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pin(u32);

impl Pin {
    /// The PIN of these digits; `None` where they are no 4 to 8 digits.
    #[must_use]
    pub fn parse(digits: &str) -> Option<Self> {
        if !(4..=8).contains(&digits.len()) {
            return None;
        }
        // A leading 1 keeps zeros at the front.
        let number = digits.bytes().try_fold(1, |number: u32, digit| {
            (digit.is_ascii_digit()).then(|| 10 * number + u32::from(digit - b'0'))
        });
        number.map(Self)
    }

    /// The number that it is kept as: its digits behind a 1.
    #[must_use]
    pub fn number(self) -> u32 {
        self.0
    }

    /// The PIN of that number; `None` where none has it.
    #[must_use]
    pub fn numbered(number: u32) -> Option<Self> {
        let power = 10_u32.checked_pow(number.checked_ilog10()?)?;
        let digits = (10_000..=100_000_000).contains(&power) && number / power == 1;
        digits.then_some(Self(number))
    }
}

/// What the desk may do over the link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Access {
    /// It may read, set, save and simulate.
    #[default]
    Full,
    /// It may read and stop the drive: the board's strap is wired to ground.
    Strapped,
    /// It may read and stop the drive until it gives the PIN.
    Locked,
}

/// The inputs of a board, or of one that is simulated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Inputs {
    /// The enable input.
    pub enable: bool,
    /// The over-temperature input.
    pub over_temperature: bool,
    /// Whether the link brought a frame in this cycle.
    pub link_heard: bool,
    /// Whether the stack came close to its end.
    pub stack_low: bool,
    /// Whether the over-current input opened the bridge.
    pub over_current: bool,
    /// Whether the drive was switched off because the control of several cycles came too late.
    pub control_late: bool,
    /// Whether the supply is below what the chip needs.
    pub supply_low: bool,
    /// Whether the clock is not the crystal's.
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

/// Appends a reading's difference to the one before; bytes used, 0 where there is no room for three.
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

/// Takes the next reading after `before` off the front of `codes`; `None` where there is none or where
/// it is no reading.
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

/// Folds an output's bits into the check of a cycle's outputs, 0 at its beginning.
#[must_use]
pub fn fold_output(check: u32, output: f32) -> u32 {
    (check ^ output.to_bits())
        .wrapping_mul(0x0100_0193)
        .rotate_left(5)
}

/// What the board says to the desk.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Response<'a> {
    /// It is done.
    Done,
    /// It is not done, and nothing was changed.
    Refused(Refusal<'a>),
    /// A setting.
    Setting(Setting<'a>),
    /// A record of the event log, or none from that number on.
    Event(Option<Record>),
    /// The result of the test.
    SelfTest(SelfTest),
    /// The counters.
    Counters(Counters),
    /// The last words, if there were any.
    LastWords(Option<&'a str>),
    /// One drive cycle; sent unasked once telemetry is on.
    Telemetry(Telemetry),
    /// A drive cycle of the simulation ended.
    Cycle {
        /// All outputs of the cycle, folded ([`fold_output`]).
        outputs: u32,
        /// What the controller saw and did.
        report: Report,
    },
    /// How far the identification has come; a result is offered here and applied nowhere.
    Identification(Identification),
    /// The target that the board holds.
    Held(Target),
    /// A fault of the past, or none that old.
    Fault(Option<KeptFault>),
    /// The board as it is now.
    Status(Status),
}

/// A board's inputs and outputs, as they were in its last drive cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Its inputs; enable is that of the input itself.
    pub inputs: Inputs,
    /// Whether the desk lets the drive run ([`Request::Enable`]).
    pub permitted: bool,
    /// What the desk may do.
    pub access: Access,
    /// Whether READY is on: what is wanted is so.
    pub ready: bool,
    /// Mean of the acceleration over the cycle in m/s^2; about 0 where `sensor_zero` is right.
    pub mean: f32,
    /// Time since the start in s.
    pub seconds: u32,
}

/// Why a request was refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Refusal<'a> {
    /// There is no such setting.
    Unknown,
    /// A value outside what its parameter accepts.
    OutOfRange {
        /// The parameter.
        parameter: &'a str,
        /// What is accepted, in words, with the unit.
        accepted: &'a str,
    },
    /// Not while the drive runs.
    Running,
    /// The memory of the settings failed.
    Store,
    /// The desk simulates no plant, or its readings end elsewhere than the board's cycle.
    OutOfStep,
    /// The memory of the settings was written too often within the last hour.
    TooOften,
    /// The link is read-only.
    ReadOnly(Access),
    /// Not the PIN that the board was locked with.
    WrongPin,
    /// Too many wrong PINs: not before so many seconds.
    Wait(u16),
    /// The line carries telemetry every so many drive cycles at most.
    Faster(u16),
    /// The supply is low, or was within the last 100 ms: nothing was kept.
    SupplyLow,
}

/// A setting with what may be known of it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setting<'a> {
    /// Its number, from 0.
    pub number: u8,
    /// Its key.
    pub key: &'a str,
    /// Its unit.
    pub unit: &'a str,
    /// Its value.
    pub value: f32,
    /// Smallest accepted value.
    pub low: f32,
    /// Largest accepted value.
    pub high: f32,
    /// Value on first start.
    pub default: f32,
}

/// What is wanted of the parts; [`control::Target`] on the line.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Target {
    /// Locked, one impact every so many cycles.
    Locked(u8),
    /// Chaotic.
    Chaotic,
    /// A value of k.
    K(f32),
    /// A normal amplitude b in mm.
    Amplitude(f32),
    /// A conveying speed in mm/s.
    Speed(f32),
    /// To find the restitution of the parts.
    Identify,
    /// In gear, one flight every so many cycles.
    Gear(u8),
    /// A value of k, with tones of the track above the first.
    Tones(f32, Shape),
    /// Grams per second of parts in gear.
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

/// Why a controller starts; [`control::StartCause`] on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum StartCause {
    /// A user asked for it: a given enable input counts.
    Ordinary,
    /// The watchdog or a brown-out reset the board.
    Reset,
    /// The stored settings were refused.
    Refused,
    /// Power came: off until the enable input was seen withdrawn.
    PowerOn,
    /// The board was reset three times in a row.
    Repeated,
    /// The program in the flash is not the one that was written.
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

/// One drive cycle as the controller saw it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Telemetry {
    /// Cycles since the start.
    pub cycle: u32,
    /// Measured k; infinite at rest.
    pub k: f32,
    /// Measured normal amplitude of the track (symbol b) in m.
    pub amplitude: f32,
    /// Amplitude chosen for the target, in m; 0 where there is none.
    pub setpoint: f32,
    /// Phase lead of the track before the output, in rad.
    pub lead: f32,
    /// Output of the drive as a share of full output.
    pub output: f32,
    /// Measured shape of the track's motion: its tones above the first.
    pub shape: Shape,
    /// Second and third tone of the output along the sine and the cosine of as many times its phase, as shares of full output.
    pub overtones: [[f32; 2]; control::UPPER],
    /// Impacts heard per cycle.
    pub rate: f32,
    /// Mean phase of the track at the impacts heard, in rad.
    pub phase: f32,
    /// Confidence that the parts are in the wanted lock, 0..1.
    pub confidence: f32,
    /// Share of the parts' time in gear as heard, 0..=1.
    pub in_gear: f32,
    /// Standard error of that share; infinite where it is only a least.
    pub in_gear_error: f32,
    /// Share of time in gear to expect of the lot at the setpoint, 0..1; 0 for a target other than gear.
    pub expected_in_gear: f32,
    /// How far the parts are from losing gear; `None` where that is not heard.
    pub margin: Option<Margin>,
    /// The parts on the track as weighed; `None` where they are not in gear, or the mass of the track is not told.
    pub load: Option<Load>,
    /// Number of the state ([`control::State`]).
    pub state: u8,
    /// Number of the fault ([`control::Fault`]), 0 for none.
    pub fault: u8,
    /// Bits of the limits ([`control::Limits`]).
    pub limits: u16,
}

/// Most bytes of a frame of telemetry.
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
    /// Its number; numbers missing before it were overwritten.
    pub number: u32,
    /// Drive cycle in which it happened.
    pub cycle: u32,
    /// Number of the event ([`control::Event`]).
    pub event: u8,
    /// Number of the fault at that time, 0 for none.
    pub fault: u8,
    /// Mass of the parts in g that the event tells; 0 with any event but [`control::Event::Weighed`].
    pub mass: f32,
    /// Flow in g/s that it tells, 0 where the track's length is not told either.
    pub flow: f32,
}

/// A fault that was kept beyond a loss of power.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct KeptFault {
    /// Its number among all faults of the board.
    pub number: u32,
    /// Seconds from the board's start to the fault.
    pub seconds: u32,
    /// Number of the fault ([`control::Fault`]).
    pub fault: u8,
    /// Number of the state that it ended ([`control::State`]).
    pub state: u8,
    /// Measured amplitude of the track in m.
    pub amplitude: f32,
    /// Amplitude that the output should have given, in m.
    pub expected: f32,
    /// Output of the drive as a share of full output.
    pub output: f32,
    /// Lowest reading of the converter in the cycle.
    pub low: u16,
    /// Highest reading of the converter in the cycle.
    pub high: u16,
}

/// What is in the memory of the settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Kept {
    /// The settings and the target in use.
    InUse,
    /// Other settings, or another target.
    Others,
    /// None were ever saved.
    #[default]
    Never,
    /// Damaged ones, or another firmware's.
    Damaged,
}

/// How the chip itself is set up, by what outlives its program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetUp {
    /// Supply voltage in mV below which the chip holds itself in reset; 0 where the option bytes leave that off.
    pub brown_out: u16,
    /// Whether the option bytes start the watchdog with the power.
    pub watchdog: bool,
    /// Most cycles of the core that a sample took; 0 where they are not counted.
    pub sample: u32,
    /// Most cycles of the core that the control of a drive cycle took; 0 where they are not counted.
    pub control: u32,
}

/// What the board found in itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SelfTest {
    /// Whether the accelerometer stands where zero acceleration has it, gravity and noise allowed.
    pub sensor: bool,
    /// What is in the memory of the settings.
    pub settings: Kept,
    /// Bytes of the stack that were never used.
    pub stack_free: u32,
    /// Drive cycles whose control came too late.
    pub missed: u32,
    /// How the chip is set up.
    pub set_up: SetUp,
}

/// What was counted on the link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counters {
    /// Requests that were read.
    pub requests: u32,
    /// Frames longer than any message.
    pub oversized: u32,
    /// Frames shorter than any message, or not COBS, or with a wrong CRC.
    pub corrupt: u32,
    /// Frames of another version or schema.
    pub foreign: u32,
    /// Sound frames whose message is not known.
    pub unknown: u32,
    /// Requests beyond what a drive cycle answers.
    pub flooded: u32,
    /// Telemetry rows that did not fit into the line's buffer, and were dropped.
    pub rows_dropped: u32,
    /// Answers that did not fit within 100 ms, and were dropped.
    pub answers_dropped: u32,
}

impl Counters {
    /// Frames that came, read or refused; each is counted once.
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
