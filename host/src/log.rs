//! The log of a board: frames of defmt, decoded with the image that wrote them.

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

use defmt_decoder::{DecodeError, StreamDecoder, Table};

use crate::refusal::Refusal;

/// What an image can say.
pub struct Words(Table);

impl Words {
    /// Reads them from an image (ELF).
    pub fn read(image: &Path) -> Result<Self, Refusal> {
        let next =
            "give the image that runs on the board, such as the one that cargo feeder builds";
        let bytes = crate::file::read(image, next)?;
        match Table::parse(&bytes) {
            Ok(Some(table)) => Ok(Self(table)),
            Ok(None) => Err(Refusal::new(
                format!("{}: this image has no log", image.display()),
                next,
            )),
            Err(error) => Err(Refusal::new(
                format!("{}: its log cannot be read: {error}", image.display()),
                next,
            )),
        }
    }
}

/// Gives the bytes of a log that were written since the last call.
pub type Source = Box<dyn FnMut() -> Result<Vec<u8>, Refusal>>;

/// A log as it is written.
pub struct Log<'a> {
    more: Source,
    record: Option<File>,
    decoder: Box<dyn StreamDecoder + Send + Sync + 'a>,
    unreadable: u64,
}

impl<'a> Log<'a> {
    /// The log that `more` gives piece by piece, written by an image that says `words`.
    pub fn new(more: Source, words: &'a Words) -> Self {
        Self {
            more,
            record: None,
            decoder: words.0.new_stream_decoder(),
            unreadable: 0,
        }
    }

    /// The log in a file that may still grow, from its beginning.
    pub fn open(file: &Path, words: &'a Words) -> Result<Self, Refusal> {
        let next = "give the path of a recorded log, its bytes as the board wrote them";
        let mut opened = crate::file::open(file, next)?;
        let more = move || {
            let mut bytes = Vec::new();
            let read = opened.read_to_end(&mut bytes);
            read.map_err(|error| {
                Refusal::new(format!("the log cannot be read: {error}"), "try again")
            })?;
            Ok(bytes)
        };
        Ok(Self::new(Box::new(more), words))
    }

    /// Keeps the bytes that come from now on in a file.
    pub fn record(&mut self, file: File) {
        self.record = Some(file);
    }

    /// Frames so far that could not be read.
    pub fn unreadable(&self) -> u64 {
        self.unreadable
    }

    /// The lines that were added since the last call: time, level and words.
    pub fn lines(&mut self) -> Result<Vec<String>, Refusal> {
        let bytes = (self.more)()?;
        if let Some(record) = &mut self.record {
            record.write_all(&bytes).map_err(|error| {
                Refusal::new(
                    format!("the record of the log cannot be written: {error}"),
                    "make room, and start again",
                )
            })?;
        }
        self.decoder.received(&bytes);
        let mut lines = Vec::new();
        loop {
            match self.decoder.decode() {
                Ok(frame) => {
                    let level = frame.level().map_or("", |level| level.as_str());
                    let words = frame.display_message();
                    lines.push(match frame.display_timestamp() {
                        Some(time) => format!("log {time} {level}: {words}"),
                        None => format!("log {level}: {words}"),
                    });
                }
                Err(DecodeError::Malformed) => self.unreadable += 1,
                Err(DecodeError::UnexpectedEof) => return Ok(lines),
            }
        }
    }
}
