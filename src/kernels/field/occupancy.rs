//! Which parts of the box of a field can be left out: a grid of bits, the rules that fill it, and the steps
//! of a ray that it keeps.
//!
//! ```text
//! planes, network ── learned::Learned ─┐
//! closed form ─────────────────────────┴─ bounded::Bounded: s at points, bounds of s in boxes
//!       ── fill (rule, β, step) ──► Occupancy: bit_grid::BitGrid + bricks::Bricks
//! Occupancy, rays ── steps ──► Intervals
//! ```
//!
//! ```text
//! bounded    the trait: a signed distance with bounds
//! learned    the trait for feature planes with a network
//! extremes   values of planes in a box
//! lines      a linear function below a network, and one above it
//! rule       which cells are removed
//! fill       coarse to fine: boxes that are decided by bounds, then cells
//! cells      the grid with the tree over its bricks
//! steps      the steps of a ray that meet occupied cells
//! ```
//!
//! # Rules
//! A cell of the n³ cells is removed, or occupied. τ = 1e-4 is [`THRESHOLD`], h the step, D the density
//! ([`super::density`]).
//!
//! * [`Rule::Published`]: removed if α = 1 − e^(−D(s)h) < τ at the middle of the cell (supplement of LIRM, Li
//!   et al. 2025). A step is kept if the cell of its middle is occupied. What lies between the middles of cells
//!   can be lost.
//! * [`Rule::Conservative`]: removed if min s over the cell > β·ln(2√3R/(2βτ)). A step is kept if a cell in the
//!   range between the cells of its two ends is occupied; this includes every cell that it touches.
//!
//! # What the conservative rule bounds
//! ½e^(−s/β) ≥ 1 − ½e^(s/β), because their sum is at least 1; so D(s) ≤ e^(−s/β)/(2β) for every s. In a removed
//! cell D < e^(−min s/β)/(2β) < τ/(2√3R). The mean density between two ends in removed cells has the same
//! bound. A ray crosses the box on at most its diagonal 2√3R = N·h, N the number of samples, so the optical
//! depth of all steps that are left out is less than τ: opacity falls by less than 1 − e^(−τ) < τ, and a value
//! in 0..1 over a background in 0..1 changes by less than τ. Without the factor N, α < τ at every sample
//! permits an image error of N·τ.
//!
//! # Interiors
//! Both rules keep the inside of an object, where the density is 1/β: of a ball of half the size of the box, 72
//! % of the occupied cells are inside (published) or 53 % (conservative), at 1/β = 250 and R = 0.525. With
//! early stop a ray ends before it comes to most of them.
//!
//! # Not a number
//! Planes and weights that are not finite are refused. A cell whose s or bound is not a number is occupied.
//!
//! # Bits
//! A cell depends only on its own s or bounds; neither threads nor the order of subdivision change a bit. No
//! adjoint: the grid is a discrete decision.

mod bounded;
mod cells;
mod extremes;
mod fill;
mod learned;
mod lines;
mod rule;
mod steps;

pub use bounded::{Bounded, Box3};
pub use cells::{Cost, Occupancy};
pub use fill::{fill, fill_all};
pub use learned::Learned;
pub use rule::{Rule, SIDE, Settings, THRESHOLD};
