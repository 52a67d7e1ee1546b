//! What every plug-in has to do, whatever it controls.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use serde_json::{Value, json};

use crate::wire::Call;
use crate::{Fault, Limits, Plugin};

/// One thing that was tested.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// What it must do.
    pub rule: &'static str,
    /// What came of it; a fault where it did not.
    pub result: Result<String, String>,
}

/// Period of the tests' steps, s.
const PERIOD: f64 = 0.01;

/// Tests the plug-in of a file over this many steps, two at least.
///
/// # Errors
/// It cannot be started, so that nothing can be tested.
pub fn conformance(file: &Path, limits: &Limits, steps: usize) -> Result<Vec<Finding>, Fault> {
    let mut plugin = Plugin::open(file, limits.clone())?;
    let inputs = inputs(plugin.descriptor().inputs.len(), steps.max(2));
    let context = context();
    let mut findings = Vec::new();
    let mut find = |rule, result: Result<String, Fault>| {
        let result = result.map_err(|fault| fault.to_string());
        findings.push(Finding { rule, result });
    };
    let first = run(&mut plugin, &context, &inputs);
    let reference = first.as_ref().map_err(Fault::clone).cloned();
    find(
        "steps over ordinary values, and keeps to the limits of its outputs",
        first.map(|rows| format!("{} steps", rows.len())),
    );
    let Ok(reference) = reference else {
        return Ok(findings);
    };
    let same = |rows: Result<Vec<Vec<f64>>, Fault>| match rows {
        Ok(rows) => agree(&reference, &rows),
        Err(fault) => Err(fault),
    };
    find(
        "a second member has the bits of the first",
        same(run(&mut plugin, &context, &inputs)),
    );
    find(
        "another process has them, too",
        same(
            Plugin::open(file, limits.clone())
                .and_then(|mut other| run(&mut other, &context, &inputs)),
        ),
    );
    find(
        "members that step together have the bits of one alone",
        same(together(&mut plugin, &context, &inputs)),
    );
    find(
        "a member that gets the memory of another goes on as it would",
        same(interrupted(&mut plugin, &context, &inputs)),
    );
    find(
        "a value that is not a number makes a fault, or no harm",
        harmless(&mut plugin, &context, &inputs),
    );
    find("speed", speed(&mut plugin, &context, &inputs));
    Ok(findings)
}

/// What the plug-in of a file gives for the inputs of [`conformance`], a row for each step.
///
/// # Errors
/// It cannot be started, or fails.
pub fn answers(file: &Path, limits: &Limits, steps: usize) -> Result<Vec<Vec<f64>>, Fault> {
    let mut plugin = Plugin::open(file, limits.clone())?;
    let inputs = inputs(plugin.descriptor().inputs.len(), steps);
    run(&mut plugin, &context(), &inputs)
}

/// Where the tests take place: an arena with a beacon, and a straight way to it.
fn context() -> Value {
    let points: Vec<[f64; 2]> = (0..=200)
        .map(|k| [1.0 + 0.01 * f64::from(k), 1.0])
        .collect();
    json!({
        "robot": "tested",
        "period": PERIOD,
        "step": 0.001,
        "seed": 1,
        "trial": 0,
        "arena": { "size": [6.0, 4.0], "beacon": [{ "name": "dock", "position": [4.0, 1.0], "radius": 0.05 }] },
        "task": { "kind": "homing", "beacon": "dock", "distance": 0.5, "speed": 0.01, "hold": 1.0 },
        "pose": [1.0, 1.0, 0.0],
        "platform": null,
        "path": { "ds": 0.01, "heading": vec![0.0; points.len()], "curvature": vec![0.0; points.len()], "points": points },
    })
}

/// Values in [−1, 1] that are the same on every machine.
fn inputs(width: usize, steps: usize) -> Vec<Vec<f64>> {
    let value = |k: usize, i: usize| {
        let part = (k * width + i) as f64 * 0.754_877_666;
        2.0 * (part - part.floor()) - 1.0
    };
    (0..steps)
        .map(|k| (0..width).map(|i| value(k, i)).collect())
        .collect()
}

fn step(plugin: &mut Plugin, member: u32, k: usize, input: &[f64]) -> Result<Vec<f64>, Fault> {
    let mut output = vec![0.0; plugin.descriptor().outputs.len()];
    plugin.step(member, k as f64 * PERIOD, PERIOD, input, &mut output)?;
    Ok(output)
}

fn run(plugin: &mut Plugin, context: &Value, inputs: &[Vec<f64>]) -> Result<Vec<Vec<f64>>, Fault> {
    let member = plugin.create(&BTreeMap::new(), context)?;
    let rows = inputs
        .iter()
        .enumerate()
        .map(|(k, input)| step(plugin, member, k, input));
    let rows = rows.collect();
    plugin.destroy(member);
    rows
}

fn together(
    plugin: &mut Plugin,
    context: &Value,
    inputs: &[Vec<f64>],
) -> Result<Vec<Vec<f64>>, Fault> {
    let width = plugin.descriptor().outputs.len();
    let members: Vec<u32> = (0..3)
        .map(|_| plugin.create(&BTreeMap::new(), context))
        .collect::<Result<_, _>>()?;
    let mut rows = Vec::new();
    let mut output = vec![0.0; width * members.len()];
    for (k, input) in inputs.iter().enumerate() {
        let call = |&member: &u32| Call {
            member,
            t: k as f64 * PERIOD,
            dt: PERIOD,
            input,
        };
        let calls: Vec<Call<'_>> = members.iter().map(call).collect();
        plugin
            .step_many(&calls, &mut output)
            .map_err(|(_, fault)| fault)?;
        let mut of_each = output.chunks_exact(width).map(<[f64]>::to_vec);
        let row = of_each.next().unwrap_or_default();
        if let Some(other) = of_each.find(|other| bits(other) != bits(&row)) {
            let problem = format!("differ from each other at step {k}: {row:?} and {other:?}");
            return Err(Fault::new("step", problem));
        }
        rows.push(row);
    }
    for member in members {
        plugin.destroy(member);
    }
    Ok(rows)
}

fn interrupted(
    plugin: &mut Plugin,
    context: &Value,
    inputs: &[Vec<f64>],
) -> Result<Vec<Vec<f64>>, Fault> {
    let mut member = plugin.create(&BTreeMap::new(), context)?;
    let mut rows = Vec::new();
    for (k, input) in inputs.iter().enumerate() {
        if k == inputs.len() / 2 {
            let memory = plugin.save(member)?;
            plugin.destroy(member);
            member = plugin.create(&BTreeMap::new(), context)?;
            plugin.restore(member, &memory)?;
        }
        rows.push(step(plugin, member, k, input)?);
    }
    plugin.destroy(member);
    Ok(rows)
}

fn harmless(plugin: &mut Plugin, context: &Value, inputs: &[Vec<f64>]) -> Result<String, Fault> {
    let poisoned = plugin.create(&BTreeMap::new(), context)?;
    let Some(input) = inputs.first() else {
        return Ok(String::new());
    };
    let told = match step(plugin, poisoned, 0, &vec![f64::NAN; input.len()]) {
        Ok(_) => "no harm".to_owned(),
        Err(fault) => format!("fault: {fault}"),
    };
    plugin.destroy(poisoned);
    let fresh = plugin.create(&BTreeMap::new(), context)?;
    step(plugin, fresh, 0, input)?;
    plugin.destroy(fresh);
    Ok(told)
}

fn speed(plugin: &mut Plugin, context: &Value, inputs: &[Vec<f64>]) -> Result<String, Fault> {
    let member = plugin.create(&BTreeMap::new(), context)?;
    let mut output = vec![0.0; plugin.descriptor().outputs.len()];
    let mut times = Vec::new();
    for (k, input) in inputs.iter().enumerate() {
        let start = Instant::now();
        plugin.step(member, k as f64 * PERIOD, PERIOD, input, &mut output)?;
        times.push(start.elapsed().as_secs_f64() * 1e6);
    }
    plugin.destroy(member);
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    Ok(format!(
        "{:.0} µs a step in the middle, {:.0} µs at most",
        at(0.5),
        at(1.0)
    ))
}

fn bits(row: &[f64]) -> Vec<u64> {
    row.iter().map(|value| value.to_bits()).collect()
}

fn agree(reference: &[Vec<f64>], rows: &[Vec<f64>]) -> Result<String, Fault> {
    let differs = |(a, b): (&Vec<f64>, &Vec<f64>)| bits(a) != bits(b);
    match reference.iter().zip(rows).position(differs) {
        None => Ok("bit for bit".into()),
        Some(k) => Err(Fault::new(
            "step",
            format!(
                "differs at step {k}: {:?} where it was {:?}. What it remembers must be in its memory, and nothing drawn at random",
                rows[k], reference[k]
            ),
        )),
    }
}
