//! Readers, and what they say of files that are wrong.

mod dcd;
mod expression;
mod mutation;
mod pdb;
mod prmtop;
mod system;
mod urdf;
mod xtc;
