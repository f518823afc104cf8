//! Append-only log of records in two banks of NOR flash, with a checksum and a commit mark (seal)
//! in each record.
//!
//! A bank is one erasable page of any size. A record fills one slot of a bank:
//!
//! | bytes | content |
//! |---|---|
//! | 4 | number of the record, rising |
//! | `SLOT` - 16 | its content |
//! | 4 | CRC-32 of both |
//! | 8 | the seal, zero: written last |
//!
//! A record with a valid checksum is valid, sealed or not. An invalid record without a seal was cut
//! short by a loss of power; the previous record remains the newest. An invalid record with a seal
//! was valid once: it is [`Newest::Damaged`]. An older record, which may belong to another machine,
//! must not silently replace it, as in the maps of `sequential-storage`.
//!
//! A bank begins with a mark, programmed after its erasure and cleared before the next. A bank
//! without a mark is erased before its first record, even if it reads as erased. After an
//! interrupted erasure cells may not stay erased.
//!
//! A journal without any mark or record counts as a new chip; its banks get marks without an
//! erasure.

use embassy_futures::yield_now;
use embedded_storage_async::nor_flash::NorFlash;
use kband_control::wire::crc32;

/// Reason for not storing a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoreFailed {
    /// Reading, programming or erasing the flash failed.
    Memory,
    /// The supply is low, or was within the settling time.
    SupplyLow,
    /// Valid settings, with which it would be stored, are missing.
    NoSettings,
}

/// Result of an access to the memory.
pub(crate) type Result<T = (), E = StoreFailed> = core::result::Result<T, E>;

const NUMBER: usize = 4;
const CHECK: usize = 4;
/// Size of a record's seal, bytes: the largest word that a board's flash programs at once.
const SEAL: usize = 8;
/// First bytes of a completely erased bank; half of the bits are ones.
const MARK: [u8; 16] = [
    0x6b, 0x94, 0x62, 0x9d, 0x65, 0x9a, 0x72, 0x8d, 0x73, 0x8c, 0x6c, 0x93, 0x6f, 0x90, 0x74, 0x8b,
];
/// Size of the mark with the blank bytes behind it, bytes.
const MARK_SLOT: usize = 32;
/// Number of bytes in a slot beside its content.
pub const OVERHEAD: usize = NUMBER + CHECK + SEAL;
/// Number of slots read before other tasks run.
const SLOTS_PER_SLICE: u32 = 16;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Slot {
    Blank,
    Mark,
    Cut,
    Whole(u32),
    /// A sealed record whose checksum fails.
    Damaged,
}

impl Slot {
    fn read(bytes: &[u8]) -> Self {
        if bytes.iter().all(|byte| *byte == 0xff) {
            return Self::Blank;
        }
        if let Some(rest) = bytes.strip_prefix(&MARK)
            && rest.iter().all(|byte| *byte == 0xff)
        {
            return Self::Mark;
        }
        let Some((body, seal)) = bytes.split_last_chunk::<SEAL>() else {
            return Self::Damaged;
        };
        let Some((payload, check)) = body.split_last_chunk::<CHECK>() else {
            return Self::Damaged;
        };
        if crc32(payload) == u32::from_le_bytes(*check)
            && let Some(number) = payload.first_chunk::<NUMBER>()
        {
            return Self::Whole(u32::from_le_bytes(*number));
        }
        // The majority of the bits decides, so that one flipped bit does not.
        let sealed = u64::from_le_bytes(*seal).count_zeros() > u64::BITS / 2;
        if sealed { Self::Damaged } else { Self::Cut }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Place {
    bank: usize,
    index: u32,
}

/// Summary of the slots of both banks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Survey {
    newest: Option<(Place, u32)>,
    /// Number of slots in each bank up to the last one that is not blank.
    used: [u32; 2],
    /// Number of slots in each bank up to the last damaged one.
    damaged: [u32; 2],
    marked: [bool; 2],
    /// Number of slots in a bank, the slot of its mark included.
    slots: u32,
}

impl Survey {
    fn take(&mut self, place: Place, slot: Slot) {
        let Place { bank, index } = place;
        if slot != Slot::Blank {
            self.used[bank] = index + 1;
        }
        match slot {
            Slot::Mark if index == 0 => self.marked[bank] = true,
            Slot::Damaged => self.damaged[bank] = index + 1,
            Slot::Whole(number) if self.newest.is_none_or(|(_, newest)| number > newest) => {
                self.newest = Some((place, number));
            }
            _ => {}
        }
    }

    /// Records that the bank was erased and marked.
    fn clear(&mut self, bank: usize) {
        self.used[bank] = 1;
        self.damaged[bank] = 0;
        self.marked[bank] = true;
    }

    /// Whether the bank was completely erased and holds no record.
    fn is_erased(&self, bank: usize) -> bool {
        self.marked[bank] && self.used[bank] == 1
    }

    /// The bank for the next record, and whether it must be prepared first.
    fn next_bank(&self) -> (usize, bool) {
        let has_room = |bank: usize| self.used[bank] < self.slots;
        match self.newest {
            Some((Place { bank, .. }, _)) if has_room(bank) => (bank, false),
            Some((Place { bank, .. }, _)) => (1 - bank, !self.is_erased(1 - bank)),
            None => match [0, 1].into_iter().find(|&b| self.marked[b] && has_room(b)) {
                Some(bank) => (bank, false),
                // Records in the fuller bank stay until the new one is stored.
                None => (usize::from(self.used[1] < self.used[0]), true),
            },
        }
    }

    /// Whether a damaged record may be newer than the newest valid one. The other bank is used once
    /// the first is full. During its erasure it holds no newer record, because its mark is cleared
    /// first.
    fn may_have_lost_newest(&self) -> bool {
        // Without any mark the content is not this journal's, or was damaged at several places.
        let is_valid = |bank: usize| self.marked[bank] || !self.marked[1 - bank];
        let is_damaged = |bank: usize| self.damaged[bank] > 0 && is_valid(bank);
        match self.newest {
            None => is_damaged(0) || is_damaged(1),
            Some((Place { bank, index }, _)) => {
                let is_full = index + 1 == self.slots;
                self.damaged[bank] > index + 1 || is_full && is_damaged(1 - bank)
            }
        }
    }
}

/// State of the newest record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Newest {
    /// No record was ever stored.
    Nothing,
    /// The newest record is valid.
    Whole,
    /// The newest record is damaged.
    Damaged,
}

/// A journal of records of `SLOT` - [`OVERHEAD`] bytes; it keeps the newest `min_records`.
pub struct Journal<const SLOT: usize> {
    start: u32,
    bank: u32,
    min_records: u32,
    survey: Option<Survey>,
}

impl<const SLOT: usize> Journal<SLOT> {
    /// Opens the journal in the pages `range` of the flash.
    ///
    /// # Errors
    /// `range` is not two whole pages, or a page cannot hold more than `min_records` records.
    pub fn new<F: NorFlash>(
        flash: &F,
        range: core::ops::Range<u32>,
        min_records: u32,
    ) -> Result<Self> {
        const { assert!(SLOT >= MARK_SLOT && SLOT.is_multiple_of(SEAL)) };
        let bank = F::ERASE_SIZE as u32;
        let fits = range.start.is_multiple_of(bank)
            && range.end.checked_sub(range.start) == Some(2 * bank)
            && range.end as usize <= flash.capacity()
            && SEAL.is_multiple_of(F::WRITE_SIZE)
            && F::READ_SIZE == 1;
        let journal = Self {
            start: range.start,
            bank,
            min_records,
            survey: None,
        };
        let accepted = 1..journal.slots().saturating_sub(1);
        let fits = fits && accepted.contains(&min_records);
        fits.then_some(journal).ok_or(StoreFailed::Memory)
    }

    /// Number of slots in a bank, the slot of its mark included.
    fn slots(&self) -> u32 {
        1 + self.bank.saturating_sub(MARK_SLOT as u32) / SLOT as u32
    }

    fn offset(&self, place: Place) -> u32 {
        let before = place.index.checked_sub(1);
        let records = before.map_or(0, |before| MARK_SLOT as u32 + before * SLOT as u32);
        self.start + place.bank as u32 * self.bank + records
    }

    /// Reads a slot into `buffer` and returns its bytes.
    async fn read<'a, F: NorFlash>(
        &self,
        flash: &mut F,
        place: Place,
        buffer: &'a mut [u8; SLOT],
    ) -> Result<&'a [u8]> {
        let size = if place.index == 0 { MARK_SLOT } else { SLOT };
        let bytes = buffer.get_mut(..size).ok_or(StoreFailed::Memory)?;
        let read = flash.read(self.offset(place), bytes).await;
        read.map_err(|_| StoreFailed::Memory)?;
        Ok(bytes)
    }

    async fn survey_banks<F: NorFlash>(&mut self, flash: &mut F) -> Result<Survey> {
        let mut survey = Survey {
            slots: self.slots(),
            ..Survey::default()
        };
        let mut buffer = [0; SLOT];
        for bank in 0..2 {
            for index in 0..survey.slots {
                let place = Place { bank, index };
                let bytes = self.read(flash, place, &mut buffer).await?;
                survey.take(place, Slot::read(bytes));
                if index % SLOTS_PER_SLICE == 0 {
                    yield_now().await;
                }
            }
        }
        self.survey = Some(survey);
        Ok(survey)
    }

    /// The stored survey of the banks, else a new one.
    async fn surveyed<F: NorFlash>(&mut self, flash: &mut F) -> Result<Survey> {
        match self.survey {
            Some(survey) => Ok(survey),
            None => self.survey_banks(flash).await,
        }
    }

    /// Makes the next access read both banks again.
    pub fn forget_survey(&mut self) {
        self.survey = None;
    }

    /// State of the newest record, from the stored survey of the banks. Its content is copied to
    /// `content`.
    pub async fn newest<F: NorFlash>(&mut self, flash: &mut F, content: &mut [u8]) -> Newest {
        let Ok(survey) = self.surveyed(flash).await else {
            return Newest::Damaged;
        };
        if survey.may_have_lost_newest() {
            return Newest::Damaged;
        }
        let Some((place, _)) = survey.newest else {
            return Newest::Nothing;
        };
        let length = content.len().min(SLOT - OVERHEAD);
        let offset = self.offset(place) + NUMBER as u32;
        match flash.read(offset, &mut content[..length]).await {
            Ok(()) => Newest::Whole,
            Err(_) => Newest::Damaged,
        }
    }

    /// Reads the record that is `age` valid records older than the newest, and returns its number.
    /// Interrupted or damaged records in between are skipped.
    pub async fn older<F: NorFlash>(
        &mut self,
        flash: &mut F,
        age: u32,
        content: &mut [u8],
    ) -> Option<u32> {
        let survey = self.surveyed(flash).await.ok()?;
        let (Place { bank, index }, _) = survey.newest?;
        let here = (0..=index).rev().map(|index| Place { bank, index });
        let other = 1 - bank;
        let there = (0..survey.used[other]).rev();
        let there = there.map(|index| Place { bank: other, index });
        let mut remaining = age;
        let mut buffer = [0; SLOT];
        for place in here.chain(there) {
            let bytes = self.read(flash, place, &mut buffer).await.ok()?;
            match Slot::read(bytes) {
                Slot::Whole(number) if remaining == 0 => {
                    let end = bytes.len().saturating_sub(CHECK + SEAL);
                    copy(bytes.get(NUMBER..end).unwrap_or_default(), content);
                    return Some(number);
                }
                Slot::Whole(_) => remaining -= 1,
                _ => {}
            }
        }
        None
    }

    /// Appends a record and verifies it. Erases the older bank once this one holds `min_records`
    /// records. A loss of power leaves the previous records, or those and the new one.
    pub async fn append(&mut self, flash: &mut impl NorFlash, content: &[u8]) -> Result {
        let mut survey = match self.survey.take() {
            Some(survey) => survey,
            None => self.survey_banks(flash).await?,
        };
        if survey.used == [0; 2] {
            for bank in 0..2 {
                self.mark(flash, bank, &mut survey).await?;
            }
        }
        let number = (survey.newest).map_or(0, |(_, number)| number.wrapping_add(1));
        let (bank, unready) = survey.next_bank();
        if unready {
            self.prepare(flash, bank, &mut survey).await?;
        }
        let index = survey.used[bank];
        let place = Place { bank, index };
        let mut bytes = [0xff; SLOT];
        let (body, seal) = bytes.split_at_mut(SLOT - SEAL);
        let (payload, check) = body.split_at_mut(SLOT - SEAL - CHECK);
        copy(&number.to_le_bytes(), payload);
        copy(content, &mut payload[NUMBER..]);
        copy(&crc32(payload).to_le_bytes(), check);
        seal.fill(0);
        let offset = self.offset(place);
        let (body, seal) = bytes.split_at(SLOT - SEAL);
        let written = flash.write(offset, body).await.is_ok()
            && (flash.write(offset + body.len() as u32, seal).await).is_ok();
        let mut buffer = [0; SLOT];
        if !written || self.read(flash, place, &mut buffer).await? != bytes {
            return Err(StoreFailed::Memory);
        }
        survey.take(place, Slot::Whole(number));
        let records = survey.used[bank] - u32::from(survey.marked[bank]);
        // A failed erasure is repeated after the next record, or before the bank is used.
        let erased = records < self.min_records
            || survey.is_erased(1 - bank)
            || self.prepare(flash, 1 - bank, &mut survey).await.is_ok();
        self.survey = erased.then_some(survey);
        // An incomplete erasure must not hide the record.
        if !erased && self.survey_banks(flash).await?.may_have_lost_newest() {
            return Err(StoreFailed::Memory);
        }
        Ok(())
    }

    async fn prepare(&self, flash: &mut impl NorFlash, bank: usize, survey: &mut Survey) -> Result {
        let from = self.offset(Place { bank, index: 0 });
        // The mark is cleared first, because it could survive an interrupted erasure.
        let cleared = !survey.marked[bank] || flash.write(from, &[0; SEAL]).await.is_ok();
        if !cleared || flash.erase(from, from + self.bank).await.is_err() {
            return Err(StoreFailed::Memory);
        }
        self.mark(flash, bank, survey).await
    }

    async fn mark(&self, flash: &mut impl NorFlash, bank: usize, survey: &mut Survey) -> Result {
        let place = Place { bank, index: 0 };
        let written = flash.write(self.offset(place), &MARK).await.is_ok();
        let mut buffer = [0; SLOT];
        if !written || Slot::read(self.read(flash, place, &mut buffer).await?) != Slot::Mark {
            return Err(StoreFailed::Memory);
        }
        survey.clear(bank);
        Ok(())
    }
}

fn copy(from: &[u8], to: &mut [u8]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = *from;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::storage::store::tests::Nor;
    use embassy_futures::block_on;

    const SLOT: usize = 256;

    fn open(nor: &Nor<2048>) -> Journal<SLOT> {
        Journal::new(nor, 0..4096, 1).unwrap()
    }

    fn open_faults(nor: &Nor<2048>) -> Journal<40> {
        Journal::new(nor, 0..4096, 32).unwrap()
    }

    fn filled(records: u32) -> Nor<2048> {
        let mut nor = Nor::new();
        let mut journal = open(&nor);
        for record in 0..records {
            block_on(journal.append(&mut nor, &record.to_le_bytes())).unwrap();
        }
        nor
    }

    #[test]
    fn a_mark_does_not_outlive_an_erasure_that_is_cut_short() {
        // The erasure of the first bank follows the record and changes no bit.
        let mut nor = filled(7);
        nor.refuses_erasures = true;
        let mut journal = open(&nor);
        block_on(journal.append(&mut nor, b"new")).unwrap();
        assert_ne!(Slot::read(&nor.bytes[..MARK_SLOT]), Slot::Mark);
        let mut journal = open(&nor);
        let mut content = [0; SLOT - OVERHEAD];
        let newest = block_on(journal.newest(&mut nor, &mut content));
        assert!(newest == Newest::Whole && content.starts_with(b"new"));
    }

    #[test]
    fn a_cut_record_hides_no_older_one() {
        let mut nor = Nor::<2048>::new();
        let mut content = [0; 40 - OVERHEAD];
        for record in 0..10_u32 {
            let mut journal = open_faults(&nor);
            block_on(journal.append(&mut nor, &record.to_le_bytes())).unwrap();
            // The next record was begun.
            let next = MARK_SLOT + 40 * (2 * record as usize + 1);
            nor.bytes[next] = 0;
        }
        let mut journal = open_faults(&nor);
        for age in 0..10 {
            let number = block_on(journal.older(&mut nor, age, &mut content));
            assert_eq!(number, Some(9 - age));
        }
        assert_eq!(block_on(journal.older(&mut nor, 10, &mut content)), None);
    }

    #[test]
    fn ranges_that_are_no_two_pages_are_refused() {
        let nor = Nor::<2048>::new();
        for range in [0..2048, 0..6144, 1024..5120, 6144..10_240] {
            assert!(Journal::<SLOT>::new(&nor, range.clone(), 1).is_err());
        }
        // A slot for the mark, one for the new record and seven for the older ones exceed the bank.
        assert!(Journal::<SLOT>::new(&nor, 0..4096, 7).is_err());
    }

    #[test]
    fn a_blank_bank_without_mark_is_erased_before_use() {
        // A full bank; the other reads as blank after a cut erasure.
        let mut nor = filled(7);
        nor.bytes[2048..4096].fill(0xff);
        nor.weak[1] = true;
        let mut journal = open(&nor);
        block_on(journal.append(&mut nor, b"new")).unwrap();
        assert!(nor.bytes[2048 + MARK_SLOT + 4..].starts_with(b"new"));
        assert_eq!(nor.erasures, [1, 1, 0, 0]);
        // On a new chip no bank is erased until the first one is full.
        assert_eq!(filled(7).erasures, [0; 4]);
    }
}
