//! The log of a board, decoded with the image that writes it.

use std::cell::OnceCell;

use kband_host::log::{Log, Words};
use kband_machines::emulator::Machine;
use kband_machines::images;

thread_local! {
    static WORDS: OnceCell<&'static Words> = const { OnceCell::new() };
}

/// Log messages of the default board's image: the file in `KBAND_IMAGE`, or a built one.
fn words() -> &'static Words {
    let read = || {
        let image = match std::env::var_os("KBAND_IMAGE") {
            Some(file) => file.into(),
            None => images::build("kband-firmware", "feeder", Machine::CortexM4F),
        };
        let words = Words::read(&image).unwrap_or_else(|refusal| panic!("{refusal}"));
        Box::leak(Box::new(words)) as &'static Words
    };
    WORDS.with(|words| *words.get_or_init(read))
}

/// Bytes of a log, in two pieces.
pub fn log(input: &[u8]) -> bool {
    let (first, second) = input.split_at(input.len() / 2);
    let mut pieces = vec![second.to_vec(), first.to_vec()];
    let source = Box::new(move || Ok(pieces.pop().unwrap_or_default()));
    let mut log = Log::new(source, words());
    let mut lines = 0;
    for _ in 0..3 {
        lines += log.lines().expect("a log is read on").len();
    }
    assert!(lines as u64 + log.unreadable() <= input.len() as u64 + 3);
    lines > 0
}
