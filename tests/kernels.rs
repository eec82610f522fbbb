//! What the kernels promise: the numbers of the reference equations, the same bits on every path, exact abandonment.

mod plant;
#[path = "kernels/reference.rs"]
mod reference;
#[path = "kernels/sensitivity.rs"]
mod sensitivity;

use plant::Plant;
use pmsm_core::effects;
use pmsm_core::identify::{Method, Request, identify};
use pmsm_core::kernels::bare::{self, Kernel, POINT, Track, chunks};
use pmsm_core::kernels::objective::{Drive, Objective, speed_weight};
use pmsm_core::machine::Machine;
use pmsm_core::model::Model;
use pmsm_core::monitor::{Silent, StopFlag};
use pmsm_core::numerics::lanes::{self, Job, Lane, Path, Rounding};
use pmsm_core::recording::{Load, Recording};
use pmsm_core::signals::Signals;
use pmsm_core::simulate::mechanical;
use proptest::prelude::*;
use sensitivity::Sensitivity;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A salient motor, `n` samples at 1/`period`, with a gap where `gap` says so.
fn signals(n: usize, period: f64, gap: Option<usize>, load: Load) -> (Plant, Signals) {
    let plant = Plant::servo();
    let (start, v) = plant.steady([-1.0, 3.0], 60.0);
    let run =
        plant.run(n, period, start, |t| [v[0] + 3.0 * (900.0 * t).sin(), v[1] + 6.0 * (400.0 * t).cos()]);
    let log = run.log([0.02, 0.3], 0.0, 3, Load::UnknownConstant);
    let column = |name: &str| log.column(name).expect("logged").to_vec();
    let mut columns: Vec<(String, Vec<f64>)> =
        log.names().iter().map(|name| ((*name).to_owned(), column(name))).collect();
    if let Some(gap) = gap {
        for t in columns.iter_mut().filter(|(name, _)| name == "t").flat_map(|(_, t)| &mut t[gap..]) {
            *t += 0.5;
        }
    }
    if load == Load::Measured {
        columns.push(("tau_m".into(), (0..n).map(|k| 1.0 + 0.3 * (0.01 * k as f64).sin()).collect()));
    }
    let recording = Recording::new(columns, Some(load)).expect("a sane recording");
    let machine = plant.nameplate([1.0; 6]);
    (plant, Signals::new(&recording, &machine).expect("signals"))
}

fn truth(plant: &Plant) -> [f64; POINT] {
    [plant.r_s, plant.l_d, plant.l_q, plant.psi_m, plant.j, plant.b, plant.tau_load]
}

fn points(plant: &Plant, factors: &[[f64; POINT]]) -> Vec<f64> {
    factors
        .iter()
        .flat_map(|f| truth(plant).into_iter().zip(f).map(|(x, f)| x * f).collect::<Vec<_>>())
        .collect()
}

fn objective<'a>(model: &'a Model, signals: &'a Signals, windows: &'a [Range<usize>]) -> Objective<'a> {
    Objective::new(Drive::Coupled, model, signals, windows)
}

fn costs(track: &Track, kernel: Kernel, points: &[f64], bounds: &[f64]) -> Vec<f64> {
    let mut costs = vec![0.0; bounds.len()];
    assert!(bare::costs(track, kernel, points, bounds, &mut costs, &|| false));
    costs
}

fn close(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance * a.abs().max(b.abs())
}

/// Every operation of a vector on given numbers.
struct Operations<'a>(&'a [[f64; 3]]);

impl Job for Operations<'_> {
    type Output = Vec<u64>;
    #[inline(always)]
    fn run<V: Lane>(self) -> Vec<u64> {
        let mut out = Vec::new();
        for rows in self.0.chunks(V::WIDTH) {
            let mut columns = [[0.0; 8]; 3];
            for (at, row) in rows.iter().enumerate() {
                for n in 0..3 {
                    columns[n][at] = row[n];
                }
            }
            let [x, y, z] = [V::load(&columns[0]), V::load(&columns[1]), V::load(&columns[2])];
            let (s, c) = x.sin_cos();
            let mut sum = x;
            sum += y;
            sum -= z;
            let all = [
                x + y,
                x - y,
                x * y,
                x / y,
                -x,
                x + 0.1,
                x - 0.1,
                x * 0.1,
                sum,
                x.mul_add(y, z),
                x.neg_mul_add(y, z),
                x.abs(),
                x.abs().sqrt(),
                s,
                c,
                y.exp(),
                x.abs().ln(),
                x.tanh(),
                x.if_positive(y, z),
                x.squared(),
                x.abs().pow_nonnegative(y),
                V::constant(x.first()) - x,
            ];
            let mut parts = [[0.0; 8]; 22];
            for (part, value) in parts.iter_mut().zip(all) {
                value.store(part);
            }
            let within = x.any_within(y);
            assert_eq!(within, (0..V::WIDTH).any(|k| columns[0][k] <= columns[1][k]));
            // What depends on the neighbours, the last, is left out.
            out.extend((0..rows.len()).flat_map(|at| parts[..21].iter().map(move |part| part[at].to_bits())));
        }
        out
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn every_operation_has_the_bits_of_single_numbers_on_every_path(
        rows in prop::collection::vec(prop::array::uniform3(-20.0..20.0f64), 1..40),
    ) {
        let expected = lanes::run(Path::Portable, Rounding::Reproducible, Operations(&rows));
        for path in Path::ALL {
            prop_assert_eq!(&lanes::run(path, Rounding::Reproducible, Operations(&rows)), &expected);
        }
    }

    #[test]
    fn every_path_and_number_of_neighbours_gives_the_same_bits(
        factors in prop::collection::vec(prop::array::uniform7(0.6..1.6f64), 1..40), increments: bool, slow: bool,
    ) {
        // Several steps per sample where the log is slow.
        let period = if slow { 1e-3 } else { 1e-4 };
        let (plant, signals) = signals(300, period, Some(170), Load::UnknownConstant);
        let track = Track::new(&signals, 1.5, 0.01).expect("evenly sampled");
        let (points, free) = (points(&plant, &factors), vec![f64::INFINITY; factors.len()]);
        let kernel = |path, rounding| Kernel { path, rounding, increments };
        let expected = costs(&track, kernel(Path::Portable, Rounding::Reproducible), &points, &free);
        let model = Model::new(signals.context, &[]);
        let starts = objective(&model, &signals, &[]).measured_starts();
        let allowed: Vec<f64> = points
            .chunks(POINT)
            .zip(&expected)
            .map(|(p, cost)| Sensitivity::new(&signals, [1.5, 0.01], p, &starts).rounding_of_cost(*cost))
            .collect();
        for path in Path::ALL {
            prop_assert_eq!(&costs(&track, kernel(path, Rounding::Reproducible), &points, &free), &expected);
            let fused = costs(&track, kernel(path, Rounding::Fused), &points, &free);
            for ((fused, expected), allowed) in fused.iter().zip(&expected).zip(&allowed) {
                prop_assert!((fused - expected).abs() <= *allowed, "{fused} {expected} {allowed}");
            }
            if Path::Avx2.available() && path >= Path::Avx2 {
                prop_assert_eq!(&fused, &costs(&track, kernel(Path::Avx2, Rounding::Fused), &points, &free));
            }
        }
        let alone = costs(&track, kernel(Path::best(), Rounding::Reproducible), &points[..POINT], &free[..1]);
        prop_assert_eq!(alone[0], expected[0]);
    }

    #[test]
    fn a_set_without_saliency_has_the_same_bits_alone_and_beside_a_salient_one(
        factors in prop::array::uniform7(0.6..1.6f64), fused: bool, measured: bool,
    ) {
        let load = if measured { Load::Measured } else { Load::UnknownConstant };
        let (plant, signals) = signals(300, 1e-4, None, load);
        let track = Track::new(&signals, 1.5, 0.01).expect("evenly sampled");
        let mut both = points(&plant, &[factors, factors]);
        both[2] = both[1];
        let rounding = if fused { Rounding::Fused } else { Rounding::Reproducible };
        for path in Path::ALL {
            let kernel = Kernel { path, rounding, increments: false };
            let beside = costs(&track, kernel, &both, &[f64::INFINITY; 2]);
            prop_assert!(beside[0] != beside[1]);
            prop_assert_eq!(&costs(&track, kernel, &both[..POINT], &[f64::INFINITY]), &beside[..1]);
        }
    }

    #[test]
    fn abandoning_one_set_changes_no_bit_of_another(
        factors in prop::collection::vec(prop::array::uniform7(0.6..1.6f64), 2..60), share in 0.0..2.0f64, slow: bool,
    ) {
        let period = if slow { 1e-3 } else { 1e-4 };
        let (plant, signals) = signals(500, period, Some(310), Load::UnknownConstant);
        let track = Track::new(&signals, 1.5, 0.01).expect("evenly sampled");
        let points = points(&plant, &factors);
        let whole = costs(&track, Kernel::default(), &points, &vec![f64::INFINITY; factors.len()]);
        let bounds: Vec<f64> = whole.iter().rev().map(|c| share * c).collect();
        for ((now, cost), bound) in costs(&track, Kernel::default(), &points, &bounds).iter().zip(&whole).zip(&bounds) {
            prop_assert_eq!(*now, if cost <= bound { *cost } else { f64::INFINITY });
        }
    }
}

#[test]
fn a_recorded_run_that_is_stopped_tells_nothing() {
    let (plant, signals) = signals(3000, 1e-5, None, Load::UnknownConstant);
    let (model, windows) = (Model::new(signals.context, &[]), mechanical::windows(&signals));
    let objective = objective(&model, &signals, &windows);
    let looks = AtomicUsize::new(0);
    let stop = || looks.fetch_add(1, Ordering::Relaxed) > 0;
    let starts = objective.measured_starts();
    let stopped = objective.normal(&truth(&plant), &[0, 6], &starts, true, &stop).expect("kernels");
    assert!(looks.into_inner() > 1 && stopped.linear.is_none() && stopped.normal.cost.is_nan());
}

#[test]
fn derivatives_for_an_uncertainty_are_near_those_around_the_best_initial_values() {
    let (plant, signals) = signals(3000, 1e-5, Some(1500), Load::UnknownConstant);
    let (model, windows) = (Model::new(signals.context, &[]), mechanical::windows(&signals));
    let objective = objective(&model, &signals, &windows);
    let p: Vec<f64> = truth(&plant).iter().map(|x| 1.001 * x).collect();
    let free = [0, 1, 2, 3, 4, 5, 6];
    let (near, best) = (objective.linearise_nearby(&p, &free), objective.linearise(&p, &free, None));
    let off = (&near.residual - &best.residual).norm() / best.residual.norm();
    assert!(off > 0.0 && off < 0.01, "{off}");
    for k in free {
        let (near, best) = (near.jacobian.column(k), best.jacobian.column(k));
        let off = (near - best).norm() / best.norm();
        assert!(off < 0.05, "{k}: {off}");
    }
    // From where the measured values are far off, the best ones are looked for.
    let far: Vec<f64> = p.iter().zip([3.0, 0.5, 2.0, 0.6, 1.0, 1.0, 1.0]).map(|(x, f)| x * f).collect();
    let (near, best) = (objective.linearise_nearby(&far, &free), objective.linearise(&far, &free, None));
    assert_eq!(near.residual, best.residual);
}

#[test]
fn increments_round_less_than_stage_values() {
    let (plant, signals) = signals(3000, 1e-5, None, Load::UnknownConstant);
    let track = Track::new(&signals, 1.5, speed_weight(&signals).powi(2)).expect("evenly sampled");
    let p = truth(&plant);
    let reference = {
        let model = Model::new(signals.context, &[]);
        let windows = mechanical::windows(&signals);
        objective(&model, &signals, &windows).reference().fitness(&p, f64::INFINITY)
    };
    let error = |increments| {
        let kernel = Kernel { increments, ..Kernel::default() };
        (costs(&track, kernel, &p, &[f64::INFINITY])[0] / reference - 1.0).abs()
    };
    assert!(error(true) < 1e-11 && error(false) < 1e-10, "{:e} {:e}", error(true), error(false));
}

/// Every effect of the catalogue, at its typical strength and at others, eight parameter sets at once.
#[test]
fn effects_on_vectors_give_the_bits_of_single_runs() {
    let (plant, signals) = signals(120, 1e-4, Some(70), Load::UnknownConstant);
    let windows = mechanical::windows(&signals);
    for effect in effects::ALL {
        let model = Model::new(signals.context, &[*effect]);
        let objective = objective(&model, &signals, &windows);
        let typical: Vec<f64> =
            effect.info().parameters.iter().map(|p| (p.typical)(model.context())).collect();
        let mut points = Vec::new();
        for k in 0..11 {
            let own = truth(&plant);
            points.extend(own[..6].iter().map(|x| x * (0.9 + 0.02 * f64::from(k))));
            points.extend(typical.iter().map(|x| x * if k == 0 { 1.0 } else { 0.2 * f64::from(k) }));
            points.push(own[6]);
            points.extend(vec![0.0; objective.len() - 7 - typical.len()]);
        }
        let single: Vec<f64> =
            points.chunks(objective.len()).map(|p| objective.fitness(p, f64::INFINITY)).collect();
        let middle = single.iter().copied().filter(|c| c.is_finite()).fold(0.0, f64::max) * 0.5;
        for bound in [f64::INFINITY, middle] {
            let mut costs = [0.0; 11];
            assert_eq!(objective.fitnesses(&points, &[bound; 11], &mut costs, &|| false), 11);
            let expected: Vec<f64> =
                single.iter().map(|c| if *c <= bound { *c } else { f64::INFINITY }).collect();
            assert_eq!(costs[..], expected[..], "{}", effect.id());
        }
    }
}

#[test]
fn pieces_of_a_long_recording_meet_and_add_up() {
    let (plant, signals) = signals(120_000, 1e-3, None, Load::UnknownConstant);
    let track = Track::new(&signals, 1.5, 0.01).expect("evenly sampled");
    let p = truth(&plant);
    let kernel = Kernel { rounding: Rounding::Reproducible, ..Kernel::default() };
    let expected = costs(&track, kernel, &p, &[f64::INFINITY])[0];
    let (sum, seams) = chunks::cost(&track, kernel, &p, &|| false).expect("not stopped");
    assert!(seams.count == 15 && seams.fallbacks == 0, "{seams:?}");
    assert!(close(sum, expected, 1e-11), "{sum} {expected}");
    for path in Path::ALL {
        assert_eq!(chunks::cost(&track, Kernel { path, ..kernel }, &p, &|| false).map(|c| c.0), Some(sum));
    }
    // A motor that forgets slower than the pieces are long is run in a row.
    let slow = [p[0], p[1], p[2], p[3], 50.0, p[5], p[6]];
    let (sum, seams) = chunks::cost(&track, kernel, &slow, &|| false).expect("not stopped");
    assert_eq!((seams.count, sum), (0, costs(&track, kernel, &slow, &[f64::INFINITY])[0]));
    assert!(chunks::cost(&track, kernel, &p, &|| true).is_none());
}

#[test]
fn unevenly_sampled_recordings_are_left_to_the_reference_equations() {
    let (_, mut signals) = signals(100, 1e-4, None, Load::UnknownConstant);
    assert!(Track::new(&signals, 1.5, 0.01).is_some());
    signals.t[50] += 2e-5;
    assert!(Track::new(&signals, 1.5, 0.01).is_none());
}

#[test]
fn a_swarm_on_two_threads_takes_the_path_of_one() {
    let plant = Plant::servo();
    let (start, v) = plant.steady([-1.0, 3.0], 60.0);
    let log = plant.run(200, 1e-4, start, |t| [v[0], v[1] + 6.0 * (400.0 * t).cos()]).log(
        [0.02, 0.3],
        0.0,
        3,
        Load::UnknownConstant,
    );
    let machine: Machine = plant.nameplate([1.1; 6]);
    let mut request = Request { method: Method::Swarm, ..Request::default() };
    request.swarm.particles = 600;
    request.swarm.iterations = 10;
    let answer = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| identify(&log, &machine, &request, &Silent).expect("an answer"))
    };
    assert_eq!(answer(1).history, answer(2).history);
}

#[test]
fn a_stop_ends_the_search_with_the_best_so_far() {
    let plant = Plant::servo();
    let (start, v) = plant.steady([-1.0, 3.0], 60.0);
    let log = plant.run(200, 1e-4, start, |_| v).log([0.02, 0.3], 0.0, 3, Load::UnknownConstant);
    let machine = plant.nameplate([1.1; 6]);
    let flag = StopFlag::default();
    flag.stop();
    for method in [Method::LeastSquares, Method::Both] {
        let answer =
            identify(&log, &machine, &Request { method, ..Request::default() }, &flag).expect("an answer");
        assert!(answer.interrupted && answer.cost.is_finite());
    }
}
