//! Snapshots of a training, as a report shows them.

/// One snapshot.
#[derive(Clone, Debug)]
pub(crate) struct Snapshot {
    /// number of complete iterations
    pub(crate) iteration: usize,
    /// mean PSNR of the views, dB
    pub(crate) psnr_db: f64,
    /// the render of the first view, where it is kept: (H, W, 3) and W, H
    pub(crate) image: Option<(Vec<f32>, [usize; 2])>,
}

/// The snapshots of a training.
#[derive(Debug, Default)]
pub(crate) struct Film {
    /// name of the view that is shown; empty before the first snapshot
    pub(crate) view: String,
    /// name of the metric
    pub(crate) metric: String,
    /// number of views of the mean
    pub(crate) views: usize,
    /// by iteration
    pub(crate) all: Vec<Snapshot>,
}
