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
//! erasure. Banks of an older image, with a record in their first slot, are read and appended to
//! unchanged.
//!
//! A journal that [converts](Journal::new) tags its banks behind the mark; the records
//! follow from byte 32 on. A bank without the tag has slots of an older size. The next record is
//! then written to the other bank, and this bank is erased after it.

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

/// Size of a record's number, bytes.
const NUMBER: usize = 4;
/// Size of a record's checksum (CRC-32), bytes.
const CHECK: usize = 4;
/// Size of a record's seal, bytes: the largest word that a board's flash programs at once.
const SEAL: usize = 8;
/// First bytes of a completely erased bank; half of the bits are ones.
const MARK: [u8; 8] = [0x6b, 0x94, 0x62, 0x9d, 0x65, 0x9a, 0x72, 0x8d];
/// Bytes behind the mark of a bank whose slots have the present size, in a journal that converts.
const TAG: [u8; 8] = [0x73, 0x8c, 0x6c, 0x93, 0x6f, 0x90, 0x74, 0x8b];
/// Size of mark and tag with the blank bytes behind them, bytes.
const TAGGED_MARK: usize = 32;
/// Largest number of wrong bits in a tag: a flipped bit must not change the size of a bank's slots.
const MAX_WRONG_TAG_BITS: u32 = 16;
/// Number of bytes in a slot beside its content.
pub const OVERHEAD: usize = NUMBER + CHECK + SEAL;
/// Number of slots read before other tasks run.
const SLOTS_PER_SLICE: u32 = 16;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Slot {
    Blank,
    /// The mark of a completely erased bank.
    Mark,
    Cut,
    /// A valid record and its number.
    Whole(u32),
    /// A sealed record whose checksum fails.
    Damaged,
}

impl Slot {
    fn read(bytes: &[u8]) -> Self {
        if bytes.iter().all(|byte| *byte == 0xff) {
            return Self::Blank;
        }
        if let Some(rest) = bytes.strip_prefix(&MARK) {
            let rest = rest.strip_prefix(&TAG).unwrap_or(rest);
            if rest.iter().all(|byte| *byte == 0xff) {
                return Self::Mark;
            }
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
    /// Whether each bank has slots of the older size.
    old: [bool; 2],
    slots: [u32; 2],
}

impl Survey {
    fn blank(old: [bool; 2], slots: [u32; 2]) -> Self {
        Self {
            old,
            slots,
            ..Self::default()
        }
    }

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

    /// Records that the bank was erased and marked; it has `slots` slots.
    fn clear(&mut self, bank: usize, slots: u32) {
        self.used[bank] = 1;
        self.damaged[bank] = 0;
        self.marked[bank] = true;
        self.old[bank] = false;
        self.slots[bank] = slots;
    }

    /// Whether a record was ever completed in a bank that has its mark.
    fn has_begun(&self) -> bool {
        self.newest.is_some() || (0..2).any(|bank| self.marked[bank] && self.damaged[bank] > 0)
    }

    /// Whether the bank was completely erased and holds no record.
    fn is_erased(&self, bank: usize) -> bool {
        self.marked[bank] && self.used[bank] == 1
    }

    /// Whether the bank is erased and has slots of the present size.
    fn is_ready(&self, bank: usize) -> bool {
        self.is_erased(bank) && !self.old[bank]
    }

    /// The bank for the next record, and whether it must be prepared first.
    fn next_bank(&self) -> (usize, bool) {
        let has_room = |bank: usize| self.used[bank] < self.slots[bank] && !self.old[bank];
        match self.newest {
            Some((Place { bank, .. }, _)) if has_room(bank) => (bank, false),
            Some((Place { bank, .. }, _)) => (1 - bank, !self.is_ready(1 - bank)),
            None => match [0, 1].into_iter().find(|&b| self.marked[b] && has_room(b)) {
                Some(bank) => (bank, false),
                // Records in the fuller bank stay until the new one is stored.
                None => (usize::from(self.used[1] < self.used[0]), true),
            },
        }
    }

    /// Whether a damaged record may be newer than the newest valid one. The other bank is used once
    /// the first is full or must be converted. During its erasure it holds no newer record, because
    /// its mark is cleared first. Only an older image leaves both banks unmarked.
    fn may_have_lost_newest(&self) -> bool {
        let Some((Place { bank, index }, _)) = self.newest else {
            return self.damaged != [0; 2];
        };
        let other = 1 - bank;
        let continues = index + 1 == self.slots[bank] || self.old[bank] && !self.old[other];
        let begun = self.marked[other] || !self.marked[bank];
        self.damaged[bank] > index + 1 || continues && begun && self.damaged[other] > 0
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
    /// Size of a slot in banks without a tag, bytes.
    old_slot: usize,
    survey: Option<Survey>,
}

impl<const SLOT: usize> Journal<SLOT> {
    /// Opens the journal in the pages `range` of the flash. Its banks are tagged if `old_slot` is
    /// not `SLOT`: the pages may then hold a journal with slots of `old_slot` bytes.
    ///
    /// # Errors
    /// `range` is not two whole pages, or a page cannot hold more than `min_records` records.
    pub fn new<F: NorFlash>(
        flash: &F,
        range: core::ops::Range<u32>,
        min_records: u32,
        old_slot: usize,
    ) -> Result<Self> {
        const { assert!(SLOT > OVERHEAD && SLOT.is_multiple_of(SEAL)) };
        let bank = F::ERASE_SIZE as u32;
        let fits = range.start.is_multiple_of(bank)
            && range.end.checked_sub(range.start) == Some(2 * bank)
            && range.end as usize <= flash.capacity()
            && SEAL.is_multiple_of(F::WRITE_SIZE)
            && F::READ_SIZE == 1;
        let journal = Self {
            min_records,
            ..Self::reading(range.start, bank, old_slot)
        };
        let accepted = 1..journal.slots(false).saturating_sub(1);
        let fits = fits && accepted.contains(&min_records);
        fits.then_some(journal).ok_or(StoreFailed::Memory)
    }

    /// A read-only journal: two pages of `bank` bytes from `start`, with slots of `old_slot` bytes.
    pub(crate) fn reading(start: u32, bank: u32, old_slot: usize) -> Self {
        Self {
            start,
            bank,
            min_records: 1,
            old_slot,
            survey: None,
        }
    }

    /// Whether the banks of this journal have tags.
    fn converts(&self) -> bool {
        self.old_slot != SLOT
    }

    /// Sizes of the mark and of a slot, bytes; `old` selects a bank with the older size.
    fn sizes(&self, old: bool) -> [usize; 2] {
        match (self.converts(), old) {
            (true, false) => [TAGGED_MARK, SLOT],
            _ => [self.old_slot; 2],
        }
    }

    /// Number of slots in a bank, the slot of its mark included.
    fn slots(&self, old: bool) -> u32 {
        let [mark, slot] = self.sizes(old).map(|size| size as u32);
        1 + self.bank.saturating_sub(mark) / slot
    }

    fn offset(&self, place: Place, old: bool) -> u32 {
        let [mark, slot] = self.sizes(old).map(|size| size as u32);
        let before = place.index.checked_sub(1);
        let records = before.map_or(0, |before| mark + before * slot);
        self.start + place.bank as u32 * self.bank + records
    }

    /// Reads a slot into `buffer` and returns its bytes.
    async fn read<'a, F: NorFlash>(
        &self,
        flash: &mut F,
        place: Place,
        old: bool,
        buffer: &'a mut [u8; SLOT],
    ) -> Result<&'a [u8]> {
        let [mark, slot] = self.sizes(old);
        let size = if place.index == 0 { mark } else { slot };
        let bytes = buffer.get_mut(..size).ok_or(StoreFailed::Memory)?;
        let read = flash.read(self.offset(place, old), bytes).await;
        read.map_err(|_| StoreFailed::Memory)?;
        Ok(bytes)
    }

    async fn is_old<F: NorFlash>(&self, flash: &mut F, bank: usize) -> Result<bool> {
        let mut tag = [0; TAG.len()];
        let offset = self.offset(Place { bank, index: 0 }, false) + MARK.len() as u32;
        let read = flash.read(offset, &mut tag).await;
        read.map_err(|_| StoreFailed::Memory)?;
        let wrong = u64::from_le_bytes(tag) ^ u64::from_le_bytes(TAG);
        Ok(self.converts() && wrong.count_ones() > MAX_WRONG_TAG_BITS)
    }

    async fn survey_banks<F: NorFlash>(&mut self, flash: &mut F) -> Result<Survey> {
        let old = [self.is_old(flash, 0).await?, self.is_old(flash, 1).await?];
        let mut survey = Survey::blank(old, old.map(|old| self.slots(old)));
        let mut buffer = [0; SLOT];
        for (bank, old) in old.into_iter().enumerate() {
            for index in 0..survey.slots[bank] {
                let place = Place { bank, index };
                let bytes = self.read(flash, place, old, &mut buffer).await?;
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
        let old = survey.old[place.bank];
        let [_, slot] = self.sizes(old);
        let length = content.len().min(slot - OVERHEAD);
        let offset = self.offset(place, old) + NUMBER as u32;
        match flash.read(offset, &mut content[..length]).await {
            Ok(()) => Newest::Whole,
            Err(_) => Newest::Damaged,
        }
    }

    /// Whether a record was ever stored, from the stored survey of the banks. Data of another
    /// program do not count.
    pub(crate) fn has_begun(&self) -> bool {
        self.survey.is_none_or(|survey| survey.has_begun())
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
            let old = survey.old[place.bank];
            let bytes = self.read(flash, place, old, &mut buffer).await.ok()?;
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
        let offset = self.offset(place, false);
        let (body, seal) = bytes.split_at(SLOT - SEAL);
        let written = flash.write(offset, body).await.is_ok()
            && (flash.write(offset + body.len() as u32, seal).await).is_ok();
        let mut buffer = [0; SLOT];
        if !written || self.read(flash, place, false, &mut buffer).await? != bytes {
            return Err(StoreFailed::Memory);
        }
        survey.take(place, Slot::Whole(number));
        let records = survey.used[bank] - u32::from(survey.marked[bank]);
        // A failed erasure is repeated after the next record, or before the bank is used.
        let erased = records < self.min_records
            || survey.is_ready(1 - bank)
            || self.prepare(flash, 1 - bank, &mut survey).await.is_ok();
        self.survey = erased.then_some(survey);
        // An incomplete erasure must not hide the record.
        if !erased && self.survey_banks(flash).await?.may_have_lost_newest() {
            return Err(StoreFailed::Memory);
        }
        Ok(())
    }

    /// Erases a bank and marks it. A bank that is already erased gets its tag.
    async fn prepare(&self, flash: &mut impl NorFlash, bank: usize, survey: &mut Survey) -> Result {
        let from = self.offset(Place { bank, index: 0 }, false);
        if !survey.is_erased(bank) {
            // The mark is cleared first, because it could survive an interrupted erasure.
            let cleared = !survey.marked[bank] || flash.write(from, &[0; MARK.len()]).await.is_ok();
            if !cleared || flash.erase(from, from + self.bank).await.is_err() {
                return Err(StoreFailed::Memory);
            }
            survey.used[bank] = 0;
        }
        self.mark(flash, bank, survey).await
    }

    async fn mark(&self, flash: &mut impl NorFlash, bank: usize, survey: &mut Survey) -> Result {
        let place = Place { bank, index: 0 };
        let from = self.offset(place, false);
        // A bank of the older size already has its mark.
        let marked = survey.used[bank] > 0 || flash.write(from, &MARK).await.is_ok();
        let tag = from + MARK.len() as u32;
        let written = marked && (!self.converts() || flash.write(tag, &TAG).await.is_ok());
        let mut buffer = [0; SLOT];
        if !written || Slot::read(self.read(flash, place, false, &mut buffer).await?) != Slot::Mark
        {
            return Err(StoreFailed::Memory);
        }
        survey.clear(bank, self.slots(false));
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
    use std::vec::Vec;

    const SLOT: usize = 256;

    fn open<const PAGE: usize>(nor: &Nor<PAGE>) -> Journal<SLOT> {
        Journal::new(nor, 0..2 * PAGE as u32, 1, SLOT).unwrap()
    }

    fn open_faults(nor: &Nor<2048>) -> Journal<40> {
        Journal::new(nor, 0..4096, 32, 40).unwrap()
    }

    /// A journal of pages of `PAGE` bytes with the given number of records.
    fn filled<const PAGE: usize>(records: u32) -> Nor<PAGE> {
        let mut nor = Nor::<PAGE>::new();
        let mut journal = open(&nor);
        for record in 0..records {
            block_on(journal.append(&mut nor, &record.to_le_bytes())).unwrap();
        }
        nor
    }

    #[test]
    fn the_last_ones_outlive_the_change_of_banks() {
        let mut nor = Nor::<2048>::new();
        let mut journal = open_faults(&nor);
        let mut content = [0; 40 - OVERHEAD];
        for record in 0..500_u32 {
            block_on(journal.append(&mut nor, &record.to_le_bytes())).unwrap();
            for age in 0..32 {
                let number = block_on(journal.older(&mut nor, age, &mut content));
                assert_eq!(number, record.checked_sub(age), "{record}, {age} back");
                if let Some(number) = number {
                    assert!(content.starts_with(&number.to_le_bytes()));
                }
            }
        }
    }

    /// A journal of an older image without marks: records from the first slot on.
    fn unmarked<const PAGE: usize>(records: u32) -> Nor<PAGE> {
        let mut nor = Nor::<PAGE>::new();
        let source = filled::<PAGE>(1);
        for number in 0..records {
            let place = &mut nor.bytes[number as usize * SLOT..][..SLOT];
            place.copy_from_slice(&source.bytes[SLOT..2 * SLOT]);
            place[..4].copy_from_slice(&number.to_le_bytes());
            place[4..8].copy_from_slice(&number.to_le_bytes());
            let check = crc32(&place[..SLOT - SEAL - CHECK]);
            place[SLOT - SEAL - CHECK..SLOT - SEAL].copy_from_slice(&check.to_le_bytes());
        }
        nor
    }

    #[test]
    fn a_journal_without_marks_is_read_and_appended_to() {
        for records in 1..=8_u32 {
            let mut nor = unmarked::<2048>(records);
            let mut journal = open(&nor);
            let mut content = [0; SLOT - OVERHEAD];
            let newest = block_on(journal.newest(&mut nor, &mut content));
            assert_eq!(newest, Newest::Whole);
            assert!(content.starts_with(&(records - 1).to_le_bytes()));
            for record in records..records + 30 {
                block_on(journal.append(&mut nor, &record.to_le_bytes())).unwrap();
                let mut reopened = open(&nor);
                let newest = block_on(reopened.newest(&mut nor, &mut content));
                assert_eq!(newest, Newest::Whole);
                assert!(content.starts_with(&record.to_le_bytes()));
            }
        }
    }

    #[test]
    fn a_mark_does_not_outlive_an_erasure_that_is_cut_short() {
        // The erasure of the first bank follows the record and changes no bit.
        let mut nor = filled::<2048>(7);
        nor.refuses_erasures = true;
        let mut journal = open(&nor);
        block_on(journal.append(&mut nor, b"new")).unwrap();
        assert_ne!(Slot::read(&nor.bytes[..SLOT]), Slot::Mark);
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
            // The next record was begun; the mark takes one more slot.
            let next = 40 * (2 * record as usize + 2);
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
            assert!(Journal::<SLOT>::new(&nor, range.clone(), 1, SLOT).is_err());
        }
        // A slot for the mark, one for the new record and seven for the older ones exceed the bank.
        assert!(Journal::<SLOT>::new(&nor, 0..4096, 7, SLOT).is_err());
    }

    /// Flips each single bit of both banks. The newest record stays, or is reported as damaged; no
    /// older record replaces it. A flip changes the state of one slot, and each state is tested
    /// with all other slots. Returns the number of flips that damage the newest record.
    fn flips<const PAGE: usize>(records: u32) -> u64 {
        let slots = PAGE / SLOT;
        let nor = filled::<PAGE>(records);
        let chunks: Vec<&[u8]> = nor.bytes[..2 * PAGE].chunks_exact(SLOT).collect();
        assert_eq!(chunks.len() * SLOT, 2 * PAGE);
        let kinds: Vec<Slot> = chunks.iter().map(|chunk| Slot::read(chunk)).collect();
        let survey = |changed: usize, kind: Slot| {
            let mut survey = Survey::blank([false; 2], [slots as u32; 2]);
            for (at, &slot) in kinds.iter().enumerate() {
                let (bank, index) = (at / slots, (at % slots) as u32);
                let slot = if at == changed { kind } else { slot };
                survey.take(Place { bank, index }, slot);
            }
            survey
        };
        let intact = survey(usize::MAX, Slot::Blank);
        let newest = intact.newest.map(|(place, _)| place);
        assert!(!intact.may_have_lost_newest());
        let mut damaged = 0;
        for (at, chunk) in chunks.iter().enumerate() {
            let mut outcomes: Vec<(Slot, bool)> = Vec::new();
            let mut bytes = chunk.to_vec();
            for bit in 0..8 * SLOT {
                bytes[bit / 8] ^= 1 << (bit % 8);
                let kind = Slot::read(&bytes);
                bytes[bit / 8] ^= 1 << (bit % 8);
                let outcome = outcomes.iter().find(|(slot, _)| *slot == kind).copied();
                let (_, doubtful) = outcome.unwrap_or_else(|| {
                    let flipped = survey(at, kind);
                    let doubtful = flipped.may_have_lost_newest();
                    let holds = doubtful || flipped.newest.map(|(place, _)| place) == newest;
                    assert!(holds, "slot {at}, bit {bit}: {kind:?}");
                    outcomes.push((kind, doubtful));
                    (kind, doubtful)
                });
                damaged += u64::from(doubtful);
            }
        }
        damaged
    }

    #[test]
    fn no_single_bit_brings_an_older_record_back() {
        let bits = 8 * (SLOT as u64 - SEAL as u64);
        // The bits of the newest record except its seal.
        for records in [1, 2, 6, 7, 8, 14, 15] {
            assert_eq!(flips::<2048>(records), bits, "{records} records");
        }
        for records in [3, 511, 512] {
            assert_eq!(flips::<{ 128 * 1024 }>(records), bits, "{records} records");
        }
    }

    #[test]
    fn a_blank_bank_without_mark_is_erased_before_use() {
        // A full bank with or without its mark; the other reads as blank after a cut erasure.
        for mut nor in [filled::<2048>(7), unmarked::<2048>(8)] {
            nor.bytes[2048..4096].fill(0xff);
            nor.weak[1] = true;
            let mut journal = open(&nor);
            block_on(journal.append(&mut nor, b"new")).unwrap();
            assert!(nor.bytes[2048 + SLOT + 4..].starts_with(b"new"));
            assert_eq!(nor.erasures, [1, 1, 0, 0]);
        }
        // On a new chip no bank is erased until the first one is full.
        assert_eq!(filled::<2048>(7).erasures, [0; 4]);
    }
}
