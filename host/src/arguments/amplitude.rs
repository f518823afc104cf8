//! Options for the amplitude of the track in mm in place of k.

use kband::feeder::Track;

use super::{DriveArguments, Range, range_or_value, within};
use crate::refusal::{Refusal, Result};
use crate::report::number;

/// The amplitude in mm, for a verb that also takes `--k`, and the drive that makes one of the
/// other; a range without a number has `COUNT` values.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct AmplitudeArguments<const COUNT: usize = 200> {
    /// Amplitude of the track normal to itself in mm, instead of --k: one value, or a range where
    /// --k accepts one.
    #[arg(long, value_name = "MM", value_parser = range_or_value((1e-6, 1e3), COUNT), conflicts_with = "k")]
    pub b: Option<Range>,

    /// Drive frequency in Hz, for options in mm or ms [default: 50].
    #[arg(long, value_name = "HZ", value_parser = within(1.0, 1000.0, "Hz"))]
    frequency: Option<f64>,

    /// Incline of the track in degrees, positive where parts climb, with --b [default: 3].
    #[arg(long, value_name = "DEG", value_parser = within(-60.0, 60.0, "degrees"))]
    incline: Option<f64>,
}

impl<const COUNT: usize> AmplitudeArguments<COUNT> {
    pub fn track(self) -> Result<Track> {
        let drive = DriveArguments {
            frequency: self.hertz(),
            incline: self.incline.unwrap_or(3.0),
        };
        Ok(drive.track()?)
    }

    pub fn hertz(self) -> f64 {
        self.frequency.unwrap_or(50.0)
    }

    /// k for the given amplitude, or `k`.
    pub fn or_k(self, k: Option<f64>) -> Result<Option<f64>> {
        match self.b {
            Some(range) if range.count > 1 => {
                let next = "give one amplitude, for example --b 0.235";
                Err(Refusal::value("--b", range, "one value", next))
            }
            Some(range) => k_of(&self.track()?, range.low).map(Some),
            None => Ok(k),
        }
    }

    /// k for each given amplitude, in order, or each of `k`.
    pub fn or_range(self, k: Option<Range>) -> Result<Option<Vec<f64>>> {
        let Some(range) = self.b else {
            return Ok(k.map(|k| k.values().collect()));
        };
        let track = self.track()?;
        let values: Result<_, _> = range.values().map(|b| k_of(&track, b)).collect();
        values.map(Some)
    }

    /// Text such as `k = 0.43`, with the amplitude if it was given.
    pub fn describe(self, k: f64) -> Result<String> {
        let k_text = format!("k = {}", number(k, 6));
        if self.b.is_none() {
            return Ok(k_text);
        }
        let track = self.track()?;
        let incline = track.incline().to_degrees();
        let [b, frequency, incline] =
            [1e3 * track.amplitude(k), track.frequency(), incline].map(|value| number(value, 6));
        let drive = format!("{frequency} Hz, incline {incline}°");
        Ok(format!("b = {b} mm at {drive} ({k_text})"))
    }
}

/// k at an amplitude in mm, within the range of the map.
pub fn k_of(track: &Track, amplitude: f64) -> Result<f64> {
    const MIN_K: f64 = 0.001;
    const MAX_K: f64 = 1000.0;
    let k = track.k(1e-3 * amplitude);
    if (MIN_K..=MAX_K).contains(&k) {
        return Ok(k);
    }
    let [low, high] = [MAX_K, MIN_K].map(|k| number(1e3 * track.amplitude(k), 3));
    let value = format!("{} mm", number(amplitude, 6));
    let ks = format!("k = {MAX_K}..{MIN_K} at this frequency and incline");
    let accepted = format!("{low}..{high} mm, which is {ks}");
    let next = "give an amplitude in this range";
    Err(Refusal::value("--b", value, accepted, next))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(low: f64, high: f64, count: usize) -> AmplitudeArguments {
        AmplitudeArguments {
            b: Some(Range { low, high, count }),
            frequency: Some(60.0),
            incline: Some(10.0),
        }
    }

    #[test]
    fn millimetres_become_k() {
        // g cos(10 degrees) / (b w^2) with w = 2 pi 60.
        let expected =
            9.80665 * 10_f64.to_radians().cos() / (0.2e-3 * (120.0 * std::f64::consts::PI).powi(2));
        let k = parse(0.2, 0.2, 1).or_k(None).unwrap().unwrap();
        assert!((k - expected).abs() < 1e-14, "{k}");
        let described = parse(0.2, 0.2, 1).describe(k).unwrap();
        assert_eq!(described, "b = 0.2 mm at 60 Hz, incline 10° (k = 0.339766)");
        let both = parse(0.1, 0.2, 2).or_range(None).unwrap().unwrap();
        assert_eq!(both.len(), 2);
        assert!((both[0] - 2.0 * expected).abs() < 1e-14 && both[1] == k);
    }
}
