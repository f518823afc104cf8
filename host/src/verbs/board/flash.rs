//! `kband flash`: checks a firmware image (ELF) and writes it onto the board through a probe.

use std::path::{Path, PathBuf};

use serde_json::json;

use super::backup::Backup;
use crate::arguments::FormatArguments;
use crate::board::{Address, Emulated, Link};
#[cfg(feature = "flash")]
use crate::chip::write;
use crate::chip::{Chip, Image, OptionBytes, Sector};
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal, Result};
use crate::report::fields;

/// Path of the board's image as `cargo feeder` builds it.
const IMAGE: &str = "target/thumbv7em-none-eabihf/firmware/feeder";

/// Write the firmware onto the board through a debug probe, verify it and start it.
///
/// First the image is checked: its chip, its size in flash and RAM, and its vector table. Then the
/// chip at the probe is checked while its program runs. Then the drive is switched off and the core
/// is stopped. Only then are sectors erased, never those of the settings. After an interruption the
/// board does not start until it is written again.
///
/// If a board answers on its link, its settings and recipes are first written to files of this
/// folder (settings_before_flash.toml, recipes_before_flash.toml), and compared afterwards.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband flash --dry-run
  kband flash
  kband flash --option-bytes
  kband flash my-feeder --probe 0483:3748 --on /dev/ttyACM0")]
pub struct Arguments {
    /// The image (ELF). Default: the image that cargo feeder builds here.
    #[arg(value_name = "IMAGE")]
    image: Option<PathBuf>,
    /// Check the image and print the steps; needs no probe.
    #[arg(long)]
    dry_run: bool,
    /// Also set the option bytes: brown-out reset at its highest level, watchdog on from reset.
    ///
    /// The other option bytes stay. A read-protected chip is refused. Keep the supply on meanwhile:
    /// if the writing is interrupted, the chip protects itself.
    #[arg(long)]
    option_bytes: bool,
    /// Debug probe, if several are connected.
    #[arg(long, value_name = "VID:PID[:SERIAL]")]
    probe: Option<String>,
    /// Serial port of the board's link, for its settings and recipes. Default: the only serial
    /// port.
    #[arg(long, value_name = "/dev/PORT")]
    on: Option<String>,
    #[command(flatten)]
    printed: FormatArguments,
}

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    if !arguments.dry_run && !cfg!(feature = "flash") {
        return Err(Refusal::new(
            "this kband was built without support for debug probes",
            "install it with: cargo install --path host --features flash (kband flash --dry-run checks an image without)",
        ));
    }
    let path = arguments.image.clone().unwrap_or_else(|| IMAGE.into());
    let image = Image::read(&path)?;
    let chip = image.chip;
    let options = options(chip, arguments.option_bytes)?;
    let runs = runs(&image);
    let sector = |run: &Run| {
        json!({"sectors": [run.first.number, run.last.number], "address": run.address(), "size": run.kib(),
            "image_size": run.bytes, "what": run.what})
    };
    let (size, slot) = (image.size_in_slot(), chip.slot.len());
    let (flash_bytes, ram_bytes) = (image.size(), image.memory);
    let memory = chip.memory.end - chip.memory.start;
    let ram = format!("RAM              {ram_bytes} bytes of {memory}, the stack included");
    let mut report = treatment()
        .printout(&runs)
        .heading(format!("{} for the {}", path.display(), chip.name))
        .note(format!("flash            {size} bytes of {slot}"))
        .note(ram);
    if let Some(options) = options {
        report = report.note(format!("option bytes     {}", options.what));
    }
    if arguments.dry_run {
        report = report.note("nothing was written: --dry-run");
    } else {
        let backup = back_up(arguments)?;
        write(image, arguments.probe.as_deref(), options, desk)?;
        report = report.note("written, verified, started");
        if let Some((link, backup)) = backup {
            report = report.note(compare(link, &backup)?);
        }
    }
    report
        .json(json!({
            "image": path.display().to_string(),
            "chip": chip.name,
            "flash_used": flash_bytes,
            "ram_used": ram_bytes,
            "sectors": runs.iter().map(sector).collect::<Vec<_>>(),
            "option_bytes": options.map(|options| options.what),
            "written": !arguments.dry_run,
        }))
        .print(arguments.printed.format)
        .map(|()| Exit::Done)
}

/// Saves settings and recipes to files of this folder, unless no board answers on an unnamed port.
fn back_up(arguments: &Arguments) -> Result<Option<(Link, Backup)>> {
    let address = Address {
        on: arguments.on.clone(),
        ..Address::default()
    };
    let read = || -> Result<_> {
        let mut link = address.open(Emulated::AtRest)?;
        let backup = Backup::read(&mut link)?;
        Ok((link, backup))
    };
    match read() {
        Ok((link, backup)) => {
            backup.write(Path::new("."), "flash")?;
            Ok(Some((link, backup)))
        }
        Err(refusal) if arguments.on.is_some() => Err(refusal.then(
            "nothing was written; leave --on out to write the image without files of the settings",
        )),
        Err(_) => {
            eprintln!("note: no board answers on a link: settings and recipes are in no file");
            Ok(None)
        }
    }
}

fn compare(mut link: Link, before: &Backup) -> Result<&'static str> {
    let unlike = link.identify().and_then(|()| before.differences(&mut link));
    let unlike = unlike.map_err(|refusal| {
        refusal.then("check the board, then compare: kband settings list, kband recipe list")
    })?;
    if unlike.is_empty() {
        return Ok("settings, target and recipes are as before");
    }
    let unlike = unlike.join("; ");
    let cause = format!("the new image runs, but settings or recipes differ: {unlike}");
    let next = "kband settings import settings_before_flash.toml --save, and kband recipe import";
    Err(Refusal::new(cause, next))
}

/// The option bytes to set; refused for a chip whose option bytes kband does not set.
fn options(chip: &Chip, requested: bool) -> Result<Option<OptionBytes>> {
    match (requested, chip.options) {
        (false, _) => Ok(None),
        (true, Some(options)) => Ok(Some(options)),
        (true, None) => Err(Refusal::new(
            format!("kband sets no option bytes of the {}", chip.name),
            "flash without --option-bytes, and set brown-out level 4 and the hardware watchdog with the vendor's tool",
        )),
    }
}

/// Neighbouring sectors with the same treatment.
struct Run {
    first: Sector,
    last: Sector,
    bytes: u32,
    what: &'static str,
}

fields! {
    fn treatment(run: Run) {
        all SECTORS => run.name();
        all ADDRESS => run.address();
        all SIZE => run.kib();
        all IMAGE_SIZE.titled("image (bytes)") => Some(run.bytes).filter(|bytes| *bytes > 0);
        all WHAT => run.what;
    }
}

impl Run {
    fn name(&self) -> String {
        if self.first == self.last {
            self.first.number.to_string()
        } else {
            format!("{}..{}", self.first.number, self.last.number)
        }
    }

    fn address(&self) -> String {
        format!("{:#010x}", self.first.range.start)
    }

    fn kib(&self) -> u32 {
        (self.last.range.end - self.first.range.start) / 1024
    }
}

fn runs(image: &Image) -> Vec<Run> {
    let chip = image.chip;
    let mut runs: Vec<Run> = Vec::new();
    for sector in chip.sectors() {
        let bytes = image.bytes_in(&sector.range);
        let what = if chip.settings.contains(&sector.range.start) {
            "settings and faults, kept"
        } else if bytes > 0 {
            "erased and written"
        } else {
            "kept"
        };
        match runs.last_mut() {
            Some(run) if run.what == what => {
                run.last = sector;
                run.bytes += bytes;
            }
            _ => runs.push(Run {
                first: sector.clone(),
                last: sector,
                bytes,
                what,
            }),
        }
    }
    runs
}

#[cfg(not(feature = "flash"))]
fn write(_: Image, _: Option<&str>, _: Option<OptionBytes>, desk: &Desk) -> Result<()> {
    desk.check_stop()
}
