//! The numbered lists of the controller: states, faults, limits, events. Numbers never change.
//!
//! On the line an item is its index in its list, and a set of limits its bits.

use serde::{Deserialize, Serialize};

/// State of the controller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u8)]
pub enum State {
    /// Drive off, waiting for the enable input.
    #[default]
    Off = 0,
    /// Soft start towards the setpoint.
    Starting = 1,
    /// At the setpoint; no lock is wanted, or it was not captured.
    Holding = 2,
    /// Planning, executing or testing a kick.
    Capturing = 3,
    /// The wanted lock is detected.
    Locked = 4,
    /// The lock was detected before and is lost.
    Lost = 5,
    /// Held back by a limit.
    Limiting = 6,
    /// Stopped by a fault until the enable input is withdrawn.
    Fault = 7,
    /// Soft stop to rest.
    Stopping = 8,
}

/// Cause for which the controller stopped the drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u8)]
pub enum Fault {
    /// The accelerometer's reading does not change.
    SensorLost = 1,
    /// The accelerometer's reading is at an end of the converter's range.
    SensorSaturated = 2,
    /// The accelerometer's reading has the wrong sign.
    SensorInverted = 3,
    /// The drive is on and the track does not follow.
    NoResponse = 4,
    /// The track moves more than the hard limit allows.
    OverAmplitude = 5,
    /// The over-temperature input is active.
    OverTemperature = 6,
    /// The stored settings were refused.
    SettingsInvalid = 8,
    /// The watchdog or a brown-out reset the board.
    WatchdogReset = 9,
    /// The stack came close to its end.
    StackLow = 10,
    /// The over-current input opened the bridge.
    OverCurrent = 11,
    /// Measured and predicted amplitude differ by more than a factor of two.
    SensorImplausible = 12,
    /// The control of several cycles was too late.
    ControlLate = 13,
    /// The supply of the board is below what its chip needs.
    SupplyLow = 14,
    /// The crystal does not oscillate, or not at its frequency.
    ClockFailed = 15,
    /// The amplitude oscillates about a constant reference.
    AmplitudeOscillates = 16,
    /// The board was reset three times in a row.
    RepeatedResets = 18,
    /// The program in the flash differs from the written one.
    ImageDamaged = 19,
}

/// The set of limits that hold the controller back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "u16", into = "u16")]
pub struct Limits(u16);

impl Limits {
    /// 1: the output is at `output_maximum`.
    pub const OUTPUT: Self = Self(1 << 1);
    /// 2: the reference was cut to `amplitude_limit`.
    pub const AMPLITUDE: Self = Self(1 << 2);
    /// 3: the reference was cut to `acceleration_limit`.
    pub const ACCELERATION: Self = Self(1 << 3);
    /// 4: no amplitude serves the target for the whole interval of restitution; the amplitude is
    /// the safe one.
    pub const NO_SETPOINT: Self = Self(1 << 4);
    /// 5: the second or third tone is smaller than wanted: the output is too small, or the response
    /// deviates from the configured one.
    pub const SECOND_TONE: Self = Self(1 << 5);
    /// 7: the link was silent for `link_timeout`, or the bus in control for `bus_timeout`; the
    /// amplitude is the safe one.
    pub const LINK_LOST: Self = Self(1 << 7);

    /// 8: no impact is detected where impacts are required; the setpoint is held and no kick
    /// begins.
    pub const DEAF: Self = Self(1 << 8);

    /// 9: the parts do not fit the lot that gear is planned for. The amplitude is the best one for
    /// parts of widely scattered restitution.
    pub const MISFIT: Self = Self(1 << 9);

    /// Every limit, in the order of their numbers.
    pub const ALL: [Self; 8] = [
        Self::OUTPUT,
        Self::AMPLITUDE,
        Self::ACCELERATION,
        Self::NO_SETPOINT,
        Self::SECOND_TONE,
        Self::LINK_LOST,
        Self::DEAF,
        Self::MISFIT,
    ];

    /// Its number, for a single limit.
    pub fn number(self) -> u8 {
        self.0.trailing_zeros() as u8
    }

    /// Its name in traces and the manual, for a single limit.
    pub fn name(self) -> &'static str {
        match self {
            Self::OUTPUT => "output at its maximum",
            Self::AMPLITUDE => "amplitude limit",
            Self::ACCELERATION => "acceleration limit",
            Self::NO_SETPOINT => "no setpoint for the lot",
            Self::SECOND_TONE => "second tone cut",
            Self::LINK_LOST => "link lost",
            Self::DEAF => "deaf",
            Self::MISFIT => "parts do not fit the lot",
            _ => "several limits",
        }
    }

    /// The set as bits, bit n for limit n.
    pub fn bits(self) -> u16 {
        self.0
    }

    /// The set of these bits; `None` where a bit belongs to no limit.
    pub fn from_bits(bits: u16) -> Option<Self> {
        let known = Self::ALL.iter().fold(0, |all, limit| all | limit.0);
        (bits & !known == 0).then_some(Self(bits))
    }

    /// Whether any limit of `other` is in this set.
    pub fn contains(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// Whether no limit holds the controller back.
    pub(crate) fn is_empty(self) -> bool {
        self.0 == 0
    }

    pub(crate) fn set(&mut self, other: Self, present: bool) {
        if present {
            self.0 |= other.0;
        } else {
            self.0 &= !other.0;
        }
    }
}

impl From<Limits> for u16 {
    fn from(limits: Limits) -> Self {
        limits.bits()
    }
}

impl TryFrom<u16> for Limits {
    type Error = &'static str;

    fn try_from(bits: u16) -> Result<Self, Self::Error> {
        Self::from_bits(bits).ok_or("an unknown limit")
    }
}

/// Event of a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u8)]
pub enum Event {
    /// The enable input came on and the soft start began.
    Started = 1,
    /// The amplitude came to within 1 % of the setpoint.
    SetpointReached = 2,
    /// A target was accepted.
    TargetSet = 3,
    /// No amplitude serves the target for the whole interval of restitution.
    NoSetpoint = 4,
    /// A kick was planned.
    KickPlanned = 5,
    /// No kick captures every restitution of the interval; the best one is tried.
    KickUncertain = 6,
    /// A kick began.
    KickBegun = 7,
    /// A kick ended and the test for the lock began.
    KickEnded = 8,
    /// The wanted lock is detected.
    Locked = 9,
    /// The lock is lost.
    LockLost = 10,
    /// The permitted kicks are used up.
    NotCaptured = 11,
    /// The wanted chaos is detected.
    Chaotic = 12,
    /// A limit began to hold the controller back.
    Limited = 13,
    /// No limit holds the controller back any longer.
    Freed = 14,
    /// A fault stopped the drive.
    Faulted = 15,
    /// The enable input was withdrawn after a fault.
    Acknowledged = 16,
    /// The enable input was withdrawn and the soft stop began.
    Stopping = 17,
    /// The drive is off.
    Stopped = 18,
    /// The sweep found the resonance.
    ResonanceFound = 19,
    /// The restitution of the parts was identified.
    Identified = 20,
    /// The restitution of the parts could not be identified.
    NotIdentified = 21,
    /// The third fault within a minute locked the drive out.
    LockedOut = 22,
    /// The track's response at twice the drive's frequency deviates from the configured one.
    SecondToneUnlike = 23,
    /// The track's response at three times the drive's frequency deviates from the configured one.
    ThirdToneUnlike = 24,
    /// No amplitude holds the lot in gear; the best one is held, with the predicted share of time.
    GearPoor = 25,
    /// The mass of the parts is estimated for the first time, or it changed by a tenth since the
    /// last event.
    Weighed = 26,
    /// The mass of the parts can no longer be estimated.
    NotWeighed = 27,
    /// The enable input chatters: the drive stays off until it was low and is high again.
    EnableChatters = 28,
    /// The selected recipe is missing or does not fit the machine; the previous target stays.
    RecipeRefused = 29,
}

/// The events of one cycle, at most [`Events::MOST`]; later ones of the same cycle are dropped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Events([Option<Event>; Events::MOST]);

impl Events {
    /// Largest number of events that one cycle reports.
    pub(crate) const MOST: usize = 6;

    /// The events in the order in which they happened.
    pub fn iter(&self) -> impl Iterator<Item = Event> + '_ {
        self.0.iter().flatten().copied()
    }

    pub(crate) fn push(&mut self, event: Event) {
        if let Some(slot) = self.0.iter_mut().find(|slot| slot.is_none()) {
            *slot = Some(event);
        }
    }
}

/// Number and name of each item of a list, for tools and the manual.
macro_rules! named {
    ($kind:ident: $($item:ident = $name:literal),+) => {
        impl $kind {
            /// All items, in the order of their numbers.
            pub const ALL: &'static [Self] = &[$(Self::$item),+];

            /// Its stable number.
            pub fn number(self) -> u8 {
                self as u8
            }

            /// The item of a number; `None` where there is none.
            pub fn numbered(number: u8) -> Option<Self> {
                let mut all = Self::ALL.iter().copied();
                all.find(|item| item.number() == number)
            }

            /// Its name in scenes, traces and the manual.
            pub fn name(self) -> &'static str {
                match self { $(Self::$item => $name),+ }
            }
        }
    };
}

named!(State: Off = "off", Starting = "starting", Holding = "holding", Capturing = "capturing", Locked = "locked",
    Lost = "lost", Limiting = "limiting", Fault = "fault", Stopping = "stopping");
named!(Fault: SensorLost = "sensor lost", SensorSaturated = "sensor saturated", SensorInverted = "sensor inverted",
    NoResponse = "no response", OverAmplitude = "over-amplitude", OverTemperature = "over-temperature",
    SettingsInvalid = "settings invalid", WatchdogReset = "watchdog reset", StackLow = "stack low",
    OverCurrent = "over-current", SensorImplausible = "sensor implausible", ControlLate = "control late",
    SupplyLow = "supply low", ClockFailed = "clock failed", AmplitudeOscillates = "amplitude oscillates",
    RepeatedResets = "repeated resets", ImageDamaged = "image damaged");
named!(Event: Started = "started", SetpointReached = "setpoint reached", TargetSet = "target set", NoSetpoint = "no setpoint",
    KickPlanned = "kick planned", KickUncertain = "kick uncertain", KickBegun = "kick begun", KickEnded = "kick ended",
    Locked = "locked", LockLost = "lock lost", NotCaptured = "not captured", Chaotic = "chaotic", Limited = "limited",
    Freed = "freed", Faulted = "faulted", Acknowledged = "acknowledged", Stopping = "stopping", Stopped = "stopped",
    ResonanceFound = "resonance found", Identified = "restitution identified",
    NotIdentified = "restitution not identified", LockedOut = "locked out",
    SecondToneUnlike = "second tone differs", ThirdToneUnlike = "third tone differs",
    GearPoor = "gear poor for the lot", Weighed = "weighed", NotWeighed = "no longer weighed",
    EnableChatters = "enable chatters", RecipeRefused = "recipe refused");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_stable_and_names_are_unique() {
        let numbers: std::vec::Vec<u8> = Fault::ALL.iter().map(|fault| fault.number()).collect();
        assert_eq!(
            numbers,
            [1, 2, 3, 4, 5, 6, 8, 9, 10, 11, 12, 13, 14, 15, 16, 18, 19]
        );
        assert!(State::ALL.iter().map(|state| state.number()).eq(0..9));
        assert!(Event::ALL.iter().map(|event| event.number()).eq(1..30));
        for number in 0..=u8::MAX {
            let fault = Fault::numbered(number);
            assert_eq!(fault.is_some(), numbers.contains(&number));
            assert!(fault.is_none_or(|fault| fault.number() == number));
        }
        let mut names: std::vec::Vec<&str> = Fault::ALL.iter().map(|fault| fault.name()).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), Fault::ALL.len());
    }

    #[test]
    fn a_full_list_of_events_keeps_the_first() {
        let mut events = Events::default();
        for &event in Event::ALL {
            events.push(event);
        }
        assert!(events.iter().eq(Event::ALL[..Events::MOST].iter().copied()));
    }
}
