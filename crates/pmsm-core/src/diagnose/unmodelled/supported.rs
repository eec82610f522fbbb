//! Effects beside the discrepancy: which of a set explain what a smooth term of the same equation cannot.
//!
//! Where the residual of a set exceeds the noise, something else is missing, and a name may only describe its shape: a friction curve outside
//! the catalogue resembles a sum of curves in it. Each effect is therefore compared with smooth terms, and one that such a term replaces is
//! not named. Saturation and the like are not compared: their names cover any map of the flux. An effect is not named either if the 95 %
//! interval of its strength holds zero.

use super::discrepancy::{Seen, beside_discrepancy, cost_beside_discrepancy, likely};
use super::mapped::Mapped;
use super::{Side, sides, with_angle_error};
use crate::diagnose::data::Data;
use crate::diagnose::fitting;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::outputs::Outputs;
use crate::diagnose::select::{in_place, reduced, special_cases};
use crate::diagnose::transfer::transfer;
use crate::effect::Site;
use crate::effects::EffectId;
use crate::error::Result;
use crate::experiment::Channel;
use crate::model::{Model, Slot};
use crate::monitor::Monitor;

/// A set of effects that the evidence supports beside the discrepancy.
pub struct Supported {
    /// The set without a map.
    pub set: Hypothesis,
    /// Posterior probability of each of its effects beside a map.
    pub probabilities: Vec<(EffectId, f64)>,
    /// What may be in place of one of its effects: a wider one, or a special case.
    pub alternatives: Vec<Alternative>,
    /// The set with that effect of the catalogue whose form is nearest to the unexplained torque, if one was considered.
    pub nearest: Option<Hypothesis>,
}

/// An effect and its special case, of which one is in a set.
pub struct Alternative {
    /// The more probable one, which is in the set.
    pub present: EffectId,
    /// The other one.
    pub absent: EffectId,
    /// Probability that it is the other one, if it is one of the two.
    pub share: f64,
}

/// The effects of `best` that a smooth term cannot replace. Those of an equation whose residual is noise stay as they are.
///
/// # Errors
/// Those of the least-squares fits.
pub fn supported(
    data: &Data,
    validation: Option<&Data>,
    best: &Hypothesis,
    monitor: &dyn Monitor,
) -> Result<Supported> {
    let elsewhere = |set: &Hypothesis| -> Result<Option<(&Data, Hypothesis)>> {
        validation.map(|run| Ok((run, transfer(run, set, monitor)?))).transpose()
    };
    let rough = data.roughly();
    // An error of the angle shows in both equations, and looks like many effects: what it explains is taken out first.
    let mapped = with_angle_error(&rough, validation, best, monitor)?;
    let fits = Fits { data: &rough, mapped: &mapped, monitor };
    let (set, mut alternatives) = narrowed(&fits, mapped.fitted.clone(), &elsewhere)?;
    let (set, of_motion) = beside_a_smooth_term(&fits, set, Side::Mechanical, &elsewhere)?;
    let nearest = nearest(&fits, best, &set)?;
    let (set, of_currents) = beside_a_smooth_term(&fits, set, Side::Electrical, &elsewhere)?;
    let mut set = beyond_error(&fits, set)?;
    if set.model.map().is_some() {
        let model = Model::new(*set.model.context(), &set.effects());
        let start = set.own()[..model.parameter_count()].to_vec();
        set = fitting::fit(data, &model, &start, false, monitor)?;
    } else if set.effects() != best.effects() {
        set = fitting::on_from(data, &set, monitor)?;
    }
    let of_effect = |effect: EffectId| {
        let asked = of_motion.iter().chain(&of_currents).find(|(e, _)| *e == effect);
        (effect, probability(asked.map_or(f64::INFINITY, |(_, nats)| *nats)))
    };
    let probabilities = set.effects().into_iter().map(of_effect).collect();
    alternatives.retain(|a| set.effects().contains(&a.present));
    Ok(Supported { set, probabilities, alternatives, nearest })
}

/// Probability at this logarithm of the odds, nats.
pub fn probability(nats: f64) -> f64 {
    1.0 / (1.0 + (-nats).exp())
}

/// The set without its effects of the motion, fitted anew.
///
/// # Errors
/// Those of the least-squares fits.
pub fn without_motion(data: &Data, best: &Hypothesis, monitor: &dyn Monitor) -> Result<Hypothesis> {
    let moving = best.effects().into_iter().filter(|e| e.info().site == Site::Mechanical);
    let set = moving.fold(best.clone(), |set, effect| {
        let (model, start) = reduced(&set, effect);
        Hypothesis::unfitted(model, start)
    });
    fitting::refit(data, &set, monitor)
}

/// How the sets are fitted: roughly, beside a map whose coefficients have a prior.
struct Fits<'a> {
    data: &'a Data,
    mapped: &'a Mapped,
    monitor: &'a dyn Monitor,
}

impl Fits<'_> {
    fn fit(&self, model: &Model, start: &[f64]) -> Result<Hypothesis> {
        fitting::fit(&self.mapped.recording(self.data, model), model, start, false, self.monitor)
    }
}

/// A set transferred to the validation run, if there is one.
type Transferred<'a> = dyn Fn(&Hypothesis) -> Result<Option<(&'a Data, Hypothesis)>> + 'a;

/// The recording and, if there is one, the validation run, each with the same set.
fn seen<'a>(data: &'a Data, set: &'a Hypothesis, other: Option<&'a (&Data, Hypothesis)>) -> Vec<Seen<'a>> {
    std::iter::once((data, set)).chain(other.map(|(run, set)| (*run, set))).collect()
}

/// The set with the special case of a mechanical effect in place of it, where that has more evidence beside a smooth torque. What was not
/// chosen comes back with its probability.
fn narrowed<'a>(
    fits: &'a Fits,
    mut set: Hypothesis,
    elsewhere: &Transferred<'a>,
) -> Result<(Hypothesis, Vec<Alternative>)> {
    let mut alternatives = Vec::new();
    let data = fits.data;
    // A smooth curve is no friction that jumps: a smooth term takes its place.
    let wider = |e: &EffectId| e.info().site == Site::Mechanical && !e.is_smooth();
    for wide in set.effects().into_iter().filter(wider) {
        for narrow in special_cases(wide) {
            if set.effects().contains(&narrow)
                || !sides(data, &set).contains(&Side::Mechanical)
                || !set.effects().contains(&wide)
            {
                continue;
            }
            let (model, start) = in_place(&set, wide, narrow);
            let simpler = fits.fit(&model, &start)?;
            let (of_set, of_simpler) = (elsewhere(&set)?, elsewhere(&simpler)?);
            let (runs, fewer) =
                (seen(data, &set, of_set.as_ref()), seen(data, &simpler, of_simpler.as_ref()));
            let cost = cost_beside_discrepancy(&runs, &runs).zip(cost_beside_discrepancy(&fewer, &runs));
            let Some((of_wide, of_narrow)) = cost else { continue };
            let share = probability(-(of_narrow - of_wide).abs());
            let (present, absent) = if of_narrow < of_wide { (narrow, wide) } else { (wide, narrow) };
            alternatives.push(Alternative { present, absent, share });
            if present == narrow {
                set = simpler;
            }
        }
    }
    Ok((set, alternatives))
}

/// The set without the effects on one side that a smooth term replaces, and what each of the others is worth beside one, nats.
fn beside_a_smooth_term<'a>(
    fits: &'a Fits,
    mut set: Hypothesis,
    side: Side,
    elsewhere: &Transferred<'a>,
) -> Result<(Hypothesis, Vec<(EffectId, f64)>)> {
    let data = fits.data;
    // Beside an error of the angle all effects in the currents are asked: it explains many of them. What is missing in the voltage equations
    // biases the torque of given currents, for which an effect of the motion may make up.
    let left = |set: &Hypothesis| match side {
        Side::Electrical => set.model.map().is_some() || sides(data, set).contains(&side),
        Side::Mechanical => !sides(data, set).is_empty(),
    };
    let asks = |set: &Hypothesis| left(set) && set.effects().iter().any(|e| side.has(*e));
    while asks(&set) {
        fits.monitor.go_on()?;
        let other = elsewhere(&set)?;
        let runs = seen(data, &set, other.as_ref());
        let worth = beside_discrepancy(&runs, side);
        // The least needed is dropped first: the gains of the others may change.
        let least = worth.iter().min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, nats)| !likely(*nats));
        let Some((effect, _)) = least else { return Ok((set, worth)) };
        let (model, start) = reduced(&set, *effect);
        set = fits.fit(&model, &start)?;
    }
    Ok((set, Vec::new()))
}

/// The set without the effects whose strength may be zero, one after the other.
fn beyond_error(fits: &Fits, mut set: Hypothesis) -> Result<Hypothesis> {
    loop {
        fits.monitor.go_on()?;
        let outputs = Outputs::new(fits.data, &set);
        let absent = |e: &EffectId| outputs.moves_nothing(*e) || outputs.may_be_absent(*e);
        let Some(effect) = set.effects().into_iter().find(absent) else { break };
        let (model, start) = reduced(&set, effect);
        set = fits.fit(&model, &start)?;
    }
    Ok(set)
}

/// The `kept` set with that one of the mechanical effects of `best` that explains most beside it, of those which a smooth torque replaces.
fn nearest(fits: &Fits, best: &Hypothesis, kept: &Hypothesis) -> Result<Option<Hypothesis>> {
    let replaced = best.model.slots().iter().filter(|slot| !kept.effects().contains(&slot.effect));
    let with = |slot: &Slot| {
        let effects = [&kept.effects()[..], &[slot.effect]].concat();
        let own = &kept.own()[..kept.model.map_parameters().start];
        let start = [own, &best.parameters[slot.parameters.clone()]].concat();
        fitting::fit(fits.data, &Model::new(*kept.model.context(), &effects), &start, false, fits.monitor)
    };
    let tried: Result<Vec<Hypothesis>> =
        replaced.filter(|slot| slot.effect.info().site == Site::Mechanical).map(with).collect();
    let speed = |set: &Hypothesis| set.square(Channel::OmegaE);
    Ok(tried?.into_iter().min_by(|a, b| speed(a).total_cmp(&speed(b))).filter(|set| speed(set) < speed(kept)))
}

#[cfg(test)]
mod tests {
    use super::super::explain;
    use super::*;
    use crate::base::BASE;
    use crate::diagnose::testing::{choice, data, fitted, settled, setup, speeds};
    use crate::drive::{Choice, Schedule, Setup, Shape, simulate};
    use crate::map::Equation;
    use crate::monitor::Silent;
    use crate::recording::Recording;
    use crate::signals::Signals;

    /// The effects of a set that holds `named` alone which a map cannot replace.
    fn kept(present: Vec<Choice>, named: EffectId) -> Vec<(EffectId, f64)> {
        // Slow about standstill, where a jump and a steep curve differ.
        let levels = [60.0, 4.0, -4.0, -50.0, -4.0, 4.0];
        let path: Vec<(f64, f64)> =
            (0..20).map(|k| (0.05 + 0.2 * f64::from(k), levels[k as usize % levels.len()])).collect();
        let (data, base) = data(&setup(speeds(4.0, &path), present));
        let set = fitted(&data, &base, named);
        let supported = supported(&data, None, &set, &Silent).unwrap();
        assert_eq!(supported.set.effects().len(), supported.probabilities.len());
        supported.probabilities
    }

    #[test]
    fn friction_beside_a_torque_that_no_effect_of_the_set_explains_stays_named() {
        let both = vec![choice("coulomb_friction", "tau_c", 0.3), choice("cogging_torque", "a_1", 0.3)];
        let kept = kept(both, EffectId::CoulombFriction);
        assert_eq!(kept.len(), 1, "{kept:?}");
        assert!(kept[0].0 == EffectId::CoulombFriction && kept[0].1 > 0.9, "{kept:?}");
    }

    /// A lively run of a machine.
    fn lively(present: Vec<Choice>) -> Setup {
        let path: Vec<(f64, f64)> =
            (0..10).map(|k| (0.05 + 0.2 * f64::from(k), [90.0, -70.0, 40.0][k as usize % 3])).collect();
        let mut manoeuvre = speeds(2.0, &path);
        let steps = [0.0, -4.0, 2.0, -3.0, 0.0].iter().enumerate();
        let steps = steps.map(|(k, i)| (0.4 * k as f64, *i)).collect();
        manoeuvre.i_d = Some(Schedule::new(steps, Shape::Steps).unwrap());
        setup(manoeuvre, present)
    }

    /// The effects of a set that holds `named` alone of such a run as it was logged.
    fn kept_of(setup: &Setup, logged: Vec<(String, Vec<f64>)>, named: EffectId) -> Vec<(EffectId, f64)> {
        let recording = Recording::new(logged, None).unwrap();
        let signals = Signals::new(&recording, &setup.nameplate).unwrap();
        let (data, base) = settled(Data::new(signals, &setup.nameplate, &Default::default()).unwrap());
        let set = fitted(&data, &base, named);
        supported(&data, None, &set, &Silent).unwrap().probabilities
    }

    /// The same where the current sensors lag two thirds of a row behind.
    fn kept_of_lagging(present: Vec<Choice>, named: EffectId) -> Vec<(EffectId, f64)> {
        let setup = lively(present);
        let whole = simulate(&setup, &Silent).unwrap().recording;
        let lagged = |name: &str| -> Vec<f64> {
            let mut shown = f64::NAN;
            let of = |x: &f64| {
                shown =
                    if shown.is_nan() || !name.starts_with("i_") { *x } else { shown + 0.6 * (x - shown) };
                shown
            };
            whole.column(name).unwrap().iter().map(of).collect()
        };
        let columns = whole.names().into_iter().map(|name| (name.to_string(), lagged(name)));
        kept_of(&setup, columns.collect(), named)
    }

    /// The same where the angle is behind the rotor by a share of its largest error, a function of the speed over the largest.
    fn kept_of_late(largest: f64, share: fn(f64) -> f64, named: EffectId) -> Vec<(EffectId, f64)> {
        let setup = lively(Vec::new());
        kept_of(&setup, late(&setup, largest, share), named)
    }

    /// The log of such a run.
    fn late(setup: &Setup, largest: f64, share: fn(f64) -> f64) -> Vec<(String, Vec<f64>)> {
        let whole = simulate(setup, &Silent).unwrap().recording;
        let column = |name: &str| whole.column(name).unwrap().to_vec();
        let (omega, mut theta) = (column("omega_e"), column("theta_e"));
        let fastest = omega.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        let late: Vec<f64> = omega.iter().map(|w| largest * share(w / fastest)).collect();
        theta.iter_mut().zip(&late).for_each(|(x, late)| *x -= late);
        // The command is known in the frame of the logged angle.
        let (mut v_d, mut v_q) = (column("v_d"), column("v_q"));
        for ((d, q), late) in v_d.iter_mut().zip(&mut v_q).zip(&late) {
            let (s, c) = late.sin_cos();
            (*d, *q) = (c * *d - s * *q, s * *d + c * *q);
        }
        let mut logged: Vec<(String, Vec<f64>)> =
            ["t", "i_a", "i_b", "i_c"].map(|name| (name.to_string(), column(name))).to_vec();
        for (name, x) in [("theta_e", theta), ("omega_e", omega), ("v_d", v_d), ("v_q", v_q)] {
            logged.push((name.to_string(), x));
        }
        logged
    }

    #[test]
    fn an_angle_that_is_late_in_no_known_way_is_modelled_as_such_and_friction_and_dead_time_are_named_beside_it()
     {
        let present = vec![choice("coulomb_friction", "tau_c", 0.3), choice("dead_time", "v_err", 8.0)];
        let setup = lively(present);
        let logged = late(&setup, 0.1, |x| (2.0 * x).tanh());
        let signals = Signals::new(&Recording::new(logged, None).unwrap(), &setup.nameplate).unwrap();
        let (data, base) = settled(Data::new(signals, &setup.nameplate, &Default::default()).unwrap());
        let effects = [EffectId::CoulombFriction, EffectId::DeadTime, EffectId::EncoderDelay];
        let context = data.signals.context;
        let typical = effects.iter().flat_map(|e| e.info().parameters).map(|p| (p.typical)(&context));
        let start = [&base.parameters[..BASE], &typical.collect::<Vec<f64>>()].concat();
        let set = fitting::fit(&data, &Model::new(context, &effects), &start, false, &Silent).unwrap();
        let supported = supported(&data, None, &set, &Silent).unwrap();
        assert_eq!(supported.set.effects(), effects[..2]);
        let (fitted, unmodelled) = explain(&data, None, &supported.set, &Silent).unwrap();
        let [term] = &unmodelled.terms[..] else { panic!("{}", unmodelled.sentence) };
        assert_eq!((term.equation, term.unit), (Equation::Sensor, "rad"));
        // The zero of the angle is that of the log, of which a constant part is not known.
        assert!((term.peak - 0.1).abs() < 0.01, "{}", term.peak);
        assert!(fitted.squares.iter().all(|(_, square)| *square < 1.2), "{:?}", fitted.squares);
    }

    #[test]
    fn a_constant_delay_is_no_name_for_an_angle_that_is_late_in_another_way() {
        // It levels off, or grows faster than the speed.
        for share in [|x: f64| (2.0 * x).tanh(), |x: f64| x * x.abs()] {
            for named in [EffectId::EncoderDelay, EffectId::VoltageDelay] {
                assert_eq!(kept_of_late(0.1, share, named), []);
            }
        }
    }

    #[test]
    fn a_delay_of_the_voltage_is_no_name_for_current_sensors_that_lag_and_dead_time_is_one_beside_them() {
        assert_eq!(kept_of_lagging(Vec::new(), EffectId::VoltageDelay), []);
        let dead_time = vec![choice("dead_time", "v_err", 8.0)];
        let kept = kept_of_lagging(dead_time, EffectId::DeadTime);
        assert!(kept.len() == 1 && kept[0].1 > 0.9, "{kept:?}");
    }

    #[test]
    fn what_biases_the_flux_is_no_friction_against_a_known_load_and_dry_friction_is_one_beside_it() {
        let kept = |present: Vec<Choice>, named| {
            let mut setup = lively(present);
            setup.manoeuvre.tau_load = Some(Schedule::constant(3.0).unwrap());
            setup.manoeuvre.load_kind = Some("known_constant".into());
            let whole = simulate(&setup, &Silent).unwrap().recording;
            // The inverter makes less voltage than the log says, and loses some more in its dead time.
            let gain = |name: &str| if name.starts_with("v_") { 1.05 } else { 1.0 };
            let logged = |name: &str| whole.column(name).unwrap().iter().map(|x| gain(name) * x).collect();
            let columns = whole.names().into_iter().map(|name| (name.to_string(), logged(name))).collect();
            let recording = Recording::new(columns, Some(whole.load())).unwrap();
            let signals = Signals::new(&recording, &setup.nameplate).unwrap();
            let (data, base) = settled(Data::new(signals, &setup.nameplate, &Default::default()).unwrap());
            let set = fitted(&data, &base, named);
            supported(&data, None, &set, &Silent).unwrap().probabilities
        };
        let dead_time = choice("dead_time", "v_err", 8.0);
        assert_eq!(kept(vec![dead_time.clone()], EffectId::AsymmetricFriction), []);
        let dry = kept(vec![dead_time, choice("coulomb_friction", "tau_c", 0.3)], EffectId::CoulombFriction);
        assert!(dry.len() == 1 && dry[0].1 > 0.9, "{dry:?}");
    }

    #[test]
    fn an_effect_of_the_motion_that_its_own_error_exceeds_earns_no_name() {
        let (data, base) = data(&setup(
            speeds(1.0, &[(0.1, 90.0), (0.4, -80.0), (0.8, 60.0)]),
            vec![choice("coulomb_friction", "tau_c", 0.3)],
        ));
        let effects = [EffectId::CoulombFriction, EffectId::QuadraticDrag];
        let context = data.signals.context;
        let typical = effects.iter().flat_map(|e| e.info().parameters).map(|p| (p.typical)(&context));
        let start: Vec<f64> = base.own().iter().copied().chain(typical).collect();
        let both = fitting::fit(&data, &Model::new(context, &effects), &start, false, &Silent).unwrap();
        let mapped = Mapped::new(&both);
        let fits = Fits { data: &data, mapped: &mapped, monitor: &Silent };
        let set = beyond_error(&fits, both).unwrap();
        assert_eq!(set.effects(), [EffectId::CoulombFriction]);
    }

    #[test]
    fn such_a_torque_alone_names_nothing() {
        let alone = vec![choice("cogging_torque", "a_1", 0.3)];
        assert_eq!(kept(alone, EffectId::QuadraticDrag), []);
    }
}
