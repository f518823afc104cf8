//! Impacts of the f64 map to 30 digits, by one Newton step in double-double arithmetic (Dekker
//! 1971).

use std::f64::consts::FRAC_PI_2;

use kband::arithmetic::Twofold;
use kband::impact::{Kernel, Map, PartState};

/// An impact with about 30 digits.
#[derive(Clone, Copy, Debug)]
pub struct Refined {
    /// Duration of the flight, rad.
    pub flight: Twofold,
    /// Arrival speed in `b w`.
    pub arrival: f64,
}

/// Longest flight in rad for the gap divided by the flight, whose f64 series is exact enough up to
/// here.
const MAX_SERIES_FLIGHT: f64 = 0.25;

/// The refined impact of a launch that neither rests nor grazes. `None` if the Newton step is
/// longer than the rounding of a simple root.
pub fn refine(map: &Map, state: PartState) -> Option<Refined> {
    let d = map.impact(state).flight;
    let (time, k) = (Twofold::from(d), Twofold::from(map.k()));
    let phase = Twofold::from(state.phase);
    let [sine, cosine] = sine_cosine(phase);
    let psi = Twofold::from(state.velocity);
    let pull = k.minus(sine);
    let (gap, slope, curvature) = if d < MAX_SERIES_FLIGHT {
        let square = Twofold::product(d, d);
        // (d - sin d)/d^3 and (d^2/2 - 1 + cos d)/d^4.
        let third = series(square, 6.0, 4.0);
        let fourth = series(square, 24.0, 5.0);
        let bend = cosine.times(third).times(time);
        let bend = bend.minus(sine.times(fourth).times(square));
        let half = Twofold::from(0.5);
        let versine = square.times(half.minus(square.times(fourth)));
        let sagitta = square.times(time).times(third);
        let mean = psi.minus(time.times(pull.times(half).minus(bend)));
        let slope = psi.minus(pull.times(time)).plus(cosine.times(versine));
        let curvature =
            cosine.value() * (d - sagitta.value()) - sine.value() * versine.value() - pull.value();
        (
            time.times(mean),
            slope.minus(sine.times(sagitta)),
            curvature,
        )
    } else {
        let [below, speed] = sine_cosine(phase.plus(time));
        let rise = psi.plus(cosine);
        let fallen = time.times(k);
        let mean = rise.minus(fallen.times(Twofold::from(0.5)));
        (
            time.times(mean).plus(sine.minus(below)),
            rise.minus(fallen).minus(speed),
            below.value() - map.k(),
        )
    };
    let step = -gap.value() / slope.value();
    let flight = time.plus(Twofold::from(step));
    (step.abs() <= 1e-9 * d).then(|| Refined {
        flight,
        arrival: -(slope.value() + curvature * step),
    })
}

const QUARTER: Twofold = Twofold {
    high: FRAC_PI_2,
    low: 6.123_233_995_736_766e-17,
};

/// `1/first - square/(first n (n + 1)) + ...`, for a square of at most 1.
fn series(square: Twofold, first: f64, n: f64) -> Twofold {
    let one = Twofold::from(1.0);
    let mut sum = one;
    for i in (0..14).rev() {
        let n = n + 2.0 * f64::from(i);
        sum = one.minus(square.times(sum).over(n * (n + 1.0)));
    }
    sum.over(first)
}

fn sine_cosine(angle: Twofold) -> [Twofold; 2] {
    let quarters = (angle.value() / FRAC_PI_2).round();
    let x = angle.minus(QUARTER.times(Twofold::from(quarters)));
    let square = x.times(x);
    let (sine, cosine) = (x.times(series(square, 1.0, 2.0)), series(square, 1.0, 1.0));
    match quarters.rem_euclid(4.0) as u8 {
        0 => [sine, cosine],
        1 => [cosine, sine.negative()],
        2 => [sine.negative(), cosine.negative()],
        _ => [cosine.negative(), sine],
    }
}
