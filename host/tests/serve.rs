//! A PLC's control of a simulated feeder, and of a board through the gateway, over Modbus TCP.

#[cfg(feature = "mqtt")]
#[path = "serve/mqtt.rs"]
mod mqtt;

mod outcome;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use kband_control::Event;
use kband_control::wire::{Request, Response};
use kband_host::board::{Address, Emulated};
use kband_machines::images;
use outcome::image;

const TIMEOUT: Duration = Duration::from_secs(60);

mod register {
    pub const CONTROL: u16 = 0;
    pub const KIND: u16 = 1;
    pub const STATUS: u16 = 4;
    pub const FAULT: u16 = 6;
    pub const SHARE_IN_GEAR: u16 = 23;
}

/// Bits of the status word.
mod status {
    pub const READY_TO_START: u16 = 1 << 0;
    pub const RUNS: u16 = 1 << 1;
    pub const FAULT: u16 = 1 << 3;
    pub const TARGET_MET: u16 = 1 << 8;
    pub const IN_CONTROL: u16 = 1 << 9;
}

struct Server {
    child: Child,
    address: String,
}

impl Server {
    fn start(arguments: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_kband"))
            .arg("serve")
            .args(arguments)
            .args(["--modbus", "127.0.0.1:0"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        out.read_line(&mut line).unwrap();
        child.stdout = Some(out.into_inner());
        let mut words = line.split([' ', ',']);
        let address = words.find(|word| word.starts_with("127.0.0.1:"));
        Self {
            address: address.unwrap_or_else(|| panic!("{line}")).to_string(),
            child,
        }
    }

    /// The gateway to the emulated board with its flash in this folder.
    fn from_board(folder: &Path) -> Self {
        let flash = folder.join("board.flash");
        let (image, flash) = (image(), flash.to_str().unwrap());
        Self::start(&["--on", "qemu", "--image", &image, "--flash-image", flash])
    }

    fn end(mut self) -> (ExitStatus, String) {
        let status = self.child.wait().unwrap();
        let mut rest = String::new();
        let mut out = self.child.stdout.take().unwrap();
        out.read_to_string(&mut rest).unwrap();
        (status, rest)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

struct Master {
    stream: TcpStream,
    transaction: u16,
}

impl Master {
    fn connect(server: &Server) -> Self {
        let stream = TcpStream::connect(&server.address).unwrap();
        stream.set_read_timeout(Some(TIMEOUT)).unwrap();
        Self {
            stream,
            transaction: 0,
        }
    }

    /// Sends a request; returns the answer after the unit, or the number of an exception.
    fn request(&mut self, request: &[u8]) -> Result<Vec<u8>, u8> {
        self.transaction += 1;
        let mut frame = self.transaction.to_be_bytes().to_vec();
        frame.extend([0, 0]);
        frame.extend((request.len() as u16 + 1).to_be_bytes());
        frame.push(1);
        frame.extend(request);
        self.stream.write_all(&frame).unwrap();
        let mut header = [0; 7];
        self.stream.read_exact(&mut header).unwrap();
        assert_eq!(header[..2], self.transaction.to_be_bytes());
        let length = usize::from(u16::from_be_bytes([header[4], header[5]])) - 1;
        let mut answer = vec![0; length];
        self.stream.read_exact(&mut answer).unwrap();
        if answer[0] & 0x80 != 0 {
            Err(answer[1])
        } else {
            Ok(answer)
        }
    }

    fn read(&mut self, address: u16) -> u16 {
        let [high, low] = address.to_be_bytes();
        let answer = self.request(&[3, high, low, 0, 1]).unwrap();
        u16::from_be_bytes([answer[2], answer[3]])
    }

    fn write(&mut self, address: u16, registers: &[u16]) -> Result<(), u8> {
        let mut request = vec![16];
        request.extend(address.to_be_bytes());
        request.extend((registers.len() as u16).to_be_bytes());
        request.push(2 * registers.len() as u8);
        request.extend(registers.iter().flat_map(|word| word.to_be_bytes()));
        self.request(&request).map(|_| ())
    }

    /// Makes a rising edge of the run bit.
    fn start(&mut self) {
        for run in [0, 1] {
            self.write(register::CONTROL, &[run]).unwrap();
        }
    }

    /// Polls until the status word has these bits set and those clear.
    fn wait(&mut self, set: u16, clear: u16) {
        let start = Instant::now();
        loop {
            let word = self.read(register::STATUS);
            if word & set == set && word & clear == 0 {
                return;
            }
            let waited = start.elapsed();
            assert!(waited < TIMEOUT, "{set:04x} {clear:04x}: {word:04x}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

#[test]
fn a_plc_reaches_gear_changes_the_target_and_clears_a_fault() {
    let folder = tempfile::tempdir().unwrap();
    let scene = outcome::kband(&folder, "simulate --print-scene").done();
    assert!(scene.contains("duration = 10.0"), "{scene}");
    let scene = scene.replace("duration = 10.0", "duration = 600.0")
        + "\n[[disturbance]]\nat = 12.0\nsensor_lost = true\n"
        + "\n[[disturbance]]\nat = 13.0\nsensor_lost = false\n";
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, scene).unwrap();
    let server = Server::start(&[path.to_str().unwrap(), "--for", "600"]);
    let mut plc = Master::connect(&server);
    // The enable input turns on 0.5 s after power-on.
    plc.wait(status::READY_TO_START | status::IN_CONTROL, status::RUNS);
    plc.start();
    plc.wait(status::RUNS | status::TARGET_MET, status::FAULT);
    let share = plc.read(register::SHARE_IN_GEAR);
    assert!(share > 5000, "in units of 0.01 %: {share}");
    // A second client reads. Its invalid requests return exceptions to it alone.
    let mut other = Master::connect(&server);
    assert_ne!(other.read(register::STATUS) & status::RUNS, 0);
    assert_eq!(other.write(register::KIND, &[99]), Err(3));
    assert_eq!(other.request(&[3, 0xff, 0xff, 0, 1]), Err(2));
    // An amplitude of 0.15 mm: kind and number in one request.
    let number = 0.15_f32.to_bits();
    let registers = [33, (number >> 16) as u16, number as u16];
    plc.write(register::KIND, &registers).unwrap();
    assert_eq!(plc.read(register::KIND), 33);
    plc.wait(status::RUNS, status::FAULT);
    // The sensor fails for 1 s.
    plc.wait(status::FAULT, status::RUNS);
    assert_eq!(plc.read(register::FAULT), 1);
    std::thread::sleep(Duration::from_secs(2));
    plc.write(register::CONTROL, &[0]).unwrap();
    plc.write(register::CONTROL, &[1 << 7]).unwrap();
    plc.wait(0, status::FAULT | status::RUNS);
    plc.start();
    plc.wait(status::RUNS, status::FAULT);
}

#[test]
fn a_run_ends_by_its_time_and_by_an_interruption() {
    let (status, rest) = Server::start(&["--for", "0.5"]).end();
    assert!(status.success(), "{status}");
    assert!(rest.contains("ended: 0 requests of 0 clients"), "{rest}");
    let server = Server::start(&[]);
    let mut plc = Master::connect(&server);
    assert_eq!(plc.read(register::FAULT), 0);
    let process = server.child.id().to_string();
    let killed = Command::new("kill").args(["-INT", &process]).status();
    assert!(killed.unwrap().success());
    let (status, rest) = server.end();
    assert!(status.success(), "{status}");
    assert!(rest.contains("ended: 1 requests of 1 clients"), "{rest}");
}

#[test]
fn an_address_in_use_is_refused() {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let folder = tempfile::tempdir().unwrap();
    let outcome = outcome::kband(&folder, &format!("serve --modbus {address}"));
    outcome.refused(&[&address, "--modbus"]);
}

/// The gateway to an emulated board with this bus authority and timeout, and its folder.
fn gateway(bus: f32, timeout: f32) -> (Server, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let address = Address {
        flash_image: Some(folder.path().join("board.flash")),
        ..Address::new("qemu", Some(Path::new(&image())))
    };
    let mut link = address.open(Emulated::AtRest).unwrap();
    for request in [
        Request::set("bus_address", 17.0),
        Request::set("bus_timeout", timeout),
        Request::set("bus", bus),
        Request::Save,
    ] {
        link.request(&request, |response| assert_eq!(response, Response::Done))
            .unwrap();
    }
    drop(link);
    (Server::from_board(folder.path()), folder)
}

#[test]
fn a_gateway_board_reaches_gear_and_detects_a_silent_bus() {
    let (server, _folder) = gateway(2.0, 2.0);
    let mut plc = Master::connect(&server);
    plc.wait(status::READY_TO_START | status::IN_CONTROL, status::RUNS);
    plc.write(register::KIND, &[1]).unwrap();
    plc.start();
    plc.wait(status::RUNS | status::TARGET_MET, status::FAULT);
    assert!(plc.read(register::SHARE_IN_GEAR) > 5000);
    // Another client shares the control word; an invalid request returns an exception of the board.
    let mut other = Master::connect(&server);
    assert_eq!(other.read(register::CONTROL), 1);
    assert_eq!(other.write(register::KIND, &[99]), Err(3));
    assert_eq!(other.request(&[3, 0xff, 0xff, 0, 1]), Err(2));
    assert_eq!(other.request(&[20, 0, 0]), Err(1));
    // Three times the board's timeout without requests; the emulator may be slower than the clock.
    let lost = |plc: &mut Master| {
        (0..8).any(|age| plc.read(1004 + 8 * age) == u16::from(Event::Limited.number()))
    };
    assert!(!lost(&mut plc));
    let end = Instant::now() + TIMEOUT;
    while !lost(&mut plc) {
        assert!(Instant::now() < end);
        std::thread::sleep(Duration::from_secs(6));
    }
    plc.wait(status::RUNS, status::FAULT);
    plc.write(register::CONTROL, &[0]).unwrap();
    plc.wait(0, status::RUNS);
}

#[test]
fn gateway_clients_only_read_a_board_whose_bus_is_off() {
    let (server, _folder) = gateway(0.0, 2.0);
    let mut plc = Master::connect(&server);
    plc.wait(0, status::IN_CONTROL);
    assert_eq!(plc.write(register::CONTROL, &[0]), Err(4));
    assert_eq!(plc.write(100, &[0x4270, 0]), Err(4));
    assert_eq!(plc.read(100), 0x4248);
}

#[test]
fn pymodbus_and_libmodbus_run_a_board_through_the_gateway() {
    let clients = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/clients");
    let (server, folder) = gateway(1.0, 60.0);
    let client = folder.path().join("client");
    let mut compiler = Command::new("gcc");
    compiler.arg(clients.join("board.c")).arg("-o").arg(&client);
    assert!(compiler.arg("-lmodbus").status().unwrap().success());
    let mut python = Command::new(images::target_folder().join("python/venv/bin/python3"));
    python.arg(clients.join("board.py"));
    for (mut command, begin) in [
        (python, "pymodbus: held"),
        (Command::new(client), "libmodbus: held"),
    ] {
        let ran = command.args([&server.address, "17"]).output().unwrap();
        let text = String::from_utf8_lossy(&ran.stdout);
        let wrong = String::from_utf8_lossy(&ran.stderr);
        assert!(text.starts_with(begin), "{text}{wrong}");
    }
}

/// The procedure of the manual: docs/registers.md and docs/recipes.md.
#[test]
fn a_commissioned_board_runs_recipe_1_after_a_power_cut() {
    let folder = tempfile::tempdir().unwrap();
    let kband = |args: &str| {
        let flash = ["--flash-image", "board.flash"];
        outcome::on_board(&folder, outcome::TIMEOUT, args, &flash).done()
    };
    kband("commission line3.html --step found --seconds 1");
    kband("settings save");
    let recipe = "recipes = 1\n\n[[recipe]]\nnumber = 1\nname = \"caps\"\n\
                  target = \"k\"\nvalue = 0.8\n\
                  restitution_low = 0.18\nrestitution_high = 0.22\nscatter = 0.05\n\
                  tangential_restitution = 0.3\nsoft_start = 0.5\nsoft_stop = 0.4\n";
    std::fs::write(folder.path().join("recipes.toml"), recipe).unwrap();
    kband("recipe import recipes.toml");
    for setting in ["bus_timeout 60", "bus_address 17", "bus 1"] {
        kband(&format!("settings set {setting} --save"));
    }
    kband("commission line3.html --step left --seconds 1");
    for _ in 0..2 {
        let server = Server::from_board(folder.path());
        let (_, port) = server.address.split_once(':').unwrap();
        let write = |register: &str, value: &str| {
            let ran = Command::new("mbpoll")
                .args(["-m", "tcp", "-p", port, "-a", "17", "-0", "-1", "-q"])
                .args(["-o", "5", "-r", register, "127.0.0.1", value])
                .output()
                .unwrap();
            assert!(ran.status.success(), "{ran:?}");
        };
        let mut plc = Master::connect(&server);
        plc.wait(status::READY_TO_START | status::IN_CONTROL, status::RUNS);
        assert_eq!(plc.read(8), 0, "the saved target");
        write("8", "1");
        write("0", "0");
        write("0", "1");
        plc.wait(status::RUNS | status::TARGET_MET, status::FAULT);
        assert_eq!((plc.read(8), plc.read(register::KIND)), (1, 32));
        // Ending the gateway also ends the emulator: the power cut.
        drop(server);
    }
}
