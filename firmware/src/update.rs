//! Update of the firmware over the link, into a slot of the flash.
//!
//! The image is written to the slot while the drive is at rest, with its enable withheld. Its
//! signature (Ed25519, RFC 8032) covers the SHA-512 of the image and the board's name. A correct
//! signature marks the slot and restarts the board. The loader swaps the slots, and the new image
//! is on trial until the desk confirms it. A restart before that restores the previous image. A
//! chip with one slot restarts into its loader, which receives the image
//! ([`kband_loader::one_slot`]).

use crate::access::LinkLock;
use crate::station::Station;
use crate::storage::store::{Records, StoreFailed};
use crate::storage::waiting::Waiting;
use core::borrow::BorrowMut;
use embassy_futures::yield_now;
use embedded_storage_async::nor_flash::NorFlash;
use kband_control::wire::{
    Access, MAX_UPDATE_BYTES, MAX_UPDATES_PER_START, Refusal, UpdateAnswer, UpdateRefusal,
    UpdateRequest, check_chunk,
};
use kband_loader::one_slot::is_signed;
use salty::{PublicKey, Sha512};

/// Time without a request after which an update no longer keeps the drive off, s.
const SILENCE_S: u32 = 10;
/// Time after which an unconfirmed image restarts the board, s.
pub(crate) const TRIAL_S: u32 = 60;

/// The chip's slot for an update.
#[derive(Clone, Copy, Debug)]
pub struct Slot {
    /// Name of the board.
    pub board: &'static str,
    /// Largest image, bytes.
    pub size: u32,
    /// Restarts the board.
    pub restart: fn(),
    /// Writer of the image.
    pub writer: Writer,
}

impl Slot {
    /// Whether the running image is on trial.
    pub fn on_trial(&self) -> bool {
        match &self.writer {
            Writer::Program(second) => (second.on_trial)(),
            Writer::Loader(_) => false,
        }
    }
}

/// Writer of the image of an update.
#[derive(Clone, Copy, Debug)]
pub enum Writer {
    /// This program, to a second slot.
    Program(SecondSlot),
    /// The loader, over this program. The function leaves the loader a request with the public key.
    Loader(fn(&[u8; 32])),
}

/// A second slot. Its functions return false on a failure of the flash.
#[derive(Clone, Copy, Debug)]
pub struct SecondSlot {
    /// Size of an erasable sector, bytes.
    pub sector: u32,
    /// Erases the sector that begins at an offset.
    pub erase: fn(u32) -> bool,
    /// Programs words at an offset and verifies them.
    pub write: fn(u32, &[u8]) -> bool,
    /// Copies the slot's content at an offset.
    pub read: fn(u32, &mut [u8]),
    /// Whether the running image is on trial.
    pub on_trial: fn() -> bool,
    /// Marks the slot for the next start.
    pub mark: fn() -> bool,
    /// Confirms the running image.
    pub confirm: fn() -> bool,
    /// Whether the marks have room for an update.
    pub has_room: fn() -> bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Progress {
    None,
    /// An image of this length in bytes is expected; `written` of them are in the slot.
    Open {
        length: u32,
        written: u32,
    },
    /// The slot is marked, or the loader has its request. The board restarts after this number of
    /// drive cycles.
    Marked(u16),
}

pub(crate) struct Update {
    slot: Option<Slot>,
    progress: Progress,
    on_trial: bool,
    begun: u8,
}

impl Update {
    pub fn new(slot: Option<Slot>) -> Self {
        Self {
            slot,
            progress: Progress::None,
            on_trial: slot.is_some_and(|slot| slot.on_trial()),
            begun: 0,
        }
    }

    /// Keeps the drive of an image on trial off, from the start on.
    pub fn begin_trial(&self, station: &Station) {
        if self.on_trial {
            station.disable_until(u32::MAX);
        }
    }

    /// Ends a drive cycle: restarts a board with a marked slot, or an unconfirmed image.
    pub fn tick(&mut self, station: &Station) {
        let is_due = match &mut self.progress {
            Progress::Marked(cycles) => {
                *cycles = cycles.saturating_sub(1);
                *cycles == 0
            }
            _ => self.on_trial && station.seconds() >= TRIAL_S,
        };
        if let Some(slot) = self.slot.filter(|_| is_due) {
            (slot.restart)();
        }
    }

    /// Answers a request. Other tasks run after each block of a long one.
    pub async fn answer(
        &mut self,
        request: &UpdateRequest<'_>,
        lock: &mut LinkLock,
        strapped: bool,
        station: &Station,
        store: &mut Records<impl NorFlash, impl BorrowMut<Waiting>>,
    ) -> UpdateAnswer<'static> {
        let answer = match *request {
            UpdateRequest::State => Ok(UpdateAnswer::State {
                board: self.slot.map_or("", |slot| slot.board),
                size: self.slot.map_or(0, |slot| slot.size),
                has_key: store.key().await.is_some(),
                on_trial: self.on_trial,
            }),
            UpdateRequest::Unlock(pin) => match lock.unlock(pin, station.seconds()) {
                Ok(()) => Ok(UpdateAnswer::Done),
                Err(Refusal::Wait(seconds)) => Err(UpdateRefusal::Wait(seconds)),
                Err(_) => Err(UpdateRefusal::WrongPin),
            },
            _ if lock.access(strapped) != Access::Full => Err(UpdateRefusal::ReadOnly),
            _ => {
                let has_pin = lock.pin.is_some();
                self.change(request, has_pin, station, store).await
            }
        };
        answer.unwrap_or_else(UpdateAnswer::Refused)
    }

    async fn change(
        &mut self,
        request: &UpdateRequest<'_>,
        has_pin: bool,
        station: &Station,
        store: &mut Records<impl NorFlash, impl BorrowMut<Waiting>>,
    ) -> Result<UpdateAnswer<'static>, UpdateRefusal> {
        let slot = self.slot.ok_or(UpdateRefusal::NoSlot)?;
        let was_open = self.progress != Progress::None;
        // An abandoned update does not stop a running drive.
        if !station.is_out_of_use() {
            self.progress = Progress::None;
            return Err(UpdateRefusal::Running);
        }
        if !store.supply_is_good() {
            return Err(UpdateRefusal::SupplyLow);
        }
        let changed = match *request {
            UpdateRequest::Key(key) => return set_key(key, has_pin, store).await,
            UpdateRequest::Confirm => return self.confirm(station),
            _ if station.bus_controls() => return Err(UpdateRefusal::NotInControl),
            UpdateRequest::Begin { board, length }
            | UpdateRequest::Signed { board, length, .. } => {
                self.begin(board, length, &slot, station, store).await
            }
            UpdateRequest::Bytes { offset, bytes } => self.write(offset, bytes),
            UpdateRequest::End(signature) => self.end(signature, station, store).await,
            _ => Ok(UpdateAnswer::Done),
        };
        match self.progress {
            Progress::Open { .. } => station.disable_until(station.seconds() + SILENCE_S),
            Progress::Marked(_) => station.disable_until(u32::MAX),
            Progress::None if was_open => station.disable_until(0),
            Progress::None => {}
        }
        changed
    }

    /// Confirms an image on trial; otherwise there is nothing to confirm.
    fn confirm(&mut self, station: &Station) -> Result<UpdateAnswer<'static>, UpdateRefusal> {
        if self.on_trial {
            if !(self.second_slot()?.confirm)() {
                return Err(UpdateRefusal::Store);
            }
            self.on_trial = false;
            station.disable_until(0);
        }
        Ok(UpdateAnswer::Done)
    }

    fn second_slot(&self) -> Result<SecondSlot, UpdateRefusal> {
        match self.slot.map(|slot| slot.writer) {
            Some(Writer::Program(second)) => Ok(second),
            _ => Err(UpdateRefusal::NoSlot),
        }
    }

    async fn begin(
        &mut self,
        board: &str,
        length: u32,
        slot: &Slot,
        station: &Station,
        store: &mut Records<impl NorFlash, impl BorrowMut<Waiting>>,
    ) -> Result<UpdateAnswer<'static>, UpdateRefusal> {
        match (self.progress, slot.writer) {
            // A repeated request has already been carried out.
            (Progress::Marked(_), Writer::Loader(_)) => return Ok(UpdateAnswer::Loader),
            (Progress::Marked(_), Writer::Program(_)) => return Err(UpdateRefusal::OnTrial),
            _ if self.on_trial => return Err(UpdateRefusal::OnTrial),
            _ => self.progress = Progress::None,
        }
        if board != slot.board {
            return Err(UpdateRefusal::OtherBoard);
        }
        if length == 0 || length > slot.size || !length.is_multiple_of(4) {
            return Err(UpdateRefusal::Length);
        }
        let key = store.key().await.ok_or(UpdateRefusal::NoKey)?;
        if self.begun == MAX_UPDATES_PER_START {
            return Err(UpdateRefusal::TooOften);
        }
        match slot.writer {
            Writer::Loader(request) => {
                request(&key);
                self.restart_soon(station);
                return Ok(UpdateAnswer::Loader);
            }
            Writer::Program(second) if !(second.has_room)() => return Err(UpdateRefusal::Store),
            Writer::Program(_) => {}
        }
        self.begun += 1;
        self.progress = Progress::Open { length, written: 0 };
        Ok(UpdateAnswer::Done)
    }

    /// Restarts the board half a second after this answer.
    fn restart_soon(&mut self, station: &Station) {
        let cycles = 1 + station.settings().frequency as u16 / 2;
        self.progress = Progress::Marked(cycles);
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<UpdateAnswer<'static>, UpdateRefusal> {
        let second = self.second_slot();
        let Progress::Open { length, written } = &mut self.progress else {
            return Err(UpdateRefusal::Order(0));
        };
        let Some(end) = check_chunk(offset, bytes, *length, *written)? else {
            return Ok(UpdateAnswer::Done);
        };
        // Bytes that reach into another sector start with its erasure.
        let second = second?;
        let sector = (end - 1) / second.sector * second.sector;
        let erased = sector < offset || (second.erase)(sector);
        if !erased || !(second.write)(offset, bytes) {
            self.progress = Progress::None;
            return Err(UpdateRefusal::Store);
        }
        *written = end;
        Ok(UpdateAnswer::Done)
    }

    async fn end(
        &mut self,
        signature: &[u8],
        station: &Station,
        store: &mut Records<impl NorFlash, impl BorrowMut<Waiting>>,
    ) -> Result<UpdateAnswer<'static>, UpdateRefusal> {
        let (length, written) = match self.progress {
            Progress::Open { length, written } => (length, written),
            // A repeated request has already been carried out.
            Progress::Marked(_) => return Ok(UpdateAnswer::Done),
            Progress::None => return Err(UpdateRefusal::Order(0)),
        };
        let signature: &[u8; 64] = signature.try_into().map_err(|_| UpdateRefusal::Length)?;
        if written != length {
            return Err(UpdateRefusal::Order(written));
        }
        let (slot, second) = (self.slot.ok_or(UpdateRefusal::NoSlot)?, self.second_slot()?);
        let key = store.key().await.ok_or(UpdateRefusal::NoKey)?;
        let mut sum = Sha512::new();
        let mut bytes = [0; MAX_UPDATE_BYTES];
        for offset in (0..length).step_by(MAX_UPDATE_BYTES) {
            let size = MAX_UPDATE_BYTES.min((length - offset) as usize);
            (second.read)(offset, &mut bytes[..size]);
            sum.update(&bytes[..size]);
            yield_now().await;
        }
        sum.update(slot.board.as_bytes());
        self.progress = Progress::None;
        if !is_signed(&key, &sum.finalize(), signature) {
            return Err(UpdateRefusal::Signature);
        }
        if !(second.mark)() {
            return Err(UpdateRefusal::Store);
        }
        self.restart_soon(station);
        Ok(UpdateAnswer::Done)
    }
}

/// Stores the public key; a change of the key needs a PIN.
async fn set_key(
    key: &[u8],
    has_pin: bool,
    store: &mut Records<impl NorFlash, impl BorrowMut<Waiting>>,
) -> Result<UpdateAnswer<'static>, UpdateRefusal> {
    let key: &[u8; 32] = key.try_into().map_err(|_| UpdateRefusal::Length)?;
    if PublicKey::try_from(key).is_err() {
        return Err(UpdateRefusal::Signature);
    }
    match store.key().await {
        Some(same) if same == *key => {}
        Some(_) if !has_pin => return Err(UpdateRefusal::HasKey),
        _ => {
            let saved = store.save_key(key).await;
            saved.map_err(|cause| match cause {
                StoreFailed::SupplyLow => UpdateRefusal::SupplyLow,
                StoreFailed::Memory | StoreFailed::NoSettings => UpdateRefusal::Store,
            })?;
        }
    }
    Ok(UpdateAnswer::Done)
}
