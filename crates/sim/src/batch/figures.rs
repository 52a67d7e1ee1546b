//! What a batch says: success with its confidence, and the distribution of each figure.

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::{Column, DRAWN, Manifest, Row};
use crate::scenario::Precision;

/// The trials of a variant, as far as they are summed up: values by columns, and no texts, so that a
/// million of them find room.
#[derive(Clone, Debug, Default)]
pub struct Trials {
    /// Of each column a value for each trial; NaN where it has none.
    pub values: Vec<Vec<f64>>,
    /// Whether each passed.
    pub passed: Vec<bool>,
    /// How many had each verdict, and failed for each reason.
    verdicts: BTreeMap<String, u64>,
    reasons: BTreeMap<String, u64>,
    first_failed: Option<u64>,
}

impl Trials {
    /// Room for those of a variant.
    pub(super) fn new(manifest: &Manifest) -> Trials {
        let room = manifest.trials as usize;
        let columns = manifest.columns.iter();
        Trials {
            values: columns.map(|_| Vec::with_capacity(room)).collect(),
            passed: Vec::with_capacity(room),
            ..Trials::default()
        }
    }

    /// Takes the next trial.
    pub(super) fn add(&mut self, row: &Row) {
        for (column, value) in self.values.iter_mut().zip(&row.values) {
            column.push(*value);
        }
        self.passed.push(row.verdict == PASSED);
        if row.verdict == "failed" {
            self.first_failed = self.first_failed.or(Some(row.trial));
        }
        count(&mut self.verdicts, &row.verdict);
        if ["failed", "invalid", "error"].contains(&row.verdict.as_str()) {
            count(&mut self.reasons, &kind_of(&row.reason));
        }
    }
}

/// Counts a name once more.
fn count(counts: &mut BTreeMap<String, u64>, name: &str) {
    match counts.get_mut(name) {
        Some(count) => *count += 1,
        None => drop(counts.insert(name.to_owned(), 1)),
    }
}

/// Share of trials that passed, with an interval: of such intervals 95 % hold the true share.
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
    /// Figure of the run that the scenario marks, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mark: Option<f64>,
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
    /// Precision of the numbers that its trials were computed with.
    #[serde(default)]
    pub precision: Precision,
    /// Number of trials of each variant.
    pub trials: u64,
    /// What each variant says; one without a name where there are none.
    pub variants: Vec<VariantSummary>,
}

/// What the trials of a variant say.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct VariantSummary {
    /// Name; empty where there are no variants.
    pub name: String,
    /// How many trials had each verdict.
    pub verdicts: BTreeMap<String, u64>,
    /// Share that passed; none without a task.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub success: Option<Success>,
    /// Reasons of failure without their numbers, the commonest first, with their counts.
    pub failures: Vec<(String, u64)>,
    /// The figures.
    pub figures: Vec<Figure>,
    /// How much drawn values have to do with the figures, the most first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub influences: Vec<Influence>,
    /// Figures of its trials less those of the same trials of the first variant.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub paired: Vec<Paired>,
}

/// Mean difference of a figure between the same trials of two variants.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Paired {
    /// Name of its column.
    pub figure: String,
    /// Mean.
    pub mean: f64,
    /// Half of the interval about it of which 95 % hold the true mean: 1.96 standard errors.
    pub error: f64,
    /// Number of trials that have it in both.
    pub count: u64,
}

/// How much a drawn value has to do with a figure.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Influence {
    /// Column of the drawn value.
    pub drawn: String,
    /// Column of the figure, or [`PASSED`].
    pub figure: String,
    /// Spearman's rank correlation, −1 to 1: of the ranks, so that any curve that rises counts as
    /// much as a straight one.
    pub correlation: f64,
}

/// Name of the figure that is 1 for a trial that passed and 0 for another.
pub const PASSED: &str = "passed";

/// A run of one trial, to be shown.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Picture {
    /// Which it is, such as `the quickest`.
    pub title: String,
    /// Place of its variant.
    pub variant: usize,
    /// Number of the trial.
    pub trial: u64,
    /// What became of it.
    pub reason: String,
    /// The arena with its path, as SVG.
    pub svg: String,
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
        mark: None,
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
        if !numeral || text.chars().last().is_some_and(char::is_alphanumeric) {
            text.push(c);
        } else if !text.ends_with('…') {
            text.push('…');
        }
        last = c;
    }
    text
}

/// Ranks of values from 0; equal ones share the mean of theirs.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let mut ranks = vec![0.0; values.len()];
    let mut from = 0;
    while from < order.len() {
        let same = |k: &usize| values[order[*k]] == values[order[from]];
        let to = (from..order.len()).take_while(same).count() + from;
        for &k in &order[from..to] {
            ranks[k] = 0.5 * (from + to - 1) as f64;
        }
        from = to;
    }
    ranks
}

/// Spearman's rank correlation of pairs; none where either does not vary.
pub(super) fn correlation(a: &[f64], b: &[f64]) -> Option<f64> {
    correlation_of_ranks(&ranks(a), &ranks(b))
}

fn correlation_of_ranks(a: &[f64], b: &[f64]) -> Option<f64> {
    let middle = 0.5 * (a.len().max(1) - 1) as f64;
    let sum = |a: &[f64], b: &[f64]| -> f64 {
        let pairs = a.iter().zip(b);
        pairs.map(|(a, b)| (a - middle) * (b - middle)).sum()
    };
    let size = (sum(a, a) * sum(b, b)).sqrt();
    (size > 0.0).then(|| sum(a, b) / size)
}

/// Values of a column that there is; of [`PASSED`] what its name says.
fn column<'a>(manifest: &Manifest, trials: &'a Trials, name: &str) -> Cow<'a, [f64]> {
    let place = manifest.columns.iter().position(|known| known.name == name);
    match place {
        Some(place) => Cow::Borrowed(&trials.values[place]),
        None => {
            let passed = trials.passed.iter();
            Cow::Owned(passed.map(|&passed| f64::from(u8::from(passed))).collect())
        }
    }
}

/// Columns of the time that a robot took, s.
fn times<'a>(manifest: &Manifest, trials: &'a Trials) -> Vec<&'a [f64]> {
    let is_time = |name: &str| name == "time" || name.ends_with(": time");
    let columns = manifest.columns.iter().zip(&trials.values);
    let times = columns.filter(|(column, _)| is_time(&column.name));
    times.map(|(_, values)| values.as_slice()).collect()
}

fn influences(manifest: &Manifest, trials: &Trials) -> Vec<Influence> {
    let (drawn, mut figures): (Vec<&str>, Vec<&str>) = (
        (manifest.columns.iter().filter(|c| c.group == DRAWN))
            .map(|c| c.name.as_str())
            .collect(),
        (manifest.columns.iter().filter(|c| c.group != DRAWN))
            .map(|c| c.name.as_str())
            .collect(),
    );
    if manifest.has_task && !figures.contains(&PASSED) {
        figures.insert(0, PASSED);
    }
    let is_whole = |values: &[f64]| values.iter().all(|value| value.is_finite());
    let of_drawn = drawn.iter().map(|drawn| {
        let values = column(manifest, trials, drawn);
        let ranks = is_whole(&values).then(|| ranks(&values));
        (values, ranks)
    });
    let of_drawn: Vec<_> = of_drawn.collect();
    // Sorting is most of the work: each column is sorted once where no trial lacks it.
    let mut found = Vec::new();
    for (f, figure) in figures.iter().enumerate() {
        let others = column(manifest, trials, figure);
        let of_figure = is_whole(&others).then(|| ranks(&others));
        for (d, (values, of_values)) in of_drawn.iter().enumerate() {
            let correlation = match (of_values, &of_figure) {
                (Some(a), Some(b)) => correlation_of_ranks(a, b),
                _ => {
                    let both = values.iter().zip(others.iter());
                    let both = both.filter(|(a, b)| a.is_finite() && b.is_finite());
                    let (a, b): (Vec<f64>, Vec<f64>) = both.unzip();
                    correlation(&a, &b)
                }
            };
            if let Some(correlation) = correlation {
                let influence = Influence {
                    drawn: drawn[d].into(),
                    figure: (*figure).into(),
                    correlation,
                };
                found.push(((d, f), influence));
            }
        }
    }
    found.sort_by(|(at, a), (place, b)| {
        let by_size = b.correlation.abs().total_cmp(&a.correlation.abs());
        by_size.then(at.cmp(place))
    });
    found.into_iter().map(|(_, influence)| influence).collect()
}

/// Differences of the figures of trials to those of the same trials of another variant.
fn paired(manifest: &Manifest, trials: &Trials, others: &Trials) -> Vec<Paired> {
    let columns = manifest.columns.iter().enumerate();
    let figures = columns.filter(|(_, column)| column.group != DRAWN);
    let difference = |(k, column): (usize, &Column)| {
        let pairs = trials.values[k].iter().zip(&others.values[k]);
        let apart = pairs.map(|(a, b)| a - b);
        let apart: Vec<f64> = apart.filter(|value| value.is_finite()).collect();
        let count = apart.len() as f64;
        let mean = apart.iter().sum::<f64>() / count.max(1.0);
        let squares: f64 = apart.iter().map(|v| (v - mean) * (v - mean)).sum();
        let deviation = (squares / (count - 1.0).max(1.0)).sqrt();
        (apart.len() > 1).then(|| Paired {
            figure: column.name.clone(),
            mean,
            error: Z * deviation / count.sqrt(),
            count: apart.len() as u64,
        })
    };
    figures.filter_map(difference).collect()
}

/// Sums the trials of each variant up.
pub(super) fn sum_up(manifest: &Manifest, trials: &[Trials], root: String) -> BatchSummary {
    let variants = manifest.variants.iter().zip(trials).enumerate();
    let variants = variants.map(|(k, (name, own))| {
        let mut summary = sum_up_variant(manifest, own, name);
        if k > 0 {
            summary.paired = paired(manifest, own, &trials[0]);
        }
        summary
    });
    BatchSummary {
        scenario: manifest.scenario.clone(),
        title: manifest.title.clone(),
        hash: manifest.hash.clone(),
        root,
        seed: manifest.seed,
        version: manifest.version.clone(),
        precision: manifest.precision,
        trials: manifest.trials,
        variants: variants.collect(),
    }
}

fn sum_up_variant(manifest: &Manifest, trials: &Trials, name: &str) -> VariantSummary {
    let mut failures: Vec<(String, u64)> = trials.reasons.clone().into_iter().collect();
    failures.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let passed = trials.verdicts.get(PASSED).copied().unwrap_or(0);
    let columns = manifest.columns.iter().zip(&trials.values);
    let figures = columns.filter_map(|(column, values)| {
        let figure = figure(&column.name, &column.unit, &column.group, values.clone())?;
        let mark = manifest.marks.get(&column.name).copied();
        Some(Figure { mark, ..figure })
    });
    VariantSummary {
        name: name.to_owned(),
        verdicts: trials.verdicts.clone(),
        success: (manifest.has_task).then(|| Success::of(passed, trials.passed.len() as u64)),
        failures,
        figures: figures.collect(),
        influences: influences(manifest, trials),
        paired: Vec::new(),
    }
}

/// Trials worth a look, with what they are: the quickest, the median and the slowest of those that
/// passed, and the first that failed, of a variant.
pub fn telling(manifest: &Manifest, trials: &Trials) -> Vec<(&'static str, u64)> {
    let times = times(manifest, trials);
    // That of the last robot.
    let time = |trial: usize| times.iter().map(|of| of[trial]).fold(0.0, f64::max);
    let all = trials.passed.iter().enumerate();
    let mut passed: Vec<(f64, u64)> = all
        .filter(|(_, passed)| **passed)
        .map(|(trial, _)| (time(trial), trial as u64))
        .collect();
    passed.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut found: Vec<(&'static str, u64)> = Vec::new();
    if let (Some(first), Some(last)) = (passed.first(), passed.last()) {
        found.push(("the quickest", first.1));
        if passed.len() > 2 {
            found.push(("the median by time", passed[passed.len() / 2].1));
        }
        if passed.len() > 1 {
            found.push(("the slowest that passed", last.1));
        }
    }
    if let Some(trial) = trials.first_failed {
        found.push(("the first that failed", trial));
    }
    found
}

/// Influences that are drawn as points, and points of each.
const SCATTERS: usize = 9;
const POINTS: usize = 600;

/// What the report of a batch is drawn from.
pub fn report(
    manifest: &Manifest,
    summary: &BatchSummary,
    trials: &[Trials],
    pictures: &[Picture],
) -> Value {
    let marks: BTreeMap<&String, Value> = manifest
        .marks
        .iter()
        .map(|(name, mark)| {
            let (mut known, mut below) = (0, 0);
            for own in trials {
                let values = column(manifest, own, name);
                known += values.iter().filter(|value| value.is_finite()).count();
                below += values.iter().filter(|value| *value < mark).count();
            }
            let share = below as f64 / known.max(1) as f64;
            (name, json!({"value": mark, "below": share}))
        })
        .collect();
    let variants = summary.variants.iter().zip(trials);
    let scatters: Vec<Value> = variants
        .map(|(variant, trials)| scatters(manifest, variant, trials))
        .collect();
    json!({
        "summary": summary,
        "marks": marks,
        "marked": manifest.marked,
        "drawn": DRAWN,
        "text": manifest.text,
        "scatters": scatters,
        "pictures": pictures,
    })
}

/// Clouds of points of what drawn values move most.
fn scatters(manifest: &Manifest, summary: &VariantSummary, trials: &Trials) -> Value {
    let every = trials.passed.len().div_ceil(POINTS).max(1);
    let scatter = |influence: &Influence| {
        let [x, y] = [&influence.drawn, &influence.figure].map(|name| {
            let values = column(manifest, trials, name);
            let values = values.iter().step_by(every);
            values
                .map(|value| value.is_finite().then_some(*value))
                .collect::<Vec<_>>()
        });
        let passed: Vec<&bool> = trials.passed.iter().step_by(every).collect();
        json!({"influence": influence, "x": x, "y": y, "passed": passed})
    };
    summary
        .influences
        .iter()
        .take(SCATTERS)
        .map(scatter)
        .collect()
}
