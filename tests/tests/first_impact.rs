//! The kernels against an independent oracle on ordinary and adversarial launches.

use kband_tests::states::{Kind, Random};
use kband_tests::verdict::judge;

/// The full soak is `soak` in this crate's binaries; this is its first few thousand launches.
#[test]
fn every_impact_is_the_first() {
    for kind in Kind::ALL {
        let mut random = Random::new(7);
        for _ in 0..6_000 {
            let launch = kind.draw(&mut random);
            if let Err(cause) = judge(&launch) {
                panic!("{kind:?}: {cause}");
            }
        }
    }
}
