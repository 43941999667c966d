//! The image: what is loaded into the flash, and the names of its functions.

use object::{Object as _, ObjectSegment as _, ObjectSymbol as _, SymbolKind};

use crate::memory::{Area, Memory};

/// A function.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Symbol {
    /// Where it begins.
    pub address: u32,
    /// Its size, bytes.
    pub size: u32,
    /// Its name, as in the source.
    pub name: String,
    /// Its name, as the linker knows it.
    pub linked: String,
}

/// An image.
#[derive(Clone, Debug, Default)]
pub struct Image {
    segments: Vec<(u32, Vec<u8>)>,
    /// Functions, by address.
    symbols: Vec<Symbol>,
    /// Variables and marks: name and address.
    data: Vec<(String, u32)>,
}

impl Image {
    /// Reads an ELF file.
    ///
    /// # Errors
    /// If it is none.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        let file = object::File::parse(bytes).map_err(|error| error.to_string())?;
        let mut image = Self::default();
        // Where a segment is loaded, not where it runs: the start-up code copies it.
        let object::File::Elf32(elf) = &file else {
            return Err("not a 32-bit ELF file".to_owned());
        };
        for (segment, header) in file.segments().zip(load_headers(elf)) {
            let data = segment.data().map_err(|error| error.to_string())?;
            if !data.is_empty() {
                image.segments.push((header, data.to_vec()));
            }
        }
        for symbol in file.symbols() {
            let (Ok(linked), address) = (symbol.name(), symbol.address() as u32) else {
                continue;
            };
            if symbol.kind() == SymbolKind::Text && symbol.size() > 0 {
                image.symbols.push(Symbol {
                    address: address & !1,
                    size: symbol.size() as u32,
                    name: format!("{:#}", rustc_demangle::demangle(linked)),
                    linked: linked.to_owned(),
                });
            } else {
                image.data.push((linked.to_owned(), address));
            }
        }
        image.symbols.sort_by_key(|symbol| symbol.address);
        Ok(image)
    }

    /// An image of machine code at an address, with a vector table at the beginning of the
    /// flash, for tests.
    pub fn of_code(vectors: &[u32], code: &[(u32, &[u16])]) -> Self {
        let table = vectors.iter().flat_map(|word| word.to_le_bytes()).collect();
        let mut segments = vec![(Area::Flash.range().0, table)];
        for (address, halfwords) in code {
            let bytes = halfwords.iter().flat_map(|word| word.to_le_bytes());
            segments.push((*address, bytes.collect()));
        }
        Self {
            segments,
            ..Self::default()
        }
    }

    /// Copies it into the flash, or wherever it is loaded.
    ///
    /// # Errors
    /// If there is no memory where it is loaded.
    pub fn load(&self, memory: &mut Memory) -> Result<(), String> {
        memory.area_mut(Area::Flash).fill(0xFF);
        for (address, bytes) in &self.segments {
            if !memory.write(*address, bytes) {
                return Err(format!("no memory at {address:#010x}"));
            }
        }
        Ok(())
    }

    /// The function at an address.
    pub fn function(&self, address: u32) -> Option<&Symbol> {
        let after = self
            .symbols
            .partition_point(|symbol| symbol.address <= address);
        let symbol = &self.symbols[after.checked_sub(1)?];
        (address < symbol.address + symbol.size).then_some(symbol)
    }

    /// The first function whose name, as in the source or the linker's, holds `part`.
    pub fn find(&self, part: &str) -> Option<&Symbol> {
        let exact = self.symbols.iter().find(|symbol| symbol.linked == part);
        exact.or_else(|| {
            self.symbols
                .iter()
                .find(|symbol| symbol.name.contains(part))
        })
    }

    /// Address of the first variable or mark whose linked name holds `part`.
    pub fn address(&self, part: &str) -> Option<u32> {
        let exact = self.data.iter().find(|(name, _)| name == part);
        let found = exact.or_else(|| self.data.iter().find(|(name, _)| name.contains(part)));
        found.map(|(_, address)| *address)
    }
}

/// Load addresses of the segments.
fn load_headers(elf: &object::read::elf::ElfFile32<'_>) -> Vec<u32> {
    use object::read::elf::ProgramHeader as _;
    let endian = elf.endian();
    elf.elf_program_headers()
        .iter()
        .filter(|header| header.p_type(endian) == object::elf::PT_LOAD)
        .map(|header| header.p_paddr(endian))
        .collect()
}
