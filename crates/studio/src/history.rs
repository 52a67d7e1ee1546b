//! What a line has driven so far: rows, events and its end, kept in columns that can be looked at coarsely.

use std::ops::Range;

use appell_sim::record::{Closing, Event, Header, RecordError, Recorder, Recording};
use appell_sim::report::friction_used;
use appell_sim::signal::Signal;
use rustfft::FftPlanner;

use crate::spectrum;

/// Rows of a block, of which the least and the largest value are kept.
const BLOCK: usize = 64;

/// Most numbers of a history: 1 GiB.
pub const NUMBERS_MAX: usize = 1 << 27;

/// Values of one signal, with the least and largest of each whole block.
#[derive(Default)]
struct Column {
    values: Vec<f64>,
    blocks: Vec<[f64; 2]>,
}

impl Column {
    fn push(&mut self, value: f64) {
        self.values.push(value);
        if self.values.len().is_multiple_of(BLOCK) {
            let block = &self.values[self.values.len() - BLOCK..];
            self.blocks.push(extremes(block));
        }
    }

    /// Least and largest value of some rows, at least one.
    fn extremes(&self, rows: Range<usize>) -> [f64; 2] {
        let (first, last) = (rows.start.div_ceil(BLOCK), rows.end / BLOCK);
        if first >= last {
            return extremes(&self.values[rows]);
        }
        let ends = [
            &self.values[rows.start..first * BLOCK],
            &self.values[last * BLOCK..rows.end],
        ];
        let blocks = self.blocks[first..last].iter().copied();
        blocks
            .chain(ends.map(extremes))
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [l, h]| {
                [low.min(l), high.max(h)]
            })
    }
}

fn extremes(values: &[f64]) -> [f64; 2] {
    values
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
            [low.min(*value), high.max(*value)]
        })
}

/// A signal that follows from others in the same row.
struct FrictionUsed {
    along: usize,
    across: usize,
    load: usize,
    friction: f64,
}

/// Rows and events of a line.
pub struct History {
    /// What was run.
    pub header: Header,
    /// One for each column: those recorded, then those that follow from them.
    pub signals: Vec<Signal>,
    /// Columns that pictures are drawn from.
    pub drawn: Vec<usize>,
    /// Times of the rows, s.
    pub times: Vec<f64>,
    /// Events, each with the number of rows before it.
    pub events: Vec<(usize, Event)>,
    columns: Vec<Column>,
    derived: Vec<FrictionUsed>,
}

/// A piece of history, as coarse as asked for.
pub struct Series {
    /// Times, s.
    pub times: Vec<f64>,
    /// Values of each signal asked for.
    pub columns: Vec<Vec<f32>>,
}

impl History {
    /// An empty one.
    pub fn new(header: &Header) -> Self {
        let mut signals = header.signals.clone();
        let mut derived = Vec::new();
        if let Some(friction) = header.extra["arena"]["friction"].as_f64() {
            let column = |path: &str| header.signals.iter().position(|one| one.path == path);
            for signal in &header.signals {
                let Some(wheel) = signal.path.strip_suffix(".force.longitudinal") else {
                    continue;
                };
                let of = [".force.longitudinal", ".force.lateral", ".load"]
                    .map(|end| column(&format!("{wheel}{end}")));
                if let [Some(along), Some(across), Some(load)] = of {
                    signals.push(Signal::new(format!("{wheel}.friction_used"), "%"));
                    derived.push(FrictionUsed {
                        along,
                        across,
                        load,
                        friction,
                    });
                }
            }
        }
        let is_drawn = |path: &str| {
            let body = [
                ".pose.x",
                ".pose.y",
                ".pose.yaw",
                ".pose.z",
                ".pose.roll",
                ".pose.pitch",
                ".twist.forward",
                ".twist.left",
                ".twist.yaw_rate",
            ];
            let wheel = [
                ".spin_angle",
                ".steering_angle",
                ".force.longitudinal",
                ".force.lateral",
                ".load",
            ];
            let is_wheel = path.contains(".wheel.") || path.contains(".trailer.");
            let ends = |of: &[&str]| of.iter().any(|end| path.ends_with(end));
            !path.contains(".sensor.") && (ends(&body) || is_wheel && ends(&wheel))
        };
        let drawn = (0..signals.len()).filter(|&k| is_drawn(&signals[k].path));
        History {
            header: header.clone(),
            drawn: drawn.collect(),
            columns: signals.iter().map(|_| Column::default()).collect(),
            signals,
            times: Vec::new(),
            events: Vec::new(),
            derived,
        }
    }

    /// That of a recording.
    pub fn of(recording: &Recording) -> Self {
        let mut history = History::new(&recording.header);
        let mut events = recording.events.iter().peekable();
        let mut row = vec![0.0; recording.columns.len()];
        for (k, &t) in recording.times.iter().enumerate() {
            while let Some(event) = events.next_if(|event| event.t < t) {
                history.events.push((k, event.clone()));
            }
            for (value, column) in row.iter_mut().zip(&recording.columns) {
                *value = column[k];
            }
            history.push(t, &row);
        }
        let rows = history.times.len();
        history.events.extend(events.map(|e| (rows, e.clone())));
        history
    }

    fn push(&mut self, t: f64, row: &[f64]) {
        self.times.push(t);
        let (recorded, derived) = self.columns.split_at_mut(row.len());
        for (column, value) in recorded.iter_mut().zip(row) {
            column.push(*value);
        }
        for (column, of) in derived.iter_mut().zip(&self.derived) {
            let used = friction_used(row[of.along], row[of.across], row[of.load], of.friction);
            column.push(used);
        }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.times.len()
    }

    /// Whether there is no room for another row.
    pub fn is_full(&self) -> bool {
        (self.rows() + 1) * self.signals.len() > NUMBERS_MAX
    }

    /// The value in a row of a column.
    pub fn value(&self, row: usize, column: usize) -> f64 {
        self.columns[column].values[row]
    }

    /// Column of a path.
    pub fn column(&self, path: &str) -> Option<usize> {
        self.signals.iter().position(|signal| signal.path == path)
    }

    /// Some signals between two times, s, for a picture so many points wide: all rows where there are few, else
    /// the least and the largest value of each point, in the order in which the first of them came. A row more
    /// at each end lets lines leave the picture. Paths that are not known give NaN.
    pub fn series(&self, paths: &[String], from: f64, to: f64, points: usize) -> Series {
        let columns: Vec<Option<usize>> = paths.iter().map(|path| self.column(path)).collect();
        let first = self.times.partition_point(|t| *t < from).saturating_sub(1);
        let end = (self.times.partition_point(|t| *t <= to) + 1).min(self.rows());
        let rows = first..end.max(first);
        if rows.len() <= 2 * points.max(1) {
            let values = |column: &Option<usize>| match column {
                Some(k) => rows.clone().map(|row| self.value(row, *k) as f32).collect(),
                None => vec![f32::NAN; rows.len()],
            };
            return Series {
                times: self.times[rows.clone()].to_vec(),
                columns: columns.iter().map(values).collect(),
            };
        }
        let points = points.max(1);
        let edge = |k: usize| rows.start + rows.len() * k / points;
        let mut series = Series {
            times: Vec::with_capacity(2 * points),
            columns: columns.iter().map(|_| Vec::new()).collect(),
        };
        for k in 0..points {
            let part = edge(k)..edge(k + 1);
            series.times.push(self.times[part.start]);
            series.times.push(self.times[part.end - 1]);
            for (found, column) in series.columns.iter_mut().zip(&columns) {
                let Some(column) = *column else {
                    found.extend([f32::NAN; 2]);
                    continue;
                };
                let [low, high] = self.columns[column].extremes(part.clone());
                let rises = self.value(part.start, column) <= self.value(part.end - 1, column);
                let pair = if rises { [low, high] } else { [high, low] };
                found.extend(pair.map(|value| value as f32));
            }
        }
        series
    }

    /// Amplitudes by frequency, in the place of times, Hz, of some signals between two times, s, in at most so
    /// many bands, each with its largest; of the newest rows where there are too many.
    pub fn spectrum(&self, paths: &[String], from: f64, to: f64, bands: usize) -> Series {
        let first = self.times.partition_point(|t| *t < from);
        let mut end = self.times.partition_point(|t| *t <= to).max(first);
        // The last row of a run may lie between two others.
        let period = self.header.period;
        while end >= first + 2 && self.times[end - 1] - self.times[end - 2] < 0.999 * period {
            end -= 1;
        }
        if period.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
            // Without a rate there are no frequencies.
            end = first;
        }
        let rows = first.max(end.saturating_sub(spectrum::ROWS_MAX))..end;
        let mut planner = FftPlanner::new();
        let mut columns = Vec::new();
        for path in paths {
            let values = self
                .column(path)
                .map(|k| &self.columns[k].values[rows.clone()]);
            let found = spectrum::amplitudes(&mut planner, values.unwrap_or(&[]));
            let found = spectrum::thinned(&found, bands);
            columns.push(
                found
                    .iter()
                    .map(|value| *value as f32)
                    .collect::<Vec<f32>>(),
            );
        }
        let count = columns.iter().map(Vec::len).max().unwrap_or(0);
        for column in &mut columns {
            column.resize(count, f32::NAN);
        }
        // Bands are of one width up to half the rate of rows.
        let highest = 0.5 / period * (rows.len() / 2 * 2) as f64 / rows.len().max(1) as f64;
        let frequency = |k: usize| (k + 1) as f64 * highest / count as f64;
        Series {
            times: (0..count).map(frequency).collect(),
            columns,
        }
    }

    /// Writes all of it, as it came, to a recorder.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn replay(
        &self,
        recorder: &mut dyn Recorder,
        summary: &serde_json::Value,
    ) -> Result<(), RecordError> {
        recorder.begin(&self.header)?;
        let mut row = vec![0.0; self.header.signals.len()];
        let mut events = self.events.iter().peekable();
        for k in 0..=self.rows() {
            while let Some((_, event)) = events.next_if(|(before, _)| *before <= k) {
                recorder.event(event)?;
            }
            if k < self.rows() {
                for (value, column) in row.iter_mut().zip(&self.columns) {
                    *value = column.values[k];
                }
                recorder.frame(self.times[k], &row)?;
            }
        }
        recorder.finish(&|| summary.clone())
    }
}

impl Recorder for History {
    fn begin(&mut self, _header: &Header) -> Result<(), RecordError> {
        Ok(())
    }

    fn frame(&mut self, t: f64, row: &[f64]) -> Result<(), RecordError> {
        self.push(t, row);
        Ok(())
    }

    fn event(&mut self, event: &Event) -> Result<(), RecordError> {
        self.events.push((self.rows(), event.clone()));
        Ok(())
    }

    fn finish(&mut self, _summary: Closing<'_>) -> Result<(), RecordError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use appell_model::scalar::Scalar;

    fn history(rows: usize) -> History {
        let header = Header {
            signals: vec![Signal::new("a", "m"), Signal::new("b", "m")],
            ..Header::default()
        };
        let mut history = History::new(&header);
        for k in 0..rows {
            let noise = ((k * 7919) % 1000) as f64 / 1000.0;
            let row = [if k == 54_321 { 50.0 } else { noise }, k as f64];
            history.frame(k as f64 * 0.01, &row).expect("keeps");
        }
        history
    }

    /// What is drawn has the same highest and lowest values as all rows, however coarse it is.
    #[test]
    fn invariant_coarse_series_keep_every_peak() {
        let history = history(100_003);
        let paths = ["a".to_owned(), "b".to_owned(), "none".to_owned()];
        for points in [1, 7, 100, 999, 60_000] {
            let series = history.series(&paths, 0.0, 1e9, points);
            assert!(series.times.len() <= (2 * points).max(100_003));
            assert!(series.times.is_sorted());
            let peak = series.columns[0].iter().fold(0.0_f32, |a, b| a.max(*b));
            assert_eq!(peak, 50.0);
            assert_eq!(series.columns[1].last(), Some(&100_002.0));
            assert_eq!(series.columns[1][0], 0.0);
            assert!(series.columns[2].iter().all(|value| value.is_nan()));
        }
        // Block by block or row by row.
        for rows in [0..1, 0..64, 63..65, 10..1000, 64..128, 100_000..100_003] {
            let column = &history.columns[0];
            assert_eq!(
                column.extremes(rows.clone()),
                extremes(&column.values[rows])
            );
        }
    }

    /// A sine that is sampled at 100 Hz is found at its frequency, also after a last row off the grid.
    #[test]
    fn closed_form_spectrum_of_a_sine() {
        let header = Header {
            signals: vec![Signal::new("a", "m")],
            period: 0.01,
            ..Header::default()
        };
        let mut history = History::new(&header);
        for k in 0..1000 {
            let t = k as f64 * 0.01;
            let angle = core::f64::consts::TAU * 7.5 * t;
            history
                .frame(t, &[2.0 * <f64 as Scalar>::sin_cos(angle).0])
                .expect("keeps");
        }
        history.frame(9.993, &[9.0]).expect("keeps");
        let paths = ["a".to_owned(), "none".to_owned()];
        let found = history.spectrum(&paths, 0.0, 99.0, 4096);
        assert_eq!(found.times.len(), 500);
        assert!((found.times[499] - 50.0).abs() < 1e-9);
        let peak = (0..500).max_by(|a, b| found.columns[0][*a].total_cmp(&found.columns[0][*b]));
        let peak = peak.expect("some");
        assert!(
            (found.times[peak] - 7.5).abs() < 1e-9,
            "{}",
            found.times[peak]
        );
        assert!((found.columns[0][peak] - 2.0).abs() < 1e-6);
        assert!(found.columns[1].iter().all(|value| value.is_nan()));
        assert_eq!(history.spectrum(&paths, 0.0, 99.0, 20).times.len(), 20);
        assert!(history.spectrum(&paths, 3.0, 3.0, 20).times.is_empty());
    }

    #[test]
    fn known_answer_of_a_window() {
        let history = history(1000);
        let series = history.series(&["b".to_owned()], 2.0, 3.0, 500);
        // One row more on each side.
        assert_eq!(series.columns[0].len(), 103);
        assert_eq!(series.columns[0][0], 199.0);
        assert_eq!(history.series(&[], 50.0, 60.0, 10).times, [9.99]);
        assert!(self::history(0).series(&[], 0.0, 1.0, 10).times.is_empty());
    }
}
