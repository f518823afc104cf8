//! The amplitude for a target, chosen for the whole lot.
//!
//! For a lock it is the k with the largest margin in the common band (docs/theory-bands.md#t5.4).

use crate::drive::Scale;
use crate::hear::LockWindow;
use crate::identify;
use crate::{Settings, Shape, Target, phase_of};
use core::fmt;
use kband::feeder::{OutOfRange, accept};
use kband::regime::Lock;
use kband::regime::band::{Band, BandError, NoBand};

/// Reason for a missing setpoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoSetpoint {
    /// The lot has no common band of the requested order.
    Band(NoBand),
    /// The drive does not reach an amplitude at which a part of the lot is in gear.
    Gear {
        /// The smallest sufficient amplitude b, in mm.
        needed: f32,
    },
    /// The output does not reach the target's amplitude b.
    Output {
        /// That amplitude, in mm.
        needed: f32,
        /// The largest amplitude of the configured drive, in mm.
        reach: f32,
    },
    /// The lot has no common chaotic interval.
    Chaos,
    /// No lock conveys at this speed within 10 %; the speed of the nearest lock in mm/s.
    Speed(Option<f32>),
    /// No order of gear gives this flow within 10 %; the nearest flow in g/s.
    Flow(f32),
}

impl fmt::Display for NoSetpoint {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Band(none) => none.fmt(formatter),
            Self::Gear { needed } => write!(
                formatter,
                "the drive does not reach the amplitude from which on parts of the lot are in gear, {needed:.4} mm; a \
                 higher limit, output_maximum or gain would allow it"
            ),
            Self::Output { needed, reach } => write!(
                formatter,
                "it needs an amplitude of {needed:.4} mm, and the output reaches {reach:.4} mm; a higher output_maximum or \
                 gain would allow it"
            ),
            Self::Chaos => formatter.write_str(
                "no k at which all parts of the interval are chaotic; a narrower interval of restitution would \
                 allow it",
            ),
            Self::Speed(Some(speed)) => write!(
                formatter,
                "no lock of the lot conveys at this speed within 10 %; the nearest is {speed:.1} mm/s"
            ),
            Self::Flow(flow) => write!(
                formatter,
                "in no gear do the parts that are on the track leave it at this flow within 10 %; the nearest is {flow:.1} g/s"
            ),
            Self::Speed(None) => formatter.write_str("the lot has no common band, so no lock conveys it"),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Level {
    /// As k, at any frequency.
    K(f64),
    /// As an amplitude in m.
    Amplitude(f32),
    /// Not found yet: the search for the lock of a speed, or for the k of gear, still runs.
    Pending,
    None(NoSetpoint),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    pub level: Level,
    pub lock: Option<LockWindow>,
    pub shape: Shape,
}

/// Half width in rad of a lock's window beyond the lot's own phases.
const LOCK_HALF_WIDTH: f32 = 0.35;
/// Permitted orders of lock and gear.
pub(super) const ORDERS: core::ops::RangeInclusive<u8> = 1..=8;

impl Choice {
    pub fn from_target(target: Target, settings: &Settings) -> Result<Self, OutOfRange> {
        let require_positive = |parameter, value: f32, accepted| {
            accept(parameter, f64::from(value), value > 0.0, accepted)
        };
        let require_zero = |parameter, value: f32, accepted| {
            accept(parameter, f64::from(value), value == 0.0, accepted)
        };
        match target {
            Target::Locked { order } | Target::Gear { order } if !ORDERS.contains(&order) => {
                Err(target.refused("1..8"))
            }
            Target::K(k) | Target::Tones { k, .. } if !(0.02..=10.0).contains(&k) => {
                Err(target.refused("0.02..10"))
            }
            Target::Amplitude(b) if !(0.0..=settings.amplitude_limit).contains(&b) => {
                Err(target.refused("0..amplitude_limit mm"))
            }
            Target::Speed(speed) if !speed.is_finite() => {
                Err(target.refused("a finite speed in mm/s"))
            }
            Target::Locked { order } => Self::lock(order, settings),
            Target::Gear { .. } | Target::Speed(_) => Ok(Self::level(Level::Pending)),
            // Chaos is reached through the lock of order 1.
            Target::Chaotic => {
                let accepted = "0 with target chaotic: its search follows impacts in no time";
                require_zero("contact", settings.contact, accepted)?;
                Self::lock(1, settings)
            }
            Target::K(k) => Ok(Self::level(Level::K(f64::from(k)))),
            Target::Tones { k, shape } => {
                shape.check()?;
                let [second, third] = shape.tones().map(|tone| tone.ratio);
                let accepted = "0..second_tone, which is what the drive affords";
                let accepts = second <= settings.second_tone;
                let parameter = "target second tone, ratio";
                accept(parameter, second.into(), accepts, accepted)?;
                let accepted = "0..third_tone, which is what the drive affords";
                let accepts = third <= settings.third_tone;
                accept("target third tone, ratio", third.into(), accepts, accepted)?;
                Ok(Self {
                    shape,
                    ..Self::level(Level::K(f64::from(k)))
                })
            }
            Target::Identify => Ok(Self::level(Level::K(identify::FIRST_K))),
            Target::Amplitude(b) => Ok(Self::level(Level::Amplitude(b * 1e-3))),
            Target::Flow(flow) => {
                // The estimate of the mass from the parts' power requires a track of one tone.
                let accepted =
                    "above 0 to 100000 kg with target flow: the mass that swings with the track";
                require_positive("track_mass", settings.track_mass, accepted)?;
                let accepted = "above 0 to 100000 mm with target flow: the length of the track on which parts are";
                require_positive("track_length", settings.track_length, accepted)?;
                let accepted = "0 with target flow: parts are weighed on a track of one tone";
                require_zero("second_tone", settings.second_tone, accepted)?;
                if flow > 0.0 && flow <= 1e6 {
                    return Ok(Self::level(Level::Pending));
                }
                Err(target.refused("above 0 to 1000000 g/s"))
            }
            Target::PartsPerMinute(rate) => {
                let accepted = "above 0 to 10000 mm with target parts a minute: the length of a part along the track";
                require_positive("part_length", settings.part_length, accepted)?;
                if rate > 0.0 && rate <= 1e6 {
                    return Ok(Self::level(Level::Pending));
                }
                Err(target.refused("above 0 to 1000000 parts a minute"))
            }
        }
    }

    /// Refuses an amplitude that the output cannot reach, because parts move differently at a
    /// smaller one. An amplitude beyond a hard limit is kept and limited there.
    pub fn limited_to_reach(self, settings: &Settings, scale: &Scale) -> Self {
        let needed = match self.level {
            Level::K(k) => scale.amplitude(k as f32),
            Level::Amplitude(amplitude) => amplitude,
            Level::Pending | Level::None(_) => return self,
        };
        let reach = settings.output_maximum * scale.full_amplitude;
        if needed.min(scale.ceiling) <= reach {
            return self;
        }
        let [needed, reach] = [needed, reach].map(|amplitude| amplitude * 1e3);
        Self::level(Level::None(NoSetpoint::Output { needed, reach }))
    }

    pub fn level(level: Level) -> Self {
        Self {
            level,
            lock: None,
            shape: Shape::SINE,
        }
    }

    /// The choice of the whole lot's lock of an order.
    pub(super) fn lock(order: u8, settings: &Settings) -> Result<Self, OutOfRange> {
        let lot = settings.lot()?;
        let contact = settings.contact_time();
        let band = match Band::common_with_contact(lot, u32::from(order), contact) {
            Ok(band) => band,
            Err(BandError::Empty(none)) => {
                return Ok(Self::level(Level::None(NoSetpoint::Band(none))));
            }
            Err(BandError::OutOfRange(refused)) => return Err(refused),
        };
        let k = band.setpoint();
        let at = |r| {
            Lock::with_contact(k, r, u32::from(order), contact)
                .map(|lock| lock.map(|lock| lock.strike_phase() as f32))
        };
        let lock = (at(lot.low())?.zip(at(lot.high())?)).map(|(low, high)| LockWindow {
            order,
            k,
            phase: phase_of(0.5 * (low + high)),
            width: 0.5 * (high - low).abs() + LOCK_HALF_WIDTH,
        });
        Ok(Self {
            lock,
            ..Self::level(Level::K(k))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::with;

    #[test]
    fn a_contact_time_shifts_the_lock() {
        let [instant, slow] = [0.0, 0.4].map(|contact| {
            let settings = with(Settings::default(), |it| it.contact = contact);
            Choice::lock(1, &settings).unwrap().lock.unwrap()
        });
        let holds = (slow.k / instant.k - 1.0).abs() > 1e-3 && slow.phase != instant.phase;
        assert!(holds, "{slow:?} {instant:?}");
    }

    #[test]
    fn lock_window_covers_the_phases_of_the_lot() {
        let settings = Settings::default();
        let lock = Choice::lock(1, &settings).unwrap().lock.unwrap();
        let at = |restitution| {
            let lock = Lock::build(lock.k, restitution, 1).unwrap().unwrap();
            lock.state().phase as f32
        };
        let (low, high) = (at(0.18), at(0.22));
        let distance = (high - low).abs();
        assert!(distance > 0.1, "{distance}");
        assert!((lock.width - (0.5 * distance + LOCK_HALF_WIDTH)).abs() < 1e-5);
        let middle = phase_of(0.5 * (low + high));
        assert!((lock.phase - middle).bits().cast_signed().abs() < 1000);
    }

    #[test]
    fn numbers_out_of_range_and_missing_settings_are_refused_by_name() {
        let bare = Settings::default();
        let slow = with(bare, |it| it.contact = 0.4);
        let massive = with(bare, |it| it.track_mass = 10.0);
        let scale = with(massive, |it| it.track_length = 500.0);
        let two = with(scale, |it| it.second_tone = 0.15);
        let flow = Target::Flow(45.0);
        assert!(Choice::from_target(flow, &scale).is_ok());
        let long = with(bare, |it| it.part_length = 10.0);
        let of_settings = [
            (Target::Chaotic, slow, "contact"),
            (Target::PartsPerMinute(120.0), bare, "part_length"),
            (flow, bare, "track_mass"),
            (flow, massive, "track_length"),
            (flow, two, "second_tone"),
        ];
        let of_numbers = [
            (Target::Locked { order: 0 }, "target locked order"),
            (Target::Locked { order: 9 }, "target locked order"),
            (Target::Gear { order: 0 }, "target gear order"),
            (Target::Gear { order: 9 }, "target gear order"),
            (Target::K(0.0), "target k"),
            (Target::K(f32::NAN), "target k"),
            (Target::Amplitude(1.1), "target amplitude"),
            (Target::Amplitude(f32::NAN), "target amplitude"),
            (Target::Speed(f32::INFINITY), "target speed"),
            (Target::PartsPerMinute(0.0), "target parts a minute"),
            (Target::PartsPerMinute(f32::NAN), "target parts a minute"),
        ];
        let of_numbers = of_numbers.map(|(target, parameter)| (target, long, parameter));
        for (target, settings, parameter) in of_settings.into_iter().chain(of_numbers) {
            let refused = Choice::from_target(target, &settings).unwrap_err();
            assert_eq!(refused.parameter, parameter);
        }
    }
}
