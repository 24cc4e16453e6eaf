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
//! | all atoms on one line, nothing to turn | refused: three angles about a line are one too many |

use crate::atoms::{Atoms, MoleculeError, MoleculeErrors};
use crate::clusters::{Clusters, is_linear};
use crate::force_field::RigidGroups;
use crate::roots::{Rooted, rooted};
use phipsi_model::{Body, Inertia, Joint, JointKind, Model, ModelBuilder, Placement};
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
    /// The degree of freedom of each hinge.
    hinges: Vec<usize>,
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
    /// [`MoleculeErrors`]: molecules whose atoms lie on one line, and what the model itself refuses.
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
        refuse_linear(atoms, positions, &clusters, &order)?;
        let mut names = Names::default();
        let mut builder = ModelBuilder::new("molecules").gravity([0.0; 3]);
        let mut body_names = vec![String::new(); clusters.clusters.len()];
        let mut joint_names = vec![String::new(); clusters.hinges.len()];
        let mut origins = vec![Vec3::zero(); clusters.clusters.len()];
        for step in &order {
            let c = step.cluster;
            let origin = positions[step.atom];
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
                    let axis = (origin - positions[inboard]).0;
                    (JointKind::Continuous { axis }, body_names[parent].clone(), origins[parent])
                }
            };
            let name = match step.hinge {
                None => names.joint(body_names[c].clone()),
                Some((h, _)) => joint_names[h].clone(),
            };
            let placement = Placement { translation: (origin - from).0, ..Placement::IDENTITY };
            builder = builder
                .body(Body::new(body_names[c].as_str(), inertia(atoms, positions, members, origin)))
                .joint(Joint::new(name, joint).at(placement), parent, body_names[c].as_str());
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
        let hinges = joint_names.iter().map(|name| model.v_offset(joint(name))).collect();
        let layout = Layout::new(&model);
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
        for hinge in &clusters.hinges {
            for side in 0..2 {
                let (body, site) = site(hinge.atoms[1 - side], hinge.clusters[side]);
                far[body].push(site);
            }
        }
        Ok(TorsionModel { atoms: atoms.clone(), clusters, model, layout, bodies, sites, far, hinges })
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
    /// The degree of freedom of a hinge, in the order of [`Clusters::hinges`].
    pub fn hinge_dof(&self, hinge: usize) -> usize {
        self.hinges[hinge]
    }
    /// Number of degrees of freedom: hinges, and six for each base (three for a single atom).
    pub fn degrees_of_freedom(&self) -> usize {
        self.model.nv()
    }
    /// ln det M(q), in nm and Da; the same for every choice of roots. Cost O(n).
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

fn refuse_linear(
    atoms: &Atoms,
    positions: &[Vec3<f64>],
    clusters: &Clusters,
    order: &[Rooted],
) -> Result<(), MoleculeErrors> {
    let mut errors = Vec::new();
    for step in order.iter().filter(|s| s.hinge.is_none() && !s.has_hinges) {
        let members = &clusters.clusters[step.cluster];
        let points: Vec<Vec3<f64>> = members.iter().map(|&i| positions[i]).collect();
        if members.len() > 1 && is_linear(&points) {
            let names: Vec<String> = members.iter().map(|&i| atoms.label(i)).collect();
            errors.push(MoleculeError::new(
                format!("molecule of atoms {}", names.join(", ")),
                "all its atoms lie on one line",
                "atoms off the line, or single atoms: a free base has three angles, a line two",
                "list the atoms as free, so that they move as points held by their bonds",
            ));
        }
    }
    if errors.is_empty() { Ok(()) } else { Err(MoleculeErrors(errors)) }
}

/// Names that were given, so that none is given twice.
#[derive(Default)]
struct Names {
    bodies: HashSet<String>,
    joints: HashSet<String>,
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
}

/// The name, or the first of `NAME#2`, `NAME#3`, … that is not taken.
fn unused(taken: &mut HashSet<String>, name: String) -> String {
    let numbered = (2..).map(|i| format!("{name}#{i}"));
    let unused =
        std::iter::once(name.clone()).chain(numbered).find(|n| !taken.contains(n)).unwrap_or(name.clone());
    taken.insert(unused.clone());
    unused
}
