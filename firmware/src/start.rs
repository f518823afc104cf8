//! Why the processor started, and whether the drive may run at once.

use kband::control::Start;

/// The cause of the last reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Cause {
    /// Power was switched on, or the reset pin was pulled.
    #[default]
    Power,
    /// The supply fell below its limit while running.
    BrownOut,
    /// The watchdog was not fed in time.
    Watchdog,
    /// The firmware asked for it: after a panic or a fault, or for new firmware.
    Software,
}

impl Cause {
    /// How the controller has to start.
    ///
    /// A feeder that stopped by itself must not start by itself (IEC 60204-1, 7.5): after any reset
    /// but power-on the drive stays off until it is enabled anew.
    #[must_use]
    pub fn start(self) -> Start {
        match self {
            Self::Power => Start::Ordinary,
            Self::BrownOut | Self::Watchdog | Self::Software => Start::Reset,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kband::control::{Controller, Cycle, Inputs, Settings, State, Target};

    #[test]
    fn only_power_on_obeys_an_enable_input_that_was_there_before() {
        for cause in [
            Cause::Power,
            Cause::BrownOut,
            Cause::Watchdog,
            Cause::Software,
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
            let starts = state(true) == State::Starting;
            assert_eq!(starts, cause == Cause::Power, "{cause:?}");
            state(true);
            state(false);
            assert_eq!(state(true) == State::Starting, cause != Cause::Power);
        }
    }
}
