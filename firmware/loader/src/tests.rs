//! Power cuts at every word of an update, of the loader's swap and of its reversal.

use super::*;
use embassy_boot::{BootLoader, BootLoaderConfig};
use std::cell::RefCell;
use std::rc::Rc;
use std::vec::Vec;

const SECTOR: usize = 64;
/// Offsets of the areas: slots of three and four sectors, and pages of the state.
const ACTIVE: u32 = 0;
const UPDATE: u32 = 3 * SECTOR as u32;
const STATE: u32 = 7 * SECTOR as u32;
const SIZE: usize = 7 * SECTOR + 16 * PAGE as usize;

/// A flash whose power fails after a number of words. The word at the cut gets half of its bits.
/// The rest of an erased sector reads as noise.
#[derive(Clone, Debug, PartialEq)]
struct Cells {
    bytes: Vec<u8>,
    power: usize,
    used: usize,
    noise: u32,
}

impl Cells {
    fn noise(&mut self) -> u8 {
        let next = self.noise.wrapping_mul(1_664_525);
        self.noise = next.wrapping_add(1_013_904_223);
        (self.noise >> 24) as u8
    }
}

#[derive(Clone)]
struct Part(Rc<RefCell<Cells>>, u32, u32);

const CUT: NorFlashErrorKind = NorFlashErrorKind::Other;

impl ErrorType for Part {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Part {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let at = (self.1 + offset) as usize;
        bytes.copy_from_slice(&self.0.borrow().bytes[at..at + bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.2 as usize
    }
}

impl NorFlash for Part {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        let cells = &mut *self.0.borrow_mut();
        for at in (self.1 + from..self.1 + to).step_by(4) {
            if cells.power == 0 {
                for at in at..self.1 + to {
                    let noise = cells.noise();
                    cells.bytes[at as usize] |= noise;
                }
                return Err(CUT);
            }
            cells.power -= 1;
            cells.used += 1;
            cells.bytes[at as usize..at as usize + 4].fill(0xff);
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let cells = &mut *self.0.borrow_mut();
        for (at, word) in (self.1 + offset..).step_by(4).zip(bytes.chunks(4)) {
            let cut = cells.power == 0;
            for (n, new) in word.iter().enumerate() {
                let unerased = if cut { cells.noise() } else { 0 };
                cells.bytes[at as usize + n] &= new | unerased;
            }
            if cut {
                return Err(CUT);
            }
            cells.power -= 1;
            cells.used += 1;
        }
        Ok(())
    }
}

/// A chip with an old image in its active slot, and a new one in the other.
#[derive(Clone)]
struct Chip(Cells);

const OLD: [u8; 3 * SECTOR] = [0x11; 3 * SECTOR];
const NEW: [u8; 3 * SECTOR] = [0x22; 3 * SECTOR];

impl Chip {
    fn new(pages_used: usize) -> Self {
        let mut bytes = std::vec![0xff; SIZE];
        bytes[..3 * SECTOR].copy_from_slice(&OLD);
        bytes[3 * SECTOR..6 * SECTOR].copy_from_slice(&NEW);
        for page in 0..pages_used {
            bytes[STATE as usize + page * 64 + 60..][..4].fill(0);
        }
        Self(Cells {
            bytes,
            power: usize::MAX,
            used: 0,
            noise: 1,
        })
    }

    /// Runs `work` with a power that fails after `words` words; returns whether it finished.
    fn with(&mut self, words: usize, work: fn(&Rc<RefCell<Cells>>) -> bool) -> bool {
        let mut cells = self.0.clone();
        (cells.power, cells.used) = (words, 0);
        cells.noise = (cells.noise).wrapping_add((words as u32).wrapping_mul(2_654_435_761));
        let shared = Rc::new(RefCell::new(cells));
        let ended = work(&shared);
        self.0 = shared.borrow().clone();
        ended
    }

    /// Whether the active slot has the new image; `None` for a mixed one.
    fn image(&self) -> Option<bool> {
        let images = [OLD, NEW].map(|image| self.0.bytes.starts_with(&image));
        (images != [false; 2]).then_some(images[1])
    }
}

fn state(cells: &Rc<RefCell<Cells>>) -> StatePages<Part> {
    let part = Part(cells.clone(), STATE, 16 * PAGE);
    StatePages::new(part, 0..16 * PAGE)
}

const MARK: fn(&Rc<RefCell<Cells>>) -> bool = |cells| state(cells).mark();
const CONFIRM: fn(&Rc<RefCell<Cells>>) -> bool = |cells| state(cells).confirm();

fn load(cells: &Rc<RefCell<Cells>>) -> bool {
    let mut loader = BootLoader::new(BootLoaderConfig {
        active: Part(cells.clone(), ACTIVE, 3 * SECTOR as u32),
        dfu: Part(cells.clone(), UPDATE, 4 * SECTOR as u32),
        state: state(cells),
    });
    loader.prepare_boot(&mut [0; 16]).is_ok()
}

fn is_on_trial(chip: &Chip) -> bool {
    let on_trial = |cells: &Rc<RefCell<Cells>>| state(cells).is_swap_due();
    chip.clone().with(usize::MAX, on_trial)
}

#[test]
fn a_cut_of_the_mark_leaves_the_old_image_or_swaps() {
    for pages in 0..12 {
        let (mut old, mut new) = (0, 0);
        for words in 0..8 {
            let mut chip = Chip::new(pages);
            chip.with(words, MARK);
            assert!(chip.with(usize::MAX, load));
            let is_new = chip.image().expect("a whole image");
            new += u32::from(is_new);
            old += u32::from(!is_new);
        }
        assert!(old > 0 && new > 0);
    }
}

#[test]
fn a_swap_cut_at_every_word_ends_in_the_new_image_and_a_return_in_the_old_one() {
    for swaps in [true, false] {
        let mut chip = Chip::new(0);
        assert!(chip.with(usize::MAX, MARK) && (swaps || chip.with(usize::MAX, load)));
        let mut uncut = chip.clone();
        assert!(uncut.with(usize::MAX, load));
        assert_eq!(uncut.image(), Some(swaps));
        let cuts = (0..uncut.0.used).flat_map(|cut| [0, 1, 17, cut].map(|second| (cut, second)));
        for (cut, second) in cuts {
            let mut chip = chip.clone();
            assert!(!chip.with(cut, load), "{cut}");
            // The power of the next start fails too.
            chip.with(second, load);
            assert!(chip.with(usize::MAX, load));
            // A power cut after the last step starts the new image, which was not confirmed.
            let image = chip.image();
            assert!(image.is_some(), "{cut}, {second}: a mixed image");
            assert!(swaps || image == Some(false), "{cut}, {second}");
            if image == Some(true) {
                assert!(is_on_trial(&chip));
                assert!(chip.with(usize::MAX, CONFIRM));
                assert!(chip.with(usize::MAX, load));
                assert_eq!(chip.image(), Some(true));
            }
            assert!(!is_on_trial(&chip), "{cut}, {second}");
        }
    }
}

#[test]
fn a_confirmation_cut_at_every_word_is_one_or_none() {
    for cut in 0..8 {
        let mut chip = Chip::new(0);
        assert!(chip.with(usize::MAX, MARK) && chip.with(usize::MAX, load));
        chip.with(cut, CONFIRM);
        assert!(chip.with(usize::MAX, load));
        assert!(chip.image().is_some(), "{cut}: a mixed image");
        assert!(!is_on_trial(&chip), "{cut}");
    }
}

#[test]
fn updates_are_refused_before_the_pages_are_full() {
    let mut chip = Chip::new(0);
    let has_room = |cells: &Rc<RefCell<Cells>>| state(cells).have_room();
    let mut updates = 0;
    while chip.with(usize::MAX, has_room) {
        assert!(chip.with(usize::MAX, MARK));
        assert!(chip.with(usize::MAX, load) && chip.with(usize::MAX, load));
        assert_eq!(chip.image(), Some(false));
        updates += 1;
    }
    assert!((4..10).contains(&updates), "{updates}");
}

#[test]
fn full_pages_are_an_ordinary_start_and_take_no_mark() {
    let mut chip = Chip::new(16);
    assert!(!is_on_trial(&chip));
    assert!(!chip.with(usize::MAX, MARK));
}
