//! The line of the bus between its interrupts and its task: one frame, in one direction at a time.
//!
//! The interrupts own the frame while they receive or send it, the task while it answers. The
//! silence of 3.5 characters ends a frame; the millisecond clock detects it.

use core::future::{Future, poll_fn};
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering};
use core::task::Poll;
use embassy_sync::waitqueue::AtomicWaker;
use kband_bus::rtu::MAX_FRAME_BYTES;

const RECEIVING: u8 = 0;
const ANSWERING: u8 = 1;
const SENDING: u8 = 2;

/// A frame and its owner.
pub struct BusLine {
    owner: AtomicU8,
    /// Number of bytes received, or to be sent.
    length: AtomicU32,
    sent: AtomicU32,
    /// Time of the last byte, us.
    last: AtomicU32,
    /// Silence that ends a frame, us.
    silence: AtomicU32,
    /// Whether a byte was damaged, in excess, or received while the task answers.
    damaged: AtomicBool,
    bytes: [AtomicU8; MAX_FRAME_BYTES],
    waker: AtomicWaker,
}

impl BusLine {
    /// A line that listens.
    pub const fn listening() -> Self {
        Self {
            owner: AtomicU8::new(RECEIVING),
            length: AtomicU32::new(0),
            sent: AtomicU32::new(0),
            last: AtomicU32::new(0),
            silence: AtomicU32::new(0),
            damaged: AtomicBool::new(false),
            bytes: [const { AtomicU8::new(0) }; MAX_FRAME_BYTES],
            waker: AtomicWaker::new(),
        }
    }

    /// Drops the frame and listens, with this silence in us.
    pub fn restart(&self, silence: u32) {
        self.silence.store(silence, Ordering::Relaxed);
        self.listen();
    }

    /// Drops the frame and listens.
    pub fn listen(&self) {
        self.length.store(0, Ordering::Relaxed);
        self.damaged.store(false, Ordering::Relaxed);
        self.owner.store(RECEIVING, Ordering::Release);
    }

    /// Takes a byte, `None` for a damaged one; for the port's interrupt. `now` in us, wrapping.
    pub fn receive(&self, byte: Option<u8>, now: u32) {
        match self.owner.load(Ordering::Acquire) {
            RECEIVING => {}
            // The answer would collide with this byte.
            ANSWERING => return self.damaged.store(true, Ordering::Relaxed),
            // The echo of a sent byte.
            _ => return,
        }
        let mut at = self.length.load(Ordering::Relaxed);
        if at > 0 && self.is_silent(now) {
            at = 0;
            self.damaged.store(false, Ordering::Relaxed);
        }
        self.last.store(now, Ordering::Relaxed);
        match (byte, self.bytes.get(at as usize)) {
            (Some(byte), Some(place)) => place.store(byte, Ordering::Relaxed),
            _ => self.damaged.store(true, Ordering::Relaxed),
        }
        let length = (at + 1).min(MAX_FRAME_BYTES as u32);
        self.length.store(length, Ordering::Relaxed);
    }

    /// Hands a frame to the task once it is followed by silence; for the millisecond clock. `now`
    /// in us, wrapping.
    pub fn poll(&self, now: u32) {
        let complete = self.owner.load(Ordering::Acquire) == RECEIVING
            && self.length.load(Ordering::Relaxed) > 0
            && self.is_silent(now);
        if complete {
            if self.damaged.load(Ordering::Relaxed) {
                // No bytes: the task counts a damaged frame.
                self.length.store(0, Ordering::Relaxed);
                self.damaged.store(false, Ordering::Relaxed);
            }
            self.owner.store(ANSWERING, Ordering::Release);
            self.waker.wake();
        }
    }

    fn is_silent(&self, now: u32) -> bool {
        let since = now.wrapping_sub(self.last.load(Ordering::Relaxed));
        since >= self.silence.load(Ordering::Relaxed)
    }

    /// Whether a frame waits for its answer.
    pub fn is_waiting(&self) -> bool {
        self.owner.load(Ordering::Acquire) == ANSWERING
    }

    /// Waits for a frame, copies it and returns its length. Its bytes belong to the task until
    /// [`BusLine::send`] or [`BusLine::listen`].
    pub fn frame(&self, buffer: &mut [u8; MAX_FRAME_BYTES]) -> impl Future<Output = usize> {
        poll_fn(|context| {
            self.waker.register(context.waker());
            if !self.is_waiting() {
                return Poll::Pending;
            }
            let length = self.length.load(Ordering::Relaxed) as usize;
            for (byte, cell) in buffer.iter_mut().zip(&self.bytes).take(length) {
                *byte = cell.load(Ordering::Relaxed);
            }
            Poll::Ready(length)
        })
    }

    /// Hands an answer to the sending interrupt. Returns false, and listens, if a byte arrived
    /// meanwhile or the answer is empty or too long.
    pub fn send(&self, answer: &[u8]) -> bool {
        let disturbed = self.damaged.load(Ordering::Relaxed);
        if disturbed || answer.is_empty() || answer.len() > MAX_FRAME_BYTES {
            self.listen();
            return false;
        }
        for (cell, byte) in self.bytes.iter().zip(answer) {
            cell.store(*byte, Ordering::Relaxed);
        }
        self.length.store(answer.len() as u32, Ordering::Relaxed);
        self.sent.store(0, Ordering::Relaxed);
        self.owner.store(SENDING, Ordering::Release);
        true
    }

    /// The next byte to send; `None` after the last one; for the port's interrupt.
    pub fn next(&self) -> Option<u8> {
        if self.owner.load(Ordering::Acquire) != SENDING {
            return None;
        }
        let at = self.sent.load(Ordering::Relaxed);
        if at >= self.length.load(Ordering::Relaxed) {
            return None;
        }
        self.sent.store(at + 1, Ordering::Relaxed);
        let byte = self.bytes.get(at as usize)?;
        Some(byte.load(Ordering::Relaxed))
    }

    /// Listens after the last stop bit of the answer; for the port's interrupt.
    pub fn end_sending(&self) {
        if self.owner.load(Ordering::Acquire) == SENDING {
            self.listen();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use embassy_futures::block_on;
    use std::vec::Vec;

    const SILENCE: u32 = 1000;

    /// A line that has received these bytes, one every 100 us from `at` on.
    fn received(line: &BusLine, at: u32, bytes: &[Option<u8>]) -> u32 {
        let mut now = at;
        for byte in bytes {
            now = now.wrapping_add(100);
            line.receive(*byte, now);
        }
        now
    }

    fn frame(line: &BusLine) -> Vec<u8> {
        let mut buffer = [0; MAX_FRAME_BYTES];
        let length = block_on(line.frame(&mut buffer));
        buffer[..length].to_vec()
    }

    fn line() -> BusLine {
        let line = BusLine::listening();
        line.restart(SILENCE);
        line
    }

    #[test]
    fn silence_ends_a_frame() {
        let line = line();
        // The counter wraps within the frame.
        let last = received(&line, u32::MAX - 150, &[Some(1), Some(2), Some(3)]);
        line.poll(last.wrapping_add(SILENCE - 1));
        assert!(!line.is_waiting());
        line.poll(last.wrapping_add(SILENCE));
        assert!(line.is_waiting());
        assert_eq!(frame(&line), [1, 2, 3]);
        line.listen();
        line.poll(last.wrapping_add(10 * SILENCE));
        assert!(!line.is_waiting(), "nothing came");
    }

    #[test]
    fn a_byte_after_silence_begins_another_frame() {
        let line = line();
        let last = received(&line, 0, &[Some(1), None]);
        let last = received(&line, last + SILENCE, &[Some(7), Some(8)]);
        line.poll(last + SILENCE);
        assert_eq!(frame(&line), [7, 8]);
    }

    #[test]
    fn a_damaged_or_overlong_frame_is_empty() {
        for damage in [
            &[Some(1), None, Some(3)][..],
            &[Some(0); MAX_FRAME_BYTES + 1],
        ] {
            let line = line();
            let last = received(&line, 0, damage);
            line.poll(last + SILENCE);
            assert!(frame(&line).is_empty());
            assert!(line.send(&[1]), "the damage is forgotten");
        }
        let line = line();
        let last = received(&line, 0, &[Some(0); MAX_FRAME_BYTES]);
        line.poll(last + SILENCE);
        assert_eq!(frame(&line).len(), MAX_FRAME_BYTES);
    }

    #[test]
    fn an_answer_is_sent_whole_and_then_the_line_listens() {
        let line = line();
        let last = received(&line, 0, &[Some(1)]);
        line.poll(last + SILENCE);
        assert_eq!(line.next(), None);
        assert!(line.send(&[4, 5]));
        // The echo on the line is ignored.
        assert_eq!(line.next(), Some(4));
        received(&line, last, &[Some(4)]);
        assert_eq!(line.next(), Some(5));
        assert_eq!(line.next(), None);
        line.poll(last + 5 * SILENCE);
        assert!(!line.is_waiting());
        line.end_sending();
        let last = received(&line, 0, &[Some(9)]);
        line.poll(last + SILENCE);
        assert_eq!(frame(&line), [9]);
    }

    #[test]
    fn an_answer_does_not_collide_with_a_new_request() {
        let line = line();
        let last = received(&line, 0, &[Some(1)]);
        line.poll(last + SILENCE);
        assert_eq!(frame(&line), [1]);
        received(&line, last + SILENCE, &[Some(2)]);
        assert!(!line.send(&[4]));
        assert_eq!(line.next(), None);
        assert!(!line.is_waiting());
        line.poll(last + SILENCE);
        assert!(!line.send(&[]) && !line.send(&[0; MAX_FRAME_BYTES + 1]));
    }
}
