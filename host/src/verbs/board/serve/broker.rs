//! Connection to an MQTT broker, with reconnection.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rumqttc::{Client, Event, LastWill, MqttOptions, Packet, QoS};

use crate::refusal::Result;

/// Time before a new attempt to connect to an absent broker.
const RETRY_INTERVAL: Duration = Duration::from_secs(1);
/// Time without messages after which the client sends a keep-alive.
const KEEP_ALIVE_INTERVAL: Duration = Duration::from_secs(5);
const QUEUE_LENGTH: usize = 64;
/// Longest time for the last message at the end.
const FAREWELL_TIMEOUT: Duration = Duration::from_millis(500);

pub struct Broker {
    client: Client,
    status: String,
    connected: Arc<AtomicBool>,
}

impl Broker {
    /// Connects, and reconnects after each loss. `status` is online or, as the last will, offline.
    pub fn begin(host: &str, port: u16, status: String) -> Result<Self> {
        let name = format!("kband-{}", std::process::id());
        let mut options = MqttOptions::new(name, host, port);
        options.set_keep_alive(KEEP_ALIVE_INTERVAL);
        options.set_last_will(LastWill::new(&status, "offline", QoS::AtLeastOnce, true));
        let (client, mut connection) = Client::new(options, QUEUE_LENGTH);
        let connected = Arc::new(AtomicBool::new(false));
        let (online, own, topic) = (Arc::clone(&connected), client.clone(), status.clone());
        std::thread::spawn(move || {
            for notice in connection.iter() {
                match notice {
                    Ok(Event::Incoming(Packet::ConnAck(_))) => {
                        // The queue has room, because nothing is sent without a connection.
                        let _ = own.try_publish(&topic, QoS::AtLeastOnce, true, "online");
                        online.store(true, Ordering::Relaxed);
                    }
                    Ok(_) => {}
                    Err(_) => {
                        online.store(false, Ordering::Relaxed);
                        std::thread::sleep(RETRY_INTERVAL);
                    }
                }
            }
        });
        Ok(Self {
            client,
            status,
            connected,
        })
    }

    /// Sends a message; returns false without a connection or without room in the queue.
    pub fn send(&self, topic: &str, at_least_once: bool, message: String) -> bool {
        let quality = if at_least_once {
            QoS::AtLeastOnce
        } else {
            QoS::AtMostOnce
        };
        let publish = || self.client.try_publish(topic, quality, false, message);
        self.connected.load(Ordering::Relaxed) && publish().is_ok()
    }
}

impl Drop for Broker {
    /// Publishes that the client is offline, as the last will would.
    fn drop(&mut self) {
        let client = &self.client;
        let published = client.try_publish(&self.status, QoS::AtLeastOnce, true, "offline");
        if published.is_ok() && client.try_disconnect().is_ok() {
            let end = Instant::now() + FAREWELL_TIMEOUT;
            while self.connected.load(Ordering::Relaxed) && Instant::now() < end {
                std::thread::sleep(Duration::from_millis(10));
            }
        }
    }
}
