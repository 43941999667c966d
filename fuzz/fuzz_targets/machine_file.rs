//! Any text as a machine file: a machine or an error, no panic; and a machine can be
//! modelled or says why not.
#![no_main]

use std::path::Path;

use host_gen::machine::Machine;
use host_gen::model::multibody::Multibody;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    // What a file is based on is another file, and none of the fuzzer's.
    if text.contains("based_on") {
        return;
    }
    if let Ok(machine) = Machine::parse(Path::new("fuzz.toml"), text) {
        let _ = Multibody::new(&machine);
    }
});
