//! Finite element models from files: beams of cubic elements against beams, and what is said of files that are wrong.

use nalgebra::DMatrix;
use phipsi_model::Model;
use phipsi_model::flexible::clamped_free_roots;
use phipsi_motion::System;
use phipsi_recursion::{Layout, MassMatrix};
use phipsi_simulate::scene::{Scene, parse};
use phipsi_simulate::{Recording, SimulateError, run};
use std::fmt::Write;
use std::path::Path;

/// Cubic elements of a beam along x: length, bending stiffness along y; 1 kg/m. Stiff in the other directions.
fn write_beam(folder: &Path, name: &str, elements: usize, length: f64, stiffness: f64) {
    let h = length / elements as f64;
    let size = 6 * (elements + 1);
    let (mut mass, mut stiff) = (DMatrix::<f64>::zeros(size, size), DMatrix::<f64>::zeros(size, size));
    let m = [
        [156.0, 22.0 * h, 54.0, -13.0 * h],
        [22.0 * h, 4.0 * h * h, 13.0 * h, -3.0 * h * h],
        [54.0, 13.0 * h, 156.0, -22.0 * h],
        [-13.0 * h, -3.0 * h * h, -22.0 * h, 4.0 * h * h],
    ];
    let k = [
        [12.0, 6.0 * h, -12.0, 6.0 * h],
        [6.0 * h, 4.0 * h * h, -6.0 * h, 2.0 * h * h],
        [-12.0, -6.0 * h, 12.0, -6.0 * h],
        [6.0 * h, 2.0 * h * h, -6.0 * h, 4.0 * h * h],
    ];
    for e in 0..elements {
        for (moved, turned, sign, rigidity) in [(1, 5, 1.0, stiffness), (2, 4, -1.0, 1e4 * stiffness)] {
            let dofs = [6 * e + moved, 6 * e + turned, 6 * e + 6 + moved, 6 * e + 6 + turned];
            let signs = [1.0, sign, 1.0, sign];
            for (i, j) in (0..4).flat_map(|i| (0..4).map(move |j| (i, j))) {
                let s = signs[i] * signs[j];
                mass[(dofs[i], dofs[j])] += s * m[i][j] * h / 420.0;
                stiff[(dofs[i], dofs[j])] += s * rigidity * k[i][j] / (h * h * h);
            }
        }
        for (dof, inertia, rigidity) in [(0, 1.0, 1e6), (3, 1e-3, 1e4)] {
            let dofs = [6 * e + dof, 6 * e + 6 + dof];
            for (i, j) in (0..2).flat_map(|i| (0..2).map(move |j| (i, j))) {
                let same = if i == j { 1.0 } else { -1.0 };
                mass[(dofs[i], dofs[j])] += inertia * h * (1.5 + 0.5 * same) / 6.0;
                stiff[(dofs[i], dofs[j])] += same * rigidity / h;
            }
        }
    }
    for (kind, matrix) in [("m", &mass), ("k", &stiff)] {
        let lower: Vec<(usize, usize)> = (0..size)
            .flat_map(|j| (j..size).map(move |i| (i, j)))
            .filter(|&(i, j)| matrix[(i, j)] != 0.0)
            .collect();
        let mut text = String::from("%%MatrixMarket matrix coordinate real symmetric\n");
        writeln!(text, "{size} {size} {}", lower.len()).unwrap();
        for (i, j) in lower {
            writeln!(text, "{} {} {:e}", i + 1, j + 1, matrix[(i, j)]).unwrap();
        }
        std::fs::write(folder.join(format!("{name}_{kind}.mtx")), text).unwrap();
    }
    let mut nodes = String::from("node, x, y, z\n");
    for k in 0..=elements {
        writeln!(nodes, "{}, {:e}, 0, 0", 100 + k, k as f64 * h).unwrap();
    }
    std::fs::write(folder.join(format!("{name}.csv")), nodes).unwrap();
}

fn body(name: &str, interface: &str, modes: usize) -> String {
    format!(
        "[[body]]\nname = \"{name}\"\n[body.flexible]\nmass = \"{name}_m.mtx\"\nstiffness = \"{name}_k.mtx\"\n\
         nodes = \"{name}.csv\"\ninboard = [100]\ninterface = {interface}\nmodes = {modes}\n"
    )
}

const JOINT: &str = "[[joint]]\nname = \"root\"\ntype = \"fixed\"\nparent = \"world\"\nchild = \"boom\"\n";
const END: &str = "[integrator]\nt_end = 0.5\nmethod = \"dop853\"\nrtol = 1e-11\n";

fn read(text: &str, folder: &Path) -> Result<Scene, SimulateError> {
    parse(text.into(), "test", "test.toml", folder, &[])
}

fn errors(text: &str, folder: &Path) -> String {
    match read(text, folder) {
        Ok(_) => panic!("accepted: {text}"),
        Err(e) => e.to_string(),
    }
}

/// Clamped-free frequencies of a beam without outboard interface, whose modes are the elements', and of one whose tip is an
/// interface: what modes with clamped interfaces leave out falls like the fourth power of their number.
#[test]
fn elements_from_files_are_a_beam() {
    let folder = tempfile::tempdir().unwrap();
    write_beam(folder.path(), "boom", 20, 2.0, 3.0);
    let errors = |interface: &str, modes: usize| {
        let scene = read(&format!("{}{JOINT}{END}", body("boom", interface, modes)), folder.path()).unwrap();
        let flexible = scene.simulation.dynamics.model().bodies()[0].flexible.clone().unwrap();
        assert!((flexible.integrals.mass - 2.0).abs() < 1e-12);
        let used = scene.reports[0].used.iter().find(|note| note.place == "body `boom`").unwrap();
        assert!(used.what.contains("126 degrees of freedom reduced to"), "{}", used.what);
        assert!(scene.files.iter().any(|file| file.key == "body.0.flexible.stiffness"));
        let squares = flexible.squared_frequencies().unwrap();
        [0, 1].map(|k| {
            let root = clamped_free_roots(2)[k];
            squares[k].sqrt() / (root * root * 3f64.sqrt() / 4.0) - 1.0
        })
    };
    // Cubic elements of length h: (b h)⁴/1440, and rounding of matrices whose entries are 1e10 times the lowest λ.
    let of_elements = [0, 1].map(|k| (clamped_free_roots(2)[k] / 20.0).powi(4) / 700.0 + 1e-9);
    let (alone, few, more) = (errors("[]", 3), errors("[120]", 4), errors("[120]", 8));
    println!("alone {alone:?}, interface with 4 modes {few:?}, 8 modes {more:?}");
    for k in 0..2 {
        assert!((-1e-9..of_elements[k]).contains(&alone[k]), "{alone:?}");
        assert!((-1e-9..few[k] / 8.0 + of_elements[k]).contains(&more[k]), "{few:?} {more:?}");
    }
    assert!(few[1] < 1e-3, "{few:?}");
}

/// A straight arm of two links on a clamped base with a spring of 5 N·m/rad between them: its frequencies are the roots of the
/// 6×6 determinant of two Euler–Bernoulli beams.
#[test]
fn an_arm_of_two_links_has_its_frequencies() {
    let folder = tempfile::tempdir().unwrap();
    write_beam(folder.path(), "boom", 24, 1.0, 3.0);
    write_beam(folder.path(), "fore", 24, 0.8, 1.0);
    let elbow = "[[joint]]\nname = \"elbow\"\ntype = \"continuous\"\naxis = [0, 0, 1]\nparent = \"boom\"\nnode = \"124\"\nchild = \"fore\"\n";
    let text = format!("{}{}{JOINT}{elbow}{END}", body("boom", "[124]", 8), body("fore", "[]", 8));
    let scene = read(&text, folder.path()).unwrap();
    let model: &Model = scene.simulation.dynamics.model();
    let (n, layout) = (model.nv(), Layout::<f64>::new(model));
    let mut mass = vec![0.0; n * n];
    MassMatrix::new(&layout).run(&layout, &model.neutral::<f64>(), &mut mass).unwrap();
    let mut stiffness = DMatrix::<f64>::zeros(n, n);
    stiffness[(0, 0)] = 5.0;
    for (k, body) in model.bodies().iter().enumerate() {
        let (first, modes) = (model.mode_v_range(k).start, body.modes());
        for (l, m) in (0..modes).flat_map(|l| (0..modes).map(move |m| (l, m))) {
            stiffness[(first + l, first + m)] = body.flexible.as_ref().unwrap().stiffness[l * modes + m];
        }
    }
    let root = DMatrix::from_row_slice(n, n, &mass).cholesky().unwrap().l();
    let left = root.solve_lower_triangular(&stiffness).unwrap();
    let standard = root.solve_lower_triangular(&left.transpose()).unwrap();
    let mut squares: Vec<f64> = standard.symmetric_eigenvalues().iter().copied().collect();
    squares.sort_by(f64::total_cmp);
    let want = [1.74018821357, 7.93404487962, 25.5189010116, 43.9488280169];
    // (b h)⁴/1440 of elements, and the modes with clamped interfaces that are left out, more with each mode.
    for ((square, want), budget) in squares.iter().zip(want).zip([1e-6, 2e-6, 2e-5, 1e-4]) {
        let error = square.sqrt() / want - 1.0;
        assert!((-1e-9..budget).contains(&error), "{want}: {error:e}");
    }
}

/// It swings under gravity and keeps its energy.
#[test]
fn a_boom_of_elements_swings() {
    let folder = tempfile::tempdir().unwrap();
    write_beam(folder.path(), "boom", 10, 1.0, 30.0);
    let hinge = JOINT.replace("fixed", "continuous").replace("type", "axis = [0, 0, 1]\ntype");
    let start = "[initial]\nq.boom = { mode1 = 0.01 }\nv.boom = { mode2 = -0.1 }\n";
    let gravity = "[model]\ngravity = [0, -9.8, 0]\n";
    let text = format!("{gravity}{}{hinge}{start}{END}", body("boom", "[]", 2));
    let mut scene = read(&text, folder.path()).unwrap();
    assert_eq!(scene.simulation.start.q[1..], [0.01, 0.0]);
    assert_eq!(scene.simulation.start.v[1..], [0.0, -0.1]);
    let summary = run(&mut scene.simulation, &mut Recording::default()).unwrap();
    // Some hundred steps of 1e-11.
    assert!(summary.energy_error < 1e-9, "{:e}", summary.energy_error);
    assert!(summary.q[0] < -0.5, "{:?}", summary.q);
    let wrong = text.replace("mode1 = 0.01", "mode9 = 0.01");
    assert!(errors(&wrong, folder.path()).contains("mode1 to mode2"));
    let wrong = text.replace("q.boom", "q.bom");
    assert!(errors(&wrong, folder.path()).contains("did you mean `boom`?"));
}

#[test]
fn mistakes_in_files_of_elements_are_named() {
    let folder = tempfile::tempdir().unwrap();
    write_beam(folder.path(), "boom", 4, 1.0, 3.0);
    let text = format!("{}{JOINT}{END}", body("boom", "[104]", 2));
    let said = |old: &str, new: &str| {
        assert!(text.contains(old), "{old}");
        errors(&text.replace(old, new), folder.path())
    };
    assert!(said("boom_m.mtx", "none.mtx").contains("none.mtx"));
    assert!(said("inboard = [100]", "inboard = [99]").contains("node `99`"));
    assert!(said("inboard = [100]\n", "").contains("no `inboard`"));
    assert!(said("inboard = [100]", "inboard = [104]").contains("an interface twice"));
    assert!(said("modes = 2", "modes = 2.5").contains("whole numbers"));
    assert!(said("modes = 2", "modes = 2\nbending = [1, 1]").contains("unknown key `bending`"));
    assert!(said("boom.csv", "boom_m.mtx").contains("a label and three finite numbers"));
    let stiffness = std::fs::read_to_string(folder.path().join("boom_k.mtx")).unwrap();
    let spoiled = |old: &str, new: &str| {
        assert!(stiffness.contains(old), "{old}");
        std::fs::write(folder.path().join("boom_k.mtx"), stiffness.replacen(old, new, 1)).unwrap();
        errors(&text, folder.path())
    };
    assert!(spoiled("30 30 ", "31 30 ").contains("boom_k.mtx:2"));
    let entry = stiffness.lines().nth(4).unwrap();
    assert!(spoiled(entry, "3 3 x").contains("boom_k.mtx:5"));
    // A support in the matrices: a rigid motion strains them.
    let support = stiffness.lines().find(|line| line.starts_with("14 14 ")).unwrap();
    assert!(spoiled(support, "14 14 1e5").contains("rigid motion"));
}
