//! From a machine's geometry to a controller table.
//!
//! Data flows one way, one module a stage:
//!
//! | module | from | to |
//! |---|---|---|
//! | [`machine`] | a TOML file | nodes, bodies, beams, board, checked |
//! | [`outline`] | a few numbers | the text of a machine file |
//! | [`multibody`] | the machine | M, K, q_d, M_r, B_0 and the modes |
//! | [`statics`], [`energy`] | the machine, its modes | loads under gravity, where modes have their energy |
//! | [`design`] | the rigid design model | K_a, K_v or K_P, K_I |
//! | [`plant`] | modes, inputs, outputs | the generalised plant G, continuous and sampled |
//! | [`zeros`], [`export`] | the plant | transmission zeros of G22, matrices for other programs |
//! | [`closed_loop`] | sampled plant and table | stability, sensitivity, isolation |
//! | [`law`] | a table | its law as a linear system |
//! | [`shape`], [`tuning`] | design, sampled plant | the best shape of each mode |
//! | [`shaping`] | all of these | the shaping that the sampled loop bears |
//! | [`margins`] | the loop | disk margins, Bode's integral |
//! | [`rounding`] | a table | what single precision costs |
//! | [`supervision`] | machine, plant | when the supervisor acts, what the self-test must find |
//! | [`robustness`] | machine, table | the same controller on machines drawn about the file's |
//! | [`table`] | gains and board | the table and its Rust source |
//! | [`spectrum`] | sampled plant, table, a floor | spectra, their sources, the criterion met |
//! | [`simulation`] | sampled plant and table | the loop in time, with converters and noise |
//! | [`sil`] | a study, a table | a board that is software |
//! | [`link`] | an address | a session with a board |
//! | [`frf`] | a session with a board | transfer functions measured in place, beside the model's |
//! | [`campaign`] | a study, a table | what becomes of faults in the loop |
//! | [`study`] | a machine | all of these up to the plant |
//! | [`history`] | a study, a table | a session in time |
//! | [`output`] | results | text and JSON |
//! | [`report`] | all of these | a page, pictures, tables of numbers |
//!
//! Equation numbers are those of J. van Dijk, "Mechatronic Design of
//! Hard-Mount Concepts for Precision Equipment". SI units; frequencies in Hz
//! where a name says so or a person reads them, else rad/s.
#![forbid(unsafe_code)]

/// The book's examples are tests.
#[cfg(doctest)]
#[doc = include_str!("../../docs/library.md")]
pub struct Library;

pub mod campaign;
pub mod closed_loop;
pub mod design;
pub mod energy;
pub mod export;
pub mod frf;
pub mod history;
pub mod law;
pub mod linear;
pub mod link;
pub mod machine;
pub mod margins;
pub mod multibody;
pub mod outline;
pub mod output;
pub mod plant;
pub mod report;
pub mod robustness;
pub mod rounding;
pub mod shape;
pub mod shaping;
pub mod sil;
pub mod simulation;
pub mod spectrum;
pub mod statics;
pub mod study;
pub mod supervision;
pub mod table;
pub mod tuning;
pub mod zeros;
