//! The state of a torsion model in the coordinates of another one that has all of its hinges, and more.
//!
//! | symbol | meaning |
//! |---|---|
//! | x, u | positions and velocities of the atoms, of the first model |
//! | q, v | of the second: x(q) = x, J(q) v = u |

use crate::atoms::{MoleculeError, MoleculeErrors};
use crate::recluster::{Tangent, failed};
use crate::torsion_model::{TorsionModel, check};
use phipsi_model::JointKind;
use std::f64::consts::{PI, TAU};

/// Atoms farther than this (nm) from where the coordinates put them are of other clusters; rounding is far below.
const OFF: f64 = 1e-9;

/// Configuration and velocities of a second model that moves as a first one does.
///
/// # Computes
/// q of the positions, v = M⁻¹ J* m u at q. `near`: a configuration of the second model; of angles that differ by whole turns the
/// nearest is taken, of quaternions the sign.
///
/// # Shapes & units
/// `q`: nq, `v`: nv of `from`; `near` and the result: nq (and nv) of `to`; rad, nm, ps.
///
/// # Accuracy
/// Positions and velocities of the atoms are the same to rounding.
///
/// # Cost
/// O(atoms).
///
/// # Errors
/// [`MoleculeErrors`]: lengths; hinges or open angles of the first model that the second one has not.
pub fn same_motion(
    from: &TorsionModel,
    q: &[f64],
    v: &[f64],
    to: &TorsionModel,
    near: &[f64],
) -> Result<(Vec<f64>, Vec<f64>), MoleculeErrors> {
    let model = to.model();
    check("near", near.len(), model.nq()).map_err(|e| failed(&e))?;
    let old = Tangent::new(from, q)?;
    let (mut found, off) = to.coordinates(&old.positions).map_err(|e| failed(&e))?;
    if off.is_nan() || off > OFF {
        let found = format!("positions that are off by {off:.1e} nm");
        return Err(MoleculeErrors(vec![MoleculeError::new(
            "clusters",
            found,
            "clusters of the second model within those of the first",
            "give the second model all hinges and open angles of the first",
        )]));
    }
    for k in model.moving_joints() {
        let range = model.q_range(k);
        match model.joints()[k].kind {
            JointKind::Free => {
                let own = &mut found[range.start + 3..range.end];
                if own.iter().zip(&near[range.start + 3..]).map(|(a, b)| a * b).sum::<f64>() < 0.0 {
                    own.iter_mut().for_each(|x| *x = -*x);
                }
            }
            JointKind::Continuous { .. } | JointKind::Universal { .. } => {
                for i in range {
                    if (near[i] - found[i]).abs() > PI {
                        found[i] += TAU * ((near[i] - found[i]) / TAU).round();
                    }
                }
            }
            _ => {}
        }
    }
    let u = old.spread(v).map_err(|e| failed(&e))?;
    let speeds = Tangent::new(to, &found)?.project(&u).map_err(|e| failed(&e))?;
    Ok((found, speeds))
}
