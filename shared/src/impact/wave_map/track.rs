//! A track of several tones with one k: its humps, where the push exceeds k.

use core::f64::consts::TAU;

use heapless::Vec;

use crate::impact::wave::{MAX_HUMPS, Wave, crossing};

/// Edge of a hump: the push equals k.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::impact) struct HumpEnd {
    /// Phase in rad, 0..2 pi.
    pub phase: f64,
    /// S there.
    pub height: f64,
    /// S' there.
    pub speed: f64,
    /// A' there.
    pub jerk: f64,
    /// -A'' there.
    pub snap: f64,
}

/// An interval on which the push exceeds k: there the gap is convex, elsewhere concave.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::impact) struct Hump {
    /// Start of the hump: a resting part is thrown off here.
    pub begin: HumpEnd,
    pub end: HumpEnd,
    /// Length in rad.
    pub width: f64,
    /// Length in rad of the concave interval before it, from the end of the previous hump.
    pub before: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::impact) struct Track {
    pub wave: Wave,
    pub k: f64,
    pub per_k: f64,
    humps: [Hump; MAX_HUMPS],
    count: usize,
    /// Square of the track's top speed, in `(b w)^2`.
    pub fastest: f64,
}

impl Track {
    pub fn new(wave: Wave, k: f64) -> Self {
        let mut track = Self {
            wave,
            k,
            per_k: 1.0 / k,
            humps: [Hump::default(); MAX_HUMPS],
            count: 0,
            fastest: wave.steepest * wave.steepest,
        };
        let in_turn = |phase: f64| if phase < TAU { phase } else { phase - TAU };
        let excess = |phase: f64| {
            let at = wave.at(in_turn(phase));
            [at.push - k, at.jerk]
        };
        let (mut begins, mut ends) = (Vec::<_, MAX_HUMPS>::new(), Vec::<_, MAX_HUMPS>::new());
        // A is monotone between neighbouring extrema.
        let next = wave.extrema().skip(1);
        let first = wave.extrema().map(|[phase, push]| [phase + TAU, push]);
        for ([low, push], [high, then]) in wave.extrema().zip(next.chain(first)) {
            if (push < k) == (then < k) {
                continue;
            }
            let phase = in_turn(crossing(&excess, low, high));
            let at = wave.at(phase);
            let edges = if push < k { &mut begins } else { &mut ends };
            // Each half of the zeros fits.
            let _ = edges.push(HumpEnd {
                phase,
                height: at.height,
                speed: at.speed,
                jerk: at.jerk,
                snap: at.snap,
            });
        }
        // Both are in the order of their phases, except those that passed the turn.
        begins.sort_unstable_by(|a, b| a.phase.total_cmp(&b.phase));
        for (n, begin) in begins.iter().enumerate() {
            let width = |end: &HumpEnd| ahead(begin.phase, end.phase);
            let before = |end: &HumpEnd| ahead(end.phase, begin.phase);
            let next = ends.iter().min_by(|a, b| width(a).total_cmp(&width(b)));
            let last = ends.iter().min_by(|a, b| before(a).total_cmp(&before(b)));
            if let (Some(end), Some(last)) = (next, last) {
                track.humps[n] = Hump {
                    begin: *begin,
                    end: *end,
                    width: width(end),
                    before: before(last),
                };
                track.count = n + 1;
            }
        }
        track
    }

    /// The humps in the order of their starts.
    #[inline(always)]
    pub fn humps(&self) -> &[Hump] {
        &self.humps[..self.count.min(MAX_HUMPS)]
    }

    /// Time in rad from rest at a phase to the next throw, and its phase; `None` if the part
    /// rests for ever.
    pub fn throw(&self, phase: f64) -> Option<(f64, f64)> {
        self.humps()
            .iter()
            .map(|hump| {
                let elapsed = ahead(hump.begin.phase, phase);
                // Within rounding of a hump's end a resting part stays: the track has already
                // thrown all others.
                if elapsed < hump.width * (1.0 - 1e-9) {
                    (0.0, phase)
                } else {
                    (ahead(phase, hump.begin.phase), hump.begin.phase)
                }
            })
            .min_by(|a, b| a.0.total_cmp(&b.0))
    }
}

/// Distance from `from` forward to `to`, in 0..2 pi.
pub(super) fn ahead(from: f64, to: f64) -> f64 {
    if to < from {
        to - from + TAU
    } else {
        to - from
    }
}
