//! `host-gen sigma` in text.

use std::fmt::{self, Display, Formatter};

use super::aligned::TITLE;
use crate::analysis::sigma::SigmaAnalysis;

impl Display for SigmaAnalysis {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{TITLE}σ_max(G11) of {}, dB, at the peaks of each curve{TITLE:#}",
            self.machine
        )?;
        for curve in &self.curves {
            writeln!(f, "  {}", curve.name)?;
            let db: Vec<f64> = curve.sigma_max.iter().map(|s| 20.0 * s.log10()).collect();
            for i in peaks(&db) {
                writeln!(f, "    {:>10.3} Hz {:>8.1} dB", self.hz[i], db[i])?;
            }
        }
        for missing in &self.missing {
            writeln!(f, "  not shown: {missing}")?;
        }
        Ok(())
    }
}

/// Indices of the maxima at least half a dB above the minima on either side: ripples from
/// rounding between close frequencies are left out.
fn peaks(db: &[f64]) -> Vec<usize> {
    const RISE: f64 = 0.5;
    let mut peaks = Vec::new();
    let (mut top, mut bottom) = (0, 0);
    let mut rising = false;
    for i in 0..db.len() {
        if rising {
            if db[i] > db[top] {
                top = i;
            } else if db[i] < db[top] - RISE {
                peaks.push(top);
                rising = false;
                bottom = i;
            }
        } else if db[i] < db[bottom] {
            bottom = i;
        } else if db[i] > db[bottom] + RISE {
            rising = true;
            top = i;
        }
    }
    peaks
}
