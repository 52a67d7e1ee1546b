//! What a batch says: success with its confidence, and the distribution of each figure.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::{Batch, DRAWN, Row};

/// Share of trials that passed, with the interval that holds the true share with 95 %.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct Success {
    /// Share of all trials.
    pub share: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// Distribution of one figure over the trials that have it.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Figure {
    /// Name of its column.
    pub name: String,
    /// Unit; empty for pure numbers.
    pub unit: String,
    /// What it belongs to: a robot, a table of statistics, or `drawn`.
    pub group: String,
    /// Number of trials that have it.
    pub count: u64,
    /// Mean.
    pub mean: f64,
    /// Standard deviation (divided by the count less one).
    pub std: f64,
    /// Smallest value; then those below which 5, 25, 50, 75 and 95 % lie; the largest.
    pub quantiles: [f64; 7],
    /// How many trials lie in each of [`BINS`] equal intervals from the smallest to the largest.
    pub bins: Vec<u64>,
}

/// Intervals of a histogram.
pub const BINS: usize = 40;

/// `batch.json`.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct BatchSummary {
    /// Name of the scenario.
    pub scenario: String,
    /// Title of the scenario.
    pub title: String,
    /// SHA-256 of all that the rows follow from.
    pub hash: String,
    /// Root of the hash tree over the rows.
    pub root: String,
    /// Seed.
    pub seed: u64,
    /// Version of the program.
    pub version: String,
    /// Number of trials.
    pub trials: u64,
    /// How many trials had each verdict.
    pub verdicts: BTreeMap<String, u64>,
    /// Share that passed; none without a task.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub success: Option<Success>,
    /// Reasons of failure without their numbers, the commonest first, with their counts.
    pub failures: Vec<(String, u64)>,
    /// The figures.
    pub figures: Vec<Figure>,
}

/// 97.5 % quantile of the normal distribution.
const Z: f64 = 1.959_963_984_540_054;

impl Success {
    /// E. B. Wilson's interval (1927): it stays within [0, 1] and is right near its ends.
    pub fn of(passed: u64, trials: u64) -> Success {
        let (n, share) = (trials as f64, passed as f64 / trials as f64);
        let center = share + Z * Z / (2.0 * n);
        let spread = Z * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt();
        let scale = 1.0 / (1.0 + Z * Z / n);
        Success {
            share,
            low: (scale * (center - spread)).max(0.0),
            high: (scale * (center + spread)).min(1.0),
        }
    }
}

/// Quantile p of sorted values, between neighbors in proportion.
fn quantile(sorted: &[f64], p: f64) -> f64 {
    let place = p * (sorted.len() - 1) as f64;
    let k = place as usize;
    let next = (k + 1).min(sorted.len() - 1);
    sorted[k] + (place - k as f64) * (sorted[next] - sorted[k])
}

fn figure(name: &str, unit: &str, group: &str, mut values: Vec<f64>) -> Option<Figure> {
    values.retain(|value| value.is_finite());
    if values.is_empty() {
        return None;
    }
    values.sort_by(f64::total_cmp);
    let count = values.len();
    // About the first value: equal ones have exactly their mean.
    let first = values[0];
    let mean = first + values.iter().map(|v| v - first).sum::<f64>() / count as f64;
    let squares: f64 = values.iter().map(|v| (v - mean) * (v - mean)).sum();
    let (low, high) = (values[0], values[count - 1]);
    let mut bins = vec![0; BINS];
    if high > low {
        for value in &values {
            let k = ((value - low) / (high - low) * BINS as f64) as usize;
            bins[k.min(BINS - 1)] += 1;
        }
    }
    Some(Figure {
        name: name.into(),
        unit: unit.into(),
        group: group.into(),
        count: count as u64,
        mean,
        std: (squares / (count.max(2) - 1) as f64).sqrt(),
        quantiles: [0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0].map(|p| quantile(&values, p)),
        bins,
    })
}

/// A reason without its numbers, so that reasons can be counted.
fn kind_of(reason: &str) -> String {
    let end = reason.find(" at t = ").unwrap_or(reason.len());
    let mut text = String::new();
    let mut last = ' ';
    for c in reason[..end].chars() {
        // A digit within a name, such as b1, is none of the numbers.
        let numeral = c.is_ascii_digit() || (c == '.' && last.is_ascii_digit());
        if !numeral || text.chars().last().is_some_and(char::is_alphabetic) {
            text.push(c);
        } else if !text.ends_with('…') {
            text.push('…');
        }
        last = c;
    }
    text
}

pub(super) fn sum_up(batch: &Batch, rows: &[Row], root: String) -> BatchSummary {
    let scenario = &batch.loaded.scenario;
    let mut verdicts: BTreeMap<String, u64> = BTreeMap::new();
    let mut reasons: BTreeMap<String, u64> = BTreeMap::new();
    for row in rows {
        *verdicts.entry(row.verdict.clone()).or_default() += 1;
        if row.verdict == "failed" || row.verdict == "invalid" {
            *reasons.entry(kind_of(&row.reason)).or_default() += 1;
        }
    }
    let mut failures: Vec<(String, u64)> = reasons.into_iter().collect();
    failures.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let has_task = scenario.robot.iter().any(|robot| robot.task.is_some());
    let passed = verdicts.get("passed").copied().unwrap_or(0);
    let figures = batch.columns.iter().enumerate().filter_map(|(k, column)| {
        let values = rows.iter().map(|row| row.values[k]).collect();
        figure(&column.name, &column.unit, &column.group, values)
    });
    BatchSummary {
        scenario: scenario.name.clone(),
        title: scenario.title.clone(),
        hash: batch.hash.clone(),
        root,
        seed: scenario.seed,
        version: env!("CARGO_PKG_VERSION").into(),
        trials: rows.len() as u64,
        verdicts,
        success: has_task.then(|| Success::of(passed, rows.len() as u64)),
        failures,
        figures: figures.collect(),
    }
}

/// What the report of a batch is drawn from; `marks` by the names of figures.
pub fn report(batch: &Batch, summary: &BatchSummary, marks: &BTreeMap<String, f64>) -> Value {
    let plan = batch.loaded.scenario.batch.as_ref();
    let marked = plan.and_then(|batch| batch.mark.clone());
    let marks: BTreeMap<&String, f64> = marks
        .iter()
        .filter(|(_, value)| value.is_finite())
        .map(|(name, value)| (name, *value))
        .collect();
    json!({
        "summary": summary,
        "marks": marks,
        "marked": marked,
        "drawn": DRAWN,
        "text": batch.loaded.resolved,
    })
}
