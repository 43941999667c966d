//! What a controller is: the ideal gains, the shapes of its channels, the table built from them,
//! and the table as a linear law.

pub mod emit;
pub mod gains;
pub mod law;
pub mod shape;
pub mod supervision;
pub mod table;

pub use gains::Gains;
pub use law::LinearLaw;
pub use shape::Shape;
