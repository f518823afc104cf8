//! Quantity over which the columns of a diagram run.

use kband::feeder::Track;

use super::Arguments;
use crate::arguments::{self, Range};
use crate::picture::{Axis, Unit};
use crate::refusal::Refusal;
use crate::report::{Column, columns, number};

/// Quantity over which the columns run.
#[derive(Clone, Copy, Debug)]
pub(super) enum Over {
    K { restitution: f64 },
    Amplitude { restitution: f64, track: Track },
    Restitution { k: f64 },
}

impl Over {
    /// k and restitution of the column at `x`.
    pub(super) fn at(self, x: f64) -> (f64, f64) {
        match self {
            Self::K { restitution } => (x, restitution),
            Self::Amplitude { restitution, track } => (track.k(x * 1e-3), restitution),
            Self::Restitution { k } => (k, x),
        }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::K { .. } => "k",
            Self::Amplitude { .. } => "b",
            Self::Restitution { .. } => "restitution",
        }
    }

    pub(super) fn unit(self) -> &'static str {
        match self {
            Self::Amplitude { .. } => "mm",
            Self::K { .. } | Self::Restitution { .. } => "",
        }
    }

    pub(super) fn column(self) -> Column {
        match self {
            Self::K { .. } => columns::K,
            Self::Amplitude { .. } => columns::B,
            Self::Restitution { .. } => columns::RESTITUTION,
        }
    }

    pub(super) fn axis(self, range: Range) -> Axis {
        let (label, unit) = match self {
            Self::K { .. } => ("k = g cos α / (b ω²)", Unit::NONE),
            Self::Amplitude { .. } => ("amplitude b normal to the track", Unit::MILLIMETRES),
            Self::Restitution { .. } => ("restitution R", Unit::NONE),
        };
        Axis::new(label, unit, range.low, range.high)
    }

    pub(super) fn fixed(self) -> String {
        match self {
            Self::K { restitution } => format!("R = {}", number(restitution, 6)),
            Self::Amplitude { restitution, track } => format!(
                "R = {}, {} Hz, incline {}°",
                number(restitution, 6),
                number(track.frequency(), 6),
                number(track.incline().to_degrees(), 6)
            ),
            Self::Restitution { k } => format!("k = {}", number(k, 6)),
        }
    }
}

/// The range among the three options, and its quantity.
pub(super) fn chosen(arguments: &Arguments) -> Result<(Over, Range), Refusal> {
    let restitution = arguments.restitution.unwrap_or(Range {
        low: 0.2,
        high: 0.2,
        count: 1,
    });
    let wide = |range: Range| range.count > 1;
    let ranges = "exactly one of --k, --b and --restitution as a range LO..HI";
    let refused = |given: String| {
        Refusal::value(
            "the range",
            given,
            ranges,
            "for example --restitution 0.2 --k 0.3..0.5",
        )
    };
    let track = arguments.amplitude.track()?;
    let single = restitution.low;
    match (arguments.k, arguments.amplitude.b, wide(restitution)) {
        (Some(k), _, false) if wide(k) => Ok((
            Over::K {
                restitution: single,
            },
            k,
        )),
        (Some(k), _, true) if !wide(k) => Ok((Over::Restitution { k: k.low }, restitution)),
        (_, Some(b), false) if wide(b) => Ok((
            Over::Amplitude {
                restitution: single,
                track,
            },
            b,
        )),
        (_, Some(b), true) if !wide(b) => Ok((
            Over::Restitution {
                k: arguments::k_of(&track, b.low)?,
            },
            restitution,
        )),
        (None, None, false) => {
            let low = kband::regime::band::flip(single, 1)?;
            let high = kband::regime::band::birth(single, 1)?;
            let range = Range {
                low: 0.8 * low,
                high: 1.05 * high,
                count: 1000,
            };
            Ok((
                Over::K {
                    restitution: single,
                },
                range,
            ))
        }
        (k, b, _) => {
            let words = |name: &str, range: Option<Range>| {
                range.map(|range| {
                    let shown = if wide(range) {
                        range.to_string()
                    } else {
                        range.low.to_string()
                    };
                    format!("--{name} {shown}")
                })
            };
            let given = [
                words("k", k),
                words("b", b),
                words("restitution", Some(restitution)),
            ];
            Err(refused(
                given.into_iter().flatten().collect::<Vec<_>>().join(" "),
            ))
        }
    }
}
