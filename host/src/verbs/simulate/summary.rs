//! Summary of a single run: motion of the track and the parts, margin to the loss, next step.
//!
//! Amplitudes are in mm, speeds in mm/s, rates in parts a minute, times in s.

use kband::regime::classify::Regime;
use kband_control::{Fault, Identification, Limits, State, Target};

use crate::causes::{Best, Cause, MIN_SHARE_IN_GEAR, causes, misfit};
use crate::report::number;
use crate::simulate::Outcome;

/// Relative difference below which two amplitudes count as equal: a setter sees no change.
const SAME_AMPLITUDE: f64 = 0.03;
/// Share of the time in the air below which parts are reported to hop and rest.
const MIN_TIME_IN_AIR: f64 = 0.9;

/// Relative margin of the amplitude below which it is called thin. A warm coil or a hand on the
/// bowl changes more.
const THIN_MARGIN: f64 = 0.01;

#[derive(Clone, Debug)]
pub(super) struct Seen {
    /// Amplitude in mm, and the track's peak acceleration over gravity.
    amplitude: f64,
    peak: f64,
    target: Target,
    state: State,
    fault: Option<Fault>,
    limits: Limits,
    /// Why the target has no setpoint.
    no_setpoint: Option<String>,
    identification: Identification,
    parts: usize,
    resting: usize,
    k: f64,
    order: u32,
    /// Share of time in gear, for parts that scatter.
    in_gear: Option<f64>,
    /// The predicted best setpoint of the lot, if parts do not stay in gear.
    best: Option<Best>,
    /// Causes why the lot is out of gear at its best setpoint.
    causes: Vec<Cause>,
    /// Share of the time in the air.
    in_air: f64,
    /// Time in gear until its loss, in s.
    loss: Option<f64>,
    locked: bool,
    /// Whether successive flights alternate, as measured.
    doubled: bool,
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

impl Seen {
    pub(super) fn of(outcome: &Outcome) -> Self {
        let last = outcome.last();
        let scene = &outcome.file().scene;
        let settings = &scene.settings;
        let frequency = f64::from(settings.frequency);
        let amplitude = outcome.amplitude();
        let k = outcome.k();
        let (low, high) = (settings.restitution_low, settings.restitution_high);
        let rate = std::f64::consts::TAU * frequency;
        let target = outcome.target();
        let in_gear = outcome.in_gear().filter(|_| outcome.file().scatters());
        let held = last.state == State::Holding && last.fault.is_none();
        let poor = held && in_gear.is_some_and(|share| share < MIN_SHARE_IN_GEAR);
        let (best, causes) = match target {
            Target::Gear { order } if poor => {
                let best = Best {
                    share: f64::from(last.expected_in_gear),
                    amplitude: amplitude * 1e3,
                };
                (Some(best), causes(settings, order, best))
            }
            Target::K(_) | Target::Amplitude(_) if poor => (Some(Best::of(settings, 1)), vec![]),
            _ if last.limits.contains(Limits::MISFIT) => {
                (None, vec![misfit(settings, amplitude * 1e3)])
            }
            _ => (None, vec![]),
        };
        Self {
            amplitude: amplitude * 1e3,
            peak: amplitude * rate * rate * f64::from(last.shape.peaks()[1])
                / kband::feeder::STANDARD_GRAVITY,
            target,
            state: last.state,
            fault: last.fault,
            limits: last.limits,
            no_setpoint: outcome.no_setpoint(),
            identification: last.identification,
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
            doubled: last
                .regime
                .is_some_and(|found| matches!(found.regime, Regime::Doubled { .. })),
            regime: outcome.regime(),
            speed: outcome.speed() * 1e3,
            part_length: outcome.file().part_length,
            margin: outcome
                .band()
                .filter(|band| band.contains(k))
                .map(|band| band.margins(k).smallest()),
            lot: if low == high {
                format!("{low}")
            } else {
                format!("{low}..{high}")
            },
            scatter: settings.scatter,
            strays: !outcome.strays().is_empty(),
            longer: (3.0 * outcome.file().duration).min(86_400.0),
        }
    }

    /// Why the lot is out of gear at its best, the most likely cause first.
    pub(super) fn causes(&self) -> &[Cause] {
        &self.causes
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
        format!(
            "The track moves {} mm to each side, {} g at its peak.",
            number(self.amplitude, 3),
            number(self.peak, 3)
        )
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
            None => format!(
                "Parts do not hop in one rhythm with the drive ({})",
                self.regime
            ),
        };
        let way = if self.speed < 0.0 { "DOWN" } else { "up" };
        let rate = 60.0 * self.speed.abs() / self.part_length;
        Some(format!(
            "{hop} and travel {} mm/s {way} the track: about {} parts a minute of {} mm each.",
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
        } else if self.doubled {
            "hop by turns high and low (doubled),".into()
        } else {
            format!("hop irregularly, in the air for {air} % of the time,")
        }
    }

    /// The fault of a configured amplitude, and the one to choose.
    fn misplaced(&self, best: Best) -> Option<String> {
        let ratio = self.amplitude / best.amplitude;
        if best.share < 0.5 || (ratio - 1.0).abs() < SAME_AMPLITUDE {
            return None;
        }
        Some(format!(
            "{} mm is too {} for parts of R {}: {} mm keeps them in gear for {} % of the time ([target] gear = 1)",
            number(self.amplitude, 3),
            if ratio < 1.0 { "little" } else { "much" },
            self.lot,
            number(best.amplitude, 3),
            number(100.0 * best.share, 2)
        ))
    }

    fn margin(&self) -> Option<String> {
        if let Some(share) = self.in_gear {
            let lost = self.loss?;
            (share > 0.0).then(|| {
                format!(
                    "They lose it after {} s in the mean, and fall back into it by themselves.",
                    number(lost, 2)
                )
            })
        } else if self.locked {
            let margin = self.margin?;
            let margin_line = format!(
                "Margin: {} % of the amplitude ({} mm)",
                number(100.0 * margin, 2),
                number(margin * self.amplitude, 2)
            );
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
        if let Some(fault) = self.fault {
            return format!(
                "remove the cause of '{}': kband explain fault {}",
                fault.name(),
                fault.number()
            );
        }
        if let Some(limit) = Limits::ALL
            .into_iter()
            .find(|limit| self.limits.contains(*limit))
        {
            let why = self.no_setpoint.as_ref();
            let why = why.map_or(String::new(), |why| format!(": {why}"));
            return format!(
                "{} (limit {}){why}; kband explain limit {}",
                limit.name(),
                limit.number(),
                limit.number()
            );
        }
        if self.target == Target::Identify
            && let Identification::Listening { hops } = self.identification
        {
            let longer = number(self.longer, 4);
            return format!(
                "no restitution is identified yet ({hops} hops detected): run longer, with --duration {longer}"
            );
        }
        match self.identification {
            Identification::Found(found) if self.target == Target::Identify => {
                let r = number(found.restitution, 3);
                return format!(
                    "the parts rebound with R = {r}: set part.restitution to an interval about it, and [target] gear = 1"
                );
            }
            Identification::NotFound(_) if self.target == Target::Identify => {
                return "no restitution was identified: see which parts and sensor it needs in the manual's commissioning".into();
            }
            _ => {}
        }
        if self.strays
            && matches!(
                self.state,
                State::Holding | State::Locked | State::Capturing | State::Lost
            )
        {
            return "some parts are outside the configured lot: widen part.restitution to all of them. \
                    Kick and amplitude are chosen for the configured lot only"
                .into();
        }
        if self.state == State::Locked && self.resting > 0 {
            let rest = format!(
                "the lock is of {} of the {} parts, the others lie at rest",
                self.parts - self.resting,
                self.parts
            );
            return if self.k >= 1.0 {
                format!(
                    "{rest}: above k = 1 the track throws no resting part. Set [target] k = 0.9, if the band holds it: \
                     kband bands --restitution {}",
                    self.lot
                )
            } else {
                format!("{rest}: [target] gear = 1 throws them")
            };
        }
        if self.state == State::Locked && self.doubled {
            return format!(
                "the flights have doubled, as of parts livelier than the lot: kband bands --restitution {}",
                self.lot
            );
        }
        let longer = number(self.longer, 4);
        match self.state {
            State::Off => "the enable input starts the drive: kband explain off".into(),
            State::Starting => format!("the setpoint is not reached yet: --duration {longer} gives it time"),
            State::Capturing => format!("the parts are not in lock yet: --duration {longer} gives it time"),
            State::Stopping => "the drive comes to rest: kband explain stopping".into(),
            State::Lost => "the lock is lost; parts that scatter stay in gear where they do not stay locked: [target] gear = 1".into(),
            State::Fault | State::Limiting => format!("kband explain {}", self.state.name()),
            State::Locked if self.margin.is_some_and(|margin| margin < THIN_MARGIN) => {
                format!("a lot of less width has more margin: kband bands --restitution {}", self.lot)
            }
            State::Locked => "the lock holds; kband explain margin describes its margin".into(),
            State::Holding => self.held(),
        }
    }

    fn held(&self) -> String {
        let gear = format!(
            "kband gear --restitution {} --scatter {}",
            self.lot, self.scatter
        );
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
                format!(
                    "no kick brought every part into lock: kband capture --restitution {}",
                    self.lot
                )
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
    use super::*;

    fn seen() -> Seen {
        Seen {
            amplitude: 0.25,
            peak: 2.5,
            target: Target::Gear { order: 1 },
            state: State::Holding,
            fault: None,
            limits: Limits::default(),
            no_setpoint: None,
            identification: Identification::Idle,
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
            doubled: false,
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
    fn the_summary_of_gear_uses_mm_strokes_and_parts_a_minute() {
        assert_eq!(
            seen().lines(),
            [
                "The track moves 0.25 mm to each side, 2.5 g at its peak.",
                "Parts hop once every stroke for 99 % of the time (in gear) and travel 87.5 mm/s up the track: \
                 about 350 parts a minute of 15 mm each.",
                "They lose it after 1.5 s in the mean, and fall back into it by themselves.",
                "Next: nothing has to be done; kband gear --restitution 0.18..0.22 --scatter 0.04 draws what else would \
                 hold them.",
            ]
        );
    }

    #[track_caller]
    fn says(change: fn(&mut Seen), words: &[&str]) {
        let mut seen = seen();
        change(&mut seen);
        let lines = seen.lines().join("\n");
        for said in words {
            assert!(lines.contains(said), "{said}: {lines}");
        }
    }

    #[test]
    fn the_summary_warns_of_thin_margin_and_short_run() {
        says(
            |seen| {
                seen.state = State::Locked;
                seen.target = Target::Locked { order: 1 };
                (seen.in_gear, seen.locked) = (None, true);
                seen.margin = Some(0.0005);
                seen.speed = -3.0;
            },
            &[
                "0.05 % of the amplitude",
                "thin",
                "DOWN the track",
                "kband bands --restitution 0.18..0.22",
            ],
        );
        says(
            |seen| {
                seen.target = Target::Identify;
                seen.identification = Identification::Listening { hops: 12 };
            },
            &["12 hops detected", "--duration 30"],
        );
        says(|seen| seen.state = State::Capturing, &["--duration 30"]);
    }

    #[test]
    fn the_summary_names_strays_doubling_and_missing_setpoint() {
        for state in [State::Holding, State::Locked, State::Capturing, State::Lost] {
            let strays = Seen {
                strays: true,
                state,
                ..seen()
            };
            let next = strays.next();
            assert!(next.contains("outside the configured lot"), "{state:?}");
        }
        says(
            |seen| (seen.state, seen.doubled) = (State::Locked, true),
            &["the flights have doubled"],
        );
        says(
            |seen| {
                (seen.state, seen.k) = (State::Locked, 1.08);
                (seen.parts, seen.resting) = (3, 2);
            },
            &["lock is of 1 of the 3 parts", "above k = 1"],
        );
        says(
            |seen| {
                (seen.state, seen.limits) = (State::Limiting, Limits::NO_SETPOINT);
                seen.no_setpoint = Some("a reason".into());
            },
            &[": a reason; kband explain"],
        );
    }

    #[test]
    fn every_state_fault_and_limit_has_its_next_step() {
        for &state in State::ALL {
            let said = Seen { state, ..seen() }.next();
            assert!(said.len() > 15, "{state:?}: {said}");
        }
        for &fault in Fault::ALL {
            let faulty = Seen {
                fault: Some(fault),
                ..seen()
            };
            let end = format!("kband explain fault {}", fault.number());
            assert!(faulty.next().ends_with(&end), "{}", faulty.next());
        }
        for limits in Limits::ALL {
            let limited = Seen { limits, ..seen() };
            let end = format!("kband explain limit {}", limits.number());
            assert!(limited.next().ends_with(&end), "{}", limited.next());
        }
        let still = Seen {
            amplitude: 0.0,
            state: State::Off,
            ..seen()
        };
        assert_eq!(still.lines()[0], "The track stands still.");
        assert_eq!(still.lines().len(), 2);
    }
}
