//! Requests on the fieldbus to a board at rest: raw frames, and requests with a valid checksum.

use crate::Reader;
use kband_bus::rtu::{self, crc};
use kband_bus::{Answer, Authority, Exception, Machine, Server, Snapshot, tcp};
use kband_control::wire::Record;
use kband_control::{Settings, Target};

/// Words of requests.
pub const WORDS: &str = "\x03\0\0\0\x0a|\x10\0\0\0\x04\x08|\x2b\x0e\x01\0";

const UNIT: u8 = 17;

/// A drive that checks the commands of the server.
struct Drive {
    authority: Authority,
    running: bool,
    settings: Settings,
    target: Target,
}

impl Machine for Drive {
    fn snapshot(&self) -> Snapshot<'_> {
        let mut snapshot = Snapshot {
            authority: self.authority,
            target: self.target,
            events: 5,
            image: "fuzz",
            ..Snapshot::default()
        };
        snapshot.telemetry.state = u8::from(self.running) * 2;
        snapshot
    }

    fn settings(&self) -> Settings {
        self.settings
    }

    fn event(&self, number: u32) -> Option<Record> {
        assert!(number < 5);
        None
    }

    fn set_target(&mut self, target: Target) -> Result<(), Exception> {
        assert!(self.authority >= Authority::Command);
        self.target = target;
        Ok(())
    }

    fn set_settings(&mut self, settings: &Settings) -> Result<(), Exception> {
        assert!(self.authority >= Authority::Command && !self.running);
        settings.check().map_err(|_| Exception::Value)?;
        let bus = |settings: &Settings| {
            let value = |key: &str| settings.get(&format!("bus{key}")).map(f32::to_bits);
            ["", "_address", "_baud", "_parity", "_timeout"].map(value)
        };
        assert_eq!(bus(settings), bus(&self.settings));
        self.settings = *settings;
        Ok(())
    }

    fn save(&mut self) -> Result<(), Exception> {
        assert!(self.authority >= Authority::Command && !self.running);
        Ok(())
    }
}

/// Sends a request to a server; the response has the unit and function of the request.
fn process(server: &mut Server, drive: &mut Drive, adu: &[u8]) -> bool {
    let mut answer = Answer::new();
    let mut frame = adu.to_vec();
    frame.extend(crc(adu).to_le_bytes());
    if !rtu::answer(server, UNIT, &frame, drive, &mut answer) {
        return false;
    }
    let answered = rtu::check(&answer).expect("a valid checksum").to_vec();
    assert!(answered[0] == adu[0] && answered[1] & 0x7f == adu[1]);
    answered[1] & 0x80 == 0
}

/// Requests to boards of each authority; each is a length and its bytes.
pub fn bus(input: &[u8]) -> bool {
    let mut input = Reader(input);
    let mut is_valid = false;
    let mut server = Server::default();
    let mut drive = Drive {
        authority: Authority::Read,
        running: false,
        settings: Settings::default(),
        target: Target::K(0.5),
    };
    while let Some(what) = input.byte() {
        let piece = input.piece().unwrap_or(&[]);
        drive.running = what & 1 != 0;
        drive.authority = match what >> 1 & 3 {
            0 => Authority::Read,
            1 => Authority::Command,
            _ => Authority::Acknowledge,
        };
        let (before, _) = server.take_command();
        let mut adu = vec![UNIT];
        adu.extend(piece);
        is_valid |= process(&mut server, &mut drive, &adu);
        let mut answer = Answer::new();
        let _ = rtu::answer(&mut server, UNIT, piece, &mut drive, &mut answer);
        if tcp::frame_length(piece) == Ok(Some(piece.len())) {
            let adu = &piece[tcp::HEADER_BYTES..];
            let _ = server.answer(adu, &mut drive, &mut answer) && tcp::wrap(piece, &mut answer);
        }
        let (command, _) = server.take_command();
        assert!(command.run == before.run || drive.authority >= Authority::Command);
        assert!(!command.acknowledge || drive.authority == Authority::Acknowledge);
    }
    is_valid
}
