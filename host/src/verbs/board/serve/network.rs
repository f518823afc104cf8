//! Modbus TCP server: one thread accepts connections, and each client has its own.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use kband_bus::{Answer, tcp};

use super::Feeder;

/// Largest number of simultaneous clients; a further connection is closed at once.
const MAX_CLIENTS: usize = 16;
/// Time between two checks of a thread for the end of the run.
const STOP_POLL_INTERVAL: Duration = Duration::from_millis(100);

/// The feeder behind the server, shared by all clients, with the numbers of clients and requests.
pub struct Shared {
    feeder: Mutex<Box<dyn Feeder>>,
    pub clients: AtomicUsize,
    pub requests: AtomicUsize,
    connected: AtomicUsize,
    ended: AtomicBool,
}

impl Shared {
    pub fn new(feeder: Box<dyn Feeder>) -> Self {
        Self {
            feeder: Mutex::new(feeder),
            clients: AtomicUsize::new(0),
            requests: AtomicUsize::new(0),
            connected: AtomicUsize::new(0),
            ended: AtomicBool::new(false),
        }
    }

    /// Calls `work` with exclusive access to the feeder.
    pub fn with<T>(&self, work: impl FnOnce(&mut dyn Feeder) -> T) -> T {
        work(&mut **self.feeder.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Ends all threads within [`STOP_POLL_INTERVAL`].
    pub fn stop(&self) {
        self.ended.store(true, Ordering::Relaxed);
    }

    fn is_over(&self) -> bool {
        self.ended.load(Ordering::Relaxed)
    }
}

/// Accepts clients in a separate thread; returns the local address.
pub fn accept(listener: TcpListener, shared: &Arc<Shared>) -> std::io::Result<SocketAddr> {
    let address = listener.local_addr()?;
    listener.set_nonblocking(true)?;
    let shared = Arc::clone(shared);
    std::thread::spawn(move || {
        while !shared.is_over() {
            match listener.accept() {
                Ok((stream, _)) if shared.connected.load(Ordering::Relaxed) < MAX_CLIENTS => {
                    shared.connected.fetch_add(1, Ordering::Relaxed);
                    shared.clients.fetch_add(1, Ordering::Relaxed);
                    let shared = Arc::clone(&shared);
                    std::thread::spawn(move || {
                        // A lost client does not affect the others.
                        let _ = serve(stream, &shared);
                        shared.connected.fetch_sub(1, Ordering::Relaxed);
                    });
                }
                Ok(_) => {}
                Err(_) => std::thread::sleep(STOP_POLL_INTERVAL),
            }
        }
    });
    Ok(address)
}

/// Answers one client until it closes, sends an invalid frame, or the run is over.
fn serve(mut stream: TcpStream, shared: &Shared) -> std::io::Result<()> {
    stream.set_nonblocking(false)?;
    stream.set_read_timeout(Some(STOP_POLL_INTERVAL))?;
    stream.set_write_timeout(Some(STOP_POLL_INTERVAL))?;
    stream.set_nodelay(true)?;
    let mut waiting = Vec::new();
    let mut bytes = [0; 512];
    let mut answer = Answer::new();
    while !shared.is_over() {
        match stream.read(&mut bytes) {
            Ok(0) => break,
            Ok(count) => waiting.extend_from_slice(&bytes[..count]),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(error) => return Err(error),
        }
        loop {
            let Ok(length) = tcp::frame_length(&waiting) else {
                return Ok(());
            };
            let Some(length) = length.filter(|length| waiting.len() >= *length) else {
                break;
            };
            let frame: Vec<u8> = waiting.drain(..length).collect();
            let adu = &frame[tcp::HEADER_BYTES..];
            let answered = shared.with(|feeder| feeder.answer(adu, &mut answer));
            shared
                .requests
                .fetch_add(answered.into(), Ordering::Relaxed);
            if answered && tcp::wrap(&frame, &mut answer) {
                stream.write_all(&answer)?;
            }
        }
    }
    Ok(())
}
