//! Powers of a complex number with integer exponents, from two tables and one product.

use super::recurrence::exp;
use num_complex::Complex64 as Complex;

const TABLE_BITS: u64 = 4;
const TABLE_SIZE: usize = 1 << TABLE_BITS;
const TABLE_END: u64 = 1 << (2 * TABLE_BITS);

/// `e^(log n)` for n = 0, 1, 2 ...
#[derive(Clone, Copy, Debug, Default)]
pub struct Powers {
    log: Complex,
    /// Powers for exponents below 16, and for multiples of 16.
    fine: [Complex; TABLE_SIZE],
    coarse: [Complex; TABLE_SIZE],
}

impl Powers {
    pub fn new(log: Complex) -> Self {
        let row = |step: Complex| {
            let mut power = Complex::new(1.0, 0.0);
            core::array::from_fn(|_| {
                let next = power * step;
                core::mem::replace(&mut power, next)
            })
        };
        Self {
            log,
            fine: row(exp(log)),
            coarse: row(exp(log * TABLE_SIZE as f64)),
        }
    }

    /// `e^(log n)`; the relative error is at most 2e-14 within the tables, n < 256.
    #[inline]
    pub fn at(&self, n: u64) -> Complex {
        if n >= TABLE_END {
            return self.beyond(n);
        }
        let (coarse, fine) = ((n >> TABLE_BITS) as usize, n as usize % TABLE_SIZE);
        if coarse == 0 {
            return self.fine[fine];
        }
        self.coarse[coarse % TABLE_SIZE] * self.fine[fine]
    }

    #[cold]
    fn beyond(&self, n: u64) -> Complex {
        exp(self.log * n as f64)
    }
}
