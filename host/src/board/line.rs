//! Requests to a board and its answers, each with a time limit.

use std::collections::VecDeque;
use std::fs::OpenOptions;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver as Bytes, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use kband::wire::{
    FRAME_MOST, Outgoing, Receiver, Refusal as Refused, Request, Response, SCHEMA, VERSION,
    read_answer, write_question, write_request,
};

use super::tether::tether;
use crate::refusal::Refusal;

/// Longest wait for an answer; an emulated board on a busy machine is far below its speed.
const PATIENCE: Duration = Duration::from_secs(10);
/// Time between two questions who is there.
const KNOCK: Duration = Duration::from_millis(500);
/// Where the emulated image lies in a clone of the project.
const IMAGE: &str = "target/thumbv7em-none-eabihf/firmware/virtual_feeder";

/// The line to one board. An emulated board ends with it.
pub struct Line {
    name: String,
    emulator: Option<Child>,
    output: Box<dyn Write + Send>,
    input: Bytes<Vec<u8>>,
    waiting: VecDeque<u8>,
    receiver: Receiver,
    sequence: u8,
}

impl Line {
    /// Opens the line to `qemu`, the emulated CPU running `image`, or to the board on a serial port;
    /// a board of another version is refused.
    pub fn open(on: &str, image: Option<&Path>) -> Result<Self, Refusal> {
        let mut line = if on == "qemu" {
            Self::emulate(image)?
        } else {
            Self::serial(Path::new(on))?
        };
        line.identify()?;
        Ok(line)
    }

    fn emulate(image: Option<&Path>) -> Result<Self, Refusal> {
        let image = image.map_or_else(|| PathBuf::from(IMAGE), Path::to_path_buf);
        if !image.is_file() {
            return Err(Refusal::new(
                format!(
                    "{}: there is no image for the emulated CPU",
                    image.display()
                ),
                "cargo build -p kband-firmware --profile firmware --target thumbv7em-none-eabihf \
                 --bin virtual_feeder, or name it with --image",
            ));
        }
        let mut command = Command::new("qemu-system-arm");
        tether(&mut command);
        let mut child = command
            .args([
                "-M",
                "olimex-stm32-h405",
                "-display",
                "none",
                "-monitor",
                "none",
            ])
            .args(["-serial", "null", "-serial", "stdio", "-semihosting-config"])
            .arg("enable=on,target=native,arg=image,arg=link")
            .arg("-kernel")
            .arg(&image)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(|error| {
                Refusal::new(
                    format!("qemu-system-arm does not start: {error}"),
                    "run tests/setup.sh, which installs it",
                )
            })?;
        let (Some(output), Some(input)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(Refusal::new(
                "qemu-system-arm has no pipes",
                "close other programs and try again",
            ));
        };
        Ok(Self::over("qemu".to_string(), output, input, Some(child)))
    }

    fn serial(path: &Path) -> Result<Self, Refusal> {
        let name = path.display().to_string();
        let open = || OpenOptions::new().read(true).write(true).open(path);
        let refuse = |error: std::io::Error| {
            Refusal::value(
                "--on",
                &name,
                "qemu, or a serial port such as /dev/ttyACM0",
                format!("{error}: plug in the board and look at its port's name"),
            )
        };
        let output = open().map_err(refuse)?;
        let set = Command::new("stty")
            .arg("-F")
            .arg(path)
            .args(["115200", "raw", "-echo", "-ixon"])
            .stdin(Stdio::null())
            .stderr(Stdio::null())
            .status();
        if !set.is_ok_and(|status| status.success()) {
            return Err(refuse(std::io::Error::other("it is no serial port")));
        }
        let input = open().map_err(refuse)?;
        Ok(Self::over(name, output, input, None))
    }

    fn over(
        name: String,
        output: impl Write + Send + 'static,
        mut input: impl Read + Send + 'static,
        emulator: Option<Child>,
    ) -> Self {
        let (send, bytes) = channel();
        // The thread ends with the line's far end, or with the program.
        std::thread::spawn(move || {
            let mut buffer = [0; 1024];
            while let Ok(count @ 1..) = input.read(&mut buffer) {
                if send.send(buffer[..count].to_vec()).is_err() {
                    break;
                }
            }
        });
        Self {
            name,
            emulator,
            output: Box::new(output),
            input: bytes,
            waiting: VecDeque::new(),
            receiver: Receiver::new(),
            sequence: 0,
        }
    }

    /// Asks, and looks at the answer; what is sent unasked is passed over.
    pub fn ask<T>(
        &mut self,
        request: &Request<'_>,
        look: impl FnOnce(Response<'_>) -> T,
    ) -> Result<T, Refusal> {
        // 0 is what is sent unasked.
        self.sequence = self.sequence % 255 + 1;
        let wanted = self.sequence;
        let mut buffer = [0; FRAME_MOST];
        let frame = write_request(&mut buffer, wanted, request)
            .map_err(|_| Refusal::new("a request is too long for a frame", "shorten its text"))?;
        self.send(frame)?;
        let mut look = Some(look);
        self.receive(Instant::now() + PATIENCE, |answer| match answer {
            Outgoing::Response { sequence, response } if sequence == wanted => {
                look.take().map(|look| look(response))
            }
            _ => None,
        })?
        .ok_or_else(|| self.silent())
    }

    /// Asks for something to be done.
    pub fn tell(&mut self, request: &Request<'_>) -> Result<(), Refusal> {
        let name = self.name.clone();
        self.ask(request, |response| match response {
            Response::Done => Ok(()),
            Response::Refused(refused) => Err(refusal(&name, refused)),
            other => Err(Refusal::new(
                format!("{name} answered something else: {other:?}"),
                "reset the board",
            )),
        })?
    }

    fn identify(&mut self) -> Result<(), Refusal> {
        let mut buffer = [0; FRAME_MOST];
        let question = write_question(&mut buffer, 0)
            .map(<[u8]>::to_vec)
            .unwrap_or_default();
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end {
            self.send(&question)?;
            let identity = self.receive(Instant::now() + KNOCK, |answer| match answer {
                Outgoing::Identity { identity, .. } => Some((
                    identity.version,
                    identity.schema,
                    identity.image.to_string(),
                )),
                Outgoing::Response { .. } => None,
            })?;
            match identity {
                Some((VERSION, SCHEMA, _)) => return Ok(()),
                Some((version, schema, image)) => {
                    return Err(Refusal::new(
                        format!(
                            "{} runs kband {image}, which speaks version {version}, schema {schema:08x}; \
                             this desk speaks {VERSION}, {SCHEMA:08x}",
                            self.name
                        ),
                        "flash the firmware that belongs to this desk",
                    ));
                }
                None => {}
            }
        }
        Err(self.silent())
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), Refusal> {
        self.output
            .write_all(frame)
            .and_then(|()| self.output.flush())
            .map_err(|error| {
                Refusal::new(
                    format!("{}: the line broke: {error}", self.name),
                    "look whether the board is still there",
                )
            })
    }

    /// The first frame that `look` finds something in, or none until `end`.
    fn receive<T>(
        &mut self,
        end: Instant,
        mut look: impl FnMut(Outgoing<'_>) -> Option<T>,
    ) -> Result<Option<T>, Refusal> {
        loop {
            while let Some(byte) = self.waiting.pop_front() {
                if let Some(Ok(inside)) = self.receiver.take(byte)
                    && let Ok(answer) = read_answer(inside)
                    && let Some(found) = look(answer)
                {
                    return Ok(Some(found));
                }
            }
            match self
                .input
                .recv_timeout(end.saturating_duration_since(Instant::now()))
            {
                Ok(bytes) => self.waiting.extend(bytes),
                Err(RecvTimeoutError::Timeout) => return Ok(None),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(Refusal::new(
                        format!("{} ended", self.name),
                        "look whether the board or the emulator is still there",
                    ));
                }
            }
        }
    }

    fn silent(&self) -> Refusal {
        Refusal::new(
            format!("{} does not answer", self.name),
            "look whether the board runs kband and no other program holds its port",
        )
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        if let Some(emulator) = &mut self.emulator {
            let _ = emulator.kill();
            let _ = emulator.wait();
        }
    }
}

fn refusal(name: &str, refused: Refused<'_>) -> Refusal {
    match refused {
        Refused::OutOfRange {
            parameter,
            accepted,
        } => Refusal::new(
            format!("{name} refuses {parameter}: it accepts {accepted}"),
            "change the value",
        ),
        Refused::Running => Refusal::new(
            format!("{name} is running its drive"),
            "withdraw the enable input first",
        ),
        Refused::Unknown => Refusal::new(
            format!("{name} does not know this setting"),
            "kband settings lists those it knows",
        ),
        Refused::Store => Refusal::new(
            format!("{name} could not keep its settings"),
            "the flash may be worn: reset the board and try again",
        ),
        Refused::OutOfStep => Refusal::new(
            format!("{name} and the desk fell out of step"),
            "reset the board and start again",
        ),
    }
}
