//! Estimates the time in gear, the restitution and its scatter from the phases of single impacts.
//!
//! Gear means one flight in every r drive periods. Three impacts in a row give one restitution in
//! closed form: launch speed of the second flight over arrival speed of the first
//! (docs/theory-real-parts.md#t10.7).
//!
//! A part that chatters, rests and is thrown again strikes as regularly as one in gear. A
//! likelihood ratio of landing phase and implied restitution separates the two. Averages forget
//! exponentially. Successive restitutions of one part are uncorrelated, which the mean square
//! successive difference tests (von Neumann 1941).

use super::energy::{SECTORS, SECTORS_PER_CYCLE};
use super::onset::DetectedImpact;
use super::phases::share_of;
use super::signal::Cycle;
use crate::angle::{impact_time, radians_of};
use crate::{Shape, UPPER, phase_of};
use core::f32::consts::TAU;
use kband::arithmetic::{Phase, sine_cosine_single, square_root_single};
use kband::feeder::Restitution;
use kband::impact::ContactTime;
use kband::regime::gear;
use serde::{Deserialize, Serialize};

/// Memory of the share of time in gear, in drive cycles (exponential forgetting).
const GEAR_WINDOW: f32 = 64.0;
/// Memory of the estimated restitution, in impacts: its error is an eleventh of the scatter.
const RESTITUTION_MEMORY_IMPACTS: f32 = 128.0;
/// Memory of the estimated trace, in impacts: A scatters by a third, the trace then by up to 0.05.
const TRACE_MEMORY_IMPACTS: f32 = 1024.0;
/// Minimum number of impacts for an estimated restitution: its scatter then errs by 16 %.
const MIN_IMPACTS: f32 = 20.0;
/// Memory of the losses of gear, in drive cycles: more than a minute at 50 Hz.
const LOSS_MEMORY_CYCLES: f32 = 4096.0;
/// Shortest and longest flight in gear over r, in 2^-32 periods (docs/theory-real-parts.md#t10.1).
const FLIGHT_BOUNDS: [u64; 2] = [
    (gear::FLIGHT_RANGE[0] * Phase::TURN) as u64,
    (gear::FLIGHT_RANGE[1] * Phase::TURN) as u64,
];
/// Number of drive cycles that output the sectors of a whole turn.
const QUARTERS: usize = SECTORS / SECTORS_PER_CYCLE;
/// Number of successive flights that define gear.
const MIN_FLIGHTS_IN_GEAR: u16 = 8;
/// Minimum scatter of an implied restitution (stamps, amplitude); also its slack beyond 0 and 1.
const MIN_SCATTER: f32 = 0.03;
/// Largest used ratio of estimated to configured scatter: 1 plus the 16 % of [`MIN_IMPACTS`].
const MAX_SCATTER_RATIO: f32 = 1.2;
/// Distance of an implied restitution from the lot, in standard deviations, that rejects it.
const MAX_LOT_DISTANCE: f32 = 4.0;
/// Standard deviation of a landing phase from rest, in rad: one sample at 50 Hz.
const LANDING_DEVIATION: f32 = 0.015;
/// Mean delay and deviation, in rad, of a landing after undetected bounces, against one from rest.
const BOUNCED_LANDING: [f32; 2] = [0.1, 0.14];
/// Weight of such landings in the likelihood ratio: measured, R of 0.1 to 0.6, s of 0.03 to 0.10.
const BOUNCED_WEIGHT: f32 = 0.35;
/// Weight of a landing from rest after an unknown flight, in rad: it accepts within 2.0 deviations.
const LANDING_WEIGHT_AFTER_UNKNOWN: f32 = 0.3;
/// Stamped height of the faintest detected impact over the noise.
const MIN_IMPACT_TO_NOISE: f32 = 2.2;
/// Initial speed over b w of the faintest detected impact: a fifth of `2 pi k/(1 + R)` in gear.
const INITIAL_MIN_IMPACT_SPEED: f32 = 0.4;
/// Serial correlation of implied restitutions, in standard errors, that shows several parts.
const MAX_SERIAL_CORRELATION: f32 = 4.0;
/// Error of the mean stamped phase of a lock, in rad: one sample at 300 Hz.
const STAMP_ERROR: f32 = 0.1;
/// Relative change of k, and change of the tones, above which the flight from rest is recomputed.
const FLIGHT_TOLERANCE: f32 = 0.003;

/// Estimated margin to the loss of gear. One part: from each flight. Several parts: from the
/// profile of their impacts over the turn (docs/theory-real-parts.md#t10.7).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GearMargin {
    /// Trace of the tangent map of one impact (symbol tr J): `1 + R^2 - A (1 + R)^2/k`.
    pub trace: f32,
    /// Estimated restitution (symbol R), 0..1.
    pub restitution: f32,
    /// Standard error of that restitution.
    pub error: f32,
    /// Scatter of restitution from impact to impact (symbol s): of one part, or the lot's.
    pub scatter: f32,
    /// Distance from the period doubling, `1 + R^2 + tr J`: 0 at the flip, negative beyond it.
    pub flip: f32,
    /// Expected drive cycles until gear is lost: cycles in gear over losses plus one, or the map's.
    pub to_loss: f32,
}

/// Motion of the track over its first tone's amplitude: displacement, velocity, minus acceleration.
#[derive(Clone, Copy, Debug, Default)]
struct TrackMotion {
    /// `e cos th` and `e sin th` of each tone above the first.
    tones: [[f32; 2]; UPPER],
}

impl TrackMotion {
    fn evaluate(&self, phase: Phase) -> [f32; 3] {
        let (sine, cosine) = sine_cosine_single(phase);
        let [[in_phase, quadrature], third] = self.tones;
        if self.tones == [[0.0; 2]; UPPER] {
            return [sine, cosine, sine];
        }
        let (sine2, cosine2) = (2.0 * sine * cosine, 1.0 - 2.0 * sine * sine);
        let second = in_phase * sine2 + quadrature * cosine2;
        let mut motion = [
            sine + second,
            cosine + 2.0 * (in_phase * cosine2 - quadrature * sine2),
            sine + 4.0 * second,
        ];
        if third != [0.0; 2] {
            let [in_phase, quadrature] = third;
            let twice = 2.0 * cosine;
            let (sine, cosine) = (twice * sine2 - sine, twice * cosine2 - cosine);
            let third = in_phase * sine + quadrature * cosine;
            motion[0] += third;
            motion[1] += 3.0 * (in_phase * cosine - quadrature * sine);
            motion[2] += 9.0 * third;
        }
        motion
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct FlightFromRest {
    k: f32,
    track: TrackMotion,
    /// Landing phase in rad.
    phase: f32,
    /// Speed of arrival over b w.
    arrival: f32,
}

impl FlightFromRest {
    /// The flight at k, by bisection and Newton's method; arrival 0 if no acceleration reaches k.
    fn evaluate(k: f32, track: TrackMotion) -> Self {
        let step = Phase::from_bits(1 << 27);
        // Backwards from the maximum of A to its rise through k.
        let (mut crest, mut highest, mut phase) = (Phase::ZERO, 0.0, Phase::ZERO);
        for _ in 0..32 {
            let [_, _, a] = track.evaluate(phase);
            if a > highest {
                (crest, highest) = (phase, a);
            }
            phase += step;
        }
        let none = Self {
            k,
            track,
            ..Self::default()
        };
        if highest <= k {
            return none;
        }
        let mut begin = crest;
        while track.evaluate(begin)[2] > k && (crest - begin).bits() < 1 << 31 {
            begin = begin - step;
        }
        let mut half = Phase::from_bits(1 << 26);
        for _ in 0..16 {
            if track.evaluate(begin + half)[2] <= k {
                begin += half;
            }
            half = Phase::from_bits(half.bits() >> 1);
        }
        let [height, velocity, _] = track.evaluate(begin);
        let relative_motion = |duration: f32| {
            let [s, c, _] =
                track.evaluate(begin + phase_of(duration - TAU * libm::floorf(duration / TAU)));
            let rise = velocity * duration - 0.5 * k * duration * duration - (s - height);
            (rise, velocity - k * duration - c)
        };
        let mut duration = 0.5;
        while duration < 40.0 && relative_motion(duration).0 > 0.0 {
            duration += 0.25;
        }
        for _ in 0..5 {
            let (height, speed) = relative_motion(duration);
            let step = height / speed;
            if !step.is_nan() {
                duration -= step.clamp(-0.25, 0.25);
            }
        }
        let turns = duration / TAU;
        Self {
            phase: radians_of(begin + phase_of(TAU * (turns - libm::floorf(turns)))),
            arrival: -relative_motion(duration).1,
            ..none
        }
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Impact {
    /// Time in steps of 2^-32 cycles.
    time: u64,
    /// Motion of the track at the impact, and at the launch after its contact.
    track: [f32; 3],
    launch: [f32; 3],
    /// Speed of arrival over b w; `None` if the flight is unknown.
    arrival: Option<f32>,
}

impl Impact {
    /// Launch speed over b w below which the part returns at once, while the track still rises.
    fn max_short_launch_speed(&self, k: f32, track: &TrackMotion) -> f32 {
        let [height, velocity, _] = self.track;
        let begin = Phase::from_bits(self.time as u32);
        let mut maximum = -1.0_f32;
        for n in 1..=12_u8 {
            let duration = 0.3 * f32::from(n);
            let [s, _, _] = track.evaluate(begin + phase_of(duration));
            maximum = maximum.max(0.5 * k * duration + (s - height) / duration - velocity);
        }
        maximum
    }
}

/// Normal density (0.4 for 1/sqrt(2 pi)).
fn normal_density(x: f32) -> f32 {
    0.4 * libm::expf(-0.5 * x * x)
}

#[derive(Clone, Copy, Debug, Default)]
pub struct DriveState {
    pub count: u32,
    pub lead: Phase,
    /// Order of the gear (symbol r).
    pub order: u8,
    pub k: f32,
    pub shape: Shape,
    /// Advance of the phase per sample.
    pub step: u32,
    /// Configured or identified restitutions of the lot (symbol R), and their scatter (symbol s).
    pub lot: Option<(Restitution, f32)>,
    pub settled: bool,
    pub contact: ContactTime,
    /// Whether gear is to be detected for READY; only then is the short histogram fitted.
    pub detects_gear: bool,
    pub needs_regime: bool,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct GearEstimator {
    lot: [f32; 2],
    scatter: f32,
    track: TrackMotion,
    flight_from_rest: FlightFromRest,
    last: Option<Impact>,
    /// Successive flights in range, and the cycles of that row not yet counted.
    flights: u16,
    pending_cycles: f32,
    /// Drive cycles in gear, and all, with a memory of [`GEAR_WINDOW`].
    in_gear: f32,
    window_cycles: f32,
    /// Drive cycles, those in gear, and losses, with a memory of [`LOSS_MEMORY_CYCLES`].
    memory_cycles: f32,
    cycles: f32,
    losses: f32,
    /// Sums over impacts in gear of 1, R and R^2, with a memory of [`RESTITUTION_MEMORY_IMPACTS`].
    impacts: f32,
    sum: f32,
    squares: f32,
    /// Sums over impacts in gear of 1 and A, with a memory of [`TRACE_MEMORY_IMPACTS`].
    trace_weight: f32,
    accelerations: f32,
    /// Sums over successive impacts of 1 and of the squared difference of R; and the last R.
    pairs: f32,
    differences: f32,
    last_restitution: Option<f32>,
    /// Sums of stamped strength, arrival speed over b w, and its square.
    strength: f32,
    arrivals: f32,
    arrival_squares: f32,
    /// Energy less noise of each quarter of the turn while in gear, and its number of cycles.
    energies: [[f32; 2]; QUARTERS],
    k: f32,
    /// Configured duration of an impact in rad, and its gain of launch speed over acceleration.
    contact: f32,
    contact_gain: f32,
}

impl GearEstimator {
    /// Estimator for a configured lot. The contact's gain is that of the lot's middle.
    pub fn new(lot: [f32; 2], scatter: f32, contact: ContactTime) -> Self {
        let middle = f64::from(0.5 * (lot[0] + lot[1]));
        Self {
            lot,
            scatter,
            contact: contact.radians() as f32,
            contact_gain: contact.gain(middle) as f32,
            ..Self::default()
        }
    }

    /// Clears all estimates; keeps the lot and the motion of the track.
    pub fn reset(&mut self) {
        *self = Self {
            lot: self.lot,
            scatter: self.scatter,
            track: self.track,
            flight_from_rest: self.flight_from_rest,
            contact: self.contact,
            contact_gain: self.contact_gain,
            ..Self::default()
        };
    }

    pub fn cycle(&mut self, cycle: &Cycle, drive_state: &DriveState) {
        let forgetting_factor = 1.0 - 1.0 / GEAR_WINDOW;
        self.in_gear *= forgetting_factor;
        self.window_cycles = self.window_cycles * forgetting_factor + 1.0;
        self.memory_cycles = self.memory_cycles * (1.0 - 1.0 / LOSS_MEMORY_CYCLES) + 1.0;
        self.cycles *= 1.0 - 1.0 / LOSS_MEMORY_CYCLES;
        self.losses *= 1.0 - 1.0 / LOSS_MEMORY_CYCLES;
        self.k = drive_state.k;
        self.update_motion(drive_state);
        let order = u64::from(drive_state.order.max(1));
        let now = u64::from(drive_state.count) << 32;
        for detected in &cycle.impacts {
            let time = impact_time(drive_state.count, detected.phase, drive_state.lead);
            self.add_impact(detected, cycle.noise, time, order);
        }
        if usize::from(self.flights) >= usize::from(MIN_FLIGHTS_IN_GEAR) + QUARTERS {
            let quarter = usize::from(cycle.sectors.first) / SECTORS_PER_CYCLE;
            let noise = cycle.noise * cycle.noise * f32::from(cycle.samples);
            if let Some([sum, cycles]) = self.energies.get_mut(quarter) {
                *sum += cycle.sectors.energy.iter().sum::<f32>() - noise;
                *cycles += QUARTERS as f32;
            }
        }
        if let Some(last) = self.last
            && now.saturating_sub(last.time) > 2 * FLIGHT_BOUNDS[1] * order
        {
            self.end_gear();
            self.last = None;
        }
    }

    /// Filters the shape of the track's motion, and recomputes the flight from rest after a change.
    fn update_motion(&mut self, drive_state: &DriveState) {
        if drive_state.shape.is_sine() {
            self.track = TrackMotion::default();
        } else {
            let now = drive_state.shape.cartesian_tones();
            for (tone, now) in self.track.tones.iter_mut().zip(now) {
                for (part, now) in tone.iter_mut().zip(now) {
                    *part += (now - *part) * 0.1;
                }
            }
        }
        let present = self.track.tones.as_flattened();
        let previous = self.flight_from_rest.track.tones.as_flattened();
        let differs = |a: f32, b: f32| (a - b > FLIGHT_TOLERANCE) | (b - a > FLIGHT_TOLERANCE);
        let k_differs = differs(drive_state.k / self.flight_from_rest.k.max(1e-6), 1.0);
        let mut tones = present.iter().zip(previous);
        if k_differs || tones.any(|(present, previous)| differs(*present, *previous)) {
            self.flight_from_rest = FlightFromRest::evaluate(drive_state.k, self.track);
        }
    }

    fn add_impact(&mut self, detected: &DetectedImpact, noise: f32, time: u64, order: u64) {
        let k = self.k;
        let phase = Phase::from_bits(time as u32);
        let track = self.track.evaluate(phase);
        let mut impact = Impact {
            time,
            track,
            launch: if self.contact == 0.0 {
                track
            } else {
                self.track.evaluate(phase + phase_of(self.contact))
            },
            arrival: None,
        };
        let last = self.last.filter(|last| time > last.time);
        self.last = Some(impact);
        let Some(last) = last else {
            return;
        };
        let flight = time - last.time;
        if !(FLIGHT_BOUNDS[0] * order..=FLIGHT_BOUNDS[1] * order).contains(&flight) {
            self.end_gear();
            return;
        }
        let turns = flight as f32 * (1.0 / Phase::TURN as f32);
        let duration = turns * TAU - self.contact;
        // u(d) = (C + psi) d - k d^2/2 - (S' - S) = 0; arrival: -u'(d) = k d + C' - C - psi.
        let rise = 0.5 * k * duration + (impact.track[0] - last.launch[0]) / duration;
        // Launch speed without the contribution of the contact (docs/theory-real-parts.md#t10.6).
        let speed = rise - last.launch[1] + self.contact_gain * (k - last.launch[2]);
        let restitution = last.arrival.map(|arrival| speed / arrival);
        impact.arrival = Some(k * duration + impact.track[1] - rise);
        let missed = self.detect_missed_flight(&last, &impact, restitution, duration, noise);
        impact.arrival = missed.unwrap_or(impact.arrival);
        self.last = Some(impact);
        if missed.is_some() {
            self.end_gear();
            return;
        }
        self.flights = self.flights.saturating_add(1);
        self.pending_cycles += turns;
        if self.flights >= MIN_FLIGHTS_IN_GEAR {
            self.in_gear += self.pending_cycles;
            self.cycles += self.pending_cycles;
            self.pending_cycles = 0.0;
            // Flights before gear may belong to another kind of hopping.
            if let (Some(restitution), Some(arrival)) = (restitution, impact.arrival) {
                self.add_restitution([restitution, last.launch[2], detected.strength, arrival]);
            }
        }
    }

    /// Likelihood-ratio test of one flight (`None`) against a throw from rest, or bounces.
    fn detect_missed_flight(
        &self,
        last: &Impact,
        impact: &Impact,
        restitution: Option<f32>,
        duration: f32,
        noise: f32,
    ) -> Option<Option<f32>> {
        let phase = radians_of(Phase::from_bits(impact.time as u32));
        let difference = phase - self.flight_from_rest.phase;
        let landing_density = normal_density(difference / LANDING_DEVIATION) / LANDING_DEVIATION;
        let arrival = (difference > -4.0 * LANDING_DEVIATION
            && difference < 4.0 * LANDING_DEVIATION)
            .then_some(self.flight_from_rest.arrival);
        let (Some(restitution), Some(speed)) = (restitution, last.arrival) else {
            return (LANDING_WEIGHT_AFTER_UNKNOWN * landing_density > 1.0).then_some(arrival);
        };
        let configured = self.scatter;
        let estimated = self.estimate_scatter().min(MAX_SCATTER_RATIO * configured);
        let scatter = MIN_SCATTER.max(configured).max(estimated);
        let [low, high] = self.lot;
        let distance = (restitution - high).max(low - restitution).max(0.0) / scatter;
        if distance > MAX_LOT_DISTANCE || !(-MIN_SCATTER..1.0 + MIN_SCATTER).contains(&restitution)
        {
            return Some(arrival);
        }
        // Density of the phase for a flight: dR/dt is arrival speed after over before, over d.
        let flight_density = normal_density(distance) / (0.4 * (high - low) + scatter) / duration;
        let bounce_density = normal_density((difference - BOUNCED_LANDING[0]) / BOUNCED_LANDING[1])
            / BOUNCED_LANDING[1];
        // Upper bound of the alternative: every bounce is too slow for detection.
        if BOUNCED_WEIGHT * (bounce_density + landing_density) <= flight_density {
            return None;
        }
        // Undetected bounces need a restitution below that of a long flight.
        let launch_speed = last.max_short_launch_speed(self.k, &self.track);
        let min_restitution = launch_speed.min(self.min_detected_speed(noise)) / speed;
        if min_restitution <= 0.0 {
            return None;
        }
        let width = 0.29 * (high - low) + scatter;
        // Logistic approximation of the normal distribution function, within 0.01.
        let bounce_probability =
            1.0 / (1.0 + libm::expf(-1.7 * (min_restitution - 0.5 * (low + high)) / width));
        (BOUNCED_WEIGHT * bounce_probability * (bounce_density + landing_density) > flight_density)
            .then_some(arrival)
    }

    fn add_restitution(&mut self, [restitution, acceleration, strength, arrival]: [f32; 4]) {
        let forgetting_factor = 1.0 - 1.0 / RESTITUTION_MEMORY_IMPACTS;
        if let Some(last_value) = self.last_restitution {
            let difference = restitution - last_value;
            self.pairs = self.pairs * forgetting_factor + 1.0;
            self.differences = self.differences * forgetting_factor + difference * difference;
        }
        self.last_restitution = Some(restitution);
        for (sum, new) in [
            (&mut self.impacts, 1.0),
            (&mut self.sum, restitution),
            (&mut self.squares, restitution * restitution),
            (&mut self.strength, strength),
            (&mut self.arrivals, arrival),
            (&mut self.arrival_squares, arrival * arrival),
        ] {
            *sum = *sum * forgetting_factor + new;
        }
        let forgetting_factor = 1.0 - 1.0 / TRACE_MEMORY_IMPACTS;
        self.trace_weight = self.trace_weight * forgetting_factor + 1.0;
        self.accelerations = self.accelerations * forgetting_factor + acceleration;
    }

    /// Landing speed over b w of a part thrown from rest; 0 if the track throws none.
    pub fn landing_speed_from_rest(&self) -> f32 {
        self.flight_from_rest.arrival
    }

    /// Phase of that landing in rad; `None` if the track throws none.
    pub fn landing_phase_from_rest(&self) -> Option<f32> {
        (self.flight_from_rest.arrival > 0.0).then_some(self.flight_from_rest.phase)
    }

    /// Whether a lock may strike at a phase of the track (rad): the track must rise and decelerate
    /// (docs/theory-bands.md#t5.1). The tolerance for late stamps is [`STAMP_ERROR`].
    pub fn may_lock_at(&self, phase: f32) -> bool {
        self.may_lock_beyond(phase, 1.0)
    }

    /// Whether a part may stay in gear at a phase of the track (rad): also one scatter below the
    /// lot's middle there must be a lock, of velocity proportional to `(1 - R)/(1 + R)`.
    pub fn may_stay_in_gear_at(&self, phase: f32) -> bool {
        let middle = 0.5 * (self.lot[0] + self.lot[1]);
        self.may_lock_beyond(phase, 1.0 + 2.0 * self.scatter / (1.0 - middle * middle))
    }

    /// Whether a sine through the motion at a phase (rad) reaches a lock's velocity times `factor`.
    fn may_lock_beyond(&self, phase: f32, factor: f32) -> bool {
        [-STAMP_ERROR, STAMP_ERROR].iter().any(|stamp_error| {
            let [_, velocity, acceleration] = self.track.evaluate(phase_of(phase + stamp_error));
            let needed = (factor * factor - 1.0) * velocity * velocity;
            velocity > 0.0 && acceleration > 0.0 && acceleration * acceleration > needed
        })
    }

    /// Speed over b w below which an impact is not detected.
    fn min_detected_speed(&self, noise: f32) -> f32 {
        if self.impacts < MIN_IMPACTS {
            return INITIAL_MIN_IMPACT_SPEED;
        }
        MIN_IMPACT_TO_NOISE * noise * self.arrivals / self.strength
    }

    /// Energy per cycle in gear over the mean squared arrival speed over b w, in (m/s^2)^2.
    pub fn energy_per_squared_speed(&self) -> Option<f32> {
        let mut energy = 0.0;
        for [sum, cycles] in self.energies {
            if cycles == 0.0 {
                return None;
            }
            energy += sum / cycles;
        }
        let square = self.arrival_squares / self.impacts;
        (self.impacts >= MIN_IMPACTS && square > 0.0).then(|| energy / square)
    }

    fn end_gear(&mut self) {
        if self.flights >= MIN_FLIGHTS_IN_GEAR {
            self.losses += 1.0;
        }
        self.flights = 0;
        self.pending_cycles = 0.0;
        self.last_restitution = None;
    }

    /// Share of time in gear, 0..=1, with a memory of [`GEAR_WINDOW`] cycles.
    pub fn share(&self) -> f32 {
        share_of(self.in_gear, self.window_cycles).min(1.0)
    }

    /// Share of time in gear, 0..=1, with a memory of [`LOSS_MEMORY_CYCLES`] cycles.
    pub fn long_share(&self) -> f32 {
        self.cycles / self.memory_cycles.max(1.0)
    }

    /// Mean drive cycles in gear per loss; infinite without a loss.
    pub fn time_to_loss(&self) -> f32 {
        if self.losses > 0.5 {
            self.cycles / self.losses
        } else {
            f32::INFINITY
        }
    }

    /// Scatter of the implied restitutions; 0 below [`MIN_IMPACTS`] impacts.
    fn estimate_scatter(&self) -> f32 {
        if self.impacts < MIN_IMPACTS {
            return 0.0;
        }
        let mean = self.sum / self.impacts;
        square_root_single((self.squares / self.impacts - mean * mean).max(0.0))
    }

    /// Margin of one part to the loss of gear; `None` with too few impacts, and for several parts.
    pub fn margin(&self) -> Option<GearMargin> {
        if self.impacts < MIN_IMPACTS {
            return None;
        }
        let mean = self.sum / self.impacts;
        let scatter = self.estimate_scatter();
        let variance = scatter * scatter;
        // Restitutions of one part are uncorrelated; those assigned across several parts are not.
        let serial_covariance = variance - 0.5 * self.differences / self.pairs.max(1.0);
        let maximum = MAX_SERIAL_CORRELATION * variance / square_root_single(self.pairs.max(1.0));
        if scatter > MIN_SCATTER && (serial_covariance > maximum || -serial_covariance > maximum) {
            return None;
        }
        let restitution_factor = (1.0 + mean) * (1.0 + mean);
        let trace = 1.0 + mean * mean
            - restitution_factor * self.accelerations / (self.trace_weight * self.k);
        Some(GearMargin {
            trace,
            restitution: mean,
            error: scatter / square_root_single(self.impacts),
            scatter,
            flip: 1.0 + mean * mean + trace,
            to_loss: self.cycles / (self.losses + 1.0),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::with;
    use kband::impact::{Kernel, Tone, WaveKernel, WaveMap};
    use kband::regime::Lock;

    #[test]
    fn flight_from_rest_is_that_of_the_map() {
        for tones in [
            [0.0_f32; 4],
            [0.15, 2.356, 0.0, 0.0],
            [0.1, 2.356, 0.02, 0.7],
        ] {
            let [e2, th2, e3, th3] = tones.map(f64::from);
            let shape = Shape::from_tones([[tones[0], tones[1]], [tones[2], tones[3]]]);
            let tones = shape.cartesian_tones();
            let track = TrackMotion { tones };
            for k in [0.6, 0.75, 0.95] {
                let flight = FlightFromRest::evaluate(k as f32, track);
                let upper = [Tone::new(e2, th2), Tone::new(e3, th3)];
                let map = WaveMap::on_tones(upper, k, 1.0).unwrap();
                let (_, phase) = map.throw(1.5 * core::f64::consts::PI).unwrap();
                let next = map.impact(WaveMap::state(phase, 0.0).unwrap()).next;
                let phase_error = libm::remainder(f64::from(flight.phase) - next.phase, TAU.into());
                let error = phase_error.abs() + (f64::from(flight.arrival) - next.velocity).abs();
                assert!(error < 1e-4, "{k}: {flight:?} {next:?}");
            }
        }
    }

    /// A locked part, whose impacts have an energy of 3 in gear, and of 3000 before.
    #[test]
    fn energy_is_that_of_the_cycles_in_gear_over_the_squared_speed() {
        let (k, restitution) = (0.43, 0.2);
        let lock = Lock::build(k, restitution, 1).unwrap().unwrap().state();
        let mut estimator = GearEstimator::new([0.19, 0.21], 0.05, ContactTime::INSTANT);
        for count in 0..1000 {
            let is_in_gear = estimator.flights > MIN_FLIGHTS_IN_GEAR;
            let energy = if is_in_gear { 3.0 } else { 3000.0 };
            let mut cycle = Cycle::default();
            cycle.impacts.extend([DetectedImpact {
                phase: Phase::from_radians(lock.phase),
                strength: 4.0,
            }]);
            cycle.sectors.first = (count as usize % QUARTERS * SECTORS_PER_CYCLE) as u8;
            cycle.sectors.energy = [energy / SECTORS_PER_CYCLE as f32; SECTORS_PER_CYCLE];
            let changed = |it: &mut DriveState| (it.count, it.order, it.k) = (count, 1, k as f32);
            estimator.cycle(&cycle, &with(DriveState::default(), changed));
        }
        let arrival = lock.velocity / restitution;
        let energy = f64::from(estimator.energy_per_squared_speed().unwrap());
        assert!((energy * arrival * arrival / 3.0 - 1.0).abs() < 1e-2);
    }
}
