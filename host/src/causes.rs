//! Causes of a share of time in gear below the best of the lot, each with its remedy: the plan of
//! gear is repeated without one bound of drive or lot at a time.

use std::f64::consts::TAU;

use kband::feeder::Restitution;
use kband::impact::ContactTime;
use kband::regime::gear::GearPlan;
use kband_control::{Controller, Limits, Settings, StartCause, Target};

use crate::report::number;

/// Share of time in gear, 0..=1, from which parts are reported to stay in gear, without causes.
pub const MIN_SHARE_IN_GEAR: f64 = 0.95;
/// Smallest gain of the predicted share for which a remedy is named.
const MIN_GAIN: f64 = 0.05;
/// Amplitude of the tried second tone, over the first.
const SECOND_TONE: f32 = 0.15;
/// Factor by which the drive is made stronger to lift its output limit.
const OUTPUT_LIFT_FACTOR: f32 = 10.0;

/// The predicted best setpoint of a lot on a drive.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BestSetpoint {
    /// Share of time in gear, 0..=1.
    pub share: f64,
    /// Amplitude b in mm; 0 if no amplitude brings parts into gear.
    pub amplitude: f64,
}

impl BestSetpoint {
    pub fn from_settings(settings: &Settings, order: u8) -> Self {
        plan(settings, order).map_or(Self::default(), |(plan, amplitude)| Self {
            share: f64::from(plan.share),
            amplitude,
        })
    }
}

/// The controller's plan of gear, and its amplitude b in mm; `None` if no part gets into gear.
pub fn plan(settings: &Settings, order: u8) -> Option<(GearPlan, f64)> {
    let target = Target::Gear { order };
    let mut controller = Controller::build(settings, target, StartCause::Ordinary).ok()?;
    while controller.plan_step() {}
    Some((controller.gear()?, f64::from(controller.setpoint()) * 1e3))
}

/// Settings of an unlimited drive for a lot.
pub fn unbounded(lot: Restitution, scatter: f64, contact: ContactTime) -> Settings {
    let frequency = f64::from(Settings::default().frequency);
    Settings {
        contact: (1e3 * contact.radians() / (TAU * frequency)) as f32,
        restitution_low: lot.low() as f32,
        restitution_high: lot.high() as f32,
        scatter: scatter as f32,
        gain: 100.0,
        amplitude_limit: 100.0,
        acceleration_limit: 1000.0,
        ..Settings::default()
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Cause {
    /// The cause with its numbers, and the change that removes it.
    pub remedy: String,
    /// Predicted best setpoint with this one change.
    pub best: BestSetpoint,
}

/// Causes whose remedies raise the share of `now`, most likely first.
pub fn causes(settings: &Settings, order: u8, now: BestSetpoint) -> Vec<Cause> {
    let Settings {
        frequency,
        resonance,
        output_maximum,
        amplitude_limit,
        acceleration_limit,
        restitution_low,
        restitution_high,
        scatter,
        ..
    } = *settings;
    let middle = 0.5 * (restitution_low + restitution_high);
    let force = number(3.0 * f64::from(settings.quality * SECOND_TONE), 2);
    let mut all: Vec<(String, Settings)> = Vec::new();
    let mut lift = |remedy: String, change: &dyn Fn(&mut Settings)| {
        let mut lifted = *settings;
        change(&mut lifted);
        if lifted != *settings {
            all.push((remedy, lifted));
        }
    };
    lift(
        format!("a stronger drive: the output is at its limit of {output_maximum}"),
        &|lifted| {
            let raised = |gain: f32| (OUTPUT_LIFT_FACTOR * gain).min(100.0);
            lifted.gain = raised(lifted.gain);
            lifted.second_gain = raised(lifted.second_gain);
            lifted.third_gain = raised(lifted.third_gain);
        },
    );
    let off = format!("it runs at {frequency} Hz, its resonance is {resonance} Hz");
    let remedy = format!("the drive on its resonance: {off}");
    lift(remedy, &|lifted| lifted.resonance = frequency);
    let remedy = format!("a higher acceleration limit than {acceleration_limit} m/s^2");
    lift(remedy, &|lifted| lifted.acceleration_limit = 1000.0);
    let remedy = format!("a higher amplitude limit than {amplitude_limit} mm");
    lift(remedy, &|lifted| lifted.amplitude_limit = 100.0);
    let lot = format!("restitution of the lot is {restitution_low}..{restitution_high}");
    lift(format!("parts sorted by restitution: {lot}"), &|lifted| {
        (lifted.restitution_low, lifted.restitution_high) = (middle, middle);
    });
    let remedy = format!("parts that scatter less: their restitution scatters by {scatter}");
    lift(remedy, &|lifted| lifted.scatter = 0.0);
    if settings.second_tone < SECOND_TONE && settings.second_gain > 0.0 {
        lift(
            format!(
                "a second tone (drive.second_tone = {SECOND_TONE}), if a mode at twice the frequency gives {} mm \
                 (second_gain); without a mode there it takes {force} times the force of the first tone",
                settings.second_gain
            ),
            &|lifted| lifted.second_tone = SECOND_TONE,
        );
    }
    let cause = |(remedy, lifted)| {
        let best = BestSetpoint::from_settings(&lifted, order);
        Cause { remedy, best }
    };
    let mut causes: Vec<Cause> = all.into_iter().map(cause).collect();
    causes.retain(|cause| cause.best.share >= now.share + MIN_GAIN);
    causes
}

/// Cause after the parts were found not to fit the lot; `amplitude` in mm is the present one.
pub fn misfit(settings: &Settings, amplitude: f64) -> Cause {
    let (low, high) = (settings.restitution_low, settings.restitution_high);
    let (share, scatter) = (0.0, settings.scatter);
    Cause {
        remedy: format!(
            "parts that do not fit the lot: restitution {low}..{high} with scatter {scatter}; \
             they tumble, or are another sort (kband target identify)"
        ),
        best: BestSetpoint { share, amplitude },
    }
}

/// Causes of one controller; up to seven plans, repeated only for other settings, order or plan.
#[derive(Clone, Debug, Default)]
pub struct CauseCache {
    inputs: Option<(Settings, u8, BestSetpoint)>,
    causes: Vec<Cause>,
}

impl CauseCache {
    /// Causes for a target of gear under these limits; empty if the lot is in gear or has no plan.
    pub fn causes(
        &mut self,
        settings: &Settings,
        order: u8,
        now: BestSetpoint,
        limits: Limits,
    ) -> Vec<Cause> {
        if limits.contains(Limits::MISFIT) {
            return vec![misfit(settings, now.amplitude)];
        }
        let planned = now.amplitude > 0.0 || limits.contains(Limits::NO_SETPOINT);
        if now.share >= MIN_SHARE_IN_GEAR || !planned {
            return vec![];
        }
        let inputs = Some((*settings, order, now));
        if self.inputs != inputs {
            self.causes = causes(settings, order, now);
            self.inputs = inputs;
        }
        self.causes.clone()
    }
}

/// The causes in words, with predicted share and amplitude after each remedy.
pub fn describe(causes: &[Cause]) -> Vec<String> {
    let line = |cause: &Cause| {
        let best = cause.best;
        let (share, amplitude) = (number(best.share, 2), number(best.amplitude, 3));
        format!("{share} in gear at {amplitude} mm with {}", cause.remedy)
    };
    causes.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn served() -> Settings {
        Settings {
            restitution_low: 0.19,
            restitution_high: 0.21,
            scatter: 0.02,
            ..Settings::default()
        }
    }

    #[test]
    fn each_bound_is_named_where_it_alone_binds_and_no_other() {
        let best = BestSetpoint::from_settings(&served(), 1);
        assert!(best.share >= MIN_SHARE_IN_GEAR, "{best:?}");
        assert_eq!(causes(&served(), 1, best), []);
        type Change = fn(&mut Settings);
        let cases: [(&str, Change); 6] = [
            ("a stronger drive", |s| s.gain = 0.15),
            ("the drive on its resonance", |s| s.resonance = 40.0),
            ("a higher acceleration limit", |s| {
                s.acceleration_limit = 15.0
            }),
            ("a higher amplitude limit", |s| s.amplitude_limit = 0.15),
            ("parts sorted by restitution", |s| {
                (s.restitution_low, s.restitution_high) = (0.1, 0.5);
            }),
            ("parts that scatter less", |s| s.scatter = 0.2),
        ];
        for (remedy, change) in cases {
            let mut settings = served();
            change(&mut settings);
            let now = BestSetpoint::from_settings(&settings, 1);
            let causes = causes(&settings, 1, now);
            let cause = causes.iter().find(|cause| cause.remedy.starts_with(remedy));
            let cause = cause.unwrap_or_else(|| panic!("{remedy}: {now:?} {causes:?}"));
            assert!(cause.best.share > 0.9, "{remedy}: {now:?} {cause:?}");
            // Off resonance the drive also lacks output. A second tone is the last cause.
            let remedies = causes.iter().map(|cause| &cause.remedy);
            let others = remedies.filter(|other| !other.starts_with("a second tone"));
            let others: Vec<_> = others.filter(|other| **other != cause.remedy).collect();
            let expected = usize::from(remedy.contains("resonance"));
            assert_eq!(others.len(), expected, "{others:?}");
        }
    }

    #[test]
    fn cached_causes_follow_settings_and_plan() {
        let weak = Settings {
            gain: 0.15,
            ..served()
        };
        let now = BestSetpoint::from_settings(&weak, 1);
        let mut cache = CauseCache::default();
        let first = cache.causes(&weak, 1, now, Limits::NO_SETPOINT);
        assert!(!first.is_empty());
        // A second call plans nothing and takes a thousandth of the time.
        let start = std::time::Instant::now();
        let first_repeated = cache.causes(&weak, 1, now, Limits::NO_SETPOINT);
        let repeated = start.elapsed();
        assert_eq!(first_repeated, first);
        assert!(repeated.as_millis() < 5, "{repeated:?}");
        let poor = Settings {
            scatter: 0.2,
            ..weak
        };
        let now_poor = BestSetpoint::from_settings(&poor, 1);
        let other = cache.causes(&poor, 1, now_poor, Limits::NO_SETPOINT);
        assert_ne!(other, first);
        assert_eq!(cache.causes(&weak, 1, now, Limits::default()), []);
        let lost = [misfit(&weak, now.amplitude)];
        assert_eq!(cache.causes(&weak, 1, now, Limits::MISFIT), lost);
        let served = served();
        let best = BestSetpoint::from_settings(&served, 1);
        assert_eq!(cache.causes(&served, 1, best, Limits::default()), []);
        // Parts that do not fit the lot are the only cause while that limit holds.
        let unfit = misfit(&served, best.amplitude);
        assert_eq!(cache.causes(&served, 1, best, Limits::MISFIT), [unfit]);
    }

    #[test]
    fn second_tone_is_advised_only_where_a_mode_is_configured() {
        let advised = |second_gain| {
            let settings = Settings {
                scatter: 0.1,
                second_gain,
                ..served()
            };
            let causes = causes(&settings, 1, BestSetpoint::from_settings(&settings, 1));
            let mut remedies = causes.iter().map(|cause| &cause.remedy);
            remedies.any(|remedy| remedy.starts_with("a second tone"))
        };
        assert!(advised(0.5));
        assert!(!advised(0.0));
    }
}
