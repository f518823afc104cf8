//! Bands and the plan for gear.

use std::mem::MaybeUninit;

use kband::feeder::Restitution;
use kband::impact::ContactTime;
use kband::regime::band::{Band, BandError};
use kband::regime::gear::{GearLimits, GearPlanSettings, GearPlanner};

use crate::failure::{Code, Failure, call, put, require};

/// Band of k in which a whole lot has the lock.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BandOfLot {
    /// Lowest k: there the lock doubles.
    pub low: f64,
    /// Highest k: there the lock is born.
    pub high: f64,
    /// k with the largest margin.
    pub setpoint: f64,
}

/// The band of k in which parts of restitution `low`..`high` (0..1) have the period-1 lock of an
/// order, 1..100 drive periods a flight. `KBAND_CODE_NONE` where they have no band in common.
#[unsafe(no_mangle)]
pub extern "C" fn kband_band(
    low: f64,
    high: f64,
    order: u32,
    band: Option<&mut MaybeUninit<BandOfLot>>,
) -> Code {
    call(|| {
        let found = match Band::common(Restitution::interval(low, high)?, order) {
            Ok(found) => found,
            Err(BandError::OutOfRange(refused)) => return Err(refused.into()),
            Err(BandError::Empty(none)) => {
                return Err(Failure::new(Code::None, format_args!("{none}")));
            }
        };
        let found = BandOfLot {
            low: found.low(),
            high: found.high(),
            setpoint: found.setpoint(),
        };
        put(band, "band", found)
    })
}

/// A lot of parts and what may be chosen for it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GearLot {
    /// Lowest mean restitution, 0..1.
    pub restitution_low: f64,
    /// Highest mean restitution, 0..1.
    pub restitution_high: f64,
    /// Standard deviation of the restitution from impact to impact, 0..0.3.
    pub scatter: f32,
    /// Largest relative error of the amplitude, 0..0.2.
    pub amplitude_error: f32,
    /// Drive periods in a flight, 1..100.
    pub order: u32,
    /// Lowest k that may be chosen, 0.005..4.
    pub k_low: f32,
    /// Highest k that may be chosen, 0.005..4.
    pub k_high: f32,
    /// Largest amplitude of a second tone over the first, 0..0.5; below 0.01 there is none.
    pub max_second_tone: f32,
    /// The same of a third tone; without a second tone there is none.
    pub max_third_tone: f32,
}

/// The k and the tones with the largest share of time in gear.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GearChoice {
    /// k of the first tone.
    pub k: f32,
    /// Amplitude of the second tone over the first.
    pub second_tone: f32,
    /// Angle of the second tone in rad.
    pub second_angle: f32,
    /// Amplitude of the third tone over the first.
    pub third_tone: f32,
    /// Angle of the third tone in rad.
    pub third_angle: f32,
    /// Lowest k whose share is within 0.02 of the best.
    pub band_low: f32,
    /// Highest k whose share is within 0.02 of the best.
    pub band_high: f32,
    /// Predicted share of time in gear, mean over the lot, 0..1.
    pub share: f32,
}

/// Plans gear for a lot, as the board does; it takes some 0.1 s. `KBAND_CODE_NONE` where no k that
/// may be chosen is settled on.
#[unsafe(no_mangle)]
pub extern "C" fn kband_gear_plan(
    lot: Option<&GearLot>,
    choice: Option<&mut MaybeUninit<GearChoice>>,
) -> Code {
    call(|| {
        let lot = require(lot, "lot")?;
        let mut planner = GearPlanner::new(GearPlanSettings {
            restitution: Restitution::interval(lot.restitution_low, lot.restitution_high)?,
            scatter: lot.scatter,
            amplitude_error: lot.amplitude_error,
            order: lot.order,
            k: [lot.k_low, lot.k_high],
            max_tones: [lot.max_second_tone, lot.max_third_tone],
            limits: GearLimits::NONE,
            contact: ContactTime::INSTANT,
        })?;
        while planner.advance(10_000) {}
        let plan = planner.plan().filter(|plan| plan.settled).ok_or_else(|| {
            let message = format_args!("no k of these throws the parts so far");
            Failure::new(Code::None, message)
        })?;
        let [[second_tone, second_angle], [third_tone, third_angle]] = plan.tones;
        let chosen = GearChoice {
            k: plan.k,
            second_tone,
            second_angle,
            third_tone,
            third_angle,
            band_low: plan.band[0],
            band_high: plan.band[1],
            share: plan.share,
        };
        put(choice, "choice", chosen)
    })
}
