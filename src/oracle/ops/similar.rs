//! Suggestions for names that do not exist.

/// Most names of a suggestion.
const MOST: usize = 3;

/// The names closest to `word`, best first, at most three: those equal to it except for case or for the group
/// before the dot; else those that contain it; else the one with the fewest insertions, deletions and
/// replacements, if they change at most half of `word`.
pub fn similar<'a>(word: &str, names: impl IntoIterator<Item = &'a str>) -> Vec<&'a str> {
    let word = word.to_lowercase();
    let names: Vec<&str> = names.into_iter().collect();
    let chosen = |is_close: &dyn Fn(&str) -> bool| {
        let close = |n: &&&str| is_close(&n.to_lowercase());
        names.iter().filter(close).take(MOST).copied().collect::<Vec<_>>()
    };
    if word.is_empty() {
        return Vec::new();
    }
    let same = chosen(&|name| name == word || name.split_once('.').is_some_and(|(_, last)| last == word));
    if !same.is_empty() {
        return same;
    }
    let parts = chosen(&|name| word.len() > 1 && name.contains(&word));
    if !parts.is_empty() {
        return parts;
    }
    let best = names.iter().map(|name| (edits(&word, &name.to_lowercase()), *name)).min_by_key(|(n, _)| *n);
    best.into_iter().filter(|(edits, _)| 2 * edits <= word.chars().count()).map(|(_, name)| name).collect()
}

/// Levenshtein's distance.
fn edits(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != *y);
            diagonal = row[j + 1];
            row[j + 1] = Ord::min(Ord::min(replaced, diagonal + 1), row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_closest_names_are_suggested() {
        let close = |word: &str| similar(word, ["splat.render", "splat.blend", "nn.linear", "loss.ssim"]);
        assert_eq!(close("splat.rendr"), ["splat.render"], "a letter is missing");
        assert_eq!(close("linear"), ["nn.linear"], "the group is missing");
        assert_eq!(
            (close("nn.lin"), close("SSIM")),
            (vec!["nn.linear"], vec!["loss.ssim"]),
            "a part, a case"
        );
        assert_eq!(close("splat."), ["splat.render", "splat.blend"], "several");
        assert!(close("gemm").is_empty() && close("").is_empty(), "nothing is close");
        assert_eq!([edits("", "abc"), edits("kitten", "sitting"), edits("a", "a")], [3, 3, 0], "distances");
    }
}
