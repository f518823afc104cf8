//! Why the processor started, and when the drive may run again.

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

/// Passes the enable input on, but for a start that was not the operator's doing.
///
/// A feeder that stopped by itself must not start by itself (IEC 60204-1, 7.5): after any reset but
/// power-on the input has to be seen inactive once before it counts.
#[derive(Clone, Copy, Debug)]
pub struct EnableGate {
    open: bool,
}

impl EnableGate {
    /// The gate after a reset of this cause.
    #[must_use]
    pub fn after(cause: Cause) -> Self {
        Self {
            open: cause == Cause::Power,
        }
    }

    /// Whether the drive is enabled, given the input.
    pub fn pass(&mut self, input: bool) -> bool {
        self.open |= !input;
        self.open && input
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn power_on_obeys_the_input_at_once() {
        let mut gate = EnableGate::after(Cause::Power);
        assert!(gate.pass(true));
        assert!(!gate.pass(false));
        assert!(gate.pass(true));
    }

    #[test]
    fn any_other_start_waits_for_a_new_enable() {
        for cause in [Cause::BrownOut, Cause::Watchdog, Cause::Software] {
            let mut gate = EnableGate::after(cause);
            assert!(!gate.pass(true), "{cause:?}");
            assert!(!gate.pass(true), "{cause:?}");
            assert!(!gate.pass(false), "{cause:?}");
            assert!(gate.pass(true), "{cause:?}");
        }
    }
}
