//! Lists of the entries that touch each band of an array, for gradients in which a thread owns a band.

/// The entries of every band, one band after the other, in increasing order within a band.
#[derive(Debug, Default)]
pub(super) struct Lists {
    starts: Vec<usize>,
    entries: Vec<u32>,
    bands: Vec<(u32, bool)>,
}

impl Lists {
    /// Replaces the lists by those of the entries 0, 1, …, each with the band that it touches, and whether it
    /// also touches the next one: a stable counting sort.
    pub(super) fn fill(&mut self, bands: usize, touched: impl Iterator<Item = (u32, bool)>) {
        let Self { starts, entries, bands: all } = self;
        all.clear();
        all.extend(touched);
        // While entries are placed, starts[band + 1] is the place of the next one of a band.
        starts.clear();
        starts.resize(bands + 2, 0);
        for (band, is_wide) in &*all {
            starts[*band as usize + 2] += 1;
            if *is_wide {
                starts[*band as usize + 3] += 1;
            }
        }
        for band in 2..starts.len() {
            starts[band] += starts[band - 1];
        }
        entries.clear();
        entries.resize(starts[bands + 1], 0);
        for (entry, (band, is_wide)) in all.iter().enumerate() {
            for band in *band..=*band + u32::from(*is_wide) {
                let place = &mut starts[band as usize + 1];
                entries[*place] = entry as u32;
                *place += 1;
            }
        }
    }

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
        Self { starts, entries, bands: Vec::new() }
    }

    /// Returns the entries of a band.
    pub(super) fn of(&self, band: usize) -> &[u32] {
        &self.entries[self.starts[band]..self.starts[band + 1]]
    }
}
