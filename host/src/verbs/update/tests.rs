//! Updates of a stand-in board behind a pseudo-terminal, with fixed faults of line and board.

use std::fs::File;
use std::io::{Read, Write};
use std::sync::atomic::{AtomicBool, Ordering};

use kband::arithmetic::Noise;
use kband_control::wire::{
    Identity, Incoming, MAX_FRAME_BYTES, Receiver, Refusal as Refused, Response, SCHEMA, SelfTest,
    Setting, Status, Stored, UpdateAnswer, UpdateRefusal, VERSION, read_request, write_identity,
    write_response, write_update_answer,
};
use kband_control::{Settings, Target};
use salty::{PublicKey, Sha512};

use super::*;
use crate::chip::slot_elf;

const SECRET: &str = "0101010101010101010101010101010101010101010101010101010101010101";
const PIN: &str = "4711";

/// A board with a slot, and faults of it and of its line.
#[derive(Clone, Debug)]
struct Board {
    name: &'static str,
    size: u32,
    schema: u32,
    key: Option<[u8; 32]>,
    pin: Option<Pin>,
    unlocked: bool,
    running: bool,
    kept: Kept,
    target: Target,
    image: Vec<u8>,
    slot: Vec<u8>,
    /// Length of the image that comes.
    length: Option<usize>,
    on_trial: bool,
    /// Image before the one on trial.
    previous: Vec<u8>,
    frames: usize,
    /// Frames whose request is lost, whose answer is lost, whose answer comes twice.
    lost: &'static [usize],
    mute: &'static [usize],
    twice: &'static [usize],
    /// Frame before which the board loses 256 bytes, and one before which it restarts.
    forgets: Option<usize>,
    restarts: Option<usize>,
    /// Target after the update, and recipe in use.
    new_target: Target,
    recipe: u8,
    /// Whether the new image does not start.
    fails: bool,
    /// Number of received bytes at which the line ends.
    cut: usize,
    received: usize,
}

impl Board {
    fn new(key: [u8; 32]) -> Self {
        let target = Target::K(0.41);
        Self {
            name: "stm32f405rg",
            size: 0x6_0000,
            schema: SCHEMA,
            key: Some(key),
            pin: None,
            unlocked: false,
            running: false,
            kept: Kept::InUse,
            target,
            image: vec![0x11; 512],
            slot: Vec::new(),
            length: None,
            on_trial: false,
            previous: Vec::new(),
            frames: 0,
            lost: &[],
            mute: &[],
            twice: &[],
            forgets: None,
            restarts: None,
            new_target: target,
            recipe: 0,
            fails: false,
            cut: usize::MAX,
            received: 0,
        }
    }

    /// Answers what comes by the far end of a port, until that is closed or `done`.
    fn serve(&mut self, mut far: File, done: &AtomicBool) {
        let mut receiver = Receiver::new();
        let mut byte = [0];
        while matches!(far.read(&mut byte), Ok(1)) && !done.load(Ordering::Relaxed) {
            self.received += 1;
            if self.received == self.cut {
                return;
            }
            let Some(Ok(frame)) = receiver.push(byte[0]) else {
                continue;
            };
            let mut buffer = [0; MAX_FRAME_BYTES];
            let answer = match read_request(frame).unwrap() {
                Incoming::Question { sequence } => self.identity(sequence),
                Incoming::Request { sequence, request } => {
                    write_response(&mut buffer, sequence, &self.answer(&request))
                        .unwrap()
                        .to_vec()
                }
                Incoming::Update { sequence, request } => self.update(sequence, &request),
            };
            if far.write_all(&answer).is_err() {
                return;
            }
        }
    }

    fn identity(&self, sequence: u8) -> Vec<u8> {
        let identity = Identity {
            version: VERSION,
            schema: self.schema,
            image: "0.1.0+stand-in",
        };
        let mut buffer = [0; MAX_FRAME_BYTES];
        write_identity(&mut buffer, sequence, &identity)
            .unwrap()
            .to_vec()
    }

    fn answer(&mut self, request: &Request<'_>) -> Response<'static> {
        match *request {
            Request::Setting(number) => match Settings::KEYS.get(usize::from(number)) {
                Some(key) => Response::Setting(Setting {
                    number,
                    key: key.name,
                    unit: key.unit,
                    value: key.default,
                    low: key.low,
                    high: key.high,
                    default: key.default,
                }),
                None => Response::Refused(Refused::Unknown),
            },
            Request::Held => Response::Held(self.target),
            Request::Recipe(_) => Response::Recipe(Stored::None),
            Request::UseRecipe(number) => {
                (self.recipe, self.target) = (number, Target::K(0.41));
                Response::Done
            }
            Request::Status => Response::Status(Status {
                recipe: self.recipe,
                ..Status::default()
            }),
            Request::SelfTest if self.running => Response::Refused(Refused::Running),
            Request::SelfTest => Response::SelfTest(SelfTest {
                settings: self.kept,
                ..SelfTest::default()
            }),
            other => panic!("no update needs {other:?}"),
        }
    }

    fn update(&mut self, sequence: u8, request: &UpdateRequest<'_>) -> Vec<u8> {
        self.frames += 1;
        let frame = Some(self.frames);
        if self.lost.contains(&self.frames) {
            return Vec::new();
        }
        if self.restarts == frame {
            self.start();
        }
        if self.forgets == frame {
            self.slot.truncate(self.slot.len() - 256);
        }
        let answer = match *request {
            UpdateRequest::State => UpdateAnswer::State {
                board: self.name,
                size: self.size,
                has_key: self.key.is_some(),
                on_trial: self.on_trial,
            },
            _ => match self.change(request) {
                Ok(()) => UpdateAnswer::Done,
                Err(why) => UpdateAnswer::Refused(why),
            },
        };
        let mut buffer = [0; MAX_FRAME_BYTES];
        let mut frames = write_update_answer(&mut buffer, sequence, &answer)
            .unwrap()
            .to_vec();
        if self.mute.contains(&self.frames) {
            frames.clear();
        }
        if self.twice.contains(&self.frames) {
            frames = frames.repeat(2);
        }
        if matches!(request, UpdateRequest::End(_)) && answer == UpdateAnswer::Done {
            if !self.on_trial && !self.fails {
                self.previous = std::mem::replace(&mut self.image, self.slot.clone());
                (self.target, self.recipe) = (self.new_target, 0);
                self.on_trial = true;
            }
            self.unlocked = false;
            frames.extend(self.identity(0));
        }
        frames
    }

    fn change(&mut self, request: &UpdateRequest<'_>) -> Result<(), UpdateRefusal> {
        use UpdateRefusal::*;
        if let UpdateRequest::Unlock(pin) = *request {
            self.unlocked = self.pin == Some(pin);
            return if self.unlocked { Ok(()) } else { Err(WrongPin) };
        }
        if self.pin.is_some() && !self.unlocked {
            return Err(ReadOnly);
        }
        if self.running {
            return Err(Running);
        }
        match *request {
            UpdateRequest::State | UpdateRequest::Unlock(_) => Ok(()),
            UpdateRequest::Key(key) => match self.key {
                Some(other) if other != key && self.pin.is_none() => Err(HasKey),
                _ => {
                    self.key = Some(key.try_into().map_err(|_| Length)?);
                    Ok(())
                }
            },
            UpdateRequest::Begin { board, length } => {
                let refusals = [
                    (board != self.name, OtherBoard),
                    (length % 4 != 0 || length > self.size, Length),
                    (self.on_trial, OnTrial),
                    (self.key.is_none(), NoKey),
                ];
                if let Some((_, why)) = refusals.into_iter().find(|(wrong, _)| *wrong) {
                    return Err(why);
                }
                self.slot.clear();
                self.length = Some(length as usize);
                Ok(())
            }
            UpdateRequest::Bytes { offset, bytes } => {
                let (has, offset) = (self.slot.len(), offset as usize);
                if offset + bytes.len() == has {
                    return Ok(());
                }
                if self.length.is_none() || offset != has {
                    return Err(Order(has as u32));
                }
                self.slot.extend_from_slice(bytes);
                Ok(())
            }
            UpdateRequest::End(signature) => {
                if self.on_trial {
                    return Ok(());
                }
                if self.length != Some(self.slot.len()) {
                    return Err(Order(self.slot.len() as u32));
                }
                let mut sum = Sha512::new();
                sum.update(&self.slot);
                sum.update(self.name.as_bytes());
                let key = PublicKey::try_from(&self.key.unwrap()).unwrap();
                let signature: &[u8; 64] = signature.try_into().unwrap();
                let signature = salty::Signature::from(signature);
                let signed = key.verify(&sum.finalize(), &signature);
                signed.map_err(|_| Signature)
            }
            UpdateRequest::Confirm => {
                self.on_trial = false;
                Ok(())
            }
            UpdateRequest::Signed { .. } => Err(NoSlot),
        }
    }

    /// A start: an image that was not confirmed is taken back.
    fn start(&mut self) {
        if std::mem::take(&mut self.on_trial) {
            std::mem::swap(&mut self.image, &mut self.previous);
        }
        self.slot.clear();
        (self.length, self.unlocked) = (None, false);
    }
}

/// A folder with an image, a key pair, and a wrong key.
struct Plant {
    folder: tempfile::TempDir,
    desk: Desk,
    public: [u8; 32],
    update: Vec<u8>,
}

impl Plant {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("feeder"), slot_elf(7)).unwrap();
        std::fs::write(path("key"), format!("kband-secret-key {SECRET}")).unwrap();
        key::create(&path("wrong")).unwrap();
        let pair = salty::Keypair::from(&[1; 32]);
        Self {
            public: *pair.public.as_bytes(),
            update: Image::parse(&slot_elf(7)).unwrap().update().unwrap(),
            desk: Desk::new(Some(1)).unwrap(),
            folder,
        }
    }

    fn board(&self) -> Board {
        Board::new(self.public)
    }

    /// Updates a board with the image of that file, signed with that key.
    fn update(
        &self,
        board: &mut Board,
        [image, key]: [&str; 2],
        pin: Option<Pin>,
    ) -> Result<String, String> {
        use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

        let far = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&far).unwrap();
        unlockpt(&far).unwrap();
        let name = ptsname(&far, Vec::new()).unwrap().into_string().unwrap();
        let mut near = File::options().read(true).write(true).open(&name).unwrap();
        let path = |name: &str| self.folder.path().join(name);
        let arguments = Arguments {
            image: Some(path(image)),
            key: Some(path(key)),
            new_key: None,
            set_key: None,
            on: Some(name),
            pin,
        };
        let done = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| board.serve(File::from(far), &done));
            let folder = self.folder.path();
            let updated = update(&path(image), &path(key), &arguments, folder, &self.desk);
            done.store(true, Ordering::Relaxed);
            // A byte ends the board's wait; its port may be gone.
            let _ = near.write_all(&[0]);
            updated.map_err(|refusal| refusal.to_string())
        })
    }

    #[track_caller]
    fn refused(&self, board: &mut Board, words: [&str; 2], expected: &[&str]) {
        let image = board.image.clone();
        let message = self.update(board, words, None).unwrap_err();
        for part in expected {
            assert!(message.contains(part), "no '{part}': {message}");
        }
        assert_eq!(message.lines().last().unwrap().find("next: "), Some(2));
        board.start();
        assert_eq!(board.image, image, "{message}");
    }

    fn files(&self) -> usize {
        std::fs::read_dir(self.folder.path()).unwrap().count()
    }
}

const GOOD: [&str; 2] = ["feeder", "key"];

#[test]
fn a_board_is_updated_compared_and_confirmed() {
    let plant = Plant::new();
    let mut board = plant.board();
    let said = plant.update(&mut board, GOOD, None).unwrap();
    assert!(
        said.ends_with("settings, target and recipes are as before"),
        "{said}"
    );
    assert_eq!((board.on_trial, &board.image), (false, &plant.update));
    let settings = plant.folder.path().join("settings_before_update.toml");
    let settings = std::fs::read_to_string(settings).unwrap();
    assert!(settings.contains("frequency = 50"), "{settings}");
}

#[test]
fn a_recipe_in_use_is_used_again_after_an_update() {
    let plant = Plant::new();
    let mut board = Board {
        recipe: 1,
        new_target: Target::K(0.5),
        ..plant.board()
    };
    plant.update(&mut board, GOOD, None).unwrap();
    assert_eq!((board.on_trial, board.recipe), (false, 1));
    assert_eq!(board.target, Target::K(0.41));
}

#[test]
fn a_board_of_another_schema_is_updated_uncompared() {
    let plant = Plant::new();
    let mut board = Board {
        schema: !SCHEMA,
        ..plant.board()
    };
    let files = plant.files();
    let said = plant.update(&mut board, GOOD, None).unwrap();
    assert!(said.ends_with("its settings were not compared"), "{said}");
    assert_eq!((board.on_trial, &board.image), (false, &plant.update));
    assert_eq!(plant.files(), files);
}

#[test]
fn a_locked_board_is_updated_with_its_pin() {
    let plant = Plant::new();
    let mut board = Board {
        pin: Pin::parse(PIN),
        ..plant.board()
    };
    plant.refused(&mut board, GOOD, &["read-only", "--pin PIN"]);
    let wrong = plant.update(&mut board, GOOD, Pin::parse("0000"));
    assert!(wrong.unwrap_err().contains("another PIN"));
    plant.update(&mut board, GOOD, Pin::parse(PIN)).unwrap();
    assert_eq!((board.on_trial, &board.image), (false, &plant.update));
}

#[test]
fn lost_and_repeated_frames_do_not_harm_an_update() {
    let plant = Plant::new();
    // Frame 1 reads the state, 2 begins, 3 to 19 carry the image, 20 to 22 end it, 22 is first.
    let mut board = Board {
        lost: &[2, 8],
        mute: &[1, 4, 22],
        twice: &[3, 6, 11],
        forgets: Some(13),
        ..plant.board()
    };
    plant.update(&mut board, GOOD, None).unwrap();
    assert_eq!((board.on_trial, &board.image), (false, &plant.update));
}

/// A change of a board, and words of the message that it causes.
type Case = (fn(&mut Board), &'static [&'static str]);

#[test]
fn a_refused_update_leaves_the_old_image() {
    let plant = Plant::new();
    let with = |change: fn(&mut Board)| {
        let mut board = plant.board();
        change(&mut board);
        board
    };
    let files = plant.files();
    let cases: [Case; 7] = [
        (|board| board.size = 0, &["no slot", "kband flash"]),
        (
            |board| board.running = true,
            &["running its drive", "enable input"],
        ),
        (|board| board.key = None, &["no key", "--set-key FILE.pub"]),
        (
            |board| board.name = "stm32f407vg",
            &["= stm32f405rg is refused", "accepted: stm32f407vg"],
        ),
        (
            |board| board.on_trial = true,
            &["on trial", "wait for a minute"],
        ),
        (
            |board| board.kept = Kept::Others,
            &["not saved", "kband settings save"],
        ),
        (
            |board| board.pin = Pin::parse(PIN),
            &["read-only", "--pin PIN"],
        ),
    ];
    for (change, expected) in cases {
        let mut board = with(change);
        board.previous.clone_from(&board.image);
        plant.refused(&mut board, GOOD, expected);
    }
    assert_eq!(plant.files(), files);
    let cases: [Case; 3] = [
        (
            |board| board.fails = true,
            &["restarted with its old image"],
        ),
        (
            |board| board.restarts = Some(9),
            &["keeps its old image", "0 bytes"],
        ),
        (
            |board| board.new_target = Target::K(0.5),
            &["not confirmed", "k = 0.41, is k = 0.5"],
        ),
    ];
    for (change, expected) in cases {
        plant.refused(&mut with(change), GOOD, expected);
    }
    let signed = ["feeder", "wrong"];
    plant.refused(
        &mut plant.board(),
        signed,
        &["another key", "--key whose .pub"],
    );
}

#[test]
fn a_wrong_file_is_refused_before_the_board_is_asked() {
    let plant = Plant::new();
    let path = |name: &str| plant.folder.path().join(name);
    let elf = slot_elf(7);
    std::fs::write(path("short"), &elf[..elf.len() - 300]).unwrap();
    std::fs::write(path("words"), "no image").unwrap();
    let files = plant.files();
    for (words, expected) in [
        (["short", "key"], ["short: the file is", "cargo feeder"]),
        (["words", "key"], ["words: this is no ELF", "cargo feeder"]),
        (["none", "key"], ["none: ", "cargo feeder"]),
        (["feeder", "words"], ["kband-secret-key", "64 hexadecimal"]),
        (
            ["feeder", "wrong.pub"],
            ["kband-secret-key", "without .pub"],
        ),
        (["feeder", "none"], ["none: ", "readable text file"]),
    ] {
        let mut board = plant.board();
        plant.refused(&mut board, words, &expected);
        assert_eq!(board.frames, 0);
    }
    assert_eq!(plant.files(), files);
}

#[test]
fn a_line_cut_anywhere_leaves_a_whole_image() {
    let plant = Plant::new();
    let mut whole = plant.board();
    plant.update(&mut whole, GOOD, None).unwrap();
    let mut drawn = Noise::new(37);
    for _ in 0..40 {
        let mut board = plant.board();
        let old = board.image.clone();
        board.cut = 1 + drawn.bits() as usize % (whole.received - 1);
        let cut = board.cut;
        let message = plant.update(&mut board, GOOD, None).unwrap_err();
        assert!(
            message.contains("ended") || message.contains("link broke"),
            "{message}"
        );
        // Before the confirmation the old image returns, after it the new one stays.
        let confirmed = !board.on_trial && board.image != old;
        board.start();
        let expected = if confirmed { &plant.update } else { &old };
        assert_eq!(&board.image, expected, "cut at {cut}");
        board.cut = usize::MAX;
        board.frames = 0;
        plant.update(&mut board, GOOD, None).unwrap();
        assert_eq!((board.on_trial, &board.image), (false, &plant.update));
    }
}
