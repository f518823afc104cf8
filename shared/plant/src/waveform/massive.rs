//! A part with mass on a track that recoils, simulated sample by sample.
//!
//! Under parts of some per cent of its mass the track jumps at each impact. So the part is a
//! falling body, and the track moves under drive, spring and all parts. Impact times are bisected.

use crate::model::law::Law;
use kband::impact::Scatter;
use kband_control::UPPER;

/// Number of bisections of a sample for an impact; they resolve 1e-9 of it.
const BISECTIONS: usize = 30;

/// Velocities of track and part after an impact with a part of `share` of the track's mass. It
/// keeps momentum, and reverses the relative velocity times `restitution`.
fn collide(track: f64, part: f64, share: f64, restitution: f64) -> [f64; 2] {
    let change = (1.0 + restitution) * (track - part) / (1.0 + share);
    [track - share * change, part + change]
}

/// Motion and gravity of the track for parts with mass.
#[derive(Clone, Copy, Debug)]
pub struct Ground {
    /// Duration of a sample in s.
    pub sample: f64,
    /// Gravity normal to the track and down along it, in m/s^2.
    pub gravity: [f64; 2],
    /// Angular frequency of the drive in rad/s.
    pub angular: f64,
    /// Motion along the track over that normal to it, for each tone n: eta cos, eta sin of n gamma.
    pub along: [[f64; 2]; 1 + UPPER],
    /// Displacement (m) and velocity (m/s) of each upper tone; `None` without a phase lead.
    pub upper: Option<[[f64; 2]; UPPER]>,
    /// Mean displacement of the swinging track in m.
    pub level: f64,
    pub law: Law,
}

impl Ground {
    /// Displacement, velocity and acceleration along the track from those normal to it. Each tone
    /// is harmonic: the derivative of its acceleration is `-(n w)^2` times its velocity.
    pub fn along(&self, [x, v, a]: [f64; 3]) -> [f64; 3] {
        let led = |[x, v, a]: [f64; 3], [cosine, sine]: [f64; 2], angular: f64| {
            let velocity = cosine * v - sine * angular * x;
            let position = cosine * x + sine * v / angular;
            [position, velocity, cosine * a - sine * angular * v]
        };
        let (mut first, mut sum) = ([x - self.level, v, a], [0.0; 3]);
        let upper = self.upper.iter().flatten();
        for (n, (&[x, v], along)) in upper.zip(&self.along[1..]).enumerate() {
            let angular = (n + 2) as f64 * self.angular;
            let upper = [x, v, -angular * angular * x];
            let led = led(upper, *along, angular);
            first = core::array::from_fn(|i| first[i] - upper[i]);
            sum = core::array::from_fn(|i| sum[i] + led[i]);
        }
        let led = led(first, self.along[0], self.angular);
        core::array::from_fn(|i| led[i] + sum[i])
    }
}

/// Displacement (m) and velocity (m/s) of the track at both ends of a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stroke {
    pub from: [f64; 2],
    pub to: [f64; 2],
}

impl Stroke {
    /// State of the track within the sample, by cubic Hermite interpolation.
    fn at(&self, share: f64, sample: f64) -> [f64; 2] {
        let ([x, v], [y, w]) = (self.from, self.to);
        let (v, w) = (v * sample, w * sample);
        let (quadratic, cubic) = (3.0 * (y - x) - 2.0 * v - w, 2.0 * (x - y) + v + w);
        [
            x + share * (v + share * (quadratic + share * cubic)),
            (v + share * (2.0 * quadratic + 3.0 * share * cubic)) / sample,
        ]
    }

    /// Mean acceleration in m/s^2.
    pub fn acceleration(&self, sample: f64) -> f64 {
        (self.to[1] - self.from[1]) / sample
    }
}

/// An impact of a part with mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blow {
    /// Time of the impact within the sample, 0..1.
    pub at: f64,
    /// Arrival speed relative to the track in m/s.
    pub speed: f64,
    /// Track at the impact: displacement in m, mean of the velocities before and after in m/s.
    pub track: [f64; 2],
    /// Start of the flight, in steps of 2^-32 turns of the drive.
    pub began: u64,
    pub rested: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Motion {
    /// At rest normal to the track, with a velocity along it in m/s relative to it.
    Lying(f64),
    Flying(Fall),
}

/// Height in m, velocities normal to the track and along it in m/s. `launch_position` is the
/// track's position along itself at launch and `travel` the distance since, both in m.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Fall {
    height: f64,
    velocity: f64,
    along: f64,
    launch_position: f64,
    travel: f64,
}

impl Fall {
    /// Height and velocity after a time in s under gravity (m/s^2).
    fn normal(&self, gravity: f64, time: f64) -> [f64; 2] {
        let (height, velocity) = (self.height, self.velocity);
        [
            height + time * (velocity - 0.5 * gravity * time),
            velocity - gravity * time,
        ]
    }

    /// Way and velocity along the track after it.
    fn along(&self, down: f64, time: f64) -> [f64; 2] {
        let Self { travel, along, .. } = *self;
        [
            travel + time * (along - 0.5 * down * time),
            along - down * time,
        ]
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassivePart {
    pub restitution: Scatter,
    /// Mass over that of the track (symbol m/M).
    pub share: f64,
    motion: Motion,
    began: u64,
    rested: bool,
    /// Displacement along the track so far in m, positive upwards; a flight counts at its end.
    pub displacement: f64,
}

impl MassivePart {
    /// A part at rest with a share of the track's mass.
    pub fn at_rest(restitution: Scatter, share: f64) -> Self {
        Self {
            restitution,
            share,
            motion: Motion::Lying(0.0),
            began: 0,
            rested: true,
            displacement: 0.0,
        }
    }

    pub fn is_on_track(&self) -> bool {
        matches!(self.motion, Motion::Lying(_))
    }

    /// Drops it from a height in m, without initial speed.
    pub fn drop_from(&mut self, height: f64, now: u64) {
        self.motion = Motion::Flying(Fall {
            height,
            ..Fall::default()
        });
        (self.began, self.rested) = (now, true);
    }

    /// Simulates a sample at rest: it presses with `normal`, the track accelerates by `along`.
    pub fn rest_on(&mut self, ground: &Ground, normal: f64, along: f64) {
        let (Motion::Lying(velocity), Law::Friction(friction)) = (&mut self.motion, ground.law)
        else {
            return;
        };
        let pull = -along - ground.gravity[1];
        let before = *velocity;
        if before == 0.0 {
            if pull.abs() <= friction.sticking * normal {
                return;
            }
            *velocity = (pull - libm::copysign(friction.sliding * normal, pull)) * ground.sample;
        } else {
            *velocity += (pull - libm::copysign(friction.sliding * normal, before)) * ground.sample;
            if before * *velocity < 0.0 {
                *velocity = 0.0;
            }
        }
        self.displacement += 0.5 * (before + *velocity) * ground.sample;
    }

    /// Begins a flight at the end of a sample, as the track falls away.
    pub fn leave(&mut self, ground: &Ground, track: [f64; 2], now: u64) {
        if let Motion::Lying(velocity) = self.motion {
            self.rested = true;
            self.fly(ground, track, track, velocity, now);
        }
    }

    /// Begins a flight with height and velocity `own`, and a velocity along the track over it.
    fn fly(&mut self, ground: &Ground, track: [f64; 2], own: [f64; 2], along: f64, now: u64) {
        let [launch_position, track_velocity, _] = ground.along([track[0], track[1], 0.0]);
        self.began = now;
        self.motion = Motion::Flying(Fall {
            height: own[0],
            velocity: own[1],
            along: track_velocity + along,
            launch_position,
            travel: 0.0,
        });
    }

    /// Simulates a sample of flight over a track's stroke, with its impact, whose recoil is added
    /// to the stroke. `times` are those of the sample's ends in steps of 2^-32 turns.
    pub fn fall(&mut self, ground: &Ground, stroke: &mut Stroke, times: [u64; 2]) -> Option<Blow> {
        let Motion::Flying(fall) = self.motion else {
            return None;
        };
        let (sample, [gravity, down]) = (ground.sample, ground.gravity);
        let [height, velocity] = fall.normal(gravity, sample);
        if height >= stroke.to[0] {
            let [travel, along] = fall.along(down, sample);
            self.motion = Motion::Flying(Fall {
                height,
                velocity,
                along,
                travel,
                ..fall
            });
            return None;
        }
        let (mut above, mut below) = (0.0, 1.0);
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (above + below);
            let is_below = fall.normal(gravity, middle * sample)[0] < stroke.at(middle, sample)[0];
            let end = if is_below { &mut below } else { &mut above };
            *end = middle;
        }
        let [x, v] = stroke.at(below, sample);
        let own = fall.normal(gravity, below * sample)[1];
        let speed = (v - own).max(0.0);
        let restitution = self.restitution.draw();
        let [after, launch_velocity] = collide(v, own, self.share, restitution);
        let [track_position, track_velocity, _] = ground.along([x, v, 0.0]);
        let [travel, along] = fall.along(down, below * sample);
        self.displacement += travel - (track_position - fall.launch_position);
        let relative = along - track_velocity;
        let relative = match ground.law {
            Law::Restitution(tangential) => tangential.restitution * relative,
            Law::Friction(friction) => {
                friction.velocity_after_impact(relative, (1.0 + restitution) * speed, [0.0; 2])
            }
        };
        let blow = Blow {
            at: below,
            speed,
            track: [x, 0.5 * (v + after)],
            began: self.began,
            rested: self.rested,
        };
        self.rested = false;
        let rest = (1.0 - below) * sample;
        stroke.to[0] += (after - v) * rest;
        stroke.to[1] += after - v;
        let time = times[0] + ((times[1] - times[0]) as f64 * below) as u64;
        self.fly(ground, [x, after], [x, launch_velocity], relative, time);
        let end = [
            x + rest * (launch_velocity - 0.5 * gravity * rest),
            launch_velocity - gravity * rest,
        ];
        if end[0] <= stroke.to[0] {
            // The hop ends within the sample: the part stays, and the track receives its momentum.
            let [track, _] = collide(stroke.to[1], end[1], self.share, 0.0);
            stroke.to[1] = track;
            let velocity = match ground.law {
                Law::Restitution(_) => 0.0,
                Law::Friction(_) => relative,
            };
            self.motion = Motion::Lying(velocity);
        } else if let Motion::Flying(fall) = &mut self.motion {
            [fall.height, fall.velocity] = end;
            [fall.travel, fall.along] = fall.along(down, rest);
        }
        Some(blow)
    }
}
