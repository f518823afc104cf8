//! An update in the desk's memory, with power cuts at every operation.

use super::*;
use kband_control::wire::crc32;
use salty::Keypair;
use std::vec;
use std::vec::Vec;

/// First and last address of the modelled flash.
const FLASH: Range<u32> = 0x0800_0000..0x0808_0000;
/// Length of the images: two pages, a part of a request and half a word.
const LENGTH: usize = 2 * PAGE as usize + 204;

/// A flash with words of 64 bits, whose power fails after a number of operations.
#[derive(Clone)]
struct Cells {
    bytes: Vec<u8>,
    torn: Vec<usize>,
    power: usize,
    used: usize,
    stuck_word: Option<u32>,
}

impl Cells {
    fn new() -> Self {
        Self {
            bytes: vec![0xff; FLASH.len()],
            torn: Vec::new(),
            power: usize::MAX,
            used: 0,
            stuck_word: None,
        }
    }

    /// Whether the power lasts for an operation on these bytes; a power cut corrupts them.
    fn has_power(&mut self, place: Range<usize>) -> bool {
        if self.power == 0 {
            return false;
        }
        (self.power, self.used) = (self.power - 1, self.used + 1);
        self.torn.retain(|at| !place.contains(at));
        if self.power == 0 {
            self.torn.extend(place.step_by(WORD));
        }
        true
    }
}

fn place(address: u32, size: usize) -> Range<usize> {
    let at = (address - FLASH.start) as usize;
    at..at + size
}

impl Memory for Cells {
    fn read(&self, address: u32, bytes: &mut [u8]) -> bool {
        let place = place(address, bytes.len());
        bytes.copy_from_slice(&self.bytes[place.clone()]);
        let words = place.start / WORD * WORD..place.end;
        !self.torn.iter().any(|at| words.contains(at))
    }

    fn program(&mut self, address: u32, word: &[u8; WORD]) -> bool {
        let place = place(address, WORD);
        let before = &self.bytes[place.clone()];
        let erased = before == [0xff; WORD] && !self.torn.contains(&place.start) || self.power == 0;
        let holds = erased || *word == [0; WORD];
        assert!(holds, "{address:#x} is programmed twice");
        let has_power = self.has_power(place.clone());
        if has_power {
            self.bytes[place.clone()].copy_from_slice(word);
            self.bytes[place.start] |= u8::from(self.stuck_word == Some(address));
        }
        has_power
    }

    fn erase(&mut self, address: u32) -> bool {
        assert!(address.is_multiple_of(PAGE));
        let place = place(address, PAGE as usize);
        let has_power = self.has_power(place.clone());
        if has_power {
            self.bytes[place].fill(0xff);
        }
        has_power
    }

    fn crc32(&self, range: Range<u32>) -> Option<u32> {
        let mut bytes = vec![0; range.len()];
        self.read(range.start, &mut bytes).then(|| crc32(&bytes))
    }
}

fn keypair() -> Keypair {
    Keypair::from(&[7; 32])
}

/// A program with its checksum, as built.
fn image(fill: u8) -> Vec<u8> {
    let mut image: Vec<u8> = (0..LENGTH).map(|n| (n * n / 7) as u8 ^ fill).collect();
    let end = SLOT.start + LENGTH as u32 - 4;
    for (at, word) in [(0, RAM.end), (4, SLOT.start + 0x201), (END as usize, end)] {
        image[at..at + 4].copy_from_slice(&word.to_le_bytes());
    }
    let sum = crc32(&image[..LENGTH - 4]).to_le_bytes();
    image[LENGTH - 4..].copy_from_slice(&sum);
    image
}

fn sum(image: &[u8]) -> [u8; 64] {
    let mut sum = Sha512::new();
    sum.update(image);
    sum.update(BOARD.as_bytes());
    sum.finalize()
}

/// Flash with a program, as `kband flash` writes it.
fn flashed(image: &[u8]) -> Cells {
    let mut cells = Cells::new();
    cells.bytes[place(SLOT.start, image.len())].copy_from_slice(image);
    cells
}

fn requested(cells: &Cells) -> OneSlot<Cells> {
    OneSlot::new(cells.clone(), Some(*keypair().public.as_bytes()))
}

fn ask(slot: &mut OneSlot<Cells>, request: &UpdateRequest<'_>) -> Result {
    match slot.answer(request, true) {
        UpdateAnswer::Done => Ok(()),
        UpdateAnswer::Refused(cause) => Err(cause),
        other => panic!("{request:?}: {other:?}"),
    }
}

fn signed<'a>(length: usize, sum: &'a [u8], signature: &'a [u8]) -> UpdateRequest<'a> {
    UpdateRequest::Signed {
        board: BOARD,
        length: length as u32,
        sum,
        signature,
    }
}

fn begin(slot: &mut OneSlot<Cells>, image: &[u8]) -> Result {
    let sum = sum(image);
    let signature = keypair().sign(&sum).to_bytes();
    ask(slot, &signed(image.len(), &sum, &signature))
}

fn put(slot: &mut OneSlot<Cells>, offset: u32, bytes: &[u8]) -> Result {
    ask(slot, &UpdateRequest::Bytes { offset, bytes })
}

fn send(slot: &mut OneSlot<Cells>, image: &[u8]) -> Result {
    let mut chunks = (0..).step_by(256).zip(image.chunks(256));
    chunks.try_for_each(|(offset, bytes)| put(slot, offset, bytes))
}

fn end(slot: &mut OneSlot<Cells>) -> Result {
    ask(slot, &UpdateRequest::End(&[]))
}

fn update(slot: &mut OneSlot<Cells>, image: &[u8]) -> Result {
    begin(slot, image)?;
    send(slot, image)?;
    end(slot)
}

fn holds(cells: &Cells, image: &[u8]) -> bool {
    cells.bytes[place(SLOT.start, image.len())] == *image
}

#[test]
fn a_signed_image_replaces_the_program() {
    let (old, new) = (image(0), image(1));
    let mut slot = requested(&flashed(&old));
    assert!(slot.has_program() && !slot.is_done());
    assert_eq!(begin(&mut slot, &new), Ok(()));
    assert!(!slot.has_program(), "its mark is gone");
    send(&mut slot, &new).unwrap();
    // The last request is sent twice, as after a lost answer.
    let last = LENGTH - 4;
    assert_eq!(put(&mut slot, last as u32, &new[last..]), Ok(()));
    assert!(!slot.has_program());
    for _ in 0..2 {
        assert_eq!(end(&mut slot), Ok(()));
        assert!(slot.is_done() && slot.has_program());
    }
    assert!(holds(&slot.memory, &new));
}

#[test]
fn the_old_program_stays_without_a_signed_hash_for_this_board() {
    let (old, new) = (image(0), image(1));
    let cells = flashed(&old);
    let (sum, invalid) = (sum(&new), [0; 64]);
    let signature = keypair().sign(&sum).to_bytes();
    let max_length = SLOT.len();
    let (offset, bytes) = (0, &new[..256]);
    let bytes = UpdateRequest::Bytes { offset, bytes };
    let for_another = UpdateRequest::Signed {
        board: "stm32f405rg",
        length: LENGTH as u32,
        sum: &sum,
        signature: &signature,
    };
    use UpdateRefusal::*;
    for (request, cause) in [
        (signed(LENGTH, &sum, &invalid), Signature),
        (signed(LENGTH, &invalid, &signature), Signature),
        (for_another, OtherBoard),
        (signed(LENGTH, &sum[1..], &signature), Length),
        (signed(LENGTH, &sum, &signature[1..]), Length),
        (signed(LENGTH + 2, &sum, &signature), Length),
        (signed(max_length + 4, &sum, &signature), Length),
        (signed(END as usize + 4, &sum, &signature), Length),
        (UpdateRequest::End(&signature), Order(0)),
        (bytes, Order(0)),
    ] {
        let mut slot = requested(&cells);
        assert_eq!(ask(&mut slot, &request), Err(cause), "{request:?}");
        assert!(slot.has_program() && slot.memory.used == 0);
    }
    let mut slot = requested(&cells);
    let request = signed(LENGTH, &sum, &signature);
    let low = slot.answer(&request, false);
    assert_eq!(low, UpdateAnswer::Refused(SupplyLow));
    let mut keyless = OneSlot::new(cells, None);
    assert_eq!(ask(&mut keyless, &request), Err(NoKey));
    assert_eq!(slot.memory.used + keyless.memory.used, 0);
}

#[test]
fn an_image_that_changes_on_the_line_or_is_cut_short_never_starts() {
    let (old, new) = (image(0), image(1));
    let cells = flashed(&old);
    for at in [0, 300, LENGTH - 5] {
        let mut other = new.clone();
        other[at] ^= 1;
        let mut slot = requested(&cells);
        begin(&mut slot, &new).unwrap();
        send(&mut slot, &other).unwrap();
        assert_eq!(end(&mut slot), Err(UpdateRefusal::Signature));
        assert!(!slot.has_program() && !slot.is_done());
        assert_eq!(end(&mut slot), Err(UpdateRefusal::Order(0)));
    }
    let mut slot = requested(&cells);
    begin(&mut slot, &new).unwrap();
    send(&mut slot, &new[..1024]).unwrap();
    let gap = put(&mut slot, 1280, &new[..256]);
    assert_eq!(gap, Err(UpdateRefusal::Order(1024)));
    assert_eq!(put(&mut slot, 1024, &new[..4]), Ok(()));
    let ahead = put(&mut slot, 1028, &new[..4]);
    assert_eq!(ahead, Err(UpdateRefusal::Length));
    assert_eq!(end(&mut slot), Err(UpdateRefusal::Order(1028)));
    assert!(!slot.has_program());
    assert_eq!(update(&mut slot, &new), Ok(()), "begun again");
}

#[test]
fn a_damaged_program_does_not_start() {
    let old = image(0);
    let uncut = flashed(&old);
    let starts = |change: &dyn Fn(&mut Cells)| {
        let mut cells = uncut.clone();
        change(&mut cells);
        OneSlot::new(cells, None).has_program()
    };
    let at = place(SLOT.start, 0).start;
    let put = |cells: &mut Cells, offset: u32, word: u32| {
        let place = place(SLOT.start + offset, 4);
        cells.bytes[place].copy_from_slice(&word.to_le_bytes());
        // Its checksum matches.
        let sum = crc32(&cells.bytes[at..at + LENGTH - 4]).to_le_bytes();
        cells.bytes[at + LENGTH - 4..at + LENGTH].copy_from_slice(&sum);
    };
    assert!(starts(&|_| {}));
    for bit in [0, 8 * 1000 + 3, 8 * (LENGTH - 1)] {
        assert!(!starts(&|cells| cells.bytes[at + bit / 8] ^= 1 << (bit % 8)));
    }
    assert!(!starts(&|cells| cells.torn.push(at + 1000)));
    assert!(starts(&|cells| put(cells, 0x100, 5)));
    for (offset, word) in [
        (0, 0),
        (0, RAM.end + 8),
        (4, 0x0800_0001),
        (END, SLOT.start + LENGTH as u32 - 3),
        (END, SLOT.start + END),
        (END, SLOT.end),
    ] {
        let started = starts(&|cells| put(cells, offset, word));
        assert!(!started, "{offset:#x} {word:#x}");
    }
    assert!(!OneSlot::new(Cells::new(), None).has_program());
}

#[test]
fn power_cut_anywhere_leaves_the_old_or_the_new_image_or_a_wait_for_it() {
    let (old, new) = (image(0), image(1));
    let cells = flashed(&old);
    let mut uncut = requested(&cells);
    update(&mut uncut, &new).unwrap();
    let count = uncut.memory.used;
    let (mut olds, mut news) = (0, 0);
    for cut in 1..=count {
        let mut slot = requested(&cells);
        slot.memory.power = cut;
        let ended = update(&mut slot, &new);
        assert!(ended.is_err(), "{cut} of {count}");
        // Power returns without a request from the program.
        let mut cells = slot.memory;
        cells.power = usize::MAX;
        let mut slot = OneSlot::new(cells, None);
        let has_program = slot.has_program();
        let [is_old, is_new] = [&old, &new].map(|image| has_program && holds(&slot.memory, image));
        assert_eq!(has_program, is_old || is_new);
        olds += u64::from(is_old);
        news += u64::from(is_new);
        if has_program {
            slot = requested(&slot.memory);
        }
        // A signature takes most of the time of this test.
        if cut < 16 || cut % 16 == 0 || cut == count {
            assert_eq!(update(&mut slot, &new), Ok(()), "{cut}");
            assert!(slot.has_program() && holds(&slot.memory, &new));
        }
    }
    // The key has a page and five words; the mark is the last operation.
    assert_eq!((olds, news), (6, 0));
}

#[test]
fn another_key_of_the_program_replaces_the_stored_one() {
    let (old, new) = (image(0), image(1));
    let mut slot = OneSlot::new(flashed(&old), Some([1; 32]));
    assert_eq!(begin(&mut slot, &new), Err(UpdateRefusal::Signature));
    let mut slot = requested(&slot.memory);
    begin(&mut slot, &new).unwrap();
    let stored = OneSlot::new(slot.memory.clone(), None);
    assert_eq!(stored.key, Some(*keypair().public.as_bytes()));
    let used = slot.memory.used;
    begin(&mut slot, &new).unwrap();
    let written = slot.memory.used - used;
    assert_eq!(written, 2, "the same key is not written again");
    let other = Keypair::from(&[8; 32]);
    let mut slot = OneSlot::new(slot.memory, Some(*other.public.as_bytes()));
    assert_eq!(begin(&mut slot, &new), Err(UpdateRefusal::Signature));
    let sum = sum(&new);
    let signature = other.sign(&sum).to_bytes();
    assert_eq!(ask(&mut slot, &signed(LENGTH, &sum, &signature)), Ok(()));
    let stored = OneSlot::new(slot.memory, None);
    assert_eq!(stored.key, Some(*other.public.as_bytes()));
}

#[test]
fn a_worn_word_is_found_when_it_is_written() {
    let new = image(1);
    let mut cells = flashed(&image(0));
    cells.stuck_word = Some(SLOT.start + 1056);
    assert_eq!(new[1056] & 1, 0, "its bit becomes 0");
    let mut slot = requested(&cells);
    begin(&mut slot, &new).unwrap();
    assert_eq!(send(&mut slot, &new), Err(UpdateRefusal::Store));
    assert_eq!(end(&mut slot), Err(UpdateRefusal::Order(0)));
}

#[test]
fn updates_that_are_begun_too_often_are_refused() {
    let new = image(1);
    let mut slot = requested(&flashed(&image(0)));
    for _ in 0..MAX_UPDATES_PER_START {
        assert_eq!(begin(&mut slot, &new), Ok(()));
    }
    let used = slot.memory.used;
    assert_eq!(begin(&mut slot, &new), Err(UpdateRefusal::TooOften));
    assert_eq!(slot.memory.used, used);
}

#[test]
fn loader_reports_what_it_refuses() {
    let mut slot = requested(&flashed(&image(0)));
    let state = |has_key| UpdateAnswer::State {
        board: BOARD,
        size: SLOT.end - SLOT.start,
        has_key,
        on_trial: false,
    };
    assert_eq!(slot.answer(&UpdateRequest::State, true), state(true));
    let (board, length) = (BOARD, 8);
    let begin = UpdateRequest::Begin { board, length };
    for request in [UpdateRequest::Key(&[1; 32]), begin, UpdateRequest::Confirm] {
        assert_eq!(slot.answer(&request, true), UpdateAnswer::Loader);
    }
    let mut keyless = OneSlot::new(Cells::new(), None);
    assert_eq!(keyless.answer(&UpdateRequest::State, true), state(false));
    assert_eq!(slot.memory.used, 0);
}
