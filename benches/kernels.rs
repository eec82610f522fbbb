//! The kernels: J1, J2, J3 and least squares as the comparison with the peers defines them, every path beside the roofline of
//! its fused multiply-add ports, and what each effect adds to a step on vectors.

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use plant::Plant;
use pmsm_core::effects::text::{Definition, Quantity, Side, TextId};
use pmsm_core::effects::{self, EffectId};
use pmsm_core::identify::{Method, Request, identify};
use pmsm_core::kernels::bare::{self, Kernel, POINT, Track, chunks};
use pmsm_core::kernels::objective::{Drive, Objective};
use pmsm_core::machine::Machine;
use pmsm_core::model::Model;
use pmsm_core::monitor::Silent;
use pmsm_core::numerics::lanes::{self, Job, Lane, Path, Rounding};
use pmsm_core::optimise::swarm::SwarmSettings;
use pmsm_core::recording::{Load, Recording};
use pmsm_core::signals::Signals;
use pmsm_core::simulate::mechanical;
use std::hint::black_box;

/// Samples of one window of the paper.
const SAMPLES: usize = 3300;
/// Samples of J3. Under three million would not be cut into pieces: the drive forgets where it started in 94,000.
const LONG: usize = 10_000_000;
/// Fused multiply-adds and other multiplications of a particle-step with saliency, the fitness included: what the ports bound.
const PORT_OPERATIONS: usize = 40;

/// The operations of `steps` particle-steps per lane in independent chains: nothing but the ports limits them. Two ports of four cycles
/// keep eight busy, and with both constants all chains stay in sixteen registers. With `ADD` sixteen of a step's seventeen additions
/// are among them: these have ports of their own on some processors and share those of the multiply-adds on others.
struct Ports<const ADD: bool> {
    steps: usize,
}

impl<const ADD: bool> Job for Ports<ADD> {
    type Output = f64;
    #[inline(always)]
    fn run<V: Lane>(self) -> f64 {
        const CHAINS: usize = 10;
        const ADDED: usize = 4;
        let (a, b) = (V::constant(black_box(0.999)), V::constant(black_box(1e-3)));
        let (mut x, mut z) = ([V::zero(); CHAINS], [V::zero(); ADDED]);
        for k in 0..CHAINS {
            x[k] = V::constant(black_box(k as f64));
        }
        // Four that differ, so that none of them can stand for the others.
        for k in 0..ADDED {
            z[k] = V::constant(black_box(k as f64));
        }
        for _ in 0..self.steps * PORT_OPERATIONS / CHAINS {
            for k in 0..CHAINS {
                x[k] = x[k].mul_add(a, b);
            }
            if ADD {
                for k in 0..ADDED {
                    z[k] += a;
                }
            }
        }
        let mut sum = V::zero();
        for part in x.into_iter().chain(z) {
            sum += part;
        }
        sum.first()
    }
}

fn recording(samples: usize) -> (Plant, Recording, Machine) {
    let plant = Plant::liu();
    let (start, v) = plant.steady([0.0, 4.0], 80.0);
    let run = plant.run(samples, 1e-5, start, |t| [v[0], v[1] + 4.0 * (60.0 * t).sin()]);
    let machine = plant.nameplate([1.0; 6]);
    (plant, run.log([0.05, 0.5], 0.0, 1, Load::UnknownConstant), machine)
}

/// Parameter sets around the plant's, with saliency.
fn points(plant: &Plant, count: usize) -> Vec<f64> {
    let truth = [plant.r_s, plant.l_d, 1.2 * plant.l_q, plant.psi_m, plant.j, plant.b, plant.tau_load];
    (0..count).flat_map(|k| truth.map(|x| x * (0.8 + 0.4 * k as f64 / count as f64))).collect()
}

/// Time per particle-step of every path, no particle abandoned, and of its multiplications, without and with its additions.
fn paths(c: &mut Criterion) {
    let (plant, recording, machine) = recording(SAMPLES);
    let signals = Signals::new(&recording, &machine).expect("signals");
    let track = Track::new(&signals, 1.5, 0.01).expect("evenly sampled");
    let (count, stop) = (256, || false);
    let (points, bounds) = (points(&plant, count), vec![f64::INFINITY; count]);
    let mut group = c.benchmark_group("particle-step");
    for path in Path::ALL.into_iter().filter(|path| path.available()) {
        group.throughput(Throughput::Elements((count * SAMPLES) as u64));
        for (name, rounding, increments) in [
            ("fused", Rounding::Fused, false),
            ("reproducible", Rounding::Reproducible, false),
            ("increments", Rounding::Fused, true),
        ] {
            let kernel = Kernel { path, rounding, increments };
            let mut costs = vec![0.0; count];
            group.bench_function(format!("{path:?} {name}"), |b| {
                b.iter(|| bare::costs(&track, kernel, &points, &bounds, &mut costs, &stop));
            });
        }
        let steps = black_box(count * SAMPLES / path.width());
        group.bench_function(format!("{path:?} roofline of the multiply-add ports"), |b| {
            b.iter(|| lanes::run(path, Rounding::Fused, Ports::<false> { steps }));
        });
        group.bench_function(format!("{path:?} roofline with additions"), |b| {
            b.iter(|| lanes::run(path, Rounding::Fused, Ports::<true> { steps }));
        });
    }
    group.finish();
}

fn jobs(c: &mut Criterion) {
    let (_, recording, machine) = recording(SAMPLES);
    let job = |particles: usize, all: bool, method: Method| {
        let bounds = [
            ("r_s", 0.05, 0.5),
            ("tau_load", 0.0, 10.0),
            ("l_d", 1e-3, 4e-3),
            ("l_q", 1e-3, 4e-3),
            ("psi_m", 0.1, 0.5),
            ("j", 0.002, 0.02),
            ("b", 0.0, 0.01),
        ];
        let fit = bounds[..if all { 7 } else { 2 }].iter();
        let fit = fit.map(|(name, low, high)| (name.parse().expect("known"), Some((*low, *high)))).collect();
        let swarm = SwarmSettings { particles, ..SwarmSettings::default() };
        Request { fit, method, swarm, ..Request::default() }
    };
    let mut group = c.benchmark_group("identify");
    group.sample_size(20);
    for (name, request, threads) in [
        ("J1: 10 x 31, 2 parameters", job(10, false, Method::Swarm), 1),
        ("J2: 1000 x 31, 7 parameters", job(1000, true, Method::Swarm), 1),
        ("J2 on two threads", job(1000, true, Method::Swarm), 2),
        ("least squares, 2 parameters", job(10, false, Method::LeastSquares), 1),
        ("least squares, 7 parameters", job(10, true, Method::LeastSquares), 1),
    ] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        group.bench_function(name, |b| {
            b.iter_batched(
                || request.clone(),
                |request| {
                    pool.install(|| identify(&recording, &machine, &request, &Silent).expect("an answer"))
                },
                BatchSize::SmallInput,
            );
        });
    }
    group.finish();
}

/// J3: one parameter set on ten million samples, in pieces and in a row.
fn long(c: &mut Criterion) {
    let (plant, short, machine) = recording(10_000);
    let repeated = |name: &str| {
        let column = short.column(name).expect("logged");
        column.iter().cycle().take(LONG).copied().collect::<Vec<f64>>()
    };
    let mut columns: Vec<(String, Vec<f64>)> =
        ["v_d", "v_q", "i_d", "i_q", "omega_e"].map(|name| (name.to_owned(), repeated(name))).into();
    columns.push(("t".into(), (0..LONG).map(|k| 1e-5 * k as f64).collect()));
    let recording = Recording::new(columns, Some(Load::UnknownConstant)).expect("a sane recording");
    let signals = Signals::new(&recording, &machine).expect("signals");
    let track = Track::new(&signals, 1.5, 0.01).expect("evenly sampled");
    // Far from the truth the drive would run faster, remember longer, and no seam would meet.
    let p: [f64; POINT] = [plant.r_s, plant.l_d, plant.l_q, plant.psi_m, plant.j, plant.b, plant.tau_load];
    let (_, seams) = chunks::cost(&track, Kernel::default(), &p, &|| false).expect("nothing stops it");
    assert!(seams.fallbacks == 0 && seams.count > 0, "{seams:?}");
    let mut group = c.benchmark_group("J3, per sample");
    group.throughput(Throughput::Elements(LONG as u64)).sample_size(10);
    group.bench_function("pieces of time side by side", |b| {
        b.iter(|| chunks::cost(&track, Kernel::default(), black_box(&p), &|| false));
    });
    group.bench_function("in a row", |b| {
        let mut cost = [0.0];
        b.iter(|| {
            bare::costs(&track, Kernel::default(), black_box(&p), &[f64::INFINITY], &mut cost, &|| false)
        });
    });
    group.finish();
}

/// Time per particle-step of the model with one effect of the catalogue, on vectors.
/// Effects of the catalogue as text, named after them.
fn as_text() -> Vec<EffectId> {
    let quantity = |(name, unit, high): &(&str, &str, f64)| Quantity {
        name: (*name).into(),
        unit: (*unit).into(),
        low: if *name == "a" || *name == "b" { -high } else { 0.0 },
        high: *high,
        typical: Some(0.1 * high),
        values: Vec::new(),
        meaning: None,
    };
    let text = |name: &str, side: Side, terms: &[&str], parameters: &[(&str, &str, f64)]| {
        let mut parameters: Vec<Quantity> = parameters.iter().map(quantity).collect();
        // Shapes stay above zero.
        parameters.iter_mut().skip(1).filter(|p| p.low == 0.0).for_each(|p| p.low = 1e-2 * p.high);
        let definition = Definition {
            name: format!("{name}_as_text"),
            side,
            terms: terms.iter().map(|t| (*t).to_string()).collect(),
            parameters,
            title: None,
            replaces: Vec::new(),
        };
        EffectId::Text(TextId::new(&definition).expect("it is right"))
    };
    let phase = |f: &str| {
        ["i_a", "i_b", "i_c"]
            .iter()
            .zip(["", "-2*pi/3", "+2*pi/3"])
            .fold(String::new(), |sum, (i, turned)| {
                format!("{sum}+{i}/sqrt({i}**2+i_th**2)*{f}(theta_e{turned})")
            })
    };
    let (d, q) = (format!("v_err*2/3*({})", phase("cos")), format!("-v_err*2/3*({})", phase("sin")));
    let saturated = "k/l_q*lambda_q**2*abs(lambda_q/one)**s/(s+2)";
    vec![
        text(
            "coulomb_friction",
            Side::Torque,
            &["tau_c*tanh(w/w_0)"],
            &[("tau_c", "N m", 5.0), ("w_0", "rad/s", 10.0)],
        ),
        text("quadratic_drag", Side::Torque, &["k*w*abs(w)"], &[("k", "N m s^2", 1e-3)]),
        text(
            "cogging_torque",
            Side::Torque,
            &["a*cos(24*theta_m)+b*sin(24*theta_m)"],
            &[("a", "N m", 1.0), ("b", "N m", 1.0)],
        ),
        text("dead_time", Side::Voltage, &[&d, &q], &[("v_err", "V", 10.0), ("i_th", "A", 2.0)]),
        text(
            "saturation_q",
            Side::Energy,
            &[saturated],
            &[("k", "1", 2.0), ("s", "1", 8.0), ("one", "V s", 2.0)],
        ),
    ]
}

fn with_effects(c: &mut Criterion) {
    let (plant, recording, machine) = recording(500);
    let signals = Signals::new(&recording, &machine).expect("signals");
    let windows = mechanical::windows(&signals);
    let mut group = c.benchmark_group("particle-step with effect");
    group.throughput(Throughput::Elements(8 * 500)).sample_size(10);
    for effect in std::iter::once(None).chain(effects::ALL.iter().copied().chain(as_text()).map(Some)) {
        let chosen: Vec<_> = effect.into_iter().collect();
        let model = Model::new(signals.context, &chosen);
        let objective = Objective::new(Drive::Coupled, &model, &signals, &windows).reference();
        let one = points(&plant, 1);
        let mut point = one[..6].to_vec();
        point.extend(chosen.iter().flat_map(|e| e.info().parameters).map(|p| (p.typical)(model.context())));
        point.push(one[6]);
        point.resize(objective.len(), 0.0);
        let (points, bounds) = (point.repeat(8), [f64::INFINITY; 8]);
        let mut costs = [0.0; 8];
        group.bench_function(effect.map_or("none", |e| e.id()), |b| {
            b.iter(|| objective.fitnesses(&points, &bounds, &mut costs, &|| false));
        });
    }
    group.finish();
}

criterion_group!(benches, paths, jobs, long, with_effects);
criterion_main!(benches);
