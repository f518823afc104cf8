//! Contact that takes time: the impact map to first order in the contact time
//! (docs/theory-real-parts.md#t10.6).
//!
//! The contact is a linear spring and dashpot (Kelvin-Voigt model). Inputs are restitution, k, and
//! the state at the touch; the output is the state at the launch. Times are in rad of the drive's
//! phase, velocities in `b w`.

use core::f64::consts::TAU;

use crate::arithmetic::square_root_single;
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

    /// State after the contact of a part that touched the track in the state `impact_state`. The
    /// state holds the phase, and R s as the velocity. `k` is the track's; without a `wave` the
    /// track moves sinusoidally.
    ///
    /// The velocity is 0 if the part rests.
    pub fn launch(
        self,
        restitution: f64,
        impact_state: PartState,
        k: f64,
        wave: Option<&Wave>,
    ) -> PartState {
        let phase = in_turn(impact_state.phase + self.radians);
        let push = wave.map_or_else(|| libm::sin(phase), |wave| wave.push(phase));
        let speed = self.launch_speed(restitution, impact_state.velocity, k - push);
        PartState::new(phase, speed)
    }

    /// `impact`, which ends at the touch, with its contact, on a track with this k (`None`: a
    /// sine).
    ///
    /// The flight then includes the contact, and the next state is the launch after it. A part that
    /// rests (flight 0) has none.
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

/// The contact itself, integrated: the reference of the tests.
#[cfg(test)]
pub(crate) mod spring {
    use core::f64::consts::PI;

    use crate::impact::PartState;

    /// A part on a linear spring and dashpot that never pulls, at rest at the displacement 0.
    pub(crate) struct Spring {
        /// Squared frequency, and twice the decay rate.
        stiffness: f64,
        damping: f64,
        duration: f64,
    }

    impl Spring {
        /// The contact with this restitution (0.01..1) and duration in rad, without other forces.
        /// Let x be the decay rate over the frequency. The force ends after `pi - 2 atan x` of the
        /// oscillation, `-ln R = x (pi - 2 atan x)`. The part is back at 0 after `2 x/(1 + x^2)`
        /// more. Below `R = exp(-2)` the contact is overdamped; then q is the ratio of its rates,
        /// and `R = q^((1+q)/(1-q))`.
        pub(crate) fn new(restitution: f64, duration: f64) -> Self {
            let solve = |high: f64, falls: bool, of: &dyn Fn(f64) -> f64| {
                let (mut low, mut high) = (1e-12, high);
                for _ in 0..200 {
                    let middle = libm::sqrt(low * high);
                    if (of(middle) > restitution) == falls {
                        low = middle;
                    } else {
                        high = middle;
                    }
                }
                low
            };
            if restitution > libm::exp(-2.0) {
                let forced = |x: f64| PI - 2.0 * libm::atan(x);
                let x = solve(1e4, true, &|x| libm::exp(-x * forced(x)));
                let frequency = (forced(x) + 2.0 * x / (1.0 + x * x)) / duration;
                return Self {
                    stiffness: (1.0 + x * x) * frequency * frequency,
                    damping: 2.0 * x * frequency,
                    duration,
                };
            }
            let q = solve(1.0 - 1e-9, false, &|q| libm::pow(q, (1.0 + q) / (1.0 - q)));
            let mean_rate = (1.0 + q - 2.0 * q * libm::log(q) / (1.0 - q)) / duration;
            Self {
                stiffness: mean_rate * mean_rate / q,
                damping: mean_rate + mean_rate / q,
                duration,
            }
        }

        /// The launch after an arrival with `speed` at `phase`, and the contact's duration; `None`
        /// if the part stays for three contact times. `track` gives S, S' and A at a phase; `watch`
        /// gets the phase, duration and mean force of each step. Fourth-order Runge-Kutta steps of
        /// 1/400 of the contact, then the free flight back to 0.
        pub(crate) fn launch(
            &self,
            track: &impl Fn(f64) -> [f64; 3],
            k: f64,
            phase: f64,
            speed: f64,
            mut watch: impl FnMut(f64, f64, f64),
        ) -> Option<(PartState, f64)> {
            let step = self.duration / 400.0;
            let pull = |time: f64| k - track(phase + time)[2];
            let force = |[u, v]: [f64; 2]| -self.stiffness * u - self.damping * v;
            let (mut at, mut time) = ([0.0, -speed], 0.0);
            while time < 3.0 * self.duration {
                let [pull_0, pull_1, pull_2] = [0.0, 0.5, 1.0].map(|part| pull(time + part * step));
                let rate = |at: [f64; 2], pull: f64| [at[1], force(at) - pull];
                let ahead = |by: [f64; 2], step: f64| [0, 1].map(|n| at[n] + step * by[n]);
                let first = rate(at, pull_0);
                let second = rate(ahead(first, 0.5 * step), pull_1);
                let third = rate(ahead(second, 0.5 * step), pull_1);
                let fourth = rate(ahead(third, step), pull_2);
                let sum = [0, 1].map(|n| first[n] + 2.0 * (second[n] + third[n]) + fourth[n]);
                let next = ahead(sum, step / 6.0);
                let (before, after) = (force(at), force(next));
                if after <= 0.0 {
                    let part = before / (before - after);
                    let end = [0, 1].map(|n| at[n] + part * (next[n] - at[n]));
                    watch(phase + time, part * step, 0.5 * before);
                    time += part * step;
                    let (launch, duration) = self.fly_free(track, k, phase, time, end)?;
                    watch(phase + time, duration - time, 0.0);
                    return Some((launch, duration));
                }
                watch(phase + time, step, 0.5 * (before + after));
                at = next;
                time += step;
            }
            None
        }

        /// From the end of the force to displacement 0.
        fn fly_free(
            &self,
            track: &impl Fn(f64) -> [f64; 3],
            k: f64,
            phase: f64,
            time: f64,
            [u, v]: [f64; 2],
        ) -> Option<(PartState, f64)> {
            let [height, rise, _] = track(phase + time);
            let at = |d: f64| {
                let [s, c, _] = track(phase + time + d);
                let fallen = u + (v + rise) * d - 0.5 * k * d * d - (s - height);
                [fallen, v + rise - k * d - c]
            };
            let end = (1..=800).find(|n| at(f64::from(*n) * self.duration / 400.0)[0] >= 0.0)?;
            let mut d = f64::from(end) * self.duration / 400.0;
            for _ in 0..8 {
                let [height, speed] = at(d);
                d -= height / speed;
            }
            let launch = PartState::new(phase + time + d, at(d)[1]);
            Some((launch, time + d))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::spring::Spring;
    use super::*;
    use crate::impact::Tone;

    /// Gain of the contact itself, from a weak constant acceleration.
    fn exact_gain(restitution: f64) -> f64 {
        // On a track at rest (k alone) the launch speed falls by rho c k.
        let (still, k) = (|_: f64| [0.0; 3], 1e-4);
        let spring = Spring::new(restitution, 1.0);
        let launch = |k| spring.launch(&still, k, 0.0, 1.0, |_, _, _| {});
        let [free, pulled] = [0.0, k].map(|k| launch(k).unwrap().0);
        let error = free.velocity - restitution;
        assert!(error.abs() < 2e-5, "{restitution} {free:?}");
        assert!((free.phase - 1.0).abs() < 1e-4, "{restitution} {free:?}");
        (free.velocity - pulled.velocity) / k
    }

    #[test]
    fn gain_is_that_of_the_contact() {
        for n in 1..=19 {
            let restitution = 0.05 * f64::from(n);
            let fit = f64::from(speed_gain(restitution as f32));
            let exact = exact_gain(restitution);
            assert!((fit - exact).abs() < 0.01, "{restitution}: {fit} {exact}");
        }
        assert_eq!([speed_gain(0.0), speed_gain(1.0)], [1.0, 0.0]);
    }

    /// Errors of launch speed and phase over (c, c^2): the omitted second order.
    #[test]
    fn first_order_is_that_of_the_integrated_contact() {
        let second = Wave::build(Tone::new(0.15, 2.356), Tone::default()).unwrap();
        for (wave, [largest, rms, bias, max_delay]) in [
            (Wave::sine(), [6.5, 0.8, 0.3, 0.6]),
            (second, [16.0, 1.3, 0.5, 1.0]),
        ] {
            let track = |phase: f64| {
                let [s, c, a, _] = wave.motion(phase);
                [s, c, a]
            };
            for percent in [0.25, 0.5, 1.0, 2.0, 4.0, 7.0] {
                let contact = ContactTime::build(percent * 0.01 * TAU).unwrap();
                let c = contact.radians();
                let (mut max, mut count) = (0.0_f64, 0.0);
                let [mut sum, mut squares, mut delays] = [0.0; 3];
                for tenth in 1..=6 {
                    let restitution = 0.1 * f64::from(tenth);
                    let spring = Spring::new(restitution, c);
                    for step in 0..8 {
                        let k = 0.25 + 0.05 * f64::from(step);
                        for n in 0..24 {
                            let phase = f64::from(n) * TAU / 24.0;
                            // Arrival speed of a lock.
                            let speed = TAU * k / (1.0 + restitution);
                            let exact = spring.launch(&track, k, phase, speed, |_, _, _| {});
                            let pull = k - wave.push(phase + c);
                            let touch = restitution * speed;
                            let actual = contact.launch_speed(restitution, touch, pull);
                            let error = actual - exact.map_or(0.0, |(launch, _)| launch.velocity);
                            let added = exact.map_or(0.0, |(_, duration)| duration - c);
                            max = max.max(error.abs());
                            sum += error;
                            squares += error * error;
                            delays += added * added;
                            count += 1.0;
                        }
                    }
                }
                let [deviation, delay] = [squares, delays].map(|sum| libm::sqrt(sum / count));
                let errors = [max, deviation, (sum / count).abs(), delay];
                std::println!("{percent} %: speed max, rms, bias, phase rms {errors:.5?}");
                let bounds = [largest, rms, bias, max_delay].map(|bound| bound * c * c);
                let mut pairs = errors.into_iter().zip(bounds);
                assert!(pairs.all(|(error, bound)| error < bound));
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
