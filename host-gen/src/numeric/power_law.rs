//! Straight lines on logarithmic axes.

/// The value at `x` of the power law through two points, all coordinates above 0.
pub fn power_law([(x0, y0), (x1, y1)]: [(f64, f64); 2], x: f64) -> f64 {
    y0 * ((y1.ln() - y0.ln()) * (x.ln() - x0.ln()) / (x1.ln() - x0.ln())).exp()
}

/// Its exponent, d ln y/d ln x.
pub fn exponent([(x0, y0), (x1, y1)]: [(f64, f64); 2]) -> f64 {
    (y1.ln() - y0.ln()) / (x1.ln() - x0.ln())
}

/// The exponent of the greater magnitude.
pub(crate) fn steeper(a: f64, b: f64) -> f64 {
    if b.abs() > a.abs() { b } else { a }
}
