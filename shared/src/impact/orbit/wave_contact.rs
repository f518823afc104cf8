//! Chatter to rest on a track of several tones (docs/theory-impacts.md#t4.1).

use crate::impact::double::launch::{MAX_CHATTER_REMAINDER, MAX_PULL_CHANGE};
use crate::impact::kernel::PartState;
use crate::impact::wave_map::track::Track;

/// Duration in rad of the infinitely many hops that end at rest, if its closed form is exact to
/// f64.
///
/// `None` otherwise: the part goes on hopping. It is the form of [`Contact`](super::Contact) with
/// the push A for the sine and A' for the cosine. Let `P = k - A` be the pull and
/// `z = psi / (P (1 - R))`. The duration is `2 z + (4/3) (A'/P) z^2`. The third order is at most
/// `z^3 (2.1 (A'/P)^2 + 0.9 |A''|/P)`. A velocity of 0 rests at once where the track does not throw
/// the part.
pub(super) fn time_to_rest(track: &Track, restitution: f64, state: PartState) -> Option<f64> {
    let hop = state.velocity;
    let at = track.wave.at(state.phase);
    let pull = track.k - at.push;
    let least = if at.surge > 0.0 {
        -16.0 * f64::EPSILON
    } else {
        0.0
    };
    if hop <= 0.0 {
        return (pull >= least).then_some(0.0);
    }
    let lost = 1.0 - restitution;
    if pull <= 0.0 || lost <= 0.0 {
        return None;
    }
    let (c, s) = (at.surge.abs(), at.bend.abs());
    let z = hop / (pull * lost);
    let third = z * z * z * (2.1 * (c / pull) * (c / pull) + 0.9 * s / pull);
    let exact = third <= MAX_CHATTER_REMAINDER;
    let steady = 2.0 * z * c <= MAX_PULL_CHANGE * pull && 2.0 * z * z * s <= MAX_PULL_CHANGE * pull;
    (exact && steady).then(|| 2.0 * z + 4.0 / 3.0 * (at.surge / pull) * z * z)
}
