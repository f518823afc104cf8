//! Summary of a single run: motion of the track and the parts, margin to the loss, next step.

use kband::regime::classify::Regime;
use kband_control::{Identification, Limits, Report, State, Target};

use crate::causes::{BestSetpoint, Cause, MIN_SHARE_IN_GEAR, causes, misfit};
use crate::report::{number, numbers, shortest, span};
use crate::simulate::Outcome;

/// Relative difference below which two amplitudes count as equal.
const SAME_AMPLITUDE: f64 = 0.03;
/// Share of the time in the air below which parts are reported to hop and rest.
const MIN_TIME_IN_AIR: f64 = 0.9;

/// Relative margin of the amplitude that is called thin; a warm coil changes more.
const THIN_MARGIN: f64 = 0.01;

pub(super) struct Observed {
    /// Amplitude in mm, and the track's peak acceleration over gravity.
    amplitude: f64,
    peak: f64,
    target: Target,
    last: Report,
    no_setpoint: Option<String>,
    parts: usize,
    resting: usize,
    k: f64,
    order: u32,
    /// Share of time in gear, for parts that scatter.
    in_gear: Option<f64>,
    /// The predicted best setpoint of the lot, if parts do not stay in gear.
    best: Option<BestSetpoint>,
    /// Causes why the lot is out of gear at its best setpoint, the most likely one first.
    pub causes: Vec<Cause>,
    in_air: f64,
    /// Time in gear until its loss, in s.
    loss: Option<f64>,
    locked: bool,
    regime: String,
    /// Conveying speed in mm/s, upwards positive.
    speed: f64,
    /// Length of a part along the track in mm; parts touch each other.
    part_length: f64,
    /// Margin of the lock, relative to the amplitude.
    margin: Option<f64>,
    /// Restitution and scatter, written as options of the verbs.
    lot: String,
    scatter: f32,
    strays: bool,
    /// Proposed duration in s of a run for a target that takes longer.
    longer: f64,
}

impl Observed {
    pub(super) fn from_outcome(outcome: &Outcome) -> Self {
        let last = outcome.last();
        let scene = &outcome.file().scene;
        let settings = &scene.settings;
        let frequency = f64::from(settings.frequency);
        let amplitude = outcome.amplitude();
        let k = outcome.k();
        let (low, high) = (settings.restitution_low, settings.restitution_high);
        let rate = std::f64::consts::TAU * frequency;
        let target = outcome.target();
        let is_gear = matches!(target, Target::Gear { .. });
        let in_gear = outcome.in_gear();
        let in_gear = in_gear.filter(|_| is_gear || outcome.file().scatters());
        let held = last.state == State::Holding && last.fault.is_none();
        let poor = held && in_gear.is_some_and(|share| share < MIN_SHARE_IN_GEAR);
        let (best, causes) = match target {
            Target::Gear { order } if poor => {
                let best = BestSetpoint {
                    share: f64::from(last.expected_in_gear),
                    amplitude: amplitude * 1e3,
                };
                (Some(best), causes(settings, order, best))
            }
            Target::K(_) | Target::Amplitude(_) if poor => {
                (Some(BestSetpoint::from_settings(settings, 1)), vec![])
            }
            _ if last.limits.contains(Limits::MISFIT) => {
                (None, vec![misfit(settings, amplitude * 1e3)])
            }
            _ => (None, vec![]),
        };
        let band = outcome.band().filter(|band| band.contains(k));
        Self {
            amplitude: amplitude * 1e3,
            peak: amplitude * rate * rate * f64::from(last.shape.peaks()[1])
                / kband::feeder::STANDARD_GRAVITY,
            target,
            last,
            no_setpoint: outcome.no_setpoint(),
            parts: scene.parts.len(),
            resting: outcome.resting(),
            k,
            order: outcome.gear_order(),
            in_gear,
            best,
            causes,
            in_air: outcome.in_air(),
            loss: outcome.time_to_loss().map(|cycles| cycles / frequency),
            locked: outcome.is_locked(),
            regime: outcome.regime(),
            speed: outcome.speed() * 1e3,
            part_length: outcome.file().part_length,
            margin: band.map(|band| band.margins(k).smallest()),
            lot: span(shortest(low), shortest(high), 9),
            scatter: settings.scatter,
            strays: !outcome.strays().is_empty(),
            longer: (3.0 * outcome.file().duration).min(86_400.0),
        }
    }

    fn doubled(&self) -> bool {
        let measured = self.last.regime;
        measured.is_some_and(|measured| matches!(measured.regime, Regime::Doubled { .. }))
    }

    /// The lines, the last of them the next step.
    pub(super) fn lines(&self) -> Vec<String> {
        let mut lines = vec![self.track()];
        if self.amplitude > 1e-3 {
            lines.extend(self.parts());
            lines.extend(self.margin());
        }
        lines.push(format!("Next: {}.", self.next()));
        lines
    }

    fn track(&self) -> String {
        if self.amplitude <= 1e-3 {
            return "The track stands still.".into();
        }
        let [amplitude, peak] = [self.amplitude, self.peak].map(|value| number(value, 3));
        format!("The track moves {amplitude} mm to each side, {peak} g at its peak.")
    }

    fn parts(&self) -> Option<String> {
        if self.parts == 0 {
            return Some("There are no parts on it.".into());
        }
        let stroke = match self.order {
            1 => "every stroke".to_string(),
            order => format!("every {order} strokes"),
        };
        let hop = match self.in_gear {
            Some(share) if share < 0.5 => {
                format!("Parts do not hop once {stroke}: they {}", self.motion())
            }
            Some(share) => format!(
                "Parts hop once {stroke} for {} % of the time (in gear)",
                number(100.0 * share, 3)
            ),
            None if self.locked => format!("Parts hop once {stroke}, in lock with the drive"),
            None => {
                let regime = &self.regime;
                format!("Parts do not hop in one rhythm with the drive ({regime})")
            }
        };
        let direction = if self.speed < 0.0 { "DOWN" } else { "up" };
        let rate = 60.0 * self.speed.abs() / self.part_length;
        Some(format!(
            "{hop} and travel {} mm/s {direction} the track: about {} parts a minute of {} mm each.",
            number(self.speed.abs(), 3),
            whole(rate),
            number(self.part_length, 4)
        ))
    }

    fn motion(&self) -> String {
        let air = number(100.0 * self.in_air, 2);
        if self.in_air <= 0.0 {
            "lie at rest".into()
        } else if self.in_air < MIN_TIME_IN_AIR {
            format!("hop and rest in turn, in the air for {air} % of the time,")
        } else if self.doubled() {
            "hop by turns high and low (doubled),".into()
        } else {
            format!("hop irregularly, in the air for {air} % of the time,")
        }
    }

    /// The fault of a configured amplitude, and the one to choose.
    fn misplaced(&self, best: BestSetpoint) -> Option<String> {
        let ratio = self.amplitude / best.amplitude;
        if best.share < 0.5 || (ratio - 1.0).abs() < SAME_AMPLITUDE {
            return None;
        }
        let fault = if ratio < 1.0 { "little" } else { "much" };
        let [present, chosen] = numbers([self.amplitude, best.amplitude], 3);
        let (lot, percent) = (&self.lot, number(100.0 * best.share, 2));
        Some(format!(
            "{present} mm is too {fault} for parts of R {lot}: {chosen} mm keeps them in gear for {percent} % of the time ([target] gear = 1)"
        ))
    }

    fn margin(&self) -> Option<String> {
        if let Some(share) = self.in_gear {
            let lost = number(self.loss?, 2);
            let text = format!(
                "They lose it after {lost} s in the mean, and fall back into it by themselves."
            );
            (share > 0.0).then_some(text)
        } else if self.locked {
            let margin = self.margin?;
            let [percent, mm] = [100.0, self.amplitude].map(|scale| number(scale * margin, 2));
            let margin_line = format!("Margin: {percent} % of the amplitude ({mm} mm)");
            Some(if margin < THIN_MARGIN {
                format!("{margin_line}: thin, not every part of this lot may hold.")
            } else {
                format!("{margin_line} until the first part of the lot loses its lock.")
            })
        } else {
            None
        }
    }

    /// The next step, for every state, limit and result.
    fn next(&self) -> String {
        if let Some(fault) = self.last.fault {
            let (name, number) = (fault.name(), fault.number());
            return format!("remove the cause of '{name}': kband explain fault {number}");
        }
        let mut limits = Limits::ALL.into_iter();
        if let Some(limit) = limits.find(|limit| self.last.limits.contains(*limit)) {
            let why = self.no_setpoint.as_ref();
            let why = why.map_or(String::new(), |why| format!(": {why}"));
            let (name, number) = (limit.name(), limit.number());
            return format!("{name} (limit {number}){why}; kband explain limit {number}");
        }
        let longer = number(self.longer, 4);
        match self.last.identification {
            _ if self.target != Target::Identify => {}
            Identification::Idle => {}
            Identification::Listening { hops } => {
                return format!(
                    "no restitution is identified yet ({hops} hops detected): run longer, with --duration {longer}"
                );
            }
            Identification::Found(identified) => {
                let r = number(identified.restitution, 3);
                return format!(
                    "the parts rebound with R = {r}: set part.restitution to an interval about it, and [target] gear = 1"
                );
            }
            Identification::NotFound(_) => {
                return "no restitution was identified: see which parts and sensor it needs in the manual's commissioning".into();
            }
        }
        let bands = format!("kband bands --restitution {}", self.lot);
        match self.last.state {
            State::Holding | State::Locked | State::Capturing | State::Lost if self.strays => {
                "some parts are outside the configured lot: widen part.restitution to all of them. \
                 Kick and amplitude are chosen for the configured lot only"
                    .into()
            }
            State::Locked if self.resting > 0 => {
                let (locked, all) = (self.parts - self.resting, self.parts);
                let remedy = if self.k >= 1.0 {
                    format!("above k = 1 the track throws no resting part. Set [target] k = 0.9, if the band holds it: {bands}")
                } else {
                    "[target] gear = 1 throws them".into()
                };
                format!("the lock is of {locked} of the {all} parts, the others lie at rest: {remedy}")
            }
            State::Locked if self.doubled() => {
                format!("the flights have doubled, as of parts livelier than the lot: {bands}")
            }
            State::Off => "the enable input starts the drive: kband explain off".into(),
            State::Starting => format!("the setpoint is not reached yet: --duration {longer} gives it time"),
            State::Capturing => format!("the parts are not in lock yet: --duration {longer} gives it time"),
            State::Stopping => "the drive comes to rest: kband explain stopping".into(),
            State::Lost => "the lock is lost; parts that scatter stay in gear where they do not stay locked: [target] gear = 1".into(),
            State::Fault | State::Limiting => format!("kband explain {}", self.last.state.name()),
            State::Locked if self.margin.is_some_and(|margin| margin < THIN_MARGIN) => {
                format!("a lot of less width has more margin: {bands}")
            }
            State::Locked => "the lock holds; kband explain margin describes its margin".into(),
            State::Holding => self.held(),
        }
    }

    fn held(&self) -> String {
        let (lot, scatter) = (&self.lot, self.scatter);
        let gear = format!("kband gear --restitution {lot} --scatter {scatter}");
        match (self.target, self.in_gear) {
            _ if self.speed < 0.0 => {
                "the track is too steep for this amplitude ratio: kband transport --help".into()
            }
            (Target::Gear { .. }, Some(share)) if share >= MIN_SHARE_IN_GEAR => {
                format!("nothing has to be done; {gear} draws what else would hold them")
            }
            (Target::Gear { .. }, Some(_)) => match self.causes.first() {
                Some(Cause { remedy, best }) => format!(
                    "{remedy}. The lot is then predicted in gear for {} % of the time instead of {} %, at {} mm: {gear}",
                    number(100.0 * best.share, 2),
                    number(100.0 * self.best.unwrap_or_default().share, 2),
                    number(best.amplitude, 3)
                ),
                None => format!("no single change of drive or lot keeps them longer: {gear}"),
            },
            (Target::K(_) | Target::Amplitude(_), Some(_))
                if let Some(wrong) = self.best.and_then(|best| self.misplaced(best)) =>
            {
                wrong
            }
            (Target::Locked { .. }, Some(_)) => {
                "parts that scatter do not stay locked, but may stay in gear: [target] gear = 1"
                    .into()
            }
            (Target::Locked { .. }, None) if !self.locked => {
                format!("no kick brought every part into lock: kband capture --restitution {lot}")
            }
            _ => "kband explain holding; the picture shows the run".into(),
        }
    }
}

/// A count with two significant digits.
fn whole(value: f64) -> f64 {
    let step = 10_f64.powf((value.max(10.0).log10() - 1.0).floor());
    (value / step).round() * step
}

#[cfg(test)]
mod tests {
    use kband::regime::classify::Verdict;
    use kband_control::Fault;

    use super::*;

    fn observed() -> Observed {
        Observed {
            amplitude: 0.25,
            peak: 2.5,
            target: Target::Gear { order: 1 },
            last: Report {
                state: State::Holding,
                ..Report::default()
            },
            no_setpoint: None,
            parts: 1,
            resting: 0,
            k: 0.4,
            order: 1,
            in_gear: Some(0.99),
            best: None,
            causes: vec![],
            in_air: 0.9,
            loss: Some(1.5),
            locked: false,
            regime: "in gear 0.99, order 1".into(),
            speed: 87.5,
            part_length: 15.0,
            margin: None,
            lot: "0.18..0.22".into(),
            scatter: 0.04,
            strays: false,
            longer: 30.0,
        }
    }

    #[test]
    fn the_summary_names_margin_strays_doubling_and_missing_setpoint() {
        let with = |expected: &[&str], change: fn(&mut Observed)| {
            let mut observed = observed();
            change(&mut observed);
            let lines = observed.lines().join("\n");
            for text in expected {
                assert!(lines.contains(text), "{text}: {lines}");
            }
        };
        let thin = ["0.05 % of the amplitude", "thin", "DOWN the track"];
        let bands = ["kband bands --restitution 0.18..0.22"];
        with(&[&thin[..], &bands].concat(), |observed| {
            observed.last.state = State::Locked;
            observed.target = Target::Locked { order: 1 };
            (observed.in_gear, observed.locked) = (None, true);
            (observed.margin, observed.speed) = (Some(0.0005), -3.0);
        });
        with(&["12 hops detected", "--duration 30"], |observed| {
            observed.target = Target::Identify;
            observed.last.identification = Identification::Listening { hops: 12 };
        });
        with(&["--duration 30"], |observed| {
            observed.last.state = State::Capturing
        });
        for state in [State::Holding, State::Locked, State::Capturing, State::Lost] {
            let mut strays = observed();
            (strays.strays, strays.last.state) = (true, state);
            let next = strays.next();
            assert!(next.contains("outside the configured lot"), "{state:?}");
        }
        with(&["the flights have doubled"], |observed| {
            let (order, doublings, confidence) = (1, 1, 1.0);
            let regime = Regime::Doubled { order, doublings };
            observed.last.regime = Some(Verdict { regime, confidence });
            observed.last.state = State::Locked;
        });
        with(
            &["lock is of 1 of the 3 parts", "above k = 1"],
            |observed| {
                (observed.last.state, observed.k) = (State::Locked, 1.08);
                (observed.parts, observed.resting) = (3, 2);
            },
        );
        with(&[": a reason; kband explain"], |observed| {
            (observed.last.state, observed.last.limits) = (State::Limiting, Limits::NO_SETPOINT);
            observed.no_setpoint = Some("a reason".into());
        });
    }

    #[test]
    fn every_state_fault_and_limit_has_its_next_step() {
        for &state in State::ALL {
            let mut observed = observed();
            observed.last.state = state;
            let text = observed.next();
            assert!(text.len() > 15, "{state:?}: {text}");
        }
        for &fault in Fault::ALL {
            let mut faulty = observed();
            faulty.last.fault = Some(fault);
            let end = format!("kband explain fault {}", fault.number());
            assert!(faulty.next().ends_with(&end), "{}", faulty.next());
        }
        for limits in Limits::ALL {
            let mut limited = observed();
            limited.last.limits = limits;
            let end = format!("kband explain limit {}", limits.number());
            assert!(limited.next().ends_with(&end), "{}", limited.next());
        }
        let mut still = observed();
        (still.amplitude, still.last.state) = (0.0, State::Off);
        assert_eq!(still.lines()[0], "The track stands still.");
        assert_eq!(still.lines().len(), 2);
    }
}
