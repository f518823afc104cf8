//! Non-volatile memory: the settings with the target and the recipes, and the last faults.
//!
//! Settings, target and recipes are one record of a [`Journal`], which no loss of power tears
//! apart. A damaged record is never replaced by an older one or by the defaults, which may not fit
//! the machine: the drive stays off until settings are saved.

use core::borrow::BorrowMut;
use core::future::Future;

use embedded_storage_async::nor_flash::NorFlash;
use kband_control::wire::{KeptFault, Pin};
use kband_control::{Settings, Target};

pub use crate::journal::StoreFailed;
use crate::journal::{Journal, Newest, OVERHEAD};
use crate::recipes::Recipes;
use crate::waiting::{RECORD_SIZE, Waiting};
use encoding::{Words, put};
use record::{decode_settings, encode_settings};

/// Size of a slot for settings, target and recipes, bytes: 40 000 saves in 10 000 erasures.
const SLOT: usize = 1008;
/// Size of the content of such a record, bytes.
const CONTENT: usize = SLOT - OVERHEAD;
/// Size of a slot for a fault, bytes. The smallest page holds 50 of them and its mark.
const FAULT_SLOT: usize = 40;
/// Number of faults that are kept.
pub const KEPT_FAULTS: u32 = 32;
/// Size of the content of a fault record, bytes.
const FAULT_CONTENT: usize = FAULT_SLOT - OVERHEAD;
const _: () = assert!(FAULT_CONTENT == RECORD_SIZE);

/// State of the stored settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Condition {
    /// They are the settings saved last.
    Whole,
    /// No settings were ever saved.
    #[default]
    Never,
    /// The settings saved last are damaged, out of range, or from a firmware that is too old.
    Lost,
    /// The settings saved last are from a newer firmware; they stay until others are saved.
    Newer,
}

/// Content of the memory at the start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// The saved settings; without them the defaults, with which the drive must not run.
    pub settings: Settings,
    /// The saved target; without one, amplitude 0.
    pub target: Target,
    /// PIN of the link, where one was saved.
    pub pin: Option<Pin>,
    /// State of these settings.
    pub condition: Condition,
    /// Settings that the record lacks, with their defaults: bit n for `Settings::KEYS[n]`.
    pub added: u64,
}

impl Found {
    /// Defaults with a target that does not drive.
    pub fn none(condition: Condition) -> Self {
        Self {
            settings: Settings::default(),
            target: Target::Amplitude(0.0),
            pin: None,
            condition,
            added: 0,
        }
    }
}

impl Default for Found {
    fn default() -> Self {
        Self::none(Condition::Never)
    }
}

/// Memory of the settings and the last faults.
pub trait Store {
    /// Loads the settings and the target saved last.
    fn load(&mut self) -> impl Future<Output = Found>;

    /// Saves settings, target and PIN, with the recipes saved last. Here and in the other saves a
    /// loss of power leaves the previous record or the new one.
    fn save(
        &mut self,
        settings: &Settings,
        target: Target,
        pin: Option<Pin>,
    ) -> impl Future<Output = Result<(), StoreFailed>>;

    /// Loads the recipes saved last.
    fn recipes(&mut self) -> impl Future<Output = Recipes>;

    /// Saves the recipes, with the settings, the target and the PIN saved last.
    fn save_recipes(&mut self, recipes: &Recipes) -> impl Future<Output = Result<(), StoreFailed>>;

    /// Loads the public key of updates, where one was saved.
    fn key(&mut self) -> impl Future<Output = Option<[u8; 32]>>;

    /// Saves the public key of updates, with all else that was saved last.
    fn save_key(&mut self, key: &[u8; 32]) -> impl Future<Output = Result<(), StoreFailed>>;

    /// Whether the supply is good enough to program the flash.
    fn supply_is_good(&self) -> bool;

    /// Queues a fault for [`Store::keep_faults`]. The queue survives a reset.
    fn take_fault(&mut self, fault: &KeptFault);

    /// Stores the queued faults, of which [`KEPT_FAULTS`] are kept, once the supply is good.
    fn keep_faults(&mut self) -> impl Future<Output = ()>;

    /// Loads the fault that is `back` faults older than the newest.
    fn fault(&mut self, back: u32) -> impl Future<Output = Option<KeptFault>>;
}

/// Memory in four pages of a NOR flash: two for the settings, two for the faults.
pub struct Records<F, W> {
    flash: F,
    settings: Journal<SLOT>,
    /// Where an older image had the settings. It is read until a record is stored in `settings`.
    older: Option<Journal<SLOT>>,
    faults: Journal<FAULT_SLOT>,
    waiting: W,
    supply_settled: fn() -> bool,
}

impl<F: NorFlash, W: BorrowMut<Waiting>> Records<F, W> {
    /// Opens the memory in these pages of the flash; faults wait in `waiting` for `supply_settled`.
    ///
    /// # Errors
    /// A range is not two whole pages.
    pub fn new(
        flash: F,
        settings: core::ops::Range<u32>,
        faults: core::ops::Range<u32>,
        waiting: W,
        supply_settled: fn() -> bool,
    ) -> Result<Self, StoreFailed> {
        Ok(Self {
            settings: Journal::converting::<{ version_3::SLOT }, _>(&flash, settings, 1)?,
            older: None,
            faults: Journal::new(&flash, faults, KEPT_FAULTS)?,
            flash,
            waiting,
            supply_settled,
        })
    }

    /// Reads the settings of an older image from two pages of `page` bytes from `start` on, until
    /// one is stored here.
    pub fn reading_from(self, start: u32, page: u32) -> Self {
        Self {
            older: Some(Journal::reading::<{ version_3::SLOT }>(start, page)),
            ..self
        }
    }

    /// State of the newest record, from what is known of the pages; copies it to `content`.
    async fn newest(&mut self, content: &mut [u8; CONTENT]) -> Newest {
        let newest = self.settings.last(&mut self.flash, content).await;
        self.or_older(newest, content).await
    }

    /// `newest`, or the state of the newest record of an older image, if none was stored here.
    async fn or_older(&mut self, newest: Newest, content: &mut [u8; CONTENT]) -> Newest {
        match &mut self.older {
            Some(older) if !self.settings.has_begun() => {
                match older.last(&mut self.flash, content).await {
                    Newest::Nothing => newest,
                    older => older,
                }
            }
            _ => newest,
        }
    }

    /// The settings of the newest record, whose content is copied to `content`.
    async fn whole(&mut self, content: &mut [u8; CONTENT]) -> Result<Found, StoreFailed> {
        match self.newest(content).await {
            Newest::Whole => decode_settings(content).map_err(|_| StoreFailed::NoSettings),
            _ => Err(StoreFailed::NoSettings),
        }
    }

    /// Stores a record with this content, unless the newest has it already.
    async fn keep(&mut self, content: &[u8; CONTENT]) -> Result<(), StoreFailed> {
        if self.settings.holds(&mut self.flash, content).await {
            return Ok(());
        }
        if !self.supply_is_good() {
            return Err(StoreFailed::SupplyLow);
        }
        let kept = self.settings.append(&mut self.flash, content).await;
        kept.map_err(|why| self.failed(why))
    }

    /// Error to report: a low supply, if it has fallen meanwhile.
    fn failed(&self, why: StoreFailed) -> StoreFailed {
        if self.supply_is_good() {
            why
        } else {
            StoreFailed::SupplyLow
        }
    }
}

impl<F: NorFlash, W: BorrowMut<Waiting>> Store for Records<F, W> {
    async fn load(&mut self) -> Found {
        let mut content = [0; CONTENT];
        let newest = self.settings.newest(&mut self.flash, &mut content).await;
        match self.or_older(newest, &mut content).await {
            Newest::Nothing => Found::none(Condition::Never),
            Newest::Spoilt => Found::none(Condition::Lost),
            Newest::Whole => decode_settings(&content).unwrap_or_else(Found::none),
        }
    }

    async fn save(
        &mut self,
        settings: &Settings,
        target: Target,
        pin: Option<Pin>,
    ) -> Result<(), StoreFailed> {
        let mut content = [0; CONTENT];
        let newest = self.newest(&mut content).await;
        let key = record::key(&content);
        if newest != Newest::Whole || !record::has_recipes(&content) {
            content.fill(0);
        }
        encode_settings(&mut content, settings, target, pin, key);
        self.keep(&content).await
    }

    async fn recipes(&mut self) -> Recipes {
        let mut content = [0; CONTENT];
        let newest = self.newest(&mut content).await;
        if newest == Newest::Whole && record::has_recipes(&content) {
            Recipes::of(&content[record::SIZE..])
        } else {
            Recipes::default()
        }
    }

    async fn save_recipes(&mut self, recipes: &Recipes) -> Result<(), StoreFailed> {
        let mut content = [0; CONTENT];
        let found = self.whole(&mut content).await?;
        let key = record::key(&content);
        encode_settings(&mut content, &found.settings, found.target, found.pin, key);
        content[record::SIZE..].copy_from_slice(recipes.bytes());
        self.keep(&content).await
    }

    async fn key(&mut self) -> Option<[u8; 32]> {
        let mut content = [0; CONTENT];
        self.newest(&mut content).await;
        record::key(&content)
    }

    async fn save_key(&mut self, key: &[u8; 32]) -> Result<(), StoreFailed> {
        let mut content = [0; CONTENT];
        let found = self.whole(&mut content).await?;
        let key = Some(*key);
        encode_settings(&mut content, &found.settings, found.target, found.pin, key);
        self.keep(&content).await
    }

    fn supply_is_good(&self) -> bool {
        (self.supply_settled)()
    }

    fn take_fault(&mut self, fault: &KeptFault) {
        self.waiting.borrow_mut().push(fault_content(fault));
    }

    async fn keep_faults(&mut self) {
        while let Some(content) = self.waiting.borrow().first() {
            if !self.supply_is_good() {
                return;
            }
            let kept = self.faults.append(&mut self.flash, &content).await;
            if let Err(why) = kept
                && self.failed(why) == StoreFailed::SupplyLow
            {
                return;
            }
            // The self-test reports a failed memory; the fault itself is in the event log.
            self.waiting.borrow_mut().drop_first();
        }
    }

    async fn fault(&mut self, back: u32) -> Option<KeptFault> {
        let mut content = [0; FAULT_CONTENT];
        let number = self
            .faults
            .older(&mut self.flash, back, &mut content)
            .await?;
        fault_of(number, &content)
    }
}

fn fault_content(fault: &KeptFault) -> [u8; FAULT_CONTENT] {
    let mut content = [0; FAULT_CONTENT];
    let words = [
        u32::from(fault.fault) | u32::from(fault.state) << 8,
        fault.seconds,
        fault.amplitude.to_bits(),
        fault.expected.to_bits(),
        fault.output.to_bits(),
        u32::from(fault.low) | u32::from(fault.high) << 16,
    ];
    put(&mut content, words);
    content
}

fn fault_of(number: u32, content: &[u8]) -> Option<KeptFault> {
    let mut words = Words(content);
    let [fault, state, ..] = words.next()?.to_le_bytes();
    let seconds = words.next()?;
    let (amplitude, expected, output) = (words.number()?, words.number()?, words.number()?);
    let readings = words.next()?;
    Some(KeptFault {
        number,
        seconds,
        fault,
        state,
        amplitude,
        expected,
        output,
        low: readings as u16,
        high: (readings >> 16) as u16,
    })
}

pub(crate) mod encoding;
mod record;
mod version_3;

#[cfg(test)]
pub(crate) mod tests;
