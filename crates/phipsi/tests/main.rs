//! The whole library on robots and trees whose numbers are known, and the house itself.

mod features;
mod forms;
mod golden_trees;
mod index;
mod loops;
mod robots;
mod rooms;
