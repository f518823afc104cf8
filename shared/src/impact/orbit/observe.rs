//! Observers of an orbit, composed at compile time.

use crate::impact::kernel::{Impact, PartState};

/// An observer of an orbit (observer pattern).
///
/// An orbit yields impacts, rests and lift-offs. Each quantity (conveying speed, tangent map,
/// histogram of intervals) is one observer. Observers compose as pairs, so unobserved quantities
/// cost nothing: `()` observes nothing.
///
/// ```
/// use kband::impact::{Impact, Kernel, Map, Observer, Orbit, PartState};
///
/// #[derive(Default)]
/// struct Longest(f64);
///
/// impl Observer for Longest {
///     fn impact(&mut self, _: PartState, impact: &Impact) {
///         self.0 = self.0.max(impact.flight);
///     }
/// }
///
/// let map = Map::build(0.43, 0.2)?;
/// let mut longest = Longest::default();
/// Orbit::new(&map, Map::state(0.5, 0.45)?).watch(100, &mut longest);
/// assert!((longest.0 - core::f64::consts::TAU).abs() < 0.1);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
pub trait Observer {
    /// The part left the track with `launch`, flew and struck it again.
    fn impact(&mut self, _launch: PartState, _impact: &Impact) {}

    /// The part chattered to rest in `chatter` rad after its `last` impact, from `phase` on.
    fn rest(&mut self, _last: PartState, _chatter: f64, _phase: f64) {}

    /// After `wait` rad at rest the track threw the part off at `phase`.
    fn lift_off(&mut self, _wait: f64, _phase: f64) {}
}

impl Observer for () {}

impl<O: Observer> Observer for &mut O {
    fn impact(&mut self, launch: PartState, impact: &Impact) {
        O::impact(self, launch, impact);
    }

    fn rest(&mut self, last: PartState, chatter: f64, phase: f64) {
        O::rest(self, last, chatter, phase);
    }

    fn lift_off(&mut self, wait: f64, phase: f64) {
        O::lift_off(self, wait, phase);
    }
}

impl<A: Observer, B: Observer> Observer for (A, B) {
    fn impact(&mut self, launch: PartState, impact: &Impact) {
        self.0.impact(launch, impact);
        self.1.impact(launch, impact);
    }

    fn rest(&mut self, last: PartState, chatter: f64, phase: f64) {
        self.0.rest(last, chatter, phase);
        self.1.rest(last, chatter, phase);
    }

    fn lift_off(&mut self, wait: f64, phase: f64) {
        self.0.lift_off(wait, phase);
        self.1.lift_off(wait, phase);
    }
}
