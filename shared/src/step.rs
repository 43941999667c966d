//! The controller step: raw ADC codes in, raw DAC codes out.
//!
//! Each sample starts with the AC coupling of the calibrated sensor values y. No average
//! h follows a deviation beyond the limit [`Table::ac_limit`](crate::table::Table::ac_limit):
//!
//! ```text
//! v   = y − h1      h1 += c_ac·bounded(v)       first high-pass
//! w   = v − h2      h2 += c_ac·bounded(w)       second high-pass
//! ```
//!
//! A direct law then applies the matrices of Eq. (14):
//!
//! ```text
//! r  += c_ro·(w − r)                            roll-off
//! x  += −leak·x + K_i·(r + r_before)            leaky trapezoidal integral, N
//! u   = injection − x − K_p·r                   Eq. (14), Eq. (21), Eq. (22)
//! ```
//!
//! A modal law goes through the modes, one channel each:
//!
//! ```text
//! r   = sections(T_in·w)                        with both kinds of sensors, T_in·w is
//!                                               first blended: see [`Complement`]
//! x  += −leak·x + k_i·(r + r_before)            N/√kg
//! u   = injection + T_out·(−x − k_p·r)
//! ```
//!
//! [`Demand`] scales the gains and the force of the law. The clamp comes last:
//!
//! ```text
//! σ   = α·u,  α = min(1, limit_i/|u_i|)         keeps the direction of the force
//! x  += anti_windup·(1 − α)·u                   only where α < 1; a modal law uses each
//!                                               channel's own force, and the states of its
//!                                               sections decay by the factor
//!                                               1 − anti_windup·(1 − α)
//! ```
//!
//! A sample is computed in two halves, because the time from codes to codes is part of the
//! loop's delay. What does not depend on the newest codes is computed before they come:
//!
//! ```text
//! Ahead        u0, the forces if all w were zero, and h1 + h2
//! latch        u = u0 + gain·fade·D·w           D: the law's path straight through,
//!                                               [`DirectPath`], one constant matrix
//! follow       the states, as above
//! ```
//!
//! The configuration ([`ValidTable`]) is immutable and separate from the [`State`].
//! Nothing here can fail or panic. What the supervisor needs to know is in [`Status`].

use nalgebra::Matrix6;
use serde::{Deserialize, Serialize};

use crate::LEGS;
use crate::codes::{AdcCode, Calibration, DacCode, LegForces, Samples};
use crate::recorder::Record;
use crate::table::{Complement, DirectPath, Law, Modal, Paths, SECTIONS, Section, ValidTable};

/// Six values: one per sensor, leg or mode.
pub type Values = [f32; LEGS];

/// The state of the step between samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// The two averages of the AC coupling, sensor units.
    averages: [Values; 2],
    law: LawState,
}

/// The state of the control law, [`force`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LawState {
    /// Per mode, the low-passed difference between the modal acceleration and the modal
    /// force: d of [`Complement`], √kg·m/s².
    difference: Values,
    /// x1 and x2 of each section, `sections[channel][section]`.
    sections: [[[f32; 2]; SECTIONS]; LEGS],
    /// The previous shaped sample of each sensor (direct) or mode (modal).
    before: Values,
    /// The integral part of the force of each leg, N (direct), or mode, N/√kg (modal).
    integral: Values,
    /// Of a modal law: what each channel's sections will give if all values of the next sample
    /// are zero, √kg·m/s².
    free: Values,
}

impl LawState {
    /// All zero.
    pub const REST: Self = Self {
        difference: [0.0; LEGS],
        sections: [[[0.0; 2]; SECTIONS]; LEGS],
        before: [0.0; LEGS],
        integral: [0.0; LEGS],
        free: [0.0; LEGS],
    };
}

impl State {
    /// A law at rest, with AC coupling and [`Complement`] in steady state for constant
    /// codes `adc`: offsets of the sensors cause no transient when the loop starts.
    pub fn settled_on(table: &ValidTable, adc: Samples) -> Self {
        let t = table.get();
        let mut averages = [[0.0; LEGS]; 2];
        if t.ac_coupling > 0.0 {
            averages[0] = calibrate(&t.sensors, &adc.sensors);
        }
        let mut law = LawState::REST;
        if let Some(complement) = t.complement() {
            let forces = calibrate(&complement.sensors, &adc.forces);
            law.difference = subtract_product(law.difference, &complement.input, &forces);
            law.free = free_from_rest(&t.law, &law.difference);
        }
        Self { averages, law }
    }

    /// Resets the law. AC coupling and [`Complement`] keep their state.
    pub fn start(&mut self, table: &ValidTable) {
        self.law = LawState {
            difference: self.law.difference,
            ..LawState::REST
        };
        self.law.free = free_from_rest(&table.get().law, &self.law.difference);
    }

    /// Sets the AC coupling to its steady state for the mean of `count` samples, whose
    /// codes sum to `sums`, and resets the law. Returns by how much the forces of the legs at
    /// this `gain` were larger before, N, for the same codes.
    pub fn settle(
        &mut self,
        table: &ValidTable,
        sums: [i64; LEGS],
        count: u32,
        gain: f32,
    ) -> LegForces {
        let demand = Demand {
            gain,
            ..Demand::LAW
        };
        let [mut before, mut after] = [Ahead::NOTHING; 2];
        before.close(table, self, &demand);
        let t = table.get();
        if t.ac_coupling > 0.0 && count > 0 {
            let mean = |i: usize| {
                let Calibration { zero, gain } = t.sensors[i];
                (single(sums[i]) / count as f32 - zero) * gain
            };
            self.averages = [core::array::from_fn(mean), [0.0; LEGS]];
        }
        self.start(table);
        after.close(table, self, &demand);
        let less = core::array::from_fn(|i| gain * (after.offsets[i] - before.offsets[i]));
        let law = core::array::from_fn(|i| before.base[i] - after.base[i]);
        LegForces(add_columns(law, &table.direct_path().sensors, &less))
    }

    /// The sum of the two averages of each sensor, sensor units.
    #[inline]
    fn offsets(&self) -> Values {
        let [h1, h2] = &self.averages;
        core::array::from_fn(|i| h1[i] + h2[i])
    }

    /// Whether every number of the state is finite.
    pub fn is_finite(&self) -> bool {
        let finite = |six: &Values| six.iter().all(|x| x.is_finite());
        self.averages.iter().all(finite)
            && finite(&self.law.difference)
            && self
                .law
                .sections
                .as_flattened()
                .as_flattened()
                .iter()
                .all(|x| x.is_finite())
            && finite(&self.law.before)
            && finite(&self.law.integral)
            && finite(&self.law.free)
    }
}

/// What one step observed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Status {
    /// Bit i is set if the code of sensor i was at an end of the ADC's range.
    pub sensors_at_rail: u8,
    /// Bit i is set if the code of force sensor i of a [`Complement`] was at an end of the
    /// ADC's range.
    pub forces_at_rail: u8,
    /// Whether the clamp reduced the forces.
    pub clamped: bool,
    /// Whether a force was not a finite number. All legs then get zero force.
    pub not_finite: bool,
}

/// The inputs of one step besides the samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Demand {
    /// Factor on the law's gains, 0 to 1. It acts before the integrals: what they
    /// accumulated under a small factor stays small when the factor grows.
    pub gain: f32,
    /// Factor on the law's force, 0 to 1. It acts after the integrals: at 0 the force is
    /// zero whatever they hold.
    pub fade: f32,
    /// Forces added to the law's before the clamp, N.
    pub injection: LegForces,
}

impl Demand {
    /// The law at full gain and no injection.
    pub const LAW: Self = Self {
        gain: 1.0,
        fade: 1.0,
        injection: LegForces::ZERO,
    };
}

impl Status {
    /// Nothing observed.
    pub const NOTHING: Self = Self {
        sensors_at_rail: 0,
        forces_at_rail: 0,
        clamped: false,
        not_finite: false,
    };

    /// Whether the code of any sensor was at an end of the ADC's range.
    pub fn at_rail(&self) -> bool {
        self.sensors_at_rail != 0 || self.forces_at_rail != 0
    }
}

/// The result of one step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Output {
    /// The DAC codes to latch.
    pub dac: [DacCode; LEGS],
    /// What the step observed.
    pub status: Status,
}

fn calibrate(sensors: &[Calibration; LEGS], adc: &[AdcCode; LEGS]) -> Values {
    core::array::from_fn(|i| sensors[i].value(adc[i]))
}

/// Bit i is set if code i is at an end of the ADC's range.
#[inline]
fn at_rail(adc: &[AdcCode; LEGS], max: AdcCode) -> u8 {
    // The lowest code is the complement of the highest. What one code has in no bit, it is not.
    let distance = |code: &AdcCode| i32::from(code.0) ^ i32::from(code.0) >> 31;
    let max = i32::from(max.0);
    if adc.iter().fold(0, |all, code| all | distance(code)) < max {
        return 0;
    }
    let mut bits = 0;
    for (i, code) in adc.iter().enumerate() {
        bits |= u8::from(distance(code) >= max) << i;
    }
    bits
}

/// What is known of a sample before its codes are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ahead {
    /// The forces of the legs if all AC-coupled values were zero, N.
    base: Values,
    /// The offsets that the AC coupling takes off, sensor units.
    offsets: Values,
    /// Factor on the law's gains and its force; 0 with the loop open.
    gain: f32,
    /// As in [`Demand`]; 0 with the loop open.
    fade: f32,
    /// Whether the loop is closed.
    closed: bool,
}

impl Ahead {
    /// No forces, nothing to take off.
    pub const NOTHING: Self = Self {
        base: [0.0; LEGS],
        offsets: [0.0; LEGS],
        gain: 0.0,
        fade: 0.0,
        closed: false,
    };

    /// With the loop closed.
    #[inline]
    pub fn close(&mut self, table: &ValidTable, state: &State, demand: &Demand) {
        self.base = base(&table.get().law, &state.law, demand);
        self.offsets = state.offsets();
        (self.gain, self.fade, self.closed) = (demand.gain, demand.fade, true);
    }

    /// With the loop open: the law stays at rest, and the legs get `injection` only.
    #[inline]
    pub fn open(&mut self, state: &State, injection: &LegForces) {
        self.base = injection.0;
        self.offsets = state.offsets();
        (self.gain, self.fade, self.closed) = (0.0, 0.0, false);
    }
}

/// A sample whose codes have been put out: what [`follow`] needs of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Latched {
    /// AC-coupled sensor values, sensor units.
    pub(crate) w: Values,
    /// The forces measured by a [`Complement`], N.
    pub(crate) forces: Values,
    /// The forces before the clamp, N.
    asked: Values,
    /// The action of the clamp.
    clamp: Clamp,
}

impl Latched {
    /// Before the first sample.
    pub const NOTHING: Self = Self {
        w: [0.0; LEGS],
        forces: [0.0; LEGS],
        asked: [0.0; LEGS],
        clamp: Clamp::Idle,
    };

    /// The first half of a sample: from the codes read to the codes to latch, in `record`.
    // Within a caller, the compiler keeps every address on the stack.
    #[inline(never)]
    pub fn latch(&mut self, table: &ValidTable, ahead: &Ahead, record: &mut Record) {
        let t = table.get();
        let adc = &record.adc;
        let y = calibrate(&t.sensors, &adc.sensors);
        self.w = core::array::from_fn(|i| y[i] - ahead.offsets[i]);
        let beside = t.complement();
        if let Some(beside) = beside {
            self.forces = calibrate(&beside.sensors, &adc.forces);
        }
        let path = table.direct_path();
        self.asked = through(path, ahead, beside.is_some(), &self.w, &self.forces);
        self.clamp = Clamp::Idle;
        record.dac = core::array::from_fn(|i| t.actuators[i].code(self.asked[i]));
        let limits = core::array::from_fn(|i| t.actuators[i].limit);
        if !inside(&self.asked, &limits) {
            let (held, clamp) = limited(&self.asked, &limits);
            self.clamp = clamp;
            record.dac = core::array::from_fn(|i| t.actuators[i].code(held[i]));
        }
    }
}

/// The second half of a sample: the states after it, and what was observed.
#[inline]
pub fn follow(
    table: &ValidTable,
    state: &mut State,
    ahead: &Ahead,
    latched: &Latched,
    adc: &Samples,
) -> Status {
    let t = table.get();
    let w = &latched.w;
    let limit = if ahead.closed {
        t.ac_limit
    } else {
        // Without a law a shock does no harm, and a limit would bias the average of an
        // asymmetric vibration.
        f32::MAX
    };
    average(&mut state.averages, w, t.ac_coupling, limit);
    if ahead.closed {
        follow_law(&t.law, &mut state.law, ahead.gain, latched);
    } else if let Paths::Modal(modal) = &t.law.paths
        && modal.complement.is_some()
    {
        blend(modal, &mut state.law, w, &latched.forces);
    }
    Status {
        sensors_at_rail: at_rail(&adc.sensors, t.adc_max),
        forces_at_rail: if t.complement().is_some() {
            at_rail(&adc.forces, t.adc_max)
        } else {
            0
        },
        clamped: matches!(latched.clamp, Clamp::Active(_)),
        not_finite: latched.clamp == Clamp::NotFinite,
    }
}

/// The averages of the AC coupling after a sample.
#[inline]
fn average([h1, h2]: &mut [Values; 2], w: &Values, coupling: f32, limit: f32) {
    let v: Values = core::array::from_fn(|i| w[i] + h2[i]);
    // No deviation is larger than the root of the sum of all squares. False for NaN.
    let (mut first, mut second) = (0.0, 0.0);
    for i in 0..LEGS {
        first += v[i] * v[i];
        second += w[i] * w[i];
    }
    if first + second <= limit * limit {
        for i in 0..LEGS {
            h1[i] += coupling * v[i];
            h2[i] += coupling * w[i];
        }
    } else {
        for i in 0..LEGS {
            h1[i] += coupling * bounded(v[i], limit);
            h2[i] += coupling * bounded(w[i], limit);
        }
    }
}

/// Runs both halves of one sample with the loop closed.
pub fn step(table: &ValidTable, state: &mut State, adc: Samples, demand: Demand) -> Output {
    let mut ahead = Ahead::NOTHING;
    ahead.close(table, state, &demand);
    let mut latched = Latched::NOTHING;
    let mut record = Record {
        adc,
        ..Record::NONE
    };
    latched.latch(table, &ahead, &mut record);
    let status = follow(table, state, &ahead, &latched, &adc);
    Output {
        dac: record.dac,
        status,
    }
}

/// The action of the clamp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Clamp {
    /// All forces are within their limits.
    Idle,
    /// All forces were scaled by this factor.
    Active(f32),
    /// A force was not finite. All forces are zero.
    NotFinite,
}

/// Both halves of the control law, from AC-coupled sensor values to leg forces, N, each within
/// its limit: Eq. (14), Eq. (21), Eq. (22).
///
/// `w` has sensor units, `limits` is in N. `forces`, N, are those measured by a
/// [`Complement`]; a law without one ignores them. For tests and analyses of the law alone:
/// the direct path is computed with every call.
pub fn force(
    law: &Law,
    limits: &Values,
    state: &mut LawState,
    w: &Values,
    forces: &Values,
    demand: &Demand,
) -> (Values, Clamp) {
    let ahead = Ahead {
        base: base(law, state, demand),
        offsets: [0.0; LEGS],
        gain: demand.gain,
        fade: demand.fade,
        closed: true,
    };
    let beside = matches!(&law.paths, Paths::Modal(modal) if modal.complement.is_some());
    let asked = through(&DirectPath::new(law), &ahead, beside, w, forces);
    let (force, clamp) = if inside(&asked, limits) {
        (asked, Clamp::Idle)
    } else {
        limited(&asked, limits)
    };
    let latched = Latched {
        w: *w,
        forces: *forces,
        asked,
        clamp,
    };
    follow_law(law, state, demand.gain, &latched);
    (force, clamp)
}

/// The forces for the newest values, before the clamp, N.
#[inline]
fn through(path: &DirectPath, ahead: &Ahead, beside: bool, w: &Values, forces: &Values) -> Values {
    let scale = ahead.gain * ahead.fade;
    let mut asked = add_columns(ahead.base, &path.sensors, &w.map(|w| scale * w));
    if beside {
        asked = add_columns(asked, &path.forces, &forces.map(|f| scale * f));
    }
    asked
}

/// Forces of which one is not within its limit, within their limits.
#[cold]
#[inline(never)]
fn limited(asked: &Values, limits: &Values) -> (Values, Clamp) {
    match clamp(asked, limits) {
        Some((held, scale)) => (held, Clamp::Active(scale)),
        None => ([0.0; LEGS], Clamp::NotFinite),
    }
}

/// The forces of the legs if all values of the next sample were zero, N.
#[inline]
fn base(law: &Law, state: &LawState, demand: &Demand) -> Values {
    let Demand {
        gain,
        fade,
        injection,
    } = demand;
    let leak = law.leak;
    match &law.paths {
        Paths::Direct(direct) => {
            let r = state.before.map(|r| r - direct.roll_off * r);
            let sum = core::array::from_fn(|i| gain * (r[i] + state.before[i]));
            let leaked = state.integral.map(|x| x - leak * x);
            let integral = add_product(leaked, &direct.integral, &sum);
            let r = r.map(|r| gain * r);
            let against = add_product(integral, &direct.proportional, &r);
            core::array::from_fn(|i| injection.0[i] - fade * against[i])
        }
        Paths::Modal(modal) => {
            let given = core::array::from_fn(|i| {
                let channel = &modal.channels[i];
                let x = state.integral[i];
                let x = x - leak * x + gain * channel.integral * state.before[i];
                let now = channel.integral + channel.proportional;
                -fade * (x + gain * now * state.free[i])
            });
            add_product(injection.0, &modal.output, &given)
        }
    }
}

/// The states of the law after a sample.
#[inline]
fn follow_law(law: &Law, state: &mut LawState, gain: f32, latched: &Latched) {
    let leak = law.leak;
    // What the clamp took of the forces, per sample, for the states.
    let windup = match latched.clamp {
        Clamp::Active(scale) => law.anti_windup * (1.0 - scale),
        Clamp::Idle | Clamp::NotFinite => 0.0,
    };
    match &law.paths {
        Paths::Direct(direct) => {
            let before = state.before;
            let w = &latched.w;
            let r: Values =
                core::array::from_fn(|i| before[i] + direct.roll_off * (w[i] - before[i]));
            let sum = core::array::from_fn(|i| gain * (r[i] + before[i]));
            state.before = r;
            let leaked = state.integral.map(|x| x - leak * x);
            state.integral = add_product(leaked, &direct.integral, &sum);
            if windup > 0.0 {
                for (integral, asked) in state.integral.iter_mut().zip(latched.asked) {
                    *integral += windup * asked;
                }
            }
        }
        Paths::Modal(modal) => {
            let r = blend(modal, state, &latched.w, &latched.forces);
            let mut free = [0.0; LEGS];
            if let Some(Complement { split, .. }) = &modal.complement {
                free = core::array::from_fn(|i| {
                    let d = state.difference[i];
                    d - split[i] * d
                });
            }
            let decay = (windup > 0.0).then_some(windup);
            // A number of sections that the compiler knows takes a third less.
            match modal.sections {
                0 => follow_modes::<0>(modal, state, r, free, leak, gain, decay),
                1 => follow_modes::<1>(modal, state, r, free, leak, gain, decay),
                2 => follow_modes::<2>(modal, state, r, free, leak, gain, decay),
                _ => follow_modes::<SECTIONS>(modal, state, r, free, leak, gain, decay),
            }
        }
    }
}

/// Sections and integrals of all modes after a sample, with `N` sections each. `r` and `free` are
/// the inputs of the first sections: those of the sample, and of one with all values zero. `decay`
/// is what the states lose of themselves under the clamp.
#[inline(never)]
fn follow_modes<const N: usize>(
    modal: &Modal,
    state: &mut LawState,
    r: Values,
    free: Values,
    leak: f32,
    gain: f32,
    decay: Option<f32>,
) {
    for (i, channel) in modal.channels.iter().enumerate() {
        let (mut r, mut free) = (r[i], free[i]);
        let sections = channel.sections.iter().zip(&mut state.sections[i]);
        for (section, states) in sections.take(N) {
            [r, free] = section.run(states, r, free, decay);
        }
        state.free[i] = free;
        let x = state.integral[i];
        let x = x - leak * x + gain * channel.integral * (r + state.before[i]);
        let windup = |decay| decay * (x + gain * channel.proportional * r);
        state.integral[i] = x - decay.map_or(0.0, windup);
        state.before[i] = r;
    }
}

/// [`LawState::free`] of a law at rest whose complement has this state.
fn free_from_rest(law: &Law, difference: &Values) -> Values {
    let Paths::Modal(modal) = &law.paths else {
        return [0.0; LEGS];
    };
    let Some(Complement { split, .. }) = &modal.complement else {
        return [0.0; LEGS];
    };
    core::array::from_fn(|i| {
        let d = difference[i];
        let sections = modal.channels[i].sections.iter().take(modal.sections);
        sections.fold(d - split[i] * d, |free, section| {
            section.output(&[0.0; 2], free)
        })
    })
}

/// From sensors to modes, with both kinds of sensors blended by a [`Complement`].
#[inline]
fn blend(modal: &Modal, state: &mut LawState, w: &Values, forces: &Values) -> Values {
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
    /// The output of a sample, with the states x1 and x2 before it.
    #[inline]
    fn output(&self, [x1, x2]: &[f32; 2], u: f32) -> f32 {
        self.direct * u + self.band * x1 + self.low * x2
    }

    /// Filters one sample. Returns the output, and that of the next sample if the section before
    /// gives `free` then. The states lose the part `decay` of themselves.
    #[inline(always)]
    fn run(&self, states: &mut [f32; 2], u: f32, free: f32, decay: Option<f32>) -> [f32; 2] {
        let [x1, x2] = *states;
        let y = self.output(states, u);
        let slope = u - self.damping * x1 - x2;
        *states = [x1 + self.rate * slope, x2 + self.rate * x1];
        if let Some(decay) = decay {
            // Slow sections would remember the overload for as long as they are slow.
            *states = states.map(|x| x - decay * x);
        }
        [y, self.output(states, free)]
    }
}

/// `x` limited to ±`limit`, which is not negative; NaN counts as too large. Compares bits: no
/// branch on the floating-point flags, and `f32::clamp` can panic.
#[inline]
fn bounded(x: f32, limit: f32) -> f32 {
    if x.to_bits() & !SIGN > limit.to_bits() {
        return f32::from_bits(x.to_bits() & SIGN | limit.to_bits());
    }
    x
}

/// The larger of two numbers, the first if one is NaN. `f32::max` takes three times as many
/// instructions.
#[inline]
pub(crate) fn larger(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// The number in single precision, by its halves: the conversion of a whole one would be a
/// subroutine.
#[inline]
pub(crate) fn single(x: i64) -> f32 {
    let size = x.unsigned_abs();
    let size = (size >> 32) as u32 as f32 * 4_294_967_296.0 + size as u32 as f32;
    if x < 0 { -size } else { size }
}

/// The bit of the sign.
const SIGN: u32 = 1 << 31;

/// Whether every force is within its limit; false for NaN.
#[inline]
fn inside(force: &Values, limits: &Values) -> bool {
    (0..LEGS).all(|i| force[i].abs() <= limits[i])
}

/// a + m·v, column by column.
#[inline]
fn add_product(a: Values, m: &Matrix6<f32>, v: &Values) -> Values {
    add_columns(a, &m.data.0, v)
}

/// a + the sum of columns[i]·v[i].
#[inline]
fn add_columns(mut a: Values, columns: &[Values; LEGS], v: &Values) -> Values {
    for (column, v) in columns.iter().zip(v) {
        for (a, m) in a.iter_mut().zip(column) {
            *a += m * v;
        }
    }
    a
}

/// a − m·v, column by column.
#[inline]
fn subtract_product(mut a: Values, m: &Matrix6<f32>, v: &Values) -> Values {
    for (column, v) in m.data.0.iter().zip(v) {
        for (a, m) in a.iter_mut().zip(column) {
            *a -= m * v;
        }
    }
    a
}

/// Scales all forces by one factor, so that the force on the frame keeps its direction.
/// Returns the forces and the factor. None if a force is not finite.
fn clamp(force: &Values, limits: &Values) -> Option<(Values, f32)> {
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
        // Rounding may exceed the limit by one unit in the last place.
        bounded(scaled, limits[i])
    });
    Some((held, scale))
}
