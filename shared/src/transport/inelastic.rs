//! Perfectly inelastic limit, R and Rt to 0: a one-dimensional map (equation 38;
//! docs/theory-transport.md#t8.9).

use crate::feeder::OutOfRange;
use crate::impact::{Contact, Kernel, Map, PartState};

/// Map of parts without restitution. Each flight begins with psi = 0 and phi = 0, so the launch
/// phase is the only state.
///
/// ```
/// use kband::transport::Inelastic;
///
/// let inelastic = Inelastic::build(0.6)?;
/// let flight = inelastic.flight(inelastic.lift_off().unwrap()).unwrap();
/// // A flight ends where u = 0: cos(t) d - k d^2/2 = sin(t + d) - sin t, from sin t = k.
/// let (t, d) = (0.6_f64.asin(), flight.flight);
/// assert!((t.cos() * d - 0.3 * d * d - (t + d).sin() + 0.6).abs() < 1e-14);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inelastic {
    map: Map,
    contact: Contact,
}

/// One flight of a part without restitution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InelasticFlight {
    /// Duration of the flight in rad.
    pub flight: f64,
    /// Landing phase in rad, 0..2 pi.
    pub landing: f64,
    /// Rest before the next launch in rad; 0 if the track throws at once.
    pub wait: f64,
    /// Phase of the next launch in rad, `arcsin k ..= pi - arcsin k`.
    pub next: f64,
}

impl Inelastic {
    /// Map at `k` (0.001..=1000); an error for a value out of range.
    pub fn build(k: f64) -> Result<Self, OutOfRange> {
        let map = Map::build(k, 0.0)?;
        Ok(Self {
            map,
            contact: Contact::new(&map),
        })
    }

    /// Lift-off phase of a part at rest in rad, `arcsin k`; `None` for k >= 1.
    pub fn lift_off(&self) -> Option<f64> {
        self.contact.lift_off()
    }

    /// Flight launched at `phase`; `None` if the track does not throw the part there.
    pub fn flight(&self, phase: f64) -> Option<InelasticFlight> {
        let lift_off = self.contact.lift_off()?;
        let start = Map::state(phase, 0.0).ok()?;
        let impact = self.map.impact(start);
        if impact.flight <= 0.0 {
            return None;
        }
        let PartState { phase: landing, .. } = impact.next;
        let wait = self.contact.wait(landing)?;
        Some(InelasticFlight {
            flight: impact.flight,
            landing,
            wait,
            next: if wait > 0.0 { lift_off } else { landing },
        })
    }

    /// Mean velocity along the track in a flight of this duration, at gamma = 0, in units of `b w`
    /// (equation 38 with `eta k/2`): `W = (k d/2) (eta - tan(alpha))`.
    pub fn velocity(&self, flight: f64, amplitude_ratio: f64, incline_tangent: f64) -> f64 {
        0.5 * self.map.k() * flight * (amplitude_ratio - incline_tangent)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::{Orbit, OrbitEvent};

    #[test]
    fn inelastic_map_is_the_limit_of_the_full_map() {
        // If the track throws at once, a part of small R deviates after one flight by its own psi,
        // of order R.
        for k in [0.2, 0.5, 0.8] {
            let inelastic = Inelastic::build(k).unwrap();
            let nearly = Map::build(k, 1e-7).unwrap();
            let (low, high) = (libm::asin(k), core::f64::consts::PI - libm::asin(k));
            for step in 1..20 {
                let phase = low + (high - low) * f64::from(step) / 20.0;
                let flight = inelastic.flight(phase).unwrap();
                let impact = nearly.impact(Map::state(phase, 0.0).unwrap());
                assert!((impact.flight - flight.flight).abs() < 1e-12);
                let first = Orbit::new(&nearly, impact.next).next().unwrap();
                if flight.wait > 0.01 {
                    assert!(
                        matches!(first, OrbitEvent::Rest { chatter, .. } if chatter < 1e-5),
                        "{k} {phase}"
                    );
                } else if flight.wait == 0.0 {
                    assert!(matches!(first, OrbitEvent::Impact(_)));
                }
                assert!((low - 1e-12..=high + 1e-12).contains(&flight.next));
            }
        }
    }
}
