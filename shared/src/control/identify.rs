//! Identification: the restitution of parts from the sound of their chatter.
//!
//! A part at rest is thrown off at arcsin k and lands after a flight that k alone decides; the intervals
//! to its further impacts, shorter and shorter until it rests, depend on its restitution. What is
//! heard of them is folded over the cycles and compared with the chatter that the map on board computes
//! for every restitution. (In the limit of short hops the ratio of successive intervals is R itself.)
//!
//! The less k, the longer and louder the hops; but parts must come to rest before they are thrown
//! anew. So it goes down from [`FIRST`], where even lively parts do, until impacts are heard where there
//! are none of a part that rests; then it lets the parts rest, goes back to a k at which they did, and
//! folds. The fold is repeated: the spread of the results is the error that is told.

use super::angle::phase_of;
use super::chatter::{Chatter, Fit, LANDING};
use super::fold::{BINS, HANDED};
use super::signal::Cycle;
use crate::arithmetic::Phase;
use core::f32::consts::TAU;

/// k at which it begins.
pub const FIRST: f64 = 0.87;
/// Ratio of k from one level to the next.
const STRIDE: f64 = 0.965;
/// Lowest k that is gone to: below, even dead parts do not rest.
const LOWEST: f64 = 0.34;
/// k at which parts come to rest that were locked: a lock of R = 0.82 ends at (1 + R) / (pi (1 - R)).
const LULL: f64 = 3.0;
/// Cycles at an amplitude before it counts: the parts forget the amplitude before.
const SETTLING: u8 = 20;
/// Cycles of listening at a level.
const LISTENED: u8 = 20;
/// Impacts among them where parts that rest have none, from which on they do not.
const ASTRAY: u8 = 3;
/// How much earlier than the track throws it, and than a thrown part lands, an impact is astray, in rad.
const EARLY: f32 = 0.5;
const LANDING_WIDTH: f32 = 0.3;
/// Cycles of a fold, each with one hop of every part.
const FOLDED: u16 = 8;
/// Folds on which the result stands.
const FOLDS: usize = 8;
/// k of the first fold over that where parts no longer rest, and how much of it the folds spread over, so
/// that the ringings of the first two impacts meet in every phase.
const BACK: f64 = 1.13;
const SPREAD: f64 = 0.05;
/// Difference in loudness, as the square of a logarithm, above which a fold is not that of a chatter.
const ALIKE: f32 = 1.5;
/// Lowest restitution that is told from the ringing, and largest standard error that is a result.
const DEADEST: f32 = 0.15;
const ERROR: f32 = 0.02;
/// Tolerance of k in what parts rest, as a share of it.
const TOLERANCE: f64 = 0.03;

/// A restitution found by listening.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Identified {
    /// Restitution normal to the track (symbol R).
    pub restitution: f32,
    /// Its standard error, from the spread of the folds that it stands on.
    pub deviation: f32,
    /// k at which the parts hopped.
    pub k: f32,
    /// Hops that it stands on.
    pub hops: u16,
}

/// Why a restitution was not found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Unidentified {
    /// Nothing repeats every cycle: there are no parts, or they are not heard.
    Quiet,
    /// What repeats is not the chatter of parts of one restitution.
    Unlike,
    /// The parts are so dead that their second impact drowns in the ringing of the first.
    Dead,
}

/// How far an identification has come.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Identification {
    /// None was asked for.
    #[default]
    Idle,
    /// Under way, with so many hops heard.
    Listening {
        /// Hops heard so far.
        hops: u16,
    },
    /// Done.
    Found(Identified),
    /// Done, without a result.
    NotFound(Unidentified),
}

/// What it is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    /// Waiting for the amplitude, for so many cycles at it.
    Settling(u8),
    /// Listening whether the parts rest, for so many cycles, with so many impacts astray.
    Listening(u8, u8),
    /// Folding from this phase of the output, for so many cycles.
    Folding(Phase, u16),
    /// Waiting for what was folded, so many bins of it.
    Collecting(usize),
    /// Comparing it.
    Comparing,
}

/// What changed in a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Step {
    /// Nothing worth telling.
    Going,
    /// It goes on at this k.
    At(f64),
    /// It is over.
    Done(bool),
}

/// The steps of one identification.
#[derive(Clone, Copy, Debug)]
pub struct Identifier {
    result: Identification,
    stage: Stage,
    k: f64,
    /// Sum of the measured k in a fold.
    sum: f64,
    heights: [f32; BINS],
    fit: Fit,
    /// k at which the parts were last heard to rest and not to rest.
    bounds: (f64, f64),
    /// Whether the level of the fold is known.
    known: bool,
    found: [f32; FOLDS],
    folds: usize,
    hops: u16,
}

impl Identifier {
    /// None asked for.
    pub fn new() -> Self {
        Self {
            result: Identification::Idle,
            stage: Stage::Settling(0),
            k: FIRST,
            sum: 0.0,
            heights: [0.0; BINS],
            fit: Fit::NEW,
            bounds: (1.0, 0.0),
            known: false,
            found: [0.0; FOLDS],
            folds: 0,
            hops: 0,
        }
    }

    /// Begins anew, at [`FIRST`].
    pub fn begin(&mut self) {
        *self = Self::new();
        self.result = Identification::Listening { hops: 0 };
    }

    /// Ends what is under way; a result stays.
    pub fn stop(&mut self) {
        if self.listens() {
            *self = Self::new();
        }
    }

    /// How far it has come.
    pub fn result(&self) -> Identification {
        self.result
    }

    /// Whether it is under way.
    pub fn listens(&self) -> bool {
        matches!(self.result, Identification::Listening { .. })
    }

    /// The drive does something else: what was being folded is worth nothing.
    pub fn interrupt(&mut self) {
        self.stage = Stage::Settling(0);
    }

    /// What is to be folded.
    pub fn fold(&self) -> Option<Phase> {
        match self.stage {
            Stage::Folding(from, _) => Some(from),
            _ => None,
        }
    }

    /// A cycle at the wanted amplitude (`near`) or not, with the measured k and the lead of the track;
    /// `least` is the least k that the drive reaches.
    pub fn cycle(&mut self, near: bool, k: f64, lead: Phase, cycle: &Cycle, least: f64) -> Step {
        let folded = &cycle.folded;
        match self.stage {
            Stage::Settling(cycles) => {
                // What is left of an interrupted fold comes first.
                let cycles = if near && folded.bin == 0 {
                    cycles + 1
                } else {
                    0
                };
                self.stage = Stage::Settling(cycles);
                if cycles < SETTLING {
                    return Step::Going;
                }
                if self.k > 1.0 {
                    return self.go(self.level());
                }
                self.stage = Stage::Listening(0, 0);
                if self.known {
                    let Some(chatter) = Chatter::of(self.k, 0.5) else {
                        return self.end(Identification::NotFound(Unidentified::Unlike));
                    };
                    let landing = Phase::from_radians(f64::from(chatter.landing));
                    let before = Phase::from_bits((LANDING as u32) << 24);
                    self.sum = 0.0;
                    self.stage = Stage::Folding(landing - lead - before, 0);
                }
            }
            Stage::Listening(cycles, astray) => {
                if !near {
                    self.stage = Stage::Settling(0);
                    return Step::Going;
                }
                let astray = astray.saturating_add(self.astray(cycle, lead));
                self.stage = Stage::Listening(cycles + 1, astray);
                if astray >= ASTRAY {
                    self.known = true;
                    self.bounds = (
                        self.k * BACK * (1.0 + TOLERANCE),
                        self.k * (1.0 - TOLERANCE),
                    );
                    if self.bounds.0 > 0.98 {
                        return self.end(Identification::NotFound(Unidentified::Unlike));
                    }
                    return self.go(LULL);
                }
                if cycles + 1 >= LISTENED {
                    let next = self.k * STRIDE;
                    if next < LOWEST.max(least) {
                        self.known = true;
                        self.bounds = (self.k * (1.0 + TOLERANCE), 0.0);
                        return self.go(self.level());
                    } else {
                        return self.go(next);
                    }
                }
            }
            Stage::Folding(from, cycles) => {
                if !near {
                    self.stage = Stage::Settling(0);
                    return Step::Going;
                }
                self.sum += k;
                self.stage = if cycles + 1 < FOLDED {
                    Stage::Folding(from, cycles + 1)
                } else {
                    Stage::Collecting(0)
                };
            }
            Stage::Collecting(bins) => {
                if folded.bin > 0 {
                    let first = usize::from(folded.bin) - 1;
                    for (n, height) in folded.heights.iter().enumerate() {
                        if let Some(slot) = self.heights.get_mut(first + n) {
                            *slot = *height;
                        }
                    }
                    self.stage = Stage::Collecting(bins + HANDED);
                    if bins + HANDED >= BINS {
                        let k = self.sum / f64::from(FOLDED);
                        self.fit.begin(k, self.bounds, &self.heights);
                        self.stage = Stage::Comparing;
                    }
                }
            }
            Stage::Comparing => return self.judge(),
        }
        Step::Going
    }

    /// One slice of comparing; whether more are to be done.
    pub fn step(&mut self) -> bool {
        self.stage == Stage::Comparing && self.fit.step()
    }

    fn go(&mut self, k: f64) -> Step {
        self.k = k;
        self.stage = Stage::Settling(0);
        Step::At(k)
    }

    /// Impacts of a cycle where a part that rests each cycle is in the air.
    fn astray(&self, cycle: &Cycle, lead: Phase) -> u8 {
        let lift_off = libm::asin(self.k) as f32;
        let landing = Chatter::of(self.k, 0.5).map_or(TAU, |chatter| chatter.landing);
        let in_air = landing - LANDING_WIDTH - (lift_off - EARLY);
        let since = phase_of(lift_off - EARLY);
        let astray = cycle.impacts().iter().filter(|heard| {
            let after = (heard.phase + lead - since).radians() as f32;
            after < in_air
        });
        astray.count() as u8
    }

    /// Takes what the fold was found to be, once that is known.
    fn judge(&mut self) -> Step {
        if self.fit.busy() {
            return Step::Going;
        }
        let Some(found) = self.fit.last() else {
            return self.end(Identification::NotFound(Unidentified::Unlike));
        };
        if !self.fit.audible() {
            return self.end(Identification::NotFound(Unidentified::Quiet));
        }
        if let Some(slot) = self.found.get_mut(self.folds) {
            *slot = found.restitution;
        }
        self.folds += 1;
        self.hops += FOLDED;
        self.result = Identification::Listening { hops: self.hops };
        if self.folds < FOLDS {
            return self.go(self.level());
        }
        let count = FOLDS as f32;
        let Some(all) = self.fit.all(count).filter(|all| all.difference < ALIKE) else {
            return self.end(Identification::NotFound(Unidentified::Unlike));
        };
        let mean = all.restitution;
        let squares: f32 = self.found.iter().map(|r| (r - mean) * (r - mean)).sum();
        let deviation = libm::sqrtf(squares / (count * (count - 1.0)));
        if mean < DEADEST {
            return self.end(Identification::NotFound(Unidentified::Dead));
        }
        if deviation > ERROR {
            return self.end(Identification::NotFound(Unidentified::Unlike));
        }
        self.end(Identification::Found(Identified {
            restitution: mean,
            deviation,
            k: (self.bounds.0 / (1.0 + TOLERANCE)) as f32,
            hops: self.hops,
        }))
    }

    /// k of the next fold.
    fn level(&self) -> f64 {
        let k = self.bounds.0 / (1.0 + TOLERANCE);
        k * (1.0 + SPREAD * self.folds as f64 / (FOLDS - 1) as f64)
    }

    fn end(&mut self, result: Identification) -> Step {
        self.result = result;
        self.stage = Stage::Settling(0);
        Step::Done(matches!(result, Identification::Found(_)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Settings, Target};
    use super::*;
    use crate::plant::{ClosedLoop, Scene, SensorModel};

    fn heard(restitution: f32, seed: u64, sensor: SensorModel) -> Identification {
        let mut scene = Scene {
            target: Target::Identify,
            settings: Settings {
                restitution_low: 0.0,
                restitution_high: 0.9,
                ..Settings::default()
            },
            sensor,
            seed,
            ..Scene::default()
        };
        scene.parts[0] = restitution;
        let mut closed = ClosedLoop::build(&scene).unwrap();
        // Twenty-five levels of forty cycles, then eight folds of a hundred, with what the amplitude takes.
        for _ in 0..3000 {
            match closed.cycle().report.identification {
                Identification::Idle | Identification::Listening { .. } => {}
                done => return done,
            }
        }
        panic!("an identification ends");
    }

    #[test]
    fn restitution_is_found_within_two_hundredths_from_sixty_four_hops_in_noise() {
        // Ten seeds of each: at most 0.017.
        for (restitution, seed) in [(0.25, 1), (0.3, 2), (0.4, 1), (0.5, 3), (0.6, 2), (0.7, 1)] {
            let sensor = SensorModel::default();
            let Identification::Found(found) = heard(restitution, seed, sensor) else {
                panic!("R {restitution} was not found");
            };
            assert!(
                (found.restitution - restitution).abs() < 0.02,
                "{restitution}: {found:?}"
            );
            assert!(found.hops >= 50 && found.deviation < 0.02);
        }
    }

    #[test]
    fn parts_that_are_not_heard_have_no_restitution() {
        let sensor = SensorModel {
            ringing: 0.0,
            ..SensorModel::default()
        };
        assert_eq!(
            heard(0.4, 1, sensor),
            Identification::NotFound(Unidentified::Quiet)
        );
    }

    #[test]
    fn a_result_stays_until_the_next_identification_and_what_is_under_way_ends_with_the_target() {
        let mut identifier = Identifier::new();
        assert_eq!(identifier.result(), Identification::Idle);
        identifier.begin();
        assert!(identifier.listens());
        identifier.stop();
        assert_eq!(identifier.result(), Identification::Idle);
        identifier.begin();
        let done = Identification::NotFound(Unidentified::Unlike);
        assert_eq!(identifier.end(done), Step::Done(false));
        identifier.stop();
        assert_eq!(identifier.result(), done);
        identifier.begin();
        assert!(identifier.listens());
    }
}
