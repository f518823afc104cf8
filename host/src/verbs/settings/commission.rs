//! `kband settings commission`: the restitution of the parts, estimated by the board.
//!
//! The board estimates it from the chatter of the parts (`kband_control::identify`). The result is
//! an interval of restitution, 0..1, for the settings of the lot.

use std::time::{Duration, Instant};

use kband_control::wire::{Request, Response};
use kband_control::{Identification, Identified, Target, Unidentified};

use super::drive::why_off;
use super::offer::Commissioning;
use crate::board::Link;
use crate::desk::{Desk, Progress};
use crate::refusal::Refusal;
use crate::report::{fields, shortest};

/// Half-width of the narrowest offered interval: the accuracy of the identification.
const HALF_WIDTH: f32 = 0.02;
/// Number of hops of a result, for the progress bar.
const RESULT_HOPS: u64 = 64;

fields! {
    /// What was identified, and the offered interval.
    fn identified(of: (Identified, [f32; 2])) {
        all RESTITUTION.digits(3) => shortest(of.0.restitution);
        all DEVIATION.digits(2) => shortest(of.0.deviation);
        all K.digits(4) => shortest(of.0.k);
        all HOPS => u32::from(of.0.hops);
        json RESTITUTION_LOW => shortest(of.1[0]);
        json RESTITUTION_HIGH => shortest(of.1[1]);
    }
}

/// Starts the identification on the board, and offers the interval of restitution.
pub(super) fn run(commissioning: &Commissioning<'_>) -> Result<(), Refusal> {
    let (mut link, settings) = commissioning.open()?;
    let target = link.held()?;
    link.tell(&Request::Target(Target::Identify))?;
    let found = listen(&mut link, commissioning.within, commissioning.desk);
    // With or without a result, the board returns to its target.
    link.tell(&Request::Target(target))?;
    let found = found?;
    let (low, high) = offered(&found);
    let note = format!(
        "proposed: restitution_low = {low}, restitution_high = {high} (twice the deviation, {HALF_WIDTH} at least)"
    );
    let mut offer = [("restitution_low", low), ("restitution_high", high)];
    // Above the present interval the upper end is set first.
    if low > settings.known().restitution_high {
        offer.reverse();
    }
    let found = (found, [low, high]);
    commissioning.conclude((link, settings), &offer, vec![note], identified(), found)
}

fn listen(link: &mut Link, within: Duration, desk: &Desk) -> Result<Identified, Refusal> {
    let progress = Progress::new("listening", RESULT_HOPS);
    let begun = Instant::now();
    let mut heard = 0;
    while begun.elapsed() < within {
        desk.go_on()?;
        let come = link.ask(&Request::Identification, |response| match response {
            Response::Identification(come) => Some(come),
            _ => None,
        })?;
        match come {
            Some(Identification::Found(found)) => {
                progress.finish();
                return Ok(found);
            }
            Some(Identification::NotFound(why)) => {
                return Err(Refusal::new(
                    format!(
                        "the restitution was not identified: {}",
                        match why {
                            Unidentified::Quiet =>
                                "no impact was detected that repeats in every cycle",
                            Unidentified::Dead => {
                                "the parts bounce so little, or so unevenly, that the ringing of an impact hides the next"
                            }
                            Unidentified::Scattered =>
                                "only the parts' first landing repeats: their restitution scatters, from impact to impact or from part to part",
                            Unidentified::Unsteady =>
                                "the drive did not hold the required amplitudes in time",
                            Unidentified::Unlike =>
                                "the detected impacts are not the chatter of parts of one restitution",
                        }
                    ),
                    match why {
                        Unidentified::Scattered | Unidentified::Dead => {
                            "put a single part on the track and try again: for one part the scatter is estimated too"
                        }
                        _ => "put parts of one kind on the track, a dozen or so, and try again",
                    },
                ));
            }
            Some(Identification::Listening { hops }) => {
                let more = u64::from(hops).saturating_sub(heard);
                progress.advance(more);
                heard += more;
            }
            Some(Identification::Idle) | None => {}
        }
        if let Some(off) = why_off(link)? {
            return Err(off);
        }
    }
    Err(Refusal::new(
        format!(
            "after {} s the board has detected {heard} hops and has no result",
            within.as_secs()
        ),
        "raise --within S; it needs up to 80 s of its own time",
    ))
}

/// The offered interval, rounded outwards to hundredths.
fn offered(found: &Identified) -> (f32, f32) {
    let half = (2.0 * found.deviation).max(HALF_WIDTH);
    // A value within rounding above a hundredth counts as that hundredth.
    let low = ((found.restitution - half) * 100.0 + 1e-3).floor() / 100.0;
    let high = ((found.restitution + half) * 100.0 - 1e-3).ceil() / 100.0;
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
            let found = Identified {
                restitution,
                deviation,
                k: 0.5,
                scatter: 0.0,
                hops: 64,
            };
            assert_eq!(offered(&found), (low, high));
        }
    }
}
