//! A debug probe on a network, in front of an emulated chip: a Black Magic Probe.
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
/// Identity of its memory access port.
const MEMORY_PORT: u32 = 0x2477_0011;
/// Power requests, granted at once.
const POWER: u32 = 0x5000_0000;
/// Interval between two checks for the end of the test.
const LOOK: Duration = Duration::from_millis(20);
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
    /// Starts a probe in front of a chip.
    ///
    /// # Panics
    /// There is no network, not even to this machine.
    pub fn before(chip: Chip) -> Self {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port of this machine");
        listener.set_nonblocking(true).expect("a port can be asked");
        let address = listener.local_addr().expect("the port has a number");
        let (chip, over) = (Arc::new(Mutex::new(chip)), Arc::new(AtomicBool::new(false)));
        let (its, end) = (chip.clone(), over.clone());
        let server = std::thread::spawn(move || {
            while !end.load(Ordering::Relaxed) {
                match listener.accept() {
                    // A desk that disconnects within a message is no fault of the probe.
                    Ok((stream, _)) => _ = serve(stream, &its, &end),
                    Err(_) => std::thread::sleep(LOOK),
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

    /// The chip.
    pub fn chip(&self) -> MutexGuard<'_, Chip> {
        self.chip.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Probe {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(server) = self.server.take() {
            // Its panic was printed already.
            let _ = server.join();
        }
    }
}

fn serve(mut stream: TcpStream, chip: &Mutex<Chip>, over: &AtomicBool) -> std::io::Result<()> {
    stream.set_nonblocking(false)?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(LOOK))?;
    let (mut wire, mut port) = (Wire::default(), Port::default());
    let (mut message, mut bytes) = (Vec::new(), [0; LONGEST_MESSAGE]);
    let mut last = Instant::now();
    while !over.load(Ordering::Relaxed) {
        let passed = std::mem::replace(&mut last, Instant::now()).elapsed();
        chip.lock()
            .unwrap_or_else(PoisonError::into_inner)
            .run_for(passed.min(LOOK));
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
                    let mut chip = chip.lock().unwrap_or_else(PoisonError::into_inner);
                    let answer = answer(&text, &mut wire, &mut port, &mut chip);
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
    let mut words = Words(rest);
    match name {
        "GA" => Some("an emulated probe".into()),
        "HC" => Some("3".into()),
        "GF" | "GZ" | "GE" | "GP" | "SS" => Some("0".into()),
        "Gf" => Some("fa0".into()),
        "So" => {
            let count = words.take(2)?;
            let bits = u64::from_str_radix(words.0, 16).ok()?;
            (0..count).for_each(|bit| wire.hears(bits >> bit & 1 == 1));
            Some("0".into())
        }
        "Si" => {
            let count = words.take(2)?;
            let said = (0..count).map(|bit| u64::from(wire.says()) << bit);
            Some(format!("{:x}", said.sum::<u64>()))
        }
        "Ad" => {
            words.skip(4)?;
            let value = port.read(words.take(4)?);
            Some(format!("{:08x}", value.swap_bytes()))
        }
        "AR" => {
            words.skip(4)?;
            let (address, value) = (words.take(4)?, words.take(8)?);
            if address == 0x4 {
                port.control = value;
            }
            Some("0".into())
        }
        "Aa" => {
            words.skip(2)?;
            let value = port.read_access(words.take(2)?, words.take(4)? & 0xff);
            Some(format!("{:08x}", value.swap_bytes()))
        }
        "AA" => {
            words.skip(2)?;
            let (_, address) = (words.take(2)?, words.take(4)? & 0xff);
            port.memory.insert(address, words.take(8)?.swap_bytes());
            Some("0".into())
        }
        "Am" => {
            words.skip(12)?;
            let (address, length) = (words.take(8)?, words.take(8)? as usize);
            let mut bytes = vec![0; length.min(LONGEST_MESSAGE)];
            chip.read(address, &mut bytes)?;
            Some(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
        }
        "AM" => {
            words.skip(12)?;
            let size = 1 << words.take(2)?.min(2);
            let (address, length) = (words.take(8)?, words.take(8)?);
            let bytes: Option<Vec<u8>> = (0..length.min(LONGEST_MESSAGE as u32))
                .map(|_| words.take(2).map(|byte| byte as u8))
                .collect();
            chip.write(address, size, &bytes?)?;
            Some("0".into())
        }
        _ => None,
    }
}

/// Successive numbers in hexadecimal digits.
struct Words<'a>(&'a str);

impl Words<'_> {
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
    heard: u8,
    /// Number of successive ones.
    ones: u32,
    /// Number of bits left of a word being written.
    written: u32,
    /// Bits to be sent.
    answer: u64,
}

impl Wire {
    fn hears(&mut self, bit: bool) {
        self.ones = if bit { self.ones + 1 } else { 0 };
        if self.ones >= RESET {
            (self.heard, self.written) = (0, 0);
            return;
        }
        if self.written > 0 {
            self.written -= 1;
            return;
        }
        self.heard = self.heard >> 1 | u8::from(bit) << 7;
        // Start, port, read, two address bits, parity, stop, park.
        let even = (self.heard & 0b0011_1110).count_ones().is_multiple_of(2);
        if self.heard & 0b1100_0001 != 0b1000_0001 || !even {
            return;
        }
        let request = std::mem::take(&mut self.heard);
        self.answer = GRANTED;
        if request & 0b100 == 0 {
            self.written = WORD;
        } else if request & 0b0001_1010 == 0 {
            let parity = u64::from(PORT.count_ones() & 1);
            self.answer |= u64::from(PORT) << 3 | parity << 35;
        }
    }

    fn says(&mut self) -> bool {
        let bit = self.answer & 1 == 1;
        self.answer >>= 1;
        bit
    }
}

/// The debug port, and the access port to the memory behind it.
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
