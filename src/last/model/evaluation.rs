//! Evaluation of a trained model: reconstruction, counterfactuals and learned graph, compared with the truth
//! if the data contains it.
//!
//! Blocks are matched with the true factors by canonical correlation before graphs are compared. Intervention
//! targets are inferred from the noise only: the target of a group is the factor whose noise changes most,
//! relative to its standard deviation, by majority over the group.

use super::data::{Data, Item};
use super::file::Trained;
use super::latent;
use super::likeness::Likeness;
use super::structure::Structure;
use super::targets::{Pairs, voted};
use crate::causal::structure;
use crate::loss::metric::structure::intervention::{locality, target_accuracy};
use crate::loss::metric::structure::matching::{Matching, matching};
use crate::loss::metric::structure::{Blocks, Factors, edges, sid};
use crate::math::digraph::Digraph;
use crate::num::order;
use crate::{Error, Result};
use serde_json::{Value, json};

/// Maximum number of items of each kind that are evaluated.
const MOST: usize = 2048;
/// Number of items decoded at all points.
const DECODED: usize = 64;
/// Variance of its posterior mean above which a latent dimension is an active unit (Burda et al. 2016).
pub const ACTIVE: f64 = 0.01;

/// The results of an evaluation.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// Mean distance of decoded points from the true ones, figure frame.
    pub space_error: f64,
    /// Mean absolute error of their colours.
    pub colour_error: f64,
    /// Errors of decoded counterfactuals and of unchanged decodings, both against the images after
    /// interventions.
    pub counterfactual: Option<[Errors; 2]>,
    /// Error of counterfactuals decoded along the true edges by the same networks, if the truth is known and
    /// every factor has its block. Networks of edges that the model does not have were not refitted, so a
    /// larger error is not evidence against the true graph.
    pub under_truth: Option<Errors>,
    /// Likeness of blocks and factors, and the values that the true factors themselves attain.
    pub likeness: [Likeness; 2],
    /// Variance of the posterior means, averaged over the dimensions of a block, shape (n); near 0, the code
    /// carries no information.
    pub variances: Vec<f64>,
    /// Active units: the number of latent dimensions whose posterior means have a variance above [`ACTIVE`].
    pub active: usize,
    /// Mean canonical correlation of blocks and true factors.
    pub mcc: f64,
    /// Matching of blocks and factors.
    pub matched: Matching,
    /// Graph over the blocks.
    pub graph: Digraph,
    /// Edge probabilities, shape (n, n).
    pub probabilities: Vec<f64>,
    /// True graph over the factors of the data; `None` if unknown.
    pub truth: Option<Digraph>,
    /// Structural Hamming distance and structural intervention distance to the truth.
    pub distances: Option<[usize; 2]>,
    /// Fraction of groups whose target was inferred correctly.
    pub target_accuracy: f64,
    /// Displacement of the points that an intervention must not move, divided by that of the points that it
    /// moves.
    pub locality: Option<f64>,
    n: usize,
}

/// Factors and noise of items under the graph, (B, n, k) each.
pub fn posterior(trained: &Trained, data: &dyn Data, items: &[Item]) -> [Vec<f64>; 2] {
    let [mu, _] = trained.model.encode(data, items);
    linked(trained, mu)
}

/// Factors and noise that correspond to the encoder's means.
pub fn linked(trained: &Trained, mu: Vec<f64>) -> [Vec<f64>; 2] {
    trained.model.linked(trained.settings.reading, &trained.graph.adjacency(), mu)
}

/// The endogenous factors that the graph predicts from noise (B, n, k).
pub fn predicted(trained: &Trained, eps: &[f64]) -> Vec<f64> {
    let s = Structure::new(trained.model.sizes, &trained.model.params);
    let mask = trained.graph.adjacency();
    let x = structure::In {
        eps,
        mask: &mask,
        mechanism: s.mechanism(),
        batch: eps.len() / trained.model.sizes.latent(),
        n: trained.model.sizes.factors,
        k: trained.model.sizes.width,
        sweeps: s.sweeps(),
    };
    structure::forward(&x).0
}

/// Variance of every column of rows (N, d), with divisor N.
pub fn variances(rows: &[f64], d: usize) -> Vec<f64> {
    let count = Ord::max(1, rows.len() / d) as f64;
    let column = |c: usize| rows.iter().skip(c).step_by(d);
    (0..d)
        .map(|c| {
            let mean = column(c).fold(0.0, |s, x| s + x) / count;
            column(c).fold(0.0, |s, x| s + (x - mean) * (x - mean)) / count
        })
        .collect()
}

/// Standard deviation of every column of rows (N, d), at least 10⁻³, used as a unit.
pub fn deviations(rows: &[f64], d: usize) -> Vec<f64> {
    variances(rows, d).iter().map(|v| order::max(v.sqrt(), 1e-3)).collect()
}

/// Errors of decoded points, means over items and coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    /// Length of the error of the first three outputs: positions, figure frame.
    pub space: f64,
    /// Mean absolute error of the other outputs: colours.
    pub colour: f64,
    /// The quantity that L_rec measures, Σ_c w_c (R − R')².
    pub weighted: f64,
}

impl Errors {
    /// The ratio of the weighted error to that of `others`; `None` if that is 0.
    pub fn over(&self, others: &Self) -> Option<f64> {
        (others.weighted > 0.0).then(|| self.weighted / others.weighted)
    }
}

/// Errors of the outputs decoded from factors (B, n, k), relative to the targets of items.
pub fn errors(trained: &Trained, data: &dyn Data, z: &[f64], shown: &[Item]) -> Errors {
    let frame = data.frame();
    let z: Vec<f32> = z.iter().map(|&z| z as f32).collect();
    let y = trained.model.decoder.forward(&trained.model.params, &frame.codes, &z);
    let (mut space, mut colour, mut weighted) = (0.0, 0.0, 0.0);
    let (p, o) = (frame.points(), frame.outputs);
    let lead = Ord::min(3, o);
    for (b, item) in shown.iter().enumerate() {
        let wanted = data.shown(*item);
        for at in 0..p {
            let error = |c: usize| {
                let i = at * o + c;
                f64::from(frame.base[i] + frame.scale[c] * y[b * p * o + i] - wanted[i])
            };
            space += (0..lead).fold(0.0, |s, c| s + error(c) * error(c)).sqrt();
            colour += (lead..o).fold(0.0, |s, c| s + error(c).abs()) / Ord::max(1, o - lead) as f64;
            weighted += (0..o).fold(0.0, |s, c| s + f64::from(frame.precision[c]) * (error(c) * error(c)));
        }
    }
    let count = Ord::max(1, shown.len() * p) as f64;
    Errors { space: space / count, colour: colour / count, weighted: weighted / count }
}

/// Evaluates a trained model on data, either its training data or other data.
///
/// # Errors
/// If factors do not vary.
pub fn of(trained: &Trained, data: &dyn Data, truth: &Option<Vec<Vec<bool>>>) -> Result<Evaluation> {
    let (n, k) = (trained.model.sizes.factors, trained.model.sizes.width);
    let d = n * k;
    let observed: Vec<Item> = (0..Ord::min(MOST, data.observed())).map(Item::Observed).collect();
    let [mu, _] = trained.model.encode(data, &observed);
    let each = variances(&mu, d);
    let [u, _] = linked(trained, mu);
    let m = data.true_factors();
    let true_factors: Vec<f64> = observed.iter().flat_map(|i| data.truth(*i).to_vec()).collect();
    let blocks = |values| Blocks { values, n, k };
    let factors = Factors { values: &true_factors, m };
    let matched = matching(&blocks(&u), &factors)?;
    let likeness = [Likeness::of(&blocks(&u), &factors)?, Likeness::of_truth(&factors)?];
    let few = &observed[..Ord::min(DECODED, observed.len())];
    let shown = errors(trained, data, &u[..few.len() * d], few);
    let mut verdict = Evaluation {
        space_error: shown.space,
        colour_error: shown.colour,
        counterfactual: None,
        under_truth: None,
        likeness,
        variances: each.chunks_exact(k).map(|b| b.iter().fold(0.0, |s, v| s + v) / k as f64).collect(),
        active: each.iter().filter(|v| **v > ACTIVE).count(),
        mcc: matched.mcc,
        graph: trained.graph.clone(),
        probabilities: Structure::new(trained.model.sizes, &trained.model.params)
            .probabilities(trained.settings.tau),
        truth: None,
        distances: None,
        target_accuracy: 0.0,
        locality: None,
        matched,
        n,
    };
    if let Some(rows) = truth {
        let graph = Digraph::from_fn(rows.len(), |i, j| rows[i].get(j).copied().unwrap_or(false));
        if graph.n() == m {
            let estimate = verdict.matched.relabel(&trained.graph);
            let shd = edges::compare(&graph, &estimate).shd;
            verdict.distances = Some([shd, sid::distance(&graph, &estimate)]);
        }
        verdict.truth = Some(graph);
    }
    interventions(trained, data, &mut verdict)?;
    Ok(verdict)
}

/// Evaluates intervention pairs: targets, locality, counterfactuals.
fn interventions(trained: &Trained, data: &dyn Data, verdict: &mut Evaluation) -> Result<()> {
    let (groups, members) = (Ord::min(MOST, data.groups().len()), data.members());
    if groups == 0 {
        return Ok(());
    }
    let (n, k) = (trained.model.sizes.factors, trained.model.sizes.width);
    let d = n * k;
    let all = |item: fn(usize, usize) -> Item| -> Vec<Item> {
        (0..groups).flat_map(|g| (0..members).map(move |m| item(g, m))).collect()
    };
    let (base, after) = (all(Item::Base), all(Item::After));
    let [u, eps] = posterior(trained, data, &base);
    let [u2, eps2] = posterior(trained, data, &after);
    let spread = &trained.noise_spread;
    let guesses = voted(&Pairs { eps: &eps, eps_after: &eps2, spread, factors: n, members });
    let targets: Vec<usize> = data.groups()[..groups].iter().map(|g| g.target).collect();
    verdict.target_accuracy = target_accuracy(&guesses, &targets, &verdict.matched)?;
    // From here on, a factor is represented by the block that was matched with it; a factor without one
    // cannot be set.
    let block = &verdict.matched.block;
    let targets: Option<Vec<usize>> = targets.iter().map(|t| block.get(*t).copied().flatten()).collect();
    let Some(targets) = targets else { return Ok(()) };
    let whole: Option<Vec<usize>> = block.iter().copied().collect();
    let truth = verdict.truth.as_ref().filter(|truth| truth.n() == n).zip(whole).map(|(truth, blocks)| {
        let factor =
            |b: usize| blocks.iter().position(|x| *x == b).expect("there are n blocks for n factors");
        Digraph::from_fn(n, |i, j| truth.has(factor(i), factor(j)))
    });
    if let Some(truth) = &truth {
        let each: Vec<usize> = targets.iter().flat_map(|t| vec![*t; members]).collect();
        let blocks = |values| Blocks { values, n, k };
        verdict.locality = locality(&blocks(&u), &blocks(&u2), &each, truth)?;
    }
    // Counterfactuals with the groups' own values.
    let few = Ord::min(DECODED / members, groups);
    let mut values = Vec::new();
    for g in 0..few {
        for _ in 0..members {
            for c in 0..k {
                let at = |m: usize| u2[(g * members + m) * d + targets[g] * k + c];
                values.push((0..members).fold(0.0, |s, m| s + at(m)) / members as f64);
            }
        }
    }
    let each: Vec<usize> = targets[..few].iter().flat_map(|t| vec![*t; members]).collect();
    let z = intervened(trained, &eps[..few * members * d], &each, &values)?;
    let shown = &after[..few * members];
    let moved = errors(trained, data, &z, shown);
    let still = errors(trained, data, &u[..few * members * d], shown);
    verdict.counterfactual = Some([moved, still]);
    if let Some(truth) = truth.filter(Digraph::is_acyclic) {
        // The noise follows from the same factors under this graph.
        let oracle = Trained { graph: truth, ..trained.clone() };
        let [_, eps] = posterior(&oracle, data, &base[..few * members]);
        let z = intervened(&oracle, &eps, &each, &values)?;
        verdict.under_truth = Some(errors(trained, data, &z, shown));
    }
    Ok(())
}

/// Factors (B, n, k) after factor `targets[b]` was set to `values` (B, k), keeping the noise `eps` (B, n, k)
/// of the others.
///
/// # Errors
/// If a factor does not exist.
pub fn intervened(trained: &Trained, eps: &[f64], targets: &[usize], values: &[f64]) -> Result<Vec<f64>> {
    let n = trained.model.sizes.factors;
    if let Some(bad) = targets.iter().find(|t| **t >= n) {
        return Err(Error::input("factor").expected(format!("0 to {}", n - 1)).got(bad.to_string()));
    }
    let s = Structure::new(trained.model.sizes, &trained.model.params);
    let mask = trained.graph.adjacency();
    Ok(latent::intervene(&s, &mask, eps, targets, values))
}

impl Evaluation {
    /// A short description of the distance between the graph and the true graph.
    pub fn against_truth(&self) -> String {
        match self.distances {
            Some([0, _]) => "equal to the true graph".into(),
            Some([shd, _]) => format!("{shd} edges differ from the true graph (SHD)"),
            None => "true graph unknown".into(),
        }
    }

    /// The results as text for a terminal.
    pub fn text(&self) -> String {
        let mut lines = vec![
            format!(
                "points      mean error {:.4} in position (the figure is 2 high), {:.4} in colour (values 0 to 1)",
                self.space_error, self.colour_error
            ),
            format!(
                "codes       variances {}; {} active units",
                self.variances.iter().map(|v| format!("{v:.3}")).collect::<Vec<_>>().join(" "),
                self.active
            ),
            format!("factors     MCC {:.3} (mean correlation with the true factors; 1 is best)", self.mcc),
            format!("targets     {:.1} % of the groups inferred correctly", 100.0 * self.target_accuracy),
        ];
        if let Some([moved, still]) = self.counterfactual {
            let mut line = format!(
                "do(factor)  mean error {:.4} in position after interventions, {:.4} without them",
                moved.space, still.space
            );
            if let Some(left) = moved.over(&still) {
                line += &format!("; ratio of the L_rec errors {left:.3}");
            }
            lines.push(line);
        }
        if let Some(oracle) = self.under_truth {
            lines
                .push(format!("            mean error {:.4} in position along the true edges", oracle.space));
        }
        let score = |x: Option<f64>| x.map_or_else(|| "–".into(), |x| format!("{x:.3}"));
        let [own, best] = self.likeness.map(|l| l.named());
        for ((name, own), (_, best)) in own.into_iter().zip(best) {
            let name = name.replace('_', " ");
            lines.push(format!("{name:<16}{} (the true factors themselves: {})", score(own), score(best)));
        }
        if let Some(locality) = self.locality {
            lines.push(format!("locality    {locality:.3} (0 is best)"));
        }
        let arrows: Vec<String> = self.graph.edges().iter().map(|(i, j)| format!("{i}>{j}")).collect();
        let arrows = if arrows.is_empty() { "none".into() } else { arrows.join(" ") };
        lines.push(format!("edges       {arrows}; {}", self.against_truth()));
        lines.join("\n")
    }

    /// The results as JSON for records.
    pub fn json(&self) -> Value {
        json!({
            "space_error": self.space_error, "colour_error": self.colour_error, "mcc": self.mcc,
            "code_variances": self.variances, "active_units": self.active,
            "target_accuracy": self.target_accuracy, "locality": self.locality,
            "likeness": self.likeness[0].json(), "likeness_of_truth": self.likeness[1].json(),
            "counterfactual_error_under_truth": self.under_truth.map(|e| e.space),
            "counterfactual_error": self.counterfactual.map(|c| c[0].space),
            "unchanged_error": self.counterfactual.map(|c| c[1].space),
            "counterfactual_loss": self.counterfactual.map(|c| c[0].weighted),
            "unchanged_loss": self.counterfactual.map(|c| c[1].weighted),
            "edges": self.graph.edges(), "probabilities": self.probabilities,
            "block_of_factor": self.matched.block, "shd": self.distances.map(|d| d[0]), "sid": self.distances.map(|d| d[1]),
        })
    }

    /// Rows of the edge probabilities, for reports.
    pub fn rows(&self) -> impl Iterator<Item = &[f64]> {
        self.probabilities.chunks_exact(self.n)
    }
}
