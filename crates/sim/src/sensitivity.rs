//! Sensitivities: exact derivatives of the figures and the end state of a run with respect to numbers of
//! its scenario, through the closed loop, by dual numbers.
//!
//! The run itself is that of plain numbers, to the last bit. What is decided by comparison (which side a
//! limit is on, at which sample a task is passed) stays as it is under a small change, and so has the
//! derivative zero: the time of a task, say, is that of a sample.

use std::path::Path;

use appell_model::dual::Dual;
use appell_model::scalar::Scalar;
use serde::Serialize;

use crate::build::Values;
use crate::judge::Verdict;
use crate::meter::Meter;
use crate::run::{Plans, assemble};
use crate::scenario::{self, Diagnostic, Diagnostics, FIRST, Loaded, Overrides, Sensor, Steering};
use crate::world::World;

/// Parameters of one run with dual numbers: more would be quicker, and take much longer to compile.
const TOGETHER: usize = 1;
type Number = Dual<f64, TOGETHER>;

/// A number of the scenario.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Parameter {
    /// Its path.
    pub path: String,
    /// Its value.
    pub value: f64,
}

/// A figure and how it answers to each parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Response {
    /// Robot.
    pub robot: String,
    /// Name.
    pub name: String,
    /// Unit; empty for pure numbers.
    pub unit: String,
    /// Value.
    pub value: f64,
    /// Derivative with respect to each parameter.
    pub derivatives: Vec<f64>,
    /// Central differences, if they were asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub differences: Vec<f64>,
}

/// Sensitivities of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sensitivity {
    /// Name of the scenario.
    pub scenario: String,
    /// What became of each robot's task, if it has one.
    pub verdicts: Vec<String>,
    /// What was varied.
    pub parameters: Vec<Parameter>,
    /// What answered.
    pub responses: Vec<Response>,
}

/// The numbers of a scenario that sensitivities can be asked for: all that its blocks are built from,
/// but those that are zero, where equations have a corner.
///
/// # Errors
/// The scenario is wrong.
pub fn parameters(file: &Path, overrides: &Overrides) -> Result<Vec<Parameter>, Diagnostics> {
    known(&scenario::load(file, overrides)?)
}

fn known(loaded: &Loaded) -> Result<Vec<Parameter>, Diagnostics> {
    let values = Values::<f64>::listing();
    assemble(loaded, 0, &Plans::default(), &values)?;
    let asked = values.asked().into_iter();
    let mut known: Vec<Parameter> = Vec::new();
    for (path, value) in asked {
        if value != 0.0 && !known.iter().any(|parameter| parameter.path == path) {
            known.push(Parameter { path, value });
        }
    }
    Ok(known)
}

fn refuse(loaded: &Loaded, path: &str, problem: String, hint: &str) -> Diagnostics {
    Diagnostics(vec![Diagnostic {
        file: loaded.file.clone(),
        at: None,
        path: path.to_owned(),
        problem,
        hint: Some(hint.to_owned()),
    }])
}

/// Derivatives of all figures with respect to the numbers at these paths; with central differences
/// beside them if `check` says so.
///
/// # Errors
/// The scenario is wrong, has no such numbers, or rounds or searches on the way, which has no useful
/// derivative.
pub fn sensitivity(
    file: &Path,
    overrides: &Overrides,
    paths: &[String],
    check: bool,
) -> Result<Sensitivity, Diagnostics> {
    let loaded = scenario::load(file, overrides)?;
    refuse_corners(&loaded)?;
    let known = known(&loaded)?;
    let mut chosen = Vec::new();
    for path in paths {
        let Some(parameter) = known.iter().find(|parameter| parameter.path == *path) else {
            return Err(refuse(
                &loaded,
                path,
                "must be a number that the robots are built from, and not 0".into(),
                "appell sensitivity SCENARIO --list shows all there are",
            ));
        };
        chosen.push(parameter.clone());
    }
    let mut answer = Sensitivity {
        scenario: loaded.scenario.name.clone(),
        verdicts: Vec::new(),
        parameters: chosen.clone(),
        responses: Vec::new(),
    };
    for chunk in chosen.chunks(TOGETHER) {
        let seed = |(k, parameter): (usize, &Parameter)| {
            let number = Number::variable(parameter.value, k);
            (parameter.path.clone(), number)
        };
        let seeds: Vec<(String, Number)> = chunk.iter().enumerate().map(seed).collect();
        let (verdicts, figures) = run(&loaded, &seeds)?;
        answer.verdicts = verdicts;
        if answer.responses.is_empty() {
            answer.responses = figures.iter().map(Told::response).collect();
        }
        for (response, figure) in answer.responses.iter_mut().zip(&figures) {
            let slopes = &figure.value.derivative[..chunk.len()];
            response.derivatives.extend_from_slice(slopes);
        }
    }
    if check {
        for parameter in &chosen {
            // Where rounding and curvature weigh the same, for runs good to 12 digits or so.
            let step = 1e-5 * parameter.value.abs();
            let mut ends = Vec::new();
            for side in [-step, step] {
                let moved = parameter.value + side;
                ends.push(run(&loaded, &[(parameter.path.clone(), moved)])?.1);
            }
            for (k, response) in answer.responses.iter_mut().enumerate() {
                let rise = |ends: &[Vec<Told<f64>>]| {
                    Some((ends[1].get(k)?.value - ends[0].get(k)?.value) / (2.0 * step))
                };
                response.differences.push(rise(&ends).unwrap_or(f64::NAN));
            }
        }
    }
    Ok(answer)
}

/// What has no derivative that tells anything.
fn refuse_corners(loaded: &Loaded) -> Result<(), Diagnostics> {
    for robot in &loaded.scenario.robot {
        if let Some((name, _)) = robot.plugins().next() {
            let base = format!("robot.{}", robot.name);
            return Err(refuse(
                loaded,
                &match robot.models().any(|model| model == name) {
                    true => format!("{base}.model.{name}.plugin"),
                    false if name == FIRST => format!("{base}.controller"),
                    false => format!("{base}.standby.{name}.controller"),
                },
                "must not be a plug-in for derivatives: it takes plain numbers".into(),
                "use a controller that is built in, or a batch",
            ));
        }
        for sensor in &robot.sensor {
            let (kind, resolution) = match sensor {
                Sensor::Encoder { resolution, .. } => ("encoder", *resolution),
                Sensor::Odometry {
                    name, resolution, ..
                } => (name.as_str(), *resolution),
                _ => continue,
            };
            if resolution > 0 {
                return Err(refuse(
                    loaded,
                    &format!("robot.{}.sensor.{kind}.resolution", robot.name),
                    format!("must be 0 for derivatives, got {resolution}: steps are flat"),
                    "set it to 0; its effect is seen in a batch",
                ));
            }
        }
        let platform = robot.platform.as_ref();
        let linked = platform
            .iter()
            .flat_map(|p| &p.wheel)
            .find(|wheel| matches!(wheel.steering, Steering::Linked { .. }));
        if let Some(wheel) = linked {
            return Err(refuse(
                loaded,
                &format!("robot.{}.platform.wheel.{}", robot.name, wheel.name),
                "must not be linked for derivatives: its angle is found by a search".into(),
                "use a robot without linked wheels, or a batch",
            ));
        }
    }
    Ok(())
}

/// A figure of a robot.
struct Told<S> {
    robot: String,
    name: String,
    unit: String,
    value: S,
}

impl<S: Scalar> Told<S> {
    fn response(&self) -> Response {
        Response {
            robot: self.robot.clone(),
            name: self.name.clone(),
            unit: self.unit.clone(),
            value: self.value.lane(0),
            derivatives: Vec::new(),
            differences: Vec::new(),
        }
    }
}

/// Outputs of the plant that make its end state, with their names.
const ENDS: [(&str, &str); 5] = [
    ("pose.x", "x at the end"),
    ("pose.y", "y at the end"),
    ("pose.yaw", "yaw at the end"),
    ("twist.forward", "speed at the end"),
    ("twist.yaw_rate", "yaw rate at the end"),
];

/// Verdicts and figures of a run with some of its numbers replaced.
#[allow(clippy::type_complexity)]
fn run<S: Scalar<Single = S>>(
    loaded: &Loaded,
    seeds: &[(String, S)],
) -> Result<(Vec<String>, Vec<Told<S>>), Diagnostics> {
    let scenario = &loaded.scenario;
    let assembly = assemble::<S>(loaded, 0, &Plans::default(), &Values::new(seeds))?;
    let mut world = World::wire(assembly.parts);
    let mut meter = Meter::new(scenario, world.signals());
    while world
        .go(u64::MAX, &mut meter)
        .expect("nothing is written that could fail")
    {}
    if let Some(error) = world.take_error(0) {
        return Err(refuse(
            loaded,
            "",
            format!("must run to its end, got: {error}"),
            "see what becomes of it with appell run",
        ));
    }
    let mut told = Vec::new();
    let mut verdicts = Vec::new();
    for (k, robot) in scenario.robot.iter().enumerate() {
        let referee = &world.referees[k];
        let judge = &referee.judge(0);
        if referee.has_task {
            let verdict = match judge.verdict() {
                Verdict::Passed => "passed",
                Verdict::Failed | Verdict::Running => "failed",
            };
            verdicts.push(format!("{}: {verdict}", robot.name));
        }
        let mut add = |name: &str, unit: &str, value: S| {
            told.push(Told {
                robot: robot.name.clone(),
                name: name.to_owned(),
                unit: unit.to_owned(),
                value,
            });
        };
        for (path, name) in ENDS {
            if let Some(column) = world.column(&format!("robot.{}.{path}", robot.name)) {
                let unit = &world.signals()[column].unit;
                add(name, unit, world.row()[column]);
            }
        }
        for figure in meter.metrics(k, 0, judge, scenario, world.time(0)) {
            if figure.name != "time" {
                add(&figure.name, &figure.unit, figure.value);
            }
        }
    }
    Ok((verdicts, told))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shipped(name: &str) -> std::path::PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../../scenarios")
            .join(name)
    }

    /// Derivatives through motors, servo, law, odometry and noise against central differences: those
    /// are good to their curvature and rounding, 1e-5 of the largest effect.
    #[test]
    fn invariant_derivatives_are_the_limit_of_differences() {
        let set = |path: &str, value: &str| (path.to_owned(), value.to_owned());
        let odometry = "[{ kind = \"odometry\", period = 0.01, angle_std = 0.001 }]";
        let overrides = [
            set("time.duration", "4.0"),
            set("robot.tri.sensor", odometry),
            set("robot.tri.controller.pose", "odometry"),
        ];
        let paths = [
            "robot.tri.platform.body.mass",
            "robot.tri.platform.wheel.left.radius",
            "robot.tri.platform.wheel.right.drive.torque_constant",
            "robot.tri.controller.lookahead",
            "robot.tri.controller.speed",
            "robot.tri.sensor.odometry.track_scale",
            "robot.tri.sensor.odometry.angle_std",
        ]
        .map(str::to_owned);
        let answer = sensitivity(&shipped("slalom.toml"), &overrides, &paths, true)
            .unwrap_or_else(|error| panic!("{error}"));
        let mut nonzero = 0;
        for response in &answer.responses {
            // A peak is that of another sample soon, an energy residual is rounding.
            let smooth = [
                "x at the end",
                "y at the end",
                "yaw at the end",
                "path length",
            ];
            if !smooth.contains(&response.name.as_str()) {
                continue;
            }
            for (k, parameter) in answer.parameters.iter().enumerate() {
                let (exact, difference) = (response.derivatives[k], response.differences[k]);
                let scale = exact.abs().max(1e-3 / parameter.value.abs());
                assert!(
                    (exact - difference).abs() < 2e-4 * scale,
                    "{} by {}: {exact} and {difference}",
                    response.name,
                    parameter.path
                );
                nonzero += usize::from(exact != 0.0);
            }
        }
        assert!(nonzero > 20, "{nonzero}");
    }

    /// Straight on, an odometry that believes in wheels 1.02 times as large errs by 0.02 of the way, and
    /// by the whole way per unit of that factor.
    #[test]
    fn closed_form_of_an_odometry_on_a_straight_way() {
        let set = |path: &str, value: &str| (path.to_owned(), value.to_owned());
        let signals = r#"{ kind = "signals", channel = [
            { to = "forward", signal = { kind = "constant", value = 0.5 } }] }"#;
        let odometry =
            r#"[{ kind = "odometry", period = 0.01, radius_scale = 1.02, causes = true }]"#;
        let overrides = [
            set("time.duration", "2.0"),
            set("robot.tri.level", "kinematic"),
            set("robot.tri.pose", "[1.0, 1.0, 0.0]"),
            set("robot.tri.controller", signals),
            set("robot.tri.sensor", odometry),
        ];
        let path = "robot.tri.sensor.odometry.radius_scale".to_owned();
        let answer = sensitivity(&shipped("homing.toml"), &overrides, &[path], false);
        let answer = answer.unwrap_or_else(|error| panic!("{error}"));
        let of = |name: &str| {
            let found = answer.responses.iter().find(|r| r.name == name);
            found.unwrap_or_else(|| panic!("no {name}"))
        };
        let (way, error) = (of("path length").value, of("error of odometry at the end"));
        assert!(way > 0.9, "{way}");
        // Sums of 200 periods.
        assert!((error.value - 0.02 * way).abs() < 1e-12 * way);
        assert!(
            (error.derivatives[0] - way).abs() < 1e-10 * way,
            "{error:?}"
        );
    }

    #[test]
    fn refusal_of_what_has_no_derivative() {
        let file = shipped("robust.toml");
        let path = ["robot.tri.platform.body.mass".to_owned()];
        let problem = sensitivity(&file, &[], &path, false).expect_err("rounds");
        assert!(problem.to_string().contains("resolution"), "{problem}");
        let problem = sensitivity(
            &shipped("slalom.toml"),
            &[],
            &["robot.tri.mass".into()],
            false,
        );
        let problem = problem.expect_err("no such number").to_string();
        assert!(problem.contains("--list"), "{problem}");
    }
}
