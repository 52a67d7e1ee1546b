//! `appell sensitivity`.

use appell_sim::sensitivity::{self, Parameter, Sensitivity};

use crate::arguments::SensitivityOptions;
use crate::{exit, terminal};

/// Shows how the figures of a run answer to numbers of its scenario.
pub fn sensitivity(options: &SensitivityOptions) -> u8 {
    match told(options) {
        Ok(text) => {
            terminal::print(&text);
            exit::PASSED
        }
        Err(problem) => {
            terminal::error(&problem);
            exit::BAD_INPUT
        }
    }
}

fn told(options: &SensitivityOptions) -> Result<String, String> {
    let overrides = options.changes.overrides()?;
    if options.list {
        let known = sensitivity::parameters(&options.scenario, &overrides);
        let known = known.map_err(|problem| problem.to_string())?;
        return Ok(if options.json {
            serde_json::to_string_pretty(&known).expect("plain data")
        } else {
            listed(&known)
        });
    }
    let answer =
        sensitivity::sensitivity(&options.scenario, &overrides, &options.to, options.check);
    let answer = answer.map_err(|problem| problem.to_string())?;
    Ok(if options.json {
        serde_json::to_string_pretty(&answer).expect("plain data")
    } else {
        table(&answer)
    })
}

fn listed(known: &[Parameter]) -> String {
    let width = known.iter().map(|p| p.path.len()).max().unwrap_or(0);
    let lines = known
        .iter()
        .map(|p| format!("{:width$}  {}\n", p.path, terminal::number(p.value)));
    lines.collect()
}

/// A block for each parameter: the figures that it moves, with what a per cent of it does to them.
fn table(answer: &Sensitivity) -> String {
    let mut out = format!("{}: {}\n", answer.scenario, answer.verdicts.join(", "));
    let width = answer
        .responses
        .iter()
        .map(|r| r.name.chars().count())
        .max();
    let width = width.unwrap_or(0);
    let several = answer
        .responses
        .iter()
        .any(|r| r.robot != answer.responses[0].robot);
    for (k, parameter) in answer.parameters.iter().enumerate() {
        out += &format!(
            "\nby {} = {}\n  {:width$} {:>13} {:>13} {:>11}{}\n",
            parameter.path,
            terminal::number(parameter.value),
            "",
            "value",
            "derivative",
            "%/%",
            if answer.responses.iter().any(|r| !r.differences.is_empty()) {
                format!(" {:>13}", "difference")
            } else {
                String::new()
            }
        );
        for response in &answer.responses {
            let slope = response.derivatives[k];
            let difference = response.differences.get(k);
            if slope == 0.0 && difference.is_none_or(|d| *d == 0.0) {
                continue;
            }
            let share = slope * parameter.value / response.value;
            let robot = if several {
                format!("  {}", response.robot)
            } else {
                String::new()
            };
            out += &format!(
                "  {:width$} {:>13} {:>13} {:>11}{} {}{robot}\n",
                response.name,
                terminal::number(response.value),
                format!("{slope:.6e}"),
                if share.is_finite() {
                    format!("{share:.4}")
                } else {
                    "–".into()
                },
                difference.map_or_else(String::new, |d| format!(" {:>13}", format!("{d:.6e}"))),
                response.unit,
            );
        }
    }
    out
}
