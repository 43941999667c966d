//! The controller step: raw ADC codes in, raw DAC codes out.
//!
//! Per sample, with y the calibrated sensor values:
//!
//! ```text
//! h1 += c_ac·(y − h1)          v = y − h1       AC coupling, twice
//! h2 += c_ac·(v − h2)          w = v − h2       (each with the state before)
//! r  += c_ro·(w − r)                            roll-off
//! x  += −leak·x + K_i·(r + r_before)            leaky trapezoidal integral, N
//! u   = injection − x − K_p·r                   Eqs. (14), (21), (22)
//! σ   = α·u,  α = min(1, limit_i/|u_i|)         clamp that keeps the direction
//! x  += anti_windup·(u − σ)                     only where α < 1
//! ```
//!
//! Configuration ([`ValidTable`]) is immutable and apart from [`State`].
//! Nothing here can fail or panic; what the supervisor must know is in
//! [`Status`].

use nalgebra::Matrix6;

use crate::LEGS;
use crate::codes::{AdcCode, DacCode, LegForces};
use crate::table::{Law, ValidTable};

type Six = [f32; LEGS];

/// What the controller remembers between samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// The two AC-coupling averages, sensor units.
    averages: [Six; 2],
    pi: PiState,
}

/// The memory of [`pi`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PiState {
    /// The rolled-off sample before, sensor units.
    before: Six,
    /// The integral part of the force, N.
    integral: Six,
}

impl PiState {
    /// At rest.
    pub const REST: Self = Self {
        before: [0.0; LEGS],
        integral: [0.0; LEGS],
    };
}

impl State {
    /// At rest, with the AC coupling settled on `adc`: a sensor's offset gives
    /// no kick when the loop starts.
    pub fn settled_on(table: &ValidTable, adc: [AdcCode; LEGS]) -> Self {
        let mut averages = [[0.0; LEGS]; 2];
        if table.get().shaping.ac_coupling > 0.0 {
            averages[0] = calibrate(table, adc);
        }
        Self {
            averages,
            pi: PiState::REST,
        }
    }

    /// Whether every number in it is finite.
    pub fn is_finite(&self) -> bool {
        let [a, b] = &self.averages;
        [a, b, &self.pi.before, &self.pi.integral]
            .iter()
            .all(|six| six.iter().all(|x| x.is_finite()))
    }
}

/// What the step saw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status {
    /// Bit i: sensor i's code was at an end of the ADC's range.
    pub sensors_at_rail: u8,
    /// The clamp was active.
    pub clamped: bool,
    /// The force was not a finite number; the output is the safe one.
    pub not_finite: bool,
}

/// What one step gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Output {
    /// The codes to latch.
    pub dac: [DacCode; LEGS],
    /// What was seen on the way.
    pub status: Status,
}

fn calibrate(table: &ValidTable, adc: [AdcCode; LEGS]) -> Six {
    let sensors = &table.get().sensors;
    core::array::from_fn(|i| sensors[i].value(adc[i]))
}

/// One sample: `adc` as read at this instant, `injection` added to the
/// controller's force before the clamp; out come the codes to latch.
pub fn step(
    table: &ValidTable,
    state: &mut State,
    adc: [AdcCode; LEGS],
    injection: LegForces,
) -> Output {
    let t = table.get();
    let y = calibrate(table, adc);
    let [h1, h2] = &mut state.averages;
    let r: Six = core::array::from_fn(|i| {
        let v = y[i] - h1[i];
        h1[i] += t.shaping.ac_coupling * v;
        let w = v - h2[i];
        h2[i] += t.shaping.ac_coupling * w;
        let before = state.pi.before[i];
        before + t.shaping.roll_off * (w - before)
    });
    let limits = core::array::from_fn(|i| t.actuators[i].limit);
    let (force, clamp) = pi(&t.law, &limits, &mut state.pi, &r, &injection.0);
    let mut sensors_at_rail = 0;
    for (i, code) in adc.iter().enumerate() {
        if code.0 >= t.adc_max.0 || code.0 < -t.adc_max.0 {
            sensors_at_rail |= 1 << i;
        }
    }
    Output {
        dac: core::array::from_fn(|i| t.actuators[i].code(force[i])),
        status: Status {
            sensors_at_rail,
            clamped: clamp == Clamp::Active,
            not_finite: clamp == Clamp::NotFinite,
        },
    }
}

/// What the clamp of [`pi`] did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clamp {
    /// All forces inside their limits.
    Idle,
    /// All forces scaled by one factor.
    Active,
    /// A force was not finite; all are zero.
    NotFinite,
}

/// The law itself: matrices, integrator and clamp. `y` in sensor units,
/// `injection` and `limits` in N; gives the forces in N, each within its limit.
#[inline]
pub fn pi(law: &Law, limits: &Six, state: &mut PiState, y: &Six, injection: &Six) -> (Six, Clamp) {
    let sum: Six = core::array::from_fn(|j| y[j] + state.before[j]);
    state.before = *y;
    let leaked = core::array::from_fn(|i| state.integral[i] - law.leak * state.integral[i]);
    let integral = add_product(leaked, &law.integral, &sum);
    state.integral = integral;
    let rest = core::array::from_fn(|i| injection[i] - integral[i]);
    let force = subtract_product(rest, &law.proportional, y);
    // Written so that NaN counts as outside.
    if (0..LEGS).all(|i| force[i].abs() <= limits[i]) {
        (force, Clamp::Idle)
    } else {
        clamp(law, limits, state, force)
    }
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
/// direction, and takes part of the excess back out of the integral.
#[cold]
#[inline(never)]
fn clamp(law: &Law, limits: &Six, state: &mut PiState, force: Six) -> (Six, Clamp) {
    let mut over = 0.0f32;
    for i in 0..LEGS {
        let ratio = force[i].abs() / limits[i];
        if !ratio.is_finite() {
            return ([0.0; LEGS], Clamp::NotFinite);
        }
        if ratio > over {
            over = ratio;
        }
    }
    let scale = 1.0 / over;
    let scaled: Six = core::array::from_fn(|i| {
        let scaled = force[i] * scale;
        // The product may round past the limit by one unit in the last place.
        // Not `f32::clamp`: it can panic.
        if scaled > limits[i] {
            limits[i]
        } else if scaled < -limits[i] {
            -limits[i]
        } else {
            scaled
        }
    });
    for i in 0..LEGS {
        state.integral[i] += law.anti_windup * (force[i] - scaled[i]);
    }
    (scaled, Clamp::Active)
}
