//! Time of the first impact after a launch, proven once for all arithmetics with this very launch.

use crate::states::Launch;
use crate::{certificate, oracle};

/// A launch, with sine and cosine of its phase.
#[derive(Clone, Copy, Debug)]
pub struct Launched {
    launch: Launch,
    track: [f64; 2],
}

impl Launched {
    /// From a launch.
    pub fn of(launch: Launch) -> Self {
        let (sine, cosine) = launch.phase.sin_cos();
        Self {
            launch,
            track: [sine, cosine],
        }
    }

    /// The launch.
    pub fn launch(&self) -> &Launch {
        &self.launch
    }

    /// The gap and its first two derivatives `d` after the launch.
    pub fn gap(&self, d: f64) -> [f64; 3] {
        let Launch {
            k, phase, velocity, ..
        } = self.launch;
        oracle::gap_from(self.track, k, phase, velocity, d)
    }

    /// Rounding error of that gap.
    pub fn rounding(&self, d: f64) -> f64 {
        oracle::rounding_from(self.track, self.launch.k, self.launch.velocity, d)
    }

    /// Excess of the track's push over k at the launch.
    pub fn excess(&self) -> f64 {
        self.track[0] - self.launch.k
    }

    /// Distance in rad from the launch to the phase at which the push passes k.
    pub fn from_edge(&self) -> f64 {
        (self.excess() / self.track[1]).abs()
    }
}

/// Time of the first impact after a launch.
pub struct Proof {
    /// The launch.
    pub launched: Launched,
    /// The impact time of the f64 map.
    guess: f64,
    /// The proven time of the quick certificate, after the first attempt.
    soon: Option<Option<f64>>,
    first: Option<f64>,
}

impl Proof {
    /// The proof of a launch; it tries the impact time `guess` first.
    pub fn of(launch: Launch, guess: f64) -> Self {
        Self {
            launched: Launched::of(launch),
            guess,
            soon: None,
            first: None,
        }
    }

    /// The first impact's time, if the quick certificate proves `guess`.
    pub fn soon(&mut self) -> Option<f64> {
        if self.soon.is_none() {
            self.soon = Some(self.proven());
        }
        self.soon.flatten()
    }

    fn proven(&self) -> Option<f64> {
        let Launch {
            k, phase, velocity, ..
        } = *self.launched.launch();
        let d = self.guess;
        let [height, slope, curvature] = self.launched.gap(d);
        let noise = self.launched.rounding(d);
        let simple = slope < 0.0 && slope * slope > 100.0 * curvature.abs() * noise;
        (simple && height.abs() <= 16.0 * noise && certificate::is_first(k, phase, velocity, d))
            .then_some(d)
    }

    /// The first impact's time: by the quick certificate, else by the oracle.
    pub fn first(&mut self) -> f64 {
        let Launch {
            k, phase, velocity, ..
        } = *self.launched.launch();
        let soon = self.soon();
        *self.first.get_or_insert_with(|| {
            soon.unwrap_or_else(|| oracle::first_impact(k, phase, velocity).duration)
        })
    }
}
