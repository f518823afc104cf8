//! The timeline picture of a scene.

use kband_control::{Event, State, Target};
use kband_plant::PARTS;
use kband_scene::{Curve, Outcome, Sketch, band_name, describe, part_group};

use crate::picture::{Axis, Fill, Panel, Picture};
use crate::report::{span, when};

const MAX_MARKERS: usize = 600;

pub const STATE_FILLS: [(Fill, &str); 6] = [
    (Fill::Rest, "off"),
    (Fill::HopAndRest, "starting, stopping, holding"),
    (Fill::Undecided, "capturing, lost"),
    (Fill::Locked, "locked"),
    (Fill::Chaotic, "limiting"),
    (Fill::Fault, "fault"),
];

pub fn state_fill(state: State) -> Fill {
    match state {
        State::Off => Fill::Rest,
        State::Starting | State::Stopping | State::Holding => Fill::HopAndRest,
        State::Capturing | State::Lost => Fill::Undecided,
        State::Locked => Fill::Locked,
        State::Limiting => Fill::Chaotic,
        State::Fault => Fill::Fault,
    }
}

/// Draws b, k with the band, impact phases and state over time; `None` if the run has no sketch.
pub fn draw(outcome: &Outcome) -> Option<Picture> {
    let sketch = outcome.record().sketch.as_ref()?;
    let end = if sketch.time > 0.0 { sketch.time } else { 1.0 };
    let time = || Axis::new("time", "s", 0.0, end);
    let in_mm = |curve: &Curve| -> Vec<(f64, f64)> {
        let points = curve.drawn().into_iter();
        points.map(|(time, b)| (time, b * 1e3)).collect()
    };
    let (b, reference) = (in_mm(&sketch.amplitude), in_mm(&sketch.reference));
    let both = b.iter().chain(&reference).map(|point| point.1);
    let highest = both.fold(0.0, f64::max);
    let states = &sketch.states;
    let ribbon = states.iter().enumerate().map(|(n, (from, state))| {
        let until = states.get(n + 1).map_or(end, |next| next.0);
        (*from, until, state_fill(*state))
    });
    let mut amplitude = Panel::new(time(), Axis::new("amplitude b", "mm", 0.0, highest * 1.08))
        .height(190.0)
        .ribbon(ribbon, &STATE_FILLS)
        .line("measured", 0, b)
        .line("reference", 1, reference);
    let mut last = f64::NEG_INFINITY;
    for happened in outcome.events() {
        let at = happened.time;
        // Labels of close events would overlap; a fault always has its label.
        let is_separate = at - last > 0.035 * end || happened.event == Event::Faulted;
        if is_labelled(happened.event) && is_separate {
            amplitude = amplitude.mark(at, happened.name());
            last = at;
        }
    }
    let k_last = outcome.k();
    let band = outcome.band();
    // k is infinite with the drive off; the range then follows from the band.
    let levels = [Some(k_last), band.map(|band| band.high())];
    let levels = levels.into_iter().flatten().filter(|k| k.is_finite());
    let top = levels.reduce(f64::max).map_or(2.0, |highest| 1.6 * highest);
    let visible = |(time, k)| (time, if k < top { k } else { f64::NAN });
    let k = sketch.k.drawn().into_iter().map(visible).collect();
    let mut throw = Panel::new(time(), Axis::new("k", "", 0.0, top)).height(190.0);
    // Band and phase of the lock apply to one tone.
    let alone = outcome.last().shape.is_sine();
    let lock = band.filter(|_| alone);
    if let Some([low, high]) = outcome.last().target_band {
        throw = throw.shelf(band_name(outcome.target()), low.into(), high.into());
        if let Some(band) = lock {
            let name = if outcome.file().scatters() {
                "lock without scatter"
            } else {
                "lock"
            };
            let low = throw.level(band.low(), name);
            throw = low.level(band.high(), "");
        }
    } else if let Some(band) = lock {
        let scatters = when(outcome.file().scatters(), || ", did it not scatter");
        let name = format!("band of order {} for the whole lot{scatters}", band.order());
        throw = throw.shelf(&name, band.low(), band.high());
    }
    throw = throw.line("k measured", 0, k);
    // The short hops of chatter are left out; of the other impacts every `stride`-th is drawn.
    let impacts = sketch.impacts.iter();
    let speeds = impacts.clone().map(|(_, strike)| strike.speed);
    let fastest = speeds.fold(0.0, f64::max);
    let marked: Vec<_> = impacts
        .filter(|(_, strike)| strike.speed > 0.05 * fastest)
        .collect();
    let phase = Axis::new("phase at impact", "rad", 0.0, std::f64::consts::TAU).in_pi();
    let mut phases = Panel::new(time(), phase).height(190.0);
    let stride = marked.len().div_ceil(MAX_MARKERS).max(1);
    let groups = part_group(&outcome.file().scene.parts);
    for (series, part_group) in groups.into_iter().enumerate() {
        // Counted part by part, because parts may strike in turn.
        let mut counts = [0_usize; PARTS];
        let chosen = marked.iter().filter(|(_, strike)| {
            let count = &mut counts[usize::from(strike.part)];
            *count += 1;
            part_group.parts.contains(&strike.part) && (*count - 1).is_multiple_of(stride)
        });
        let struck: Vec<_> = chosen.map(|(time, strike)| (*time, strike.phase)).collect();
        if !struck.is_empty() {
            phases = phases.markers(&part_group.name, series, struck);
        }
    }
    if let Some(expected) = outcome.expected_phase().filter(|_| alone) {
        phases = phases.level(expected, "lock");
    }
    let settings = &outcome.file().scene.settings;
    let [low, high] = [settings.restitution_low, settings.restitution_high].map(f64::from);
    let regime = || format!(", restitution scatters: {}", outcome.regime());
    let scatter = when(outcome.file().scatters(), regime);
    let mut picture = Picture::new("A feeder under control")
        .caption(format!(
            "{} Hz, incline {}°, R {}, Q {}, target {}{scatter}",
            settings.frequency,
            settings.incline,
            span(low, high, 4),
            settings.quality,
            describe(outcome.target())
        ))
        .panel(amplitude)
        .panel(throw)
        .panel(phases);
    if outcome.file().scatters() {
        let share = Axis::new("share of time in gear", "", 0.0, 1.05);
        let gear = Panel::new(time(), share).height(140.0);
        let mut gear = gear.line("estimated", 0, sketch.in_gear.drawn());
        if let Some(share) = outcome.in_gear() {
            gear = gear.level(share, "true, mean");
        }
        picture = picture.panel(gear);
    }
    if outcome.file().scene.masses.iter().any(|mass| *mass > 0.0) {
        picture = picture.panel(mass(outcome, sketch, time()));
        let length = f64::from(settings.track_length);
        if settings.track_mass > 0.0 && length > 0.0 {
            let truth = outcome.mass() * outcome.speed() * 1e3 / length;
            picture = picture.panel(flow(outcome, sketch.flow.drawn(), truth, time()));
        }
    }
    Some(picture)
}

fn mass(outcome: &Outcome, sketch: &Sketch, time: Axis) -> Panel {
    let mut truth: Vec<(f64, f64)> = Vec::new();
    for (from, mass) in outcome.masses() {
        let before = truth.last().map(|last| (from, last.1));
        truth.extend(before);
        truth.push((from, mass));
    }
    truth.extend(truth.last().map(|last| (sketch.time, last.1)));
    let weighed = sketch.mass.drawn();
    let highest = highest(truth.iter().chain(&weighed));
    let mass = Axis::new("mass on the track", "g", 0.0, 1.15 * highest);
    let panel = Panel::new(time, mass).height(140.0).line("true", 1, truth);
    if weighed.iter().all(|point| !point.1.is_finite()) {
        return panel;
    }
    panel.line("weighed", 0, weighed)
}

fn flow(outcome: &Outcome, weighed: Vec<(f64, f64)>, truth: f64, time: Axis) -> Panel {
    let requested = match outcome.target() {
        Target::Flow(flow) => Some(f64::from(flow)),
        _ => None,
    };
    let ends = [Some(truth), requested];
    let ends = ends.into_iter().flatten().map(|flow| (0.0, flow));
    let all: Vec<(f64, f64)> = weighed.iter().copied().chain(ends).collect();
    let lowest = all.iter().fold(0.0, |low, point| point.1.min(low));
    let flow = Axis::new("flow", "g/s", 1.15 * lowest, 1.15 * highest(&all));
    let mut panel = Panel::new(time, flow)
        .height(140.0)
        .line("weighed", 0, weighed)
        .level(truth, "true, at the end");
    let is_apart = |requested: &f64| (requested - truth).abs() > 0.1 * truth.abs();
    if let Some(requested) = requested.filter(is_apart) {
        panel = panel.level(requested, "target");
    }
    panel
}

/// Largest value of a curve; 1 if it is not positive.
fn highest<'a>(points: impl IntoIterator<Item = &'a (f64, f64)>) -> f64 {
    let values = points.into_iter().map(|point| point.1);
    let highest = values.fold(0.0, f64::max);
    if highest > 0.0 { highest } else { 1.0 }
}

fn is_labelled(event: Event) -> bool {
    use Event::{KickEnded, KickPlanned, Stopped, TargetSet};
    !matches!(event, KickEnded | KickPlanned | TargetSet | Stopped)
}
