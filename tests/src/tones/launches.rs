//! Random tracks of two and three tones, and launches from them: ordinary and adversarial ones.

use std::f64::consts::TAU;

use kband::arithmetic::Phase;
use kband::impact::{PartState, Tone, Wave};

use crate::oracle::Track;
use crate::states::Random;

/// The kinds of launch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// psi uniform in 0..3.
    Low,
    /// psi uniform in 0..20.
    High,
    /// psi log-uniform in 1e-20..3.
    Chatter,
    /// Phases within 1e-16..0.1 of an edge, where the push passes k; psi = 0 or tiny.
    Edge,
    /// Flights that touch a hump within 1e-17..1e-2.
    Grazing,
    /// psi log-uniform in 1e-30..100.
    Wide,
}

impl Kind {
    /// Every kind.
    pub const ALL: [Self; 6] = [
        Self::Low,
        Self::High,
        Self::Chatter,
        Self::Edge,
        Self::Grazing,
        Self::Wide,
    ];
}

/// A random track, of two or three tones with equal chance; k up to the highest throw.
///
/// # Panics
/// If the library refuses valid tones.
pub fn track(random: &mut Random) -> (Track, Wave) {
    let second = if random.sign() > 0.0 {
        random.between(0.0, 0.5)
    } else {
        random.between(0.0, 0.2)
    };
    let third = if random.sign() > 0.0 {
        random.between(0.0, 0.5)
    } else {
        0.0
    };
    let tones = [
        second,
        random.between(-TAU, TAU),
        third,
        random.between(-TAU, TAU),
    ];
    let [e, th, e3, th3] = tones;
    let tone = |amplitude, angle| Tone { amplitude, angle };
    let wave = Wave::build(tone(e, th), tone(e3, th3)).expect("tones of at most 0.5");
    let k = if random.sign() > 0.0 {
        random.between(0.02, 1.0)
    } else {
        random.scale(0.01, 1.2 * wave.highest_throw())
    };
    (Track::of(k, tones), wave)
}

/// Phases of a turn, from a random one on, at which the push of the track passes k.
fn edges<'a>(track: &'a Track, random: &mut Random) -> impl Iterator<Item = f64> + 'a {
    const STEP: f64 = TAU / 500.0;
    let excess = |phase: f64| -track.at(phase)[2] - track.k;
    let start = random.between(0.0, TAU);
    let places = (0..500).map(move |n| start + f64::from(n) * STEP);
    let mut before = excess(start);
    places.filter_map(move |first| {
        let (here, there) = (before, excess(first + STEP));
        before = there;
        if (here < 0.0) == (there < 0.0) {
            return None;
        }
        let (mut low, mut high) = (first, first + STEP);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if (excess(middle) < 0.0) == (here < 0.0) {
                low = middle;
            } else {
                high = middle;
            }
        }
        Some(low)
    })
}

/// Phase and velocity of a flight that touches the track at a random place, and its time until
/// then.
pub fn touching(track: &Track, random: &mut Random) -> Option<(f64, f64, f64)> {
    let touch = random.between(0.0, TAU);
    let [s, c, curvature, _] = track.at(touch);
    if -curvature <= track.k {
        return None;
    }
    let gap = |past: f64| s - c * past - 0.5 * track.k * past * past - track.at(touch - past)[0];
    let mut far = random.between(0.05, 9.0);
    let mut near = gap(far);
    loop {
        let there = gap(far + 0.05);
        if near > 0.0 && there <= 0.0 {
            break;
        }
        near = there;
        far += 0.05;
        if far > 60.0 {
            return None;
        }
    }
    let (mut near, mut far) = (far, far + 0.05);
    for _ in 0..60 {
        let middle = 0.5 * (near + far);
        if gap(middle) > 0.0 {
            near = middle;
        } else {
            far = middle;
        }
    }
    let phase = (touch - far).rem_euclid(TAU);
    Some((phase, c + track.k * far - track.at(phase)[1], far))
}

/// The launches of one kind from a track.
#[derive(Clone, Debug)]
pub struct Launches {
    kind: Kind,
    edges: Vec<f64>,
    touching: Option<(f64, f64, f64)>,
    drawn: u32,
}

/// Launches that pass one touch on either side: finding a touch takes as long as a dozen verdicts.
const ASIDE: u32 = 32;

impl Launches {
    /// The launches of a kind from this track; `None` where it has none.
    pub fn from(track: &Track, kind: Kind, random: &mut Random) -> Option<Self> {
        let edges = match kind {
            Kind::Edge => edges(track, random).collect(),
            _ => Vec::new(),
        };
        (kind != Kind::Edge || !edges.is_empty()).then_some(Self {
            kind,
            edges,
            touching: None,
            drawn: 0,
        })
    }

    /// The next launch, if the draw gives one.
    ///
    /// Every second one is rounded to the steps of all arithmetics, 2^-32 turns and 2^-26 or f32.
    pub fn draw(&mut self, track: &Track, random: &mut Random) -> Option<PartState> {
        let anywhere = random.between(0.0, TAU);
        let (mut phase, mut velocity) = match self.kind {
            Kind::Low => (anywhere, random.between(0.0, 3.0)),
            Kind::High => (anywhere, random.between(0.0, 20.0)),
            Kind::Chatter => (anywhere, random.scale(1e-20, 3.0)),
            Kind::Edge => {
                let edge = self.edges[(random.bits() % self.edges.len() as u64) as usize];
                let aside = random.sign() * random.scale(1e-16, 0.1);
                let still = random.sign() > 0.0;
                let psi = if still { 0.0 } else { random.scale(1e-30, 0.1) };
                (edge + aside, psi)
            }
            Kind::Grazing => {
                if self.drawn.is_multiple_of(ASIDE) {
                    self.touching = touching(track, random);
                }
                self.drawn = self.drawn.wrapping_add(1);
                let Some((phase, velocity, _)) = self.touching else {
                    self.drawn = 0;
                    return None;
                };
                let velocity = velocity + random.sign() * random.scale(1e-17, 1e-2);
                if !(0.0..20.0).contains(&velocity) {
                    return None;
                }
                (phase, velocity)
            }
            Kind::Wide => (anywhere, random.scale(1e-30, 100.0)),
        };
        phase = phase.rem_euclid(TAU);
        if random.sign() > 0.0 {
            phase = Phase::from_radians(phase).radians();
            velocity = f64::from(((velocity * 67_108_864.0).round() / 67_108_864.0) as f32);
        }
        (phase < TAU).then_some(PartState { phase, velocity })
    }
}
