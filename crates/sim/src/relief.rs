//! From what a file says of uneven ground to heights over the map.

pub mod elevation;
pub mod roughness;

use std::path::Path;
use std::sync::{Arc, Mutex};

use appell_model::planar::{Vec2, vec2};
use appell_model::scalar::Scalar;
use appell_model::terrain::{Form, Grid, Relief, Terrain, heading};

use crate::noise::Stream;
use crate::scenario;
use elevation::{ElevationError, Reading};
use roughness::{CLASS_PSD, Roughness};

/// Nodes to the shortest wave of rough ground: between them a wave is off by less than one in a hundred.
pub(crate) const NODES_PER_WAVE: f64 = 8.0;
/// Most nodes of rough ground.
pub(crate) const NODES_MAX: f64 = 1e7;
/// Waves to the octave of rough ground.
const WAVES_PER_OCTAVE: f64 = 16.0;

/// Why a relief cannot be built.
pub(crate) struct ReliefError {
    /// Place among the features, from 0.
    pub index: usize,
    /// What is wrong with it.
    pub error: ElevationError,
}

/// Grids that were read or drawn, each by the feature that asked for it: trials share them.
#[derive(Default)]
pub(crate) struct Grids(Mutex<Vec<(scenario::Relief, Grid)>>);

/// Most grids that are kept: a batch that varies the ground has new ones for each trial.
const GRIDS_MAX: usize = 8;

impl Grids {
    /// The ground of a terrain whose files lie in a folder; `None` where it is even.
    pub(crate) fn terrain(
        &self,
        terrain: &scenario::Terrain,
        folder: &Path,
    ) -> Result<Option<Arc<Terrain>>, ReliefError> {
        if !matches!(terrain, scenario::Terrain::Uneven { .. }) {
            return Ok(None);
        }
        let features = terrain.relief().iter().enumerate();
        let features: Result<Vec<Relief>, ReliefError> = features
            .map(|(index, feature)| {
                let fail = |error| ReliefError { index, error };
                self.feature(feature, folder).map_err(fail)
            })
            .collect();
        Ok(Some(Arc::new(Terrain::new(features?))))
    }

    fn feature(&self, feature: &scenario::Relief, folder: &Path) -> Result<Relief, ElevationError> {
        if let Some(relief) = plain(feature) {
            return Ok(relief);
        }
        let known = |grids: &Vec<(scenario::Relief, Grid)>| {
            let found = grids.iter().find(|(known, _)| known == feature);
            found.map(|(_, grid)| grid.clone())
        };
        if let Some(grid) = known(&self.0.lock().expect("nothing panics with it")) {
            return Ok(Relief::Grid(grid));
        }
        let grid = gridded(feature, folder)?;
        let mut grids = self.0.lock().expect("nothing panics with it");
        if known(&grids).is_none() {
            if grids.len() == GRIDS_MAX {
                grids.remove(0);
            }
            grids.push((feature.clone(), grid.clone()));
        }
        Ok(Relief::Grid(grid))
    }
}

/// Features that are formulas.
fn plain(feature: &scenario::Relief) -> Option<Relief> {
    use scenario::Relief as File;
    let point = |[x, y]: [f64; 2]| vec2(x, y);
    let along = |degrees: f64| -> Vec2<f64> { heading(degrees.to_radians()) };
    Some(match *feature {
        File::Slope {
            slope_deg,
            downhill_heading_deg,
        } => {
            let (sin, cos) = Scalar::sin_cos(slope_deg.to_radians());
            Relief::Slope {
                uphill: along(downhill_heading_deg + 180.0),
                grade: sin / cos,
            }
        }
        File::Step {
            at,
            heading_deg,
            rise,
        } => Relief::Ramp {
            at: point(at),
            along: along(heading_deg),
            rise,
            length: 0.0,
        },
        File::Ramp {
            at,
            heading_deg,
            rise,
            length,
        } => Relief::Ramp {
            at: point(at),
            along: along(heading_deg),
            rise,
            length,
        },
        File::Block {
            at,
            heading_deg,
            length,
            width,
            rise,
        } => Relief::Block {
            at: point(at),
            along: along(heading_deg),
            half: [0.5 * length, 0.5 * width],
            rise,
        },
        File::Wave {
            form,
            at,
            heading_deg,
            amplitude,
            period,
            phase_deg,
            length,
        } => Relief::Wave {
            at: point(at),
            along: along(heading_deg),
            form: match form {
                scenario::Form::Sine => Form::Sine,
                scenario::Form::Triangle => Form::Triangle,
                scenario::Form::Square => Form::Square,
            },
            amplitude,
            period,
            phase: phase_deg.to_radians(),
            length,
        },
        File::Map { .. } | File::Roughness { .. } => return None,
    })
}

/// Features that are heights at nodes.
fn gridded(feature: &scenario::Relief, folder: &Path) -> Result<Grid, ElevationError> {
    let (origin, spacing, columns, heights) = match feature {
        scenario::Relief::Map {
            file,
            size,
            resolution,
            low,
            high,
            origin,
        } => {
            let reading = Reading {
                size: *size,
                resolution: *resolution,
                low: *low,
                high: *high,
                origin: *origin,
            };
            let read = elevation::read(&folder.join(file), &reading)?;
            (read.origin, read.spacing, read.columns, read.heights)
        }
        scenario::Relief::Roughness {
            class,
            shortest,
            longest,
            origin,
            size,
            seed,
        } => {
            let octaves = Scalar::ln(longest / shortest) / std::f64::consts::LN_2;
            let waves = (WAVES_PER_OCTAVE * octaves).ceil() as usize;
            let stream = Stream::new(*seed, 0, "terrain.roughness");
            let random = |counter: u64| stream.uniforms(counter)[0];
            let rough = Roughness::new(
                CLASS_PSD[*class as usize],
                *shortest,
                *longest,
                waves,
                random,
            );
            let counts = nodes(*shortest, *size);
            let spacing = [0, 1].map(|k| size[k] / (counts[k] - 1) as f64);
            let heights = rough.sample(*origin, spacing, counts[0], counts[1]);
            (*origin, spacing, counts[0], heights)
        }
        _ => unreachable!("features that are formulas are no grids"),
    };
    let grid = Grid::new(vec2(origin[0], origin[1]), spacing, columns, heights);
    grid.ok_or_else(|| ElevationError {
        field: "kind",
        problem: "must have finite heights".into(),
        hint: String::new(),
    })
}

/// Columns and rows of rough ground.
pub(crate) fn nodes(shortest: f64, size: [f64; 2]) -> [usize; 2] {
    size.map(|length| (length * NODES_PER_WAVE / shortest).ceil() as usize + 1)
}

#[cfg(test)]
mod tests;
