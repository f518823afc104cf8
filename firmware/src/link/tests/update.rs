//! Tests of an update over the link, with a slot in the desk's memory.

use super::*;
use crate::testing::with;
use crate::update::{SecondSlot, Slot, TRIAL_S, Writer};
use UpdateRefusal::*;
use UpdateRequest::{Confirm, End, Key};
use core::cell::RefCell;
use kband_control::wire::{
    MAX_UPDATES_PER_START, UpdateAnswer, UpdateRefusal, UpdateRequest, write_update_request,
};
use salty::{Keypair, Sha512};
use std::{thread_local, vec};

/// Size of the slot and of its sectors, bytes.
const SIZE: u32 = 1536;
const SECTOR: u32 = 512;

#[derive(Default)]
struct Flash {
    bytes: Vec<u8>,
    erased: Vec<u32>,
    marked: bool,
    on_trial: bool,
    restarts: u32,
    full: bool,
    requested: Option<[u8; 32]>,
    fails: &'static str,
}

thread_local! {
    static FLASH: RefCell<Flash> = RefCell::default();
}

fn flash<T>(work: impl FnOnce(&mut Flash) -> T) -> T {
    FLASH.with_borrow_mut(work)
}

const SLOT: Slot = Slot {
    board: "stm32f405rg",
    size: SIZE,
    restart: || flash(|flash| flash.restarts += 1),
    writer: Writer::Program(SECOND_SLOT),
};

/// Does the work of the function `name`; returns whether it succeeds.
fn attempt(name: &str, work: impl FnOnce(&mut Flash)) -> bool {
    flash(work);
    flash(|flash| flash.fails != name)
}

const SECOND_SLOT: SecondSlot = SecondSlot {
    sector: SECTOR,
    erase: |offset| {
        attempt("erase", |flash| {
            flash.bytes[offset as usize..][..SECTOR as usize].fill(0xff);
            flash.erased.push(offset);
        })
    },
    write: |offset, bytes| {
        attempt("write", |flash| {
            let place = &mut flash.bytes[offset as usize..][..bytes.len()];
            assert!(place.iter().all(|byte| *byte == 0xff), "it is erased");
            place.copy_from_slice(bytes);
        })
    },
    read: |offset, bytes| {
        flash(|flash| bytes.copy_from_slice(&flash.bytes[offset as usize..][..bytes.len()]));
    },
    on_trial: || flash(|flash| flash.on_trial),
    mark: || attempt("mark", |flash| flash.marked = true),
    confirm: || attempt("confirm", |flash| flash.on_trial = flash.fails == "confirm"),
    has_room: || flash(|flash| !flash.full),
};

fn keypair() -> Keypair {
    Keypair::from(&[7; 32])
}

fn image() -> Vec<u8> {
    (0..SIZE - 8).map(|n| (n * n / 7) as u8).collect()
}

fn signature(image: &[u8], board: &str) -> [u8; 64] {
    let mut sum = Sha512::new();
    sum.update(image);
    sum.update(board.as_bytes());
    keypair().sign(&sum.finalize()).to_bytes()
}

const BEGIN: UpdateRequest<'static> = begin("stm32f405rg", SIZE - 8);

const fn begin(board: &str, length: u32) -> UpdateRequest<'_> {
    UpdateRequest::Begin { board, length }
}

fn bytes(image: &[u8], offset: usize) -> UpdateRequest<'_> {
    UpdateRequest::Bytes {
        offset: offset as u32,
        bytes: image[offset..].chunks(256).next().unwrap(),
    }
}

fn answered(board: &mut Board, request: &UpdateRequest<'_>, answer: UpdateAnswer<'_>) {
    board.cycle();
    let mut buffer = [0; MAX_FRAME_BYTES];
    let frame = (write_update_request(&mut buffer, 9, request).unwrap()).to_vec();
    let answers = board.send(&frame);
    assert_eq!(answers.len(), 1, "{request:?}");
    let expected = (9, Outgoing::Update(answer));
    assert_eq!(outgoing(&answers[0]), expected, "{request:?}");
}

fn done(board: &mut Board, request: &UpdateRequest<'_>) {
    answered(board, request, UpdateAnswer::Done);
}

fn refused(board: &mut Board, request: &UpdateRequest<'_>, cause: UpdateRefusal) {
    answered(board, request, UpdateAnswer::Refused(cause));
}

/// A board with a slot and the public key of [`keypair`].
fn board(on_trial: bool) -> Board {
    board_with(SLOT, on_trial)
}

fn board_with(slot: Slot, on_trial: bool) -> Board {
    let mut board = keyless(slot, on_trial);
    done(&mut board, &Key(keypair().public.as_bytes()));
    board
}

fn keyless(slot: Slot, on_trial: bool) -> Board {
    FLASH.set(Flash {
        bytes: vec![0; SIZE as usize],
        on_trial,
        ..Flash::default()
    });
    let image = with(IMAGE, |it| it.slot = Some(slot));
    let board = Board::of(image, LOADED(Condition::Whole), StartCause::PowerOn);
    board.service.update.begin_trial(&board.station);
    board
}

fn send_image(board: &mut Board, image: &[u8]) {
    done(board, &BEGIN);
    for offset in (0..image.len()).step_by(256) {
        done(board, &bytes(image, offset));
    }
}

/// Runs for some seconds, as one drive cycle each.
fn pass(board: &mut Board, seconds: u32) {
    for _ in 0..seconds {
        let inputs = with(Inputs::default(), |it| it.enable = board.enable);
        board.station.cycle(&sensed(20_000), inputs);
        board.service.tick(&board.station);
    }
}

/// Presses the enable input and runs for two seconds; returns whether the drive has started.
fn starts(board: &mut Board) -> bool {
    let mut started = false;
    for (enable, cycles) in [(false, 50), (true, 100)] {
        board.enable = enable;
        for _ in 0..cycles {
            board.cycle();
            started |= !board.station.at_rest();
        }
    }
    started
}

#[test]
fn a_signed_image_is_written_marked_and_started_once() {
    let mut board = board(false);
    let image = image();
    send_image(&mut board, &image);
    // The last request and the end are sent twice, as after a lost answer.
    done(&mut board, &bytes(&image, 1280));
    let end = signature(&image, "stm32f405rg");
    for _ in 0..2 {
        done(&mut board, &End(&end));
    }
    refused(&mut board, &BEGIN, OnTrial);
    flash(|flash| {
        assert_eq!(flash.bytes[..image.len()], image);
        assert_eq!(flash.erased, [0, 512, 1024]);
        assert!(flash.marked && flash.restarts == 0);
    });
    board.run(false, 25);
    assert!(flash(|flash| flash.restarts > 0));
}

#[test]
fn an_image_that_is_not_signed_for_this_board_is_refused() {
    let image = image();
    let mut other = image.clone();
    other[700] ^= 1;
    let mut wrong = signature(&image, "stm32f405rg");
    wrong[5] ^= 1;
    for (sent, end) in [
        (&image, wrong),
        (&image, signature(&image, "stm32g474re")),
        (&image, signature(&image, "")),
        (&other, signature(&image, "stm32f405rg")),
    ] {
        let mut board = board(false);
        send_image(&mut board, sent);
        refused(&mut board, &End(&end), Signature);
        refused(&mut board, &End(&end), Order(0));
        assert!(!flash(|flash| flash.marked));
        assert!(starts(&mut board), "the old image runs on");
    }
}

#[test]
fn requests_out_of_order_or_range_change_nothing() {
    let mut board = board(false);
    let image = image();
    refused(&mut board, &bytes(&image, 0), Order(0));
    for (request, cause) in [
        (begin("stm32g474re", 8), OtherBoard),
        (begin("", 8), OtherBoard),
        (begin("stm32f405rg", 0), Length),
        (begin("stm32f405rg", 10), Length),
        (begin("stm32f405rg", SIZE + 4), Length),
    ] {
        refused(&mut board, &request, cause);
    }
    done(&mut board, &BEGIN);
    done(&mut board, &bytes(&image, 0));
    refused(&mut board, &bytes(&image, 512), Order(256));
    let end = signature(&image, "stm32f405rg");
    refused(&mut board, &End(&end), Order(256));
    refused(&mut board, &End(&end[1..]), Length);
    for offset in (256..image.len()).step_by(256) {
        done(&mut board, &bytes(&image, offset));
    }
    done(&mut board, &End(&end));
}

#[test]
fn an_update_keeps_the_drive_off_and_a_running_drive_refuses_it() {
    let mut board = board(false);
    assert!(board.status().permitted);
    done(&mut board, &BEGIN);
    assert!(!board.status().permitted && !starts(&mut board));
    // The desk is silent. The enable input is still on: only a new press starts the drive.
    for _ in 0..20 {
        pass(&mut board, 1);
        assert!(board.station.at_rest());
    }
    assert!(starts(&mut board));
    let image = image();
    for request in [
        BEGIN,
        bytes(&image, 0),
        Key(&[1; 32]),
        Confirm,
        End(&[0; 64]),
    ] {
        refused(&mut board, &request, Running);
        assert!(!board.station.at_rest());
    }
    assert_eq!(flash(|flash| flash.erased.len()), 0);
    board.run(false, 100);
    refused(&mut board, &bytes(&image, 0), Order(0));
}

#[test]
fn an_enabled_drive_at_rest_is_not_taken_out_of_service() {
    let mut board = board(false);
    board.done(&Request::Enable(false));
    board.enable = true;
    refused(&mut board, &BEGIN, Running);
    board.enable = false;
    board.done(&SIMULATE);
    refused(&mut board, &BEGIN, Running);
}

#[test]
fn an_image_on_trial_drives_nothing_until_confirmed() {
    let mut board = board(true);
    assert!(!starts(&mut board));
    refused(&mut board, &BEGIN, OnTrial);
    flash(|flash| flash.fails = "confirm");
    refused(&mut board, &Confirm, Store);
    flash(|flash| flash.fails = "");
    for _ in 0..2 {
        done(&mut board, &Confirm);
    }
    assert!(!flash(|flash| flash.on_trial));
    // The enable input has stayed on: only a new press starts the drive.
    board.run(true, 50);
    assert!(board.station.at_rest());
    assert!(starts(&mut board));
    pass(&mut board, TRIAL_S + 1);
    assert_eq!(flash(|flash| flash.restarts), 0);
}

#[test]
fn an_unconfirmed_image_restarts_the_board() {
    let mut board = board(true);
    pass(&mut board, TRIAL_S - 1);
    assert_eq!(flash(|flash| flash.restarts), 0);
    pass(&mut board, 1);
    assert_eq!(flash(|flash| flash.restarts), 1);
}

#[test]
fn a_key_is_set_once_and_replaced_with_a_pin() {
    let mut board = board(false);
    let other = Keypair::from(&[8; 32]);
    let set = Key(other.public.as_bytes());
    refused(&mut board, &set, HasKey);
    refused(&mut board, &Key(&[1; 31]), Length);
    // Not a point of the curve.
    refused(&mut board, &Key(&[2; 32]), Signature);
    done(&mut board, &Key(keypair().public.as_bytes()));
    let pin = Pin::parse("0420").unwrap();
    board.done(&Request::Lock(Some(pin)));
    for request in [set, BEGIN, Confirm] {
        refused(&mut board, &request, ReadOnly);
    }
    let wrong = UpdateRequest::Unlock(Pin::parse("0421").unwrap());
    for _ in 0..5 {
        refused(&mut board, &wrong, WrongPin);
    }
    // The right PIN is refused too, for a minute.
    for (seconds, left) in [(0, 60), (59, 1)] {
        pass(&mut board, seconds);
        refused(&mut board, &UpdateRequest::Unlock(pin), Wait(left));
    }
    pass(&mut board, 1);
    refused(&mut board, &wrong, WrongPin);
    done(&mut board, &UpdateRequest::Unlock(pin));
    done(&mut board, &set);
    let key = block_on(board.service.store.key());
    assert_eq!(key, Some(*other.public.as_bytes()));
}

#[test]
fn refused_update_gives_the_reason() {
    let mut none = Board::new();
    let state = |board, size, has_key| UpdateAnswer::State {
        board,
        size,
        has_key,
        on_trial: false,
    };
    answered(&mut none, &UpdateRequest::State, state("", 0, false));
    refused(&mut none, &BEGIN, NoSlot);
    refused(&mut keyless(SLOT, false), &BEGIN, NoKey);
    let mut board = board(false);
    let with_slot = state("stm32f405rg", SIZE, true);
    answered(&mut board, &UpdateRequest::State, with_slot);
    flash(|flash| flash.full = true);
    refused(&mut board, &BEGIN, Store);
    flash(|flash| flash.full = false);
    SUPPLY_IS_GOOD.set(false);
    refused(&mut board, &BEGIN, SupplyLow);
    SUPPLY_IS_GOOD.set(true);
    board.done(&Request::set("bus_address", 7.0));
    board.done(&Request::set("bus", 1.0));
    refused(&mut board, &BEGIN, NotInControl);
    done(&mut board, &Confirm);
    board.done(&Request::set("bus", 0.0));
    let image = image();
    for fails in ["erase", "write"] {
        done(&mut board, &BEGIN);
        flash(|flash| flash.fails = fails);
        refused(&mut board, &bytes(&image, 0), Store);
        refused(&mut board, &bytes(&image, 0), Order(0));
    }
    flash(|flash| flash.fails = "mark");
    send_image(&mut board, &image);
    let end = signature(&image, "stm32f405rg");
    refused(&mut board, &End(&end), Store);
    refused(&mut board, &End(&end), Order(0));
}

#[test]
fn a_chip_with_one_slot_restarts_into_its_loader() {
    let loader = Slot {
        writer: Writer::Loader(|key| flash(|flash| flash.requested = Some(*key))),
        ..SLOT
    };
    let mut board = board_with(loader, false);
    refused(&mut board, &begin("stm32g474re", 8), OtherBoard);
    for request in [bytes(&image(), 0), End(&[0; 64])] {
        refused(&mut board, &request, Order(0));
    }
    assert_eq!(flash(|flash| flash.requested), None);
    let signed = UpdateRequest::Signed {
        board: "stm32f405rg",
        length: 8,
        sum: &[0; 64],
        signature: &[0; 64],
    };
    // The second request arrives before the restart.
    for request in [BEGIN, BEGIN, signed] {
        answered(&mut board, &request, UpdateAnswer::Loader);
    }
    let key = *keypair().public.as_bytes();
    assert_eq!(flash(|flash| flash.requested), Some(key));
    assert!(!starts(&mut board), "the drive is kept off");
    assert!(flash(|flash| flash.restarts > 0 && flash.erased.is_empty()));
}

#[test]
fn updates_that_are_begun_too_often_are_refused() {
    let mut board = board(false);
    for _ in 0..MAX_UPDATES_PER_START {
        done(&mut board, &BEGIN);
    }
    refused(&mut board, &BEGIN, TooOften);
    refused(&mut board, &bytes(&image(), 0), Order(0));
}
