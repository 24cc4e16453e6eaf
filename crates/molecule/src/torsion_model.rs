//! Molecules as trees of rigid clusters on free bases: an ordinary [`Model`] in nm, Da and ps.
//!
//! Body frames are parallel to the world at the given positions, where q is neutral: a base's origin is an atom of its
//! cluster, a hinge's the atom at its outboard end. Hinge angles are increments from the given torsions, with the sign of
//! the torsion (right-handed along the bond), whichever end is outboard.
//!
//! | molecule | base |
//! |---|---|
//! | one atom | translation, 3 degrees of freedom |
//! | clusters and hinges, or one rigid cluster | free, 6; the root is the cluster whose heaviest branch is lightest |
//! | all atoms on one line, nothing to turn | free with a still axis, 5 (`lines.rs`) |

use crate::atoms::{Atoms, MoleculeError, MoleculeErrors};
use crate::clusters::{Clusters, HingeBond};
use crate::force_field::RigidGroups;
use crate::lines::straighten;
use crate::roots::rooted;
use phipsi_closure::{ClosedDynamics, ClosedMomenta, Conditions};
use phipsi_model::{Body, Closure, ClosureKind, Inertia, Joint, JointKind, Model, ModelBuilder, Placement};
use phipsi_recursion::layout::GROUND;
use phipsi_recursion::{ArticulatedSweep, DynamicsError, Layout};
use phipsi_spatial::{Motion, Sym3, Transform, Vec3, Wrench};
use std::collections::HashSet;

/// An atom in the layout body that carries it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Site {
    pub(crate) atom: usize,
    pub(crate) place: Vec3<f64>,
}

/// The normal of an open angle h–i–j, which is at rest in the cluster of i as j is not: a point at the distance [`Mark::AWAY`] from i.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Mark {
    pub(crate) atoms: [usize; 3],
    pub(crate) place: Vec3<f64>,
}

impl Mark {
    /// nm; that of a bond.
    const AWAY: f64 = 0.1;

    /// Where it is.
    pub(crate) fn point([h, i, j]: [usize; 3], positions: &[Vec3<f64>]) -> Vec3<f64> {
        positions[i] + normal(positions, [h, i, j]).scale(Self::AWAY)
    }
}

/// The torsion model of molecules.
#[derive(Clone, Debug)]
pub struct TorsionModel {
    atoms: Atoms,
    clusters: Clusters,
    model: Model,
    pub(crate) layout: Layout<f64>,
    /// The body of each cluster.
    bodies: Vec<usize>,
    /// Atoms of each layout body.
    pub(crate) sites: Vec<Vec<Site>>,
    /// Atoms of other bodies that are at rest in this one: the far ends of its hinges.
    pub(crate) far: Vec<Vec<Site>>,
    /// Normals of the open angles that are at rest in each layout body.
    pub(crate) marks: Vec<Vec<Mark>>,
    /// The degree of freedom of each hinge: its torsion, or its bend where it does not turn.
    hinges: Vec<usize>,
    /// The degree of freedom of each hinge's bend, and the angle at q = 0.
    bends: Vec<Option<usize>>,
    angles: Vec<Option<f64>>,
    /// Independent rows of the closures at q = 0.
    rank: usize,
    /// The largest distance by which atoms of linear molecules were put on their lines, nm.
    straightened: f64,
}

/// Poses of the clusters at one configuration.
#[derive(Clone, Debug)]
pub struct Poses {
    pub(crate) hinge: Vec<Transform<f64>>,
    pub(crate) world: Vec<Transform<f64>>,
}

/// Scratch of [`TorsionModel::gather_into`].
#[derive(Clone, Debug)]
pub struct GatherWorkspace(Vec<Wrench<f64>>);

impl TorsionModel {
    /// The model of clusters at the given positions (nm), with its roots at the mass centroids of the trees.
    ///
    /// # Errors
    /// [`MoleculeErrors`]: molecules whose atoms are all in one place, and what the model itself refuses.
    pub fn new(atoms: &Atoms, positions: &[Vec3<f64>], clusters: Clusters) -> Result<Self, MoleculeErrors> {
        Self::with_roots(atoms, positions, clusters, &[])
    }
    /// Atoms that keep their distances: those of each body, and the far ends of its hinges.
    pub fn rigid_groups(&self) -> RigidGroups {
        let body =
            |(own, far): (&Vec<Site>, &Vec<Site>)| own.iter().chain(far).map(|site| site.atom).collect();
        RigidGroups::new(self.atoms.len(), self.sites.iter().zip(&self.far).map(body))
    }
    /// The same, with the base of some molecules at given atoms.
    ///
    /// # Errors
    /// As [`TorsionModel::new`]; roots that are no atoms, or two of one molecule.
    pub fn with_roots(
        atoms: &Atoms,
        positions: &[Vec3<f64>],
        clusters: Clusters,
        roots: &[usize],
    ) -> Result<Self, MoleculeErrors> {
        for (what, found) in [("positions", positions.len()), ("clusters", clusters.cluster_of.len())] {
            if found != atoms.len() {
                return Err(MoleculeErrors(vec![MoleculeError::new(
                    what,
                    format!("{found} atoms"),
                    format!("{} atoms", atoms.len()),
                    "give those of the same atoms",
                )]));
            }
        }
        let order = rooted(atoms, &clusters, roots)?;
        let (lines, straight, straightened) = straighten(atoms, positions, &clusters, &order)?;
        let positions = &straight[..];
        let mut names = Names::default();
        let mut builder = ModelBuilder::new("molecules").gravity([0.0; 3]);
        let mut body_names = vec![String::new(); clusters.clusters.len()];
        let mut joint_names = vec![String::new(); clusters.hinges.len()];
        let mut origins = vec![Vec3::zero(); clusters.clusters.len()];
        for step in &order {
            let c = step.cluster;
            // A bend turns about the atom at its angle, which is at rest on both sides.
            let bend = step.hinge.and_then(|(h, _)| clusters.hinges[h].bend);
            let origin = positions[bend.map_or(step.atom, |b| b.center)];
            origins[c] = origin;
            let members = &clusters.clusters[c];
            body_names[c] = names.body(atoms.label(step.atom));
            let (joint, parent, from) = match step.hinge {
                None if members.len() == 1 && !step.has_hinges => {
                    (JointKind::Translation, "world".into(), Vec3::zero())
                }
                None => (JointKind::Free, "world".into(), Vec3::zero()),
                Some((h, inboard)) => {
                    let parent = clusters.cluster_of[inboard];
                    joint_names[h] = names.joint(atoms.bond_label(clusters.hinges[h].atoms));
                    let joint = hinge_joint(positions, &clusters.hinges[h], [inboard, step.atom]);
                    (joint, body_names[parent].clone(), origins[parent])
                }
            };
            let name = match step.hinge {
                None => names.joint(body_names[c].clone()),
                Some((h, _)) => joint_names[h].clone(),
            };
            let placement = Placement { translation: (origin - from).0, ..Placement::IDENTITY };
            let mut body = Body::new(body_names[c].as_str(), inertia(atoms, positions, members, origin));
            if let Some(line) = &lines[c] {
                body = line.body(body);
            }
            builder = builder.body(body).joint(
                Joint::new(name, joint).at(placement),
                parent,
                body_names[c].as_str(),
            );
        }
        for closure in &clusters.closures {
            let name = names.closure(atoms.bond_label(closure.atoms));
            builder = builder.closure(ring_closure(positions, closure, name, &body_names, &origins));
        }
        let model = builder.build().map_err(|errors| {
            let convert = |v: &phipsi_model::Violation| {
                MoleculeError::new("model", v.to_string(), "a model", "correct the masses and positions")
            };
            MoleculeErrors(errors.0.iter().map(convert).collect())
        })?;
        let index = |name: &String| model.find_body(name).ok().flatten().expect("a body that was just added");
        let bodies: Vec<usize> = body_names.iter().map(index).collect();
        let joint = |name: &String| model.find_joint(name).expect("a joint that was just added");
        let hinges: Vec<usize> = joint_names.iter().map(|name| model.v_offset(joint(name))).collect();
        let mut bends = vec![None; hinges.len()];
        let mut turns = hinges.clone();
        for step in &order {
            if let Some((h, inboard)) = step.hinge
                && let Some(bend) = clusters.hinges[h].bend
            {
                // The bend is the first axis where the angle is on the inboard side.
                let first = usize::from(bend.center != inboard);
                let both = clusters.hinges[h].turns;
                bends[h] = Some(hinges[h] + if both { first } else { 0 });
                turns[h] = hinges[h] + if both { 1 - first } else { 0 };
            }
        }
        let angle = |h: &HingeBond| h.open_angle().map(|atoms| angle(positions, atoms));
        let angles = clusters.hinges.iter().map(angle).collect();
        let layout = Layout::new(&model.clone().without_closures());
        let mut sites = vec![Vec::new(); layout.len()];
        let mut far = vec![Vec::new(); layout.len()];
        let site = |atom: usize, cluster: usize| {
            let carrier = &layout.carriers()[bodies[cluster]];
            (carrier.body, Site { atom, place: carrier.pose.point(positions[atom] - origins[cluster]) })
        };
        for (atom, &cluster) in clusters.cluster_of.iter().enumerate() {
            let (body, site) = site(atom, cluster);
            sites[body].push(site);
        }
        for (cluster, atoms) in clusters.at_rest().iter().enumerate() {
            for &atom in atoms.iter().filter(|&&a| clusters.cluster_of[a] != cluster) {
                let (body, site) = site(atom, cluster);
                far[body].push(site);
            }
        }
        let mut marks = vec![Vec::new(); layout.len()];
        for atoms in clusters.hinges.iter().filter_map(HingeBond::open_angle) {
            let cluster = clusters.cluster_of[atoms[1]];
            let carrier = &layout.carriers()[bodies[cluster]];
            let place = carrier.pose.point(Mark::point(atoms, positions) - origins[cluster]);
            marks[carrier.body].push(Mark { atoms, place });
        }
        let rank = rank(&model)?;
        let hinges = turns;
        let atoms = atoms.clone();
        Ok(TorsionModel {
            atoms,
            clusters,
            model,
            layout,
            bodies,
            sites,
            far,
            marks,
            hinges,
            bends,
            angles,
            rank,
            straightened,
        })
    }
    /// The model: clusters as bodies, hinges as joints.
    pub fn model(&self) -> &Model {
        &self.model
    }
    /// Its compiled form.
    pub fn layout(&self) -> &Layout<f64> {
        &self.layout
    }
    /// The atoms.
    pub fn atoms(&self) -> &Atoms {
        &self.atoms
    }
    /// The clusters and hinges.
    pub fn clusters(&self) -> &Clusters {
        &self.clusters
    }
    /// The body of the model that a cluster is.
    pub fn body_of_cluster(&self, cluster: usize) -> usize {
        self.bodies[cluster]
    }
    /// The degree of freedom of a hinge, in the order of [`Clusters::hinges`]: its torsion, or its bend where it does not turn.
    pub fn hinge_dof(&self, hinge: usize) -> usize {
        self.hinges[hinge]
    }
    /// The open angles: coordinate q and degree of freedom of the bend β, and θ₀ (rad), the angle at q = 0: θ = θ₀ + β.
    pub fn open_angles(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        self.bends.iter().zip(&self.angles).filter_map(|(dof, angle)| {
            let dof = (*dof)?;
            let (joint, component) = self.model.joint_of_velocity(dof);
            Some((self.model.q_offset(joint) + component, dof, (*angle)?))
        })
    }
    /// The degree of freedom of a hinge's bend.
    pub fn bend_dof(&self, hinge: usize) -> Option<usize> {
        self.bends[hinge]
    }
    /// True if flexible rings are closed by closures.
    pub fn has_rings(&self) -> bool {
        !self.clusters.closures.is_empty()
    }
    /// Makes velocities keep flexible rings closed, and linear molecules from turning about their lines, with the least change in
    /// kinetic energy: those of the Maxwell–Boltzmann distribution of the tree become those of the model. `q`: nq, `v`: nv.
    ///
    /// # Errors
    /// [`MoleculeErrors`]: lengths, and joints without inertia.
    pub fn close_velocities(&self, q: &[f64], v: &mut [f64]) -> Result<(), MoleculeErrors> {
        self.model.still_axes().for_each(|axis| axis.remove(v));
        if self.has_rings() {
            let mut closed = ClosedDynamics::<f64>::new(&self.model).map_err(|e| loops_failed(&e))?;
            closed.project_velocity(q, v, &Conditions::default()).map_err(|e| loops_failed(&e))?;
        }
        Ok(())
    }
    /// Number of degrees of freedom: torsions and bends of hinges, and six for each base (five for a linear molecule, three for a
    /// single atom), less the independent rows of the closures of flexible rings at q = 0.
    pub fn degrees_of_freedom(&self) -> usize {
        self.model.nv() - self.rank - self.model.still_axes().count()
    }
    /// The largest distance (nm) by which an atom of a linear molecule was put on the line of its molecule.
    pub fn straightened(&self) -> f64 {
        self.straightened
    }
    /// ln det M(q), in nm and Da; the same for every choice of roots. A linear molecule adds a constant. Cost O(n).
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn log_determinant(&self, q: &[f64]) -> Result<f64, DynamicsError> {
        Ok(ArticulatedSweep::new(&self.layout, q)?.log_determinant())
    }
    /// Poses before any configuration was set.
    pub fn poses(&self) -> Poses {
        let identity = vec![Transform::identity(); self.layout.len()];
        Poses { hinge: identity.clone(), world: identity }
    }
    /// Scratch of [`TorsionModel::gather_into`].
    pub fn gather_workspace(&self) -> GatherWorkspace {
        GatherWorkspace(vec![Wrench::zero(); self.layout.len()])
    }

    /// Positions of all atoms (nm) at a configuration: one outward sweep. `q`: nq; `out`: one for each atom. Cost O(atoms).
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn positions_into(
        &self,
        q: &[f64],
        poses: &mut Poses,
        out: &mut [Vec3<f64>],
    ) -> Result<(), DynamicsError> {
        check("q", q.len(), self.model.nq())?;
        check("positions", out.len(), self.atoms.len())?;
        check("poses", poses.world.len(), self.layout.len())?;
        for (k, body) in self.layout.bodies().iter().enumerate() {
            let hinge = body.pose(q);
            let world = match body.parent {
                GROUND => hinge,
                parent => poses.world[parent].compose(&hinge),
            };
            (poses.hinge[k], poses.world[k]) = (hinge, world);
            for site in &self.sites[k] {
                out[site.atom] = world.point(site.place);
            }
        }
        Ok(())
    }
    /// Positions of all atoms, nm.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn positions(&self, q: &[f64]) -> Result<Vec<Vec3<f64>>, DynamicsError> {
        let mut out = vec![Vec3::zero(); self.atoms.len()];
        self.positions_into(q, &mut self.poses(), &mut out)?;
        Ok(out)
    }

    /// Generalised forces J* F of forces on the atoms, at poses set before: one inward sweep. With momenta m u of the atoms
    /// in place of forces it gives generalised momenta. `vectors`: one for each atom, world axes; `out`: nv. Cost O(atoms).
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn gather_into(
        &self,
        poses: &Poses,
        vectors: &[Vec3<f64>],
        workspace: &mut GatherWorkspace,
        out: &mut [f64],
    ) -> Result<(), DynamicsError> {
        check("vectors", vectors.len(), self.atoms.len())?;
        check("out", out.len(), self.model.nv())?;
        check("poses", poses.world.len(), self.layout.len())?;
        let wrenches = &mut workspace.0;
        check("workspace", wrenches.len(), self.layout.len())?;
        for (k, sites) in self.sites.iter().enumerate() {
            let rotation = &poses.world[k].rotation;
            let mut sum = Wrench::zero();
            for site in sites {
                let force = rotation.transpose_mul(vectors[site.atom]);
                sum += Wrench::new(site.place.cross(force), force);
            }
            wrenches[k] = sum;
        }
        for (k, body) in self.layout.bodies().iter().enumerate().rev() {
            let f = wrenches[k];
            for i in 0..body.hinge.nv() {
                out[body.v + i] = body.hinge.project(i, &f);
            }
            if body.parent != GROUND {
                wrenches[body.parent] += poses.hinge[k].wrench_to_parent(f);
            }
        }
        Ok(())
    }

    /// Velocities of all atoms (nm/ps, world axes) at poses set before. `v`: nv; `out`: one for each atom. Cost O(atoms).
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn velocities_into(
        &self,
        poses: &Poses,
        v: &[f64],
        out: &mut [Vec3<f64>],
    ) -> Result<(), DynamicsError> {
        check("v", v.len(), self.model.nv())?;
        check("velocities", out.len(), self.atoms.len())?;
        check("poses", poses.world.len(), self.layout.len())?;
        let mut velocity = vec![Motion::zero(); self.layout.len()];
        for (k, body) in self.layout.bodies().iter().enumerate() {
            let inboard = match body.parent {
                GROUND => Motion::zero(),
                parent => poses.hinge[k].motion_to_child(velocity[parent]),
            };
            velocity[k] = inboard + body.hinge.expand(&v[body.v..]);
            for site in &self.sites[k] {
                let moved = velocity[k].linear + velocity[k].angular.cross(site.place);
                out[site.atom] = poses.world[k].rotation * moved;
            }
        }
        Ok(())
    }
}

pub(crate) fn check(argument: &'static str, found: usize, expected: usize) -> Result<(), DynamicsError> {
    if found == expected { Ok(()) } else { Err(DynamicsError::Shape { argument, expected, found }) }
}

/// The joint of a hinge between an inboard and an outboard atom: in the outboard one, or in the atom of an open angle.
fn hinge_joint(positions: &[Vec3<f64>], hinge: &HingeBond, [inboard, outboard]: [usize; 2]) -> JointKind {
    let along = (positions[outboard] - positions[inboard]).0;
    let Some([reference, center, other]) = hinge.open_angle() else {
        return JointKind::Continuous { axis: along };
    };
    let normal = normal(positions, [reference, center, other]);
    // The angle grows as j turns away from h, or h from j.
    let bend = if center == inboard { normal.0 } else { (-normal).0 };
    match (hinge.turns, center == inboard) {
        (false, _) => JointKind::Continuous { axis: bend },
        (true, true) => JointKind::Universal { axes: [bend, along] },
        (true, false) => JointKind::Universal { axes: [along, bend] },
    }
}

/// The unit normal of the plane of an angle.
fn normal(positions: &[Vec3<f64>], [h, i, j]: [usize; 3]) -> Vec3<f64> {
    let normal = (positions[h] - positions[i]).cross(positions[j] - positions[i]);
    normal.scale(1.0 / normal.norm())
}

/// θ of an open angle.
fn angle(positions: &[Vec3<f64>], [h, i, j]: [usize; 3]) -> f64 {
    let (u, w) = (positions[h] - positions[i], positions[j] - positions[i]);
    u.cross(w).norm().atan2(u.dot(w))
}

/// The cut bond of a ring: both atoms at one place of either side, which turn against each other about the bond.
fn ring_closure(
    positions: &[Vec3<f64>],
    bond: &HingeBond,
    name: String,
    bodies: &[String],
    origins: &[Vec3<f64>],
) -> Closure {
    let [i, j] = bond.atoms;
    let [a, b] = bond.clusters;
    // The turn that takes z to the bond.
    let along = positions[j] - positions[i];
    let [x, y, z] = along.scale(1.0 / along.norm()).0;
    let rotation = if z > -0.5 { [-y, x, 0.0, 1.0 + z] } else { [1.0 - z, 0.0, x, y] };
    let pose = |cluster: usize| Placement { translation: (positions[j] - origins[cluster]).0, rotation };
    Closure {
        name,
        kind: ClosureKind::Revolute,
        body_a: bodies[a].clone(),
        pose_a: pose(a),
        body_b: bodies[b].clone(),
        pose_b: pose(b),
    }
}

pub(crate) fn loops_failed(e: &dyn std::fmt::Display) -> MoleculeErrors {
    let remedy = "keep the named hinge, or the ring, rigid";
    MoleculeErrors(vec![MoleculeError::new("flexible rings", e.to_string(), "loops that move", remedy)])
}

/// Independent rows of the closures at q = 0.
fn rank(model: &Model) -> Result<usize, MoleculeErrors> {
    if model.closures().is_empty() {
        return Ok(0);
    }
    let mut momenta = ClosedMomenta::<f64>::new(model).map_err(|e| loops_failed(&e))?;
    momenta.place(&model.neutral::<f64>()).map_err(|e| loops_failed(&e))?;
    Ok(momenta.rank())
}

/// Point masses about a frame parallel to the world.
fn inertia(atoms: &Atoms, positions: &[Vec3<f64>], members: &[usize], origin: Vec3<f64>) -> Inertia {
    let mass: f64 = members.iter().map(|&i| atoms.masses[i]).sum();
    let moment =
        members.iter().fold(Vec3::zero(), |sum, &i| sum + (positions[i] - origin).scale(atoms.masses[i]));
    let center = moment.scale(1.0 / mass);
    let about = members.iter().fold(Sym3::zero(), |sum, &i| {
        sum + Sym3::point_mass(atoms.masses[i], positions[i] - origin - center)
    });
    let frame = Placement { translation: center.0, ..Placement::IDENTITY };
    Inertia { mass, frame, tensor: about.entries() }
}

/// Names that were given, so that none is given twice.
#[derive(Default)]
struct Names {
    bodies: HashSet<String>,
    joints: HashSet<String>,
    closures: HashSet<String>,
}

impl Names {
    fn body(&mut self, name: String) -> String {
        // `world` is the inertial frame.
        let name = if name == "world" { "world#1".into() } else { name };
        unused(&mut self.bodies, name)
    }
    fn joint(&mut self, name: String) -> String {
        unused(&mut self.joints, name)
    }
    fn closure(&mut self, name: String) -> String {
        unused(&mut self.closures, name)
    }
}

/// The name, or the first of `NAME#2`, `NAME#3`, … that is not taken.
fn unused(taken: &mut HashSet<String>, name: String) -> String {
    let numbered = (2..).map(|i| format!("{name}#{i}"));
    let unused =
        std::iter::once(name.clone()).chain(numbered).find(|n| !taken.contains(n)).unwrap_or(name.clone());
    taken.insert(unused.clone());
    unused
}
