//! A board, or the emulated CPU, as source of the dashboard.

use std::time::{Duration, Instant};

use kband_control::Event;
use kband_control::wire::{Record, Request, Response, Telemetry};

use super::source::{Assignment, Seen, Source, Wish};
use crate::board::{BoardSettings, Clock, Link, Unsolicited};
use crate::refusal::Refusal;

/// Time between two reads of the event log; to the board they are also signs of life.
const LOG_POLL_INTERVAL: Duration = Duration::from_millis(200);
/// Longest wait for a response; longer ones would delay the keys.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(3);
/// Largest number of telemetry rows per second, for the link's rate.
const MAX_TELEMETRY_RATE: f32 = 60.0;

/// A board on the link.
pub struct Board {
    link: Link,
    assignment: Assignment,
    clock: Clock,
    /// Drive cycles between two rows of telemetry.
    every: u16,
    next: u32,
    looked: Option<Instant>,
}

impl Board {
    /// The board at the end of `link`, with its telemetry switched on.
    pub fn start(mut link: Link) -> Result<Self, Refusal> {
        let settings = BoardSettings::read(&mut link)?.known();
        link.wait_at_most(ANSWER_TIMEOUT);
        let target = link.held()?;
        let mut board = Self {
            link,
            assignment: Assignment { settings, target },
            clock: Clock::default(),
            every: (settings.frequency / MAX_TELEMETRY_RATE).ceil().max(1.0) as u16,
            next: 0,
            looked: None,
        };
        board.listen_to_cycles()?;
        Ok(board)
    }

    fn listen_to_cycles(&mut self) -> Result<(), Refusal> {
        self.link.begin_telemetry(self.every)
    }

    fn seen(&mut self, telemetry: Telemetry) -> Seen {
        let cycles = self.clock.now(telemetry.cycle);
        Seen {
            time: cycles as f64 / f64::from(self.assignment.settings.frequency),
            telemetry,
            strikes: Vec::new(),
            way: None,
            events: Vec::new(),
        }
    }

    /// New records of the event log; the board keeps at most 64.
    fn log(&mut self) -> Result<Vec<Record>, Refusal> {
        let mut records = Vec::new();
        for _ in 0..64 {
            let record = self
                .link
                .ask(&Request::Event(self.next), |response| match response {
                    Response::Event(record) => record,
                    _ => None,
                })?;
            let Some(record) = record else { break };
            self.next = record.number.wrapping_add(1);
            records.push(record);
        }
        Ok(records)
    }
}

impl Source for Board {
    fn name(&self) -> String {
        self.link.name().into()
    }

    fn assignment(&self) -> Assignment {
        self.assignment
    }

    /// The received cycles; a board has its own time.
    fn advance(&mut self, _seconds: f64) -> Result<Vec<Seen>, Refusal> {
        let mut cycles = Vec::new();
        for said in self.link.listen(Duration::ZERO)? {
            match said {
                Unsolicited::Telemetry(telemetry) => cycles.push(self.seen(telemetry)),
                Unsolicited::Started(_) => {
                    self.next = 0;
                    self.clock = Clock::default();
                    self.assignment.settings = BoardSettings::read(&mut self.link)?.known();
                    self.assignment.target = self.link.held()?;
                    self.listen_to_cycles()?;
                }
            }
        }
        if self
            .looked
            .is_none_or(|looked| looked.elapsed() > LOG_POLL_INTERVAL)
            && let Some(last) = cycles.last_mut()
        {
            self.looked = Some(Instant::now());
            for record in self.log()? {
                last.events.extend(Event::numbered(record.event));
            }
            if last.events.contains(&Event::TargetSet) {
                self.assignment.target = self.link.held()?;
            }
        }
        Ok(cycles)
    }

    fn obey(&mut self, wish: Wish) -> Result<(), Refusal> {
        match wish {
            Wish::Target(target) => {
                self.link.tell(&Request::Target(target))?;
                self.assignment.target = target;
                Ok(())
            }
            Wish::Enable(enable) => self.link.tell(&Request::Enable(enable)),
        }
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        // A failure means that the board has gone.
        let _ = self.link.tell(&Request::Telemetry(0));
    }
}
