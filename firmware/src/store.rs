//! Non-volatile memory: the settings with the target, and the last faults.
//!
//! Settings and target are one record of a [`Journal`], so that a loss of power cannot tear them
//! apart. A damaged record is never replaced by an older one or by the defaults: neither fits the
//! machine. The drive stays off until settings are saved.
//!
//! A record names each setting by a hash of its key. A key that the record lacks gets its default:
//! the default of a key that is added must not change what the drive does. A key that this firmware
//! does not know is of a newer one: the record stays as it is, and the drive stays off.
//!
//! | bytes | content of a settings record |
//! |---|---|
//! | 4 | its version |
//! | 8 | kind and number of the target |
//! | 16 | ratio and phase of the target's upper tones |
//! | 4 | the PIN, 0 for none |
//! | 4 | number of settings |
//! | 6 each | hash of a key, and its value |

use core::borrow::BorrowMut;
use core::future::Future;

use embedded_storage_async::nor_flash::NorFlash;
use kband_control::wire::{KeptFault, Pin};
use kband_control::{Settings, Shape, Target, UpperTone};

pub use crate::journal::StoreFailed;
use crate::journal::{Journal, Newest, OVERHEAD};
use crate::waiting::{RECORD_SIZE, Waiting};

/// Version of a record's format and meaning; raised when a setting keeps its name and changes its
/// meaning.
const VERSION: u32 = 4;
/// Largest version that a newer firmware may write.
const LAST_VERSION: u32 = 0xffff;
/// Size of a slot for settings and target, bytes. Two pages of 2 KiB hold 60 000 saves in 10 000
/// erasures.
const SLOT: usize = 512;
/// Size of the content of a settings record, bytes.
const CONTENT: usize = SLOT - OVERHEAD;
/// Size of a record's content before the settings, bytes.
const HEAD: usize = 36;
/// Size of a setting in a record, bytes.
const PAIR: usize = 6;
/// Number of settings.
const COUNT: usize = Settings::KEYS.len();
/// Number of further settings for which a record has room.
const SPARE: usize = 16;
/// Size of a slot for a fault, bytes. The smallest page holds 50 of them and its mark.
const FAULT_SLOT: usize = 40;
/// Number of faults that are kept.
pub const KEPT_FAULTS: u32 = 32;
/// Size of the content of a fault record, bytes.
const FAULT_CONTENT: usize = FAULT_SLOT - OVERHEAD;
const _: () = assert!(FAULT_CONTENT == RECORD_SIZE);

const _: () = assert!(HEAD + PAIR * (COUNT + SPARE) <= CONTENT && COUNT <= u64::BITS as usize);

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

    /// Saves settings, target and PIN.
    ///
    /// A loss of power leaves the previous record or the new one.
    fn save(
        &mut self,
        settings: &Settings,
        target: Target,
        pin: Option<Pin>,
    ) -> impl Future<Output = Result<(), StoreFailed>>;

    /// Whether the supply is good enough to program the flash.
    fn supply_is_good(&self) -> bool;

    /// Queues a fault for [`Store::keep_faults`]. The queue survives a reset.
    fn take_fault(&mut self, fault: &KeptFault);

    /// Stores the queued faults once the supply is good; the last [`KEPT_FAULTS`] are kept. Call it only
    /// while the drive is at rest.
    fn keep_faults(&mut self) -> impl Future<Output = ()>;

    /// Loads the fault that is `back` faults older than the newest.
    fn fault(&mut self, back: u32) -> impl Future<Output = Option<KeptFault>>;
}

/// Memory in four pages of a NOR flash: two for the settings, two for the faults.
pub struct Records<F, W> {
    flash: F,
    settings: Journal<SLOT>,
    faults: Journal<FAULT_SLOT>,
    waiting: W,
    supply_settled: fn() -> bool,
}

impl<F: NorFlash, W: BorrowMut<Waiting>> Records<F, W> {
    /// Opens the memory in these pages of the flash. Faults wait in `waiting` until
    /// `supply_settled` returns true.
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
            settings: Journal::new(&flash, settings, 1)?.converting::<{ version_3::SLOT }>(),
            faults: Journal::new(&flash, faults, KEPT_FAULTS)?,
            flash,
            waiting,
            supply_settled,
        })
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
        match self.settings.newest(&mut self.flash, &mut content).await {
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
        let content = encode_settings(settings, target, pin);
        if self.settings.holds(&mut self.flash, &content).await {
            return Ok(());
        }
        if !self.supply_is_good() {
            return Err(StoreFailed::SupplyLow);
        }
        let kept = self.settings.append(&mut self.flash, &content).await;
        kept.map_err(|why| self.failed(why))
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

/// Hash of a setting's key: FNV-1a of 32 bits, folded to 16.
const fn hash(key: &str) -> u16 {
    let name = key.as_bytes();
    let mut sum = 0x811c_9dc5_u32;
    let mut at = 0;
    while at < name.len() {
        sum = (sum ^ name[at] as u32).wrapping_mul(0x0100_0193);
        at += 1;
    }
    (sum >> 16 ^ sum) as u16
}

/// Hashes of the keys, in the order of [`Settings::KEYS`].
const HASHES: [u16; COUNT] = {
    let mut hashes = [0; COUNT];
    let mut key = 0;
    while key < COUNT {
        hashes[key] = hash(Settings::KEYS[key].name);
        key += 1;
    }
    hashes
};

/// Reads a record in words of four bytes, little endian.
struct Words<'a>(&'a [u8]);

impl Words<'_> {
    fn next(&mut self) -> Option<u32> {
        let (word, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(u32::from_le_bytes(*word))
    }

    fn number(&mut self) -> Option<f32> {
        self.next().map(f32::from_bits)
    }
}

fn put(content: &mut [u8], words: impl IntoIterator<Item = u32>) {
    for (room, word) in content.chunks_exact_mut(4).zip(words) {
        room.copy_from_slice(&word.to_le_bytes());
    }
}

fn encode_settings(settings: &Settings, target: Target, pin: Option<Pin>) -> [u8; CONTENT] {
    let mut content = [0; CONTENT];
    let (head, pairs) = content.split_at_mut(HEAD);
    let words = [VERSION]
        .into_iter()
        .chain(target_words(target))
        .chain([pin.map_or(0, Pin::number), COUNT as u32]);
    put(head, words);
    let (pairs, _) = pairs.as_chunks_mut::<PAIR>();
    for ((pair, hash), value) in pairs.iter_mut().zip(HASHES).zip(settings.values()) {
        let [low, high] = hash.to_le_bytes();
        let [a, b, c, d] = value.to_le_bytes();
        *pair = [low, high, a, b, c, d];
    }
    content
}

/// Kind, number and upper tones of a target.
fn target_words(target: Target) -> impl Iterator<Item = u32> {
    let mut tones = Shape::SINE;
    let (kind, number) = match target {
        Target::Locked { order } => (0, u32::from(order)),
        Target::Chaotic => (1, 0),
        Target::K(k) => (2, k.to_bits()),
        Target::Amplitude(amplitude) => (3, amplitude.to_bits()),
        Target::Speed(speed) => (4, speed.to_bits()),
        Target::Identify => (5, 0),
        Target::Flow(flow) => (8, flow.to_bits()),
        Target::Gear { order } => (6, u32::from(order)),
        Target::Tones { k, shape } => {
            tones = shape;
            (7, k.to_bits())
        }
    };
    let tones = tones.tones();
    let tones = tones.map(|tone| [tone.ratio.to_bits(), tone.phase.to_bits()]);
    [kind, number]
        .into_iter()
        .chain(tones.into_iter().flatten())
}

impl Words<'_> {
    /// The target; `None` where this firmware has none of its kind.
    fn target(&mut self) -> Option<Target> {
        let (kind, number) = (self.next()?, self.next()?);
        let mut tone = || Some(UpperTone::new(self.number()?, self.number()?));
        let shape = Shape::new(tone()?, tone()?);
        Some(match kind {
            0 => Target::Locked {
                order: u8::try_from(number).ok()?,
            },
            1 => Target::Chaotic,
            2 => Target::K(f32::from_bits(number)),
            3 => Target::Amplitude(f32::from_bits(number)),
            4 => Target::Speed(f32::from_bits(number)),
            5 => Target::Identify,
            8 => Target::Flow(f32::from_bits(number)),
            6 => Target::Gear {
                order: u8::try_from(number).ok()?,
            },
            7 => Target::Tones {
                k: f32::from_bits(number),
                shape,
            },
            _ => return None,
        })
    }

    /// The PIN, where one is set; the outer `None` for a number that is no PIN.
    fn pin(&mut self) -> Option<Option<Pin>> {
        match self.next()? {
            0 => Some(None),
            number => Pin::from_number(number).map(Some),
        }
    }
}

/// Decodes a record.
///
/// # Errors
/// The record is of a newer firmware, or its settings are not accepted.
fn decode_settings(content: &[u8]) -> Result<Found, Condition> {
    let mut words = Words(content);
    let found = match words.next() {
        Some(VERSION) => decode_pairs(words)?,
        Some(version_3::SCHEMA) => version_3::decode(words).ok_or(Condition::Lost)?,
        Some(newer) if (VERSION..=LAST_VERSION).contains(&newer) => return Err(Condition::Newer),
        _ => return Err(Condition::Lost),
    };
    found.settings.check().map_err(|_| Condition::Lost)?;
    Ok(found)
}

/// Decodes a record behind its version.
fn decode_pairs(mut words: Words<'_>) -> Result<Found, Condition> {
    let target = words.target().ok_or(Condition::Newer)?;
    let pin = words.pin().ok_or(Condition::Lost)?;
    let count = words.next().ok_or(Condition::Lost)? as usize;
    let (pairs, _) = words.0.as_chunks::<PAIR>();
    let mut settings = Settings::default();
    let mut added = u64::MAX >> (u64::BITS as usize - COUNT);
    for [low, high, value @ ..] in pairs.get(..count).ok_or(Condition::Lost)? {
        let hash = u16::from_le_bytes([*low, *high]);
        let known = HASHES.iter().zip(Settings::KEYS).enumerate();
        let mut known = known.filter(|(_, (known, _))| **known == hash);
        let (number, (_, key)) = known.next().ok_or(Condition::Newer)?;
        let set = settings.set(key.name, f32::from_le_bytes(*value));
        set.map_err(|_| Condition::Lost)?;
        added &= !(1 << number);
    }
    Ok(Found {
        settings,
        target,
        pin,
        condition: Condition::Whole,
        added,
    })
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

mod version_3;

#[cfg(test)]
pub(crate) mod tests;
