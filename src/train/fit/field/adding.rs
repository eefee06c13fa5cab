//! The sum of contributions to one gradient.

/// Adds one array to another.
pub(super) fn add(sum: &mut [f32], part: &[f32]) {
    sum.iter_mut().zip(part).for_each(|(sum, x)| *sum += x);
}
