//! What the reference board's image takes.

use std::fs;

use object::{Object as _, ObjectSection as _, ObjectSymbol as _, SectionFlags, elf};

use crate::Outcome;
use crate::baseline::Baseline;
use crate::boards;
use crate::tools::Tools;

/// What it took.
const SIZE: Baseline = Baseline {
    file: "firmware/size.txt",
    slack: 0.05,
    update: "size",
};

/// A memory of the board.
struct Memory {
    name: &'static str,
    /// Its addresses.
    start: u64,
    end: u64,
}

/// As in firmware/memory/nucleo-h743.x.
const MEMORIES: [Memory; 4] = [
    Memory {
        name: "flash",
        start: 0x0800_0000,
        end: 0x080D_0000,
    },
    Memory {
        name: "itcm",
        start: 0,
        end: 0x0001_0000,
    },
    Memory {
        name: "dtcm",
        start: 0x2001_0000,
        end: 0x2002_0000,
    },
    Memory {
        name: "axi",
        start: 0x2400_0000,
        end: 0x2408_0000,
    },
];

/// The loop's code, which is in ITCM, calls nothing in flash but what ends in a panic. A call
/// from one to the other is too far for one instruction, so the linker puts a thunk beside the
/// caller.
fn calls_only_itcm(file: &object::File<'_>) -> Outcome<()> {
    let [_, itcm, ..] = &MEMORIES;
    let thunks = file.symbols().filter_map(|symbol| {
        let name = symbol.name().ok()?;
        let (_, callee) = name.split_once("LongThunk_")?;
        let inside = (itcm.start..itcm.end).contains(&symbol.address());
        (inside && !callee.contains("panic")).then_some(callee)
    });
    let callees: Vec<_> = thunks.collect();
    if callees.is_empty() {
        return Ok(());
    }
    Err(format!(
        "the loop's code in ITCM calls code in flash: {}. Place it in firmware/memory/nucleo-h743.x",
        callees.join(", ")
    ))
}

/// Prints it, and compares it with the baseline or writes that anew.
pub fn size(tools: &Tools, update: bool) -> Outcome<()> {
    let image = boards::build_reference(tools)?;
    let path = image.display();
    let bytes = fs::read(&image).map_err(|error| format!("{path}: {error}"))?;
    let file = object::File::parse(&*bytes).map_err(|error| format!("{path}: {error}"))?;
    calls_only_itcm(&file)?;
    let mut used = [0; MEMORIES.len()];
    for section in file.sections() {
        let SectionFlags::Elf { sh_flags } = section.flags() else {
            continue;
        };
        if sh_flags & u64::from(elf::SHF_ALLOC) == 0 {
            continue;
        }
        for (memory, used) in MEMORIES.iter().zip(&mut used) {
            if (memory.start..memory.end).contains(&section.address()) {
                *used += section.size();
            }
        }
        // What is copied at start waits in flash.
        let copied = matches!(section.name(), Ok(".data" | ".itcm"));
        if copied {
            used[0] += section.size();
        }
    }
    let mut found = Vec::new();
    for (Memory { name, start, end }, used) in MEMORIES.iter().zip(used) {
        found.push(format!("{name} of {} {used}", end - start));
    }
    println!("Bytes; the stack has 64 KiB beside them (host-gen link health tells its use):");
    if update {
        SIZE.write(&found)
    } else {
        SIZE.compare(&found)
    }
}
