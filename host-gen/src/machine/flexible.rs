//! Flexible bodies: matrices read from files, and checked to be those of a free elastic body.

use std::fs;
use std::path::Path;

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, MatrixXx6, Vector3};
use nalgebra_sparse::convert::serial::convert_coo_dense;
use nalgebra_sparse::io::load_coo_from_matrix_market_str;
use npyz::{NpyFile, Order};

use super::checked::{FlexibleBody, Node};
use super::error::EntryError;
use super::file::{FlexibleBodyEntry, LengthUnit, MassUnit};
use super::validate::{Checked, fraction, not_negative, positive};
use crate::numeric::motion::rigid_motions;
use crate::numeric::unit_diagonal::{scaled, to_ones};

/// Most rows of a matrix: with more, a design takes hours.
const ROWS: usize = 900;

/// The part of an entry by which rounding of a file's digits may make it differ.
const DIGITS: f64 = 1e-5;

/// The part of the forces in a rigid motion that may remain of them: positions of nodes in a finite
/// element programme and in the file, both rounded.
const REMAINS: f64 = 1e-4;

/// An eigenvalue of a matrix scaled to a diagonal of ones that counts as zero.
const ZERO: f64 = 1e-10;

/// Reads and checks the flexible body `name`; relative paths of its matrices are from `folder`.
/// `interface` are its nodes, by index in `nodes`.
pub(super) fn flexible_body(
    name: &str,
    spec: &FlexibleBodyEntry,
    folder: &Path,
    interface: Vec<usize>,
    nodes: &[Node],
) -> Checked<FlexibleBody> {
    let entry = format!("flexible_bodies.{name}");
    if interface.is_empty() {
        return Err(EntryError::new(
            format!("{entry}.nodes"),
            "a flexible body needs interface nodes, six coordinates of its matrices each",
        ));
    }
    let mass_entry = format!("{entry}.mass_matrix");
    let stiffness_entry = format!("{entry}.stiffness_matrix");
    let mut mass = read(&mass_entry, &folder.join(&spec.mass_matrix))?;
    let mut stiffness = read(&stiffness_entry, &folder.join(&spec.stiffness_matrix))?;
    let size = mass.nrows();
    if stiffness.nrows() != size {
        return Err(EntryError::new(
            stiffness_entry,
            format!(
                "the stiffness matrix has {} rows and the mass matrix {size}",
                stiffness.nrows()
            ),
        ));
    }
    let fixed = 6 * interface.len();
    if size < fixed {
        return Err(EntryError::new(
            format!("{entry}.nodes"),
            format!(
                "{} nodes have {fixed} coordinates, and the matrices have {size} rows",
                interface.len()
            ),
        )
        .fix("name the interface nodes of the matrices, each once; modal coordinates come last"));
    }
    // In SI: energies of the file are in its mass times its length squared over s².
    let length = match spec.length_unit {
        LengthUnit::M => 1.0,
        LengthUnit::Mm => 1e-3,
    };
    let heavy = match spec.mass_unit {
        MassUnit::Kg => 1.0,
        MassUnit::T => 1e3,
    };
    let unit = DVector::from_fn(
        size,
        |i, _| {
            if i < fixed && i % 6 < 3 { 1.0 } else { length }
        },
    );
    for matrix in [&mut mass, &mut stiffness] {
        for (i, mut row) in matrix.row_iter_mut().enumerate() {
            row *= heavy * unit[i];
            row.component_mul_assign(&unit.transpose());
        }
    }
    let mass = symmetric(&mass_entry, "mass", mass)?;
    let stiffness = symmetric(&stiffness_entry, "stiffness", stiffness)?;

    let at: Vec<Vector3<f64>> = interface.iter().map(|&node| nodes[node].at).collect();
    let centre = at.iter().sum::<Vector3<f64>>() / at.len() as f64;
    let rigid = rigid_motions(&at, &centre, size);
    let stiffness = free(&stiffness_entry, &stiffness, &rigid)?;
    let (total, cog) = whole(&mass_entry, &mass, &rigid, &centre)?;
    if let Some(stated) = spec.mass {
        let stated = positive(&format!("{entry}.mass"), stated, "kg")?;
        if (total / stated - 1.0).abs() > 0.01 {
            return Err(EntryError::new(
                mass_entry,
                format!("the matrix has a mass of {total:.4e} kg, and the file says {stated} kg"),
            )
            .fix("check length_unit and mass_unit, and whether the matrix has the whole body"));
        }
    }
    let loss_entry = format!("{entry}.loss_factor");
    let modal_entry = format!("{entry}.modal_damping");
    Ok(FlexibleBody {
        name: name.to_owned(),
        nodes: interface,
        mass,
        stiffness,
        loss_factor: not_negative(&loss_entry, spec.loss_factor.unwrap_or(0.0), "")?,
        modal_damping: fraction(&modal_entry, spec.modal_damping.unwrap_or(0.0))?,
        total,
        cog,
    })
}

/// The square matrix in a file.
fn read(entry: &str, path: &Path) -> Checked<DMatrix<f64>> {
    let refuse = |cause: String| EntryError::new(entry, format!("{} {cause}", path.display()));
    let fails = |error: &dyn core::fmt::Display| refuse(format!("cannot be read: {error}"));
    let check = |rows: usize, columns: usize| {
        if rows != columns || rows == 0 {
            Err(refuse(format!(
                "has {rows} rows and {columns} columns; the matrix must be square"
            )))
        } else if rows > ROWS {
            Err(refuse(format!(
                "has {rows} rows; {ROWS} can be computed in a useful time"
            ))
            .fix("reduce the body to fewer interface nodes and modes"))
        } else {
            Ok(rows)
        }
    };
    let extension = path.extension().and_then(|extension| extension.to_str());
    let matrix = match extension {
        Some("mtx") => {
            let text = fs::read_to_string(path).map_err(|error| fails(&error))?;
            let sparse = load_coo_from_matrix_market_str::<f64>(&text);
            let sparse = sparse.map_err(|error| fails(&error))?;
            check(sparse.nrows(), sparse.ncols())?;
            convert_coo_dense(&sparse)
        }
        Some("npy") => {
            let bytes = fs::read(path).map_err(|error| fails(&error))?;
            let array = NpyFile::new(&bytes[..]).map_err(|error| fails(&error))?;
            let &[rows, columns] = array.shape() else {
                let shape = array.shape().len();
                return Err(refuse(format!("has {shape} dimensions; a matrix has two")));
            };
            let long = |length: u64| usize::try_from(length).unwrap_or(usize::MAX);
            let size = check(long(rows), long(columns))?;
            let order = array.order();
            let all = array.into_vec::<f64>().map_err(|error| fails(&error))?;
            if all.len() != size * size {
                return Err(refuse("ends too early".to_owned()));
            }
            match order {
                Order::C => DMatrix::from_row_slice(size, size, &all),
                Order::Fortran => DMatrix::from_column_slice(size, size, &all),
            }
        }
        _ => {
            return Err(refuse(
                "is neither Matrix Market (.mtx) nor NumPy (.npy)".to_owned(),
            ));
        }
    };
    if matrix.iter().all(|x| x.is_finite()) {
        Ok(matrix)
    } else {
        Err(refuse("has entries that are not finite".to_owned()))
    }
}

/// The matrix without what rounding left of its skew part, after a check that it is symmetric and
/// positive semidefinite.
fn symmetric(entry: &str, what: &str, matrix: DMatrix<f64>) -> Checked<DMatrix<f64>> {
    let n = matrix.nrows();
    let diagonal = matrix.diagonal();
    if let Some(i) = (0..n).find(|&i| diagonal[i] < 0.0) {
        return Err(EntryError::new(
            entry,
            format!(
                "the {what} matrix is not positive semidefinite: entry ({0}, {0}) of its diagonal is negative",
                i + 1
            ),
        ));
    }
    for i in 0..n {
        for j in 0..i {
            let scale = (diagonal[i] * diagonal[j]).sqrt();
            if (matrix[(i, j)] - matrix[(j, i)]).abs() > DIGITS * scale {
                return Err(EntryError::new(
                    entry,
                    format!(
                        "the {what} matrix is not symmetric: entries ({}, {}) and ({1}, {0}) differ",
                        i + 1,
                        j + 1
                    ),
                )
                .fix("export it whole, or in Matrix Market with the word symmetric in its first line"));
            }
        }
    }
    let matrix = 0.5 * (&matrix + matrix.transpose());
    let least = scaled(&matrix, &to_ones(&matrix));
    let least = least.symmetric_eigenvalues().min();
    if least < -DIGITS {
        return Err(EntryError::new(
            entry,
            format!(
                "the {what} matrix is not positive semidefinite: scaled to a diagonal of ones, it has the eigenvalue {least:.1e}"
            ),
        ));
    }
    Ok(matrix)
}

const MOTIONS: [&str; 6] = [
    "translation along x",
    "translation along y",
    "translation along z",
    "rotation about x",
    "rotation about y",
    "rotation about z",
];

/// The stiffness without what rounding leaves of forces in rigid motions, after a check that a
/// rigid motion makes none, and every other motion some.
fn free(entry: &str, stiffness: &DMatrix<f64>, rigid: &MatrixXx6<f64>) -> Checked<DMatrix<f64>> {
    let forces = stiffness * rigid;
    let sizes = stiffness.abs() * rigid.abs();
    for (k, motion) in MOTIONS.iter().enumerate() {
        let (force, size) = (forces.column(k).amax(), sizes.column(k).amax());
        if force > REMAINS * size {
            let message = format!(
                "the stiffness matrix is not that of a free body: a rigid {motion} leaves {:.1e} of the forces that it is made of",
                force / size
            );
            let fix = if k < 3 {
                "export the body without supports, with x, y, z, rx, ry, rz of each node in this order and modal coordinates last"
            } else {
                "check the order of nodes, their positions under [nodes] against those of the body, and length_unit"
            };
            return Err(EntryError::new(entry, message).fix(fix));
        }
    }
    // Scaled, so that forces and moments compare.
    let scale = to_ones(stiffness);
    let mut basis = rigid.clone();
    for (mut row, scale) in basis.row_iter_mut().zip(&scale) {
        row /= *scale;
    }
    let basis = basis.qr().q();
    let n = stiffness.nrows();
    let without = DMatrix::identity(n, n) - &basis * basis.transpose();
    let elastic = &without * scaled(stiffness, &scale) * &without;
    let mut values = elastic.symmetric_eigenvalues();
    values.as_mut_slice().sort_by(f64::total_cmp);
    // Six of them are the rigid motions that were taken out.
    if let Some(least) = values.get(6)
        && *least < ZERO
    {
        return Err(EntryError::new(
            entry,
            "the stiffness matrix has more than the six motions of a rigid body without stiffness",
        )
        .fix("take out coordinates without stiffness, such as rotations of solid elements' nodes, or tie them to the body"));
    }
    Ok(DMatrix::from_fn(n, n, |i, j| {
        0.5 * (elastic[(i, j)] + elastic[(j, i)]) / (scale[i] * scale[j])
    }))
}

/// Mass, kg, and centre of gravity, m, after a check that the mass is the same in all directions.
/// The rotations of the `rigid` motions are about `centre`.
fn whole(
    entry: &str,
    mass: &DMatrix<f64>,
    rigid: &MatrixXx6<f64>,
    centre: &Vector3<f64>,
) -> Checked<(f64, Vector3<f64>)> {
    let whole: Matrix6<f64> = rigid.transpose() * mass * rigid;
    let [x, y, z] = [0, 1, 2].map(|i| whole[(i, i)]);
    let total = (x + y + z) / 3.0;
    let off = whole.fixed_view::<3, 3>(0, 0) - Matrix3::from_diagonal_element(total);
    if total <= 0.0 || off.amax() > 0.01 * total {
        return Err(EntryError::new(
            entry,
            format!(
                "a body has the same mass in all directions; this matrix has {x:.4e} kg along x, {y:.4e} along y and {z:.4e} along z"
            ),
        )
        .fix("check the order of coordinates: x, y, z, rx, ry, rz of each node, modal coordinates last"));
    }
    // The moment of the mass, m·[r]×.
    let moment = whole.fixed_view::<3, 3>(3, 0);
    let skew = 0.5 * (moment - moment.transpose());
    let offset = Vector3::new(skew[(2, 1)], skew[(0, 2)], skew[(1, 0)]) / total;
    Ok((total, centre + offset))
}
