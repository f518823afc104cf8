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
//! folds until one restitution explains what is heard better than any other. The spread of what the
//! single folds say is the error that is told.

use core::f32::consts::TAU;

use heapless::Vec;

use super::chatter::Chatter;
use super::fit::{BEFORE, Circumstances, Fit, Verdict};
use crate::arithmetic::Phase;
use crate::control::angle::phase_of;
use crate::control::hear::{Cycle, GearMargin};
use crate::control::hear::{HANDED, Layout};

/// k at which it begins: a part of R = 0.84 still rests each cycle there.
pub const FIRST: f64 = 0.87;
/// Ratio of k from one level to the next: a step less than the 4 to 9 % by which [`back`] ends above the k at
/// which parts cease to rest.
const STRIDE: f64 = 0.965;
/// Lowest k of the way down. Parts that are not heard astray even here are dead ones, of R = 0.25 at most, which
/// rest each cycle at [`back`] of it.
const LOWEST: f64 = 0.42;
/// k at which the parts are let rest: above the last lock of order 1 for R up to 0.8, which ends at
/// k = (1 + R)/(pi (1 - R)) (docs/theory-bands.md#t5.2).
const REST_K: f64 = 3.0;
/// Cycles at an amplitude before it counts: four time constants of a kick, and of the drive at Q = 25 more than
/// two, beyond those until the amplitude is [`NEAR`].
const SETTLING: u8 = 20;
/// Cycles of listening at a level.
const LISTENED: u8 = 20;
/// Impacts astray among them from which on the parts do not rest each cycle: one or two may be noise.
const ASTRAY: u8 = 3;
/// What is not counted as astray, in rad: impacts this little before lift-off, where a late chatter still ends, and
/// this little before the first landing, which error of k (1 %: 0.1 rad) and of the stamp (0.05 rad) may shift.
const BEFORE_LIFT_OFF: f32 = 0.5;
const BEFORE_LANDING: f32 = 0.3;
/// Cycles of a fold, each with one hop of every part: a quarter of the noise is left of them.
const FOLDED: u16 = 16;
/// Folds on which a result stands at least, one at each k of the [`SPREAD`], and most that are made: half as many
/// where nothing is heard.
const FOLDS: usize = 4;
const MOST: usize = 16;
/// How much of k the folds spread over, so that the ringings of two impacts meet in every phase: 5 % of k moves
/// the second impact against the first by 0.05 rad (R = 0.1) to 0.11 rad (R = 0.8), and half a turn of the default
/// ringing is 0.065 rad at 50 Hz.
const SPREAD: f64 = 0.05;
/// How much higher than measured k may be where parts rest: their ringing adds to the measured amplitude, 1.5 % for
/// 24 of them at 2.4 kHz (see [`Signal`](crate::control::Signal)), and twice that is borne. From -0.03 to 0.06
/// every test passes.
const RESTING: f64 = 0.03;
/// How much lower than where parts were heard astray a k surely is at which they hop on. Tuned: without it,
/// `restitution_is_found_within_two_hundredths_from_sixty_four_hops_in_noise` fails.
const HOPPING: f64 = 0.08;
/// How much of the wanted amplitude may be missing: before it counts (1 %, as everywhere), while it does, and
/// where the parts only are to rest.
const NEAR: f32 = 0.01;
const AROUND: f32 = 0.03;
/// At a `NEAR` of 0.003 or 0.03 identifications fail; from 0.005 to 0.2 and from 0.03 to 0.5 of the others none.
const NEAR_REST: f32 = 0.2;
/// Evidence ([`Fit::evidence`]) from which on one restitution stands against every other: a likelihood ratio of
/// e^24, for the evidence is twice its logarithm. From 0 to 96 every test passes.
const EVIDENT: f32 = 48.0;
/// Lowest restitution that is told from none: its second impact, 0.04 as fast as the first, is lost in what is left
/// of that one's ringing.
const DEADEST: f32 = 0.04;
/// Cycles after which it ends, whatever it waits for: some 20 levels on the way down and 16 folds, 40 to 70 cycles each, come
/// to half as many where the amplitude holds still.
const LONGEST: u16 = 4000;
/// Where parts come into gear from rest, for R about 0.3, 0.1 and 0.5 (docs/theory-real-parts.md#t10.1), and cycles for
/// which it is waited there: a third of them in gear give a standard error of a tenth of the scatter.
const GEARS: [f64; 3] = [0.46, 0.37, 0.55];
const CHECKED: u16 = 300;
/// Largest standard error of what is heard in gear: that of 25 impacts at s = 0.10.
const HEARD: f32 = 0.02;
/// Standard error of a restitution heard in gear over the square of the scatter: impacts that keep the part in gear are others than those
/// that lose it. At R = 0.1, s = 0.10 it is heard up to 0.04 too high.
const CHOSEN: f32 = 2.0;
/// Scatter heard that is none: what the stamps of a sample come to at 50 Hz, thrice.
const STILL: f32 = 0.015;
/// How far what is folded and what is heard in gear may be apart: the 1 % of k that an amplitude may be off is 0.01 in R.
const AGREES: f32 = 0.02;
/// Parts counted from which on they are several: of one 0.5 to 1.05 are counted, of two 2.2, of three 3.0, of six 5.0.
const SEVERAL: f32 = 1.5;
/// Standard error of a folded result for the samples' width and for what is left of the ringing in k, times the square of the samples in
/// a turn: 0.0018 at 50 Hz, 0.0072 at 100 Hz. The largest errors of 420 runs of one part were 0.0014 and 0.0067, of 84 of up to six
/// 0.0049 at 50 Hz (docs/commissioning.md).
const SAMPLED: f32 = 288.0;
/// Largest standard error of a result: a lot of twice that to either side is as wide as the default one. At
/// 0.001 and at 0.05 `what_is_no_chatter_of_one_restitution_is_said_to_be_none` fails.
const ERROR: f32 = 0.01;

/// A restitution found by listening.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Identified {
    /// Restitution normal to the track (symbol R).
    pub restitution: f32,
    /// Its standard error, from the spread of the folds that it stands on.
    pub deviation: f32,
    /// k at which the parts hopped.
    pub k: f32,
    /// Standard deviation of restitution from impact to impact (symbol s); 0 where none is heard.
    pub scatter: f32,
    /// Hops that it stands on.
    pub hops: u16,
}

/// Why a restitution was not found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unidentified {
    /// Nothing repeats every cycle: there are no parts, or they are not heard.
    Quiet,
    /// What repeats is not the chatter of parts of one restitution.
    Unlike,
    /// The parts are so dead, or scatter so near to that, that their second impact drowns in the ringing of the first.
    Dead,
    /// Only their first landing repeats: their restitution scatters, from impact to impact or from part to part.
    Scattered,
    /// The drive did not hold the amplitudes that were wanted still enough in the time allowed.
    Unsteady,
}

/// How far an identification has come.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
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
    /// Waiting for what was folded.
    Collecting,
    /// Comparing it.
    Comparing,
    /// Listening to parts in gear, for so many cycles.
    Checking(u16),
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

/// How the drive is in a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Driven {
    /// How far the amplitude is from the wanted one, as a share of it; infinite on the way there.
    pub off: f32,
    /// Measured k.
    pub k: f64,
    /// Lead of the track before the output.
    pub lead: Phase,
    /// Least k that the drive reaches.
    pub least: f64,
    /// Gravity normal to the track in m/s^2.
    pub normal_gravity: f32,
    /// Advance of the phase per sample.
    pub step: u32,
    /// What is heard of parts in gear, of whatever restitution.
    pub margin: Option<GearMargin>,
    /// Speed over b w with which a part lands that is thrown from rest.
    pub thrown: f32,
    /// Energy of the residual in a cycle in gear over the mean square of the speed of arrival over b w.
    pub loudness: Option<f32>,
}

/// The steps of one identification.
#[derive(Clone, Debug)]
pub struct Identifier {
    result: Identification,
    stage: Stage,
    k: f64,
    /// Sum of the measured k in a fold.
    sum: f64,
    /// Sums over the cycles of all folds of the residual's energy in a quarter of them, but for noise, and of the square of the first
    /// landing's speed over `b w k`.
    energy: f32,
    squares: f32,
    turns_a_sample: f32,
    /// Cycles of all folds in which an impact was heard.
    struck: u16,
    fit: Fit,
    /// k of the first fold, once it is known.
    first: Option<f64>,
    /// What the folds that were heard say, and how many there are of all.
    found: Vec<f32, MOST>,
    folds: usize,
    hops: u16,
    /// What the folds came to, and where that is held against what is heard in gear.
    folded: Option<Identification>,
    checks: usize,
    /// Cycles so far.
    age: u16,
}

impl Identifier {
    /// None asked for.
    pub fn new() -> Self {
        Self {
            result: Identification::Idle,
            stage: Stage::Settling(0),
            k: FIRST,
            sum: 0.0,
            energy: 0.0,
            squares: 0.0,
            turns_a_sample: 0.0,
            struck: 0,
            fit: Fit::NEW,
            first: None,
            found: Vec::new(),
            folds: 0,
            hops: 0,
            folded: None,
            checks: 0,
            age: 0,
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

    /// As [`Identifier::interrupt`], while the drive is on its way: that is waited for so long only.
    pub fn wait(&mut self) -> Step {
        self.interrupt();
        self.grow_old()
    }

    fn grow_old(&mut self) -> Step {
        self.age = self.age.saturating_add(1);
        if self.age < LONGEST {
            return Step::Going;
        }
        self.end(Identification::NotFound(Unidentified::Unsteady))
    }

    /// What is to be folded.
    pub fn fold(&self) -> Option<Phase> {
        match self.stage {
            Stage::Folding(from, _) => Some(from),
            _ => None,
        }
    }

    /// Takes a cycle.
    pub fn cycle(&mut self, driven: &Driven, cycle: &Cycle) -> Step {
        let folded = &cycle.folded;
        let old = self.grow_old();
        if old != Step::Going {
            return old;
        }
        match self.stage {
            Stage::Settling(cycles) => {
                let near = driven.off < if self.k > 1.0 { NEAR_REST } else { NEAR };
                // What is left of an interrupted fold comes first.
                let cycles = if near && folded.first == 0 {
                    cycles + 1
                } else {
                    0
                };
                self.stage = Stage::Settling(cycles);
                if cycles >= SETTLING {
                    return self.settled(driven.lead);
                }
            }
            Stage::Listening(..) | Stage::Folding(..) if driven.off > AROUND => {
                self.stage = Stage::Settling(0);
            }
            Stage::Listening(cycles, astray) => {
                let astray = astray.saturating_add(self.astray(cycle, driven.lead));
                self.stage = Stage::Listening(cycles + 1, astray);
                if astray >= ASTRAY {
                    return self.fold_back(self.k * (1.0 - HOPPING));
                }
                if cycles + 1 >= LISTENED {
                    let next = self.k * STRIDE;
                    return if next < LOWEST.max(driven.least) {
                        self.fold_back(0.0)
                    } else {
                        self.go(next)
                    };
                }
            }
            Stage::Folding(from, cycles) => {
                self.sum += driven.k;
                self.turns_a_sample = driven.step as f32 * (1.0 / Phase::TURN as f32);
                self.struck += u16::from(!cycle.heard.is_empty());
                let noise = cycle.noise * cycle.noise * f32::from(cycle.samples);
                self.energy += cycle.sectors.energy.iter().sum::<f32>() - noise;
                let speed = driven.thrown / driven.k as f32;
                self.squares += speed * speed;
                self.stage = if cycles + 1 < FOLDED {
                    Stage::Folding(from, cycles + 1)
                } else {
                    Stage::Collecting
                };
            }
            Stage::Collecting => {
                if let Some(first) = usize::from(folded.first).checked_sub(1) {
                    self.fit.put(first, &folded.residual);
                    if first + HANDED >= Layout::of(driven.step).places {
                        self.fit.begin(Circumstances {
                            k: self.sum / f64::from(FOLDED),
                            normal_gravity: driven.normal_gravity,
                            step: driven.step,
                        });
                        self.stage = Stage::Comparing;
                    }
                }
            }
            Stage::Checking(cycles) => {
                self.stage = Stage::Checking(cycles + 1);
                if let (true, Some(folded)) = (cycles + 1 >= CHECKED, self.folded) {
                    let margin = driven.margin.filter(|margin| {
                        let count = self.count(driven, margin.restitution);
                        count.is_some_and(|count| count < SEVERAL)
                    });
                    return self.checked(margin, folded);
                }
            }
            Stage::Comparing => {
                if !self.fit.busy() {
                    return self.judge();
                }
            }
        }
        Step::Going
    }

    /// One slice of comparing; whether more are to be done.
    pub fn step(&mut self) -> bool {
        self.stage == Stage::Comparing && self.fit.step()
    }

    /// The amplitude is there.
    fn settled(&mut self, lead: Phase) -> Step {
        if self.folded.is_some() {
            self.stage = Stage::Checking(0);
            return Step::Going;
        }
        match (self.first, Chatter::of(self.k, 0.5)) {
            (None, _) => self.stage = Stage::Listening(0, 0),
            (Some(first), None) => return self.go(first),
            (Some(_), Some(chatter)) => {
                let landing = Phase::from_radians(f64::from(chatter.landing));
                self.sum = 0.0;
                self.stage = Stage::Folding(landing - lead - phase_of(BEFORE), 0);
            }
        }
        Step::Going
    }

    /// Lets the parts rest, and then goes back to a k at which they do each cycle; `hopping` is one at which they
    /// do not.
    fn fold_back(&mut self, hopping: f64) -> Step {
        let first = back(self.k);
        self.first = Some(first);
        self.fit.among((first * (1.0 + RESTING), hopping));
        self.go(REST_K)
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
        let in_air = landing - BEFORE_LANDING - (lift_off - BEFORE_LIFT_OFF);
        let since = phase_of(lift_off - BEFORE_LIFT_OFF);
        let astray = cycle.heard.iter().filter(|heard| {
            let after = (heard.phase + lead - since).radians() as f32;
            after < in_air
        });
        astray.count() as u8
    }

    /// Takes what the fold was found to be.
    fn judge(&mut self) -> Step {
        self.folds += 1;
        let verdict = self.fit.last();
        if let Verdict::Heard(restitution) = verdict
            && self.found.push(restitution).is_ok()
        {
            self.hops += FOLDED;
            self.result = Identification::Listening { hops: self.hops };
            if self.found.len() >= FOLDS && self.fit.evidence_of_a_train() < -EVIDENT {
                return self.check(Identification::NotFound(Unidentified::Scattered));
            }
            if let Some(found) = self.found() {
                return self.check(if found.restitution < DEADEST {
                    Identification::NotFound(Unidentified::Dead)
                } else {
                    Identification::Found(found)
                });
            }
        }
        let nothing = verdict == Verdict::Quiet && self.found.is_empty();
        let most = if nothing { MOST / 2 } else { MOST };
        match (self.first, verdict) {
            (Some(first), _) if self.folds < most => {
                let place = self.folds % FOLDS;
                self.go(first * (1.0 + SPREAD * place as f64 / (FOLDS - 1) as f64))
            }
            // What strikes and does not repeat is of parts that scatter.
            _ if nothing && 2 * self.struck < FOLDED * self.folds as u16 => {
                self.end(Identification::NotFound(Unidentified::Quiet))
            }
            _ => self.check(Identification::NotFound(Unidentified::Unlike)),
        }
    }

    /// Holds what the folds came to against the restitution that is heard of parts in gear, where they come into it: of
    /// parts that scatter only the first landing repeats, and what is folded of the others is another restitution's.
    fn check(&mut self, folded: Identification) -> Step {
        self.folded = Some(folded);
        match GEARS.get(self.checks) {
            Some(&k) => {
                self.checks += 1;
                self.go(k)
            }
            None => self.end(folded),
        }
    }

    /// What is heard in gear, once that was listened to for long enough.
    fn checked(&mut self, margin: Option<GearMargin>, folded: Identification) -> Step {
        let Some(margin) = margin.filter(|margin| margin.error < HEARD) else {
            return self.check(folded);
        };
        let scatter = if margin.scatter > STILL {
            margin.scatter
        } else {
            0.0
        };
        self.end(match folded {
            Identification::Found(found)
                if (found.restitution - margin.restitution).abs()
                    < AGREES.max(3.0 * margin.error) =>
            {
                Identification::Found(Identified { scatter, ..found })
            }
            _ if scatter > 0.0 => Identification::Found(Identified {
                restitution: margin.restitution,
                deviation: both(margin.error, CHOSEN * scatter * scatter),
                k: self.k as f32,
                scatter,
                hops: CHECKED,
            }),
            // Of what does not scatter the folds tell more.
            _ => folded,
        })
    }

    /// How many parts there are, where they scatter: those that lie together land together and ring as one, so that of n of them the energy
    /// is n^2; in gear they strike one by one, and it is n.
    fn count(&self, driven: &Driven, restitution: f32) -> Option<f32> {
        let chatter = Chatter::of(self.first?, restitution)?;
        let trained: f32 = chatter
            .impacts()
            .iter()
            .map(|(_, speed)| speed * speed)
            .sum();
        let together = self.energy / (self.squares * trained);
        let k = driven.k as f32;
        Some(together / (driven.loudness? * k * k))
    }

    /// What was found, once it stands.
    fn found(&self) -> Option<Identified> {
        let mean = self.fit.all()?;
        let squares: f32 = self.found.iter().map(|r| (r - mean) * (r - mean)).sum();
        let count = self.found.len().max(2) as f32;
        let deviation = libm::sqrtf(squares / (count * (count - 1.0)));
        let repeats = mean < DEADEST || self.fit.evidence_of_a_train() > EVIDENT;
        let stands = self.found.len() >= FOLDS
            && deviation < ERROR
            && self.fit.evidence() > EVIDENT
            && repeats;
        let sampled = SAMPLED * self.turns_a_sample * self.turns_a_sample;
        stands.then_some(Identified {
            restitution: mean,
            deviation: both(deviation, sampled),
            k: self.first? as f32,
            scatter: 0.0,
            hops: self.hops,
        })
    }

    fn end(&mut self, result: Identification) -> Step {
        self.result = result;
        self.stage = Stage::Settling(0);
        Step::Done(matches!(result, Identification::Found(_)))
    }
}

/// Standard error of what has two causes.
fn both(one: f32, other: f32) -> f32 {
    libm::sqrtf(one * one + other * other)
}

/// k at which parts surely rest each cycle that were heard astray at `k`.
///
/// On the way down parts cease to rest some levels before they are heard astray, the more the less they bounce. Fitted to
/// measurements: this ends 4 to 9 % above the k at which parts of R = 0.3 to 0.8 cease to rest.
fn back(k: f64) -> f64 {
    k * (1.17 - 0.44 * (k - 0.6).max(0.0))
}

#[cfg(all(test, feature = "plant"))]
mod tests {
    use super::*;
    use crate::control::settings::Settings;
    use crate::control::target::Target;
    use crate::plant::{ClosedLoop, EnvelopeLoop, Scene, SensorModel};

    fn rests(k: f64, restitution: f32) -> bool {
        Chatter::of(k, restitution).is_some_and(|chatter| chatter.rests())
    }

    #[test]
    fn the_way_down_begins_and_ends_where_its_constants_say() {
        assert!(rests(FIRST, 0.84) && !rests(FIRST, 0.88));
        assert!(rests(back(LOWEST), 0.25));
        // 5 % of k moves the second impact by about half a turn of the default ringing, 0.065 rad at 50 Hz.
        for (k, restitution) in [(0.45, 0.1), (0.56, 0.3), (0.85, 0.8)] {
            let second = |k| Chatter::of(k, restitution).unwrap().impacts()[1].0;
            let moved = second(k) - second(k * (1.0 + SPREAD));
            assert!((0.05..0.12).contains(&moved), "{restitution}: {moved}");
        }
    }

    #[test]
    fn it_goes_back_to_a_k_just_above_the_one_at_which_parts_cease_to_rest() {
        for restitution in [0.3, 0.5, 0.8] {
            let Identification::Found(found) = heard(&[restitution], 1, SensorModel::default())
            else {
                panic!("R {restitution} was not found");
            };
            let k = f64::from(found.k);
            assert!(
                rests(0.965 * k, restitution) && !rests(0.91 * k, restitution),
                "{found:?}"
            );
        }
    }

    fn heard(parts: &[f32], seed: u64, sensor: SensorModel) -> Identification {
        let scene = Scene {
            target: Target::Identify,
            parts: parts.iter().copied().collect(),
            settings: Settings {
                restitution_low: 0.0,
                restitution_high: 0.9,
                ..Settings::default()
            },
            sensor,
            seed,
            ..Scene::default()
        };
        let mut closed = ClosedLoop::build(&scene).unwrap();
        for _ in 0..=LONGEST + 100 {
            match closed.cycle().report.identification {
                Identification::Idle | Identification::Listening { .. } => {}
                done => return done,
            }
        }
        panic!("an identification ends");
    }

    #[test]
    fn restitution_is_found_within_two_hundredths_from_sixty_four_hops_in_noise() {
        // Twenty seeds of each: at most 0.001 (docs/commissioning.md).
        for (restitution, decay, seed) in
            [(0.1, 1.0, 1), (0.15, 2.0, 2), (0.3, 2.0, 3), (0.8, 1.0, 1)]
        {
            let sensor = SensorModel {
                ringing_decay: decay,
                ..SensorModel::default()
            };
            let Identification::Found(found) = heard(&[restitution], seed, sensor) else {
                panic!("R {restitution} was not found");
            };
            assert!(
                (found.restitution - restitution).abs() < 0.005,
                "{restitution}: {found:?}"
            );
            assert!(found.hops >= 50 && found.deviation < 0.005);
        }
    }

    #[test]
    fn what_is_no_chatter_of_one_restitution_is_said_to_be_none() {
        let not_found = |parts: &[f32], why| {
            let heard = heard(parts, 1, SensorModel::default());
            assert_eq!(heard, Identification::NotFound(why), "{parts:?}");
        };
        not_found(&[0.0], Unidentified::Dead);
        not_found(&[0.15, 0.35], Unidentified::Scattered);
    }

    /// A lot of so many parts of a restitution and a scatter, in closed form from cycle to cycle.
    fn heard_of(restitution: f32, scatter: f32, parts: usize, seed: u64) -> Identification {
        let scene = Scene {
            target: Target::Identify,
            parts: core::iter::repeat_n(restitution, parts).collect(),
            scatter: core::iter::repeat_n(scatter, parts).collect(),
            settings: Settings {
                restitution_low: 0.0,
                restitution_high: 0.9,
                ..Settings::default()
            },
            seed,
            ..Scene::default()
        };
        let mut closed = EnvelopeLoop::build(&scene).unwrap();
        let mut told = (0..=LONGEST + 100).map(|_| closed.cycle().report.identification);
        told.find(|told| {
            !matches!(
                told,
                Identification::Idle | Identification::Listening { .. }
            )
        })
        .expect("an identification ends")
    }

    /// Some of the lots of `examples/identifying.rs`.
    #[test]
    fn of_parts_that_scatter_no_answer_is_false_and_easy_lots_are_answered() {
        for parts in [1, 6] {
            for tenths in [1_u8, 3, 5, 7] {
                for scatter in [0.0, 0.05, 0.10, 0.15] {
                    let restitution = 0.1 * f32::from(tenths);
                    let heard = heard_of(restitution, scatter, parts, 21);
                    let lot = (restitution, scatter, parts);
                    if let Identification::Found(found) = heard {
                        let apart = (found.restitution - restitution).abs();
                        assert!(apart < 3.0 * found.deviation, "{lot:?}: {found:?}");
                        assert!(
                            found.deviation < 0.03 && apart < 0.045,
                            "{lot:?}: {found:?}"
                        );
                    }
                    let easy = scatter == 0.0 || parts == 1 && scatter < 0.08 && restitution < 0.55;
                    let answered = matches!(heard, Identification::Found(_));
                    assert!(answered || !easy, "{lot:?}: {heard:?}");
                    // Parts that strike are never said to be none.
                    assert_ne!(
                        heard,
                        Identification::NotFound(Unidentified::Quiet),
                        "{lot:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn parts_that_are_not_heard_have_no_restitution() {
        let sensor = SensorModel {
            ringing: 0.0,
            ..SensorModel::default()
        };
        assert_eq!(
            heard(&[0.4], 1, sensor),
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
