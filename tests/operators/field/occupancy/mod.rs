//! The occupancy grid: the same cells and the same steps as without leaving anything out, and what its rules
//! lose.

mod closed;
mod filling;
mod losses;
mod steps;
