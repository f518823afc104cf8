//! A Black Magic Probe on a network, in front of an emulated chip.
//!
//! It implements the probe's remote protocol, version 3, and the part of SWD that detects the debug
//! port. Sources: <https://github.com/blackmagic-debug/blackmagic>, `src/remote.c`; ARM IHI 0031,
//! chapters B2 and B4.

use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::chip::Chip;

/// Identity of an STM32F4's debug port.
const PORT: u32 = 0x2ba0_1477;
const MEMORY_PORT: u32 = 0x2477_0011;
/// Power requests, granted at once.
const POWER: u32 = 0x5000_0000;
/// Interval between two checks for the end of the test.
const STOP_POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Longest message of the protocol, bytes.
const LONGEST_MESSAGE: usize = 1024;

/// The probe and its chip; dropping it ends the server.
pub struct Probe {
    address: SocketAddr,
    chip: Arc<Mutex<Chip>>,
    over: Arc<AtomicBool>,
    server: Option<JoinHandle<()>>,
}

impl Probe {
    pub fn before(chip: Chip) -> Self {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port of this machine");
        listener.set_nonblocking(true).expect("a port can be asked");
        let address = listener.local_addr().expect("the port has a number");
        let (chip, over) = (Arc::new(Mutex::new(chip)), Arc::new(AtomicBool::new(false)));
        let (its, end) = (chip.clone(), over.clone());
        let server = std::thread::spawn(move || {
            while !end.load(Ordering::Relaxed) {
                match listener.accept() {
                    // A desk may disconnect within a message.
                    Ok((stream, _)) => _ = serve(stream, &its, &end),
                    Err(_) => std::thread::sleep(STOP_POLL_INTERVAL),
                }
            }
        });
        Self {
            address,
            chip,
            over,
            server: Some(server),
        }
    }

    /// Address of the probe for a desk.
    pub fn name(&self) -> String {
        format!("1d50:6018:{}", self.address)
    }

    pub fn chip(&self) -> MutexGuard<'_, Chip> {
        lock(&self.chip)
    }
}

impl Drop for Probe {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(server) = self.server.take() {
            // The panic was already printed.
            let _ = server.join();
        }
    }
}

fn lock(chip: &Mutex<Chip>) -> MutexGuard<'_, Chip> {
    chip.lock().unwrap_or_else(PoisonError::into_inner)
}

fn serve(mut stream: TcpStream, chip: &Mutex<Chip>, over: &AtomicBool) -> std::io::Result<()> {
    stream.set_nonblocking(false)?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(STOP_POLL_INTERVAL))?;
    let (mut wire, mut port) = (Wire::default(), Port::default());
    let (mut message, mut bytes) = (Vec::new(), [0; LONGEST_MESSAGE]);
    let mut last = Instant::now();
    while !over.load(Ordering::Relaxed) {
        let passed = std::mem::replace(&mut last, Instant::now()).elapsed();
        lock(chip).run_for(passed.min(STOP_POLL_INTERVAL));
        let count = match stream.read(&mut bytes) {
            Ok(0) => return Ok(()),
            Ok(count) => count,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                continue;
            }
            Err(error) => return Err(error),
        };
        for &byte in &bytes[..count] {
            match byte {
                b'!' => message.clear(),
                b'#' => {
                    let text = String::from_utf8_lossy(&message).into_owned();
                    message.clear();
                    if text.is_empty() || text == "+" {
                        continue;
                    }
                    let answer = answer(&text, &mut wire, &mut port, &mut lock(chip));
                    let answer = answer.map_or("E1".into(), |answer| format!("K{answer}"));
                    stream.write_all(format!("&{answer}#").as_bytes())?;
                }
                byte if message.len() < 2 * LONGEST_MESSAGE => message.push(byte),
                _ => message.clear(),
            }
        }
    }
    Ok(())
}

/// Answer of the probe; `None` is an error.
fn answer(text: &str, wire: &mut Wire, port: &mut Port, chip: &mut Chip) -> Option<String> {
    let (name, rest) = text.split_at_checked(2)?;
    let mut digits = Digits(rest);
    match name {
        "GA" => Some("an emulated probe".into()),
        "HC" => Some("3".into()),
        "GF" | "GZ" | "GE" | "GP" | "SS" => Some("0".into()),
        "Gf" => Some("fa0".into()),
        "So" => {
            let count = digits.take(2)?;
            let bits = u64::from_str_radix(digits.0, 16).ok()?;
            (0..count).for_each(|bit| wire.receive(bits >> bit & 1 == 1));
            Some("0".into())
        }
        "Si" => {
            let count = digits.take(2)?;
            let sent = (0..count).map(|bit| u64::from(wire.transmit()) << bit);
            Some(format!("{:x}", sent.sum::<u64>()))
        }
        "Ad" => {
            digits.skip(4)?;
            let value = port.read(digits.take(4)?);
            Some(format!("{:08x}", value.swap_bytes()))
        }
        "AR" => {
            digits.skip(4)?;
            let (address, value) = (digits.take(4)?, digits.take(8)?);
            if address == 0x4 {
                port.control = value;
            }
            Some("0".into())
        }
        "Aa" => {
            digits.skip(2)?;
            let value = port.read_access(digits.take(2)?, digits.take(4)? & 0xff);
            Some(format!("{:08x}", value.swap_bytes()))
        }
        "AA" => {
            digits.skip(2)?;
            let (_, address) = (digits.take(2)?, digits.take(4)? & 0xff);
            port.memory.insert(address, digits.take(8)?.swap_bytes());
            Some("0".into())
        }
        "Am" => {
            digits.skip(12)?;
            let (address, length) = (digits.take(8)?, digits.take(8)? as usize);
            let mut bytes = vec![0; length.min(LONGEST_MESSAGE)];
            chip.read(address, &mut bytes)?;
            Some(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
        }
        "AM" => {
            digits.skip(12)?;
            let size = 1 << digits.take(2)?.min(2);
            let (address, length) = (digits.take(8)?, digits.take(8)?);
            let count = length.min(LONGEST_MESSAGE as u32);
            let bytes = (0..count).map(|_| digits.take(2).map(|byte| byte as u8));
            chip.write(address, size, &bytes.collect::<Option<Vec<u8>>>()?)?;
            Some("0".into())
        }
        _ => None,
    }
}

struct Digits<'a>(&'a str);

impl Digits<'_> {
    fn take(&mut self, digits: usize) -> Option<u32> {
        let (word, rest) = self.0.split_at_checked(digits)?;
        self.0 = rest;
        u32::from_str_radix(word, 16).ok()
    }

    fn skip(&mut self, digits: usize) -> Option<()> {
        self.0 = self.0.get(digits..)?;
        Some(())
    }
}

/// Acknowledgement of a request (OK), lowest bit first.
const GRANTED: u64 = 0b001;
/// Number of ones that reset the line.
const RESET: u32 = 50;
/// Number of bits in a word with its parity.
const WORD: u32 = 33;

/// The two wires of SWD. Every request is granted; a read of the identity is answered.
#[derive(Default)]
struct Wire {
    /// The last eight bits received, the newest on top.
    received: u8,
    ones: u32,
    /// Number of bits left of a word being written.
    written: u32,
    answer: u64,
}

impl Wire {
    fn receive(&mut self, bit: bool) {
        self.ones = if bit { self.ones + 1 } else { 0 };
        if self.ones >= RESET {
            (self.received, self.written) = (0, 0);
            return;
        }
        if self.written > 0 {
            self.written -= 1;
            return;
        }
        self.received = self.received >> 1 | u8::from(bit) << 7;
        // Start, port, read, two address bits, parity, stop, park.
        let even = (self.received & 0b0011_1110).count_ones().is_multiple_of(2);
        if self.received & 0b1100_0001 != 0b1000_0001 || !even {
            return;
        }
        let request = std::mem::take(&mut self.received);
        self.answer = GRANTED;
        if request & 0b100 == 0 {
            self.written = WORD;
        } else if request & 0b0001_1010 == 0 {
            let parity = u64::from(PORT.count_ones() & 1);
            self.answer |= u64::from(PORT) << 3 | parity << 35;
        }
    }

    fn transmit(&mut self) -> bool {
        let bit = self.answer & 1 == 1;
        self.answer >>= 1;
        bit
    }
}

#[derive(Default)]
struct Port {
    control: u32,
    memory: std::collections::BTreeMap<u32, u32>,
}

impl Port {
    fn read(&self, address: u32) -> u32 {
        match address {
            0x0 => PORT,
            0x4 => self.control | (self.control & POWER) << 1,
            _ => 0,
        }
    }

    fn read_access(&self, number: u32, address: u32) -> u32 {
        match (number, address) {
            (0, 0xfc) => MEMORY_PORT,
            (0, 0xf8) => 0xe00f_f003,
            (0, 0x00) => self.memory.get(&0).copied().unwrap_or(0) | 0x2300_0040,
            (0, address) => self.memory.get(&address).copied().unwrap_or(0),
            _ => 0,
        }
    }
}
