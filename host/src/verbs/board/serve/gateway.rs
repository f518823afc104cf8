//! Gateway from Modbus TCP to a board on a link: the board's own server answers.

use std::time::Duration;

use kband_bus::Answer;
use kband_control::wire::{Access, Request, Response};

use super::Feeder;
use crate::board::{Address, BoardMessage, Emulated, Link};
use crate::refusal::{Refusal, Result};

/// Longest wait for the board; then the client receives an exception.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(2);
/// Exception code of a gateway: the board does not answer.
const TARGET_FAILED: u8 = 0x0b;

pub struct Gateway {
    link: Link,
    failure: Option<Refusal>,
    next_event: u32,
    has_telemetry: bool,
}

impl Gateway {
    /// Opens the link; refused if no board answers, or if it runs another firmware.
    pub fn open(address: &Address) -> Result<Self> {
        let mut link = address.open(Emulated::Running)?;
        link.set_answer_timeout(ANSWER_TIMEOUT);
        Ok(Self {
            link,
            failure: None,
            next_event: 0,
            has_telemetry: false,
        })
    }

    /// Reason why clients can only read, and its remedy; `None` if they can command.
    pub fn reads_only(&mut self) -> Result<Option<&'static str>> {
        let access = self.link.status()?.map(|status| status.access);
        let mut controls = true;
        for key in ["bus", "bus_address"] {
            controls &= self.link.request(
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

    fn request_news(&mut self, news: &mut Vec<BoardMessage>) -> Result<()> {
        let request = Request::Get("frequency");
        let frequency = self.link.request(&request, |response| match response {
            Response::Setting(setting) => setting.value,
            _ => 0.0,
        })?;
        news.push(BoardMessage::Setting("frequency".into(), frequency));
        if !self.has_telemetry {
            // One row a second.
            self.link.begin_telemetry(frequency as u16)?;
            self.has_telemetry = true;
        }
        for message in self.link.listen(Duration::ZERO)? {
            if let BoardMessage::Started(_) = message {
                // A board starts with its telemetry off and an empty log.
                (self.has_telemetry, self.next_event) = (false, 0);
            }
            news.push(message);
        }
        loop {
            let request = Request::Event(self.next_event);
            let message = self.link.request(&request, BoardMessage::from_response)?;
            let Some(BoardMessage::Event(event)) = message else {
                return Ok(());
            };
            self.next_event = event.number.wrapping_add(1);
            news.push(BoardMessage::Event(event));
        }
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
        let request = Request::Bus(adu);
        let result = self.link.request(&request, |response| match response {
            Response::Bus(bytes) => answer.extend_from_slice(bytes).is_ok(),
            _ => false,
        });
        match result {
            Ok(true) => !answer.is_empty(),
            Ok(false) => false,
            Err(refusal) => {
                // The client receives an exception; a closed link ends the gateway.
                self.failure = self.link.is_over().then_some(refusal);
                let failed = [unit, function | 0x80, TARGET_FAILED];
                answer.extend_from_slice(&failed).is_ok()
            }
        }
    }

    fn advance(&mut self, _passed: Duration) -> Result<()> {
        self.failure.take().map_or(Ok(()), Err)
    }

    fn news(&mut self) -> Result<Vec<BoardMessage>> {
        let mut news = Vec::new();
        match self.request_news(&mut news) {
            Err(refusal) if self.link.is_over() => Err(refusal),
            // A silent board has no news.
            _ => Ok(news),
        }
    }
}
