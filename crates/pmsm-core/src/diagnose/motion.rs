//! The equation of motion fitted to the measured speed, with an unknown load whose steps are found, added where the
//! simulation still misses one, and pruned where they explain too little.

mod reversals;
mod settling;
mod state;
mod steps;

use super::data::Data;
use crate::error::Result;
use crate::model::Model;
use crate::monitor::Monitor;
use crate::noise::colour::Colour;
use crate::recording::Load;
use crate::simulate::mechanical::Nuisance;
use settling::Settling;
use state::{State, states_of};
use steps::with_missing_step;

pub use reversals::without_reversals;
pub use settling::Motion;

/// Excess mean square of the speed from which a missing load step is looked for.
const MISSING: f64 = 0.3;
/// A step added there must bring the mean square below this share of what it was.
const IMPROVEMENT: f64 = 0.7;
/// Steps added at most.
const ADDED: usize = 4;

/// Where a fit begins with what each recording leaves open: the nuisances and values of each.
pub type Found<'a> = (&'a [Nuisance], &'a [f64]);

/// Fits the mechanical parameters `rotor` of `model`, starting from `start`, and whatever each recording leaves open: from what was
/// `found` before, if anything was. Steps that are missing from an unknown load are added.
///
/// # Errors
/// Those of the least-squares fit.
pub fn fit(
    data: &Data,
    model: &Model,
    start: &[f64],
    rotor: &[usize],
    found: Option<Found>,
    monitor: &dyn Monitor,
) -> Result<Motion> {
    let torque = data.torque(model, &start[..model.parameter_count()]);
    driven(data, model, start, rotor, found, &torque, monitor)
}

/// The same with the motor `torque` given per sample, N·m, in place of that of the currents, and nothing found before.
///
/// # Errors
/// Those of the least-squares fit.
pub fn fit_driven_by(
    data: &Data,
    model: &Model,
    start: &[f64],
    rotor: &[usize],
    torque: &[f64],
    monitor: &dyn Monitor,
) -> Result<Motion> {
    driven(data, model, start, rotor, None, torque, monitor)
}

fn driven(
    data: &Data,
    model: &Model,
    start: &[f64],
    rotor: &[usize],
    found: Option<Found>,
    torque: &[f64],
    monitor: &dyn Monitor,
) -> Result<Motion> {
    let own = &start[..model.parameter_count()];
    let begin = |(run, part): (usize, &Data)| {
        State::start(part, model, own, rotor, &torque[data.samples_of(run)], monitor)
    };
    let states = match found {
        Some(found) => states_for(data, model, found),
        None => data.runs().iter().enumerate().map(begin).collect(),
    };
    let settling = Settling { data, model, rotor, torque, initial_held: false, monitor };
    let mut best = settled(&settling, own, states)?;
    for (run, part) in data.runs().iter().enumerate() {
        if part.signals.load != Load::UnknownPiecewise || !part.has_mechanical() {
            continue;
        }
        for _ in 0..ADDED {
            if best.squares[run] < 1.0 + MISSING {
                break;
            }
            monitor.go_on()?;
            let mut states = states_of(&best.nuisances, &best.parameters[model.parameter_count()..]);
            let own = &best.parameters[..model.parameter_count()];
            let samples = &torque[data.samples_of(run)];
            let Some((state, at)) = with_missing_step(part, model, own, &states[run], samples) else { break };
            states[run] = state;
            match settling.settle_with(own.to_vec(), states, (run, at))? {
                Some(more) if more.squares[run] <= IMPROVEMENT * best.squares[run] => best = more,
                _ => break,
            }
        }
    }
    Ok(best)
}

/// The same under a load of the shape that was `found`, whose levels and instants are fitted but to which no step is added.
///
/// # Errors
/// Those of the least-squares fit.
pub fn fit_under(
    data: &Data,
    model: &Model,
    start: &[f64],
    rotor: &[usize],
    found: Found,
    monitor: &dyn Monitor,
) -> Result<Motion> {
    let own = &start[..model.parameter_count()];
    let states = states_for(data, model, found);
    let torque = &data.torque(model, own);
    settled(&Settling { data, model, rotor, torque, initial_held: false, monitor }, own, states)
}

/// The equation of motion fitted from given states. Where the fit has many minima and the one found explains too little, it is fitted in short
/// windows first.
fn settled(settling: &Settling, own: &[f64], states: Vec<State>) -> Result<Motion> {
    let direct = settling.settle(own.to_vec(), states.clone())?;
    let explained = direct.squares.iter().all(|square| *square < 1.0 + MISSING);
    if explained || !settling.model.effects().iter().any(|e| e.is_multimodal()) {
        return Ok(direct);
    }
    let short = settling.data.in_short_windows();
    let near = Settling { data: &short, initial_held: true, ..*settling }.settle(own.to_vec(), states)?;
    let (own, values) = near.parameters.split_at(own.len());
    let better = settling.settle(own.to_vec(), states_of(&near.nuisances, values))?;
    let sum = |motion: &Motion| motion.squares.iter().sum::<f64>();
    Ok(if sum(&better) < sum(&direct) { better } else { direct })
}

/// The states found with a model that may have had other initial values, which then begin anew.
fn states_for(data: &Data, model: &Model, (nuisances, values): Found) -> Vec<State> {
    let mut states = states_of(nuisances, values);
    for (state, part) in states.iter_mut().zip(data.runs()) {
        let initial = if part.has_mechanical() { part.initial_states(model) } else { 0 };
        if state.deviations.len() != initial {
            state.deviations = vec![0.0; initial];
        }
    }
    states
}

/// Lag-one correlation within windows from which a fitted speed is fitted once more with whitened residuals.
const COLOURED: f64 = 0.3;
/// Rounds of whitening, each by the colour of what the round before leaves.
const ROUNDS: usize = 3;

/// The same equation of motion fitted once more with the residual whitened by its own colour within the windows, as an
/// efficient estimate wants it where torque errors add up in the speed or let a shaft ring; `None` where they hardly do.
///
/// # Errors
/// Those of the least-squares fit.
pub fn whitened(
    data: &Data,
    model: &Model,
    fitted: &[f64],
    nuisances: &[Nuisance],
    rotor: &[usize],
    monitor: &dyn Monitor,
) -> Result<Option<Vec<f64>>> {
    let count = model.parameter_count();
    let torque = data.torque(model, &fitted[..count]);
    let mut free = rotor.to_vec();
    free.extend(count..fitted.len());
    let mut best = None;
    for _ in 0..if rotor.is_empty() { 0 } else { ROUNDS } {
        monitor.go_on()?;
        let experiment = data.motion(model, nuisances, &torque);
        let from = best.as_deref().unwrap_or(fitted);
        let residual = experiment.residual(from);
        let coloured = experiment.coloured(&residual, |run, rows| {
            Colour::of(rows, run.windows).filter(|c| c.lag_one() >= COLOURED)
        });
        let Some(experiment) = coloured else { break };
        best = Some(experiment.fit(from, &free, &data.settings, monitor)?.parameters);
    }
    Ok(best)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::hypothesis::Hypothesis;
    use crate::diagnose::testing::{data, fitted, prepared, setup, speeds};
    use crate::diagnose::verdict::largest_excess;
    use crate::diagnose::{baseline, fitting};
    use crate::drive::{Choice, Schedule, Shape, simulate};
    use crate::effects::EffectId;
    use crate::experiment::Channel;
    use crate::monitor::Silent;
    use crate::recording::Recording;

    /// A step of the load, N·m, that lowers the mean square of the innovations by less than its share.
    const SMALL: f64 = 0.045;

    #[test]
    fn a_fit_begins_from_the_load_that_was_found() {
        let mut manoeuvre = speeds(0.8, &[(0.1, 80.0), (0.4, -60.0), (0.7, 90.0)]);
        manoeuvre.tau_load = Some(Schedule::constant(4.0).unwrap());
        manoeuvre.load_kind = Some("unknown_constant".into());
        let (data, base) = data(&setup(manoeuvre, Vec::new()));
        let count = base.model.parameter_count();
        let load = (&base.nuisances[..], &base.parameters[count..]);
        assert_eq!(states_for(&data, &base.model, load)[0].levels, [base.parameters[count]]);
        let torque = data.torque(&base.model, base.own());
        let anew = State::start(&data, &base.model, base.own(), &[], &torque, &Silent).levels;
        let off = (anew[0] / base.parameters[count] - 1.0).abs();
        assert!(off > 0.0 && off < 0.02, "{anew:?}");
    }

    #[test]
    fn under_a_load_that_was_found_a_shaft_begins_at_rest_and_no_step_is_added() {
        let mut manoeuvre = speeds(1.2, &[(0.1, 90.0), (0.4, -80.0), (0.7, 90.0), (1.0, -60.0)]);
        let steps = vec![(0.0, 1.0), (0.55, 4.0)];
        manoeuvre.tau_load = Some(Schedule::new(steps, Shape::Steps).unwrap());
        manoeuvre.load_kind = Some("unknown_piecewise".into());
        let (data, base) = data(&setup(manoeuvre, Vec::new()));
        let count = base.own().len();
        let (stepping, values) = ([Nuisance { levels: 2, initial: 0 }], &base.parameters[count..]);
        assert_eq!(base.nuisances, stepping);
        let model = Model::new(*base.model.context(), &[EffectId::TwoMassShaft]);
        let typical = EffectId::TwoMassShaft.info().parameters.iter().map(|p| (p.typical)(model.context()));
        let start: Vec<f64> = base.own().iter().copied().chain(typical).collect();
        let shaft = fit_under(&data, &model, &start, &[], (&stepping, values), &Silent).unwrap();
        assert_eq!(shaft.nuisances, [Nuisance { levels: 2, initial: data.initial_states(&model) }]);
        assert!(data.initial_states(&model) > 0);
        // Without the step, one that is to be found is, and one under a load that was found is not.
        let flat = ([Nuisance { levels: 1, initial: 0 }], [values[0]]);
        let flat: Found = (&flat.0, &flat.1);
        let under = fit_under(&data, &base.model, base.own(), &[], flat, &Silent).unwrap();
        let on = fit(&data, &base.model, base.own(), &[], Some(flat), &Silent).unwrap();
        assert!(under.squares[0] > 1.0 + MISSING && under.nuisances == flat.0, "{:?}", under.squares);
        assert!(on.squares[0] < 1.0 + MISSING && on.nuisances == stepping, "{:?}", on.squares);
    }

    #[test]
    fn a_small_step_of_the_load_under_a_speed_that_wanders_is_found() {
        let path: Vec<(f64, f64)> =
            (0..8).map(|k| (0.1 + 0.25 * f64::from(k), [90.0, -70.0][k as usize % 2])).collect();
        let mut manoeuvre = speeds(2.0, &path);
        let steps = vec![(0.0, 1.0), (0.83, 2.5), (1.42, 2.5 + SMALL)];
        manoeuvre.tau_load = Some(Schedule::new(steps, Shape::Steps).unwrap());
        manoeuvre.load_kind = Some("unknown_piecewise".into());
        let mut setup = setup(manoeuvre, Vec::new());
        setup.drive.sensors.noise_i = 0.3;
        for machine in [&mut setup.machine, &mut setup.nameplate] {
            *machine = machine.clone().with_drive(Some(560.0), Some(20.0), Some(2e4)).unwrap();
        }
        let recording = simulate(&setup, &Silent).unwrap().recording;
        let mut data = prepared(&recording, &setup);
        let base = baseline::fit(&mut data, &Silent).unwrap();
        let speed = data.floors.iter().find(|f| f.channel == Channel::OmegaE).unwrap();
        assert!(speed.wander.is_some(), "{speed:?}");
        let found = &base.parameters[base.model.parameter_count()..];
        assert_eq!(base.nuisances[0].steps(), 2, "{found:?} {:?}", base.squares);
        assert!(
            (found[4] - 1.42).abs() < 0.02 && (found[2] - found[1] - SMALL).abs() < 0.3 * SMALL,
            "{found:?}"
        );
        assert!(largest_excess(&base) < 0.5 * data.options.mismatch, "{:?}", base.squares);
    }

    #[test]
    fn a_shaft_that_twists_on_through_a_gap_is_fitted_behind_it() {
        let manoeuvre = speeds(1.2, &[(0.1, 90.0), (0.4, -80.0), (0.7, 90.0), (1.0, -60.0)]);
        let parameters = [("inertia_ratio", 0.4), ("f_antires", 25.0), ("zeta", 0.02)];
        let parameters = parameters.map(|(name, value)| (name.to_string(), value)).into();
        let setup =
            setup(manoeuvre, vec![Choice { effect: "two_mass_shaft".into(), parameters, definition: None }]);
        let whole = simulate(&setup, &Silent).unwrap().recording;
        let in_gap = |t: f64| (0.43..0.47).contains(&t) || (0.75..0.81).contains(&t);
        let logged = |x: &[f64]| -> Vec<f64> {
            whole.t().iter().zip(x).filter(|(t, _)| !in_gap(**t)).map(|(_, x)| *x).collect()
        };
        let names = ["t", "v_d", "v_q", "i_a", "i_b", "i_c", "theta_e", "omega_e"];
        let columns = names.iter().filter_map(|name| Some((name.to_string(), logged(whole.column(name)?))));
        let recording = Recording::new(columns.collect(), None).unwrap();
        let mut data = prepared(&recording, &setup);
        let base = baseline::fit(&mut data, &Silent).unwrap();
        let shaft = fitted(&data, &base, EffectId::TwoMassShaft);
        assert_eq!(shaft.nuisances[0].initial, 6);
        let square = shaft.square(Channel::OmegaE);
        assert!(base.square(Channel::OmegaE) > 10.0 && (square - 1.0).abs() < 0.1, "{square}");
        // As if the shaft had settled behind each gap, the same model leaves far more than noise.
        let count = shaft.own().len();
        let mut settled = shaft.parameters.clone();
        settled[count + 2..].fill(0.0);
        let settled = Hypothesis::on(&data, shaft.model, settled, shaft.free, shaft.nuisances);
        assert!(settled.square(Channel::OmegaE) > 1.0 + data.options.mismatch, "{:?}", settled.squares);
    }

    #[test]
    fn a_measured_load_that_jumps_between_two_rows_is_no_mismatch() {
        let mut manoeuvre = speeds(1.0, &[(0.1, 80.0), (0.5, -60.0), (0.9, 90.0)]);
        // In the middle between two samples, where the trapezoid of the samples is most wrong one way or the other.
        let steps = vec![(0.0, 0.0), (0.31002, 14.0), (0.62018, -10.0)];
        manoeuvre.tau_load = Some(Schedule::new(steps, Shape::Steps).unwrap());
        manoeuvre.load_kind = Some("measured".into());
        let mut setup = setup(manoeuvre, Vec::new());
        setup.drive.sensors.noise_tau = 0.01;
        let (data, base) = data(&setup);
        assert!(data.windows.len() > 4, "{:?}", data.windows);
        assert!(largest_excess(&base) < data.options.mismatch, "{:?}", base.squares);
        // In windows over the jumps the same model leaves far more than noise.
        let mut whole = data.clone();
        whole.windows = vec![0..1250, 1250..2500, 2500..3750, 3750..data.signals.len()];
        let over = fitting::refit(&whole, &base, &Silent).unwrap();
        assert!(over.square(Channel::OmegaE) > 1.5, "{:?}", over.squares);
    }
}
