//! Cost of the simulations per sample, in plain numbers and in numbers with derivatives.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use plant::Plant;
use pmsm_core::effects::EffectId;
use pmsm_core::machine::Machine;
use pmsm_core::model::Model;
use pmsm_core::numerics::dual::Dual;
use pmsm_core::numerics::real::Real;
use pmsm_core::recording::{Load, Recording};
use pmsm_core::signals::Signals;
use pmsm_core::simulate::mechanical::{self, Nuisance, Restart};
use pmsm_core::simulate::{coupled, electrical};
use std::hint::black_box;

/// Samples of one window of the paper.
const SAMPLES: usize = 3300;

/// Starts every window at the measured speed.
struct Measured<'a>(&'a [f64]);

impl<T: Real> Restart<T> for Measured<'_> {
    fn speed(&mut self, _: usize, k: usize) -> T {
        T::constant(self.0[k])
    }
    fn forget(&self, _: &mut T) {}
}

fn recording() -> (Plant, Recording, Machine) {
    let plant = Plant::liu();
    let (start, v) = plant.steady([0.0, 4.0], 80.0);
    let run = plant.run(SAMPLES, 1e-5, start, |t| [v[0], v[1] + 4.0 * (60.0 * t).sin()]);
    let machine = plant.nameplate([1.0; 6]);
    (plant, run.log([0.05, 0.5], 0.0, 1, Load::UnknownConstant), machine)
}

fn simulations(c: &mut Criterion) {
    let (plant, recording, machine) = recording();
    let signals = Signals::new(&recording, &machine).expect("signals");
    let model = Model::new(signals.context, &[]);
    let p = [plant.r_s, plant.l_d, plant.l_q, plant.psi_m, plant.j, plant.b];
    let dual: Vec<Dual<8>> = (0..6).map(|k| Dual::variable(p[k], k)).collect();
    let windows = mechanical::windows(&signals);
    let torque = mechanical::torque(&model, &signals, &p);
    let load = Nuisance::unknown(0, 0);
    let mut group = c.benchmark_group("per sample");
    group.throughput(Throughput::Elements(SAMPLES as u64));
    group.bench_function("electrical f64", |b| {
        b.iter(|| {
            let mut sum = 0.0;
            electrical::run(&model, &signals, black_box(&p), |_, i| sum += i[0] + i[1]);
            sum
        });
    });
    group.bench_function("electrical Dual<8>", |b| {
        b.iter(|| {
            let mut sum = Dual::<8>::zero();
            electrical::run(&model, &signals, black_box(&dual), |_, i| sum += i[0] + i[1]);
            sum
        });
    });
    group.bench_function("mechanical f64", |b| {
        b.iter(|| {
            let mut sum = 0.0;
            let (p, restart) = (black_box(&p), Measured(&signals.omega_e));
            let load = (load, &[3.0][..]);
            mechanical::run(&model, &signals, p, &torque, load, &windows, restart, |_, _, w| sum += w);
            sum
        });
    });
    group.bench_function("mechanical Dual<8>", |b| {
        let torque: Vec<Dual<8>> = torque.iter().map(|x| Dual::constant(*x)).collect();
        b.iter(|| {
            let mut sum = Dual::<8>::zero();
            let (p, restart) = (black_box(&dual), Measured(&signals.omega_e));
            let load = (load, &[Dual::constant(3.0)][..]);
            mechanical::run(&model, &signals, p, &torque, load, &windows, restart, |_, _, w| sum += w);
            sum
        });
    });
    let effects =
        [EffectId::DeadTime, EffectId::SaturationQ, EffectId::StribeckFriction, EffectId::CoggingTorque];
    let rich = Model::new(signals.context, &effects);
    let typical =
        effects.iter().flat_map(|e| e.info().parameters.iter().map(|p| (p.typical)(rich.context())));
    let values: Vec<f64> = p.into_iter().chain(typical).collect();
    let dual: Vec<Dual<8>> = values
        .iter()
        .enumerate()
        .map(|(k, x)| if k < 8 { Dual::variable(*x, k) } else { Dual::constant(*x) })
        .collect();
    group.bench_function("electrical Dual<8>, four effects", |b| {
        b.iter(|| {
            let mut sum = Dual::<8>::zero();
            electrical::run(&rich, &signals, black_box(&dual), |_, i| sum += i[0] + i[1]);
            sum
        });
    });
    group.bench_function("mechanical Dual<8>, four effects", |b| {
        let torque: Vec<Dual<8>> = torque.iter().map(|x| Dual::constant(*x)).collect();
        b.iter(|| {
            let mut sum = Dual::<8>::zero();
            let (p, restart) = (black_box(&dual), Measured(&signals.omega_e));
            let load = (load, &[Dual::constant(3.0)][..]);
            mechanical::run(&rich, &signals, p, &torque, load, &windows, restart, |_, _, w| sum += w);
            sum
        });
    });
    group.bench_function("torque Dual<8>, four effects", |b| {
        b.iter(|| mechanical::torque(&rich, &signals, black_box(&dual)));
    });
    group.bench_function("coupled f64", |b| {
        b.iter(|| {
            let mut sum = 0.0;
            coupled::run(&model, &signals, 0..SAMPLES, black_box(&p), 3.0, |_, x| {
                sum += x[0] + x[1] + x[2];
                true
            });
            sum
        });
    });
    group.finish();
}

criterion_group!(benches, simulations);
criterion_main!(benches);
