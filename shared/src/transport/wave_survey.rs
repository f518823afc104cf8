//! Measurement of the conveying speed on a track with several tones and friction.

use super::conveyed::Conveying;
use super::survey::{CONVERGENCE_PERIODS, Effort, Measured, classify_run};
use crate::impact::{Friction, Orbit, StopReason, WaveMap};

/// Largest number of lift-off phases in a turn; after as many lift-offs the phases repeat.
const MAX_LIFT_OFF_PHASES: usize = 3;

/// [`measure`](super::measure) on a track of several tones with friction; `along` must be built for
/// the same track and k.
///
/// A part may have several lift-off phases in a cycle. If it comes to rest, it is measured between
/// two lift-offs at the same phase, once its velocity there has converged.
pub fn measure_on_tones(
    mut orbit: Orbit<'_, WaveMap>,
    along: Friction,
    effort: Effort,
) -> Measured {
    let mut conveying = Conveying::of(along, &orbit);
    let (ended, steady) = measure_until_steady(&mut orbit, &mut conveying, effort);
    classify_run(ended, conveying.conveyed(), steady, along)
}

/// Runs transient and measurement; returns whether the velocity along the track has converged.
fn measure_until_steady(
    orbit: &mut Orbit<'_, WaveMap>,
    conveying: &mut Conveying<Friction>,
    effort: Effort,
) -> (StopReason, bool) {
    orbit.watch_until(effort.settle, conveying, |_| false);
    conveying.restart_at_lift_off();
    let mut phase = None;
    for _ in 0..MAX_LIFT_OFF_PHASES {
        match orbit.watch_until(effort.impacts, conveying, |_| true) {
            StopReason::Repeats => phase = Some(orbit.state().phase),
            other => return (other, true),
        }
    }
    let mut ended = StopReason::Repeats;
    for _ in 0..CONVERGENCE_PERIODS {
        let before = conveying.velocity();
        conveying.restart_at_lift_off();
        ended = orbit.watch_until(effort.impacts, conveying, |lift_off| {
            Some(lift_off) == phase
        });
        if ended != StopReason::Repeats || (conveying.velocity() - before).abs() <= 1e-12 {
            return (ended, true);
        }
    }
    (ended, false)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::{FrictionSettings, PartState, Tone, Wave};

    fn settings(mu: f64) -> FrictionSettings {
        FrictionSettings {
            sticking: mu,
            sliding: mu,
            amplitude_ratio: 1.5,
            phase_lead: 0.3,
            incline_tangent: 0.05,
        }
    }

    fn two_tones(amplitude: f64, angle: f64) -> Wave {
        Wave::build(Tone::new(amplitude, angle), Tone::default()).unwrap()
    }

    const EFFORT: Effort = Effort {
        settle: 300,
        impacts: 1000,
    };

    /// While a part slides in one direction, v' + c mu u' is independent of the contact force,
    /// through slides and impacts, on any wave.
    #[test]
    fn contact_force_invariant_is_conserved_on_every_wave() {
        let mut runs = 0;
        for n in 0..300 {
            let part = |m: i32| f64::from(n * m % 101) / 101.0;
            let tone = |size: f64, angle: f64| Tone::new(0.4 * size, 6.0 * angle);
            let wave = Wave::build(tone(part(31), part(37)), tone(part(41), part(43))).unwrap();
            let law = FrictionSettings {
                sticking: 0.1 + 0.2 * part(5),
                sliding: 0.1 + 0.2 * part(5),
                amplitude_ratio: 0.5 + 2.0 * part(7),
                phase_lead: 2.0 * part(11) - 1.0,
                incline_tangent: 0.2 * part(13) - 0.1,
            };
            let (k, mu) = ((0.3 + 0.6 * part(17)) * wave.highest_throw(), law.sliding);
            // Fast enough to keep its direction for a while.
            let c = if n % 2 == 0 { 1.0 } else { -1.0 };
            let start = PartState::new(6.0 * part(23), 0.3 + part(29));
            let map = WaveMap::on(wave, k, 0.1 + 0.7 * part(19)).unwrap();
            let mut orbit = Orbit::new(&map, start);
            let mut run = Conveying::new(Friction::on(&wave, k, law).unwrap(), &map);
            run.velocity = 60.0 * c;
            // Velocity of the track at a phase, and its contribution to the invariant.
            let carried = |phase: f64| {
                let along = wave.motion(phase + law.phase_lead)[1];
                law.amplitude_ratio * along + c * mu * wave.motion(phase)[1]
            };
            let resistance = k * (law.incline_tangent + c * mu);
            let invariant_of = |state: PartState, run: &Conveying<Friction>| {
                let conveyed = run.conveyed();
                let time = conveyed.flying + conveyed.resting;
                let relative = run.velocity + c * mu * state.velocity;
                relative + carried(state.phase) + resistance * time
            };
            let initial = invariant_of(start, &run);
            for _ in 0..30 {
                // One event at a time: an impact, or a lift-off after a rest.
                let ended = orbit.watch_until(1, &mut run, |_| true);
                if ended == StopReason::RestsForEver || run.velocity * c <= 0.0 {
                    break;
                }
                let conveyed = run.conveyed();
                let clock = conveyed.flying + conveyed.resting;
                let error = (invariant_of(orbit.state(), &run) - initial).abs();
                assert!(error < 1e-8 * (1.0 + clock), "{n}: {error} of {initial}");
                runs += 1;
            }
        }
        assert!(runs > 4000, "{runs}");
    }

    #[test]
    fn sliding_and_hopping_begin_at_their_thresholds() {
        for (e, th) in [(0.15, 2.356), (0.3, 0.5), (0.1, 5.0)] {
            let wave = two_tones(e, th);
            let law = settings(0.6);
            let moves = |throw: f64| {
                let (k, along) = (1.0 / throw, Friction::on(&wave, 1.0 / throw, law).unwrap());
                let map = WaveMap::on(wave, k, 0.2).unwrap();
                measure_on_tones(Orbit::from_rest(&map), along, EFFORT).conveyed
            };
            let hops = 1.0 / wave.highest_throw();
            let first =
                [true, false].map(|upwards| law.sliding_throw_number(&wave, upwards).unwrap());
            let [up, down] = first;
            assert!(up.min(down) < hops, "{e} {th}");
            let first_slide = up.min(down);
            let below = moves(first_slide * (1.0 - 1e-6));
            assert_eq!((below.forward, below.backward), (0.0, 0.0));
            let slides = moves(first_slide * (1.0 + 1e-3));
            let slid = if up < down {
                slides.forward
            } else {
                slides.backward
            };
            assert!(slid > 0.0);
            assert_eq!(moves(hops * (1.0 - 1e-6)).flying, 0.0);
            assert!(moves(hops * (1.0 + 1e-3)).flying > 0.0);
        }
    }
}
