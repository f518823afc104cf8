//! A desk that talks to an image on the emulated CPU over its serial port.

use std::io::{Read, Write};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver as Bytes, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use kband_control::wire::{
    MAX_FRAME_BYTES, Outgoing, Receiver, Request, Response, read_answer, write_request,
};

/// Longest wait for an answer; on a busy machine the emulator runs far below the board's speed.
const PATIENCE: Duration = Duration::from_secs(20);

/// A connection to one image; dropping it ends the image.
pub struct Desk {
    child: Child,
    input: ChildStdin,
    bytes: Bytes<Vec<u8>>,
    waiting: std::collections::VecDeque<u8>,
    receiver: Receiver,
}

impl Desk {
    /// Starts the image of `command`, which has its own time limit.
    ///
    /// # Panics
    /// If the image does not start.
    pub fn start(mut command: Command) -> Self {
        let mut child = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("tests/emulator starts");
        let input = child.stdin.take().expect("standard input is a pipe");
        let mut output = child.stdout.take().expect("standard output is a pipe");
        let (send, bytes) = channel();
        // The thread ends with the pipe, the pipe with the image.
        std::thread::spawn(move || {
            let mut buffer = [0; 256];
            while let Ok(count @ 1..) = output.read(&mut buffer) {
                if send.send(buffer[..count].to_vec()).is_err() {
                    break;
                }
            }
        });
        Self {
            child,
            input,
            bytes,
            waiting: std::collections::VecDeque::new(),
            receiver: Receiver::new(),
        }
    }

    /// Sends bytes as they are.
    ///
    /// # Panics
    /// If the image has ended.
    pub fn send(&mut self, bytes: &[u8]) {
        self.input
            .write_all(bytes)
            .and_then(|()| self.input.flush())
            .expect("the image listens");
    }

    /// The next valid frame.
    ///
    /// # Panics
    /// If no frame arrives in time.
    pub fn receive<T>(&mut self, look: impl FnOnce(Outgoing<'_>) -> T) -> T {
        let end = Instant::now() + PATIENCE;
        loop {
            while let Some(byte) = self.waiting.pop_front() {
                if let Some(Ok(inside)) = self.receiver.push(byte)
                    && let Ok(answer) = read_answer(inside)
                {
                    return look(answer);
                }
            }
            let left = end.saturating_duration_since(Instant::now());
            match self.bytes.recv_timeout(left) {
                Ok(bytes) => self.waiting.extend(bytes),
                Err(RecvTimeoutError::Timeout) => panic!("no answer in {PATIENCE:?}"),
                Err(RecvTimeoutError::Disconnected) => panic!("the image is gone"),
            }
        }
    }

    /// Sends a request and passes the answer to `look`; frames without a request are skipped.
    ///
    /// # Panics
    /// If no answer arrives in time.
    pub fn ask<T>(&mut self, request: &Request<'_>, look: impl FnOnce(Response<'_>) -> T) -> T {
        let mut buffer = [0; MAX_FRAME_BYTES];
        let frame = write_request(&mut buffer, 1, request).expect("the request fits a frame");
        let frame = frame.to_vec();
        self.send(&frame);
        let mut look = Some(look);
        for _ in 0..10_000 {
            let answer = self.receive(|answer| match answer {
                Outgoing::Response {
                    sequence: 1,
                    response,
                } => look.take().map(|look| look(response)),
                _ => None,
            });
            if let Some(answer) = answer {
                return answer;
            }
        }
        panic!("telemetry and no answer");
    }
}

impl Drop for Desk {
    fn drop(&mut self) {
        // The emulator's time limit is its parent process and passes this signal on.
        let _ = Command::new("kill")
            .arg(self.child.id().to_string())
            .status();
        let end = Instant::now() + Duration::from_secs(5);
        while Instant::now() < end {
            if let Ok(Some(_)) = self.child.try_wait() {
                return;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
