//! The runs that each experiment compares.

use super::comparison::{Comparison, threshold};
use super::constants::{Constants, FOLDER};
use super::fit_run::{FitRun, Structure};
use super::report;
use super::setup::Setup;
use crate::Result;
use crate::experiment::{Cell, Experiment, Report, Values};
use crate::fit::training::Watch;
use lastlight_last::avatar::density::{Density, Mode};
use lastlight_last::avatar::progressive::{Cap, Keys, Order, Progressive};
use lastlight_last::avatar::settings::Settings;
use serde_json::Value;
use std::sync::atomic::AtomicBool;

/// Values of τ_rec in E5.
const THRESHOLDS: [f64; 10] = [1e-5, 5e-5, 1e-4, 5e-4, 1e-3, 2e-3, 3e-3, 5e-3, 1e-2, 5e-2];
/// Values of λ in E7.
const BOUNDS: [f64; 9] = [0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, f64::INFINITY];
/// Values of the weight of L_lat in E15.
const WEIGHTS: [f32; 2] = [0.01, 0.1];

/// Ids and claims of these experiments, also used for lists and for experiments that cannot run.
pub const CLAIMS: [(&str, &str); 11] = [
    ("E1", "The full system is better than its host in all metrics (Table 1)."),
    (
        "E2",
        "Table 2: without structure ≪ without progressive update or density adapter < full; the paper has no row with all components off.",
    ),
    (
        "E3",
        "A wrong structure reduces quality below the learned one and below all components off, as the paper's row without structure is below its host.",
    ),
    ("E5", "τ_rec in 0.001 … 0.005 gives the best quality; the number of Gaussians decreases with τ_rec."),
    (
        "E6",
        "At the same number of Gaussians, the latent criterion selects better positions than the pixel criterion.",
    ),
    (
        "E7",
        "λ = 0.1 is best, below 0.05 convergence is poor, and from 0.5 the error increases with the iterations.",
    ),
    ("E8", "The topological order matters: better than a random one with the same blocks and renders."),
    ("E9", "Fine-tuning A on the subject improves quality."),
    (
        "E13",
        "Updates from pixel losses only interfere between factors: with the progressive update the error of child factors increases less while parents change.",
    ),
    ("E14", "Computational cost; the paper reports no times."),
    (
        "E15",
        "Latent factors as supervision, as announced in the introduction: w_lat · L_lat in the loss of the host.",
    ),
];

/// An experiment with persons.
pub struct Persons<'a> {
    id: &'static str,
    claim: &'static str,
    setup: &'a Setup,
    list: Vec<(String, FitRun)>,
    comparison: Comparison,
}

impl Experiment for Persons<'_> {
    fn id(&self) -> &'static str {
        self.id
    }

    fn folder(&self) -> &'static str {
        FOLDER
    }

    fn cells(&self) -> Vec<Cell> {
        self.list.iter().map(|(row, run)| run.cell(self.setup, row)).collect()
    }

    fn settings(&self, cell: usize) -> Value {
        self.list[cell].1.record(self.setup)
    }

    fn run(&self, cell: usize, watch: &mut dyn Watch, _: &AtomicBool) -> Result<Values> {
        self.list[cell].1.run(self.setup, watch)
    }

    fn report(&self, results: &[(Cell, Values)]) -> Report {
        report::of(self.id, self.claim, &self.comparison, results)
    }
}

/// Builds the rows of an experiment.
struct Rows<'a> {
    setup: &'a Setup,
    constants: &'a Constants,
    list: Vec<(String, FitRun)>,
    /// Settings of the host without LAST.
    host: Settings,
    /// Settings of the full system.
    full: Settings,
}

impl<'a> Rows<'a> {
    fn new(setup: &'a Setup, constants: &'a Constants) -> Self {
        let (host, full) = (setup.size.baseline(), constants.full(setup, 0, 0));
        Self { setup, constants, list: Vec::new(), host, full }
    }

    /// Settings of the full system with a changed progressive update.
    fn with(&self, edit: impl Fn(&mut Progressive)) -> Settings {
        let mut p = self.constants.progressive();
        edit(&mut p);
        Settings { progressive: Some(p), ..self.full.clone() }
    }

    /// Adds a row: one run for each subject, with the given model.
    fn of(&mut self, model: usize, row: &str, structure: Structure, settings: &Settings) -> Result<()> {
        let renders = self.constants.renders(self.setup, model)?;
        for subject in 1..=self.setup.size.subjects {
            let settings = Settings { seed: subject, ..settings.clone() };
            let run = FitRun { model, subject, structure, settings, renders, factors: false };
            self.list.push((row.to_owned(), run));
        }
        Ok(())
    }

    /// Adds a row with the first model and its learned graph.
    fn row(&mut self, row: &str, settings: &Settings) -> Result<()> {
        self.of(0, row, Structure::Learned, settings)
    }

    /// E1: the full system and its host, for every model.
    fn systems(&mut self) -> Result<Comparison> {
        let mut graphs = Vec::new();
        let (setup, host) = (self.setup, self.host.clone());
        for (m, model) in setup.models.iter().enumerate() {
            self.of(m, &format!("{} host", model.graph), Structure::Learned, &host)?;
            let full = self.constants.full(setup, m, 0);
            self.of(m, &format!("{} LAST", model.graph), Structure::Learned, &full)?;
            graphs.push(model.graph.clone());
        }
        Ok(Comparison::Better { graphs })
    }

    /// E2: structure, density adapter and progressive update, each on and off.
    fn ablation(&mut self) -> Result<Comparison> {
        let (host, full) = (self.host.clone(), self.full.clone());
        for bits in (0..8).rev() {
            let [structure, density, progressive] = [bits & 4 != 0, bits & 2 != 0, bits & 1 != 0];
            let settings = Settings {
                density: if density { full.density.clone() } else { host.density.clone() },
                progressive: if progressive { full.progressive.clone() } else { None },
                ..full.clone()
            };
            let graph = if structure { Structure::Learned } else { Structure::Empty };
            self.of(0, &combination(structure, density, progressive), graph, &settings)?;
        }
        Ok(Comparison::Ablation)
    }

    /// E3: the full system with correct and wrong graphs.
    fn structures(&mut self) -> Result<Comparison> {
        let (host, full) = (self.host.clone(), self.full.clone());
        self.row("all off", &host)?;
        for graph in
            [Structure::Learned, Structure::True, Structure::Empty, Structure::Random, Structure::Reversed]
        {
            self.of(0, graph.name(), graph, &full)?;
        }
        Ok(Comparison::Structures)
    }

    /// E5: the latent criterion at several thresholds, and the pixel criterion.
    fn thresholds(&mut self) -> Result<Comparison> {
        let (host, full) = (self.host.clone(), self.full.clone());
        self.row("pixel", &Settings { density: host.density, ..full.clone() })?;
        let thresholds = self.setup.size.some(&THRESHOLDS);
        for tau in &thresholds {
            let density = Density { mode: Mode::Replace, latent_threshold: *tau, ..full.density.clone() };
            self.row(&threshold(*tau), &Settings { density, ..full.clone() })?;
        }
        Ok(Comparison::Thresholds(thresholds))
    }

    /// E6: both criteria at the same number of Gaussians.
    fn criteria(&mut self) -> Result<Comparison> {
        let (host, full) = (self.host.clone(), self.full.clone());
        self.row("pixel", &host)?;
        let density = Density { mode: Mode::Budget, ..full.density };
        self.row("budget", &Settings { density, ..host })?;
        Ok(Comparison::Pair(["budget", "pixel"]))
    }

    /// E7: every mode of λ at several values.
    fn bounds(&mut self) -> Result<Comparison> {
        let bounds = self.setup.size.some(&BOUNDS);
        for cap in [Cap::Relative, Cap::Absolute, Cap::Stop] {
            for lambda in &bounds {
                let settings = self.with(|p| (p.cap, p.lambda) = (cap, *lambda));
                self.row(&bound(cap, *lambda), &settings)?;
            }
        }
        Ok(Comparison::Bounds(bounds))
    }

    /// E8: orders of the update, and methods to choose key Gaussians.
    fn orders(&mut self) -> Result<Comparison> {
        for order in [Order::Topological, Order::Reverse, Order::Random, Order::None] {
            let settings = self.with(|p| p.order = order);
            self.row(&format!("order {}", order.name()), &settings)?;
        }
        for keys in [Keys::Random, Keys::All] {
            let settings = self.with(|p| p.keys = keys);
            self.row(&format!("keys {}", keys.name()), &settings)?;
        }
        Ok(Comparison::Pair(["order topo", "order random"]))
    }

    /// E9: the graph as learned and as tuned on the subject.
    fn tuning(&mut self) -> Result<Comparison> {
        let full = self.full.clone();
        self.row("not tuned", &full)?;
        self.of(0, "tuned", Structure::Tuned, &full)?;
        Ok(Comparison::Tuning)
    }

    /// E13: the errors of factors during the update.
    fn interference(&mut self) -> Result<Comparison> {
        let (host, full) = (self.host.clone(), self.full.clone());
        self.row("host", &host)?;
        self.row("LAST", &full)?;
        self.list.iter_mut().for_each(|(_, run)| run.factors = true);
        let graph = &self.setup.models[0].trained.graph;
        let children = (0..graph.n()).filter(|&j| graph.parents(j) != 0).collect();
        let begin = full.progressive.as_ref().map_or(0, |p| full.scaled(p.first));
        Ok(Comparison::Factors { children, begin })
    }

    /// E14: the time of each part.
    fn cost(&mut self) -> Result<Comparison> {
        let (host, full) = (self.host.clone(), self.full.clone());
        self.row("host", &host)?;
        self.row("density adapter", &Settings { density: full.density.clone(), ..host.clone() })?;
        self.row("progressive", &Settings { progressive: full.progressive.clone(), ..host })?;
        self.row("full", &full)?;
        Ok(Comparison::Cost)
    }

    /// E15: L_lat in the loss of the host.
    fn weights(&mut self) -> Result<Comparison> {
        let host = self.host.clone();
        self.row("w_lat 0", &host)?;
        for w in WEIGHTS {
            self.row(&format!("w_lat {w}"), &Settings { latent_weight: w, ..host.clone() })?;
        }
        Ok(Comparison::Weights(WEIGHTS.map(|w| format!("w_lat {w}")).to_vec()))
    }
}

/// Row name of a combination of components.
fn combination(structure: bool, density: bool, progressive: bool) -> String {
    let parts = [(structure, "structure"), (density, "density"), (progressive, "progressive")];
    let on: Vec<&str> = parts.iter().filter(|p| p.0).map(|p| p.1).collect();
    match on.len() {
        0 => "all off".into(),
        3 => "full".into(),
        _ => on.join(" + "),
    }
}

fn bound(cap: Cap, lambda: f64) -> String {
    format!("{} {lambda}", cap.name())
}

/// All experiments with the given constants.
///
/// # Errors
/// When a model's graph has a cycle.
pub fn all<'a>(setup: &'a Setup, constants: &Constants) -> Result<Vec<Persons<'a>>> {
    CLAIMS.iter().map(|&(id, claim)| make(id, claim, setup, constants)).collect()
}

fn make<'a>(
    id: &'static str,
    claim: &'static str,
    setup: &'a Setup,
    constants: &Constants,
) -> Result<Persons<'a>> {
    let mut rows = Rows::new(setup, constants);
    let comparison = match id {
        "E1" => rows.systems(),
        "E2" => rows.ablation(),
        "E3" => rows.structures(),
        "E5" => rows.thresholds(),
        "E6" => rows.criteria(),
        "E7" => rows.bounds(),
        "E8" => rows.orders(),
        "E9" => rows.tuning(),
        "E13" => rows.interference(),
        "E14" => rows.cost(),
        _ => rows.weights(),
    }?;
    Ok(Persons { id, claim, setup, list: rows.list, comparison })
}
