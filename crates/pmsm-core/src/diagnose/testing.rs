//! Recordings of known truth for the tests of the diagnosis.

use super::data::Data;
use super::fitting;
use super::hypothesis::Hypothesis;
use super::verdict::Validated;
use crate::drive::{Choice, Manoeuvre, Schedule, Setup, Shape, simulate};
use crate::effects::EffectId;
use crate::effects::testing::CX;
use crate::experiment::Channel;
use crate::machine::Machine;
use crate::model::Model;
use crate::monitor::Silent;
use crate::numerics::transforms::park;
use crate::recording::Recording;
use crate::signals::Signals;

/// A servo motor at 5 kHz with ordinary sensors.
pub fn setup(manoeuvre: Manoeuvre, effects: Vec<Choice>) -> Setup {
    let machine = Machine::liu_2008().with_drive(Some(560.0), Some(20.0), Some(5e3)).unwrap();
    let mut setup = Setup::new(machine, manoeuvre);
    setup.effects = effects;
    setup.drive.sensors.noise_i = 0.05;
    setup.drive.sensors.noise_omega_e = 0.3;
    setup
}

/// An effect of this strength.
pub fn choice(effect: &str, parameter: &str, value: f64) -> Choice {
    Choice { effect: effect.into(), parameters: [(parameter.to_string(), value)].into(), definition: None }
}

/// Lines through points (s, mechanical rad/s).
pub fn speeds(duration: f64, points: &[(f64, f64)]) -> Manoeuvre {
    let mut manoeuvre = Manoeuvre::new(duration);
    manoeuvre.settle = 0.3;
    manoeuvre.omega_m = Some(Schedule::new(points.to_vec(), Shape::Linear).unwrap());
    manoeuvre
}

/// One direction, hardly any change of speed: Coulomb friction and drag look alike.
pub fn narrow() -> Manoeuvre {
    speeds(1.0, &[(0.2, 95.0), (0.4, 105.0), (0.6, 105.0), (0.8, 95.0)])
}

/// A run of several reversals between these levels (mechanical rad/s) with steps of i_d, as telemetry logs it: with the currents in the
/// rotor's axes. The columns t, theta_e, omega_e, v_d, v_q, i_d, i_q.
pub fn telemetry(levels: [f64; 3], effects: Vec<Choice>) -> (Vec<(String, Vec<f64>)>, Setup) {
    let path: Vec<(f64, f64)> =
        (0..8).map(|k| (0.05 + 0.15 * f64::from(k), levels[k as usize % 3])).collect();
    let mut manoeuvre = speeds(1.3, &path);
    let steps = (0..13).map(|k| (0.1 * f64::from(k), [-4.0, 2.0, 0.0][k as usize % 3])).collect();
    manoeuvre.i_d = Some(Schedule::new(steps, Shape::Steps).unwrap());
    let setup = setup(manoeuvre, effects);
    let whole = simulate(&setup, &Silent).unwrap().recording;
    let column = |name: &str| whole.column(name).unwrap();
    let phases = ["i_a", "i_b", "i_c"].map(column);
    let axes = (0..whole.len()).map(|k| {
        let (sin, cos) = column("theta_e")[k].sin_cos();
        park(phases.map(|x| x[k]), cos, sin)
    });
    let axes: Vec<[f64; 2]> = axes.collect();
    let mut columns: Vec<(String, Vec<f64>)> = ["t", "theta_e", "omega_e", "v_d", "v_q"]
        .map(|name| (name.to_string(), column(name).to_vec()))
        .into();
    columns.extend(
        ["i_d", "i_q"]
            .iter()
            .enumerate()
            .map(|(k, name)| (name.to_string(), axes.iter().map(|x| x[k]).collect())),
    );
    (columns, setup)
}

/// The simulated recording made ready, with its floors settled on the dq-model.
pub fn data(setup: &Setup) -> (Data, Hypothesis) {
    let recording = simulate(setup, &Silent).unwrap().recording;
    settled(prepared(&recording, setup))
}

/// A recording made with this setup, with the floors of its sensors.
pub fn prepared(recording: &Recording, setup: &Setup) -> Data {
    let signals = Signals::new(recording, &setup.nameplate).unwrap();
    Data::new(signals, &setup.nameplate, &Default::default()).unwrap()
}

/// A recording made ready with its floors settled on the dq-model, and that machine.
pub fn settled(mut data: Data) -> (Data, Hypothesis) {
    let model = Model::new(data.signals.context, &[]);
    let rough = fitting::fit(&data, &model, &data.start, false, &Silent).unwrap();
    data.settle_floors(&rough);
    let base = fitting::fit(&data, &model, rough.own(), false, &Silent).unwrap();
    (data, base)
}

/// One effect fitted on top of the dq-model, from its typical strength.
pub fn fitted(data: &Data, base: &Hypothesis, effect: EffectId) -> Hypothesis {
    let context = data.signals.context;
    let model = Model::new(context, &[effect]);
    let mut start = base.own().to_vec();
    start.extend(effect.info().parameters.iter().map(|p| (p.typical)(&context)));
    fitting::fit(data, &model, &start, false, &Silent).unwrap()
}

/// A hypothesis of the dq-model with these mean squares of i_d and the speed and so many free parameters.
pub fn hypothesis(d: f64, speed: f64, free: usize) -> Hypothesis {
    let mut out = Hypothesis::unfitted(Model::new(CX, &[]), vec![1.0; 6]);
    out.free = (0..free).collect();
    out.squares = vec![(Channel::ID, d), (Channel::OmegaE, speed)];
    out.samples = vec![1e4, 1e4];
    out.chance = vec![0.0, 0.0];
    out
}

/// The same, and what i_d leaves on a held-out recording.
pub fn validated(d: f64, speed: f64, held_out: f64, free: usize) -> Validated {
    let held_out = vec![hypothesis(held_out, speed, free)];
    Validated { fitted: hypothesis(d, speed, free), held_out, refuted: false }
}
