//! Update of the firmware of the STM32F405 over the link, on the flashed image: confirmed,
//! reverted, and with power cuts.
//!
//! `KBAND_CUTS=N` makes N times as many random cuts.

use super::{
    await_image, begin, drives, other_program, power_cycle, rig_with_key, runs_other, send,
    signature,
};
use kband_control::wire::{UpdateRefusal, UpdateRequest};
use kband_machines::chip::clocks::Cause;
use kband_machines::chip::kind::Kind;
use kband_machines::chip::world::Event;
use kband_machines::draw::Draw;
use kband_machines::rig::{Act, Rig};
use std::ops::Range;
use std::sync::LazyLock;

const BOARD: &str = "stm32f405rg";
/// Lower bound of the number of flash operations in a swap of these programs.
const MIN_SWAP_OPERATIONS: u64 = 150_000;

/// A board whose slot contains the other program; the end request is not sent.
fn written() -> (Rig, [u8; 64]) {
    static WRITTEN: LazyLock<Rig> = LazyLock::new(|| {
        let mut rig = rig_with_key(Kind::Stm32f405);
        let (other, began) = (other_program(&rig), rig.time());
        assert_eq!(rig.update(&begin(BOARD, other.len())), Ok(()));
        assert_eq!(send(&mut rig, &other), Ok(()));
        println!("{} bytes in {:.1} s", other.len(), rig.time() - began);
        rig
    });
    (WRITTEN.clone(), signature(&other_program(&WRITTEN), BOARD))
}

fn on_trial() -> Rig {
    static TRIAL: LazyLock<Rig> = LazyLock::new(|| {
        let (mut rig, end) = written();
        let began = rig.time();
        assert_eq!(rig.update(&UpdateRequest::End(&end)), Ok(()));
        println!("signature checked in {:.2} s", rig.time() - began);
        let began = rig.time();
        await_image(&mut rig);
        println!("swapped in {:.1} s", rig.time() - began);
        rig
    });
    TRIAL.clone()
}

#[test]
fn a_confirmed_update_drives_with_the_old_settings() {
    let mut rig = on_trial();
    assert!(runs_other(&mut rig));
    let trial = rig.time();
    assert_eq!(rig.find_time(trial - 0.3, &Event::Fault(true)), None);
    let operations = rig.chip.operations();
    assert!(!drives(&mut rig), "not on trial");
    assert_eq!(rig.chip.operations(), operations, "a trial writes nothing");
    assert_eq!(rig.update(&begin(BOARD, 8)), Err(UpdateRefusal::OnTrial));
    assert_eq!(rig.update(&UpdateRequest::Confirm), Ok(()));
    assert!(drives(&mut rig));
    power_cycle(&mut rig);
    assert!(runs_other(&mut rig) && drives(&mut rig));
    assert_eq!(rig.update(&UpdateRequest::Confirm), Ok(()));
    assert_eq!(rig.update(&begin(BOARD, 8)), Ok(()), "the next update");
}

#[test]
fn an_unconfirmed_update_is_reverted_by_a_reset() {
    let mut rig = on_trial();
    power_cycle(&mut rig);
    assert!(!runs_other(&mut rig));
    assert!(drives(&mut rig));
    power_cycle(&mut rig);
    assert!(!runs_other(&mut rig), "it stays");
}

/// Operations with a power cut: those of `all`, and `drawn` random ones of `rest` further ones.
fn cuts(draw: &mut Draw, all: Range<u64>, rest: u64, drawn: u32) -> Vec<u64> {
    let times = std::env::var("KBAND_CUTS").map_or(1, |times| times.parse().expect("a number"));
    let drawn = (0..drawn * times).map(|_| all.end + (draw.unit() as f64 * rest as f64) as u64);
    all.clone().chain(drawn).collect()
}

/// Cuts the power at some of the next operations; returns how often each image then runs.
fn cut(rig: &Rig, cuts: &[u64], mut start: impl FnMut(&mut Rig)) -> [u32; 2] {
    let mut old_and_new = [0; 2];
    for cut in cuts {
        let mut rig = rig.clone();
        let began = rig.time();
        rig.chip.board.cut_at = Some(rig.chip.operations() + cut);
        start(&mut rig);
        rig.run_until(0.01, 30.0, |rig| !rig.chip.board.supplied);
        power_cycle(&mut rig);
        let new = runs_other(&mut rig);
        if new && rig.update(&begin(BOARD, 8)) == Err(UpdateRefusal::OnTrial) {
            assert_eq!(rig.update(&UpdateRequest::Confirm), Ok(()), "{cut}");
        }
        old_and_new[usize::from(new)] += 1;
        assert_eq!(rig.find_time(began, &Event::Bridge(true)), None, "{cut}");
    }
    old_and_new
}

#[test]
fn a_cut_mark_or_swap_leaves_the_old_or_the_new_image() {
    let mut draw = Draw::new(37);
    let (rig, end) = written();
    // The mark ends a page, and programs a word of the next one.
    let cuts = cuts(&mut draw, 1..4, MIN_SWAP_OPERATIONS, 3);
    let old_and_new = cut(&rig, &cuts, |rig| {
        let frame = rig.update_frame(&UpdateRequest::End(&end));
        rig.act(&Act::Link(frame));
    });
    println!("cut at {cuts:?}: old and new image {old_and_new:?}");
    let [old, new] = old_and_new;
    assert!(old >= 2 && new >= 3, "{old_and_new:?}");
}

#[test]
fn a_cut_return_leaves_the_old_image() {
    let mut draw = Draw::new(38);
    let rig = on_trial();
    let cuts = cuts(&mut draw, 1..2, MIN_SWAP_OPERATIONS, 2);
    let old_and_new = cut(&rig, &cuts, |rig| rig.chip.reset(Cause::Pin));
    assert_eq!(old_and_new, [cuts.len() as u32, 0]);
}
