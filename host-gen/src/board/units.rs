//! A board's records in physical units.

use shared::LEGS;
use shared::codes::{Calibration, Drive};
use shared::recorder::Record;

use crate::machine::Machine;

/// The scales of a board's converters and the names of its channels, for records in m/s² and N.
#[derive(Clone, Debug)]
pub struct Scales {
    /// By kind: six sensors, and six force sensors if both kinds are fed back.
    sensors: Vec<[Calibration; LEGS]>,
    legs: [Drive; LEGS],
    columns: Vec<String>,
}

impl Scales {
    /// Those of the board of `machine`. They depend on the machine file alone, not on the controller.
    pub fn new(machine: &Machine) -> Self {
        let feedback = machine.target.feedback;
        let sensors = machine.sensor_names(feedback).into_iter();
        let sensors = sensors.zip(machine.sensor_units(feedback));
        let legs = machine.actuators.iter();
        let legs = legs.map(|&beam| format!("force {} [N]", machine.beams[beam].name));
        let (own, beside) = machine.board.calibrations();
        Self {
            sensors: [Some(own), beside].into_iter().flatten().collect(),
            legs: machine.board.drives(),
            columns: sensors
                .map(|(name, unit)| format!("sensor {name} [{unit}]"))
                .chain(legs)
                .collect(),
        }
    }

    /// The names of the columns, each with its unit: the sensors, then the forces that the legs were
    /// told to make.
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// The values of a record, one for each column, m/s² or N. Those of the sensors have their offset.
    pub fn values(&self, record: &Record) -> impl Iterator<Item = f32> {
        let codes = [record.adc.sensors, record.adc.forces];
        let sensors = self.sensors.iter().zip(codes);
        let legs = self.legs.iter().zip(record.dac);
        sensors
            .flat_map(|(kind, codes)| kind.iter().zip(codes).map(|(c, code)| c.value(code)))
            .chain(legs.map(|(leg, code)| leg.force(code)))
    }
}

#[cfg(test)]
mod tests {
    use shared::codes::{AdcCode, DacCode, Samples};

    use super::*;

    fn scales(file: &str) -> Scales {
        let models = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../models");
        Scales::new(&Machine::load(&models.join(file)).unwrap())
    }

    /// With the numbers of the file: 20 V over 16 bits, 20 V/(m/s²) and 0.02 V/N; 5 V over 16 bits and
    /// 100 N/V about the middle.
    #[test]
    fn values_are_those_of_the_converters() {
        let mut record = Record::NONE;
        record.adc = Samples {
            sensors: [0, 1, -1, 32767, -32768, 100].map(AdcCode),
            forces: [AdcCode(1000); LEGS],
        };
        record.dac = [32768, 32769, 32767, 40000, 0, 65535].map(DacCode);
        let volts = |code: i32| f64::from(code) * 20.0 / 65536.0;
        let sensors = [0, 1, -1, 32767, -32768, 100].map(|code| volts(code) / 20.0);
        let forces = [volts(1000) / 0.02; LEGS];
        let legs = [0, 1, -1, 7232, -32768, 32767].map(|n| f64::from(n) * 5.0 / 65536.0 * 100.0);
        for (file, expected) in [
            ("metrology-frame.toml", [sensors, legs].as_flattened()),
            ("both-sensors.toml", [sensors, forces, legs].as_flattened()),
        ] {
            let scales = scales(file);
            let found: Vec<f32> = scales.values(&record).collect();
            assert_eq!(found.len(), expected.len());
            assert_eq!(scales.columns().len(), expected.len());
            for (found, expected) in found.iter().zip(expected) {
                let off = (f64::from(*found) - expected).abs();
                assert!(off <= 1e-6 * expected.abs(), "{found} {expected}");
            }
        }
    }

    #[test]
    fn columns_have_units() {
        let both = scales("both-sensors.toml");
        let kinds = both.columns().chunks_exact(LEGS);
        for (columns, (start, end)) in kinds.zip([
            ("sensor ", " [m/s^2]"),
            ("sensor leg", " [N]"),
            ("force leg", " [N]"),
        ]) {
            for column in columns {
                assert!(
                    column.starts_with(start) && column.ends_with(end),
                    "{column}"
                );
            }
        }
    }
}
