//! `kband status`: present state of a board.

use std::io::{IsTerminal, Write, stdout};
use std::time::{Duration, Instant};

use kband_control::wire::{Request, Status, Telemetry};
use kband_control::{Fault, Limits, State, Target};
use serde_json::{Value as Json, json};

use crate::arguments::FormatArguments;
use crate::board::{Address, BoardMessage, BoardSettings, Emulated, Link};
use crate::causes::{self, BestSetpoint, Cause, CauseCache};
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal, Result};
use crate::report::{self, Format, Printout, Table, columns, finite, number, when};
use crate::simulate::{RESTING_AMPLITUDE, band_name, describe};

/// Print the present state of a board: inputs, readings, amplitude, margins, faults, and the next
/// step.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband status
  kband status --on /dev/ttyACM0 --live
  kband status --on qemu --format json")]
pub struct Arguments {
    #[command(flatten)]
    address: Address,
    /// Repeat twice a second, until Ctrl-C.
    #[arg(long)]
    live: bool,
    #[command(flatten)]
    printed: FormatArguments,
}

const POLL_INTERVAL: Duration = Duration::from_millis(500);

pub fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit> {
    let mut link = arguments.address.open(Emulated::Running)?;
    let mut cache = CauseCache::default();
    let on_screen =
        arguments.live && arguments.printed.format == Format::Table && stdout().is_terminal();
    loop {
        let status = BoardStatus::request(&mut link)?.with_causes(&mut link, &mut cache)?;
        if on_screen {
            // Moves the cursor home and clears the screen; the next line reports a closed terminal.
            let _ = write!(stdout(), "\x1b[H\x1b[J");
            report::print(&status.screen())?;
        } else {
            status.printout().print(arguments.printed.format)?;
        }
        if !arguments.live || desk.check_stop().is_err() {
            return Ok(Exit::Done);
        }
        std::thread::sleep(POLL_INTERVAL);
        if desk.check_stop().is_err() {
            return Ok(Exit::Done);
        }
    }
}

/// Longest wait for a row of telemetry: some cycles at 5 Hz, on a busy machine.
const TELEMETRY_TIMEOUT: Duration = Duration::from_secs(5);
const SCREEN_COLUMNS: usize = 80;

pub struct BoardStatus {
    name: String,
    target: Target,
    status: Status,
    telemetry: Telemetry,
    /// Causes why the lot is out of gear at its best setpoint, most likely first.
    causes: Vec<Cause>,
}

impl BoardStatus {
    pub fn request(link: &mut Link) -> Result<Self> {
        let status = link.status()?;
        let target = link.target()?;
        link.begin_telemetry(1)?;
        let telemetry = row(link);
        // Telemetry is switched off again even after an error.
        link.command(&Request::Telemetry(0))?;
        let telemetry = telemetry?;
        Ok(Self {
            name: link.name().into(),
            target,
            causes: vec![],
            status: status.ok_or_else(|| {
                let cause = "the board does not report its inputs";
                Refusal::new(cause, "kband flash writes the firmware of this desk")
            })?,
            telemetry,
        })
    }

    pub fn with_causes(mut self, link: &mut Link, cache: &mut CauseCache) -> Result<Self> {
        let now = BestSetpoint {
            share: f64::from(self.telemetry.expected_in_gear),
            amplitude: f64::from(self.telemetry.setpoint) * 1e3,
        };
        if let Target::Gear { order } = self.target
            && matches!(self.state(), Some(State::Holding | State::Limiting))
        {
            let limits = Limits::try_from(self.telemetry.limits).unwrap_or_default();
            let settings = BoardSettings::read(link)?.configured();
            self.causes = cache.causes(&settings, order, now, limits);
        }
        Ok(self)
    }

    pub fn state(&self) -> Option<State> {
        State::numbered(self.telemetry.state)
    }

    /// Number of the recipe in use; 0 without one.
    pub fn recipe(&self) -> u8 {
        self.status.recipe
    }

    /// The fault that keeps the drive off.
    pub fn fault(&self) -> Option<Fault> {
        Fault::numbered(self.telemetry.fault)
    }

    fn limits(&self) -> Vec<Limits> {
        let held = Limits::try_from(self.telemetry.limits).unwrap_or_default();
        let limits = Limits::ALL.into_iter();
        limits.filter(|limit| held.contains(*limit)).collect()
    }

    fn rows(&self) -> Vec<(&'static str, String)> {
        let (status, telemetry) = (&self.status, &self.telemetry);
        let moving = f64::from(telemetry.amplitude) > RESTING_AMPLITUDE;
        let or_rest = |value: String| if moving { value } else { "-".into() };
        let mm = |metres: f32| format!("{} mm", number(f64::from(metres) * 1e3, 4));
        let either = |is: bool, yes: &str, no: &str| if is { yes } else { no }.to_string();
        let state = self.state().map_or("unknown", State::name);
        let mut rows = vec![("board", self.name.clone()), ("state", state.into())];
        let named = |kind: &str, name: &str, number: u8| format!("{name} ({kind} {number})");
        if let Some(fault) = self.fault() {
            rows.push(("fault", named("fault", fault.name(), fault.number())));
        }
        for limit in self.limits() {
            let limit = named("limit", limit.name(), limit.number());
            rows.push(("held back by", limit));
        }
        let given = either(status.inputs.enable, "given", "not given");
        let permitted = either(status.permitted, "given", "withdrawn: kband enable");
        rows.extend([
            ("target", describe(self.target)),
            ("ready", either(status.ready, "on", "off")),
            ("enable input", given),
            ("enable of the desk", permitted),
        ]);
        let alarm = |(name, active)| (name, either(active, "ACTIVE", "no"));
        rows.extend(self.alarms().map(alarm));
        let mean = format!("{} m/s^2 (sensor_zero: about 0)", number(status.mean, 3));
        let output = number(f64::from(telemetry.output) * 100.0, 3);
        let impacts = number(telemetry.rate, 3);
        rows.extend([
            ("mean acceleration", mean),
            ("amplitude", or_rest(mm(telemetry.amplitude))),
            ("setpoint", mm(telemetry.setpoint)),
            ("k", or_rest(number(telemetry.k, 4))),
            ("output", format!("{output} %")),
            ("impacts detected", format!("{impacts} a cycle")),
            ("in gear estimated", number(telemetry.in_gear, 2)),
        ]);
        if let Some([low, high]) = telemetry.target_band {
            let [low, high] = [low, high].map(|k| number(k, 4));
            rows.push((band_name(self.target), format!("k {low} .. {high}")));
        }
        if let Some(margin) = telemetry.margin {
            let (flip, trace) = (number(margin.flip, 2), number(margin.trace, 2));
            let (restitution, error) = (number(margin.restitution, 3), number(margin.error, 1));
            let scatter = number(margin.scatter, 2);
            let estimated = format!("{restitution} +- {error}, scattering by {scatter}");
            let lost = format!("{} cycles", number(margin.to_loss, 2));
            rows.extend([
                ("margin to the flip", format!("{flip} (trace {trace})")),
                ("estimated restitution", estimated),
                ("gear is lost after", lost),
            ]);
        }
        if let Some(load) = telemetry.load {
            let flow = when(load.flow != 0.0, || {
                format!(", {} g/s", number(load.flow, 3))
            });
            let (mass, speed) = (number(load.mass, 3), number(load.speed, 3));
            let load = format!("{mass} g at {speed} mm/s{flow}");
            rows.push(("parts on the track", load));
        }
        rows.push(("time since its start", format!("{} s", status.seconds)));
        rows
    }

    pub fn printout(&self) -> Printout {
        let mut table = Table::new(&[columns::ITEM, columns::VALUE]);
        let causes = causes::describe(&self.causes).into_iter();
        let causes = causes.map(|cause| ("predicted", cause));
        for (item, value) in self.rows().into_iter().chain(causes) {
            table.push([item.into(), value.into()]);
        }
        let next = format!("next: {}", self.next());
        Printout::new(table).note(next).json(self.to_json())
    }

    /// The status within 23 lines of 80 columns: short items are paired, alarms share a line.
    pub fn screen(&self) -> String {
        let alarms = self.alarms();
        let mut rows: Vec<(&str, String)> = Vec::new();
        for (item, value) in self.rows() {
            match rows.last_mut() {
                Some((last, held)) if *last == item => *held += &format!(", {value}"),
                _ if alarms.iter().all(|(alarm, _)| *alarm != item) => rows.push((item, value)),
                _ => {}
            }
        }
        let active = alarms.iter().filter(|(_, active)| *active);
        let active: Vec<&str> = active.map(|(alarm, _)| *alarm).collect();
        let none = if active.is_empty() { "none" } else { "" };
        rows.push(("active alarms", active.join(", ") + none));
        let cause = causes::describe(&self.causes).into_iter().next();
        rows.extend(cause.map(|cause| ("predicted", cause)));
        let cell = |item: &str, value: &str| {
            let begin = format!("{item:<20} ");
            let rest = " ".repeat(begin.len());
            let wrap = textwrap::Options::new(SCREEN_COLUMNS)
                .initial_indent(&begin)
                .subsequent_indent(&rest);
            textwrap::fill(value, wrap)
        };
        let (mut text, mut beside) = (String::new(), None::<String>);
        for (item, value) in rows {
            let cell = cell(item, &value);
            // A short item waits for another short one, to share a line.
            if cell.chars().count() >= SCREEN_COLUMNS / 2 {
                text += &(cell + "\n");
            } else if let Some(left) = beside.take() {
                text += &format!("{left:<41}{cell}\n");
            } else {
                beside = Some(cell);
            }
        }
        for last in beside.into_iter().chain([cell("next", &self.next())]) {
            text += &(last + "\n");
        }
        text
    }

    /// Inputs that stop the drive while they are active.
    fn alarms(&self) -> [(&'static str, bool); 6] {
        let inputs = self.status.inputs;
        [
            ("over-temperature", inputs.over_temperature),
            ("over-current", inputs.over_current),
            ("supply low", inputs.supply_low),
            ("clock failed", inputs.clock_failed),
            ("control late", inputs.control_late),
            ("stack low", inputs.stack_low),
        ]
    }

    pub fn to_json(&self) -> Json {
        let alarms = self.alarms().into_iter();
        let alarms = alarms.map(|(name, active)| (name.replace([' ', '-'], "_"), active));
        json!({
            "board": self.name,
            "state": self.state().map(State::name),
            "fault": self.fault().map(Fault::name),
            "limits": self.limits().into_iter().map(Limits::name).collect::<Vec<_>>(),
            "target": describe(self.target),
            "ready": self.status.ready,
            "enable_input": self.status.inputs.enable,
            "enable_desk": self.status.permitted,
            "alarms": alarms.collect::<Json>(),
            "mean_acceleration": self.status.mean,
            "b": self.telemetry.amplitude * 1e3,
            "setpoint_b": self.telemetry.setpoint * 1e3,
            "k": finite(self.telemetry.k),
            "output": self.telemetry.output,
            "impacts_detected": self.telemetry.rate,
            "in_gear_estimated": self.telemetry.in_gear,
            "gear_band_low": self.telemetry.target_band.map(|[low, _]| low),
            "gear_band_high": self.telemetry.target_band.map(|[_, high]| high),
            "flip_estimated": self.telemetry.margin.map(|margin| margin.flip),
            "trace_estimated": self.telemetry.margin.map(|margin| margin.trace),
            "restitution_estimated": self.telemetry.margin.map(|margin| margin.restitution),
            "scatter_estimated": self.telemetry.margin.map(|margin| margin.scatter),
            "to_loss_estimated": self.telemetry.margin.map(|margin| margin.to_loss),
            "running_time": self.status.seconds,
            "mass_weighed": self.telemetry.load.map(|load| load.mass),
            "flow_weighed": self.telemetry.load.map(|load| load.flow).filter(|flow| *flow != 0.0),
            "causes": causes::describe(&self.causes),
            "next": self.next(),
        })
    }

    /// Reason why the drive does not meet the request, or what to check.
    pub fn next(&self) -> String {
        if let Some(fault) = self.fault() {
            return format!("kband explain fault {}", fault.number());
        }
        if !self.status.permitted {
            return "the desk withdrew the enable: kband enable gives it back".into();
        }
        if let Some((alarm, _)) = self.alarms().into_iter().find(|(_, active)| *active) {
            return format!("the drive stays off while '{alarm}' is active");
        }
        if !self.status.inputs.enable {
            return "the enable input has to be given at the machine".into();
        }
        if let Some(limit) = self.limits().first() {
            return format!("kband explain limit {}", limit.number());
        }
        match self.state() {
            Some(State::Off) => {
                "withdraw the enable input and give it again: a drive starts by its edge alone"
                    .into()
            }
            Some(_) if let [Cause { remedy, .. }, ..] = &self.causes[..] => remedy.clone(),
            Some(state) => {
                let name = state.name();
                format!("kband explain {name}; kband status --live shows it running")
            }
            None => "kband flash writes the firmware of this desk".into(),
        }
    }
}

/// Prints the present status, the last act of a verb.
pub fn show(link: &mut Link, format: Format) -> Result<Exit> {
    BoardStatus::request(link)?.printout().print(format)?;
    Ok(Exit::Done)
}

fn row(link: &mut Link) -> Result<Telemetry> {
    let end = Instant::now() + TELEMETRY_TIMEOUT;
    while Instant::now() < end {
        for message in link.listen(Duration::from_millis(50))? {
            if let BoardMessage::Telemetry(telemetry) = message {
                return Ok(telemetry);
            }
        }
    }
    let cause = "the board answers, but sends no telemetry";
    let next = "reset the board; kband identify lists its counts";
    Err(Refusal::new(cause, next))
}

#[cfg(test)]
mod tests {
    use kband_control::{GearMargin, Load};

    use super::*;
    use crate::report::Format;

    fn status() -> BoardStatus {
        BoardStatus {
            name: "board".into(),
            target: Target::Gear { order: 1 },
            status: Status {
                permitted: true,
                ..Status::default()
            },
            telemetry: Telemetry::from(&kband_control::Report::default()),
            causes: vec![],
        }
    }

    #[test]
    fn an_input_that_is_not_active_and_a_track_at_rest_say_so() {
        let mut printed = Vec::new();
        let printout = status().printout();
        printout.write(Format::Table, &mut printed).unwrap();
        let printed = String::from_utf8(printed).unwrap();
        let value = |item: &str| {
            let line = printed.lines().find(|line| line.starts_with(item));
            line.unwrap()[item.len()..].trim().to_string()
        };
        for (item, expected) in [("clock failed", "no"), ("amplitude", "-"), ("k ", "-")] {
            assert_eq!(value(item), expected, "{printed}");
        }
    }

    #[test]
    fn the_live_view_fits_a_terminal_of_80_columns_and_24_lines() {
        let mut now = status();
        let limits = Limits::ALL.iter().fold(0, |all, limit| all | limit.bits());
        (now.telemetry.limits, now.telemetry.target_band) = (limits, Some([0.392_12, 0.477_43]));
        now.telemetry.margin = Some(GearMargin::default());
        now.telemetry.load = Some(Load::default());
        let inputs = &mut now.status.inputs;
        (inputs.over_temperature, inputs.over_current) = (true, true);
        (inputs.supply_low, inputs.clock_failed) = (true, true);
        (inputs.control_late, inputs.stack_low) = (true, true);
        let cause = causes::misfit(&kband_control::Settings::default(), 0.327);
        for fault in [0, Fault::AmplitudeOscillates.number()] {
            now.telemetry.fault = fault;
            now.causes = vec![cause.clone(); 3];
            let text = now.screen();
            // The last line is left for the cursor.
            assert!(text.lines().count() < 24, "{text}");
            let mut widths = text.lines().map(|line| line.chars().count());
            assert!(widths.all(|width| width <= 80), "{text}");
            let message = text.split_whitespace().collect::<Vec<_>>().join(" ");
            for limit in Limits::ALL {
                let named = format!("{} (limit {})", limit.name(), limit.number());
                assert!(message.contains(&named), "{text}");
            }
            for expected in [
                &cause.remedy,
                &now.next(),
                "stack low",
                "time since its start",
            ] {
                assert!(message.contains(expected), "{expected}: {text}");
            }
        }
    }

    #[test]
    fn the_next_step_names_what_blocks_the_drive_or_the_first_cause() {
        let mut now = status();
        assert!(now.next().contains("enable input has to be given"));
        now.status.inputs.enable = true;
        assert!(now.next().contains("edge"));
        now.telemetry.state = State::Holding.number();
        assert!(now.next().contains("kband explain holding"));
        let cause = causes::misfit(&kband_control::Settings::default(), 0.327);
        now.causes = vec![cause.clone()];
        assert_eq!(now.next(), cause.remedy);
        now.status.inputs.supply_low = true;
        assert!(now.next().contains("'supply low'"));
        now.status.permitted = false;
        assert!(now.next().contains("kband enable"));
        now.telemetry.fault = Fault::NoResponse.number();
        assert_eq!(now.next(), "kband explain fault 4");
    }
}
