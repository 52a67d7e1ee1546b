//! A batch that is looked at: the figures of its trials, each of which can be driven again.

use std::path::Path;
use std::sync::Arc;

use appell_sim::batch::{self, Batch, BatchError, Store, Trials};
use serde_json::{Value, json};

use super::command::Refusal;
use super::line::Kind;
use super::{Studio, Undo};

/// Most numbers that a page is sent; of more trials some are left out evenly.
const NUMBERS_MAX: usize = 1 << 20;
/// Trials, and branches of them, that are shown beside each other.
const TRIALS_SHOWN: usize = 4;

/// A folder that `appell batch` has written.
pub(super) struct Opened {
    batch: Batch,
    /// Its figures, as JSON.
    pub text: Arc<str>,
}

impl From<BatchError> for Refusal {
    fn from(error: BatchError) -> Self {
        match error {
            BatchError::Scenario(diagnostics) => diagnostics.into(),
            BatchError::Folder {
                path,
                problem,
                hint,
            } => Refusal::new(format!("{}: {problem}", path.display()), hint),
        }
    }
}

/// The folder of a batch: one that is named, or that of the rows that are.
pub(super) fn folder_of(file: &Path) -> Option<&Path> {
    if file.is_dir() {
        return Some(file);
    }
    let trials = file.parent()?;
    let is_rows = file.extension()? == "parquet" && trials.file_name()? == "trials";
    let folder = trials.parent()?;
    (is_rows && folder.join("batch.manifest").is_file()).then_some(folder)
}

impl Opened {
    /// Reads a folder.
    pub fn read(folder: &Path) -> Result<Opened, Refusal> {
        let store = Store::existing(folder)?;
        let (_, trials) = batch::sum_up(&store)?;
        let batch = Batch::new(&folder.join("scenario.toml"), &[], None, &[], None)?;
        let manifest = store.manifest();
        let own = batch.manifest();
        if (own.seed, own.trials, &own.variants)
            != (manifest.seed, manifest.trials, &manifest.variants)
            || own.columns.len() < manifest.columns.len()
        {
            return Err(Refusal::new(
                format!(
                    "{}: its scenario.toml is another batch's than its trials",
                    folder.display()
                ),
                "run the batch again",
            ));
        }
        let columns = manifest.columns.len().max(1);
        let every = (trials.iter().map(|of| of.passed.len()).sum::<usize>() * columns)
            .div_ceil(NUMBERS_MAX)
            .max(1);
        let of_variant = |(k, trials): (usize, &Trials)| -> Value {
            let kept = (0..trials.passed.len()).step_by(every);
            let values = trials.values.iter().map(|column| {
                let kept = kept.clone().map(|k| column[k]);
                // JSON knows no NaN: null.
                kept.collect::<Vec<f64>>()
            });
            json!({
                "name": manifest.variants[k],
                "trials": kept.clone().collect::<Vec<usize>>(),
                "passed": kept.clone().map(|k| trials.passed[k]).collect::<Vec<bool>>(),
                "values": values.collect::<Vec<_>>(),
                "count": trials.passed.len(),
                "passes": trials.passed.iter().filter(|passed| **passed).count(),
            })
        };
        let text = json!({
            "scenario": manifest.scenario,
            "title": manifest.title,
            "seed": manifest.seed,
            "has_task": manifest.has_task,
            "columns": manifest.columns,
            "every": every,
            "variants": trials.iter().enumerate().map(of_variant).collect::<Vec<_>>(),
        });
        Ok(Opened {
            batch,
            text: text.to_string().into(),
        })
    }
}

impl Studio {
    /// Drives a trial of the batch again, to its end, as a line of its own.
    pub(super) fn replay(&mut self, variant: &str, trial: u64) -> Result<(), Refusal> {
        let Some(opened) = &self.batch else {
            return Err(Refusal::new(
                "no batch is open",
                "`appell studio FOLDER` opens one",
            ));
        };
        let manifest = opened.batch.manifest();
        let place = manifest.variants.iter().position(|known| known == variant);
        let place = match (place, variant) {
            (None, "") => Some(0),
            (place, _) => place,
        };
        let Some(place) = place.filter(|_| trial < manifest.trials) else {
            return Err(Refusal::new(
                format!(
                    "must be one of the {} trials of a variant, got {trial} of {variant:?}",
                    manifest.trials
                ),
                manifest.variants.join(", "),
            ));
        };
        let mut scenario = opened.batch.scenario(place, trial)?.scenario;
        // What was drawn for it stands in the scenario; its noise goes by its number.
        (scenario.batch, scenario.trial) = (None, trial);
        let what = match manifest.variants[place].as_str() {
            "" => "of the batch".to_owned(),
            name => name.to_owned(),
        };
        let name = format!("trial {trial}");
        let loaded = self.reload(&scenario, &[])?;
        let mut line = self.begin(loaded, name, what, Kind::Driven)?;
        line.drive_to(u64::MAX);
        self.ghosts.clear();
        self.lines
            .retain(|line| !matches!(line.kind, Kind::Ghost(_)));
        self.active = line.id;
        // The line of the scenario alone goes when the first trial comes.
        self.lines.retain(|one| one.name != "A");
        self.lines.push(line);
        if self.lines.len() > TRIALS_SHOWN {
            self.lines.remove(0);
        }
        (self.undo, self.redo) = (Vec::<Undo>::new(), Vec::new());
        (self.gesture, self.saved, self.is_playing) = (None, None, false);
        Ok(())
    }
}
