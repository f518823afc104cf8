//! A simulated feeder behind the registers.

use std::time::Duration;

use kband_bus::{Answer, Machine, Server};

use super::Feeder;
use super::drive::Drive;
use crate::board::Said;
use crate::refusal::Refusal;

/// A simulated feeder and its server: the edges of its control word are those of all clients.
pub struct Simulated {
    drive: Drive,
    server: Server,
    /// Number of the next event for [`Feeder::news`].
    next_event: u32,
}

impl Simulated {
    /// Serves this feeder.
    pub fn new(drive: Drive) -> Self {
        Self {
            drive,
            server: Server::default(),
            next_event: 0,
        }
    }
}

impl Feeder for Simulated {
    fn name(&self) -> String {
        "a simulated feeder".into()
    }

    fn answer(&mut self, adu: &[u8], answer: &mut Answer) -> bool {
        let answered = self.server.answer(adu, &mut self.drive, answer);
        if answered {
            self.drive.record_request();
        }
        answered
    }

    fn advance(&mut self, passed: Duration) -> Result<(), Refusal> {
        self.drive.advance(passed.as_secs_f64());
        Ok(())
    }

    fn news(&mut self) -> Result<Vec<Said>, Refusal> {
        let frequency = self.drive.settings().frequency;
        let begin = [
            Said::Setting("frequency".into(), frequency),
            Said::Telemetry(self.drive.seen().telemetry),
        ];
        let events =
            (self.next_event..self.drive.seen().events).filter_map(|n| self.drive.event(n));
        let news = begin.into_iter().chain(events.map(Said::Event)).collect();
        self.next_event = self.drive.seen().events;
        Ok(news)
    }
}
