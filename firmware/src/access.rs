//! Write access over the link: a strap and a PIN make the link read-only.

use kband_control::wire::{Access, Pin, Refusal};

/// Number of wrong PINs after which PINs are refused for a time.
const MAX_WRONG_PINS: u8 = 5;
/// Duration of that refusal, s.
const PIN_WAIT_S: u32 = 60;

/// The lock of the link.
#[derive(Clone, Copy, Debug, Default)]
pub struct LinkLock {
    pub pin: Option<Pin>,
    open: bool,
    wrong_pins: u8,
    /// Time since the start of the last wrong PIN, s.
    since: u32,
}

impl LinkLock {
    pub fn new(pin: Option<Pin>) -> Self {
        Self {
            pin,
            ..Self::default()
        }
    }

    /// Access of the desk; `strapped`: the strap is wired to ground.
    pub fn access(&self, strapped: bool) -> Access {
        if strapped {
            Access::Strapped
        } else if self.pin.is_some() && !self.open {
            Access::Locked
        } else {
            Access::Full
        }
    }

    /// Opens the lock until the next start.
    ///
    /// # Errors
    /// The PIN is wrong, or the refusal after five wrong PINs lasts.
    pub fn unlock(&mut self, pin: Pin, now: u32) -> Result<(), Refusal<'static>> {
        if self.wrong_pins >= MAX_WRONG_PINS {
            let waited = now.saturating_sub(self.since);
            if waited < PIN_WAIT_S {
                return Err(Refusal::Wait((PIN_WAIT_S - waited) as u16));
            }
            self.wrong_pins = 0;
        }
        if self.pin.is_some_and(|correct| correct != pin) {
            (self.wrong_pins, self.since) = (self.wrong_pins + 1, now);
            return Err(Refusal::WrongPin);
        }
        (self.open, self.wrong_pins) = (true, 0);
        Ok(())
    }
}
