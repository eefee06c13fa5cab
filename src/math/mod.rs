//! Small geometry. Level 1.

pub mod knn;
