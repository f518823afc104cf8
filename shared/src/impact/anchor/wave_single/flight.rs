//! A flight over several tones in f32.

use super::track::Track;
use crate::impact::anchor::flight::{self, Flight, Local, RADIANS_PER_STEP, node_from_near};
use crate::impact::anchor::single::steps_to;

/// A flight in f32.
#[derive(Clone, Copy)]
pub(super) struct Ballistic<'a> {
    pub track: &'a Track,
    pub phase: u32,
    /// S at launch.
    pub height: f32,
    /// The ball's velocity there, `psi + S'`.
    pub rise: f32,
}

impl Flight for Ballistic<'_> {
    const MAX_SHORT_FLIGHT: f32 = 0.2;
    const MAX_LAST_STEP: f32 = 0.02;
    const MAX_GRAZING_SPEED: f32 = 0.015;
    const APPROACH_IS_FINAL: bool = true;
    const MAX_LAST_CORRECTION: f32 = 3e-3;
    const PULL_ROUNDING: f32 = 4e-9;
    const GAP_ROUNDING: f32 = 1e-5;
    const GAP_ROUNDING_PER_RADIAN: f32 = 2e-6;

    #[inline(always)]
    fn node_of(phase: u32, x: f32) -> (i32, f32) {
        node_from_near(phase, x)
    }

    #[inline(always)]
    fn local(&self, node: i32) -> Local {
        let steps = steps_to(self.phase, node);
        // Whole turns and the rest, each rounded once.
        let turns = ((steps + (1 << 31)) >> 32) as i32;
        let time = steps as i32 as f32 * RADIANS_PER_STEP + turns as f32 * core::f32::consts::TAU;
        let at = flight::Track::at(self.track, node);
        let fall = self.track.k * time;
        Local {
            height: (self.height - at.height) + time * (self.rise - 0.5 * fall),
            slope: self.rise - fall - at.speed,
            push: at.push,
            surge: at.surge,
            bend: at.bend,
        }
    }
}
