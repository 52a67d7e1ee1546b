//! What a robot does, by the measures of ISO 18646-1: rated speed, stopping, steepest slope, speed on a
//! slope, highest sill. Each is a run of its own, at the level whose wheels slip, where the robot has it.
//!
//! ISO 18646-1:2016, *Robotics – Performance criteria and related test methods for service robots –
//! Part 1: Locomotion for wheeled robots*.

use std::path::Path;

use appell_model::drive::Drive;
use serde::Serialize;

use crate::build::{self, DriveModel};
use crate::record::{Memory, Recording};
use crate::run::Run;
use crate::scenario::{self, Platform};

/// How it is measured.
#[derive(Clone, Copy, Debug)]
pub struct Test {
    /// Coefficient of friction.
    pub friction: f64,
    /// Slope on which the speed is measured, degrees.
    pub slope_deg: f64,
}

/// What was measured.
#[derive(Clone, Debug, Serialize)]
pub struct Measures {
    /// Name of the robot.
    pub robot: String,
    /// Level of the model: `slip`, or `rolling` with a trailer.
    pub level: &'static str,
    /// Speed that it keeps on level ground, m/s.
    pub rated_speed: f64,
    /// How far it still goes when it is told to stop at that speed, m.
    pub stopping_distance: f64,
    /// Time until it stands still for good, s.
    pub stopping_time: f64,
    /// Steepest slope that it climbs, degrees, at three tenths of the rated speed.
    pub slope_max_deg: f64,
    /// What keeps it from a steeper one.
    pub limit: &'static str,
    /// Speed that it keeps uphill on the slope of the test, m/s; none where it is too steep.
    pub slope_speed: Option<f64>,
    /// Highest step up that all its wheels come over, m, at three tenths of the rated speed; none where
    /// uneven ground does not know the robot.
    pub sill: Option<f64>,
}

/// Steepest slope that is tried, degrees, and how finely.
const STEEPEST: f64 = 60.0;
const HALVINGS: usize = 8;
/// How finely the highest sill is sought, as a share of the largest radius: a hundredth.
const SILL_HALVINGS: usize = 7;
/// Time to reach a speed, and then to stop, s.
const RUN_UP: f64 = 10.0;
const STOP: f64 = 10.0;
const CLIMB: f64 = 6.0;

/// Measures the robot of a file.
///
/// # Errors
/// A text that says what is wrong with the file or the robot.
pub fn measure(file: &Path, test: Test) -> Result<Measures, String> {
    let platform = scenario::load_robot(file).map_err(|error| error.to_string())?;
    let fastest = fastest(&platform)
        .ok_or_else(|| format!("{}: has no drive that moves it ahead", file.display()))?;
    let course = Course {
        file,
        platform: &platform,
        test,
        level: if platform.trailer.is_some() {
            "rolling"
        } else {
            "slip"
        },
        fastest,
    };
    let level_run = course.run(&Ground::Slope(0.0), fastest, RUN_UP, STOP)?;
    let speeds = column(&level_run, "twist.forward");
    let xs = column(&level_run, "pose.x");
    let at = |t: f64| level_run.times.partition_point(|&time| time < t - 1e-9);
    let stop = at(RUN_UP);
    let rated_speed = speeds[stop];
    // At rest: below a hundredth of the speed, for good.
    let still = |k: usize| speeds[k..].iter().all(|v| v.abs() <= 0.01 * rated_speed);
    let rests = (stop..speeds.len()).find(|&k| still(k));
    let rests = rests.unwrap_or(speeds.len() - 1);

    // A servo may roll it back after that.
    let farthest = xs[stop..=rests].iter().copied().fold(xs[stop], f64::max);

    let slow = 0.3 * rated_speed;
    let (mut low, mut high) = (0.0, STEEPEST);
    let mut limit = "none up to 60°";
    if course.climbs(STEEPEST, slow)?.is_some() {
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            match course.climbs(middle, slow)? {
                None => low = middle,
                Some(why) => {
                    high = middle;
                    limit = why;
                }
            }
        }
    } else {
        low = STEEPEST;
    }
    let slope_speed = if test.slope_deg <= low {
        let run = course.run(&Ground::Slope(test.slope_deg), fastest, RUN_UP, 0.0)?;
        column(&run, "twist.forward").last().copied()
    } else {
        None
    };
    Ok(Measures {
        robot: platform.name.clone(),
        level: course.level,
        rated_speed,
        stopping_distance: farthest - xs[stop],
        stopping_time: level_run.times[rests] - RUN_UP,
        slope_max_deg: low,
        limit,
        slope_speed,
        sill: course.sill(slow)?,
    })
}

/// What is driven on.
enum Ground {
    /// A plane that rises ahead, degrees.
    Slope(f64),
    /// A step up of a rise ahead, both m.
    Sill { ahead: f64, rise: f64 },
}

/// Largest speed straight ahead that the drives' rates allow, m/s.
fn fastest(file: &Platform) -> Option<f64> {
    let platform = build::platform(file, DriveModel::Rate, 9.81).ok()?;
    let x = build::rest_state(&platform, [0.0; 3], &build::start_angles(file));
    let rates = platform.rates_from_twist(&x, [1.0, 0.0, 0.0]);
    let mut fastest: Option<f64> = None;
    for (wheel, rate) in platform.wheels().iter().zip(rates) {
        if let Drive::Rate { rate_max } = wheel.drive
            && rate.abs() > 1e-9
        {
            let speed = rate_max / rate.abs();
            fastest = Some(fastest.map_or(speed, |known| known.min(speed)));
        }
    }
    fastest.filter(|speed| speed.is_finite() && *speed > 0.0)
}

struct Course<'a> {
    file: &'a Path,
    platform: &'a Platform,
    test: Test,
    level: &'static str,
    fastest: f64,
}

fn column<'a>(recording: &'a Recording, signal: &str) -> &'a [f64] {
    recording
        .column(&format!("robot.it.{signal}"))
        .expect("every robot has it")
}

impl Course<'_> {
    /// Straight ahead, at a commanded speed for a time, s, and then to a stop.
    fn run(&self, ground: &Ground, speed: f64, ahead: f64, stop: f64) -> Result<Recording, String> {
        let file = std::fs::canonicalize(self.file).map_err(|error| error.to_string())?;
        let length = 20.0 + 2.0 * self.fastest * (ahead + stop);
        let middle = 0.5 * length;
        let terrain = match ground {
            Ground::Slope(slope) => {
                format!("kind = \"plane\"\nslope_deg = {slope:?}\ndownhill_heading_deg = 180.0\n")
            }
            Ground::Sill { ahead, rise } => format!(
                "kind = \"uneven\"\nrelief = [{{ kind = \"step\", at = [{:?}, 0.0], rise = {rise:?} }}]\n",
                middle + ahead
            ),
        };
        let text = format!(
            "schema = 1\nname = \"measures\"\nseed = 1\n\
             [time]\nstep = 0.001\nduration = {duration:?}\n\
             [arena]\nsize = [{length:?}, 40.0]\n\
             [[arena.beacon]]\nname = \"mark\"\nposition = [1.0, 1.0]\n\
             [terrain]\nfriction = {friction:?}\n{terrain}\
             [[robot]]\nname = \"it\"\nfile = {file:?}\nlevel = \"{level}\"\npose = [{middle:?}, 20.0, 0.0]\n\
             [robot.controller]\nkind = \"signals\"\n\
             channel = [{{ to = \"forward\", signal = {{ kind = \"step\", at = {ahead:?}, before = {speed:?}, after = 0.0 }} }}]\n",
            duration = ahead + stop,
            friction = self.test.friction,
            level = self.level,
        );
        let loaded = scenario::load_text(&text, Path::new("measures.toml"), &Vec::new());
        let loaded = loaded.map_err(|error| error.to_string())?;
        let mut run = Run::new(&loaded, 0).map_err(|error| error.to_string())?;
        let mut memory = Memory::new();
        run.execute(&mut memory, &mut |_| {})
            .map_err(|error| error.to_string())?;
        Ok(memory.into_recording())
    }

    /// Highest step that it comes over at a speed, m.
    fn sill(&self, speed: f64) -> Result<Option<f64>, String> {
        let radii = self.platform.wheel.iter().map(|wheel| wheel.radius);
        let largest = radii.fold(0.0, f64::max);
        if self.platform.trailer.is_some() || self.comes_over(1e-6, speed).is_err() {
            return Ok(None);
        }
        // A step as high as a hub is a wall.
        let (mut low, mut high) = (0.0, largest);
        for _ in 0..SILL_HALVINGS {
            let middle = 0.5 * (low + high);
            match self.comes_over(middle, speed)? {
                true => low = middle,
                false => high = middle,
            }
        }
        Ok(Some(low))
    }

    /// Whether all wheels come over a step at a speed.
    fn comes_over(&self, rise: f64, speed: f64) -> Result<bool, String> {
        let wheels = self.platform.wheel.iter();
        let reach = |way: f64| {
            let ends = wheels.clone().map(|w| way * w.mount[0] + w.radius);
            ends.fold(0.0, f64::max)
        };
        let (front, rear) = (reach(1.0), reach(-1.0));
        // A run-up, then as far as it is long, twice over: a step takes its time.
        let ahead = front + 0.1;
        let way = ahead + rear + 0.1;
        let ground = Ground::Sill { ahead, rise };
        let run = self.run(&ground, speed, (2.0 * way / speed).ceil(), 0.0)?;
        let xs = column(&run, "pose.x");
        Ok(xs[xs.len() - 1] - xs[0] > ahead + rear)
    }

    /// What keeps it from climbing a slope at a speed; none if it does.
    fn climbs(&self, slope: f64, speed: f64) -> Result<Option<&'static str>, String> {
        let run = self.run(&Ground::Slope(slope), speed, CLIMB, 0.0)?;
        let speeds = column(&run, "twist.forward");
        let last = &speeds[speeds.len() - speeds.len() / 6..];
        let mean = last.iter().sum::<f64>() / last.len() as f64;
        let lowest = |signal: &str| {
            let column = run.column(&format!("robot.it.{signal}"));
            column.map(|values| values.iter().copied().fold(f64::INFINITY, f64::min))
        };
        if lowest("tip_margin").is_some_and(|margin| margin < 0.0) {
            return Ok(Some("tips over"));
        }
        if mean >= 0.9 * speed {
            return Ok(None);
        }
        let slides = self.platform.wheel.iter().any(|wheel| {
            let used = run.column(&format!("robot.it.wheel.{}.friction_use", wheel.name));
            used.is_some_and(|values| {
                values[values.len() - values.len() / 6..]
                    .iter()
                    .any(|u| *u > 0.999)
            })
        });
        Ok(Some(if slides { "slides" } else { "drive" }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The Husky: its drivers' top speed, and a slope on which friction ends before the drives do:
    /// tan ψ = μ for a robot all of whose wheels drive.
    #[test]
    fn closed_form_measures_of_the_husky() {
        let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots");
        let test = Test {
            friction: 0.5,
            slope_deg: 5.0,
        };
        let measured = measure(&robots.join("husky-a200.toml"), test).expect("a robot");
        // 6.06 rad/s on a radius of 0.1651 m, held by a servo with an integral part.
        assert!((measured.rated_speed - 1.0005).abs() < 0.01, "{measured:?}");
        assert_eq!(measured.limit, "slides");
        let limit = appell_model::scalar::Scalar::atan(0.5_f64).to_degrees();
        // Found to a quarter of a degree; close below the limit it no longer reaches its speed in time.
        assert!(measured.slope_max_deg < limit, "{measured:?}");
        assert!(measured.slope_max_deg > limit - 2.0, "{measured:?}");
        // Not sooner than full friction stops it.
        let speed = measured.rated_speed;
        assert!(measured.stopping_distance > speed * speed / (2.0 * 0.5 * 9.81));
    }
}
