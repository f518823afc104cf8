//! The dashboard of `kband live`, drawn for a terminal of 80 x 24 characters or more.

use std::f64::consts::TAU;

use kband_control::{Limits, State, Target};
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span, Text};
use ratatui::widgets::canvas::{Canvas, Circle, Line as Stroke, Points};
use ratatui::widgets::{Block, Clear, Paragraph};

use super::history::{History, WINDOW};
use super::source::{Assignment, Seen};
use crate::causes::Cause;
use crate::report::number;
use crate::simulate::describe;

/// Request of the user to the screen.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Shown {
    /// The picture is paused.
    pub paused: bool,
    /// Keys and signs are explained.
    pub help: bool,
}

/// Draws everything.
pub(super) fn draw(
    frame: &mut Frame<'_>,
    history: &History,
    assignment: &Assignment,
    cause: Option<&Cause>,
    name: &str,
    shown: Shown,
) {
    let area = frame.area();
    if area.width < 60 || area.height < 20 {
        let small = format!(
            "kband live needs 80 x 24 characters; this terminal has {} x {}",
            area.width, area.height
        );
        frame.render_widget(Paragraph::new(small), area);
        return;
    }
    let foot = foot(history, assignment, area.width);
    let [head, body, events, keys] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Min(14),
        // Half of the lines beyond 24.
        Constraint::Length(5 + area.height.saturating_sub(24) / 2),
        Constraint::Length(foot.height() as u16),
    ])
    .areas(area);
    let [left, right] =
        Layout::horizontal([Constraint::Min(40), Constraint::Length(28)]).areas(body);
    let [gauge, trace, ribbon] = Layout::vertical([
        Constraint::Length(5),
        Constraint::Min(5),
        Constraint::Length(3),
    ])
    .areas(left);
    let [clock, numbers] =
        Layout::vertical([Constraint::Min(7), Constraint::Length(10)]).areas(right);
    draw_head(frame, head, history, assignment, name, shown.paused);
    draw_gauge(frame, gauge, history, assignment);
    draw_trace(frame, trace, history, assignment);
    draw_ribbon(frame, ribbon, history);
    draw_clock(frame, clock, history, assignment);
    draw_numbers(frame, numbers, history, assignment);
    draw_events(frame, events, history, cause);
    frame.render_widget(Paragraph::new(foot), keys);
    if shown.help {
        draw_help(frame, area);
    }
}

/// Advice if the drive is off or held back, else the keys.
fn foot(history: &History, assignment: &Assignment, width: u16) -> Text<'static> {
    match history.now().and_then(|seen| advice(seen, assignment)) {
        Some(advice) => {
            let words = format!("? help  {advice}");
            let lines = textwrap::wrap(&words, usize::from(width)).into_iter();
            let lines = lines.map(|line| Line::from(line.into_owned()).yellow());
            Text::from(lines.collect::<Vec<_>>())
        }
        None => Line::from(
            "?help  q quit  e enable  1-8 lock  g gear  x chaos  +-k  c capture anew  p pause",
        )
        .dim()
        .into(),
    }
}

/// The next step if the drive is off or has no setpoint, or the limits that hold it back.
fn advice(seen: &Seen, assignment: &Assignment) -> Option<String> {
    if let Some(fault) = seen.fault() {
        let (number, name) = (fault.number(), fault.name());
        return Some(format!(
            "stopped by fault {number}, {name}: kband explain fault {number}"
        ));
    }
    if seen.telemetry.setpoint <= 0.0 {
        return Some(match assignment.no_setpoint() {
            Some(why) => format!("no setpoint: {why}"),
            None => "no setpoint yet: the amplitude for this target is being chosen".into(),
        });
    }
    if seen.state() == State::Off {
        return Some("the drive is off: e enables it; a board needs its input given anew".into());
    }
    let limits = limits(seen);
    (!limits.is_empty()).then(|| format!("limits: {}", limits.join(", ")))
}

/// Names of the limits that hold the drive back.
fn limits(seen: &Seen) -> Vec<&'static str> {
    let held = Limits::ALL
        .iter()
        .filter(|limit| limit.bits() & seen.telemetry.limits != 0);
    held.map(|limit| limit.name()).collect()
}

/// Keys, letters of the states and signs.
fn draw_help(frame: &mut Frame<'_>, area: Rect) {
    let mut lines: Vec<Line<'_>> = [
        "q        quit            p    let the picture stand",
        "e        enable, or bring the drive to rest",
        "1 to 8   lock of that order: cycles in a flight",
        "g  x     in gear of order 1; chaos",
        "+  -     k by 0.005: less and more amplitude",
        "c        capture anew    ?    this help",
        "",
        "\u{25c6} k now, \u{2588} the lot's band; blue lines: its ends",
        "circle: phase of the drive; \u{2022} impacts, hand: their mean,",
        "  blue tick: where a locked part strikes",
        "R s for: estimated restitution, scatter, cycles to loss",
        "",
    ]
    .map(Line::from)
    .into();
    for row in STATES.chunks(3) {
        let of = |state: &State| {
            let (letter, colour) = look(*state);
            [
                Span::from(format!(" {letter} "))
                    .fg(Color::Black)
                    .bg(colour),
                Span::from(format!(" {:<12}", state.name())),
            ]
        };
        lines.push(Line::from(row.iter().flat_map(of).collect::<Vec<_>>()));
    }
    let (width, height) = (58, lines.len() as u16 + 2);
    let place = Rect {
        x: area.x + area.width.saturating_sub(width) / 2,
        y: area.y + area.height.saturating_sub(height) / 2,
        width: width.min(area.width),
        height: height.min(area.height),
    };
    frame.render_widget(Clear, place);
    let block = Block::bordered().title(" help: ? or Esc closes it ");
    frame.render_widget(Paragraph::new(lines).block(block), place);
}

/// The states in the order of their legend.
const STATES: [State; 9] = [
    State::Off,
    State::Starting,
    State::Holding,
    State::Capturing,
    State::Locked,
    State::Lost,
    State::Limiting,
    State::Fault,
    State::Stopping,
];

fn look(state: State) -> (char, Color) {
    match state {
        State::Off => ('o', Color::DarkGray),
        State::Starting => ('s', Color::Gray),
        State::Holding => ('h', Color::Cyan),
        State::Capturing => ('c', Color::Magenta),
        State::Locked => ('L', Color::Blue),
        State::Lost => ('!', Color::Yellow),
        State::Limiting => ('m', Color::Yellow),
        State::Fault => ('F', Color::Red),
        State::Stopping => ('e', Color::Gray),
    }
}

fn draw_head(
    frame: &mut Frame<'_>,
    area: Rect,
    history: &History,
    assignment: &Assignment,
    name: &str,
    paused: bool,
) {
    let state = history.now().map_or(State::Off, Seen::state);
    let badge = format!(" {} ", state.name().to_uppercase());
    let target = match assignment.target {
        // The numbers have its tones.
        Target::Tones { k, .. } => format!("tones at k = {k}"),
        other => describe(other),
    };
    let words = format!(
        "{}  {:.1} s  target {target}  ",
        if paused { " PAUSED" } else { "" },
        history.time()
    );
    let mut line = Line::from(vec![
        Span::from("kband live ").bold(),
        Span::from(badge).fg(Color::Black).bg(look(state).1).bold(),
        Span::from(words),
    ]);
    // The end of a long path names the file.
    let room = usize::from(area.width).saturating_sub(line.width());
    let length = name.chars().count();
    line.push_span(if length <= room {
        name.to_string()
    } else {
        let end = name.chars().skip(length + 1 - room.max(1));
        format!("…{}", end.collect::<String>())
    });
    frame.render_widget(Paragraph::new(line), area);
}

/// Band in k of the target: the gear band for a target of gear, else the lock's band.
fn band_of_target(history: &History, assignment: &Assignment) -> Option<[f64; 2]> {
    if let (Target::Gear { .. }, Some(seen)) = (assignment.target, history.now()) {
        return seen.telemetry.gear_band.map(|ends| ends.map(f64::from));
    }
    let band = assignment.band()?;
    Some([band.low(), band.high()])
}

/// Range of k of gauge and trace: the band with as much room on either side, or the measured range.
fn range(history: &History, assignment: &Assignment) -> (f64, f64) {
    if let Some([low, high]) = band_of_target(history, assignment) {
        let room = 0.9 * (high - low);
        return (low - room, high + room);
    }
    let k = history
        .now()
        .map_or(0.5, |seen| f64::from(seen.telemetry.k));
    let k = if k.is_finite() { k } else { 1.0 };
    (0.8 * k, 1.2 * k)
}

fn draw_gauge(frame: &mut Frame<'_>, area: Rect, history: &History, assignment: &Assignment) {
    let block = Block::bordered().title(" k against the band ");
    let inner = block.inner(area);
    let (low, high) = range(history, assignment);
    let now = history.now().map(|seen| seen.telemetry);
    let k = now.map_or(f64::NAN, |telemetry| f64::from(telemetry.k));
    let millimetres = |metres: f32| f64::from(metres) * 1e3;
    let first = now.map_or("no telemetry yet".to_string(), |telemetry| {
        format!(
            "k {k:.4}   b {:.4} mm   setpoint {:.4} mm",
            millimetres(telemetry.amplitude),
            millimetres(telemetry.setpoint)
        )
    });
    let width = usize::from(inner.width).max(1);
    let band = band_of_target(history, assignment);
    let cell = |n: usize| {
        let at = |part: f64| low + (high - low) * (n as f64 + part) / width as f64;
        let here =
            (at(0.0)..at(1.0)).contains(&k) || (n == 0 && k < low) || (n == width - 1 && k >= high);
        if here {
            Span::from("◆").bold()
        } else if band.is_some_and(|[low, high]| (low..=high).contains(&at(0.5))) {
            Span::from("█").blue()
        } else {
            Span::from("·").dark_gray()
        }
    };
    let gauge = Line::from((0..width).map(cell).collect::<Vec<_>>());
    let last = match assignment.band() {
        _ if matches!(assignment.target, Target::Gear { .. }) => format!(
            "in gear {}; gear band {}",
            now.map_or("not estimated".into(), |telemetry| in_gear(&telemetry)),
            band.map_or("not planned yet".into(), |[low, high]| format!(
                "{low:.4} to {high:.4}"
            ))
        ),
        None => "no band for this lot and target".to_string(),
        Some(band) if band.contains(k) => {
            let margins = band.margins(k);
            format!(
                "b {:.1} % below the flip, {:.1} % above lock's end",
                100.0 * margins.low.amplitude,
                100.0 * margins.high.amplitude
            )
        }
        Some(band) if k.is_finite() && k <= band.low() => {
            format!(
                "BEYOND {:.4}: b is {:.1} % too large",
                band.low(),
                100.0 * (1.0 - k / band.low())
            )
        }
        Some(band) if k.is_finite() => {
            format!(
                "BEYOND {:.4}: b is {:.1} % too small",
                band.high(),
                100.0 * (1.0 - band.high() / k)
            )
        }
        Some(band) => format!(
            "{:.4} to {:.4}, the drive is at rest",
            band.low(),
            band.high()
        ),
    };
    let text = Text::from(vec![Line::from(first).bold(), gauge, Line::from(last)]);
    frame.render_widget(Paragraph::new(text).block(block), area);
}

fn draw_trace(frame: &mut Frame<'_>, area: Rect, history: &History, assignment: &Assignment) {
    let (low, high) = range(history, assignment);
    let end = history.time();
    let points: Vec<(f64, f64)> = history
        .k()
        .map(|(time, k)| (time - end, k.clamp(low, high)))
        .collect();
    let band = band_of_target(history, assignment);
    let canvas = Canvas::default()
        .block(Block::bordered().title(format!(" k over the last {WINDOW:.0} s ")))
        .marker(Marker::Braille)
        .x_bounds([-WINDOW, 0.0])
        .y_bounds([low, high])
        .paint(|context| {
            for edge in band.into_iter().flatten() {
                context.draw(&Stroke::new(-WINDOW, edge, 0.0, edge, Color::Blue));
                context.print(-WINDOW, edge, Line::from(format!("{edge:.3}")).blue());
            }
            context.layer();
            context.draw(&Points {
                coords: &points,
                color: Color::Reset,
            });
        });
    frame.render_widget(canvas, area);
}

fn draw_ribbon(frame: &mut Frame<'_>, area: Rect, history: &History) {
    let block = Block::bordered().title(legend(history, area.width));
    let width = usize::from(block.inner(area).width).max(1);
    let end = history.time();
    let cell = |n: usize| {
        let time = end - WINDOW * (1.0 - (n as f64 + 1.0) / width as f64);
        match history.state_at(time) {
            Some(state) => {
                let (letter, colour) = look(state);
                let style = Style::new().fg(Color::Black).bg(colour);
                Span::styled(letter.to_string(), style)
            }
            None => Span::from(" "),
        }
    };
    let line = Line::from((0..width).map(cell).collect::<Vec<_>>());
    frame.render_widget(Paragraph::new(line).block(block), area);
}

/// The letters of all states if there is room for them, else of those in the window.
fn legend(history: &History, width: u16) -> String {
    let words = |states: &mut dyn Iterator<Item = State>| {
        let of = |state: State| format!("{} {}", look(state).0, state.name());
        format!(" {} ", states.map(of).collect::<Vec<_>>().join("  "))
    };
    let all = words(&mut STATES.into_iter());
    if all.chars().count() + 2 <= usize::from(width) {
        all
    } else {
        words(
            &mut STATES
                .into_iter()
                .filter(|state| history.states().any(|held| held == *state)),
        )
    }
}

/// Half of the width and half of the height of a canvas on which a circle is round. A character is
/// about twice as high as it is wide; there is room for the circle's words.
fn round(inner: Rect) -> (f64, f64) {
    let ratio = f64::from(inner.width.max(1)) / (2.0 * f64::from(inner.height.max(1)));
    let high = f64::max(1.4, 1.7 / ratio);
    (ratio * high, high)
}

fn draw_clock(frame: &mut Frame<'_>, area: Rect, history: &History, assignment: &Assignment) {
    let strikes: Vec<(f64, f64)> = history
        .strikes()
        .map(|phase| (phase.cos(), phase.sin()))
        .collect();
    let hand = history.now().filter(|seen| seen.telemetry.rate > 0.0);
    let hand = hand.map(|seen| f64::from(seen.telemetry.phase));
    let wanted = history
        .now()
        .and_then(|seen| assignment.lock_phase(f64::from(seen.telemetry.k)));
    let block = Block::bordered().title(" impact phase ");
    let (wide, high) = round(block.inner(area));
    let canvas = Canvas::default()
        .block(block)
        .marker(Marker::Braille)
        .x_bounds([-wide, wide])
        .y_bounds([-high, high])
        .paint(|context| {
            context.draw(&Circle::new(0.0, 0.0, 1.0, Color::DarkGray));
            if let Some(phase) = wanted.map(|phase| phase.rem_euclid(TAU)) {
                let (x, y) = (phase.cos(), phase.sin());
                context.draw(&Stroke::new(x, y, 1.2 * x, 1.2 * y, Color::Blue));
            }
            context.layer();
            if let Some(phase) = hand {
                let (x, y) = (0.9 * phase.cos(), 0.9 * phase.sin());
                context.draw(&Stroke::new(0.0, 0.0, x, y, Color::Reset));
            }
            context.print(1.3, 0.0, "0");
            context.print(-0.15, 1.3, "π/2");
            context.print(-1.4, 0.0, "π");
            context.layer();
            for (x, y) in &strikes {
                context.print(*x, *y, Line::from("•").yellow());
            }
        });
    frame.render_widget(canvas, area);
}

/// The share of time in gear with its error, or its lower bound.
fn in_gear(telemetry: &kband_control::wire::Telemetry) -> String {
    let share = 100.0 * telemetry.in_gear;
    if telemetry.in_gear_error.is_finite() {
        format!("{share:.0} +- {:.0} %", 100.0 * telemetry.in_gear_error)
    } else {
        format!("≥ {share:.0} %")
    }
}

fn draw_numbers(frame: &mut Frame<'_>, area: Rect, history: &History, assignment: &Assignment) {
    let mut lines = Vec::new();
    if let Some(seen) = history.now() {
        let telemetry = &seen.telemetry;
        let speed = history
            .speed()
            .map_or("not estimated".to_string(), |speed| {
                format!("{:.1} mm/s", 1e3 * speed)
            });
        lines.push(Line::from(format!("speed   {speed}")));
        lines.push(Line::from(format!(
            "impacts {:.2} at {:+.2} rad",
            telemetry.rate, telemetry.phase
        )));
        lines.push(Line::from(match assignment.target {
            Target::Gear { .. } => format!("in gear {}", in_gear(telemetry)),
            _ => format!("lock    {:.0} % confidence", 100.0 * telemetry.confidence),
        }));
        match telemetry.margin {
            None => lines.push(Line::from("margin  not estimated")),
            Some(margin) => lines.extend([
                Line::from(format!(
                    "margin  {:.2}, trace {:+.2}",
                    margin.flip, margin.trace
                )),
                Line::from(format!(
                    "R {:.3}, scatter {:.3}",
                    margin.restitution, margin.scatter
                )),
            ]),
        }
        if let Some(load) = telemetry.load {
            lines.push(Line::from(format!(
                "weighed {:.0} g, {} g/s",
                load.mass,
                number(load.flow.into(), 3)
            )));
        }
        lines.push(Line::from(format!(
            "output  {:.1} %",
            100.0 * telemetry.output
        )));
        let kband_control::Shape { second, third } = telemetry.shape;
        if second.ratio > 0.0 {
            let third = if third.ratio > 0.0 {
                format!(", e3 {:.3}", third.ratio)
            } else {
                String::new()
            };
            lines.push(Line::from(format!("tones   e {:.3}{third}", second.ratio)));
        }
        // The foot has the names.
        lines.push(match (seen.fault(), limits(seen).len()) {
            (Some(fault), _) => Line::from(format!("fault {}", fault.number())).red().bold(),
            (None, 0) => Line::from("no fault, no limit"),
            (None, 1) => Line::from("no fault, 1 limit").yellow(),
            (None, count) => Line::from(format!("no fault, {count} limits")).yellow(),
        });
    }
    frame.render_widget(
        Paragraph::new(lines).block(Block::bordered().title(" now ")),
        area,
    );
}

/// The last events, and above them the likeliest cause of parts out of gear.
fn draw_events(frame: &mut Frame<'_>, area: Rect, history: &History, cause: Option<&Cause>) {
    let title = cause.map_or(" events ".into(), |cause| {
        format!(" events; {} ", cause.short())
    });
    let block = Block::bordered().title(title);
    let inner = block.inner(area);
    let (room, width) = (usize::from(inner.height), usize::from(inner.width));
    let mut lines: Vec<Line<'_>> = Vec::new();
    for (time, words) in history.said().rev() {
        let begin = format!("{time:8.2} s  ");
        let options = textwrap::Options::new(width)
            .initial_indent(&begin)
            .subsequent_indent("            ");
        let said: Vec<_> = textwrap::wrap(words, options)
            .into_iter()
            .map(|line| Line::from(line.into_owned()))
            .collect();
        // An older event is shown whole or not at all.
        if !lines.is_empty() && lines.len() + said.len() > room {
            break;
        }
        lines.splice(0..0, said);
    }
    frame.render_widget(Paragraph::new(lines).block(block), area);
}

#[cfg(test)]
mod tests {
    use kband_control::{GearMargin, Load, Shape, UpperTone};
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    use super::super::{Simulation, Source};
    use super::*;
    use crate::causes::CauseCache;
    use crate::simulate::{DEFAULT, SceneFile};

    fn shown(width: u16, height: u16, history: &History, assignment: &Assignment) -> String {
        drawn(width, height, history, assignment, Shown::default())
    }

    fn drawn(
        width: u16,
        height: u16,
        history: &History,
        assignment: &Assignment,
        shown: Shown,
    ) -> String {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal
            .draw(|frame| {
                let cause = history
                    .now()
                    .and_then(|seen| seen.cause(assignment, &mut CauseCache::default()));
                draw(frame, history, assignment, cause.as_ref(), "a test", shown);
            })
            .unwrap();
        let buffer = terminal.backend().buffer();
        let mut text = String::new();
        for (n, cell) in buffer.content().iter().enumerate() {
            text.push_str(cell.symbol());
            if (n + 1) % usize::from(width) == 0 {
                text.push('\n');
            }
        }
        text
    }

    #[test]
    fn everything_fits_into_80_by_24() {
        let file = SceneFile::parse(DEFAULT).unwrap();
        let mut source = Simulation::build("the default scene", &file).unwrap();
        let mut history = History::default();
        for seen in source.advance(4.0).unwrap() {
            history.take(seen);
        }
        let screen = shown(80, 24, &history, &source.assignment());
        let band = history.now().and_then(|seen| seen.telemetry.gear_band);
        let end = format!("to {:.4}", band.expect("a gear band")[1]);
        assert!(screen.contains(&end), "the gear band is cut:\n{screen}");
        for words in [
            "kband live",
            "target gear of order 1",
            "k against the band",
            "gear band 0.",
            "mm/s",
            "impact phase",
            "no fault",
            "no limit",
            "c capture anew",
            "p pause",
            "◆",
            "•",
        ] {
            assert!(screen.contains(words), "'{words}' is missing:\n{screen}");
        }
    }

    /// Two-digit rates, a load, tones, all limits, a long path and a long refusal.
    #[test]
    fn the_longest_values_are_not_cut() {
        let (source, mut history) = ran(4.0);
        let mut seen = history.now().unwrap().clone();
        let telemetry = &mut seen.telemetry;
        (telemetry.rate, telemetry.phase) = (24.0, -3.04);
        telemetry.margin = Some(GearMargin {
            trace: -1.25,
            restitution: 0.345,
            error: 0.01,
            scatter: 0.125,
            flip: -0.25,
            to_loss: 50.0,
        });
        telemetry.load = Some(Load {
            mass: 12_345.0,
            speed: 100.0,
            flow: 1234.5,
        });
        telemetry.output = 1.0;
        telemetry.shape = Shape::new(UpperTone::new(0.15, 2.0), UpperTone::new(0.05, 1.0));
        telemetry.limits = Limits::ALL.iter().fold(0, |all, limit| all | limit.bits());
        history.take(seen);
        let refusal = "target k = 12 is refused; accepted: 0.02..10; next: change target k and run again, \
                       or correct the settings of this board with kband settings";
        history.say(refusal.into());
        let assignment = source.assignment();
        let mut terminal = Terminal::new(TestBackend::new(80, 24)).unwrap();
        let path = "/a/long/path/to/the/folder/with/the/scenes/of/all/lines/line-3.toml";
        terminal
            .draw(|frame| draw(frame, &history, &assignment, None, path, Shown::default()))
            .unwrap();
        let cells = terminal.backend().buffer().content();
        let row = |row: &[ratatui::buffer::Cell]| -> String {
            row.iter().map(|cell| cell.symbol()).collect()
        };
        let screen: Vec<String> = cells.chunks(80).map(row).collect();
        let words = screen
            .join(" ")
            .replace(['│', '┌', '┐', '└', '┘', '─'], " ");
        let words: Vec<&str> = words.split_whitespace().collect();
        let words = words.join(" ");
        for expected in [
            refusal,
            "lines/line-3.toml",
            "impacts 24.00 at -3.04 rad",
            "margin -0.25, trace -1.25",
            "R 0.345, scatter 0.125",
            "weighed 12345 g, 1235 g/s",
            "output 100.0 %",
            "tones e 0.150, e3 0.050",
            "no fault, 8 limits",
            "limits: output at its maximum, amplitude limit, acceleration limit,",
            "parts do not fit the lot",
        ] {
            assert!(
                words.contains(expected),
                "'{expected}' is cut:\n{}",
                screen.join("\n")
            );
        }
    }

    #[test]
    fn likeliest_cause_of_parts_out_of_gear_fits_over_the_events() {
        for (actual, configured, cause) in [
            (
                "[-0.1]",
                "0.04",
                "0 in gear with parts that do not fit the lot ",
            ),
            ("[0.2]", "0.2", "in gear with parts that scatter less "),
        ] {
            let text = DEFAULT
                .replace("# actual = [0.2] ", &format!("actual = {actual} #"))
                .replace("scatter = 0.04 ", "scatter = 0.2 ")
                .replace(
                    "\n[controller]",
                    &format!("\n[controller]\nscatter = {configured} "),
                );
            let file = SceneFile::parse(&text).unwrap();
            let mut source = Simulation::build("a scene", &file).unwrap();
            let mut history = History::default();
            for seen in source.advance(9.0).unwrap() {
                history.take(seen);
            }
            let screen = shown(80, 24, &history, &source.assignment());
            assert!(screen.contains(cause), "'{cause}' is missing:\n{screen}");
        }
    }

    /// A source that has run for some seconds, and its history.
    fn ran(seconds: f64) -> (Simulation, History) {
        let file = SceneFile::parse(DEFAULT).unwrap();
        let mut source = Simulation::build("the default scene", &file).unwrap();
        let mut history = History::default();
        for seen in source.advance(seconds).unwrap() {
            history.take(seen);
        }
        (source, history)
    }

    #[test]
    fn the_help_explains_every_key_and_every_state() {
        let (source, history) = ran(2.0);
        let help = Shown {
            help: true,
            ..Shown::default()
        };
        for (width, height) in [(80, 24), (60, 20), (140, 50)] {
            let screen = drawn(width, height, &history, &source.assignment(), help);
            for state in STATES {
                let (letter, _) = look(state);
                let entry = format!(" {letter}  {}", state.name());
                assert!(screen.contains(&entry), "'{entry}' is missing:\n{screen}");
            }
            for words in [
                "? or Esc closes it",
                "e        enable",
                "chaos",
                "blue tick",
            ] {
                assert!(screen.contains(words), "'{words}' is missing:\n{screen}");
            }
        }
    }

    #[test]
    fn the_legend_is_cut_to_visible_curves_where_room_is_short() {
        let (source, history) = ran(3.0);
        let wide = shown(160, 40, &history, &source.assignment());
        for state in STATES {
            assert!(
                wide.contains(&format!("{} {}", look(state).0, state.name())),
                "{wide}"
            );
        }
        let narrow = shown(80, 24, &history, &source.assignment());
        assert!(
            narrow.contains(" o off  s starting  h holding "),
            "{narrow}"
        );
    }

    #[test]
    fn the_screen_says_how_to_start_an_idle_drive() {
        use super::super::Wish;
        let (mut source, mut history) = ran(3.0);
        source.obey(Wish::Enable(false)).unwrap();
        history.take(source.advance(3.0).unwrap().pop().unwrap());
        let off = shown(80, 24, &history, &source.assignment());
        assert!(off.contains("the drive is off: e enables it"), "{off}");
        // A lot without a common band has no lock.
        let mut wide = SceneFile::parse(DEFAULT).unwrap();
        wide.scene.settings.restitution_low = 0.1;
        wide.scene.settings.restitution_high = 0.3;
        wide.scene.target = Target::Locked { order: 1 };
        let mut source = Simulation::build("a wide lot", &wide).unwrap();
        history.take(source.advance(0.5).unwrap().pop().unwrap());
        let none = shown(80, 24, &history, &source.assignment());
        assert!(none.contains("? help  no setpoint: no band"), "{none}");
        let why = source.assignment().no_setpoint().unwrap().to_string();
        let words: Vec<&str> = none.split_whitespace().collect();
        assert!(words.join(" ").contains(&why), "'{why}' is cut:\n{none}");
    }

    #[test]
    fn events_fill_the_rest_of_the_height() {
        let (source, _) = ran(0.1);
        let mut history = History::default();
        for n in 0..60 {
            history.say(format!("word {n}"));
        }
        let told = |height| {
            shown(80, height, &history, &source.assignment())
                .matches("word ")
                .count()
        };
        assert_eq!((told(24), told(50)), (3, 16));
    }

    #[test]
    fn any_size_and_an_empty_history_are_drawn() {
        let file = SceneFile::parse(DEFAULT).unwrap();
        let source = Simulation::build("the default scene", &file).unwrap();
        for (width, height) in [(1, 1), (20, 5), (59, 30), (60, 20), (80, 24), (300, 90)] {
            let screen = shown(width, height, &History::default(), &source.assignment());
            assert_eq!(screen.lines().count(), usize::from(height));
        }
        assert!(shown(70, 10, &History::default(), &source.assignment()).contains("needs 80 x 24"));
    }
}
