//! Tests of the memory under power cuts, flipped bits and years of use, with the boards' page
//! sizes.

use super::*;
use embassy_futures::block_on;
use embedded_storage_async::nor_flash::{
    ErrorType, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use kband::arithmetic::Noise;
use std::vec::Vec;

/// Page size of the STM32G474, bytes.
const SMALL: usize = 2 * 1024;
/// Sector size of the STM32F405, bytes.
const LARGE: usize = 128 * 1024;
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
                    *byte |= noise.bits() as u8;
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

const TARGETS: [Target; 8] = [
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
    store.flash.worn = Some(2 * SLOT + 20);
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
    for before in [1, 510, 511, 512] {
        let erasure = (WORDS..LARGE / 4).step_by(797);
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
    let kept = block_on(store.load());
    let (mut held, mut lost) = (0, 0);
    for bit in 0..8 * 2 * SMALL {
        let mut nor = store.flash.clone();
        nor.bytes[bit / 8] ^= 1 << (bit % 8);
        let found = block_on(records(nor).load());
        if found == kept {
            held += 1;
        } else {
            assert_eq!(found, Found::none(Condition::Lost), "bit {bit}");
            lost += 1;
        }
    }
    assert_eq!((held, lost), (8 * (2 * SMALL - SLOT + 8), 8 * (SLOT - 8)));
}

/// Seed of the draw: `KBAND_SEED`, else a fixed one.
fn seed(fixed: u64) -> u64 {
    std::env::var("KBAND_SEED").map_or(fixed, |text| text.parse().expect("a whole number"))
}

/// 100 000 saves, one of sixteen with a power cut. Each page is erased less often than its
/// endurance, and no record is lost. Without its erasures a save takes no more words than a record
/// has.
fn years<const PAGE: usize>(most_erasures: u32) {
    let mut store = records(Nor::<PAGE>::new());
    // The first save marks both banks.
    block_on(store.save(&Settings::default(), Target::Chaotic, None)).unwrap();
    store.flash.touched = 0;
    let mut noise = Noise::new(seed(3));
    let (mut words, mut most) = (0, 0);
    let mut last = None;
    for n in 0..100_000_u32 {
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
            assert!(
                last.is_none_or(|last| found == last) || found.settings == settings,
                "save {n}: {found:?}"
            );
        }
        let erased: u32 = store.flash.erasures.iter().sum();
        words = store.flash.touched.max(words);
        store.flash.touched = 0;
        block_on(store.save(&settings, target, None)).unwrap();
        if store.flash.erasures.iter().sum::<u32>() == erased {
            most = store.flash.touched.max(most);
        }
        last = Some(Found {
            settings,
            target,
            pin: None,
            condition: Condition::Whole,
        });
    }
    assert_eq!(Some(block_on(store.load())), last);
    assert_eq!(most, WORDS);
    let erasures = store.flash.erasures;
    assert!(
        erasures.iter().all(|times| *times <= most_erasures),
        "{erasures:?}"
    );
}

#[test]
fn a_hundred_thousand_saves_wear_no_page_out() {
    // The endurance of a page is 10 000 erasures.
    years::<SMALL>(8_000);
    years::<LARGE>(120);
}

#[test]
fn invalid_or_foreign_settings_are_reported_as_lost() {
    let sound = encode_settings(&Settings::default(), Target::Chaotic, None);
    assert_eq!(
        decode_settings(&sound).unwrap().settings,
        Settings::default()
    );
    let spoilt = |word: usize, value: u32| {
        let mut content = sound;
        content[4 * word..][..4].copy_from_slice(&value.to_le_bytes());
        let mut store = records(Nor::<SMALL>::new());
        block_on(store.settings.append(&mut store.flash, &content)).unwrap();
        block_on(store.load())
    };
    for (word, value) in [
        (0, SETTINGS_SCHEMA ^ 1),
        (1, f32::NAN.to_bits()),
        (1, 1e6_f32.to_bits()),
        (1 + COUNT, 9),
    ] {
        assert_eq!(spoilt(word, value), Found::none(Condition::Lost));
    }
    // Each value is in its range, but the combination is not.
    let place = |name| {
        1 + Settings::KEYS
            .iter()
            .position(|key| key.name == name)
            .unwrap()
    };
    assert!(Settings::default().restitution_high < 0.9);
    assert_eq!(
        spoilt(place("restitution_low"), 0.9_f32.to_bits()),
        Found::none(Condition::Lost)
    );
    assert_eq!(
        spoilt(1, 60_f32.to_bits()).condition,
        Condition::Whole,
        "a sound record is taken"
    );
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
