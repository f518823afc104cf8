//! The timeline picture of a scene.

use kband::control::{Event, State};

use super::outcome::Outcome;
use super::scene::describe;
use crate::picture::{Axis, Panel, Picture, Tone, Unit};

/// Most points of one line: about one a pixel, low and high of each stretch.
const POINTS: usize = 900;

/// Most impacts that are drawn.
const MARKERS: usize = 600;

const TONES: [(Tone, &str); 6] = [
    (Tone::Rest, "off"),
    (Tone::HopAndRest, "starting, stopping, holding"),
    (Tone::Undecided, "capturing, lost"),
    (Tone::Locked, "locked"),
    (Tone::Chaotic, "limiting"),
    (Tone::Fault, "fault"),
];

fn tone(state: State) -> Tone {
    match state {
        State::Off => Tone::Rest,
        State::Starting | State::Stopping | State::Holding => Tone::HopAndRest,
        State::Capturing | State::Lost => Tone::Undecided,
        State::Locked => Tone::Locked,
        State::Limiting => Tone::Chaotic,
        State::Fault => Tone::Fault,
    }
}

/// Draws b, k with the band, the impact phases and what the controller did, over time.
#[must_use]
pub fn draw(outcome: &Outcome) -> Picture {
    let moments = outcome.moments();
    let end = moments.last().map_or(1.0, |moment| f64::from(moment.time));
    let time = || Axis::new("time", Unit::new("s"), 0.0, end);
    let series = |value: &dyn Fn(usize) -> f64| {
        thin(
            &moments
                .iter()
                .enumerate()
                .map(|(n, moment)| (f64::from(moment.time), value(n)))
                .collect::<Vec<_>>(),
        )
    };
    let report = |n: usize| &moments[n].report;
    let b = series(&|n| f64::from(report(n).amplitude) * 1e3);
    // The reference is for the cycle after next.
    let reference = series(&|n| f64::from(report(n.saturating_sub(2)).reference) * 1e3);
    let highest = b
        .iter()
        .chain(&reference)
        .map(|point| point.1)
        .fold(0.0, f64::max);
    let mut ribbon: Vec<(f64, f64, Tone)> = Vec::new();
    for moment in moments {
        let (now, tone) = (f64::from(moment.time), tone(moment.report.state));
        match ribbon.last_mut() {
            Some(last) if last.2 == tone => last.1 = now,
            Some(last) => {
                last.1 = now;
                ribbon.push((now, now, tone));
            }
            None => ribbon.push((0.0, now, tone)),
        }
    }
    let used: Vec<(Tone, &str)> = TONES
        .into_iter()
        .filter(|(tone, _)| ribbon.iter().any(|stretch| stretch.2 == *tone))
        .collect();
    let mut amplitude = Panel::new(
        time(),
        Axis::new("amplitude b", Unit::new("mm"), 0.0, highest * 1.08),
    )
    .height(190.0)
    .ribbon(ribbon, &used)
    .line("measured", 0, b)
    .line("reference", 1, reference);
    let mut last = f64::NEG_INFINITY;
    for happened in outcome.events() {
        let at = f64::from(happened.time);
        // Several kicks in a row would write over each other.
        if telling(happened.event) && at - last > 0.035 * end {
            amplitude = amplitude.mark(at, happened.event.name());
            last = at;
        }
    }
    let k_last = outcome.k();
    let band = outcome.band();
    let top = band.map_or(k_last, |band| band.high()).max(k_last) * 1.6;
    let top = if top.is_finite() { top } else { 2.0 };
    let k = series(&|n| {
        let k = f64::from(report(n).k);
        if k < top { k } else { f64::NAN }
    });
    let mut throw = Panel::new(time(), Axis::new("k", Unit::NONE, 0.0, top)).height(190.0);
    if let Some(band) = band {
        throw = throw.shelf(
            &format!("band of order {} for the whole lot", band.order()),
            band.low(),
            band.high(),
        );
    }
    throw = throw.line("k measured", 0, k);
    // The short hops of a chatter say nothing that its first ones do not; of the rest, an even choice.
    let fastest = outcome
        .strikes()
        .iter()
        .map(|(_, strike)| strike.speed)
        .fold(0.0, f64::max);
    let told: Vec<(f64, f64)> = outcome
        .strikes()
        .iter()
        .filter(|(_, strike)| strike.speed > 0.05 * fastest)
        .map(|(time, strike)| (f64::from(*time), strike.phase))
        .collect();
    let stride = told.len().div_ceil(MARKERS).max(1);
    let struck: Vec<(f64, f64)> = told.into_iter().step_by(stride).collect();
    let mut phases = Panel::new(
        time(),
        Axis::new(
            "phase at impact",
            Unit::new("rad"),
            0.0,
            std::f64::consts::TAU,
        )
        .in_pi(),
    )
    .height(190.0)
    .markers("impacts of the parts", 0, struck);
    if let Some(expected) = outcome.expected_phase() {
        phases = phases.level(expected, "lock");
    }
    let settings = &outcome.file().scene.settings;
    Picture::new("A feeder under control")
        .caption(format!(
            "{} Hz, incline {} degrees, R {}..{}, Q {}, target {}",
            settings.frequency,
            settings.incline,
            settings.restitution_low,
            settings.restitution_high,
            settings.quality,
            describe(outcome.target())
        ))
        .panel(amplitude)
        .panel(throw)
        .panel(phases)
}

fn telling(event: Event) -> bool {
    !matches!(
        event,
        Event::KickEnded | Event::KickPlanned | Event::TargetSet | Event::Stopped
    )
}

/// The points, or the lowest and highest of each stretch where there are many.
fn thin(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    if points.len() <= POINTS {
        return points.to_vec();
    }
    let stretch = points.len().div_ceil(POINTS / 2);
    points
        .chunks(stretch)
        .flat_map(|chunk| {
            let by = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
            let low = chunk.iter().min_by(by);
            let high = chunk.iter().max_by(by);
            let mut pair: Vec<(f64, f64)> = low.into_iter().chain(high).copied().collect();
            pair.sort_by(|a, b| a.0.total_cmp(&b.0));
            pair
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_the_extremes_and_the_order_of_time() {
        let points: Vec<(f64, f64)> = (0..50_000)
            .map(|n| {
                (
                    f64::from(n),
                    if n == 31_234 { 9.0 } else { f64::from(n % 7) },
                )
            })
            .collect();
        let thinned = thin(&points);
        assert!(thinned.len() <= POINTS);
        assert!(thinned.contains(&(31_234.0, 9.0)));
        assert!(thinned.windows(2).all(|pair| pair[0].0 <= pair[1].0));
    }
}
