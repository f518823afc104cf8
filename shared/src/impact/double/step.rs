//! Root-finding steps in f64: the gap around a table node, and Householder's method of order 4.
//!
//! Source: A. S. Householder, The Numerical Treatment of a Single Nonlinear Equation, 1970.

use core::f64::consts::TAU;

use super::launch::{Launch, Track};
use crate::arithmetic::node;
use crate::arithmetic::vector::{Arc, Node, ROUNDING_OFFSET, Vector};
use crate::impact::kernel::{Impact, PartState};

#[derive(Clone, Copy, Debug)]
pub(crate) struct Landing<V> {
    pub flight: V,
    /// Phase of the impact, in 0..2 pi.
    pub phase: V,
    /// Speed of arrival relative to the track, at least 0.
    pub arrival: V,
}

/// The impact of a part launched in `state`; without a landing the part rests.
#[inline(always)]
pub(crate) fn build_impact(
    restitution: f64,
    state: PartState,
    landing: Option<(Landing<f64>, bool)>,
) -> Impact {
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

impl<V: Vector> Landing<V> {
    #[inline(always)]
    pub(crate) fn or(self, mask: V::Mask, other: Self) -> Self {
        Self {
            flight: V::select(mask, self.flight, other.flight),
            phase: V::select(mask, self.phase, other.phase),
            arrival: V::select(mask, self.arrival, other.arrival),
        }
    }
}

/// The gap `u0 + u1 x + b2 x^2 + ...` around a node of the table.
#[derive(Clone, Copy)]
pub(super) struct Local<V> {
    pub node: Node<V>,
    pub value: V,
    pub slope: V,
}

impl<V: Vector> Local<V> {
    /// Around the node nearest to `d` after the launch.
    #[inline(always)]
    pub(super) fn at_nearest_node(track: &Track<V>, launch: &Launch<V>, d: V) -> Self {
        let node = Node::near(launch.phase, d);
        let v = launch.rise();
        Self {
            node,
            value: node.distance * (v - track.half() * node.distance) + (launch.sine - node.sine),
            slope: (v - track.k * node.distance) - node.cosine,
        }
    }
}

/// Step of Householder's method of order 4, backwards to the root, with one division. `f` is the
/// value, `g` to `g4` are the derivatives. The sign of the whole function does not matter.
#[inline(always)]
pub(crate) fn householder<V: Vector>(f: V, g: V, g2: V, g3: V, g4: V) -> V {
    let (gg, ff, curved) = (g * g, f * f, g2 * f);
    let third_term = (g3 * V::splat(1.0 / 6.0)) * ff;
    let top = g * (gg - curved) + third_term;
    let rest = (curved * curved) * V::splat(0.25) - ((g4 * V::splat(1.0 / 24.0)) * f) * ff;
    let bottom = gg * (gg - V::splat(1.5) * curved) + (rest + (third_term + third_term) * g);
    f * top / bottom
}

/// Estimated landing: a table node and a distance before it.
#[derive(Clone, Copy)]
pub(crate) struct LandingEstimate<V> {
    /// The [`ROUNDING_OFFSET`] sum of the node.
    pub rounded: V,
    /// Distance before the node in rad.
    pub step: V,
}

impl<V: Vector> LandingEstimate<V> {
    /// The estimate `d` rad after the launch.
    #[inline(always)]
    pub(super) fn after_launch(launch: &Launch<V>, d: V) -> Self {
        let node = Node::near(launch.phase, d);
        Self {
            rounded: node.rounded,
            step: node.distance - d,
        }
    }
}

/// The gap u near an impact and u', to rounding, with the track's sine and cosine. The ball is
/// expanded about the node of the approach, the track about the node next to the impact. Every sum
/// starts with the terms that are computed first.
#[derive(Clone, Copy)]
pub(crate) struct GapNearImpact<V> {
    /// The node next to the impact; its distance is that of the approach's node from the launch.
    pub node: Node<V>,
    /// Time in rad back from the approach's node.
    pub step: V,
    /// Time in rad from the node next to the impact.
    pub x: V,
    pub value: V,
    pub slope: V,
    pub sine: V,
    pub cosine: V,
}

impl<V: Vector> GapNearImpact<V> {
    #[inline(always)]
    pub fn new(track: &Track<V>, launch: &Launch<V>, estimate: &LandingEstimate<V>) -> Self {
        let per_node = V::splat(node::COUNT as f64 / TAU);
        let rounded = estimate.rounded - estimate.step * per_node;
        let (node_sine, node_cosine) = V::node(rounded);
        let (half, step) = (track.half(), estimate.step);
        let x = (estimate.rounded - rounded) * V::splat(node::SPACING) - step;
        let count = estimate.rounded - V::splat(ROUNDING_OFFSET);
        let distance = (count * V::splat(node::SPACING_HIGH) - launch.phase)
            + count * V::splat(node::SPACING_LOW);
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
            step,
            x,
            value: ((height - step * (speed + half * step)) - node_sine) - rise,
            slope: (speed + track.k * step) - cosine,
            sine: node_sine + rise,
            cosine,
        }
    }

    /// The landing `step` rad earlier; its phase may be a rounding error below zero.
    #[inline(always)]
    pub(super) fn landing(&self, step: V, arrival: V) -> Landing<V> {
        let (high, low) = V::within_turn(self.node.rounded);
        Landing {
            flight: self.node.distance - (self.step + step),
            phase: high + ((low + self.x) - step),
            arrival,
        }
    }

    /// The last step to the root, by Householder's method of order 4.
    #[inline(always)]
    pub fn finish(&self, track: &Track<V>) -> Landing<V> {
        let (f, g, sine, g3) = (self.value, self.slope, self.sine, self.cosine);
        let g2 = sine - track.k;
        let step = householder(f, g, g2, g3, -sine);
        let half_third = g3 * V::splat(0.5);
        let quadratic = half_third
            + step * (sine * V::splat(1.0 / 6.0) - step * (half_third * V::splat(1.0 / 12.0)));
        let mut landing = self.landing(step, step * (g2 - step * quadratic) - g);
        landing.phase = in_turn(landing.phase);
        landing
    }
}

/// A phase in 0..2 pi from one that may be a rounding error below zero.
#[inline(always)]
pub(crate) fn in_turn<V: Vector>(phase: V) -> V {
    let below = phase.below(V::splat(0.0));
    if V::any(below) {
        // A tiny negative phase rounds up to the whole turn.
        (phase + V::splat(TAU).keep_where(below)).min(V::splat(TAU.next_down()))
    } else {
        phase
    }
}
