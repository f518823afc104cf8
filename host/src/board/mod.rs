//! A board on the link: a real one on a serial port, or the emulated CPU.

mod closed_loop;
mod line;
mod tether;

pub use closed_loop::BoardLoop;
pub use line::Line;
