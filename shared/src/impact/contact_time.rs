//! Contact that takes time: the impact map to first order in the contact time
//! (docs/theory-real-parts.md#t10.6).
//!
//! The contact is a linear spring and dashpot (Kelvin-Voigt model). Inputs are restitution, k, and
//! the state at the touch; the output is the state at the launch. Times are in rad of the drive's
//! phase, velocities in `b w`.

use core::f64::consts::TAU;

use crate::arithmetic::{sine_cosine, square_root_single};
use crate::feeder::{OutOfRange, accept_in};
use crate::impact::kernel::{Impact, PartState};
use crate::impact::wave::{Wave, in_turn};

/// Duration of an impact (symbol c). The impact lasts from touching the track until the part is
/// back at the height of the touch.
///
/// The contact is a linear spring and dashpot that pushes and never pulls. A part arrives at phase
/// t with speed s. It leaves at `t + c` with the relative speed `psi = R s + rho(R) c (A(t + c) -
/// k)`. A part whose speed is then not above 0 rests.
///
/// ```
/// use kband::impact::{ContactTime, PartState};
/// // 0.4 ms at 50 Hz are 2 % of the cycle.
/// let contact = ContactTime::from_milliseconds(0.4, 50.0)?;
/// assert!((contact.radians() / core::f64::consts::TAU - 0.02).abs() < 1e-12);
/// // The track pushes less than gravity, 0.58 against 0.7: the part leaves later and more slowly.
/// let left = contact.launch(0.3, PartState::new(0.5, 0.45), 0.7, None);
/// assert!(left.phase > 0.62 && 0.44 < left.velocity && left.velocity < 0.45);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactTime {
    radians: f64,
}

impl ContactTime {
    /// An impact without duration.
    pub const INSTANT: Self = Self { radians: 0.0 };

    /// A contact of this duration in rad of the drive's phase, 0 to 7 % of a cycle (0.44 rad);
    /// an error beyond, where the first order no longer holds.
    pub fn build(radians: f64) -> Result<Self, OutOfRange> {
        let accepted = "0..0.4398 rad, 7 % of a drive cycle";
        accept_in("contact", radians, 0.0..=0.07 * TAU, accepted)?;
        Ok(Self { radians })
    }

    /// A contact of this duration in ms, at a drive frequency in Hz; an error above 7 % of a cycle.
    pub fn from_milliseconds(duration: f64, frequency: f64) -> Result<Self, OutOfRange> {
        let radians = duration * 1e-3 * frequency * TAU;
        Self::build(radians).map_err(|_| OutOfRange {
            parameter: "contact",
            value: duration,
            accepted: "0..7 % of a drive cycle, in ms",
        })
    }

    /// Duration in rad of the drive's phase.
    pub fn radians(self) -> f64 {
        self.radians
    }

    /// Whether the impact has no duration.
    #[inline]
    pub fn is_instant(self) -> bool {
        self.radians == 0.0
    }

    /// State after the contact of a part that touched the track in `impact_state`, with R s as its
    /// velocity; velocity 0 if it rests. `k` is the track's; without a `wave` it is a sine.
    pub fn launch(
        self,
        restitution: f64,
        impact_state: PartState,
        k: f64,
        wave: Option<&Wave>,
    ) -> PartState {
        let phase = in_turn(impact_state.phase + self.radians);
        let push = wave.map_or_else(|| sine_cosine(phase).0, |wave| wave.push(phase));
        let speed = self.launch_speed(restitution, impact_state.velocity, k - push);
        PartState::new(phase, speed)
    }

    /// `impact`, which ends at the touch, with its contact; the track is as in
    /// [`ContactTime::launch`]. A part that rests (flight 0) has no contact.
    #[inline]
    pub fn hold(self, restitution: f64, impact: Impact, k: f64, wave: Option<&Wave>) -> Impact {
        if self.is_instant() || impact.flight <= 0.0 {
            return impact;
        }
        Impact {
            flight: impact.flight + self.radians,
            next: self.launch(restitution, impact.next, k, wave),
            ..impact
        }
    }

    /// Launch speed in `b w` at the end of the contact; 0 if the part rests.
    /// `speed` is R s in `b w`, `pull` is `k - A` at the end of the contact in `b w^2`.
    #[inline]
    fn launch_speed(self, restitution: f64, speed: f64, pull: f64) -> f64 {
        (speed - self.gain(restitution) * pull).max(0.0)
    }

    /// `rho c`: launch speed in `b w` gained by an acceleration of `b w^2` during the contact.
    pub fn gain(self, restitution: f64) -> f64 {
        f64::from(speed_gain(restitution as f32)) * self.radians
    }

    /// `q c`: velocity along the track in `b w` gained by an acceleration along it of `b w^2`.
    ///
    /// Friction holds the part to the track until the force ends. Then the part flies, for a share
    /// q of the contact. q is a fit to integrated contacts with friction. Largest error of the
    /// speed in lock: 0.03, 0.17 and 0.44 % for contacts of 0.25, 1 and 2 % of the cycle.
    pub fn gain_along(self, restitution: f64) -> f64 {
        let r = restitution;
        let free = (1.0 - r) / (1.0 + 3.45 * r + 0.7 * libm::sqrt(r));
        free * self.radians
    }
}

/// Launch speed gained per acceleration and contact time (symbol rho), of a restitution in 0..=1. A
/// rational fit, from R = 0.05 on within 0.009 of the exact gain.
#[inline]
pub(crate) fn speed_gain(restitution: f32) -> f32 {
    let r = restitution;
    (1.0 - r * r) / (1.0 + 3.15 * r + 0.82 * square_root_single(r))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::Tone;

    /// Gains of the integrated contact for R = 0.05, 0.1 ... 0.95, from a weak acceleration
    /// (docs/theory-real-parts.md#t10.6).
    const EXACT_GAINS: [f32; 19] = [
        0.752_83, 0.630_52, 0.545_22, 0.479_19, 0.424_76, 0.378_51, 0.337_98, 0.301_40, 0.268_17,
        0.237_36, 0.208_72, 0.181_47, 0.155_97, 0.131_20, 0.107_68, 0.085_12, 0.063_11, 0.041_26,
        0.020_67,
    ];

    #[test]
    fn gain_is_that_of_the_contact() {
        for (n, exact) in EXACT_GAINS.into_iter().enumerate() {
            let restitution = 0.05 * (n + 1) as f32;
            let fit = speed_gain(restitution);
            assert!((fit - exact).abs() < 0.01, "{restitution}: {fit} {exact}");
        }
        assert_eq!([speed_gain(0.0), speed_gain(1.0)], [1.0, 0.0]);
    }

    /// Launch velocities of the integrated contact on one tone and on two, by Runge-Kutta steps of
    /// 1/400 of it (docs/theory-real-parts.md#t10.6). Each part arrives as fast as in lock.
    #[test]
    fn first_order_is_that_of_the_integrated_contact() {
        let second = Wave::build(Tone::new(0.15, 2.356), Tone::default()).unwrap();
        for (percent, [restitution, k, phase], exact) in [
            (0.25, [0.1, 0.35, 2.4], [0.203_038, 0.207_554]),
            (0.25, [0.3, 0.45, 4.8], [0.643_827, 0.641_828]),
            (1.0, [0.1, 0.25, 3.3], [0.123_685, 0.133_486]),
            (1.0, [0.3, 0.35, 5.7], [0.486_718, 0.500_902]),
            (2.0, [0.3, 0.25, 0.4], [0.373_656, 0.367_147]),
            (2.0, [0.6, 0.35, 2.8], [0.820_409, 0.832_966]),
            (4.0, [0.6, 0.25, 3.7], [0.535_590, 0.502_940]),
            (7.0, [0.3, 0.45, 2.2], [0.666_358, 0.754_415]),
            (7.0, [0.6, 0.55, 4.6], [1.163_655, 1.177_147]),
        ] {
            let contact = ContactTime::build(percent * 0.01 * TAU).unwrap();
            let speed = TAU * k / (1.0 + restitution);
            let touch = PartState::new(phase, restitution * speed);
            for (wave, exact) in [None, Some(&second)].into_iter().zip(exact) {
                let launch = contact.launch(restitution, touch, k, wave);
                // The second order, which is left out.
                let bound = 0.55 * contact.radians() * contact.radians();
                let error = (launch.velocity - exact).abs();
                assert!(error < bound, "{percent} {touch:?}: {error}");
            }
        }
    }

    #[test]
    fn part_rests_where_the_contact_keeps_it() {
        let contact = ContactTime::build(0.1).unwrap();
        assert_eq!(contact.launch_speed(0.3, 0.02, 0.6), 0.0);
        assert!(contact.launch_speed(0.3, 0.02, 0.4) > 0.0);
        assert!(contact.launch_speed(0.3, 0.0, -0.4) > 0.0);
        assert_eq!(ContactTime::INSTANT.launch_speed(0.3, 0.02, 0.6), 0.02);
    }

    #[test]
    fn contacts_out_of_range_are_refused() {
        for bad in [-1e-9, 0.45, f64::NAN] {
            assert_eq!(ContactTime::build(bad).unwrap_err().parameter, "contact");
        }
        let refused = ContactTime::from_milliseconds(1.5, 50.0).unwrap_err();
        assert_eq!((refused.parameter, refused.value), ("contact", 1.5));
        assert!(ContactTime::from_milliseconds(1.4, 50.0).is_ok());
    }
}
