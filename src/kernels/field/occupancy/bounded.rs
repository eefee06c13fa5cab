//! A signed distance with bounds.

/// Lower and upper corner of a box whose sides are parallel to the axes.
pub type Box3 = [[f32; 3]; 2];

/// A signed distance whose values in a box can be bounded. Functions run on the calling thread.
pub trait Bounded: Sync {
    /// Writes s at points; `sdf` is resized.
    fn values(&self, points: &[[f32; 3]], sdf: &mut Vec<f32>);

    /// Writes bounds of s in boxes, a lower and an upper one; `bounds` is resized.
    ///
    /// Each value that [`Self::values`] computes at a point of a box lies between them, rounding included. The
    /// points of a box are those between its corners; a coordinate of 0 is not one of them where the lower
    /// corner is 0 and the upper one is larger: zeros belong to the lower side. A bound that is not a number
    /// proves nothing.
    fn bounds(&self, boxes: &[Box3], bounds: &mut Vec<[f32; 2]>);
}

/// Returns the smallest and the largest |x| in a box: the lengths of its nearest and farthest points.
pub(super) fn extent([low, high]: Box3) -> [[f32; 3]; 2] {
    let (mut near, mut far) = ([0.0; 3], [0.0; 3]);
    for k in 0..3 {
        let (a, b) = (low[k].abs(), high[k].abs());
        let (small, large) = if a < b { (a, b) } else { (b, a) };
        near[k] = if low[k] < 0.0 && high[k] > 0.0 { 0.0 } else { small };
        far[k] = large;
    }
    [near, far]
}
