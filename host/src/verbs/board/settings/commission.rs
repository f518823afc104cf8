//! `kband settings commission`: restitution of the parts, estimated by the board from their chatter
//! (`kband_control::identify`), as an interval 0..1 for the settings of the lot.

use std::time::{Duration, Instant};

use kband_control::wire::{Request, Response};
use kband_control::{Identification, Identified, Target, Unidentified};

use super::offer::{Commissioning, why_off};
use crate::board::Link;
use crate::desk::{Desk, Progress};
use crate::refusal::{Refusal, Result};
use crate::report::{fields, shortest};

/// Half-width of the narrowest proposed interval: the accuracy of the identification.
const MIN_HALF_WIDTH: f32 = 0.02;
const RESULT_HOPS: u64 = 64;

fields! {
    fn identified(row: (Identified, [f32; 2])) {
        all RESTITUTION.digits(3) => shortest(row.0.restitution);
        all DEVIATION.digits(2) => shortest(row.0.deviation);
        all K.digits(4) => shortest(row.0.k);
        all HOPS => u32::from(row.0.hops);
        json RESTITUTION_LOW => shortest(row.1[0]);
        json RESTITUTION_HIGH => shortest(row.1[1]);
    }
}

pub(super) fn run(commissioning: &Commissioning<'_>) -> Result<()> {
    let (mut link, settings) = commissioning.open()?;
    let target = link.target()?;
    link.command(&Request::Target(Target::Identify))?;
    let result = listen(&mut link, commissioning.within, commissioning.desk);
    // The board returns to its target with or without a result.
    link.command(&Request::Target(target))?;
    let result = result?;
    let (low, high) = offered(&result);
    let note = format!(
        "proposed: restitution_low = {low}, restitution_high = {high} (twice the deviation, {MIN_HALF_WIDTH} at least)"
    );
    let mut offer = [("restitution_low", low), ("restitution_high", high)];
    // Above the present interval the upper end is set first.
    if low > settings.configured().restitution_high {
        offer.reverse();
    }
    let result = (result, [low, high]);
    commissioning.conclude((link, settings), &offer, vec![note], identified(), result)
}

fn listen(link: &mut Link, within: Duration, desk: &Desk) -> Result<Identified> {
    let progress = Progress::new("listening", RESULT_HOPS);
    let start = Instant::now();
    let mut hops_counted = 0;
    while start.elapsed() < within {
        desk.check_stop()?;
        let identification = link.request(&Request::Identification, |response| match response {
            Response::Identification(identification) => Some(identification),
            _ => None,
        })?;
        match identification {
            Some(Identification::Found(result)) => return Ok(result),
            Some(Identification::NotFound(why)) => {
                let cause = match why {
                    Unidentified::Quiet => "no impact was detected that repeats in every cycle",
                    Unidentified::Dead => {
                        "the parts bounce so little, or so unevenly, that the ringing of an impact hides the next"
                    }
                    Unidentified::Scattered => {
                        "only the parts' first landing repeats: their restitution scatters, from impact to impact or from part to part"
                    }
                    Unidentified::Unsteady => {
                        "the drive did not hold the required amplitudes in time"
                    }
                    Unidentified::Unlike => {
                        "the detected impacts are not the chatter of parts of one restitution"
                    }
                };
                let next = match why {
                    Unidentified::Scattered | Unidentified::Dead => {
                        "put a single part on the track and try again: for one part the scatter is estimated too"
                    }
                    _ => "put parts of one kind on the track, a dozen or so, and try again",
                };
                let cause = format!("the restitution was not identified: {cause}");
                return Err(Refusal::new(cause, next));
            }
            Some(Identification::Listening { hops }) => {
                let more = u64::from(hops).saturating_sub(hops_counted);
                progress.advance(more);
                hops_counted += more;
            }
            Some(Identification::Idle) | None => {}
        }
        if let Some(off) = why_off(link)? {
            return Err(off);
        }
    }
    let seconds = within.as_secs();
    let cause =
        format!("after {seconds} s the board has detected {hops_counted} hops and has no result");
    let next = "raise --within S; it needs up to 80 s of its own time";
    Err(Refusal::new(cause, next))
}

/// Proposed interval, rounded outwards to hundredths.
fn offered(result: &Identified) -> (f32, f32) {
    let half = (2.0 * result.deviation).max(MIN_HALF_WIDTH);
    // A value within 1e-5 of a hundredth counts as that hundredth: rounding widens no interval.
    let low = ((result.restitution - half) * 100.0 + 1e-3).floor() / 100.0;
    let high = ((result.restitution + half) * 100.0 - 1e-3).ceil() / 100.0;
    (low.max(0.0), high.min(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_offered_interval_contains_the_estimate() {
        for (restitution, deviation, low, high) in [
            (0.4, 0.005, 0.38, 0.42),
            (0.403, 0.02, 0.36, 0.45),
            (0.01, 0.001, 0.0, 0.03),
            (0.99, 0.01, 0.97, 1.0),
        ] {
            let result = Identified {
                restitution,
                deviation,
                k: 0.5,
                scatter: 0.0,
                hops: 64,
            };
            assert_eq!(offered(&result), (low, high));
        }
    }
}
