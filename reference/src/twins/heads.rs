//! The heads of the twins' source files: equation, symbols, rounding, kinks and domain of every operator.

/// The source of every twin, in the order of the list; its first line names the operator.
static SOURCES: &[&str] = &[
    include_str!("../splat/activate.rs"),
    include_str!("../splat/covariance.rs"),
    include_str!("../splat/project.rs"),
    include_str!("../splat/color.rs"),
    include_str!("../splat/blend.rs"),
    include_str!("../splat/render.rs"),
    include_str!("../geometry/trace.rs"),
    include_str!("../nn/linear.rs"),
    include_str!("../nn/act.rs"),
    include_str!("../nn/conv.rs"),
    include_str!("../nn/mlp.rs"),
    include_str!("../nn/softmax.rs"),
    include_str!("../nn/decoder.rs"),
    include_str!("../nn/window.rs"),
    include_str!("../loss/l1.rs"),
    include_str!("../loss/mse.rs"),
    include_str!("../loss/ssim.rs"),
    include_str!("../loss/points.rs"),
    include_str!("../loss/groups.rs"),
    include_str!("../loss/latent.rs"),
    include_str!("../loss/prior.rs"),
    include_str!("../loss/presence.rs"),
    include_str!("../loss/eikonal.rs"),
    include_str!("../loss/albedo.rs"),
    include_str!("../loss/lpips.rs"),
    include_str!("../shade/ggx.rs"),
    include_str!("../shade/envmap.rs"),
    include_str!("../shade/diffuse.rs"),
    include_str!("../shade/gain.rs"),
    include_str!("../shade/over_black.rs"),
    include_str!("../field/fetch.rs"),
    include_str!("../field/sdf_head.rs"),
    include_str!("../field/value_head.rs"),
    include_str!("../field/normal_head.rs"),
    include_str!("../field/embed.rs"),
    include_str!("../field/density.rs"),
    include_str!("../field/interval.rs"),
    include_str!("../field/normal.rs"),
    include_str!("../field/composite.rs"),
    include_str!("../field/render.rs"),
    include_str!("../causal/acyclic.rs"),
    include_str!("../causal/mask.rs"),
    include_str!("../causal/probability.rs"),
    include_str!("../causal/edges.rs"),
    include_str!("../causal/structure.rs"),
    include_str!("../causal/posterior_kl.rs"),
    include_str!("../causal/posterior.rs"),
    include_str!("../causal/scm_kl.rs"),
    include_str!("../causal/intervene.rs"),
    include_str!("../causal/independence.rs"),
    include_str!("../causal/limit.rs"),
    include_str!("../causal/code.rs"),
    include_str!("../causal/held.rs"),
    include_str!("../body/skin.rs"),
    include_str!("../body/rest.rs"),
    include_str!("../body/pose.rs"),
    include_str!("../optim/adam.rs"),
    include_str!("../optim/adamw.rs"),
];

/// The head of the twin's source file, without comment signs: Markdown whose first line starts with the name
/// of the operator in code font.
pub fn head(op: &str) -> Option<String> {
    let start = format!("//! `{op}`:");
    let source = SOURCES.iter().find(|source| source.starts_with(&start))?;
    let lines = source.lines().map_while(|line| line.strip_prefix("//!"));
    Some(lines.map(|line| line.strip_prefix(' ').unwrap_or(line)).collect::<Vec<_>>().join("\n"))
}
