//! Every arithmetic against an independent oracle on ordinary and adversarial launches.

use std::sync::Mutex;

use kband_tests::soak::{replay, soak};
use kband_tests::states::Launch;

/// Some thousand launches of each kind; the full soak is the binary `soak` of this crate.
#[test]
fn every_impact_is_the_first() {
    let wrong = Mutex::new(String::new());
    let tallies = soak(8_000, 7, 1, |cause| {
        let mut wrong = wrong.lock().unwrap();
        wrong.push_str(cause);
        wrong.push('\n');
    });
    let wrong = wrong.into_inner().unwrap();
    assert!(wrong.is_empty(), "{wrong}");
    assert!(tallies.iter().all(|(_, tally)| tally.launches >= 8_000));
}

/// Failures found by soaks, each in one arithmetic.
///
/// The approach ended far from any root or at a later one, or a number overflowed.
#[test]
fn launches_that_went_astray_once_do_not_again() {
    // k, restitution, phase, velocity.
    let launches = "\
        0.023132896551010206 0.2710876237171167 2.8393086632844273 1.6835547912497957
        0.03519012428370688 0.5763116760714332 2.8007446242647305 1.7171284895259213
        0.04754633112523418 0.6642165470791498 3.860470293454715 1.7564294934272766
        0.2986721122179514 0.7829545940725362 2.6758354118050307 1.831135646729145
        0.9669330791417855 0.10066063358845945 1.0178831069881449 0.011780376227499037
        0.48935913750061094 0.5855877714514119 4.71238928467165 1.4103816747665405
        1.0047419683691856 0.31668494559680804 1.570796005425027 0.007366143586215442
        0.4319734090838992 0.22484586309369858 0.4258307251703763 0.0001475512981414795
    ";
    for line in launches.trim().lines() {
        let numbers: Vec<f64> = line
            .split_whitespace()
            .map(|number| number.parse().unwrap())
            .collect();
        let [k, restitution, phase, velocity] = numbers[..] else {
            panic!("{line}")
        };
        let launch = Launch::new(k, restitution, phase, velocity);
        if let Err(wrong) = replay(&launch) {
            panic!("{wrong}");
        }
    }
}
