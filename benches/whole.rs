//! The whole way: one window of the tracker, and a diagnosis with the whole catalogue on recordings of different length.

use criterion::{BatchSize, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use plant::Plant;
use pmsm_core::diagnose::diagnose;
use pmsm_core::drive::{Choice, Manoeuvre, Schedule, Setup, Shape, simulate};
use pmsm_core::identify::Method;
use pmsm_core::machine::Machine;
use pmsm_core::monitor::Silent;
use pmsm_core::recording::{Load, Recording};
use pmsm_core::track::{Settings, Tracker};

/// Samples of one window of the paper, 33 ms at 100 kHz.
const SAMPLES: usize = 3300;
const PERIOD: f64 = 1e-5;

/// The second window of a stream, begun from the result of the first, which ends with the second's first row.
fn tracker(c: &mut Criterion) {
    let plant = Plant::liu();
    let (start, v) = plant.steady([0.0, 4.0], 80.0);
    let run = plant.run(2 * SAMPLES, PERIOD, start, |t| [v[0], v[1] + 4.0 * (60.0 * t).sin()]);
    let log = run.log([0.05, 0.5], 0.0, 1, Load::UnknownConstant);
    let rows = |from: usize, to: usize| -> Vec<(&str, &[f64])> {
        log.names().into_iter().map(|name| (name, &log.column(name).expect("logged")[from..to])).collect()
    };
    let mut group = c.benchmark_group("tracker, one window");
    for (name, method) in [("warm least squares", Method::LeastSquares), ("the paper's swarm", Method::Swarm)]
    {
        let settings = Settings { method, ..Settings::default() };
        let begun = || {
            let mut tracker = Tracker::new(plant.nameplate([1.0; 6]), settings.clone()).expect("a tracker");
            tracker.update(&rows(0, SAMPLES + 1), &Silent).expect("the first window");
            tracker
        };
        group.bench_function(name, |b| {
            b.iter_batched(
                begun,
                |mut tracker| {
                    let update = tracker.update(&rows(SAMPLES + 1, 2 * SAMPLES), &Silent);
                    (update.expect("rows"), tracker.finish(&Silent).expect("a window"))
                },
                BatchSize::SmallInput,
            );
        });
    }
    group.finish();
}

/// A drive that reverses once a second, at 10 kHz, under a load that nobody knows and that changes every 0.7 s, or under none.
fn recording(seconds: u32, effects: &[Choice], stepping: bool) -> (Recording, Machine) {
    let machine = Machine::liu_2008().with_drive(Some(560.0), Some(20.0), Some(1e4)).expect("a sane drive");
    let mut manoeuvre = Manoeuvre::new(f64::from(seconds));
    manoeuvre.settle = 0.3;
    let speeds = (0..=4 * seconds).map(|k| (0.25 * f64::from(k), [0.0, 90.0, -40.0, -80.0][k as usize % 4]));
    manoeuvre.omega_m = Some(Schedule::new(speeds.collect(), Shape::Linear).expect("a schedule"));
    if stepping {
        let loads =
            (0..=seconds * 10 / 7).map(|k| (0.7 * f64::from(k), [2.0, 5.0, 1.0, 3.5][k as usize % 4]));
        manoeuvre.tau_load = Some(Schedule::new(loads.collect(), Shape::Steps).expect("a schedule"));
        manoeuvre.load_kind = Some("unknown_piecewise".into());
    }
    let mut setup = Setup::new(machine, manoeuvre);
    setup.effects = effects.to_vec();
    (setup.drive.sensors.noise_i, setup.drive.sensors.noise_omega_e) = (0.05, 0.3);
    (simulate(&setup, &Silent).expect("a recording").recording, setup.nameplate)
}

fn diagnosis(c: &mut Criterion) {
    let friction = Choice {
        effect: "coulomb_friction".into(),
        parameters: [("tau_c".to_owned(), 0.3)].into(),
        definition: None,
    };
    let mut group = c.benchmark_group("diagnosis with the whole catalogue");
    group.sample_size(10);
    for (name, effects, stepping) in [
        ("clean", Vec::new(), false),
        ("Coulomb friction", vec![friction], false),
        ("a load that steps", Vec::new(), true),
    ] {
        for seconds in [1, 2, 4, 8] {
            let (recording, machine) = recording(seconds, &effects, stepping);
            group.throughput(Throughput::Elements(recording.len() as u64));
            group.bench_function(BenchmarkId::new(name, format!("{seconds} s")), |b| {
                b.iter(|| {
                    diagnose(&[&recording], &machine, None, &Default::default(), &Silent).expect("an answer")
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, tracker, diagnosis);
criterion_main!(benches);
