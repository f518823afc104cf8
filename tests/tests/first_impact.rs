//! Every arithmetic against an independent oracle, for ordinary and adversarial launches.

use std::sync::Mutex;

use kband::impact::Tone;
use kband_tests::number;
use kband_tests::oracle::Track;
use kband_tests::soak::{replay, soak};
use kband_tests::states::{Kind, Launch};

/// Largest number of printed wrong impacts, because one cause may have thousands.
const MAX_PRINTED: usize = 100;

/// Some thousand launches of each kind; `KBAND_MILLIONS` and `KBAND_SEED` select a longer soak
/// test.
fn soak_all(on_tones: bool) {
    let millions = number("KBAND_MILLIONS", 0) * 1_000_000 / 8;
    let each = if millions > 0 { millions } else { 8_000 };
    let wrong = Mutex::new(Vec::new());
    let tallies = soak(each, on_tones, number("KBAND_SEED", 7), |cause| {
        let mut wrong = wrong.lock().unwrap();
        if wrong.len() < MAX_PRINTED {
            wrong.push(cause.to_owned());
        }
    });
    let wrong = wrong.into_inner().unwrap();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    for (kind, tally) in tallies {
        println!("{kind:?}: {tally:?}");
        assert!(tally.launches >= each);
        let ordinary = !matches!(kind, Kind::Edge | Kind::Grazing | Kind::Flat);
        let open = tally.flagged + tally.undecided;
        assert!(!ordinary || open * 1000 < each, "{kind:?}: {tally:?}");
    }
}

#[test]
fn every_impact_is_the_first() {
    soak_all(false);
}

#[test]
fn every_impact_on_several_tones_is_the_first() {
    soak_all(true);
}

/// Launches that failed in a soak test, each in one arithmetic, or on several tones in an earlier
/// version of the judge. `KBAND_LAUNCH` selects another launch. The iteration ended far from any
/// root or at a later one, or a number overflowed. On several tones the gap is level or within
/// rounding at the end, or the last step is long.
#[test]
fn launches_that_went_astray_once_do_not_again() {
    // k, restitution, phase, velocity; amplitude and angle of both tones.
    let launches = "\
        0.023132896551010206 0.2710876237171167 2.8393086632844273 1.6835547912497957
        0.03519012428370688 0.5763116760714332 2.8007446242647305 1.7171284895259213
        0.04754633112523418 0.6642165470791498 3.860470293454715 1.7564294934272766
        0.2986721122179514 0.7829545940725362 2.6758354118050307 1.831135646729145
        0.9669330791417855 0.10066063358845945 1.0178831069881449 0.011780376227499037
        0.48935913750061094 0.5855877714514119 4.71238928467165 1.4103816747665405
        1.0047419683691856 0.31668494559680804 1.570796005425027 0.007366143586215442
        0.4319734090838992 0.22484586309369858 0.4258307251703763 0.0001475512981414795
        0.6687744855880737 0.5 4.956585342922264 0.05858538063683924 0.04422844643704593 2.473028682702567 0.49190439167432487 4.027142765083594
        0.036666177213191986 0.5 0.9351735011128768 1.1779218912124634 0.38365946570411325 1.6710014899993009 0.49088987219147384 5.758842747944476
        0.8734670281410217 0.5 1.7890589832244281 0.016837129153128648 0.13455773564055562 3.8834187280234134 0.1543038352392614 0.1253389852604064
        0.45561397075653076 0.5 4.725681662626832 1.6527704000473022 0.24626691127195954 1.1631240474138165 0.07384043256752193 2.725558356411393
        0.01220413763076067 0.5 6.178004592814933 3.028766118052361e-26 0.11424984713084996 3.0926211534331016 0 0
        0.36970144510269165 0.5 1.6290708902100857 0.00019097790936939418 0.07761136628697382 1.51444318046587 0 0
    ";
    let replayed = std::env::var("KBAND_LAUNCH");
    let launches = replayed.as_deref().unwrap_or(launches);
    for line in launches.trim().lines() {
        let words = line.split_whitespace();
        let numbers: Vec<f64> = words.map(|word| word.parse().unwrap()).collect();
        let (&[k, restitution, phase, velocity], tones) = numbers.split_first_chunk().unwrap();
        let mut tones = tones.chunks(2).map(|tone| Tone::new(tone[0], tone[1]));
        let tones = [(); 2].map(|()| tones.next().unwrap_or_default());
        let launch = Launch {
            track: Track::on(k, tones),
            restitution,
            phase,
            velocity,
        };
        let text = replay(&launch).unwrap_or_else(|wrong| panic!("{wrong}"));
        println!("{text}");
    }
}
