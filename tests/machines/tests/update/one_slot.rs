//! Update of the STM32G474 by its loader: a complete image, refused images, and power cuts.
//!
//! `KBAND_EVERY_CUT=1` cuts the power at every flash operation, instead of a random sample.

use super::{
    await_image, begin, drives, keypair, other_program, power_cycle, program, rig_with_key,
    runs_other, send, signature, sum,
};
use kband_control::wire::{MAX_UPDATE_BYTES, Request, UpdateRefusal, UpdateRequest};
use kband_machines::chip::clocks::Cause;
use kband_machines::chip::kind::Kind;
use kband_machines::chip::world::Event;
use kband_machines::draw::Draw;
use kband_machines::rig::{Act, Rig};
use std::sync::LazyLock;

const KIND: Kind = Kind::Stm32g474;
const BOARD: &str = "stm32g474re";
/// Number of operations before the old image's mark is erased: the key's page and its five words.
const KEY: u64 = 6;
/// Requests with power cuts in a usual run, and share of their operations that is cut.
const DEFAULT_REQUESTS: usize = 20;
const DEFAULT_SHARE: f32 = 0.02;

struct Header {
    board: &'static str,
    length: u32,
    sum: [u8; 64],
    signature: [u8; 64],
}

impl Header {
    fn from_image(image: &[u8]) -> Self {
        Self {
            board: BOARD,
            length: image.len() as u32,
            sum: sum(image, BOARD),
            signature: signature(image, BOARD),
        }
    }

    fn request(&self) -> UpdateRequest<'_> {
        UpdateRequest::Signed {
            board: self.board,
            length: self.length,
            sum: &self.sum,
            signature: &self.signature,
        }
    }
}

/// Whether the loader waits for an image, FAULT on.
fn waits(rig: &mut Rig) -> bool {
    rig.image().expect("an answer").starts_with("loader")
}

/// A board whose program has restarted into the loader.
fn in_loader() -> Rig {
    static LOADER: LazyLock<Rig> = LazyLock::new(|| {
        let mut rig = rig_with_key(KIND);
        assert_eq!(rig.update(&begin(BOARD, 4096)), Ok(()));
        rig.run_for(1.0);
        assert!(waits(&mut rig));
        rig
    });
    LOADER.clone()
}

/// A board whose slot contains the other program without its mark.
fn written() -> Rig {
    static WRITTEN: LazyLock<Rig> = LazyLock::new(|| {
        let mut rig = in_loader();
        let (other, began) = (other_program(&rig), rig.time());
        assert_eq!(rig.update(&Header::from_image(&other).request()), Ok(()));
        println!("signature checked in {:.2} s", rig.time() - began);
        assert_eq!(send(&mut rig, &other), Ok(()));
        println!("{} bytes in {:.1} s", other.len(), rig.time() - began);
        rig
    });
    WRITTEN.clone()
}

#[test]
fn an_update_by_the_loader_drives_with_the_old_settings() {
    let mut rig = written();
    let lamp = rig.find_time(rig.time() - 10.0, &Event::Fault(false));
    assert_eq!(lamp, None, "FAULT is on during the wait");
    let began = rig.time();
    assert_eq!(rig.update(&UpdateRequest::End(&[])), Ok(()));
    println!("hash checked in {:.2} s", rig.time() - began);
    await_image(&mut rig);
    println!("new image after {:.2} s", rig.time() - began);
    assert!(runs_other(&mut rig));
    let started = rig.find_time(began, &Event::Fault(false)).unwrap();
    assert_eq!(rig.faults_after(started), None);
    assert_eq!(rig.closes_after(0.0), None);
    assert!(drives(&mut rig));
    power_cycle(&mut rig);
    assert!(runs_other(&mut rig) && drives(&mut rig));
    assert_eq!(rig.update(&begin(BOARD, 4096)), Ok(()), "the next update");
}

#[test]
fn an_invalid_update_is_refused_before_the_old_image_is_erased() {
    let mut rig = in_loader();
    let operations = rig.chip.operations();
    let image = program(&rig);
    let mut header = Header::from_image(&image);
    header.signature[40] ^= 1;
    assert_eq!(rig.update(&header.request()), Err(UpdateRefusal::Signature));
    header.signature = signature(&image, "stm32f405rg");
    assert_eq!(rig.update(&header.request()), Err(UpdateRefusal::Signature));
    header.board = "stm32f405rg";
    let refused = rig.update(&header.request());
    assert_eq!(refused, Err(UpdateRefusal::OtherBoard));
    let first = send(&mut rig, &image[..256]);
    assert_eq!(first, Err(UpdateRefusal::Order(0)));
    // The desk is silent: the old image starts again, without a fault.
    let from = rig.time();
    rig.run(from + 9.5);
    assert!(rig.find_time(from, &Event::Fault(false)).is_none());
    rig.run(from + 11.0);
    assert_eq!(rig.chip.operations(), operations);
    assert!(!runs_other(&mut rig) && drives(&mut rig));
    let from = rig.time();
    rig.act(&Act::Enable(true)).run(from + 2.0);
    let refused = rig.update(&begin(BOARD, 4096));
    assert_eq!(refused, Err(UpdateRefusal::Running));
    rig.request_done(&Request::Alive);
    assert_eq!(rig.find_time(from + 0.5, &Event::Bridge(false)), None);
}

#[test]
fn an_empty_slot_waits_and_a_board_without_a_key_refuses_all() {
    let mut rig = rig_with_key(KIND);
    let image = program(&rig);
    rig.act(&Act::Volts(0.0)).run_for(0.3);
    let program = KIND.facts().program;
    rig.chip.flash_mut()[program..][..image.len()].fill(0xff);
    let (from, operations) = (rig.time(), rig.chip.operations());
    rig.power_cycle(0.01, 0.5);
    assert!(waits(&mut rig));
    let request = rig.update(&Header::from_image(&image).request());
    assert_eq!(request, Err(UpdateRefusal::NoKey));
    let key = *keypair().public.as_bytes();
    let loader = rig.update(&UpdateRequest::Key(&key));
    assert_eq!(loader, Ok(()));
    rig.run_for(12.0);
    assert!(waits(&mut rig));
    assert_eq!(rig.chip.operations(), operations);
    assert_eq!(rig.find_time(from, &Event::Bridge(true)), None);
    let resets = rig.resets().into_iter().filter(|reset| reset.0 > from);
    assert_eq!(resets.count(), 1);
}

#[test]
fn any_power_cut_leaves_the_old_image_or_an_empty_slot() {
    let every = std::env::var_os("KBAND_EVERY_CUT").is_some();
    let mut draw = Draw::new(39);
    let mut rig = in_loader();
    let other = other_program(&rig);
    let settings = rig.chip.flash()[KIND.facts().stored.clone()].to_vec();
    let header = Header::from_image(&other);
    let offsets = (0..).step_by(MAX_UPDATE_BYTES);
    let chunks = offsets.zip(other.chunks(MAX_UPDATE_BYTES));
    let bytes = chunks.map(|(offset, bytes)| UpdateRequest::Bytes { offset, bytes });
    let requests: Vec<_> = [header.request()].into_iter().chain(bytes).collect();
    let count = if every {
        requests.len()
    } else {
        DEFAULT_REQUESTS
    };
    let mut cuts = 0;
    let mut cut = |rig: &Rig, request: &UpdateRequest<'_>, cut: u64, keeps_image: bool| {
        let mut rig = rig.clone();
        let began = rig.time();
        rig.chip.board.cut_at = Some(rig.chip.operations() + cut);
        let frame = rig.update_frame(request);
        rig.act(&Act::Link(frame));
        rig.run_until(1e-3, 10.0, |rig| !rig.chip.board.supplied);
        rig.power_cycle(0.01, 0.5);
        assert_eq!(waits(&mut rig), !keeps_image, "{request:?} {cut}");
        if keeps_image {
            assert!(!runs_other(&mut rig));
        }
        // The old image may write its fault log.
        let stored = &rig.chip.flash()[KIND.facts().stored.clone()];
        assert!(keeps_image || stored == settings, "{request:?} {cut}");
        assert_eq!(rig.find_time(began, &Event::Bridge(true)), None);
        cuts += 1;
    };
    for (number, request) in requests[..count].iter().enumerate() {
        let mut next = rig.clone();
        assert_eq!(next.update(request), Ok(()));
        for operation in 1..=next.chip.operations() - rig.chip.operations() {
            if every || number == 0 || draw.unit() < DEFAULT_SHARE {
                cut(&rig, request, operation, number == 0 && operation <= KEY);
            }
        }
        rig = next;
    }
    cut(&written(), &UpdateRequest::End(&[]), 1, false);
    println!("{cuts} power cuts");
    // The reset pin acts as a power cut.
    rig.chip.reset(Cause::Pin);
    rig.run_for(0.5);
    assert!(waits(&mut rig));
}
