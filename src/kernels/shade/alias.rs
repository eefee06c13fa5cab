//! Tables that choose one of many entries by weight in constant time (alias tables: Walker 1977; Vose 1991), and
//! maps divided into coarser cells.

/// One entry of a table.
#[derive(Clone, Copy, Debug)]
struct Alias {
    /// The entry's own index is chosen if the fraction is below this value.
    own: f64,
    /// The index that is chosen otherwise.
    other: u32,
}

/// An alias table.
#[derive(Clone, Debug)]
pub(super) struct AliasTable(Vec<Alias>);

impl AliasTable {
    /// Builds the table of weights with a positive total, in index order (Vose 1991 with stacks read from the
    /// end).
    pub(super) fn new(weights: &[f64], total: f64) -> Self {
        let n = weights.len();
        let mut share: Vec<f64> = weights.iter().map(|w| w / total * n as f64).collect();
        let mut table: Vec<Alias> = (0..n).map(|i| Alias { own: 1.0, other: i as u32 }).collect();
        let (mut small, mut large): (Vec<u32>, Vec<u32>) =
            (0..n as u32).partition(|&i| share[i as usize] < 1.0);
        while let (Some(&s), Some(&l)) = (small.last(), large.last()) {
            small.pop();
            let own = share[s as usize];
            table[s as usize] = Alias { own, other: l };
            let left = &mut share[l as usize];
            *left = *left - (1.0 - own);
            if *left < 1.0 {
                large.pop();
                small.push(l);
            }
        }
        // The remaining entries differ from 1 by rounding only; they keep own = 1, unless their weight is
        // zero.
        for i in small.into_iter().map(|i| i as usize) {
            if weights[i] == 0.0 {
                let other = weights.iter().position(|w| *w > 0.0).unwrap_or(0);
                table[i] = Alias { own: 0.0, other: other as u32 };
            }
        }
        Self(table)
    }

    /// Returns the index chosen by a 64-bit word.
    #[inline]
    pub(super) fn choose(&self, word: u64) -> usize {
        let wide = u128::from(word) * self.0.len() as u128;
        let (i, rest) = ((wide >> 64) as usize, wide as u64);
        let entry = self.0[i];
        let fraction = (rest >> 12) as f64 * (1.0 / 4_503_599_627_370_496.0);
        if fraction < entry.own { i } else { entry.other as usize }
    }

    /// Returns the probability with which [`Self::choose`] returns each index.
    pub(super) fn probabilities(&self) -> Vec<f64> {
        let n = self.0.len() as f64;
        let mut p: Vec<f64> = self.0.iter().map(|a| a.own / n).collect();
        for a in &self.0 {
            p[a.other as usize] += (1.0 - a.own) / n;
        }
        p
    }
}

/// Divides `n` texels of a row or column among `cells`: for each texel, the cells that it overlaps (at most two)
/// and the parts of it that lie in them.
pub(super) fn overlaps(n: usize, cells: usize) -> Vec<[(usize, f64); 2]> {
    let texel = |i: usize| {
        // In units of 1/(n·cells), a texel is `cells` long and a cell is n long.
        let first = i * cells / n;
        let inside = Ord::min((first + 1) * n - i * cells, cells) as f64 / cells as f64;
        [(first, inside), (Ord::min(first + 1, cells - 1), 1.0 - inside)]
    };
    (0..n).map(texel).collect()
}
