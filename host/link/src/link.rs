//! Requests to a board and its responses, over a serial port or to an emulated board. The method is
//! stop-and-wait with sequence numbers: an idempotent request is repeated every 0.5 s for up to 10
//! s. Telemetry, which a board sends without a request, is kept in a queue.

use std::collections::VecDeque;
use std::io::{Read, Write};
use std::path::Path;
use std::process::Child;
use std::sync::mpsc::{Receiver as Bytes, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use kband_control::Target;
use kband_control::wire::{
    Access, Identity, MAX_FRAME_BYTES, Outgoing, Receiver, Record, Refusal as Refused, Request,
    Response, SCHEMA, Status, Telemetry, UpdateAnswer, UpdateRequest, VERSION, read_answer,
    write_identity, write_identity_request, write_request, write_update_request,
};

use kband_scene::refusal::Refusal;

use crate::{Emulated, emulator, serial};

/// Longest wait for a response; an emulated board on a busy machine is far slower than real time.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(10);
const RETRY_INTERVAL: Duration = Duration::from_millis(500);
/// Largest number of queued messages without a request: over a minute at 50 Hz.
const MAX_UNSOLICITED: usize = 4096;

/// One message of a board; those without a request are telemetry and starts.
#[derive(Clone, Debug, PartialEq)]
pub enum BoardMessage {
    /// A drive cycle.
    Telemetry(Telemetry),
    /// A record of the event log.
    Event(Record),
    /// The board restarted, with this image.
    Started(String),
    /// Key and value of a setting.
    Setting(String, f32),
}

impl BoardMessage {
    /// The message in a frame with this sequence number; `None` for other frames.
    pub fn from_frame((sequence, frame): (u8, Outgoing<'_>)) -> Option<Self> {
        match frame {
            Outgoing::Identity(identity) => {
                (sequence == 0).then(|| Self::Started(identity.image.into()))
            }
            Outgoing::Response(response) => Self::from_response(response),
            Outgoing::Update(_) => None,
        }
    }

    /// The message in a response; `None` for other responses.
    pub fn from_response(response: Response<'_>) -> Option<Self> {
        match response {
            Response::Telemetry(telemetry) => Some(Self::Telemetry(telemetry)),
            Response::Event(event) => event.map(Self::Event),
            Response::Setting(setting) => Some(Self::Setting(setting.key.into(), setting.value)),
            _ => None,
        }
    }
}

/// Called during a wait; a refusal ends the wait.
pub type CheckStop = Box<dyn FnMut() -> Result<(), Refusal> + Send>;
const STOP_POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Link to one board. Dropping it ends an emulated board.
pub struct Link {
    name: String,
    emulator: Option<Child>,
    output: Box<dyn Write + Send>,
    input: Bytes<Vec<u8>>,
    waiting: VecDeque<u8>,
    receiver: Receiver,
    sequence: u8,
    answer_timeout: Duration,
    protocol: (u8, u32),
    image: String,
    bytes_received: usize,
    unreadable: u32,
    unsolicited: VecDeque<BoardMessage>,
    record: Option<Box<dyn Write + Send>>,
    check_stop: CheckStop,
    over: bool,
}

impl Link {
    /// Link to the emulated CPU, which runs `image` and keeps its settings in the file `flash`.
    pub fn emulate(
        [image, flash]: [Option<&Path>; 2],
        emulated: Emulated,
        check_stop: CheckStop,
    ) -> Result<Self, Refusal> {
        let mut child = emulator::start(image, emulated, flash)?;
        let (Some(output), Some(input)) = (child.stdin.take(), child.stdout.take()) else {
            let cause = "qemu-system-arm has no pipes";
            return Err(Refusal::new(cause, "close other programs and try again"));
        };
        Self::over("qemu".to_string(), output, input, Some(child), check_stop)
    }

    /// Link to the board on a serial port; `check_stop` is called during a wait.
    pub fn open(path: &Path, check_stop: CheckStop) -> Result<Self, Refusal> {
        let output = serial::open(path)?;
        let next = "close other programs and try again";
        let input = output.try_clone();
        let input = input.map_err(|error| Refusal::file(path, &error, next))?;
        Self::over(path.display().to_string(), output, input, None, check_stop)
    }

    /// Link over a writer to a board and a reader from it; an emulator ends with the link.
    fn over(
        name: String,
        output: impl Write + Send + 'static,
        mut input: impl Read + Send + 'static,
        emulator: Option<Child>,
        check_stop: CheckStop,
    ) -> Result<Self, Refusal> {
        let (send, bytes) = channel();
        // The thread ends when the other end closes, or with the program.
        std::thread::spawn(move || {
            let mut buffer = [0; 1024];
            while let Ok(count @ 1..) = input.read(&mut buffer) {
                if send.send(buffer[..count].to_vec()).is_err() {
                    break;
                }
            }
        });
        let mut link = Self {
            name,
            emulator,
            output: Box::new(output),
            input: bytes,
            waiting: VecDeque::new(),
            receiver: Receiver::new(),
            sequence: 0,
            answer_timeout: ANSWER_TIMEOUT,
            protocol: (0, 0),
            image: String::new(),
            bytes_received: 0,
            unreadable: 0,
            unsolicited: VecDeque::new(),
            record: None,
            check_stop,
            over: false,
        };
        link.identify()?;
        Ok(link)
    }

    /// Name of the connection: qemu or the port.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Name, version and build of the board's image.
    pub fn image(&self) -> &str {
        &self.image
    }

    /// Whether the other end is closed: the port or the emulator.
    pub fn is_over(&self) -> bool {
        self.over
    }

    /// Version and schema of the link protocol on the board.
    pub fn protocol(&self) -> (u8, u32) {
        self.protocol
    }

    /// Number of unreadable frames so far.
    pub fn unreadable(&self) -> u32 {
        self.unreadable
    }

    /// Instruction for the user on how to write the firmware of this version to the board.
    pub fn fitting_firmware(&self) -> String {
        let build = emulator::BUILD;
        match self.emulator {
            Some(_) => format!("build the image that belongs to this desk, {build}"),
            None => {
                "flash the firmware that belongs to this desk (kband flash or kband update)".into()
            }
        }
    }

    /// Refuses a board with another version or schema of the link protocol.
    pub fn check_protocol(&self) -> Result<(), Refusal> {
        if self.protocol == (VERSION, SCHEMA) {
            return Ok(());
        }
        let ((version, schema), image) = (self.protocol, &self.image);
        let cause = format!(
            "{} runs kband {image}, which speaks version {version}, schema {schema:08x}; \
             this desk speaks {VERSION}, {SCHEMA:08x}",
            self.name
        );
        Err(Refusal::new(cause, self.fitting_firmware()))
    }

    /// From now on writes the board's identity, and every byte from the board, to `record`.
    pub fn record(&mut self, mut record: impl Write + Send + 'static) -> Result<(), Refusal> {
        let (version, schema) = self.protocol;
        let identity = Identity {
            version,
            schema,
            image: &self.image,
        };
        let mut buffer = [0; MAX_FRAME_BYTES];
        if let Ok(frame) = write_identity(&mut buffer, 0, &identity) {
            record.write_all(frame).map_err(unrecorded)?;
        }
        self.record = Some(Box::new(record));
        Ok(())
    }

    /// Sets the longest wait for a response; returns the one before.
    pub fn set_answer_timeout(&mut self, answer_timeout: Duration) -> Duration {
        std::mem::replace(&mut self.answer_timeout, answer_timeout)
    }

    /// Waits for `time`; returns the messages without a request, oldest first.
    pub fn listen(&mut self, time: Duration) -> Result<Vec<BoardMessage>, Refusal> {
        self.receive(Instant::now() + time, |_| None::<()>)?;
        Ok(self.unsolicited.drain(..).collect())
    }

    /// Sends a request and passes its response to `handle`.
    pub fn request<T>(
        &mut self,
        request: &Request<'_>,
        handle: impl FnOnce(Response<'_>) -> T,
    ) -> Result<T, Refusal> {
        let sequence = self.next_sequence();
        let mut buffer = [0; MAX_FRAME_BYTES];
        let frame = write_request(&mut buffer, sequence, request).map_err(|_| too_long())?;
        let is_idempotent = !matches!(request, Request::Samples { .. } | Request::Simulate { .. });
        let mut handle = Some(handle);
        let timeout = self.answer_timeout;
        self.exchange(frame, timeout, is_idempotent, |answer| match answer {
            (same, Outgoing::Response(response)) if same == sequence => {
                handle.take().map(|handle| handle(response))
            }
            _ => None,
        })
    }

    pub(crate) fn request_update<T>(
        &mut self,
        request: &UpdateRequest<'_>,
        handle: impl FnOnce(UpdateAnswer<'_>) -> T,
    ) -> Result<T, Refusal> {
        let sequence = self.next_sequence();
        let mut buffer = [0; MAX_FRAME_BYTES];
        let frame = write_update_request(&mut buffer, sequence, request).map_err(|_| too_long())?;
        let mut handle = Some(handle);
        self.exchange(frame, self.answer_timeout, true, |answer| match answer {
            (same, Outgoing::Update(answer)) if same == sequence => {
                handle.take().map(|handle| handle(answer))
            }
            _ => None,
        })
    }

    /// Sequence number of the next request; 0 is reserved for messages without a request.
    fn next_sequence(&mut self) -> u8 {
        self.sequence = self.sequence % 255 + 1;
        self.sequence
    }

    /// Sends a frame until `handle` finds its response. A board drops requests beyond its limit per
    /// drive cycle, and a link may lose a frame. `is_idempotent` repeats an idempotent request.
    fn exchange<T>(
        &mut self,
        frame: &[u8],
        timeout: Duration,
        is_idempotent: bool,
        mut handle: impl FnMut((u8, Outgoing<'_>)) -> Option<T>,
    ) -> Result<T, Refusal> {
        let end = Instant::now() + timeout;
        while Instant::now() < end {
            self.send(frame)?;
            let retry = Instant::now() + RETRY_INTERVAL;
            let until = if is_idempotent { retry } else { end };
            if let Some(value) = self.receive(until, &mut handle)? {
                return Ok(value);
            }
        }
        Err(self.no_answer())
    }

    /// Sends a command; an error says why the board refused it.
    pub fn command(&mut self, request: &Request<'_>) -> Result<(), Refusal> {
        let name = self.name.clone();
        self.request(request, |response| match response {
            Response::Done => Ok(()),
            Response::Refused(refused) => Err(refusal(&name, refused)),
            other => Err(reset(format!(
                "{name} sent an unexpected answer: {other:?}"
            ))),
        })?
    }

    /// Begins telemetry at a period in drive cycles, or at the highest rate of the line.
    pub fn begin_telemetry(&mut self, every: u16) -> Result<(), Refusal> {
        let min_period = self.request(&Request::Telemetry(every), |response| match response {
            Response::Refused(Refused::Faster(min_period)) => Some(min_period),
            _ => None,
        })?;
        self.command(&Request::Telemetry(min_period.unwrap_or(every)))
    }

    /// The board's status; `None` from a firmware that does not send it.
    pub fn status(&mut self) -> Result<Option<Status>, Refusal> {
        self.request(&Request::Status, |response| match response {
            Response::Status(status) => Some(status),
            _ => None,
        })
    }

    /// Target that the board holds, from any source.
    pub fn target(&mut self) -> Result<Target, Refusal> {
        self.request(&Request::Held, |response| match response {
            Response::Held(target) => Ok(target),
            other => {
                let cause = format!("the board answered the request for its target with {other:?}");
                Err(reset(cause))
            }
        })?
    }

    /// Requests the board's identity again.
    pub fn identify(&mut self) -> Result<(), Refusal> {
        let mut buffer = [0; MAX_FRAME_BYTES];
        // A starting board sends its identity with sequence 0.
        let question = write_identity_request(&mut buffer, 1).unwrap_or_default();
        let read = |(_, answer): (u8, Outgoing<'_>)| match answer {
            Outgoing::Identity(identity) => {
                let protocol = (identity.version, identity.schema);
                Some((protocol, identity.image.to_string()))
            }
            Outgoing::Response(_) | Outgoing::Update(_) => None,
        };
        (self.protocol, self.image) = self.exchange(question, ANSWER_TIMEOUT, true, read)?;
        self.unsolicited.clear();
        Ok(())
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), Refusal> {
        let sent = self.output.write_all(frame);
        sent.and_then(|()| self.output.flush()).map_err(|error| {
            let cause = format!("{}: the link broke: {error}", self.name);
            Refusal::new(cause, "check that the board is connected")
        })
    }

    /// First result of `handle` over the received frames; `None` if there is none until `end`.
    fn receive<T>(
        &mut self,
        end: Instant,
        mut handle: impl FnMut((u8, Outgoing<'_>)) -> Option<T>,
    ) -> Result<Option<T>, Refusal> {
        loop {
            while let Some(byte) = self.waiting.pop_front() {
                let Some(frame) = self.receiver.push(byte) else {
                    continue;
                };
                let Ok(answer) = frame.and_then(read_answer) else {
                    self.unreadable = self.unreadable.wrapping_add(1);
                    continue;
                };
                if answer.0 == 0 {
                    self.unsolicited.extend(BoardMessage::from_frame(answer));
                }
                if self.unsolicited.len() > MAX_UNSOLICITED {
                    self.unsolicited.pop_front();
                }
                if let Some(value) = handle(answer) {
                    return Ok(Some(value));
                }
            }
            let left = end.saturating_duration_since(Instant::now());
            match self.input.recv_timeout(left.min(STOP_POLL_INTERVAL)) {
                Ok(bytes) => {
                    self.bytes_received = self.bytes_received.saturating_add(bytes.len());
                    if let Some(record) = &mut self.record {
                        record.write_all(&bytes).map_err(unrecorded)?;
                    }
                    self.waiting.extend(bytes);
                }
                Err(RecvTimeoutError::Timeout) => {
                    (self.check_stop)()?;
                    if left <= STOP_POLL_INTERVAL {
                        return Ok(None);
                    }
                }
                Err(RecvTimeoutError::Disconnected) => {
                    self.over = true;
                    let next = "check that the board is connected, or that the emulator runs";
                    return Err(Refusal::new(format!("{} ended", self.name), next));
                }
            }
        }
    }

    fn no_answer(&self) -> Refusal {
        let Self {
            name,
            bytes_received,
            unreadable,
            ..
        } = self;
        if *bytes_received > 0 && self.image.is_empty() {
            let frames = format!("{unreadable} unreadable frames and no readable one");
            let cause = format!("{name} sent {bytes_received} bytes: {frames}");
            let next = "check that this is the board's port, at 115200 baud";
            return Refusal::new(cause, format!("{next}, and that the board runs kband"));
        }
        let next = match &self.emulator {
            Some(_) => format!("give an image for the emulated CPU; {}", emulator::BUILD),
            None => "check that the board runs kband, and that its send and receive lines are \
                     crossed"
                .into(),
        };
        Refusal::new(format!("{name} does not answer"), next)
    }
}

pub(crate) fn reset(cause: String) -> Refusal {
    Refusal::new(cause, "reset the board")
}

fn too_long() -> Refusal {
    Refusal::new("a request is too long for a frame", "shorten its text")
}

fn unrecorded(error: std::io::Error) -> Refusal {
    let cause = format!("the record cannot be written: {error}");
    Refusal::new(cause, "make room, or give another path with --record")
}

impl Drop for Link {
    fn drop(&mut self) {
        if let Some(emulator) = &mut self.emulator {
            let _ = emulator.kill();
            let _ = emulator.wait();
        }
    }
}

fn refusal(name: &str, refused: Refused<'_>) -> Refusal {
    let cause = match &refused {
        Refused::OutOfRange {
            parameter,
            accepted,
        } => format!("{name} refuses {parameter}: it accepts {accepted}"),
        Refused::Running => format!("{name} is running its drive"),
        Refused::Unknown => format!("{name} has no such setting"),
        Refused::Store => format!("{name} could not save its settings"),
        Refused::TooOften => format!("{name} has saved its settings 60 times within an hour"),
        Refused::ReadOnly(Access::Strapped) => {
            format!("the link of {name} is read-only: its strap, PC1, is wired to ground")
        }
        Refused::ReadOnly(_) => format!("the link of {name} is locked by a PIN"),
        Refused::WrongPin => format!("{name} was locked with another PIN"),
        Refused::Wait(_) => format!("{name} was given five wrong PINs"),
        Refused::Faster(least) => {
            format!("the line of {name} carries telemetry every {least} drive cycles at most")
        }
        Refused::SupplyLow => format!(
            "{name} saved nothing: its supply of 3.3 V is too low, or was within the last 0.1 s"
        ),
        Refused::NoRecipe => format!("{name} has no such recipe, or a newer firmware saved it"),
        Refused::NoSettings => {
            format!("{name} has no saved settings, and recipes are saved with them")
        }
        Refused::NotInControl => {
            format!("{name} is controlled by its fieldbus: the desk only reads, and stops it")
        }
        Refused::OutOfStep => format!("{name} and the desk fell out of step"),
    };
    let next = match refused {
        Refused::OutOfRange { .. } => "change the value",
        Refused::Running => "withdraw the enable input first",
        Refused::Unknown => "kband settings list shows its settings",
        Refused::Store => "the flash may be worn: reset the board and try again",
        Refused::TooOften => "its flash wears: save once more in a minute, after all changes",
        Refused::ReadOnly(Access::Strapped) => "open the strap to change the board from the desk",
        Refused::ReadOnly(_) => "kband unlock PIN lets the desk change it until its next start",
        Refused::WrongPin => RIGHT_PIN,
        Refused::Wait(seconds) => &format!("wait for {seconds} s, then give the right PIN"),
        Refused::Faster(least) => &format!("kband monitor --every {least}, or more"),
        Refused::SupplyLow => "check the supply, then save again",
        Refused::NoRecipe => "kband recipe list shows all",
        Refused::NoSettings => "kband settings save first",
        Refused::NotInControl => "with the drive at rest: kband settings set bus 0",
        Refused::OutOfStep => "reset the board and start again",
    };
    Refusal::new(cause, next)
}

pub(crate) const RIGHT_PIN: &str =
    "give the right PIN; after five wrong ones the board waits for a minute";
