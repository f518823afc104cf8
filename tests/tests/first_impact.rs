//! Every arithmetic against an independent oracle on ordinary and adversarial launches.

use std::sync::Mutex;

use kband_tests::soak::soak;

/// The full soak is `soak` in this crate's binaries; this is some thousand launches of each kind.
#[test]
fn every_impact_is_the_first() {
    let wrong = Mutex::new(String::new());
    let tallies = soak(8_000, 7, 1, |cause| {
        let mut wrong = wrong.lock().unwrap();
        wrong.push_str(cause);
        wrong.push('\n');
    });
    println!("{tallies:?}");
    let wrong = wrong.into_inner().unwrap();
    assert!(wrong.is_empty(), "{wrong}");
    assert!(tallies.iter().all(|(_, tally)| tally.launches >= 8_000));
}
