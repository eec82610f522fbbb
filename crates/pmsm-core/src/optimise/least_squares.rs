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

mod information;
mod problem;
mod settings;
mod step;

use nalgebra::DVector;

use crate::error::{Error, Result};
use crate::monitor::Monitor;
use problem::{checked, evaluate};
use step::{RIDGE, Step, lie_on};

pub use information::{WeakDirection, covariance, scaled_inverse, weak_directions};
pub use problem::{Normal, Problem};
pub use settings::Settings;

/// Damping at which a rejected step has become pure gradient descent of no length: no lower cost will be found.
const MAX_DAMPING: f64 = 1e16;
/// Smallest damping after a rejected undamped step.
const MIN_RAISED_DAMPING: f64 = 1e-6;
/// Smallest ratio of actual to predicted reduction that is accepted.
const MIN_GAIN: f64 = 1e-4;
/// Relative reduction that summation error of a long cost can hide. A run that finds no lower cost while the model
/// promises no more than this has converged.
const COST_NOISE: f64 = 1e-8;
/// Steps on end that hardly lower the cost, after which a run has stalled.
const STALLED: usize = 3;
/// What a step promises falls with the one before to no less than this share, as far as can be relied on: from far away it falls faster.
const FASTEST: f64 = 1e-5;

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

/// Outcome of [`minimise`]: the best point whose normal equations are known, until [`Fit::go_on`] goes one step further.
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
    let mut before = 0.0f64;
    let (mut idle, mut fell) = (0, f64::INFINITY);
    let status = loop {
        if !normal.is_finite() {
            break if monitor.cancelled() { Status::Interrupted } else { Status::NotFinite };
        }
        let column = normal.jtj.diagonal().map(|x| x.max(0.0).sqrt());
        scale = scale.sup(&column);
        let newton = Step::solve(&normal, &p, bounds, &column, RIDGE);
        let length = newton.step.component_mul(&column).norm();
        let reach = DVector::from_column_slice(&p).component_mul(&column).norm();
        let enough = settings.cost_tolerance * normal.cost;
        let falls = (newton.promise / before).max(FASTEST);
        let rest = settings.leaves_rest
            && damping <= settings.initial_damping
            && newton.promise * falls <= enough
            && newton.reduction - Step::cautious(&normal, &p, bounds).reduction <= enough;
        if newton.promise <= enough || length <= settings.step_tolerance * reach || rest {
            break Status::Converged;
        }
        before = newton.promise;
        if iterations == settings.max_iterations {
            break Status::IterationLimit;
        }
        iterations += 1;
        monitor.report("least squares", iterations as f64 / settings.max_iterations as f64);
        match descend(problem, &normal, &p, bounds, &scale, &mut damping, monitor)? {
            Search::Found(point, there) => {
                let above = problem.residuals().map_or(1.0, |n| (there.cost / n.max(1) as f64).max(1.0));
                let falls = normal.cost - there.cost;
                let hardly = falls <= settings.stall_tolerance * above * there.cost && falls <= fell;
                idle = if hardly { idle + 1 } else { 0 };
                fell = falls;
                (p, normal) = (point, there);
                if idle == STALLED {
                    break Status::Converged;
                }
            }
            Search::Cancelled => break Status::Interrupted,
            Search::NotFinite => break Status::NotFinite,
            Search::Nothing if newton.promise <= COST_NOISE * normal.cost => break Status::Converged,
            Search::Nothing => break Status::IterationLimit,
        }
    };
    let at_bound = lie_on(bounds, &p);
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
            let (cost, ready) = problem.trial(&trial, !tried);
            tried = true;
            let gain = (normal.cost - cost) / step.reduction;
            if gain > MIN_GAIN {
                let there = checked(ready.unwrap_or_else(|| problem.normal(&trial)), p.len())?;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::monitor::{Silent, StopFlag};
    use nalgebra::DMatrix;

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

    /// r = k (1 − exp(−t/τ)) − t − c·(−1)^n at t = 1, …, 12, over (k, τ): the line is reached where τ has no end.
    struct Runaway {
        c: f64,
    }

    impl Problem for Runaway {
        fn dim(&self) -> usize {
            2
        }
        fn residuals(&self) -> Option<usize> {
            Some(12)
        }
        fn cost(&self, p: &[f64]) -> f64 {
            self.normal(p).cost
        }
        fn normal(&self, p: &[f64]) -> Normal {
            let fades = |n: i32| (-f64::from(n) / p[1]).exp();
            let residual = |n: i32| p[0] * (1.0 - fades(n)) - f64::from(n) - self.c * (-1f64).powi(n);
            let r = DVector::from_iterator(12, (1..=12).map(residual));
            let a = DMatrix::from_fn(12, 2, |i, j| {
                let n = i as i32 + 1;
                if j == 0 { 1.0 - fades(n) } else { -p[0] * fades(n) * f64::from(n) / (p[1] * p[1]) }
            });
            Normal { cost: r.norm_squared(), jtj: a.tr_mul(&a), jtr: a.tr_mul(&r) }
        }
    }

    #[test]
    fn a_parameter_that_runs_away_is_followed_only_as_long_as_it_is_worth_it() {
        let end = |c: f64, stall_tolerance: f64| {
            let settings = Settings { cost_tolerance: 1e-8, stall_tolerance, ..Settings::default() };
            minimise(&Runaway { c }, &[20.0, 20.0], &[FREE; 2], &settings, &Silent).unwrap()
        };
        let (far, near) = (end(0.5, 0.0), end(0.5, 1e-4));
        assert!(near.iterations + 5 < far.iterations, "{} {}", near.iterations, far.iterations);
        assert_eq!(near.status, Status::Converged);
        assert!(near.cost < 1.001 * far.cost, "{} {}", near.cost, far.cost);
        // What is ten times above one per residual need not be known as well.
        let loud = end(3.5, 1e-4);
        assert!(loud.cost > 12.0 * 10.0 && loud.iterations < near.iterations, "{loud:?}");
    }
}
