//! Number systems: binary angles with sine and cosine, fixed-point and double-double (twofold)
//! numbers, SIMD vectors; square roots, bisection and random numbers with the same bits on every
//! CPU.

mod bisection;
pub(crate) mod fixed;
pub(crate) mod node;
mod noise;
mod phase;
pub(crate) mod positive;
#[allow(unsafe_code)]
mod root;
pub(crate) mod trigonometry;
pub(crate) mod twofold;
pub(crate) mod vector;
mod ziggurat;

pub(crate) use bisection::bisect;
pub use fixed::Velocity;
pub use noise::Noise;
pub(crate) use noise::splitmix;
pub use phase::Phase;
pub(crate) use root::square_root;
pub use root::square_root_single;
pub(crate) use trigonometry::arcsine_single;
pub use trigonometry::{sine_cosine, sine_cosine_single};
pub use twofold::Twofold;
pub(crate) use ziggurat::gauss;
#[cfg(test)]
pub(crate) use ziggurat::tests::assert_gaussian;
