//! NOR flash in a file of the host computer, by semihosting. Its content outlives the emulator.

use cortex_m_semihosting::{nr, syscall};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};

const PAGE: usize = 4096;
const FAILED: usize = usize::MAX;

const FILE_FAILED: NorFlashErrorKind = NorFlashErrorKind::Other;

/// A file as NOR flash: writing clears bits, erasing sets the bits of a page. Ending the emulator
/// in between is a power cut.
pub struct FlashFile {
    /// `None`: a blank flash, and nothing can be written.
    handle: Option<usize>,
    length: usize,
}

impl FlashFile {
    /// Opens the file as flash of the file's size; with an empty name a blank flash.
    pub fn open(name: &str) -> Result<Self, NorFlashErrorKind> {
        if name.is_empty() {
            let (handle, length) = (None, 4 * PAGE);
            return Ok(Self { handle, length });
        }
        let mut path = [0; 257];
        let bytes = name.as_bytes();
        // The terminating zero stays.
        let place = path[..256].get_mut(..bytes.len());
        place.ok_or(FILE_FAILED)?.copy_from_slice(bytes);
        // SAFETY: SYS_OPEN takes a name that ends with a zero, a mode and the name's length.
        let handle = unsafe { syscall!(OPEN, path.as_ptr(), nr::open::RW_BINARY, bytes.len()) };
        // SAFETY: SYS_FLEN takes a file, and fails for one that is not open.
        let length = unsafe { syscall!(FLEN, handle) };
        if handle == FAILED || length == FAILED {
            return Err(FILE_FAILED);
        }
        let handle = Some(handle);
        Ok(Self { handle, length })
    }

    /// Ranges of the pages for settings, target and recipes, and of those for the event log.
    pub fn ranges(&self) -> [core::ops::Range<u32>; 2] {
        let (half, whole) = (self.length as u32 / 2, self.length as u32);
        [0..half, half..whole]
    }

    fn seek(&mut self, offset: u32) -> Result<usize, NorFlashErrorKind> {
        let handle = self.handle.ok_or(FILE_FAILED)?;
        // SAFETY: SYS_SEEK takes an open file and an offset in it.
        whole(unsafe { syscall!(SEEK, handle, offset) })?;
        Ok(handle)
    }

    fn put(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let handle = self.seek(offset)?;
        // SAFETY: SYS_WRITE reads this many bytes and returns how many it did not write.
        whole(unsafe { syscall!(WRITE, handle, bytes.as_ptr(), bytes.len()) })
    }
}

/// Requires that an operation left no bytes.
fn whole(left: usize) -> Result<(), NorFlashErrorKind> {
    (left == 0).then_some(()).ok_or(FILE_FAILED)
}

impl ErrorType for FlashFile {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for FlashFile {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        if self.handle.is_none() {
            bytes.fill(0xff);
            return Ok(());
        }
        let handle = self.seek(offset)?;
        // SAFETY: SYS_READ writes at most this many bytes and returns how many it did not.
        whole(unsafe { syscall!(READ, handle, bytes.as_mut_ptr(), bytes.len()) })
    }

    fn capacity(&self) -> usize {
        self.length
    }
}

impl NorFlash for FlashFile {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        let blank = [0xff; 256];
        for offset in (from..to).step_by(blank.len()) {
            self.put(offset, &blank)?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let mut word = [0; Self::WRITE_SIZE];
        let words = bytes.chunks_exact(Self::WRITE_SIZE);
        for (offset, bytes) in (offset..).step_by(Self::WRITE_SIZE).zip(words) {
            self.read(offset, &mut word).await?;
            for (old, new) in word.iter_mut().zip(bytes) {
                *old &= new;
            }
            self.put(offset, &word)?;
        }
        Ok(())
    }
}
