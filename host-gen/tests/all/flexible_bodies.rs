//! Flexible bodies from finite elements: a rod reduced in here against the full model and closed
//! forms, and matrices that are refused.

use std::fmt::Write as _;
use std::path::Path;

use host_gen::machine::{Machine, MachineError};
use host_gen::model::energy::energies;
use host_gen::model::multibody::Multibody;
use host_gen::numeric::eigen::generalised_eigen;
use nalgebra::DMatrix;
use npyz::WriterBuilder as _;
use tempfile::TempDir;

use crate::beams_with_mass::{AREA, LENGTH, SECOND, STEEL, TORSION, beside, rod};

/// Elements of the full model.
const PARTS: usize = 10;

/// Stiffness and mass of an element of length h along x, for x, y, z, rx, ry, rz of both ends.
fn element(h: f64, stiffer: f64) -> [DMatrix<f64>; 2] {
    let [e, g, density] = STEEL;
    let (e, g) = (e * stiffer, g * stiffer);
    let mut k = DMatrix::zeros(12, 12);
    let mut m = DMatrix::zeros(12, 12);
    let polar = SECOND.iter().sum::<f64>();
    for (axis, spring, mass) in [
        (0, e * AREA / h, density * AREA * h),
        (3, g * TORSION / h, density * polar * h),
    ] {
        for (i, j, sign, part) in [
            (0, 0, 1.0, 3.0),
            (0, 6, -1.0, 6.0),
            (6, 0, -1.0, 6.0),
            (6, 6, 1.0, 3.0),
        ] {
            k[(axis + i, axis + j)] = sign * spring;
            m[(axis + i, axis + j)] = mass / part;
        }
    }
    let stiff = [
        [12.0, 6.0, -12.0, 6.0],
        [6.0, 4.0, -6.0, 2.0],
        [-12.0, -6.0, 12.0, -6.0],
        [6.0, 2.0, -6.0, 4.0],
    ];
    let heavy = [
        [156.0, 22.0, 54.0, -13.0],
        [22.0, 4.0, 13.0, -3.0],
        [54.0, 13.0, 156.0, -22.0],
        [-13.0, -3.0, -22.0, 4.0],
    ];
    for (across, about, sign, second) in [(2, 4, -1.0, SECOND[0]), (1, 5, 1.0, SECOND[1])] {
        let at = [across, about, 6 + across, 6 + about];
        let unit = [1.0, sign * h, 1.0, sign * h];
        for i in 0..4 {
            for j in 0..4 {
                let scale = unit[i] * unit[j];
                k[(at[i], at[j])] = e * second / h.powi(3) * scale * stiff[i][j];
                m[(at[i], at[j])] = density * AREA * h / 420.0 * scale * heavy[i][j];
            }
        }
    }
    [k, m]
}

/// Mass and stiffness of the rod by Craig and Bampton: its two ends, then the `modes` lowest modes
/// with the ends held.
fn reduced(modes: usize, stiffer: f64) -> [DMatrix<f64>; 2] {
    let size = 6 * (PARTS + 1);
    let mut k = DMatrix::zeros(size, size);
    let mut m = DMatrix::zeros(size, size);
    let [stiffness, mass] = element(LENGTH / PARTS as f64, stiffer);
    for part in 0..PARTS {
        let mut block = k.view_mut((6 * part, 6 * part), (12, 12));
        block += &stiffness;
        let mut block = m.view_mut((6 * part, 6 * part), (12, 12));
        block += &mass;
    }
    let ends: Vec<usize> = (0..6).chain(size - 6..size).collect();
    let inner: Vec<usize> = (6..size - 6).collect();
    let of = |a: &DMatrix<f64>, rows: &[usize], columns: &[usize]| {
        a.select_rows(rows).select_columns(columns)
    };
    let held = of(&k, &inner, &inner);
    let follow = -held.clone().lu().solve(&of(&k, &inner, &ends)).unwrap();
    let (_, shapes) = generalised_eigen(&held, &of(&m, &inner, &inner)).unwrap();
    let mut t = DMatrix::zeros(size, 12 + modes);
    for (i, &row) in ends.iter().enumerate() {
        t[(row, i)] = 1.0;
    }
    t.view_mut((6, 0), (size - 12, 12)).copy_from(&follow);
    t.view_mut((6, 12), (size - 12, modes))
        .copy_from(&shapes.columns(0, modes));
    [t.transpose() * m * &t, t.transpose() * k * t]
}

/// Matrix Market, every entry.
fn array(matrix: &DMatrix<f64>) -> String {
    let mut text = format!(
        "%%MatrixMarket matrix array real general\n{} {}\n",
        matrix.nrows(),
        matrix.ncols()
    );
    for x in matrix.iter() {
        writeln!(text, "{x:e}").unwrap();
    }
    text
}

/// Matrix Market, the lower triangle.
fn coordinates(matrix: &DMatrix<f64>) -> String {
    let n = matrix.nrows();
    let mut lines = Vec::new();
    for j in 0..n {
        for i in j..n {
            lines.push(format!("{} {} {:e}\n", i + 1, j + 1, matrix[(i, j)]));
        }
    }
    format!(
        "%%MatrixMarket matrix coordinate real symmetric\n{n} {n} {}\n{}",
        lines.len(),
        lines.concat()
    )
}

/// NumPy, row by row.
fn numpy(matrix: &DMatrix<f64>) -> Vec<u8> {
    let by_rows = matrix.transpose();
    let mut bytes = Vec::new();
    let shape = [matrix.nrows() as u64, matrix.ncols() as u64];
    let mut writer = npyz::WriteOptions::new()
        .default_dtype()
        .shape(&shape)
        .writer(&mut bytes)
        .begin_nd()
        .unwrap();
    writer.extend(by_rows.iter()).unwrap();
    writer.finish().unwrap();
    bytes
}

/// The rod on a short stiff beam from the base, free at its tip, as `middle` says.
fn on_a_clamp(middle: &str) -> String {
    beside(&format!(
        "[nodes]\nwall = [1.9, 0.0, 0.0]\nroot = [2.0, 0.0, 0.0]\ntip = [{:?}, 0.0, 0.0]\n[base]\nnodes = [\"wall\"]\n[beams.clamp]\nnodes = [\"wall\", \"root\"]\nstiffness = {{ axial = 1e8, bending = [2e4, 3e4], torsion = 1e4 }}\n{middle}",
        2.0 + LENGTH
    ))
}

const BODY: &str = "[flexible_bodies.rod]\nnodes = [\"root\", \"tip\"]\nmass_matrix = \"m.mtx\"\nstiffness_matrix = \"k.mtx\"\n";

fn in_folder(folder: &TempDir, body: &str) -> Result<Machine, MachineError> {
    Machine::parse(&folder.path().join("machine.toml"), &on_a_clamp(body))
}

fn with(matrices: &[DMatrix<f64>; 2], body: &str) -> Result<Machine, MachineError> {
    let folder = TempDir::new().unwrap();
    let [m, k] = matrices;
    std::fs::write(folder.path().join("m.mtx"), array(m)).unwrap();
    std::fs::write(folder.path().join("k.mtx"), coordinates(k)).unwrap();
    in_folder(&folder, body)
}

fn hertz(machine: &Machine) -> Vec<f64> {
    Multibody::new(machine).unwrap().modes().hertz()
}

/// With all modes of the held rod, a Craig–Bampton body is the rod; with some of them it has its low
/// modes, from above.
#[test]
fn a_reduced_rod_moves_as_the_full_one() {
    let full = on_a_clamp(&format!(
        "[free]\nnodes = [\"root\", \"tip\"]\n[beams.rod]\nnodes = [\"root\", \"tip\"]\nprofile = \"rod\"\n{}",
        rod(PARTS)
    ));
    let full = hertz(&Machine::parse(Path::new("full.toml"), &full).unwrap());
    let whole = hertz(&with(&reduced(6 * (PARTS - 1), 1.0), BODY).unwrap());
    assert_eq!(whole.len(), full.len());
    for (a, b) in whole.iter().zip(&full) {
        assert!((a / b - 1.0).abs() < 1e-6, "{a} {b}");
    }
    let some = hertz(&with(&reduced(8, 1.0), BODY).unwrap());
    assert_eq!(some.len(), 12 + 12 + 8);
    for (a, b) in some.iter().zip(&full).take(18) {
        assert!(a / b > 1.0 - 1e-9 && a / b < 1.01, "{a} {b}");
    }
    let guyan = hertz(&with(&reduced(0, 1.0), BODY).unwrap());
    assert_eq!(guyan.len(), 12 + 12);
}

/// In t and mm, and as NumPy's file, the machine is the same; its mass is that of the rod.
#[test]
fn units_and_formats_are_read() {
    let [m, k] = reduced(5, 1.0);
    let expected = hertz(&with(&[m.clone(), k.clone()], BODY).unwrap());
    let n = m.nrows();
    // Energy in t·mm²/s² = 1e-3 J; translations in mm.
    let unit = |i: usize| if i < 12 && i % 6 < 3 { 1e-3 } else { 1.0 };
    let other =
        [&m, &k].map(|a| DMatrix::from_fn(n, n, |i, j| 1e3 * unit(i) * unit(j) * a[(i, j)]));
    let body = format!("{BODY}length_unit = \"mm\"\nmass_unit = \"t\"\nmass = 1.256\n");
    let machine = with(&other, &body).unwrap();
    let rod = &machine.flexible[0];
    let mass = STEEL[2] * AREA * LENGTH;
    assert!((rod.total / mass - 1.0).abs() < 1e-9, "{}", rod.total);
    let middle = nalgebra::Vector3::new(2.0 + 0.5 * LENGTH, 0.0, 0.0);
    assert!((rod.cog - middle).norm() < 1e-9, "{}", rod.cog);
    for (a, b) in hertz(&machine).iter().zip(&expected) {
        assert!((a / b - 1.0).abs() < 1e-9, "{a} {b}");
    }

    let folder = TempDir::new().unwrap();
    std::fs::write(folder.path().join("m.npy"), numpy(&m)).unwrap();
    std::fs::write(folder.path().join("k.npy"), numpy(&k)).unwrap();
    let machine = in_folder(&folder, &BODY.replace(".mtx", ".npy")).unwrap();
    for (a, b) in hertz(&machine).iter().zip(&expected) {
        assert!((a / b - 1.0).abs() < 1e-12, "{a} {b}");
    }
}

/// What is in the files decides the digest and what a search reads.
#[test]
fn matrices_are_part_of_the_machine() {
    let one = with(&reduced(5, 1.0), BODY).unwrap();
    let same = with(&reduced(5, 1.0), BODY).unwrap();
    let other = with(&reduced(5, 1.000_001), BODY).unwrap();
    assert_eq!(one.digest, same.digest);
    assert_eq!(one.search_inputs(), same.search_inputs());
    assert_ne!(one.digest, other.digest);
    assert_ne!(one.search_inputs(), other.search_inputs());
}

/// The base takes the body along: at its tip the rod sags as under a uniform load, beyond what
/// the clamp gives.
#[test]
fn the_floor_moves_the_body() {
    let machine = with(&reduced(0, 1.0), BODY).unwrap();
    let model = Multibody::new(&machine).unwrap();
    let equation = model.equation_of_motion();
    let push = -(&equation.rheonomic * model.floor.column(2));
    let q = equation.stiffness.lu().solve(&push).unwrap();
    let first = 6 * machine.bodies.len();
    let (root, tip) = (first, first + 6);
    // Relative to the root and its slope.
    let sag = q[tip + 2] - q[root + 2] + LENGTH * q[root + 4];
    let [e, _, density] = STEEL;
    let exact = -density * AREA * LENGTH.powi(4) / (8.0 * e * SECOND[0]);
    assert!((sag / exact - 1.0).abs() < 1e-6, "{sag:e} {exact:e}");
    for energies in energies(&machine, &model, &model.modes()) {
        for shares in [&energies.kinetic, &energies.strain] {
            let sum: f64 = shares.iter().map(|share| share.share).sum();
            assert!((sum - 1.0).abs() < 1e-6, "{sum}");
        }
    }
}

/// A nearly rigid flexible body hangs like the rigid body of its mass and inertia.
#[test]
fn it_swings_like_a_rigid_body() {
    let hung = |body: &str| {
        beside(&format!(
            "gravity = [9.81, 0.0, 0.0]\n[nodes]\nwall = [1.9, 0.0, 0.0]\nroot = [2.0, 0.0, 0.0]\ntip = [{:?}, 0.0, 0.0]\n[base]\nnodes = [\"wall\"]\n[beams.hang]\nnodes = [\"wall\", \"root\"]\nstiffness = {{ axial = 1e6, bending = [0.02, 0.03], torsion = 0.1 }}\n{body}",
            2.0 + LENGTH
        ))
    };
    let mass = STEEL[2] * AREA * LENGTH;
    let polar = mass * SECOND.iter().sum::<f64>() / AREA;
    let across = mass * LENGTH * LENGTH / 12.0;
    let rigid = hung(&format!(
        "[bodies.rod]\nmass = {mass:?}\ninertia = [{polar:?}, {across:?}, {across:?}]\ncog = [{:?}, 0.0, 0.0]\nnodes = [\"root\", \"tip\"]\n[coordinates]\ndeformations = [\"hang.e1\", \"hang.e2\", \"hang.e3\", \"hang.e4\", \"hang.e5\", \"hang.e6\"]\n",
        2.0 + 0.5 * LENGTH
    ));
    let rigid = hertz(&Machine::parse(Path::new("rigid.toml"), &rigid).unwrap());
    let folder = TempDir::new().unwrap();
    let [m, k] = reduced(0, 1e4);
    std::fs::write(folder.path().join("m.mtx"), array(&m)).unwrap();
    std::fs::write(folder.path().join("k.mtx"), array(&k)).unwrap();
    let path = folder.path().join("machine.toml");
    let flexible = hertz(&Machine::parse(&path, &hung(BODY)).unwrap());
    // Gravity pulls along x here, so the frame's own modes are there too, in both.
    for (a, b) in flexible.iter().zip(&rigid).take(12) {
        assert!((a / b - 1.0).abs() < 1e-4, "{a} {b}");
    }
}

/// Each elastic mode φ of the free rod has φᵀDφ = 2ζω and no part in the others; rigid motions are
/// not damped. So it is with Guyan's matrices, and with some modes of the held rod.
#[test]
fn free_modes_have_their_damping() {
    let ratio = 0.03;
    for modes in [0, 4] {
        let [m, k] = reduced(modes, 1.0);
        let body = format!("{BODY}modal_damping = {ratio:?}\n[damping]\nmodal = 0.0\n");
        let machine = with(&[m.clone(), k.clone()], &body).unwrap();
        let model = Multibody::new(&machine).unwrap();
        let of_machine = model.modes();
        // D = M·V·Δ·Vᵀ·M: all motions have inertia.
        let momentum = &model.mass * &of_machine.shapes;
        let whole = &momentum * of_machine.damping * momentum.transpose();
        let n = m.nrows();
        let first = 6 * machine.bodies.len();
        let own = whole.view((first, first), (n, n));
        let (squares, shapes) = generalised_eigen(&k, &m).unwrap();
        let damping = shapes.transpose() * own * &shapes;
        let highest = 2.0 * ratio * squares.max().sqrt();
        for i in 0..n {
            for j in 0..n {
                let exact = if i == j && i >= 6 {
                    2.0 * ratio * squares[i].sqrt()
                } else {
                    0.0
                };
                let off = (damping[(i, j)] - exact).abs();
                assert!(off < 1e-7 * highest, "{i} {j}: {off:e} of {exact:e}");
            }
        }
        assert!((whole.amax() - own.amax()).abs() < 1e-9 * own.amax());
    }
    let [m, k] = reduced(0, 1.0);
    let error = with(&[m, k], &format!("{BODY}modal_damping = 1.0\n")).unwrap_err();
    assert_eq!(error.entry(), "flexible_bodies.rod.modal_damping");
    assert!(error.message().contains("below 1"), "{error}");
}

#[test]
fn each_wrong_matrix_has_its_error() {
    let right = reduced(2, 1.0);
    let changed = |which: usize, change: &dyn Fn(&mut DMatrix<f64>)| {
        let mut matrices = right.clone();
        change(&mut matrices[which]);
        matrices
    };
    let mass = "flexible_bodies.rod.mass_matrix";
    let stiffness = "flexible_bodies.rod.stiffness_matrix";
    let last = right[0].nrows() - 1;
    for (matrices, body, entry, says) in [
        (
            changed(0, &|m| m[(0, 6)] *= 1.5),
            BODY.to_owned(),
            mass,
            "not symmetric: entries (7, 1) and (1, 7)",
        ),
        (
            changed(0, &|m| m[(2, 2)] = -1.0),
            BODY.to_owned(),
            mass,
            "entry (3, 3) of its diagonal is negative",
        ),
        (
            changed(0, &|m| {
                m[(0, 6)] *= 4.0;
                m[(6, 0)] *= 4.0;
            }),
            BODY.to_owned(),
            mass,
            "not positive semidefinite: scaled",
        ),
        (
            changed(0, &|m| {
                m.row_mut(1).scale_mut(2.0);
                m.column_mut(1).scale_mut(2.0);
            }),
            BODY.to_owned(),
            mass,
            "the same mass in all directions",
        ),
        (
            changed(1, &|k| k[(1, 1)] *= 1.5),
            BODY.to_owned(),
            stiffness,
            "a rigid translation along y leaves",
        ),
        (
            right.clone(),
            BODY.replace("\"root\", \"tip\"", "\"tip\", \"root\""),
            stiffness,
            "a rigid rotation about y leaves",
        ),
        (
            changed(1, &|k| {
                k.row_mut(last).fill(0.0);
                k.column_mut(last).fill(0.0);
            }),
            BODY.to_owned(),
            stiffness,
            "more than the six motions",
        ),
        (
            changed(1, &|k| *k = k.clone().resize(12, 12, 0.0)),
            BODY.to_owned(),
            stiffness,
            "has 12 rows and the mass matrix 14",
        ),
        (
            changed(0, &|m| *m = m.clone().resize(13, 14, 0.0)),
            BODY.to_owned(),
            mass,
            "has 13 rows and 14 columns",
        ),
        (
            changed(0, &|m| *m *= 2.0),
            format!("{BODY}mass = 1.25\n"),
            mass,
            "the matrix has a mass of 2.5120e0 kg, and the file says 1.25 kg",
        ),
        (
            right.clone(),
            BODY.replace("m.mtx", "nothing.mtx"),
            mass,
            "cannot be read",
        ),
        (
            right.clone(),
            BODY.replace("m.mtx", "m.csv"),
            mass,
            "is neither",
        ),
        (
            right.clone(),
            format!("{BODY}loss_factor = -0.1\n"),
            "flexible_bodies.rod.loss_factor",
            "at least 0",
        ),
    ] {
        let error = with(&matrices, &body).unwrap_err();
        assert_eq!(error.entry(), entry, "{error}");
        assert!(error.message().contains(says), "{error}");
    }
}
