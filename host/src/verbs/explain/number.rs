//! Value of a quantity on a feeder: its formula, and a number in millimetres.

use kband::feeder::{Restitution, Track, throw_number};
use kband::impact::TangentialSettings;
use kband::regime::band::Band;
use kband::regime::cascade::Cascade;
use kband::transport::locked;

use crate::report::number;

/// The feeder of the numbers.
#[derive(Clone, Copy, Debug)]
pub struct Example {
    /// Its track.
    pub track: Track,
    /// Its parts.
    pub lot: Restitution,
}

/// Amplitude ratio of the built-in scene, and the restitution along the track that its friction
/// leaves a part in lock.
const AMPLITUDE_RATIO: f64 = 1.5;
const TANGENTIAL_RESTITUTION: f64 = 0.0;

impl Example {
    /// The formula of `term` and its value here; `None` without a formula.
    pub fn of(&self, term: &str) -> Option<String> {
        let band = Band::common(self.lot, 1).ok();
        let (formula, here) = self.quantity(term, band)?;
        let lot = if self.lot.low() == self.lot.high() {
            format!("{}", self.lot.low())
        } else {
            format!("{}..{}", self.lot.low(), self.lot.high())
        };
        let here = here.unwrap_or_else(|| "nothing: the parts share no band of order 1".into());
        Some(format!(
            "`{formula}`\n\nAt {} Hz, {} degrees, R = {lot}: {here}.\n",
            number(self.track.frequency(), 6),
            number(self.track.incline().to_degrees(), 4)
        ))
    }

    fn quantity(&self, term: &str, band: Option<Band>) -> Option<(&'static str, Option<String>)> {
        let mm = |k: f64| format!("{:.4} mm", self.track.amplitude(k) * 1e3);
        let at = |k: f64| format!("k = {k:.4} is b = {}", mm(k));
        Some(match term {
            "k" | "amplitude" => {
                let k = band.map_or(0.4, |band| band.setpoint());
                (
                    "k = g cos(alpha)/(b w^2),  b = g cos(alpha)/(k w^2)",
                    Some(at(k)),
                )
            }
            "throw number" => {
                let value = |band: Band| {
                    let k = band.setpoint();
                    let b = self.track.amplitude(k);
                    let (throw, peak) = (throw_number(k), self.track.acceleration(b));
                    format!(
                        "b = {} is a throw number of {throw:.2} and {peak:.2} g at the peak",
                        mm(k)
                    )
                };
                ("1/k = b w^2/(g cos(alpha))", band.map(value))
            }
            "rest" | "lift-off" => {
                let value = format!("a part at rest stays there below b = {}", mm(1.0));
                ("sin(t) = k,  for k < 1", Some(value))
            }
            "band" | "lock" | "order" => {
                let value = |band: Band| {
                    let (most, least) = (mm(band.low()), mm(band.high()));
                    format!(
                        "order 1 locks for b = {least} .. {most} (k {:.4}..{:.4})",
                        band.low(),
                        band.high()
                    )
                };
                (
                    "k2 < k < k1,  k1 = (1+R)/((1-R) pi r),  k2 = 1/sqrt(pi^2 r^2 (1-R)^2/(1+R)^2 + 4 (1+R^2)^2/(1+R)^4)",
                    band.map(value),
                )
            }
            "setpoint" => (
                "k = 2 k1 k2/(k1 + k2): the largest margin in b",
                band.map(|band| at(band.setpoint())),
            ),
            "margin" => {
                let value = |band: Band| {
                    let share = band.margins(band.setpoint()).smallest();
                    let b = self.track.amplitude(band.setpoint()) * 1e3;
                    format!(
                        "{:.1} % of b, {:.4} mm of {b:.4} mm",
                        100.0 * share,
                        share * b
                    )
                };
                ("min(b(k2) - b, b - b(k1))/b", band.map(value))
            }
            "flip" | "cascade" | "chaotic" => {
                let lively = Cascade::locate(self.lot.high(), 1, 7).ok()?;
                let value = lively.k_infinity().map(|chaos| {
                    let flips = lively.flips();
                    let first = flips.first().map_or(String::new(), |k| {
                        format!("flights double from b = {} on, ", mm(*k))
                    });
                    format!("{first}and the doublings pile up at {}", at(chaos.value))
                });
                (
                    "tr J = -(1 + R^2) at a flip; k_n -> k_infinity, each gap about 4.669 times less",
                    value,
                )
            }
            "restitution" | "lot" => {
                let r = self.lot.low();
                let value = format!("dropped from 100 mm it rebounds by {:.1} mm", 100.0 * r * r);
                (
                    "R = sqrt(height of the rebound/height of the drop)",
                    Some(value),
                )
            }
            "conveying speed" => {
                let along = TangentialSettings {
                    restitution: TANGENTIAL_RESTITUTION,
                    amplitude_ratio: AMPLITUDE_RATIO,
                    phase_lead: 0.0,
                    incline_tangent: self.track.incline_tangent(),
                };
                let value = |band: Band| {
                    let k = band.setpoint();
                    let speed = locked::velocity_in_phase(1, k, self.lot.low(), &along)
                        * self.track.velocity_unit(self.track.amplitude(k));
                    format!(
                        "{:.1} mm/s in lock of order 1 (a/b = {AMPLITUDE_RATIO}, friction stops it at every impact: Rt = {TANGENTIAL_RESTITUTION})",
                        speed * 1e3
                    )
                };
                (
                    "V = pi r g cos(alpha)/w {eta (1-R)/(1+R) - tan(alpha) (1+Rt)/(1-Rt)}",
                    band.map(value),
                )
            }
            _ => return None,
        })
    }
}
