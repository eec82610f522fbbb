//! The optimisers on problems whose answers are known: test functions with known optima, the certified nonlinear
//! regressions of NIST's Statistical Reference Datasets, and coverage of confidence intervals by simulation.

use std::f64::consts::TAU;

use nalgebra::{DMatrix, DVector};
use pmsm_core::least_squares::{self, Fit, Normal, Problem, Settings, Status, covariance};
use pmsm_core::monitor::Silent;
use pmsm_core::swarm::{self, Inertia, Neighbourhood, SwarmSettings, Update};

const FREE: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);

// Particle swarm -----------------------------------------------------------------------------------------------------

fn sphere(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum()
}

fn rosenbrock(x: &[f64]) -> f64 {
    x.windows(2).map(|w| 100.0 * (w[1] - w[0] * w[0]).powi(2) + (1.0 - w[0]).powi(2)).sum()
}

fn rastrigin(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v - 10.0 * (TAU * v).cos() + 10.0).sum()
}

fn ackley(x: &[f64]) -> f64 {
    let n = x.len() as f64;
    let waves: f64 = x.iter().map(|v| (TAU * v).cos()).sum();
    20.0 + 1f64.exp() - 20.0 * (-0.2 * (sphere(x) / n).sqrt()).exp() - (waves / n).exp()
}

fn griewank(x: &[f64]) -> f64 {
    let product: f64 = x.iter().enumerate().map(|(k, v)| (v / ((k + 1) as f64).sqrt()).cos()).product();
    1.0 + sphere(x) / 4000.0 - product
}

fn himmelblau(x: &[f64]) -> f64 {
    (x[0] * x[0] + x[1] - 11.0).powi(2) + (x[0] + x[1] * x[1] - 7.0).powi(2)
}

/// Constriction coefficients of Clerc & Kennedy 2002, with which a swarm contracts.
const CONTRACTING: SwarmSettings = SwarmSettings {
    particles: 40,
    iterations: 500,
    inertia: 0.7298,
    cognitive: 1.49618,
    social: 1.49618,
    velocity_limit: 0.5,
    schedule: Inertia::Constant,
    update: Update::Inertia,
    neighbourhood: Neighbourhood::All,
};

/// How many of 20 seeds end below `target` (every optimum here is 0).
fn successes(
    settings: &SwarmSettings,
    cost: fn(&[f64]) -> f64,
    dims: usize,
    reach: f64,
    target: f64,
) -> usize {
    // Unequal sides keep the optimum away from the middle of the box.
    let bounds = vec![(-reach, 0.8 * reach); dims];
    (1..=20)
        .filter(|&seed| {
            let run = swarm::minimise(settings, &bounds, seed, None, &cost, &Silent).unwrap();
            assert_eq!(run.cost, cost(&run.parameters));
            run.cost < target
        })
        .count()
}

#[test]
fn a_contracting_swarm_finds_known_optima() {
    for (name, cost, dims, reach, target, least) in [
        ("sphere", sphere as fn(&[f64]) -> f64, 5, 10.0, 1e-10, 20),
        ("rosenbrock", rosenbrock, 2, 5.0, 1e-8, 20),
        ("rastrigin", rastrigin, 2, 5.12, 1e-8, 18),
        ("ackley", ackley, 5, 32.0, 1e-8, 18),
        // Its many basins differ by less than 0.01.
        ("griewank", griewank, 2, 100.0, 1e-8, 10),
        ("himmelblau", himmelblau, 2, 6.0, 1e-10, 20),
    ] {
        let found = successes(&CONTRACTING, cost, dims, reach, target);
        assert!(found >= least, "{name}: {found} of 20");
    }
}

#[test]
fn every_variant_that_contracts_finds_the_floor_of_one_basin() {
    let paper = SwarmSettings { particles: 20, iterations: 200, ..SwarmSettings::default() };
    let falling = SwarmSettings { inertia: 0.9, schedule: Inertia::Linear { last: 0.4 }, ..paper };
    let constricted = SwarmSettings { update: Update::Constriction, cognitive: 2.05, social: 2.05, ..paper };
    let informed = SwarmSettings { update: Update::FullyInformed, ..constricted };
    let social = SwarmSettings { cognitive: 1.49, social: 1.49, inertia: 0.72, ..paper };
    for (name, settings) in [
        ("falling inertia", falling),
        ("random inertia", SwarmSettings { schedule: Inertia::Random { last: 0.5 }, ..social }),
        ("adaptive inertia", SwarmSettings { schedule: Inertia::Adaptive { last: 0.4 }, ..social }),
        ("constriction", constricted),
        ("constriction on a ring", SwarmSettings { neighbourhood: Neighbourhood::Ring, ..constricted }),
        ("constriction on a grid", SwarmSettings { neighbourhood: Neighbourhood::VonNeumann, ..constricted }),
        ("informed on a ring", SwarmSettings { neighbourhood: Neighbourhood::Ring, ..informed }),
        ("informed on a grid", SwarmSettings { neighbourhood: Neighbourhood::VonNeumann, ..informed }),
    ] {
        let found = successes(&settings, sphere, 3, 10.0, 1e-6);
        assert!(found >= 19, "{name}: {found} of 20");
    }
}

/// w = 0.8, c₁ = c₂ = 2 does not contract by itself: 10 particles and 30 iterations find the basin, not its floor.
#[test]
fn the_papers_swarm_finds_the_basin_of_two_parameters() {
    let paper = SwarmSettings::default();
    for (name, cost, reach, target) in
        [("sphere", sphere as fn(&[f64]) -> f64, 10.0, 0.2), ("himmelblau", himmelblau, 6.0, 2.0)]
    {
        let found = successes(&paper, cost, 2, reach, target);
        assert!(found >= 16, "{name}: {found} of 20");
    }
}

#[test]
fn the_swarm_gives_the_same_bits_on_any_number_of_threads() {
    let settings = SwarmSettings { particles: 37, iterations: 40, ..SwarmSettings::default() };
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            swarm::minimise(&settings, &[(-5.0, 4.0); 6], 11, Some(&[1.0; 6]), &rastrigin, &Silent).unwrap()
        })
    };
    let one = run(1);
    for threads in [2, 4, 8] {
        let many = run(threads);
        let bits = |x: &[f64]| x.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&one.parameters), bits(&many.parameters), "{threads} threads");
        assert_eq!(bits(&one.history), bits(&many.history), "{threads} threads");
        assert_eq!(one, many);
    }
    let other = swarm::minimise(&settings, &[(-5.0, 4.0); 6], 12, None, &rastrigin, &Silent).unwrap();
    assert_ne!(one.parameters, other.parameters);
}

// Levenberg–Marquardt ------------------------------------------------------------------------------------------------

/// A residual and its gradient: one row of r and J.
type Row = (f64, Vec<f64>);

/// A test function as a sum of squares.
struct Residuals {
    dim: usize,
    rows: fn(&[f64]) -> Vec<Row>,
}

impl Problem for Residuals {
    fn dim(&self) -> usize {
        self.dim
    }
    fn cost(&self, p: &[f64]) -> f64 {
        (self.rows)(p).iter().map(|(r, _)| r * r).sum()
    }
    fn normal(&self, p: &[f64]) -> Normal {
        normal(self.dim, (self.rows)(p).into_iter())
    }
}

fn normal(dim: usize, rows: impl Iterator<Item = Row>) -> Normal {
    let mut sum = Normal { cost: 0.0, jtj: DMatrix::zeros(dim, dim), jtr: DVector::zeros(dim) };
    for (r, gradient) in rows {
        let gradient = DVector::from_vec(gradient);
        sum.cost += r * r;
        sum.jtj.ger(1.0, &gradient, &gradient, 1.0);
        sum.jtr.axpy(r, &gradient, 1.0);
    }
    sum
}

fn fit(problem: &dyn Problem, start: &[f64], bounds: &[(f64, f64)]) -> Fit {
    least_squares::minimise(problem, start, bounds, &Settings::default(), &Silent).unwrap()
}

fn rosenbrock_rows(p: &[f64]) -> Vec<Row> {
    vec![(10.0 * (p[1] - p[0] * p[0]), vec![-20.0 * p[0], 10.0]), (1.0 - p[0], vec![-1.0, 0.0])]
}

fn beale_rows(p: &[f64]) -> Vec<Row> {
    [1.5, 2.25, 2.625]
        .iter()
        .zip(1..)
        .map(|(c, k)| {
            let slope = f64::from(k) * p[0] * p[1].powi(k - 1);
            (c - p[0] * (1.0 - p[1].powi(k)), vec![p[1].powi(k) - 1.0, slope])
        })
        .collect()
}

fn powell_rows(p: &[f64]) -> Vec<Row> {
    let (five, ten) = (5f64.sqrt(), 10f64.sqrt());
    let (a, b) = (p[1] - 2.0 * p[2], p[0] - p[3]);
    vec![
        (p[0] + 10.0 * p[1], vec![1.0, 10.0, 0.0, 0.0]),
        (five * (p[2] - p[3]), vec![0.0, 0.0, five, -five]),
        (a * a, vec![0.0, 2.0 * a, -4.0 * a, 0.0]),
        (ten * b * b, vec![2.0 * ten * b, 0.0, 0.0, -2.0 * ten * b]),
    ]
}

#[test]
fn least_squares_solves_rosenbrock_and_beale() {
    let problem = Residuals { dim: 2, rows: rosenbrock_rows };
    let found = fit(&problem, &[-1.2, 1.0], &[FREE; 2]);
    assert_eq!(found.status, Status::Converged);
    assert!(found.parameters.iter().all(|x| (x - 1.0).abs() < 1e-9), "{found:?}");
    let problem = Residuals { dim: 2, rows: beale_rows };
    let found = fit(&problem, &[1.0, 0.8], &[FREE; 2]);
    assert_eq!(found.status, Status::Converged);
    assert!(
        (found.parameters[0] - 3.0).abs() < 1e-8 && (found.parameters[1] - 0.5).abs() < 1e-8,
        "{found:?}"
    );
}

/// The Jacobian loses rank at the optimum 0, where convergence is only linear.
#[test]
fn least_squares_gets_down_to_the_optimum_of_powells_singular_function() {
    let problem = Residuals { dim: 4, rows: powell_rows };
    let found = fit(&problem, &[3.0, -1.0, 0.0, 1.0], &[FREE; 4]);
    assert!(found.cost < 1e-20 && found.parameters.iter().all(|x| x.abs() < 1e-5), "{found:?}");
}

#[test]
fn least_squares_follows_a_valley_along_its_bounds() {
    // On x ≤ 0.5 the minimum of Rosenbrock's function is (0.5, 0.25); on y ≤ −1 it is near (0, −1).
    let problem = Residuals { dim: 2, rows: rosenbrock_rows };
    let found = fit(&problem, &[-1.2, 1.0], &[(-2.0, 0.5), FREE]);
    assert_eq!((found.status, found.at_bound.clone()), (Status::Converged, vec![true, false]));
    assert!((found.parameters[1] - 0.25).abs() < 1e-8, "{found:?}");
    let found = fit(&problem, &[-1.2, -3.0], &[(-2.0, 2.0), (-5.0, -1.0)]);
    assert_eq!((found.status, found.at_bound.clone()), (Status::Converged, vec![false, true]));
    // There 400 x (x² + 1) = 2 (1 − x).
    let x = found.parameters[0];
    assert!((400.0 * x * (x * x + 1.0) - 2.0 * (1.0 - x)).abs() < 1e-4, "{found:?}");
}

// NIST StRD ----------------------------------------------------------------------------------------------------------

/// Value of a model at x; its gradient with respect to the parameters goes into the last argument.
type Model = fn(&[f64], f64, &mut [f64]) -> f64;

struct Regression {
    name: &'static str,
    model: Model,
    /// y, x, y, x, …
    data: &'static [f64],
    starts: [&'static [f64]; 2],
    certified: &'static [f64],
    stderr: &'static [f64],
    rss: f64,
}

impl Problem for Regression {
    fn dim(&self) -> usize {
        self.certified.len()
    }
    fn cost(&self, p: &[f64]) -> f64 {
        let mut gradient = vec![0.0; self.dim()];
        self.data.chunks(2).map(|yx| ((self.model)(p, yx[1], &mut gradient) - yx[0]).powi(2)).sum()
    }
    fn normal(&self, p: &[f64]) -> Normal {
        let rows = self.data.chunks(2).map(|yx| {
            let mut gradient = vec![0.0; self.dim()];
            ((self.model)(p, yx[1], &mut gradient) - yx[0], gradient)
        });
        normal(self.dim(), rows)
    }
}

/// b₁ (1 − exp(−b₂ x))
fn saturating(b: &[f64], x: f64, g: &mut [f64]) -> f64 {
    let decay = (-b[1] * x).exp();
    g.copy_from_slice(&[1.0 - decay, b[0] * x * decay]);
    b[0] * (1.0 - decay)
}

/// exp(−b₁ x) / (b₂ + b₃ x)
fn chwirut(b: &[f64], x: f64, g: &mut [f64]) -> f64 {
    let below = b[1] + b[2] * x;
    let y = (-b[0] * x).exp() / below;
    g.copy_from_slice(&[-x * y, -y / below, -x * y / below]);
    y
}

/// (b₁ + b₂ x + b₃ x² + b₄ x³) / (1 + b₅ x + b₆ x² + b₇ x³)
fn cubic_over_cubic(b: &[f64], x: f64, g: &mut [f64]) -> f64 {
    let above = b[0] + x * (b[1] + x * (b[2] + x * b[3]));
    let below = 1.0 + x * (b[4] + x * (b[5] + x * b[6]));
    for k in 0..4 {
        g[k] = x.powi(k as i32) / below;
    }
    for k in 1..4 {
        g[k + 3] = -above * x.powi(k as i32) / (below * below);
    }
    above / below
}

/// b₁ (x² + b₂ x) / (x² + b₃ x + b₄)
fn mgh09(b: &[f64], x: f64, g: &mut [f64]) -> f64 {
    let (above, below) = (x * x + b[1] * x, x * x + b[2] * x + b[3]);
    let y = b[0] * above / below;
    g.copy_from_slice(&[above / below, b[0] * x / below, -y * x / below, -y / below]);
    y
}

/// (b₁/b₂) exp(−½ ((x − b₃)/b₂)²)
fn peak(b: &[f64], x: f64, g: &mut [f64]) -> f64 {
    let z = (x - b[2]) / b[1];
    let bell = (-0.5 * z * z).exp() / b[1];
    g.copy_from_slice(&[bell, b[0] * bell * (z * z - 1.0) / b[1], b[0] * bell * z / b[1]]);
    b[0] * bell
}

const MISRA1A: [f64; 28] = [
    10.07, 77.6, 14.73, 114.9, 17.94, 141.1, 23.93, 190.8, 29.61, 239.9, 35.18, 289.0, 40.02, 332.8, 44.82,
    378.4, 50.76, 434.8, 55.05, 477.3, 61.01, 536.8, 66.4, 593.1, 75.47, 689.1, 81.78, 760.0,
];

const CHWIRUT2: [f64; 108] = [
    92.9, 0.5, 57.1, 1.0, 31.05, 1.75, 11.5875, 3.75, 8.025, 5.75, 63.6, 0.875, 21.4, 2.25, 14.25, 3.25,
    8.475, 5.25, 63.8, 0.75, 26.8, 1.75, 16.4625, 2.75, 7.125, 4.75, 67.3, 0.625, 41.0, 1.25, 21.15, 2.25,
    8.175, 4.25, 81.5, 0.5, 13.12, 3.0, 59.9, 0.75, 14.62, 3.0, 32.9, 1.5, 5.44, 6.0, 12.56, 3.0, 5.44, 6.0,
    32.0, 1.5, 13.95, 3.0, 75.8, 0.5, 20.0, 2.0, 10.42, 4.0, 59.5, 0.75, 21.67, 2.0, 8.55, 5.0, 62.0, 0.75,
    20.2, 2.25, 7.76, 3.75, 3.75, 5.75, 11.81, 3.0, 54.7, 0.75, 23.7, 2.5, 11.55, 4.0, 61.3, 0.75, 17.7, 2.5,
    8.74, 4.0, 59.2, 0.75, 16.3, 2.5, 8.62, 4.0, 81.0, 0.5, 4.87, 6.0, 14.62, 3.0, 81.7, 0.5, 17.17, 2.75,
    81.3, 0.5, 28.9, 1.75,
];

const THURBER: [f64; 74] = [
    80.574, -3.067, 84.248, -2.981, 87.264, -2.921, 87.195, -2.912, 89.076, -2.84, 89.608, -2.797, 89.868,
    -2.702, 90.101, -2.699, 92.405, -2.633, 95.854, -2.481, 100.696, -2.363, 101.06, -2.322, 401.672, -1.501,
    390.724, -1.46, 567.534, -1.274, 635.316, -1.212, 733.054, -1.1, 759.087, -1.046, 894.206, -0.915,
    990.785, -0.714, 1090.109, -0.566, 1080.914, -0.545, 1122.643, -0.4, 1178.351, -0.309, 1260.531, -0.109,
    1273.514, -0.103, 1288.339, 0.01, 1327.543, 0.119, 1353.863, 0.377, 1414.509, 0.79, 1425.208, 0.963,
    1421.384, 1.006, 1442.962, 1.115, 1464.35, 1.572, 1468.705, 1.841, 1447.894, 2.047, 1457.628, 2.2,
];

const HAHN1: [f64; 472] = [
    0.591, 24.41, 1.547, 34.82, 2.902, 44.09, 2.894, 45.07, 4.703, 54.98, 6.307, 65.51, 7.03, 70.53, 7.898,
    75.7, 9.47, 89.57, 9.484, 91.14, 10.072, 96.4, 10.163, 97.19, 11.615, 114.26, 12.005, 120.25, 12.478,
    127.08, 12.982, 133.55, 12.97, 133.61, 13.926, 158.67, 14.452, 172.74, 14.404, 171.31, 15.19, 202.14,
    15.55, 220.55, 15.528, 221.05, 15.499, 221.39, 16.131, 250.99, 16.438, 268.99, 16.387, 271.8, 16.549,
    271.97, 16.872, 321.31, 16.83, 321.69, 16.926, 330.14, 16.907, 333.03, 16.966, 333.47, 17.06, 340.77,
    17.122, 345.65, 17.311, 373.11, 17.355, 373.79, 17.668, 411.82, 17.767, 419.51, 17.803, 421.59, 17.765,
    422.02, 17.768, 422.47, 17.736, 422.61, 17.858, 441.75, 17.877, 447.41, 17.912, 448.7, 18.046, 472.89,
    18.085, 476.69, 18.291, 522.47, 18.357, 522.62, 18.426, 524.43, 18.584, 546.75, 18.61, 549.53, 18.87,
    575.29, 18.795, 576.0, 19.111, 625.55, 0.367, 20.15, 0.796, 28.78, 0.892, 29.57, 1.903, 37.41, 2.15,
    39.12, 3.697, 50.24, 5.87, 61.38, 6.421, 66.25, 7.422, 73.42, 9.944, 95.52, 11.023, 107.32, 11.87,
    122.04, 12.786, 134.03, 14.067, 163.19, 13.974, 163.48, 14.462, 175.7, 14.464, 179.86, 15.381, 211.27,
    15.483, 217.78, 15.59, 219.14, 16.075, 262.52, 16.347, 268.01, 16.181, 268.62, 16.915, 336.25, 17.003,
    337.23, 16.978, 339.33, 17.756, 427.38, 17.808, 428.58, 17.868, 432.68, 18.481, 528.99, 18.486, 531.08,
    19.09, 628.34, 16.062, 253.24, 16.337, 273.13, 16.345, 273.66, 16.388, 282.1, 17.159, 346.62, 17.116,
    347.19, 17.164, 348.78, 17.123, 351.18, 17.979, 450.1, 17.974, 450.35, 18.007, 451.92, 17.993, 455.56,
    18.523, 552.22, 18.669, 553.56, 18.617, 555.74, 19.371, 652.59, 19.33, 656.2, 0.08, 14.13, 0.248, 20.41,
    1.089, 31.3, 1.418, 33.84, 2.278, 39.7, 3.624, 48.83, 4.574, 54.5, 5.556, 60.41, 7.267, 72.77, 7.695,
    75.25, 9.136, 86.84, 9.959, 94.88, 9.957, 96.4, 11.6, 117.37, 13.138, 139.08, 13.564, 147.73, 13.871,
    158.63, 13.994, 161.84, 14.947, 192.11, 15.473, 206.76, 15.379, 209.07, 15.455, 213.32, 15.908, 226.44,
    16.114, 237.12, 17.071, 330.9, 17.135, 358.72, 17.282, 370.77, 17.368, 372.72, 17.483, 396.24, 17.764,
    416.59, 18.185, 484.02, 18.271, 495.47, 18.236, 514.78, 18.237, 515.65, 18.523, 519.47, 18.627, 544.47,
    18.665, 560.11, 19.086, 620.77, 0.214, 18.97, 0.943, 28.93, 1.429, 33.91, 2.241, 40.03, 2.951, 44.66,
    3.782, 49.87, 4.757, 55.16, 5.602, 60.9, 7.169, 72.08, 8.92, 85.15, 10.055, 97.06, 12.035, 119.63,
    12.861, 133.27, 13.436, 143.84, 14.167, 161.91, 14.755, 180.67, 15.168, 198.44, 15.651, 226.86, 15.746,
    229.65, 16.216, 258.27, 16.445, 273.77, 16.965, 339.15, 17.121, 350.13, 17.206, 362.75, 17.25, 371.03,
    17.339, 393.32, 17.793, 448.53, 18.123, 473.78, 18.49, 511.12, 18.566, 524.7, 18.645, 548.75, 18.706,
    551.64, 18.924, 574.02, 19.1, 623.86, 0.375, 21.46, 0.471, 24.33, 1.504, 33.43, 2.204, 39.22, 2.813,
    44.18, 4.765, 55.02, 9.835, 94.33, 10.04, 96.44, 11.946, 118.82, 12.596, 128.48, 13.303, 141.94, 13.922,
    156.92, 14.44, 171.65, 14.951, 190.0, 15.627, 223.26, 15.639, 223.88, 15.814, 231.5, 16.315, 265.05,
    16.334, 269.44, 16.43, 271.78, 16.423, 273.46, 17.024, 334.61, 17.009, 339.79, 17.165, 349.52, 17.134,
    358.18, 17.349, 377.98, 17.576, 394.77, 17.848, 429.66, 18.09, 468.22, 18.276, 487.27, 18.404, 519.54,
    18.519, 523.03, 19.133, 612.99, 19.074, 638.59, 19.239, 641.36, 19.28, 622.05, 19.101, 631.5, 19.398,
    663.97, 19.252, 646.9, 19.89, 748.29, 20.007, 749.21, 19.929, 750.14, 19.268, 647.04, 19.324, 646.89,
    20.049, 746.9, 20.107, 748.43, 20.062, 747.35, 20.065, 749.27, 19.286, 647.61, 19.972, 747.78, 20.088,
    750.51, 20.743, 851.37, 20.83, 845.97, 20.935, 847.54, 21.035, 849.93, 20.93, 851.61, 21.074, 849.75,
    21.085, 850.98, 20.935, 848.23,
];

const MGH09: [f64; 22] = [
    0.1957, 4.0, 0.1947, 2.0, 0.1735, 1.0, 0.16, 0.5, 0.0844, 0.25, 0.0627, 0.167, 0.0456, 0.125, 0.0342,
    0.1, 0.0323, 0.0833, 0.0235, 0.0714, 0.0246, 0.0625,
];

const ECKERLE4: [f64; 70] = [
    0.0001575, 400.0, 0.0001699, 405.0, 0.000235, 410.0, 0.0003102, 415.0, 0.0004917, 420.0, 0.000871, 425.0,
    0.0017418, 430.0, 0.00464, 435.0, 0.0065895, 436.5, 0.0097302, 438.0, 0.0149002, 439.5, 0.023731, 441.0,
    0.0401683, 442.5, 0.0712559, 444.0, 0.1264458, 445.5, 0.2073413, 447.0, 0.2902366, 448.5, 0.3445623,
    450.0, 0.3698049, 451.5, 0.3668534, 453.0, 0.3106727, 454.5, 0.2078154, 456.0, 0.1164354, 457.5,
    0.0616764, 459.0, 0.03372, 460.5, 0.0194023, 462.0, 0.0117831, 463.5, 0.0074357, 465.0, 0.0022732, 470.0,
    0.00088, 475.0, 0.0004579, 480.0, 0.0002345, 485.0, 0.0001586, 490.0, 0.0001143, 495.0, 7.1e-05, 500.0,
];

const BOXBOD: [f64; 12] = [109.0, 1.0, 149.0, 2.0, 149.0, 3.0, 191.0, 5.0, 213.0, 7.0, 224.0, 10.0];
/// Starts, certified parameters, standard deviations and residual sums of squares as published by NIST.
const REGRESSIONS: [Regression; 7] = [
    Regression {
        name: "Misra1a",
        model: saturating,
        data: &MISRA1A,
        starts: [&[500.0, 0.0001], &[250.0, 0.0005]],
        certified: &[238.94212918, 0.00055015643181],
        stderr: &[2.7070075241, 7.2668688436e-06],
        rss: 0.12455138894,
    },
    Regression {
        name: "Chwirut2",
        model: chwirut,
        data: &CHWIRUT2,
        starts: [&[0.1, 0.01, 0.02], &[0.15, 0.008, 0.01]],
        certified: &[0.16657666537, 0.0051653291286, 0.012150007096],
        stderr: &[0.03830328681, 0.00066621605126, 0.0015304234767],
        rss: 513.04802941,
    },
    Regression {
        name: "Thurber",
        model: cubic_over_cubic,
        data: &THURBER,
        starts: [
            &[1000.0, 1000.0, 400.0, 40.0, 0.7, 0.3, 0.03],
            &[1300.0, 1500.0, 500.0, 75.0, 1.0, 0.4, 0.05],
        ],
        certified: &[
            1288.13968,
            1491.0792535,
            583.23836877,
            75.416644291,
            0.96629502864,
            0.39797285797,
            0.049727297349,
        ],
        stderr: &[
            4.6647963344,
            39.571156086,
            28.698696102,
            5.567537027,
            0.031333340687,
            0.014984928198,
            0.0065842344623,
        ],
        rss: 5642.7082397,
    },
    Regression {
        name: "Hahn1",
        model: cubic_over_cubic,
        data: &HAHN1,
        starts: [
            &[10.0, -1.0, 0.05, -1e-05, -0.05, 0.001, -1e-06],
            &[1.0, -0.1, 0.005, -1e-06, -0.005, 0.0001, -1e-07],
        ],
        certified: &[
            1.0776351733,
            -0.12269296921,
            0.004086375061,
            -1.4262662514e-06,
            -0.0057609940901,
            0.00024053735503,
            -1.2314450199e-07,
        ],
        stderr: &[
            0.17070154742,
            0.012000289189,
            0.00022508314937,
            2.7578037666e-07,
            0.00024712888219,
            1.0449373768e-05,
            1.3027335327e-08,
        ],
        rss: 1.5324382854,
    },
    Regression {
        name: "MGH09",
        model: mgh09,
        data: &MGH09,
        starts: [&[25.0, 39.0, 41.5, 39.0], &[0.25, 0.39, 0.415, 0.39]],
        certified: &[0.19280693458, 0.19128232873, 0.12305650693, 0.13606233068],
        stderr: &[0.011435312227, 0.19633220911, 0.080842031232, 0.090025542308],
        rss: 0.00030750560385,
    },
    Regression {
        name: "Eckerle4",
        model: peak,
        data: &ECKERLE4,
        starts: [&[1.0, 10.0, 500.0], &[1.5, 5.0, 450.0]],
        certified: &[1.5543827178, 4.0888321754, 451.54121844],
        stderr: &[0.015408051163, 0.046803020753, 0.046800518816],
        rss: 0.0014635887487,
    },
    Regression {
        name: "BoxBOD",
        model: saturating,
        data: &BOXBOD,
        starts: [&[1.0, 1.0], &[100.0, 0.75]],
        certified: &[213.80940889, 0.54723748542],
        stderr: &[12.354515176, 0.10455993237],
        rss: 1168.0088766,
    },
];

/// Enough for the slow way round that the first start of MGH09 takes.
const PATIENT: Settings =
    Settings { max_iterations: 500, cost_tolerance: 1e-14, step_tolerance: 1e-10, initial_damping: 1e-3 };

fn assert_certified(problem: &Regression, found: &Fit, start: &[f64]) {
    let (name, dim) = (problem.name, problem.dim());
    assert_eq!(found.status, Status::Converged, "{name} from {start:?}: {found:?}");
    assert!((found.cost / problem.rss - 1.0).abs() < 1e-9, "{name} from {start:?}: {}", found.cost);
    let freedom = (problem.data.len() / 2 - dim) as f64;
    let spread = covariance(&found.normal.jtj, None, &vec![true; dim]) * (found.cost / freedom);
    for k in 0..dim {
        let value = found.parameters[k] / problem.certified[k] - 1.0;
        let stderr = spread[(k, k)].sqrt() / problem.stderr[k] - 1.0;
        assert!(value.abs() < 1e-6, "{name} from {start:?}: b{} off by {value:e}", k + 1);
        assert!(stderr.abs() < 1e-6, "{name} from {start:?}: stderr of b{} off by {stderr:e}", k + 1);
    }
}

#[test]
fn least_squares_reproduces_nists_certified_regressions() {
    for problem in &REGRESSIONS {
        for start in problem.starts {
            // From BoxBOD's first start the way leads onto a plateau unless the rate is bounded.
            let rate = if problem.name == "BoxBOD" { (0.0, 5.0) } else { FREE };
            let mut bounds = vec![FREE; problem.dim()];
            bounds[1] = rate;
            let found = least_squares::minimise(problem, start, &bounds, &PATIENT, &Silent).unwrap();
            assert_certified(problem, &found, start);
        }
    }
}

#[test]
fn a_plateau_is_not_called_convergence() {
    let problem = REGRESSIONS.iter().find(|r| r.name == "BoxBOD").unwrap();
    let found = least_squares::minimise(problem, problem.starts[0], &[FREE; 2], &PATIENT, &Silent).unwrap();
    assert!(found.cost > 2.0 * problem.rss);
    assert_eq!(found.status, Status::IterationLimit);
}

/// The swarm finds the basin in a wide box, least squares finishes.
#[test]
fn swarm_and_least_squares_together_need_no_start() {
    let boxes: [(&str, &[(f64, f64)]); 3] = [
        ("BoxBOD", &[(0.0, 1000.0), (0.0, 5.0)]),
        ("Eckerle4", &[(0.0, 10.0), (0.5, 50.0), (400.0, 500.0)]),
        ("MGH09", &[(0.0, 2.0), (0.0, 2.0), (0.0, 2.0), (0.0, 2.0)]),
    ];
    for (name, bounds) in boxes {
        let problem = REGRESSIONS.iter().find(|r| r.name == name).unwrap();
        for seed in 1..=5 {
            let settings = SwarmSettings { particles: 30, iterations: 60, ..CONTRACTING };
            let basin =
                swarm::minimise(&settings, bounds, seed, None, &|p| problem.cost(p), &Silent).unwrap();
            let found =
                least_squares::minimise(problem, &basin.parameters, bounds, &PATIENT, &Silent).unwrap();
            assert!(found.cost <= basin.cost);
            assert_certified(problem, &found, &basin.parameters);
        }
    }
}

// Covariance ---------------------------------------------------------------------------------------------------------

/// Standard normal numbers from a 64-bit linear congruential generator (Knuth's MMIX) by the Box–Muller transform.
struct Gauss(u64);

impl Gauss {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 11) as f64 + 0.5) * 0.5 * f64::EPSILON
    }
    fn next(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (TAU * self.uniform()).cos()
    }
}

/// y = p₀ + p₁ x
struct Line {
    x: Vec<f64>,
    y: Vec<f64>,
}

impl Line {
    fn residuals(&self, p: &[f64]) -> Vec<f64> {
        self.x.iter().zip(&self.y).map(|(x, y)| p[0] + p[1] * x - y).collect()
    }
}

impl Problem for Line {
    fn dim(&self) -> usize {
        2
    }
    fn cost(&self, p: &[f64]) -> f64 {
        self.residuals(p).iter().map(|r| r * r).sum()
    }
    fn normal(&self, p: &[f64]) -> Normal {
        normal(2, self.residuals(p).into_iter().zip(&self.x).map(|(r, &x)| (r, vec![1.0, x])))
    }
}

#[test]
fn covariance_of_a_straight_line_is_the_textbooks() {
    let x: Vec<f64> = (0..40).map(|k| 100.0 + 0.01 * f64::from(k)).collect();
    let problem = Line { y: x.iter().map(|x| 3.0 - 0.2 * x).collect(), x };
    let found = fit(&problem, &[0.0, 0.0], &[FREE; 2]);
    let c = covariance(&found.normal.jtj, None, &[true; 2]);
    let n = problem.x.len() as f64;
    let mean = problem.x.iter().sum::<f64>() / n;
    let spread: f64 = problem.x.iter().map(|x| (x - mean).powi(2)).sum();
    for (found, exact) in
        [(c[(1, 1)], 1.0 / spread), (c[(0, 0)], 1.0 / n + mean * mean / spread), (c[(0, 1)], -mean / spread)]
    {
        assert!((found / exact - 1.0).abs() < 1e-6, "{found} {exact}");
    }
}

/// Long-run covariance of the scores x·r, Bartlett weights up to `lag` (Newey & West 1987).
fn long_run(problem: &Line, p: &[f64], lag: usize) -> DMatrix<f64> {
    let residuals = problem.residuals(p);
    let score = |k: usize| DVector::from_row_slice(&[residuals[k], residuals[k] * problem.x[k]]);
    let mut meat = DMatrix::zeros(2, 2);
    for k in 0..residuals.len() {
        for l in k.saturating_sub(lag)..(k + lag + 1).min(residuals.len()) {
            let weight = 1.0 - k.abs_diff(l) as f64 / (lag + 1) as f64;
            meat.ger(weight, &score(k), &score(l), 1.0);
        }
    }
    meat
}

/// Noise and regressor both AR(1) with 0.8: the plain interval is far too narrow, the sandwich's is nearly right.
#[test]
fn the_sandwich_covers_under_autocorrelated_noise() {
    let (runs, n, rho) = (300, 800, 0.8f64);
    let innovation = (1.0 - rho * rho).sqrt();
    let mut gauss = Gauss(1);
    let (mut plain, mut sandwich) = (0, 0);
    for _ in 0..runs {
        let (mut x, mut noise) = (gauss.next(), gauss.next());
        let mut problem = Line { x: Vec::new(), y: Vec::new() };
        for _ in 0..n {
            x = rho * x + innovation * gauss.next();
            noise = rho * noise + innovation * gauss.next();
            problem.x.push(x);
            problem.y.push(1.0 + 2.0 * x + noise);
        }
        let found = fit(&problem, &[0.0, 0.0], &[FREE; 2]);
        let variance = found.cost / (n - 2) as f64;
        let meat = long_run(&problem, &found.parameters, 30);
        let covers = |c: &DMatrix<f64>, factor: f64| {
            (found.parameters[1] - 2.0).abs() < 1.96 * (factor * c[(1, 1)]).sqrt()
        };
        plain += usize::from(covers(&covariance(&found.normal.jtj, None, &[true; 2]), variance));
        sandwich += usize::from(covers(&covariance(&found.normal.jtj, Some(&meat), &[true; 2]), 1.0));
    }
    let (plain, sandwich) = (plain as f64 / f64::from(runs), sandwich as f64 / f64::from(runs));
    assert!(plain < 0.75, "plain interval covers {plain}");
    assert!((0.89..0.98).contains(&sandwich), "sandwich covers {sandwich}");
}
