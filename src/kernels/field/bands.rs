//! Lists of the entries that touch each band of an array, for gradients in which a thread owns a band.

/// The entries of every band, one band after the other, in increasing order within a band.
pub(super) struct Lists {
    starts: Vec<usize>,
    entries: Vec<u32>,
}

impl Lists {
    /// Sorts the entries 0..n by the bands that they touch (at most K each; the same band may be named twice): a
    /// stable counting sort.
    pub(super) fn sort<const K: usize>(
        n: usize,
        bands: usize,
        touched: impl Fn(usize) -> [usize; K],
    ) -> Self {
        let touched: Vec<[usize; K]> = (0..n).map(touched).collect();
        let is_first = |bands: &[usize; K], k: usize| !bands[..k].contains(&bands[k]);
        let mut starts = vec![0; bands + 1];
        for own in &touched {
            for k in (0..K).filter(|k| is_first(own, *k)) {
                starts[own[k] + 1] += 1;
            }
        }
        for band in 1..starts.len() {
            starts[band] += starts[band - 1];
        }
        let mut next = starts.clone();
        let mut entries = vec![0; starts[bands]];
        for (entry, own) in touched.iter().enumerate() {
            for k in (0..K).filter(|k| is_first(own, *k)) {
                entries[next[own[k]]] = entry as u32;
                next[own[k]] += 1;
            }
        }
        Self { starts, entries }
    }

    /// Returns the entries of a band.
    pub(super) fn of(&self, band: usize) -> &[u32] {
        &self.entries[self.starts[band]..self.starts[band + 1]]
    }
}
