//! A machine with its controller as one MAT-file.

use nalgebra::{Complex, DMatrix, Dim, Matrix, RawStorage};
use rayon::prelude::*;
use shared::LEGS;

use super::poles::PoleAnalysis;
use super::sigma::{Frequencies, LawKind, SigmaAnalysis};
use super::signals::{Signals, of_plant, of_states, states};
use crate::closed_loop::{Pole, SampledLoop, close_ideal};
use crate::design::{Design, DesignedStudy, Study};
use crate::files::mat::{Field, TooLarge, Value, encode};
use crate::machine::FeedbackKind;
use crate::numeric::NumericError;
use crate::plant::export::Generalised;
use crate::plant::{DiscreteStateSpace, Plant, SampledPlant};

/// Why there is no MAT-file of a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MatFileError {
    /// An eigenvalue iteration does not converge.
    #[error(transparent)]
    Numeric(#[from] NumericError),
    /// The file would be too large.
    #[error(transparent)]
    TooLarge(#[from] TooLarge),
}

/// The bytes of `host-gen plant --mat`: a MAT-file, level 5, with the variables of `docs/json.md`:
/// the generalised plant with the sensors of the machine's feedback, the same as the board samples it,
/// the ideal gains, the controller of `design`, poles, and frequency responses.
///
/// # Errors
/// [`MatFileError`].
pub fn mat_file(study: &Study, design: Design) -> Result<Vec<u8>, MatFileError> {
    let machine = study.machine();
    let feedback = study.design_model().feedback;
    let [inputs, outputs] = of_plant(machine, feedback);
    let program = concat!("hardmount ", env!("CARGO_PKG_VERSION"));
    let table = design.table;
    let variables = [
        ("machine", machine.name.as_str().into()),
        ("model_sha256", machine.digest.to_string().as_str().into()),
        ("program", program.into()),
        ("feedback", feedback.name().into()),
        ("plant", plant(study, &inputs, &outputs)),
        ("sampled", sampled(study.plant(), &inputs, &outputs)),
        ("gains", gains(study)),
        (
            "controller",
            controller(
                &SampledLoop::new(study.plant(), &table),
                &inputs,
                &outputs,
                machine.board.latch_delay,
            ),
        ),
        ("poles", poles(&PoleAnalysis::new(study, &table)?)),
        ("response", response(study, design)?),
    ];
    Ok(encode(program, &variables)?)
}

/// The fields that name inputs, outputs or states.
fn named([identifiers, names, units]: [&'static str; 3], signals: &Signals) -> [Field; 3] {
    [
        (identifiers, Value::texts(&signals.identifiers)),
        (names, Value::texts(&signals.names)),
        (units, Value::texts(&signals.units)),
    ]
}

/// A system's fields.
fn system<'a>(
    matrices: [&DMatrix<f64>; 4],
    inputs: &Signals,
    outputs: &Signals,
    states: &Signals,
    more: impl IntoIterator<Item = (&'static str, f64)> + 'a,
) -> Value {
    let names = ["A", "B", "C", "D"].into_iter();
    let mut fields: Vec<Field> = names.zip(matrices.map(Value::from)).collect();
    fields.extend(named(["inputs", "input_names", "input_units"], inputs));
    fields.extend(named(["outputs", "output_names", "output_units"], outputs));
    fields.push(("states", Value::texts(&states.identifiers)));
    fields.push(("state_units", Value::texts(&states.units)));
    fields.extend(more.into_iter().map(|(name, number)| (name, number.into())));
    Value::Structure(fields)
}

fn plant(study: &Study, inputs: &Signals, outputs: &Signals) -> Value {
    let Generalised { a, b, c, d } = Generalised::new(&study.plant().plant);
    let states = states(a.nrows() / 2);
    system([&a, &b, &c, &d], inputs, outputs, &states, [])
}

fn sampled(sampled: &SampledPlant, inputs: &Signals, outputs: &Signals) -> Value {
    let DiscreteStateSpace { a, b, c, d } = sampled.discrete();
    let delays = sampled.seen_delay();
    let poles = (1..=a.nrows() - LEGS * delays).map(|i| (format!("pole{i}"), "1"));
    let age = |age: usize| (1..=LEGS).map(move |leg| (format!("held{age}_{leg}"), "N"));
    let states = of_states(poles.chain((1..=delays).flat_map(age)));
    let ordered = |m: &DMatrix<f64>| Generalised::outputs(&sampled.plant, m);
    let period = [("sample_time", sampled.period)];
    system(
        [&a, &b, &ordered(&c), &ordered(&d)],
        inputs,
        outputs,
        &states,
        period,
    )
}

/// The controller as the board runs it, but for rounding and clamp.
fn controller(
    closed: &SampledLoop<'_>,
    inputs: &Signals,
    outputs: &Signals,
    latch_delay: f64,
) -> Value {
    let law = closed.law.state_space();
    let sensors = part(outputs, outputs.names.len() - closed.law.sensors());
    let forces = part(inputs, LEGS);
    let states = of_states(closed.law.states(sensors.units[0]));
    let times = [
        ("sample_time", closed.plant.period),
        ("latch_delay", latch_delay),
    ];
    system(
        [&law.a, &law.b, &law.c, &law.d],
        &sensors,
        &forces,
        &states,
        times,
    )
}

/// The signals from the one at `first` on.
fn part(signals: &Signals, first: usize) -> Signals {
    Signals {
        names: signals.names[first..].to_vec(),
        identifiers: signals.identifiers[first..].to_vec(),
        units: signals.units[first..].to_vec(),
    }
}

fn gains(study: &Study) -> Value {
    let design = study.design_model();
    let target = &study.machine().target;
    let [proportional, integral] = match design.feedback {
        FeedbackKind::Acceleration | FeedbackKind::Both => ["K_a", "K_v"],
        FeedbackKind::Force => ["K_P", "K_I"],
    };
    let gains = study.gains();
    Value::Structure(vec![
        ("frequency_hz", target.frequency.into()),
        ("damping", target.damping.into()),
        (proportional, (&gains.proportional).into()),
        (integral, (&gains.integral).into()),
        ("M_d", (&design.suspension.mass).into()),
        ("K_d", (&design.suspension.stiffness).into()),
        ("T_c", (&design.sensing).into()),
        ("S", (&design.modal).into()),
    ])
}

fn poles(poles: &PoleAnalysis) -> Value {
    let column = |poles: &[Pole]| {
        Value::complex_column(poles.iter().map(|pole| Complex::new(pole.re, pole.im)))
    };
    Value::Structure(vec![
        ("open", column(&poles.open)),
        ("ideal", column(&poles.ideal)),
        ("sampled", column(&poles.sampled)),
    ])
}

/// Frequency responses at the frequencies of `host-gen sigma`.
fn response(study: &Study, design: Design) -> Result<Value, NumericError> {
    let table = design.table;
    let designed = DesignedStudy {
        study: study.clone(),
        design: Ok(design),
    };
    let sigma = SigmaAnalysis::new(study.machine(), &[designed], Frequencies::USUAL)?;
    let hz = &sigma.hz;
    let sampled = study.plant();
    let plant: &Plant = &sampled.plant;
    let closed = SampledLoop::new(sampled, &table);
    let modal = closed.modal_loop(&study.design_model().modal);
    let rows = || plant.performance();
    let mut fields = vec![("hz", Value::column(hz.iter().copied()))];
    for curve in sigma.curves {
        let (sigma_max, name, values) = match curve.of {
            None => (
                "sigma_max_open",
                "G11_open",
                at(hz, |hz| plant.open(hz, rows())),
            ),
            Some((_, LawKind::Ideal)) => (
                "sigma_max_ideal",
                "G11_ideal",
                at(hz, |hz| close_ideal(plant, study.gains(), hz, rows())),
            ),
            Some((_, LawKind::Sampled)) => (
                "sigma_max_sampled",
                "G11_sampled",
                at(hz, |hz| closed.close(hz, rows())),
            ),
        };
        fields.push((sigma_max, Value::column(curve.sigma_max)));
        fields.push((name, values));
    }
    fields.extend([
        (
            "G22_sampled",
            at(hz, |hz| sampled.response(hz).from_legs(plant.sensors())),
        ),
        (
            "controller",
            at(hz, |hz| closed.law.response(sampled.z(hz))),
        ),
        ("loop", at(hz, modal)),
    ]);
    Ok(Value::Structure(fields))
}

/// Complex matrices at the frequencies `hz`, Hz, along the third index.
fn at<R: Dim, C: Dim, S: RawStorage<Complex<f64>, R, C>>(
    hz: &[f64],
    of: impl Fn(f64) -> Matrix<Complex<f64>, R, C, S> + Sync,
) -> Value {
    let all: Vec<_> = hz
        .par_iter()
        .map(|&hz| {
            let matrix = of(hz);
            DMatrix::from_iterator(matrix.nrows(), matrix.ncols(), matrix.iter().copied())
        })
        .collect();
    Value::stack(&all)
}
