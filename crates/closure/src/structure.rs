//! What is known once per model: the loops, where they open and close, and the order and sizes of the elimination.
//!
//! | symbol | meaning |
//! |---|---|
//! | loop | a closure or a coupling, with m rows |
//! | ancestor K | the body in which the two branches of a loop meet; the ground, if it is closed to the world |
//! | strand | the path of a loop from one of its ends up to its ancestor, the ancestor not included |
//! | block | rows of a front with common columns: residuals of a subtree and the open loops that they enter |
//! | close | eliminates one loop at its ancestor from the blocks that it enters; the others' rows are one block after it |
//! | join | appends a joint's rows to the blocks of its body: one block that goes up to the parent; in place, where one block waits |

use crate::error::ClosureError;
use crate::rows::MOST_ROWS;
use crate::tree::Tree;
use phipsi_model::{ClosureKind, Model};
use phipsi_recursion::Layout;
use phipsi_recursion::layout::GROUND;
use phipsi_spatial::{Real, Transform};
use std::ops::Range;

mod elimination;
mod loops;

use loops::{common_ancestor, depths, loops, scene_length};

/// A frame of a closure on a body of the layout.
#[derive(Clone, Copy, Debug)]
pub(crate) struct End<T> {
    /// The body, or [`GROUND`].
    pub(crate) body: usize,
    /// The frame in the body's frame.
    pub(crate) pose: Transform<T>,
}

/// What a loop keeps.
#[derive(Clone, Copy, Debug)]
pub(crate) enum LoopKind<T> {
    /// A closure between two frames.
    Frames { kind: ClosureKind, a: End<T>, b: End<T> },
    /// q(joint) = multiplier q(source) + offset.
    Gear {
        q: [usize; 2],
        v: [usize; 2],
        multiplier: T,
        offset: T,
        /// The row is an angle.
        rotation: bool,
    },
}

/// A loop.
#[derive(Clone, Debug)]
pub(crate) struct Loop<T> {
    pub(crate) name: String,
    pub(crate) kind: LoopKind<T>,
    /// Its rows among all rows.
    pub(crate) rows: Range<usize>,
    /// Component of the relative twist that each row is along, or [`crate::rows::OWN`].
    pub(crate) axes: [usize; MOST_ROWS],
    /// Number of its first rows that are angles.
    pub(crate) angular: usize,
    /// The body in which its branches meet, or [`GROUND`].
    pub(crate) ancestor: usize,
    /// The strands of its ends A and B, where they have one.
    pub(crate) strands: [Option<usize>; 2],
    /// First of the n places of Π of its ends A and B, where they are on a flexible body.
    pub(crate) attached: [Option<usize>; 2],
}

/// Rows of a loop as they pass one joint of a strand.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Passing {
    pub(crate) of: usize,
    pub(crate) strand: usize,
    /// Place of this body among those of all strands.
    pub(crate) place: usize,
    /// First column in the block that leaves the joint.
    pub(crate) column: usize,
    /// The parent is the ancestor: nothing of C goes there.
    pub(crate) last: bool,
    /// Of modes: first of the n places of Π of what the strand comes from.
    pub(crate) attached: usize,
}

/// The way of a loop from one end to its ancestor.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Strand {
    pub(crate) of: usize,
    /// First of its m rows of C.
    pub(crate) first: usize,
    /// Its bodies from the end inward: where they are listed, and how many.
    pub(crate) path: usize,
    pub(crate) bodies: usize,
}

/// A coefficient of a coupling on one component of a joint.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry<T> {
    pub(crate) of: usize,
    pub(crate) component: usize,
    pub(crate) coefficient: T,
}

/// Columns of a block, and where its numbers are.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    /// Loops, with the first column of each.
    pub(crate) columns: Vec<(usize, usize)>,
    pub(crate) width: usize,
    /// Most rows that it can have.
    pub(crate) most: usize,
    /// First row among all blocks' rows; the same for blocks that grow in place.
    pub(crate) row: usize,
    /// First number of W among all blocks' (row after row); likewise.
    pub(crate) number: usize,
    /// First row of X among all blocks', each in the frame of its own body.
    pub(crate) x: usize,
}

/// What an elimination takes and gives.
#[derive(Clone, Debug)]
pub(crate) struct Operation {
    /// The loop that is closed; a join closes none.
    pub(crate) closes: Option<usize>,
    /// Blocks that it takes, each with the new column of each of its columns.
    pub(crate) inputs: Vec<(usize, Vec<usize>)>,
    /// Columns of the closed loop, and of the others.
    pub(crate) closing: usize,
    pub(crate) others: usize,
    /// The loops of the other columns, with the first column of each.
    pub(crate) other_loops: Vec<(usize, usize)>,
    /// Of these, the strands that stay open at the body: first row of C, first column, number of rows.
    pub(crate) held: Vec<(usize, usize, usize)>,
    /// The block that remains.
    pub(crate) output: Option<usize>,
    /// Rows are appended to the only block that it takes, or begin one: there is no matrix.
    pub(crate) in_place: bool,
    /// Most rows that are stacked.
    pub(crate) most: usize,
    /// Numbers of a row of its matrix.
    pub(crate) width: usize,
    /// First number of its matrix, of its reflections, of its rows and of its steps among all operations'.
    pub(crate) number: usize,
    pub(crate) reflection: usize,
    pub(crate) row: usize,
    pub(crate) step: usize,
}

/// What happens at one body, from tip to base.
#[derive(Clone, Debug)]
pub(crate) struct Station<T> {
    /// Strands that begin here, before the joint.
    pub(crate) begins: Vec<usize>,
    /// Closings, in order.
    pub(crate) closes: Range<usize>,
    /// Strands that pass the joint.
    pub(crate) passes: Vec<Passing>,
    /// Coefficients of couplings on the joint.
    pub(crate) entries: Vec<Entry<T>>,
    /// The join, if a strand passes.
    pub(crate) join: Option<usize>,
    /// Blocks that wait before the joint.
    pub(crate) waiting: Vec<usize>,
}

impl<T> Station<T> {
    fn empty() -> Self {
        Station {
            begins: Vec::new(),
            closes: 0..0,
            passes: Vec::new(),
            entries: Vec::new(),
            join: None,
            waiting: Vec::new(),
        }
    }
}

/// The elimination of a model.
#[derive(Clone, Debug)]
pub(crate) struct Structure<T> {
    pub(crate) loops: Vec<Loop<T>>,
    pub(crate) strands: Vec<Strand>,
    /// Bodies of all strands.
    pub(crate) paths: Vec<usize>,
    /// Of a body on modes: first of its n places of Π.
    pub(crate) attached: Vec<Option<usize>>,
    /// Length of the array of all Π.
    pub(crate) screws: usize,
    /// One per body, then the ground.
    pub(crate) stations: Vec<Station<T>>,
    pub(crate) blocks: Vec<Block>,
    pub(crate) operations: Vec<Operation>,
    /// Closings in the order in which they are done.
    pub(crate) closings: Vec<usize>,
    /// Number of rows of all loops.
    pub(crate) rows: usize,
    /// Lengths of the arrays.
    pub(crate) strand_rows: usize,
    pub(crate) block_rows: usize,
    pub(crate) block_numbers: usize,
    pub(crate) block_x: usize,
    pub(crate) reflections: usize,
    pub(crate) operation_rows: usize,
    pub(crate) operation_numbers: usize,
    pub(crate) operation_steps: usize,
    /// Bodies on the longest path.
    pub(crate) depth: usize,
    /// Length that angles are multiplied with before they are compared with lengths, m.
    pub(crate) length: f64,
    /// Σ over joints of (rows of the loops that pass)².
    pub(crate) nesting: usize,
}

impl<T: Real> Structure<T> {
    /// Finds the loops of a model whose tree is `layout`, or `tree`.
    pub(crate) fn new(model: &Model, layout: &Layout<T>, tree: &Tree<T>) -> Result<Self, ClosureError> {
        let mut structure = Structure {
            loops: loops(model, layout, tree)?,
            strands: Vec::new(),
            paths: Vec::new(),
            attached: Vec::with_capacity(tree.len()),
            screws: 0,
            stations: vec![Station::empty(); tree.len() + 1],
            blocks: Vec::new(),
            operations: Vec::new(),
            closings: Vec::new(),
            rows: 0,
            strand_rows: 0,
            block_rows: 0,
            block_numbers: 0,
            block_x: 0,
            reflections: 0,
            operation_rows: 0,
            operation_numbers: 0,
            operation_steps: 0,
            depth: 0,
            length: scene_length(model, tree),
            nesting: 0,
        };
        structure.rows = structure.loops.last().map_or(0, |l| l.rows.end);
        let depths = depths(tree);
        structure.depth = depths.iter().fold(0, |most, d| most.max(*d));
        structure.attach(tree);
        structure.open(layout, tree, &depths);
        structure.eliminate(tree);
        Ok(structure)
    }
    /// Places of Π of all that is on flexible bodies.
    fn attach(&mut self, tree: &Tree<T>) {
        let mut screws = 0;
        let mut place = |modes: usize| {
            screws += modes;
            screws - modes
        };
        for body in &tree.bodies {
            self.attached.push(body.on.map(|_| place(tree.bodies[body.parent].nv)));
        }
        for l in &mut self.loops {
            let LoopKind::Frames { a, b, .. } = l.kind else { continue };
            let on = |end: End<T>| tree.modes(end.body).map(|_| tree.bodies[end.body].nv);
            l.attached = [on(a), on(b)].map(|modes| modes.map(&mut place));
        }
        self.screws = screws;
    }
    /// Finds the ancestor of every loop and lays its strands.
    fn open(&mut self, layout: &Layout<T>, tree: &Tree<T>, depths: &[usize]) {
        let bodies = &tree.bodies;
        let mut carrier = vec![GROUND; layout.nv()];
        for (k, body) in bodies.iter().enumerate() {
            carrier[body.v..body.v + body.nv].fill(k);
        }
        for of in 0..self.loops.len() {
            let m = self.loops[of].rows.len();
            let (ends, gear) = match self.loops[of].kind {
                LoopKind::Frames { a, b, .. } => ([a.body, b.body], false),
                LoopKind::Gear { v, .. } => (v.map(|i| carrier[i]), true),
            };
            // A coupling opens at its joints: its branches meet above them.
            let tops = if gear { ends.map(|k| bodies[k].parent) } else { ends };
            let ancestor = common_ancestor(tree, depths, tops);
            self.loops[of].ancestor = ancestor;
            let depth = |k: usize| if k == GROUND { 0 } else { depths[k] };
            // Of two joints on one path the outer one comes first: its strand passes the other.
            let sides = if depth(ends[0]) >= depth(ends[1]) { [0, 1] } else { [1, 0] };
            for side in sides {
                let start = ends[side];
                if start == ancestor
                    || start == GROUND
                    || (gear && self.stations[start].passes.iter().any(|p| p.of == of))
                {
                    continue;
                }
                let strand = self.strands.len();
                self.strands.push(Strand { of, first: self.strand_rows, path: self.paths.len(), bodies: 0 });
                self.strand_rows += m;
                self.loops[of].strands[side] = Some(strand);
                if !gear {
                    self.stations[start].begins.push(strand);
                }
                let mut k = start;
                let mut attached = self.loops[of].attached[side];
                while k != ancestor {
                    let last = bodies[k].parent == ancestor;
                    self.stations[k].passes.push(Passing {
                        of,
                        strand,
                        place: self.paths.len(),
                        column: 0,
                        last,
                        attached: attached.unwrap_or(0),
                    });
                    attached = self.attached[k];
                    self.paths.push(k);
                    self.strands[strand].bodies += 1;
                    k = bodies[k].parent;
                }
            }
            if let LoopKind::Gear { v, multiplier, .. } = self.loops[of].kind {
                for (i, coefficient) in [(0, T::one()), (1, -multiplier)] {
                    let k = carrier[v[i]];
                    let component = v[i] - bodies[k].v;
                    self.stations[k].entries.push(Entry { of, component, coefficient });
                }
            }
        }
    }
}
