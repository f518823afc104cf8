//! `kband report`: an interactive page (HTML) of one feeder.

mod data;

use std::path::{Path, PathBuf};

use crate::desk::Desk;
use crate::file::Destination;
use crate::page::{self, Page};
use crate::refusal::{Exit, Result};
use crate::report::number;
use crate::simulate::{self, Outcome, SceneText};
use data::Feeder;

/// Write one self-contained page for the browser: bands, gear, basins, speed and a run of a feeder,
/// with sliders.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband report
  kband report my.toml --out my.html

The page is one file. It needs no other file and no network, can be printed, and follows the \
browser's light or dark theme. The values behind its sliders are computed beforehand on a grid, and \
are in the page as JSON.")]
pub struct Arguments {
    /// Scene file (TOML), `-` for standard input; without one, the default scene.
    #[arg(value_name = "SCENE.toml")]
    scene: Option<PathBuf>,
    /// Page to write, .html [default: kband-report.html]. A named file is overwritten, the default
    /// only if kband wrote it.
    #[arg(long, value_name = "FILE.html")]
    out: Option<PathBuf>,
}

const PAGE: &str = "kband-report.html";

const FIGURES: &str = include_str!("report/figures.js");

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let read = SceneText::read(arguments.scene.as_deref())?;
    let scene = read.scene(&read.table)?;
    let target = match &arguments.out {
        Some(path) => Destination::output(path, "html")?,
        None => Destination::default_name(Path::new(PAGE), page::own, "--out FILE.html")?,
    };
    target.ends_in("--out", &["html", "htm"])?;
    let outcome = simulate::run(&scene, desk)?;
    let feeder = Feeder::from_outcome(&outcome)?;
    let written = toml::to_string(&read.table).unwrap_or_default();
    let page = page(&feeder, &outcome, &written, desk)?;
    target.write_bytes(page.to_html().as_bytes())?;
    eprintln!("{}", target.describe_write());
    Ok(Exit::Done)
}

fn page(feeder: &Feeder, outcome: &Outcome, written: &str, desk: &Desk) -> Result<Page> {
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
    let provenance = format!("{:#}", data["provenance"]);
    let text = page::paragraphs(&spoken)
        + &page::table(&heads, &feeder.bands_in_words())
        + &page::folded("the scene", written)
        + &page::folded("how this page was made", &provenance);
    Ok(Page::new(&format!("A feeder at {} Hz", number(feeder.frequency(), 6)), data, FIGURES)
        .section("In plain words", &text)
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
