//! What the steps on nodes ask of a flight, over a sine or over several tones.

use crate::arithmetic::fixed::Fixed;

/// Height and slope of the flight above the track at a node, and what the track does there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Local<const C: u32, T> {
    /// Saturating.
    pub height: Fixed<30>,
    pub slope: Fixed<26>,
    /// `A - k`: for a sine `sin - k`.
    pub curvature: Fixed<C>,
    /// What else an expansion about the node takes of the track.
    pub track: T,
}

/// The track at a node, to 15 bits.
pub(super) struct Motion {
    /// S less a height.
    pub below: Fixed<16>,
    /// S'.
    pub speed: Fixed<13>,
    /// `k - A`, within -8..8.
    pub curvature: Fixed<13>,
}

/// A flight in integers; `C` are the places of its curvature.
pub(super) trait Anchored<const C: u32> {
    /// What an expansion about a node takes of the track, beside its curvature.
    type Track: Copy;
    /// A height of the track.
    type Height: Copy;

    /// Phase of launch, steps.
    fn phase(&self) -> u32;
    /// Restitution, 1 as 1 - 2^-32.
    fn restitution(&self) -> Fixed<32, u32>;
    /// k.
    fn k(&self) -> Fixed<12>;
    /// The track at a node, its height over `base`.
    fn motion(&self, node: i32, base: Self::Height) -> Motion;
    /// The flight at a node.
    fn local(&self, node: i32) -> Local<C, Self::Track>;
    /// Height and slope at `d`, within reach, from a node, where they are small.
    fn expanded(&self, local: &Local<C, Self::Track>, d: Fixed<34>) -> (Fixed<30>, Fixed<26>);
    /// The curvature at `d` from a node.
    fn turned(local: &Local<C, Self::Track>, d: Fixed<34>) -> Fixed<C>;
    /// The mean curvature over `d` from there on.
    fn bent(local: &Local<C, Self::Track>, curvature: Fixed<C>, d: Fixed<34>) -> Fixed<C>;

    #[inline(always)]
    fn steps_to(&self, node: i32) -> i64 {
        (i64::from(node) << 24) - i64::from(self.phase())
    }
}
