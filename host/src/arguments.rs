//! Options shared by the verbs, and parsers of numbers, ranges and restitutions. An error of a
//! parser is one line with the accepted range; clap adds the option and the value.

mod amplitude;

pub use amplitude::{AmplitudeArguments, k_of};

use std::path::{Path, PathBuf};

use clap::builder::ValueParser;
use kband::arithmetic::Noise;
use kband::feeder::{OutOfRange, Restitution, STANDARD_GRAVITY, Track, TrackSettings};
use kband::impact::{ContactTime, Scatter, Tone, Wave};

use crate::file::Destination;
use crate::picture::{Look, PICTURES, Picture};
use crate::refusal::{Exit, Refusal, Result};
use crate::report::{Column, Format, Printout, Rows, rows, when};

/// How the result is printed on standard output.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct FormatArguments {
    /// Form of the result on standard output.
    #[arg(long, value_enum, default_value_t = Format::Table)]
    pub format: Format,
}

/// The file a picture or a table goes to, and how it looks.
#[derive(Clone, Debug, clap::Args)]
pub struct FileArguments {
    /// Also write a file. Its ending selects the content: .svg, .png or .pdf for the picture, .csv
    /// or .json for the numbers. An older file of that name is overwritten. `-` writes the picture
    /// to standard output, `--out=-.png` another form of it.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,

    #[command(flatten)]
    look: Look,
}

/// Where a whole result goes: its form on standard output, and a file with its picture or numbers.
#[derive(Clone, Debug, clap::Args)]
pub struct OutputArguments {
    #[command(flatten)]
    printed: FormatArguments,

    #[command(flatten)]
    drawn: FileArguments,
}

impl OutputArguments {
    /// The destination of the picture or the numbers, checked before anything is computed. A
    /// picture on standard output is refused if `--format` prints numbers there.
    pub fn check(&self) -> Result<Output> {
        self.drawn.check(self.printed.format, false)
    }

    /// The same with a default: without `--out`, a picture called `name` beside a printed table.
    pub fn check_or(&self, name: &str) -> Result<Output> {
        let format = self.printed.format;
        if self.drawn.out.is_some() || format != Format::Table {
            return self.check();
        }
        let target = Destination::default_name(Path::new(name), own_picture, "--out FILE.svg")?;
        let kind = Some((target, Kind::Picture(self.drawn.look)));
        Ok(Output { format, kind })
    }
}

impl FileArguments {
    /// Checked destination; numbers written `by_rows` may also go to a .parquet file.
    pub fn check(&self, format: Format, by_rows: bool) -> Result<Output> {
        let Some(path) = &self.out else {
            return Ok(Output { format, kind: None });
        };
        refuse_two_forms(path, format)?;
        let target = Destination::output(path, "svg")?;
        let kind = match target.ending().as_str() {
            "csv" => Kind::Numbers(Format::Csv),
            "json" => Kind::Numbers(Format::Json),
            "parquet" if by_rows => {
                rows::check("--out", &target)?;
                Kind::Numbers(Format::Csv)
            }
            picture if PICTURES.contains(&picture) => Kind::Picture(self.look),
            other => {
                let key = "ending of --out";
                let accepted = ".svg, .png or .pdf for the picture, .csv or .json for the numbers";
                let next = "give the file one of these endings";
                return Err(Refusal::value(key, format!("'{other}'"), accepted, next));
            }
        };
        let kind = Some((target, kind));
        Ok(Output { format, kind })
    }
}

pub fn own_picture(begin: &str) -> bool {
    begin.starts_with("<svg xmlns") && begin.contains("font-family=\"'DejaVu Sans'")
}

/// Refuses a picture on standard output if `format` prints numbers there.
pub fn refuse_two_forms(path: &Path, format: Format) -> Result<()> {
    if path != Path::new("-") || format == Format::Table {
        return Ok(());
    }
    let cause = "--out - writes a picture to standard output, and --format writes numbers there";
    let next = "leave out --out -, or leave out --format";
    Err(Refusal::new(cause, next))
}

pub struct Output {
    format: Format,
    kind: Option<(Destination, Kind)>,
}

enum Kind {
    Picture(Look),
    Numbers(Format),
}

impl Output {
    /// Calls `work` with the writer of rows; with `None` if the output is a picture or nothing.
    pub fn rows<T>(
        &self,
        columns: &[Column],
        work: impl FnOnce(Option<&mut dyn Rows>) -> Result<T>,
    ) -> Result<T> {
        let target = match &self.kind {
            Some((target, Kind::Numbers(_))) => Some(target),
            _ => None,
        };
        let result = rows::write(target, columns, work)?;
        if let Some(target) = target {
            eprintln!("{}", target.describe_write());
        }
        Ok(result)
    }

    /// Prints `report` and writes its picture or its numbers; prints the file's name on standard
    /// error. Without `--out` it writes nothing and draws no picture.
    pub fn show(&self, report: &Printout, picture: impl FnOnce() -> Picture) -> Result<Exit> {
        report.print(self.format)?;
        if let Some((target, Kind::Numbers(format))) = &self.kind {
            target.write(|out| report.write(*format, out))?;
            eprintln!("{}", target.describe_write());
        }
        self.draw(picture)
    }

    /// Whether `--out` names a picture.
    pub fn is_picture(&self) -> bool {
        matches!(self.kind, Some((_, Kind::Picture(_))))
    }

    /// Writes the picture, if one is wanted; prints the file's name on standard error.
    pub fn draw(&self, picture: impl FnOnce() -> Picture) -> Result<Exit> {
        if let Some((target, Kind::Picture(look))) = &self.kind {
            look.write(target, &picture())?;
            eprintln!("{}", target.describe_write());
        }
        Ok(Exit::Done)
    }
}

/// An evenly spaced range `LO..HI:N`, ends included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    pub low: f64,
    pub high: f64,
    /// Number of values, at least 1.
    pub count: usize,
}

impl Range {
    pub const fn new(low: f64, high: f64, count: usize) -> Self {
        Self { low, high, count }
    }

    /// The values, `low` and `high` exact.
    pub fn values(self) -> impl Iterator<Item = f64> + Clone {
        let last = self.count.saturating_sub(1);
        (0..self.count).map(move |n| match n {
            0 => self.low,
            _ if n == last => self.high,
            _ => self.low + (self.high - self.low) * (n as f64 / last as f64),
        })
    }
}

impl std::fmt::Display for Range {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{}..{}:{}", self.low, self.high, self.count)
    }
}

/// What turns k into an amplitude in mm.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct DriveArguments {
    /// Drive frequency in Hz.
    #[arg(long, value_name = "HZ", default_value = "50", value_parser = within(1.0, 1000.0, "Hz"))]
    pub frequency: f64,

    /// Incline of the track in degrees, positive where parts climb.
    #[arg(long, value_name = "DEG", default_value = "3", value_parser = within(-60.0, 60.0, "degrees"))]
    pub incline: f64,
}

/// Impacts that take time.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct ContactArguments {
    /// Contact time of an impact in ms, at most 7 % of a drive cycle. It ends when the part is back
    /// where it touched the track.
    #[arg(long, value_name = "MS", default_value = "0", value_parser = within(0.0, 70.0, "ms"))]
    pub contact: f64,
}

impl ContactArguments {
    /// Contact time as a phase of a drive of this frequency.
    pub fn time(self, frequency: f64) -> Result<ContactTime> {
        ContactTime::from_milliseconds(self.contact, frequency).map_err(|refused| {
            let next = "give a shorter contact or a lower --frequency";
            Refusal::value("--contact", refused.value, refused.accepted, next)
        })
    }

    /// `, contacts of 0.4 ms` for the text of a result; empty for instantaneous impacts.
    pub fn describe(self) -> String {
        let text = || format!(", contacts of {} ms", self.contact);
        when(self.contact > 0.0, text)
    }
}

/// Upper tones of the track.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct ToneArguments {
    /// Second tone of the track: amplitude over that of the first tone, 0..0.5, and angle in rad.
    #[arg(long, value_name = "E,TH", value_parser = tone)]
    pub second_tone: Option<Tone>,

    /// Third tone, E3 sin(3 t + TH3).
    #[arg(long, value_name = "E3,TH3", value_parser = tone)]
    pub third_tone: Option<Tone>,
}

impl ToneArguments {
    /// The second and the third tone; of amplitude 0 where none is given.
    pub fn upper(self) -> [Tone; 2] {
        [self.second_tone, self.third_tone].map(Option::unwrap_or_default)
    }

    /// Motion of the track, over its first tone's amplitude. The error names a tone out of range.
    pub fn wave(self) -> Result<Wave, OutOfRange> {
        let [second, third] = self.upper();
        Wave::build(second, third)
    }
}

/// Restitution that scatters from impact to impact.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct ScatterArguments {
    /// Standard deviation of the restitution from impact to impact (s). Tumbling bodies have 0.27
    /// to 0.52, which this model does not cover.
    #[arg(long, value_name = "S", default_value = "0", value_parser = within(0.0, 0.3, ""))]
    pub scatter: f64,

    /// Seed of the random restitutions.
    #[arg(long, value_name = "N", default_value = "1", value_parser = seed)]
    pub seed: u64,
}

impl ScatterArguments {
    /// Restitutions of orbit number `stream` about a mean; `None` without scatter.
    pub fn stream(self, mean: f64, stream: u64) -> Result<Option<Scatter>, OutOfRange> {
        if self.scatter == 0.0 {
            return Ok(None);
        }
        // Neighbouring numbers give unrelated streams.
        let mut seeds = Noise::new(self.seed.rotate_left(32).wrapping_add(stream));
        let seed = u64::from(seeds.bits()) << 32 | u64::from(seeds.bits());
        Scatter::build(mean, self.scatter, seed).map(Some)
    }
}

/// Refuses restitution that scatters, for a question that has no answer then.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct NoScatter {
    /// Only 0: this verb computes a result of one restitution.
    #[arg(long, value_name = "S", hide = true, value_parser = within(0.0, 0.3, ""))]
    scatter: Option<f64>,
}

impl NoScatter {
    pub fn check(self, why: &str, next: &str) -> Result<()> {
        match self.scatter {
            Some(scatter) if scatter > 0.0 => {
                let accepted = format!("0: {why}");
                Err(Refusal::value("--scatter", scatter, accepted, next))
            }
            _ => Ok(()),
        }
    }
}

impl DriveArguments {
    /// A track with this amplitude along itself over that normal to it, and this phase lead in
    /// degrees.
    pub fn settings(self, amplitude_ratio: f64, phase_lead: f64) -> TrackSettings {
        TrackSettings {
            frequency: self.frequency,
            incline: self.incline,
            amplitude_ratio,
            phase_lead,
            gravity: STANDARD_GRAVITY,
        }
    }

    /// The track, with motion normal to it alone.
    pub fn track(self) -> Result<Track, OutOfRange> {
        Track::build(self.settings(0.0, 0.0))
    }
}

pub fn number(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(_) => Err("accepted: a finite number".into()),
        Err(_) => Err("accepted: a number such as 0.43 or 1e-3".into()),
    }
}

/// A parser of numbers within `low..=high`; `unit` is named in the refusal (may be empty).
pub fn within(low: f64, high: f64, unit: &'static str) -> ValueParser {
    ValueParser::new(move |text: &str| {
        let value = number(text).ok();
        let value = value.filter(|value| (low..=high).contains(value));
        value.ok_or_else(|| format!("accepted: {}", format!("{low}..{high} {unit}").trim_end()))
    })
}

pub fn count(low: usize, high: usize) -> ValueParser {
    ValueParser::new(move |text: &str| {
        let value = whole(text).filter(|value| (low..=high).contains(value));
        value.ok_or_else(|| format!("accepted: a whole number, {low}..{high}"))
    })
}

fn whole(text: &str) -> Option<usize> {
    text.trim().replace('_', "").parse().ok()
}

pub fn pin(text: &str) -> Result<kband_control::wire::Pin, String> {
    kband_control::wire::Pin::parse(text).ok_or_else(|| "accepted: 4 to 8 digits".into())
}

pub fn socket(text: &str) -> Result<std::net::SocketAddr, String> {
    let accepted = "ADDRESS:PORT with an IP address and a port of 0..65535";
    let read = text.trim().parse();
    read.map_err(|_| format!("accepted: {accepted}, such as 127.0.0.1:1502 or [::1]:1502"))
}

pub fn seed(text: &str) -> Result<u64, String> {
    let read = text.trim().parse();
    read.map_err(|_| format!("accepted: a whole number, 0..{}", u64::MAX))
}

/// Parses a restitution `R` or an interval `LO..HI`.
pub fn restitution(text: &str) -> Result<Restitution, String> {
    let read = || {
        let (low, high) = text.split_once("..").unwrap_or((text, text));
        Restitution::interval(number(low).ok()?, number(high).ok()?).ok()
    };
    let accepted = "one value R or an interval LO..HI, 0 <= LO <= HI <= 1";
    read().ok_or_else(|| format!("accepted: {accepted}, such as 0.2 or 0.18..0.22"))
}

/// Parses friction: one coefficient, or those of sliding and static friction, `MU,MU_S`.
pub fn friction(text: &str) -> Result<(f64, f64), String> {
    let (sliding, sticking) = text.split_once(',').unwrap_or((text, text));
    let (sliding, sticking) = (number(sliding.trim())?, number(sticking.trim())?);
    if sliding >= 0.0 && (sliding..=10.0).contains(&sticking) {
        return Ok((sliding, sticking));
    }
    let accepted = "0..10, or sliding and sticking as 0.3,0.35, the second at least the first";
    Err(format!("accepted: {accepted}"))
}

/// Parses `E,TH`: amplitude of a tone over that of the first one, and angle in rad.
pub fn tone(text: &str) -> Result<Tone, String> {
    let read = || {
        let (amplitude, angle) = text.split_once(',')?;
        let (amplitude, angle) = (number(amplitude).ok()?, number(angle).ok()?);
        let tone = Tone { amplitude, angle };
        Wave::build(tone, Tone::default()).ok().map(|_| tone)
    };
    let accepted = "E,TH with the amplitude E in 0..0.5 of the first tone and the angle TH in \
                    -6.2832..6.2832 rad";
    read().ok_or_else(|| format!("accepted: {accepted}, such as 0.15,2.356 (135 degrees)"))
}

/// A parser of one value or a range `LO..HI[:N]`, N = `count` if absent, with ends in `low..=high`.
pub fn range_or_value((low, high): (f64, f64), count: usize) -> ValueParser {
    ValueParser::new(move |text: &str| {
        let is_open = text.contains("..") && !text.contains(':');
        let counted = when(is_open, || format!(":{count}"));
        let range = range(&format!("{text}{counted}"));
        let within = range.filter(|range| low <= range.low && range.high <= high);
        let accepted = || format!("one number or LO..HI or LO..HI:N within {low}..{high}");
        within.ok_or_else(|| format!("accepted: {}, LO < HI, N in 2..1000000", accepted()))
    })
}

/// A range `LO..HI:N` with `LO < HI` and N in 2..=1 000 000, or one value.
fn range(text: &str) -> Option<Range> {
    let Some((low, rest)) = text.split_once("..") else {
        let value = number(text).ok()?;
        return Some(Range::new(value, value, 1));
    };
    let (high, steps) = rest.split_once(':')?;
    let (low, high) = (number(low).ok()?, number(high).ok()?);
    let steps = whole(steps).filter(|steps| (2..=1_000_000).contains(steps))?;
    (low < high).then_some(Range::new(low, high, steps))
}

/// A parser of one number or `LO..HI` within `low..=high`, as both ends.
pub fn interval(low: f64, high: f64, unit: &'static str) -> ValueParser {
    ValueParser::new(move |text: &str| {
        let (from, to) = text.split_once("..").unwrap_or((text, text));
        match (number(from), number(to)) {
            (Ok(from), Ok(to)) if low <= from && from <= to && to <= high => Ok([from, to]),
            _ => {
                let accepted = format!("{low}..{high} {unit}, LO <= HI");
                Err(format!("accepted: one number or LO..HI within {accepted}"))
            }
        }
    })
}
