//! How many pictures a fit renders, and how long it may be for a number of them.
//!
//! An iteration renders once; from the one after the first search for keys on, once for each level of the graph. A search by exchange renders each
//! picture that it looks at. λ mode `stop` renders as often as the gradient asks for, and has no budget.

use crate::Result;
use crate::math::digraph::Digraph;
use lastlight_last::avatar::progressive::{Cap, Keys, Order, Plan};
use lastlight_last::avatar::settings::Settings;

/// Number of levels under a graph.
///
/// # Errors
/// When it has a cycle.
pub fn levels(settings: &Settings, graph: &Digraph) -> Result<usize> {
    let Some(p) = &settings.progressive else { return Ok(1) };
    let graph = p.graph.as_ref().unwrap_or(graph);
    Ok(Plan::new(graph, if graph.count() == 0 { Order::None } else { p.order }, settings.seed)?.levels.len())
}

/// Pictures rendered by a fit of some levels to `train` training pictures; none where that depends on the gradients.
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
    let looks = (n - begin) / every + 1;
    let look = if p.keys == Keys::Swap { Ord::min(p.views, train) } else { 0 };
    Some(n + (n - begin) * (levels - 1) + looks * look)
}

/// The iterations that render most pictures, but no more than `budget`; of several the number nearest to that of the settings, and the smaller of two. Constants of
/// the schedule are rounded, so that more iterations may render less.
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
        // Keys are found at 100, 150, …, 600 of 600 iterations, on 8 pictures.
        let full = with(Progressive::published());
        assert_eq!(renders(&full, 3, 40), Some(600 + 500 * 2 + 11 * 8), "levels and looks");
        assert_eq!(renders(&full, 3, 5), Some(600 + 500 * 2 + 11 * 5), "no more pictures than there are");
        let random = with(Progressive { keys: Keys::Random, ..Progressive::published() });
        assert_eq!(renders(&random, 2, 40), Some(600 + 500), "drawn keys look at nothing");
        let stop = with(Progressive { cap: Cap::Stop, ..Progressive::published() });
        assert_eq!(renders(&stop, 2, 40), None, "depends on gradients");
        assert_eq!(
            renders(&Settings { iterations: 3, ..full.clone() }, 3, 40),
            Some(3 + 2 * 2 + 3 * 8),
            "short"
        );
        assert_eq!(iterations(&host, 1, 40, 1688), Some(1688), "the host goes on for longer");
        assert_eq!(iterations(&full, 3, 40, 1688), Some(600), "itself");
        let longer = iterations(&full, 2, 40, 1688).expect("fits");
        let n = |iterations| renders(&Settings { iterations, ..full.clone() }, 2, 40).expect("known");
        assert!((1680..=1688).contains(&n(longer)), "nearly all is spent: {} by {longer}", n(longer));
    }
}
