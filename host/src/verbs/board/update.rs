//! `kband update`: sends a signed firmware image to a board over its link.

mod key;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use kband_control::wire::{MAX_UPDATE_BYTES, Pin, Request, Response, SavedSettings, UpdateRequest};

use super::backup::Backup;
use crate::arguments::pin;
use crate::board::{Address, BoardMessage, Emulated, Link};
use crate::chip::Image;
use crate::desk::{Desk, Progress};
use crate::refusal::{Exit, Refusal, Result};

/// Longest wait for the start of a new image: the board needs 10 to 20 s to swap the images.
const START_TIMEOUT: Duration = Duration::from_secs(60);
/// Longest wait for one response of a starting board.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(1);
const POLL_INTERVAL: Duration = Duration::from_millis(250);
/// Largest number of times that sending goes on at the number of bytes that the board reports.
const MAX_CORRECTIONS: u32 = 8;

/// Update the firmware of a board over its link, with a signed image.
///
/// The drive must be at rest, and stays off meanwhile. Once the board accepts the update, its
/// settings and recipes are written to files of this folder (settings_before_update.toml,
/// recipes_before_update.toml). The board
/// accepts an image only if it is signed with the secret key that belongs to its public key. The
/// STM32F405 then swaps the images, and runs the new one on trial until this command finds
/// settings, target and recipes as before and confirms it. Without the confirmation the old image
/// returns. The loader of the STM32G474 writes over the old image; cut short, it waits for the
/// update again.
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

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    if let Some(path) = &arguments.new_key {
        let public = key::create(path)?;
        let (secret, public) = (path.display(), public.display());
        println!("{secret} is secret and signs images; {public} is for the boards");
    }
    if let Some(path) = &arguments.set_key {
        let key = key::read_public(path)?;
        let (mut link, _) = open(arguments)?;
        unlock(&mut link, arguments.pin)?;
        link.command_update(&UpdateRequest::Key(&key))?;
        let name = link.name();
        println!("{name} accepts images that are signed with this key");
    }
    if let (Some(image), Some(key)) = (&arguments.image, &arguments.key) {
        let done = update(image, key, arguments, desk)?;
        println!("{done}");
    }
    Ok(Exit::Done)
}

fn update(path: &Path, key: &Path, arguments: &Arguments, desk: &Desk) -> Result<String> {
    let image = Image::read(path)?;
    let bytes = image.update();
    let bytes = bytes.map_err(|refusal| refusal.at(path.display()))?;
    let board = image.chip.name.to_lowercase();
    let sum = key::sum(&bytes, &board);
    let signature = key::sign(key, &sum)?;
    let (mut link, name) = open(arguments)?;
    if name != board {
        let next = format!("build the image of the board on {}", link.name());
        return Err(Refusal::value("board of the image", board, &name, next));
    }
    let before = back_up(&mut link)?;
    unlock(&mut link, arguments.pin)?;
    let (board, length) = (board.as_str(), bytes.len() as u32);
    let loader_receives = link.begin_update(&UpdateRequest::Begin { board, length })?;
    if let Some(before) = &before {
        before.write(Path::new("."), "update")?;
    }
    let (started, unconfirmed) = if loader_receives {
        let signed = UpdateRequest::Signed {
            board,
            length,
            sum: &sum,
            signature: &signature,
        };
        let received = |link: &mut Link, _: &[BoardMessage]| Ok(!link.begin_update(&signed)?);
        wait(&mut link, desk, "its loader", received)
            .map_err(|refusal| refusal.at("the board keeps its image"))?;
        send_all(&mut link, &bytes, &signature, desk).map_err(|refusal| {
            refusal.at("the board waits for an image until it has a whole one")
        })?;
        let started = wait(&mut link, desk, "the new image", |link, _| {
            link.identify()?;
            // The loader has protocol version 0.
            Ok(link.protocol().0 > 0)
        });
        (started, "the board has the new image")
    } else {
        send_all(&mut link, &bytes, &signature, desk)
            .map_err(|refusal| refusal.at("the board keeps its old image"))?;
        eprintln!("the board swaps its images, which takes up to 20 s");
        let started = wait_for_trial(&mut link, desk);
        let unconfirmed = "the new image is not confirmed, and the old one returns";
        (started, unconfirmed)
    };
    let compared = started
        .and_then(|()| confirm(&mut link, before.as_ref(), arguments.pin))
        .map_err(|refusal| refusal.at(unconfirmed))?;
    Ok(format!("{} runs {}; {compared}", link.name(), link.image()))
}

/// The link to a board of any version that supports updates, and the board's name.
fn open(arguments: &Arguments) -> Result<(Link, String)> {
    let address = Address {
        on: arguments.on.clone(),
        ..Address::default()
    };
    let mut link = address.open_any(Emulated::AtRest)?;
    let (name, _) = link.update_state()?;
    Ok((link, name))
}

fn unlock(link: &mut Link, pin: Option<Pin>) -> Result<()> {
    pin.map_or(Ok(()), |pin| {
        link.command_update(&UpdateRequest::Unlock(pin))
    })
}

/// Settings, target and recipes of the board; `None` if this version cannot compare them later.
fn back_up(link: &mut Link) -> Result<Option<Backup>> {
    let saved = match link.check_protocol() {
        Ok(()) => link.request(&Request::SelfTest, |response| match response {
            Response::SelfTest(result) => result.settings,
            _ => SavedSettings::InUse,
        })?,
        Err(_) => SavedSettings::Damaged,
    };
    match saved {
        SavedSettings::InUse | SavedSettings::Never => Backup::read(link).map(Some),
        SavedSettings::Different => {
            let name = link.name();
            let cause = format!("{name} uses settings or a target that are not saved");
            let next = "kband settings save, or reset the board; then start the update again";
            Err(Refusal::new(cause, next))
        }
        SavedSettings::Damaged => {
            eprintln!("note: this desk cannot read the saved settings: they are in no file");
            Ok(None)
        }
    }
}

fn send_all(link: &mut Link, image: &[u8], signature: &[u8], desk: &Desk) -> Result<()> {
    send(link, image, desk)?;
    // Discards earlier messages: only a start after the end of the image is the new image's.
    link.listen(Duration::ZERO)?;
    link.command_update(&UpdateRequest::End(signature))
}

/// Sends an image, continuing at the number of bytes that the board reports.
fn send(link: &mut Link, image: &[u8], desk: &Desk) -> Result<()> {
    let progress = Progress::new("sending", image.len() as u64);
    let mut sent = 0;
    let mut corrections = 0;
    while let Some(bytes) = image.get(sent..).filter(|rest| !rest.is_empty()) {
        desk.check_stop().map_err(|_| interrupted())?;
        let bytes = &bytes[..bytes.len().min(MAX_UPDATE_BYTES)];
        let has = link.send_image(sent as u32, bytes)? as usize;
        if has == sent + bytes.len() {
            progress.advance(bytes.len() as u64);
        } else {
            corrections += 1;
            if has == sent || has > image.len() || corrections > MAX_CORRECTIONS {
                let name = link.name();
                let cause = format!("{name} has {has} bytes of the image, {sent} were sent");
                let next = "check that the board restarted; then start the update again";
                return Err(Refusal::new(cause, next));
            }
        }
        sent = has;
    }
    Ok(())
}

/// Waits until `done`, which receives the latest messages; `what` is to start meanwhile.
fn wait(
    link: &mut Link,
    desk: &Desk,
    what: &str,
    mut done: impl FnMut(&mut Link, &[BoardMessage]) -> Result<bool>,
) -> Result<()> {
    let end = Instant::now() + START_TIMEOUT;
    let mut messages = Vec::new();
    while Instant::now() < end {
        desk.check_stop().map_err(|_| interrupted())?;
        if done(link, &messages)? {
            return Ok(());
        }
        messages = link.listen(POLL_INTERVAL)?;
    }
    let cause = format!("{} did not start {what} within a minute", link.name());
    let next = "look at the board: kband identify; then start the update again";
    Err(Refusal::new(cause, next))
}

/// Waits until the board answers with its new image, which is on trial.
fn wait_for_trial(link: &mut Link, desk: &Desk) -> Result<()> {
    let usual = link.set_answer_timeout(ANSWER_TIMEOUT);
    let mut restarted = false;
    let started = wait(link, desk, "the new image", |link, messages| {
        let started = |message: &BoardMessage| matches!(message, BoardMessage::Started(_));
        restarted |= messages.iter().any(started);
        match link.update_state() {
            Ok((_, false)) if restarted => Err(Refusal::new(
                format!("{} restarted with its old image", link.name()),
                "look at the supply of the board; then start the update again",
            )),
            Err(refusal) if link.is_over() => Err(refusal),
            state => Ok(state.is_ok_and(|(_, on_trial)| on_trial)),
        }
    });
    link.set_answer_timeout(usual);
    started
}

/// Compares the board with its backup and confirms the image on trial; returns the result in words.
fn confirm(link: &mut Link, before: Option<&Backup>, pin: Option<Pin>) -> Result<&'static str> {
    link.identify()?;
    unlock(link, pin)?;
    let mut compared = "its settings were not compared";
    if let (Some(before), Ok(())) = (before, link.check_protocol()) {
        let unlike = before.differences(link)?;
        if !unlike.is_empty() {
            let cause = format!("settings, target or recipes differ: {}", unlike.join("; "));
            let next = "report this, with settings_before_update.toml";
            return Err(Refusal::new(cause, next));
        }
        compared = "settings, target and recipes are as before";
    }
    link.command_update(&UpdateRequest::Confirm)?;
    Ok(compared)
}

fn interrupted() -> Refusal {
    Refusal::cut("interrupted", "start the update again")
}
