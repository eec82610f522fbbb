use super::*;
use crate::base::BASE;
use crate::effects::EffectId;
use crate::effects::testing::{CX, MACHINE};
use crate::model::Model;
use crate::numerics::dual::Dual;
use crate::numerics::real::Real;

fn quantity(name: &str, unit: &str, low: f64, high: f64) -> Quantity {
    Quantity {
        name: name.into(),
        unit: unit.into(),
        low,
        high,
        typical: None,
        values: Vec::new(),
        meaning: None,
    }
}

fn definition(name: &str, side: Side, terms: &[&str], parameters: &[(&str, &str, f64, f64)]) -> Definition {
    Definition {
        name: name.into(),
        side,
        terms: terms.iter().map(|t| (*t).to_string()).collect(),
        parameters: parameters.iter().map(|(n, u, l, h)| quantity(n, u, *l, *h)).collect(),
        title: None,
        replaces: Vec::new(),
    }
}

fn effect(side: Side, terms: &[&str], parameters: &[(&str, &str, f64, f64)]) -> EffectId {
    EffectId::Text(TextId::new(&definition("own", side, terms, parameters)).unwrap())
}

fn brake() -> Definition {
    let parameters = [("k", "N m s", 0.0, 1.0), ("w0", "rad/s", 1.0, 500.0)];
    definition("my_brake", Side::Torque, &["k*w/(1+(w/w0)**2)"], &parameters)
}

/// The model with one effect at given parameters, and its parameter vector.
fn with(effect: EffectId, own: &[f64]) -> (Model, Vec<f64>) {
    (Model::new(CX, &[effect]), MACHINE.iter().chain(own).copied().collect())
}

/// Everything that a model computes at one point.
fn everything<T: Real>(model: &Model, p: &[T]) -> Vec<T> {
    let base = Base::new(p);
    let c = T::constant;
    let env = Env {
        t: c(0.3),
        omega_e: c(210.0),
        theta_e: c(2.3),
        theta_m: c(2.3 / CX.n_p),
        heating: 0.0,
        magnet_heating: 0.0,
    };
    let mut state = [c(0.0); 12];
    (state[0], state[1]) = (c(0.21), c(0.15));
    let now = model.state_current(p, &base, &state, &env);
    let winding = model.electrical_rhs(p, &base, &state, [c(13.0), c(-40.0)], &env);
    let rotor = model.mechanical_rhs(p, &base, &[c(70.0)], now.tau_e, c(1.3), &env);
    let sensor = model.sensor(p, &env);
    let shown = model.measured_current(&sensor, now.i, env.theta_e);
    [&now.i[..], &[now.tau_e, sensor.angle, sensor.angle_slope], &winding[..2], &rotor, &shown].concat()
}

/// Catalogue effects, and the same as text: the effect, its text, and parameters of both.
fn pairs() -> Vec<(EffectId, EffectId, Vec<f64>)> {
    let third = "2*pi/3";
    let phase = |i: &str| format!("({i}/sqrt({i}**2+i_th**2))");
    let [a, b, c] = ["i_a", "i_b", "i_c"].map(phase);
    let d = format!("v_err*2/3*({a}*cos(theta_e)+{b}*cos(theta_e-{third})+{c}*cos(theta_e+{third}))");
    let q = format!("-v_err*2/3*({a}*sin(theta_e)+{b}*sin(theta_e-{third})+{c}*sin(theta_e+{third}))");
    let harmonic = [("a_5", "1", -0.1, 0.1), ("b_5", "1", -0.1, 0.1)];
    vec![
        (
            EffectId::CoulombFriction,
            effect(
                Side::Torque,
                &["tau_c*tanh(w/w_0)"],
                &[("tau_c", "N m", 0.0, 10.0), ("w_0", "rad/s", 0.05, 5.0)],
            ),
            vec![0.3, 0.4],
        ),
        (
            EffectId::QuadraticDrag,
            effect(Side::Torque, &["k*w*abs(w)"], &[("k", "N m s^2", 0.0, 1e-2)]),
            vec![2e-4],
        ),
        (
            EffectId::DeadTime,
            effect(Side::Voltage, &[&d, &q], &[("v_err", "V", 0.0, 50.0), ("i_th", "A", 0.01, 3.0)]),
            vec![2.0, 0.5],
        ),
        (
            EffectId::SaturationQ,
            effect(
                Side::Energy,
                &["k/l_q*lambda_q**2*abs(lambda_q/lambda_0)**s/(s+2)"],
                &[("k", "1", 0.0, 5.0), ("s", "1", 0.5, 10.0), ("lambda_0", "V s", 0.2, 0.5)],
            ),
            vec![0.4, 2.5, 0.3],
        ),
        (
            EffectId::BackEmfHarmonics,
            effect(
                Side::Flux,
                &[
                    "psi_m*(a_5*cos(6*theta_e)-b_5*sin(6*theta_e))",
                    "-psi_m*(a_5*sin(6*theta_e)+b_5*cos(6*theta_e))",
                ],
                &harmonic,
            ),
            vec![0.01, -0.02],
        ),
        (
            EffectId::CurrentOffset,
            effect(Side::Current, &["a", "b", "-a-b"], &[("a", "A", -3.0, 3.0), ("b", "A", -3.0, 3.0)]),
            vec![0.2, -0.1],
        ),
    ]
}

#[test]
fn a_text_of_a_catalogue_effect_is_that_effect() {
    for (known, own, p) in pairs() {
        let mut theirs = p.clone();
        match known {
            EffectId::SaturationQ => theirs.truncate(2),
            EffectId::BackEmfHarmonics => theirs.extend([0.0; 2]),
            // Its offsets are given in the α, β frame.
            EffectId::CurrentOffset => theirs = vec![p[0], (p[0] + 2.0 * p[1]) / 3f64.sqrt()],
            _ => {}
        }
        let (model, q) = with(known, &theirs);
        let (text, r) = with(own, &p);
        for (a, b) in everything(&model, &q).iter().zip(everything(&text, &r)) {
            assert!((a - b).abs() < 1e-9 * b.abs().max(1e-3), "{known:?}: {a} {b}");
        }
        assert_eq!(known.info().site, own.info().site);
        assert_eq!(
            (known.is_magnetic(), known.turns(), known.jumps() || known == EffectId::QuadraticDrag),
            (own.is_magnetic(), own.turns(), own.jumps()),
            "{known:?}"
        );
    }
}

#[test]
fn without_strength_it_changes_no_bit_and_its_derivatives_are_exact() {
    for (_, own, p) in pairs() {
        let roles = own.info().parameters.iter().map(|q| q.role);
        let absent: Vec<f64> =
            p.iter().zip(roles).map(|(x, role)| if role == Role::Amplitude { 0.0 } else { *x }).collect();
        let (model, q) = with(own, &absent);
        let bare = everything(&Model::new(CX, &[]), &MACHINE[..BASE]);
        for (a, b) in everything(&model, &q).iter().zip(&bare) {
            assert_eq!(a.to_bits(), b.to_bits(), "{own:?}");
        }
        let (model, q) = with(own, &p);
        let seeded =
            |k: usize, x: f64| if k < BASE { Dual::constant(x) } else { Dual::<3>::variable(x, k - BASE) };
        let dual: Vec<Dual<3>> = q.iter().enumerate().map(|(k, x)| seeded(k, *x)).collect();
        let exact = everything(&model, &dual);
        for k in 0..p.len() {
            let h = 1e-6 * p[k].abs();
            let moved = |h: f64| {
                let mut q = q.clone();
                q[BASE + k] += h;
                everything(&model, &q)
            };
            for ((x, up), down) in exact.iter().zip(moved(h)).zip(moved(-h)) {
                let quotient = (up - down) / (2.0 * h);
                let allowed = 1e-6 * quotient.abs().max(x.re.abs() / p[k].abs()) + 1e-9;
                assert!((x.eps[k] - quotient).abs() <= allowed, "{own:?} {k}: {} {quotient}", x.eps[k]);
            }
        }
    }
}

#[test]
fn the_first_parameter_that_may_be_zero_is_the_strength_or_the_first_few() {
    let roles = |effect: EffectId| effect.info().parameters.iter().map(|p| p.role).collect::<Vec<_>>();
    let brake = EffectId::Text(TextId::new(&brake()).unwrap());
    assert_eq!(roles(brake), [Role::Amplitude, Role::Shape]);
    assert!(brake.is_first_order() && !brake.jumps());
    let behind = [("w0", "rad/s", 0.1, 5.0), ("k", "N m", -1.0, 1.0)];
    assert_eq!(roles(effect(Side::Torque, &["k*tanh(w/w0)"], &behind)), [Role::Shape, Role::Amplitude]);
    let both = [("a", "N m", -1.0, 1.0), ("b", "N m", -1.0, 1.0)];
    let wave = effect(Side::Torque, &["a*cos(18*theta_m)+b*sin(18*theta_m)"], &both);
    assert_eq!(roles(wave), [Role::Amplitude, Role::Amplitude]);
    // One whose square is the strength is no first-order effect.
    assert!(!effect(Side::Torque, &["k**2*w"], &[("k", "N^0.5 m^0.5 s^0.5", 0.0, 1.0)]).is_first_order());
    let mut order =
        definition("wave", Side::Torque, &["a*cos(n*theta_m)"], &[both[0], ("n", "1", 6.0, 36.0)]);
    order.parameters[1].values = vec![6.0, 12.0, 18.0];
    let order = EffectId::Text(TextId::new(&order).unwrap());
    assert_eq!(roles(order), [Role::Amplitude, Role::Fixed]);
    assert_eq!(order.probes(&CX).iter().map(|p| p[1]).collect::<Vec<_>>(), [6.0, 12.0, 18.0]);
}

#[test]
fn equal_definitions_are_one_effect_and_probes_lie_in_the_bounds() {
    let (a, b) = (TextId::new(&brake()).unwrap(), TextId::new(&brake()).unwrap());
    assert_eq!((a, a.cmp(&b)), (b, std::cmp::Ordering::Equal));
    let mut other = brake();
    other.parameters[0].high = 2.0;
    assert_ne!(a, TextId::new(&other).unwrap());
    for (_, own, _) in pairs() {
        for set in own.probes(&CX) {
            for (p, x) in own.info().parameters.iter().zip(set) {
                assert!((p.low)(&CX) <= x && x <= (p.high)(&CX), "{own:?} {}", p.name);
            }
        }
    }
    assert_eq!(EffectId::Text(a).definition(), Some(&brake()));
    assert_eq!(EffectId::DeadTime.definition(), None);
}

#[test]
fn what_is_wrong_is_an_error_that_names_the_place() {
    let k = ("k", "N m s", 0.0, 1.0);
    let said = |terms: &[&str], parameters: &[(&str, &str, f64, f64)]| {
        TextId::new(&definition("own", Side::Torque, terms, parameters)).unwrap_err().to_string()
    };
    for (terms, parameters, expected) in [
        (
            &["k*omga_m"][..],
            &[k][..],
            "effect 'own', torque, character 3: there is no quantity 'omga_m'; did you mean omega_m?",
        ),
        (&["k*w*w"], &[k], "it is in W, and torque is in N m"),
        (&["k*w+w"], &[k], "character 4: the left side is in N m and the right side in rad/s"),
        (&["k*i_q"], &[k], "'i_q' is not known where torque is computed"),
        (&["k*w/w"], &[("k", "N m", 0.0, 1.0)], "divides by zero where"),
        (&["k*abs(w)**1.5/w0**0.5", "1"], &[k], "2 formulas are given for torque"),
        (&["w0*w"], &[("w0", "N m s", 0.5, 1.0)], "no parameter may be zero"),
        (&["k*w+2*c"], &[k, ("c", "N m", 0.5, 1.0)], "is not zero where k is zero"),
        (&["k*w"], &[k, ("c", "N m", 0.5, 1.0)], "no formula has the parameter 'c'"),
        (&["k*w"], &[("k", "Nms", 0.0, 1.0)], "no SI symbol 'Nms'"),
        (&["k*w"], &[("k", "N m s", 1.0, 0.0)], "has no range"),
        (&["k*w"], &[("k", "N m s", 0.0, f64::NAN)], "has no range"),
        (&["k*w"], &[k, k], "stands there twice"),
        (&["k*w"], &[("sin", "N m s", 0.0, 1.0)], "has the name of something else"),
        (&["k*exp(w/w0)*w"], &[k, ("w0", "rad/s", 0.1, 0.2)], "beyond all numbers"),
    ] {
        let got = said(terms, parameters);
        assert!(got.contains(expected), "{got}");
    }
    let mut taken = brake();
    taken.name = "dead_time".into();
    assert!(
        TextId::new(&taken).unwrap_err().to_string().contains("the catalogue has an effect of this name")
    );
    let slope = definition("own", Side::Energy, &["k*lambda_q"], &[("k", "A", 0.0, 1.0)]);
    assert!(TextId::new(&slope).unwrap_err().to_string().contains("magnet alone"));
}

#[test]
fn a_list_of_own_effects_comes_back_from_its_text() {
    let own = OwnEffects::try_from(vec![brake()]).unwrap();
    let text = serde_json::to_string(&own).unwrap();
    assert_eq!(serde_json::from_str::<OwnEffects>(&text).unwrap(), own);
    assert_eq!(own.iter().map(EffectId::id).collect::<Vec<_>>(), ["my_brake"]);
    assert!(OwnEffects::default().is_empty() && !own.is_empty());
    assert!(OwnEffects::try_from(vec![brake(), brake()]).is_err());
    let many: Vec<Definition> = (0..17).map(|k| Definition { name: format!("own_{k}"), ..brake() }).collect();
    assert!(OwnEffects::try_from(many).is_err());
}
