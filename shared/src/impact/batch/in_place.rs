//! Tall flights where their lanes stand.

use super::columns::Columns;
use super::lanes::LANES;
use super::plan::{Kind, Plan};
use super::stages::Stages;
use crate::arithmetic::lane::Lane;
use crate::arithmetic::lane::queue::Queue;
use crate::impact::double::launch::Launch;
use crate::impact::double::step::Near;
use crate::impact::double::tall;

/// Registers that go through a stage together.
const GROUP: usize = 8;

/// One impact of the tall lanes of those registers three quarters of which are tall; the other tall ones
/// are queued. Lanes that are not tall next are added to `unsorted`.
#[inline(always)]
pub(super) fn advance<L: Lane>(
    columns: &mut Columns,
    stages: &mut Stages,
    now: &mut Plan,
    next: &mut Plan,
    unsorted: &mut Queue,
) {
    let mut starts = [0; GROUP];
    let mut at = 0;
    while at < LANES {
        let mut count = 0;
        while at < LANES && count < GROUP {
            let bits = now.tall.bits(at, L::WIDTH);
            if 4 * bits.count_ones() as usize >= 3 * L::WIDTH {
                starts[count] = at;
                count += 1;
            } else {
                now.queues[Kind::Tall as usize].push_bits(at, bits);
            }
            at += L::WIDTH;
        }
        let starts = &starts[..count];
        for (n, &at) in starts.iter().enumerate() {
            let crossing = tall::crossing::<L>(&columns.track_at(at), &columns.launch_at(at));
            stages.put_crossing(n, &crossing);
        }
        for (n, &at) in starts.iter().enumerate() {
            let crossing = stages.crossing::<L>(n);
            let close = tall::approach(&columns.track_at(at), &crossing);
            stages.put_close(n, &close);
        }
        for (n, &at) in starts.iter().enumerate() {
            let close = stages.close::<L>(n);
            let near = Near::at(&columns.track_at(at), &columns.launch_at(at), &close);
            stages.put_near(n, &near);
        }
        for (n, &at) in starts.iter().enumerate() {
            let landing = stages.near::<L>(n).finish(&columns.track_at(at));
            stages.put_landing(n, &landing);
        }
        for (n, &at) in starts.iter().enumerate() {
            let track = columns.track_at(at);
            let landing = stages.landing::<L>(n);
            let velocity = columns.restitution_at::<L>(at) * landing.arrival;
            let after = Launch::near(landing.phase, velocity, &stages.node(n));
            let bits = now.tall.bits(at, L::WIDTH);
            columns.land_at(at, L::mask(bits), landing.flight, &after);
            let tall = L::bits(after.is_tall(&track)) & bits;
            next.tall.add(at, tall);
            unsorted.push_bits(at, bits & !tall);
        }
    }
}
