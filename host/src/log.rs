//! The log of a board: frames of defmt, decoded with the image that wrote them.

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

use defmt_decoder::{DecodeError, StreamDecoder, Table};

use crate::refusal::Refusal;

/// Format strings of an image's log.
pub struct Words(Table);

impl Words {
    /// Reads the format strings of an image (ELF).
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

/// Returns the bytes of a log since the last call.
pub type Source = Box<dyn FnMut() -> Result<Vec<u8>, Refusal>>;

/// Decoder of a growing log.
pub struct Log<'a> {
    more: Source,
    record: Option<File>,
    decoder: Box<dyn StreamDecoder + Send + Sync + 'a>,
    unreadable: u64,
}

impl<'a> Log<'a> {
    /// The log from `more`, of an image with the format strings `words`.
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

    /// From now on writes the received bytes to a file.
    pub fn record(&mut self, file: File) {
        self.record = Some(file);
    }

    /// Number of unreadable frames so far.
    pub fn unreadable(&self) -> u64 {
        self.unreadable
    }

    /// The lines since the last call: time, level and text.
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
