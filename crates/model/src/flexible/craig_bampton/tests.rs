//! Masses on springs against sums over points, beam elements against beams, and refusals.

use super::{CraigBampton, InterfaceNode, KeptModes, difference};
use crate::{Beam, MassPoint, Random, Section, ShapeIntegrals, SymmetricMatrix};
use nalgebra::DMatrix;

/// Masses at random places, all connected by springs.
fn cloud(seed: u64) -> (Vec<f64>, CraigBampton) {
    let mut random = Random::new(seed);
    let count = 6;
    let positions: Vec<[f64; 3]> = (0..count).map(|_| random.vector()).collect();
    let masses: Vec<f64> = (0..count).map(|_| 0.5 + random.uniform()).collect();
    let mut stiffness = DMatrix::zeros(3 * count, 3 * count);
    for k in 0..count {
        for l in 0..k {
            let d = difference(positions[k], positions[l]);
            for a in 0..3 {
                for b in 0..3 {
                    let x = d[a] * d[b] * (1.0 + (k + l) as f64);
                    stiffness[(3 * k + a, 3 * k + b)] += x;
                    stiffness[(3 * l + a, 3 * l + b)] += x;
                    stiffness[(3 * k + a, 3 * l + b)] -= x;
                    stiffness[(3 * l + a, 3 * k + b)] -= x;
                }
            }
        }
    }
    let mass = DMatrix::from_fn(3 * count, 3 * count, |i, j| if i == j { masses[i / 3] } else { 0.0 });
    // Held at one point only, a cloud turns about it.
    let outboard = (3..count).map(|k| InterfaceNode { name: format!("n{k}"), index: k }).collect();
    let [mass, stiffness] = [mass, stiffness].map(|m| SymmetricMatrix::from_dense(&m).unwrap());
    let modes = KeptModes::Lowest(0);
    (masses, CraigBampton { mass, stiffness, positions, inboard: vec![0, 1, 2], outboard, modes })
}

/// With every node an interface the shapes are known at all of them: integrals are sums over mass points.
#[test]
fn integrals_of_masses_and_springs_are_sums_over_points() {
    for seed in 0..5 {
        let (masses, elements) = cloud(seed);
        let (body, report) = elements.reduce("cloud").unwrap();
        let n = body.modes();
        assert_eq!(n, 9);
        assert!(!report.lumped && report.lumping < 1e-12, "{report:?}");
        let mut points: Vec<MassPoint> = (0..3)
            .map(|k| MassPoint {
                mass: masses[k],
                position: difference(elements.positions[k], elements.positions[0]),
                displacement: vec![[0.0; 3]; n],
            })
            .collect();
        points.extend(body.nodes.iter().enumerate().map(|(k, node)| MassPoint {
            mass: masses[k + 3],
            position: node.position,
            displacement: node.displacement.clone(),
        }));
        let want = ShapeIntegrals::from_points(n, &points);
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        close(body.integrals.mass, want.mass);
        for a in 0..3 {
            close(body.integrals.first_moment[a], want.first_moment[a]);
            for b in 0..3 {
                close(body.integrals.second_moment[a][b], want.second_moment[a][b]);
                close(body.integrals.rotary[a][b], 0.0);
                for l in 0..n {
                    close(body.integrals.moment[l][a][b], want.moment[l][a][b]);
                    for m in 0..n {
                        let x = l * n + m;
                        close(body.integrals.product[x][a][b], want.product[x][a][b]);
                    }
                }
            }
            for l in 0..n {
                close(body.integrals.displacement[l][a], want.displacement[l][a]);
                close(body.integrals.rotary_coupling[l][a], 0.0);
            }
        }
        let modal = body.integrals.modal_mass();
        for l in 0..n {
            for m in 0..n {
                close(modal[l * n + m], if l == m { 1.0 } else { 0.0 });
            }
        }
    }
}

/// A beam of cubic elements in one plane, with all six degrees of freedom at each node; the others are stiff and heavy.
fn beam_elements(elements: usize) -> CraigBampton {
    let nodes = elements + 1;
    let h = 1.0 / elements as f64;
    let (mut mass, mut stiffness) =
        (DMatrix::zeros(6 * nodes, 6 * nodes), DMatrix::zeros(6 * nodes, 6 * nodes));
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
        // Bending along y: y and the rotation about z; along z: z and minus the rotation about y.
        for (moved, turned, sign) in [(1, 5, 1.0), (2, 4, -1.0)] {
            let dofs = [6 * e + moved, 6 * e + turned, 6 * e + 6 + moved, 6 * e + 6 + turned];
            let signs = [1.0, sign, 1.0, sign];
            for i in 0..4 {
                for j in 0..4 {
                    let s = signs[i] * signs[j];
                    mass[(dofs[i], dofs[j])] += s * m[i][j] * h / 420.0;
                    stiffness[(dofs[i], dofs[j])] += s * k[i][j] / (h * h * h);
                }
            }
        }
        // Axial and torsion, with a linear shape.
        for (dof, inertia, rigidity) in [(0, 1.0, 1e4), (3, 1e-3, 1e2)] {
            let dofs = [6 * e + dof, 6 * e + 6 + dof];
            for i in 0..2 {
                for j in 0..2 {
                    let same = if i == j { 1.0 } else { -1.0 };
                    mass[(dofs[i], dofs[j])] += inertia * h * (1.5 + 0.5 * same) / 6.0;
                    stiffness[(dofs[i], dofs[j])] += same * rigidity / h;
                }
            }
        }
    }
    let [mass, stiffness] = [mass, stiffness].map(|m| SymmetricMatrix::from_dense(&m).unwrap());
    CraigBampton {
        mass,
        stiffness,
        positions: (0..nodes).map(|k| [k as f64 * h, 0.0, 0.0]).collect(),
        inboard: vec![0],
        outboard: vec![InterfaceNode { name: "tip".into(), index: elements }],
        modes: KeptModes::Lowest(14),
    }
}

/// Frequencies and first-order integrals of a beam of elements are those of the beam.
#[test]
fn a_beam_of_elements_is_a_beam() {
    let elements = beam_elements(16);
    let (body, report) = elements.reduce("beam").unwrap();
    let roots = crate::flexible::clamped_free_roots(2);
    for (k, root) in roots.iter().enumerate() {
        for plane in 0..2 {
            let found = report.frequencies[2 * k + plane];
            let want = root * root;
            // Cubic elements: (b h)⁴/1440 or so; clamped-interface modes cost less.
            assert!((found / want - 1.0).abs() < 1e-4, "{found} {want}");
        }
    }
    assert!(report.lumped && report.lumping > 1e-6, "{report:?}");
    let section = Section {
        mass_per_length: 1.0,
        bending_stiffness: [1.0; 2],
        torsional_stiffness: 1e2,
        polar_inertia: 1e-3,
        axial_stiffness: 1e4,
    };
    let rigid = Beam::new(1.0, section).build().integrals;
    assert!((body.integrals.mass - rigid.mass).abs() < 1e-13);
    assert!((body.integrals.first_moment[0] - rigid.first_moment[0]).abs() < 1e-13);
    let (a, b) = (body.integrals.undeformed(), rigid.undeformed());
    for i in [0, 3, 5] {
        assert!((a.tensor[i] - b.tensor[i]).abs() < 1e-10, "{:?} {:?}", a.tensor, b.tensor);
    }
    // M_ee and M_we(0) come from the mass matrix, whatever masses are lumped.
    let modal = body.integrals.modal_mass();
    let n = body.modes();
    for l in 0..n {
        for m in 0..n {
            let want = if l == m { 1.0 } else { 0.0 };
            assert!((modal[l * n + m] - want).abs() < 1e-11);
        }
    }
}

#[test]
fn what_is_wrong_is_said() {
    let mut elements = beam_elements(4);
    elements.outboard.push(InterfaceNode { name: "far".into(), index: 99 });
    let said = elements.reduce("beam").unwrap_err().to_string();
    assert!(said.contains("interface node 99") && said.contains("`beam`"), "{said}");
    let mut free = beam_elements(4);
    free.stiffness = SymmetricMatrix::from_triangle(30, []).unwrap();
    let said = free.reduce("beam").unwrap_err().to_string();
    assert!(said.contains("not positive definite: node 1, degree of freedom 0"), "{said}");
    let mut held = beam_elements(4);
    let spring = held.stiffness.entries().chain([(13, 13, 10.0)]);
    held.stiffness = SymmetricMatrix::from_triangle(30, spring).unwrap();
    let said = held.reduce("beam").unwrap_err().to_string();
    assert!(said.contains("rigid motion") && said.contains("node 2, degree of freedom 1"), "{said}");
    let mut massless = beam_elements(4);
    massless.mass = SymmetricMatrix::from_triangle(30, [(24, 24, 1.0)]).unwrap();
    let said = massless.reduce("beam").unwrap_err().to_string();
    assert!(said.contains("14 modes") && said.contains("mass for 0"), "{said}");
    let mut short = beam_elements(4);
    short.positions.pop();
    let said = short.reduce("plate").unwrap_err().to_string();
    assert!(said.contains("`plate`") && said.contains("30 rows") && said.contains("4 nodes"), "{said}");
    let mut turning = beam_elements(2);
    turning.modes = KeptModes::Given(DMatrix::from_element(18, 1, 1.0));
    let said = turning.reduce("beam").unwrap_err().to_string();
    assert!(said.contains("a shape moves inboard node 0"), "{said}");
}

/// Shapes that another program made give the same body.
#[test]
fn given_shapes_are_taken_as_they_are() {
    let elements = beam_elements(6);
    let shapes = elements.shapes("beam", 6).unwrap().psi;
    let given = CraigBampton { modes: KeptModes::Given(shapes), ..elements.clone() };
    let ((a, _), (b, report)) = (elements.reduce("beam").unwrap(), given.reduce("beam").unwrap());
    assert_eq!(a, b);
    assert!(report.clamped.is_empty() && report.first_left_out.is_none());
}

/// Clamped-clamped frequencies of both planes, which are equal in pairs, and what is said of those left out.
#[test]
fn modes_with_clamped_interfaces_are_the_beams() {
    let (_, report) = beam_elements(40).reduce("beam").unwrap();
    for (k, root) in crate::flexible::shapes::clamped_clamped_roots(5).iter().enumerate() {
        for plane in 0..2 {
            let error = report.clamped[2 * k + plane] / (root * root) - 1.0;
            // Cubic elements: (b h)⁴/1440.
            assert!((-1e-12..(root / 40.0).powi(4) / 700.0).contains(&error), "mode {k}: {error:e}");
        }
    }
    let next = report.first_left_out.unwrap();
    assert!(next >= report.clamped[13] * (1.0 - 1e-12), "{report:?}");
    assert!(report.rigid_force < 1e-13, "{report}");
    assert!((report.mass - 1.0).abs() < 1e-13, "{report}");
}
