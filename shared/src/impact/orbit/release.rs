//! Release: the flight of a part that the track throws off from rest.

use crate::impact::kernel::{Impact, Kernel};

/// A part thrown off from rest: its launch and the flight that follows.
///
/// The launch is at `sin t = k` going up with velocity 0, independent of the earlier motion
/// (docs/theory-impacts.md#t4.2). So launch and flight depend on k and the restitution alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Release<S> {
    /// The state at launch.
    pub launch: S,
    /// The flight from there.
    pub impact: Impact<S>,
}

/// Delay of a lift-off in rad, for arithmetics coarser than f64.
///
/// It exceeds their rounding of `arcsin k` and of a phase, so that the part always leaves the
/// track. It omits a launch velocity of at most half its square, 5e-9 `b w`.
pub const LIFT_OFF_DELAY: f64 = 1e-4;

impl<S: Copy> Release<S> {
    /// The release `delay` rad (0, or [`LIFT_OFF_DELAY`]) after `lift_off`, which is `arcsin k` in
    /// rad.
    ///
    /// `None` if the kernel finds no flight there.
    pub fn build<K: Kernel<State = S>>(kernel: &K, lift_off: f64, delay: f64) -> Option<Self> {
        let launch = K::state(lift_off + delay, 0.0).ok()?;
        let impact = kernel.impact(launch);
        (impact.flight > 0.0).then_some(Self { launch, impact })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::anchor::Single;
    use crate::impact::double::Map;
    use crate::impact::integer::Integer;

    /// Flights from rest at k evenly and down to rounding below 1, where the top of the sine is
    /// flat.
    fn flights<K: Kernel>(delay: f64) -> impl Iterator<Item = (f64, Option<f64>)> {
        (0..40_000).map(move |step| {
            let part = (f64::from(step) * 0.618_034).rem_euclid(1.0);
            let ks = [0.005 + 0.994 * part, 1.0 - libm::exp10(-15.9 * part)];
            let k = ks[step as usize % 2].max(0.005);
            let kernel = K::build(k, 0.3).unwrap();
            let release = Release::build(&kernel, libm::asin(k), delay);
            (k, release.map(|release| release.impact.flight))
        })
    }

    #[test]
    fn resting_part_lifts_off_in_every_arithmetic() {
        for (k, flight) in flights::<Map>(0.0) {
            assert!(flight.is_some(), "{k:e}");
        }
        let coarse = flights::<Single>(LIFT_OFF_DELAY).chain(flights::<Integer>(LIFT_OFF_DELAY));
        for (k, flight) in coarse {
            // Within LIFT_OFF_DELAY of the top of the sine the track's push has ended after the
            // delay.
            let is_flat = k > 1.0 - LIFT_OFF_DELAY * LIFT_OFF_DELAY;
            assert!(flight.is_some() || is_flat, "{k:e}");
        }
    }
}
