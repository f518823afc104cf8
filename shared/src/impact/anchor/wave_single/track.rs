//! A track of several tones with one k, set up without f64: the humps, where the push exceeds k.
//!
//! Bounds of the push's derivatives limit the steps over nodes, so no relevant hump is missed.

use core::f32::consts::TAU;

use super::harmonics::Harmonics;
use crate::arithmetic::Phase;
use crate::arithmetic::fixed::Fixed;
use crate::feeder::{OutOfRange, accept_in};
use crate::impact::anchor::flight::{
    self, Gravity, Motion, RADIANS_PER_STEP, SPACING, STEPS_PER_RADIAN, abs, larger,
    newton_or_middle,
};
use crate::impact::wave::{MAX_HUMPS, Tone};

/// Edge of a hump: the push equals k.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Edge {
    /// S there.
    pub height: f32,
    /// S' there.
    pub speed: f32,
    /// A' there.
    pub jerk: f32,
}

/// An interval on which the track pushes harder than k.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Hump {
    /// Start of the hump, in steps of a phase: a resting part is thrown off here.
    pub phase: u32,
    /// Its length in steps of a phase and in rad.
    pub length: u32,
    pub width: f32,
    pub begin: Edge,
    pub end: Edge,
}

/// Times in steps after launch between which a down-crossing is the first impact, without a search.
#[derive(Clone, Copy)]
pub(super) struct Limits {
    /// It excludes launch itself and impacts that the short form settles with more digits.
    pub first: i64,
    /// A ball above the track's reach at or before this time has not met the track.
    pub clear: i64,
    /// A down-crossing up to this time is the first impact.
    ///
    /// It holds up to the end of the next hump. On the concave interval up to that hump, the
    /// down-crossing ends the part above 0 from launch on. Within the hump the gap is convex, so it
    /// is above 0 from the start on, and so was the interval before.
    ///
    /// If the gap rises at the start of the hump, it rises from launch on and until the hump ends.
    /// So the same holds up to the end of the hump after it.
    pub last: i64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Track {
    pub tones: Harmonics,
    pub gravity: Gravity,
    /// Bound of |S|.
    pub reach: f32,
    humps: [Hump; MAX_HUMPS],
    count: usize,
    /// k, in the resolution of the push.
    threshold: Fixed<35, i64>,
}

impl Track {
    pub fn build(second: Tone, third: Tone, k: f64) -> Result<Self, OutOfRange> {
        let tones = Harmonics::build(second, third)?;
        accept_in("k", k, 0.005..=4.0, "0.005..4")?;
        let single = k as f32;
        let mut track = Self {
            tones,
            gravity: Gravity {
                k: single,
                half: 0.5 * single,
                inverse: 1.0 / single,
                min_tall_speed_squared: 0.0,
            },
            reach: tones.bound(0),
            humps: [Hump::default(); MAX_HUMPS],
            count: 0,
            threshold: Fixed::<35, i64>::nearest(k),
        };
        track.find_humps();
        // The largest S'^2 + 2 k S lies where its slope 2 S' (k - A) is 0; 0.02 covers rounding.
        let edges = track.humps().iter().flat_map(|hump| [hump.begin, hump.end]);
        let squares = edges.map(|edge| edge.speed * edge.speed + 2.0 * single * edge.height);
        track.gravity.min_tall_speed_squared =
            0.02 + squares.fold(2.0 * single * track.reach, larger);
        Ok(track)
    }

    /// The humps in the order of their phases, from any of them.
    #[inline(always)]
    pub fn humps(&self) -> &[Hump] {
        &self.humps[..self.count.min(MAX_HUMPS)]
    }

    #[inline(always)]
    pub fn throws(&self, phase: u32) -> bool {
        self.humps()
            .iter()
            .any(|hump| phase.wrapping_sub(hump.phase) < hump.length)
    }

    /// Time limits of a flight from `phase` with the ball's velocity `rise`, if there is a hump.
    #[inline(always)]
    pub fn limits(&self, phase: u32, rise: f32) -> Option<Limits> {
        let wait = |hump: &Hump| hump.phase.wrapping_sub(phase).wrapping_sub(1);
        let humps = self.humps();
        let (first, others) = humps.split_first()?;
        let (mut next, mut index, mut shortest_wait) = (first, 0, wait(first));
        for (n, hump) in others.iter().enumerate() {
            if wait(hump) < shortest_wait {
                (next, index, shortest_wait) = (hump, n + 1, wait(hump));
            }
        }
        let begin = shortest_wait as f32 * RADIANS_PER_STEP;
        let (mut hump, mut clear) = (next, i64::from(shortest_wait));
        if rise - self.gravity.k * begin - next.begin.speed > 1e-5 {
            if humps.len() == 1 {
                clear += Phase::STEPS;
            } else {
                hump = humps.get(index + 1).unwrap_or(first);
                clear = i64::from(wait(hump));
            }
        }
        Some(Limits {
            first: (<Self as flight::Track>::MAX_SHORT_FLIGHT * STEPS_PER_RADIAN) as i64,
            clear,
            last: clear + i64::from(hump.length),
        })
    }

    /// Time limit of a ball that leaves the track's reach before it meets the track, in steps after
    /// launch. It is the end of the hump below the ball as it sinks into the reach, else of the
    /// next one.
    #[inline(never)]
    pub fn limit_from_above(&self, phase: u32, height: f32, rise: f32, clear: i64) -> Option<i64> {
        let (from, to) = self.time_above_reach(height, rise);
        // Earlier than the time of sinking, by more than its rounding in f32.
        let sinks = to - 1e-3 - 1e-6 * to;
        if !(from < (clear >> 8) as i32 as f32 * (256.0 * RADIANS_PER_STEP) && from < sinks) {
            return None;
        }
        let sinks = (sinks * STEPS_PER_RADIAN) as i64;
        let there = phase.wrapping_add(sinks as u32);
        let end = |hump: &Hump| {
            let elapsed = there.wrapping_sub(hump.phase);
            if elapsed < hump.length {
                hump.length - elapsed
            } else {
                // The longest hump is shorter than the rest of the turn.
                hump.phase.wrapping_sub(there).saturating_add(hump.length)
            }
        };
        let shortest_wait = self.humps().iter().map(end).min()?;
        Some(sinks + i64::from(shortest_wait))
    }

    /// Next lift-off phase of a part that rests at `phase`, in steps of a phase.
    pub fn lift_off(&self, phase: u32) -> Option<u32> {
        let begins = self.humps().iter().map(|hump| hump.phase);
        begins.min_by_key(|begin| begin.wrapping_sub(phase))
    }

    /// `A - k` within 3e-9.
    #[inline(never)]
    pub fn excess(&self, phase: u32) -> f32 {
        let push = self.tones.sines(Phase::from_bits(phase), [4, 9]);
        let Fixed(excess) = push - self.threshold;
        // Steps of 2^-35, below 2^39 of them.
        (excess >> 8) as i32 as f32 * (1.0 / (1 << 27) as f32)
            + (excess & 255) as f32 * (1.0 / 34_359_738_368.0)
    }

    /// Finds every interval with A > k, node by node. From a node where A is far from k it skips as
    /// many nodes as the slope allows. A hump that it misses is shorter than a node distance, with
    /// two more extrema of A within it. There A exceeds k so little and so briefly that the gap is
    /// concave to 1e-8.
    fn find_humps(&mut self) {
        let excess =
            |track: &Self, node: i32| flight::Track::at(track, node).push - track.gravity.k;
        // The mean of A over evenly spread nodes is 0.
        let start = (0..16)
            .map(|n| 16 * n)
            .find(|&node| excess(self, node) < 0.0)
            .unwrap_or(0);
        let per_node = 1.0 / (self.tones.bound(3) * SPACING);
        // Beyond this distance from k at a node, A cannot reach k and return before the next node.
        let turning = 0.5 * self.tones.bound(4) * SPACING * SPACING;
        let mut begin = None;
        let (mut node, mut value) = (start, excess(self, start));
        while node < start + 256 {
            let next = (node + ((abs(value) * per_node) as i32).max(1)).min(start + 256);
            let then = excess(self, next);
            let (low, high) = ((node as u32) << 24, ((next - node) as u32) << 24);
            if (value > 0.0) == (then > 0.0) {
                if next == node + 1
                    && abs(value) < turning
                    && let Some(middle) = self.find_hidden_extremum(low, high, value > 0.0)
                {
                    self.add_edge(&mut begin, low, middle);
                    self.add_edge(&mut begin, low.wrapping_add(middle), high - middle);
                }
            } else {
                self.add_edge(&mut begin, low, high);
            }
            (node, value) = (next, then);
        }
    }

    /// Extremum of A between two nodes where A passes k and returns; `None` without one.
    fn find_hidden_extremum(&self, low: u32, width: u32, above: bool) -> Option<u32> {
        let jerk = |phase: u32| self.tones.at(phase).cosines(8.0, 27.0);
        let toward = |at: u32| (jerk(low.wrapping_add(at)) < 0.0) == above;
        if !toward(0) || toward(width) {
            return None;
        }
        let (mut near, mut far) = (0, width);
        while far - near > 1 << 8 {
            let middle = near + (far - near) / 2;
            if toward(middle) {
                near = middle;
            } else {
                far = middle;
            }
        }
        ((self.excess(low.wrapping_add(near)) > 0.0) != above).then_some(near)
    }

    /// Finds the edge within `width` steps of `low`, by safeguarded Newton steps. It becomes the
    /// start of a hump, or the end of the open one.
    fn add_edge(&mut self, begun: &mut Option<u32>, low: u32, width: u32) {
        let rising = begun.is_none();
        let (mut near, mut far) = (0.0, width as f32);
        let mut x = 0.5 * far;
        let mut fine = false;
        for _ in 0..40 {
            let phase = low.wrapping_add(x as u32);
            let parts = self.tones.at(phase);
            let excess = if fine {
                self.excess(phase)
            } else {
                parts.sines(4.0, 9.0) - self.gravity.k
            };
            // Near the edge the sum in f32 has too few digits for its sign.
            if fine || abs(excess) > 1e-5 {
                if (excess > 0.0) == rising {
                    far = x;
                } else {
                    near = x;
                }
            } else {
                fine = true;
                continue;
            }
            let newton = x - excess / parts.cosines(8.0, 27.0) * STEPS_PER_RADIAN;
            let next = newton_or_middle(newton, near, far);
            let moved = abs(next - x);
            x = next;
            if moved < 1.0 && fine {
                break;
            }
            fine |= moved < 1024.0;
        }
        let phase = low.wrapping_add(x as u32);
        let Some(begin) = *begun else {
            *begun = Some(phase);
            return;
        };
        *begun = None;
        if let Some(slot) = self.humps.get_mut(self.count) {
            let length = phase.wrapping_sub(begin);
            let edge = |phase: u32| {
                let parts = self.tones.at(phase);
                Edge {
                    height: parts.sines(1.0, 1.0),
                    speed: parts.cosines(2.0, 3.0),
                    jerk: parts.cosines(8.0, 27.0),
                }
            };
            *slot = Hump {
                phase: begin,
                length,
                width: length as f32 * RADIANS_PER_STEP,
                begin: edge(begin),
                end: edge(phase),
            };
            self.count += 1;
        }
    }

    /// Time in rad at which the ball falls through the lowest reach of the track.
    pub fn fall_time(&self, height: f32, rise: f32) -> f32 {
        let square = rise * rise + 2.0 * self.gravity.k * (height + self.reach);
        (rise + flight::root(square)) * self.gravity.inverse
    }

    /// Begin and end in rad of the ball's time above the track's reach; an empty span without one.
    pub fn time_above_reach(&self, height: f32, rise: f32) -> (f32, f32) {
        let square = rise * rise + 2.0 * self.gravity.k * (height - self.reach) - 1e-4;
        if !(rise > 0.0 && square > 0.0) {
            return (TAU, 0.0);
        }
        let speed = flight::root(square);
        (
            (rise - speed) * self.gravity.inverse,
            (rise + speed) * self.gravity.inverse,
        )
    }
}

impl flight::Track for Track {
    const MAX_SHORT_FLIGHT: f32 = 0.2;
    const MAX_LAST_STEP: f32 = 0.02;
    const MAX_LAST_CORRECTION: f32 = 3e-3;
    const PULL_ROUNDING: f32 = 4e-9;
    const GAP_ROUNDING_PER_RADIAN: f32 = 2e-6;

    #[inline(always)]
    fn gravity(&self) -> Gravity {
        self.gravity
    }

    #[inline(always)]
    fn at(&self, node: i32) -> Motion {
        self.tones.at_node(node)
    }
}
