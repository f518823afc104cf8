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
    /// The firmware reset the board: after a panic or a fault, or for new firmware.
    Software,
}

impl ResetCause {
    /// Cause of the reset from the chip's flags. RAM that kept its mark shows that the power was
    /// not off. A chip may report a sag as power-on, and noise on its reset pin as a button.
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
    /// A feeder must not start by itself when its supply returns (IEC 60204-1, 7.5). So the drive
    /// stays off until a new edge of the enable input. Any cause except power-on is a fault.
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

    #[test]
    fn only_no_flag_at_all_is_power_on() {
        for bits in 0..16_u8 {
            let signs = ResetFlags {
                watchdog: bits & 1 != 0,
                software: bits & 2 != 0,
                sag: bits & 4 != 0,
                remembered: bits & 8 != 0,
            };
            let ordinary = ResetCause::of(signs).start() == StartCause::PowerOn;
            assert_eq!(ordinary, bits == 0, "{signs:?}");
        }
        let watchdog = ResetFlags {
            watchdog: true,
            remembered: true,
            ..ResetFlags::default()
        };
        assert_eq!(ResetCause::of(watchdog), ResetCause::Watchdog);
    }
}
