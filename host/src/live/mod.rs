//! The dashboard in the terminal: k against the band, the regime, the phase of the impacts, faults.

mod board;
mod history;
mod screen;
mod source;

use std::time::{Duration, Instant};

use kband_control::{State, Target};
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};

pub use board::Board;
use history::History;
use source::{Assignment, Wish};
pub use source::{Simulation, Source};

use crate::causes::CauseCache;
use crate::desk::Desk;
use crate::refusal::Refusal;

/// Time between two pictures on the screen.
const FRAME_INTERVAL: Duration = Duration::from_millis(50);

/// Step of k by the keys + and -.
const K_STEP: f32 = 0.005;

/// Speed and duration of a run.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    /// Seconds of the source for one second of the clock.
    pub speed: f64,
    /// Time after which the run ends by itself.
    pub limit: Option<Duration>,
}

/// Restores the terminal at the end of the dashboard. After a panic the hook of
/// [`ratatui::try_init`] does that.
struct Restored;

impl Drop for Restored {
    fn drop(&mut self) {
        // A second time would put the cursor over the panic's message.
        if !std::thread::panicking() {
            ratatui::restore();
        }
    }
}

/// Shows `source` until the user quits, the time is over or the source ends.
pub fn run(source: &mut dyn Source, pace: Pace, desk: &Desk) -> Result<(), Refusal> {
    let failed = |error: std::io::Error| {
        Refusal::new(
            format!("the terminal: {error}"),
            "run kband live in a terminal of at least 80 x 24",
        )
    };
    let mut terminal = ratatui::try_init().map_err(failed)?;
    let _restored = Restored;
    let mut history = History::default();
    let begun = Instant::now();
    let mut cache = CauseCache::default();
    let (mut last, mut shown) = (begun, screen::Shown::default());
    while desk.go_on().is_ok() && pace.limit.is_none_or(|limit| begun.elapsed() < limit) {
        let now = Instant::now();
        // After a sleep of the desk, the simulation does not catch up.
        let passed = (now - last).min(4 * FRAME_INTERVAL).as_secs_f64();
        last = now;
        // During a pause the link is still read; otherwise the board would detect a lost link.
        let seconds = if shown.paused {
            0.0
        } else {
            passed * pace.speed
        };
        for seen in source.advance(seconds)? {
            if !shown.paused {
                history.take(seen);
            }
        }
        let assignment = source.assignment();
        let cause = history
            .now()
            .and_then(|seen| seen.cause(&assignment, &mut cache));
        terminal
            .draw(|frame| {
                let cause = cause.as_ref();
                screen::draw(frame, &history, &assignment, cause, &source.name(), shown);
            })
            .map_err(failed)?;
        let mut wait = FRAME_INTERVAL.saturating_sub(now.elapsed());
        while event::poll(wait).map_err(failed)? {
            wait = Duration::ZERO;
            let Event::Key(key) = event::read().map_err(failed)? else {
                continue;
            };
            if key.kind != KeyEventKind::Press {
                continue;
            }
            let control = key.modifiers.contains(KeyModifiers::CONTROL);
            match key.code {
                KeyCode::Esc if shown.help => shown.help = false,
                KeyCode::Char('q') | KeyCode::Esc => return Ok(()),
                KeyCode::Char('?' | 'h') => shown.help = !shown.help,
                KeyCode::Char('c') if control => return Ok(()),
                KeyCode::Char('p' | ' ') => shown.paused = !shown.paused,
                KeyCode::Char(letter) => {
                    if let Some(wish) = wish(letter, &source.assignment(), &history)
                        && let Err(refusal) = source.obey(wish)
                    {
                        history.say(refusal.to_string().replace('\n', ";"));
                    }
                }
                _ => {}
            }
        }
    }
    Ok(())
}

/// The request of a key.
fn wish(letter: char, assignment: &Assignment, history: &History) -> Option<Wish> {
    Some(match letter {
        '1'..='8' => Wish::Target(Target::Locked {
            order: letter as u8 - b'0',
        }),
        'g' => Wish::Target(Target::Gear { order: 1 }),
        'x' => Wish::Target(Target::Chaotic),
        '+' | '=' | '-' => {
            let k = match assignment.target {
                Target::K(k) => k,
                _ => history.now()?.k_setpoint(assignment)?,
            };
            let k = if letter == '-' {
                k - K_STEP
            } else {
                k + K_STEP
            };
            // Round numbers, whatever the setpoint was.
            Wish::Target(Target::K(((k / K_STEP).round() * K_STEP).clamp(0.02, 10.0)))
        }
        'c' => Wish::Target(assignment.target),
        'e' => Wish::Enable(matches!(
            history.now()?.state(),
            State::Off | State::Stopping
        )),
        _ => return None,
    })
}
