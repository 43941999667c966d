//! The report's page in a real browser: it loads without an error and without a
//! network, its charts have their series, hovering shows a value, modes move as the
//! model says, and the watched page follows its file. On a wide window, a phone and paper, no text
//! lies on another or is cut off.
#![forbid(unsafe_code)]

mod sheets;
mod webdriver;

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};
use clap::Parser;
use host_gen::design::{Cache, Search, Study};
use host_gen::floor::{Criterion, Floor};
use host_gen::machine::{Machine, Structure};
use host_gen::report::chart::Chart;
use host_gen::report::page::page;
use host_gen::report::{Report, Review};
use serde_json::Value;
use sheets::Sheets;
use webdriver::Browser;

/// Looks at the page of `host-gen report` and `host-gen watch` in Chromium.
#[derive(Parser)]
struct Cli {
    /// The browser.
    #[arg(long, default_value = "/usr/bin/chromium")]
    browser: PathBuf,
    /// What drives it.
    #[arg(long, default_value = "/usr/bin/chromedriver")]
    driver: PathBuf,
    /// The program whose `watch` is looked at.
    #[arg(long, default_value = "target/release/host-gen")]
    host_gen: PathBuf,
    /// Pictures of what was seen go there.
    #[arg(long, default_value = "target/browser")]
    pictures: PathBuf,
}

const MODEL: &str = "models/metrology-frame.toml";
const OTHER: &str = "models/smaller-basis.toml";

/// What is wrong with the texts on the page.
const LAYOUT: &str = include_str!("layout.js");

/// Widths of windows, pixels: of a desk and of a phone.
const WINDOWS: [u32; 2] = [1400, 390];

/// A4 in pixels between the margins of the page, 14 mm.
const PAPER: [f64; 2] = [688.0, 1017.0];

/// Most sheets of the page of one machine: one more than it takes, for letters of another width.
const SHEETS: usize = 14;

/// A search that takes a laptop half a minute ends by then anywhere.
const PATIENCE: Duration = Duration::from_secs(300);

/// A page larger than this is too large to send by mail.
const LARGEST: usize = 6_000_000;

fn main() -> Result<()> {
    run(&Cli::parse())
}

fn run(cli: &Cli) -> Result<()> {
    fs::create_dir_all(&cli.pictures)?;
    let folder = tempfile::tempdir()?;
    let browser = Browser::start(&cli.driver, &cli.browser)?;

    let machine = Machine::load(Path::new(MODEL))?;
    // Other steps of the whole test have searched for these already.
    let cache = Cache::from_environment();
    let search = Search {
        cache: cache.as_ref(),
        ..Search::FULL
    };
    let report = |machine| {
        Report::new(
            machine,
            Some(&Floor::Criterion(Criterion::VcC).into()),
            &search,
        )
    };
    let review = Review::new(vec![report(&machine)?])?;
    let seen = Seen::open(&browser, &write(folder.path(), "one.html", &review)?)?;
    seen.charts(&charts(&review))?;
    seen.hover(&cli.pictures)?;
    seen.modes(&machine)?;
    seen.layout(&cli.pictures, "report")?;
    let sheets = seen.printed(&cli.pictures, "report")?;
    ensure!(sheets <= SHEETS, "{sheets} sheets of paper");
    seen.done(&cli.pictures, "report")?;
    println!("one machine: charts, hover, modes, layout, {sheets} sheets: as they should be");

    let [one, other] = [MODEL, OTHER].map(|model| direct(folder.path(), model));
    let both = Review::new(vec![report(&one?)?, report(&other?)?])?;
    let seen = Seen::open(&browser, &write(folder.path(), "two.html", &both)?)?;
    seen.layout(&cli.pictures, "side-by-side")?;
    seen.printed(&cli.pictures, "side-by-side")?;
    seen.side_by_side(&both)?;
    seen.done(&cli.pictures, "side-by-side")?;
    println!("two machines: side by side as they should be");

    let machine = Structure::parse_passive(Path::new("row.toml"), PASSIVE)?;
    let machine = machine.context("the file says something of control")?;
    let review = Review::passive(&machine)?;
    let seen = Seen::open(&browser, &write(folder.path(), "passive.html", &review)?)?;
    seen.layout(&cli.pictures, "passive")?;
    seen.printed(&cli.pictures, "passive")?;
    seen.done(&cli.pictures, "passive")?;
    println!("a machine without control: as it should be");

    watched(&browser, cli, folder.path())
}

/// Two masses in a row on springs from the base.
const PASSIVE: &str = r#"
format = 1
name = "row"
[nodes]
wall = [0.0, 0.0, 0.0]
near = [0.0, 0.0, 0.2]
far = [0.0, 0.1, 0.5]
[base]
nodes = ["wall"]
[free]
nodes = ["near", "far"]
[point_masses]
first = { node = "near", mass = 2.0, inertia = [0.1, 0.1, 0.1] }
second = { node = "far", mass = 3.0, inertia = [0.1, 0.1, 0.1] }
[springs.foot]
nodes = ["wall", "near"]
stiffness = [4e5, 5e5, 6e5]
rotational_stiffness = [1e4, 1e4, 1e4]
[springs.between]
nodes = ["near", "far"]
stiffness = [1e5, 2e5, 3e5]
rotational_stiffness = [1e4, 1e4, 1e4]
"#;

/// A machine under the direct law, whose search is short and whose page is the same.
fn direct(folder: &Path, model: &str) -> Result<Machine> {
    let based_on = fs::canonicalize(model)?;
    let path = folder.join(Path::new(model).file_name().context("a model has a name")?);
    let text = format!("based_on = {based_on:?}\n[control]\nlaw = \"direct\"\n");
    fs::write(&path, text)?;
    Ok(Machine::load(&path)?)
}

fn write(folder: &Path, name: &str, review: &Review) -> Result<String> {
    let path = folder.join(name);
    let text = page(review);
    ensure!(text.len() < LARGEST, "{name} has {} bytes", text.len());
    println!("{name}: {} bytes", text.len());
    fs::write(&path, text)?;
    Ok(format!("file://{}", path.display()))
}

/// The charts that the page shows of its one machine.
fn charts(review: &Review) -> Vec<&Chart> {
    let pictures = review.pictures().into_iter();
    let drawn = |chart: &&Chart| !["machine", "mode"].contains(&&chart.id[..]);
    pictures.map(|(_, chart)| chart).filter(drawn).collect()
}

/// A page in the browser.
struct Seen<'a> {
    browser: &'a Browser,
}

impl<'a> Seen<'a> {
    fn open(browser: &'a Browser, url: &str) -> Result<Self> {
        browser.open(url)?;
        let seen = Self { browser };
        seen.until("document.querySelectorAll('#gallery img').length > 0")?;
        Ok(seen)
    }

    fn ask(&self, expression: &str) -> Result<Value> {
        self.browser.ask(expression)
    }

    fn number(&self, expression: &str) -> Result<f64> {
        let answer = self.ask(expression)?;
        answer
            .as_f64()
            .with_context(|| format!("{expression} is {answer}"))
    }

    fn until(&self, expression: &str) -> Result<()> {
        let start = Instant::now();
        while start.elapsed() < PATIENCE {
            // While a page goes and another comes there is nobody to ask.
            if self.ask(expression).is_ok_and(|answer| answer == true) {
                return Ok(());
            }
            std::thread::sleep(Duration::from_millis(25));
        }
        bail!(
            "it never came to this: {expression}\n{:?}",
            self.browser.errors()?
        )
    }

    /// Every chart has a place with as many series, and as many points in each.
    fn charts(&self, charts: &[&Chart]) -> Result<()> {
        let drawn = self.number("document.querySelectorAll('[data-chart] .main-svg').length > 0 ? document.querySelectorAll('[data-chart]').length : 0")?;
        ensure!(
            drawn == charts.len() as f64,
            "{drawn} of {} charts",
            charts.len()
        );
        for chart in charts {
            let place = format!(
                "document.querySelector('#sections [data-chart={}]')",
                chart.id
            );
            let points = self.ask(&format!(
                "JSON.stringify({place}.data.map((t) => [new DOMParser().parseFromString(t.name, 'text/html').body.textContent, t.x.length, t.y.length]))"
            ))?;
            let points: Vec<(String, usize, usize)> =
                serde_json::from_str(points.as_str().context("no text")?)?;
            let expected = chart.series.iter();
            // What follows an underscore is set lower, without it.
            let expected: Vec<_> = expected
                .map(|s| (s.name.replace('_', ""), s.x.len(), s.y.len()))
                .collect();
            ensure!(points == expected, "{}: {points:?}", chart.id);
            // And something is drawn of it.
            let paths = self.number(&format!(
                "{place}.querySelectorAll('.scatterlayer path').length"
            ))?;
            ensure!(paths > 0.0, "{} is empty", chart.id);
        }
        Ok(())
    }

    /// Over the highest point of the first curve, its value is said.
    fn hover(&self, pictures: &Path) -> Result<()> {
        let spot = self.ask(
            "(() => {
                const place = document.querySelector('#sections [data-chart=sigma]');
                place.scrollIntoView({ block: 'center', behavior: 'instant' });
                const box = place.getBoundingClientRect(), l = place._fullLayout;
                const y = place.data[0].y, k = y.indexOf(Math.max(...y));
                return JSON.stringify([box.left + l.xaxis._offset + l.xaxis.d2p(place.data[0].x[k]),
                    box.top + l.yaxis._offset + l.yaxis.d2p(y[k]), place.data[0].x[k], y[k]]);
            })()",
        )?;
        let [x, y, hz, db]: [f64; 4] = serde_json::from_str(spot.as_str().context("no text")?)?;
        // From the side, as a hand would.
        self.browser.mouse(&[[x - 40.0, y + 60.0], [x, y]])?;
        self.until("document.querySelector('[data-chart=sigma] .hoverlayer .hovertext') !== null")?;
        let text =
            self.ask("document.querySelector('[data-chart=sigma] .hovertext').textContent")?;
        let text = text.as_str().context("no text")?;
        // As the page says it, four digits of each.
        for value in [hz, db] {
            let said = format!("{value:.2}");
            let said = &said[..said.len() - 1];
            ensure!(text.contains(said), "hover says {text}, not {said}");
        }
        self.picture(pictures, "hover")
    }

    /// Nodes move as the model's shapes say, and the picture moves.
    fn modes(&self, machine: &Machine) -> Result<()> {
        let study = Study::new(machine.clone())?;
        let shapes = study.model().modes().shapes;
        for mode in 0..shapes.ncols() {
            let shape = shapes.column(mode).into_owned();
            let there = self.ask(&format!("JSON.stringify(stage.scene.nodes.map((n) => stage.shapeAt(stage.modes[{mode}], n)))"))?;
            let there: Vec<[f64; 3]> = serde_json::from_str(there.as_str().context("no text")?)?;
            for (node, there) in there.iter().enumerate() {
                let here = study.model().translation(node, &shape);
                let off = (here - nalgebra::Vector3::from(*there)).norm();
                ensure!(off < 1e-9, "mode {mode}, node {node}: {here} and {there:?}");
            }
        }
        self.ask("document.querySelector('#gallery button[data-mode=\"3\"]').click()")?;
        let look = "stage.renderer.domElement.toDataURL()";
        let (first, factor) = (self.ask(look)?, self.number("stage.factor")?);
        self.until(&format!("Math.abs(stage.factor - {factor}) > 0.3"))?;
        ensure!(self.ask(look)? != first, "the mode does not move");
        self.ask("document.getElementById('play').click()")?;
        let still = self.number("stage.phase")?;
        std::thread::sleep(Duration::from_millis(300));
        ensure!(self.number("stage.phase")? == still, "it moves on");
        Ok(())
    }

    fn side_by_side(&self, review: &Review) -> Result<()> {
        let compared = review.pictures().into_iter();
        let compared: Vec<_> = compared
            .filter(|(name, _)| name.starts_with("compared-"))
            .collect();
        ensure!(!compared.is_empty(), "nothing is compared");
        for (_, chart) in compared {
            let series = self.number(&format!(
                "document.querySelector('#compared [data-chart={}]').data.length",
                chart.id
            ))?;
            ensure!(
                series == chart.series.len() as f64,
                "{}: {series}",
                chart.id
            );
        }
        // The second machine's own page part.
        self.ask("document.querySelector('.tabs [data-machine=\"1\"]').click()")?;
        self.until("document.querySelectorAll('#gallery img').length > 0")?;
        let shown = self.ask("document.querySelector('#file summary').textContent")?;
        let name = Path::new(OTHER).file_name().and_then(|name| name.to_str());
        let other = shown.as_str().zip(name);
        let other = other.is_some_and(|(shown, name)| shown.ends_with(name));
        ensure!(other, "the file shown is {shown}");
        Ok(())
    }

    /// No text lies on another, is cut off or hard to read, whatever the window, and on paper.
    fn layout(&self, pictures: &Path, name: &str) -> Result<()> {
        for width in WINDOWS {
            for dark in [false, true] {
                self.browser.look(width, "screen", dark)?;
                self.until(&format!(
                    "innerWidth === {width} && [...document.querySelectorAll('[data-chart]')].every((p) => p._fullLayout.width === p.clientWidth)"
                ))?;
                let kind = if dark { "dark" } else { "light" };
                self.texts(&format!("{width} pixels, {kind}"))?;
                self.picture(pictures, &format!("{name}-{width}-{kind}"))?;
            }
        }
        // Paper is white, whatever the screen is.
        self.browser.look(PAPER[0] as u32, "print", true)?;
        self.ask("window.dispatchEvent(new Event('beforeprint'))")?;
        self.texts("paper")?;
        let [width, height] = PAPER;
        let cut = self.ask(&format!(
            "JSON.stringify([...document.querySelectorAll('figure')].filter((f) => f.offsetHeight > {height} || getComputedStyle(f).breakInside !== 'avoid' || [...f.querySelectorAll('.main-svg')].some((s) => s.getBoundingClientRect().right > {width} + 1)).map((f) => f.textContent))"
        ))?;
        ensure!(cut == "[]", "cut off on paper: {cut}");
        let ground = self.ask("getComputedStyle(document.body).backgroundColor")?;
        ensure!(ground == "rgb(255, 255, 255)", "paper is {ground}");
        self.ask("window.dispatchEvent(new Event('afterprint'))")?;
        // What is printed must not be taken for a screen.
        self.browser.look(WINDOWS[0], "", false)
    }

    fn texts(&self, on: &str) -> Result<()> {
        let faults = self.ask(LAYOUT)?;
        let faults: Vec<String> = serde_json::from_str(faults.as_str().context("no text")?)?;
        ensure!(faults.is_empty(), "{on}: {}", faults.join("\n"));
        Ok(())
    }

    /// Printed, every heading has on its sheet what it is the heading of. The number of sheets.
    fn printed(&self, pictures: &Path, name: &str) -> Result<usize> {
        let pdf = self.browser.print()?;
        fs::write(pictures.join(name).with_extension("pdf"), &pdf)?;
        let text = String::from_utf8_lossy(&pdf);
        let sheets = Sheets::new(&text);
        let headings = sheets.headings();
        let there = self.number("document.querySelectorAll('h1, h2, h3').length")?;
        ensure!(
            headings.len() as f64 == there,
            "{} of {there} headings printed",
            headings.len()
        );
        let alone = headings.iter().filter(|heading| sheets.is_alone(**heading));
        let alone = alone.count();
        ensure!(alone == 0, "{alone} headings at the end of a sheet");
        Ok(sheets.count())
    }

    fn picture(&self, folder: &Path, name: &str) -> Result<()> {
        let picture = self.browser.picture()?;
        Ok(fs::write(folder.join(name).with_extension("png"), picture)?)
    }

    /// Nothing went wrong, and nothing was asked of a network.
    fn done(self, pictures: &Path, name: &str) -> Result<()> {
        self.ask("window.scrollTo(0, 0)")?;
        self.picture(pictures, name)?;
        let asked = self.ask("JSON.stringify(performance.getEntriesByType('resource').map((r) => r.name).filter((n) => !n.startsWith('data:') && !n.startsWith('blob:')))")?;
        ensure!(asked == "[]", "it asked for {asked}");
        let errors = self.browser.errors()?;
        ensure!(errors.is_empty(), "the console says {errors:?}");
        Ok(())
    }
}

/// `host-gen watch` under a model that is edited.
struct Watched(Child);

impl Drop for Watched {
    fn drop(&mut self) {
        self.0.kill().unwrap_or_default();
        self.0.wait().map(|_| ()).unwrap_or_default();
    }
}

fn watched(browser: &Browser, cli: &Cli, folder: &Path) -> Result<()> {
    let model = folder.join("watched.toml");
    let text = fs::read_to_string(MODEL)?;
    let text = text.replace("[control]\n", "[control]\nlaw = \"direct\"\n");
    fs::write(&model, &text)?;
    let mut process = Command::new(&cli.host_gen);
    process
        .arg("watch")
        .arg(&model)
        .args(["--listen", "127.0.0.1:0"]);
    let process = process.stdout(Stdio::piped()).spawn();
    let mut process = Watched(process.with_context(|| format!("{}", cli.host_gen.display()))?);
    let mut lines = BufReader::new(process.0.stdout.take().context("no output")?).lines();
    let url = lines.find(|line| line.as_ref().is_ok_and(|line| line.starts_with("http")));
    let url = url.context("it says no address")??;
    // What else it says is read, so that it does not wait for that.
    std::thread::spawn(move || lines.for_each(drop));
    let seen = Seen::open(browser, &url)?;
    let mass = "document.querySelector('#gallery') && review.machines[0].scene.bodies[0].mass";
    for round in 0..3 {
        let kilos = 700 + round;
        let edited = text.replace("mass = 742.0", &format!("mass = {kilos}.0"));
        let start = Instant::now();
        fs::write(&model, edited)?;
        seen.until(&format!("{mass} === {kilos}"))?;
        println!(
            "watch: saved to shown in {:.2} s",
            start.elapsed().as_secs_f64()
        );
    }
    // What the search finds comes by itself.
    seen.until("Boolean(review.machines[0].closed)")?;
    fs::write(&model, text.replace("mass = 742.0", "mass = -1.0"))?;
    seen.until("document.getElementById('error') !== null")?;
    let error = seen.ask("document.getElementById('error').textContent")?;
    let line = text
        .lines()
        .position(|line| line.starts_with("mass = 742.0"));
    let line = line.context("the frame has a mass")? + 1;
    let place = format!("watched.toml:{line}:1: bodies.frame.mass");
    ensure!(
        error.as_str().is_some_and(|error| error.contains(&place)),
        "the page says {error}"
    );
    fs::write(&model, &text)?;
    seen.until(&format!(
        "document.getElementById('error') === null && {mass} === 742"
    ))?;
    println!("watch: errors with their place, and over once they are mended");
    Ok(())
}
