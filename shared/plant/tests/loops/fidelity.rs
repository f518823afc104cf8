//! Either plant under the controller, and the true time in gear of its parts.

use core::f64::consts::TAU;

use kband::regime::gear::GearWatch;
use kband_control::Controller;
use kband_plant::{ClosedLoop, EnvelopeLoop, Moment, Scene, Strike};

/// Either fidelity.
pub enum Loop {
    Envelope(Box<EnvelopeLoop>),
    Waveform(Box<ClosedLoop>),
}

impl Loop {
    pub fn build(scene: &Scene, waveform: bool) -> Self {
        if waveform {
            Self::Waveform(Box::new(ClosedLoop::build(scene).unwrap()))
        } else {
            Self::Envelope(Box::new(EnvelopeLoop::build(scene).unwrap()))
        }
    }

    pub fn both(scene: &Scene) -> [Self; 2] {
        [false, true].map(|waveform| Self::build(scene, waveform))
    }

    /// A drive cycle: the moment, its impacts and READY.
    pub fn cycle(&mut self) -> (Moment, Vec<Strike>, bool) {
        let (moment, strikes) = match self {
            Self::Envelope(closed) => (closed.cycle(), closed.strikes().to_vec()),
            Self::Waveform(closed) => (closed.cycle(), closed.plant().strikes().to_vec()),
        };
        (moment, strikes, self.controller().is_ready())
    }

    pub fn controller(&self) -> &Controller {
        match self {
            Self::Envelope(closed) => closed.controller(),
            Self::Waveform(closed) => closed.controller(),
        }
    }
}

/// Records the strikes of a cycle, a watch for each part.
pub fn record(watches: &mut [GearWatch], strikes: &[Strike]) {
    for strike in strikes {
        let landed = strike.time as f64 / 4_294_967_296.0 * TAU;
        let flight = f64::from(strike.flight) * TAU;
        let watch = &mut watches[usize::from(strike.part)];
        if strike.rested {
            watch.add_rest(landed - flight);
        }
        watch.add_landing(landed, flight);
    }
}
