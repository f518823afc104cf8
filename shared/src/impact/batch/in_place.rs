//! Tall flights, computed in their own lanes without gathering.

use super::columns::Columns;
use super::lanes::LANES;
use super::plan::{Kind, Plan};
use super::stages::Stages;
use crate::arithmetic::lane::queue::Queue;
use crate::arithmetic::lane::{Lane, Node};
use crate::impact::double::launch::Launch;
use crate::impact::double::step::{GapNearImpact, LandingEstimate};
use crate::impact::double::tall;

/// Number of registers that pass a stage together.
const REGISTERS_PER_STAGE: usize = 8;

/// Number of quantities that a register keeps between stages; launch and track are in the columns.
///
/// A later quantity reuses the place of one that no later stage needs.
const QUANTITIES_PER_REGISTER: usize = 11;
/// Nodes and speed of the crossing, and the sum of its node.
const CROSSING: usize = 0;
/// Sine and cosine of the node next to the impact.
const NODE_VALUES: usize = 0;
/// The sum of the node at which the approach begins.
const NODE_SUM: usize = 2;
/// Distance of the impact before that node, and the sum of the node next to the impact.
const DISTANCE_BACK: usize = 3;
const NEXT_NODE_SUM: usize = 4;
/// The gap there, later the landing.
const GAP: usize = 5;

/// One impact of the tall lanes, in registers of which at least half are tall; other tall lanes are
/// queued.
///
/// Lanes whose next flight is not tall are added to `unsorted`.
#[inline(always)]
pub(super) fn advance<L: Lane>(
    columns: &mut Columns,
    stages: &mut Stages,
    now: &mut Plan,
    next: &mut Plan,
    unsorted: &mut Queue,
) {
    let mut starts = [(0, 0); REGISTERS_PER_STAGE];
    let mut at = 0;
    while at < LANES {
        let mut count = 0;
        while at < LANES && count < REGISTERS_PER_STAGE {
            let bits = now.tall_bits(at, L::WIDTH);
            if 2 * bits.count_ones() as usize >= L::WIDTH {
                starts[count] = (at, bits);
                count += 1;
            } else {
                now.queues[Kind::Tall as usize].push_bits(at, bits);
            }
            at += L::WIDTH;
        }
        let starts = &starts[..count];
        for (n, &(at, _)) in starts.iter().enumerate() {
            let crossing = tall::crossing::<L>(&columns.track_at(at), &columns.launch_at(at));
            let tall::Crossing { nodes, speed } = crossing;
            stages.put_at(
                n * QUANTITIES_PER_REGISTER + CROSSING,
                [nodes, speed, crossing.node_sum()],
            );
        }
        for (n, &(at, _)) in starts.iter().enumerate() {
            let [nodes, speed, rounded] =
                stages.get_at::<L, _>(n * QUANTITIES_PER_REGISTER + CROSSING);
            let node = stages.node_at(n * QUANTITIES_PER_REGISTER + NODE_SUM);
            let crossing = tall::Crossing { nodes, speed };
            let estimate = tall::approach_from(&columns.track_at(at), &crossing, rounded, node);
            stages.put_at(
                n * QUANTITIES_PER_REGISTER + DISTANCE_BACK,
                [estimate.back, estimate.next_node_sum()],
            );
        }
        for (n, &(at, _)) in starts.iter().enumerate() {
            let [rounded, back, next] =
                stages.get_at::<L, _>(n * QUANTITIES_PER_REGISTER + NODE_SUM);
            let node = stages.node_at(n * QUANTITIES_PER_REGISTER + NEXT_NODE_SUM);
            let estimate = LandingEstimate { rounded, back };
            let GapNearImpact {
                node,
                x,
                value,
                slope,
                sine,
                cosine,
                ..
            } = GapNearImpact::with_node(
                &columns.track_at(at),
                &columns.launch_at(at),
                &estimate,
                next,
                node,
            );
            stages.put_at(
                n * QUANTITIES_PER_REGISTER + NODE_VALUES,
                [node.sine, node.cosine],
            );
            let near = [node.distance, x, value, slope, sine, cosine];
            stages.put_at(n * QUANTITIES_PER_REGISTER + GAP, near);
        }
        for (n, &(at, bits)) in starts.iter().enumerate() {
            let bits = tall_bits_in_place::<L>(bits);
            let near = GapNearImpact::from_stage(
                stages.get_at::<L, _>(n * QUANTITIES_PER_REGISTER + DISTANCE_BACK),
            );
            let landing = near.finish_only(&columns.track_at(at), L::mask(bits));
            let landing = [landing.flight, landing.phase, landing.arrival];
            stages.put_at(n * QUANTITIES_PER_REGISTER + GAP, landing);
        }
        for (n, &(at, bits)) in starts.iter().enumerate() {
            let bits = tall_bits_in_place::<L>(bits);
            let track = columns.track_at(at);
            let [sine, cosine] = stages.get_at::<L, _>(n * QUANTITIES_PER_REGISTER + NODE_VALUES);
            let [rounded, flight, phase, arrival] =
                stages.get_at(n * QUANTITIES_PER_REGISTER + NEXT_NODE_SUM);
            // The launch ignores the node's distance.
            let node = Node {
                sine,
                cosine,
                distance: flight,
                rounded,
            };
            let velocity = columns.restitution_at::<L>(at) * arrival;
            let after = Launch::near_node(phase, velocity, &node, L::mask(bits));
            columns.land_at(at, L::mask(bits), flight, &after);
            let tall = L::bits(after.is_tall(&track)) & bits;
            next.add_tall(at, L::WIDTH, tall);
            unsorted.push_bits(at, bits & !tall);
        }
    }
}

/// The tall lanes of a register that flies in place.
///
/// A lone lane flies in place only if it is tall, so its bit needs no mask.
#[inline(always)]
fn tall_bits_in_place<L: Lane>(bits: u32) -> u32 {
    if L::WIDTH == 1 { 1 } else { bits }
}
