//! Choice of a map, its size and stiffness, by cross-validation to first order.
//!
//! The derivatives of the exact simulation with respect to the coefficients, at zero, and those with respect to the fitted
//! parameters give normal equations block by block. The blocks are dealt to a few folds. Coefficients from all folds but one, with a ridge,
//! predict that one. Each size and stiffness costs one small solution, and the simulation is differentiated once per map.

use super::view::View;
use super::{Side, candidates};
use crate::diagnose::data::Data;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::locate::Located;
use crate::error::Result;
use crate::map::{Factor, Part};
use crate::monitor::Monitor;
use crate::optimise::least_squares::Normal;
use crate::recording::Kind;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::ops::Range;

/// Parts into which the blocks are dealt; each is left out once.
const FOLDS: usize = 4;
/// Blocks of a recording without windows enough.
const BLOCKS: usize = 16;
/// Variances of the coefficients' prior, in units of what the recording says of one of them, inverted: the more a curve stands out of the
/// noise, the less it may be held back.
const RIDGES: [f64; 8] = [1e-11, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2];
/// Harmonics tried of a factor that has more.
const HARMONICS: [usize; 4] = [1, 2, 4, 8];
/// Largest number of derivatives held for one map.
const CELLS: usize = 8_000_000;
/// Independent samples that one channel counts in the choice of a map, whatever the length of the recording, and at most in that of a
/// manoeuvre.
pub const MOST_WORTH: f64 = 200.0;
/// Price of a coefficient, nats, as by the default of `coefficient_cost`.
const PRICE: f64 = 0.5;
/// Gain from which a map is worth a fit by simulation, nats: prior odds of 1 to 20, as for an effect.
const LEAST_GAIN: f64 = 3.0;
/// Ridge that leaves a base parameter where it is if the blocks in use do not show it.
const UNSHOWN: f64 = 1e-8;

/// A map chosen to first order.
#[derive(Debug, Clone)]
pub struct Choice {
    /// The part to be added.
    pub part: Part,
    /// First-order coefficients.
    pub start: Vec<f64>,
    /// Weight of the coefficients' prior, in units of what the recording says of one of them.
    pub ridge: f64,
}

/// One way to use a candidate's columns.
struct Trial {
    part: Part,
    ridge: f64,
    left: f64,
}

/// The maps of one side that predict left-out blocks best, their coefficients paid: of each site the best one, if any is worth a fit, the
/// better one first.
///
/// # Errors
/// [`Error::Interrupted`](crate::error::Error::Interrupted).
pub fn choose(
    data: &Data,
    best: &Hypothesis,
    side: Side,
    located: &[Located],
    monitor: &dyn Monitor,
) -> Result<Vec<Choice>> {
    monitor.go_on()?;
    let Some(folds) = folds(data, side) else { return Ok(Vec::new()) };
    let torque = candidates::torque(data, best);
    let view = View::new(data, best, side, &torque, &folds);
    let rows = view.known.nrows();
    let candidates: Vec<Part> = candidates::candidates(data, best, side, located)
        .into_iter()
        .filter(|part| part.count() * rows <= CELLS)
        .collect();
    let bare = left(&view.normals(&DMatrix::zeros(rows, 0)), view.parameters(), &[], 0.0);
    let scale = Scale { channels: rows / data.signals.len(), counted: data.counted() };
    let trials: Result<Vec<Vec<Trial>>> =
        candidates.par_iter().map(|part| trials(&view, part, monitor)).collect();
    let loss = |trial: &Trial| scale.loss(trial.left, trial.part.count());
    let mut trials: Vec<Trial> = trials?.into_iter().flatten().collect();
    trials.sort_by(|a, b| loss(a).total_cmp(&loss(b)));
    let mut chosen: Vec<Trial> = Vec::new();
    for trial in trials.into_iter().take_while(|trial| loss(trial) < scale.loss(bare, 0) - LEAST_GAIN) {
        if chosen.iter().all(|other| other.part.site() != trial.part.site()) {
            chosen.push(trial);
        }
    }
    Ok(chosen.into_iter().map(|trial| settled(&view, trial)).collect())
}

/// What a sum of squares over some channels is worth, by the rule by which effects are compared.
struct Scale {
    channels: usize,
    counted: usize,
}

impl Scale {
    /// Loss in nats of a map with so many coefficients that leaves so much; a residual below the floor gains nothing.
    fn loss(&self, left: f64, coefficients: usize) -> f64 {
        let square = left / (self.channels * self.counted) as f64;
        0.5 * MOST_WORTH * self.channels as f64 * square.max(1.0).ln() + PRICE * coefficients as f64
    }
}

/// All sizes and ridges of one candidate.
fn trials(view: &View, part: &Part, monitor: &dyn Monitor) -> Result<Vec<Trial>> {
    monitor.go_on()?;
    let normals = view.normals(&view.columns(part));
    let base = view.parameters();
    let mut out = Vec::new();
    for (part, columns) in sizes(part) {
        monitor.go_on()?;
        for ridge in RIDGES {
            let left = left(&normals, base, &columns, ridge);
            out.push(Trial { part: part.clone(), ridge, left });
        }
    }
    Ok(out)
}

/// First-order coefficients of a trial from all blocks.
fn settled(view: &View, trial: Trial) -> Choice {
    let whole = sum(&view.normals(&view.columns(&trial.part)), None);
    let base = view.parameters();
    let columns: Vec<usize> = (0..trial.part.count()).collect();
    let step = step(&whole, base, &columns, trial.ridge);
    let start: Vec<f64> =
        step.map_or(vec![0.0; columns.len()], |s| s.rows(base, columns.len()).iter().copied().collect());
    Choice { part: trial.part, start, ridge: trial.ridge }
}

/// The blocks of a recording dealt to folds; none if there are too few.
fn folds(data: &Data, side: Side) -> Option<Vec<Vec<Range<usize>>>> {
    let n = data.signals.len();
    let blocks: Vec<Range<usize>> = if data.signals.kind == Kind::OperatingPoints {
        (0..n).map(|k| k..k + 1).collect()
    } else if side == Side::Mechanical || data.windows.len() >= 2 * FOLDS {
        data.windows.clone()
    } else {
        (0..BLOCKS).map(|b| b * n / BLOCKS..(b + 1) * n / BLOCKS).collect()
    };
    let mut folds = vec![Vec::new(); FOLDS];
    for (k, block) in blocks.iter().enumerate() {
        folds[k % FOLDS].push(block.clone());
    }
    (blocks.len() >= FOLDS).then_some(folds)
}

/// Smaller parts within one: each equation alone or both, fewer harmonics; with their columns.
fn sizes(part: &Part) -> Vec<(Part, Vec<usize>)> {
    let size = part.size();
    let mut wanted: Vec<Vec<usize>> = (0..part.equations.len()).map(|e| vec![e]).collect();
    if part.equations.len() > 1 {
        wanted.push((0..part.equations.len()).collect());
    }
    let second = part.second.as_ref().map_or(1, Factor::count);
    let fewer = |most: usize| HARMONICS.into_iter().filter(move |h| *h < most).chain([most]);
    let firsts: Vec<Factor> = match part.first {
        Factor::Harmonics { angle, order, count } => {
            fewer(count).map(|count| Factor::Harmonics { angle, order, count }).collect()
        }
        Factor::Fourier { angle, count } => {
            fewer(count).map(|count| Factor::Fourier { angle, count }).collect()
        }
        Factor::Swing { frequency, count } => {
            fewer(count).map(|count| Factor::Swing { frequency, count }).collect()
        }
        other => vec![other],
    };
    let mut out = Vec::new();
    for first in &firsts {
        for equations in &wanted {
            let columns =
                equations.iter().flat_map(|e| e * size..e * size + first.count() * second).collect();
            let equations = equations.iter().map(|e| part.equations[*e]).collect();
            out.push((Part { equations, first: *first, second: part.second }, columns));
        }
    }
    out
}

/// Sum of normal equations, without one of them.
fn sum(normals: &[Normal], without: Option<usize>) -> Normal {
    let size = normals[0].jtr.len();
    let mut sum = Normal { cost: 0.0, jtj: DMatrix::zeros(size, size), jtr: DVector::zeros(size) };
    for normal in normals.iter().enumerate().filter(|(k, _)| Some(*k) != without).map(|(_, n)| n) {
        sum.cost += normal.cost;
        sum.jtj += &normal.jtj;
        sum.jtr += &normal.jtr;
    }
    sum
}

/// Weight of the ridge on each of the columns (counted behind the base).
fn weight(normal: &Normal, base: usize, columns: &[usize], ridge: f64) -> f64 {
    let mean =
        columns.iter().map(|k| normal.jtj[(base + k, base + k)]).sum::<f64>() / columns.len().max(1) as f64;
    ridge * mean
}

/// Least-squares step of the base and of some columns under a ridge.
fn step(normal: &Normal, base: usize, columns: &[usize], ridge: f64) -> Option<DVector<f64>> {
    let (at, weight) = (places(base, columns), weight(normal, base, columns, ridge));
    let mut matrix = normal.jtj.select_rows(&at).select_columns(&at);
    for k in 0..at.len() {
        matrix[(k, k)] += if k < base { UNSHOWN } else { weight };
    }
    let right = normal.jtr.select_rows(&at);
    Some(-matrix.cholesky()?.solve(&right))
}

fn places(base: usize, columns: &[usize]) -> Vec<usize> {
    (0..base).chain(columns.iter().map(|k| base + k)).collect()
}

/// Sum of squares that a step from the other folds leaves on each fold, summed; infinite if there is none.
fn left(normals: &[Normal], base: usize, columns: &[usize], ridge: f64) -> f64 {
    let at = places(base, columns);
    let on = |fold: usize| -> f64 {
        let Some(step) = step(&sum(normals, Some(fold)), base, columns, ridge) else { return f64::INFINITY };
        let own = &normals[fold];
        let gram = own.jtj.select_rows(&at).select_columns(&at);
        own.cost + 2.0 * own.jtr.select_rows(&at).dot(&step) + step.dot(&(gram * &step))
    };
    (0..normals.len()).map(on).sum()
}
