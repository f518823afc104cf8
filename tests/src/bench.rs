//! Every arithmetic on one track, and the verdicts on its impacts.
//!
//! An arithmetic rounds a launch to another launch. Those with the same rounded launch share one
//! proof.

use kband::impact::{Impact, Integer, Kernel, Map, PartState, Single, WaveKernel, WaveMap};

use crate::oracle::Track;
use crate::states::Launch;
use crate::verdict::{Proof, Tried, Verdict, judge};

/// A track in every arithmetic that can represent it; on several tones in f64 and f32 only.
pub struct Bench {
    map: Option<Map>,
    wave: Option<WaveMap>,
    single: Option<Single>,
    integer: Option<Integer>,
}

/// A launch that was judged: the verdict on f64, and its impact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judged {
    /// The verdict.
    pub verdict: Verdict,
    /// The impact.
    pub impact: Impact<PartState>,
    /// Number of arithmetics with another root that they flag.
    pub flagged: u64,
}

impl Bench {
    /// The bench of a track.
    pub fn build(track: &Track, restitution: f64) -> Self {
        fn sine<K: Kernel>(track: &Track, restitution: f64) -> Option<K> {
            let built = track.is_sine().then(|| K::build(track.k, restitution));
            built?.ok()
        }
        fn tones<K: WaveKernel>(track: &Track, restitution: f64) -> Option<K> {
            K::on_tones(track.upper_tones(), track.k, restitution).ok()
        }
        Self {
            map: sine(track, restitution),
            wave: tones(track, restitution),
            single: tones(track, restitution),
            integer: sine(track, restitution),
        }
    }

    /// The map of one tone in f64.
    pub fn map(&self) -> Option<&Map> {
        self.map.as_ref()
    }

    /// The impact in f64.
    fn impact(&self, state: PartState) -> Option<Impact<PartState>> {
        match (&self.map, &self.wave) {
            (Some(map), _) => Some(map.impact(state)),
            (None, Some(wave)) => Some(wave.impact(state)),
            (None, None) => None,
        }
    }

    /// Judges every arithmetic that can represent a launch from this track.
    ///
    /// The microcontroller kernels are judged on their rounded launch. The error names the
    /// arithmetic and the replay command.
    ///
    /// # Errors
    /// In any arithmetic: a wrong root without a flag, a number that is not finite, a phase outside
    /// the turn, a negative velocity. A speed or a phase that does not belong to the flight.
    pub fn judge(&self, launch: &Launch) -> Result<Judged, String> {
        self.spoiled(launch, &|_, _| {})
    }

    /// The same; `spoil` may change the impact of the named arithmetic.
    fn spoiled(
        &self,
        launch: &Launch,
        spoil: &impl Fn(&str, &mut Impact<PartState>),
    ) -> Result<Judged, String> {
        let Some(impact) = self.impact(launch.state()) else {
            return Err(format!("f64 refuses {launch:?}"));
        };
        let mut proof = Proof::of(*launch, impact.flight);
        let verdict = if self.map.is_some() {
            one::<Map>(&mut proof, impact, spoil)?
        } else {
            one::<WaveMap>(&mut proof, impact, spoil)?
        };
        // In an order in which arithmetics with the same launch are neighbours.
        let others = [
            self.another(self.single.as_ref(), launch, &mut proof, spoil)?,
            self.another(self.integer.as_ref(), launch, &mut proof, spoil)?,
        ];
        let verdicts = others.into_iter().flatten().chain([verdict]);
        let flagged = verdicts.filter(|verdict| *verdict == Verdict::Flagged);
        Ok(Judged {
            verdict,
            impact,
            flagged: flagged.count() as u64,
        })
    }

    /// Judges an arithmetic, if it can represent the launch.
    fn another<K: Tried>(
        &self,
        kernel: Option<&K>,
        launch: &Launch,
        proof: &mut Proof,
        spoil: &impl Fn(&str, &mut Impact<PartState>),
    ) -> Result<Option<Verdict>, String> {
        let (Some(kernel), Ok(state)) = (kernel, K::state(launch.phase, launch.velocity)) else {
            return Ok(None);
        };
        let impact = kernel.impact(state);
        let impact = Impact {
            flight: impact.flight,
            next: K::observe(impact.next),
            grazes: impact.grazes,
        };
        let PartState { phase, velocity } = K::observe(state);
        let held = Launch {
            phase,
            velocity,
            ..*launch
        };
        if *proof.launch() != held {
            let guess = self.impact(held.state());
            *proof = Proof::of(held, guess.map_or(0.0, |impact| impact.flight));
        }
        one::<K>(proof, impact, spoil).map(Some)
    }
}

/// Judges the impact of an arithmetic against the proof of its launch.
fn one<K: Tried>(
    proof: &mut Proof,
    mut impact: Impact<PartState>,
    spoil: &impl Fn(&str, &mut Impact<PartState>),
) -> Result<Verdict, String> {
    spoil(K::NAME, &mut impact);
    // So near to lift-off the step of the phase decides whether the track throws the part.
    if proof.launch().velocity < 1e-16 && proof.from_edge() < 6.0 * K::STEPS[0] {
        return Ok(Verdict::Flagged);
    }
    judge::<K>(proof, &impact).map_err(|cause| {
        let Launch {
            track,
            restitution,
            phase,
            velocity,
        } = proof.launch();
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
    type Spoil = Box<dyn Fn(&mut Impact<PartState>)>;

    /// Changes that make an impact wrong: flight longer and shorter by a share `off`, speed, phase,
    /// another root, none.
    fn spoils(off: f64) -> [Spoil; 6] {
        [
            Box::new(move |impact| impact.flight *= 1.0 + off),
            Box::new(move |impact| impact.flight *= 1.0 - off),
            Box::new(|impact| impact.next.velocity += 1e-2),
            Box::new(|impact| impact.next.phase = 6.0 - 0.9 * impact.next.phase),
            Box::new(|impact| impact.flight += 1.0),
            Box::new(|impact| impact.flight = 0.0),
        ]
    }

    /// Share of an arithmetic's changed impacts that are detected, among those that neither graze
    /// nor rest.
    fn noticed(name: &str, on_tones: bool, spoil: impl Fn(&mut Impact<PartState>)) -> f64 {
        let (mut wrong, mut of) = (0, 0);
        let mut random = Random::new(5);
        for kind in [Kind::High, Kind::Low, Kind::Chatter, Kind::Wrap, Kind::Wide] {
            for _ in 0..400 {
                let tones = on_tones.then(|| states::tones(&mut random));
                let tones = tones.unwrap_or_default();
                let track = kind.track(&mut random, tones);
                let launch = kind.launch(&mut random, track, 0.5);
                let tried = std::cell::Cell::new(false);
                let only_this = |which: &str, impact: &mut Impact<PartState>| {
                    if which == name && impact.flight > 0.0 && !impact.grazes {
                        tried.set(true);
                        spoil(impact);
                    }
                };
                let judged = Bench::build(&track, 0.5).spoiled(&launch, &only_this);
                let of_this = format!("--arithmetic {name} ");
                let told = judged.is_err_and(|cause| cause.contains(&of_this));
                assert!(tried.get() || !told, "{launch:?}");
                of += u32::from(tried.get());
                wrong += u32::from(told);
            }
        }
        f64::from(wrong) / f64::from(of)
    }

    #[test]
    fn a_wrong_impact_is_noticed_in_every_arithmetic() {
        for (name, on_tones) in [
            (Map::NAME, false),
            (Single::NAME, false),
            (Integer::NAME, false),
            (WaveMap::NAME, true),
            (Single::NAME, true),
        ] {
            // Far above each rounding, far below the distance of another root.
            let exact = [Map::NAME, WaveMap::NAME].contains(&name);
            let off = if exact { 1e-9 } else { 1e-2 };
            let shares = spoils(off).map(|spoil| noticed(name, on_tones, spoil));
            println!("{name}: {shares:.4?}");
            assert!(shares.iter().all(|share| *share > 0.9), "{name} {shares:?}");
        }
    }
}
