//! Readings and events through the broker mosquitto, which is killed and restarted.

use std::io::{BufRead, BufReader};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use serde_json::Value as Json;

use super::{Master, Server, TIMEOUT, register, status};

/// A process that is killed with the test.
struct Program(Child);

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn free_port() -> u16 {
    let free = TcpListener::bind("127.0.0.1:0").unwrap();
    free.local_addr().unwrap().port()
}

/// A broker that stores sessions in this folder; it accepts clients on return.
fn broker(folder: &Path, port: u16) -> Program {
    let file = folder.join("mosquitto.conf");
    let text = format!(
        "listener {port} 127.0.0.1\nallow_anonymous true\nuser root\npersistence true\n\
         persistence_location {}/\nautosave_on_changes true\nautosave_interval 1\n",
        folder.display()
    );
    std::fs::write(&file, text).unwrap();
    let mut command = Command::new("mosquitto");
    command.arg("-c").arg(file).stderr(Stdio::null());
    let program = Program(command.spawn().expect("tests/setup.sh installs it"));
    let end = Instant::now() + TIMEOUT;
    while TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert!(Instant::now() < end, "mosquitto does not listen");
        std::thread::sleep(Duration::from_millis(50));
    }
    program
}

/// A subscriber with a stored session to all topics, and its pairs of topic and message.
fn subscriber(port: u16) -> (Program, Receiver<(String, String)>) {
    let port = port.to_string();
    let mut child = Command::new("mosquitto_sub")
        .args(["-h", "127.0.0.1", "-p", &port, "-i", "reader", "-c"])
        .args(["-q", "1", "-v", "-t", "line3/#"])
        .stdout(Stdio::piped())
        .spawn()
        .expect("tests/setup.sh installs it");
    let out = BufReader::new(child.stdout.take().unwrap());
    let (sender, received) = channel();
    std::thread::spawn(move || {
        for line in out.lines().map_while(Result::ok) {
            if let Some((topic, message)) = line.split_once(' ') {
                let _ = sender.send((topic.into(), message.into()));
            }
        }
    });
    (Program(child), received)
}

/// The next message of a topic that satisfies `fits`.
#[track_caller]
fn next(received: &Receiver<(String, String)>, topic: &str, fits: impl Fn(&str) -> bool) -> String {
    loop {
        let (other, message) = received.recv_timeout(TIMEOUT).expect(topic);
        if other == format!("line3/feeder/{topic}") && fits(&message) {
            return message;
        }
    }
}

#[test]
fn readings_and_events_survive_a_broker_that_is_killed() {
    let folder = tempfile::tempdir().unwrap();
    let port = free_port();
    let first = broker(folder.path(), port);
    let (reader, received) = subscriber(port);
    let address = format!("127.0.0.1:{port}");
    let mut server = Server::start(&["--mqtt", &address, "--topic", "line3/feeder"]);
    next(&received, "status", |message| message == "online");
    let reading = |received: &Receiver<_>, state: &str| -> Json {
        let fits = |message: &str| message.contains(&format!("\"state\":\"{state}\""));
        serde_json::from_str(&next(received, "readings", fits)).unwrap()
    };
    let at_rest = reading(&received, "off");
    assert_eq!(at_rest["output"], 0.0);
    let mut plc = Master::connect(&server);
    plc.wait(status::READY_TO_START, status::RUNS);
    plc.start();
    let is = |event: &str| {
        let event = format!("\"event\":\"{event}\"");
        move |message: &str| message.contains(&event)
    };
    next(&received, "event", is("started"));
    let running = reading(&received, "holding");
    assert!(running["b"].as_f64().unwrap() > 0.05, "{running}");
    assert!(running["cycle"].as_u64() > at_rest["cycle"].as_u64());
    drop((first, reader));
    // Modbus clients are not affected. An event waits for the broker.
    plc.write(register::CONTROL, &[0]).unwrap();
    plc.wait(0, status::RUNS);
    std::thread::sleep(Duration::from_secs(2));
    let _second = broker(folder.path(), port);
    let (_reader, received) = subscriber(port);
    next(&received, "status", |message| message == "online");
    next(&received, "event", is("stopped"));
    reading(&received, "off");
    server.child.kill().unwrap();
    next(&received, "status", |message| message == "offline");
}

#[test]
fn the_farewell_of_an_orderly_end_is_offline() {
    let folder = tempfile::tempdir().unwrap();
    let port = free_port();
    let _broker = broker(folder.path(), port);
    let (_reader, received) = subscriber(port);
    let address = format!("127.0.0.1:{port}");
    let args = ["--mqtt", &address, "--topic", "line3/feeder", "--for", "3"];
    let (ended, _) = Server::start(&args).end();
    assert!(ended.success());
    next(&received, "status", |message| message == "online");
    next(&received, "status", |message| message == "offline");
}
