//! What every effect says of itself: identifiers, names of results, bounds, points from which it is tried.

use crate::support::{MACHINE, operating_points, run};
use pmsm_core::base::Base;
use pmsm_core::effect::{Context, Need, Role};
use pmsm_core::effects::{ALL, EffectId};

/// Every identifier of the file contract with the results whose names are binding.
const CONTRACT: [(&str, &[&str]); 33] = [
    ("coulomb_friction", &["tau_c"]),
    ("stribeck_friction", &["tau_c", "tau_s", "w_s"]),
    ("asymmetric_friction", &[]),
    ("concave_friction", &["k", "alpha"]),
    ("presliding_friction", &["tau_c", "theta_0"]),
    ("load_dependent_friction", &[]),
    ("quadratic_drag", &["k"]),
    ("cogging_torque", &["tau_cog", "order_mech"]),
    ("cogging_asymmetry", &["tau_slots", "tau_poles", "order_slots"]),
    ("load_torque_pulsation", &["tau_pul"]),
    ("gravity_torque", &["tau_g"]),
    ("time_varying_load", &["amplitude", "f"]),
    ("two_mass_shaft", &["f_antires", "f_res"]),
    ("backlash", &["gap"]),
    ("back_emf_harmonics", &["e5_rel", "e7_rel"]),
    ("saturation_d", &[]),
    ("saturation_q", &[]),
    ("cross_saturation", &[]),
    ("inductance_harmonics", &[]),
    ("rs_thermal_drift", &[]),
    ("magnet_thermal_drift", &[]),
    ("iron_loss", &["r_c"]),
    ("dead_time", &["v_err"]),
    ("voltage_delay", &["extra_samples"]),
    ("dc_link_sag", &["r_source"]),
    ("phase_resistance_imbalance", &["r_excess_rel"]),
    ("inter_turn_short", &[]),
    ("current_offset", &["o_a", "o_b", "o_c"]),
    ("current_gain_imbalance", &[]),
    ("encoder_angle_offset", &["offset_el_rad"]),
    ("encoder_delay", &["t_delay"]),
    ("encoder_eccentricity", &["amplitude_el_rad"]),
    ("encoder_harmonics", &["amplitude_1_el_rad", "amplitude_2_el_rad"]),
];

/// Scales of recordings from a fast scope to a slow logger.
fn contexts() -> Vec<Context> {
    let usual = run(false).context;
    vec![
        usual,
        run(true).context,
        operating_points().context,
        Context { period: 2e-2, duration: 60.0, ..usual },
        Context { period: 1e-3, duration: 24.0, i_max: 0.5, v_max: 10.0, tau_max: 0.02, v_dc: 12.0, ..usual },
        Context {
            period: 1e-5,
            duration: 0.1,
            n_p: 50.0,
            i_max: 400.0,
            omega_e_max: 6000.0,
            v_max: 350.0,
            ..usual
        },
    ]
}

#[test]
fn identifiers_and_result_names_are_those_of_the_contract() {
    let cx = run(false).context;
    for (id, names) in CONTRACT {
        let effect = EffectId::parse(id).unwrap();
        let own: Vec<f64> = effect.info().parameters.iter().map(|p| (p.typical)(&cx)).collect();
        let out = effect.outputs(&own, &Base::new(&MACHINE), &cx);
        for name in names {
            assert!(out.iter().any(|(n, _, _)| n == name), "{id} does not give {name}");
        }
        assert!(!out.is_empty() && out.iter().all(|(_, unit, x)| !unit.is_empty() && x.is_finite()), "{id}");
    }
    let refusal = EffectId::parse("ghost").unwrap_err().to_string();
    assert!(ALL.iter().all(|e| refusal.contains(e.id())), "{refusal}");
}

#[test]
fn every_result_is_explained() {
    let cx = run(false).context;
    for effect in ALL {
        let parameters = effect.info().parameters;
        let own: Vec<f64> = parameters.iter().map(|p| (p.typical)(&cx)).collect();
        let results = effect.outputs(&own, &Base::new(&MACHINE), &cx);
        for (name, unit, _) in &results {
            let parameter = parameters.iter().find(|p| p.name == *name).map(|p| p.unit);
            let derived = effect.derived().iter().find(|d| d.0 == *name).map(|d| d.1);
            assert_eq!(parameter.xor(derived), Some(*unit), "{}.{name}", effect.id());
        }
        for (name, _, meaning) in effect.derived() {
            assert!(results.iter().any(|r| r.0 == *name) && !meaning.is_empty(), "{}.{name}", effect.id());
        }
    }
}

#[test]
fn descriptions_are_complete_and_point_to_effects_that_exist() {
    let mut ids: Vec<&str> = ALL.iter().map(|e| e.id()).collect();
    ids.sort_unstable();
    assert!(ids.windows(2).all(|w| w[0] != w[1]), "an identifier is used twice");
    for &effect in ALL {
        let info = effect.info();
        let texts = [info.title, info.sentence, info.equation, info.source, info.fingerprint];
        assert!(texts.iter().all(|t| !t.trim().is_empty()), "{}", info.id);
        assert!(!info.look_alikes.is_empty(), "{} resembles nothing", info.id);
        for other in info.look_alikes.iter().chain(info.contains) {
            assert!(ids.contains(other) && *other != info.id, "{} names {other}", info.id);
        }
        let amplitudes = info.parameters.iter().filter(|p| p.role == Role::Amplitude).count();
        assert!(amplitudes > 0, "{} has no strength", info.id);
        for (k, parameter) in info.parameters.iter().enumerate() {
            let clash = info.parameters[..k].iter().any(|p| p.name == parameter.name);
            assert!(!clash && !parameter.unit.is_empty() && !parameter.meaning.is_empty(), "{}", info.id);
        }
    }
}

#[test]
fn typical_values_and_probes_lie_within_bounds() {
    for cx in contexts() {
        for &effect in ALL {
            // Operating points are not asked for what needs transients.
            if cx.period > 0.05 && effect.info().needs.contains(&Need::Transients) {
                continue;
            }
            let parameters = effect.info().parameters;
            for p in parameters {
                let (low, typical, high) = ((p.low)(&cx), (p.typical)(&cx), (p.high)(&cx));
                assert!(
                    low <= typical && typical <= high,
                    "{}.{}: {low} {typical} {high}",
                    effect.id(),
                    p.name
                );
                if p.role == Role::Amplitude {
                    assert!(low <= 0.0 && high > 0.0 && typical != 0.0, "{}.{}", effect.id(), p.name);
                }
            }
            let probes = effect.probes(&cx);
            assert!(!probes.is_empty(), "{}", effect.id());
            for probe in probes {
                assert_eq!(probe.len(), parameters.len(), "{}", effect.id());
                for (x, p) in probe.iter().zip(parameters).filter(|(_, p)| p.role != Role::Amplitude) {
                    let (low, high) = ((p.low)(&cx), (p.high)(&cx));
                    assert!(low <= *x && *x <= high, "{}.{}: {low} {x} {high}", effect.id(), p.name);
                }
            }
            let fitted = (0..parameters.len()).filter(|k| effect.fitted(&cx, *k)).collect::<Vec<_>>();
            assert!(fitted.iter().any(|k| parameters[*k].role == Role::Amplitude), "{}", effect.id());
        }
    }
}
