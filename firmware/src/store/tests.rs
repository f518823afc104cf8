//! Tests of the memory under power cuts, with the boards' page sizes.

use super::encoding::{COUNT, HASHES, PAIR, hash};
use super::record::{HEAD, KEY_HASHES, SIZE};
use super::*;
use embassy_futures::block_on;
use embedded_storage_async::nor_flash::{
    ErrorType, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use kband::arithmetic::Noise;
use kband_control::{Recipe, RecipeName, Shape, UpperTone};
use std::vec::Vec;

/// Page size of the STM32G474, bytes.
const SMALL: usize = 2 * 1024;
/// Page size of the STM32F405, bytes.
const LARGE: usize = 16 * 1024;
/// Number of four-byte words in a record; an erasure clears a page word by word.
const WORDS: usize = SLOT / 4;

/// NOR flash of four pages whose power fails after a number of words. Writing clears bits; erasing
/// sets the bits of a page.
#[derive(Clone)]
pub struct Nor<const PAGE: usize> {
    pub bytes: Vec<u8>,
    /// Number of words until the power fails.
    power: usize,
    touched: usize,
    pub erasures: [u32; 4],
    /// Pages whose last erasure was cut short: programming them fails.
    pub weak: [bool; 4],
    /// Whether erasures fail before they begin.
    pub refuses_erasures: bool,
    /// Index of a byte that stays erased.
    worn: Option<usize>,
}

#[derive(Debug)]
pub struct PowerCut;

impl NorFlashError for PowerCut {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl<const PAGE: usize> Nor<PAGE> {
    pub fn new() -> Self {
        Self {
            bytes: std::vec![0xff; 4 * PAGE],
            power: usize::MAX,
            touched: 0,
            erasures: [0; 4],
            weak: [false; 4],
            refuses_erasures: false,
            worn: None,
        }
    }

    fn powered(&self, words: usize) -> Self {
        Self {
            power: words,
            touched: 0,
            ..self.clone()
        }
    }

    fn touch(&mut self) -> Result<(), PowerCut> {
        if self.touched == self.power {
            return Err(PowerCut);
        }
        self.touched += 1;
        Ok(())
    }
}

impl<const PAGE: usize> ErrorType for Nor<PAGE> {
    type Error = PowerCut;
}

impl<const PAGE: usize> ReadNorFlash for Nor<PAGE> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), PowerCut> {
        let at = offset as usize;
        bytes.copy_from_slice(&self.bytes[at..at + bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl<const PAGE: usize> NorFlash for Nor<PAGE> {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), PowerCut> {
        if self.refuses_erasures {
            return Err(PowerCut);
        }
        let page = from as usize / PAGE;
        self.erasures[page] += 1;
        self.weak[page] = true;
        for at in (from as usize..to as usize).step_by(4) {
            if let Err(cut) = self.touch() {
                // A half erased page reads as random bytes.
                let mut noise = Noise::new(at as u64 + 1);
                for byte in &mut self.bytes[at..(at + 3 * SLOT).min(to as usize)] {
                    *byte = noise.bits() as u8;
                }
                return Err(cut);
            }
            self.bytes[at..at + 4].fill(0xff);
        }
        // At the end of an erasure all bytes read as erased already.
        self.touch()?;
        self.weak[page] = false;
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), PowerCut> {
        assert!(offset.is_multiple_of(8) && bytes.len().is_multiple_of(8));
        assert!(
            !self.weak[offset as usize / PAGE],
            "its erasure did not end"
        );
        for (at, word) in (offset as usize..).step_by(4).zip(bytes.chunks_exact(4)) {
            self.touch()?;
            for (old, new) in self.bytes[at..].iter_mut().zip(word) {
                // Flash with error correction programs each word once; zeros always.
                assert!(*old == 0xff || *new == 0);
                *old &= new;
            }
            if let Some(worn) = self.worn.filter(|worn| (at..at + 4).contains(worn)) {
                self.bytes[worn] = 0xff;
            }
        }
        Ok(())
    }
}

fn records<const PAGE: usize>(nor: Nor<PAGE>) -> Records<Nor<PAGE>, Waiting> {
    let page = PAGE as u32;
    let (settings, faults) = (0..2 * page, 2 * page..4 * page);
    Records::new(nor, settings, faults, Waiting::EMPTY, || true).unwrap()
}

/// Settings that differ from the defaults in every key that `change` may halve, and from each
/// other.
fn changed(factor: f32) -> Settings {
    let mut settings = Settings::default();
    for known in Settings::KEYS {
        let value = settings.get(known.name).unwrap();
        // Some are at the end of their range or whole numbers, and the two bounds must keep their
        // order.
        if !known.name.starts_with("bus") || known.name == "bus_timeout" {
            let _ = settings.set(known.name, value * factor);
        }
    }
    settings.check().unwrap();
    settings
}

const TARGETS: [Target; 9] = [
    Target::Locked { order: 3 },
    Target::Chaotic,
    Target::K(0.41),
    Target::Amplitude(0.0),
    Target::Speed(-12.5),
    Target::Tones {
        k: 0.35,
        shape: Shape::new(UpperTone::new(0.15, 2.356), UpperTone::new(0.05, -1.0)),
    },
    Target::Identify,
    Target::Gear { order: 2 },
    Target::PartsPerMinute(120.0),
];

#[test]
fn settings_and_target_load_as_saved() {
    let mut store = records(Nor::<SMALL>::new());
    let found = block_on(store.load());
    assert_eq!(found, Found::default());
    assert_eq!(found.condition, Condition::Never);
    for (n, target) in TARGETS.into_iter().enumerate() {
        let settings = changed(0.9 + 0.01 * n as f32);
        let pin = Pin::parse("0420").filter(|_| n % 2 == 0);
        block_on(store.save(&settings, target, pin)).unwrap();
        store = records(store.flash);
        let wanted = Found {
            settings,
            target,
            pin,
            condition: Condition::Whole,
        };
        assert_eq!(block_on(store.load()), wanted);
    }
}

#[test]
fn a_byte_that_cannot_be_written_is_an_error() {
    let mut store = records(Nor::<SMALL>::new());
    block_on(store.save(&changed(1.0), TARGETS[0], None)).unwrap();
    // A byte in the settings of the second record.
    store.flash.worn = Some(32 + SLOT + 20);
    assert_eq!(
        block_on(store.save(&changed(0.9), TARGETS[0], None)),
        Err(StoreFailed::Memory)
    );
    let found = block_on(records(store.flash.clone()).load());
    assert_ne!(found.settings, changed(0.9));
}

#[test]
fn saving_the_same_again_writes_nothing() {
    let mut store = records(Nor::<SMALL>::new());
    block_on(store.save(&changed(0.95), Target::Chaotic, None)).unwrap();
    let mut store = records(store.flash.powered(0));
    block_on(store.save(&changed(0.95), Target::Chaotic, None)).unwrap();
    assert!(block_on(store.save(&changed(0.95), Target::K(0.5), None)).is_err());
}

/// Cuts a save after every word, with `before` saves in the memory. The memory then holds the
/// previous or the new settings, or reports them as lost. The next save succeeds. Returns the
/// number of losses.
fn cuts<const PAGE: usize>(before: u32, words: impl Iterator<Item = usize>) -> u32 {
    let mut store = records(Nor::<PAGE>::new());
    let (mut old, mut lost, mut whole) = (Found::default(), 0, false);
    for n in 0..before {
        let settings = changed(0.9 + 0.001 * (n % 50) as f32);
        block_on(store.save(&settings, Target::K(0.4), None)).unwrap();
        old = block_on(store.load());
    }
    let base = store.flash;
    let new = Found {
        settings: changed(0.99),
        target: Target::Locked { order: 2 },
        pin: None,
        condition: Condition::Whole,
    };
    for power in words {
        let mut cut = records(base.powered(power));
        let saved = block_on(cut.save(&new.settings, new.target, None)).is_ok();
        let mut again = records(cut.flash.powered(usize::MAX));
        let found = block_on(again.load());
        if found.condition == Condition::Lost {
            assert_eq!(found, Found::none(Condition::Lost));
            lost += 1;
        } else {
            assert!(found == old || found == new, "{before}, {power}: {found:?}");
        }
        assert!(!saved || found == new, "{before}, {power}: told to be kept");
        whole |= saved;
        // A second cut, in the middle of an erasure or of a record.
        for power in [PAGE / 8, WORDS / 2, power] {
            let mut cut = records(again.flash.powered(power));
            let _ = block_on(cut.save(&new.settings, new.target, None));
            let last = block_on(records(cut.flash.powered(usize::MAX)).load());
            // Where nothing was ever saved, the remains of an erasure count as damaged settings.
            let none = before == 0 && last == Found::none(Condition::Lost);
            assert!(
                last == found || last == new || none,
                "{before}, {power}: {last:?}"
            );
        }
        block_on(again.save(&new.settings, new.target, None)).unwrap();
        assert_eq!(block_on(records(again.flash).load()), new);
    }
    assert!(whole, "the last one was not cut");
    lost
}

#[test]
fn a_cut_after_any_word_leaves_old_or_new() {
    for before in 0..20 {
        let page = SMALL / 4;
        // The save has an erasure before, after, or none.
        assert_eq!(cuts::<SMALL>(before, 0..=2 * page + WORDS), 0, "{before}");
    }
    // The sector is full: the next record begins the other one, and the full one is erased after
    // it.
    for before in [1, 15, 16, 17] {
        let erasure = (WORDS..LARGE / 4).step_by(97);
        let all = (0..=WORDS).chain(erasure).chain([2 * LARGE]);
        assert_eq!(cuts::<LARGE>(before, all), 0, "{before}");
    }
}

/// What a record with this content is loaded as.
fn loaded(content: &[u8; CONTENT]) -> Found {
    let mut store = records(Nor::<SMALL>::new());
    block_on(store.settings.append(&mut store.flash, content)).unwrap();
    let before = store.flash.bytes.clone();
    let found = block_on(store.load());
    assert_eq!(store.flash.bytes, before, "a start writes nothing");
    found
}

/// A record of the defaults, changed.
fn record(change: impl FnOnce(&mut [u8; CONTENT])) -> [u8; CONTENT] {
    let mut content = [0; CONTENT];
    encode_settings(
        &mut content,
        &Settings::default(),
        Target::Chaotic,
        None,
        None,
    );
    change(&mut content);
    content
}

/// Offset of a setting in the content of a record, bytes.
fn place(name: &str) -> usize {
    let known = Settings::KEYS.iter().position(|key| key.name == name);
    HEAD + PAIR * known.unwrap()
}

#[test]
fn invalid_settings_are_reported_as_lost() {
    let word = |at: usize, value: u32| {
        loaded(&record(|content| {
            content[at..][..4].copy_from_slice(&value.to_le_bytes());
        }))
    };
    let frequency = place("frequency") + 2;
    for (at, value) in [
        // Older versions, a PIN of no digits, more settings than there is room.
        (0, 0xda9f_6037),
        (0, 3),
        (28, 7),
        (32, 62),
        (32, u32::MAX),
        (frequency, f32::NAN.to_bits()),
        (frequency, 1e6_f32.to_bits()),
        // Each value is in its range, but the combination is not.
        (place("restitution_low") + 2, 0.9_f32.to_bits()),
    ] {
        assert_eq!(word(at, value), Found::none(Condition::Lost), "{at}");
    }
    let whole = word(frequency, 60_f32.to_bits());
    assert_eq!(whole.settings.frequency, 60.0);
    assert_eq!(whole.condition, Condition::Whole);
}

#[test]
fn the_hashes_of_all_keys_differ() {
    let mut hashes = [&HASHES[..], &KEY_HASHES].concat();
    hashes.sort_unstable();
    hashes.dedup();
    assert_eq!(hashes.len(), COUNT + KEY_HASHES.len());
    // Check value of FNV-1a in 32 bits: "a" is 0xe40c292c.
    assert_eq!(hash("a"), 0xe40c ^ 0x292c);
}

#[test]
fn a_key_that_the_record_lacks_gets_its_default() {
    let settings = changed(0.9);
    for (number, key) in Settings::KEYS.iter().enumerate() {
        let mut content = [0; CONTENT];
        let pin = Pin::parse("1234");
        encode_settings(&mut content, &settings, Target::K(0.4), pin, None);
        // The last setting takes the place of this one.
        let last = HEAD + PAIR * (COUNT - 1);
        content.copy_within(last..last + PAIR, HEAD + PAIR * number);
        content[HEAD - 4] -= 1;
        let mut wanted = settings;
        wanted.set(key.name, key.default).unwrap();
        let condition = match wanted.check() {
            Ok(()) => Condition::Whole,
            Err(_) => Condition::Lost,
        };
        let found = loaded(&content);
        assert_eq!(found.condition, condition, "{}", key.name);
        if condition == Condition::Whole {
            assert_eq!(found.settings, wanted);
            assert_eq!(
                (found.target, found.pin),
                (Target::K(0.4), Pin::parse("1234"))
            );
        }
    }
}

#[test]
fn a_record_of_a_newer_firmware_stays_as_it_is() {
    let unknown = record(|content| {
        let at = HEAD + PAIR * COUNT;
        content[at..][..2].copy_from_slice(&hash("colour").to_le_bytes());
        content[HEAD - 4] += 1;
    });
    let mut version = record(|content| content[0] += 1);
    version[SIZE..].fill(7);
    let target = record(|content| content[4] = 10);
    for content in [unknown, version, target] {
        assert_eq!(loaded(&content), Found::none(Condition::Newer));
    }
    // It is replaced only by a save, which keeps the public key.
    let key = [9; 32];
    let mut keyed = [0; CONTENT];
    encode_settings(
        &mut keyed,
        &Settings::default(),
        Target::Chaotic,
        None,
        Some(key),
    );
    version[HEAD - 4..SIZE].copy_from_slice(&keyed[HEAD - 4..SIZE]);
    let mut store = records(Nor::<SMALL>::new());
    block_on(store.settings.append(&mut store.flash, &version)).unwrap();
    let mut store = records(store.flash);
    assert_eq!(block_on(store.key()), Some(key));
    block_on(store.save(&changed(0.9), Target::Chaotic, None)).unwrap();
    let mut store = records(store.flash);
    let found = block_on(store.load());
    assert_eq!(
        (found.settings, found.condition),
        (changed(0.9), Condition::Whole)
    );
    assert_eq!(block_on(store.key()), Some(key));
    assert_eq!(block_on(store.recipes()), Recipes::default());
}

/// Recipes that differ for each number.
fn some_recipes(number: u8) -> Recipes {
    let mut recipes = Recipes::default();
    for place in 1..=Recipe::COUNT {
        let settings = Settings {
            scatter: 0.001 * f32::from(number),
            ..Settings::default()
        };
        let recipe = Recipe::of(Target::K(0.1 * f32::from(place)), &settings);
        recipes.set(place, Some(&(RecipeName::parse("parts").unwrap(), recipe)));
    }
    recipes
}

#[test]
fn settings_recipes_and_key_are_saved_without_each_other() {
    let mut store = records(Nor::<SMALL>::new());
    assert_eq!(block_on(store.recipes()), Recipes::default());
    let none = block_on(store.save_recipes(&some_recipes(1)));
    assert_eq!(none, Err(StoreFailed::NoSettings));
    let none = block_on(store.save_key(&[1; 32]));
    assert_eq!(none, Err(StoreFailed::NoSettings));
    assert_eq!(block_on(store.key()), None);
    // Among them the bits of a signalling NaN.
    let key = |n: u8| core::array::from_fn(|at| if at < 4 { [1, 0, 0xa0, 0x7f][at] } else { n });
    for n in 1..9 {
        let pin = Pin::parse("0420").filter(|_| n % 2 == 0);
        let settings = changed(0.9 + 0.01 * f32::from(n));
        block_on(store.save(&settings, Target::Chaotic, pin)).unwrap();
        assert_eq!(
            block_on(store.recipes()),
            if n > 1 {
                some_recipes(n - 1)
            } else {
                Recipes::default()
            }
        );
        block_on(store.save_recipes(&some_recipes(n))).unwrap();
        assert_eq!(block_on(store.key()), (n > 1).then(|| key(n - 1)));
        block_on(store.save_key(&key(n))).unwrap();
        store = records(store.flash);
        assert_eq!(block_on(store.key()), Some(key(n)));
        let found = block_on(store.load());
        assert_eq!((found.settings, found.pin), (settings, pin));
        assert_eq!(found.condition, Condition::Whole);
        assert_eq!(block_on(store.recipes()), some_recipes(n));
    }
    // Settings that are damaged are not replaced by older ones with the recipes.
    let newest = store
        .flash
        .bytes
        .iter()
        .rposition(|byte| *byte == 0)
        .unwrap();
    store.flash.bytes[newest - 100] ^= 1;
    let mut store = records(store.flash);
    let refused = block_on(store.save_recipes(&some_recipes(20)));
    assert_eq!(refused, Err(StoreFailed::NoSettings));
    assert_eq!(block_on(store.load()), Found::none(Condition::Lost));
}

#[test]
fn the_last_faults_are_kept_and_come_back() {
    let mut store = records(Nor::<SMALL>::new());
    assert_eq!(block_on(store.fault(0)), None);
    let fault = |n: u32| KeptFault {
        number: n,
        seconds: 1000 * n,
        fault: 4,
        state: 2,
        amplitude: n as f32 * 1e-6,
        expected: 2e-3,
        output: 0.5,
        low: 17,
        high: 4095,
    };
    for n in 0..200 {
        store.take_fault(&fault(n));
        block_on(store.keep_faults());
    }
    let mut store = records(store.flash);
    for back in 0..KEPT_FAULTS {
        assert_eq!(block_on(store.fault(back)), Some(fault(199 - back)));
    }
}
