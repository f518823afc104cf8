//! One part on one track: each impact and the regime.
//!
//! `cargo run -p kband --example orbit`

use std::error::Error;

use kband::impact::{Kernel, Map, Orbit, OrbitEvent};
use kband::regime::Lock;
use kband::regime::classify::{Classifier, Regime, TimingAccuracy};

/// The regime of a part that started from rest, after some thousand events.
fn regime(k: f64, restitution: f64) -> Result<Regime, Box<dyn Error>> {
    let map = Map::build(k, restitution)?;
    let mut classifier = Classifier::<256>::build(TimingAccuracy::COMPUTED)?;
    for event in Orbit::from_rest(&map).take(3000) {
        match event {
            OrbitEvent::Impact(impact) => classifier.flight(impact.flight),
            OrbitEvent::Rest { chatter, .. } => classifier.wait(chatter),
            OrbitEvent::LiftOff { wait, .. } => classifier.wait(wait),
        }
    }
    Ok(classifier.verdict().regime)
}

fn main() -> Result<(), Box<dyn Error>> {
    let map = Map::build(0.405, 0.2)?;
    println!("k = 0.405, R = 0.2, from rest:");
    for (n, event) in Orbit::from_rest(&map).take(12).enumerate() {
        println!("{n:3}  {event:?}");
    }
    let lock = Lock::build(0.405, 0.2, 1)?.ok_or("no lock of order 1")?;
    println!("it goes to the lock at {:?}", lock.state());
    for k in [0.405, 0.43, 0.365, 0.35] {
        println!("from rest at k = {k}: {:?}", regime(k, 0.2)?);
    }
    Ok(())
}

#[test]
fn it_runs() {
    main().unwrap();
}

#[test]
fn a_part_from_rest_locks_in_a_piece_of_the_band_only() {
    let locked = Regime::Locked { order: 1 };
    assert_eq!(regime(0.405, 0.2).unwrap(), locked);
    assert_ne!(regime(0.43, 0.2).unwrap(), locked);
}
