//! A headless browser by the W3C WebDriver protocol: HTTP with JSON to Chromium's driver.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value as Json, json};

/// Longest wait for the driver, or for a request to a page.
const WAIT_TIMEOUT: Duration = Duration::from_secs(60);
/// Key of an element reference in the protocol (WebDriver, section 12).
const ELEMENT: &str = "element-6066-11e4-a52e-4f735466cecf";

/// Keys without a character (WebDriver, section 17.4.2).
pub mod keys {
    pub const END: char = '\u{E010}';
    pub const HOME: char = '\u{E011}';
    pub const LEFT: char = '\u{E012}';
    pub const RIGHT: char = '\u{E014}';
}

/// The browser; dropping it terminates the process.
pub struct Browser {
    driver: Child,
    port: u16,
    session: String,
}

impl Browser {
    pub fn start() -> Self {
        let mut driver = Command::new("chromedriver")
            .args(["--port=0"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("chromedriver starts; it is the package chromium-driver, which tests/setup.sh installs");
        let output = driver.stdout.take().expect("its output is a pipe");
        let mut lines = BufReader::new(output).lines();
        let port = lines.by_ref().map_while(Result::ok).find_map(|line| {
            let (_, port) = line.split_once("successfully on port ")?;
            port.trim_end_matches('.').parse().ok()
        });
        // Reads further output, so the pipe cannot fill up.
        std::thread::spawn(move || lines.count());
        let mut browser = Self {
            driver,
            port: port.expect("chromedriver names its port"),
            session: String::new(),
        };
        let options = [
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--hide-scrollbars",
        ];
        let made = browser.post(
            "/session",
            &json!({"capabilities": {"alwaysMatch": {
                "goog:chromeOptions": {"args": options},
                "goog:loggingPrefs": {"browser": "ALL"},
            }}}),
        );
        let session = made["sessionId"].as_str().expect("a session has a name");
        browser.session = format!("/session/{session}");
        browser
    }

    /// Opens a file and waits until its script, if any, has set `data-ready` or `data-failed` on
    /// the page.
    pub fn open(&self, file: &Path) {
        let url = format!("file://{}", file.display());
        self.command("/url", &json!({ "url": url }));
        self.wait_for(
            "document.scripts.length === 0 || Object.keys(document.documentElement.dataset).length > 0",
        );
    }

    pub fn wait_for(&self, condition: &str) {
        let end = Instant::now() + WAIT_TIMEOUT;
        while self.script(&format!("return {condition}")) != true {
            assert!(Instant::now() < end, "never on the page: {condition}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    pub fn script(&self, script: &str) -> Json {
        self.command("/execute/sync", &json!({"script": script, "args": []}))
    }

    pub fn text(&self, selector: &str) -> String {
        let path = format!("{}/element/{}/text", self.session, self.element(selector));
        let text = self.exchange("GET", &path, "");
        text.as_str().expect("a text").into()
    }

    pub fn press(&self, selector: &str, keys: &str) {
        let path = format!("/element/{}/value", self.element(selector));
        self.command(&path, &json!({ "text": keys }));
    }

    pub fn click(&self, selector: &str) {
        let element = self.element(selector);
        self.command(&format!("/element/{element}/click"), &json!({}));
    }

    /// Moves the pointer to `x` pixels right of and `y` below the centre of an element.
    pub fn point(&self, selector: &str, x: i32, y: i32) {
        let origin = json!({ ELEMENT: self.element(selector) });
        let moved = json!({"type": "pointerMove", "duration": 0, "x": x, "y": y, "origin": origin});
        let pointer = json!({"type": "pointer", "id": "mouse", "actions": [moved]});
        self.command("/actions", &json!({ "actions": [pointer] }));
    }

    pub fn resize(&self, width: u32, height: u32) {
        self.command("/window/rect", &json!({"width": width, "height": height}));
    }

    /// The printed page as base64 of a PDF.
    pub fn print(&self) -> String {
        let pdf = self.command("/print", &json!({}));
        pdf.as_str().expect("a PDF").into()
    }

    /// Warnings and errors in the browser's log.
    pub fn errors(&self) -> Vec<String> {
        let log = self.command("/se/log", &json!({"type": "browser"}));
        let entries = log.as_array().into_iter().flatten();
        entries.map(|entry| entry["message"].to_string()).collect()
    }

    fn element(&self, selector: &str) -> String {
        let query = json!({"using": "css selector", "value": selector});
        let element = self.command("/element", &query);
        let element = element[ELEMENT].as_str().map(str::to_owned);
        element.unwrap_or_else(|| panic!("no {selector} on the page"))
    }

    fn command(&self, path: &str, body: &Json) -> Json {
        self.post(&format!("{}{path}", self.session), body)
    }

    fn post(&self, path: &str, body: &Json) -> Json {
        self.exchange("POST", path, &body.to_string())
    }

    fn send(&self, method: &str, path: &str, body: &str) -> std::io::Result<TcpStream> {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port))?;
        stream.set_read_timeout(Some(WAIT_TIMEOUT))?;
        let length = body.len();
        let request = format!(
            "{method} {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n\
            Content-Length: {length}\r\nConnection: close\r\n\r\n{body}",
        );
        stream.write_all(request.as_bytes())?;
        Ok(stream)
    }

    /// Value of a response; panics with the message of a driver error.
    fn exchange(&self, method: &str, path: &str, body: &str) -> Json {
        let sent = self.send(method, path, body);
        let mut reader = BufReader::new(sent.expect("the driver reads"));
        let head = reader.by_ref().lines().map_while(Result::ok);
        head.take_while(|line| !line.is_empty()).for_each(drop);
        let mut answers = serde_json::Deserializer::from_reader(reader).into_iter::<Json>();
        let answer = answers.next().and_then(Result::ok);
        let value = answer.expect("the driver's answer is JSON")["value"].take();
        let (error, message) = (&value["error"], &value["message"]);
        assert!(error.is_null(), "{error}: {message}");
        value
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // The driver closes the browser; without a driver the browser has ended, too.
        if let Ok(mut stream) = self.send("DELETE", &self.session, "") {
            let _ = stream.read(&mut [0; 64]);
        }
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}
