//! Equation, symbols, rounding, kinks and domain of an operator as plain text, from the head of its twin.

use reference::twins;

/// The text of an operator, without Markdown. It is empty where there is no such operator.
pub(super) fn of(op: &str) -> String {
    let head = twins::head(op).unwrap_or_default();
    let group = op.split('.').next().unwrap_or_default();
    let (mut out, mut table) = (Vec::new(), Vec::new());
    for line in head.lines() {
        let line = plain(line, group);
        if let Some(row) = line.strip_prefix('|') {
            let row = row.strip_suffix('|').unwrap_or(row);
            table.push(row.split('|').map(|cell| cell.trim().to_owned()).collect::<Vec<_>>());
            continue;
        }
        out.extend(aligned(&std::mem::take(&mut table)));
        if !line.starts_with("```") {
            out.push(line.trim_start_matches('#').trim_start().to_owned());
        }
    }
    out.extend(aligned(&table));
    out.join("\n")
}

/// A line without code font; links to other twins become names of operators.
fn plain(line: &str, group: &str) -> String {
    if line.starts_with("```") {
        return line.to_owned();
    }
    let line = line.replace("[`super::", &format!("[`{group}."));
    let mut out = String::new();
    let mut rest = &*line;
    while let Some((before, link)) = rest.split_once("[`") {
        let (name, after) = link.split_once("`]").unwrap_or((link, ""));
        out.push_str(before);
        out.push_str(name.rsplit("::").next().unwrap_or(name));
        rest = after;
    }
    out.push_str(rest);
    out.replace('`', "")
}

/// Rows of a table in columns, without the line below its head.
fn aligned(rows: &[Vec<String>]) -> Vec<String> {
    let is_rule = |row: &&Vec<String>| row.iter().all(|c| !c.is_empty() && c.chars().all(|c| c == '-'));
    let rows: Vec<&Vec<String>> = rows.iter().filter(|row| !is_rule(row)).collect();
    let columns = rows.iter().map(|row| row.len()).max().unwrap_or(0);
    let wide = |k: usize| rows.iter().filter_map(|r| r.get(k)).map(|c| c.chars().count()).max().unwrap_or(0);
    let width: Vec<usize> = (0..columns).map(wide).collect();
    let cell = |(k, c): (usize, &String)| format!("{c:<0$}", width[k]);
    let line = |row: &&Vec<String>| row.iter().enumerate().map(cell).collect::<Vec<_>>().join("  ");
    rows.iter().map(|row| format!("  {}", line(row).trim_end())).collect()
}

#[cfg(test)]
mod tests {
    use crate::ops;

    #[test]
    fn every_operator_has_a_text_that_starts_with_its_name() {
        for op in ops::LIST {
            let text = super::of(op.name);
            assert!(text.starts_with(&format!("{}: ", op.name)), "{}: {text}", op.name);
            for mark in ["`", "//!", "::", "|---", "\n#"] {
                assert!(!text.contains(mark), "{}: {mark} in {text}", op.name);
            }
        }
        let text = super::of("nn.linear");
        assert!(
            text.contains("\n  symbol  argument       shape\n  x       x              (M, K)\n"),
            "{text}"
        );
        assert!(text.contains("\nKinks and domain\nAt 0 the slope of λ is s."), "{text}");
    }
}
