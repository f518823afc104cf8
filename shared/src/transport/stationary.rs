//! Exact impact mean of any hopping regime, locked or chaotic (equation 34, corrected;
//! docs/theory-transport.md#t8.5).

use crate::impact::{Impact, Observer, PartState, TangentialSettings};

/// Impact mean of the velocity along the track in units of `b w`, at gamma = 0 (equation 34).
///
/// It is `<W> = (k D/2) { eta (1-R)/(1+R) - tan(alpha) (1+Rt)/(1-Rt) }` of parts that hop without
/// rest at a mean interval D in rad. The means of psi, phi and cos t are then equal before and after
/// an impact. `None` if gamma is not 0, as the mean then depends on more than D.
pub fn impact_mean(
    k: f64,
    restitution: f64,
    settings: &TangentialSettings,
    mean_interval: f64,
) -> Option<f64> {
    let rt = settings.restitution;
    let drive = settings.amplitude_ratio * (1.0 - restitution) / (1.0 + restitution);
    let fall = settings.incline_tangent * (1.0 + rt) / (1.0 - rt);
    (settings.phase_lead == 0.0).then_some(0.5 * k * mean_interval * (drive - fall))
}

/// Observer of the quantities that determine the impact mean at any gamma: the mean interval
/// (symbol D) and two means over the impact phases.
///
/// ```
/// use kband::impact::{Kernel, Map, Orbit, Tangential, TangentialSettings};
/// use kband::transport::{Conveying, stationary::PhaseMeans};
///
/// let along = TangentialSettings {
///     restitution: 0.3,
///     amplitude_ratio: 1.7,
///     phase_lead: 0.6,
///     incline_tangent: 0.07,
/// };
/// let map = Map::build(0.34, 0.2)?;
/// let mut conveying = Conveying::new(Tangential::build(0.34, along)?, &map);
/// let mut phases = PhaseMeans::default();
/// let mut orbit = Orbit::new(&map, Map::state(0.9, 0.36)?);
/// orbit.watch(20_000, &mut (&mut conveying, &mut phases));
/// let measured = conveying.conveyed().impact_mean().unwrap();
/// // The difference comes from the two ends of the run.
/// assert!((measured - phases.impact_mean(0.34, 0.2, &along).unwrap()).abs() < 1e-3);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PhaseMeans {
    impacts: u64,
    flying: f64,
    /// Sum of `sin tau` at launch.
    sine: f64,
    /// Sum of `(cos tau' - cos tau)/d` over the flights.
    chord: f64,
}

impl PhaseMeans {
    /// Impact mean of the velocity along the track in units of `b w`, for parts that hop without
    /// rest:
    ///
    /// ```text
    /// <W> = (k D/2) { eta cos(gamma) (1-R)/(1+R) - tan(alpha) (1+Rt)/(1-Rt) }
    ///       - eta sin(gamma) { <sin tau> + <(cos tau' - cos tau)/d> }
    /// ```
    ///
    /// It is equation 29 with the stationary means of phi and psi. `None` before any impact.
    pub fn impact_mean(
        &self,
        k: f64,
        restitution: f64,
        settings: &TangentialSettings,
    ) -> Option<f64> {
        let count = self.impacts as f64;
        let (sine, cosine) = libm::sincos(settings.phase_lead);
        let normal = TangentialSettings {
            amplitude_ratio: settings.amplitude_ratio * cosine,
            phase_lead: 0.0,
            ..*settings
        };
        let led = settings.amplitude_ratio * sine * (self.sine + self.chord) / count;
        let mean = impact_mean(k, restitution, &normal, self.flying / count)?;
        (self.impacts > 0).then_some(mean - led)
    }
}

impl Observer for PhaseMeans {
    #[inline]
    fn impact(&mut self, launch: PartState, impact: &Impact) {
        let half = 0.5 * impact.flight;
        self.impacts += 1;
        self.flying += impact.flight;
        self.sine += libm::sin(launch.phase);
        self.chord -= libm::sin(launch.phase + half) * libm::sin(half) / half;
    }
}

/// Mean launch velocity of parts that hop without rest, in units of `b w`: `<psi> = k D R/(1+R)`.
pub fn mean_velocity(k: f64, restitution: f64, mean_interval: f64) -> f64 {
    k * mean_interval * restitution / (1.0 + restitution)
}
