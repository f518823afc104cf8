//! Tests of the memory under power cuts, flipped bits and years of use, with the boards' page
//! sizes.

use super::encoding::{COUNT, HASHES, PAIR, hash};
use super::record::{HEAD, KEY_HASHES, SIZE};
use super::*;
use crate::testing::with;
use core::cell::Cell;
use embassy_futures::block_on;
use embedded_storage_async::nor_flash::{ErrorType, NorFlashErrorKind, ReadNorFlash};
use kband::arithmetic::Noise;
use kband_control::{Recipe, RecipeName, Shape, UpperTone};
use std::thread_local;
use std::vec::Vec;

/// Page size of the STM32G474, bytes.
pub const G4_PAGE: usize = 2 * 1024;
const F4_PAGE: usize = 16 * 1024;
/// Number of four-byte words in a record; an erasure clears a page word by word.
const SLOT_WORDS: usize = SLOT / 4;

/// NOR flash of four pages whose power fails after a number of words. Writing clears bits; erasing
/// sets the bits of a page.
#[derive(Clone, Default)]
pub struct Nor<const PAGE: usize> {
    pub bytes: Vec<u8>,
    /// Number of words until the power fails.
    power: usize,
    operations: usize,
    pub erasures: [u32; 4],
    /// Pages whose last erasure was cut short: programming them fails.
    pub weak: [bool; 4],
    /// Whether erasures fail before they begin.
    pub refuses_erasures: bool,
    /// Index of a byte that stays erased.
    stuck: Option<usize>,
}

const CUT: NorFlashErrorKind = NorFlashErrorKind::Other;

impl<const PAGE: usize> Nor<PAGE> {
    pub fn new() -> Self {
        Self {
            bytes: std::vec![0xff; 4 * PAGE],
            power: usize::MAX,
            ..Self::default()
        }
    }

    fn powered(&self, words: usize) -> Self {
        Self {
            power: words,
            operations: 0,
            ..self.clone()
        }
    }

    fn count_operation(&mut self) -> Result<(), NorFlashErrorKind> {
        if self.operations == self.power {
            return Err(CUT);
        }
        self.operations += 1;
        Ok(())
    }
}

impl<const PAGE: usize> ErrorType for Nor<PAGE> {
    type Error = NorFlashErrorKind;
}

impl<const PAGE: usize> ReadNorFlash for Nor<PAGE> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
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

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        if self.refuses_erasures {
            return Err(CUT);
        }
        let page = from as usize / PAGE;
        self.erasures[page] += 1;
        self.weak[page] = true;
        for at in (from as usize..to as usize).step_by(4) {
            if let Err(cut) = self.count_operation() {
                // A partly erased page reads as random bytes.
                let mut noise = Noise::new(at as u64 + 1);
                for byte in &mut self.bytes[at..(at + 3 * SLOT).min(to as usize)] {
                    *byte = noise.bits() as u8;
                }
                return Err(cut);
            }
            self.bytes[at..at + 4].fill(0xff);
        }
        // Near the end of an erasure all bytes already read as erased.
        self.count_operation()?;
        self.weak[page] = false;
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        assert!(offset.is_multiple_of(8) && bytes.len().is_multiple_of(8));
        let holds = !self.weak[offset as usize / PAGE];
        assert!(holds, "its erasure did not end");
        for (at, word) in (offset as usize..).step_by(4).zip(bytes.chunks_exact(4)) {
            self.count_operation()?;
            for (old, new) in self.bytes[at..].iter_mut().zip(word) {
                // Flash with error correction programs each word once, except to zeros.
                assert!(*old == 0xff || *new == 0);
                *old &= new;
            }
            if let Some(stuck) = self.stuck.filter(|stuck| (at..at + 4).contains(stuck)) {
                self.bytes[stuck] = 0xff;
            }
        }
        Ok(())
    }
}

pub type Memory<const PAGE: usize> = Records<Nor<PAGE>, Waiting>;

thread_local! {
    /// Whether the supply of the memories in a test is good.
    pub static SUPPLY_IS_GOOD: Cell<bool> = const { Cell::new(true) };
}

fn records<const PAGE: usize>(nor: Nor<PAGE>) -> Memory<PAGE> {
    let page = PAGE as u32;
    let (settings, faults) = (0..2 * page, 2 * page..4 * page);
    let supply_settled = || SUPPLY_IS_GOOD.get();
    Records::new(nor, settings, faults, Waiting::EMPTY, supply_settled).unwrap()
}

/// Settings unlike the defaults, and unlike each other, in every key that `change` may halve.
fn changed(factor: f32) -> Settings {
    let mut settings = Settings::default();
    for key in Settings::KEYS {
        let value = settings.get(key.name).unwrap();
        // Some are whole or at the end of their range; the two bounds must keep their order.
        if !key.name.starts_with("bus") || key.name == "bus_timeout" {
            let _ = settings.set(key.name, value * factor);
        }
    }
    settings.check().unwrap();
    settings
}

fn valid(settings: Settings, target: Target, pin: Option<Pin>) -> LoadedSettings {
    with(LoadedSettings::whole(settings, target), |it| it.pin = pin)
}

fn saved<const PAGE: usize>(settings: &Settings, target: Target) -> Memory<PAGE> {
    let mut store = records(Nor::new());
    block_on(store.save(settings, target, None)).unwrap();
    store
}

/// A memory in this condition; a whole one has these settings.
pub fn memory(saved: &LoadedSettings) -> Memory<G4_PAGE> {
    let mut store = records(Nor::new());
    match saved.condition {
        Condition::Never => {}
        Condition::Whole => block_on(store.save(&saved.settings, saved.target, saved.pin)).unwrap(),
        Condition::Lost => store.flash.bytes[..2 * G4_PAGE].fill(0),
        Condition::Newer => {
            let newer = record(|content| content[0] += 1);
            block_on(store.settings.append(&mut store.flash, &newer)).unwrap();
        }
    }
    records(store.flash)
}

/// Content of the memory after its loss of power.
fn loaded_from<const PAGE: usize>(nor: &Nor<PAGE>) -> LoadedSettings {
    block_on(records(nor.powered(usize::MAX)).load())
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
fn a_byte_that_cannot_be_written_is_an_error() {
    let mut store = saved::<G4_PAGE>(&changed(1.0), TARGETS[0]);
    // A byte in the settings of the second record.
    store.flash.stuck = Some(32 + SLOT + 20);
    let failed = block_on(store.save(&changed(0.9), TARGETS[0], None));
    assert_eq!(failed, Err(StoreFailed::Memory));
    assert_ne!(loaded_from(&store.flash).settings, changed(0.9));
}

#[test]
fn saving_the_same_again_writes_nothing() {
    let store = saved::<G4_PAGE>(&changed(0.95), Target::Chaotic);
    let mut store = records(store.flash.powered(0));
    block_on(store.save(&changed(0.95), Target::Chaotic, None)).unwrap();
    assert!(block_on(store.save(&changed(0.95), Target::K(0.5), None)).is_err());
}

/// Cuts a save after each of these numbers of words. The memory then holds the content before or
/// after it. A second cut, after one of the numbers in [`SECOND`], adds no other content, and later
/// saves succeed.
fn cut_everywhere<const PAGE: usize>(base: &Nor<PAGE>, words: impl Iterator<Item = usize>) {
    let old = loaded_from(base);
    let new: [LoadedSettings; 5] = core::array::from_fn(|number| {
        let mut uncut = records(base.clone());
        save(&mut uncut, number as u8).unwrap();
        block_on(uncut.load())
    });
    let (mut olds, mut news) = (0, 0);
    for power in words {
        let mut cut = records(base.powered(power));
        let done = save(&mut cut, 0).is_ok();
        let nor = cut.flash.powered(usize::MAX);
        let found = loaded_from(&nor);
        let holds = found == new[0] || found == old && !done;
        assert!(holds, "{power}: {found:?}");
        olds += u32::from(found == old);
        news += u32::from(found == new[0]);
        for second in SECOND {
            let mut cut = records(nor.powered(second));
            let done = save(&mut cut, 1).is_ok();
            let last = loaded_from(&cut.flash);
            // Without any mark yet, the remains of an erasure count as damaged settings.
            let was_empty = found.condition == Condition::Never;
            let lost = was_empty && last.condition == Condition::Lost;
            let holds = last == new[1] || !done && (last == found || lost);
            assert!(holds, "{power}, {second}: {last:?}");
        }
        let mut store = records(nor);
        for (number, expected) in (0..).zip(new).skip(1) {
            save(&mut store, number).unwrap();
            store = records(store.flash);
            assert_eq!(block_on(store.load()), expected, "{power}");
        }
    }
    assert!(olds > 0 && news > 0, "{olds}, {news}");
}

/// The save of this number in a test of power cuts.
fn save<const PAGE: usize>(store: &mut Memory<PAGE>, number: u8) -> Result {
    let settings = changed(0.99 - 0.001 * f32::from(number));
    block_on(store.save(&settings, Target::Locked { order: 2 }, Pin::parse("0420")))
}

/// Numbers of words of a second cut: in a record, in the change of banks after it, in an erasure.
const SECOND: [usize; 5] = [
    3,
    SLOT_WORDS / 2,
    SLOT_WORDS + 3,
    SLOT_WORDS + 10,
    F4_PAGE / 8,
];

#[test]
fn a_cut_after_any_word_leaves_old_or_new() {
    fn base<const PAGE: usize>(saves: u32) -> Nor<PAGE> {
        let mut store = records(Nor::new());
        for n in 0..saves {
            let settings = changed(0.9 + 0.001 * n as f32);
            block_on(store.save(&settings, Target::K(0.4), None)).unwrap();
        }
        store.flash
    }
    // A page holds two records: the save has an erasure before it, after it, or none.
    for saves in 0..6 {
        let words = 0..=2 * (G4_PAGE / 4) + SLOT_WORDS;
        cut_everywhere(&base::<G4_PAGE>(saves), words);
    }
    // A full sector: the next record starts the other one, and this one is erased after it.
    for saves in [1, 15, 16, 17] {
        let erasure = (SLOT_WORDS..F4_PAGE / 4).step_by(97);
        let words = (0..=SLOT_WORDS).chain(erasure).chain([2 * F4_PAGE]);
        cut_everywhere(&base::<F4_PAGE>(saves), words);
    }
}

#[test]
fn a_flipped_bit_keeps_the_settings_or_is_reported() {
    // A page holds two records.
    let mut store = records(Nor::<G4_PAGE>::new());
    for n in 0..5 {
        block_on(store.save(&changed(0.9 + 0.005 * n as f32), TARGETS[0], None)).unwrap();
        let original = loaded_from(&store.flash);
        let mut lost = 0;
        for bit in 0..8 * 2 * G4_PAGE {
            let mut nor = store.flash.clone();
            nor.bytes[bit / 8] ^= 1 << (bit % 8);
            let found = block_on(records(nor).load());
            if found != original {
                assert_eq!(found, LoadedSettings::none(Condition::Lost), "bit {bit}");
                lost += 1;
            }
        }
        assert_eq!(lost, 8 * (SLOT - 8), "{n}");
    }
}

/// 30 000 saves. Each page is erased less often than its endurance, and no record is lost. Erasures
/// apart, a save writes no more words than a record has.
fn wear<const PAGE: usize>(max_erasures: u32) {
    // The first save marks both banks.
    let mut store = saved::<PAGE>(&Settings::default(), Target::Chaotic);
    let mut words = 0;
    for n in 0..30_000_u32 {
        let gain = 1.0 + (n % 1000) as f32 * 1e-3;
        let settings = with(Settings::default(), |it| it.gain = gain);
        let target = Target::K(0.3 + (n % 7) as f32 * 0.1);
        let erasures = store.flash.erasures;
        store.flash.operations = 0;
        block_on(store.save(&settings, target, None)).unwrap();
        if store.flash.erasures == erasures {
            words = store.flash.operations.max(words);
        }
        if n.is_multiple_of(16) {
            assert_eq!(block_on(store.load()), valid(settings, target, None));
        }
    }
    assert_eq!(words, SLOT_WORDS);
    let maximum = store.flash.erasures.into_iter().max();
    assert!(maximum <= Some(max_erasures), "{maximum:?}");
}

#[test]
fn thirty_thousand_saves_wear_no_page_out() {
    // The endurance of a page is 10 000 erasures.
    wear::<G4_PAGE>(8_000);
    wear::<F4_PAGE>(1_100);
}

fn loaded(content: &[u8; CONTENT]) -> LoadedSettings {
    let mut store = records(Nor::<G4_PAGE>::new());
    block_on(store.settings.append(&mut store.flash, content)).unwrap();
    let before = store.flash.bytes.clone();
    let found = block_on(store.load());
    assert_eq!(store.flash.bytes, before, "a start writes nothing");
    found
}

/// A record of the defaults with this public key.
fn keyed(key: Option<[u8; 32]>) -> [u8; CONTENT] {
    let mut content = [0; CONTENT];
    let settings = Settings::default();
    encode_settings(&mut content, &settings, Target::Chaotic, None, key);
    content
}

/// A record of the defaults, changed.
fn record(change: impl FnOnce(&mut [u8; CONTENT])) -> [u8; CONTENT] {
    let mut content = keyed(None);
    change(&mut content);
    content
}

/// Offset of a setting in the content of a record, bytes.
fn place(name: &str) -> usize {
    let index = Settings::KEYS.iter().position(|key| key.name == name);
    HEAD + PAIR * index.unwrap()
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
        // Older than version 3, no version, a PIN without digits, more settings than fit.
        (0, 0xda9f_6037),
        (0, 3),
        (28, 7),
        (32, 62),
        (32, u32::MAX),
        (frequency, f32::NAN.to_bits()),
        (frequency, 1e6_f32.to_bits()),
        // Each value is in its range, but the combination is refused.
        (place("restitution_low") + 2, 0.9_f32.to_bits()),
    ] {
        let lost = LoadedSettings::none(Condition::Lost);
        assert_eq!(word(at, value), lost, "{at}");
    }
    let valid = word(frequency, 60_f32.to_bits());
    assert_eq!((valid.settings.frequency, valid.added), (60.0, 0));
    assert_eq!(valid.condition, Condition::Whole);
}

#[test]
fn the_hashes_of_all_keys_differ() {
    let mut hashes = [&HASHES[..], &KEY_HASHES].concat();
    hashes.sort_unstable();
    hashes.dedup();
    assert_eq!(hashes.len(), COUNT + KEY_HASHES.len());
    // Check value of FNV-1a in 32 bits: "a" is 0xe40c292c.
    assert_eq!(hash(b"a"), 0xe40c ^ 0x292c);
}

#[test]
fn a_key_that_the_record_lacks_gets_its_default() {
    let settings = changed(0.9);
    for (number, key) in Settings::KEYS.iter().enumerate() {
        let mut content = [0; CONTENT];
        let pin = Pin::parse("1234");
        encode_settings(&mut content, &settings, Target::K(0.4), pin, None);
        // The last setting takes the position of this one.
        let last = HEAD + PAIR * (COUNT - 1);
        content.copy_within(last..last + PAIR, HEAD + PAIR * number);
        content[HEAD - 4] -= 1;
        let mut expected = settings;
        expected.set(key.name, key.default).unwrap();
        let condition = match expected.check() {
            Ok(()) => Condition::Whole,
            Err(_) => Condition::Lost,
        };
        let found = loaded(&content);
        assert_eq!(found.condition, condition, "{}", key.name);
        if condition == Condition::Whole {
            let expected = valid(expected, Target::K(0.4), pin);
            assert_eq!(found, with(expected, |it| it.added = 1 << number));
        }
    }
}

#[test]
fn a_record_of_a_newer_firmware_stays_as_it_is() {
    let unknown = record(|content| {
        let at = HEAD + PAIR * COUNT;
        content[at..][..2].copy_from_slice(&hash(b"colour").to_le_bytes());
        content[HEAD - 4] += 1;
    });
    let mut version = record(|content| content[0] += 1);
    version[SIZE..].fill(7);
    let target = record(|content| content[4] = 10);
    for content in [unknown, version, target] {
        assert_eq!(loaded(&content), LoadedSettings::none(Condition::Newer));
    }
    // Only a save replaces it, and keeps the public key.
    let key = [9; 32];
    let keyed = keyed(Some(key));
    version[HEAD - 4..SIZE].copy_from_slice(&keyed[HEAD - 4..SIZE]);
    let mut store = records(Nor::<G4_PAGE>::new());
    block_on(store.settings.append(&mut store.flash, &version)).unwrap();
    let mut store = records(store.flash);
    assert_eq!(block_on(store.key()), Some(key));
    block_on(store.save(&changed(0.9), Target::Chaotic, None)).unwrap();
    let mut store = records(store.flash);
    let expected = valid(changed(0.9), Target::Chaotic, None);
    assert_eq!(block_on(store.load()), expected);
    assert_eq!(block_on(store.key()), Some(key));
    assert_eq!(block_on(store.recipes()), Recipes::default());
}

fn some_recipes(number: u8) -> Recipes {
    let mut recipes = Recipes::default();
    for place in 1..=Recipe::COUNT {
        let scatter = 0.001 * f32::from(number);
        let settings = with(Settings::default(), |it| it.scatter = scatter);
        let recipe = Recipe::of(Target::K(0.1 * f32::from(place)), &settings);
        recipes.set(place, Some(&(RecipeName::parse("parts").unwrap(), recipe)));
    }
    recipes
}

#[test]
fn settings_recipes_and_key_are_saved_without_each_other() {
    let mut store = records(Nor::<G4_PAGE>::new());
    let never = LoadedSettings::none(Condition::Never);
    assert_eq!(block_on(store.load()), never);
    assert_eq!(never.target, Target::Amplitude(0.0));
    assert_eq!(block_on(store.recipes()), Recipes::default());
    let none = Err(StoreFailed::NoSettings);
    assert_eq!(block_on(store.save_recipes(&some_recipes(1))), none);
    assert_eq!(block_on(store.save_key(&[1; 32])), none);
    assert_eq!(block_on(store.key()), None);
    // Among them the bits of a signalling NaN.
    let key = |n: u8| core::array::from_fn(|at| if at < 4 { [1, 0, 0xa0, 0x7f][at] } else { n });
    for (n, target) in (1..).zip(TARGETS) {
        let pin = Pin::parse("0420").filter(|_| n % 2 == 0);
        let settings = changed(0.9 + 0.01 * f32::from(n));
        block_on(store.save(&settings, target, pin)).unwrap();
        let before = (n > 1).then(|| some_recipes(n - 1));
        assert_eq!(block_on(store.recipes()), before.unwrap_or_default());
        block_on(store.save_recipes(&some_recipes(n))).unwrap();
        assert_eq!(block_on(store.key()), (n > 1).then(|| key(n - 1)));
        block_on(store.save_key(&key(n))).unwrap();
        store = records(store.flash);
        assert_eq!(block_on(store.key()), Some(key(n)));
        let found = block_on(store.load());
        assert_eq!(found, valid(settings, target, pin));
        assert_eq!(block_on(store.recipes()), some_recipes(n));
    }
    // Older settings do not replace damaged ones when recipes are saved.
    let newest = store.flash.bytes.iter().rposition(|byte| *byte == 0);
    store.flash.bytes[newest.unwrap() - 100] ^= 1;
    let mut store = records(store.flash);
    assert_eq!(block_on(store.save_recipes(&some_recipes(20))), none);
    assert_eq!(
        block_on(store.load()),
        LoadedSettings::none(Condition::Lost)
    );
}

#[test]
fn the_last_faults_outlive_the_change_of_banks() {
    let mut store = records(Nor::<G4_PAGE>::new());
    let fault = |n: u32| FaultRecord {
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
    assert_eq!(block_on(store.fault(0)), None);
    for n in 0..500_u32 {
        store.take_fault(&fault(n));
        block_on(store.keep_faults());
        if n == 250 {
            store = records(store.flash);
        }
        for age in 0..STORED_FAULTS {
            let expected = n.checked_sub(age).map(fault);
            assert_eq!(block_on(store.fault(age)), expected, "{n}, {age} back");
        }
    }
}
