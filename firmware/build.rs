//! Names the table of a machine that is compiled in, if there is one, and hands the board's
//! memory layout to the linker; the latter does nothing on a host.

use std::env;
use std::fs;
use std::path::PathBuf;

/// The environment variable with the absolute path of a table that `host-gen generate` has made. A
/// board's image runs this table instead of the one that comes with it.
const TABLE: &str = "HARDMOUNT_TABLE";

fn main() {
    table();
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

/// Makes the module `made` of `tables` and sets `made_table`, if there is a table to compile in.
fn table() {
    println!("cargo::rerun-if-env-changed={TABLE}");
    println!("cargo::rustc-check-cfg=cfg(made_table)");
    let Some(table) = env::var_os(TABLE).filter(|path| !path.is_empty()) else {
        return;
    };
    let table = PathBuf::from(table);
    assert!(
        table.is_absolute() && table.is_file(),
        "{TABLE} is {}, which is not the absolute path of a file",
        table.display()
    );
    println!("cargo::rerun-if-changed={}", table.display());
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    // A table's file begins with documentation of its module, so it cannot be included itself.
    let module = format!(
        "/// The table of `{TABLE}`.\n#[path = {:?}]\npub mod made;\n",
        table.to_str().expect("the path is UTF-8")
    );
    fs::write(out.join("made.rs"), module).expect("OUT_DIR is writable");
    println!("cargo::rustc-cfg=made_table");
}
