//! The simulations against an independent integration of the textbook equations.

mod plant;

use plant::{Plant, Run, State, dormand_prince};
use pmsm_core::effects::EffectId;
use pmsm_core::model::Model;
use pmsm_core::recording::{Load, Recording};
use pmsm_core::signals::Signals;
use pmsm_core::simulate::{coupled, electrical};

fn signals(recording: &Recording, plant: &Plant) -> Signals {
    Signals::new(recording, &plant.nameplate([1.0; 6])).expect("signals")
}

fn parameters(plant: &Plant) -> Vec<f64> {
    vec![plant.r_s, plant.l_d, plant.l_q, plant.psi_m, plant.j, plant.b]
}

fn run_coupled(signals: &Signals, plant: &Plant, effects: &[(EffectId, &[f64])]) -> Vec<[f64; 3]> {
    let ids: Vec<EffectId> = effects.iter().map(|(id, _)| *id).collect();
    let model = Model::new(signals.context, &ids);
    let mut p = parameters(plant);
    effects.iter().for_each(|(_, own)| p.extend_from_slice(own));
    let mut out = Vec::new();
    coupled::run(&model, signals, 0..signals.len(), &p, plant.tau_load, |_, now| {
        out.push(now);
        true
    });
    out
}

fn run_electrical(signals: &Signals, plant: &Plant) -> Vec<[f64; 2]> {
    let model = Model::new(signals.context, &[]);
    let mut out = Vec::new();
    electrical::run(&model, signals, &parameters(plant), |_, now| out.push(now));
    out
}

/// Largest distance between two trajectories over the largest value, worst channel.
fn distance<const N: usize>(a: &[[f64; N]], b: &[[f64; N]]) -> f64 {
    assert_eq!(a.len(), b.len());
    (0..N)
        .map(|c| {
            let size = b.iter().map(|x| x[c].abs()).fold(0.0, f64::max);
            a.iter().zip(b).map(|(a, b)| (a[c] - b[c]).abs()).fold(0.0, f64::max) / size
        })
        .fold(0.0, f64::max)
}

fn shown(run: &Run) -> Vec<[f64; 3]> {
    run.x.iter().map(|x| [x[0], x[1], x[2] * run.n_p]).collect()
}

/// Steps of both voltages about an operating point.
fn stepping(about: [f64; 2], size: f64) -> impl Fn(f64) -> [f64; 2] {
    move |t| {
        let high = |period: f64| if (t / period).fract() < 0.5 { size } else { -size };
        [about[0] + high(7e-3), about[1] + high(11e-3)]
    }
}

/// Order from the end points of three runs over the same time, each with half the step of the one before.
fn order<const N: usize>(runs: [Vec<[f64; N]>; 3]) -> f64 {
    let end = runs.map(|run| run[run.len() - 1]);
    let gap = |a: [f64; N], b: [f64; N]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    (gap(end[0], end[1]) / gap(end[1], end[2])).log2()
}

#[test]
fn both_simulations_are_of_fourth_order() {
    let plant = Plant::servo();
    let (start, v) = plant.steady([-1.0, 3.0], 50.0);
    // A step of voltage; the longest period is just short enough not to be divided.
    let recording = |halvings: u32, still: bool| {
        let (n, period) = (40 << halvings, 4.5e-4 / f64::from(1 << halvings));
        let run = plant.run(n + 1, period, start, |_| [v[0] + 3.0, v[1] - 4.0]);
        let run = Run {
            x: (0..=n)
                .map(|k| {
                    let mut x = run.x[k];
                    if still {
                        (x[2], x[3]) = (start[2], 3.0 * start[2] * k as f64 * period);
                    }
                    x
                })
                .collect(),
            ..run
        };
        signals(&run.log([0.0; 2], 0.0, 1, Load::None), &plant)
    };
    let coupled = order([0, 1, 2].map(|h| run_coupled(&recording(h, false), &plant, &[])));
    let driven = order([0, 1, 2].map(|h| run_electrical(&recording(h, true), &plant)));
    assert!((coupled - 4.0).abs() < 0.05, "coupled: {coupled}");
    assert!((driven - 4.0).abs() < 0.05, "electrical: {driven}");
}

#[test]
fn the_coupled_model_follows_the_reference_within_a_billionth() {
    // At the paper's 100 kHz and, for the servo motor, 40 kHz.
    for (plant, period, n) in [(Plant::liu(), 1e-5, 10_000), (Plant::servo(), 2.5e-5, 10_000)] {
        let (start, v) = plant.steady([0.0, 4.0], 60.0);
        let run = plant.run(n, period, start, stepping(v, 5.0));
        let signals = signals(&run.log([0.0; 2], 0.0, 1, Load::None), &plant);
        let off = distance(&run_coupled(&signals, &plant, &[]), &shown(&run));
        assert!(off < 1e-9, "{off:e}");
    }
}

#[test]
fn the_driven_currents_follow_the_reference_within_a_billionth() {
    let plant = Plant::servo();
    let (period, n) = (2.5e-5, 10_000);
    let (start, v) = plant.steady([-1.0, 3.0], 40.0);
    let voltage = stepping(v, 5.0);
    // The speed rises evenly, so that interpolation between samples is exact.
    let (w, a) = (plant.n_p * 40.0, 300.0);
    let mut i = [start[0], start[1]];
    let mut run = Run { period, x: Vec::new(), v: Vec::new(), n_p: plant.n_p };
    for k in 0..n {
        let t = k as f64 * period;
        let v = voltage(t);
        let state: State = [i[0], i[1], (w + a * t) / plant.n_p, w * t + 0.5 * a * t * t, 0.0, 0.0, 0.0];
        run.x.push(state);
        run.v.push(v);
        i = dormand_prince(period, &i, |c, i| {
            let now = plant.slope(&[i[0], i[1], (w + a * (t + c)) / plant.n_p, 0.0, 0.0, 0.0, 0.0], v);
            [now[0], now[1]]
        });
    }
    let reference: Vec<[f64; 2]> = run.x.iter().map(|x| [x[0], x[1]]).collect();
    let signals = signals(&run.log([0.0; 2], 0.0, 1, Load::Locked), &plant);
    let off = distance(&run_electrical(&signals, &plant), &reference);
    assert!(off < 1e-9, "{off:e}");
}

#[test]
fn extra_states_take_part_in_the_coupled_run() {
    let mut plant = Plant::servo();
    let (share, f_antires, zeta) = (0.4, 55.0, 0.04);
    let w = std::f64::consts::TAU * f_antires;
    plant.shaft = Some([share, share * plant.j * w * w, 2.0 * zeta * w * share * plant.j]);
    plant.heating = Some([2e-2, 0.5]);
    let (mut start, v) = plant.steady([0.0, 4.0], 60.0);
    // Quasi-static start: the shaft carries the load and accelerates the far mass.
    let torque = 1.5 * plant.n_p * plant.psi_m * start[1];
    let acceleration = (torque - plant.b * start[2] - plant.tau_load) / plant.j;
    start[4] = (plant.tau_load + share * plant.j * acceleration) / (share * plant.j * w * w);
    let run = plant.run(8_000, 2.5e-5, start, stepping(v, 5.0));
    let signals = signals(&run.log([0.0; 2], 0.0, 1, Load::None), &plant);
    let shaft: (EffectId, &[f64]) = (EffectId::TwoMassShaft, &[share, f_antires, zeta]);
    let heat: (EffectId, &[f64]) = (EffectId::RsThermalDrift, &[0.0, 2e-2, 0.5]);
    for effects in [[shaft, heat], [heat, shaft]] {
        let off = distance(&run_coupled(&signals, &plant, &effects), &shown(&run));
        assert!(off < 1e-8, "{off:e}");
    }
    let bare = distance(&run_coupled(&signals, &plant, &[]), &shown(&run));
    assert!(bare > 1e-3, "the extra states must matter here: {bare:e}");
}

#[test]
fn a_slow_log_is_stepped_finely_enough() {
    let plant = Plant::servo();
    let (start, v) = plant.steady([0.0, 4.0], 60.0);
    let run = plant.run(500, 1e-3, start, stepping(v, 5.0));
    let signals = signals(&run.log([0.0; 2], 0.0, 1, Load::None), &plant);
    let off = distance(&run_coupled(&signals, &plant, &[]), &shown(&run));
    assert!(off < 1e-5, "{off:e}");
}

#[test]
fn gaps_restart_the_coupled_run_from_the_measurement() {
    let plant = Plant::servo();
    let (start, v) = plant.steady([0.0, 4.0], 60.0);
    let run = plant.run(400, 1e-4, start, stepping(v, 5.0));
    let whole = run.log([0.0; 2], 0.0, 1, Load::None);
    let given = whole
        .names()
        .iter()
        .map(|name| {
            let values = whole.column(name).expect("its own name");
            ((*name).to_string(), [&values[..150], &values[230..]].concat())
        })
        .collect();
    let signals = signals(&Recording::new(given, Some(Load::None)).expect("a sane recording"), &plant);
    assert_eq!(signals.segments.len(), 2);
    let reference = shown(&run);
    let reference = [&reference[..150], &reference[230..]].concat();
    let off = distance(&run_coupled(&signals, &plant, &[]), &reference);
    assert!(off < 1e-7, "{off:e}");
}
