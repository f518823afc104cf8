//! Without the feature `mqtt` there is no connection to a broker.

use crate::refusal::Refusal;

/// No client.
pub enum Broker {}

impl Broker {
    /// Refused.
    pub fn begin(_host: &str, _port: u16, _status: String) -> Result<Self, Refusal> {
        Err(Refusal::new(
            "this kband was built without MQTT",
            "build it with it: cargo install --path host --features mqtt",
        ))
    }

    /// Never called: there is no client.
    pub fn send(&self, _topic: &str, _at_least_once: bool, _message: String) -> bool {
        match *self {}
    }
}
