//! Tables that choose one of many entries by weight in constant time, and maps divided into coarser cells.

/// One entry of the alias table (Walker 1977; Vose 1991).
#[derive(Clone, Copy, Debug)]
pub(super) struct Alias {
    /// The entry's own texel is chosen if the fraction is below this value.
    pub(super) own: f64,
    /// The texel that is chosen otherwise.
    pub(super) other: u32,
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

/// Builds the alias table of weights with a positive total, in index order (Vose 1991 with stacks read from
/// the end).
pub(super) fn alias(weights: &[f64], total: f64) -> Vec<Alias> {
    let n = weights.len();
    let mut share: Vec<f64> = weights.iter().map(|w| w / total * n as f64).collect();
    let mut table: Vec<Alias> = (0..n).map(|i| Alias { own: 1.0, other: i as u32 }).collect();
    let (mut small, mut large): (Vec<u32>, Vec<u32>) = (0..n as u32).partition(|&i| share[i as usize] < 1.0);
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
    // The remaining entries differ from 1 by rounding only; they keep own = 1, unless their weight is zero.
    for i in small.into_iter().map(|i| i as usize) {
        if weights[i] == 0.0 {
            let other = weights.iter().position(|w| *w > 0.0).unwrap_or(0);
            table[i] = Alias { own: 0.0, other: other as u32 };
        }
    }
    table
}
