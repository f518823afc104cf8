//! Pictures of one house style.

mod theme;

pub use theme::Theme;
