//! Bands of a wave over restitution, beside those of one tone.

use kband::feeder::Track;
use kband::impact::Wave;
use kband::regime::band::Band;
use kband::regime::wave_band::WaveBands;
use kband::transport::locked;

use super::{AMPLITUDE_RATIO, Arguments, TANGENTIAL_RESTITUTION, along};
use crate::desk::Desk;
use crate::picture::{Axis, Panel, Picture};
use crate::refusal::Refusal;
use crate::report::number;

/// Number of restitutions at which the bands are drawn, and the largest one.
const RESTITUTION_STEPS: usize = 71;
const MAX_RESTITUTION: f64 = 0.7;

/// Bands of order 1 of one wave: restitution, low end and high end of the widest one.
type Bands = Vec<(f64, f64, f64)>;

#[derive(Default)]
pub(super) struct Drawing {
    one_tone: Bands,
    wave: Option<Bands>,
    speed: Vec<(f64, f64)>,
}

fn restitution(n: usize) -> f64 {
    MAX_RESTITUTION * n as f64 / (RESTITUTION_STEPS - 1) as f64
}

pub(super) fn compute(wave: &Wave, track: &Track, desk: &Desk) -> Result<Drawing, Refusal> {
    let bands = |wave: &Wave| -> Result<Bands, Refusal> {
        desk.try_map("bands over R", RESTITUTION_STEPS, |n| {
            let found = WaveBands::find(wave, restitution(n), 1)?;
            let ends = found.iter().map(|band| (band.low.k, band.high.k));
            let widest = ends.max_by(|a, b| (a.1 - a.0).total_cmp(&(b.1 - b.0)));
            let (low, high) = widest.unwrap_or((f64::NAN, f64::NAN));
            Ok((restitution(n), low, high))
        })
    };
    let along = along(track);
    let unit = 1e3 * track.velocity_unit(track.amplitude(1.0));
    let speed = |r| (r, unit * locked::velocity_in_phase(1, 1.0, r, &along));
    let tones = Some(wave).filter(|wave| !wave.is_sine());
    Ok(Drawing {
        one_tone: bands(&Wave::sine())?,
        wave: tones.map(bands).transpose()?,
        speed: (0..RESTITUTION_STEPS).map(restitution).map(speed).collect(),
    })
}

/// Draws the bands in mm, to set a feeder, and in k, to compare feeders.
pub(super) fn draw(
    arguments: &Arguments,
    wave: &Wave,
    track: &Track,
    drawing: &Drawing,
) -> Picture {
    let lot = arguments.restitution;
    let axis = || Axis::new("restitution R", "", 0.0, MAX_RESTITUTION);
    let second = wave.second();
    let two_tones = format!("e = {}, th = {} rad", second.amplitude, second.angle);
    let over = |label: &str, unit: &'static str, scale: &dyn Fn(f64) -> f64| {
        let scaled = |bands: &Bands| -> Bands {
            let ends = |&(r, low, high): &(f64, f64, f64)| {
                let (one, other) = (scale(low), scale(high));
                (r, one.min(other), one.max(other))
            };
            bands.iter().map(ends).collect()
        };
        let one_tone = scaled(&drawing.one_tone);
        let wave = drawing.wave.as_ref().map(scaled);
        let all = one_tone.iter().chain(wave.iter().flatten());
        let top = all.map(|band| band.2).fold(0.0, f64::max);
        let mut panel = Panel::new(axis(), Axis::new(label, unit, 0.0, 1.05 * top))
            .between("one tone", 1, one_tone);
        if let Some(wave) = wave {
            panel = panel.between(&two_tones, 0, wave);
        }
        for (at, label) in [(lot.low(), "your lot"), (lot.high(), "")] {
            panel = panel.mark(at, label);
        }
        panel
    };
    let millimetres = |k: f64| 1e3 * track.amplitude(k);
    let mut amplitude = over("amplitude b normal to the track", "mm", &millimetres).height(330.0);
    if let (true, Ok(band)) = (wave.is_sine(), Band::common(lot, 1)) {
        let b = millimetres(band.setpoint());
        amplitude = amplitude.level(b, format!("setpoint {} mm", number(b, 3)));
    }
    let bands = over("k = g cos α / (b ω²)", "", &|k| k).height(230.0);
    let speeds = drawing.speed.iter().map(|point| point.1);
    let slowest = speeds.clone().fold(0.0, f64::min);
    let highest = 1.05 * speeds.fold(1.0, f64::max);
    let name = if wave.is_sine() {
        "at every amplitude of the band"
    } else {
        "of one tone and of two, at every amplitude"
    };
    let speed = Panel::new(axis(), Axis::new("speed in lock", "mm/s", slowest, highest))
        .height(190.0)
        .line(name, 0, drawing.speed.clone());
    Picture::new("Bands of order 1 over restitution")
        .caption(format!(
            "Between these amplitudes a part locks: with more its lock doubles or touches, with less none is born. {} Hz, \
             incline {}\u{b0}; speed with eta {AMPLITUDE_RATIO}, Rt {TANGENTIAL_RESTITUTION}",
            arguments.drive.frequency, arguments.drive.incline
        ))
        .panel(amplitude)
        .panel(bands)
        .panel(speed)
}
