//! `<mimic>`: joints that follow others.

use super::{Mimic, ReadJoint};
use crate::suggest::{nearest, shown};
use crate::urdf::reader::Reader;
use phipsi_model::Coupling;
use std::collections::HashMap;

/// For how many errors a name is guessed, and among how many.
const MOST_GUESSES: usize = 100;
const MOST_NAMES: usize = 10_000;

/// The couplings that the model gets; what is wrong with a `<mimic>` is reported, also where it is dropped.
pub(super) fn couplings(reader: &mut Reader, joints: &[ReadJoint<'_>], mimic: Mimic) -> Vec<Coupling> {
    let mut index: HashMap<&str, usize> = HashMap::new();
    for (i, read) in joints.iter().enumerate() {
        // Of two joints with one name, which is an error of its own, the first.
        index.entry(&read.joint.name).or_insert(i);
    }
    let source = |i: usize| joints[i].coupling.as_ref().and_then(|c| index.get(c.source.as_str()).copied());
    let on_cycle = on_cycle(joints.len(), source);
    let mut found = Vec::new();
    for (i, follower) in joints.iter().enumerate() {
        let Some(coupling) = &follower.coupling else { continue };
        let name = shown(&coupling.source);
        let Some(source) = source(i) else {
            // A guess costs a look at every name.
            let names = joints.iter().map(|j| j.joint.name.as_str()).take(MOST_NAMES);
            let guess = match reader.report.errors.len() {
                ..MOST_GUESSES => nearest(&coupling.source, names),
                _ => None,
            };
            let to_do = guess.map_or("correct the name".into(), |guess| format!("did you mean `{guess}`?"));
            let what = format!("mimics joint `{name}`, which does not exist");
            reader.error(&follower.at, what, "the name of a joint", &to_do);
            continue;
        };
        if on_cycle[i] {
            let what = match source == i {
                true => "mimics itself".into(),
                false => format!("mimics joint `{name}`, which follows it in turn"),
            };
            reader.error(
                &follower.at,
                what,
                "a joint that moves by itself",
                "remove one <mimic> of the circle",
            );
            continue;
        }
        for end in [follower, &joints[source]] {
            let n = end.joint.kind.nv();
            if end.has_kind && n != 1 {
                let what = format!(
                    "mimic with joint `{}`, which has {n} degrees of freedom",
                    shown(&end.joint.name)
                );
                reader.error(&follower.at, what, "joints with one degree of freedom", "remove the <mimic>");
            }
        }
        match mimic {
            Mimic::Free => {
                let what = format!("mimic of joint `{name}` dropped: the joint moves freely");
                reader.approximated(&follower.at, what);
            }
            Mimic::Closure => {
                reader.used(&follower.at, format!("mimic of joint `{name}`, a coupling"));
                found.push(coupling.clone());
            }
        }
    }
    found
}

/// For each of n things, each with at most one that it follows: whether following leads back to it.
fn on_cycle(n: usize, follows: impl Fn(usize) -> Option<usize>) -> Vec<bool> {
    let mut cycle = vec![false; n];
    // The walk that first came by, from 1; a walk that meets itself has found a cycle.
    let mut walk = vec![0usize; n];
    for start in 0..n {
        let mut at = Some(start);
        while let Some(i) = at.filter(|&i| walk[i] == 0) {
            walk[i] = start + 1;
            at = follows(i);
        }
        while let Some(i) = at.filter(|&i| walk[i] == start + 1 && !cycle[i]) {
            cycle[i] = true;
            at = follows(i);
        }
    }
    cycle
}
