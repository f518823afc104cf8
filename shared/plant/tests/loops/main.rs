//! The controller in a closed loop with the simulated feeder.

mod bounds;
mod capture;
mod commissioned;
mod contact;
mod conveying;
mod fidelity;
mod held;
mod hopper;
mod identification;
mod lots;
mod margin;
mod misfit;
mod share;
mod tones;
