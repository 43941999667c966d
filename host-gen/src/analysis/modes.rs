//! Modes with their shapes and energies, Eq. (2), and the static loads of the legs.

use serde::Serialize;

use super::{Rows, rows};
use crate::design::Study;
use crate::model::energy::{Energies, energies};
use crate::model::gravity::buckling_load;
use crate::model::independence::reach;

/// Result of `host-gen modes`: modes with shapes and energies, static loads of the legs,
/// and the equation of motion.
#[derive(Debug, Serialize)]
pub struct ModeAnalysis {
    pub(crate) machine: String,
    model_sha256: String,
    pub(crate) modes: Vec<ModeEntry>,
    /// How the design model was reduced, in words.
    pub(crate) reduction: &'static str,
    pub(crate) rigid_modes_hz: [f64; 6],
    /// Static loads of the legs; empty without gravity.
    pub(crate) leg_loads: Vec<LegLoad>,
    pub(crate) coordinates: Vec<String>,
    pub(crate) equation_of_motion: EquationMatrices,
    #[serde(skip)]
    pub(crate) reach: f64,
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
    /// The mode shape in the degrees of freedom q_d, mass-normalised, m and rad.
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
        let machine = study.machine();
        let modes = study.model().modes();
        let equation = study.model().equation_of_motion();
        let deformations = &study.model().coordinates * &modes.shapes;
        Self {
            machine: machine.name.clone(),
            model_sha256: machine.digest.to_string(),
            modes: modes
                .hertz()
                .into_iter()
                .zip(energies(machine, study.model(), &modes))
                .enumerate()
                .map(|(i, (hz, energies))| ModeEntry {
                    energies,
                    hz,
                    shape: machine
                        .bodies
                        .iter()
                        .enumerate()
                        .map(|(b, body)| BodyMotion {
                            body: body.name.clone(),
                            motion: modes
                                .shapes
                                .column(i)
                                .rows(6 * b, 6)
                                .iter()
                                .copied()
                                .collect(),
                        })
                        .collect(),
                    nodes: study
                        .model()
                        .owners()
                        .iter()
                        .enumerate()
                        .skip(machine.bodies.len())
                        .map(|(six, owner)| NodeMotion {
                            node: owner.name(machine),
                            motion: modes
                                .shapes
                                .column(i)
                                .rows(6 * six, 6)
                                .iter()
                                .copied()
                                .collect(),
                        })
                        .collect(),
                    deformations: deformations.column(i).iter().copied().collect(),
                })
                .collect(),
            reduction: study.design_model().suspension.reduction.words(),
            rigid_modes_hz: study.design_model().hertz(),
            leg_loads: machine
                .beams
                .iter()
                .zip(&study.model().statics.axial)
                .map(|(beam, &axial_force)| LegLoad {
                    beam: beam.name.clone(),
                    axial_force,
                    buckling_load: buckling_load(beam),
                })
                .collect(),
            coordinates: study.model().coordinate_names(machine),
            equation_of_motion: EquationMatrices {
                mass: rows(&equation.mass),
                damping: rows(&equation.damping),
                stiffness: rows(&equation.stiffness),
                rheonomic: rows(&equation.rheonomic),
                input: rows(&equation.input),
            },
            reach: reach(machine),
        }
    }
}
