//! Observers of an orbit, composed at compile time.

use crate::impact::kernel::{Impact, PartState};

/// An observer of an orbit (observer pattern).
///
/// An orbit yields impacts, rests and lift-offs. Each quantity (conveying speed, tangent map,
/// histogram of intervals) is one observer. Observers compose as tuples, so unobserved quantities
/// cost nothing: `()` observes nothing.
///
/// ```
/// use kband::impact::{Count, Impact, Kernel, Map, Observer, Orbit, PartState};
///
/// #[derive(Default)]
/// struct Longest(f64);
///
/// impl Observer for Longest {
///     fn impact(&mut self, _: PartState, impact: &Impact<PartState>) {
///         self.0 = self.0.max(impact.flight);
///     }
/// }
///
/// let map = Map::build(0.43, 0.2)?;
/// let (mut longest, mut count) = (Longest::default(), Count::default());
/// Orbit::new(&map, Map::state(0.5, 0.45)?).watch(100, &mut (&mut longest, &mut count));
/// assert_eq!(count.impacts, 100);
/// assert!((longest.0 - core::f64::consts::TAU).abs() < 0.1);
/// # Ok::<(), kband::feeder::OutOfRange>(())
/// ```
pub trait Observer {
    /// The part left the track with `launch`, flew and struck it again.
    #[inline]
    fn impact(&mut self, launch: PartState, impact: &Impact<PartState>) {
        let _ = (launch, impact);
    }

    /// The part chattered to rest in `chatter` rad; it rests from `phase` on.
    ///
    /// `last` is the state after the last computed impact.
    #[inline]
    fn rest(&mut self, last: PartState, chatter: f64, phase: f64) {
        let _ = (last, chatter, phase);
    }

    /// After `wait` rad at rest the track threw the part off at `phase`.
    #[inline]
    fn lift_off(&mut self, wait: f64, phase: f64) {
        let _ = (wait, phase);
    }
}

impl Observer for () {}

impl<O: Observer> Observer for &mut O {
    #[inline]
    fn impact(&mut self, launch: PartState, impact: &Impact<PartState>) {
        O::impact(self, launch, impact);
    }

    #[inline]
    fn rest(&mut self, last: PartState, chatter: f64, phase: f64) {
        O::rest(self, last, chatter, phase);
    }

    #[inline]
    fn lift_off(&mut self, wait: f64, phase: f64) {
        O::lift_off(self, wait, phase);
    }
}

macro_rules! compose {
    ($($name:ident),+) => {
        impl<$($name: Observer),+> Observer for ($($name,)+) {
            #[inline]
            fn impact(&mut self, launch: PartState, impact: &Impact<PartState>) {
                #[allow(non_snake_case)]
                let ($($name,)+) = self;
                $($name.impact(launch, impact);)+
            }

            #[inline]
            fn rest(&mut self, last: PartState, chatter: f64, phase: f64) {
                #[allow(non_snake_case)]
                let ($($name,)+) = self;
                $($name.rest(last, chatter, phase);)+
            }

            #[inline]
            fn lift_off(&mut self, wait: f64, phase: f64) {
                #[allow(non_snake_case)]
                let ($($name,)+) = self;
                $($name.lift_off(wait, phase);)+
            }
        }
    };
}

compose!(A);
compose!(A, B);
compose!(A, B, C);
compose!(A, B, C, D);

/// Counts of events: the cheapest observer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Count {
    /// Impacts.
    pub impacts: u64,
    /// Rests.
    pub rests: u64,
    /// Lift-offs.
    pub lift_offs: u64,
}

impl Observer for Count {
    #[inline]
    fn impact(&mut self, _: PartState, _: &Impact<PartState>) {
        self.impacts += 1;
    }

    #[inline]
    fn rest(&mut self, _: PartState, _: f64, _: f64) {
        self.rests += 1;
    }

    #[inline]
    fn lift_off(&mut self, _: f64, _: f64) {
        self.lift_offs += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::double::Map;
    use crate::impact::kernel::Kernel;
    use crate::impact::orbit::Orbit;

    /// FNV-1a hash of the bits of impact phases and flights, in order.
    struct Hash(u64);

    impl Observer for Hash {
        fn impact(&mut self, launch: PartState, impact: &Impact<PartState>) {
            for value in [launch.phase, impact.flight, impact.next.velocity] {
                self.0 = (self.0 ^ value.to_bits()).wrapping_mul(0x100_0000_01b3);
            }
        }
    }

    #[test]
    fn each_tuple_member_sees_every_event() {
        let map = Map::build(0.9, 0.5).unwrap();
        let (mut bare, mut first, mut second) = (Hash(1), Hash(1), Hash(1));
        let (mut counted, mut again) = (Count::default(), Count::default());
        // One impact at a time: a watch of several ends where the orbit repeats.
        let mut orbit = Orbit::new(&map, Map::state(2.0, 0.5).unwrap());
        let mut same = orbit.clone();
        for _ in 0..500 {
            orbit.watch(1, &mut bare);
            same.watch(1, &mut (&mut first, &mut counted, &mut second, &mut again));
        }
        assert_eq!((first.0, second.0), (bare.0, bare.0));
        assert_eq!(counted, again);
        assert_eq!(counted.impacts, 500);
        assert!(counted.rests > 10 && counted.rests.abs_diff(counted.lift_offs) <= 1);
    }
}
