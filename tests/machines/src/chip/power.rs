//! Model of the supply, its monitor and the brown-out reset (RM0090, chapter 5; DS8626, table 19).

/// Bits of CR (5.4.1) and CSR (5.4.2).
const MONITOR: u32 = 1 << 4;
const BELOW: u32 = 1 << 2;
const SCALED: u32 = 1 << 14;

/// Monitor thresholds of a falling supply by level, V.
const LEVELS: [f64; 8] = [1.98, 2.13, 2.25, 2.39, 2.54, 2.65, 2.78, 2.88];
/// Hysteresis of the monitor and the brown-out reset, V.
const HYSTERESIS: f64 = 0.1;
/// Brown-out thresholds in the coding of the option bytes, V: 0b00 is level 3, 0b11 is off.
const BROWN_OUT: [f64; 4] = [2.83, 2.44, 2.19, 0.0];
/// Power-down threshold, V: below it the chip is off with any option bytes.
const OFF: f64 = 1.68;
/// Lowest supply for 168 MHz with 5 wait states, V (DS8626, table 15).
pub const LOWEST: f64 = 2.7;

/// State of the chip at a supply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Supply {
    Enough,
    /// Below the brown-out level: in reset.
    BrownOut,
    /// Below the power-on threshold: off.
    Gone,
}

/// The registers and the supply.
#[derive(Clone, Debug)]
pub struct Power {
    /// The supply, V.
    pub volts: f64,
    control: u32,
    status: u32,
    below: bool,
}

impl Default for Power {
    fn default() -> Self {
        Self {
            volts: 3.3,
            control: SCALED,
            status: 0,
            below: false,
        }
    }
}

impl Power {
    pub fn reset(&mut self) {
        *self = Self {
            volts: self.volts,
            ..Self::default()
        };
    }

    pub fn read(&self, offset: u32) -> u32 {
        match offset {
            0x00 => self.control,
            0x04 => self.status | SCALED | (u32::from(self.below) * BELOW),
            _ => 0,
        }
    }

    pub fn write(&mut self, offset: u32, value: u32) {
        match offset {
            0x00 => self.control = value & 0xc3f3,
            0x04 => self.status = value & 0x300,
            _ => {}
        }
        self.look();
    }

    /// Updates the monitor; returns its output: the supply is below its level.
    pub fn look(&mut self) -> bool {
        let level = LEVELS[(self.control >> 5 & 7) as usize];
        let level = level + if self.below { HYSTERESIS } else { 0.0 };
        self.below = self.control & MONITOR != 0 && self.volts < level;
        self.below
    }

    /// Whether the supply is too low to program or erase the flash by words (DS8626, flash memory
    /// programming), or the monitor's output is high.
    pub fn too_low_for_flash(&self) -> bool {
        self.volts < LOWEST || self.below
    }

    /// State of the chip with this brown-out level of the option bytes (3.9.1), in reset or not.
    pub fn supply(&self, level: u32, in_reset: bool) -> Supply {
        let more = if in_reset { HYSTERESIS } else { 0.0 };
        if self.volts < OFF + more / 2.0 {
            Supply::Gone
        } else if self.volts < BROWN_OUT[(level & 3) as usize] + more {
            Supply::BrownOut
        } else {
            Supply::Enough
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn monitor_sees_a_low_supply_only_while_on() {
        let mut power = Power {
            volts: 2.5,
            ..Power::default()
        };
        assert!(!power.look());
        power.write(0, MONITOR | 5 << 5);
        assert_eq!(power.read(4) & BELOW, BELOW);
        power.volts = 2.7;
        assert!(power.look(), "within the hysteresis");
        assert!(power.too_low_for_flash());
        power.volts = 2.8;
        assert!(!power.look());
        assert!(!power.too_low_for_flash());
        power.volts = 2.69;
        assert!(!power.look() && power.too_low_for_flash());
    }

    #[test]
    fn brown_out_follows_the_option_bytes() {
        let mut power = Power::default();
        for (volts, level, expected) in [
            (3.3, 3, Supply::Enough),
            (1.8, 3, Supply::Enough),
            (1.6, 3, Supply::Gone),
            (2.8, 0, Supply::BrownOut),
            (2.9, 0, Supply::Enough),
            (2.3, 1, Supply::BrownOut),
            (2.1, 2, Supply::BrownOut),
        ] {
            power.volts = volts;
            assert_eq!(power.supply(level, false), expected, "{volts} V, {level}");
        }
        power.volts = 2.9;
        assert_eq!(
            power.supply(0, true),
            Supply::BrownOut,
            "not yet risen enough"
        );
    }
}
