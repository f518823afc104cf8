//! What the dashboard shows, made for 80 x 24 and any larger terminal.

use std::f64::consts::TAU;

use kband::control::{Limits, State, Target};
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span, Text};
use ratatui::widgets::canvas::{Canvas, Circle, Line as Stroke, Points};
use ratatui::widgets::{Block, Paragraph};

use super::history::{History, WINDOW};
use super::source::Assignment;
use crate::simulate::describe;

/// Draws everything.
pub(super) fn draw(
    frame: &mut Frame<'_>,
    history: &History,
    assignment: &Assignment,
    name: &str,
    paused: bool,
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
    let [head, body, events, keys] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Min(14),
        Constraint::Length(5),
        Constraint::Length(1),
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
    draw_head(frame, head, history, assignment, name, paused);
    draw_gauge(frame, gauge, history, assignment);
    draw_trace(frame, trace, history, assignment);
    draw_ribbon(frame, ribbon, history);
    draw_clock(frame, clock, history, assignment);
    draw_numbers(frame, numbers, history);
    draw_events(frame, events, history);
    let help = "q quit  e enable  1-8 lock  g gear  x chaotic  + - k  c capture anew  p pause";
    frame.render_widget(Paragraph::new(help).dim(), keys);
}

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
    let state = history.now().map_or(State::Off, super::Seen::state);
    let badge = format!(" {} ", state.name().to_uppercase());
    let line = Line::from(vec![
        Span::from("kband live ").bold(),
        Span::from(badge).fg(Color::Black).bg(look(state).1).bold(),
        Span::from(format!(
            "{}  {:.1} s  target {}  {name}",
            if paused { " PAUSED" } else { "" },
            history.time(),
            describe(assignment.target)
        )),
    ]);
    frame.render_widget(Paragraph::new(line), area);
}

/// Range of k that gauge and trace show: the band with as much room beside it, or what was seen.
fn range(history: &History, assignment: &Assignment) -> (f64, f64) {
    if let Some(band) = assignment.band() {
        let room = 0.9 * (band.high() - band.low());
        return (band.low() - room, band.high() + room);
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
    let band = assignment.band();
    let cell = |n: usize| {
        let at = |part: f64| low + (high - low) * (n as f64 + part) / width as f64;
        let here =
            (at(0.0)..at(1.0)).contains(&k) || (n == 0 && k < low) || (n == width - 1 && k >= high);
        if here {
            Span::from("◆").bold()
        } else if band.is_some_and(|band| band.contains(at(0.5))) {
            Span::from("█").blue()
        } else {
            Span::from("·").dark_gray()
        }
    };
    let gauge = Line::from((0..width).map(cell).collect::<Vec<_>>());
    let last = match band {
        // Gear holds beyond the band of a lock too, where the plan put it.
        Some(band) if matches!(assignment.target, Target::Gear { .. }) => format!(
            "in gear {}; band of the lock {:.4} to {:.4}",
            now.map_or("not heard".into(), |telemetry| in_gear(&telemetry)),
            band.low(),
            band.high()
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
    let band = assignment.band();
    let canvas = Canvas::default()
        .block(Block::bordered().title(format!(" k over the last {WINDOW:.0} s ")))
        .marker(Marker::Braille)
        .x_bounds([-WINDOW, 0.0])
        .y_bounds([low, high])
        .paint(|context| {
            for edge in band.iter().flat_map(|band| [band.low(), band.high()]) {
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
    let block = Block::bordered().title(" o off s start h hold c kick L lock ! lost F fault ");
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
    let canvas = Canvas::default()
        .block(Block::bordered().title(" impact phase "))
        .marker(Marker::Braille)
        .x_bounds([-2.1, 2.1])
        .y_bounds([-1.4, 1.4])
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
            context.print(1.35, -0.05, "0");
            context.print(-0.15, 1.4, "π/2");
            context.print(-1.5, -0.05, "π");
            context.layer();
            for (x, y) in &strikes {
                context.print(*x, *y, Line::from("•").yellow());
            }
        });
    frame.render_widget(canvas, area);
}

/// The share of time in gear with its error, or what it is at least.
fn in_gear(telemetry: &kband::wire::Telemetry) -> String {
    let share = 100.0 * telemetry.in_gear;
    if telemetry.in_gear_error.is_finite() {
        format!("{share:.0} +- {:.0} %", 100.0 * telemetry.in_gear_error)
    } else {
        format!("{share:.0} % or more")
    }
}

fn draw_numbers(frame: &mut Frame<'_>, area: Rect, history: &History) {
    let mut lines = Vec::new();
    if let Some(seen) = history.now() {
        let telemetry = &seen.telemetry;
        let speed = history.speed().map_or("not known".to_string(), |speed| {
            format!("{:.1} mm/s", 1e3 * speed)
        });
        lines.push(Line::from(format!("speed   {speed}")));
        lines.push(Line::from(format!(
            "impacts {:.2}, at {:+.2} rad",
            telemetry.rate, telemetry.phase
        )));
        lines.push(Line::from(format!(
            "in gear {}, lock {:.0} %",
            in_gear(telemetry),
            100.0 * telemetry.confidence
        )));
        match telemetry.margin {
            None => lines.push(Line::from("margin  not heard")),
            Some(margin) => lines.extend([
                Line::from(format!(
                    "margin  {:.2}, trace {:+.2}",
                    margin.flip, margin.trace
                )),
                Line::from(format!(
                    "R {:.3} s {:.3} for {:.0}",
                    margin.restitution, margin.scatter, margin.to_loss
                )),
            ]),
        }
        let kband::wire::Shape { second, third } = telemetry.shape;
        let tones = [(", e", second), (", e3", third)];
        let upper: String = (tones.into_iter())
            .filter(|(_, tone)| tone.ratio > 0.0)
            .map(|(name, tone)| format!("{name} {:.3}", tone.ratio))
            .collect();
        lines.push(Line::from(format!(
            "output  {:.1} %{upper}",
            100.0 * telemetry.output
        )));
        lines.push(match seen.fault() {
            Some(fault) => Line::from(format!("fault {}: {}", fault.number(), fault.name()))
                .red()
                .bold(),
            None => Line::from("no fault"),
        });
        let held: Vec<&str> = Limits::ALL
            .iter()
            .filter(|limit| limit.bits() & telemetry.limits != 0)
            .map(|limit| limit.name())
            .collect();
        lines.push(if held.is_empty() {
            Line::from("no limit")
        } else {
            Line::from(held.join(", ")).yellow()
        });
    }
    frame.render_widget(
        Paragraph::new(lines).block(Block::bordered().title(" now ")),
        area,
    );
}

fn draw_events(frame: &mut Frame<'_>, area: Rect, history: &History) {
    let block = Block::bordered().title(" events ");
    let room = usize::from(block.inner(area).height);
    let mut lines: Vec<Line<'_>> = history
        .said()
        .rev()
        .take(room)
        .map(|(time, words)| Line::from(format!("{time:8.2} s  {words}")))
        .collect();
    lines.reverse();
    frame.render_widget(Paragraph::new(lines).block(block), area);
}

#[cfg(test)]
mod tests {
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    use super::super::{Simulation, Source};
    use super::*;
    use crate::simulate::{DEFAULT, SceneFile};

    fn shown(width: u16, height: u16, history: &History, assignment: &Assignment) -> String {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal
            .draw(|frame| draw(frame, history, assignment, "a test", false))
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
        for words in [
            "kband live",
            "target gear of order 1",
            "k against the band",
            "band of the lock",
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
