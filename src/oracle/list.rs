//! `oracle list`.

use crate::ops::{self, Kind, Op, Port};
use serde::Serialize;
use std::fmt;

/// The operator list, printable as text and as JSON.
#[derive(Serialize)]
pub struct List {
    /// all operators in order
    pub operators: &'static [&'static Op],
}

/// The operator list.
pub fn list() -> List {
    List { operators: ops::LIST }
}

fn ports(f: &mut fmt::Formatter<'_>, title: &str, ports: &[Port]) -> fmt::Result {
    for (i, p) in ports.iter().enumerate() {
        let title = if i == 0 { title } else { "" };
        let mark = match (p.differentiable, p.optional) {
            (true, true) => "∂?",
            (true, false) => "∂ ",
            (false, true) => " ?",
            (false, false) => "  ",
        };
        let shape = format!("({})", p.shape);
        writeln!(f, "    {title:<14}{mark} {:<16} {shape:<14} {:<6} {}", p.name, p.dtype.name(), p.doc)?;
    }
    Ok(())
}

impl fmt::Display for List {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "∂ has a gradient, ? may be absent; float is f32 or f64 as the run")?;
        for op in self.operators {
            let note = if op.adjoint { "" } else { "  (no adjoint)" };
            writeln!(f, "\n{}{note}\n    {}", op.name, op.summary)?;
            ports(f, "inputs", op.inputs)?;
            ports(f, "outputs", op.outputs)?;
            ports(f, "with --dump", op.intermediates)?;
            ports(f, "plan", op.plan)?;
            for (i, s) in op.settings.iter().enumerate() {
                let title = if i == 0 { "settings" } else { "" };
                let values = match s.kind {
                    Kind::Number => "number".to_owned(),
                    Kind::Flag => "0|1".to_owned(),
                    Kind::Choice(words) => words.join("|"),
                };
                writeln!(f, "    {title:<14}   {:<16} {values} (default {}) {}", s.key, s.default, s.doc)?;
            }
            if op.is_composite() {
                let stages: Vec<_> = op.stages.iter().map(|s| s.operator).collect();
                writeln!(f, "    {:<14}   {}", "stages", stages.join(" → "))?;
            }
        }
        Ok(())
    }
}
