//! The first impact over several tones: the stretch between edges that holds it.

use super::constants::{Edge, Hump};
use super::flight::{Ballistic, Bends};
use super::short::{self, LONGEST, Near};
use crate::arithmetic::Phase;
use crate::arithmetic::fixed::Fixed;
use crate::arithmetic::trigonometry::RADIANS_PER_TURN;
use crate::impact::integer::anchored::{Anchored, Local};
use crate::impact::integer::constants::SHORT;
use crate::impact::integer::search::{Bracket, from_begin};

/// Heights below which tangents do not tell whether a hump is cleared.
const NOISE: Fixed<20> = Fixed::<20>::of(1.0 / 16_384.0);

/// Turns after which a search is given up: a ball that does not leave the reach of the track falls through it sooner.
const TURNS: u32 = 24;

/// The stretch of the first impact.
pub(super) struct Stretch {
    pub bracket: Bracket,
    /// Whether the flight touches a hump within rounding, or the search was given up.
    pub grazes: bool,
}

/// A flight with its form near launch.
pub(super) struct Search<'a> {
    pub flight: &'a Ballistic<'a>,
    pub near: &'a Near,
}

/// The gap and its slope.
#[derive(Clone, Copy)]
struct Gap {
    height: Fixed<30>,
    slope: Fixed<26>,
}

/// So many steps of a phase in rad, below a turn.
#[inline(always)]
fn radians<const H: u32>(steps: i64) -> Fixed<H> {
    Fixed::<31>((steps >> 1) as i32).times(RADIANS_PER_TURN)
}

/// A hop of at most [`SHORT`] steps in rad.
#[inline(always)]
pub(super) fn short_radians(steps: i64) -> Fixed<34> {
    Fixed::<36>((steps << 4) as i32)
        .times::<28, 34>(RADIANS_PER_TURN)
        .clamp(Fixed(0), LONGEST - Fixed(1))
}

impl Ballistic<'_> {
    /// The hump that begins next after launch, its place, and when.
    #[inline(always)]
    fn next_hump(&self) -> Option<(usize, i64)> {
        let mut next = None;
        for (n, hump) in self.constants.humps().iter().enumerate() {
            // From the very begin of a hump the next one is a whole turn away.
            let wait = i64::from(hump.phase.wrapping_sub(self.phase).wrapping_sub(1)) + 1;
            if next.is_none_or(|(_, soonest)| wait < soonest) {
                next = Some((n, wait));
            }
        }
        next
    }

    /// Until how many steps after launch a down-crossing is certain to be the first impact; `None` where there is
    /// no hump.
    ///
    /// Up to the end of the next hump it is, and where the gap rises at the begin of that, up to the end of the one
    /// after it: see the kernels with an FPU.
    #[inline(always)]
    pub fn limit(&self) -> Option<i64> {
        let humps = self.constants.humps();
        let (place, wait) = self.next_hump()?;
        let hump = humps.get(place)?;
        if self.falling(wait) - hump.begin.speed <= Fixed::<26>::of(1e-5) {
            return Some(wait + i64::from(hump.length));
        }
        let after = humps.get(place + 1).or(humps.first())?;
        let further = match after.phase.wrapping_sub(hump.phase) {
            0 => Phase::STEPS,
            steps => i64::from(steps),
        };
        Some(wait + further + i64::from(after.length))
    }
}

impl Search<'_> {
    /// The gap at an edge, `steps` after launch.
    #[inline(always)]
    fn gap(&self, steps: i64, edge: &Edge) -> Gap {
        if steps < SHORT {
            let short::Gap { height, slope } = self.near.gap(short_radians(steps));
            return Gap { height, slope };
        }
        let (height, velocity) = self.flight.over(steps, edge.height);
        Gap {
            height,
            slope: velocity - edge.speed,
        }
    }

    /// The gap anywhere, `steps` after launch, and whether it is on a concave rise.
    #[inline(always)]
    fn at(&self, steps: i64) -> (Gap, bool) {
        if steps < SHORT {
            let short::Gap { height, slope } = self.near.gap(short_radians(steps));
            return (Gap { height, slope }, false);
        }
        let node = ((steps + i64::from(self.flight.phase) + (1 << 23)) >> 24) as i32;
        let local: Local<27, Bends> = self.flight.local(node);
        let offset = Fixed::<32>((steps - self.flight.steps_to(node)) as i32);
        let (height, slope) = self.flight.expanded(&local, offset.times(RADIANS_PER_TURN));
        let rises = local.curvature < Fixed::<27>::ZERO && slope > Fixed::<26>::ZERO;
        (Gap { height, slope }, rises)
    }

    /// The stretch between edges that holds the first impact, with one root of the gap in it.
    #[inline(never)]
    pub fn stretch(&self) -> Stretch {
        let flight = self.flight;
        let humps = flight.constants.humps();
        let mut low = 0;
        for hump in humps {
            let past = flight.phase.wrapping_sub(hump.phase);
            if past < hump.length {
                low = i64::from(hump.length - past);
            }
        }
        let Some((next, first)) = flight.next_hump() else {
            return Stretch {
                bracket: self.concave_throughout(low),
                grazes: false,
            };
        };
        let mut grazes = false;
        let mut turn = 0_i64;
        for _ in 0..TURNS {
            for n in 0..humps.len() {
                let place = next + n;
                let place = if place < humps.len() {
                    place
                } else {
                    place - humps.len()
                };
                let (Some(hump), Some(from)) = (humps.get(place), humps.get(next)) else {
                    break;
                };
                let begin = first + turn + i64::from(hump.phase.wrapping_sub(from.phase));
                let end = begin + i64::from(hump.length);
                let over_begin = self.gap(begin, &hump.begin);
                if over_begin.height <= Fixed::<30>::ZERO {
                    let start = from_begin(begin, over_begin.height, over_begin.slope, low);
                    let bracket = Bracket {
                        low,
                        high: begin,
                        start,
                    };
                    return Stretch { bracket, grazes };
                }
                let over_end = self.gap(end, &hump.end);
                if over_end.height <= Fixed::<30>::ZERO {
                    let start = from_begin(begin, over_begin.height, over_begin.slope, begin);
                    let bracket = Bracket {
                        low: begin,
                        high: end,
                        start: start.min(end),
                    };
                    return Stretch { bracket, grazes };
                }
                if over_begin.slope < Fixed::<26>::ZERO
                    && over_end.slope > Fixed::<26>::ZERO
                    && !clears(hump, &over_begin, &over_end)
                {
                    let (lowest, touches) = self.lowest(begin, end);
                    grazes |= touches;
                    if let Some(high) = lowest {
                        let start = from_begin(begin, over_begin.height, over_begin.slope, begin);
                        let bracket = Bracket {
                            low: begin,
                            high,
                            start: start.min(high),
                        };
                        return Stretch { bracket, grazes };
                    }
                }
                low = end;
            }
            let skipped = self.skipped(first + turn);
            turn += Phase::STEPS + skipped;
            low += skipped;
        }
        let bracket = Bracket {
            low,
            high: low,
            start: low,
        };
        Stretch {
            bracket,
            grazes: true,
        }
    }

    /// Whole turns, in steps, that a ball above the reach of the track stays there after a hump at `steps`.
    #[inline(never)]
    fn skipped(&self, steps: i64) -> i64 {
        let constants = self.flight.constants;
        let (over, velocity) = self.flight.over(steps, constants.reach);
        if over <= Fixed::<30>::ZERO || velocity <= Fixed::<26>::ZERO {
            return 0;
        }
        // 2 velocity / k until it is as high again.
        let turns: Fixed<50, u64> = velocity.unsigned().wide(constants.inverse);
        let rounds = turns.scaled::<49>().to::<0>().0 as i64;
        (rounds - 2).max(0) * Phase::STEPS
    }

    /// The bracket where the track is concave throughout: up to where the ball has fallen below it.
    #[inline(never)]
    fn concave_throughout(&self, low: i64) -> Bracket {
        let constants = self.flight.constants;
        let rise = self.flight.rise.narrow::<26>();
        // v^2 + 2 k (S + reach).
        let drop = self.flight.start.coarse + constants.reach.coarse;
        let lift: Fixed<54, i64> = constants.k.wide(drop);
        let square = rise.wide::<26, 52>(rise) + lift.scaled::<53>().to();
        let speed = crate::impact::integer::settle::square_root(square);
        let sum = Fixed::<26, u32>(speed.0.saturating_add_signed(rise.0));
        let turns: Fixed<50, u64> = sum.wide(constants.inverse);
        let turns = Fixed::<18, i64>(turns.to::<18>().0 as i64).to::<32>().0;
        // What the root may lack.
        let high = turns + (turns >> 12) + (1 << 20);
        let near = self.near.first().map_or(high, short::steps_of);
        Bracket {
            low,
            high,
            start: near.clamp(low, high),
        }
    }

    /// The lowest point over the hump from `begin` to `end`: where it is, if it is below the track, and whether that
    /// is within rounding.
    #[inline(never)]
    fn lowest(&self, begin: i64, end: i64) -> (Option<i64>, bool) {
        let (mut left, mut right) = (begin, end);
        // Within the hump the slope rises.
        while right - left > 1 << 9 {
            let middle = left + (right - left) / 2;
            if self.at(middle).0.slope > Fixed::<26>::ZERO {
                right = middle;
            } else {
                left = middle;
            }
        }
        let place = left + (right - left) / 2;
        let height = self.at(place).0.height;
        // Steps that the height's products round by, and what sine and cosine at launch move it by.
        let rounded = if place < SHORT {
            (i64::from(self.flight.velocity.0 >> 22) * place) >> 32
        } else {
            24 + (place >> 25)
        };
        let touches = i64::from(height.0.abs()) <= rounded;
        ((height <= Fixed::<30>::ZERO).then_some(place), touches)
    }

    /// The root in a bracket by halving it alone: steps after launch and arrival speed.
    #[inline(never)]
    pub fn halved(&self, bracket: &Bracket) -> (i64, Fixed<26>) {
        let Bracket {
            mut low, mut high, ..
        } = *bracket;
        while high - low > 1 {
            let middle = low + (high - low) / 2;
            let (gap, rises) = self.at(middle);
            // On a concave rise even a height rounded below 0 is before the root.
            if gap.height > Fixed::<30>::ZERO || rises {
                low = middle;
            } else {
                high = middle;
            }
        }
        (high, (-self.at(high).0.slope).max(Fixed::<26>::ZERO))
    }
}

/// Whether the tangents at both ends of a hump meet above the track: the gap, which is convex, is above them.
#[inline(always)]
fn clears(hump: &Hump, begin: &Gap, end: &Gap) -> bool {
    let width: Fixed<26> = radians(i64::from(hump.length));
    let turning = i64::from(end.slope.0) - i64::from(begin.slope.0);
    // Where they meet, times the difference of their slopes.
    let reach: Fixed<52, i64> = end.slope.wide(width);
    let back = reach.to::<20>() - Fixed(i64::from(end.height.to::<20>().0));
    let meet = i64::from(begin.height.to::<20>().0) * i64::from(end.slope.0)
        + i64::from(begin.slope.0) * back.0;
    meet > (turning * i64::from(NOISE.0)).max(0)
}
