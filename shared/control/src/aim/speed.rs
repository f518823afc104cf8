//! The lock with a requested conveying speed: an exhaustive search over the orders of lock.
//!
//! A locked part's speed does not depend on the amplitude (docs/theory-transport.md#t8.3).

use super::setpoint::{Choice, Level, NoSetpoint, ORDERS};
use crate::settings::Settings;
use kband::impact::TangentialSettings;
use kband::regime::{Lock, band};
use kband::transport::locked;

/// Largest accepted relative deviation of a lock's speed from the requested one.
const SPEED_TOLERANCE: f32 = 0.1;

#[derive(Clone, Copy, Debug)]
pub struct SpeedSearch {
    requested: f32,
    order: u8,
    /// The nearest lock so far, with its speed in mm/s.
    nearest: Option<(f32, Choice)>,
}

impl SpeedSearch {
    /// Begins the search for a speed in mm/s.
    pub fn begin(requested: f32) -> Self {
        Self {
            requested,
            order: *ORDERS.start(),
            nearest: None,
        }
    }

    /// Computes one slice, which is one order of lock. Returns the choice after the last order.
    pub fn step(&mut self, settings: &Settings) -> Option<Choice> {
        if let Some((speed, choice)) = lock_speed(self.order, settings)
            && (self.nearest).is_none_or(|(best, _)| self.distance(speed) < self.distance(best))
        {
            self.nearest = Some((speed, choice));
        }
        self.order = self.order.saturating_add(1);
        (self.order > *ORDERS.end()).then(|| self.choice())
    }

    fn distance(&self, speed: f32) -> f32 {
        (speed - self.requested).abs()
    }

    fn choice(&self) -> Choice {
        let tolerance = SPEED_TOLERANCE * self.requested.abs();
        match self.nearest {
            Some((speed, choice)) if self.distance(speed) <= tolerance => choice,
            nearest => {
                let speed = nearest.map(|(speed, _)| speed);
                Choice::level(Level::None(NoSetpoint::Speed(speed)))
            }
        }
    }
}

/// The conveying speed in mm/s of the lot's middle in a lock, and that lock; `None` without one.
fn lock_speed(order: u8, settings: &Settings) -> Option<(f32, Choice)> {
    let lot = settings.lot().ok()?;
    // Without a band, `Choice::lock` slowly computes the narrower lot that would have one.
    let contact = settings.contact_time();
    let [_, flip] = band::edges_with_contact(lot.high(), u32::from(order), contact).ok()?;
    let [birth, _] = band::edges_with_contact(lot.low(), u32::from(order), contact).ok()?;
    if flip >= birth {
        return None;
    }
    let choice = Choice::lock(order, settings).ok()?;
    let (k, track) = (choice.lock?.k, settings.track().ok()?);
    let tangential = TangentialSettings::on(&track, f64::from(settings.tangential_restitution));
    let orbit = Lock::with_contact(k, lot.middle(), u32::from(order), contact).ok()??;
    let unit = track.velocity_unit(track.amplitude(k));
    // Equation 20.
    let speed = locked::velocity(&orbit, k, &tangential) * unit * 1e3;
    Some((speed as f32, choice))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::lot;

    fn choice(speed: f32, settings: &Settings) -> Choice {
        let mut search = SpeedSearch::begin(speed);
        for _ in 1..8 {
            assert_eq!(search.step(settings), None);
        }
        search.step(settings).unwrap()
    }

    #[test]
    fn speed_search_finds_the_nearest_lock_or_refuses() {
        // Equation 21: `pi r (g cos(alpha) / w) { eta (1-R)/(1+R) - tan(alpha) (1+Rt)/(1-Rt) }` =
        // 88.4 r mm/s.
        let settings = lot(0.199, 0.201);
        for (speed, order) in [(88.0, 1), (95.0, 1), (180.0, 2), (268.0, 3)] {
            let choice = choice(speed, &settings);
            assert_eq!(choice.lock.unwrap().order, order, "{speed}");
            assert_eq!(Ok(choice), Choice::lock(order, &settings), "{speed}");
        }
        for speed in [-80.0, 0.0, 40.0, 130.0] {
            let choice = choice(speed, &settings);
            let Level::None(NoSetpoint::Speed(Some(nearest))) = choice.level else {
                panic!("{speed}: {choice:?}");
            };
            assert!(nearest > 80.0, "{speed}: {nearest}");
        }
    }

    #[test]
    fn a_lot_without_any_band_has_no_speed_at_all() {
        // docs/theory-bands.md#t5.4: no common band of order 1; those of higher orders are smaller.
        let choice = choice(100.0, &lot(0.1, 0.3));
        assert_eq!(choice, Choice::level(Level::None(NoSetpoint::Speed(None))));
    }
}
