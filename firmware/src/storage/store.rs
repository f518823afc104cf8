//! Non-volatile memory: the settings with the target and the recipes, and the last faults.
//!
//! Settings, target and recipes are one record of a [`Journal`], which no loss of power splits. An
//! older record or the defaults, which may not fit the machine, never replace a damaged record. The
//! drive then stays off until settings are saved.

use core::borrow::BorrowMut;
use embedded_storage_async::nor_flash::NorFlash;
use kband_control::wire::{FaultRecord, Pin};
use kband_control::{Settings, Target};

pub use crate::storage::journal::StoreFailed;
use crate::storage::journal::{Journal, Newest, OVERHEAD, Result};
use crate::storage::recipes::Recipes;
use crate::storage::saves::Saves;
use crate::storage::waiting::{RECORD_SIZE, Waiting};
use encoding::{Words, put};
use record::{decode_settings, encode_settings};

/// Size of a slot for settings, target and recipes, bytes: 40 000 saves in 10 000 erasures.
const SLOT: usize = 1008;
/// Size of the content of such a record, bytes.
const CONTENT: usize = SLOT - OVERHEAD;
/// Size of a slot for a fault, bytes. The smallest page holds 50 such slots and its mark.
const FAULT_SLOT: usize = 40;
/// Number of faults kept.
pub const STORED_FAULTS: u32 = 32;
const FAULT_CONTENT: usize = FAULT_SLOT - OVERHEAD;
const _: () = assert!(FAULT_CONTENT == RECORD_SIZE);

/// State of the stored settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Condition {
    /// They are the settings saved last.
    Whole,
    /// No settings were ever saved.
    Never,
    /// The last saved settings are damaged, out of range, or from a firmware that is too old.
    Lost,
    /// The last saved settings are from a newer firmware; they stay until others are saved.
    Newer,
}

/// Content of the memory at the start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadedSettings {
    /// The saved settings; else the defaults, with which the drive must not run.
    pub settings: Settings,
    /// The saved target; without one, amplitude 0.
    pub target: Target,
    /// PIN of the link, if one was saved.
    pub pin: Option<Pin>,
    /// State of these settings.
    pub condition: Condition,
    /// Settings missing in the record, set to their defaults: bit n for `Settings::KEYS[n]`.
    pub added: u64,
}

impl LoadedSettings {
    /// Whole settings without a PIN.
    pub fn whole(settings: Settings, target: Target) -> Self {
        Self {
            settings,
            target,
            ..Self::none(Condition::Whole)
        }
    }

    /// Defaults with a target that does not move the drive.
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

/// Memory of the settings and the last faults in four pages of a NOR flash, two each. A loss of
/// power during a save leaves the previous record or the new one.
pub struct Records<F, W> {
    flash: F,
    settings: Journal<SLOT>,
    faults: Journal<FAULT_SLOT>,
    waiting: W,
    supply_settled: fn() -> bool,
    pub(crate) saves: Saves,
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
    ) -> Result<Self> {
        Ok(Self {
            settings: Journal::new(&flash, settings, 1)?,
            faults: Journal::new(&flash, faults, STORED_FAULTS)?,
            flash,
            waiting,
            supply_settled,
            saves: Saves::default(),
        })
    }

    /// State of the newest record. Its content is copied to `content`, which stays 0 without a whole
    /// record.
    async fn newest(&mut self, content: &mut [u8; CONTENT]) -> Newest {
        self.settings.newest(&mut self.flash, content).await
    }

    /// The settings of the newest record, whose content is copied to `content`.
    async fn load_newest(&mut self, content: &mut [u8; CONTENT]) -> Result<LoadedSettings> {
        match self.newest(content).await {
            Newest::Whole => decode_settings(content).map_err(|_| StoreFailed::NoSettings),
            _ => Err(StoreFailed::NoSettings),
        }
    }

    /// Stores a record with this content, unless the newest record has it already.
    async fn save_content(&mut self, content: &[u8; CONTENT]) -> Result {
        if self.is_stored(content).await {
            return Ok(());
        }
        if !self.supply_is_good() {
            return Err(StoreFailed::SupplyLow);
        }
        let result = self.settings.append(&mut self.flash, content).await;
        result.map_err(|cause| self.failed(cause))
    }

    /// Whether the newest record is valid and has this content.
    async fn is_stored(&mut self, content: &[u8; CONTENT]) -> bool {
        let mut stored = [0; CONTENT];
        let newest = self.settings.newest(&mut self.flash, &mut stored).await;
        newest == Newest::Whole && stored == *content
    }

    /// Error to report: a low supply, if it has dropped meanwhile.
    fn failed(&self, cause: StoreFailed) -> StoreFailed {
        if self.supply_is_good() {
            cause
        } else {
            StoreFailed::SupplyLow
        }
    }

    /// Loads the last saved settings and target, after all pages were read again.
    pub async fn load(&mut self) -> LoadedSettings {
        self.settings.forget_survey();
        let mut content = [0; CONTENT];
        match self.newest(&mut content).await {
            Newest::Nothing => LoadedSettings::none(Condition::Never),
            Newest::Damaged => LoadedSettings::none(Condition::Lost),
            Newest::Whole => decode_settings(&content).unwrap_or_else(LoadedSettings::none),
        }
    }

    /// Saves settings, target and PIN, with the last saved recipes.
    pub async fn save(&mut self, settings: &Settings, target: Target, pin: Option<Pin>) -> Result {
        let mut content = [0; CONTENT];
        let newest = self.newest(&mut content).await;
        let key = record::key(&content);
        if newest != Newest::Whole || !record::has_recipes(&content) {
            content.fill(0);
        }
        encode_settings(&mut content, settings, target, pin, key);
        self.save_content(&content).await
    }

    /// Loads the last saved recipes.
    pub async fn recipes(&mut self) -> Recipes {
        let mut content = [0; CONTENT];
        let newest = self.newest(&mut content).await;
        if newest == Newest::Whole && record::has_recipes(&content) {
            Recipes::of(&content[record::SIZE..])
        } else {
            Recipes::default()
        }
    }

    /// Saves the recipes, with the last saved settings, target and PIN.
    pub async fn save_recipes(&mut self, recipes: &Recipes) -> Result {
        let mut content = [0; CONTENT];
        let found = self.load_newest(&mut content).await?;
        let key = record::key(&content);
        encode_settings(&mut content, &found.settings, found.target, found.pin, key);
        content[record::SIZE..].copy_from_slice(recipes.bytes());
        self.save_content(&content).await
    }

    /// Loads the public key of updates, if one was saved.
    pub async fn key(&mut self) -> Option<[u8; 32]> {
        let mut content = [0; CONTENT];
        self.newest(&mut content).await;
        record::key(&content)
    }

    /// Saves the public key of updates, with everything else that was saved last.
    pub async fn save_key(&mut self, key: &[u8; 32]) -> Result {
        let mut content = [0; CONTENT];
        let found = self.load_newest(&mut content).await?;
        let key = Some(*key);
        encode_settings(&mut content, &found.settings, found.target, found.pin, key);
        self.save_content(&content).await
    }

    /// Whether the supply is good enough to program the flash.
    pub fn supply_is_good(&self) -> bool {
        (self.supply_settled)()
    }

    /// Queues a fault for [`Records::keep_faults`]. The queue survives a reset.
    pub fn take_fault(&mut self, fault: &FaultRecord) {
        self.waiting.borrow_mut().push(fault_content(fault));
    }

    /// Stores the queued faults once the supply is good; the newest [`STORED_FAULTS`] are kept.
    pub async fn keep_faults(&mut self) {
        while let Some(content) = self.waiting.borrow().first() {
            if !self.supply_is_good() {
                return;
            }
            let result = self.faults.append(&mut self.flash, &content).await;
            if let Err(cause) = result
                && self.failed(cause) == StoreFailed::SupplyLow
            {
                return;
            }
            // The self-test reports a failed memory; the fault itself is in the event log.
            self.waiting.borrow_mut().drop_first();
        }
    }

    /// Loads the fault that is `age` faults older than the newest.
    pub async fn fault(&mut self, age: u32) -> Option<FaultRecord> {
        let mut content = [0; FAULT_CONTENT];
        let number = self.faults.older(&mut self.flash, age, &mut content);
        fault_of(number.await?, &content)
    }
}

fn fault_content(fault: &FaultRecord) -> [u8; FAULT_CONTENT] {
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

fn fault_of(number: u32, content: &[u8]) -> Option<FaultRecord> {
    let mut words = Words(content);
    let [fault, state, ..] = words.next()?.to_le_bytes();
    let seconds = words.next()?;
    let (amplitude, expected, output) = (words.number()?, words.number()?, words.number()?);
    let readings = words.next()?;
    Some(FaultRecord {
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

#[cfg(test)]
pub(crate) mod tests;
