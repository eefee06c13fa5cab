//! What an experiment found: a table, a chart, and whether a claim holds.

use super::stats::Summary;

/// A curve of a chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// in the legend
    pub name: String,
    /// (x, mean, deviation)
    pub points: Vec<(f64, f64, f64)>,
}

/// A chart of an experiment.
#[derive(Clone, Debug, PartialEq)]
pub enum Chart {
    /// one bar per row
    Bars(Vec<(String, f64)>),
    /// curves over a number
    Lines {
        /// what is drawn
        curves: Vec<Curve>,
        /// whether the y axis begins at 0
        from_zero: bool,
    },
    /// means with their 95 % intervals, before a line at 0
    Intervals(Vec<(String, Summary)>),
}

/// Whether what counts as reproduced came out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It did.
    Holds,
    /// It did not.
    Fails,
    /// There is no criterion.
    Reported,
    /// Something that it needs is not there.
    NotRun,
}

impl Outcome {
    /// As a word of a table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Holds => "holds",
            Self::Fails => "does not",
            Self::Reported => "reported",
            Self::NotRun => "not run",
        }
    }

    /// Of a criterion that was met, was not, or could not be looked at.
    pub fn of(met: Option<bool>) -> Self {
        match met {
            Some(true) => Self::Holds,
            Some(false) => Self::Fails,
            None => Self::Reported,
        }
    }
}

/// What an experiment found.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// name of the experiment
    pub id: &'static str,
    /// what it tests
    pub claim: &'static str,
    /// heads of the table; numbers begin with `>`
    pub head: Vec<&'static str>,
    /// its rows
    pub rows: Vec<Vec<String>>,
    /// title of the chart, label of its x axis
    pub chart_labels: [&'static str; 2],
    /// the chart
    pub chart: Chart,
    /// whether what counts as reproduced came out
    pub outcome: Outcome,
    /// the finding in words
    pub verdict: String,
}

impl Report {
    /// Of an experiment that could not run.
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
