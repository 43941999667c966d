//! The law of a table as a linear system: [`shared::step`] without clamp and rounding errors.

use nalgebra::{Complex, DMatrix, DVector, Matrix6};
use shared::LEGS;
use shared::table::{Channel, Direct, Modal, Paths, Section, ValidTable};

use crate::plant::{Control, DiscreteStateSpace};

/// The linear law of a table, from sensor values, m/s² or N, to leg forces, N.
///
/// It has the table's coefficients, which are rounded to single precision.
#[derive(Clone, Copy, Debug)]
pub struct LinearLaw {
    ac_coupling: f64,
    leak: f64,
    paths: Paths,
}

impl LinearLaw {
    /// The law in `table`.
    pub fn new(table: &ValidTable) -> Self {
        let table = table.get();
        Self {
            ac_coupling: table.ac_coupling.into(),
            leak: table.law.leak.into(),
            paths: table.law.paths,
        }
    }

    /// This law with all its forces multiplied by `gain`, as the board's loop gain does.
    pub fn with_gain(mut self, gain: f64) -> Self {
        match &mut self.paths {
            Paths::Direct(direct) => {
                direct.proportional *= gain as f32;
                direct.integral *= gain as f32;
            }
            Paths::Modal(modal) => modal.output *= gain as f32,
        }
        self
    }

    /// The number of sensors: six, or twelve if the law uses accelerometers and force sensors.
    pub fn sensors(&self) -> usize {
        match &self.paths {
            Paths::Modal(modal) if modal.complement.is_some() => 2 * LEGS,
            Paths::Modal(_) | Paths::Direct(_) => LEGS,
        }
    }

    /// C(z) of σ = C(z)·y, the complex gains from sensors to leg forces, at `z` = e^(jωT).
    pub fn response(&self, z: Complex<f64>) -> Control {
        let high_pass = ac_coupling(self.ac_coupling, z);
        let mut control = Control::zeros(self.sensors());
        match &self.paths {
            Paths::Direct(direct) => {
                let shaping = -(high_pass * low_pass(f64::from(direct.roll_off), z));
                let integral = integral(self.leak, z);
                control.copy_from(
                    &(direct.proportional.map(|p| shaping * f64::from(p))
                        + direct.integral.map(|i| shaping * integral * f64::from(i))),
                );
            }
            Paths::Modal(modal) => {
                let complex = |m: &Matrix6<f32>| m.map(|x| Complex::from(f64::from(x)));
                let mut by_kind = vec![complex(&modal.input) * high_pass];
                if let Some(complement) = &modal.complement {
                    by_kind.push(complex(&complement.input));
                    for (i, &split) in complement.split.iter().enumerate() {
                        let low = low_pass(f64::from(split), z);
                        for (kind, part) in by_kind.iter_mut().zip([low, 1.0 - low]) {
                            kind.row_mut(i).iter_mut().for_each(|x| *x *= part);
                        }
                    }
                }
                let output = complex(&modal.output);
                for (kind, mut modes) in by_kind.into_iter().enumerate() {
                    for (i, channel) in modal.channels.iter().enumerate() {
                        let gain = -channel_response(channel, modal.sections, self.leak, z);
                        modes.row_mut(i).iter_mut().for_each(|x| *x *= gain);
                    }
                    control
                        .fixed_columns_mut::<LEGS>(kind * LEGS)
                        .copy_from(&(output * modes));
                }
            }
        }
        control
    }

    /// The number of second-order sections of each channel.
    fn sections(&self) -> usize {
        match &self.paths {
            Paths::Direct(_) => 0,
            Paths::Modal(modal) => modal.sections,
        }
    }

    /// The names and units of the states of [`state_space`](Self::state_space), in their order. Units
    /// are in ASCII: `N/sqrt(kg)` is that of modal forces, and of √kg·m/s². `sensor` is that of
    /// the first six sensors.
    pub fn states(&self, sensor: &'static str) -> Vec<(String, &'static str)> {
        let (shaped, force) = match self.paths {
            Paths::Direct(_) => (sensor, "N"),
            Paths::Modal(_) => (MODAL_FORCE, MODAL_FORCE),
        };
        let mut groups = vec![
            ("average1".to_owned(), sensor),
            ("average2".to_owned(), sensor),
            ("before".to_owned(), shaped),
            ("integral".to_owned(), force),
        ];
        for section in 1..=self.sections() {
            groups.extend([1, 2].map(|x| (format!("section{section}_x{x}"), shaped)));
        }
        if self.sensors() > LEGS {
            groups.push(("difference".to_owned(), shaped));
        }
        let each =
            |(name, unit): (String, _)| (1..=LEGS).map(move |i| (format!("{name}_{i}"), unit));
        groups.into_iter().flat_map(each).collect()
    }

    /// The law as a discrete system, from six or twelve sensor values, m/s² or N, to the six leg forces,
    /// N.
    pub fn state_space(&self) -> DiscreteStateSpace {
        let sections = self.sections();
        let beside = self.sensors() > LEGS;
        // Six states each: two high-passes, previous input, integral, two for each section, and
        // the low-pass that combines the two kinds of sensors.
        let states = LEGS * (4 + 2 * sections + usize::from(beside));
        let columns = states + self.sensors();
        let mut law = Signals {
            next: DMatrix::zeros(states, columns),
        };
        let y = law.at(states);
        let h1 = law.at(0);
        let v = y - &h1;
        law.set(0, h1 + self.ac_coupling * &v);
        let h2 = law.at(LEGS);
        let w = v - &h2;
        law.set(LEGS, h2 + self.ac_coupling * &w);
        let [before_at, integral_at] = [2, 3].map(|i| LEGS * i);
        let before = law.at(before_at);
        let kept = (1.0 - self.leak) * law.at(integral_at);
        let force = match &self.paths {
            Paths::Direct(Direct {
                roll_off,
                proportional,
                integral,
            }) => {
                let r = &before + f64::from(*roll_off) * (w - &before);
                let x = kept + matrix(integral) * (&r + before);
                law.set(integral_at, x.clone());
                law.set(before_at, r.clone());
                -(x + matrix(proportional) * r)
            }
            Paths::Modal(Modal {
                input,
                complement,
                channels,
                output,
                ..
            }) => {
                let mut r = matrix(input) * w;
                if let Some(complement) = complement {
                    let f = matrix(&complement.input) * law.at(states + LEGS);
                    let at = states - LEGS;
                    let d = law.at(at);
                    let split = complement.split.map(f64::from);
                    let split = DMatrix::from_diagonal(&DVector::from_column_slice(&split));
                    let d = &d + split * (r - &f - &d);
                    law.set(at, d.clone());
                    r = f + d;
                }
                for j in 0..sections {
                    let of = |part: fn(&Section) -> f32| {
                        diagonal(channels, |channel| part(&channel.sections[j]))
                    };
                    let at = LEGS * (4 + 2 * j);
                    let (x1, x2) = (law.at(at), law.at(at + LEGS));
                    let out = of(|s| s.direct) * &r + of(|s| s.band) * &x1 + of(|s| s.low) * &x2;
                    let slope = r - of(|s| s.damping) * &x1 - &x2;
                    law.set(at + LEGS, x2 + of(|s| s.rate) * &x1);
                    law.set(at, x1 + of(|s| s.rate) * slope);
                    r = out;
                }
                let x = kept + diagonal(channels, |channel| channel.integral) * (&r + before);
                law.set(integral_at, x.clone());
                law.set(before_at, r.clone());
                let asked = x + diagonal(channels, |channel| channel.proportional) * r;
                -(matrix(output) * asked)
            }
        };
        let part =
            |all: &DMatrix<f64>, from: usize, count: usize| all.columns(from, count).into_owned();
        DiscreteStateSpace {
            a: part(&law.next, 0, states),
            b: part(&law.next, states, self.sensors()),
            c: part(&force, 0, states),
            d: part(&force, states, self.sensors()),
        }
    }
}

/// The unit of modal forces, and of modal accelerations, √kg·m/s².
const MODAL_FORCE: &str = "N/sqrt(kg)";

/// The next states as rows of coefficients on the states and inputs before the sample.
struct Signals {
    next: DMatrix<f64>,
}

impl Signals {
    /// The six states, or inputs, from column `first` on, as rows of coefficients.
    fn at(&self, first: usize) -> DMatrix<f64> {
        let mut rows = DMatrix::zeros(LEGS, self.next.ncols());
        rows.view_mut((0, first), (LEGS, LEGS)).fill_with_identity();
        rows
    }

    fn set(&mut self, first: usize, rows: DMatrix<f64>) {
        self.next.rows_mut(first, LEGS).copy_from(&rows);
    }
}

fn matrix(m: &Matrix6<f32>) -> DMatrix<f64> {
    DMatrix::from_fn(LEGS, LEGS, |i, j| m[(i, j)].into())
}

fn diagonal(channels: &[Channel; LEGS], of: impl Fn(&Channel) -> f32) -> DMatrix<f64> {
    let values = channels.iter().map(|channel| f64::from(of(channel)));
    DMatrix::from_diagonal(&DVector::from_iterator(LEGS, values))
}

/// The response of the AC coupling at `z`: two first-order high-passes with the coefficient `c`.
pub fn ac_coupling(c: f64, z: Complex<f64>) -> Complex<f64> {
    let one = (z - 1.0) / (z - 1.0 + c);
    one * one
}

/// The response of the low-pass x += c·(input − x) at `z`, with the coefficient `c`.
pub fn low_pass(c: f64, z: Complex<f64>) -> Complex<f64> {
    z * c / (z - 1.0 + c)
}

/// The response of the leaky trapezoidal integral at `z`, divided by T/2.
fn integral(leak: f64, z: Complex<f64>) -> Complex<f64> {
    (z + 1.0) / (z - 1.0 + leak)
}

/// The response of one channel at `z`: its first `sections` sections, then proportional plus
/// integral. `leak` is the coefficient of the integral's leak.
pub fn channel_response(
    channel: &Channel,
    sections: usize,
    leak: f64,
    z: Complex<f64>,
) -> Complex<f64> {
    let shaping: Complex<f64> = channel.sections[..sections]
        .iter()
        .map(|section| section_response(section, z))
        .product();
    shaping * (integral(leak, z) * f64::from(channel.integral) + f64::from(channel.proportional))
}

/// The response of one second-order section at `z`.
pub fn section_response(section: &Section, z: Complex<f64>) -> Complex<f64> {
    let [c, d, direct, band, low] = [
        section.rate,
        section.damping,
        section.direct,
        section.band,
        section.low,
    ]
    .map(f64::from);
    let delta = z - 1.0;
    let low_pass = c * c / (delta * (delta + c * d) + c * c);
    direct + low_pass * (low + delta * (band / c))
}
