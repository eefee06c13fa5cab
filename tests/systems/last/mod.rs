//! Foundations and requirements of LAST: operators, metrics, scores of structures, learners on known factors.

mod abduction;
mod acyclicity;
mod body;
mod guidance;
mod identification;
mod independence;
mod intervention;
mod learners;
mod lpips;
mod metrics;
mod models;
mod networks;
mod repair;
mod skin;
mod structure;
mod tuning;
