//! Number systems: binary angles with sine and cosine, fixed-point and twofold numbers, SIMD lanes.

pub(crate) mod fixed;
mod gauss;
#[cfg_attr(
    not(any(test, feature = "analysis")),
    expect(dead_code, reason = "many lanes at a time serve `impact::batch`")
)]
pub(crate) mod lane;
pub(crate) mod node;
mod phase;
pub(crate) mod positive;
#[allow(unsafe_code)]
mod root;
pub(crate) mod trigonometry;
pub(crate) mod twofold;

pub use fixed::Velocity;
pub(crate) use gauss::gauss;
pub use phase::Phase;
pub(crate) use root::{square_root, square_root_single};
#[cfg(any(test, feature = "analysis", feature = "control"))]
pub(crate) use trigonometry::arcsine_single;
pub use trigonometry::{sine_cosine_fixed, sine_cosine_single};
#[cfg(feature = "unstable")]
pub use twofold::Twofold;
