//! The client of an MQTT broker without the feature `mqtt`: the interface of `broker`, which
//! refuses every connection.

use crate::refusal::Refusal;

/// A client that cannot exist.
pub enum Broker {}

impl Broker {
    /// Always refused; the message names the feature to build with.
    pub fn begin(_host: &str, _port: u16, _status: String) -> Result<Self, Refusal> {
        Err(Refusal::new(
            "this kband was built without MQTT",
            "install it with: cargo install --path host --features mqtt",
        ))
    }

    /// Never called, because no client exists.
    pub fn send(&self, _topic: &str, _at_least_once: bool, _message: String) -> bool {
        match *self {}
    }
}
