//! A writer of MAT-files, level 5, as MATLAB, Octave (`load`) and SciPy (`scipy.io.loadmat`) read
//! them.
//!
//! Of the crates that write this format, those for plain numbers have neither structures nor text
//! (`matfile`, `mat5`), one binds a C library (`matio-rs`), and one builds on a crate that is no
//! longer maintained (`matrw`). What is needed here is little: the five kinds of [`Value`],
//! uncompressed. The format is that of "MAT-File Format", The MathWorks, chapter 1.

use nalgebra::{Complex, DMatrix, Dim, Matrix, RawStorage};

/// The value of a variable or of a field.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// Real numbers in double precision, the first index running fastest.
    Real {
        /// The length in each dimension, at least two.
        size: Vec<usize>,
        /// As many numbers as the product of the lengths.
        numbers: Vec<f64>,
    },
    /// Complex numbers, as [`Value::Real`].
    Complex {
        /// The length in each dimension, at least two.
        size: Vec<usize>,
        /// As many numbers as the product of the lengths.
        numbers: Vec<Complex<f64>>,
    },
    /// A row of characters.
    Text(String),
    /// A cell array with one column.
    Cells(Vec<Value>),
    /// A structure, 1×1, with its fields in order.
    Structure(Vec<Field>),
}

/// The name of a variable or of a field, a legal name of at most 31 ASCII letters, and its value.
pub type Field = (&'static str, Value);

/// An array has more than 4 GiB, or a length of more than 31 bits: no MAT-file of level 5 can have it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a MAT-file has no room for so much: an array is larger than 4 GiB")]
pub struct TooLarge;

impl<R: Dim, C: Dim, S: RawStorage<f64, R, C>> From<&Matrix<f64, R, C, S>> for Value {
    fn from(matrix: &Matrix<f64, R, C, S>) -> Self {
        Self::Real {
            size: vec![matrix.nrows(), matrix.ncols()],
            numbers: matrix.iter().copied().collect(),
        }
    }
}

impl From<f64> for Value {
    fn from(number: f64) -> Self {
        Self::column([number])
    }
}

impl From<&str> for Value {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl Value {
    /// A column of real numbers.
    pub fn column(numbers: impl IntoIterator<Item = f64>) -> Self {
        let numbers: Vec<f64> = numbers.into_iter().collect();
        Self::Real {
            size: vec![numbers.len(), 1],
            numbers,
        }
    }

    /// A column of complex numbers.
    pub fn complex_column(numbers: impl IntoIterator<Item = Complex<f64>>) -> Self {
        let numbers: Vec<_> = numbers.into_iter().collect();
        Self::Complex {
            size: vec![numbers.len(), 1],
            numbers,
        }
    }

    /// Complex matrices of one size, one behind the other along the third index; 0×0×0 without any.
    pub fn stack(matrices: &[DMatrix<Complex<f64>>]) -> Self {
        let [rows, columns] = matrices.first().map_or([0, 0], |m| [m.nrows(), m.ncols()]);
        Self::Complex {
            size: vec![rows, columns, matrices.len()],
            numbers: matrices.iter().flat_map(|m| m.iter().copied()).collect(),
        }
    }

    /// A cell array with one column of texts.
    pub fn texts<T: AsRef<str>>(texts: impl IntoIterator<Item = T>) -> Self {
        let texts = texts.into_iter();
        Self::Cells(texts.map(|text| text.as_ref().into()).collect())
    }
}

/// The bytes of a MAT-file with these `variables`; `about` is the text that it begins with, of which
/// 116 bytes are kept.
///
/// The same variables give the same bytes: the time is not part of the file.
///
/// # Errors
/// [`TooLarge`].
pub fn encode(about: &str, variables: &[Field]) -> Result<Vec<u8>, TooLarge> {
    const TEXT: usize = 116;
    const SUBSYSTEM: [u8; 8] = [b' '; 8];
    const VERSION: u16 = 0x0100;
    let ascii = about
        .chars()
        .map(|c| if c.is_ascii() { c as u8 } else { b'?' });
    let mut bytes: Vec<u8> = b"MATLAB 5.0 MAT-file, "
        .iter()
        .copied()
        .chain(ascii)
        .collect();
    bytes.resize(TEXT, b' ');
    bytes.extend(SUBSYSTEM);
    bytes.extend(VERSION.to_le_bytes());
    // A reader that finds these two letters so knows that the numbers are little-endian.
    bytes.extend(b"IM");
    for (name, value) in variables {
        bytes.extend(array(name, value)?);
    }
    Ok(bytes)
}

/// The types of an element's bytes.
#[derive(Clone, Copy)]
enum Type {
    Int8 = 1,
    Int32 = 5,
    UInt32 = 6,
    Double = 9,
    Matrix = 14,
    Utf8 = 16,
}

/// The classes of arrays.
#[derive(Clone, Copy)]
enum Class {
    Cell = 1,
    Structure = 2,
    Char = 4,
    Double = 6,
}

/// The flag of complex numbers, beside the class.
const COMPLEX: u32 = 0x0800;

/// The room for the name of a field, with a zero at its end.
const FIELD: usize = 32;

/// An element: its tag, its bytes, and zeros up to a multiple of eight.
fn element(kind: Type, bytes: &[u8]) -> Result<Vec<u8>, TooLarge> {
    let length = u32::try_from(bytes.len()).map_err(|_| TooLarge)?;
    let mut whole = Vec::with_capacity(8 + bytes.len().next_multiple_of(8));
    whole.extend((kind as u32).to_le_bytes());
    whole.extend(length.to_le_bytes());
    whole.extend(bytes);
    whole.resize(whole.len().next_multiple_of(8), 0);
    Ok(whole)
}

fn doubles(numbers: impl Iterator<Item = f64>) -> Result<Vec<u8>, TooLarge> {
    let bytes: Vec<u8> = numbers.flat_map(f64::to_le_bytes).collect();
    element(Type::Double, &bytes)
}

/// An array as an element, with its name; fields and cells have none.
fn array(name: &str, value: &Value) -> Result<Vec<u8>, TooLarge> {
    let (class, size, flags) = match value {
        Value::Real { size, .. } => (Class::Double, size.clone(), 0),
        Value::Complex { size, .. } => (Class::Double, size.clone(), COMPLEX),
        // The length is that of the bytes, as MATLAB writes it.
        Value::Text(text) => (
            Class::Char,
            vec![usize::from(!text.is_empty()), text.len()],
            0,
        ),
        Value::Cells(cells) => (Class::Cell, vec![cells.len(), 1], 0),
        Value::Structure(_) => (Class::Structure, vec![1, 1], 0),
    };
    let flags = [class as u32 | flags, 0];
    let flags: Vec<u8> = flags.into_iter().flat_map(u32::to_le_bytes).collect();
    let mut lengths = Vec::new();
    for length in size {
        let length = i32::try_from(length).map_err(|_| TooLarge)?;
        lengths.extend(length.to_le_bytes());
    }
    let mut bytes = element(Type::UInt32, &flags)?;
    bytes.extend(element(Type::Int32, &lengths)?);
    bytes.extend(element(Type::Int8, name.as_bytes())?);
    match value {
        Value::Real { numbers, .. } => bytes.extend(doubles(numbers.iter().copied())?),
        Value::Complex { numbers, .. } => {
            bytes.extend(doubles(numbers.iter().map(|z| z.re))?);
            bytes.extend(doubles(numbers.iter().map(|z| z.im))?);
        }
        Value::Text(text) => bytes.extend(element(Type::Utf8, text.as_bytes())?),
        Value::Cells(cells) => {
            for cell in cells {
                bytes.extend(array("", cell)?);
            }
        }
        Value::Structure(fields) => {
            // A short element: type and length in one word, the four bytes in the next.
            bytes.extend((4 << 16 | Type::Int32 as u32).to_le_bytes());
            bytes.extend((FIELD as u32).to_le_bytes());
            let mut names = Vec::new();
            for (i, (name, _)) in fields.iter().enumerate() {
                debug_assert!(name.len() < FIELD);
                names.extend(name.as_bytes());
                names.resize(FIELD * (i + 1), 0);
            }
            bytes.extend(element(Type::Int8, &names)?);
            for (_, value) in fields {
                bytes.extend(array("", value)?);
            }
        }
    }
    element(Type::Matrix, &bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Words of 32 bits after the header.
    fn words(bytes: &[u8]) -> Vec<u32> {
        assert_eq!(&bytes[..29], b"MATLAB 5.0 MAT-file, by tests");
        assert_eq!(bytes[29..124], [b' '; 95]);
        assert_eq!(bytes[124..128], [0x00, 0x01, b'I', b'M']);
        assert!(bytes.len().is_multiple_of(8));
        let words = bytes[128..].chunks_exact(4);
        let little = |word: &[u8]| u32::from_le_bytes(word.try_into().unwrap());
        words.map(little).collect()
    }

    /// The bytes by hand, as the description of the format has them for a number 1.0 named "a".
    #[test]
    fn a_number_is_as_the_format_says() {
        let file = encode("by tests", &[("a", 1.0.into())]).unwrap();
        let one = 1f64.to_bits();
        let expected = [
            // Matrix of 64 bytes; flags: class double; 1×1; its name; eight bytes of a double.
            [14, 64],
            [6, 8],
            [6, 0],
            [5, 8],
            [1, 1],
            [1, 1],
            [u32::from(b'a'), 0],
            [9, 8],
            [one as u32, (one >> 32) as u32],
        ];
        assert_eq!(words(&file), expected.as_flattened());
    }

    /// Every element of nested values lies in the one that it is part of, at a multiple of eight bytes.
    #[test]
    fn elements_are_nested_and_aligned() {
        let matrix = DMatrix::from_element(2, 3, Complex::new(1.0, -2.0));
        let value = Value::Structure(vec![
            ("texts", Value::texts(["", "Füße", "seven77"])),
            ("stack", Value::stack(&[matrix.clone(), matrix])),
        ]);
        let file = encode("by tests", &[("s", value), ("x", 2.0.into())]).unwrap();
        let mut arrays = 0;
        check(&words(&file), &mut arrays);
        // s, texts and three of them, stack, x.
        assert_eq!(arrays, 7);
    }

    fn check(mut words: &[u32], arrays: &mut usize) {
        while let [kind, length, rest @ ..] = words {
            if kind >> 16 > 0 {
                // A short element.
                words = rest;
                continue;
            }
            let count = (*length as usize).next_multiple_of(8) / 4;
            let (content, after) = rest.split_at(count);
            if *kind == Type::Matrix as u32 {
                *arrays += 1;
                check(content, arrays);
            }
            words = after;
        }
        assert!(words.is_empty());
    }
}
