//! Settings kept in NOR flash, a record each.
//!
//! The records are those of `sequential-storage`: each has checks of its own and lies apart from the
//! others. A record's key is a hash of the setting's name, so that settings may come, go and move; a
//! record of another [`VERSION`] does not count.

use core::future::Future;

use embedded_storage_async::nor_flash::NorFlash;
use kband::control::Settings;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::map::{MapConfig, MapStorage};

/// Version of what the records mean; raised when a setting keeps its name and changes its meaning.
const VERSION: u8 = 1;
/// Room for one record: key and value, in whole words of any flash.
const ROOM: usize = 32;

/// The memory of the settings failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoreFailed;

/// What was found in the memory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Found {
    /// The settings: the defaults, but for what is kept.
    pub settings: Settings,
    /// Records that were read and accepted.
    pub kept: u16,
    /// Records that were read and refused, alone or together.
    pub refused: u16,
}

/// A memory of the settings.
pub trait Store {
    /// The settings kept.
    fn load(&mut self) -> impl Future<Output = Found>;

    /// Keeps the settings.
    ///
    /// A power cut leaves of each setting the old or the new value.
    fn save(&mut self, settings: &Settings) -> impl Future<Output = Result<(), StoreFailed>>;
}

/// The settings in two or more pages of a NOR flash.
pub struct Records<F: NorFlash> {
    map: MapStorage<u32, F, Cache<Uncached, Uncached, Uncached, u32>>,
}

impl<F: NorFlash> Records<F> {
    /// The records in the pages `range` of the flash; refused unless these are at least two whole ones.
    pub fn new(flash: F, range: core::ops::Range<u32>) -> Result<Self, StoreFailed> {
        let config = MapConfig::try_new(range).map_err(|_| StoreFailed)?;
        Ok(Self {
            map: MapStorage::new(flash, config, Cache::new_uncached()),
        })
    }

    async fn read(&mut self, name: &str) -> Option<f32> {
        let mut room = [0; ROOM];
        match self.map.fetch_item::<&[u8]>(&mut room, &key(name)).await {
            Ok(Some([VERSION, a, b, c, d])) => Some(f32::from_le_bytes([*a, *b, *c, *d])),
            _ => None,
        }
    }
}

impl<F: NorFlash> Store for Records<F> {
    async fn load(&mut self) -> Found {
        let mut found = Found {
            settings: Settings::default(),
            kept: 0,
            refused: 0,
        };
        for known in Settings::KEYS {
            let Some(value) = self.read(known.name).await else {
                continue;
            };
            match found.settings.set(known.name, value) {
                Ok(()) => found.kept += 1,
                Err(_) => found.refused += 1,
            }
        }
        if found.settings.check().is_err() {
            found.refused += 1;
        }
        found
    }

    async fn save(&mut self, settings: &Settings) -> Result<(), StoreFailed> {
        for (known, value) in Settings::KEYS.iter().zip(settings.values()) {
            if self.read(known.name).await.map(f32::to_bits) == Some(value.to_bits()) {
                continue;
            }
            let [a, b, c, d] = value.to_le_bytes();
            let mut room = [0; ROOM];
            self.map
                .store_item(&mut room, &key(known.name), &&[VERSION, a, b, c, d][..])
                .await
                .map_err(|_| StoreFailed)?;
        }
        Ok(())
    }
}

/// FNV-1a of a setting's name.
fn key(name: &str) -> u32 {
    name.bytes().fold(0x811c_9dc5, |sum, byte| {
        (sum ^ u32::from(byte)).wrapping_mul(0x0100_0193)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use embassy_futures::block_on;
    use embedded_storage_async::nor_flash::{
        ErrorType, NorFlashError, NorFlashErrorKind, ReadNorFlash,
    };
    use std::vec::Vec;

    const PAGE: usize = 1024;
    const SIZE: usize = 2 * PAGE;

    /// NOR flash whose power goes after so many bytes: writing clears bits, erasing sets a page's.
    #[derive(Clone)]
    struct Nor {
        bytes: Vec<u8>,
        power: usize,
        touched: usize,
    }

    #[derive(Debug)]
    struct PowerCut;

    impl NorFlashError for PowerCut {
        fn kind(&self) -> NorFlashErrorKind {
            NorFlashErrorKind::Other
        }
    }

    impl Nor {
        fn new() -> Self {
            Self {
                bytes: std::vec![0xff; SIZE],
                power: usize::MAX,
                touched: 0,
            }
        }

        fn touch(&mut self, at: usize, change: impl FnOnce(u8) -> u8) -> Result<(), PowerCut> {
            if self.touched == self.power {
                return Err(PowerCut);
            }
            self.touched += 1;
            self.bytes[at] = change(self.bytes[at]);
            Ok(())
        }
    }

    impl ErrorType for Nor {
        type Error = PowerCut;
    }

    impl ReadNorFlash for Nor {
        const READ_SIZE: usize = 1;

        async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), PowerCut> {
            let at = offset as usize;
            bytes.copy_from_slice(&self.bytes[at..at + bytes.len()]);
            Ok(())
        }

        fn capacity(&self) -> usize {
            SIZE
        }
    }

    impl NorFlash for Nor {
        const WRITE_SIZE: usize = 4;
        const ERASE_SIZE: usize = PAGE;

        async fn erase(&mut self, from: u32, to: u32) -> Result<(), PowerCut> {
            (from as usize..to as usize).try_for_each(|at| self.touch(at, |_| 0xff))
        }

        async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), PowerCut> {
            assert!(offset.is_multiple_of(4) && bytes.len().is_multiple_of(4));
            (offset as usize..)
                .zip(bytes)
                .try_for_each(|(at, &byte)| self.touch(at, |old| old & byte))
        }
    }

    fn records(nor: Nor) -> Records<Nor> {
        Records::new(nor, 0..SIZE as u32).unwrap()
    }

    fn nor(mut records: Records<Nor>) -> Nor {
        records.map.flash().clone()
    }

    /// Settings that differ from the defaults in every key that `change` may halve.
    fn changed(factor: f32) -> Settings {
        let mut settings = Settings::default();
        for known in Settings::KEYS {
            let value = settings.get(known.name).unwrap();
            // Some stand at the end of their range, and the two bounds have to keep their order.
            let _ = settings.set(known.name, value * factor);
        }
        settings.check().unwrap();
        settings
    }

    #[test]
    fn settings_are_the_defaults_on_first_start_and_come_back_as_saved() {
        let mut store = records(Nor::new());
        let found = block_on(store.load());
        assert_eq!(found.settings, Settings::default());
        assert_eq!((found.kept, found.refused), (0, 0));
        let settings = changed(0.95);
        block_on(store.save(&settings)).unwrap();
        let found = block_on(records(nor(store)).load());
        assert_eq!(found.settings, settings);
        assert_eq!(usize::from(found.kept), Settings::KEYS.len());
    }

    #[test]
    fn saving_the_same_again_writes_nothing() {
        let mut store = records(Nor::new());
        block_on(store.save(&changed(0.95))).unwrap();
        let mut store = records(Nor {
            power: 0,
            touched: 0,
            ..nor(store)
        });
        block_on(store.save(&changed(0.95))).unwrap();
    }

    #[test]
    fn power_may_go_after_any_byte() {
        // Enough saved before that the page is full and the next save has to move the records.
        let mut store = records(Nor::new());
        for factor in [0.9, 0.92, 0.94] {
            block_on(store.save(&changed(factor))).unwrap();
        }
        let old = changed(0.94);
        let base = nor(store);
        let new = changed(0.96);
        let mut power = 0;
        loop {
            let mut store = records(Nor {
                power,
                touched: 0,
                ..base.clone()
            });
            let whole = block_on(store.save(&new)).is_ok();
            let mut store = records(Nor {
                power: usize::MAX,
                touched: 0,
                ..nor(store)
            });
            let found = block_on(store.load());
            for known in Settings::KEYS {
                let value = found.settings.get(known.name);
                assert!(
                    value == old.get(known.name) || value == new.get(known.name),
                    "{} after {power} bytes: {value:?}",
                    known.name
                );
            }
            // What was cut is taken up again.
            block_on(store.save(&new)).unwrap();
            assert_eq!(block_on(store.load()).settings, new, "after {power} bytes");
            if whole {
                break;
            }
            power += 1;
        }
        // A page was erased on the way.
        assert!(power > PAGE, "{power}");
    }

    #[test]
    fn a_bad_record_does_not_lose_the_others() {
        let mut store = records(Nor::new());
        let settings = changed(0.95);
        block_on(store.save(&settings)).unwrap();
        let base = nor(store);
        let used = base.bytes.iter().rposition(|byte| *byte != 0xff).unwrap();
        let mut worst = 0;
        for at in 0..=used {
            let mut bad = base.clone();
            bad.bytes[at] ^= 0x10;
            let found = block_on(records(bad).load()).settings;
            let lost = Settings::KEYS
                .iter()
                .filter(|known| found.get(known.name) != settings.get(known.name))
                .count();
            worst = worst.max(lost);
            for known in Settings::KEYS {
                let value = found.get(known.name);
                assert!(
                    value == settings.get(known.name) || value == Some(known.default),
                    "{} with byte {at} bad: {value:?}",
                    known.name
                );
            }
            assert!(lost <= 1, "{lost} lost with byte {at} bad");
        }
        assert_eq!(worst, 1);
    }

    #[test]
    fn records_out_of_range_or_of_another_version_do_not_count() {
        let mut store = records(Nor::new());
        let mut room = [0; ROOM];
        let [a, b, c, d] = 1e6_f32.to_le_bytes();
        block_on(
            store
                .map
                .store_item(&mut room, &key("frequency"), &&[VERSION, a, b, c, d][..]),
        )
        .unwrap();
        let [a, b, c, d] = 40_f32.to_le_bytes();
        let other = [VERSION + 1, a, b, c, d];
        block_on(
            store
                .map
                .store_item(&mut room, &key("resonance"), &&other[..]),
        )
        .unwrap();
        let found = block_on(store.load());
        assert_eq!(found.settings, Settings::default());
        assert_eq!((found.kept, found.refused), (0, 1));
    }
}
