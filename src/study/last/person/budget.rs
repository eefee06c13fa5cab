//! Render budgets: the number of renders of a fit, and the number of iterations for a given number of
//! renders.
//!
//! An iteration renders once, and after the first search for key Gaussians once for each level of the graph.
//! A search by exchange renders each view that it evaluates. In λ mode `stop` the number of renders depends
//! on the gradients, so there is no budget.

use crate::Result;
use crate::math::digraph::Digraph;
use lastlight_last::avatar::progressive::{Cap, Keys, Order, Plan};
use lastlight_last::avatar::settings::Settings;

/// Number of levels of the progressive update for a graph.
///
/// # Errors
/// When it has a cycle.
pub fn levels(settings: &Settings, graph: &Digraph) -> Result<usize> {
    let Some(p) = &settings.progressive else { return Ok(1) };
    let graph = p.graph.as_ref().unwrap_or(graph);
    Ok(Plan::new(graph, if graph.count() == 0 { Order::None } else { p.order }, settings.seed)?.levels.len())
}

/// Number of renders of a fit with `levels` levels to `train` training images; `None` if it depends on the
/// gradients.
pub fn renders(settings: &Settings, levels: usize, train: usize) -> Option<usize> {
    let n = settings.iterations;
    let Some(p) = &settings.progressive else { return Some(n) };
    if p.cap == Cap::Stop && levels > 1 {
        return None;
    }
    let (every, first) = (settings.scaled(p.every), settings.scaled(p.first));
    let begin = first.div_ceil(every) * every;
    if begin > n {
        return Some(n);
    }
    let searches = (n - begin) / every + 1;
    let views = if p.keys == Keys::Swap { Ord::min(p.views, train) } else { 0 };
    Some(n + (n - begin) * (levels - 1) + searches * views)
}

/// The number of iterations with the most renders that do not exceed `budget`; of several the one nearest to
/// that of the settings, and of two equally near the smaller. Constants of the schedule are rounded, so more
/// iterations may need fewer renders.
pub fn iterations(settings: &Settings, levels: usize, train: usize, budget: usize) -> Option<usize> {
    let mut best: Option<(usize, usize)> = None;
    for n in 1..=budget {
        let r = renders(&Settings { iterations: n, ..settings.clone() }, levels, train)?;
        let off = |n: usize| n.abs_diff(settings.iterations);
        if r <= budget && best.is_none_or(|(s, m)| r > s || (r == s && off(n) < off(m))) {
            best = Some((r, n));
        }
    }
    best.map(|(_, n)| n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lastlight_last::avatar::progressive::Progressive;

    #[test]
    fn renders_are_counted_before_they_happen() {
        let host = Settings { iterations: 600, ..Settings::baseline() };
        let chain = Digraph::new(4, &[(0, 1), (1, 2)]);
        let with = |p: Progressive| Settings { progressive: Some(p), ..host.clone() };
        assert_eq!(levels(&host, &chain).expect("acyclic"), 1, "without the progressive update");
        assert_eq!(levels(&with(Progressive::published()), &chain).expect("acyclic"), 3, "a chain of three");
        assert_eq!(renders(&host, 1, 40), Some(600), "one each");
        // Key Gaussians are searched at 100, 150, …, 600 of 600 iterations, on 8 images.
        let full = with(Progressive::published());
        assert_eq!(renders(&full, 3, 40), Some(600 + 500 * 2 + 11 * 8), "levels and searches");
        assert_eq!(renders(&full, 3, 5), Some(600 + 500 * 2 + 11 * 5), "at most as many images as there are");
        let random = with(Progressive { keys: Keys::Random, ..Progressive::published() });
        assert_eq!(renders(&random, 2, 40), Some(600 + 500), "random keys need no renders");
        let stop = with(Progressive { cap: Cap::Stop, ..Progressive::published() });
        assert_eq!(renders(&stop, 2, 40), None, "depends on gradients");
        assert_eq!(
            renders(&Settings { iterations: 3, ..full.clone() }, 3, 40),
            Some(3 + 2 * 2 + 3 * 8),
            "short"
        );
        assert_eq!(iterations(&host, 1, 40, 1688), Some(1688), "the host runs longer");
        assert_eq!(iterations(&full, 3, 40, 1688), Some(600), "the same number");
        let longer = iterations(&full, 2, 40, 1688).expect("fits");
        let n = |iterations| renders(&Settings { iterations, ..full.clone() }, 2, 40).expect("known");
        assert!((1680..=1688).contains(&n(longer)), "nearly all is spent: {} by {longer}", n(longer));
    }
}
