//! Freeze and thaw during a run: which kinds of bonds turn from which time on, and what a change did.

use crate::error::SimulateError;
use crate::folder::summary::short;
use phipsi_molecule::{
    Angles, BondKind, Clustering, Clusters, Deviates, FixmanPotential, ForceField, Ledger, MoleculeErrors,
    TorsionModel, recluster,
};
use phipsi_spatial::Vec3;
use serde::{Deserialize, Serialize};

/// The stream of a seed from which the speeds of the first change are drawn; those of later ones follow.
const STREAM: u64 = 1 << 33;

/// A change of clusters at a time of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// When, ps.
    pub time: f64,
    /// Kinds of bonds that stop turning.
    pub freeze: Vec<BondKind>,
    /// Kinds of bonds that begin to turn.
    pub thaw: Vec<BondKind>,
    /// Temperature (K) of the speeds of what begins to turn; `None`: it begins at rest.
    pub thaw_temperature: Option<f64>,
    /// Degrees of freedom from then on.
    pub degrees_of_freedom: usize,
}

impl Change {
    /// For people, with the degrees of freedom that carry the temperature from then on.
    pub fn describe(&self, degrees_of_freedom: usize) -> String {
        let mut what = what(&words(&self.freeze), &words(&self.thaw));
        if let (Some(kelvin), false) = (self.thaw_temperature, self.thaw.is_empty()) {
            what += &format!(" at {} K", short(kelvin));
        }
        format!("t = {} ps: {what}; {} degrees of freedom", short(self.time), degrees_of_freedom)
    }
}

/// All changes of a run, and what clusters are made of.
#[derive(Clone)]
pub struct Schedule {
    /// The clusters at the start.
    pub clustering: Clustering,
    /// Open bond angles h–i–j of the widest clusters, with the kind of the hinge i–j: each is open while that turns.
    pub angles: Vec<(BondKind, [usize; 3])>,
    /// Degrees of freedom at the start.
    pub degrees_of_freedom: usize,
    /// The changes, in the order of time.
    pub changes: Vec<Change>,
    /// The force field.
    pub field: ForceField,
}

/// Clusters at positions with velocities, after a change.
pub(crate) struct Changed {
    pub(crate) positions: Vec<[f64; 3]>,
    pub(crate) v: Vec<f64>,
    pub(crate) ledger: Ledger,
}

impl Schedule {
    /// Which clusters there are after so many changes.
    pub fn clustering_after(&self, changes: usize) -> Clustering {
        let mut clustering = self.clustering.clone();
        for change in self.changes.iter().take(changes) {
            clustering.rigid.extend(&change.freeze);
            clustering.rigid.retain(|kind| !change.thaw.contains(kind));
        }
        self.with_angles(clustering)
    }
    /// With the angles of the widest clusters that are open; others would not be in the coordinates of the record.
    fn with_angles(&self, mut clustering: Clustering) -> Clustering {
        if !self.angles.is_empty() {
            let always = self.widest().rigid;
            let is_open = |kind: &BondKind| always.contains(kind) || !clustering.rigid.contains(kind);
            let open = self.angles.iter().filter(|(kind, _)| is_open(kind)).map(|(_, angle)| *angle);
            clustering.angles = Angles::Listed(open.collect());
        }
        clustering
    }
    /// Those that have every hinge which turns at some time: a run is recorded in their coordinates.
    pub fn widest(&self) -> Clustering {
        let mut widest = self.clustering.clone();
        widest.rigid.retain(|kind| self.changes.iter().all(|change| !change.thaw.contains(kind)));
        widest
    }
    /// True if a hinge that turns later is rigid at the start.
    pub fn starts_narrower(&self) -> bool {
        self.widest().rigid.len() < self.clustering.rigid.len()
    }
    /// Degrees of freedom of a state at time t; at a change those before it.
    pub fn degrees_of_freedom_at(&self, t: f64) -> usize {
        let done = self.changes.iter().take_while(|c| c.time * (1.0 + 1e-9) < t);
        done.last().map_or(self.degrees_of_freedom, |c| c.degrees_of_freedom)
    }
    /// A state of before with the clusters after `changes` changes; where the last one freezes and thaws, in this order. `changes` = 0:
    /// the clusters at the start.
    pub(crate) fn apply(
        &self,
        changes: usize,
        (torsion, q, v): (&TorsionModel, &[f64], &[f64]),
        seed: u64,
    ) -> Result<Changed, MoleculeErrors> {
        let next = self.clustering_after(changes);
        let last = changes.checked_sub(1).and_then(|i| self.changes.get(i));
        let mut frozen = next.clone();
        frozen.rigid.extend(last.iter().flat_map(|change| &change.thaw));
        let frozen = self.with_angles(frozen);
        let first = recluster(torsion, q, v, &frozen, None)?;
        let Some(change) = last.filter(|change| !change.thaw.is_empty()) else {
            return Ok(Changed {
                positions: positions(&first.torsion, &first.q)?,
                v: first.v,
                ledger: first.ledger,
            });
        };
        let mut deviates = Deviates::stream(seed, STREAM + changes as u64);
        let thaw = change.thaw_temperature.map(|kelvin| (kelvin, &mut deviates));
        let second = recluster(&first.torsion, &first.q, &first.v, &next, thaw)?;
        let ledger = Ledger {
            before: first.ledger.before,
            removed: first.ledger.removed + second.ledger.removed,
            drawn: second.ledger.drawn,
            after: second.ledger.after,
            degrees_of_freedom: [first.ledger.degrees_of_freedom[0], second.ledger.degrees_of_freedom[1]],
        };
        Ok(Changed { positions: positions(&second.torsion, &second.q)?, v: second.v, ledger })
    }
    /// The model after `changes` changes, with the bond lengths and angles of positions: the same bits for the same positions.
    pub(crate) fn model(
        &self,
        changes: usize,
        widest: &TorsionModel,
        positions: &[Vec3<f64>],
    ) -> Result<TorsionModel, MoleculeErrors> {
        let atoms = widest.atoms();
        TorsionModel::new(atoms, positions, Clusters::new(atoms, positions, &self.clustering_after(changes))?)
    }
}

fn positions(torsion: &TorsionModel, q: &[f64]) -> Result<Vec<[f64; 3]>, MoleculeErrors> {
    let found = torsion.positions(q).map_err(|e| {
        let remedy = "correct the positions";
        let error =
            phipsi_molecule::MoleculeError::new("state", e.to_string(), "a state of the model", remedy);
        MoleculeErrors(vec![error])
    })?;
    Ok(found.into_iter().map(|x| x.0).collect())
}

/// Fixman's potential at a state, kJ/mol; zero where there is no temperature `kt` of it.
pub(crate) fn fixman(torsion: &TorsionModel, q: &[f64], kt: Option<f64>) -> Result<f64, SimulateError> {
    let Some(kt) = kt else { return Ok(0.0) };
    let mut potential = FixmanPotential::of(torsion, kt).map_err(|e| SimulateError::Start(e.to_string()))?;
    Ok(potential.evaluate(q, &mut vec![0.0; torsion.model().nv()])?)
}

/// What a change did: kinetic energies in kJ/mol, with after = before − removed + drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChangeRecord {
    /// Time, ps.
    pub t: f64,
    /// Kinds of bonds that stopped turning.
    pub freeze: Vec<String>,
    /// Kinds of bonds that began to turn.
    pub thaw: Vec<String>,
    /// Kinetic energies and degrees of freedom.
    #[serde(flatten)]
    pub ledger: Ledger,
    /// Change of Fixman's potential, which is that of other clusters; zero without.
    pub fixman: f64,
}

impl ChangeRecord {
    pub(crate) fn new(t: f64, change: &Change, ledger: Ledger, fixman: f64) -> Self {
        ChangeRecord { t, freeze: words(&change.freeze), thaw: words(&change.thaw), ledger, fixman }
    }
    /// Energy that the change gave.
    pub fn given(&self) -> f64 {
        self.ledger.drawn - self.ledger.removed + self.fixman
    }
    /// For people.
    pub fn describe(&self) -> String {
        let Ledger { before, removed, drawn, after, degrees_of_freedom: [n, m] } = self.ledger;
        let mut line = format!(
            "t = {} ps: {}: {n} → {m} degrees of freedom; kinetic energy {before:.3} − {removed:.3} removed + {drawn:.3} drawn = \
             {after:.3} kJ/mol",
            short(self.t),
            what(&self.freeze, &self.thaw)
        );
        if self.fixman != 0.0 {
            line += &format!("; Fixman's potential changes by {:.3} kJ/mol", self.fixman);
        }
        line
    }
}

fn words(kinds: &[BondKind]) -> Vec<String> {
    kinds.iter().map(|kind| kind.word().to_string()).collect()
}

fn what(freeze: &[String], thaw: &[String]) -> String {
    let part =
        |words: &[String], verb: &str| (!words.is_empty()).then(|| format!("{verb} {}", words.join(", ")));
    let parts: Vec<String> = [part(freeze, "freeze"), part(thaw, "thaw")].into_iter().flatten().collect();
    parts.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_said_of_a_change() {
        let change = Change {
            time: 5.0,
            freeze: vec![BondKind::Omega, BondKind::Chi],
            thaw: vec![BondKind::Methyl],
            thaw_temperature: Some(300.0),
            degrees_of_freedom: 12,
        };
        let said = "t = 5 ps: freeze omega, chi, thaw methyl at 300 K; 12 degrees of freedom";
        assert_eq!(change.describe(12), said);
        let ledger =
            Ledger { before: 2.0, removed: 0.5, drawn: 1.0, after: 2.5, degrees_of_freedom: [13, 12] };
        let record = ChangeRecord::new(5.0, &change, ledger, 0.25);
        assert_eq!(record.given(), 0.75);
        assert!(record.describe().contains("13 → 12 degrees of freedom"), "{}", record.describe());
        let text = serde_json::to_string(&record).unwrap();
        assert_eq!(serde_json::from_str::<ChangeRecord>(&text).unwrap(), record);
    }
}
