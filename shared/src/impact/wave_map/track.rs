//! A track of several tones with one k: its humps, where the push exceeds k.

use core::f64::consts::TAU;

use crate::impact::wave::{MAX_HUMPS, MAX_ZEROS, Motion, Wave, crossing};

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
            fastest: wave.steepest() * wave.steepest(),
        };
        // A is monotone between neighbouring extrema.
        let mut extrema = [[0.0; 2]; MAX_ZEROS];
        let mut count = 0;
        for (slot, extremum) in extrema.iter_mut().zip(wave.extrema()) {
            *slot = extremum;
            count += 1;
        }
        let (mut begins, mut ends) = (
            [HumpEnd::default(); MAX_HUMPS],
            [HumpEnd::default(); MAX_HUMPS],
        );
        let (mut rising, mut falling) = (0, 0);
        for n in 0..count {
            let [low, push] = extrema[n];
            let [high, then] = extrema[(n + 1) % count];
            let high = if n + 1 == count { high + TAU } else { high };
            if (push < k) == (then < k) {
                continue;
            }
            let phase = crossing(
                &|phase| {
                    let at = wave.at(if phase < TAU { phase } else { phase - TAU });
                    [at.push - k, at.jerk]
                },
                low,
                high,
            );
            let phase = if phase < TAU { phase } else { phase - TAU };
            let Motion {
                height,
                speed,
                jerk,
                snap,
                ..
            } = wave.at(phase);
            let hump_end = HumpEnd {
                phase,
                height,
                speed,
                jerk,
                snap,
            };
            if push < k {
                begins[rising] = hump_end;
                rising += 1;
            } else {
                ends[falling] = hump_end;
                falling += 1;
            }
        }
        // Both are in the order of their phases, except those that passed the turn.
        begins[..rising].sort_unstable_by(|a, b| a.phase.total_cmp(&b.phase));
        for (n, begin) in begins.iter().enumerate().take(rising) {
            let nearest = ends[..falling]
                .iter()
                .min_by(|a, b| ahead(begin.phase, a.phase).total_cmp(&ahead(begin.phase, b.phase)));
            let last = ends[..falling]
                .iter()
                .min_by(|a, b| ahead(a.phase, begin.phase).total_cmp(&ahead(b.phase, begin.phase)));
            if let (Some(end), Some(last)) = (nearest, last) {
                track.humps[n] = Hump {
                    begin: *begin,
                    end: *end,
                    width: ahead(begin.phase, end.phase),
                    before: ahead(last.phase, begin.phase),
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
