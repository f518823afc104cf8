//! The impact map over arrays.

use kband::impact::batch::{Block, LANES};
use kband::impact::{Impact, Kernel, Map};

use crate::failure::{Code, Failure, call};

/// The first impact after each launch: phase (rad, 0..2 pi) and speed (units of b w) just after it.
///
/// phase: -1.3e7..1.3e7 rad; speed: 0..1000 b w; k: 0.001..1000; restitution: 0..1. `next_phase`
/// and
/// `next_speed` may be the arrays `phase` and `speed`. Launches before a refused one may be done.
///
/// # Safety
/// Each array has `count` elements.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kband_impacts(
    phase: *const f64,
    speed: *const f64,
    k: *const f64,
    restitution: *const f64,
    count: usize,
    next_phase: *mut f64,
    next_speed: *mut f64,
) -> Code {
    call(|| {
        let inputs = [phase, speed, k, restitution, next_phase, next_speed];
        if count > 0 && inputs.iter().any(|array| array.is_null()) {
            return Err(Failure::new(Code::Null, format_args!("an array is null")));
        }
        let launch = |n: usize| {
            // SAFETY: the arrays have `count` elements, and `n` is below that.
            let [phase, speed, k, restitution] =
                unsafe { [phase, speed, k, restitution].map(|column| *column.add(n)) };
            let refused = |refused| Failure::element(refused, n);
            let map = Map::build(k, restitution).map_err(refused)?;
            Ok::<_, Failure>((map, Map::state(phase, speed).map_err(refused)?))
        };
        let mut block = Block::new();
        for first in (0..count).step_by(LANES) {
            let lanes = LANES.min(count - first);
            for lane in 0..lanes {
                let (map, state) = launch(first + lane)?;
                block.put(lane, &map, state)?;
            }
            for lane in lanes..LANES {
                block.clear(lane);
            }
            block.advance(1);
            for lane in 0..lanes {
                let next = match block.impact(lane) {
                    Some(Impact { flight, next, .. }) if flight > 0.0 => next,
                    _ => {
                        // The block does not advance parts that rest or whose chatter has a closed
                        // form. The result of this launch is not written yet.
                        let (map, state) = launch(first + lane)?;
                        map.impact(state).next
                    }
                };
                // SAFETY: the arrays have `count` elements.
                unsafe {
                    *next_phase.add(first + lane) = next.phase;
                    *next_speed.add(first + lane) = next.velocity;
                }
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use kband::impact::PartState;

    #[test]
    fn impacts_have_the_bits_of_the_map_over_their_launches() {
        let spread = |n: u32, factor: f64| (f64::from(n) * factor).fract();
        let column = |value: &dyn Fn(u32) -> f64| -> Vec<f64> { (0..1000).map(value).collect() };
        let mut phase = column(&|n| 9.0 * spread(n, 0.618_034) - 1.0);
        let mut speed = column(&|n| (20.0 * spread(n, 0.414_214)).powi(3).min(1000.0));
        speed[77] = 0.0;
        let k = column(&|n| 0.02 + 1.3 * spread(n, 0.732_051));
        let restitution = column(&|n| spread(n, 0.236_068));
        let impact = |n: usize| {
            let map = Map::build(k[n], restitution[n]).unwrap();
            map.impact(Map::state(phase[n], speed[n]).unwrap()).next
        };
        let expected: Vec<PartState> = (0..1000).map(impact).collect();
        let (phases, speeds) = (phase.as_mut_ptr(), speed.as_mut_ptr());
        let (k, restitution) = (k.as_ptr(), restitution.as_ptr());
        // SAFETY: each array has 1000 elements.
        let code = unsafe { kband_impacts(phases, speeds, k, restitution, 1000, phases, speeds) };
        assert_eq!(code, Code::Ok);
        for (n, state) in expected.iter().enumerate() {
            let actual = [phase[n], speed[n]].map(f64::to_bits);
            let reference = [state.phase, state.velocity].map(f64::to_bits);
            assert_eq!(actual, reference, "{n}");
        }
    }
}
