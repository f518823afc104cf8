//! `kband margins`: gain and phase margin of the amplitude loop.

use kband::control::{LoopMargins, Settings};
use serde_json::json;

use crate::arguments::{Drawn, Printed};
use crate::desk::Desk;
use crate::picture::{Axis, Panel, Picture, Unit};
use crate::refusal::{Exit, Refusal};
use crate::report::{Printout, Table, columns};

/// The margins of the loop that holds the track's amplitude, on drives at their resonance and
/// beside it.
///
/// In cycles of the drive the loop is the same at every frequency.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband margins
  kband margins --out margins.svg
  kband margins --format json

Each row is a quality, and the true gain over the one told; of detunings up to 20 % to either side it shows the least margins and where they are.
Where a drive is told as it is, the loop off the resonance has no feedback but from what was not told; its margins are those of a loop that is told nothing.")]
pub struct Arguments {
    #[command(flatten)]
    printed: Printed,

    #[command(flatten)]
    drawn: Drawn,
}

const QUALITIES: [f32; 7] = [3.0, 5.0, 10.0, 25.0, 50.0, 100.0, 200.0];
/// Those that are drawn.
const DRAWN: [usize; 5] = [0, 2, 3, 4, 6];
/// True gain over the configured one.
const WRONG: [f32; 3] = [1.0, 0.5, 2.0];
/// Margins beyond are drawn there.
const HIGHEST: f64 = 100.0;

/// Drive frequency over resonance less 1: -0.2..0.2, dense where the resonance is.
fn detunings() -> Vec<f32> {
    (-120..=120)
        .map(|n| {
            let part = n as f32 / 120.0;
            0.2 * part * part.abs()
        })
        .collect()
}

/// Margins over the detuning, with wrong settings of quality and gain.
struct Line {
    quality: f32,
    wrong: f32,
    margins: Vec<(f32, LoopMargins)>,
}

impl Line {
    fn of(quality: f32, wrong: f32) -> Result<Self, Refusal> {
        let margins = detunings().into_iter().map(|detuning| {
            let told = Settings {
                quality,
                frequency: 50.0 * (1.0 + detuning),
                ..Settings::default()
            };
            let is = Settings {
                gain: wrong * told.gain,
                ..told
            };
            Ok((detuning, LoopMargins::of(&told, &is)?))
        });
        Ok(Self {
            quality,
            wrong,
            margins: margins.collect::<Result<_, Refusal>>()?,
        })
    }

    /// The least of a margin, and the detuning.
    fn least(&self, margin: impl Fn(&LoopMargins) -> f64) -> (f64, f32) {
        let least = (self.margins.iter())
            .map(|(detuning, margins)| (margin(margins), *detuning))
            .min_by(|one, other| one.0.total_cmp(&other.0));
        least.unwrap_or((f64::INFINITY, 0.0))
    }
}

/// Prints the least margins and draws all.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let output = arguments.drawn.output()?;
    let all: Vec<(f32, f32)> = (WRONG.iter())
        .flat_map(|wrong| QUALITIES.map(|quality| (quality, *wrong)))
        .collect();
    let lines = desk.try_map("margins", all.len(), |n| Line::of(all[n].0, all[n].1))?;
    let report = report(&lines)?;
    report.print(arguments.printed.format)?;
    output.write(&report, || picture(&lines))?;
    Ok(Exit::Done)
}

fn report(lines: &[Line]) -> Result<Printout, Refusal> {
    let mut table = Table::new(&[
        columns::QUALITY.digits(3),
        columns::GAIN_OVER_TOLD.titled("gain over told").digits(2),
        columns::GAIN_MARGIN.titled("gain margin").digits(4),
        columns::GAIN_MARGIN_DETUNING
            .titled("at detuning")
            .digits(3),
        columns::PHASE_MARGIN
            .titled("phase margin (degrees)")
            .digits(4),
        columns::PHASE_MARGIN_DETUNING
            .titled("at detuning")
            .digits(3),
    ]);
    let mut rows = Vec::new();
    for line in lines {
        let (gain, gain_at) = line.least(|margins| margins.gain);
        let (phase, phase_at) = line.least(|margins| margins.phase);
        let as_told = |detuning: f32| f64::from(detuning);
        table.push([
            f64::from(line.quality).into(),
            f64::from(line.wrong).into(),
            gain.into(),
            as_told(gain_at).into(),
            phase.into(),
            as_told(phase_at).into(),
        ]);
        rows.push(json!({
            "quality": line.quality,
            "gain_over_told": line.wrong,
            "gain_margin": gain,
            "gain_margin_detuning": gain_at,
            "phase_margin": phase,
            "phase_margin_detuning": phase_at,
        }));
    }
    Printout::new(table)
        .heading("amplitude loop, detuned by up to 20 % to either side; the same at 5 to 500 Hz")
        .note("gain margin: the factor on the loop's gain at which the amplitude swings for ever; phase margin: the lag more")
        .json(&rows)
}

fn picture(lines: &[Line]) -> Picture {
    let detuning = || {
        Axis::new(
            "drive frequency over resonance, less 1",
            Unit::new("%"),
            -20.0,
            20.0,
        )
    };
    let panel = |wrong: f32, axis: Axis, margin: &dyn Fn(&LoopMargins) -> f64| {
        let mut panel = Panel::new(detuning(), axis).height(230.0);
        let shown = lines.iter().filter(|line| line.wrong == wrong);
        let shown = shown.filter(|line| DRAWN.iter().any(|n| QUALITIES[*n] == line.quality));
        for (n, line) in shown.enumerate() {
            let points = (line.margins.iter())
                .map(|(detuning, found)| (f64::from(*detuning) * 100.0, margin(found)))
                .collect();
            panel = panel.line(&format!("Q {}", line.quality), n, points);
        }
        panel
    };
    let gain = |margins: &LoopMargins| margins.gain.min(HIGHEST);
    let factor = |label: &str| Axis::new(label, Unit::NONE, 1.0, HIGHEST).logarithmic();
    Picture::new("Margins of the amplitude loop")
        .caption("at any drive frequency; each line a quality of the drive")
        .panel(panel(1.0, factor("gain margin"), &gain))
        .panel(panel(
            1.0,
            Axis::new("phase margin", Unit::new("degrees"), 0.0, 180.0),
            &|margins| margins.phase,
        ))
        .panel(panel(
            2.0,
            factor("gain margin at twice the gain told"),
            &gain,
        ))
}
