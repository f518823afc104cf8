//! Summary of a single run: motion of the track and the parts, margin to the loss, next step.

use std::f64::consts::TAU;

use kband::feeder::STANDARD_GRAVITY;
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

pub(super) struct Observed<'a> {
    outcome: &'a Outcome,
    last: Report,
    /// Amplitude and conveying speed, upwards positive, in mm and mm/s.
    amplitude: f64,
    speed: f64,
    /// Share of time in gear, for parts that scatter.
    in_gear: Option<f64>,
    /// The predicted best setpoint of the lot, if parts do not stay in gear.
    best: Option<BestSetpoint>,
    /// Causes why the lot is out of gear at its best setpoint, the most likely one first.
    pub causes: Vec<Cause>,
    locked: bool,
    /// Margin of the lock, relative to the amplitude.
    margin: Option<f64>,
    /// Restitution, written as an option of the verbs.
    lot: String,
}

impl<'a> Observed<'a> {
    pub(super) fn from_outcome(outcome: &'a Outcome) -> Self {
        let last = outcome.last();
        let settings = &outcome.file().scene.settings;
        let amplitude = outcome.amplitude() * 1e3;
        let k = outcome.k();
        let target = outcome.target();
        let is_gear = matches!(target, Target::Gear { .. });
        let in_gear = outcome.in_gear();
        let in_gear = in_gear.filter(|_| is_gear || outcome.file().scatters());
        let held = last.state == State::Holding && last.fault.is_none();
        let poor = held && in_gear.is_some_and(|share| share < MIN_SHARE_IN_GEAR);
        let (best, causes) = match target {
            Target::Gear { order } if poor => {
                let share = f64::from(last.expected_in_gear);
                let best = BestSetpoint { share, amplitude };
                (Some(best), causes(settings, order, best))
            }
            Target::K(_) | Target::Amplitude(_) if poor => {
                (Some(BestSetpoint::from_settings(settings, 1)), vec![])
            }
            _ if last.limits.contains(Limits::MISFIT) => (None, vec![misfit(settings, amplitude)]),
            _ => (None, vec![]),
        };
        let band = outcome.band().filter(|band| band.contains(k));
        let [low, high] = [settings.restitution_low, settings.restitution_high].map(shortest);
        Self {
            outcome,
            last,
            amplitude,
            speed: outcome.speed() * 1e3,
            in_gear,
            best,
            causes,
            locked: outcome.is_locked(),
            margin: band.map(|band| band.margins(k).smallest()),
            lot: span(low, high, 9),
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
            lines.push(self.parts());
            lines.extend(self.margin());
        }
        lines.push(format!("Next: {}.", self.next()));
        lines
    }

    fn track(&self) -> String {
        if self.amplitude <= 1e-3 {
            return "The track stands still.".into();
        }
        let rate = TAU * f64::from(self.outcome.file().scene.settings.frequency);
        let acceleration = self.outcome.amplitude() * rate * rate;
        let peak = acceleration * f64::from(self.last.shape.peaks()[1]) / STANDARD_GRAVITY;
        let [amplitude, peak] = numbers([self.amplitude, peak], 3);
        format!("The track moves {amplitude} mm to each side, {peak} g at its peak.")
    }

    fn parts(&self) -> String {
        let file = self.outcome.file();
        if file.scene.parts.is_empty() {
            return "There are no parts on it.".into();
        }
        let stroke = match self.outcome.gear_order() {
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
                let regime = self.outcome.regime();
                format!("Parts do not hop in one rhythm with the drive ({regime})")
            }
        };
        let direction = if self.speed < 0.0 { "DOWN" } else { "up" };
        let rate = 60.0 * self.speed.abs() / file.part_length;
        format!(
            "{hop} and travel {} mm/s {direction} the track: about {} parts a minute of {} mm each.",
            number(self.speed.abs(), 3),
            whole(rate),
            number(file.part_length, 4)
        )
    }

    fn motion(&self) -> String {
        let in_air = self.outcome.in_air();
        let air = number(100.0 * in_air, 2);
        if in_air <= 0.0 {
            "lie at rest".into()
        } else if in_air < MIN_TIME_IN_AIR {
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
            let frequency = f64::from(self.outcome.file().scene.settings.frequency);
            let lost = number(self.outcome.time_to_loss()? / frequency, 2);
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
            let why = self.outcome.no_setpoint();
            let why = why.map_or(String::new(), |why| format!(": {why}"));
            let (name, number) = (limit.name(), limit.number());
            return format!("{name} (limit {number}){why}; kband explain limit {number}");
        }
        let longer = number((3.0 * self.outcome.file().duration).min(86_400.0), 4);
        match self.last.identification {
            _ if self.outcome.target() != Target::Identify => {}
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
        let (strays, resting) = (self.outcome.strays(), self.outcome.resting());
        match self.last.state {
            State::Holding | State::Locked | State::Capturing | State::Lost
                if !strays.is_empty() =>
            {
                "some parts are outside the configured lot: widen part.restitution to all of them. \
                 Kick and amplitude are chosen for the configured lot only"
                    .into()
            }
            State::Locked if resting > 0 => {
                let all = self.outcome.file().scene.parts.len();
                let locked = all - resting;
                let remedy = if self.outcome.k() >= 1.0 {
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
        let (lot, scatter) = (&self.lot, self.outcome.file().scene.settings.scatter);
        let gear = format!("kband gear --restitution {lot} --scatter {scatter}");
        match (self.outcome.target(), self.in_gear) {
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
    use kband_scene::{DEFAULT, Fidelity, SceneFile, Watch};

    use super::*;

    /// tests/reports.txt and answers.txt have the summaries of the scenes.
    #[test]
    fn the_summary_names_a_thin_margin_an_open_capture_and_doubled_flights() {
        let mut file = SceneFile::parse(DEFAULT).unwrap();
        file.duration = 3.0;
        let run = Outcome::run(&file, Fidelity::Envelope, Watch::default(), &mut |_| Ok(()));
        let outcome = run.unwrap();
        let (order, doublings, confidence) = (1, 1, 1.0);
        let regime = Regime::Doubled { order, doublings };
        let doubled = Some(Verdict { regime, confidence });
        let bands = "kband bands --restitution 0.18..0.22";
        let thin = ["0.05 % of the amplitude", "thin", "DOWN the track", bands];
        for (state, regime, expected) in [
            (State::Locked, None, &thin[..]),
            (State::Capturing, None, &["--duration 9"]),
            (State::Locked, doubled, &["the flights have doubled"]),
        ] {
            let mut observed = Observed::from_outcome(&outcome);
            (observed.last.state, observed.last.regime) = (state, regime);
            (observed.locked, observed.margin) = (true, Some(0.0005));
            observed.speed = -3.0;
            let lines = observed.lines().join("\n");
            for text in expected {
                assert!(lines.contains(text), "{text}: {lines}");
            }
        }
    }
}
