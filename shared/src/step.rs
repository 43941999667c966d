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
//! with the gains, and what the law gives, times the factors of [`Demand`],
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
use serde::{Deserialize, Serialize};

use crate::LEGS;
use crate::codes::{AdcCode, Calibration, DacCode, LegForces, Samples};
use crate::table::{Complement, Direct, Law, Modal, Paths, SECTIONS, Section, Table, ValidTable};

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

    /// Puts the law at rest; AC coupling and [`Complement`] go on.
    pub fn start(&mut self) {
        let difference = self.law.difference;
        self.law = LawState {
            difference,
            ..LawState::REST
        };
    }

    /// Settles the AC coupling on the mean of so many samples, whose codes sum to
    /// `sums`, and puts the law at rest.
    pub fn settle(&mut self, table: &ValidTable, sums: [i64; LEGS], count: u32) {
        let t = table.get();
        if t.ac_coupling > 0.0 && count > 0 {
            let mean = |i: usize| {
                let Calibration { zero, gain } = t.sensors[i];
                (sums[i] as f32 / count as f32 - zero) * gain
            };
            self.averages = [core::array::from_fn(mean), [0.0; LEGS]];
        }
        self.start();
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
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

/// What is asked of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Demand {
    /// Factor of the law's gains, 0 to 1: what its integrals gathered under a small
    /// one stays small when it grows.
    pub gain: f32,
    /// Factor of the law's force, 0 to 1: with 0 there is none whatever its
    /// integrals hold.
    pub fade: f32,
    /// Added to it before the clamp.
    pub injection: LegForces,
}

impl Demand {
    /// The whole law and nothing else.
    pub const LAW: Self = Self {
        gain: 1.0,
        fade: 1.0,
        injection: LegForces::ZERO,
    };
}

impl Status {
    /// Nothing.
    pub const NOTHING: Self = Self {
        sensors_at_rail: 0,
        forces_at_rail: 0,
        clamped: false,
        not_finite: false,
    };

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

/// One sample: `adc` as read at this instant; out come the codes to latch.
pub fn step(table: &ValidTable, state: &mut State, adc: Samples, demand: Demand) -> Output {
    let t = table.get();
    let (w, forces) = sense(t, state, adc, t.ac_limit);
    let limits = limits(t);
    let (force, clamp) = force(&t.law, &limits, &mut state.law, &w, &forces, &demand);
    output(t, adc, force, clamp)
}

/// One sample with the loop open: AC coupling and [`Complement`] follow the
/// sensors, the law stays at rest, the legs get `injection` alone.
pub fn rest(table: &ValidTable, state: &mut State, adc: Samples, injection: LegForces) -> Output {
    let t = table.get();
    // No law, so no shock that it could take for an offset; and of a swing that is
    // not as high as it is deep the mean within limits is another.
    let (w, forces) = sense(t, state, adc, f32::MAX);
    if let Paths::Modal(modal) = &t.law.paths {
        blend(modal, &mut state.law, &w, &forces);
    }
    let limits = limits(t);
    let (force, clamp) = if inside(&injection.0, &limits) {
        (injection.0, Clamp::Idle)
    } else {
        clamp(&injection.0, &limits).map_or(([0.0; LEGS], Clamp::NotFinite), |(held, _)| {
            (held, Clamp::Active)
        })
    };
    output(t, adc, force, clamp)
}

/// AC-coupled sensor values, and what the force sensors beside them measure, N.
#[inline]
fn sense(t: &Table, state: &mut State, adc: Samples, limit: f32) -> (Six, Six) {
    let y = calibrate(&t.sensors, adc.sensors);
    let forces = t
        .complement()
        .map_or([0.0; LEGS], |beside| calibrate(&beside.sensors, adc.forces));
    let [h1, h2] = &mut state.averages;
    let w = core::array::from_fn(|i| {
        let v = y[i] - h1[i];
        h1[i] += t.ac_coupling * bounded(v, limit);
        let w = v - h2[i];
        h2[i] += t.ac_coupling * bounded(w, limit);
        w
    });
    (w, forces)
}

#[inline]
fn limits(t: &Table) -> Six {
    core::array::from_fn(|i| t.actuators[i].limit)
}

#[inline]
fn output(t: &Table, adc: Samples, force: Six, clamp: Clamp) -> Output {
    let beside = t.complement().is_some();
    Output {
        dac: core::array::from_fn(|i| t.actuators[i].code(force[i])),
        status: Status {
            sensors_at_rail: at_rail(adc.sensors, t.adc_max),
            forces_at_rail: if beside {
                at_rail(adc.forces, t.adc_max)
            } else {
                0
            },
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
/// measured beside accelerometers, and `limits` in N; gives the forces in N, each
/// within its limit.
#[inline]
pub fn force(
    law: &Law,
    limits: &Six,
    state: &mut LawState,
    w: &Six,
    forces: &Six,
    demand: &Demand,
) -> (Six, Clamp) {
    let Demand {
        gain,
        fade,
        injection,
    } = demand;
    match &law.paths {
        Paths::Direct(direct) => {
            let asked = direct_force(direct, law.leak, *gain, state, w);
            let force = core::array::from_fn(|i| injection.0[i] - fade * asked[i]);
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
            let asked = modal_force(modal, law.leak, *gain, state, w, forces);
            let given = asked.map(|asked| fade * asked);
            let force = add_product(injection.0, &modal.output, &given);
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

/// The negative of the leg forces, N.
#[inline]
fn direct_force(direct: &Direct, leak: f32, gain: f32, state: &mut LawState, w: &Six) -> Six {
    let before = state.before;
    let r: Six = core::array::from_fn(|i| before[i] + direct.roll_off * (w[i] - before[i]));
    let sum = core::array::from_fn(|i| gain * (r[i] + before[i]));
    state.before = r;
    let leaked = core::array::from_fn(|i| state.integral[i] - leak * state.integral[i]);
    let integral = add_product(leaked, &direct.integral, &sum);
    state.integral = integral;
    let r = r.map(|r| gain * r);
    add_product(integral, &direct.proportional, &r)
}

/// Forces along the modes, N/√kg.
#[inline]
fn modal_force(
    modal: &Modal,
    leak: f32,
    gain: f32,
    state: &mut LawState,
    w: &Six,
    forces: &Six,
) -> Six {
    let mut r = blend(modal, state, w, forces);
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
        let x = x - leak * x + gain * channel.integral * (r[i] + state.before[i]);
        state.integral[i] = x;
        -x - gain * channel.proportional * r[i]
    });
    state.before = r;
    asked
}

/// Sensors to modes.
#[inline]
fn blend(modal: &Modal, state: &mut LawState, w: &Six, forces: &Six) -> Six {
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
    r
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
