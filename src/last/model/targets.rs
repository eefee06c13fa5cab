//! Inference of the factor that was set in each group, if it is not given.

/// Noise of pairs before and after an intervention.
#[derive(Clone, Copy, Debug)]
pub struct Pairs<'a> {
    /// Noise before, shape (G·M, n, k).
    pub eps: &'a [f64],
    /// Noise after, shape (G·M, n, k).
    pub eps_after: &'a [f64],
    /// Scale by which a change is divided, shape (n, k).
    pub spread: &'a [f64],
    /// Number of factors n.
    pub factors: usize,
    /// Number of pairs M of a group.
    pub members: usize,
}

/// The factor of each group: every pair votes for argmaxⱼ ‖(ε′ⱼ − εⱼ)/sⱼ‖, and the majority determines the
/// factor of the group. Ties go to the lowest index.
pub fn voted(x: &Pairs<'_>) -> Vec<usize> {
    let (n, d) = (x.factors, x.spread.len());
    let k = d / n;
    let most = |score: &dyn Fn(usize) -> f64| {
        (0..n).fold(0, |best, j| if score(j) > score(best) { j } else { best })
    };
    let vote = |p: usize| {
        most(&|j| {
            (j * k..(j + 1) * k).fold(0.0, |s, at| {
                let change = (x.eps_after[p * d + at] - x.eps[p * d + at]) / x.spread[at];
                s + change * change
            })
        })
    };
    let votes: Vec<usize> = (0..x.eps.len() / d).map(vote).collect();
    let of = |group: &[usize]| most(&|j| group.iter().filter(|v| **v == j).count() as f64);
    votes.chunks_exact(x.members).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_majority_decides_and_spread_counts() {
        // Two factors of two dimensions, a group of three pairs; the scale of factor 1 is ten times as large.
        let eps = [0.0; 12];
        let after = [1.0, 0.0, 2.0, 0.0, 1.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 20.0];
        let pairs = |spread: &'static [f64]| {
            voted(&Pairs { eps: &eps, eps_after: &after, spread, factors: 2, members: 3 })
        };
        assert_eq!(
            pairs(&[1.0, 1.0, 10.0, 10.0]),
            [0],
            "two of three moved factor 0 more, by its own spread"
        );
        assert_eq!(pairs(&[1.0; 4]), [1], "all three moved factor 1 more");
    }
}
