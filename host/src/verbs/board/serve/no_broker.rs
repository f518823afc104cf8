//! The client of an MQTT broker without the feature `mqtt`, which refuses every connection.

use crate::refusal::{Refusal, Result};

pub enum Broker {}

impl Broker {
    /// Always refused; the message names the feature to build with.
    pub fn begin(_host: &str, _port: u16, _status_topic: String) -> Result<Self> {
        let next = "install it with: cargo install --path host --features mqtt";
        Err(Refusal::new("this kband was built without MQTT", next))
    }

    /// Publishes a message; whether it was accepted. Never called, because no client exists.
    pub fn send(&self, _topic: &str, _at_least_once: bool, _message: String) -> bool {
        match *self {}
    }
}
