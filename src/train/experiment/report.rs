//! Report of an experiment: a table, a chart, and whether a claim holds.

use super::stats::Summary;

/// A curve of a chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// label in the legend
    pub name: String,
    /// (x, mean, deviation)
    pub points: Vec<(f64, f64, f64)>,
}

/// A chart of an experiment.
#[derive(Clone, Debug, PartialEq)]
pub enum Chart {
    /// one bar per row
    Bars(Vec<(String, f64)>),
    /// curves over a numeric variable
    Lines {
        /// the curves
        curves: Vec<Curve>,
        /// whether the y axis begins at 0
        from_zero: bool,
    },
    /// means with their 95 % intervals, and a line at 0
    Intervals(Vec<(String, Summary)>),
}

/// Whether the criterion of reproduction is met.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It is met.
    Holds,
    /// It is not met.
    Fails,
    /// The experiment has no criterion.
    Reported,
    /// The experiment did not run because an input is missing.
    NotRun,
}

impl Outcome {
    /// The word used in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Holds => "holds",
            Self::Fails => "does not hold",
            Self::Reported => "reported",
            Self::NotRun => "not run",
        }
    }

    /// Outcome of a criterion that is met, not met, or could not be evaluated (`None`).
    pub fn of(met: Option<bool>) -> Self {
        match met {
            Some(true) => Self::Holds,
            Some(false) => Self::Fails,
            None => Self::Reported,
        }
    }
}

/// Report of an experiment.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// name of the experiment
    pub id: &'static str,
    /// what it tests
    pub claim: &'static str,
    /// column heads of the table; those of numeric columns begin with `>`
    pub head: Vec<&'static str>,
    /// rows of the table
    pub rows: Vec<Vec<String>>,
    /// title of the chart, label of its x axis
    pub chart_labels: [&'static str; 2],
    /// the chart
    pub chart: Chart,
    /// whether the criterion of reproduction is met
    pub outcome: Outcome,
    /// the finding in words
    pub verdict: String,
}

impl Report {
    /// Report of an experiment that could not run.
    pub fn not_run(id: &'static str, claim: &'static str, why: &str) -> Self {
        Self {
            id,
            claim,
            head: Vec::new(),
            rows: Vec::new(),
            chart_labels: ["", ""],
            chart: Chart::Bars(Vec::new()),
            outcome: Outcome::NotRun,
            verdict: format!("Not run: {why}."),
        }
    }
}
