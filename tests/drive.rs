//! What the simulated drive promises: the machine's own steady states, energy, limits, and a log that the package's own
//! models reproduce.

use pmsm_core::drive::{
    Choice, DriveSettings, Hold, Inverter, Manoeuvre, Schedule, Sensors, Setup, Shape, Simulation, simulate,
};
use pmsm_core::effect::Role;
use pmsm_core::effects::ALL;
use pmsm_core::error::Error;
use pmsm_core::identify::{Method, Request, Target, identify};
use pmsm_core::machine::{BaseParameter, Machine};
use pmsm_core::model::Model;
use pmsm_core::monitor::{Silent, StopFlag};
use pmsm_core::recording::{Kind, Load};
use pmsm_core::signals::Signals;
use pmsm_core::simulate::{coupled, electrical};

fn constant(x: f64) -> Option<Schedule> {
    Some(Schedule::constant(x).unwrap())
}

/// Salient machine: Table 1 with twice the inductance across the magnet.
fn machine() -> Machine {
    Machine::liu_2008().with(BaseParameter::LQ, 3.8e-3).unwrap()
}

/// A run to `omega_m` under load.
fn setup(omega_m: f64, tau_load: f64, duration: f64) -> Setup {
    let mut setup = Setup::new(machine(), Manoeuvre::new(duration));
    setup.manoeuvre.omega_m = constant(omega_m);
    setup.manoeuvre.tau_load = constant(tau_load);
    setup
}

fn run(setup: &Setup) -> Simulation {
    simulate(setup, &Silent).unwrap()
}

fn column<'a>(simulation: &'a Simulation, name: &str) -> &'a [f64] {
    simulation.recording.column(name).unwrap()
}

fn last(x: &[f64]) -> f64 {
    *x.last().unwrap()
}

#[test]
fn steady_state_is_the_analytic_one() {
    let mut setup = setup(80.0, 10.0, 0.2);
    setup.manoeuvre.settle = 1.5;
    setup.manoeuvre.i_d = constant(-20.0);
    let (n_p, omega) = (4.0, 320.0);
    let [r_s, l_d, l_q, psi, _, b] = machine().base.map(Option::unwrap);
    let i_d = -20.0;
    let i_q = (b * 80.0 + 10.0) / (1.5 * n_p * (psi + (l_d - l_q) * i_d));
    for hold in [Hold::Rotor, Hold::Stator] {
        setup.drive.inverter = Inverter::Averaged { hold };
        let simulation = run(&setup);
        let close = |name: &str, x: f64, expected: f64, tolerance: f64| {
            assert!((x - expected).abs() < tolerance, "{hold:?} {name}: {x} is not {expected}");
        };
        let truth = &simulation.truth.traces;
        close("omega_e", last(column(&simulation, "omega_e")), omega, 1e-6);
        // A voltage held in the stator ripples in the rotor: the mean is the same to second order of the turn.
        let ripple = if hold == Hold::Rotor { 1e-8 } else { 2e-3 };
        close("i_d", last(&truth["i_d"]), i_d, 1e-6);
        close("i_q", last(&truth["i_q"]), i_q, 1e-6 + ripple);
        close("v_d", last(column(&simulation, "v_d")), r_s * i_d - omega * l_q * i_q, 1e-6 + 10.0 * ripple);
        close(
            "v_q",
            last(column(&simulation, "v_q")),
            r_s * i_q + omega * (l_d * i_d + psi),
            1e-6 + 10.0 * ripple,
        );
        close("tau_e", last(&truth["tau_e"]), b * 80.0 + 10.0, 1e-6 + ripple);
    }
}

#[test]
fn energy_goes_into_heat_motion_and_field() {
    let mut setup = setup(100.0, 5.0, 0.3);
    setup.drive.f_sample = Some(50e3);
    let simulation = run(&setup);
    let truth = &simulation.truth.traces;
    let [r_s, l_d, l_q, _, j, b] = machine().base.map(Option::unwrap);
    let (h, n) = (2e-5, truth["i_d"].len());
    let (i_d, i_q, omega) = (&truth["i_d"], &truth["i_q"], &truth["omega_m"]);
    let (v_d, v_q) = (column(&simulation, "v_d"), column(&simulation, "v_q"));
    let (mut taken, mut lost, mut shaft) = (0.0, 0.0, 0.0);
    for k in 0..n - 1 {
        let mean = |f: &dyn Fn(usize) -> f64| 0.5 * (f(k) + f(k + 1));
        taken += 1.5 * h * (v_d[k] * mean(&|k| i_d[k]) + v_q[k] * mean(&|k| i_q[k]));
        lost += h * mean(&|k| 1.5 * r_s * (i_d[k].powi(2) + i_q[k].powi(2)) + b * omega[k].powi(2));
        shaft += h * mean(&|k| 5.0 * omega[k]);
    }
    let field = 0.75 * (l_d * last(i_d).powi(2) + l_q * last(i_q).powi(2));
    let motion = 0.5 * j * last(omega).powi(2);
    let given = lost + shaft + field + motion;
    assert!(motion > 30.0 && (taken / given - 1.0).abs() < 2e-4, "{taken} {given}");
}

#[test]
fn the_models_of_the_package_reproduce_the_log() {
    let mut setup = setup(60.0, 4.0, 0.4);
    setup.effects = ["dead_time", "iron_loss", "coulomb_friction", "encoder_angle_offset", "voltage_delay"]
        .map(|effect| Choice { effect: effect.into(), parameters: [].into(), definition: None })
        .to_vec();
    let simulation = run(&setup);
    let mut signals = Signals::new(&simulation.recording, &machine()).unwrap();
    // The effects mean what they mean at the scales of the simulation.
    signals.context = simulation.truth.scales;
    let chosen: Vec<_> = setup.effects.iter().map(|c| c.resolve(&signals.context).unwrap()).collect();
    let effects: Vec<_> = chosen.iter().map(|c| c.0).collect();
    let model = Model::new(signals.context, &effects);
    let mut p = machine().base.map(Option::unwrap).to_vec();
    p.extend(chosen.iter().flat_map(|c| c.1.clone()));
    let measured = signals.i.clone().unwrap();
    let mut worst = 0.0f64;
    electrical::run::<f64>(&model, &signals, &p, |k, i| {
        worst = worst.max((i[0] - measured[0][k]).hypot(i[1] - measured[1][k]));
    });
    // What is left is the straight line that the free run draws between samples of the speed.
    assert!(worst > 0.0 && worst < 0.05, "{worst}");

    let bare = run(&Setup { effects: Vec::new(), ..setup });
    let signals = Signals::new(&bare.recording, &machine()).unwrap();
    let model = Model::new(signals.context, &[]);
    let mut worst = [0.0f64; 2];
    let measured = signals.i.clone().unwrap();
    coupled::run::<f64>(&model, &signals, 0..signals.len(), &p[..6], 4.0, |k, [d, q, w]| {
        worst[0] = worst[0].max((d - measured[0][k]).hypot(q - measured[1][k]));
        worst[1] = worst[1].max((w - signals.omega_e[k]).abs());
        true
    });
    assert!(worst[0] < 1e-6 && worst[1] < 1e-6, "{worst:?}");
}

#[test]
fn an_effect_without_strength_is_the_bare_machine() {
    let mut setup = setup(60.0, 4.0, 0.02);
    setup.manoeuvre.start_omega_m = 55.0;
    setup.drive.sensors.noise_i = 0.05;
    let bare = run(&setup);
    for effect in ALL {
        let zero = effect.info().parameters.iter().filter(|p| p.role == Role::Amplitude);
        setup.effects = vec![Choice {
            effect: effect.id().into(),
            parameters: zero.map(|p| (p.name.to_string(), 0.0)).collect(),
            definition: None,
        }];
        let same = run(&setup);
        for name in bare.recording.names() {
            let worst = column(&same, name)
                .iter()
                .zip(column(&bare, name))
                .map(|(a, b)| (a - b).abs() / b.abs().max(1.0))
                .fold(0.0, f64::max);
            // States of their own call for shorter steps, which round differently.
            let tolerance = if effect.electrical_state_count() > 0 { 1e-6 } else { 0.0 };
            assert!(worst <= tolerance, "{}: {name} differs by {worst}", effect.id());
        }
    }
}

#[test]
fn fast_switching_is_the_averaged_inverter() {
    let mut setup = setup(60.0, 8.0, 0.05);
    setup.drive.inverter = Inverter::Averaged { hold: Hold::Stator };
    let averaged = run(&setup);
    let error = |f_sw: f64| {
        let mut setup = setup.clone();
        setup.drive.inverter = Inverter::Switching { f_sw: Some(f_sw) };
        let switching = run(&setup);
        ["i_a", "i_b", "i_c"]
            .iter()
            .flat_map(|name| column(&switching, name).iter().zip(column(&averaged, name)))
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max)
    };
    let errors = [5e3, 1e4, 2e4, 8e4, 32e4].map(error);
    assert!(errors[1] < 0.5 && errors[4] < 2e-3, "{errors:?}");
    assert!(errors.windows(2).all(|e| e[1] < 0.9 * e[0]), "{errors:?}");
}

#[test]
fn voltage_and_current_stay_within_their_limits_and_nothing_winds_up() {
    let mut setup = setup(170.0, 5.0, 0.8);
    setup.drive.v_dc = Some(250.0);
    let simulation = run(&setup);
    let limit = 250.0 / 3f64.sqrt();
    let voltage = column(&simulation, "v_d").iter().zip(column(&simulation, "v_q")).map(|(d, q)| d.hypot(*q));
    let longest = voltage.clone().fold(0.0, f64::max);
    assert!(longest <= limit * (1.0 + 1e-12), "{longest}");
    let saturated = voltage.filter(|v| *v > 0.999 * limit).count();
    assert!(saturated > 100, "{saturated}");
    let current = &simulation.truth.traces["i_q"];
    assert!(current.iter().all(|i| *i < 1.05 * setup.drive.i_limit.unwrap_or(2.0 * 58.78)));
    let fastest = simulation.truth.traces["omega_m"].iter().copied().fold(0.0, f64::max);
    assert!(fastest < 170.0 * 1.1, "{fastest}");
}

#[test]
fn the_same_seed_gives_the_same_bits() {
    let mut setup = setup(60.0, 4.0, 0.02);
    setup.drive.sensors = Sensors { noise_i: 0.1, noise_omega_e: 0.5, ..Sensors::default() };
    let bits = |setup: &Setup| -> Vec<u64> {
        let simulation = run(setup);
        let names = simulation.recording.names();
        names.iter().flat_map(|n| column(&simulation, n).iter().map(|x| x.to_bits())).collect()
    };
    let first = bits(&setup);
    assert_eq!(first, bits(&setup));
    setup.seed = 2;
    assert_ne!(first, bits(&setup));
}

#[test]
fn a_locked_rotor_stands_still() {
    let mut setup = Setup::new(machine(), Manoeuvre::new(0.1));
    setup.manoeuvre.load_kind = Some("locked".into());
    setup.manoeuvre.start_theta_e = 1.0;
    setup.manoeuvre.i_d = constant(5.0);
    setup.manoeuvre.i_q = Some(Schedule::new(vec![(0.0, 0.0), (0.05, 20.0)], Shape::Steps).unwrap());
    let simulation = run(&setup);
    assert_eq!((simulation.recording.load(), simulation.recording.kind()), (Load::Locked, Kind::Electrical));
    assert!(column(&simulation, "omega_e").iter().all(|w| *w == 0.0));
    assert!(column(&simulation, "theta_e").iter().all(|x| *x == 1.0));
    assert!((last(&simulation.truth.traces["i_q"]) - 20.0).abs() < 0.1);
    setup.manoeuvre.omega_m = constant(1.0);
    assert!(matches!(simulate(&setup, &Silent), Err(Error::Unusable { .. })));
}

#[test]
fn drifting_parameters_appear_in_the_disturbed_load() {
    let mut setup = setup(60.0, 3.0, 0.3);
    let ramp = |a: f64, b: f64| Some(Schedule::new(vec![(0.0, a), (0.3, b)], Shape::Linear).unwrap());
    setup.drift[BaseParameter::RS.index()] = ramp(0.16, 0.21);
    setup.drift[BaseParameter::J.index()] = ramp(0.008, 0.010);
    setup.drift[BaseParameter::B.index()] = ramp(0.00115, 0.003);
    let truth = run(&setup).truth.traces;
    assert!((last(&truth["r_s"]) - 0.21).abs() < 1e-4 && truth["r_s"][0] == 0.16);
    let last_b = last(&truth["b"]);
    let expected = 3.0 + (last_b - 0.00115) * last(&truth["omega_m"]);
    // The speed has settled, so that the inertia shows no torque.
    assert!(
        (last(&truth["tau_load_disturbed"]) - expected).abs() < 0.02,
        "{}",
        last(&truth["tau_load_disturbed"])
    );
    let largest = truth["tau_load_disturbed"].iter().copied().fold(0.0, f64::max);
    assert!(largest > 3.15, "{largest}");
    assert!(!truth.contains_key("l_d"));
}

#[test]
fn the_paper_s_parameters_are_found_again() {
    let mut setup = Setup::new(Machine::liu_2008(), Manoeuvre::new(0.2));
    setup.manoeuvre.omega_m = Some(Schedule::new(vec![(0.0, 0.0), (0.15, 80.0)], Shape::Linear).unwrap());
    setup.manoeuvre.tau_load = constant(3.0);
    setup.drive.sensors = Sensors { noise_i: 0.05, noise_omega_e: 0.1, ..Sensors::default() };
    let simulation = run(&setup);
    let fit = vec![(Target::Base(BaseParameter::RS), None), (Target::TauLoad, None)];
    let request = Request { fit, method: Method::LeastSquares, ..Request::default() };
    let answer = identify(&simulation.recording, &Machine::liu_2008(), &request, &Silent).unwrap();
    let text = serde_json::to_value(&answer).unwrap();
    let value = |name: &str| text["parameters"][name]["value"].as_f64().unwrap();
    assert!((value("r_s") / 0.17 - 1.0).abs() < 0.01, "{}", value("r_s"));
    assert!((value("tau_load") / 3.0 - 1.0).abs() < 0.005, "{}", value("tau_load"));
}

#[test]
fn what_makes_no_sense_is_refused() {
    let good = setup(60.0, 4.0, 0.02);
    let refused = |change: &dyn Fn(&mut Setup), part: &str| {
        let mut setup = good.clone();
        change(&mut setup);
        let error = simulate(&setup, &Silent).map(drop).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    };
    refused(&|s| s.machine.base[1] = None, "machine's l_d is not known");
    refused(&|s| s.nameplate.base[4] = None, "nameplate does not tell j");
    refused(&|s| s.drive.delay = 2, "delay is 2");
    refused(&|s| s.drive.inverter = Inverter::Switching { f_sw: Some(12e3) }, "f_sw is 12000 Hz");
    refused(&|s| s.drive.v_dc = Some(-1.0), "v_dc is -1 V");
    refused(&|s| s.drive.sensors.noise_i = f64::NAN, "noise_i is NaN A");
    refused(&|s| s.manoeuvre.duration = 1e9, "duration is 1000000000 s");
    refused(&|s| s.manoeuvre.duration = 0.0, "duration is 0 s");
    refused(&|s| s.manoeuvre.load_kind = Some("heavy".into()), "no load 'heavy'");
    refused(&|s| s.manoeuvre.load_kind = Some("none".into()), "said to be none");
    refused(&|s| s.drift[0] = constant(-1.0), "r_s is -1 ohm");
    refused(&|s| (s.machine.base[0], s.machine.base[1]) = (Some(1e4), Some(1e-8)), "diverges");
    let stop = StopFlag::default();
    stop.stop();
    assert_eq!(simulate(&good, &stop).map(drop).unwrap_err(), Error::Interrupted);
    assert_eq!(DriveSettings::default().delay, 1);
}
