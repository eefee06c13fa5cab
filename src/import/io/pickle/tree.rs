//! Nodes to a tree of values.

use super::machine::Machine;
use super::node::{Id, Node};
use super::value::Value;
use super::{instance, text};
use crate::Result;

/// Depth of the tree.
pub(super) const MAX_DEPTH: usize = 100;
/// What a node of the tree costs.
const NODE_COST: usize = 64;

impl Machine<'_> {
    /// The tree below a node; `budget` counts down.
    pub(super) fn tree(&self, id: Id, depth: usize, budget: &mut usize) -> Result<Value> {
        let node = &self.nodes[id as usize];
        let cost = NODE_COST + node.payload();
        *budget = budget.checked_sub(cost).ok_or_else(|| self.too_much())?;
        let deeper = depth.checked_sub(1).ok_or_else(|| {
            self.error("values")
                .expected(format!("at most {MAX_DEPTH} levels"))
                .got("more, or a value that contains itself")
        })?;
        let mut all = |ids: &[Id]| -> Result<Vec<Value>> {
            ids.iter().map(|&i| self.tree(i, deeper, budget)).collect()
        };
        Ok(match node {
            Node::None => Value::None,
            Node::Bool(b) => Value::Bool(*b),
            Node::Int(i) => Value::Int(*i),
            Node::Float(x) => Value::Float(*x),
            Node::Text(t) => Value::Text(t.clone()),
            Node::Str(b) => text::string(b),
            Node::Made(b) => text::string(b),
            Node::Bytes(b) => Value::Bytes(b.to_vec()),
            Node::Encoded(b) => Value::Bytes(b.clone()),
            Node::List(l) => Value::List(all(l)?),
            Node::Tuple(l) => Value::Tuple(all(l)?),
            Node::Dict(d) => {
                let mut out = Vec::with_capacity(d.len());
                for &(k, v) in d {
                    let pair = all(&[k, v])?;
                    let [k, v] = <[Value; 2]>::try_from(pair).map_err(|_| self.error("a pair"))?;
                    out.push((k, v));
                }
                Value::Dict(out)
            }
            Node::Array(a) => Value::Array(a.clone()),
            Node::Objects(shape, l) => Value::Objects(shape.clone(), all(l)?),
            Node::Texts(shape, t) => {
                Value::Objects(shape.clone(), t.iter().map(|t| Value::Text(t.clone())).collect())
            }
            Node::Unread(what) => Value::Unread(what.clone()),
            Node::Shell => return Err(self.error("array").expected("its shape and elements").got("none")),
            Node::Dtype { descr, .. } => Value::Text(descr.clone()),
            Node::Global(c) => {
                return Err(self.error("values").expected("a value").got(format!("the name {c:?} itself")));
            }
            Node::Instance(class, state) => {
                let state = state.ok_or_else(|| {
                    self.error("values").expected(format!("what the {class:?} holds")).got("nothing")
                })?;
                let state = self.tree(state, deeper, budget)?;
                let value = instance::instance(*class, &state).map_err(|e| e.within(self.name))?;
                if let Value::Array(a) = &value {
                    *budget = budget.checked_sub(8 * a.len()).ok_or_else(|| self.too_much())?;
                }
                value
            }
        })
    }
}
