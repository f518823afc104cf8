//! Quantity along the columns of a diagram.

use kband::feeder::Track;

use super::Arguments;
use crate::arguments::{self, Range};
use crate::picture::Axis;
use crate::refusal::Refusal;
use crate::report::{Column, columns, number};

/// Quantity along the columns.
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

    pub(super) fn column(self) -> Column {
        match self {
            Self::K { .. } => columns::K,
            Self::Amplitude { .. } => columns::B,
            Self::Restitution { .. } => columns::RESTITUTION,
        }
    }

    pub(super) fn axis(self, Range { low, high, .. }: Range) -> Axis {
        match self {
            Self::K { .. } => Axis::of_k(low, high),
            Self::Amplitude { .. } => Axis::of_b(low, high),
            Self::Restitution { .. } => Axis::new("restitution R", "", low, high),
        }
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

/// The option that is a range, and its quantity.
pub(super) fn chosen(arguments: &Arguments) -> Result<(Over, Range), Refusal> {
    let lot = arguments.restitution.unwrap_or(Range::new(0.2, 0.2, 1));
    let restitution = lot.low;
    let wide = |range: Range| range.count > 1;
    let track = arguments.amplitude.track()?;
    match (arguments.k, arguments.amplitude.b, wide(lot)) {
        (Some(k), _, false) if wide(k) => Ok((Over::K { restitution }, k)),
        (Some(k), _, true) if !wide(k) => Ok((Over::Restitution { k: k.low }, lot)),
        (_, Some(b), false) if wide(b) => Ok((Over::Amplitude { restitution, track }, b)),
        (_, Some(b), true) if !wide(b) => {
            let k = arguments::k_of(&track, b.low)?;
            Ok((Over::Restitution { k }, lot))
        }
        (None, None, false) => {
            let low = 0.8 * kband::regime::band::flip(restitution, 1)?;
            let high = 1.05 * kband::regime::band::birth(restitution, 1)?;
            Ok((Over::K { restitution }, Range::new(low, high, 1000)))
        }
        (k, b, _) => {
            let given = [("k", k), ("b", b), ("restitution", Some(lot))];
            let options = given.into_iter().filter_map(|(name, range)| match range? {
                range if wide(range) => Some(format!("--{name} {range}")),
                range => Some(format!("--{name} {}", range.low)),
            });
            Err(Refusal::value(
                "the range",
                options.collect::<Vec<_>>().join(" "),
                "exactly one of --k, --b and --restitution as a range LO..HI",
                "for example --restitution 0.2 --k 0.3..0.5",
            ))
        }
    }
}
