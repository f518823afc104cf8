//! Displacement and time of an orbit (equations 10 and 11).

use crate::impact::{
    Along, ContactMotion, ContactTime, Impact, Observer, Orbit, OrbitMap, PartState, Tangential,
};

/// Displacement and time of an orbit along the track.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Conveyed {
    /// Number of impacts; the infinitely many impacts of a chatter in closed form are not counted.
    pub impacts: u64,
    /// Number of rests.
    pub rests: u64,
    /// Displacement along the track in units of b.
    pub distance: f64,
    /// Time in flight, chatter and contacts included, in rad of drive phase.
    pub flying: f64,
    /// Time at rest in rad of drive phase, sliding included.
    pub resting: f64,
    /// Time of sliding up the track in rad of drive phase.
    pub forward: f64,
    /// Time of sliding down the track in rad of drive phase.
    pub backward: f64,
    /// Sum of the mean velocities of the flights (symbol W, equation 11) in units of `b w`.
    velocities: f64,
}

impl Conveyed {
    /// Time mean of the velocity along the track in units of `b w`: displacement over time, rests
    /// included. `None` before any time has passed.
    pub fn time_mean(&self) -> Option<f64> {
        let time = self.flying + self.resting;
        (time > 0.0).then(|| self.distance / time)
    }

    /// Impact mean of the velocity in units of `b w`: the mean of W over flights, the paper's
    /// `<W>`. `None` after a rest, whose infinitely many short hops would dominate it.
    pub fn impact_mean(&self) -> Option<f64> {
        (self.impacts > 0 && self.rests == 0).then(|| self.velocities / self.impacts as f64)
    }

    /// Mean time between impacts (symbol D) in rad; `None` if the part came to rest.
    pub fn mean_interval(&self) -> Option<f64> {
        (self.impacts > 0 && self.rests == 0).then(|| self.flying / self.impacts as f64)
    }

    pub(crate) fn plus(&self, other: &Self) -> Self {
        Self {
            impacts: self.impacts + other.impacts,
            rests: self.rests + other.rests,
            distance: self.distance + other.distance,
            flying: self.flying + other.flying,
            resting: self.resting + other.resting,
            forward: self.forward + other.forward,
            backward: self.backward + other.backward,
            velocities: self.velocities + other.velocities,
        }
    }

    fn add_rest(&mut self, motion: &ContactMotion, time: f64) {
        self.distance += motion.distance;
        self.forward += motion.forward;
        self.backward += motion.backward;
        self.resting += time;
    }

    pub(super) fn from_contact_cycle(cycle: ContactMotion) -> Self {
        let mut conveyed = Self::default();
        conveyed.add_rest(&cycle, core::f64::consts::TAU);
        conveyed
    }
}

/// Observer that sums displacement and time of an orbit.
///
/// The velocity along the track (symbol phi) follows the law of the motion along it ([`Along`]).
/// With tangential restitution it is 0 at rest, so each lift-off starts the same orbit. The sums
/// after the first lift-off are kept apart: up to the second they are exactly one period. With
/// friction that holds once the velocity at lift-off has converged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conveying<A = Tangential> {
    along: A,
    /// k and restitution.
    part: [f64; 2],
    contact: ContactTime,
    pub(super) velocity: f64,
    rest_phase: f64,
    /// Sums up to the first lift-off.
    before: Conveyed,
    has_lifted_off: bool,
    /// Sums since the first lift-off; all sums if there was none.
    pub(super) conveyed: Conveyed,
}

impl<A: Along> Conveying<A> {
    /// Observer with this motion along the track, of an orbit on `map` whose impacts take no time,
    /// initially without velocity along the track.
    pub fn new<M: OrbitMap>(along: A, map: &M) -> Self {
        Self {
            along,
            part: map.parameters(),
            contact: ContactTime::INSTANT,
            velocity: 0.0,
            rest_phase: 0.0,
            before: Conveyed::default(),
            has_lifted_off: false,
            conveyed: Conveyed::default(),
        }
    }

    pub(super) fn of<M: OrbitMap>(along: A, orbit: &Orbit<'_, M>) -> Self {
        let mut conveying = Self::new(along, orbit.map);
        conveying.part[1] = orbit.restitution;
        conveying.contact = orbit.contact;
        conveying
    }

    /// Sums so far.
    pub fn conveyed(&self) -> Conveyed {
        self.before.plus(&self.conveyed)
    }

    /// Velocity along the track just after the last impact (symbol phi) in units of `b w`.
    pub fn velocity(&self) -> f64 {
        self.velocity
    }

    /// Clears the sums of the transient; the velocity remains.
    pub fn restart(&mut self) {
        self.has_lifted_off = false;
        (self.before, self.conveyed) = Default::default();
    }

    /// [`Conveying::restart`] just after a lift-off.
    pub(super) fn restart_at_lift_off(&mut self) {
        self.restart();
        self.has_lifted_off = true;
    }
}

impl<A: Along> Observer for Conveying<A> {
    #[inline]
    fn impact(&mut self, launch: PartState, impact: &Impact) {
        let (along, contact, [_, restitution]) = (&self.along, self.contact, self.part);
        let (distance, velocity) = if contact.is_instant() {
            along.move_in_flight(launch, impact, self.velocity)
        } else {
            along.move_through_contact(launch, impact, self.velocity, contact, restitution)
        };
        self.velocity = velocity;
        let sums = &mut self.conveyed;
        sums.distance += distance;
        sums.flying += impact.flight;
        sums.velocities += distance / impact.flight;
        sums.impacts += 1;
    }

    fn rest(&mut self, last: PartState, chatter: f64, phase: f64) {
        let (along, velocity) = (&self.along, self.velocity);
        let motion = along.move_in_chatter(self.part, last, chatter, velocity);
        self.velocity = motion.velocity;
        self.rest_phase = phase;
        // Sliding within the chatter counts as hopping.
        self.conveyed.distance += motion.distance;
        self.conveyed.flying += chatter;
        self.conveyed.rests += 1;
    }

    fn lift_off(&mut self, wait: f64, _: f64) {
        let (along, velocity) = (&self.along, self.velocity);
        let motion = along.move_in_contact(self.rest_phase, wait, velocity);
        self.conveyed.add_rest(&motion, wait);
        self.velocity = motion.velocity;
        if !self.has_lifted_off {
            self.before = core::mem::take(&mut self.conveyed);
            self.has_lifted_off = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::{Kernel, Map, TangentialSettings};

    const SETTINGS: TangentialSettings = TangentialSettings {
        restitution: 0.3,
        amplitude_ratio: 1.5,
        phase_lead: 0.3,
        incline_tangent: 0.05,
    };

    /// Displacement of a chatter in closed form and as the sum of its hops.
    #[test]
    fn closed_chatter_has_the_distance_of_its_hops() {
        let map = Map::build(0.9, 0.6).unwrap();
        let tangential = Tangential::build(0.9, SETTINGS).unwrap();
        let mut state = Map::state(4.0, 1e-6).unwrap();
        let chatter = map.time_to_rest(state).unwrap();
        let mut closed = Conveying::new(tangential, &map);
        closed.velocity = 0.8;
        let mut hops = closed;
        closed.rest(state, chatter, 0.0);
        for _ in 0..60 {
            let impact = map.impact(state);
            hops.impact(state, &impact);
            state = impact.next;
        }
        let (closed, hops) = (closed.conveyed(), hops.conveyed());
        // Second order: the track's motion (1.5) over the chatter squared (1e-11).
        assert!((closed.distance - hops.distance).abs() < 2.0 * chatter * chatter);
        assert!(closed.distance > 1e3 * chatter * chatter);
        assert!((closed.flying / hops.flying - 1.0).abs() < 1e-9);
    }
}
