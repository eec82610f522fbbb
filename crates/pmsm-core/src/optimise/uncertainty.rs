//! Uncertainty of fitted parameters: standard errors that hold for coloured residuals, and which parameters, or
//! combinations of them, a recording does not show.
//!
//! With H = JᵀJ the covariance is the sandwich H⁻¹ (Σ_b g_b g_bᵀ) H⁻¹ over blocks b of samples, all channels together,
//! that are long compared with the correlation of what drives each estimate. A block's score g_b is corrected for the
//! block's share in the fit, g_b = J_bᵀ (1 − J_b H⁻¹ J_bᵀ)^(−1/2) r_b (Bell & McCaffrey, "Bias reduction in standard
//! errors for linear regression with multi-stage samples", Survey Methodology 28 (2002)); intervals are those of
//! Student's t with one degree of freedom less than there are blocks.

mod jacobi;
mod judge;

pub use judge::Judge;

use crate::error::Result;
use crate::figures::figure;
use crate::numerics::tall;
use crate::optimise::least_squares::{self, weak_directions};
use jacobi::function_times;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use serde::Serialize;

/// Most blocks: more do not make an interval narrower.
const MOST_BLOCKS: usize = 100;
/// Fewest blocks, and the fewest per parameter.
const FEWEST_BLOCKS: usize = 12;
const BLOCKS_PER_PARAMETER: usize = 2;
/// Length of a block over the time for which the residual remembers itself.
const BLOCK_OVER_MEMORY: f64 = 10.0;
/// Least share of a block's score that the rest of the recording must confirm.
const LEAST_REST: f64 = 0.05;
/// A combination counts as shown if its standard error is below this share of a change that matters.
const SHOWN: f64 = 0.5;

/// Covariance of least-squares parameters.
#[derive(Debug, Clone)]
pub struct Spread {
    /// In the parameters' units; infinite variance where the data show nothing.
    pub covariance: DMatrix<f64>,
    /// Number of blocks from which it was estimated.
    pub blocks: usize,
    /// Whether the blocks are long compared with the residual's memory. If not, the residual swings so slowly that
    /// the recording is only a few independent looks at the machine, and the covariance is too small.
    pub settled: bool,
    /// H = JᵀJ, the covariance H⁻¹ that white residuals of variance one would have, and Jᵀr.
    information: DMatrix<f64>,
    naive: DMatrix<f64>,
    gradient: DVector<f64>,
}

/// Covariance from stacked weighted residuals (channel by channel, `rows_per_channel` samples each) and their Jacobian.
///
/// # Panics
/// If the rows of the arguments differ, or are no multiple of `rows_per_channel`.
pub fn spread(jacobian: &DMatrix<f64>, residual: &DVector<f64>, rows_per_channel: usize) -> Spread {
    let (rows, dim) = jacobian.shape();
    let n = rows_per_channel;
    assert!(rows == residual.len() && n > 0 && rows % n == 0, "stacked channels");
    let information = tall::gram(jacobian);
    let naive = least_squares::covariance(&information, None, &vec![true; dim]);
    let shown: Vec<usize> = (0..dim).filter(|k| naive[(*k, *k)].is_finite()).collect();
    // One score per sample and parameter, all channels together.
    let mut scores = DMatrix::<f64>::zeros(n, dim);
    // As slices: elements that a matrix hands out one by one take several times as long.
    let slopes = jacobian.as_slice().chunks_exact(rows.max(1));
    for (scores, slopes) in scores.as_mut_slice().chunks_exact_mut(n).zip(slopes) {
        let channels = slopes.chunks_exact(n).zip(residual.as_slice().chunks_exact(n));
        for (slopes, errors) in channels {
            for ((score, slope), error) in scores.iter_mut().zip(slopes).zip(errors) {
                *score += slope * error;
            }
        }
    }
    let gradient = DVector::from_iterator(dim, columns(&scores, n).map(tall::sum));
    let mut covariance = naive.clone();
    if shown.is_empty() {
        return Spread { covariance, blocks: 0, settled: false, information, naive, gradient };
    }
    let whitener = whitener(&information);
    // Column k of `influence` times a score is what that score moved parameter k.
    let influence = (&whitener * whitener.transpose()).select_columns(&shown);
    let (length, settled) = block_length(&scores * influence);
    let blocks = n.div_ceil(length);
    let kept = whitener.ncols();
    let mut meat = DMatrix::zeros(kept, kept);
    let (mut axes, mut white, mut half) = (meat.clone(), meat.clone(), DMatrix::zeros(kept, dim));
    let (mut share, mut score) = (DMatrix::zeros(dim, dim), DVector::zeros(dim));
    let (mut pull, mut corrected) = (DVector::zeros(kept), DVector::zeros(kept));
    for block in 0..blocks {
        let (start, count) = (block * length, length.min(n - block * length));
        share.fill(0.0);
        let channels = (0..rows).step_by(n).map(|first| first + start..first + start + count);
        tall::add_gram(jacobian, channels, &mut share);
        for (score, own) in score.iter_mut().zip(columns(&scores, n)) {
            *score = tall::sum(&own[start..start + count]);
        }
        half.gemm_tr(1.0, &whitener, &share, 0.0);
        white.gemm(1.0, &half, &whitener, 0.0);
        pull.gemv_tr(1.0, &whitener, &score, 0.0);
        let rest = |x: f64| (1.0 - x).clamp(LEAST_REST, 1.0).sqrt().recip();
        function_times(&mut white, &mut axes, &pull, rest, &mut corrected);
        meat.ger(1.0, &corrected, &corrected, 1.0);
    }
    let sandwich = &whitener * meat * whitener.transpose();
    for &row in &shown {
        for &column in &shown {
            covariance[(row, column)] = sandwich[(row, column)];
        }
    }
    Spread { covariance, blocks, settled, information, naive, gradient }
}

impl Spread {
    /// Mean factor by which the colour of the residuals widens the variance of some parameters over that with white residuals of variance one;
    /// `None` where the data do not show one of them.
    pub fn widened(&self, parameters: &[usize]) -> Option<f64> {
        let block = |of: &DMatrix<f64>| of.select_rows(parameters).select_columns(parameters);
        let (naive, covariance) = (block(&self.naive), block(&self.covariance));
        if parameters.is_empty() || naive.iter().chain(covariance.iter()).any(|x| !x.is_finite()) {
            return None;
        }
        Some(naive.cholesky()?.solve(&covariance).trace() / parameters.len() as f64)
    }

    /// Square of these values of some parameters in units of their covariance, the statistic of Wald; `None` as for [`Self::widened`].
    pub fn square(&self, values: &[(usize, f64)]) -> Option<f64> {
        let places: Vec<usize> = values.iter().map(|x| x.0).collect();
        let covariance = self.covariance.select_rows(&places).select_columns(&places);
        if places.is_empty() || covariance.iter().any(|x| !x.is_finite()) {
            return None;
        }
        let value = DVector::from_iterator(values.len(), values.iter().map(|x| x.1));
        Some(value.dot(&covariance.cholesky()?.solve(&value)))
    }

    /// Whether all derivatives that it rests on are finite: their sums of squares tell.
    pub fn is_finite(&self) -> bool {
        self.information.iter().all(|x| x.is_finite())
    }
}

/// The columns, `n` rows each, as they lie in memory.
fn columns(matrix: &DMatrix<f64>, n: usize) -> impl Iterator<Item = &[f64]> {
    matrix.as_slice().chunks_exact(n)
}

/// [`spread`]'s covariance.
///
/// # Panics
/// As [`spread`].
pub fn covariance(jacobian: &DMatrix<f64>, residual: &DVector<f64>, rows_per_channel: usize) -> DMatrix<f64> {
    spread(jacobian, residual, rows_per_channel).covariance
}

/// W with W Wᵀ = H⁺ and Wᵀ H W = 1 on what the data show.
fn whitener(information: &DMatrix<f64>) -> DMatrix<f64> {
    let dim = information.nrows();
    let scale: Vec<f64> = information.diagonal().iter().map(|x| x.max(f64::MIN_POSITIVE).sqrt()).collect();
    let unit = DMatrix::from_fn(dim, dim, |r, c| information[(r, c)] / (scale[r] * scale[c]));
    let eigen = SymmetricEigen::new(unit);
    let floor = 1e-12 * eigen.eigenvalues.max();
    let kept: Vec<usize> = (0..dim).filter(|k| eigen.eigenvalues[*k] > floor).collect();
    DMatrix::from_fn(dim, kept.len(), |r, c| {
        eigen.eigenvectors[(r, kept[c])] / (scale[r] * eigen.eigenvalues[kept[c]].sqrt())
    })
}

/// Block length in samples and whether it is long enough, from the moves of each parameter (a column) by each sample (a
/// row). The variance of sums over blocks, relative to that of independent samples, is the time for which the moves
/// remember themselves.
fn block_length(moves: DMatrix<f64>) -> (usize, bool) {
    let (n, dim) = moves.shape();
    let fewest = FEWEST_BLOCKS.max(BLOCKS_PER_PARAMETER * dim);
    let (least, most) = (n.div_ceil(MOST_BLOCKS).max(1), (n / fewest).max(1));
    let mut columns: Vec<Vec<f64>> = columns(&moves, n).map(<[f64]>::to_vec).collect();
    let singles: Vec<f64> = columns.iter().map(|x| square(x)).collect();
    let memory = |sums: &[Vec<f64>]| -> f64 {
        sums.iter().zip(&singles).fold(1.0, |worst: f64, (sums, single)| {
            // Sums that cancel (a residual that alternates) make the sandwich too wide at worst.
            if *single > 0.0 { worst.max(square(sums) / single) } else { worst }
        })
    };
    let mut length = 1;
    while length <= most {
        // A memory is one sample at least.
        if length as f64 >= BLOCK_OVER_MEMORY && length as f64 >= BLOCK_OVER_MEMORY * memory(&columns) {
            return (length.max(least).min(most), true);
        }
        length *= 2;
        columns.iter_mut().for_each(halve);
    }
    let summed = |column: &[f64]| column.chunks(most).map(|x| x.iter().sum()).collect();
    let columns: Vec<Vec<f64>> = moves.as_slice().chunks_exact(n).map(summed).collect();
    (most, most as f64 >= 0.5 * BLOCK_OVER_MEMORY * memory(&columns))
}

/// Sum of squares, in four sums that do not wait for each other.
fn square(x: &[f64]) -> f64 {
    let (quads, rest) = x.as_chunks::<4>();
    let mut sums = [0.0; 4];
    for x in quads {
        for k in 0..4 {
            sums[k] += x[k] * x[k];
        }
    }
    (sums[0] + sums[2]) + (sums[1] + sums[3]) + rest.iter().map(|x| x * x).sum::<f64>()
}

/// Adds neighbours in pairs; the last one may stay alone.
fn halve(x: &mut Vec<f64>) {
    let pairs = x.len() / 2;
    for k in 0..pairs {
        x[k] = x[2 * k] + x[2 * k + 1];
    }
    if x.len() % 2 == 1 {
        x[pairs] = x[2 * pairs];
    }
    x.truncate(x.len().div_ceil(2));
}

/// Half width of a 95 % interval in standard errors when the covariance comes from this many blocks: Student's t
/// (Abramowitz & Stegun 26.7.5).
pub fn quantile(blocks: usize) -> f64 {
    let (z, nu) = (1.959_963_985_f64, blocks.saturating_sub(1).max(1) as f64);
    let z2 = z * z;
    let first = z * (z2 + 1.0) / 4.0;
    let second = z * ((5.0 * z2 + 16.0) * z2 + 3.0) / 96.0;
    let third = z * (((3.0 * z2 + 19.0) * z2 + 17.0) * z2 - 15.0) / 384.0;
    z + (first + (second + third / nu) / nu) / nu
}

/// An estimate as it is written to files.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Estimate {
    /// The value in `unit`; `None` if nothing is known of it.
    pub value: Option<f64>,
    /// Its standard error.
    pub stderr: Option<f64>,
    /// Its 95 % interval.
    pub ci95: Option<[f64; 2]>,
    /// SI unit.
    pub unit: &'static str,
    /// Why there is no uncertainty, or no value.
    pub why_none: Option<String>,
}

impl Estimate {
    /// A value with its standard error; the interval is `quantile` standard errors to each side.
    pub fn known(value: f64, stderr: f64, quantile: f64, unit: &'static str) -> Self {
        let reach = quantile * stderr;
        let ci95 = Some([value - reach, value + reach]);
        Self { value: Some(value), stderr: Some(stderr), ci95, unit, why_none: None }
    }

    /// A value without uncertainty, or no value at all.
    pub fn bare(value: Option<f64>, unit: &'static str, why: impl Into<String>) -> Self {
        Self { value, stderr: None, ci95: None, unit, why_none: Some(why.into()) }
    }
}

/// Parameters that a recording does not show.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NotShown {
    /// Their names; several if only a combination of them is missing.
    pub parameters: Vec<String>,
    /// Why, in a plain sentence, and what recording would show them.
    pub why: String,
}

/// Says which of the parameters `names`, or which combinations, are not shown: those that could change by half of
/// `sizes` (in the parameters' units: how large a change matters) within one standard error of `spread`. `advice` says
/// for a name what kind of recording shows it.
///
/// # Errors
/// Those of [`weak_directions`], if the Jacobian was not finite.
pub fn not_shown(
    names: &[&str],
    sizes: &[f64],
    spread: &Spread,
    advice: impl Fn(&str) -> String,
) -> Result<Vec<NotShown>> {
    let Spread { information, naive, .. } = spread;
    let dim = names.len();
    // How much the residual's size and colour widen the errors that H alone would give.
    let widen = (0..dim)
        .map(|k| spread.covariance[(k, k)] / naive[(k, k)])
        .filter(|x| x.is_finite())
        .fold(0.0, f64::max);
    let scaled = DMatrix::from_fn(dim, dim, |r, c| information[(r, c)] * sizes[r] * sizes[c]);
    let largest =
        if scaled.iter().all(|x| x.is_finite()) { scaled.symmetric_eigenvalues().max() } else { 0.0 };
    let threshold = if largest > 0.0 { (widen / (SHOWN * SHOWN) / largest).clamp(1e-12, 1.0) } else { 1.0 };
    let weak = weak_directions(information, sizes, threshold)?;
    Ok(weak
        .into_iter()
        .map(|direction| {
            let parameters: Vec<String> = direction.parameters.iter().map(|k| names[*k].to_owned()).collect();
            let advice: Vec<String> = parameters.iter().map(|name| advice(name)).collect();
            let why = match parameters.as_slice() {
                [one] => format!(
                    "the recording hardly depends on {one}: a change of {} would go unnoticed; {}",
                    figure(SHOWN * sizes[direction.parameters[0]], 3),
                    advice[0]
                ),
                several => format!(
                    "the recording does not tell {} apart: they can change together unnoticed; {}",
                    several.join(", "),
                    advice.join(", or ")
                ),
            };
            NotShown { parameters, why }
        })
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optimise::swarm::{Swarm, SwarmSettings};

    /// Uniform numbers in [−1, 1), another sequence for each seed.
    fn noise(n: usize, seed: u64) -> Vec<f64> {
        let settings = SwarmSettings { particles: n, ..SwarmSettings::default() };
        Swarm::new(&settings, &[(-1.0, 1.0)], seed).unwrap().positions().to_vec()
    }

    /// A level and a slope under noise with memory 1/(1 − rho), fitted; returns estimates and spread.
    fn line(seed: u64, rho: f64) -> (DVector<f64>, Spread) {
        let n = 8000;
        let mut last = 0.0;
        let error: Vec<f64> = noise(n, seed)
            .iter()
            .map(|e| {
                last = rho * last + e;
                last
            })
            .collect();
        let jacobian = DMatrix::from_fn(n, 2, |k, c| if c == 0 { 1.0 } else { k as f64 / n as f64 - 0.5 });
        let error = DVector::from_vec(error);
        let found = (jacobian.tr_mul(&jacobian)).try_inverse().unwrap() * jacobian.tr_mul(&error);
        let residual = &error - &jacobian * &found;
        let spread = spread(&jacobian, &residual, n);
        (found, spread)
    }

    #[test]
    fn colour_widens_as_its_memory_does() {
        let mean =
            |rho: f64| (0..20).map(|seed| line(seed, rho).1.widened(&[0, 1]).unwrap()).sum::<f64>() / 20.0;
        // Uniform numbers in [-1, 1) have the variance 1/3, a sum of theirs with memory that over (1 - rho)^2.
        assert!((mean(0.0) / (1.0 / 3.0) - 1.0).abs() < 0.1, "{}", mean(0.0));
        assert!((mean(0.9) / (100.0 / 3.0) - 1.0).abs() < 0.2, "{}", mean(0.9));
        let unseen = DMatrix::from_fn(8000, 2, |_, c| if c == 0 { 1.0 } else { 0.0 });
        let spread = spread(&unseen, &DVector::from_vec(noise(8000, 1)), 8000);
        assert!(spread.widened(&[0]).is_some() && spread.widened(&[0, 1]).is_none());
        assert!(spread.widened(&[]).is_none() && spread.square(&[]).is_none());
    }

    #[test]
    fn the_statistic_of_values_is_their_square_over_the_covariance() {
        let spread = line(3, 0.9).1;
        let one = spread.square(&[(1, 0.5)]).unwrap();
        assert!((one * spread.covariance[(1, 1)] / 0.25 - 1.0).abs() < 1e-9);
        // Together two values of no correlation count as the sum of their squares.
        let both = spread.square(&[(0, 0.1), (1, 0.5)]).unwrap();
        let sum = one + spread.square(&[(0, 0.1)]).unwrap();
        assert!((both / sum - 1.0).abs() < 0.3, "{both} {sum}");
    }

    #[test]
    fn intervals_cover_under_white_and_coloured_noise() {
        for rho in [0.0, 0.9] {
            let mut inside = 0;
            for seed in 0..300 {
                let (found, spread) = line(seed, rho);
                assert!(spread.settled);
                for k in 0..2 {
                    let reach = quantile(spread.blocks) * spread.covariance[(k, k)].sqrt();
                    inside += usize::from(found[k].abs() <= reach);
                }
            }
            let covered = inside as f64 / 600.0;
            assert!((0.92..=0.975).contains(&covered), "{rho}: {covered}");
        }
    }

    #[test]
    fn a_residual_that_only_drifts_is_told_apart() {
        let n = 1000;
        let jacobian = DMatrix::from_element(n, 1, 1.0);
        let drift = DVector::from_fn(n, |k, _| (k as f64 / n as f64 * std::f64::consts::TAU).sin());
        assert!(!spread(&jacobian, &drift, n).settled);
    }

    #[test]
    fn parameters_that_stand_in_for_each_other_are_named() {
        let n = 400;
        let e = noise(n, 3);
        let jacobian = DMatrix::from_fn(n, 3, |k, c| match c {
            0 => (k as f64 * 0.1).sin(),
            1 => 2.0 * (k as f64 * 0.1).sin(),
            _ => (k as f64 * 0.07).cos(),
        });
        let spread = spread(&jacobian, &DVector::from_vec(e), n);
        assert!(spread.covariance[(0, 0)].is_infinite() && spread.covariance[(2, 2)].is_finite());
        let told = not_shown(&["x", "y", "z"], &[1.0; 3], &spread, |name| format!("vary {name}"));
        let told = told.unwrap();
        assert_eq!(told.len(), 1);
        let mut names = told[0].parameters.clone();
        names.sort();
        assert_eq!(names, ["x", "y"]);
        assert!(told[0].why.contains("vary x"), "{}", told[0].why);
    }

    #[test]
    fn quantiles_are_those_of_the_t_table() {
        for (blocks, table) in [(13, 2.179), (31, 2.042), (101, 1.984)] {
            assert!((quantile(blocks) - table).abs() < 2e-3, "{blocks}: {}", quantile(blocks));
        }
    }
}
