//! A board on a link behind its registers: its own server answers.

use std::time::Duration;

use kband_bus::Answer;
use kband_control::wire::{Access, Request, Response};

use super::Feeder;
use crate::board::{Address, Emulated, Link, Said, Unsolicited};
use crate::refusal::Refusal;

/// Longest wait for the board, after which the client gets an exception.
const PATIENCE: Duration = Duration::from_secs(2);
/// Exception of a gateway: the board does not answer.
const TARGET_FAILED: u8 = 0x0b;

/// The link to a board.
pub struct Gateway {
    link: Link,
    failure: Option<Refusal>,
    /// Number of the next event for [`Feeder::news`].
    next_event: u32,
    /// Whether telemetry is on.
    has_telemetry: bool,
}

impl Gateway {
    /// Opens the link.
    ///
    /// # Errors
    /// No board answers, or it runs another firmware.
    pub fn open(address: &Address) -> Result<Self, Refusal> {
        let mut link = address.open(Emulated::Running)?;
        link.wait_at_most(PATIENCE);
        Ok(Self {
            link,
            failure: None,
            next_event: 0,
            has_telemetry: false,
        })
    }

    /// Why clients only read, and what changes that; `None` where they command.
    ///
    /// # Errors
    /// The board does not answer.
    pub fn reads_only(&mut self) -> Result<Option<&'static str>, Refusal> {
        let access = self.link.status()?.map(|status| status.access);
        let mut controls = true;
        for key in ["bus", "bus_address"] {
            controls &= self.link.ask(
                &Request::Get(key),
                |response| matches!(response, Response::Setting(setting) if setting.value > 0.0),
            )?;
        }
        Ok(match access {
            _ if !controls => Some("kband settings set bus 1 and bus_address 1 let them command"),
            Some(Access::Strapped) => Some("the strap PC1 makes the link read-only"),
            Some(Access::Locked) => Some("kband unlock PIN lets them command"),
            _ => None,
        })
    }
}

impl Gateway {
    fn ask_news(&mut self, news: &mut Vec<Said>) -> Result<(), Refusal> {
        let frequency = self
            .link
            .ask(&Request::Get("frequency"), |response| match response {
                Response::Setting(setting) => setting.value,
                _ => 0.0,
            })?;
        news.push(Said::Setting("frequency".into(), frequency));
        if !self.has_telemetry {
            // A row a second.
            self.link.begin_telemetry(frequency as u16)?;
            self.has_telemetry = true;
        }
        for said in self.link.listen(Duration::ZERO)? {
            news.push(match said {
                Unsolicited::Telemetry(telemetry) => Said::Telemetry(telemetry),
                Unsolicited::Started(image) => {
                    // A board that starts has its telemetry off, and begins its log anew.
                    (self.has_telemetry, self.next_event) = (false, 0);
                    Said::Started(image)
                }
            });
        }
        while let Some(event) =
            self.link.ask(
                &Request::Event(self.next_event),
                |response| match response {
                    Response::Event(event) => event,
                    _ => None,
                },
            )?
        {
            self.next_event = event.number.wrapping_add(1);
            news.push(Said::Event(event));
        }
        Ok(())
    }
}

impl Feeder for Gateway {
    fn name(&self) -> String {
        format!("the board on {}", self.link.name())
    }

    fn answer(&mut self, adu: &[u8], answer: &mut Answer) -> bool {
        answer.clear();
        let (&[unit, function, ..], None) = (adu, &self.failure) else {
            return false;
        };
        let asked = self
            .link
            .ask(&Request::Bus(adu), |response| match response {
                Response::Bus(bytes) => answer.extend_from_slice(bytes).is_ok(),
                _ => false,
            });
        match asked {
            Ok(true) => !answer.is_empty(),
            Ok(false) => false,
            Err(refusal) => {
                // The client has the exception; a board that is gone ends the gateway.
                self.failure = self.link.is_over().then_some(refusal);
                let failed = [unit, function | 0x80, TARGET_FAILED];
                answer.extend_from_slice(&failed).is_ok()
            }
        }
    }

    fn advance(&mut self, _passed: Duration) -> Result<(), Refusal> {
        self.failure.take().map_or(Ok(()), Err)
    }

    fn news(&mut self) -> Result<Vec<Said>, Refusal> {
        let mut news = Vec::new();
        match self.ask_news(&mut news) {
            Err(refusal) if self.link.is_over() => Err(refusal),
            // A board that is silent has no news.
            _ => Ok(news),
        }
    }
}
