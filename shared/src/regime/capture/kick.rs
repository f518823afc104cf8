//! Shape of a kick: a hold followed by a linear descent (docs/theory-capture.md#t7.4).

use crate::feeder::{OutOfRange, accept_in};

/// Commanded amplitude over the target amplitude during a capture.
///
/// It is `factor` for `hold` cycles, a straight line to `release` over `descent` cycles, then 1.
/// A rectangular kick (no descent) throws the part onto the orbit. A slow descent moves a hopping
/// part through the cascade until the lock attracts it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KickSettings {
    /// Highest commanded amplitude over the target amplitude, 1..=10.
    pub factor: f32,
    /// Duration at `factor` in cycles, 0..=10000.
    pub hold: u16,
    /// Duration of the descent in cycles, 0..=10000.
    pub descent: u16,
    /// Amplitude at the end of the descent over the target amplitude, 1..=`factor`.
    pub release: f32,
}

/// A kick with validated settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kick {
    settings: KickSettings,
}

impl Kick {
    /// No kick: the target amplitude from the first cycle on.
    pub const NONE: Self = Self {
        settings: KickSettings {
            factor: 1.0,
            hold: 0,
            descent: 0,
            release: 1.0,
        },
    };

    /// Builds the kick; an error names the parameter out of range.
    pub fn build(settings: KickSettings) -> Result<Self, OutOfRange> {
        let factor = settings.factor.into();
        let accepted = "1..10 times the target amplitude";
        accept_in("factor", factor, 1.0..=10.0, accepted)?;
        for (parameter, cycles) in [("hold", settings.hold), ("descent", settings.descent)] {
            let cycles = cycles.into();
            accept_in(parameter, cycles, ..=10_000.0, "0..10000 drive cycles")?;
        }
        let accepted = "1..factor times the target amplitude";
        accept_in("release", settings.release.into(), 1.0..=factor, accepted)?;
        Ok(Self { settings })
    }

    /// Settings of the kick.
    pub fn settings(&self) -> KickSettings {
        self.settings
    }

    /// Duration in cycles until the command remains at the target.
    pub fn length(&self) -> u32 {
        u32::from(self.settings.hold) + u32::from(self.settings.descent)
    }

    /// Commanded amplitude over the target amplitude in drive cycle `cycle`, counted from 0.
    pub fn command(&self, cycle: u32) -> f32 {
        let KickSettings {
            factor,
            hold,
            descent,
            release,
        } = self.settings;
        if cycle < u32::from(hold) {
            factor
        } else if cycle < self.length() {
            let remaining = (self.length() - cycle) as f32 / f32::from(descent);
            release + (factor - release) * remaining
        } else {
            1.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    const VALID: KickSettings = KickSettings {
        factor: 1.5,
        ..Kick::NONE.settings
    };

    #[test]
    fn kick_falls_linearly_from_its_factor_to_the_target() {
        for (hold, descent, release) in [
            (12, 0, 1.0),
            (3, 40, 1.2),
            (0, 7, 1.0),
            (10_000, 10_000, 1.5),
        ] {
            let mut settings = VALID;
            (settings.hold, settings.descent, settings.release) = (hold, descent, release);
            let kick = Kick::build(settings).unwrap();
            let mut last = 1.5;
            for cycle in 0..kick.length() {
                let command = kick.command(cycle);
                let slope = (1.5 - release) / f32::from(descent.max(1));
                assert!(command <= last && last - command <= slope + 1e-6);
                assert_eq!(command == 1.5, cycle <= u32::from(hold) || release == 1.5);
                last = command;
            }
            assert_eq!(kick.command(kick.length()), 1.0);
        }
        assert_eq!(Kick::NONE.command(0), 1.0);
    }

    #[test]
    fn refusals_name_the_parameter() {
        let refused = |change: fn(&mut KickSettings)| {
            let mut settings = VALID;
            change(&mut settings);
            Kick::build(settings).unwrap_err().parameter
        };
        assert_eq!(refused(|s| s.factor = 0.9), "factor");
        assert_eq!(refused(|s| s.factor = f32::NAN), "factor");
        assert_eq!(refused(|s| s.hold = 10_001), "hold");
        assert_eq!(refused(|s| s.descent = 10_001), "descent");
        assert_eq!(refused(|s| s.release = 1.6), "release");
    }
}
