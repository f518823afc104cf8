//! Classification of an orbit over the impacts that are computed anyway.

use std::f64::consts::TAU;

use kband::impact::{Impact, OrbitEvent, PartState};
use kband::regime::classify::Regime;

use super::followed::{Followed, Said};
use super::{Endings, FOLLOWED};

/// Number of impacts for a classification: smallest; three times those of a verdict on chaos.
pub const SEEN: usize = 1500;

/// Observer of an orbit, event by event.
pub struct Seen<'a> {
    endings: &'a Endings,
    followed: Followed,
    /// Remaining impacts.
    left: usize,
    /// Time in rad since its begin.
    time: f64,
    /// Time in rad of the last lift-off.
    thrown: Option<f64>,
    /// Whether it may be extended once.
    again: bool,
    ending: Option<Regime>,
    gear: Option<u32>,
}

impl<'a> Seen<'a> {
    /// An observer on a track of [`Endings::seen`], over `impacts` impacts.
    pub fn new(endings: &'a Endings, impacts: usize) -> Self {
        Self {
            endings,
            followed: Followed::weighed_at(impacts),
            left: impacts,
            time: 0.0,
            thrown: None,
            again: true,
            ending: None,
            gear: None,
        }
    }

    /// The regime; `None` while it is open and impacts remain.
    pub fn ending(&self) -> Option<Regime> {
        self.ending
            .or((self.left == 0).then_some(Regime::Undecided))
    }

    /// Order of the gear in which the part is chaotic. If that gear does not hold it
    /// ([`Endings::holds`]), the chaos may be a transient.
    pub fn gear(&self) -> Option<u32> {
        self.gear
    }

    /// Takes the next event.
    pub fn take(&mut self, event: &OrbitEvent) {
        match event {
            OrbitEvent::Impact(impact) => self.impact(impact),
            OrbitEvent::Rest { chatter, .. } => {
                self.time += chatter;
                // Rest erases the history.
                self.followed = Followed::weighed_at(self.left);
            }
            OrbitEvent::LiftOff { wait, .. } => {
                self.time += wait;
                if let (None, Some(thrown)) = (self.ending, self.thrown) {
                    // The part rests again and again: all thrown parts fly alike.
                    let cycles = ((self.time - thrown) / TAU).round() as u32;
                    self.ending = Some(Regime::HopAndRest { cycles });
                }
                self.thrown = Some(self.time);
            }
        }
    }

    /// Takes an impact.
    #[inline]
    pub fn impact(&mut self, impact: &Impact<PartState>) {
        if self.ending.is_some() || self.left == 0 {
            return;
        }
        self.left -= 1;
        self.time += impact.flight;
        let mut said = self.followed.take(self.endings, impact);
        self.gear = None;
        if let Said::Asks(order) = said {
            self.gear = Some(order);
            said = Said::Ends(Regime::Chaotic);
        }
        self.ending = match said {
            Said::Ends(Regime::Chaotic | Regime::Undecided) if self.followed.settles() => {
                // No chaos, but slow: extended once by the number of impacts of the other verbs.
                if std::mem::replace(&mut self.again, false) {
                    self.left = FOLLOWED;
                    self.followed = Followed::weighed_at(FOLLOWED);
                }
                None
            }
            Said::Ends(end) => Some(end),
            _ => None,
        };
    }
}

#[cfg(test)]
mod tests {
    use kband::impact::{ContactTime, Orbit};
    use kband::regime::cascade::Cascade;
    use kband::regime::exponent::start_near_lock;

    use super::*;

    /// Observed regime of a part from rest.
    fn from_rest(k: f64, restitution: f64) -> Regime {
        let endings = Endings::seen(k, restitution, ContactTime::INSTANT).unwrap();
        let mut seen = Seen::new(&endings, SEEN);
        for event in Orbit::from_rest(endings.map()) {
            seen.take(&event);
            if seen.ending().is_some() {
                break;
            }
        }
        match seen.gear() {
            Some(order) if !endings.holds(order) => Regime::Undecided,
            _ => seen.ending().unwrap_or(Regime::Rest),
        }
    }

    #[test]
    fn beside_a_flip_nothing_is_chaos() {
        // At R = 0.2 the lock doubles at 0.39305.
        for n in 0..40 {
            let k = 0.3922 + 4e-5 * f64::from(n);
            let regime = from_rest(k, 0.2);
            assert_ne!(regime, Regime::Chaotic, "{k}");
        }
        assert_eq!(
            from_rest(0.3928, 0.2),
            Regime::Doubled {
                order: 1,
                doublings: 1
            }
        );
        assert_eq!(from_rest(0.35, 0.2), Regime::Chaotic);
        assert_eq!(from_rest(0.337, 0.2), Regime::Undecided);
    }

    #[test]
    fn each_doubling_has_the_period_between_its_flips() {
        let mut doubled = 0;
        for tenth in 1..=8 {
            let restitution = 0.1 * f64::from(tenth);
            let cascade = Cascade::locate(restitution, 1, 5).unwrap();
            for (window, doublings) in cascade.flips().windows(2).zip(1..) {
                // Within 1 % of a flip 1500 impacts do not decide.
                for n in 1..99 {
                    let k = window[1] + (window[0] - window[1]) * (f64::from(n) + 0.5) / 100.0;
                    let endings = Endings::seen(k, restitution, ContactTime::INSTANT).unwrap();
                    let orbit = Orbit::new(endings.map(), start_near_lock(endings.map(), 1));
                    let mut seen = Seen::new(&endings, SEEN);
                    for event in orbit {
                        seen.take(&event);
                        if seen.ending().is_some() {
                            break;
                        }
                    }
                    let ended = seen.ending();
                    if let Some(Regime::Doubled { .. }) = ended {
                        let wanted = Regime::Doubled {
                            order: 1,
                            doublings,
                        };
                        assert_eq!(ended, Some(wanted), "{k} {restitution}");
                        doubled += 1;
                    }
                }
            }
        }
        assert!(doubled > 2800, "{doubled} of 3136");
    }

    #[test]
    fn what_is_seen_to_end_ends_so() {
        let places: Vec<(f64, f64)> = (0..60)
            .map(|n| 0.31 + 0.012 * f64::from(n))
            .flat_map(|k| [(k, 0.2), (k, 0.6)])
            .collect();
        let followed = Endings::of_tracks(&places, FOLLOWED, ContactTime::INSTANT).unwrap();
        let mut open = 0;
        for ((k, restitution), followed) in places.into_iter().zip(followed) {
            match from_rest(k, restitution) {
                // These may still change.
                Regime::Chaotic | Regime::Undecided => open += 1,
                ending => assert_eq!(ending, followed.from_rest(), "{k} {restitution}"),
            }
        }
        assert!((1..40).contains(&open), "{open}");
    }
}
