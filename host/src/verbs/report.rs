//! `kband report`: an interactive page (HTML) of one feeder.

mod data;

use std::path::{Path, PathBuf};

use kband::feeder::Restitution;
use toml::Value;

use crate::arguments;
use crate::desk::Desk;
use crate::file::Destination;
use crate::page::{self, Page};
use crate::refusal::{Exit, Refusal};
use crate::report::number;
use crate::simulate::{self, Outcome, SceneText};
use data::Feeder;

/// Write one self-contained page for the browser: bands, gear, basins, speed and a run of a feeder,
/// with sliders.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband report
  kband report my.toml --out my.html
  kband report --restitution 0.28..0.32 --scatter 0.06 --frequency 60 --out feeder.html

The page is one file. It needs no other file and no network, can be printed, and follows the \
browser's light or dark theme. The values behind its sliders are computed beforehand on a grid, and \
are in the page as JSON.")]
pub struct Arguments {
    /// Scene file (TOML), `-` for standard input; without one, the default scene.
    #[arg(value_name = "SCENE.toml")]
    scene: Option<PathBuf>,

    /// Restitution of the lot instead of the scene's. The simulated parts have its middle.
    #[arg(long, value_name = "R|LO..HI", value_parser = arguments::restitution)]
    restitution: Option<Restitution>,

    /// Standard deviation of restitution from impact to impact instead of the scene's.
    #[arg(long, value_name = "S", value_parser = arguments::within(0.0, 0.3, ""))]
    scatter: Option<f64>,

    /// Frequency of the drive and of its resonance in Hz instead of the scene's.
    #[arg(long, value_name = "HZ", value_parser = arguments::within(5.0, 500.0, "Hz"))]
    frequency: Option<f64>,

    /// Incline of the track in degrees instead of the scene's.
    #[arg(long, value_name = "DEG", value_parser = arguments::within(-60.0, 60.0, "degrees"))]
    incline: Option<f64>,

    /// Page to write, .html [default: kband-report.html]. A named file is overwritten, the default
    /// only if kband wrote it.
    #[arg(long, value_name = "FILE.html")]
    out: Option<PathBuf>,
}

const PAGE: &str = "kband-report.html";

const FIGURES: &str = include_str!("report/figures.js");

/// Computes and writes the page.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let read = SceneText::read(arguments.scene.as_deref())?;
    let mut table = read.table.clone();
    arguments.adapt(&mut table);
    let scene = read.scene(&table)?;
    let target = match &arguments.out {
        Some(path) => Destination::output(path, "html")?,
        None => Destination::default_name(Path::new(PAGE), page::own, "--out FILE.html")?,
    };
    target.ends_in("--out", &["html", "htm"])?;
    let outcome = simulate::run(&scene, desk)?;
    let feeder = Feeder::of(&outcome)?;
    let written = toml::to_string(&table).unwrap_or_default();
    let page = page(&feeder, &outcome, &written, desk)?;
    target.write_bytes(page.to_html().as_bytes())?;
    eprintln!("{}", target.told());
    Ok(Exit::Done)
}

impl Arguments {
    /// Replaces values of the scene's table by those of the command line.
    fn adapt(&self, table: &mut toml::Table) {
        let mut put = |section: &str, key: &str, value: Value| {
            if let Some(Value::Table(section)) = table.get_mut(section) {
                section.insert(key.into(), value);
            }
        };
        if let Some(lot) = self.restitution {
            let ends = [lot.low(), lot.high()].map(Value::Float);
            put("part", "restitution", Value::Array(ends.into()));
            put(
                "part",
                "actual",
                Value::Array(vec![Value::Float(lot.middle())]),
            );
        }
        if let Some(scatter) = self.scatter {
            put("part", "scatter", Value::Float(scatter));
        }
        if let Some(frequency) = self.frequency {
            put("track", "frequency", Value::Float(frequency));
            put("drive", "resonance", Value::Float(frequency));
        }
        if let Some(incline) = self.incline {
            put("track", "incline", Value::Float(incline));
        }
    }
}

fn page(feeder: &Feeder, outcome: &Outcome, written: &str, desk: &Desk) -> Result<Page, Refusal> {
    let data = data::all(feeder, outcome, desk)?;
    let heads = [
        "order",
        "b / mm",
        "setpoint / mm",
        "margin / %",
        "throw number",
        "peak / g",
    ];
    let mut spoken = super::simulate::plain_words(outcome);
    if feeder.has_contact_time() {
        spoken.push(
            "The figure of bands below is that of impacts in no time. The others have the contact time of \
             the scene."
                .into(),
        );
    }
    let words = page::paragraphs(&spoken)
        + &page::table(&heads, &feeder.bands_in_words())
        + &page::folded("the scene", written)
        + &page::folded(
            "how this page was made",
            &format!("{:#}", data["provenance"]),
        );
    Ok(Page::new(&format!("A feeder at {} Hz", number(feeder.frequency(), 6)), data, FIGURES)
        .section("In plain words", &words)
        .section(
            "Where parts lock",
            &page::figure(
                "bands",
                "Between these amplitudes a part of constant restitution locks to the drive: with more its lock doubles or touches, with \
                 less none is born. The strip is what all parts of the lot share.",
            ),
        )
        .section(
            "How much of the time parts are in gear",
            &page::figure(
                "gear",
                "Share of time in gear over the amplitude, from rest and without a kick, mean over the lot and the part that is in gear \
                 least, by how much restitution scatters from impact to impact.",
            ),
        )
        .section(
            "Where a part ends by how it starts",
            &page::figure(
                "basins",
                "Regime in which a part of the lot's middle ends, by the phase and velocity with which it leaves the track; without scatter.",
            ),
        )
        .section(
            "How fast parts travel",
            &page::figure(
                "transport",
                "Mean conveying speed of a part that starts from rest, with Coulomb's friction, sliding included; S: always in contact, \
                 H-S: hops and lies, H: hops on.",
            ),
        )
        .section(
            "A run of the controller",
            &(page::figure("amplitude", "Amplitude of the track over time, measured and as the controller asks for it.")
                + &page::figure("phases", "Phase of the drive at the impacts of the parts over time.")
                + &page::figure("share", "Share of time in gear over time, as the controller estimates it.")),
        ))
}
