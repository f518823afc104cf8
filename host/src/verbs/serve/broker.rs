//! The connection to an MQTT broker, which is tried again while the broker is away.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rumqttc::{Client, Event, LastWill, MqttOptions, Packet, QoS};

use crate::refusal::Refusal;

/// Time after which a broker that is away is tried again.
const RETRY_INTERVAL: Duration = Duration::from_secs(1);
/// Silence after which the client shows that it is alive.
const KEEP_ALIVE: Duration = Duration::from_secs(5);
const QUEUE: usize = 64;
/// Longest time that the farewell takes.
const FAREWELL: Duration = Duration::from_millis(500);

/// A client of a broker.
pub struct Broker {
    client: Client,
    /// Topic that says whether the client is there.
    status: String,
    connected: Arc<AtomicBool>,
}

impl Broker {
    /// Connects to a broker, and again whenever it is away. The topic `status` is online or, as the
    /// last will, offline.
    pub fn begin(host: &str, port: u16, status: String) -> Result<Self, Refusal> {
        let name = format!("kband-{}", std::process::id());
        let mut options = MqttOptions::new(name, host, port);
        options.set_keep_alive(KEEP_ALIVE);
        options.set_last_will(LastWill::new(&status, "offline", QoS::AtLeastOnce, true));
        let (client, mut connection) = Client::new(options, QUEUE);
        let connected = Arc::new(AtomicBool::new(false));
        let (online, own, topic) = (Arc::clone(&connected), client.clone(), status.clone());
        std::thread::spawn(move || {
            for notice in connection.iter() {
                match notice {
                    Ok(Event::Incoming(Packet::ConnAck(_))) => {
                        // There is room: nothing is sent without a connection.
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

    /// Sends a message, once at least or at most; returns false where there is no connection or no
    /// room.
    pub fn send(&self, topic: &str, at_least_once: bool, message: String) -> bool {
        let quality = if at_least_once {
            QoS::AtLeastOnce
        } else {
            QoS::AtMostOnce
        };
        self.connected.load(Ordering::Relaxed)
            && (self.client)
                .try_publish(topic, quality, false, message)
                .is_ok()
    }
}

impl Drop for Broker {
    /// Says that the client is offline, as the last will would.
    fn drop(&mut self) {
        let Self {
            client,
            status,
            connected,
        } = self;
        let said = client.try_publish(&*status, QoS::AtLeastOnce, true, "offline");
        if said.is_ok() && client.try_disconnect().is_ok() {
            let end = Instant::now() + FAREWELL;
            while connected.load(Ordering::Relaxed) && Instant::now() < end {
                std::thread::sleep(Duration::from_millis(10));
            }
        }
    }
}
