//! How each suspension mode follows the floor: without control, with the ideal law, and
//! with the sampled law.

use nalgebra::Complex;
use serde::Serialize;

use crate::closed_loop::isolation::{corner, isolation_band};
use crate::closed_loop::{SampledLoop, close_ideal, ideal_poles, stable};
use crate::design::Study;
use crate::numeric::NumericError;
use crate::numeric::frequencies::{grid, pole_peaks};
use crate::plant::Gain;

/// Frequencies at which isolation is reported, Hz.
pub(crate) const AT: [f64; 6] = [2.0, 5.0, 10.0, 20.0, 50.0, 100.0];

/// One mode of the design model.
#[derive(Debug, Serialize)]
pub(crate) struct ModeIsolation {
    /// Natural frequency without control, Hz.
    pub(crate) hz: f64,
    pub(crate) open: Isolation,
    /// With the ideal law; none if that loop is unstable.
    pub(crate) ideal: Option<Isolation>,
    pub(crate) sampled: Isolation,
}

/// How a mode follows floor motion of the same shape.
#[derive(Debug, Serialize)]
pub(crate) struct Isolation {
    /// Frequency above which the transmissibility is below 1/√2, Hz.
    pub(crate) corner_hz: f64,
    /// Attenuation at each of [`AT`], dB; positive where the mode moves less than the
    /// floor.
    pub(crate) db: [f64; AT.len()],
    /// Highest amplification, dB.
    pub(crate) peak_db: f64,
    /// Frequency of the highest amplification, Hz.
    pub(crate) peak_hz: f64,
}

impl ModeIsolation {
    /// Isolation of every mode of the design model, lowest frequency first. `closed` is
    /// the sampled loop, `poles` are its poles, rad/s.
    ///
    /// # Errors
    /// [`NumericError`] if an eigenvalue iteration does not converge.
    pub(crate) fn all(
        study: &Study,
        closed: &SampledLoop<'_>,
        poles: &[Complex<f64>],
    ) -> Result<Vec<Self>, NumericError> {
        let plant = &study.plant().plant;
        let gains = study.gains();
        let ideal = ideal_poles(&plant.state_space, gains)?;
        let floor = plant.rigid_floor.map(Complex::from);
        let model = study.design_model();
        let band = isolation_band(model, study.machine().target.frequency);
        let whole = plant.whole();
        let open = |hz: f64| plant.open(hz, whole.clone()) * floor;
        let under_ideal = |hz: f64| close_ideal(plant, gains, hz, whole.clone()) * floor;
        let sampled = |hz: f64| closed.transmissibility(hz);
        let modes = model.hertz().into_iter().enumerate();
        Ok(modes
            .map(|(k, hz)| Self {
                hz,
                open: Isolation::new(k, band, &plant.peaks(), &open),
                ideal: stable(&ideal)
                    .then(|| Isolation::new(k, band, &pole_peaks(&ideal), &under_ideal)),
                sampled: Isolation::new(k, band, &pole_peaks(poles), &sampled),
            })
            .collect())
    }
}

impl Isolation {
    fn new(
        mode: usize,
        [low, high]: [f64; 2],
        peaks: &[(f64, f64)],
        gain: &dyn Fn(f64) -> Gain,
    ) -> Self {
        let own = |hz: f64| gain(hz)[(mode, mode)];
        let alone = |hz: f64| Gain::from_fn(1, |_, j| if j == 0 { own(hz) } else { Complex::ZERO });
        let db = |hz: f64| -20.0 * own(hz).norm().log10();
        let (peak_hz, peak_db) = grid(low, high, 200, peaks)
            .into_iter()
            .map(|hz| (hz, -db(hz)))
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or((low, 0.0));
        Self {
            corner_hz: corner(low, high, peaks, alone),
            db: AT.map(db),
            peak_db,
            peak_hz,
        }
    }
}
