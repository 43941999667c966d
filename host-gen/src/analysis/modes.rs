//! Modes with their shapes and energies, Eq. (2), and the static loads of the legs.

use serde::Serialize;

use super::{Rows, rows};
use crate::design::Study;
use crate::machine::{MachineError, Structure};
use crate::model::energy::{Energies, energies, of_structure};
use crate::model::gravity::buckling_load;
use crate::model::independence::reach;
use crate::model::structure::{Modes, StructureModel};

/// Result of `host-gen modes`: modes with shapes and energies, static loads of the legs,
/// and, of a machine with control, the equation of motion.
#[derive(Debug, Serialize)]
pub struct ModeAnalysis {
    pub(crate) machine: String,
    pub(crate) modes: Vec<ModeEntry>,
    /// Static loads of the legs; empty without gravity and preload.
    pub(crate) leg_loads: Vec<LegLoad>,
    #[serde(flatten)]
    pub(crate) control: Option<ControlModes>,
    #[serde(skip)]
    pub(crate) reach: f64,
}

/// What only a machine with control has.
#[derive(Debug, Serialize)]
pub(crate) struct ControlModes {
    model_sha256: String,
    /// How the design model was reduced, in words.
    pub(crate) reduction: &'static str,
    pub(crate) rigid_modes_hz: [f64; 6],
    pub(crate) coordinates: Vec<String>,
    pub(crate) equation_of_motion: EquationMatrices,
}

#[derive(Debug, Serialize)]
pub(crate) struct ModeEntry {
    pub(crate) hz: f64,
    /// Per body: translation, m, and rotation, rad, of its centre of gravity;
    /// mass-normalised.
    pub(crate) shape: Vec<BodyMotion>,
    /// The same per node that no rigid body carries, and per node between the elements of a beam,
    /// `BEAM[1]` the first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) nodes: Vec<NodeMotion>,
    /// The mode shape in the degrees of freedom q_d, mass-normalised, m and rad; empty without
    /// control.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) deformations: Vec<f64>,
    #[serde(flatten)]
    pub(crate) energies: Energies,
}

#[derive(Debug, Serialize, PartialEq)]
pub(crate) struct LegLoad {
    pub(crate) beam: String,
    /// Axial force, N; positive in tension.
    pub(crate) axial_force: f64,
    /// Buckling load, N; positive in compression. None if the beam does not bend.
    pub(crate) buckling_load: Option<f64>,
}

#[derive(Debug, Serialize)]
pub(crate) struct BodyMotion {
    pub(crate) body: String,
    pub(crate) motion: Vec<f64>,
}

#[derive(Debug, Serialize)]
pub(crate) struct NodeMotion {
    pub(crate) node: String,
    pub(crate) motion: Vec<f64>,
}

#[derive(Debug, Serialize)]
pub(crate) struct EquationMatrices {
    pub(crate) mass: Rows,
    pub(crate) damping: Rows,
    pub(crate) stiffness: Rows,
    pub(crate) rheonomic: Rows,
    pub(crate) input: Rows,
}

impl ModeAnalysis {
    /// The modes of `study`.
    pub fn new(study: &Study) -> Self {
        let (machine, model) = (study.machine(), study.model());
        let modes = model.modes();
        let energies = energies(machine, model, &modes);
        let mut analysis = Self::of(machine, model, &modes, energies);
        let deformations = &model.coordinates * &modes.shapes;
        for (mode, shape) in analysis.modes.iter_mut().zip(deformations.column_iter()) {
            mode.deformations = shape.iter().copied().collect();
        }
        let equation = model.equation_of_motion();
        analysis.control = Some(ControlModes {
            model_sha256: machine.digest.to_string(),
            reduction: study.design_model().suspension.reduction.words(),
            rigid_modes_hz: study.design_model().hertz(),
            coordinates: model.coordinate_names(machine),
            equation_of_motion: EquationMatrices {
                mass: rows(&equation.mass),
                damping: rows(&equation.damping),
                stiffness: rows(&equation.stiffness),
                rheonomic: rows(&equation.rheonomic),
                input: rows(&equation.input),
            },
        });
        analysis
    }

    /// The modes of a machine without control.
    ///
    /// # Errors
    /// [`MachineError`] as [`StructureModel::new`].
    pub fn passive(structure: &Structure) -> Result<Self, MachineError> {
        let model = StructureModel::new(structure)?;
        let modes = model.modes();
        let energies = of_structure(structure, &[], &model, &modes);
        Ok(Self::of(structure, &model, &modes, energies))
    }

    fn of(
        structure: &Structure,
        model: &StructureModel,
        modes: &Modes,
        energies: Vec<Energies>,
    ) -> Self {
        let motion = |i: usize, six: usize| {
            let motion = modes.shapes.column(i);
            motion.rows(6 * six, 6).iter().copied().collect()
        };
        let entries = modes.hertz().into_iter().zip(energies).enumerate();
        let entries = entries.map(|(i, (hz, energies))| ModeEntry {
            energies,
            hz,
            shape: structure
                .bodies
                .iter()
                .enumerate()
                .map(|(b, body)| BodyMotion {
                    body: body.name.clone(),
                    motion: motion(i, b),
                })
                .collect(),
            nodes: model
                .owners()
                .iter()
                .enumerate()
                .skip(structure.bodies.len())
                .map(|(six, owner)| NodeMotion {
                    node: owner.name(structure),
                    motion: motion(i, six),
                })
                .collect(),
            deformations: Vec::new(),
        });
        Self {
            machine: structure.name.clone(),
            modes: entries.collect(),
            leg_loads: structure
                .beams
                .iter()
                .zip(&model.statics.axial)
                .map(|(beam, &axial_force)| LegLoad {
                    beam: beam.name.clone(),
                    axial_force,
                    buckling_load: buckling_load(beam),
                })
                .collect(),
            control: None,
            reach: reach(structure),
        }
    }
}
