//! dynibo's side of `python -m validation.speed`; the protocol is that of phipsi's example `speed`. With a MODEL as its argument
//! it prints the names of the joints in dynibo's order.
//!
//! MODEL is `FILE.urdf`, `free:FILE.urdf` for a floating base, each with `#LINK` for the link of the Jacobian. A floating base
//! has the coordinates of phipsi's free joint for q (position, quaternion x y z w); its v, a and tau are angular first in world
//! axes, the acceleration the rate of the velocity of the root link's origin, as dynibo wants them.

#[path = "../../../../crates/phipsi/examples/speed/protocol.rs"]
mod protocol;

use dynibo::{BaseState, FloatingRobot, Frame, LinkId, Robot, Twist};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use protocol::{Call, Failure, Operation, Program, States, serve};
use std::cell::RefCell;

enum Tree {
    Fixed(Robot),
    Free(FloatingRobot),
}

struct Open {
    tree: RefCell<Tree>,
    target: Option<LinkId>,
    nv: usize,
}

fn twist(x: &[f64]) -> Twist {
    Twist::new(Vector3::new(x[0], x[1], x[2]), Vector3::new(x[3], x[4], x[5]))
}

fn base(q: &[f64], v: &[f64], a: &[f64]) -> Result<BaseState, Failure> {
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(q[6], q[3], q[4], q[5]));
    let frame: Frame = Isometry3::from_parts(Translation3::new(q[0], q[1], q[2]), rotation);
    Ok(BaseState::new(frame, twist(v), twist(a))?)
}

impl Program for Open {
    fn open(name: &str) -> Result<Self, Failure> {
        let (path, link) = name.split_once('#').unwrap_or((name, ""));
        let (tree, target, nv) = match path.strip_prefix("free:") {
            Some(path) => {
                let robot = FloatingRobot::from_urdf(path)?;
                let target = if link.is_empty() { None } else { Some(robot.link_id(link)?) };
                let nv = robot.generalized_count();
                (Tree::Free(robot), target, nv)
            }
            None => {
                let robot = Robot::from_urdf(path)?;
                let target = if link.is_empty() { None } else { Some(robot.link_id(link)?) };
                let nv = robot.generalized_count();
                (Tree::Fixed(robot), target, nv)
            }
        };
        Ok(Open { tree: RefCell::new(tree), target, nv })
    }

    fn operation<'a>(&'a self, name: &str, s: &'a States) -> Result<Option<Operation<'a>>, Failure> {
        if s.dimensions().1 != self.nv {
            return Err("the states have other dimensions than the model".into());
        }
        let nv = self.nv;
        // Base states are inputs; making them is not dynibo's work.
        let bases: Vec<BaseState> = match *self.tree.borrow() {
            Tree::Fixed(_) => Vec::new(),
            Tree::Free(_) => (0..s.count).map(|i| base(s.q(i), s.v(i), s.a(i))).collect::<Result<_, _>>()?,
        };
        let (size, call): (usize, Call<'a>) = match name {
            "forward_dynamics" => (
                nv,
                Box::new(move |i, out| {
                    Ok(match &mut *self.tree.borrow_mut() {
                        Tree::Fixed(r) => r.forward_dynamics(s.q(i), s.v(i), s.tau(i), &[], out)?,
                        Tree::Free(r) => {
                            r.forward_dynamics(&bases[i], &s.q(i)[7..], &s.v(i)[6..], s.tau(i), &[], out)?
                        }
                    })
                }),
            ),
            "inverse_dynamics" => (
                nv,
                Box::new(move |i, out| {
                    Ok(match &mut *self.tree.borrow_mut() {
                        Tree::Fixed(r) => r.inverse_dynamics(s.q(i), s.v(i), s.a(i), &[], out)?,
                        Tree::Free(r) => {
                            let (q, v, a) = (&s.q(i)[7..], &s.v(i)[6..], &s.a(i)[6..]);
                            r.inverse_dynamics(&bases[i], q, v, a, &[], out)?
                        }
                    })
                }),
            ),
            "mass_matrix" => (
                nv * nv,
                Box::new(move |i, out| {
                    Ok(match &mut *self.tree.borrow_mut() {
                        Tree::Fixed(r) => r.mass_matrix(s.q(i), out)?,
                        Tree::Free(r) => r.mass_matrix(&bases[i], &s.q(i)[7..], out)?,
                    })
                }),
            ),
            // By columns; the driver knows.
            "jacobian:columns" => {
                let Some(target) = self.target else { return Ok(None) };
                let call: Call<'a> = Box::new(move |i, out| {
                    Ok(match &mut *self.tree.borrow_mut() {
                        Tree::Fixed(r) => r.jacobian(s.q(i), target, out)?,
                        Tree::Free(r) => r.jacobian(&bases[i], &s.q(i)[7..], target, out)?,
                    })
                });
                (6 * nv, call)
            }
            _ => return Ok(None),
        };
        Ok(Some(Operation { size, batch: false, call }))
    }
}

/// Names of the moving joints in dynibo's order, one a line.
fn print_joints(model: &str) -> Result<(), Failure> {
    let open = Open::open(model)?;
    let tree = open.tree.borrow();
    let count = match &*tree {
        Tree::Fixed(r) => r.joint_count(),
        Tree::Free(r) => r.joint_count(),
    };
    for i in 0..count {
        println!(
            "{}",
            match &*tree {
                Tree::Fixed(r) => r.joint_name(i)?,
                Tree::Free(r) => r.joint_name(i)?,
            }
        );
    }
    Ok(())
}

fn main() -> Result<(), Failure> {
    match std::env::args().nth(1) {
        Some(model) => print_joints(&model),
        None => serve::<Open>(),
    }
}
