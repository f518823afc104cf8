//! Measurement of the conveying speed of one orbit after its transient.

use super::conveyed::{Conveyed, Conveying};
use crate::impact::{Along, Observer, Orbit, OrbitMap, PartState, StopReason};

/// Mean time between rests, in rad, from which a part counts as hopping. A rest is shorter than a
/// drive period, so below 1 % of the time is spent at rest.
const MIN_TIME_BETWEEN_RESTS: f64 = 100.0 * core::f64::consts::TAU;

/// Periods within which a velocity damped by friction alone converges.
pub(super) const CONVERGENCE_PERIODS: usize = 500;

/// Length of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Effort {
    /// Impacts discarded as transient.
    pub settle: u64,
    /// Impacts measured.
    pub impacts: u64,
}

/// Start of an orbit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Origin {
    /// The part lies on the track.
    Rest,
    /// The part has just hit the track.
    Hop(PartState),
}

impl Origin {
    /// The orbit from here.
    pub fn orbit<M: OrbitMap>(self, map: &M) -> Orbit<'_, M> {
        match self {
            Self::Rest => Orbit::from_rest(map),
            Self::Hop(state) => Orbit::new(map, state),
        }
    }
}

/// Long-term motion of a part, as far as conveying is concerned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// It hops, for at least 100 drive cycles between rests. In wide chaos rare rests occur (at R =
    /// 0.9, k = 0.05 one in about 40 000 impacts) without effect.
    Hopping,
    /// It hops, rests and is thrown off again, every few drive cycles.
    HopAndRest,
    /// It never leaves the track, with or without sliding.
    Rest,
}

/// Result of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Motion of the part.
    pub motion: Motion,
    /// Sums over exactly one period if the part came to rest twice, else over the requested
    /// impacts. Zero for a part that stays or accelerates for ever.
    pub conveyed: Conveyed,
}

/// Simulates an orbit through its transient and measures its conveying speed; `also` also observes
/// the measured part of the orbit.
///
/// With random restitution it measures the requested impacts, because nothing repeats.
pub fn measure(
    mut orbit: Orbit<'_>,
    along: impl Along,
    effort: Effort,
    also: &mut impl Observer,
) -> Measured {
    let mut conveying = Conveying::of(along, &orbit);
    orbit.watch(effort.settle, &mut conveying);
    conveying.restart();
    let (ended, steady) = measure_until_steady(&mut orbit, along, &mut conveying, effort, also);
    let conveyed = match ended {
        StopReason::Repeats => conveying.conveyed,
        StopReason::RestsForEver | StopReason::Counted => conveying.conveyed(),
    };
    classify_run(ended, conveyed, steady, along)
}

/// Result of a run; `steady` means that its velocity along the track has converged.
pub(super) fn classify_run(
    ended: StopReason,
    mut conveyed: Conveyed,
    steady: bool,
    along: impl Along,
) -> Measured {
    if ended == StopReason::RestsForEver {
        let cycle = along.steady_cycle().map(Conveyed::from_contact_cycle);
        return Measured {
            motion: Motion::Rest,
            conveyed: cycle.unwrap_or_default(),
        };
    }
    let time = conveyed.flying + conveyed.resting;
    let motion = if time < MIN_TIME_BETWEEN_RESTS * conveyed.rests as f64 {
        Motion::HopAndRest
    } else {
        Motion::Hopping
    };
    // A part that accelerates for ever has no speed.
    if !(steady && along.can_be_steady()) {
        conveyed = Conveyed::default();
    }
    Measured { motion, conveyed }
}

/// Observes the measured run; returns whether the velocity along the track has converged. With
/// friction it converges later than the flights, so the run is repeated.
fn measure_until_steady<A: Along>(
    orbit: &mut Orbit<'_>,
    along: A,
    conveying: &mut Conveying<A>,
    effort: Effort,
    also: &mut impl Observer,
) -> (StopReason, bool) {
    let mut steady = true;
    if !A::REST_ERASES_HISTORY && along.can_be_steady() {
        for _ in 0..CONVERGENCE_PERIODS {
            let before = conveying.velocity();
            let ended = orbit.watch_period(effort.impacts, conveying);
            conveying.restart();
            steady = ended != StopReason::Repeats || (conveying.velocity() - before).abs() <= 1e-12;
            if steady {
                break;
            }
        }
    }
    let ended = orbit.watch_period(effort.impacts, &mut (conveying, also));
    (ended, steady)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::{ContactTime, Kernel, Map, Tangential, TangentialSettings};
    use crate::regime::Lock;
    use crate::transport::locked;

    /// Parameters of the paper's section on chaotic conveying (docs/theory-transport.md#t8.2).
    const CHAOTIC_SETTINGS: TangentialSettings = TangentialSettings {
        restitution: 0.3,
        amplitude_ratio: 2.0,
        phase_lead: 0.0,
        incline_tangent: 0.05,
    };

    #[test]
    fn motions_are_classified() {
        let (settle, impacts) = (200, 1000);
        let effort = Effort { settle, impacts };
        let hop = |phase, velocity| Origin::Hop(Map::state(phase, velocity).unwrap());
        for (k, restitution, origin, motion) in [
            // At k = 0.43 a part from rest chatters to rest every three cycles; one that starts on
            // the lock stays there (docs/theory-capture.md#t7.1).
            (0.43, 0.2, Origin::Rest, Motion::HopAndRest),
            (0.43, 0.2, hop(0.457, 0.45), Motion::Hopping),
            (1.5, 0.5, Origin::Rest, Motion::Rest),
            (1.5, 0.5, hop(1.0, 2.0), Motion::Rest),
        ] {
            let map = Map::build(k, restitution).unwrap();
            let along = Tangential::build(k, CHAOTIC_SETTINGS).unwrap();
            let actual = measure(origin.orbit(&map), along, effort, &mut ());
            assert_eq!(actual.motion, motion, "{k} {origin:?}");
            let has_mean = actual.conveyed.time_mean().is_some();
            assert_eq!(has_mean, motion != Motion::Rest, "{k} {origin:?}");
        }
    }

    /// In lock the speed is the closed form, and 0 on the critical slope.
    #[test]
    fn speed_in_lock_is_the_closed_form() {
        let (settle, impacts) = (400, 400);
        let effort = Effort { settle, impacts };
        for (k, restitution, order, percent) in [
            (0.43, 0.2, 1, 0.0),
            (0.43, 0.2, 1, 1.0),
            (0.56, 0.35, 1, 2.0),
            (0.7, 0.5, 1, 4.0),
            (0.23, 0.2, 2, 2.0),
        ] {
            let contact = ContactTime::build(percent * 0.01 * core::f64::consts::TAU).unwrap();
            let lock = Lock::with_contact(k, restitution, order, contact);
            let lock = lock.unwrap().unwrap();
            let map = Map::build(k, restitution).unwrap();
            let mut settings = CHAOTIC_SETTINGS;
            settings.phase_lead = 0.4;
            let mut critical = settings;
            critical.incline_tangent = locked::critical_slope(&lock, k, &settings);
            for settings in [settings, critical] {
                let along = Tangential::build(k, settings).unwrap();
                let orbit = Orbit::new(&map, lock.state()).with_contact(contact);
                let actual = measure(orbit, along, effort, &mut ()).conveyed;
                let expected = locked::velocity(&lock, k, &settings);
                let error = actual.time_mean().unwrap() - expected;
                assert!(error.abs() < 1e-9, "{k} {percent}: {error}");
            }
            assert!(locked::velocity(&lock, k, &critical).abs() < 1e-12);
        }
    }
}
