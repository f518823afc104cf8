//! The way to the chip: a debug probe, by probe-rs.

use std::time::Duration;

use probe_rs::flashing::DownloadOptions;
use probe_rs::probe::DebugProbeInfo;
use probe_rs::probe::list::Lister;
use probe_rs::{Core, MemoryInterface, Permissions, Session};

use super::chip::Chip;
use super::image::Image;
use crate::refusal::Refusal;

/// The register that identifies the chip, and the one that tells its flash (RM0090, 38.6.1 and 39.2).
const IDENTITY: u64 = 0xe004_2000;
const FLASH_SIZE: u64 = 0x1fff_7a22;
/// What the identity says of the family.
const FAMILY: u32 = 0xfff;
/// Longest wait for the core to stop.
const HALT: Duration = Duration::from_millis(500);

/// Writes an image through a probe, verifies it and starts it; the chip is checked before.
pub fn write(image: &Image, chip: &Chip, probe: Option<&str>) -> Result<(), Refusal> {
    let mut session = attach(chip, probe)?;
    check(&mut session, chip)?;
    let mut loader = session.target().flash_loader();
    let failed = |error: &dyn std::fmt::Display| {
        Refusal::new(
            format!("the flash was not written: {error}"),
            "run kband flash again: until it ends well the board does not start, and its settings are untouched",
        )
    };
    for piece in image.pieces() {
        loader
            .add_data(u64::from(piece.address), &piece.bytes)
            .map_err(|error| failed(&error))?;
    }
    let mut options = DownloadOptions::new();
    options.verify = true;
    loader
        .commit(&mut session, options)
        .map_err(|error| failed(&error))?;
    let started = session.core(0).and_then(|mut core| core.reset());
    started.map_err(|error| {
        Refusal::new(
            format!("written and verified, but the chip does not start: {error}"),
            "switch the board off and on",
        )
    })
}

/// The chip on the probe that is wanted, or on the only one there is.
fn attach(chip: &Chip, wanted: Option<&str>) -> Result<Session, Refusal> {
    let probes = Lister::new().list_all();
    let name = |info: &DebugProbeInfo| {
        let serial = info
            .serial_number
            .as_ref()
            .map_or(String::new(), |serial| format!(":{serial}"));
        format!("{:04x}:{:04x}{serial}", info.vendor_id, info.product_id)
    };
    let names: Vec<String> = probes.iter().map(name).collect();
    let info = match (wanted, &probes[..]) {
        (_, []) => {
            return Err(Refusal::new(
                "no debug probe is there",
                "plug in an ST-Link, J-Link or CMSIS-DAP probe (on Linux with its udev rule: https://probe.rs/docs/getting-started/probe-setup)",
            ));
        }
        (None, [info]) => info,
        (None, _) => {
            return Err(Refusal::new(
                format!("several debug probes are there: {}", names.join(", ")),
                format!("name one, such as --probe {}", names[0]),
            ));
        }
        (Some(wanted), _) => {
            let found = names.iter().position(|name| {
                name.starts_with(&wanted.to_lowercase()) || name.starts_with(wanted)
            });
            match found.and_then(|found| probes.get(found)) {
                Some(info) => info,
                None => {
                    return Err(Refusal::value(
                        "--probe",
                        wanted,
                        names.join(", "),
                        "name one that is there",
                    ));
                }
            }
        }
    };
    let probe = info.open().map_err(|error| {
        Refusal::new(
            format!("the probe {} does not open: {error}", name(info)),
            "close other programs that use it, and look whether you may (on Linux its udev rule)",
        )
    })?;
    probe
        .attach(chip.name, Permissions::default())
        .map_err(|error| {
            Refusal::new(
                format!("the probe {} does not reach the chip: {error}", name(info)),
                "check SWDIO, SWCLK, ground and the board's supply",
            )
        })
}

/// Refused unless the chip is of the family, with as much flash.
fn check(session: &mut Session, chip: &Chip) -> Result<(), Refusal> {
    let read = |core: &mut Core<'_>| -> Result<(u32, u32), probe_rs::Error> {
        core.halt(HALT)?;
        Ok((
            core.read_word_32(IDENTITY)? & FAMILY,
            u32::from(core.read_word_16(FLASH_SIZE)?),
        ))
    };
    let found = session.core(0).and_then(|mut core| read(&mut core));
    let (family, kib) = found.map_err(|error| {
        Refusal::new(
            format!("the chip does not say what it is: {error}"),
            "check SWDIO, SWCLK, ground and the board's supply",
        )
    })?;
    let size = (chip.flash.end - chip.flash.start) / 1024;
    if family == chip.family && kib >= size {
        return Ok(());
    }
    Err(Refusal::value(
        "chip",
        format!("family {family:#05x} with {kib} KiB of flash"),
        format!("{:#05x} with {size} KiB: {}", chip.family, chip.name),
        "nothing was written: look whether this is the right board",
    ))
}
