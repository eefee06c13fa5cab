//! Counts, seconds and bytes as text for people.

/// Seconds as `850 ms`, `12.3 s` or `4 min 05 s`.
pub(crate) fn seconds(s: f64) -> String {
    if s < 1.0 {
        format!("{:.0} ms", s * 1e3)
    } else if s < 60.0 {
        format!("{s:.1} s")
    } else {
        let whole = s.round() as u64;
        format!("{} min {:02} s", whole / 60, whole % 60)
    }
}

/// Bytes as `1.4 MiB`.
pub(crate) fn bytes(n: u64) -> String {
    let x = n as f64;
    if x < 1024.0 {
        format!("{n} B")
    } else if x < 1024.0 * 1024.0 {
        format!("{:.1} KiB", x / 1024.0)
    } else if x < 1024.0 * 1024.0 * 1024.0 {
        format!("{:.1} MiB", x / 1_048_576.0)
    } else {
        format!("{:.2} GiB", x / 1_073_741_824.0)
    }
}

/// `1 photo`, `12 photos`.
pub(crate) fn counted(n: usize, noun: &str) -> String {
    format!("{n} {noun}{}", if n == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_singular() {
        let all = [0, 1, 2].map(|n| counted(n, "training photo"));
        assert_eq!(all, ["0 training photos", "1 training photo", "2 training photos"], "plurals");
    }
}
