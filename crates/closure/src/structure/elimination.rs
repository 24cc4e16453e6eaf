//! The order of the elimination: what each body closes and joins, and where the blocks that this leaves are kept.
//!
//! Symbols: those of [`super`].

use super::{Block, Operation, Structure};
use crate::reflections::GROUP;
use crate::tree::Tree;
use phipsi_spatial::Real;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

impl<T: Real> Structure<T> {
    /// Lays out blocks and operations, tip to base.
    pub(super) fn eliminate(&mut self, tree: &Tree<T>) {
        let n = tree.len();
        let mut closing: Vec<Vec<usize>> = vec![Vec::new(); n + 1];
        for (of, l) in self.loops.iter().enumerate() {
            closing[l.ancestor.min(n)].push(of);
        }
        for k in (0..n).rev() {
            self.close_all(k, &closing[k]);
            self.join(k, tree.bodies[k].nv, tree.bodies[k].parent.min(n));
        }
        self.close_all(n, &closing[n]);
    }
    /// Appends a body's joint to its blocks.
    fn join(&mut self, k: usize, freedoms: usize, parent: usize) {
        if self.stations[k].passes.is_empty() {
            return;
        }
        let mut columns = Vec::new();
        let mut width = 0;
        for i in 0..self.stations[k].passes.len() {
            let of = self.stations[k].passes[i].of;
            // Both strands of a loop that meet on a flexible body pass its modes.
            if let Some(&(_, column)) = columns.iter().find(|(o, _)| *o == of) {
                self.stations[k].passes[i].column = column;
                continue;
            }
            self.stations[k].passes[i].column = width;
            columns.push((of, width));
            width += self.loops[of].rows.len();
        }
        self.nesting += width * width;
        let taken = self.stations[k].waiting.clone();
        let rows = taken.iter().map(|&b| self.blocks[b].most).sum::<usize>() + freedoms;
        let extended = match taken[..] {
            [] => true,
            [b] => {
                // Its rows must be the last ones, so that there is room after them.
                let block = &self.blocks[b];
                let ends = (block.row + block.most, block.number + block.most * width);
                block.columns == columns && ends == (self.block_rows, self.block_numbers)
            }
            _ => false,
        };
        let in_place = extended && rows <= 2 * width;
        let output = match taken[..] {
            [b] if in_place => self.extend(b, freedoms),
            _ => self.block(columns.clone(), width, rows.min(2 * width)),
        };
        let operation = self.operation(None, &taken, 0, columns, width, rows, Some(output), in_place);
        self.stations[k].join = Some(operation);
        self.stations[parent].waiting.push(output);
    }
    /// Closes loops at a body, one at a time: next the one that touches fewest columns of others.
    fn close_all(&mut self, k: usize, loops: &[usize]) {
        let first = self.operations.len();
        let mut open = vec![true; loops.len()];
        // Blocks that a loop enters, among those that wait here.
        let mut alive: Vec<usize> = self.stations[k].waiting.clone();
        let mut touching: Vec<Vec<usize>> = vec![Vec::new(); loops.len()];
        let place = |of: usize| loops.binary_search(&of).ok();
        for &b in &alive {
            for (of, _) in &self.blocks[b].columns {
                if let Some(i) = place(*of) {
                    touching[i].push(b);
                }
            }
        }
        let mut queue = BinaryHeap::new();
        for i in 0..loops.len() {
            queue.push(Reverse((self.coupled(loops[i], &touching[i]).1, i)));
        }
        while let Some(Reverse((degree, i))) = queue.pop() {
            if !open[i] {
                continue;
            }
            let (columns, width) = self.coupled(loops[i], &touching[i]);
            if width != degree {
                queue.push(Reverse((width, i)));
                continue;
            }
            open[i] = false;
            let taken = touching[i].clone();
            let m = self.loops[loops[i]].rows.len();
            // Room for the slack of an assembly.
            let rows = taken.iter().map(|&b| self.blocks[b].most).sum::<usize>() + m;
            let output =
                (width > 0 && !taken.is_empty()).then(|| self.block(columns.clone(), width, rows.min(width)));
            let (columns_of, of) = (columns.clone(), Some(loops[i]));
            let operation = self.operation(of, &taken, m, columns_of, width, rows, output, false);
            self.closings.push(operation);
            alive.retain(|b| !taken.contains(b));
            alive.extend(output);
            for (of, _) in columns {
                if let Some(j) = place(of).filter(|&j| open[j]) {
                    touching[j].retain(|b| !taken.contains(b));
                    touching[j].extend(output);
                    queue.push(Reverse((self.coupled(loops[j], &touching[j]).1, j)));
                }
            }
        }
        self.stations[k].closes = first..self.operations.len();
        for operation in &mut self.operations[first..] {
            operation.held = self.stations[k]
                .passes
                .iter()
                .filter_map(|passing| {
                    let (of, column) = operation.other_loops.iter().find(|(o, _)| *o == passing.of)?;
                    let first = self.strands[passing.strand].first;
                    Some((first, *column, self.loops[*of].rows.len()))
                })
                .collect();
        }
        self.stations[k].waiting = alive;
    }
    /// The columns of other loops in these blocks, in order, and their number.
    fn coupled(&self, of: usize, blocks: &[usize]) -> (Vec<(usize, usize)>, usize) {
        let mut others: Vec<usize> = blocks
            .iter()
            .flat_map(|&b| self.blocks[b].columns.iter().map(|c| c.0))
            .filter(|&o| o != of)
            .collect();
        others.sort_unstable();
        others.dedup();
        let mut width = 0;
        let columns = others
            .into_iter()
            .map(|o| {
                width += self.loops[o].rows.len();
                (o, width - self.loops[o].rows.len())
            })
            .collect();
        (columns, width)
    }
    fn block(&mut self, columns: Vec<(usize, usize)>, width: usize, most: usize) -> usize {
        let (row, number, x) = (self.block_rows, self.block_numbers, self.block_x);
        self.blocks.push(Block { columns, width, most, row, number, x });
        self.block_rows += most;
        self.block_numbers += most * width;
        self.block_x += most;
        self.blocks.len() - 1
    }
    /// The last block with more rows, in the same place but for X, which is in the frame of another body.
    fn extend(&mut self, block: usize, more: usize) -> usize {
        let mut block = self.blocks[block].clone();
        block.most += more;
        block.x = self.block_x;
        self.block_rows += more;
        self.block_numbers += more * block.width;
        self.block_x += block.most;
        self.blocks.push(block);
        self.blocks.len() - 1
    }
    #[allow(clippy::too_many_arguments)]
    fn operation(
        &mut self,
        closes: Option<usize>,
        taken: &[usize],
        closing: usize,
        other_loops: Vec<(usize, usize)>,
        others: usize,
        most: usize,
        output: Option<usize>,
        in_place: bool,
    ) -> usize {
        let column_of = |of: usize| {
            if Some(of) == closes {
                return 0;
            }
            let at = other_loops.iter().find(|(o, _)| *o == of);
            closing + at.map_or(0, |(_, column)| *column)
        };
        let inputs = taken
            .iter()
            .map(|&b| {
                let map = self.blocks[b]
                    .columns
                    .iter()
                    .flat_map(|&(of, _)| (0..self.loops[of].rows.len()).map(move |i| (of, i)))
                    .map(|(of, i)| column_of(of) + i)
                    .collect();
                (b, map)
            })
            .collect();
        let (number, row, step) = (self.operation_numbers, self.operation_rows, self.operation_steps);
        let (reflection, columns) = (self.reflections, closing + others);
        let width = (columns + 6).next_multiple_of(GROUP);
        self.operations.push(Operation {
            closes,
            inputs,
            closing,
            others,
            other_loops,
            held: Vec::new(),
            output,
            in_place,
            most,
            width,
            number,
            reflection,
            row,
            step,
        });
        if !in_place {
            self.operation_numbers += most * width;
            self.reflections += most * columns.min(most);
            self.operation_rows += most;
            self.operation_steps += columns;
        }
        self.operations.len() - 1
    }
}
