//! Cause of the last reset, and whether the drive may run at once.

use kband_control::StartCause;

/// Flags of the chip after a reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ResetFlags {
    /// A watchdog caused the reset.
    pub watchdog: bool,
    /// The firmware caused the reset.
    pub software: bool,
    /// The chip detected a sag of the supply.
    pub sag: bool,
    /// The RAM kept its content over the reset.
    pub remembered: bool,
}

/// The cause of the last reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ResetCause {
    /// Power was switched on.
    #[default]
    Power,
    /// The supply fell below its limit while running, or the reset pin was pulled.
    BrownOut,
    /// The watchdog was not fed in time.
    Watchdog,
    /// The firmware caused it: after a panic or a fault, or for new firmware.
    Software,
}

impl ResetCause {
    /// Cause of the reset from the chip's flags.
    ///
    /// A chip reports a sag below its lowest limit as power-on, and noise on its reset pin as a
    /// button. RAM that kept its mark shows that the power was not really off.
    pub fn of(signs: ResetFlags) -> Self {
        if signs.watchdog {
            Self::Watchdog
        } else if signs.software {
            Self::Software
        } else if signs.sag || signs.remembered {
            Self::BrownOut
        } else {
            Self::Power
        }
    }

    /// Name in the log.
    pub fn name(self) -> &'static str {
        match self {
            Self::Power => "power-on",
            Self::BrownOut => "brown-out",
            Self::Watchdog => "the watchdog",
            Self::Software => "the firmware",
        }
    }

    /// Cause of the start for the controller.
    ///
    /// A feeder must not start by itself when its supply returns (IEC 60204-1, 7.5). After any
    /// reset the drive stays off until the enable input has a new edge. After any but power-on this
    /// is a fault.
    pub fn start(self) -> StartCause {
        match self {
            Self::Power => StartCause::PowerOn,
            Self::BrownOut | Self::Watchdog | Self::Software => StartCause::Reset,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kband_control::{Controller, Cycle, Inputs, Settings, State, Target};

    #[test]
    fn only_no_flag_at_all_is_power_on() {
        let mut times = 0;
        for bits in 0..16_u8 {
            let signs = ResetFlags {
                watchdog: bits & 1 != 0,
                software: bits & 2 != 0,
                sag: bits & 4 != 0,
                remembered: bits & 8 != 0,
            };
            let ordinary = ResetCause::of(signs).start() == StartCause::PowerOn;
            assert_eq!(ordinary, bits == 0, "{signs:?}");
            times += u8::from(ordinary);
        }
        assert_eq!(times, 1);
        let watchdog = ResetFlags {
            watchdog: true,
            remembered: true,
            ..ResetFlags::default()
        };
        assert_eq!(ResetCause::of(watchdog), ResetCause::Watchdog);
    }

    #[test]
    fn no_start_obeys_an_enable_input_that_was_there_before() {
        for cause in [
            ResetCause::Power,
            ResetCause::BrownOut,
            ResetCause::Watchdog,
            ResetCause::Software,
        ] {
            let target = Target::Locked { order: 1 };
            let mut controller =
                Controller::build(&Settings::default(), target, cause.start()).unwrap();
            let mut state = |enable| {
                let inputs = Inputs {
                    enable,
                    ..Inputs::default()
                };
                controller.cycle(&Cycle::default(), &inputs).state
            };
            for _ in 0..100 {
                assert_ne!(state(true), State::Starting, "{cause:?}");
            }
            // A fault is acknowledged in half a second (25 cycles); after power-on there is none.
            let cycles = if cause == ResetCause::Power { 1 } else { 25 };
            for cycle in 1..=cycles {
                let acknowledged = state(false) == State::Off;
                assert_eq!(acknowledged, cycle == cycles, "{cause:?}");
            }
            assert_eq!(state(true), State::Starting, "{cause:?}");
        }
    }
}
