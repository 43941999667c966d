//! How long computations report that they advance.

/// Told of every step of a long computation; from any thread.
pub trait Progress: Sync {
    /// One more step is done.
    fn advance(&self);
}

/// Nobody watches.
impl Progress for () {
    fn advance(&self) {}
}
