//! A set of effects fitted to a recording by simulation: the electrical equations first, with the measured speed; then the mechanical
//! one, with the torque of the measured currents; and both together where one alone does not tell enough.

use super::data::Data;
use super::hypothesis::Hypothesis;
use super::motion::{self, Found};
use crate::base::BASE;
use crate::effect::Site;
use crate::error::Result;
use crate::experiment::{Channel, Channels};
use crate::machine::BaseParameter;
use crate::model::Model;
use crate::monitor::Monitor;
use crate::simulate::mechanical::Nuisance;

/// Most rounds in which currents and motion are fitted together, each weighted by the residual of the one before.
const ROUNDS: usize = 2;
/// Ratio of a residual to that of the round before above which no channel has improved enough for another round.
const SETTLED: f64 = 0.8;

/// Channels with their noise times `factors`, one per channel of each recording in turn.
pub fn rescaled(channels: Channels, factors: impl IntoIterator<Item = f64>) -> Channels {
    let mut factors = factors.into_iter();
    let mut own = |(c, s): (Channel, f64)| (c, s * factors.next().unwrap_or(1.0));
    channels.into_iter().map(|run| run.into_iter().map(&mut own).collect()).collect()
}

/// Fits the effects of `model` to `data`, starting from the model parameters `start`. `electrical_done` says that the
/// electrical parameters of `start` are already the fitted ones.
///
/// # Errors
/// Those of the least-squares fit.
pub fn fit(
    data: &Data,
    model: &Model,
    start: &[f64],
    electrical_done: bool,
    monitor: &dyn Monitor,
) -> Result<Hypothesis> {
    let stage = Stage { electrical_done, held: &[], load: Unknown::Anew, currents_alone: false };
    staged(data, model, start, stage, monitor)
}

/// Fits as [`fit`] does, but with the steps of an unknown load that were found `under` another model, if there is one; and first with the
/// model parameters `held`, if there are any, kept at their start, and then all of them from where that leads, loads and initial values
/// included.
///
/// # Errors
/// Those of the least-squares fits.
pub fn fit_under(
    under: Option<&Hypothesis>,
    held: &[usize],
    data: &Data,
    model: &Model,
    (start, electrical_done): (&[f64], bool),
    monitor: &dyn Monitor,
) -> Result<Hypothesis> {
    let load = under.map_or(Unknown::Anew, |under| Unknown::As(load_of(under)));
    let stage = Stage { electrical_done, held, load, currents_alone: false };
    let first = staged(data, model, start, stage, monitor)?;
    if held.is_empty() {
        return Ok(first);
    }
    let load = Unknown::As(load_of(&first));
    let stage = Stage { electrical_done, held: &[], load, currents_alone: false };
    staged(data, model, first.own(), stage, monitor)
}

/// The electrical parameters of a hypothesis fitted to the currents alone, and what these leave; nothing is said of the motion.
///
/// # Errors
/// Those of the least-squares fit.
pub fn currents_alone(data: &Data, hypothesis: &Hypothesis, monitor: &dyn Monitor) -> Result<Hypothesis> {
    let stage = Stage { electrical_done: false, held: &[], load: Unknown::Anew, currents_alone: true };
    staged(data, &hypothesis.model, hypothesis.own(), stage, monitor)
}

/// Fits a hypothesis to the same recordings once more from where it stands, loads and initial values included.
///
/// # Errors
/// Those of the least-squares fits.
pub fn on_from(data: &Data, from: &Hypothesis, monitor: &dyn Monitor) -> Result<Hypothesis> {
    let load = Unknown::From(load_of(from));
    let stage = Stage { electrical_done: false, held: &[], load, currents_alone: false };
    staged(data, &from.model, from.own(), stage, monitor)
}

/// Fits a hypothesis that was fitted to some samples of the same recordings to all of them, from where it stands, with the steps of an
/// unknown load that it has.
///
/// # Errors
/// Those of the least-squares fits.
pub fn carried_over(data: &Data, from: &Hypothesis, monitor: &dyn Monitor) -> Result<Hypothesis> {
    let load = Unknown::As(load_of(from));
    let stage = Stage { electrical_done: false, held: &[], load, currents_alone: false };
    staged(data, &from.model, from.own(), stage, monitor)
}

/// What a hypothesis found of each recording's load and initial values.
fn load_of(found: &Hypothesis) -> Found<'_> {
    (&found.nuisances, &found.parameters[found.model.parameter_count()..])
}

/// The parameters to which a fit of the electrical ones and of sensors to the currents alone leads from `start`, which keeps those `held`.
///
/// # Errors
/// Those of the least-squares fit.
fn to_currents(
    data: &Data,
    model: &Model,
    start: &[f64],
    held: &[usize],
    monitor: &dyn Monitor,
) -> Result<Vec<f64>> {
    let (electrical, _, sensors) = free_parameters(data, model);
    let wanted: Vec<usize> = electrical.into_iter().chain(sensors).filter(|k| !held.contains(k)).collect();
    let nuisances = vec![Nuisance::known(0); data.runs().len()];
    let experiment = data.experiment(model, &nuisances, data.channels(true, false));
    let parameters = experiment.fit(start, &wanted, &data.settings, monitor)?.parameters;
    if !data.poor {
        return Ok(parameters);
    }
    // Missing physics can bias parameters that the recording hardly shows: fit again from the nameplate, weighted by the residual.
    let left = experiment.loudness(&experiment.residual(&parameters));
    let channels = rescaled(data.channels(true, false), left.into_iter().map(|r| r.max(1.0)));
    let experiment = data.experiment(model, &nuisances, channels);
    let start = [&data.start[..], &start[BASE..]].concat();
    Ok(experiment.fit(&start, &wanted, &data.settings, monitor)?.parameters)
}

/// The start of the fit of an unknown load.
#[derive(Clone, Copy)]
enum Unknown<'a> {
    /// With what the recording shows of its steps.
    Anew,
    /// With what was found before, to which steps are added that are missing.
    From(Found<'a>),
    /// With what was found before, to which none is added.
    As(Found<'a>),
}

/// What a fit keeps, the load from which it begins, and whether it ends with the currents.
struct Stage<'a> {
    electrical_done: bool,
    held: &'a [usize],
    load: Unknown<'a>,
    currents_alone: bool,
}

fn staged(
    data: &Data,
    model: &Model,
    start: &[f64],
    Stage { electrical_done, held, load, currents_alone }: Stage,
    monitor: &dyn Monitor,
) -> Result<Hypothesis> {
    let (mut electrical, mut rotor, mut sensors) = free_parameters(data, model);
    for free in [&mut electrical, &mut rotor, &mut sensors] {
        free.retain(|k| !held.contains(k));
    }
    let mut parameters = start.to_vec();
    let mut nuisances = vec![Nuisance::known(0); data.runs().len()];
    let mut free = torque_constants(data);
    if data.has_electrical() {
        if !electrical_done {
            parameters = to_currents(data, model, start, held, monitor)?;
        }
        free = [electrical, sensors].concat();
        if currents_alone {
            return Ok(Hypothesis::of_currents(data, model, &parameters, &free));
        }
    }
    if data.has_mechanical() {
        let fitted = match load {
            Unknown::Anew => motion::fit(data, model, &parameters, &rotor, None, monitor)?,
            Unknown::From(found) => motion::fit(data, model, &parameters, &rotor, Some(found), monitor)?,
            Unknown::As(found) => motion::fit_under(data, model, &parameters, &rotor, found, monitor)?,
        };
        (parameters, nuisances) = (fitted.parameters, fitted.nuisances);
        free.extend(fitted.free);
        if together(data, model) {
            parameters = fit_together(data, model, parameters, &free, &nuisances, monitor)?;
        } else if data.has_electrical() && model.effects().iter().any(|e| e.info().site == Site::Electrical) {
            let apart = Hypothesis::on(data, model.clone(), parameters, free, nuisances);
            return in_agreement(data, apart, monitor);
        }
    }
    Ok(Hypothesis::on(data, model.clone(), parameters, free, nuisances))
}

/// A hypothesis fitted to the currents and then to the motion, fitted to both at once where that explains the motion as well. The torque may
/// determine a parameter of an effect that the currents do not show.
fn in_agreement(data: &Data, apart: Hypothesis, monitor: &dyn Monitor) -> Result<Hypothesis> {
    let explained = |h: &Hypothesis, electrical: bool| {
        let mut side = h.squares.iter().filter(|(c, _)| c.is_electrical() == electrical);
        side.all(|(_, square)| *square <= 1.0 + data.options.mismatch)
    };
    if !explained(&apart, true) || explained(&apart, false) {
        return Ok(apart);
    }
    let Hypothesis { model, parameters, free, nuisances, .. } = &apart;
    let parameters = fit_together(data, model, parameters.clone(), free, nuisances, monitor)?;
    let both = Hypothesis::on(data, model.clone(), parameters, free.clone(), nuisances.clone());
    Ok(if explained(&both, true) && explained(&both, false) { both } else { apart })
}

/// Fits currents and motion at once, starting from the fits of each.
fn fit_together(
    data: &Data,
    model: &Model,
    mut parameters: Vec<f64>,
    free: &[usize],
    nuisances: &[Nuisance],
    monitor: &dyn Monitor,
) -> Result<Vec<f64>> {
    let experiment = data.experiment(model, nuisances, data.channels(true, true));
    let blocks = experiment.blocks();
    let mut before = vec![f64::INFINITY; blocks.len()];
    for _ in 0..ROUNDS {
        // A mismatched channel gets less weight, so that it does not bias parameters that the others determine. A systematic residual is
        // correlated and weighs as few independent samples: the flux does not absorb a missing friction. Where the motion determines a
        // sensor, or a parameter that the currents do not show, the residual weighs as if it were white.
        let residual = experiment.residual(&parameters);
        let (rms, loud) = (experiment.relative_rms(&residual), experiment.loudness(&residual));
        let left: Vec<f64> = (0..blocks.len())
            .map(|k| {
                let plain = if data.poor { !blocks[k].channel.is_electrical() } else { model.has_sensor() };
                if plain { rms[k].max(1.0) } else { loud[k].max(1.0) }
            })
            .collect();
        if left.iter().zip(&before).all(|(now, then)| *now > SETTLED * then) {
            break;
        }
        let channels = rescaled(data.channels(true, true), left.iter().copied());
        let experiment = data.experiment(model, nuisances, channels);
        parameters = experiment.fit(&parameters, free, &data.settings, monitor)?.parameters;
        if data.poor || model.has_sensor() {
            break;
        }
        before = left;
    }
    Ok(parameters)
}

/// Fits the effects of a hypothesis once more, from where it stands.
///
/// # Errors
/// Those of the least-squares fit.
pub fn refit(data: &Data, from: &Hypothesis, monitor: &dyn Monitor) -> Result<Hypothesis> {
    fit(data, &from.model, from.own(), false, monitor)
}

/// Whether the electrical parameters are fitted to the motion, too. A sensor error shows in both. With a noisy voltage or a poor manoeuvre
/// the torque determines the flux better than the currents do, unless a map holds the torque that is missing.
pub fn together(data: &Data, model: &Model) -> bool {
    let both = data.has_electrical() && data.has_mechanical();
    let mapped = model.map().is_some_and(|map| map.parts.iter().any(|part| part.site() == Site::Mechanical));
    both && (model.has_sensor() || (data.input.voltage > 0.0 || data.poor) && !mapped)
        || !torque_constants(data).is_empty()
}

/// The parameters of the torque that recordings of the motion alone determine: l_d − l_q, by way of l_q, where both currents flow, and the flux
/// where a load in N·m is known. Without such a load it scales inertia and friction, and is not determined. A wrong value on the nameplate is
/// no missing physics.
fn torque_constants(data: &Data) -> Vec<usize> {
    let by_currents = |run: &&Data| run.signals.tau_e.is_none() && run.signals.i.is_some();
    let runs = || data.runs().iter().filter(by_currents);
    if data.has_electrical() || !data.has_mechanical() {
        return Vec::new();
    }
    let flows = |i: &[Vec<f64>; 2]| i[0].iter().zip(&i[1]).any(|(d, q)| d * q != 0.0);
    let both = runs().any(|run| run.signals.i.as_ref().is_some_and(flows));
    let against_a_load = runs().any(|run| run.signals.context.load_known);
    let told = [(BaseParameter::LQ, both), (BaseParameter::PsiM, against_a_load)];
    told.into_iter().filter(|(_, shown)| *shown).map(|(p, _)| p.index()).collect()
}

/// The final estimate: the mechanical parameters fitted once more with whitened residuals where the speed's residual is
/// coloured. Hypotheses are compared before that, on the residuals as they are.
///
/// # Errors
/// Those of the least-squares fit.
pub fn efficient(data: &Data, hypothesis: &Hypothesis, monitor: &dyn Monitor) -> Result<Hypothesis> {
    let model = &hypothesis.model;
    if !data.has_mechanical() || (model.has_sensor() && data.has_electrical()) {
        return Ok(hypothesis.clone());
    }
    let (_, rotor, _) = free_parameters(data, model);
    let nuisances = &hypothesis.nuisances;
    let fitted = motion::whitened(data, model, &hypothesis.parameters, nuisances, &rotor, monitor)?;
    Ok(match fitted {
        Some(parameters) => {
            Hypothesis::on(data, model.clone(), parameters, hypothesis.free.clone(), nuisances.clone())
        }
        None => hypothesis.clone(),
    })
}

/// Free model parameters: electrical, mechanical, and those of sensors.
pub fn free_parameters(data: &Data, model: &Model) -> (Vec<usize>, Vec<usize>, Vec<usize>) {
    let wanted = |p: &BaseParameter| data.needs(*p);
    let mut electrical: Vec<usize> =
        BaseParameter::ELECTRICAL.iter().filter(|p| wanted(p)).map(|p| p.index()).collect();
    if !data.has_electrical() {
        electrical.clear();
    }
    let mut rotor: Vec<usize> = BaseParameter::MECHANICAL.iter().map(|p| p.index()).collect();
    let mut sensors = Vec::new();
    for slot in model.slots() {
        let fitted = slot
            .parameters
            .clone()
            .enumerate()
            .filter(|(k, _)| slot.effect.fitted(model.context(), *k))
            .map(|(_, index)| index);
        match slot.effect.info().site {
            Site::Electrical => electrical.extend(fitted),
            Site::Mechanical => rotor.extend(fitted),
            Site::Sensor => sensors.extend(fitted),
        }
    }
    if let Some(map) = model.map() {
        let start = model.map_parameters().start;
        for (part, place) in map.places() {
            let side = match part.site() {
                Site::Electrical => &mut electrical,
                Site::Mechanical => &mut rotor,
                Site::Sensor => &mut sensors,
            };
            side.extend(place.map(|k| start + k));
        }
    }
    (electrical, rotor, sensors)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{data, setup, speeds};
    use crate::drive::Schedule;
    use crate::monitor::Silent;

    #[test]
    fn a_wrong_saliency_is_no_physics_that_a_recording_of_the_motion_lacks() {
        let mut manoeuvre = speeds(1.0, &[(0.1, 90.0), (0.4, -80.0), (0.7, 60.0)]);
        let steps = (0..10).map(|k| (0.1 * f64::from(k), [-8.0, 4.0][k as usize % 2])).collect();
        manoeuvre.i_d = Some(Schedule::new(steps, crate::drive::Shape::Steps).unwrap());
        let setup = setup(manoeuvre, Vec::new());
        let whole = crate::drive::simulate(&setup, &Silent).unwrap().recording;
        let names = ["t", "i_a", "i_b", "i_c", "theta_e", "omega_e"];
        let columns = names.iter().filter_map(|name| Some((name.to_string(), whole.column(name)?.to_vec())));
        let recording = crate::recording::Recording::new(columns.collect(), None).unwrap();
        let l_q = setup.machine.get(BaseParameter::LQ).unwrap();
        let nameplate = setup.machine.with(BaseParameter::LQ, 1.25 * l_q).unwrap();
        let signals = crate::signals::Signals::new(&recording, &nameplate).unwrap();
        let mut data = Data::new(signals, &nameplate, &Default::default()).unwrap();
        let base = crate::diagnose::baseline::fit(&mut data, &Silent).unwrap();
        assert!(
            crate::diagnose::verdict::largest_excess(&base) < data.options.mismatch,
            "{:?}",
            base.squares
        );
    }

    #[test]
    fn a_wrong_flux_under_a_known_load_is_no_physics_that_a_recording_of_the_motion_lacks() {
        let mut manoeuvre = speeds(1.0, &[(0.1, 90.0), (0.4, -80.0), (0.7, 60.0)]);
        manoeuvre.tau_load = Some(Schedule::constant(3.0).unwrap());
        manoeuvre.load_kind = Some("known_constant".into());
        let setup = setup(manoeuvre, Vec::new());
        let whole = crate::drive::simulate(&setup, &Silent).unwrap().recording;
        let names = ["t", "i_a", "i_b", "i_c", "theta_e", "omega_e"];
        let columns = names.iter().filter_map(|name| Some((name.to_string(), whole.column(name)?.to_vec())));
        let recording = crate::recording::Recording::new(columns.collect(), Some(whole.load())).unwrap();
        let psi_m = setup.machine.get(BaseParameter::PsiM).unwrap();
        let nameplate = setup.machine.with(BaseParameter::PsiM, 1.15 * psi_m).unwrap();
        let signals = crate::signals::Signals::new(&recording, &nameplate).unwrap();
        let mut data = Data::new(signals, &nameplate, &Default::default()).unwrap();
        let base = crate::diagnose::baseline::fit(&mut data, &Silent).unwrap();
        let excess = crate::diagnose::verdict::largest_excess(&base);
        assert!(excess < data.options.mismatch, "{:?}", base.squares);
        assert!((base.own()[BaseParameter::PsiM.index()] / psi_m - 1.0).abs() < 0.01, "{:?}", base.own());
    }

    #[test]
    fn what_the_currents_leave_open_the_torque_may_tell() {
        // Close to standstill the flux hardly shows in the voltages, but under a known load it does in the motion.
        let mut manoeuvre = speeds(1.0, &[(0.2, 0.3), (0.5, -0.3), (0.8, 0.3)]);
        manoeuvre.tau_load = Some(Schedule::constant(3.0).unwrap());
        manoeuvre.load_kind = Some("known_constant".into());
        let setup = setup(manoeuvre, Vec::new());
        let (data, base) = data(&setup);
        let psi_m = BaseParameter::PsiM.index();
        let truth = BaseParameter::ALL.map(|p| setup.machine.get(p).unwrap());
        let with_flux = |share: f64| {
            let mut parameters = truth.to_vec();
            parameters[psi_m] *= share;
            Hypothesis::on(&data, base.model.clone(), parameters, base.free.clone(), base.nuisances.clone())
        };
        let left = |h: &Hypothesis, electrical: bool| {
            let side = h.squares.iter().filter(|(c, _)| c.is_electrical() == electrical);
            side.map(|(_, square)| *square).fold(0.0, f64::max)
        };
        let apart = with_flux(1.01);
        assert!(
            left(&apart, true) < 1.0 + data.options.mismatch && left(&apart, false) > 10.0,
            "{:?}",
            apart.squares
        );
        let both = in_agreement(&data, apart, &Silent).unwrap();
        assert!(left(&both, true) < 1.1 && left(&both, false) < 1.1, "{:?}", both.squares);
        assert!((both.parameters[psi_m] / truth[psi_m] - 1.0).abs() < 2e-3);
        // Where the currents do not fit themselves, or nothing is amiss, it stays as it was.
        for share in [1.3, 1.0] {
            let apart = with_flux(share);
            let agreed = in_agreement(&data, apart.clone(), &Silent).unwrap();
            assert_eq!(agreed.parameters, apart.parameters, "{share}");
        }
    }
}
