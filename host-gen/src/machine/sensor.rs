//! A sensor with its noise and its dynamics, from the file's form.

use super::checked::{LowerCorner, Sensor};
use super::error::EntryError;
use super::file::{Resonance, SensorEntry};
use super::noise::NoiseDensity;
use super::validate::{Checked, not_zero, number, positive};

/// The sensor that `spec` describes under the key `entry`.
pub(super) fn sensor(entry: &str, spec: Option<&SensorEntry>) -> Checked<Option<Sensor>> {
    let Some(spec) = spec else {
        return Ok(None);
    };
    let key = |key: &str| format!("{entry}.{key}");
    let sensor = Sensor {
        sensitivity: not_zero(&key("sensitivity"), spec.sensitivity)?,
        noise_density: NoiseDensity::new(&key("noise_density"), &spec.noise_density)?,
        offset: number(&key("offset"), spec.offset, true, "")?,
        bandwidth: bandwidth(&key("bandwidth"), spec.bandwidth)?,
        lower_corner: lower_corner(entry, spec)?,
        resonance: resonance(entry, spec.resonance)?,
        transverse: transverse(&key("transverse"), spec.transverse.unwrap_or(0.0))?,
    };
    let peak = sensor.resonance.map(|peak| ("resonance.hz", peak.hz));
    let uppers = [sensor.bandwidth.map(|hz| ("bandwidth", hz)), peak];
    for (name, upper) in uppers.into_iter().flatten() {
        if let Some(lower) = sensor.lower_corner
            && lower.hz() > 0.5 * upper
        {
            let lower = lower.hz();
            let message = format!(
                "lower_corner must be at most half of {name}, {upper} Hz, not {lower}: the sensor would pass nothing"
            );
            return Err(EntryError::new(key("lower_corner"), message));
        }
    }
    Ok(Some(sensor))
}

/// A bandwidth `hz` under the key `entry`, Hz.
pub(super) fn bandwidth(entry: &str, hz: Option<f64>) -> Checked<Option<f64>> {
    hz.map(|hz| positive(entry, hz, "Hz")).transpose()
}

/// The largest transverse sensitivity: the sine of 17°.
const MOST_TRANSVERSE: f64 = 0.3;

fn transverse(entry: &str, part: f64) -> Checked<f64> {
    let right = (0.0..=MOST_TRANSVERSE).contains(&part);
    number(
        entry,
        part,
        right,
        "be 0 to 0.3, a part of an acceleration across the axis",
    )
}

fn lower_corner(entry: &str, spec: &SensorEntry) -> Checked<Option<LowerCorner>> {
    let hz = bandwidth(&format!("{entry}.lower_corner"), spec.lower_corner)?;
    let at = || format!("{entry}.lower_order");
    match (hz, spec.lower_order) {
        (None, None) => Ok(None),
        (Some(hz), None | Some(1)) => Ok(Some(LowerCorner::First(hz))),
        (Some(hz), Some(2)) => Ok(Some(LowerCorner::Second(hz))),
        (Some(_), Some(order)) => {
            let message = format!("lower_order must be 1 or 2, not {order}");
            Err(EntryError::new(at(), message))
        }
        (None, Some(_)) => Err(
            EntryError::new(at(), "there is no lower_corner that has an order")
                .fix("give lower_corner, in Hz, or remove lower_order"),
        ),
    }
}

fn resonance(entry: &str, spec: Option<Resonance>) -> Checked<Option<Resonance>> {
    let Some(Resonance { hz, damping }) = spec else {
        return Ok(None);
    };
    positive(&format!("{entry}.resonance.hz"), hz, "Hz")?;
    // More is no resonance, and at 1 both poles are equal.
    let right = (1e-4..=0.99).contains(&damping);
    number(
        &format!("{entry}.resonance.damping"),
        damping,
        right,
        "be 0.0001 to 0.99",
    )?;
    Ok(spec)
}
