//! Address of a board from the user: the emulated CPU or a serial port.

use std::path::{Path, PathBuf};

use kband_link::{Emulated, Link, serial};

use crate::desk::limit_waits;
use crate::file::Destination;
use crate::refusal::{Refusal, Result};

/// Bytes of the emulated board's flash for settings and faults: four pages of 4 KiB.
const FLASH_BYTES: usize = 16_384;

/// The board that a verb talks to.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Address {
    /// The board: qemu (the emulated CPU) or its serial port. Default: the only serial port.
    #[arg(long, value_name = "qemu or /dev/PORT", global = true)]
    pub on: Option<String>,

    /// Image for --on qemu. Default: the image that cargo builds here.
    #[arg(long, value_name = "FILE", global = true)]
    pub image: Option<PathBuf>,

    /// File that keeps the settings of --on qemu between runs. It is created if missing.
    #[arg(long, value_name = "FILE", global = true)]
    pub flash_image: Option<PathBuf>,
}

impl Address {
    /// The board `on`, qemu or a serial port; an emulated one runs `image`.
    pub fn new(on: &str, image: Option<&Path>) -> Self {
        Self {
            on: Some(on.into()),
            image: image.map(Path::to_path_buf),
            flash_image: None,
        }
    }

    /// Whether the address is the emulated CPU.
    pub fn is_emulated(&self) -> bool {
        self.on.as_deref() == Some("qemu")
    }

    fn emulated_options(&self) -> impl Iterator<Item = (&'static str, &Path)> {
        let image = self.image.iter().map(|file| ("--image", &**file));
        let flash = self.flash_image.iter();
        image.chain(flash.map(|file| ("--flash-image", &**file)))
    }

    /// The same board as options of a command.
    pub fn options(&self) -> String {
        let on = self.on.iter().map(|on| format!(" --on {on}"));
        let files = self.emulated_options();
        let files = files.map(|(option, file)| format!(" {option} {}", file.display()));
        on.chain(files).collect()
    }

    /// Opens the link to the board; refuses another version or schema of the protocol.
    pub fn open(&self, emulated: Emulated) -> Result<Link> {
        let link = self.open_any(emulated)?;
        link.check_protocol()?;
        Ok(link)
    }

    /// Opens the link to a board of any version, for reading only.
    pub fn open_any(&self, emulated: Emulated) -> Result<Link> {
        if self.is_emulated() {
            if let Some(flash) = &self.flash_image {
                prepare(flash)?;
            }
            let files = [&self.image, &self.flash_image].map(Option::as_deref);
            return Link::emulate(files, emulated, Box::new(|| Ok(())));
        }
        self.refuse_emulated_options()?;
        let port = match &self.on {
            Some(port) => port.into(),
            None => {
                let port = serial::only_port()?;
                eprintln!("the board on {}", port.display());
                port
            }
        };
        Link::open(&port, Box::new(limit_waits()))
    }

    /// Refuses the options that only apply to an emulated board.
    pub fn refuse_emulated_options(&self) -> Result<()> {
        let Some((option, file)) = self.emulated_options().next() else {
            return Ok(());
        };
        let accepted = "with --on qemu only: a board has its own image and flash";
        let next = "leave it out, or give --on qemu";
        Err(Refusal::value(option, file.display(), accepted, next))
    }
}

/// Creates an erased flash if the file is missing; refuses a file of another kind.
fn prepare(flash: &Path) -> Result<()> {
    let Ok(data) = flash.metadata() else {
        return Destination::check(flash)?.write_bytes(&[0xff; FLASH_BYTES]);
    };
    if data.len() == FLASH_BYTES as u64 {
        return Ok(());
    }
    let value = format!("{} ({} bytes)", flash.display(), data.len());
    let accepted = "a file that --flash-image created: four pages of 4096 bytes";
    let next = "name a file that does not exist; kband creates it";
    Err(Refusal::value("--flash-image", value, accepted, next))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// tests/wrong_inputs.txt has the refusal of options of the emulated board for a port.
    #[test]
    fn options_of_a_command_name_the_same_board() {
        let address = Address {
            flash_image: Some("flash.bin".into()),
            ..Address::new("/dev/null", None)
        };
        assert_eq!(address.options(), " --on /dev/null --flash-image flash.bin");
    }
}
