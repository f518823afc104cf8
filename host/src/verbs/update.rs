//! `kband update`: sends a signed firmware image to a board over its link.

mod key;
#[cfg(all(test, unix))]
mod tests;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use kband_control::wire::{Kept, MAX_UPDATE_BYTES, Pin, Request, Response, UpdateRequest};

use super::backup::Backup;
use crate::arguments::pin;
use crate::board::{Address, Emulated, Link, Unsolicited};
use crate::chip::Image;
use crate::desk::{Desk, Progress};
use crate::refusal::{Exit, Refusal};

/// Longest wait for the start of a new image: the board needs 10 to 20 s to swap the images.
const START_TIMEOUT: Duration = Duration::from_secs(60);
/// Longest wait for one answer of a board that starts.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(1);
/// Time between two questions to a board that starts.
const POLL_INTERVAL: Duration = Duration::from_millis(250);
/// Largest number of times that a board may name another number of bytes than were sent.
const MAX_CORRECTIONS: u32 = 8;

/// Update the firmware of a board over its link, with a signed image.
///
/// The drive must be at rest, and stays off meanwhile. Its settings and recipes are first written
/// to files of this folder (settings_before_update.toml, recipes_before_update.toml). The board
/// accepts an image only if it is signed with the secret key that belongs to its public key. The
/// STM32F405 then swaps the images, and runs the new one on trial until this command finds settings,
/// target and recipes as before and confirms it. Without the confirmation the old image returns. The
/// loader of the STM32G474 writes over the old image; cut short, it waits for the update again.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband update --new-key plant.key
  kband update --set-key plant.key.pub --on /dev/ttyACM0
  kband update feeder --key plant.key --on /dev/ttyACM0

Keep the secret key (plant.key) safe: its owner can change the firmware of your boards.")]
pub struct Arguments {
    /// The image (ELF), as cargo feeder builds it.
    #[arg(value_name = "IMAGE", requires = "key",
          required_unless_present_any = ["new_key", "set_key"],
          conflicts_with_all = ["new_key", "set_key"])]
    image: Option<PathBuf>,

    /// File of the secret key that signs the image.
    #[arg(long, value_name = "FILE", requires = "image")]
    key: Option<PathBuf>,

    /// Make a key pair: FILE holds the secret key, FILE.pub the public key.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["set_key", "on", "pin"])]
    new_key: Option<PathBuf>,

    /// Send the public key to the board. It replaces another key only on a board with a PIN.
    #[arg(long, value_name = "FILE.pub")]
    set_key: Option<PathBuf>,

    /// Serial port of the board. Default: the only serial port.
    #[arg(long, value_name = "/dev/PORT")]
    on: Option<String>,

    /// The PIN of a locked board, 4 to 8 digits.
    #[arg(long, value_parser = pin)]
    pin: Option<Pin>,
}

/// Makes a key, gives it to a board, or updates a board.
pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    if let Some(path) = &arguments.new_key {
        let public = key::create(path)?;
        println!(
            "{} is secret and signs images; {} is for the boards",
            path.display(),
            public.display()
        );
    }
    if let Some(path) = &arguments.set_key {
        let key = key::read_public(path)?;
        let (mut link, _) = open(arguments)?;
        unlock(&mut link, arguments.pin)?;
        link.tell_update(&UpdateRequest::Key(&key))?;
        println!(
            "{} accepts images that are signed with this key",
            link.name()
        );
    }
    if let (Some(image), Some(key)) = (&arguments.image, &arguments.key) {
        let done = update(image, key, arguments, Path::new("."), desk)?;
        println!("{done}");
    }
    Ok(Exit::Done)
}

/// Updates a board, with its files in `folder`; the result in words.
fn update(
    path: &Path,
    key: &Path,
    arguments: &Arguments,
    folder: &Path,
    desk: &Desk,
) -> Result<String, Refusal> {
    let image = Image::read(path)?;
    let bytes = image
        .update()
        .map_err(|refusal| refusal.at(path.display()))?;
    let board = image.chip().name.to_lowercase();
    let sum = key::sum(&bytes, &board);
    let signature = key::sign(key, &sum)?;
    let (mut link, name) = open(arguments)?;
    if name != board {
        return Err(Refusal::value(
            "board of the image",
            board,
            &name,
            format!("build the image of the board on {}", link.name()),
        ));
    }
    let before = back_up(&mut link)?;
    unlock(&mut link, arguments.pin)?;
    let length = bytes.len() as u32;
    let begin = UpdateRequest::Begin {
        board: &board,
        length,
    };
    let by_loader = link.begin_update(&begin)?;
    if let Some(before) = &before {
        before.write(folder, "update")?;
    }
    let [unsent, unconfirmed] = if by_loader {
        [
            "the board waits for an image until it has a whole one",
            "the board has the new image",
        ]
    } else {
        [
            "the board keeps its old image",
            "the new image is not confirmed, and the old one returns",
        ]
    };
    if by_loader {
        let signed = UpdateRequest::Signed {
            board: &board,
            length,
            sum: &sum,
            signature: &signature,
        };
        wait_for_loader(&mut link, &signed, desk)
            .map_err(|refusal| refusal.at("the board keeps its image"))?;
    }
    send(&mut link, &bytes, desk)
        // Only a start after the end of the image is the new image's.
        .and_then(|()| link.listen(Duration::ZERO))
        .and_then(|_| link.tell_update(&UpdateRequest::End(&signature)))
        .map_err(|refusal| refusal.at(unsent))?;
    let started = if by_loader {
        wait_for_start(&mut link, desk)
    } else {
        eprintln!("the board swaps its images, which takes up to 20 s");
        wait_for_trial(&mut link, desk)
    };
    let compared = started
        .and_then(|()| confirm(&mut link, before.as_ref(), arguments.pin))
        .map_err(|refusal| refusal.at(unconfirmed))?;
    Ok(format!("{} runs {}; {compared}", link.name(), link.image()))
}

/// The link to a board of any version that knows updates, and the board's name.
fn open(arguments: &Arguments) -> Result<(Link, String), Refusal> {
    let address = Address {
        on: arguments.on.clone(),
        ..Address::default()
    };
    let mut link = address.open_any(Emulated::AtRest)?;
    let (name, _) = link.update_state()?;
    Ok((link, name))
}

fn unlock(link: &mut Link, pin: Option<Pin>) -> Result<(), Refusal> {
    pin.map_or(Ok(()), |pin| link.tell_update(&UpdateRequest::Unlock(pin)))
}

/// Settings, target and recipes of the board; `None` where the desk cannot compare them later.
fn back_up(link: &mut Link) -> Result<Option<Backup>, Refusal> {
    let kept = match link.speaks_the_same() {
        Ok(()) => link.ask(&Request::SelfTest, |response| match response {
            Response::SelfTest(found) => found.settings,
            _ => Kept::InUse,
        })?,
        Err(_) => Kept::Damaged,
    };
    match kept {
        Kept::InUse | Kept::Never => Backup::read(link).map(Some),
        Kept::Others => Err(Refusal::new(
            format!(
                "{} uses settings or a target that are not saved",
                link.name()
            ),
            "kband settings save, or reset the board; then start the update again",
        )),
        Kept::Damaged => {
            eprintln!("note: this desk cannot read the saved settings: they are in no file");
            Ok(None)
        }
    }
}

/// Sends an image, and goes on from the number of bytes that the board has.
fn send(link: &mut Link, image: &[u8], desk: &Desk) -> Result<(), Refusal> {
    let progress = Progress::new("sending", image.len() as u64);
    let mut sent = 0;
    let mut corrections = 0;
    while let Some(bytes) = image.get(sent..).filter(|rest| !rest.is_empty()) {
        desk.go_on().map_err(|_| interrupted())?;
        let bytes = &bytes[..bytes.len().min(MAX_UPDATE_BYTES)];
        let has = link.send_image(sent as u32, bytes)? as usize;
        if has == sent + bytes.len() {
            progress.advance(bytes.len() as u64);
        } else {
            corrections += 1;
            if has == sent || has > image.len() || corrections > MAX_CORRECTIONS {
                return Err(Refusal::new(
                    format!(
                        "{} has {has} bytes of the image, {sent} were sent",
                        link.name()
                    ),
                    "check that the board restarted; then start the update again",
                ));
            }
        }
        sent = has;
    }
    Ok(())
}

/// Waits until the board's loader answers and has checked the signature of an image.
fn wait_for_loader(
    link: &mut Link,
    signed: &UpdateRequest<'_>,
    desk: &Desk,
) -> Result<(), Refusal> {
    let end = Instant::now() + START_TIMEOUT;
    while link.begin_update(signed)? {
        desk.go_on().map_err(|_| interrupted())?;
        if Instant::now() > end {
            return Err(Refusal::new(
                format!("{} did not start its loader within a minute", link.name()),
                "look at the board: kband identify; then start the update again",
            ));
        }
        link.listen(POLL_INTERVAL)?;
    }
    Ok(())
}

/// Waits until the board's loader has started the new image.
fn wait_for_start(link: &mut Link, desk: &Desk) -> Result<(), Refusal> {
    let end = Instant::now() + START_TIMEOUT;
    while Instant::now() < end {
        desk.go_on().map_err(|_| interrupted())?;
        link.identify()?;
        // The loader speaks version 0.
        if link.speaks().0 > 0 {
            return Ok(());
        }
        link.listen(POLL_INTERVAL)?;
    }
    Err(not_started(link))
}

/// Waits until the board answers with its new image, which is on trial.
fn wait_for_trial(link: &mut Link, desk: &Desk) -> Result<(), Refusal> {
    link.wait_at_most(ANSWER_TIMEOUT);
    let end = Instant::now() + START_TIMEOUT;
    let mut restarted = false;
    while Instant::now() < end {
        desk.go_on().map_err(|_| interrupted())?;
        match link.update_state() {
            Ok((_, true)) => return Ok(()),
            Ok((_, false)) if restarted => {
                return Err(Refusal::new(
                    format!("{} restarted with its old image", link.name()),
                    "look at the supply of the board; then start the update again",
                ));
            }
            Err(refusal) if link.is_over() => return Err(refusal),
            Ok(_) | Err(_) => {}
        }
        let heard = link.listen(POLL_INTERVAL)?;
        restarted |= heard
            .iter()
            .any(|said| matches!(said, Unsolicited::Started(_)));
    }
    Err(not_started(link))
}

fn not_started(link: &Link) -> Refusal {
    Refusal::new(
        format!(
            "{} did not start the new image within a minute",
            link.name()
        ),
        "look at the board: kband identify; then start the update again",
    )
}

/// Compares the board with its backup and confirms the image on trial; the result in words.
fn confirm(
    link: &mut Link,
    before: Option<&Backup>,
    pin: Option<Pin>,
) -> Result<&'static str, Refusal> {
    link.identify()?;
    unlock(link, pin)?;
    let mut compared = "its settings were not compared";
    if let (Some(before), Ok(())) = (before, link.speaks_the_same()) {
        let unlike = before.differences(link)?;
        if !unlike.is_empty() {
            return Err(Refusal::new(
                format!("settings, target or recipes differ: {}", unlike.join("; ")),
                "report this, with settings_before_update.toml",
            ));
        }
        compared = "settings, target and recipes are as before";
    }
    link.tell_update(&UpdateRequest::Confirm)?;
    Ok(compared)
}

fn interrupted() -> Refusal {
    Refusal::cut("interrupted", "start the update again")
}
