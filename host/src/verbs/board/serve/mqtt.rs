//! Publication of readings and events to an MQTT broker.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use serde_json::Value as Json;

use super::Feeder;
use super::broker::Broker;
use crate::board::BoardMessage;
use crate::refusal::{Refusal, Result};
use crate::report::Value;
use crate::stream;
use crate::verbs::board::monitor::{Row, columns};

const INTERVAL: Duration = Duration::from_secs(1);
/// Largest number of events that wait for a broker; beyond it the oldest one is dropped.
const MAX_EVENTS: usize = 1000;

pub struct Publisher {
    broker: Broker,
    topic: String,
    row: Row,
    events: VecDeque<Json>,
    last: Option<Instant>,
}

impl Publisher {
    /// Connects to the broker at `address` (HOST:PORT), and reconnects after each loss.
    /// Refused if address or topic is invalid.
    pub fn begin(address: &str, topic: &str) -> Result<Self> {
        let (host, port) = split(address)?;
        if topic.is_empty() || topic.contains(['+', '#', '\0']) {
            let value = format!("{topic:?}");
            let accepted = "a name with levels, without + and #";
            let next = "--topic line3/feeder";
            return Err(Refusal::value("--topic", value, accepted, next));
        }
        let broker = Broker::begin(host, port, format!("{topic}/status"))?;
        Ok(Self {
            broker,
            topic: topic.into(),
            row: Row::default(),
            events: VecDeque::new(),
            last: None,
        })
    }

    /// Publishes a reading, at most once a second, and new events.
    pub fn publish(&mut self, feeder: &mut dyn Feeder) -> Result<()> {
        if self.last.is_some_and(|last| last.elapsed() < INTERVAL) {
            return Ok(());
        }
        self.last = Some(Instant::now());
        let mut reading = None;
        for message in feeder.news()? {
            match message {
                BoardMessage::Setting(_, frequency) => self.row.set_frequency(frequency),
                BoardMessage::Telemetry(telemetry) => {
                    reading = Some(object(&self.row.cycle(&telemetry)))
                }
                BoardMessage::Event(record) => {
                    self.events.push_back(object(&self.row.event(&record)))
                }
                BoardMessage::Started(image) => {
                    self.events.push_back(object(&self.row.start(&image)))
                }
            }
        }
        while self.events.len() > MAX_EVENTS {
            self.events.pop_front();
        }
        while let Some(event) = self.events.front()
            && self.send("event", true, event)
        {
            self.events.pop_front();
        }
        if let Some(reading) = reading {
            // An unsent reading is dropped, because it is obsolete after 1 s.
            self.send("readings", false, &reading);
        }
        Ok(())
    }

    fn send(&self, name: &str, at_least_once: bool, message: &Json) -> bool {
        let topic = format!("{}/{name}", self.topic);
        self.broker.send(&topic, at_least_once, message.to_string())
    }
}

fn object(row: &[Value]) -> Json {
    stream::object(&columns(), row)
}

fn split(address: &str) -> Result<(&str, u16)> {
    let parts = address.rsplit_once(':');
    let parts = parts.and_then(|(host, port)| Some((host, port.parse().ok()?)));
    match parts {
        Some((host, port)) if !host.is_empty() && port > 0 => {
            Ok((host.trim_matches(['[', ']']), port))
        }
        _ => Err(Refusal::value(
            "--mqtt",
            address,
            "a host and a port",
            "--mqtt 127.0.0.1:1883",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// tests/wrong_inputs.txt has what is refused, except what a line of words cannot hold.
    #[test]
    fn an_address_is_a_host_and_a_port_and_a_topic_has_a_name() {
        assert_eq!(split("broker.plant:1883"), Ok(("broker.plant", 1883)));
        assert_eq!(split("[::1]:8883"), Ok(("::1", 8883)));
        assert!(split("").is_err() && Publisher::begin("127.0.0.1:1", "").is_err());
    }
}
