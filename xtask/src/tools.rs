//! What the boards need beside cargo: a compiler with the target's library or
//! the library's source, a linker, and the emulator.

use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::{Outcome, run};

/// The compiler's name for a Cortex-M4F or M7 with hardware floating point.
pub const TARGET: &str = "thumbv7em-none-eabihf";

/// The oldest minor version of rustc 1 that builds the firmware; the
/// workspace's `rust-version`.
const OLDEST: u32 = 89;

/// Where Debian puts its compiler.
const DEBIAN_RUSTC: &str = "/usr/bin/rustc";

/// How the firmware is compiled.
pub struct Tools {
    compiler: Compiler,
    /// The linker to name, where the compiler does not bring its own.
    linker: Option<&'static str>,
}

enum Compiler {
    /// The rustc that cargo uses has the target's library.
    Target,
    /// A rustc that builds the core library from its source.
    Source(PathBuf),
}

impl Tools {
    /// Finds everything; installs what is missing from Debian's packages if
    /// `install`, else says which they are.
    pub fn find(install: bool) -> Outcome<Self> {
        let mut missing = missing();
        if !missing.is_empty() {
            let packages = missing.join(" ");
            if !install {
                return Err(format!(
                    "missing: {packages} (Debian packages). Install them with apt-get install --no-install-recommends {packages}{}, or leave out --no-install",
                    if missing.contains(&"rustc-web") {
                        format!(
                            "; with rustup, `rustup target add {TARGET}` does instead of the rust packages and lld"
                        )
                    } else {
                        String::new()
                    }
                ));
            }
            install_packages(&missing)?;
            missing = self::missing();
        }
        match compiler() {
            Some((compiler, linker)) if missing.is_empty() => {
                let tools = Self { compiler, linker };
                println!("boards: {}", tools.describe());
                Ok(tools)
            }
            _ => Err(format!(
                "still missing after installation: {}",
                missing.join(" ")
            )),
        }
    }

    fn describe(&self) -> String {
        let linker = self.linker.unwrap_or("the compiler's own linker");
        match &self.compiler {
            Compiler::Target => format!("installed target {TARGET}, {linker}"),
            Compiler::Source(rustc) => format!(
                "core library from source with {}, {linker}",
                version_line(rustc).unwrap_or_else(|| rustc.display().to_string())
            ),
        }
    }

    /// Makes a cargo command build with these.
    pub fn apply(&self, command: &mut Command) {
        if let Compiler::Source(rustc) = &self.compiler {
            command
                .env("RUSTC", rustc)
                // Building the core library is a cargo feature that is not
                // stable.
                .env("RUSTC_BOOTSTRAP", "1")
                .arg("-Zbuild-std=core");
        }
        if let Some(linker) = self.linker {
            command.env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER", linker);
        }
    }
}

/// Where Debian puts its browser, and what drives it.
pub const CHROMIUM: [&str; 2] = ["/usr/bin/chromium", "/usr/bin/chromedriver"];

/// Chromium and its driver; installs them from Debian's packages if `install`.
pub fn chromium(install: bool) -> Outcome<()> {
    const PACKAGES: [&str; 2] = ["chromium", "chromium-driver"];
    if CHROMIUM.iter().all(|program| Path::new(program).is_file()) {
        return Ok(());
    }
    packages(&PACKAGES, install)
}

/// What the virtual board's emulator is built with: cmake, and libclang for its bindings.
pub fn emulator(install: bool) -> Outcome<()> {
    // With it come the compiler's own headers, which the library alone does not have.
    let packaged = fs::read_dir("/usr/lib").into_iter().flatten().flatten();
    let clang = env::var_os("LIBCLANG_PATH").is_some()
        || packaged
            .map(|folder| folder.path().join("lib/libclang.so"))
            .any(|library| library.is_file());
    let mut missing = Vec::new();
    if !on_path("cmake") {
        missing.push("cmake");
    }
    if !clang {
        missing.push("libclang-dev");
    }
    if missing.is_empty() {
        return Ok(());
    }
    packages(&missing, install)
}

/// A Python environment of its own in `folder`, and the folder of its programs; installs what
/// Debian's Python lacks for it if `install`.
pub fn venv(folder: &Path, install: bool) -> Outcome<PathBuf> {
    // Without this, the environment has no pip.
    if output(Path::new("python3"), &["-c", "import ensurepip"]).is_none() {
        packages(&["python3-venv"], install)?;
    }
    run(Command::new("python3")
        .args(["-m", "venv", "--clear"])
        .arg(folder))?;
    Ok(folder.join("bin"))
}

/// What packs a program as a wheel: the one on the path, else that of PyPI in an environment of its
/// own if `install`.
pub fn maturin(install: bool) -> Outcome<PathBuf> {
    const VERSION: &str = "maturin==1.16.0";
    if on_path("maturin") {
        return Ok(PathBuf::from("maturin"));
    }
    let folder = Path::new("target/tools/maturin");
    let own = folder.join("bin/maturin");
    if own.is_file() {
        return Ok(own);
    }
    if !install {
        return Err(format!(
            "missing: maturin. Install it with pip install {VERSION}, or leave out --no-install"
        ));
    }
    let programs = venv(folder, install)?;
    println!("installing from PyPI: {VERSION}");
    run(Command::new(programs.join("pip")).args(["install", "--quiet", VERSION]))?;
    Ok(own)
}

/// A Python with Exudyn, NumPy and SciPy: the one on the path, else one in an environment of its own
/// with what PyPI has if `install`.
pub fn python(install: bool) -> Outcome<PathBuf> {
    const MODULES: &str = "exudyn, numpy, scipy";
    const VERSIONS: [&str; 3] = ["exudyn==1.13.6", "numpy==2.4.6", "scipy==1.17.1"];
    if imports("python3", MODULES) {
        return Ok(PathBuf::from("python3"));
    }
    let folder = Path::new("target/tools/python");
    let own = folder.join("bin/python3");
    if imports(&own, MODULES) {
        return Ok(own);
    }
    let wanted = VERSIONS.join(" ");
    if !install {
        return Err(format!(
            "missing: Exudyn, NumPy or SciPy. Install them with pip install {wanted}, or leave out --no-install"
        ));
    }
    let programs = venv(folder, install)?;
    println!("installing from PyPI: {wanted}");
    run(Command::new(programs.join("pip"))
        .args(["install", "--quiet"])
        .args(VERSIONS))?;
    Ok(own)
}

/// Whether a Python has these modules.
pub fn imports(python: impl AsRef<OsStr>, modules: &str) -> bool {
    Command::new(python)
        .args(["-c", &format!("import {modules}")])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

/// Octave's program without windows; installs Debian's package if `install`.
pub fn octave(install: bool) -> Outcome<&'static str> {
    const PROGRAM: &str = "octave-cli";
    if !on_path(PROGRAM) {
        packages(&["octave"], install)?;
    }
    Ok(PROGRAM)
}

/// A program that is a crate, and the version that the project is tested with.
pub struct Crate {
    name: &'static str,
    version: &'static str,
}

pub const MDBOOK: Crate = Crate {
    name: "mdbook",
    version: "0.5.4",
};

pub const CARGO_DENY: Crate = Crate {
    name: "cargo-deny",
    version: "0.20.2",
};

impl Crate {
    /// The one on the path, else one that cargo builds here if `install`.
    pub fn find(&self, install: bool) -> Outcome<PathBuf> {
        const ROOT: &str = "target/tools";
        let Self { name, version } = self;
        if on_path(name) {
            return Ok(PathBuf::from(name));
        }
        let own = Path::new(ROOT).join("bin").join(name);
        if own.is_file() {
            return Ok(own);
        }
        if !install {
            return Err(format!(
                "missing: {name}. Install it with cargo install {name} --locked, or leave out --no-install"
            ));
        }
        println!("building {name}, which takes some minutes");
        let mut command = crate::cargo();
        command.args(["install", name, "--version", version, "--locked"]);
        // It runs for seconds and would be optimised for minutes.
        for (setting, value) in [("OPT_LEVEL", "0"), ("LTO", "off"), ("CODEGEN_UNITS", "16")] {
            command.env(format!("CARGO_PROFILE_RELEASE_{setting}"), value);
        }
        run(command.args(["--root", ROOT]))?;
        Ok(own)
    }
}

/// The Debian packages that would supply what is not here.
fn missing() -> Vec<&'static str> {
    let mut packages = Vec::new();
    match compiler() {
        None => packages.extend(["rustc-web", "rust-web-src", "lld"]),
        Some((_, Some(linker))) if !on_path(linker) => packages.push("lld"),
        Some(_) => {}
    }
    if !on_path("qemu-system-arm") {
        packages.push("qemu-system-arm");
    }
    packages
}

/// The best compiler here: one with the target's library, else one with the
/// source of it. With it the linker it needs.
fn compiler() -> Option<(Compiler, Option<&'static str>)> {
    let usual = env::var_os("RUSTC").map_or_else(|| PathBuf::from("rustc"), PathBuf::from);
    if let Some(sysroot) = sysroot(&usual) {
        let library = sysroot.join("lib/rustlib").join(TARGET).join("lib");
        if library.is_dir() {
            return Some((Compiler::Target, linker(&sysroot)));
        }
    }
    [usual, PathBuf::from(DEBIAN_RUSTC)]
        .into_iter()
        .find_map(|rustc| {
            let sysroot = sysroot(&rustc)?;
            let source = sysroot.join("lib/rustlib/src/rust/library/core/Cargo.toml");
            (source.is_file() && new_enough(&rustc))
                .then(|| (Compiler::Source(rustc), linker(&sysroot)))
        })
}

/// LLVM's linker by name, unless the compiler brings it along.
fn linker(sysroot: &Path) -> Option<&'static str> {
    let own = fs::read_dir(sysroot.join("lib/rustlib"))
        .into_iter()
        .flatten()
        .flatten()
        .any(|folder| folder.path().join("bin/rust-lld").is_file());
    if own { None } else { Some("ld.lld") }
}

fn sysroot(rustc: &Path) -> Option<PathBuf> {
    output(rustc, &["--print", "sysroot"]).map(PathBuf::from)
}

fn version_line(rustc: &Path) -> Option<String> {
    output(rustc, &["--version"])
}

fn new_enough(rustc: &Path) -> bool {
    // "rustc 1.96.0 (…)"
    version_line(rustc)
        .and_then(|line| line.split('.').nth(1)?.parse().ok())
        .is_some_and(|minor: u32| minor >= OLDEST)
}

fn output(program: &Path, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}

fn on_path(program: &str) -> bool {
    let path = env::var_os("PATH").unwrap_or_default();
    env::split_paths(&path).any(|folder| folder.join(program).is_file())
}

/// Installs what is missing from Debian's packages if `install`, else says what that is.
fn packages(missing: &[&str], install: bool) -> Outcome<()> {
    if install {
        return install_packages(missing);
    }
    let names = missing.join(" ");
    Err(format!(
        "missing: {names} (Debian packages). Install them with apt-get install --no-install-recommends {names}, or leave out --no-install"
    ))
}

/// Installs Debian's packages.
fn install_packages(names: &[&str]) -> Outcome<()> {
    println!("installing from Debian: {}", names.join(" "));
    apt(&["update", "--quiet"])?;
    let mut arguments = vec!["install", "--quiet", "--yes", "--no-install-recommends"];
    arguments.extend(names);
    apt(&arguments)
}

/// apt-get, through sudo for whoever is not root.
fn apt(arguments: &[&str]) -> Outcome<()> {
    if !on_path("apt-get") {
        return Err("there is no apt-get here; see the README for what the boards need".to_owned());
    }
    let root = output(Path::new("id"), &["-u"]).as_deref() == Some("0");
    let mut command = if root {
        Command::new("apt-get")
    } else {
        let mut sudo = Command::new("sudo");
        sudo.arg("apt-get");
        sudo
    };
    command.env("DEBIAN_FRONTEND", "noninteractive");
    run(command.args(arguments))
}
