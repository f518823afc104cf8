//! Root-finding steps in f64: the gap around a table node, and Householder's method of order 4.
//!
//! Source: A. S. Householder, The Numerical Treatment of a Single Nonlinear Equation, 1970.

use core::f64::consts::TAU;

use super::launch::{Launch, Track};
use crate::arithmetic::lane::{Arc, Lane, Node, ROUNDING_OFFSET};
use crate::arithmetic::node;
use crate::impact::kernel::{Impact, PartState};

/// The end of a flight.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Landing<L> {
    /// Duration of the flight.
    pub flight: L,
    /// Phase of the impact, in 0..2 pi.
    pub phase: L,
    /// Speed of arrival relative to the track, at least 0.
    pub arrival: L,
}

/// The impact of a part launched in `state`; without a landing the part rests.
#[inline(always)]
pub(crate) fn build_impact(
    restitution: f64,
    state: PartState,
    landing: Option<(Landing<f64>, bool)>,
) -> Impact<PartState> {
    let Some((landing, grazes)) = landing else {
        return Impact {
            flight: 0.0,
            next: state,
            grazes: false,
        };
    };
    Impact {
        flight: landing.flight,
        next: PartState::new(landing.phase, restitution * landing.arrival),
        grazes,
    }
}

impl<L: Lane> Landing<L> {
    /// `self` where the mask holds, else `other`.
    #[inline(always)]
    pub(crate) fn or(self, mask: L::Mask, other: Self) -> Self {
        Self {
            flight: L::select(mask, self.flight, other.flight),
            phase: L::select(mask, self.phase, other.phase),
            arrival: L::select(mask, self.arrival, other.arrival),
        }
    }
}

/// The gap `u0 + u1 x + b2 x^2 + ...` around a node of the table.
#[derive(Clone, Copy)]
pub(super) struct Local<L> {
    pub node: Node<L>,
    /// `u` at the node.
    pub value: L,
    /// `u'` at the node.
    pub slope: L,
}

impl<L: Lane> Local<L> {
    /// Around the node nearest to `d` after the launch.
    #[inline(always)]
    pub(super) fn at_nearest_node(track: &Track<L>, launch: &Launch<L>, d: L) -> Self {
        let node = Node::near(launch.phase, d);
        let v = launch.rise();
        Self {
            node,
            value: node.distance * (v - track.half() * node.distance) + (launch.sine - node.sine),
            slope: (v - track.k * node.distance) - node.cosine,
        }
    }

    /// `u''` at the node.
    #[inline(always)]
    pub(super) fn curvature(&self, track: &Track<L>) -> L {
        self.node.sine - track.k
    }
}

/// Step of Householder's method of order 4, backwards to the root, with one division.
///
/// `f` is the value, `g` to `g4` are the derivatives. The sign of the whole function does not
/// matter.
#[inline(always)]
pub(crate) fn householder<L: Lane>(f: L, g: L, g2: L, g3: L, g4: L) -> L {
    let (gg, ff, bent) = (g * g, f * f, g2 * f);
    let turned = (g3 * L::splat(1.0 / 6.0)) * ff;
    let top = g * (gg - bent) + turned;
    let rest = (bent * bent) * L::splat(0.25) - ((g4 * L::splat(1.0 / 24.0)) * f) * ff;
    let bottom = gg * (gg - L::splat(1.5) * bent) + (rest + (turned + turned) * g);
    f * top / bottom
}

/// Estimated landing: a table node and a distance before it.
#[derive(Clone, Copy)]
pub(crate) struct LandingEstimate<L> {
    /// The [`ROUNDING_OFFSET`] sum of the node.
    pub rounded: L,
    /// Distance before the node in rad.
    pub back: L,
}

impl<L: Lane> LandingEstimate<L> {
    /// The estimate `d` rad after the launch.
    #[inline(always)]
    pub(super) fn after_launch(launch: &Launch<L>, d: L) -> Self {
        let node = Node::near(launch.phase, d);
        Self {
            rounded: node.rounded,
            back: node.distance - d,
        }
    }

    /// The [`ROUNDING_OFFSET`] sum of the nearest node.
    #[inline(always)]
    pub fn next_node_sum(&self) -> L {
        self.rounded - self.back * L::splat(node::COUNT as f64 / TAU)
    }
}

/// The gap near an impact, to rounding.
///
/// The ball is expanded about the node of the approach, the track about the node next to the
/// impact. Every sum follows the readiness of its terms.
#[derive(Clone, Copy)]
pub(crate) struct GapNearImpact<L> {
    /// The node next to the impact; its distance is that of the approach's node from the launch.
    pub node: Node<L>,
    /// Time in rad back from the approach's node.
    pub back: L,
    /// Time in rad from the node next to the impact.
    pub x: L,
    /// `u`.
    pub value: L,
    /// `u'`.
    pub slope: L,
    /// The track's sine.
    pub sine: L,
    /// Its cosine.
    pub cosine: L,
}

impl<L: Lane> GapNearImpact<L> {
    /// At `estimate`.
    #[inline(always)]
    pub fn new(track: &Track<L>, launch: &Launch<L>, estimate: &LandingEstimate<L>) -> Self {
        let rounded = estimate.next_node_sum();
        let (node_sine, node_cosine) = L::node(rounded);
        let (half, back) = (track.half(), estimate.back);
        let x = (estimate.rounded - rounded) * L::splat(node::SPACING) - back;
        let count = estimate.rounded - L::splat(ROUNDING_OFFSET);
        let distance = (count * L::splat(node::SPACING_HIGH) - launch.phase)
            + count * L::splat(node::SPACING_LOW);
        let v = launch.rise();
        let height = launch.sine + distance * (v - half * distance);
        let speed = v - track.k * distance;
        let arc = Arc::new(x);
        let rise = node_cosine * arc.sine - node_sine * arc.versine;
        let fall = node_sine * arc.sine + node_cosine * arc.versine;
        let cosine = node_cosine - fall;
        Self {
            node: Node {
                sine: node_sine,
                cosine: node_cosine,
                distance,
                rounded,
            },
            back,
            x,
            value: ((height - back * (speed + half * back)) - node_sine) - rise,
            slope: (speed + track.k * back) - cosine,
            sine: node_sine + rise,
            cosine,
        }
    }

    /// The landing `back` rad earlier; its phase may be a rounding error below zero.
    #[inline(always)]
    pub(super) fn landing(&self, back: L, arrival: L) -> Landing<L> {
        let (high, low) = L::within_turn(self.node.rounded);
        Landing {
            flight: self.node.distance - (self.back + back),
            phase: high + ((low + self.x) - back),
            arrival,
        }
    }

    /// The last step to the root, by Householder's method of order 4.
    #[inline(always)]
    pub fn finish(&self, track: &Track<L>) -> Landing<L> {
        let (f, g, sine, g3) = (self.value, self.slope, self.sine, self.cosine);
        let g2 = sine - track.k;
        let back = householder(f, g, g2, g3, -sine);
        let half_third = g3 * L::splat(0.5);
        let bend = half_third
            + back * (sine * L::splat(1.0 / 6.0) - back * (half_third * L::splat(1.0 / 12.0)));
        let mut landing = self.landing(back, back * (g2 - back * bend) - g);
        landing.phase = in_turn(landing.phase);
        landing
    }
}

/// A phase in 0..2 pi from one that may be a rounding error below zero.
#[inline(always)]
pub(crate) fn in_turn<L: Lane>(phase: L) -> L {
    let below = phase.below(L::splat(0.0));
    if L::any(below) {
        // A tiny negative phase rounds up to the whole turn.
        (phase + L::splat(TAU).keep_where(below)).min(L::splat(TAU.next_down()))
    } else {
        phase
    }
}
