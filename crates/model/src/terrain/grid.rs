//! Heights at the nodes of a grid, smooth between them.

use std::sync::Arc;

use crate::planar::{Vec2, vec2};

/// Heights at the nodes of a regular grid, between them by cubic convolution (Catmull–Rom): continuous
/// with its gradient, and through every node. Beyond its rim the ground goes on as high as there.
#[derive(Clone, Debug)]
pub struct Grid {
    origin: Vec2<f64>,
    spacing: [f64; 2],
    columns: usize,
    rows: usize,
    /// Shared by all that stand on it.
    heights: Arc<[f64]>,
}

impl Grid {
    /// Nodes from `origin`, m, `spacing` apart in x and y, m; row after row, the lowest y first. `None`
    /// unless heights and spacing are finite, the spacing positive, and there are two or more
    /// nodes each way.
    pub fn new(
        origin: Vec2<f64>,
        spacing: [f64; 2],
        columns: usize,
        heights: Vec<f64>,
    ) -> Option<Self> {
        let rows = heights.len().checked_div(columns)?;
        let whole = rows * columns == heights.len() && rows >= 2 && columns >= 2;
        let apart = spacing.iter().all(|&s| s.is_finite() && s > 0.0);
        let finite = heights.iter().all(|h| h.is_finite());
        (whole && apart && finite && origin.x.is_finite() && origin.y.is_finite()).then_some(Grid {
            origin,
            spacing,
            columns,
            rows,
            heights: heights.into(),
        })
    }

    /// Height, m, and its gradient.
    pub fn height(&self, point: Vec2<f64>) -> (f64, Vec2<f64>) {
        let across = place((point.x - self.origin.x) / self.spacing[0], self.columns);
        let along = place((point.y - self.origin.y) / self.spacing[1], self.rows);
        let (mut height, mut x_rate, mut y_rate) = (0.0, 0.0, 0.0);
        for j in 0..4 {
            let row = along.nodes[j] * self.columns;
            let (mut value, mut rate) = (0.0, 0.0);
            for i in 0..4 {
                let node = self.heights[row + across.nodes[i]];
                value += across.weights[i] * node;
                rate += across.rates[i] * node;
            }
            height += along.weights[j] * value;
            x_rate += along.weights[j] * rate;
            y_rate += along.rates[j] * value;
        }
        (
            height,
            vec2(x_rate / self.spacing[0], y_rate / self.spacing[1]),
        )
    }
}

/// The four nodes that a place along one axis rests on, their weights, and the rates of these.
struct Place {
    nodes: [usize; 4],
    weights: [f64; 4],
    rates: [f64; 4],
}

/// A place in units of the spacing among `count` nodes.
fn place(at: f64, count: usize) -> Place {
    let last = (count - 1) as f64;
    let inside = at.clamp(0.0, last);
    let first = (inside.floor()).min(last - 1.0);
    let t = inside - first;
    let k = first as usize;
    let next = |ahead: usize| (k + ahead).saturating_sub(1).min(count - 1);
    // Beyond the rim nothing changes.
    let moves = if at == inside { 1.0 } else { 0.0 };
    Place {
        nodes: [next(0), next(1), next(2), next(3)],
        weights: [
            0.5 * t * (t * (2.0 - t) - 1.0),
            0.5 * (t * t * (3.0 * t - 5.0) + 2.0),
            0.5 * t * (t * (4.0 - 3.0 * t) + 1.0),
            0.5 * t * t * (t - 1.0),
        ],
        rates: [
            0.5 * (t * (4.0 - 3.0 * t) - 1.0),
            0.5 * t * (9.0 * t - 10.0),
            0.5 * (t * (8.0 - 9.0 * t) + 1.0),
            0.5 * t * (3.0 * t - 2.0),
        ]
        .map(|rate| moves * rate),
    }
}
