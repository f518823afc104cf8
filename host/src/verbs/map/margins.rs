//! `kband margins`: gain margin (1) and phase margin (degrees) of the amplitude loop.

use kband_control::{LoopMargins, Settings};

use crate::arguments::OutputArguments;
use crate::desk::Desk;
use crate::picture::{Axis, Panel, Picture};
use crate::refusal::{Exit, Result};
use crate::report::{Printout, fields};

/// Compute the stability margins of the amplitude loop, on drives at their resonance and beside it.
///
/// In drive cycles the loop is the same at every frequency.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband margins
  kband margins --out margins.svg
  kband margins --format json

Each row is a quality and a gain ratio: true gain over configured gain. It shows the least margins over detunings up to 20 % to either side, and their detuning.
Off the resonance of a correctly configured drive, the loop feeds back only the deviation from its model. Its margins are those of a loop without a model.")]
pub struct Arguments {
    #[command(flatten)]
    output: OutputArguments,
}

const QUALITIES: [f32; 7] = [3.0, 5.0, 10.0, 25.0, 50.0, 100.0, 200.0];
const DRAWN_QUALITIES: [f32; 5] = [3.0, 10.0, 25.0, 50.0, 200.0];
/// True gain over the configured one.
const GAIN_RATIOS: [f32; 3] = [1.0, 0.5, 2.0];
/// Largest drawn gain margin; larger ones are drawn at this value.
const MAX_DRAWN_MARGIN: f64 = 100.0;

struct Line {
    quality: f32,
    gain_ratio: f32,
    margins: Vec<(f32, LoopMargins)>,
}

impl Line {
    fn new((quality, gain_ratio): (f32, f32)) -> Result<Self> {
        // Detunings, drive frequency over resonance minus 1, denser near the resonance.
        let parts = (-120..=120).map(|n| n as f32 / 120.0);
        let detunings = parts.map(|part| 0.2 * part * part.abs());
        let margins = detunings.map(|detuning| {
            let configured = Settings {
                quality,
                frequency: 50.0 * (1.0 + detuning),
                ..Settings::default()
            };
            let actual = Settings {
                gain: gain_ratio * configured.gain,
                ..configured
            };
            Ok((detuning, LoopMargins::from_settings(&configured, &actual)?))
        });
        Ok(Self {
            quality,
            gain_ratio,
            margins: margins.collect::<Result<_>>()?,
        })
    }

    fn min_margin(&self, margin: impl Fn(&LoopMargins) -> f64) -> (f64, f64) {
        let margins = self.margins.iter();
        let margins = margins.map(|(detuning, at)| (margin(at), f64::from(*detuning)));
        let least = margins.min_by(|one, other| one.0.total_cmp(&other.0));
        least.unwrap_or((f64::INFINITY, 0.0))
    }
}

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let output = arguments.output.check()?;
    let all: Vec<(f32, f32)> = (GAIN_RATIOS.iter())
        .flat_map(|ratio| QUALITIES.map(|quality| (quality, *ratio)))
        .collect();
    let lines = desk.try_map("margins", all.len(), |n| Line::new(all[n]))?;
    output.show(&report(&lines), || picture(&lines))
}

fields! {
    fn min_margin(line: Line) {
        all QUALITY.digits(3) => f64::from(line.quality);
        all GAIN_RATIO.titled("gain ratio").digits(2) => f64::from(line.gain_ratio);
        all GAIN_MARGIN.titled("gain margin").digits(4) => line.min_margin(|margins| margins.gain).0;
        all GAIN_MARGIN_DETUNING.titled("at detuning").digits(3) => line.min_margin(|margins| margins.gain).1;
        all PHASE_MARGIN.titled("phase margin (degrees)").digits(4) => line.min_margin(|margins| margins.phase).0;
        all PHASE_MARGIN_DETUNING.titled("at detuning").digits(3) => line.min_margin(|margins| margins.phase).1;
    }
}

fn report(lines: &[Line]) -> Printout {
    min_margin()
        .printout(lines)
        .heading("amplitude loop, detuned by up to 20 % to either side; the same at 5 to 500 Hz")
        .note("gain margin: factor on the loop gain at the limit of stability; phase margin: additional lag there")
}

fn picture(lines: &[Line]) -> Picture {
    let detuning = || Axis::new("drive frequency over resonance, less 1", "%", -20.0, 20.0);
    let panel = |gain_ratio: f32, axis: Axis, margin: &dyn Fn(&LoopMargins) -> f64| {
        let mut panel = Panel::new(detuning(), axis).height(230.0);
        let drawn = lines.iter().filter(|line| line.gain_ratio == gain_ratio);
        let drawn = drawn.filter(|line| DRAWN_QUALITIES.contains(&line.quality));
        for (n, line) in drawn.enumerate() {
            let points = (line.margins.iter())
                .map(|(detuning, margins)| (f64::from(*detuning) * 100.0, margin(margins)))
                .collect();
            panel = panel.line(&format!("Q {}", line.quality), n, points);
        }
        panel
    };
    let gain = |margins: &LoopMargins| margins.gain.min(MAX_DRAWN_MARGIN);
    let factor = |label: &str| Axis::new(label, "", 1.0, MAX_DRAWN_MARGIN).logarithmic();
    let phase = Axis::new("phase margin", "degrees", 0.0, 180.0);
    let doubled = factor("gain margin at twice the configured gain");
    Picture::new("Margins of the amplitude loop")
        .caption("at any drive frequency; each line a quality of the drive")
        .panel(panel(1.0, factor("gain margin"), &gain))
        .panel(panel(1.0, phase, &|margins| margins.phase))
        .panel(panel(2.0, doubled, &gain))
}
