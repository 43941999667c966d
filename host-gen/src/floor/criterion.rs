//! Vibration criteria.

use core::f64::consts::TAU;

use serde::Serialize;

/// Vibration criteria of the IEST, and NIST-A: one-third-octave rms velocities.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[expect(missing_docs, reason = "the variants are the names of the criteria")]
pub enum Criterion {
    VcA,
    VcB,
    VcC,
    VcD,
    VcE,
    VcF,
    VcG,
    NistA,
}

impl Criterion {
    /// VC-A to VC-G, the least strict first.
    pub const VC: [Self; 7] = {
        let [vc @ .., _nist] = Self::ALL;
        vc
    };

    /// All criteria.
    pub const ALL: [Self; 8] = [
        Self::VcA,
        Self::VcB,
        Self::VcC,
        Self::VcD,
        Self::VcE,
        Self::VcF,
        Self::VcG,
        Self::NistA,
    ];

    /// The name in lower case, as on a command line.
    pub fn key(self) -> &'static str {
        match self {
            Self::VcA => "vc-a",
            Self::VcB => "vc-b",
            Self::VcC => "vc-c",
            Self::VcD => "vc-d",
            Self::VcE => "vc-e",
            Self::VcF => "vc-f",
            Self::VcG => "vc-g",
            Self::NistA => "nist-a",
        }
    }

    /// The name as printed.
    pub fn name(self) -> &'static str {
        match self {
            Self::VcA => "VC-A",
            Self::VcB => "VC-B",
            Self::VcC => "VC-C",
            Self::VcD => "VC-D",
            Self::VcE => "VC-E",
            Self::VcF => "VC-F",
            Self::VcG => "VC-G",
            Self::NistA => "NIST-A",
        }
    }

    /// Lowest frequency of the criterion, Hz.
    pub fn begins(self) -> f64 {
        match self {
            Self::VcA | Self::VcB => 4.0,
            _ => 1.0,
        }
    }

    /// Whether the criterion has a limit in the one-third-octave band with centre `hz`,
    /// Hz. A band with the nominal centre 4 Hz has its exact centre at 10^0.6 = 3.98 Hz.
    pub fn covers(self, hz: f64) -> bool {
        hz > 0.98 * self.begins()
    }

    /// The frequencies that the criterion's one-third-octave bands span, lowest and highest, Hz.
    pub fn needs(self) -> [f64; 2] {
        let mut own = third_centres().filter(|hz| self.covers(*hz));
        // Every criterion covers the band at 80 Hz.
        let [low, high] = own.next().map_or([0.0; 2], third_edges);
        [low, own.last().map_or(high, |hz| third_edges(hz)[1])]
    }

    /// The frequencies at which [`velocity`](Self::velocity) is not smooth, Hz.
    pub(super) fn breaks(self) -> &'static [f64] {
        match self {
            Self::VcA | Self::VcB => &[4.0, 8.0],
            Self::NistA => &[20.0],
            _ => &[],
        }
    }

    /// The highest allowed rms velocity in the one-third-octave band with centre `hz`,
    /// m/s. VC-A and B are flat from 8 Hz and rise as 1/f from there down to 4 Hz; C to G
    /// are flat; NIST-A is 0.025 µm up to 20 Hz and 3.1 µm/s above. Outside the
    /// frequencies of the criterion, this goes on: the velocity is constant, or below 20 Hz the
    /// displacement of NIST-A.
    pub fn velocity(self, hz: f64) -> f64 {
        let rising = |flat: f64| flat * 8.0 / hz.clamp(4.0, 8.0);
        1e-6 * match self {
            Self::VcA => rising(50.0),
            Self::VcB => rising(25.0),
            Self::VcC => 12.5,
            Self::VcD => 6.25,
            Self::VcE => 3.125,
            Self::VcF => 1.5625,
            Self::VcG => 0.781_25,
            Self::NistA if hz < 20.0 => 0.025 * TAU * hz,
            Self::NistA => 3.1,
        }
    }
}

/// Exact centres of the one-third-octave bands from 1 to 80 Hz, ascending, Hz.
pub fn third_centres() -> impl Iterator<Item = f64> {
    (0..20).map(|n| 10f64.powf(f64::from(n) / 10.0))
}

/// Lower and upper edge of the one-third-octave band with centre `hz`, Hz.
pub fn third_edges(hz: f64) -> [f64; 2] {
    let half = 2f64.powf(1.0 / 6.0);
    [hz / half, hz * half]
}

/// The error of a name that is not the name of a criterion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("not a criterion: write vc-a to vc-g, or nist-a")]
pub struct UnknownCriterion;

impl core::str::FromStr for Criterion {
    type Err = UnknownCriterion;

    fn from_str(key: &str) -> Result<Self, UnknownCriterion> {
        let mut all = Self::ALL.into_iter();
        all.find(|criterion| criterion.key() == key)
            .ok_or(UnknownCriterion)
    }
}
