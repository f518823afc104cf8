//! Tests of the memory under power cuts, flipped bits and years of use, with the boards' page
//! sizes.

use super::encoding::{COUNT, HASHES, PAIR, hash};
use super::record::{HEAD, KEY_HASHES, SIZE};
use super::*;
use crate::testing::{seed, with};
use embassy_futures::block_on;
use embedded_storage_async::nor_flash::{ErrorType, NorFlashErrorKind, ReadNorFlash};
use kband::arithmetic::Noise;
use kband_control::{Recipe, RecipeName, Shape, UpperTone};
use std::vec::Vec;

/// Page size of the STM32G474, bytes.
const SMALL: usize = 2 * 1024;
/// Page size of the STM32F405, bytes.
const LARGE: usize = 16 * 1024;
/// Size of its pages of settings in older images, bytes.
const OLDER: usize = 128 * 1024;
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

const CUT: NorFlashErrorKind = NorFlashErrorKind::Other;

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

    fn touch(&mut self) -> Result<(), NorFlashErrorKind> {
        if self.touched == self.power {
            return Err(CUT);
        }
        self.touched += 1;
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

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        assert!(offset.is_multiple_of(8) && bytes.len().is_multiple_of(8));
        let holds = !self.weak[offset as usize / PAGE];
        assert!(holds, "its erasure did not end");
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

/// What a memory with these settings holds.
fn whole(settings: Settings, target: Target, pin: Option<Pin>) -> Found {
    Found {
        settings,
        target,
        pin,
        condition: Condition::Whole,
        added: 0,
    }
}

/// A fresh memory with these settings saved.
fn saved<const PAGE: usize>(settings: &Settings, target: Target) -> Records<Nor<PAGE>, Waiting> {
    let mut store = records(Nor::new());
    block_on(store.save(settings, target, None)).unwrap();
    store
}

/// What the memory holds after its loss of power.
fn loaded_from<const PAGE: usize>(nor: &Nor<PAGE>) -> Found {
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
        assert_eq!(block_on(store.load()), whole(settings, target, pin));
    }
}

#[test]
fn a_byte_that_cannot_be_written_is_an_error() {
    let mut store = saved::<SMALL>(&changed(1.0), TARGETS[0]);
    // A byte in the settings of the second record.
    store.flash.worn = Some(32 + SLOT + 20);
    let failed = block_on(store.save(&changed(0.9), TARGETS[0], None));
    assert_eq!(failed, Err(StoreFailed::Memory));
    assert_ne!(loaded_from(&store.flash).settings, changed(0.9));
}

#[test]
fn saving_the_same_again_writes_nothing() {
    let store = saved::<SMALL>(&changed(0.95), Target::Chaotic);
    let mut store = records(store.flash.powered(0));
    block_on(store.save(&changed(0.95), Target::Chaotic, None)).unwrap();
    assert!(block_on(store.save(&changed(0.95), Target::K(0.5), None)).is_err());
}

/// Cuts a save after every word, with `before` saves in the memory. The memory then holds the
/// previous or the new settings, or reports them as lost. The next save succeeds. Returns the
/// number of losses.
fn cuts<const PAGE: usize>(before: u32, words: impl Iterator<Item = usize>) -> u32 {
    let mut store = records(Nor::<PAGE>::new());
    let (mut old, mut lost, mut uncut) = (Found::default(), 0, false);
    for n in 0..before {
        let settings = changed(0.9 + 0.001 * (n % 50) as f32);
        block_on(store.save(&settings, Target::K(0.4), None)).unwrap();
        old = block_on(store.load());
    }
    let base = store.flash;
    let new = whole(changed(0.99), Target::Locked { order: 2 }, None);
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
        uncut |= saved;
        // A second cut, in the middle of an erasure or of a record.
        for power in [PAGE / 8, WORDS / 2, power] {
            let mut cut = records(again.flash.powered(power));
            let _ = block_on(cut.save(&new.settings, new.target, None));
            let last = loaded_from(&cut.flash);
            // Where nothing was ever saved, the remains of an erasure count as damaged settings.
            let none = before == 0 && last == Found::none(Condition::Lost);
            let known = last == found || last == new || none;
            assert!(known, "{before}, {power}: {last:?}");
        }
        block_on(again.save(&new.settings, new.target, None)).unwrap();
        assert_eq!(block_on(records(again.flash).load()), new);
    }
    assert!(uncut, "the last one was not cut");
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

#[test]
fn a_flipped_bit_keeps_the_settings_or_is_reported() {
    let mut store = records(Nor::<SMALL>::new());
    for n in 0..11 {
        block_on(store.save(&changed(0.9 + 0.005 * n as f32), TARGETS[0], None)).unwrap();
    }
    let lost = flips(&store);
    assert_eq!(lost, 8 * (SLOT - 8));
}

/// Flips every bit of the settings' pages. They stay, or are reported as lost. Returns the number
/// of losses.
fn flips(store: &Records<Nor<SMALL>, Waiting>) -> usize {
    let kept = loaded_from(&store.flash);
    let mut lost = 0;
    for bit in 0..8 * 2 * SMALL {
        let mut nor = store.flash.clone();
        nor.bytes[bit / 8] ^= 1 << (bit % 8);
        let found = block_on(records(nor).load());
        if found != kept {
            assert_eq!(found, Found::none(Condition::Lost), "bit {bit}");
            lost += 1;
        }
    }
    lost
}

/// 30 000 saves, one of sixteen with a power cut. Each page is erased less often than its
/// endurance, and no record is lost. Without its erasures a save takes no more words than a record
/// has.
fn years<const PAGE: usize>(most_erasures: u32) {
    // The first save marks both banks.
    let mut store = saved::<PAGE>(&Settings::default(), Target::Chaotic);
    store.flash.touched = 0;
    let mut noise = Noise::new(seed(3));
    let (mut words, mut most) = (0, 0);
    let mut last = None;
    for n in 0..30_000_u32 {
        let settings = Settings {
            gain: 1.0 + (n % 1000) as f32 * 1e-3,
            ..Settings::default()
        };
        let target = Target::K(0.3 + (n % 7) as f32 * 0.1);
        if noise.bits().is_multiple_of(16) {
            let mut cut = records(store.flash.powered(noise.bits() as usize % WORDS));
            assert!(block_on(cut.save(&settings, target, None)).is_err());
            store = records(cut.flash.powered(usize::MAX));
            let found = block_on(store.load());
            let known = last.is_none_or(|last| found == last) || found.settings == settings;
            assert!(known, "save {n}: {found:?}");
        }
        let erased: u32 = store.flash.erasures.iter().sum();
        words = store.flash.touched.max(words);
        store.flash.touched = 0;
        block_on(store.save(&settings, target, None)).unwrap();
        if store.flash.erasures.iter().sum::<u32>() == erased {
            most = store.flash.touched.max(most);
        }
        last = Some(whole(settings, target, None));
    }
    assert_eq!(Some(block_on(store.load())), last);
    assert_eq!(most, WORDS);
    let most = store.flash.erasures.into_iter().max();
    assert!(most <= Some(most_erasures), "{most:?}");
}

#[test]
fn thirty_thousand_saves_wear_no_page_out() {
    // The endurance of a page is 10 000 erasures.
    years::<SMALL>(9_500);
    years::<LARGE>(1_100);
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
        // Older than version 3, no version, a PIN of no digits, more settings than there is room.
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
    assert_eq!((whole.settings.frequency, whole.added), (60.0, 0));
    assert_eq!(whole.condition, Condition::Whole);
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
            assert_eq!((found.settings, found.added), (wanted, 1 << number));
            assert_eq!((found.target, found.pin), (Target::K(0.4), pin));
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
        assert_eq!(loaded(&content), Found::none(Condition::Newer));
    }
    // It is replaced only by a save, which keeps the public key.
    let key = [9; 32];
    let keyed = keyed(Some(key));
    version[HEAD - 4..SIZE].copy_from_slice(&keyed[HEAD - 4..SIZE]);
    let mut store = records(Nor::<SMALL>::new());
    block_on(store.settings.append(&mut store.flash, &version)).unwrap();
    let mut store = records(store.flash);
    assert_eq!(block_on(store.key()), Some(key));
    block_on(store.save(&changed(0.9), Target::Chaotic, None)).unwrap();
    let mut store = records(store.flash);
    let wanted = whole(changed(0.9), Target::Chaotic, None);
    assert_eq!(block_on(store.load()), wanted);
    assert_eq!(block_on(store.key()), Some(key));
    assert_eq!(block_on(store.recipes()), Recipes::default());
}

/// Offset and bytes of each line of a dump of two pages that an image with version 3 wrote.
fn dump_of_version_3() -> Vec<(usize, Vec<u8>)> {
    let line = |line: &str| {
        let mut words = line.split(' ');
        let at = usize::from_str_radix(words.next().unwrap(), 16).unwrap();
        let bytes = words.map(|word| u8::from_str_radix(word, 16).unwrap());
        (at, bytes.collect())
    };
    include_str!("version_3.hex").lines().map(line).collect()
}

/// The pages after the first `saves` of them; from the eighth on the record is the sixth once more.
fn version_3<const PAGE: usize>(saves: usize) -> Nor<PAGE> {
    let mut nor = Nor::<PAGE>::new();
    for (at, bytes) in dump_of_version_3() {
        if at < (1 + saves) * version_3::SLOT {
            nor.bytes[at..at + bytes.len()].copy_from_slice(&bytes);
        }
    }
    // The second bank was marked with the first save.
    nor.bytes.copy_within(0..version_3::SLOT, PAGE);
    for number in 6..saves.min(PAGE / version_3::SLOT - 1) {
        let size = version_3::SLOT;
        let mut record = nor.bytes[6 * size..7 * size].to_vec();
        record[..4].copy_from_slice(&(number as u32).to_le_bytes());
        let check = kband_control::wire::crc32(&record[..size - 12]);
        record[size - 12..size - 8].copy_from_slice(&check.to_le_bytes());
        nor.bytes[(1 + number) * size..][..size].copy_from_slice(&record);
    }
    nor
}

/// What the record of save `n` in the dump holds; its image had no fieldbus.
fn saved_with_version_3(n: usize) -> Found {
    let n = n.min(5);
    let mut settings = changed(0.9 + 0.01 * n as f32);
    settings.bus_timeout = Settings::default().bus_timeout;
    whole(settings, TARGETS[n], Pin::parse("0420").filter(|_| n == 5))
}

#[test]
fn records_of_version_3_are_read() {
    assert_eq!(loaded_from(&version_3::<SMALL>(0)), Found::default());
    for saves in 1..=7 {
        let found = loaded_from(&version_3::<SMALL>(saves));
        let wanted = saved_with_version_3(saves - 1);
        assert_eq!(Found { added: 0, ..found }, wanted);
        assert_eq!(found.added.count_ones() as usize, COUNT - 40);
    }
}

/// Cuts the first save of this firmware on `base` after every word, then a second one.
fn conversion_cuts<const PAGE: usize>(base: &Nor<PAGE>, words: impl Iterator<Item = usize>) {
    let old = loaded_from(base);
    assert_eq!(old.condition, Condition::Whole);
    let new = |n: usize| Found {
        settings: changed(0.99 - 0.001 * n as f32),
        target: Target::Locked { order: 2 },
        added: 0,
        ..old
    };
    let (mut olds, mut news) = (0, 0);
    let mut save = |nor: Nor<PAGE>, old: Found, new: Found| {
        let mut cut = records(nor);
        let saved = block_on(cut.save(&new.settings, new.target, new.pin)).is_ok();
        let nor = cut.flash.powered(usize::MAX);
        let found = block_on(records(nor.clone()).load());
        assert!(found == old || found == new, "{found:?}");
        assert!(!saved || found == new, "told to be kept");
        olds += u32::from(found == old);
        news += u32::from(found == new);
        (nor, found)
    };
    for power in words {
        let (nor, mut now) = save(base.powered(power), old, new(0));
        for again in [3, 255, 256, 262, power] {
            save(nor.powered(again), now, new(1));
        }
        // The remains of the cut hinder none of the next saves.
        let mut nor = nor;
        for n in 1..5 {
            (nor, now) = save(nor, now, new(n));
            assert_eq!(now, new(n));
        }
    }
    assert!(olds > 0 && news > 0);
}

#[test]
fn a_cut_conversion_leaves_old_or_new() {
    let page = SMALL / 4;
    for saves in 1..=7 {
        conversion_cuts(&version_3::<SMALL>(saves), 0..=page + WORDS + 8);
    }
    // The other bank is to be erased first: its erasure was cut short, or it has no mark.
    for first in [0x6b, 0xff] {
        let mut nor = version_3::<SMALL>(7);
        nor.bytes[SMALL..2 * SMALL].fill(0xff);
        nor.bytes[SMALL] = first;
        nor.weak[1] = true;
        conversion_cuts(&nor, 0..=2 * page + WORDS + 8);
    }
}

/// Memory on a chip whose older image had its settings in pages behind the present ones.
fn moved(nor: Nor<SMALL>) -> Records<Nor<SMALL>, Waiting> {
    records(nor).reading_from(4 * SMALL as u32, OLDER as u32)
}

/// A flash with the bytes `left` in the present pages, behind them settings of an older image.
fn with_older_settings(left: u8, older: &Nor<OLDER>) -> Nor<SMALL> {
    let mut nor = Nor::new();
    nor.bytes.fill(left);
    nor.bytes.extend(&older.bytes[..2 * OLDER]);
    nor
}

#[test]
fn settings_elsewhere_hold_until_a_save_at_any_cut() {
    let mut present = records(Nor::<OLDER>::new());
    block_on(present.save(&changed(0.95), Target::K(0.4), Pin::parse("0420"))).unwrap();
    block_on(present.save_recipes(&some_recipes(3))).unwrap();
    for (left, older) in [
        (0xff, present.flash),
        (0x46, version_3::<OLDER>(300)),
        (0, version_3::<OLDER>(511)),
    ] {
        let nor = with_older_settings(left, &older);
        let mut before = moved(nor.clone());
        let old = block_on(before.load());
        let recipes = block_on(before.recipes());
        let wanted = (Condition::Whole, Pin::parse("0420"));
        assert_eq!((old.condition, old.pin), wanted);
        let new = with(old, |it| (it.settings, it.added) = (changed(0.99), 0));
        let (mut olds, mut news) = (0, 0);
        // Two erasures with their marks, and the record between them.
        for power in 0..=2 * (SMALL / 4 + 5) + WORDS {
            let mut cut = moved(nor.powered(power));
            let saved = block_on(cut.save(&new.settings, new.target, new.pin)).is_ok();
            let mut again = moved(cut.flash.powered(usize::MAX));
            let found = block_on(again.load());
            assert!(found == new || found == old && !saved, "{power}: {found:?}");
            assert_eq!(block_on(again.recipes()), recipes, "{power}");
            olds += u32::from(found == old);
            news += u32::from(found == new);
            block_on(again.save(&new.settings, new.target, new.pin)).unwrap();
            assert_eq!(block_on(moved(again.flash).load()), new);
        }
        assert!(olds > 0 && news > 0, "{olds}, {news}");
    }
}

#[test]
fn without_settings_elsewhere_those_here_count() {
    for (left, condition) in [(0xff, Condition::Never), (0, Condition::Lost)] {
        let nor = with_older_settings(left, &Nor::new());
        assert_eq!(block_on(moved(nor).load()), Found::none(condition));
    }
    // The newest record elsewhere is damaged.
    let mut older = version_3::<OLDER>(7);
    older.bytes[7 * version_3::SLOT + 40] ^= 1;
    let found = block_on(moved(with_older_settings(0xff, &older)).load());
    assert_eq!(found, Found::none(Condition::Lost));
}

#[test]
fn a_damaged_record_is_not_replaced_by_an_older_place() {
    let nor = with_older_settings(0xff, &version_3::<OLDER>(300));
    let mut store = moved(nor);
    block_on(store.save(&changed(0.99), TARGETS[0], None)).unwrap();
    for bit in 8 * 32..8 * (32 + SLOT - 8) {
        let mut nor = store.flash.clone();
        nor.bytes[bit / 8] ^= 1 << (bit % 8);
        let found = block_on(moved(nor).load());
        assert_eq!(found, Found::none(Condition::Lost), "bit {bit}");
    }
}

#[test]
fn a_flipped_bit_of_a_conversion_brings_no_older_record_back() {
    // The save is stored, and the erasure of the old bank after it has failed.
    let mut store = records(version_3::<SMALL>(4));
    store.flash.refuses_erasures = true;
    block_on(store.save(&changed(0.99), TARGETS[0], None)).unwrap();
    assert_eq!(loaded_from(&store.flash).settings, changed(0.99));
    assert_eq!(flips(&store), 8 * (SLOT - 8));
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
    let none = Err(StoreFailed::NoSettings);
    assert_eq!(block_on(store.save_recipes(&some_recipes(1))), none);
    assert_eq!(block_on(store.save_key(&[1; 32])), none);
    assert_eq!(block_on(store.key()), None);
    // Among them the bits of a signalling NaN.
    let key = |n: u8| core::array::from_fn(|at| if at < 4 { [1, 0, 0xa0, 0x7f][at] } else { n });
    for n in 1..9 {
        let pin = Pin::parse("0420").filter(|_| n % 2 == 0);
        let settings = changed(0.9 + 0.01 * f32::from(n));
        block_on(store.save(&settings, Target::Chaotic, pin)).unwrap();
        let before = (n > 1).then(|| some_recipes(n - 1));
        assert_eq!(block_on(store.recipes()), before.unwrap_or_default());
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
    let newest = store.flash.bytes.iter().rposition(|byte| *byte == 0);
    store.flash.bytes[newest.unwrap() - 100] ^= 1;
    let mut store = records(store.flash);
    assert_eq!(block_on(store.save_recipes(&some_recipes(20))), none);
    assert_eq!(block_on(store.load()), Found::none(Condition::Lost));
}

#[test]
fn a_cut_save_of_recipes_leaves_old_or_new() {
    // From records of this firmware, with room and without, and from those of version 3.
    let mut own = Vec::new();
    let mut store = records(Nor::<SMALL>::new());
    for n in 0..2 {
        block_on(store.save(&changed(0.9 + 0.01 * n as f32), TARGETS[2], None)).unwrap();
        block_on(store.save_recipes(&some_recipes(n))).unwrap();
        own.push(store.flash.clone());
    }
    own.extend([version_3::<SMALL>(3), version_3::<SMALL>(7)]);
    for base in own {
        let added = 0;
        let found = with(loaded_from(&base), |it| it.added = added);
        let old = block_on(records(base.clone()).recipes());
        let new = some_recipes(9);
        let (mut olds, mut news) = (0, 0);
        for power in 0..=SMALL / 2 + WORDS {
            let mut cut = records(base.powered(power));
            let saved = block_on(cut.save_recipes(&new)).is_ok();
            let mut again = records(cut.flash.powered(usize::MAX));
            let now = block_on(again.recipes());
            assert!(now == new || now == old && !saved, "{power}");
            let loaded = block_on(again.load());
            assert_eq!(Found { added, ..loaded }, found);
            olds += u32::from(now == old);
            news += u32::from(now == new);
            block_on(again.save_recipes(&new)).unwrap();
            assert_eq!(block_on(again.recipes()), new);
        }
        assert!(olds > 0 && news > 0);
    }
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
