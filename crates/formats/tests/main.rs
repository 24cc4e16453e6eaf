//! Readers, and what they say of files that are wrong.

mod dcd;
mod expression;
mod matrix_market;
mod mutation;
mod pdb;
mod prmtop;
mod system;
mod urdf;
mod xtc;
