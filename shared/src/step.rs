//! The controller step: raw ADC codes in, raw DAC codes out.
//!
//! Per sample, with y the calibrated sensor values:
//!
//! ```text
//! v   = y − h1      h1 += c_ac·v                AC coupling, twice; neither
//! w   = v − h2      h2 += c_ac·w                average follows more than a limit
//! ```
//!
//! then, through the matrices of Eq. (14),
//!
//! ```text
//! r  += c_ro·(w − r)                            roll-off
//! x  += −leak·x + K_i·(r + r_before)            leaky trapezoidal integral, N
//! u   = injection − x − K_p·r                   Eqs. (14), (21), (22)
//! ```
//!
//! or through the modes,
//!
//! ```text
//! r   = sections(T_in·w)                        by channel; with force sensors
//!                                               beside them see [`Complement`]
//! x  += −leak·x + k_i·(r + r_before)            N/√kg
//! u   = injection + T_out·(−x − k_p·r)
//! ```
//!
//! and at last
//!
//! ```text
//! σ   = α·u,  α = min(1, limit_i/|u_i|)         clamp that keeps the direction
//! x  += anti_windup·(u − σ)                     only where α < 1; by mode with
//!                                               what the channel itself asks
//! ```
//!
//! Configuration ([`ValidTable`]) is immutable and apart from [`State`].
//! Nothing here can fail or panic; what the supervisor must know is in
//! [`Status`].

use nalgebra::Matrix6;

use crate::LEGS;
use crate::codes::{AdcCode, Calibration, DacCode, LegForces, Samples};
use crate::table::{Complement, Direct, Law, Modal, Paths, SECTIONS, Section, ValidTable};

type Six = [f32; LEGS];

/// What the controller remembers between samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// The two AC-coupling averages, sensor units.
    averages: [Six; 2],
    law: LawState,
}

/// The memory of [`force`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LawState {
    /// By mode, what accelerometers show at low frequency that force sensors do
    /// not, √kg·m/s².
    difference: Six,
    /// By section and then by channel, x1 and x2.
    sections: [[Six; 2]; SECTIONS],
    /// The shaped sample before: of a sensor, or of a mode.
    before: Six,
    /// The integral part of the force: of a leg, N, or of a mode, N/√kg.
    integral: Six,
}

impl LawState {
    /// At rest.
    pub const REST: Self = Self {
        difference: [0.0; LEGS],
        sections: [[[0.0; LEGS]; 2]; SECTIONS],
        before: [0.0; LEGS],
        integral: [0.0; LEGS],
    };
}

impl State {
    /// At rest, with AC coupling and [`Complement`] settled on `adc`: a sensor's
    /// offset gives no kick when the loop starts.
    pub fn settled_on(table: &ValidTable, adc: Samples) -> Self {
        let t = table.get();
        let mut averages = [[0.0; LEGS]; 2];
        if t.ac_coupling > 0.0 {
            averages[0] = calibrate(&t.sensors, adc.sensors);
        }
        let mut law = LawState::REST;
        if let Some(complement) = t.complement() {
            let forces = calibrate(&complement.sensors, adc.forces);
            law.difference = subtract_product(law.difference, &complement.input, &forces);
        }
        Self { averages, law }
    }

    /// Whether every number in it is finite.
    pub fn is_finite(&self) -> bool {
        let finite = |six: &Six| six.iter().all(|x| x.is_finite());
        self.averages.iter().all(finite)
            && finite(&self.law.difference)
            && self.law.sections.as_flattened().iter().all(finite)
            && finite(&self.law.before)
            && finite(&self.law.integral)
    }
}

/// What the step saw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status {
    /// Bit i: sensor i's code was at an end of the ADC's range.
    pub sensors_at_rail: u8,
    /// The same of the force sensors beside them.
    pub forces_at_rail: u8,
    /// The clamp was active.
    pub clamped: bool,
    /// The force was not a finite number; the output is the safe one.
    pub not_finite: bool,
}

impl Status {
    /// Whether any sensor's code was at an end of the ADC's range.
    pub fn at_rail(&self) -> bool {
        self.sensors_at_rail != 0 || self.forces_at_rail != 0
    }
}

/// What one step gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Output {
    /// The codes to latch.
    pub dac: [DacCode; LEGS],
    /// What was seen on the way.
    pub status: Status,
}

fn calibrate(sensors: &[Calibration; LEGS], adc: [AdcCode; LEGS]) -> Six {
    core::array::from_fn(|i| sensors[i].value(adc[i]))
}

/// Bit i: code i is at an end of the ADC's range.
fn at_rail(adc: [AdcCode; LEGS], max: AdcCode) -> u8 {
    let mut bits = 0;
    for (i, code) in adc.iter().enumerate() {
        if code.0 >= max.0 || code.0 < -max.0 {
            bits |= 1 << i;
        }
    }
    bits
}

/// One sample: `adc` as read at this instant, `injection` added to the
/// controller's force before the clamp; out come the codes to latch.
pub fn step(table: &ValidTable, state: &mut State, adc: Samples, injection: LegForces) -> Output {
    let t = table.get();
    let y = calibrate(&t.sensors, adc.sensors);
    let (forces, forces_at_rail) = match t.complement() {
        Some(complement) => (
            calibrate(&complement.sensors, adc.forces),
            at_rail(adc.forces, t.adc_max),
        ),
        None => ([0.0; LEGS], 0),
    };
    let [h1, h2] = &mut state.averages;
    let w: Six = core::array::from_fn(|i| {
        let v = y[i] - h1[i];
        h1[i] += t.ac_coupling * bounded(v, t.ac_limit);
        let w = v - h2[i];
        h2[i] += t.ac_coupling * bounded(w, t.ac_limit);
        w
    });
    let limits = core::array::from_fn(|i| t.actuators[i].limit);
    let (force, clamp) = force(&t.law, &limits, &mut state.law, &w, &forces, &injection.0);
    Output {
        dac: core::array::from_fn(|i| t.actuators[i].code(force[i])),
        status: Status {
            sensors_at_rail: at_rail(adc.sensors, t.adc_max),
            forces_at_rail,
            clamped: clamp == Clamp::Active,
            not_finite: clamp == Clamp::NotFinite,
        },
    }
}

/// What the clamp of [`force`] did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clamp {
    /// All forces inside their limits.
    Idle,
    /// All forces scaled by one factor.
    Active,
    /// A force was not finite; all are zero.
    NotFinite,
}

/// The law itself: from AC-coupled sensor values `w` to forces. `forces`, those
/// measured beside accelerometers, `injection` and `limits` in N; gives the
/// forces in N, each within its limit.
#[inline]
pub fn force(
    law: &Law,
    limits: &Six,
    state: &mut LawState,
    w: &Six,
    forces: &Six,
    injection: &Six,
) -> (Six, Clamp) {
    match &law.paths {
        Paths::Direct(direct) => {
            let force = direct_force(direct, law.leak, state, w, injection);
            if inside(&force, limits) {
                return (force, Clamp::Idle);
            }
            let Some((held, _)) = clamp(&force, limits) else {
                return ([0.0; LEGS], Clamp::NotFinite);
            };
            for i in 0..LEGS {
                state.integral[i] += law.anti_windup * (force[i] - held[i]);
            }
            (held, Clamp::Active)
        }
        Paths::Modal(modal) => {
            let asked = modal_force(modal, law.leak, state, w, forces);
            let force = add_product(*injection, &modal.output, &asked);
            if inside(&force, limits) {
                return (force, Clamp::Idle);
            }
            let Some((held, scale)) = clamp(&force, limits) else {
                return ([0.0; LEGS], Clamp::NotFinite);
            };
            for (integral, asked) in state.integral.iter_mut().zip(asked) {
                *integral += law.anti_windup * (1.0 - scale) * asked;
            }
            (held, Clamp::Active)
        }
    }
}

/// Leg forces, N.
#[inline]
fn direct_force(direct: &Direct, leak: f32, state: &mut LawState, w: &Six, injection: &Six) -> Six {
    let before = state.before;
    let r: Six = core::array::from_fn(|i| before[i] + direct.roll_off * (w[i] - before[i]));
    let sum = core::array::from_fn(|i| r[i] + before[i]);
    state.before = r;
    let leaked = core::array::from_fn(|i| state.integral[i] - leak * state.integral[i]);
    let integral = add_product(leaked, &direct.integral, &sum);
    state.integral = integral;
    let rest = core::array::from_fn(|i| injection[i] - integral[i]);
    subtract_product(rest, &direct.proportional, &r)
}

/// Forces along the modes, N/√kg.
#[inline]
fn modal_force(modal: &Modal, leak: f32, state: &mut LawState, w: &Six, forces: &Six) -> Six {
    let mut r = add_product([0.0; LEGS], &modal.input, w);
    if let Some(Complement { input, split, .. }) = &modal.complement {
        let f = add_product([0.0; LEGS], input, forces);
        for i in 0..LEGS {
            let d = state.difference[i];
            let d = d + split[i] * (r[i] - f[i] - d);
            state.difference[i] = d;
            r[i] = f[i] + d;
        }
    }
    // `zip` and `take` bound the sections without a check that could panic.
    for (j, states) in state.sections.iter_mut().enumerate().take(modal.sections) {
        let [x1, x2] = states;
        for (i, channel) in modal.channels.iter().enumerate() {
            r[i] = channel.sections[j].run(&mut x1[i], &mut x2[i], r[i]);
        }
    }
    let asked = core::array::from_fn(|i| {
        let channel = &modal.channels[i];
        let x = state.integral[i];
        let x = x - leak * x + channel.integral * (r[i] + state.before[i]);
        state.integral[i] = x;
        -x - channel.proportional * r[i]
    });
    state.before = r;
    asked
}

impl Section {
    /// One sample.
    #[inline]
    fn run(&self, x1: &mut f32, x2: &mut f32, u: f32) -> f32 {
        let y = self.direct * u + self.band * *x1 + self.low * *x2;
        let slope = u - self.damping * *x1 - *x2;
        *x2 += self.rate * *x1;
        *x1 += self.rate * slope;
        y
    }
}

/// `x` held within ±`limit`. Not `f32::clamp`: that can panic.
#[inline]
fn bounded(x: f32, limit: f32) -> f32 {
    if x > limit {
        limit
    } else if x < -limit {
        -limit
    } else {
        x
    }
}

/// Whether every force is within its limit; NaN is not.
#[inline]
fn inside(force: &Six, limits: &Six) -> bool {
    (0..LEGS).all(|i| force[i].abs() <= limits[i])
}

/// a + m·v, column by column.
#[inline]
fn add_product(mut a: Six, m: &Matrix6<f32>, v: &Six) -> Six {
    for (column, v) in m.data.0.iter().zip(v) {
        for (a, m) in a.iter_mut().zip(column) {
            *a += m * v;
        }
    }
    a
}

/// a − m·v, column by column.
#[inline]
fn subtract_product(mut a: Six, m: &Matrix6<f32>, v: &Six) -> Six {
    for (column, v) in m.data.0.iter().zip(v) {
        for (a, m) in a.iter_mut().zip(column) {
            *a -= m * v;
        }
    }
    a
}

/// Scales all forces by one factor, so that the force on the frame keeps its
/// direction, and gives that factor too. None if a force is not finite.
#[cold]
#[inline(never)]
fn clamp(force: &Six, limits: &Six) -> Option<(Six, f32)> {
    let mut over = 0.0f32;
    for i in 0..LEGS {
        let ratio = force[i].abs() / limits[i];
        if !ratio.is_finite() {
            return None;
        }
        if ratio > over {
            over = ratio;
        }
    }
    let scale = 1.0 / over;
    let held = core::array::from_fn(|i| {
        let scaled = force[i] * scale;
        // The product may round past the limit by one unit in the last place.
        bounded(scaled, limits[i])
    });
    Some((held, scale))
}
