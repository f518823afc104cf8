//! Two registers processed together, which hides the latency of each behind the other.

use core::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

use super::{Column, Lane, MAX_LANES};

/// Two registers, the lower lanes first.
#[derive(Clone, Copy)]
pub(crate) struct Twice<T>(T, T);

macro_rules! operators {
    ($($operator:ident $method:ident,)*) => {$(
        impl<T: $operator<Output = T>> $operator for Twice<T> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(self.0.$method(other.0), self.1.$method(other.1))
            }
        }
    )*};
}

operators! {
    Add add, Sub sub, Mul mul, Div div, BitAnd bitand, BitOr bitor,
}

impl<T: Neg<Output = T>> Neg for Twice<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0, -self.1)
    }
}

impl<T: Not<Output = T>> Not for Twice<T> {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0, !self.1)
    }
}

/// Upper half of these bytes, moved to the front.
#[inline(always)]
fn upper<L: Lane>(bytes: [u8; MAX_LANES]) -> [u8; MAX_LANES] {
    (u64::from_le_bytes(bytes) >> (8 * L::WIDTH)).to_le_bytes()
}

impl<L: Lane> Lane for Twice<L> {
    type Mask = Twice<L::Mask>;

    const WIDTH: usize = {
        assert!(2 * L::WIDTH <= MAX_LANES);
        2 * L::WIDTH
    };

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self(L::splat(value), L::splat(value))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt(), self.1.sqrt())
    }
    #[inline(always)]
    fn rough_sqrt(self) -> Self {
        Self(self.0.rough_sqrt(), self.1.rough_sqrt())
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0), self.1.max(other.1))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0), self.1.min(other.1))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.abs(), self.1.abs())
    }
    #[inline(always)]
    fn below(self, other: Self) -> Self::Mask {
        Twice(self.0.below(other.0), self.1.below(other.1))
    }
    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        Self(
            L::select(mask.0, yes.0, no.0),
            L::select(mask.1, yes.1, no.1),
        )
    }
    #[inline(always)]
    fn keep_where(self, mask: Self::Mask) -> Self {
        Self(self.0.keep_where(mask.0), self.1.keep_where(mask.1))
    }
    #[inline(always)]
    fn bits(mask: Self::Mask) -> u32 {
        L::bits(mask.0) | L::bits(mask.1) << L::WIDTH
    }
    #[inline(always)]
    fn unpaired(self) -> Self {
        Self(self.0.unpaired(), self.1.unpaired())
    }
    #[inline(always)]
    fn node(rounded: Self) -> (Self, Self) {
        let (low, high) = (L::node(rounded.0), L::node(rounded.1));
        (Self(low.0, high.0), Self(low.1, high.1))
    }
    #[inline(always)]
    fn node_at(rounded: &[f64], at: usize) -> (Self, Self) {
        let (low, high) = (L::node_at(rounded, at), L::node_at(rounded, at + L::WIDTH));
        (Self(low.0, high.0), Self(low.1, high.1))
    }
    #[inline(always)]
    fn is_same_node(rounded: Self, other: Self) -> Self::Mask {
        Twice(
            L::is_same_node(rounded.0, other.0),
            L::is_same_node(rounded.1, other.1),
        )
    }
    #[inline(always)]
    fn within_turn(rounded: Self) -> (Self, Self) {
        let (low, high) = (L::within_turn(rounded.0), L::within_turn(rounded.1));
        (Self(low.0, high.0), Self(low.1, high.1))
    }
    #[inline(always)]
    fn mask(bits: u32) -> Self::Mask {
        Twice(L::mask(bits), L::mask(bits >> L::WIDTH))
    }
    #[inline(always)]
    fn load(values: &[f64], at: usize) -> Self {
        Self(L::load(values, at), L::load(values, at + L::WIDTH))
    }
    #[inline(always)]
    fn store(self, values: &mut [f64], at: usize) {
        self.0.store(values, at);
        self.1.store(values, at + L::WIDTH);
    }
    #[inline(always)]
    fn store_where(self, mask: Self::Mask, values: &mut [f64], at: usize) {
        self.0.store_where(mask.0, values, at);
        self.1.store_where(mask.1, values, at + L::WIDTH);
    }
    #[inline(always)]
    fn pick(column: &Column, numbers: [u8; MAX_LANES]) -> Self {
        Self(
            L::pick(column, numbers),
            L::pick(column, upper::<L>(numbers)),
        )
    }
    #[inline(always)]
    fn choose(bytes: [u8; MAX_LANES], places: u64) -> [u8; MAX_LANES] {
        L::choose(bytes, places)
    }
    #[inline(always)]
    fn to_array(self) -> [f64; MAX_LANES] {
        let mut values = [0.0; MAX_LANES];
        self.store(&mut values, 0);
        values
    }
}
