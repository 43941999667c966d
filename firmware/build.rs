//! Hands the board's memory layout to the linker. Does nothing on a host.

use std::env;
use std::fs;
use std::path::PathBuf;

fn main() {
    println!("cargo::rerun-if-changed=memory");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let is = |board: &str| env::var_os(format!("CARGO_FEATURE_{board}")).is_some();
    let layout = match (is("MPS2"), is("NUCLEO_H743")) {
        (true, false) => "mps2",
        (false, true) => {
            println!("cargo::rustc-link-arg-bins=-Tdefmt.x");
            "nucleo-h743"
        }
        _ => panic!("choose one board: --no-default-features --features mps2, or the default"),
    };
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::copy(format!("memory/{layout}.x"), out.join("memory.x")).expect("OUT_DIR is writable");
    println!("cargo::rustc-link-search={}", out.display());
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    // cortex-m-rt asks for it where the image starts at address 0.
    println!("cargo::rustc-link-arg-bins=--nmagic");
}
