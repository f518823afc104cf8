//! Axes: a quantity with its unit, range and round ticks.

use std::f64::consts::PI;

use crate::report::number;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Division {
    Decimal,
    Decades,
    Pi,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    label: String,
    unit: &'static str,
    low: f64,
    high: f64,
    division: Division,
}

impl Axis {
    /// An axis, widened if `low..high` encloses nothing; a pure number has the unit "".
    pub fn new(label: impl Into<String>, unit: &'static str, low: f64, high: f64) -> Self {
        let low = if low.is_finite() { low } else { 0.0 };
        let (low, high) = if high.is_finite() && high > low {
            (low, high)
        } else if high == low && low != 0.0 {
            (low - 0.1 * low.abs(), low + 0.1 * low.abs())
        } else {
            (low, low + low.abs().max(1.0) * 0.1)
        };
        Self {
            label: label.into(),
            unit,
            low,
            high,
            division: Division::Decimal,
        }
    }

    pub fn of_k(low: f64, high: f64) -> Self {
        Self::new("k = g cos α / (b ω²)", "", low, high)
    }

    pub fn of_b(low: f64, high: f64) -> Self {
        Self::new("amplitude b normal to the track", "mm", low, high)
    }

    /// An axis over all `values`, with some room at both ends.
    pub fn over_values(
        label: impl Into<String>,
        unit: &'static str,
        values: impl IntoIterator<Item = f64>,
    ) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values.into_iter().filter(|value| value.is_finite()) {
            low = low.min(value);
            high = high.max(value);
        }
        let room = 0.04 * (high - low);
        Self::new(label, unit, low - room, high + room)
    }

    /// The axis in decades; a range that is not positive stays linear.
    pub fn logarithmic(mut self) -> Self {
        if self.low > 0.0 {
            self.division = Division::Decades;
        }
        self
    }

    pub fn in_pi(mut self) -> Self {
        self.division = Division::Pi;
        self
    }

    pub(super) fn title(&self) -> String {
        let unit = match self.unit {
            "" => "–".into(),
            // Units are typed in this form in scenes and settings.
            unit => unit.replace("^2", "²"),
        };
        format!("{} ({unit})", self.label)
    }

    /// Relative position of `value`: 0 at the low end, 1 at the high end, NaN without a position.
    pub(super) fn part(&self, value: f64) -> f64 {
        match self.division {
            Division::Decades if value > 0.0 => {
                (value / self.low).log10() / (self.high / self.low).log10()
            }
            Division::Decades => f64::NAN,
            _ => (value - self.low) / (self.high - self.low),
        }
    }

    /// Cell of a value among this many equal ones, the first at the high end; `None` beyond the axis.
    pub fn cell(&self, value: f64, cells: usize) -> Option<usize> {
        let part = self.part(value);
        let cell = ((1.0 - part) * cells as f64) as usize;
        let cell = cell.min(cells.saturating_sub(1));
        (0.0..=1.0).contains(&part).then_some(cell)
    }

    /// Ticks with labels: about `target_count`, at least three, because fewer leave the scale
    /// ambiguous.
    pub(super) fn ticks(&self, target_count: usize) -> Vec<(f64, String)> {
        let of_count = |count: usize| match self.division {
            Division::Pi => parts_of_pi(self.low, self.high, count),
            Division::Decades => decades(self.low, self.high, count),
            Division::Decimal => decimal(self.low, self.high, count),
        };
        let fewest = target_count.max(2);
        let mut finer = (fewest..fewest + 4 * MIN_LABELS).map(of_count);
        let enough = finer.find(|ticks| ticks.len() >= MIN_LABELS);
        enough.unwrap_or_else(|| of_count(fewest + 4 * MIN_LABELS - 1))
    }

    /// Minor ticks of a logarithmic axis, nine a decade.
    pub(super) fn small_ticks(&self) -> Vec<f64> {
        let first = self.low.log10().floor() as i32;
        let last = self.high.log10().ceil() as i32;
        if self.division != Division::Decades || last - first > 12 {
            return Vec::new();
        }
        let of_decade = |n| (1..10).map(move |digit| f64::from(digit) * 10_f64.powi(n));
        let all = (first..last).flat_map(of_decade);
        all.filter(|value| (self.low..=self.high).contains(value))
            .collect()
    }
}

const MIN_LABELS: usize = 3;

fn decimal(low: f64, high: f64, target_count: usize) -> Vec<(f64, String)> {
    let rough = (high - low) / target_count as f64;
    let decade = 10_f64.powf(rough.log10().floor());
    let mut steps = [1.0, 2.0, 5.0].map(|round| round * decade).into_iter();
    let step = steps.find(|step| *step >= rough).unwrap_or(10.0 * decade);
    let decimals = (-(step * 1.000_001).log10().floor()).clamp(0.0, 12.0) as usize;
    let tick = |n: i64| {
        let value = n as f64 * step;
        let label = match (1e-4..1e6).contains(&step) || value == 0.0 {
            true => format!("{value:.decimals$}"),
            false => number(value, 6),
        };
        (value, label.replace('-', "−"))
    };
    multiples(low, high, step).map(tick).collect()
}

fn decades(low: f64, high: f64, target_count: usize) -> Vec<(f64, String)> {
    let (first, last) = (low.log10().ceil() as i32, high.log10().floor() as i32);
    let count = (last - first + 1).max(0) as usize;
    let raised = |sign: char| match sign.to_digit(10) {
        Some(digit) => "⁰¹²³⁴⁵⁶⁷⁸⁹".chars().nth(digit as usize),
        None => Some('⁻'),
    };
    let power = |n: i32| {
        let label = match n {
            -3..=3 => number(10_f64.powi(n), 6),
            _ => "10".to_string() + &n.to_string().chars().filter_map(raised).collect::<String>(),
        };
        (10_f64.powi(n), label)
    };
    // With enough room also two and five in each decade.
    let ticks: Vec<(f64, String)> = if count >= 2 && 3 * count > target_count {
        let every = count.div_ceil(target_count).max(1) as i32;
        let labelled = (first..=last).filter(|n| n.rem_euclid(every) == 0);
        labelled.map(power).collect()
    } else {
        let rounds = |n| [1.0, 2.0, 5.0].map(|round: f64| round * 10_f64.powi(n));
        let values = (first - 1..=last + 1).flat_map(rounds);
        let within = values.filter(|value| (low..=high).contains(value));
        within.map(|value| (value, number(value, 6))).collect()
    };
    // A range below a few decades has the labels of a linear scale.
    match ticks.len() {
        MIN_LABELS.. => ticks,
        _ => decimal(low, high, target_count),
    }
}

fn parts_of_pi(low: f64, high: f64, target_count: usize) -> Vec<(f64, String)> {
    let rough = (high - low) / target_count as f64 / PI;
    let mut steps = [(1, 12), (1, 6), (1, 4), (1, 3), (1, 2), (1, 1), (2, 1_i64)].into_iter();
    let step = steps.find(|(over, under)| *over as f64 / *under as f64 >= rough);
    let Some((over, under)) = step else {
        return decimal(low, high, target_count);
    };
    let step = over as f64 / under as f64 * PI;
    let tick = |n: i64| {
        let (mut over, mut under) = (n * over, under);
        for divisor in [2, 3, 2] {
            if over % divisor == 0 && under % divisor == 0 {
                (over, under) = (over / divisor, under / divisor);
            }
        }
        let sign = if over < 0 { "−" } else { "" };
        let label = match (over.abs(), under) {
            (0, _) => "0".to_string(),
            (1, 1) => format!("{sign}π"),
            (over, 1) => format!("{sign}{over}π"),
            (1, under) => format!("{sign}π/{under}"),
            (over, under) => format!("{sign}{over}π/{under}"),
        };
        (n as f64 * step, label)
    };
    multiples(low, high, step).map(tick).collect()
}

/// Integer multiples of `step` within the range, with a tolerance of a rounding error.
fn multiples(low: f64, high: f64, step: f64) -> impl Iterator<Item = i64> {
    let slack = 1e-9;
    let first = (low / step - slack).ceil() as i64;
    let last = (high / step + slack).floor() as i64;
    first..=last.min(first.saturating_add(100))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &Axis, target_count: usize) -> Vec<String> {
        let ticks = axis.ticks(target_count).into_iter();
        ticks.map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_are_round() {
        let axis = |low, high| Axis::new("k", "", low, high);
        let narrow = labels(&axis(0.3, 0.5), 5);
        assert_eq!(narrow, ["0.30", "0.35", "0.40", "0.45", "0.50"]);
        let signed = labels(&axis(-1.0, 1.0), 4);
        assert_eq!(signed, ["−1.0", "−0.5", "0.0", "0.5", "1.0"]);
        assert_eq!(labels(&axis(0.0, 2e7), 2), ["0", "1e7", "2e7"]);
        assert_eq!(labels(&axis(0.0, 180.0), 3), ["0", "50", "100", "150"]);
        assert_eq!(labels(&axis(0.0, 1.2), 2), ["0.0", "0.5", "1.0"]);
        let log = axis(1e-12, 1.0).logarithmic();
        assert_eq!(labels(&log, 4), ["10⁻¹²", "10⁻⁸", "10⁻⁴", "1"]);
        assert_eq!(log.part(1e-6), 0.5);
        let speeds = axis(60.0, 3000.0).logarithmic();
        assert_eq!(labels(&speeds, 8), ["100", "200", "500", "1000", "2000"]);
        let short = axis(2.1, 4.4).logarithmic();
        assert_eq!(labels(&short, 6), ["2.5", "3.0", "3.5", "4.0"]);
        let small = axis(7.5, 35.0).logarithmic().small_ticks();
        assert_eq!(small, [8.0, 9.0, 10.0, 20.0, 30.0]);
        assert!(axis(7.5, 35.0).small_ticks().is_empty());
        let turn = Axis::new("phase", "rad", 0.0, 2.0 * PI).in_pi();
        assert_eq!(labels(&turn, 4), ["0", "π/2", "π", "3π/2", "2π"]);
    }

    #[test]
    fn an_empty_range_is_widened() {
        let axis = Axis::new("k", "", 1.0, 1.0);
        assert!((axis.part(1.0) - 0.5).abs() < 1e-9 && !axis.ticks(5).is_empty());
        assert!(Axis::over_values("k", "", [f64::NAN]).part(0.0).is_finite());
    }
}
