//! Scenarios that can be built: what `appell-scenario` reads, under the rules of [`check`].

mod check;

use std::path::Path;

pub use appell_scenario::*;

pub use check::{COUNT_MAX, TRIALS_MAX, check};

/// Reads, completes and checks a scenario file.
pub fn load(file: &Path, overrides: &Overrides) -> Result<Loaded, Diagnostics> {
    accept(Draft::read(file, overrides)?)
}

/// The same from a text, as if it stood in `file`.
pub fn load_text(text: &str, file: &Path, overrides: &Overrides) -> Result<Loaded, Diagnostics> {
    accept(Draft::read_text(text, file, overrides)?)
}

fn accept(draft: Draft) -> Result<Loaded, Diagnostics> {
    let problems = check(&draft.scenario, &draft.folder);
    draft.judged(problems)
}

/// Reads and checks a robot file alone.
pub fn load_robot(file: &Path) -> Result<Platform, Diagnostics> {
    let draft = RobotDraft::read(file)?;
    let problems = check::check_platform(&draft.platform, "");
    draft.judged(problems)
}

/// The scenario of a template with numbers at paths; without its text. `None` where it would be
/// refused: [`load`] says why.
pub fn with_numbers(template: &Template, numbers: &[(String, f64)]) -> Option<Loaded> {
    let loaded = template.with(numbers).ok()?;
    check(&loaded.scenario, &loaded.folder)
        .is_empty()
        .then_some(loaded)
}
