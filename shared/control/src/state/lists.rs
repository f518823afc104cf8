//! The numbered lists of the controller: states, faults, limits, events. Numbers never change.
//!
//! On the line an item is its index in its list, and a set of limits its bits.

use serde::{Deserialize, Serialize};

/// A list of items, each with its stable number, and its name for tools and the manual.
macro_rules! numbered {
    ($(#[$of:meta])* $kind:ident { $($(#[$item_of:meta])* $item:ident = $number:literal $name:literal,)+ }) => {
        $(#[$of])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        #[repr(u8)]
        pub enum $kind {
            $($(#[$item_of])* $item = $number,)+
        }

        impl $kind {
            /// All items, in the order of their numbers.
            pub const ALL: &'static [Self] = &[$(Self::$item),+];

            /// Its stable number.
            pub fn number(self) -> u8 {
                self as u8
            }

            /// The item of a number; `None` if there is none.
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

numbered! {
    /// State of the controller.
    #[derive(Default)]
    State {
        /// Drive off, waiting for the enable input.
        #[default]
        Off = 0 "off",
        /// Soft start towards the setpoint.
        Starting = 1 "starting",
        /// At the setpoint; no lock is requested, or it was not captured.
        Holding = 2 "holding",
        /// Planning, executing or testing a kick.
        Capturing = 3 "capturing",
        /// The requested lock is detected.
        Locked = 4 "locked",
        /// The lock was detected before and is lost.
        Lost = 5 "lost",
        /// Held back by a limit.
        Limiting = 6 "limiting",
        /// Stopped by a fault until the enable input is withdrawn.
        Fault = 7 "fault",
        /// Soft stop to rest.
        Stopping = 8 "stopping",
    }
}

numbered! {
    /// Cause for which the controller stopped the drive.
    Fault {
        /// The accelerometer's reading does not change.
        SensorLost = 1 "sensor lost",
        /// The accelerometer's reading is at an end of the converter's range.
        SensorSaturated = 2 "sensor saturated",
        /// The accelerometer's reading has the wrong sign.
        SensorInverted = 3 "sensor inverted",
        /// The drive is on and the track does not follow.
        NoResponse = 4 "no response",
        /// The track moves more than the hard limit allows.
        OverAmplitude = 5 "over-amplitude",
        /// The over-temperature input is active.
        OverTemperature = 6 "over-temperature",
        /// The stored settings were refused.
        SettingsInvalid = 8 "settings invalid",
        /// The watchdog or a brown-out reset the board.
        WatchdogReset = 9 "watchdog reset",
        /// The stack came close to its end.
        StackLow = 10 "stack low",
        /// The over-current input opened the bridge.
        OverCurrent = 11 "over-current",
        /// Measured and predicted amplitude differ by more than a factor of two.
        SensorImplausible = 12 "sensor implausible",
        /// The control of several cycles was too late.
        ControlLate = 13 "control late",
        /// The supply of the board is below what its chip needs.
        SupplyLow = 14 "supply low",
        /// The crystal does not oscillate, or not at its frequency.
        ClockFailed = 15 "clock failed",
        /// The amplitude oscillates about a constant reference.
        AmplitudeOscillates = 16 "amplitude oscillates",
        /// The board was reset three times in a row.
        RepeatedResets = 18 "repeated resets",
        /// The program in the flash differs from the written one.
        ImageDamaged = 19 "image damaged",
    }
}

/// The set of limits that hold the controller back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "u16", into = "u16")]
pub struct Limits(u16);

/// The single limits, each with its number and its name in traces and the manual.
macro_rules! limits {
    ($($(#[$of:meta])* $limit:ident = $number:literal $name:literal,)+) => {
        impl Limits {
            $($(#[$of])* pub const $limit: Self = Self(1 << $number);)+

            /// Every limit, in the order of their numbers.
            pub const ALL: [Self; [$($number),+].len()] = [$(Self::$limit),+];

            /// Its name, for a single limit.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$limit => $name,)+
                    _ => "several limits",
                }
            }
        }
    };
}

limits! {
    /// 1: the output is at `output_maximum`.
    OUTPUT = 1 "output at its maximum",
    /// 2: the reference was cut to `amplitude_limit`.
    AMPLITUDE = 2 "amplitude limit",
    /// 3: the reference was cut to `acceleration_limit`.
    ACCELERATION = 3 "acceleration limit",
    /// 4: no amplitude suits the whole interval of restitution; the amplitude is the safe one.
    NO_SETPOINT = 4 "no setpoint for the lot",
    /// 5: the second or third tone is smaller than requested: the output is too small, or the
    /// response deviates from the configured one.
    SECOND_TONE = 5 "second tone cut",
    /// 7: the link was silent for `link_timeout`, or the bus in control for `bus_timeout`; the
    /// amplitude is the safe one.
    LINK_LOST = 7 "link lost",
    /// 8: no impact is detected although impacts are required; the setpoint is held and no kick
    /// begins.
    DEAF = 8 "deaf",
    /// 9: the parts do not fit the lot that gear is planned for. The amplitude is the best one for
    /// parts of widely scattered restitution.
    MISFIT = 9 "parts do not fit the lot",
}

impl Limits {
    /// Its number, for a single limit.
    pub fn number(self) -> u8 {
        self.0.trailing_zeros() as u8
    }

    /// The set as bits, bit n for limit n.
    pub fn bits(self) -> u16 {
        self.0
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
        let defined = Self::ALL.iter().fold(0, |all, limit| all | limit.0);
        ((bits & !defined == 0).then_some(Self(bits))).ok_or("an unknown limit")
    }
}

numbered! {
    /// Event of a cycle.
    Event {
        /// The enable input came on and the soft start began.
        Started = 1 "started",
        /// The amplitude came to within 1 % of the setpoint.
        SetpointReached = 2 "setpoint reached",
        /// A target was accepted.
        TargetSet = 3 "target set",
        /// No amplitude suits the whole interval of restitution.
        NoSetpoint = 4 "no setpoint",
        /// A kick was planned.
        KickPlanned = 5 "kick planned",
        /// No kick captures every restitution of the interval; the best one is tried.
        KickUncertain = 6 "kick uncertain",
        /// A kick began.
        KickBegun = 7 "kick begun",
        /// A kick ended and the test for the lock began.
        KickEnded = 8 "kick ended",
        /// The requested lock is detected.
        Locked = 9 "locked",
        /// The lock is lost.
        LockLost = 10 "lock lost",
        /// The permitted kicks are used up.
        NotCaptured = 11 "not captured",
        /// The requested chaos is detected.
        Chaotic = 12 "chaotic",
        /// A limit began to hold the controller back.
        Limited = 13 "limited",
        /// No limit holds the controller back any longer.
        Freed = 14 "freed",
        /// A fault stopped the drive.
        Faulted = 15 "faulted",
        /// The enable input was withdrawn after a fault.
        Acknowledged = 16 "acknowledged",
        /// The enable input was withdrawn and the soft stop began.
        Stopping = 17 "stopping",
        /// The drive is off.
        Stopped = 18 "stopped",
        /// The sweep found the resonance.
        ResonanceFound = 19 "resonance found",
        /// The restitution of the parts was identified.
        Identified = 20 "restitution identified",
        /// The restitution of the parts could not be identified.
        NotIdentified = 21 "restitution not identified",
        /// The third fault within a minute locked the drive out.
        LockedOut = 22 "locked out",
        /// The track's response at twice the drive's frequency deviates from the configured one.
        SecondToneUnlike = 23 "second tone differs",
        /// The track's response at three times that frequency deviates from the configured one.
        ThirdToneUnlike = 24 "third tone differs",
        /// No amplitude holds the lot in gear; the best one is held, for its predicted share.
        GearPoor = 25 "gear poor for the lot",
        /// The mass of the parts is estimated first, or differs by a tenth from the last event's.
        Weighed = 26 "weighed",
        /// The mass of the parts can no longer be estimated.
        NotWeighed = 27 "no longer weighed",
        /// The enable input chatters: the drive stays off until it was low and is high again.
        EnableChatters = 28 "enable chatters",
        /// The selected recipe is missing or does not fit the machine; the previous target stays.
        RecipeRefused = 29 "recipe refused",
    }
}

/// The events of one cycle, at most [`Events::CAP`]; later ones of the same cycle are dropped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Events([Option<Event>; Events::CAP]);

impl Events {
    /// Largest number of events that one cycle reports.
    pub(crate) const CAP: usize = 6;

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

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn numbers_are_stable_and_names_are_unique() {
        let numbers: std::vec::Vec<u8> = Fault::ALL.iter().map(|fault| fault.number()).collect();
        let expected = [1, 2, 3, 4, 5, 6, 8, 9, 10, 11, 12, 13, 14, 15, 16, 18, 19];
        assert_eq!(numbers, expected);
        assert!(State::ALL.iter().map(|state| state.number()).eq(0..9));
        assert!(Event::ALL.iter().map(|event| event.number()).eq(1..30));
        for number in 0..=u8::MAX {
            let fault = Fault::numbered(number);
            assert_eq!(fault.is_some(), numbers.contains(&number));
            assert!(fault.is_none_or(|fault| fault.number() == number));
        }
        let names: BTreeSet<&str> = Fault::ALL.iter().map(|fault| fault.name()).collect();
        assert_eq!(names.len(), Fault::ALL.len());
    }

    #[test]
    fn a_full_list_of_events_keeps_the_first() {
        let mut events = Events::default();
        for &event in Event::ALL {
            events.push(event);
        }
        assert!(events.iter().eq(Event::ALL[..Events::CAP].iter().copied()));
    }
}
