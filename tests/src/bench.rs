//! Every arithmetic on one track, and verdicts on its impacts.
//!
//! An arithmetic rounds a launch to another one. Arithmetics with the same rounded launch share a
//! proof.

use kband::impact::{Impact, Integer, Kernel, Map, PartState, Single, WaveKernel, WaveMap};

use crate::oracle::Track;
use crate::states::Launch;
use crate::verdict::{Proof, Tried, Verdict, judge};

/// A track in every arithmetic that can represent it; several tones only in f64 and f32.
pub struct Bench {
    /// The map in f64; `None` on several tones.
    pub map: Option<Map>,
    wave: Option<WaveMap>,
    single: Option<Single>,
    integer: Option<Integer>,
}

/// A judged launch: verdict on f64, and its impact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judged {
    pub verdict: Verdict,
    pub impact: Impact<PartState>,
    /// Number of arithmetics with another root that they flag.
    pub flagged: u64,
}

fn sine<K: Kernel>(track: &Track, restitution: f64) -> Option<K> {
    let built = track.is_sine().then(|| K::build(track.k, restitution));
    built?.ok()
}

fn tones<K: WaveKernel>(track: &Track, restitution: f64) -> Option<K> {
    K::on_tones(track.upper_tones(), track.k, restitution).ok()
}

impl Bench {
    pub fn build(track: &Track, restitution: f64) -> Self {
        Self {
            map: sine(track, restitution),
            wave: tones(track, restitution),
            single: tones(track, restitution),
            integer: sine(track, restitution),
        }
    }

    /// Judges every arithmetic that can represent a launch from this track.
    ///
    /// The microcontroller kernels are judged on their rounded launch. The error names the
    /// arithmetic and the replay command.
    ///
    /// # Errors
    /// In any arithmetic: a wrong root without a flag, a number that is not finite, a phase outside
    /// the turn, or a negative velocity. Also a speed or phase that does not agree with the flight.
    pub fn judge(&self, launch: &Launch) -> Result<Judged, String> {
        let (mut proof, state) = (Proof::new(*launch), launch.state());
        let (verdict, impact) = if let Some(map) = &self.map {
            let impact = map.impact(state);
            (one::<Map>(&proof, impact)?, impact)
        } else if let Some(wave) = &self.wave {
            let impact = wave.impact(state);
            (one::<WaveMap>(&proof, impact)?, impact)
        } else {
            return Err(format!("f64 refuses {launch:?}"));
        };
        // Arithmetics with the same launch are neighbours in this order.
        let others = [
            another(self.single.as_ref(), launch, &mut proof)?,
            another(self.integer.as_ref(), launch, &mut proof)?,
        ];
        let verdicts = others.into_iter().flatten().chain([verdict]);
        let flagged = verdicts.filter(|verdict| *verdict == Verdict::Flagged);
        Ok(Judged {
            verdict,
            impact,
            flagged: flagged.count() as u64,
        })
    }
}

/// Judges an arithmetic, if it can represent the launch.
fn another<K: Tried>(
    kernel: Option<&K>,
    launch: &Launch,
    proof: &mut Proof,
) -> Result<Option<Verdict>, String> {
    let Some((held, impact)) = kernel.and_then(|kernel| tried(kernel, launch)) else {
        return Ok(None);
    };
    if proof.launch != held {
        *proof = Proof::new(held);
    }
    one::<K>(proof, impact).map(Some)
}

/// A launch as an arithmetic represents it, and its impact; `None` if it cannot.
fn tried<K: Tried>(kernel: &K, launch: &Launch) -> Option<(Launch, Impact<PartState>)> {
    let state = K::state(launch.phase, launch.velocity).ok()?;
    let impact = kernel.impact(state);
    let impact = Impact {
        flight: impact.flight,
        next: K::observe(impact.next),
        grazes: impact.grazes,
    };
    let (state, mut held) = (K::observe(state), *launch);
    (held.phase, held.velocity) = (state.phase, state.velocity);
    Some((held, impact))
}

/// Judges the impact of an arithmetic against the proof of its launch.
fn one<K: Tried>(proof: &Proof, impact: Impact<PartState>) -> Result<Verdict, String> {
    // So near to lift-off the phase resolution decides whether the track throws the part.
    if proof.launch.velocity < 1e-16 && proof.distance_to_edge() < 6.0 * K::STEPS[0] {
        return Ok(Verdict::Flagged);
    }
    judge::<K>(proof, &impact).map_err(|cause| {
        let (track, restitution) = (proof.launch.track, proof.launch.restitution);
        let PartState { phase, velocity } = proof.launch.state();
        let mut tones = String::new();
        for (name, tone) in ["second", "third"].iter().zip(track.upper_tones()) {
            if tone.amplitude > 0.0 {
                tones += &format!(" --{name}-tone {:e},{:e}", tone.amplitude, tone.angle);
            }
        }
        format!(
            "{cause}\n    gave {impact:?}\n    kband impacts --arithmetic {} --k {:e} --restitution {restitution:e} --phase {phase:e} --velocity {velocity:e}{tones}",
            K::NAME, track.k
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::states::{self, Kind, Random};

    /// A change that makes an impact wrong.
    type Falsification<'a> = &'a dyn Fn(&mut Impact<PartState>);

    /// Falsifies impacts of an arithmetic that neither graze nor rest: flight longer and shorter by
    /// a share `off`, speed, phase, another root, no flight. The judge must notice nearly all.
    fn notices<K: Tried>(build: fn(&Track, f64) -> Option<K>, on_tones: bool, off: f64) {
        let falsifications: [Falsification; 6] = [
            &|impact| impact.flight *= 1.0 + off,
            &|impact| impact.flight *= 1.0 - off,
            &|impact| impact.next.velocity += 1e-2,
            &|impact| impact.next.phase = 6.0 - 0.9 * impact.next.phase,
            &|impact| impact.flight += 1.0,
            &|impact| impact.flight = 0.0,
        ];
        let (mut total, mut noticed) = (0, [0; 6]);
        let mut random = Random::new(5);
        for kind in [Kind::High, Kind::Low, Kind::Chatter, Kind::Wrap, Kind::Wide] {
            for _ in 0..400 {
                let tones = on_tones.then(|| states::tones(&mut random));
                let track = kind.track(&mut random, tones.unwrap_or_default());
                let launch = kind.launch(&mut random, track, 0.5);
                let Some((held, sound)) = build(&track, 0.5).and_then(|k| tried(&k, &launch))
                else {
                    continue;
                };
                if sound.flight == 0.0 || sound.grazes {
                    continue;
                }
                total += 1;
                let proof = Proof::new(held);
                for (falsify, count) in falsifications.iter().zip(&mut noticed) {
                    let mut wrong = sound;
                    falsify(&mut wrong);
                    *count += u32::from(one::<K>(&proof, wrong).is_err());
                }
            }
        }
        println!("{}: {noticed:?} of {total}", K::NAME);
        assert!(total > 1000 && noticed.iter().all(|count| 10 * count > 9 * total));
    }

    #[test]
    fn a_wrong_impact_is_noticed_in_every_arithmetic() {
        // Far above the rounding errors, and far below the distance of another root.
        notices::<Map>(sine, false, 1e-9);
        notices::<WaveMap>(super::tones, true, 1e-9);
        notices::<Single>(super::tones, false, 1e-2);
        notices::<Single>(super::tones, true, 1e-2);
        notices::<Integer>(sine, false, 1e-2);
    }
}
