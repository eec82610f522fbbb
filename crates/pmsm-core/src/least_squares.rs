//! Levenberg–Marquardt for problems too long to store a Jacobian: the problem delivers its normal equations.
//!
//! With residuals r(p) = weighted (model − data) and J = ∂r/∂p, the cost is c(p) = rᵀr and a step s solves
//!
//! ```text
//! (JᵀJ + μ D²) s = −Jᵀr,    D² = running maximum of diag(JᵀJ)
//! ```
//!
//! so that the result does not depend on the units of the parameters (Moré 1978). The damping μ follows the ratio of
//! actual to predicted reduction (Nielsen 1999; Madsen, Nielsen & Tingleff, "Methods for non-linear least squares
//! problems", 2004, section 3.2). Bounds: a parameter at its bound whose gradient pushes outward is frozen for that
//! iteration; one that a step would carry across its bound is put there and the others are solved for again.

use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};

use crate::error::{Error, Result};
use crate::monitor::Monitor;

/// Ridge of the step that counts as undamped, relative to the unit diagonal of the scaled JᵀJ: the least that lets a
/// rank-deficient matrix be factorised in double precision.
const RIDGE: f64 = 1e-14;
/// Damping at which a rejected step has become pure gradient descent of no length: no lower cost will be found.
const MAX_DAMPING: f64 = 1e16;
/// Smallest damping after a rejected undamped step.
const MIN_RAISED_DAMPING: f64 = 1e-6;
/// Smallest ratio of actual to predicted reduction that is accepted.
const MIN_GAIN: f64 = 1e-4;
/// Relative reduction that summation error of a long cost can hide. A run that finds no lower cost while the model
/// promises no more than this has converged.
const COST_NOISE: f64 = 1e-8;
/// Relative eigenvalue of the information matrix with unit diagonal below which a direction is lost in the rounding
/// of the normal equations (columns dependent to about 1e-6).
const UNDETERMINED: f64 = 1e-12;

/// Normal equations at one point.
#[derive(Debug, Clone, PartialEq)]
pub struct Normal {
    /// Sum of squared weighted residuals, rᵀr.
    pub cost: f64,
    /// JᵀJ, dim × dim.
    pub jtj: DMatrix<f64>,
    /// Jᵀr, half the gradient of the cost, with r = model − data.
    pub jtr: DVector<f64>,
}

impl Normal {
    fn is_finite(&self) -> bool {
        self.cost.is_finite() && self.jtj.iter().chain(self.jtr.iter()).all(|x| x.is_finite())
    }
}

/// A sum of squares to be minimised.
pub trait Problem: Sync {
    /// Number of parameters.
    fn dim(&self) -> usize;
    /// Sum of squared weighted residuals at `p`. Not finite where the model cannot be evaluated.
    fn cost(&self, p: &[f64]) -> f64;
    /// Cost and normal equations at `p`.
    fn normal(&self, p: &[f64]) -> Normal;
}

/// When to stop, and how carefully to begin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Most accepted or abandoned steps, at least 1.
    pub max_iterations: usize,
    /// Converged once the undamped step promises to lower the cost by no more than this share of it, ≥ 0. The promise
    /// is the squared distance to the minimum in standard errors, divided by the degrees of freedom.
    pub cost_tolerance: f64,
    /// Converged once the undamped step is no longer than this share of the parameters, both measured in the norm
    /// that weights each parameter with its column of J, ≥ 0.
    pub step_tolerance: f64,
    /// First μ, ≥ 0; 0 begins with a Gauss–Newton step.
    pub initial_damping: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { max_iterations: 100, cost_tolerance: 1e-14, step_tolerance: 1e-10, initial_damping: 1e-3 }
    }
}

impl Settings {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`Error::Quantity`] naming the first setting that is out of range.
    pub fn validate(&self) -> Result<()> {
        if self.max_iterations == 0 {
            return Err(Error::quantity("max_iterations", 0.0, "", "it must be at least 1"));
        }
        for (name, value) in [
            ("cost_tolerance", self.cost_tolerance),
            ("step_tolerance", self.step_tolerance),
            ("initial_damping", self.initial_damping),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(Error::quantity(name, value, "", "it must be finite and not negative"));
            }
        }
        Ok(())
    }
}

/// Why a fit ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// A tolerance is met.
    Converged,
    /// The iterations ran out, or no step lowers the cost although the normal equations promise one.
    IterationLimit,
    /// The monitor asked to stop.
    Interrupted,
    /// Cost or normal equations are not finite at the start, or at every point tried around the last one.
    NotFinite,
}

/// Outcome of [`minimise`]: always the best point whose normal equations are known.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// Parameters, within their bounds.
    pub parameters: Vec<f64>,
    /// Sum of squared weighted residuals there.
    pub cost: f64,
    /// Normal equations there.
    pub normal: Normal,
    /// Number of iterations: steps accepted, and one more if the last search found none.
    pub iterations: usize,
    /// Why it ended.
    pub status: Status,
    /// Which parameters lie on a bound.
    pub at_bound: Vec<bool>,
}

/// Minimises `problem` from `start` within `bounds` (one `(low, high)` per parameter, infinite where there is none;
/// `low == high` fixes a parameter). A start outside is moved to its bound. The start is always evaluated, so that an
/// interrupted fit still has a cost; the monitor is asked before every further evaluation. A trial point with a cost
/// that is not finite is a rejected step. A direction that JᵀJ does not determine is left where it is.
///
/// # Errors
/// Settings that [`Settings::validate`] refuses; a start, bounds or normal equations that do not have the dimension of
/// the problem; a start that is not finite; bounds that are NaN or reversed.
pub fn minimise(
    problem: &dyn Problem,
    start: &[f64],
    bounds: &[(f64, f64)],
    settings: &Settings,
    monitor: &dyn Monitor,
) -> Result<Fit> {
    settings.validate()?;
    let dim = problem.dim();
    check_box(dim, start, bounds)?;
    let mut p: Vec<f64> = start.iter().zip(bounds).map(|(&x, &(low, high))| x.clamp(low, high)).collect();
    let mut normal = evaluate(problem, &p)?;
    let mut scale = DVector::zeros(dim);
    let mut damping = settings.initial_damping;
    let mut iterations = 0;
    let status = loop {
        if !normal.is_finite() {
            break if monitor.cancelled() { Status::Interrupted } else { Status::NotFinite };
        }
        let column = normal.jtj.diagonal().map(|x| x.max(0.0).sqrt());
        scale = scale.sup(&column);
        let newton = Step::solve(&normal, &p, bounds, &column, RIDGE);
        let length = newton.step.component_mul(&column).norm();
        let reach = DVector::from_column_slice(&p).component_mul(&column).norm();
        if newton.promise <= settings.cost_tolerance * normal.cost
            || length <= settings.step_tolerance * reach
        {
            break Status::Converged;
        }
        if iterations == settings.max_iterations {
            break Status::IterationLimit;
        }
        iterations += 1;
        monitor.report("least squares", iterations as f64 / settings.max_iterations as f64);
        match descend(problem, &normal, &p, bounds, &scale, &mut damping, monitor)? {
            Search::Found(point, there) => (p, normal) = (point, there),
            Search::Cancelled => break Status::Interrupted,
            Search::NotFinite => break Status::NotFinite,
            Search::Nothing if newton.promise <= COST_NOISE * normal.cost => break Status::Converged,
            Search::Nothing => break Status::IterationLimit,
        }
    };
    let at_bound = p.iter().zip(bounds).map(|(&x, &(low, high))| x <= low || x >= high).collect();
    Ok(Fit { parameters: p, cost: normal.cost, normal, iterations, status, at_bound })
}

fn check_box(dim: usize, start: &[f64], bounds: &[(f64, f64)]) -> Result<()> {
    if dim == 0 || start.len() != dim || bounds.len() != dim {
        return Err(Error::unusable(
            format!("{} starting values and {} bounds for {dim} parameters", start.len(), bounds.len()),
            "give one of each per parameter, and at least one parameter",
        ));
    }
    for (k, (x, &(low, high))) in start.iter().zip(bounds).enumerate() {
        let reachable = low <= high && low < f64::INFINITY && high > f64::NEG_INFINITY;
        if !(x.is_finite() && reachable) {
            return Err(Error::unusable(
                format!("parameter {k} starts at {x} with bounds {low} and {high}"),
                "the start must be finite and the lower bound come first",
            ));
        }
    }
    Ok(())
}

fn evaluate(problem: &dyn Problem, p: &[f64]) -> Result<Normal> {
    let (normal, dim) = (problem.normal(p), p.len());
    if normal.jtj.shape() != (dim, dim) || normal.jtr.len() != dim {
        return Err(Error::unusable(
            format!("normal equations of shape {:?} for {dim} parameters", normal.jtj.shape()),
            "the problem must deliver a square matrix and a vector of its dimension",
        ));
    }
    Ok(normal)
}

/// Outcome of one search for a lower cost.
enum Search {
    Found(Vec<f64>, Normal),
    Nothing,
    NotFinite,
    Cancelled,
}

/// Raises the damping until a step lowers the cost as promised, and adapts it to how well the promise was kept.
fn descend(
    problem: &dyn Problem,
    normal: &Normal,
    p: &[f64],
    bounds: &[(f64, f64)],
    scale: &DVector<f64>,
    damping: &mut f64,
    monitor: &dyn Monitor,
) -> Result<Search> {
    let (mut growth, mut tried, mut usable) = (2.0, false, false);
    while *damping <= MAX_DAMPING {
        let step = Step::solve(normal, p, bounds, scale, damping.max(RIDGE));
        let trial = step.from(p, bounds);
        if trial == p {
            break;
        }
        if step.reduction > 0.0 {
            if monitor.cancelled() {
                return Ok(Search::Cancelled);
            }
            let cost = problem.cost(&trial);
            tried = true;
            let gain = (normal.cost - cost) / step.reduction;
            if gain > MIN_GAIN {
                let there = evaluate(problem, &trial)?;
                if there.is_finite() {
                    *damping *= (1.0 - (2.0 * gain - 1.0).powi(3)).max(1.0 / 3.0);
                    return Ok(Search::Found(trial, there));
                }
            } else {
                usable |= cost.is_finite();
            }
        }
        *damping = (*damping * growth).max(MIN_RAISED_DAMPING);
        growth *= 2.0;
    }
    Ok(if tried && !usable { Search::NotFinite } else { Search::Nothing })
}

/// A step within the bounds, and what the normal equations say of it.
struct Step {
    step: DVector<f64>,
    /// Predicted reduction of the cost, −2 gᵀs − sᵀJᵀJ s.
    reduction: f64,
    /// The larger of |gᵀs| and sᵀJᵀJ s: zero at a constrained minimum only, even where bounds cut the step so that
    /// the prediction is not positive.
    promise: f64,
}

impl Step {
    /// Solves (JᵀJ + damping·D²) s = −Jᵀr, D = diag(`scale`), for the parameters that are neither frozen nor carried
    /// to a bound.
    fn solve(normal: &Normal, p: &[f64], bounds: &[(f64, f64)], scale: &DVector<f64>, damping: f64) -> Self {
        let (jtj, jtr, dim) = (&normal.jtj, &normal.jtr, p.len());
        let mut step = DVector::zeros(dim);
        let mut free: Vec<usize> = (0..dim)
            .filter(|&k| {
                let (low, high) = bounds[k];
                let outward = (p[k] <= low && jtr[k] >= 0.0) || (p[k] >= high && jtr[k] <= 0.0);
                scale[k] > 0.0 && low < high && !outward
            })
            .collect();
        while !free.is_empty() {
            // Right-hand side −g − JᵀJ·s with s the moves of those already carried to a bound.
            let rhs = -(jtr + jtj * &step);
            let matrix = DMatrix::from_fn(free.len(), free.len(), |i, j| {
                jtj[(free[i], free[j])] / (scale[free[i]] * scale[free[j]])
            });
            let rhs = DVector::from_fn(free.len(), |i, _| rhs[free[i]] / scale[free[i]]);
            let solution = solve_damped(&matrix, &rhs, damping);
            let mut kept = Vec::with_capacity(free.len());
            for (i, &k) in free.iter().enumerate() {
                let move_ = solution[i] / scale[k];
                let (low, high) = bounds[k];
                if p[k] + move_ < low {
                    step[k] = low - p[k];
                } else if p[k] + move_ > high {
                    step[k] = high - p[k];
                } else {
                    kept.push((k, move_));
                }
            }
            if kept.len() == free.len() {
                for &(k, move_) in &kept {
                    step[k] = move_;
                }
                break;
            }
            free = kept.into_iter().map(|(k, _)| k).collect();
        }
        let slope = jtr.dot(&step);
        let curvature = step.dot(&(jtj * &step));
        Self { reduction: -2.0 * slope - curvature, promise: slope.abs().max(curvature), step }
    }

    /// The point this step leads to, exactly on a bound where it reaches one.
    fn from(&self, p: &[f64], bounds: &[(f64, f64)]) -> Vec<f64> {
        let ends = p.iter().zip(self.step.iter()).zip(bounds);
        ends.map(|((&x, &move_), &(low, high))| (x + move_).clamp(low, high)).collect()
    }
}

/// Solves (`matrix` + damping·I) x = `rhs`; rounding that leaves the matrix indefinite is met with more damping.
fn solve_damped(matrix: &DMatrix<f64>, rhs: &DVector<f64>, mut damping: f64) -> DVector<f64> {
    loop {
        let mut damped = matrix.clone();
        for k in 0..rhs.len() {
            damped[(k, k)] += damping;
        }
        if let Some(factor) = Cholesky::new(damped) {
            return factor.solve(rhs);
        }
        if damping > MAX_DAMPING {
            return DVector::zeros(rhs.len());
        }
        damping *= 10.0;
    }
}

/// Covariance of the free parameters, dim × dim in the parameters' units squared.
///
/// With H = JᵀJ weighted by 1/σ it is H⁻¹ (multiply by the residual variance if the weights are not 1/σ); with `meat`
/// M, the covariance of Jᵀr (which autocorrelated residuals make differ from H), it is the sandwich H⁻¹ M H⁻¹. H is
/// inverted with unit diagonal, D⁻¹ (D⁻¹ H D⁻¹)⁺ D⁻¹ with D² = diag H, through its eigenvalues; those below 1e-12 of
/// the largest belong to directions that the data do not show. A parameter that takes part in such a direction has
/// an infinite variance and zero covariances. A parameter that is not free has zeros throughout. If `jtj` or `meat`
/// is not finite, nothing is known: every free variance is infinite.
///
/// # Panics
/// If the dimensions of the arguments differ.
pub fn covariance(jtj: &DMatrix<f64>, meat: Option<&DMatrix<f64>>, free: &[bool]) -> DMatrix<f64> {
    let dim = free.len();
    assert_eq!(jtj.shape(), (dim, dim), "one free flag per row and column of jtj");
    let mut result = DMatrix::zeros(dim, dim);
    let index: Vec<usize> = (0..dim).filter(|&k| free[k]).collect();
    let known = jtj.iter().chain(meat.into_iter().flat_map(|m| m.iter())).all(|x| x.is_finite());
    let scale: Vec<f64> = index.iter().map(|&k| jtj[(k, k)].max(0.0).sqrt()).collect();
    let shown: Vec<usize> = (0..index.len()).filter(|&i| known && scale[i] > 0.0).collect();
    let n = shown.len();
    for &k in &index {
        result[(k, k)] = f64::INFINITY;
    }
    if n == 0 {
        return result;
    }
    let at = |i: usize| index[shown[i]];
    let unit = DMatrix::from_fn(n, n, |i, j| jtj[(at(i), at(j))] / (scale[shown[i]] * scale[shown[j]]));
    let eigen = SymmetricEigen::new(unit);
    let floor = UNDETERMINED * eigen.eigenvalues.max();
    let mut inverse = DMatrix::zeros(n, n);
    let mut lost = vec![false; n];
    for (&value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if value > floor {
            inverse.ger(1.0 / value, &vector, &vector, 1.0);
        } else {
            for i in 0..n {
                // A smaller share would add less than 1/H_ii to the variance if the eigenvalue were at the floor.
                lost[i] |= vector[i].abs() > UNDETERMINED.sqrt();
            }
        }
    }
    if let Some(meat) = meat {
        assert_eq!(meat.shape(), (dim, dim), "meat has the shape of jtj");
        let scaled =
            DMatrix::from_fn(n, n, |i, j| meat[(at(i), at(j))] / (scale[shown[i]] * scale[shown[j]]));
        inverse = &inverse * scaled * &inverse;
    }
    for i in (0..n).filter(|&i| !lost[i]) {
        for j in (0..n).filter(|&j| !lost[j]) {
            result[(at(i), at(j))] = inverse[(i, j)] / (scale[shown[i]] * scale[shown[j]]);
        }
    }
    result
}

/// A combination of parameters that the data do not determine.
#[derive(Debug, Clone, PartialEq)]
pub struct WeakDirection {
    /// Parameters that make up the combination, the largest share first.
    pub parameters: Vec<usize>,
    /// Their shares in units of `scale`, in the same order; signs are relative to each other.
    pub weights: Vec<f64>,
    /// √(λ_max/λ): how many times less sharply than the best-determined combination this one is seen; infinite if
    /// not at all.
    pub condition: f64,
}

/// Combinations of parameters that are not determined: eigenvectors of S·JᵀJ·S, S = diag(`scale`), whose eigenvalue is
/// below `threshold` times the largest, the weakest first.
///
/// `scale` says how large a change of each parameter matters, in its unit: its typical size for "known in percent", or
/// 1/√(JᵀJ)ᵢᵢ to look for parameters that merely stand in for each other. A parameter with scale 0 is left out. A
/// parameter belongs to a combination if its share is at least a quarter of the largest one's.
///
/// # Errors
/// [`Error::Unusable`] if dimensions differ, or a value is not finite, or a scale or the threshold is negative.
pub fn weak_directions(jtj: &DMatrix<f64>, scale: &[f64], threshold: f64) -> Result<Vec<WeakDirection>> {
    let proper = |x: &f64| x.is_finite() && *x >= 0.0;
    if jtj.shape() != (scale.len(), scale.len())
        || !jtj.iter().all(|x| x.is_finite())
        || !scale.iter().all(proper)
        || !proper(&threshold)
    {
        return Err(Error::unusable(
            format!("weak directions of a matrix {:?} with scale {scale:?}", jtj.shape()),
            "matrix, scale and threshold must be finite and fit together, the latter two not negative",
        ));
    }
    let index: Vec<usize> = (0..scale.len()).filter(|&k| scale[k] > 0.0).collect();
    if index.is_empty() {
        return Ok(Vec::new());
    }
    let scaled = DMatrix::from_fn(index.len(), index.len(), |i, j| {
        jtj[(index[i], index[j])] * scale[index[i]] * scale[index[j]]
    });
    let eigen = SymmetricEigen::new(scaled);
    let largest = eigen.eigenvalues.max().max(0.0);
    // What rounding leaves of an eigenvalue that is zero.
    let noise = index.len() as f64 * f64::EPSILON * largest;
    let mut weak = Vec::new();
    for (&value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if value > noise && value >= threshold * largest {
            continue;
        }
        let mut order: Vec<usize> =
            (0..index.len()).filter(|&i| vector[i].abs() >= 0.25 * vector.amax()).collect();
        order.sort_by(|&i, &j| vector[j].abs().total_cmp(&vector[i].abs()));
        weak.push(WeakDirection {
            parameters: order.iter().map(|&i| index[i]).collect(),
            weights: order.iter().map(|&i| vector[i]).collect(),
            condition: if value > noise { (largest / value).sqrt() } else { f64::INFINITY },
        });
    }
    weak.sort_by(|a, b| b.condition.total_cmp(&a.condition));
    Ok(weak)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::monitor::{Silent, StopFlag};

    const FREE: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);

    /// r = A p − b.
    struct Linear {
        a: DMatrix<f64>,
        b: DVector<f64>,
    }

    impl Linear {
        fn residual(&self, p: &[f64]) -> DVector<f64> {
            &self.a * DVector::from_column_slice(p) - &self.b
        }
    }

    impl Problem for Linear {
        fn dim(&self) -> usize {
            self.a.ncols()
        }
        fn cost(&self, p: &[f64]) -> f64 {
            self.residual(p).norm_squared()
        }
        fn normal(&self, p: &[f64]) -> Normal {
            let r = self.residual(p);
            Normal { cost: r.norm_squared(), jtj: self.a.tr_mul(&self.a), jtr: self.a.tr_mul(&r) }
        }
    }

    /// A straight line through noisy points, columns of very different size.
    fn line() -> Linear {
        let a = DMatrix::from_fn(12, 2, |i, j| if j == 0 { 1e3 } else { 1e-4 * i as f64 });
        let b = DVector::from_fn(12, |i, _| 2.0 + 0.3 * i as f64 + if i % 3 == 0 { 0.1 } else { -0.05 });
        Linear { a, b }
    }

    /// r = (p − 1, or NaN beyond a wall).
    struct Wall {
        wall: f64,
    }

    impl Problem for Wall {
        fn dim(&self) -> usize {
            1
        }
        fn cost(&self, p: &[f64]) -> f64 {
            if p[0] > self.wall { f64::NAN } else { (p[0] - 1.0).powi(2) + 1.0 }
        }
        fn normal(&self, p: &[f64]) -> Normal {
            Normal {
                cost: self.cost(p),
                jtj: DMatrix::from_element(1, 1, 1.0),
                jtr: DVector::from_element(1, p[0] - 1.0),
            }
        }
    }

    fn fit(problem: &dyn Problem, start: &[f64], bounds: &[(f64, f64)]) -> Fit {
        minimise(problem, start, bounds, &Settings::default(), &Silent).unwrap()
    }

    #[test]
    fn a_linear_problem_takes_one_undamped_step() {
        let problem = line();
        let settings = Settings { initial_damping: 0.0, ..Settings::default() };
        let fit = minimise(&problem, &[5.0, -7.0], &[FREE; 2], &settings, &Silent).unwrap();
        let exact = problem.a.clone().svd(true, true).solve(&problem.b, 1e-14).unwrap();
        assert_eq!((fit.iterations, fit.status), (1, Status::Converged));
        for k in 0..2 {
            assert!((fit.parameters[k] / exact[k] - 1.0).abs() < 1e-9, "{fit:?} {exact}");
        }
        assert_eq!(fit.normal.cost, fit.cost);
    }

    #[test]
    fn the_result_does_not_depend_on_units() {
        let problem = line();
        let mut other = line();
        other.a.column_mut(1).scale_mut(1e9);
        let (one, two) = (fit(&problem, &[1.0, 1.0], &[FREE; 2]), fit(&other, &[1.0, 1e-9], &[FREE; 2]));
        assert_eq!(one.iterations, two.iterations);
        assert!((one.parameters[1] / two.parameters[1] / 1e9 - 1.0).abs() < 1e-9);
    }

    #[test]
    fn an_active_bound_holds_its_parameter_and_the_others_are_optimal() {
        // Columns correlate, so the free parameter must answer to the one held.
        let a = DMatrix::from_row_slice(3, 2, &[1.0, 1.0, 1.0, 2.0, 1.0, 3.0]);
        let problem = Linear { a, b: DVector::from_row_slice(&[3.0, 5.0, 7.0]) };
        let fit = fit(&problem, &[0.0, 0.0], &[(-9.0, 9.0), (-1.0, 1.5)]);
        assert_eq!(fit.parameters[1], 1.5);
        assert!((fit.parameters[0] - 2.0).abs() < 1e-9, "{fit:?}");
        assert_eq!((fit.at_bound, fit.status), (vec![false, true], Status::Converged));
    }

    #[test]
    fn a_parameter_leaves_a_bound_that_does_not_hold_it() {
        let fit = fit(&line(), &[-4.0, 1e3], &[(-4.0, 4.0), (-1e4, 1e4)]);
        assert_eq!((fit.at_bound, fit.status), (vec![false, false], Status::Converged));
    }

    #[test]
    fn equal_bounds_fix_a_parameter() {
        let fit = fit(&line(), &[0.5, 0.0], &[(0.002, 0.002), FREE]);
        assert_eq!(fit.parameters[0], 0.002);
        assert_eq!((fit.at_bound, fit.status), (vec![true, false], Status::Converged));
    }

    #[test]
    fn rank_deficiency_and_dead_parameters_do_no_harm() {
        let a = DMatrix::from_fn(9, 4, |i, j| match j {
            0 => 1.0,
            1 => i as f64,
            2 => 1.0 + i as f64,
            _ => 0.0,
        });
        let problem = Linear { a, b: DVector::from_fn(9, |i, _| 4.0 - 2.0 * i as f64) };
        let fit = fit(&problem, &[0.0, 0.0, 0.0, 6.0], &[FREE; 4]);
        assert_eq!(fit.status, Status::Converged);
        assert!(fit.cost < 1e-16, "{fit:?}");
        assert_eq!(fit.parameters[3], 6.0);
    }

    #[test]
    fn a_step_to_where_there_is_no_cost_is_rejected() {
        let near = fit(&Wall { wall: 0.9 }, &[-3.0], &[FREE]);
        assert!(near.parameters[0] <= 0.9 && near.parameters[0] > 0.89, "{near:?}");
        assert_eq!(near.status, Status::NotFinite);
        assert_eq!(fit(&Wall { wall: 1.5 }, &[-3.0], &[FREE]).status, Status::Converged);
        let beyond = fit(&Wall { wall: 1.5 }, &[2.0], &[FREE]);
        assert_eq!((beyond.status, beyond.parameters), (Status::NotFinite, vec![2.0]));
    }

    #[test]
    fn a_wrong_gradient_is_not_called_convergence() {
        struct Wrong;
        impl Problem for Wrong {
            fn dim(&self) -> usize {
                1
            }
            fn cost(&self, p: &[f64]) -> f64 {
                1.0 + p[0] * p[0]
            }
            fn normal(&self, p: &[f64]) -> Normal {
                Normal {
                    cost: self.cost(p),
                    jtj: DMatrix::from_element(1, 1, 1.0),
                    jtr: DVector::from_element(1, -p[0]),
                }
            }
        }
        let fit = fit(&Wrong, &[2.0], &[FREE]);
        assert_eq!((fit.status, fit.parameters), (Status::IterationLimit, vec![2.0]));
    }

    #[test]
    fn a_stopped_fit_returns_its_start_with_its_cost() {
        let flag = StopFlag::default();
        flag.stop();
        let problem = line();
        let fit = minimise(&problem, &[1.0, 1.0], &[FREE; 2], &Settings::default(), &flag).unwrap();
        assert_eq!((fit.status, fit.cost), (Status::Interrupted, problem.cost(&[1.0, 1.0])));
        let settings = Settings { max_iterations: 1, ..Settings::default() };
        let fit = minimise(&problem, &[1.0, 1.0], &[FREE; 2], &settings, &Silent).unwrap();
        assert_eq!((fit.status, fit.iterations), (Status::IterationLimit, 1));
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        let (problem, ok) = (line(), Settings::default());
        let run = |start: &[f64], bounds: &[(f64, f64)], settings: &Settings| {
            minimise(&problem, start, bounds, settings, &Silent)
        };
        assert!(run(&[1.0], &[FREE; 2], &ok).is_err());
        assert!(run(&[1.0; 2], &[FREE], &ok).is_err());
        assert!(run(&[1.0, f64::NAN], &[FREE; 2], &ok).is_err());
        assert!(run(&[1.0; 2], &[FREE, (1.0, 0.0)], &ok).is_err());
        assert!(run(&[1.0; 2], &[FREE, (f64::NAN, 0.0)], &ok).is_err());
        assert!(run(&[1.0; 2], &[FREE, (f64::INFINITY, f64::INFINITY)], &ok).is_err());
        assert!(run(&[1.0; 2], &[FREE; 2], &Settings { max_iterations: 0, ..ok }).is_err());
        assert!(run(&[1.0; 2], &[FREE; 2], &Settings { cost_tolerance: f64::NAN, ..ok }).is_err());
        assert!(run(&[1.0; 2], &[FREE; 2], &Settings { initial_damping: -1.0, ..ok }).is_err());
    }

    #[test]
    fn covariance_is_the_inverse_information() {
        let h = DMatrix::from_row_slice(2, 2, &[4e8, 1e3, 1e3, 9e-2]);
        let exact = h.clone().try_inverse().unwrap();
        let found = covariance(&h, None, &[true, true]);
        assert!((&found - &exact).component_div(&exact).amax() < 1e-9, "{found} {exact}");
        let meat = DMatrix::from_row_slice(2, 2, &[8e8, 5e2, 5e2, 7e-1]);
        let sandwich = covariance(&h, Some(&meat), &[true, true]);
        let exact = &exact * meat * &exact;
        assert!((&sandwich - &exact).component_div(&exact).amax() < 1e-9);
        let held = covariance(&h, None, &[false, true]);
        assert_eq!((held[(0, 0)], held[(0, 1)]), (0.0, 0.0));
        assert!((held[(1, 1)] * 9e-2 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn what_the_data_cannot_show_has_infinite_variance() {
        // Parameters 0 and 1 act only through their sum, 3 not at all.
        let h = DMatrix::from_fn(4, 4, |i, j| match (i, j) {
            (0 | 1, 0 | 1) => 5.0,
            (2, 2) => 2.0,
            (2, 0 | 1) | (0 | 1, 2) => 0.5,
            _ => 0.0,
        });
        let c = covariance(&h, None, &[true; 4]);
        assert_eq!([c[(0, 0)], c[(1, 1)], c[(3, 3)]], [f64::INFINITY; 3]);
        assert_eq!((c[(0, 1)], c[(0, 2)]), (0.0, 0.0));
        assert!((c[(2, 2)] - 1.0 / (2.0 - 0.25 / 5.0)).abs() < 1e-9, "{c}");
        assert!((covariance(&h, None, &[true, false, true, true])[(0, 0)]).is_finite());
        let unknown = covariance(&DMatrix::from_element(1, 1, f64::NAN), None, &[true]);
        assert_eq!(unknown[(0, 0)], f64::INFINITY);
    }

    #[test]
    fn weak_directions_name_the_combination() {
        let a = DMatrix::from_fn(20, 3, |i, j| match j {
            0 => 1.0 + 1e-5 * (i as f64).sin(),
            1 => 1.0,
            _ => i as f64,
        });
        let h = a.tr_mul(&a);
        let weak = weak_directions(&h, &[1.0, 1.0, 0.1], 1e-6).unwrap();
        assert_eq!(weak.len(), 1);
        let mut who = weak[0].parameters.clone();
        who.sort_unstable();
        assert_eq!(who, [0, 1]);
        assert!(weak[0].weights[0] * weak[0].weights[1] < 0.0);
        assert!(weak[0].condition > 1e3 && weak[0].condition.is_finite());
        assert!(weak_directions(&h, &[1.0, 0.0, 0.1], 1e-6).unwrap().is_empty());
        let dead = DMatrix::from_diagonal(&DVector::from_row_slice(&[1.0, 0.0]));
        let weak = weak_directions(&dead, &[1.0, 1.0], 1e-6).unwrap();
        assert_eq!((weak[0].parameters.as_slice(), weak[0].condition), ([1].as_slice(), f64::INFINITY));
        assert!(weak_directions(&dead, &[1.0], 1e-6).is_err());
        assert!(weak_directions(&dead, &[1.0, -1.0], 1e-6).is_err());
    }
}
