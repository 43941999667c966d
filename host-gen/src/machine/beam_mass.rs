//! The mass of a beam, the elements that it is divided into, and the nodes that are held.

use super::checked::{Beam, Carrier, Node, Spring, Stiffness};
use super::error::EntryError;
use super::file::ProfileEntry;
use super::validate::{Checked, positive};

/// Mass, kg, moment of inertia about the own axis, kg m², and number of elements of a beam.
pub(super) struct BeamMass {
    pub mass: f64,
    pub polar_inertia: f64,
    pub segments: usize,
}

/// Most nodes with coordinates of their own: with more, a design takes hours.
const OWN_NODES: usize = 150;

/// Checks density, mass and segments of the stiffness set at `entry`, for a beam of `length`, m.
pub(super) fn beam_mass(
    entry: &str,
    p: &ProfileEntry,
    stiffness: &Stiffness,
    length: f64,
) -> Checked<BeamMass> {
    let mass = match (p.density, p.mass, p.area) {
        (None, None, _) => 0.0,
        (None, Some(mass), _) => positive(&format!("{entry}.mass"), mass, "kg")?,
        (Some(density), None, Some(area)) => {
            let density = positive(&format!("{entry}.density"), density, "kg/m³")?;
            positive(&format!("{entry}.area"), area, "m²")?;
            density * area * length
        }
        (Some(_), None, None) => {
            return Err(EntryError::new(
                format!("{entry}.density"),
                "a density needs the section that the material fills",
            )
            .fix("give mass, the mass of the whole beam in kg, or material and section"));
        }
        (Some(_), Some(_), _) => {
            return Err(EntryError::new(
                format!("{entry}.mass"),
                "a beam has either density or mass, not both",
            ));
        }
    };
    let segments = p.segments.unwrap_or(1);
    let segments_entry = format!("{entry}.segments");
    if segments == 0 {
        return Err(EntryError::new(
            segments_entry,
            "segments must be at least 1",
        ));
    }
    if segments > 1 {
        if mass == 0.0 {
            return Err(EntryError::new(
                segments_entry,
                "a beam without mass has no resonances of its own, and is exact in one element",
            )
            .fix("give density or mass, or remove segments"));
        }
        let [y, z] = stiffness.bending;
        if [stiffness.axial, stiffness.torsion, y, z].contains(&0.0) {
            return Err(EntryError::new(
                segments_entry,
                "the nodes between the elements of this beam would not be held: one of its stiffnesses is 0",
            )
            .fix("remove segments, or give all stiffnesses"));
        }
    }
    // I/A of a homogeneous section in both planes; its sum is that of the polar moment.
    let gyration_squared = match (p.area, p.second_moments) {
        (Some(area), Some(second)) if area > 0.0 => second.iter().sum::<f64>() / area,
        _ if stiffness.axial > 0.0 => stiffness.bending.iter().sum::<f64>() / stiffness.axial,
        _ => 0.0,
    };
    Ok(BeamMass {
        mass,
        polar_inertia: mass * gyration_squared,
        segments,
    })
}

/// Checks that beams or springs end on every free node, and that there are not too many nodes.
pub(super) fn check_nodes(nodes: &[Node], beams: &[Beam], springs: &[Spring]) -> Checked<()> {
    let mut held = vec![false; nodes.len()];
    let ends = beams.iter().map(|beam| beam.ends);
    for end in ends
        .chain(springs.iter().map(|spring| spring.ends))
        .flatten()
    {
        held[end] = true;
    }
    let free = |node: &&Node| node.carrier == Carrier::Free;
    for (i, node) in nodes.iter().enumerate() {
        if free(&node) && !held[i] {
            return Err(EntryError::new(
                format!("nodes.{}", node.name),
                "the node is free, and neither a beam nor a spring ends on it",
            )
            .fix("remove it, or join it to the machine by beams or springs"));
        }
    }
    let inner = beams.iter().map(|beam| beam.segments - 1).sum::<usize>();
    let all = inner + nodes.iter().filter(free).count();
    let most = beams.iter().max_by_key(|beam| beam.segments);
    match most {
        Some(most) if all > OWN_NODES => Err(EntryError::new(
            format!("beams.{}", most.name),
            format!(
                "{all} nodes are free or between the segments of beams; {OWN_NODES} can be computed in a useful time"
            ),
        )
        .fix("use fewer segments: a beam shows its first k resonances with about 2k")),
        _ => Ok(()),
    }
}
