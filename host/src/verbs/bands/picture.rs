//! The bands of a wave over restitution, beside those of one tone.

use kband::feeder::Track;
use kband::impact::Wave;
use kband::regime::wave_band::WaveBands;
use kband::transport::locked;

use super::{AMPLITUDE_RATIO, Arguments, TANGENTIAL_RESTITUTION, along};
use crate::desk::Desk;
use crate::picture::{Axis, Panel, Picture, Unit};
use crate::refusal::Refusal;

/// Restitutions at which the bands are drawn, up to the highest.
const PLACES: usize = 71;
const HIGHEST: f64 = 0.7;

/// The bands of order 1 of one wave: low and high end for each restitution, the widest of each.
type Bands = Vec<(f64, f64, f64)>;

/// What the picture shows.
#[derive(Default)]
pub(super) struct Drawing {
    one_tone: Bands,
    wave: Option<Bands>,
    /// Speed in lock in mm/s.
    speed: Vec<(f64, f64)>,
}

fn restitution(n: usize) -> f64 {
    HIGHEST * n as f64 / (PLACES - 1) as f64
}

/// Computes the bands of order 1 over restitution.
pub(super) fn compute(wave: &Wave, track: &Track, desk: &Desk) -> Result<Drawing, Refusal> {
    let bands = |wave: &Wave| -> Result<Bands, Refusal> {
        desk.try_map("bands over R", PLACES, |n| {
            let widest = WaveBands::of(wave, restitution(n), 1)?
                .iter()
                .map(|band| (band.low.k, band.high.k))
                .max_by(|a, b| (a.1 - a.0).total_cmp(&(b.1 - b.0)));
            let (low, high) = widest.unwrap_or((f64::NAN, f64::NAN));
            Ok((restitution(n), low, high))
        })
    };
    let along = along(track);
    let unit = 1e3 * track.velocity_unit(track.amplitude(1.0));
    Ok(Drawing {
        one_tone: bands(&Wave::sine())?,
        wave: if wave.is_sine() {
            None
        } else {
            Some(bands(wave)?)
        },
        speed: (0..PLACES)
            .map(restitution)
            .map(|r| (r, unit * locked::velocity_in_phase(1, 1.0, r, &along)))
            .collect(),
    })
}

/// Draws them.
pub(super) fn draw(arguments: &Arguments, wave: &Wave, drawing: &Drawing) -> Picture {
    let lot = arguments.restitution;
    let axis = || Axis::new("restitution R", Unit::NONE, 0.0, HIGHEST);
    let all = drawing.one_tone.iter().chain(drawing.wave.iter().flatten());
    let top = all.map(|band| band.2).fold(0.5, f64::max);
    let mut bands = Panel::new(axis(), Axis::new("k", Unit::NONE, 0.0, 1.05 * top))
        .height(330.0)
        .between("one tone", 1, drawing.one_tone.clone());
    let second = wave.second();
    if let Some(wave) = &drawing.wave {
        let name = format!("e = {}, th = {} rad", second.amplitude, second.angle);
        bands = bands.between(&name, 0, wave.clone());
    }
    for (at, words) in [(lot.low(), "lot"), (lot.high(), "")] {
        bands = bands.mark(at, words);
    }
    let fastest = drawing
        .speed
        .iter()
        .map(|point| point.1)
        .fold(1.0, f64::max);
    let slowest = drawing
        .speed
        .iter()
        .map(|point| point.1)
        .fold(0.0, f64::min);
    let speed = Panel::new(
        axis(),
        Axis::new(
            "speed in lock",
            Unit::MILLIMETRES_A_SECOND,
            slowest,
            1.05 * fastest,
        ),
    )
    .height(190.0)
    .line(
        "of one tone and of two, at every amplitude",
        0,
        drawing.speed.clone(),
    );
    Picture::new("Bands of order 1 over restitution")
        .caption(format!(
            "k between which a part locks: below, its lock doubles or touches; above, none is born. {} Hz, incline {}\u{b0}, eta \
             {AMPLITUDE_RATIO}, Rt {TANGENTIAL_RESTITUTION}",
            arguments.drive.frequency, arguments.drive.incline
        ))
        .panel(bands)
        .panel(speed)
}
