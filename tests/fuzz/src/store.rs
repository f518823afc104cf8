//! Memory of the settings, with arbitrary content and power failures at any time.

use crate::Reader;
use embassy_futures::block_on;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use kband_control::wire::FaultRecord;
use kband_control::{Settings, Target};
use kband_firmware::storage::store::{Condition, Records};
use kband_firmware::storage::waiting::Waiting;
use std::cell::RefCell;
use std::rc::Rc;

/// Bytes of the smallest flash page of a board.
pub const PAGE: usize = 2048;

struct Cells {
    bytes: Vec<u8>,
    power: usize,
}

/// NOR flash of four pages that programs only erased words, until its power fails.
///
/// Clones share the same flash.
#[derive(Clone)]
pub struct Flash(Rc<RefCell<Cells>>);

/// A power failure, or programming of a word that was not erased.
const FAILED: NorFlashErrorKind = NorFlashErrorKind::Other;

impl Default for Flash {
    fn default() -> Self {
        Self(Rc::new(RefCell::new(Cells {
            bytes: vec![0xff; 4 * PAGE],
            power: usize::MAX,
        })))
    }
}

impl Flash {
    fn touch(&self) -> Result<(), NorFlashErrorKind> {
        let power = &mut self.0.borrow_mut().power;
        *power = power.checked_sub(1).ok_or(FAILED)?;
        Ok(())
    }

    /// Sets the number of words until the power fails.
    pub fn power(&self, words: usize) {
        self.0.borrow_mut().power = words;
    }

    /// Memory of settings and faults in this flash.
    pub fn records(&self) -> Records<Self, Waiting> {
        let page = PAGE as u32;
        let (settings, faults) = (0..2 * page, 2 * page..4 * page);
        Records::new(self.clone(), settings, faults, Waiting::EMPTY, || true)
            .expect("two pages each")
    }
}

impl ErrorType for Flash {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let at = offset as usize;
        bytes.copy_from_slice(&self.0.borrow().bytes[at..at + bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.borrow().bytes.len()
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        for at in (from as usize..to as usize).step_by(4) {
            self.touch()?;
            self.0.borrow_mut().bytes[at..at + 4].fill(0xff);
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        for (at, word) in (offset as usize..).step_by(4).zip(bytes.chunks_exact(4)) {
            self.touch()?;
            for (old, new) in self.0.borrow_mut().bytes[at..].iter_mut().zip(word) {
                if *old != 0xff && *new != 0 {
                    return Err(FAILED);
                }
                *old &= new;
            }
        }
        Ok(())
    }
}

/// Valid settings and a target, different for each number.
fn some(number: u8) -> (Settings, Target) {
    let settings = Settings {
        amplitude_limit: 0.1 + f32::from(number) * 0.01,
        ..Settings::default()
    };
    (settings, Target::Amplitude(f32::from(number) * 1e-3))
}

/// A sequence of operations on a memory.
pub fn store(input: &[u8]) -> bool {
    let flash = Flash::default();
    let mut records = flash.records();
    let mut input = Reader(input);
    // Whether only kband has written to the memory so far.
    let mut sound = true;
    let mut whole = false;
    while let Some(what) = input.byte() {
        let number = input.byte().unwrap_or(0);
        match what % 5 {
            // Arbitrary content, for example after a change of firmware.
            0 => {
                let at = usize::from(input.half().unwrap_or(0)) % (4 * PAGE);
                let piece = input.piece().unwrap_or(&[]);
                let length = piece.len().min(4 * PAGE - at);
                flash.0.borrow_mut().bytes[at..at + length].copy_from_slice(&piece[..length]);
                records = flash.records();
                sound = false;
            }
            1 => {
                let (settings, target) = some(number);
                let saved = block_on(records.save(&settings, target, None));
                assert!(saved.is_ok() || !sound, "a sound memory keeps");
                if saved.is_ok() {
                    for mut records in [flash.records(), records] {
                        let state = block_on(records.load());
                        assert_eq!(state.condition, Condition::Whole);
                        assert_eq!((state.settings, state.target), (settings, target));
                    }
                }
                records = flash.records();
            }
            2 => {
                let fault = FaultRecord {
                    fault: number,
                    seconds: 7 * u32::from(number),
                    ..FaultRecord::default()
                };
                records.take_fault(&fault);
                block_on(records.keep_faults());
                if sound {
                    let newest = block_on(records.fault(0)).expect("it was kept");
                    assert_eq!((newest.fault, newest.seconds), (fault.fault, fault.seconds));
                }
            }
            // The power fails.
            3 => {
                let before = block_on(records.load());
                flash.power(usize::from(input.half().unwrap_or(0)) % 700);
                let (settings, target) = some(number);
                let saved = block_on(records.save(&settings, target, None));
                flash.power(usize::MAX);
                records = flash.records();
                let after = block_on(records.load());
                let new = (after.settings, after.target) == (settings, target);
                if sound {
                    assert!(after == before || new, "{before:?} {after:?}");
                }
                assert!(saved.is_err() || new, "what is said to be kept is kept");
            }
            _ => {
                records = flash.records();
                for back in [0, 1, 31, u32::from(number) << 24] {
                    let _ = block_on(records.fault(back));
                }
            }
        }
        let state = block_on(records.load());
        state.settings.check().expect("what is found is accepted");
        whole |= state.condition == Condition::Whole;
    }
    whole
}
