//! Twofold (double-double) arithmetic: a number as the unevaluated sum of two f64, to about 104
//! bits (Dekker, Numer. Math. 18 (1971) 224).

/// `high + low`, |low| at most half an ulp of `high`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Twofold {
    /// The nearest f64.
    pub high: f64,
    /// The exact value minus `high`.
    pub low: f64,
}

impl Twofold {
    /// An f64, exactly.
    pub const fn from(high: f64) -> Self {
        let low = 0.0;
        Self { high, low }
    }

    /// `a + b` for |a| >= |b|, exactly (Dekker's fast two-sum).
    const fn normal(a: f64, b: f64) -> Self {
        let high = a + b;
        let low = b - (high - a);
        Self { high, low }
    }

    /// `a + b`, exactly (Knuth).
    pub const fn sum(a: f64, b: f64) -> Self {
        let high = a + b;
        let part = high - a;
        let low = (a - (high - part)) + (b - part);
        Self { high, low }
    }

    /// `a b`, exactly (Dekker) unless it overflows or its rest underflows.
    pub const fn product(a: f64, b: f64) -> Self {
        let high = a * b;
        let (x, y) = (Self::halves(a), Self::halves(b));
        let low = ((x.high * y.high - high) + x.high * y.low + x.low * y.high) + x.low * y.low;
        Self { high, low }
    }

    /// Upper and lower 26 bits (Veltkamp's split).
    const fn halves(value: f64) -> Self {
        let scaled = 134_217_729.0 * value;
        let high = scaled - (scaled - value);
        let low = value - high;
        Self { high, low }
    }

    /// `-self`.
    pub const fn negative(self) -> Self {
        let (high, low) = (-self.high, -self.low);
        Self { high, low }
    }

    /// `self + other`.
    pub const fn plus(self, other: Self) -> Self {
        let sum = Self::sum(self.high, other.high);
        Self::normal(sum.high, sum.low + self.low + other.low)
    }

    /// `self - other`.
    pub const fn minus(self, other: Self) -> Self {
        self.plus(other.negative())
    }

    /// `self other`.
    pub const fn times(self, other: Self) -> Self {
        let Self { high, low } = Self::product(self.high, other.high);
        Self::normal(high, low + (self.high * other.low + self.low * other.high))
    }

    /// Division by a number with few bits.
    pub const fn over(self, divisor: f64) -> Self {
        let high = self.high / divisor;
        let rest = self.minus(Self::product(high, divisor));
        Self::normal(high, rest.high / divisor)
    }

    /// The nearest f64.
    pub const fn value(self) -> f64 {
        self.high + self.low
    }
}
