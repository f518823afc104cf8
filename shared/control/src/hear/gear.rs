//! Estimates the time in gear, the restitution and its scatter from the phases of single impacts.
//!
//! Gear means one flight in every r drive periods. Three impacts in a row give one restitution in
//! closed form: launch speed of the second flight over arrival speed of the first
//! (docs/theory-real-parts.md#t10.7).
//!
//! A part that chatters, rests and is thrown anew strikes as regularly as one in gear. A likelihood
//! ratio separates the two by landing phase and implied restitution. Averages forget exponentially.
//! Successive restitutions of one part are uncorrelated, which the mean square successive
//! difference tests (von Neumann 1941).

use core::f32::consts::TAU;

use super::energy::{SECTORS, SECTORS_HANDED};
use super::margin::GearMargin;
use super::onset::DetectedImpact;
use super::signal::Cycle;
use crate::angle::{phase_of, radians_of};
use crate::drive::{Shape, UPPER};
use kband::arithmetic::{Phase, sine_cosine_single, square_root_single};
use kband::feeder::Restitution;
use kband::impact::ContactTime;
use kband::regime::gear;

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
/// Number of drive cycles that hand over the sectors of a whole turn.
const QUARTERS: usize = SECTORS / SECTORS_HANDED;
/// Number of successive flights that define gear.
const MIN_FLIGHTS_IN_GEAR: u16 = 8;
/// Minimum scatter of an implied restitution (stamps, amplitude); also its slack beyond 0 and 1.
const MIN_SCATTER: f32 = 0.03;
/// Largest ratio of estimated to configured scatter that is used: 1 plus the 16 % of
/// [`MIN_IMPACTS`].
const MAX_SCATTER_RATIO: f32 = 1.2;
/// Distance of an implied restitution from the lot, in standard deviations, that rejects it.
const MAX_LOT_DISTANCE: f32 = 4.0;
/// Standard deviation of a landing phase from rest, in rad: one sample at 50 Hz.
const LANDING_DEVIATION: f32 = 0.015;
/// Mean delay and deviation, in rad, of a landing after undetected bounces, against one from rest.
const BOUNCED_LANDING: [f32; 2] = [0.1, 0.14];
/// Weight of such landings in the likelihood ratio: measured, R of 0.1 to 0.6, s of 0.03 to 0.10.
const BOUNCED_WEIGHT: f32 = 0.35;
/// Weight of a landing from rest after an unknown flight, in rad: accepts within 2.0 deviations, by
/// `sqrt(2 ln(0.4 0.3/LANDING))`.
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

/// Motion of the track over its first tone's amplitude: displacement S, velocity C, negative
/// acceleration A.
#[derive(Clone, Copy, Debug, Default)]
struct Track {
    /// `e cos th` and `e sin th` of each tone above the first.
    tones: [[f32; 2]; UPPER],
}

impl Track {
    fn of(shape: &Shape) -> Self {
        Self {
            tones: shape.mixed(),
        }
    }

    fn at(&self, phase: Phase) -> [f32; 3] {
        let (sine, cosine) = sine_cosine_single(phase);
        let [[straight, across], third] = self.tones;
        if self.tones == [[0.0; 2]; UPPER] {
            return [sine, cosine, sine];
        }
        let (sine2, cosine2) = (2.0 * sine * cosine, 1.0 - 2.0 * sine * sine);
        let second = straight * sine2 + across * cosine2;
        let mut motion = [
            sine + second,
            cosine + 2.0 * (straight * cosine2 - across * sine2),
            sine + 4.0 * second,
        ];
        if third != [0.0; 2] {
            let [straight, across] = third;
            let twice = 2.0 * cosine;
            let (sine, cosine) = (twice * sine2 - sine, twice * cosine2 - cosine);
            let third = straight * sine + across * cosine;
            motion[0] += third;
            motion[1] += 3.0 * (straight * cosine - across * sine);
            motion[2] += 9.0 * third;
        }
        motion
    }
}

/// Flight of a part thrown from rest.
#[derive(Clone, Copy, Debug, Default)]
struct FlightFromRest {
    k: f32,
    track: Track,
    /// Landing phase in rad.
    phase: f32,
    /// Speed of arrival over b w.
    arrival: f32,
}

impl FlightFromRest {
    /// Computes the flight at k; arrival 0 where the acceleration never reaches k. Lift-off by
    /// bisection, landing by Newton's method with bounded steps.
    fn at(k: f32, track: Track) -> Self {
        let step = Phase::from_bits(1 << 27);
        // Backwards from the maximum of A to its rise through k.
        let (mut crest, mut highest, mut phase) = (Phase::ZERO, 0.0, Phase::ZERO);
        for _ in 0..32 {
            let [_, _, a] = track.at(phase);
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
        while track.at(begin)[2] > k && (crest - begin).bits() < 1 << 31 {
            begin = begin - step;
        }
        let mut half = Phase::from_bits(1 << 26);
        for _ in 0..16 {
            if track.at(begin + half)[2] <= k {
                begin += half;
            }
            half = Phase::from_bits(half.bits() >> 1);
        }
        let [risen, velocity, _] = track.at(begin);
        let above = |duration: f32| {
            let [s, c, _] =
                track.at(begin + phase_of(duration - TAU * libm::floorf(duration / TAU)));
            let rise = velocity * duration - 0.5 * k * duration * duration - (s - risen);
            (rise, velocity - k * duration - c)
        };
        let mut duration = 0.5;
        while duration < 40.0 && above(duration).0 > 0.0 {
            duration += 0.25;
        }
        for _ in 0..5 {
            let (height, speed) = above(duration);
            let step = height / speed;
            if !step.is_nan() {
                duration -= step.clamp(-0.25, 0.25);
            }
        }
        let turns = duration / TAU;
        Self {
            phase: radians_of(begin + phase_of(TAU * (turns - libm::floorf(turns)))),
            arrival: -above(duration).1,
            ..none
        }
    }
}

/// An impact, and the flight before it.
#[derive(Clone, Copy, Debug, Default)]
struct Struck {
    /// Time in steps of 2^-32 cycles.
    time: u64,
    /// Motion of the track at the impact, and at the launch after its contact.
    track: [f32; 3],
    launch: [f32; 3],
    /// Speed of arrival over b w; `None` where the flight is unknown.
    arrival: Option<f32>,
}

impl Struck {
    fn phase(&self) -> f32 {
        radians_of(Phase::from_bits(self.time as u32))
    }

    /// Launch speed over b w below which the part returns at once, while the track still rises.
    fn max_short_launch_speed(&self, k: f32, track: &Track) -> f32 {
        let [risen, velocity, _] = self.track;
        let begin = Phase::from_bits(self.time as u32);
        let mut most = -1.0_f32;
        for n in 1..=12_u8 {
            let duration = 0.3 * f32::from(n);
            let [s, _, _] = track.at(begin + phase_of(duration));
            most = most.max(0.5 * k * duration + (s - risen) / duration - velocity);
        }
        most
    }
}

/// Normal density (0.4 for 1/sqrt(2 pi)).
fn gauss(x: f32) -> f32 {
    0.4 * libm::expf(-0.5 * x * x)
}

/// State of drive and settings in one cycle, as the estimators need it.
#[derive(Clone, Copy, Debug)]
pub struct DriveState {
    pub count: u32,
    /// Phase lead of the track.
    pub lead: Phase,
    /// Order of the gear (symbol r).
    pub order: u8,
    /// Measured k.
    pub k: f32,
    /// Measured shape of the track's motion.
    pub shape: Shape,
    /// Advance of the phase per sample.
    pub step: u32,
    /// Configured or identified restitutions of the lot (symbol R), and their scatter from impact
    /// to impact (symbol s).
    pub lot: Option<(Restitution, f32)>,
    /// Whether the amplitude has settled at its setpoint.
    pub stands: bool,
    /// Configured duration of an impact.
    pub contact: ContactTime,
    /// Whether gear is to be detected for READY; only then is the short histogram fitted.
    pub detects_gear: bool,
    /// Whether a decision needs the regime.
    pub needs_regime: bool,
}

/// Estimator of gear from single impacts.
#[derive(Clone, Copy, Debug, Default)]
pub struct GearEstimator {
    /// Configured restitutions of the lot, and their scatter.
    lot: [f32; 2],
    scatter: f32,
    track: Track,
    thrown: FlightFromRest,
    last: Option<Struck>,
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
    /// Estimator for a configured lot.
    pub fn new(low: f32, high: f32, scatter: f32) -> Self {
        Self {
            lot: [low, high],
            scatter,
            ..Self::default()
        }
    }

    /// The same with impacts of this duration; its gain is that of the lot's middle.
    pub fn with_contact(self, contact: ContactTime) -> Self {
        let [low, high] = self.lot;
        let middle = f64::from(0.5 * (low + high));
        Self {
            contact: contact.radians() as f32,
            contact_gain: contact.gain(middle) as f32,
            ..self
        }
    }

    /// Clears all estimates; keeps the lot and the motion of the track.
    pub fn reset(&mut self) {
        *self = Self {
            track: self.track,
            thrown: self.thrown,
            contact: self.contact,
            contact_gain: self.contact_gain,
            ..Self::new(self.lot[0], self.lot[1], self.scatter)
        };
    }

    /// Updates the estimates with the impacts of one drive cycle.
    pub fn cycle(&mut self, cycle: &Cycle, with: &DriveState) {
        let keep = 1.0 - 1.0 / GEAR_WINDOW;
        self.in_gear *= keep;
        self.window_cycles = self.window_cycles * keep + 1.0;
        self.memory_cycles = self.memory_cycles * (1.0 - 1.0 / LOSS_MEMORY_CYCLES) + 1.0;
        self.cycles *= 1.0 - 1.0 / LOSS_MEMORY_CYCLES;
        self.losses *= 1.0 - 1.0 / LOSS_MEMORY_CYCLES;
        self.k = with.k;
        self.update_motion(with);
        let order = u64::from(with.order.max(1));
        let now = u64::from(with.count) << 32;
        for heard in &cycle.heard {
            let time = (now | u64::from(heard.phase.bits()))
                .wrapping_add_signed(i64::from(with.lead.bits() as i32));
            self.add_impact(heard, cycle.noise, time, order);
        }
        if usize::from(self.flights) >= usize::from(MIN_FLIGHTS_IN_GEAR) + QUARTERS {
            let quarter = usize::from(cycle.sectors.first) / SECTORS_HANDED;
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
    fn update_motion(&mut self, with: &DriveState) {
        if with.shape.is_sine() {
            self.track = Track::default();
        } else {
            let now = Track::of(&with.shape);
            for (tone, now) in self.track.tones.iter_mut().zip(now.tones) {
                for (part, now) in tone.iter_mut().zip(now) {
                    *part += (now - *part) * 0.1;
                }
            }
        }
        let is = self.track.tones.as_flattened();
        let was = self.thrown.track.tones.as_flattened();
        let apart = |a: f32, b: f32| (a - b > FLIGHT_TOLERANCE) | (b - a > FLIGHT_TOLERANCE);
        if apart(with.k / self.thrown.k.max(1e-6), 1.0)
            || is.iter().zip(was).any(|(is, was)| apart(*is, *was))
        {
            self.thrown = FlightFromRest::at(with.k, self.track);
        }
    }

    fn add_impact(&mut self, heard: &DetectedImpact, noise: f32, time: u64, order: u64) {
        let k = self.k;
        let phase = Phase::from_bits(time as u32);
        let track = self.track.at(phase);
        let mut struck = Struck {
            time,
            track,
            launch: if self.contact == 0.0 {
                track
            } else {
                self.track.at(phase + phase_of(self.contact))
            },
            arrival: None,
        };
        let last = self.last.filter(|last| time > last.time);
        self.last = Some(struck);
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
        // Flight equation: u(d) = (C + psi) d - k d^2/2 - [S' - S] = 0. Arrival speed: -u'(d) = k d
        // + C' - C - psi.
        let rise = 0.5 * k * duration + (struck.track[0] - last.launch[0]) / duration;
        // Launch speed without what the contact added (docs/theory-real-parts.md#t10.6).
        let speed = rise - last.launch[1] + self.contact_gain * (k - last.launch[2]);
        let restitution = last.arrival.map(|arrival| speed / arrival);
        struck.arrival = Some(k * duration + struck.track[1] - rise);
        if let Some(arrival) =
            self.detect_missed_flight(&last, &struck, restitution, duration, noise)
        {
            struck.arrival = arrival;
            self.last = Some(struck);
            self.end_gear();
            return;
        }
        self.last = Some(struck);
        self.flights = self.flights.saturating_add(1);
        self.pending_cycles += turns;
        if self.flights >= MIN_FLIGHTS_IN_GEAR {
            self.in_gear += self.pending_cycles;
            self.cycles += self.pending_cycles;
            self.pending_cycles = 0.0;
        }
        // Flights before gear may belong to another kind of hopping.
        if let (Some(restitution), Some(arrival), true) = (
            restitution,
            struck.arrival,
            self.flights >= MIN_FLIGHTS_IN_GEAR,
        ) {
            self.add_restitution(restitution, last.launch[2], heard.strength, arrival);
        }
    }

    /// Decides by a likelihood ratio whether the gap since the last impact was no single flight.
    /// `None`: it was. Else the part was thrown from rest (with this arrival), or bounced.
    fn detect_missed_flight(
        &self,
        last: &Struck,
        struck: &Struck,
        restitution: Option<f32>,
        duration: f32,
        noise: f32,
    ) -> Option<Option<f32>> {
        let apart = struck.phase() - self.thrown.phase;
        let landed = gauss(apart / LANDING_DEVIATION) / LANDING_DEVIATION;
        let arrival = (apart > -4.0 * LANDING_DEVIATION && apart < 4.0 * LANDING_DEVIATION)
            .then_some(self.thrown.arrival);
        let (Some(restitution), Some(speed)) = (restitution, last.arrival) else {
            return (LANDING_WEIGHT_AFTER_UNKNOWN * landed > 1.0).then_some(arrival);
        };
        let told = self.scatter;
        let heard = self.estimate_scatter().min(MAX_SCATTER_RATIO * told);
        let scatter = MIN_SCATTER.max(told).max(heard);
        let [low, high] = self.lot;
        let out = (restitution - high).max(low - restitution).max(0.0) / scatter;
        if out > MAX_LOT_DISTANCE || !(-MIN_SCATTER..1.0 + MIN_SCATTER).contains(&restitution) {
            return Some(arrival);
        }
        // Probability density of the phase for a flight: dR/dt is arrival speed after over before,
        // over d.
        let flown = gauss(out) / (0.4 * (high - low) + scatter) / duration;
        let bounced = gauss((apart - BOUNCED_LANDING[0]) / BOUNCED_LANDING[1]) / BOUNCED_LANDING[1];
        // Upper bound of the alternative: every bounce is too slow for detection.
        if BOUNCED_WEIGHT * (bounced + landed) <= flown {
            return None;
        }
        // Undetected bounces need a restitution below that of a long flight.
        let least = last
            .max_short_launch_speed(self.k, &self.track)
            .min(self.min_detected_speed(noise))
            / speed;
        if least <= 0.0 {
            return None;
        }
        let width = 0.29 * (high - low) + scatter;
        // Logistic approximation of the normal distribution function, within 0.01.
        let short = 1.0 / (1.0 + libm::expf(-1.7 * (least - 0.5 * (low + high)) / width));
        (BOUNCED_WEIGHT * short * (bounced + landed) > flown).then_some(arrival)
    }

    fn add_restitution(&mut self, restitution: f32, bend: f32, strength: f32, arrival: f32) {
        let keep = 1.0 - 1.0 / RESTITUTION_MEMORY_IMPACTS;
        if let Some(before) = self.last_restitution {
            let apart = restitution - before;
            self.pairs = self.pairs * keep + 1.0;
            self.differences = self.differences * keep + apart * apart;
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
            *sum = *sum * keep + new;
        }
        let keep = 1.0 - 1.0 / TRACE_MEMORY_IMPACTS;
        self.trace_weight = self.trace_weight * keep + 1.0;
        self.accelerations = self.accelerations * keep + bend;
    }

    /// Landing speed over b w of a part thrown from rest; 0 where the track throws none.
    pub fn landing_speed_from_rest(&self) -> f32 {
        self.thrown.arrival
    }

    /// Phase of that landing in rad; `None` where the track throws none.
    pub fn landing_phase_from_rest(&self) -> Option<f32> {
        (self.thrown.arrival > 0.0).then_some(self.thrown.phase)
    }

    /// Whether a lock may strike at a phase of the track (rad): the track must rise and decelerate
    /// (docs/theory-bands.md#t5.1). The tolerance for late stamps is [`STAMP_ERROR`].
    pub fn may_lock_at(&self, phase: f32) -> bool {
        self.may_lock_beyond(phase, 1.0)
    }

    /// Whether a part may stay in gear at a phase of the track (rad): a restitution one scatter
    /// below the lot's middle must have a lock too, whose velocity goes as `(1 - R)/(1 + R)`.
    pub fn may_stay_in_gear_at(&self, phase: f32) -> bool {
        let middle = 0.5 * (self.lot[0] + self.lot[1]);
        self.may_lock_beyond(phase, 1.0 + 2.0 * self.scatter / (1.0 - middle * middle))
    }

    /// Whether a sine through the track's velocity and acceleration at a phase (rad) reaches a
    /// lock's velocity times `factor`.
    fn may_lock_beyond(&self, phase: f32, factor: f32) -> bool {
        [-STAMP_ERROR, STAMP_ERROR].iter().any(|late| {
            let [_, velocity, bend] = self.track.at(phase_of(phase + late));
            let needed = (factor * factor - 1.0) * velocity * velocity;
            velocity > 0.0 && bend > 0.0 && bend * bend > needed
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
    pub fn loudness(&self) -> Option<f32> {
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
        if self.window_cycles > 0.0 {
            (self.in_gear / self.window_cycles).min(1.0)
        } else {
            0.0
        }
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
        let related = variance - 0.5 * self.differences / self.pairs.max(1.0);
        let most = MAX_SERIAL_CORRELATION * variance / square_root_single(self.pairs.max(1.0));
        if scatter > MIN_SCATTER && (related > most || -related > most) {
            return None;
        }
        let squeezed = (1.0 + mean) * (1.0 + mean);
        let trace =
            1.0 + mean * mean - squeezed * self.accelerations / (self.trace_weight * self.k);
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
