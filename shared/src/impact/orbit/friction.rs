//! Motion along the track with Coulomb friction: one event map for stick, slide, flight and impact.
//!
//! Method: docs/theory-real-parts.md#t10.4.

use super::along::{Along, ContactMotion, accept_motion};
use super::push::{Push, first_zero};
use crate::feeder::{OutOfRange, Track, accept_in};
use crate::impact::kernel::{Impact, PartState};
use crate::impact::wave::Wave;

/// Parameters of the motion along the track besides k, with friction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrictionSettings {
    /// Static friction coefficient (symbol mu_s), `sliding`..=10.
    pub sticking: f64,
    /// Kinetic friction coefficient of a sliding or striking part (symbol mu), 0..=10.
    pub sliding: f64,
    /// Amplitude parallel to the track over the amplitude normal to it (symbol eta), 0..=100.
    pub amplitude_ratio: f64,
    /// Phase lead of the parallel motion (symbol gamma) in rad, -2 pi..=2 pi.
    pub phase_lead: f64,
    /// Tangent of the incline, -2..=2, positive where parts climb.
    pub incline_tangent: f64,
}

impl FrictionSettings {
    /// The settings of parts with these coefficients on `track`.
    pub fn on(track: &Track, sticking: f64, sliding: f64) -> Self {
        Self {
            sticking,
            sliding,
            amplitude_ratio: track.amplitude_ratio(),
            phase_lead: track.phase_lead(),
            incline_tangent: track.incline_tangent(),
        }
    }

    fn check(&self, k: f64) -> Result<(), OutOfRange> {
        let (eta, lead) = (self.amplitude_ratio, self.phase_lead);
        accept_motion(k, eta, lead, self.incline_tangent)?;
        accept_in("friction", self.sliding, 0.0..=10.0, "0..10")?;
        let (range, accepted) = (
            self.sliding..=10.0,
            "the friction of sliding..10: a part at rest holds at least as well as one that slides",
        );
        accept_in("sticking friction", self.sticking, range, accepted)?;
        Ok(())
    }

    /// Velocity along the track after an impact with a normal impulse per mass. A free part gains
    /// `gains`, during the force and after it: 0 if the impact has no duration. All in one unit.
    /// Mean velocities of integrated contacts of 2 % of a cycle are met within 0.1 `b w`.
    pub fn velocity_after_impact(&self, velocity: f64, impulse: f64, gains: [f64; 2]) -> f64 {
        let [pressed, free] = gains;
        // The force holds a part, unless it slides through the impact.
        let direction = libm::copysign(f64::from(velocity != 0.0), velocity);
        let speed = direction * (velocity + pressed) - self.sliding * impulse.max(0.0);
        direction * speed.max(0.0) + free
    }

    /// Velocity along the track that a chatter removes less than a contact of the same duration.
    pub fn chatter_velocity_excess(&self, velocity: f64, normal: f64) -> f64 {
        if velocity == 0.0 {
            0.0
        } else {
            libm::copysign(self.sliding * normal, velocity)
        }
    }

    /// Throw number (1/k) above which a part at rest slides up, or down; `None` if it never slides.
    ///
    /// `(mu_s +- T)` over the maximum of `mu_s A(tau) +- eta A(tau + gamma)`. On a sine that is
    /// `|mu_s +- eta e^(i gamma)|`, at gamma = 0 Boothroyd's limits.
    pub fn sliding_throw_number(&self, wave: &Wave, upwards: bool) -> Option<f64> {
        let c = if upwards { 1.0 } else { -1.0 };
        let eta = c * self.amplitude_ratio;
        let push = if wave.is_sine() {
            let (sine, cosine) = libm::sincos(self.phase_lead);
            libm::hypot(self.sticking + eta * cosine, eta * sine)
        } else {
            let along = Push::new(wave, eta, self.phase_lead, 0.0);
            let normal = Push::new(wave, 1.0, 0.0, 0.0);
            along.plus(self.sticking, &normal).maximum()
        };
        let hold = self.sticking + c * self.incline_tangent;
        (push > 0.0).then(|| (hold / push).max(0.0))
    }
}

/// The motion along the track for one k, with friction. Velocities relative to the track in `b w`.
///
/// In contact the normal force is `N = k - A`, with `A = sin tau` on one tone. The push on a part
/// at rest is `f = eta A(tau + gamma) - k tan(alpha)`; it sticks while `|f| <= mu_s N`. A part that
/// slides in direction c has `v'' = f - c mu N`, in closed form until v' is 0. An impact removes
/// `mu` times its normal impulse: `phi' = sgn(phi) max(0, |phi| - mu (s + psi'))`. While c does not
/// change, `v' + c mu u'` is independent of the contact force.
///
/// Event phases have an error below 1e-14 rad; the steps cannot jump over an event.
///
/// ```
/// use kband::impact::{Friction, FrictionSettings};
///
/// // A track too weak to throw (k > 1) still conveys: throw number 0.6, throw angle 30 degrees.
/// let along = Friction::build(1.0 / 0.6, FrictionSettings {
///     sticking: 0.8,
///     sliding: 0.8,
///     amplitude_ratio: 3.0_f64.sqrt(),
///     phase_lead: 0.0,
///     incline_tangent: 3.0_f64.to_radians().tan(),
/// })?;
/// let cycle = along.steady_contact_cycle().expect("it settles");
/// assert!((cycle.distance / core::f64::consts::TAU - 0.386_499).abs() < 1e-6);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Friction {
    settings: FrictionSettings,
    /// `f`, the acceleration of a free part relative to the track.
    free: Push,
    /// `A - k`: minus the normal force in contact, and u'' in flight.
    normal: Push,
}

/// Friction state of a part in contact; `Sliding` holds the direction c.
#[derive(Clone, Copy, Debug, PartialEq)]
enum FrictionState {
    Sticking,
    Sliding(f64),
}

impl Friction {
    /// The motion along a sinusoidal track at `k`, 0.001..=1000; an error names the parameter out
    /// of range.
    pub fn build(k: f64, settings: FrictionSettings) -> Result<Self, OutOfRange> {
        Self::on(&Wave::sine(), k, settings)
    }

    /// The motion along a track of several tones: `eta` times the normal one, led by gamma.
    pub fn on(wave: &Wave, k: f64, settings: FrictionSettings) -> Result<Self, OutOfRange> {
        settings.check(k)?;
        let (eta, gravity) = (settings.amplitude_ratio, k * settings.incline_tangent);
        Ok(Self {
            settings,
            free: Push::new(wave, eta, settings.phase_lead, gravity),
            normal: Push::new(wave, 1.0, 0.0, k),
        })
    }

    /// Distance in b and velocity in `b w` before the impact, after a flight of `d` rad from
    /// `phase`.
    pub fn motion_before_impact(&self, phase: f64, d: f64, velocity: f64) -> (f64, f64) {
        self.free.advance(phase, d, velocity)
    }

    /// Speed normal to the track at the end of a flight, in `b w`.
    fn arrival_speed(&self, launch: PartState, flight: &Impact) -> f64 {
        let arrival = -(launch.velocity + self.normal.velocity(launch.phase, flight.flight));
        arrival.max(0.0)
    }

    fn sliding_acceleration(&self, c: f64) -> Push {
        self.free.plus(c * self.settings.sliding, &self.normal)
    }

    /// Margin of static friction over the push in direction c: `mu_s N - c f`.
    fn static_friction_margin(&self, c: f64) -> Push {
        Push::default()
            .plus(-self.settings.sticking, &self.normal)
            .plus(-c, &self.free)
    }

    fn friction_state_at_rest(&self, phase: f64) -> FrictionState {
        let free = self.free.at(phase);
        let hold = -self.settings.sticking * self.normal.at(phase);
        if free.abs() > hold {
            FrictionState::Sliding(if free > 0.0 { 1.0 } else { -1.0 })
        } else {
            FrictionState::Sticking
        }
    }

    /// A contact from `phase` on for `duration` rad, with initial `velocity`.
    pub fn move_in_contact(&self, phase: f64, duration: f64, velocity: f64) -> ContactMotion {
        /// Phase step in rad past an event where the push only touches the friction limit.
        const TOUCH_PHASE_STEP: f64 = 1e-7;
        let mut motion = ContactMotion {
            velocity,
            ..ContactMotion::default()
        };
        let (mut at, mut remaining) = (phase, duration);
        let mut state = if velocity == 0.0 {
            self.friction_state_at_rest(at)
        } else {
            FrictionState::Sliding(if velocity > 0.0 { 1.0 } else { -1.0 })
        };
        while remaining > 0.0 {
            match state {
                FrictionState::Sticking => {
                    let until = |c: f64| {
                        let slack = self.static_friction_margin(c);
                        first_zero(remaining, slack.bound(2), |d| {
                            (slack.at(at + d), slack.slope(at + d))
                        })
                        .map(|d| (d, c))
                    };
                    let next = match (until(1.0), until(-1.0)) {
                        (Some(one), Some(other)) if other.0 < one.0 => Some(other),
                        (Some(one), _) => Some(one),
                        (None, other) => other,
                    };
                    let Some((d, c)) = next else { break };
                    (at, remaining) = (at + d, remaining - d);
                    state = FrictionState::Sliding(c);
                }
                FrictionState::Sliding(c) => {
                    let push = self.sliding_acceleration(c);
                    let begun = c * motion.velocity;
                    // At the start of a slide velocity and push may be 0; then the push's slope
                    // gives the first distance.
                    let slope = c * push.slope(at);
                    let lead = if begun <= 0.0 && c * push.at(at) <= 1e-9 {
                        (1.5 * slope / push.bound(2).max(f64::MIN_POSITIVE)).clamp(0.0, remaining)
                    } else {
                        0.0
                    };
                    let speed = |d: f64| {
                        let d = lead + d;
                        (begun + c * push.velocity(at, d), c * push.at(at + d))
                    };
                    let d = if speed(0.0).0 < 0.0 {
                        0.0
                    } else {
                        let stop = first_zero(remaining - lead, push.bound(1), speed);
                        stop.map_or(remaining, |d| lead + d)
                    };
                    let stopped = d < remaining;
                    let (displacement, gained) = push.integrals(at, d);
                    motion.distance += motion.velocity * d + displacement;
                    motion.velocity += gained;
                    if stopped {
                        motion.velocity = 0.0;
                    }
                    if c > 0.0 {
                        motion.forward += d;
                    } else {
                        motion.backward += d;
                    }
                    (at, remaining) = (at + d, remaining - d);
                    if stopped {
                        state = self.friction_state_at_rest(at);
                        if d < TOUCH_PHASE_STEP {
                            let touch = TOUCH_PHASE_STEP.min(remaining);
                            (at, remaining) = (at + touch, remaining - touch);
                        }
                    }
                }
            }
        }
        motion
    }

    /// One drive cycle once the motion repeats; `None` if the part slides off or is thrown.
    pub fn steady_contact_cycle(&self) -> Option<ContactMotion> {
        /// Drive cycles before the motion counts as unsteady. A slide that stops erases the
        /// history; one that never stops settles by its own damping.
        const MAX_CYCLES: usize = 20_000;
        if !self.can_be_steady() || (self.normal.bound(0) > 0.0 && self.throws()) {
            return None;
        }
        let mut velocity = 0.0;
        for _ in 0..MAX_CYCLES {
            let cycle = self.move_in_contact(0.0, core::f64::consts::TAU, velocity);
            if (cycle.velocity - velocity).abs() <= 1e-14 {
                return Some(cycle);
            }
            velocity = cycle.velocity;
        }
        None
    }

    /// Whether the normal force falls below 0 somewhere in a cycle.
    fn throws(&self) -> bool {
        // Starts at a phase where gravity holds the part down.
        let up = |d: f64| (-self.normal.at(d), -self.normal.slope(d));
        if up(0.0).0 < 0.0 {
            return true;
        }
        match first_zero(core::f64::consts::TAU, self.normal.bound(2), up) {
            // A force that only touches 0 throws nothing.
            Some(d) => self.normal.at(d + 1e-6) > 1e-12,
            None => false,
        }
    }
}

impl Along for Friction {
    const REST_ERASES_HISTORY: bool = false;

    fn move_in_flight(&self, launch: PartState, impact: &Impact, velocity: f64) -> (f64, f64) {
        let (distance, arriving) = self.arrive(launch, impact, velocity);
        let impulse = self.arrival_speed(launch, impact) + impact.next.velocity;
        let after = self
            .settings
            .velocity_after_impact(arriving, impulse, [0.0; 2]);
        (distance, after)
    }

    fn arrive(&self, launch: PartState, flight: &Impact, velocity: f64) -> (f64, f64) {
        self.motion_before_impact(launch.phase, flight.flight, velocity)
    }

    fn rebound(&self, from: PartState, touch: &Impact, v: f64, c: f64, gains: [f64; 2]) -> f64 {
        let pull = -self.normal.at(touch.next.phase);
        let impulse = self.arrival_speed(from, touch) + touch.next.velocity + c * pull;
        self.settings.velocity_after_impact(v, impulse, gains)
    }

    fn push(&self, phase: f64) -> f64 {
        self.free.at(phase)
    }

    fn move_in_chatter(
        &self,
        _: [f64; 2],
        last: PartState,
        chatter: f64,
        velocity: f64,
    ) -> ContactMotion {
        // Over its duration the impacts push like a contact, except for the part's initial normal
        // velocity. Their impulses sum to the integral of N less psi.
        let settings = &self.settings;
        let excess = settings.chatter_velocity_excess(velocity, last.velocity);
        self.move_in_contact(last.phase, chatter, velocity + excess)
    }

    fn move_in_contact(&self, phase: f64, wait: f64, velocity: f64) -> ContactMotion {
        Friction::move_in_contact(self, phase, wait, velocity)
    }

    /// The mean normal force is `k` for any motion, so friction holds an incline of at most `mu_s`.
    fn can_be_steady(&self) -> bool {
        self.settings.incline_tangent.abs() <= self.settings.sticking
    }

    fn steady_cycle(&self) -> Option<ContactMotion> {
        self.steady_contact_cycle()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(eta: f64, mu: f64, degrees: f64) -> FrictionSettings {
        FrictionSettings {
            sticking: mu,
            sliding: mu,
            amplitude_ratio: eta,
            phase_lead: 0.0,
            incline_tangent: libm::tan(degrees.to_radians()),
        }
    }

    fn cycle(throw: f64, settings: FrictionSettings) -> ContactMotion {
        let along = Friction::build(1.0 / throw, settings).unwrap();
        along.steady_contact_cycle().unwrap()
    }

    /// Boothroyd's limits: forward above (mu + T)/(eta + mu), backward above (mu - T)/(eta - mu).
    #[test]
    fn sliding_begins_at_its_thresholds() {
        let case = settings(1.0 / libm::tan(30_f64.to_radians()), 0.8, 3.0);
        let (tangent, eta, mu) = (case.incline_tangent, case.amplitude_ratio, case.sliding);
        let forward = (mu + tangent) / (eta + mu);
        let backward = (mu - tangent) / (eta - mu);
        assert!((forward - 0.336_647).abs() < 1e-6 && (backward - 0.802_094).abs() < 1e-6);
        for (upwards, closed) in [(true, forward), (false, backward)] {
            let from = case.sliding_throw_number(&Wave::sine(), upwards);
            assert!((from.unwrap() - closed).abs() < 1e-15);
        }
        // With a phase lead: against the contact itself.
        for lead in [-1.0, 0.5, 2.0] {
            let mut led = case;
            led.phase_lead = lead;
            let from = led.sliding_throw_number(&Wave::sine(), true).unwrap();
            assert_eq!(cycle(from - 1e-6, led).forward, 0.0, "{lead}");
            assert!(cycle(from + 1e-4, led).forward > 0.0, "{lead}");
        }
        assert_eq!(cycle(backward - 1e-6, case).backward, 0.0);
        assert!(cycle(backward + 1e-3, case).backward > 0.0);
        // A part with more static friction starts to slide later, but then slides in the same way.
        let mut sticky = case;
        sticky.sticking = 1.0;
        let threshold = (1.0 + tangent) / (eta + 1.0);
        assert_eq!(cycle(threshold - 1e-6, sticky).distance, 0.0);
        assert!(cycle(threshold + 1e-6, sticky).distance > 1e-2);
    }

    #[test]
    fn settings_out_of_range_are_named() {
        for (sticking, sliding, parameter) in
            [(0.2, 0.3, "sticking friction"), (0.3, -0.1, "friction")]
        {
            let mut settings = settings(1.5, sliding, 3.0);
            settings.sticking = sticking;
            let refused = Friction::build(0.5, settings).unwrap_err();
            assert_eq!(refused.parameter, parameter);
        }
        // An incline that friction cannot hold has no steady speed.
        let too_steep = Friction::build(1.5, settings(1.5, 0.1, 20.0)).unwrap();
        assert!(too_steep.steady_contact_cycle().is_none());
    }
}
