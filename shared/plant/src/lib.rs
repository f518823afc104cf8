//! Simulated feeder for the controller: drive, parts, accelerometer, and the closed loop.
//!
//! A part's flight is one step of the impact map at the track's amplitude at launch. The change of
//! the amplitude within a flight is neglected; at Q = 25 it is at most an eighth of the remaining
//! change.
//!
//! There are two plants. The waveform ([`ClosedLoop`]) passes each sample through the firmware's
//! signal path. It uses integers, single precision and the map's arithmetic only, so desk and
//! emulated CPU give the same bits. The envelope ([`EnvelopeLoop`]) advances by a drive cycle in
//! closed form, under the same controller.
//!
//! A closed loop, sample by sample, with a simulated feeder in place of the board:
//!
//! ```
//! use kband_control::{Controller, Signal, State, Target};
//! use kband_plant::{Bench, Scene};
//! let scene = Scene {
//!     target: Target::K(0.41),
//!     ..Scene::default()
//! };
//! let mut bench = Bench::build(&scene)?;
//! let mut signal = Signal::build(&scene.settings)?;
//! let mut controller = Controller::build(&scene.settings, scene.target, scene.start)?;
//! let mut cycles = 0;
//! while cycles < 60 {
//!     // The sample interrupt.
//!     let before = signal.phase();
//!     let sampled = signal.sample(bench.sample());
//!     bench.hold(sampled.output, (signal.phase() - before).bits());
//!     if sampled.wrapped {
//!         // Once a cycle, with a slice of planning in the idle time that is left.
//!         let report = controller.cycle(signal.cycle(), &bench.inputs());
//!         signal.command(report.command);
//!         controller.plan_step();
//!         cycles += 1;
//!     }
//! }
//! let report = controller.report();
//! assert_eq!(report.state, State::Holding);
//! assert!((report.k / 0.41 - 1.0).abs() < 0.02);
//! # Ok::<(), kband::feeder::OutOfRange>(())
//! ```
#![no_std]
#![deny(unsafe_code)]

#[cfg(test)]
extern crate std;

#[cfg(test)]
mod drawn;
mod envelope;
mod model;
mod waveform;

pub use envelope::EnvelopeLoop;
pub use model::{
    Change, DISTURBANCES, Disturbance, Disturbances, DriveModel, Moment, PARTS, Parts, Scene,
    SensorModel, Strike,
};
pub use waveform::{Bench, ClosedLoop, Plant, Sample};
