//! The bands of k that a lot of parts shares, and the amplitudes at the feeder.
//!
//! `cargo run -p kband --example bands`

use std::error::Error;

use kband::feeder::{Restitution, STANDARD_GRAVITY, Track, TrackSettings, throw_number};
use kband::regime::band::{Band, BandError};

fn main() -> Result<(), Box<dyn Error>> {
    let track = Track::build(TrackSettings {
        frequency: 50.0,
        incline: 3.0,
        amplitude_ratio: 1.5,
        phase_lead: 0.0,
        gravity: STANDARD_GRAVITY,
    })?;
    for (low, high) in [(0.18, 0.22), (0.1, 0.3)] {
        let lot = Restitution::interval(low, high)?;
        println!("restitution {low}..{high}");
        for order in 1..=3 {
            match Band::common(lot, order) {
                Ok(band) => {
                    let k = band.setpoint();
                    println!(
                        "  order {order}: k {:.4}..{:.4}, best at {k:.4}: b = {:.4} mm, throw number {:.2}",
                        band.low(),
                        band.high(),
                        track.amplitude(k) * 1e3,
                        throw_number(k),
                    );
                }
                Err(BandError::Empty(reason)) => println!("  order {order}: {reason}"),
                Err(refused) => return Err(refused.into()),
            }
        }
    }
    Ok(())
}

#[test]
fn it_runs() {
    main().unwrap();
}
