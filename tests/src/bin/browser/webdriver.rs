//! A browser over the W3C WebDriver protocol: chromedriver, and the few of its commands
//! that the test needs.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use anyhow::{Context as _, Result, ensure};
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use serde::Deserialize;
use serde_json::{Value, json};

/// The longest that a page may take to load, or the browser to answer. Printing takes some seconds, and
/// two minutes beside other work on all cores.
const PATIENCE: Duration = Duration::from_secs(300);

/// One window of a browser; both it and its driver end with this.
pub struct Browser {
    driver: Child,
    agent: ureq::Agent,
    session: String,
}

/// A line of the browser's console.
#[derive(Deserialize)]
struct LogEntry {
    /// "SEVERE", "WARNING", "INFO" or "DEBUG".
    level: String,
    /// Who wrote it: "console-api", "javascript", "network" and others.
    source: String,
    /// What it says, with its place.
    message: String,
}

impl Browser {
    /// Starts `driver` on a free port, and with it `browser` without a window on the
    /// screen.
    pub fn start(driver: &Path, browser: &Path) -> Result<Self> {
        let mut child = Command::new(driver)
            .arg("--port=0")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .with_context(|| format!("{} cannot be started", driver.display()))?;
        let output = child.stdout.take().context("the driver has no output")?;
        // Owned from here, so that it ends wherever this fails.
        let mut this = Self {
            driver: child,
            agent: ureq::Agent::config_builder()
                .timeout_global(Some(PATIENCE))
                .http_status_as_error(false)
                .build()
                .into(),
            session: String::new(),
        };
        let mut lines = BufReader::new(output).lines().map_while(Result::ok);
        let port = lines.find_map(|line| {
            let (_, port) = line.split_once("started successfully on port ")?;
            Some(port.trim_end_matches('.').to_owned())
        });
        let server = format!("http://127.0.0.1:{}", port.context("the driver ended")?);
        // Read on, so that the driver never waits for a full pipe.
        std::thread::spawn(move || lines.for_each(drop));
        let capabilities = json!({ "capabilities": { "alwaysMatch": {
            "browserName": "chrome",
            "goog:loggingPrefs": { "browser": "ALL" },
            "goog:chromeOptions": {
                "binary": browser,
                "args": [
                    "--headless=new",
                    // It looks at our own pages, and root has no other way.
                    "--no-sandbox",
                    "--window-size=1280,1000",
                    // Drawing in 3D without a graphics card; nothing but the page.
                    "--enable-unsafe-swiftshader",
                    "--disable-quic",
                    "--no-first-run",
                    "--disable-background-networking",
                    "--disable-component-update",
                    "--disable-sync",
                    // Containers have little of it.
                    "--disable-dev-shm-usage",
                ],
            },
        } } });
        this.session = format!("{server}/session");
        let session = this.post("", &capabilities)?;
        let id = session["sessionId"].as_str().context("no session")?;
        this.session = format!("{server}/session/{id}");
        Ok(this)
    }

    /// Loads a page to its end.
    pub fn open(&self, url: &str) -> Result<()> {
        self.post("/url", &json!({ "url": url })).map(drop)
    }

    /// The value of a JavaScript expression on the page.
    pub fn ask(&self, expression: &str) -> Result<Value> {
        let script = format!("return ({expression});");
        self.post("/execute/sync", &json!({ "script": script, "args": [] }))
    }

    /// Moves the mouse from point to point of the window, pixels from its upper left.
    pub fn mouse(&self, path: &[[f64; 2]]) -> Result<()> {
        let moves: Vec<Value> = path
            .iter()
            .map(|[x, y]| json!({ "type": "pointerMove", "duration": 0, "x": x.round(), "y": y.round() }))
            .collect();
        let mouse = json!({
            "type": "pointer",
            "id": "mouse",
            "parameters": { "pointerType": "mouse" },
            "actions": moves,
        });
        self.post("/actions", &json!({ "actions": [mouse] }))
            .map(drop)
    }

    /// From now on the window is `width` pixels wide, and the page as for `media`, "screen",
    /// "print" or, where it is empty, what it is really for, of a reader who prefers dark colours if
    /// `dark`.
    pub fn look(&self, width: u32, media: &str, dark: bool) -> Result<()> {
        let size =
            json!({ "width": width, "height": 1000, "deviceScaleFactor": 1, "mobile": false });
        self.devtools("Emulation.setDeviceMetricsOverride", &size)?;
        // Paper has none, and its width is that of the text.
        let bars = json!({ "hidden": media == "print" });
        self.devtools("Emulation.setScrollbarsHidden", &bars)?;
        let scheme = if dark { "dark" } else { "light" };
        let features = json!([{ "name": "prefers-color-scheme", "value": scheme }]);
        let media = json!({ "media": media, "features": features });
        self.devtools("Emulation.setEmulatedMedia", &media)
            .map(drop)
    }

    /// The page as printed: a PDF whose outline has the headings.
    pub fn print(&self) -> Result<Vec<u8>> {
        let settings = json!({
            "preferCSSPageSize": true,
            "generateTaggedPDF": true,
            "generateDocumentOutline": true,
        });
        let printed = self.devtools("Page.printToPDF", &settings)?;
        Ok(BASE64_STANDARD.decode(printed["data"].as_str().context("no print")?)?)
    }

    /// What the browser answers to a command of its own protocol.
    fn devtools(&self, command: &str, parameters: &Value) -> Result<Value> {
        let body = json!({ "cmd": command, "params": parameters });
        self.post("/goog/cdp/execute", &body)
    }

    /// The window as a PNG.
    pub fn picture(&self) -> Result<Vec<u8>> {
        let request = self
            .agent
            .get(format!("{}/screenshot", self.session))
            .call()?;
        let picture = value(request)?;
        Ok(BASE64_STANDARD.decode(picture.as_str().context("no picture")?)?)
    }

    /// What the console has said since the last call that a page without fault does not:
    /// its own messages, exceptions, errors. The graphics driver warns that taking
    /// pictures is slow.
    pub fn errors(&self) -> Result<Vec<String>> {
        let entries = self.post("/se/log", &json!({ "type": "browser" }))?;
        let entries: Vec<LogEntry> = serde_json::from_value(entries)?;
        let wrong = |entry: &LogEntry| entry.level == "SEVERE" || entry.source == "console-api";
        let wrong = entries.into_iter().filter(wrong);
        Ok(wrong.map(|entry| entry.message).collect())
    }

    fn post(&self, command: &str, body: &Value) -> Result<Value> {
        let url = format!("{}{command}", self.session);
        value(self.agent.post(url).send_json(body)?)
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // The driver closes its browser; where it cannot there is nothing else to do.
        let _ = self.agent.delete(&self.session).call();
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}

/// What an answer holds.
fn value(mut answer: ureq::http::Response<ureq::Body>) -> Result<Value> {
    // Pictures are larger than what is read otherwise.
    let mut read = answer
        .body_mut()
        .with_config()
        .limit(u64::MAX)
        .read_json::<Value>()?;
    let value = read["value"].take();
    ensure!(answer.status().is_success(), "the browser says {value}");
    Ok(value)
}
