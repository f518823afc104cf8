//! Soak test on several tones: each launch through every arithmetic, its first impact proven once.
//!
//! An arithmetic rounds a launch to another launch. Every second launch is drawn so that all round
//! it alike. Those share one proof.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};

use kband::arithmetic::Phase;
use kband::impact::{Impact, Kernel, PartState, Tone, WaveKernel, WaveMap, WaveSingle};

use super::launches::{Kind, Launches, track};
use crate::oracle::{Flight, Track};
use crate::soak::watched;
use crate::states::Random;

/// Launches per track: the set-up takes as long as some verdicts.
const BLOCK: u64 = 2000;
/// Restitution of every launch.
const RESTITUTION: f64 = 0.5;
/// The arithmetics, in the order of a [`Tally`].
pub const NAMES: [&str; 2] = [WaveMap::NAME, WaveSingle::NAME];

/// Resolution of an arithmetic.
#[derive(Clone, Copy, Debug)]
enum Held {
    /// f64, to the rounding of the gap's terms.
    Double,
    /// A microcontroller kernel, with its rounding.
    Rounded(Rounding),
}

/// Rounding and omitted terms of a microcontroller kernel.
#[derive(Clone, Copy, Debug)]
struct Rounding {
    /// Rounding of a height: constant part, and part per rad of flight.
    height: f64,
    turned: f64,
}

/// Flight time in rad below which f64 uses the height divided by the time, to the rounding of its
/// terms.
const SHORT_HOP: f64 = 0.5 / 3.0;

/// The last step of f32 in rad, and the largest ratio of `b2 u0` to the squared slope there.
const LEAP: f64 = 0.02;
const SIMPLE: f64 = 0.1;

impl Rounding {
    /// Error of the impact time beside the effect of a height's rounding, for a third derivative up
    /// to `jerk`.
    ///
    /// For a root of `u0 + u1 d + b2 d^2 + c d^3` let n be Newton's step, `a = b2 n/u1` and
    /// `b = c n^2/u1`. Householder's step then leaves `n (2 a b + 2 b^2 - a^3)` and higher powers.
    fn late(arrival: f64, jerk: f64) -> f64 {
        let cube = jerk / 6.0 * LEAP * LEAP / arrival;
        LEAP * (SIMPLE * SIMPLE * SIMPLE + 2.0 * SIMPLE * cube + 2.0 * cube * cube)
    }
}

const HELD: [Held; 2] = [
    Held::Double,
    Held::Rounded(Rounding {
        height: 1e-5,
        turned: 2e-6,
    }),
];

/// Results of a soak for one arithmetic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seen {
    /// Launches tried.
    pub launches: u64,
    /// Impacts flagged as grazing.
    pub flagged: u64,
    /// Impacts within rounding of another one, or launched within rounding of an edge.
    pub doubtful: u64,
    /// Wrong impacts.
    pub wrong: u64,
}

/// Results of a soak, by arithmetic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally(pub [Seen; 2]);

impl Tally {
    /// Adds another tally.
    pub fn add(&mut self, other: &Self) {
        for (seen, other) in self.0.iter_mut().zip(&other.0) {
            seen.launches += other.launches;
            seen.flagged += other.flagged;
            seen.doubtful += other.doubtful;
            seen.wrong += other.wrong;
        }
    }
}

/// A launch and its first impact.
#[derive(Clone, Copy, Debug)]
struct Truth {
    state: PartState,
    /// Push minus k at launch, and its derivative by the phase.
    excess: f64,
    surge: f64,
    flight: Flight,
    /// Slope and curvature of the gap at the impact.
    ends: [f64; 2],
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    Right,
    Flagged,
    Doubtful,
}

/// A track in every arithmetic.
struct Bench {
    track: Track,
    map: WaveMap,
    single: WaveSingle,
}

/// The rounded launch of a microcontroller kernel, and its impact.
fn flown<K: WaveKernel>(kernel: &K, launch: PartState) -> Option<(PartState, Impact<PartState>)> {
    // Velocity in `b w` up to which the kernels are judged.
    const FASTEST: f64 = 20.0;
    if launch.velocity > FASTEST {
        return None;
    }
    let start = K::state(launch.phase, launch.velocity).ok()?;
    let impact = kernel.impact(start);
    let next = K::observe(impact.next);
    let impact = Impact {
        flight: impact.flight,
        next,
        grazes: impact.grazes,
    };
    Some((K::observe(start), impact))
}

impl Bench {
    /// A random track, rounded as in the microcontroller kernels.
    fn draw(random: &mut Random) -> Self {
        let (drawn, wave) = track(random);
        let rounded = |tone: Tone| {
            Tone::new(
                (tone.amplitude * 4_294_967_296.0).round() / 4_294_967_296.0,
                Phase::from_radians(tone.angle).radians(),
            )
        };
        let tones = [wave.second(), wave.third()].map(rounded);
        Self::build(f64::from((drawn.k as f32).clamp(0.01, 4.0)), tones)
    }

    /// The bench of a second and a third tone.
    fn build(k: f64, tones: [Tone; 2]) -> Self {
        let [second, third] = tones.map(|tone| [tone.amplitude, tone.angle]);
        Self {
            track: Track::of(k, [second[0], second[1], third[0], third[1]]),
            map: on(tones, k),
            single: on(tones, k),
        }
    }

    /// The rounded launch of each arithmetic, and its impact.
    fn impacts(&self, launch: PartState) -> [Option<(PartState, Impact<PartState>)>; 2] {
        [
            Some((launch, self.map.impact(launch))),
            flown(&self.single, launch),
        ]
    }

    /// The first impact after a launch; `told` is tried first.
    fn truth(&self, state: PartState, told: f64) -> Truth {
        let PartState { phase, velocity } = state;
        let flight = self.track.first_impact_by(phase, velocity, told);
        let [_, slope, curvature] = self.track.gap(phase, velocity, flight.duration);
        let [_, _, curvature_of_track, third] = self.track.at(phase);
        Truth {
            state,
            excess: -curvature_of_track - self.track.k,
            surge: -third,
            flight,
            ends: [slope, curvature],
        }
    }

    /// Judges an impact; the error is the cause.
    fn judge(
        &self,
        held: Held,
        truth: &Truth,
        impact: &Impact<PartState>,
    ) -> Result<Verdict, String> {
        let PartState { phase, velocity } = truth.state;
        let d = impact.flight;
        if !(d.is_finite() && d >= 0.0) {
            return Err("flight".into());
        }
        if !((0.0..std::f64::consts::TAU).contains(&impact.next.phase)
            && impact.next.velocity.is_finite()
            && impact.next.velocity >= 0.0)
        {
            return Err("state".into());
        }
        // Rounding of a push of up to 7.5; a step of the phase changes it by up to 18 of these.
        let room = match held {
            Held::Double => 2e-14,
            Held::Rounded(_) => 4e-8,
        };
        let level = truth.excess.abs() < room;
        if d == 0.0 && velocity == 0.0 {
            return if truth.excess <= 0.0 || level {
                Ok(Verdict::Right)
            } else {
                Err("rests though it is thrown".into())
            };
        }
        // Near launch the gap is `psi d - (k - A) d^2/2 + A' d^3/6`. The rounding decides between a
        // tiny hop and a throw.
        let limit = |pull: f64| 0.375 * pull.max(0.0) * pull.max(0.0);
        let (least, most) = (limit(-truth.excess - room), limit(-truth.excess + room));
        if truth.surge > 0.0
            && truth.excess < room
            && (least..=most).contains(&(velocity * truth.surge))
        {
            return Ok(Verdict::Doubtful);
        }
        let Flight {
            duration, arrival, ..
        } = truth.flight;
        let error = (d - duration).abs();
        match held {
            Held::Double => {
                let mut rounding = 16.0 * self.track.rounding(phase, velocity, duration);
                if duration >= SHORT_HOP {
                    // The difference of two heights of up to 2, each the sum of three products.
                    rounding = rounding.max(8.0 * f64::EPSILON);
                }
                let moved = rounding / arrival + 1e-12 * duration;
                if level || moved > 1e-2 * duration {
                    return Ok(Verdict::Doubtful);
                }
                if error <= moved {
                    return self.leaves(truth, impact, moved, [rounding / duration, 0.0]);
                }
                // A touch within rounding, before or at the end.
                if impact.grazes {
                    return Ok(Verdict::Flagged);
                }
                // The proof of an impact does not measure the distance of a touch.
                let Flight { clearance, .. } = self.track.first_impact(phase, velocity);
                if clearance < 8.0 || arrival * arrival < 16.0 * rounding {
                    return Ok(Verdict::Doubtful);
                }
            }
            Held::Rounded(Rounding { height, turned }) => {
                let [.., jerk, _] = self.track.sums();
                if level && velocity == 0.0 {
                    return Ok(Verdict::Doubtful);
                }
                let short = if duration < 0.04 { duration } else { 1.0 };
                let rounding =
                    short * (height + turned * duration * (1.0 + self.track.k * duration));
                if impact.grazes {
                    return Ok(Verdict::Flagged);
                }
                let late = Rounding::late(arrival, jerk);
                let moved = rounding / arrival + 3e-9 + 3e-7 * duration;
                if error <= moved + late {
                    let moved = moved + late.min(error);
                    return self.leaves(truth, impact, moved, [rounding / duration, 3e-8]);
                }
                let stepped = self.track.first_impact(phase, velocity);
                let touch = stepped.clearance * self.track.rounding(phase, velocity, duration);
                if touch < rounding || arrival * arrival < 40.0 * rounding {
                    return Ok(Verdict::Doubtful);
                }
            }
        }
        Err(format!("wrong root, expected flight {duration:e}"))
    }

    /// Judges the state after an impact at the right time.
    fn leaves(
        &self,
        truth: &Truth,
        impact: &Impact<PartState>,
        moved: f64,
        [turned, step]: [f64; 2],
    ) -> Result<Verdict, String> {
        let turns = (truth.state.phase + impact.flight - impact.next.phase) / std::f64::consts::TAU;
        let room = 2.0 * f64::EPSILON * (2.0 + impact.flight) + step;
        if (turns - turns.round()).abs() > room {
            return Err("phase is not that of the flight".into());
        }
        let [slope, curvature] = truth.ends;
        let speed = RESTITUTION * (-slope).max(0.0);
        // The time's error changes the speed, by the curvature and its change.
        let room = 16.0 * (moved * (curvature.abs() + 20.0 * moved) + turned + 1e-15 + step);
        if (impact.next.velocity - speed).abs() > room {
            return Err(format!("velocity, expected {speed:e} within {room:e}"));
        }
        Ok(Verdict::Right)
    }
}

fn on<K: WaveKernel>(tones: [Tone; 2], k: f64) -> K {
    K::on_tones(tones, k, RESTITUTION).expect("a track that every arithmetic holds")
}

/// The tally of a launch; `spoil` may change the impact of an arithmetic.
fn one(
    bench: &Bench,
    launch: PartState,
    spoil: &impl Fn(usize, &mut Impact<PartState>),
    tell: &impl Fn(&str),
) -> Tally {
    let mut tally = Tally::default();
    let mut truth: Option<Truth> = None;
    for (n, flown) in bench.impacts(launch).into_iter().enumerate() {
        let Some((state, mut impact)) = flown else {
            continue;
        };
        let truth = match truth {
            Some(known) if known.state == state => known,
            _ => *truth.insert(bench.truth(state, bench.map.impact(state).flight)),
        };
        spoil(n, &mut impact);
        let seen = &mut tally.0[n];
        seen.launches += 1;
        match bench.judge(HELD[n], &truth, &impact) {
            Ok(Verdict::Right) => {}
            Ok(Verdict::Flagged) => seen.flagged += 1,
            Ok(Verdict::Doubtful) => seen.doubtful += 1,
            Err(cause) => {
                seen.wrong += 1;
                tell(&format!(
                    "{} {:?} {state:?} gave {impact:?}: {cause}, {:?}",
                    NAMES[n], bench.track, truth.flight
                ));
            }
        }
    }
    tally
}

/// The launches of a block; the seed determines them.
fn drawn(kind: Kind, seed: u64, number: u64) -> (Bench, Vec<PartState>) {
    let mut seeds = Random::new(seed ^ ((kind as u64) << 56) ^ (number << 8));
    let mut random = Random::new(seeds.bits());
    loop {
        let bench = Bench::draw(&mut random);
        let Some(mut launches) = Launches::from(&bench.track, kind, &mut random) else {
            continue;
        };
        let mut found = Vec::with_capacity(BLOCK as usize);
        // A track that hardly throws has few touches.
        for _ in 0..4 * BLOCK {
            found.extend(launches.draw(&bench.track, &mut random));
            if found.len() as u64 == BLOCK {
                return (bench, found);
            }
        }
    }
}

/// Tries `count` launches of every kind on `threads` threads and reports wrong impacts as they
/// come.
pub fn soak(
    count: u64,
    seed: u64,
    threads: usize,
    tell: impl Fn(&str) + Sync,
) -> Vec<(Kind, Tally)> {
    spoiled(count, seed, threads, |_, _| {}, tell)
}

fn spoiled(
    count: u64,
    seed: u64,
    threads: usize,
    spoil: impl Fn(usize, &mut Impact<PartState>) + Sync,
    tell: impl Fn(&str) + Sync,
) -> Vec<(Kind, Tally)> {
    let blocks = count.div_ceil(BLOCK).max(1);
    let kind = |kind: Kind| {
        let block = |number: u64, current: &AtomicUsize| {
            let (bench, launches) = drawn(kind, seed, number);
            let mut tally = Tally::default();
            for (n, launch) in launches.into_iter().enumerate() {
                current.store(n, Ordering::Relaxed);
                let seen = catch_unwind(AssertUnwindSafe(|| one(&bench, launch, &spoil, &tell)));
                tally.add(&seen.unwrap_or_else(|_| {
                    tell(&format!("a kernel panicked: {:?} {launch:?}", bench.track));
                    let mut wrong = Tally::default();
                    wrong.0[0].wrong = 1;
                    wrong
                }));
            }
            tally
        };
        let told = |number, n: usize| {
            let (bench, launches) = drawn(kind, seed, number);
            format!("{kind:?}: {:?} {:?}", bench.track, launches.get(n))
        };
        (
            kind,
            watched(blocks, threads, block, Tally::add, told, &tell),
        )
    };
    Kind::ALL.map(kind).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Share of an arithmetic's changed impacts that are detected, among those that neither graze,
    /// rest nor are doubtful.
    ///
    /// Some are both, so that all of them are a little more than 1. The other arithmetics' impacts
    /// are unchanged.
    fn noticed(n: usize, spoil: impl Fn(&mut Impact<PartState>) + Sync) -> f64 {
        let rests = AtomicUsize::new(0);
        let only_this = |which: usize, impact: &mut Impact<PartState>| {
            if which != n {
                return;
            }
            if impact.flight > 0.0 {
                spoil(impact);
            } else {
                rests.fetch_add(1, Ordering::Relaxed);
            }
        };
        let (mut wrong, mut of) = (0, 0);
        for (kind, Tally(seen)) in spoiled(BLOCK, 5, 1, only_this, |_| {}) {
            for (which, seen) in seen.iter().enumerate() {
                assert!(which == n || seen.wrong == 0, "{kind:?} {which}");
            }
            wrong += seen[n].wrong;
            of += seen[n].launches - seen[n].flagged - seen[n].doubtful;
        }
        wrong as f64 / (of - rests.into_inner() as u64) as f64
    }

    /// Launches and tracks that an earlier judge rejected wrongly, with the arithmetics concerned.
    #[test]
    fn what_arithmetics_round_and_leave_out_is_not_wrong() {
        // k, phase, velocity; amplitude and angle of both tones; number of the arithmetic.
        let told = "\
            # The gap is 1.3e-16 below 0 in 50 digits: the steps of f64 passed it.
            0.6687744855880737 4.956585342922264 0.05858538063683924 \
            0.04422844643704593 2.473028682702567 0.49190439167432487 4.027142765083594 0
            # f32 ends 3.4e-5 rad early: its step is 0.02 rad, with half the slope at its end.
            0.036666177213191986 0.9351735011128768 1.1779218912124634 \
            0.38365946570411325 1.6710014899993009 0.49088987219147384 5.758842747944476 1
            # f64 ends 1e-9 rad early, where the gap is 4.2e-16 below 0 and falls at 4e-7.
            0.8734670281410217 1.7890589832244281 0.016837129153128648 \
            0.13455773564055562 3.8834187280234134 0.1543038352392614 0.1253389852604064 0
            # f32 lands on a stretch that is level for 0.1 rad, 1.5e-7 above 0.
            0.45561397075653076 4.725681662626832 1.6527704000473022 \
            0.24626691127195954 1.1631240474138165 0.07384043256752193 2.725558356411393 1
            # The push is level to 2e-11: f32 rounds between no hop and a throw of twenty turns.
            0.01220413763076067 6.178004592814933 3.028766118052361e-26 \
            0.11424984713084996 3.0926211534331016 0 0 1
            # Householder's steps lead 1468 rad away and back, over which f32 keeps its digits.
            0.36970144510269165 1.6290708902100857 0.00019097790936939418 \
            0.07761136628697382 1.51444318046587 0 0 1";
        for line in told.lines().filter(|line| !line.trim().starts_with('#')) {
            let numbers: Vec<f64> = line
                .split_whitespace()
                .map(|number| number.parse().unwrap())
                .collect();
            let [k, phase, velocity, e, th, e3, th3, which] = numbers[..] else {
                panic!("{line}");
            };
            let bench = Bench::build(k, [Tone::new(e, th), Tone::new(e3, th3)]);
            let launch = PartState { phase, velocity };
            let tally = one(&bench, launch, &|_, _| {}, &|cause| println!("{cause}"));
            let seen = tally.0[which as usize];
            assert_eq!((seen.launches, seen.wrong), (1, 0), "{launch:?}");
        }
    }

    #[test]
    fn a_wrong_impact_is_noticed_in_every_arithmetic() {
        for (n, name) in NAMES.iter().enumerate() {
            // Far above each rounding, far below the distance of another root.
            let off = if n == 0 { 1e-9 } else { 1e-2 };
            let shares = crate::bench::spoils(off).map(|spoil| noticed(n, spoil));
            println!("{name}: {shares:.4?}");
            // Slow arrivals and tiny flights have wider tolerances; another root is always
            // detected.
            assert!(shares.iter().all(|share| *share > 0.9), "{name} {shares:?}");
            assert!(shares[4] >= 1.0, "{name} {shares:?}");
        }
    }
}
