//! `oracle list` and `oracle show`.

use super::text;
use crate::ops::{self, Kind, Op, Port, SettingSpec, Stage, Width};
use crate::{Error, Result};
use serde::ser::SerializeStruct;
use serde::{Serialize, Serializer};
use std::fmt;

/// Operators, printable as text and as JSON.
pub struct List {
    /// the operators in order
    pub operators: Vec<&'static Op>,
    /// whether the text has arguments, outputs and settings too; JSON always has them
    pub is_complete: bool,
}

/// The operators of these names, or in groups of these names (`splat`); all if there are none. One line each.
///
/// # Errors
/// When a name is neither that of an operator nor of a group.
pub fn list(names: &[String]) -> Result<List> {
    let is_in = |op: &Op, name: &str| {
        op.name == name || op.name.strip_prefix(name).is_some_and(|rest| rest.starts_with('.'))
    };
    for name in names {
        if ops::LIST.iter().any(|op| is_in(op, name)) {
            continue;
        }
        let mut groups: Vec<&str> =
            ops::LIST.iter().filter_map(|op| Some(op.name.split_once('.')?.0)).collect();
        groups.dedup();
        let e = Error::input("oracle list").got(format!("'{name}'"));
        let close = ops::similar(name, groups.iter().copied().chain(ops::LIST.iter().map(|op| op.name)));
        return Err(if close.is_empty() {
            e.expected(format!("operators, or groups of them: {}", groups.join(", ")))
        } else {
            e.expected("an operator or a group of operators")
                .hint(format!("did you mean {}?", close.join(" or ")))
        });
    }
    let chosen = |op: &&'static Op| names.is_empty() || names.iter().any(|name| is_in(op, name));
    Ok(List { operators: ops::LIST.iter().copied().filter(chosen).collect(), is_complete: false })
}

/// The operators of these names with arguments, outputs and settings.
///
/// # Errors
/// When a name is unknown.
pub fn show(names: &[String]) -> Result<List> {
    Ok(List { operators: ops::choose(names)?, is_complete: true })
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
        if !self.is_complete {
            for op in &self.operators {
                let note = if op.adjoint { "" } else { "  (no adjoint)" };
                writeln!(f, "{:<22} {}{note}", op.name, op.summary)?;
            }
            return Ok(());
        }
        writeln!(f, "∂: has a gradient; ?: optional; float is f32 or f64, as selected by --precision")?;
        for op in &self.operators {
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
            writeln!(f)?;
            for line in text::of(op.name).lines() {
                writeln!(f, "{}", format!("    {line}").trim_end())?;
            }
        }
        Ok(())
    }
}

impl Serialize for List {
    fn serialize<S: Serializer>(&self, to: S) -> std::result::Result<S::Ok, S::Error> {
        let mut list = to.serialize_struct("List", 1)?;
        list.serialize_field(
            "operators",
            &self.operators.iter().map(|op| Entry::of(op)).collect::<Vec<_>>(),
        )?;
        list.end()
    }
}

/// An operator in JSON.
#[derive(Serialize)]
struct Entry {
    name: &'static str,
    summary: &'static str,
    /// equation, symbols, kinks and domain
    text: String,
    inputs: Vec<PortEntry>,
    outputs: Vec<PortEntry>,
    intermediates: Vec<PortEntry>,
    plan: Vec<PortEntry>,
    companions: &'static [&'static str],
    settings: Vec<SettingEntry>,
    stages: Vec<StageEntry>,
    adjoint: bool,
    width: Width,
    work_unit: &'static str,
    work_ns: [f64; 2],
    cases: usize,
}

#[derive(Serialize)]
struct PortEntry {
    name: &'static str,
    shape: &'static str,
    dtype: &'static str,
    differentiable: bool,
    optional: bool,
    doc: &'static str,
}

#[derive(Serialize)]
struct SettingEntry {
    key: &'static str,
    kind: KindEntry,
    default: &'static str,
    doc: &'static str,
}

#[derive(Serialize)]
#[serde(rename_all = "lowercase")]
enum KindEntry {
    Number,
    Flag,
    Choice(&'static [&'static str]),
}

#[derive(Serialize)]
struct StageEntry {
    operator: &'static str,
    inputs: &'static [&'static str],
    outputs: &'static [&'static str],
}

impl Entry {
    fn of(op: &Op) -> Self {
        let ports = |ports: &[Port]| ports.iter().map(PortEntry::of).collect();
        Self {
            name: op.name,
            summary: op.summary,
            text: text::of(op.name),
            inputs: ports(op.inputs),
            outputs: ports(op.outputs),
            intermediates: ports(op.intermediates),
            plan: ports(op.plan),
            companions: op.companions,
            settings: op.settings.iter().map(SettingEntry::of).collect(),
            stages: op.stages.iter().map(StageEntry::of).collect(),
            adjoint: op.adjoint,
            width: op.width,
            work_unit: op.work_unit,
            work_ns: op.work_ns,
            cases: op.cases,
        }
    }
}

impl PortEntry {
    fn of(port: &Port) -> Self {
        let Port { name, shape, dtype, differentiable, optional, doc, .. } = *port;
        Self { name, shape, dtype: dtype.name(), differentiable, optional, doc }
    }
}

impl SettingEntry {
    fn of(spec: &SettingSpec) -> Self {
        let SettingSpec { key, kind, default, doc } = *spec;
        let kind = match kind {
            Kind::Number => KindEntry::Number,
            Kind::Flag => KindEntry::Flag,
            Kind::Choice(words) => KindEntry::Choice(words),
        };
        Self { key, kind, default, doc }
    }
}

impl StageEntry {
    fn of(stage: &Stage) -> Self {
        let Stage { operator, inputs, outputs } = *stage;
        Self { operator, inputs, outputs }
    }
}
