//! The memory limit: what grows with the input is estimated before it is allocated.
//!
//! The limit (`--max-memory`) is a property of the process, as the memory is. It applies to every estimate by itself and bounds no sum of all
//! allocations. By default it is half of what the process may use: the memory of the machine, or of its control group or address space
//! if that is less. An allocation that the system refuses although it is within the limit is an error too.

use crate::{Error, Result};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// The limit that was set, in bytes; 0 if none was.
static LIMIT: AtomicU64 = AtomicU64::new(0);

/// Half of this is the default limit where the system does not say how much memory there is.
const UNKNOWN: u64 = 16 << 30;

/// What a user can do about it.
const HINT: &str = "--max-memory raises the limit, if the machine has more";

/// Sets the limit in bytes.
pub fn set_limit(bytes: u64) {
    LIMIT.store(bytes.max(1), Ordering::Relaxed);
}

/// The limit in bytes.
pub fn limit() -> u64 {
    static HALF: OnceLock<u64> = OnceLock::new();
    match LIMIT.load(Ordering::Relaxed) {
        0 => *HALF.get_or_init(|| usable().unwrap_or(UNKNOWN) / 2),
        bytes => bytes,
    }
}

/// Bytes that this process may use, on Linux.
fn usable() -> Option<u64> {
    let read = |path: &str| std::fs::read_to_string(path).ok();
    let total = read("/proc/meminfo")
        .and_then(|text| number_after(&text, "MemTotal:"))
        .map(|k| k.saturating_mul(1024));
    let group = read("/proc/self/cgroup").and_then(|text| {
        let own = text.lines().find_map(|line| line.strip_prefix("0::"))?.trim_end_matches('/').to_owned();
        read(&format!("/sys/fs/cgroup{own}/memory.max"))
    });
    let group = group.or_else(|| read("/sys/fs/cgroup/memory.max")).and_then(|text| text.trim().parse().ok());
    let space = read("/proc/self/limits").and_then(|text| number_after(&text, "Max address space"));
    [total, group, space].into_iter().flatten().min()
}

/// The number that follows a label at the start of a line; none if it is a word such as `unlimited`.
fn number_after(text: &str, label: &str) -> Option<u64> {
    text.lines().find_map(|line| line.strip_prefix(label))?.split_whitespace().next()?.parse().ok()
}

/// A size such as `4G`, `512M`, `1.5GiB` or `100000`: bytes, or powers of 1024 of them.
///
/// # Errors
/// When it is no positive size.
pub fn parse_size(text: &str) -> Result<u64> {
    let lower = text.trim().to_ascii_lowercase();
    let short = lower.strip_suffix("ib").or_else(|| lower.strip_suffix('b')).unwrap_or(&lower);
    let (digits, shift) = match short.char_indices().last() {
        Some((at, unit @ ('k' | 'm' | 'g' | 't'))) => {
            (&short[..at], 10 * (1 + "kmgt".find(unit).unwrap_or(0)))
        }
        _ => (short, 0),
    };
    let bytes =
        digits.parse::<f64>().ok().map(|x| x * (1_u64 << shift) as f64).filter(|x| (1.0..=1e18).contains(x));
    bytes
        .map(|x| x as u64)
        .ok_or_else(|| Error::input("size").expected("bytes, such as 512M or 4G").got(text))
}

/// Bytes as `1.4 MiB`.
pub fn size(bytes: u64) -> String {
    let x = bytes as f64;
    match bytes {
        0..1_024 => format!("{bytes} B"),
        1_024..1_048_576 => format!("{:.1} KiB", x / 1024.0),
        1_048_576..1_073_741_824 => format!("{:.1} MiB", x / 1_048_576.0),
        _ => format!("{:.2} GiB", x / 1_073_741_824.0),
    }
}

/// Checks an estimate of what `name` will take.
///
/// # Errors
/// When it is above the limit.
pub fn check(name: &str, bytes: u64) -> Result<()> {
    if bytes <= limit() {
        return Ok(());
    }
    Err(Error::input(name)
        .at("memory")
        .expected(format!("at most {}", size(limit())))
        .got(format!("an estimate of {}", size(bytes)))
        .hint(HINT))
}

/// An empty vector with room for `len` entries.
///
/// # Errors
/// When that is above the limit, or the system refuses.
pub fn room<T>(name: &str, len: usize) -> Result<Vec<T>> {
    let mut out = Vec::new();
    grow(name, &mut out, len)?;
    Ok(out)
}

/// Makes room for `more` entries.
///
/// # Errors
/// As [`room`].
pub fn grow<T>(name: &str, out: &mut Vec<T>, more: usize) -> Result<()> {
    let bytes = (more as u64).saturating_mul(size_of::<T>() as u64);
    check(name, bytes)?;
    out.try_reserve_exact(more).map_err(|_| {
        Error::input(name)
            .at("memory")
            .expected(format!("{} to allocate", size(bytes)))
            .got("too little free memory")
    })
}

/// A vector of `len` copies of a value.
///
/// # Errors
/// As [`room`].
pub fn filled<T: Clone>(name: &str, len: usize, value: T) -> Result<Vec<T>> {
    let mut out = room(name, len)?;
    out.resize(len, value);
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_and_printed() {
        for (text, bytes) in [
            ("4G", 4 << 30),
            ("512M", 512 << 20),
            ("1.5GiB", 3 << 29),
            ("2 kb", 2048),
            ("7", 7),
            ("1t", 1 << 40),
        ] {
            let text = text.replace(' ', "");
            assert_eq!(parse_size(&text).expect("a size"), bytes, "{text}");
        }
        for bad in ["", "G", "-1G", "nan", "0", "4X", "1e30T"] {
            assert!(parse_size(bad).is_err(), "'{bad}' is refused");
        }
        assert_eq!([size(7), size(3 << 29), size(1 << 19)], ["7 B", "1.50 GiB", "512.0 KiB"], "printed");
    }

    #[test]
    fn what_is_above_the_limit_or_refused_is_an_error() {
        assert!(limit() > 1 << 20, "a limit by default: {}", limit());
        let e = check("a.npz", u64::MAX).expect_err("more than any machine has").to_string();
        assert!(e.starts_with("a.npz: memory: expected at most ") && e.contains("--max-memory"), "{e}");
        assert!(room::<f64>("a.npz", usize::MAX / 2).is_err(), "above the limit");
        assert_eq!(filled("a.npz", 3, 1_u8).expect("little"), [1; 3], "filled");
    }

    #[test]
    fn limits_of_the_system_are_read() {
        let limits =
            "Limit  Soft Limit\nMax address space         4096000000           unlimited            bytes\n";
        assert_eq!(number_after(limits, "Max address space"), Some(4_096_000_000), "a number");
        assert_eq!(number_after("Max address space  unlimited  x\n", "Max address space"), None, "a word");
    }
}
