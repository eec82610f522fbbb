//! The baseline: the dq-model without effects, fitted to a recording. It gives the noise floors, and shows whether the recording determines
//! the machine's parameters.

use super::adequacy;
use super::coverage;
use super::data::Data;
use super::fitting;
use super::hypothesis::Hypothesis;
use crate::error::Result;
use crate::machine::BaseParameter;
use crate::model::Model;
use crate::monitor::Monitor;
use crate::optimise::least_squares;
use crate::signals::Finding;

/// Most rounds in which the dq-model and the noise of its voltages are estimated in turn.
const SETTLING: usize = 5;
/// Change of the inductances (ln) since the noise was estimated below which the rounds end.
const AWAY: f64 = 0.005;
/// Factors from one unit to another.
const PREFIXES: [f64; 2] = [1e-3, 1e3];
/// Signals must exceed their noise by this factor for anything to be said.
const LEAST_SIGNAL: f64 = 5.0;
/// Change of the residual, in units of the noise, that an electrical base parameter must cause as a whole to matter: three times the noise.
const MATTERS: f64 = 3.0;
/// Relative standard error of an electrical base parameter, from the sensors' noise alone, from which the recording is
/// called poor.
const POOR: f64 = 0.01;

/// Fits the dq-model and settles the noise floors with its help.
pub fn fit(data: &mut Data, monitor: &dyn Monitor) -> Result<Hypothesis> {
    let model = Model::new(data.signals.context, &[]);
    let mut found = fitting::fit(data, &model, &data.start, false, monitor)?;
    if data.has_electrical() && !adequacy::explains_half(data, &found, true) {
        // In a log of another unit the parameters are off by its factor, and the nameplate is no prior for them.
        let open = data.clone().without_prior();
        for scale in PREFIXES {
            let mut start = data.start;
            BaseParameter::ELECTRICAL.iter().for_each(|p| start[p.index()] *= scale);
            let away = fitting::fit(&open, &model, &start, false, monitor)?;
            if cost(data, &away) < cost(data, &found) {
                found = away;
                data.prior.clear();
                data.parts.iter_mut().for_each(|part| part.prior.clear());
            }
        }
    }
    for _ in 0..SETTLING {
        monitor.go_on()?;
        data.settle_floors(&found);
        found = fitting::on_from(data, &found, monitor)?;
        if data.away(&found) < AWAY {
            break;
        }
    }
    Ok(found)
}

/// Sum of squares of the electrical residual and of the deviations from the prior.
fn cost(data: &Data, found: &Hypothesis) -> f64 {
    let known: f64 = data.prior.iter().map(|prior| prior.off(found.parameters[prior.index]).0.powi(2)).sum();
    let own = found.squares.iter().filter(|(channel, _)| channel.is_electrical());
    let cost = own.map(|(_, square)| square).sum::<f64>() * data.counted() as f64 + known;
    // A fit that diverged costs all.
    if cost.is_finite() { cost } else { f64::INFINITY }
}

/// A finding if currents, voltages or speed hardly leave their noise in any recording.
pub fn silent(data: &Data) -> Option<Finding> {
    (!data.runs().iter().any(is_alive)).then(|| Finding {
        finding: "no recorded signal exceeds its own noise".into(),
        consequence: "nothing can be said about the machine".into(),
        fix: "record a manoeuvre: reversals, two levels of i_q, steps of i_d".into(),
    })
}

/// A finding if the residual of the fitted dq-model is not finite.
pub fn diverged(base: &Hypothesis) -> Option<Finding> {
    let (channel, _) = base.squares.iter().find(|(_, square)| !square.is_finite())?;
    Some(Finding {
        finding: format!("no dq-model was found whose {} stays finite on this recording", channel.name()),
        consequence: "nothing can be said about the machine".into(),
        fix: "give r_s, l_d, l_q and psi_m on the nameplate, and check units and signs of voltages, currents, speed and angle".into(),
    })
}

fn is_alive(data: &Data) -> bool {
    let spread = |x: &[f64]| {
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        let square = x.iter().map(|v| v * v).sum::<f64>() / x.len() as f64;
        square.sqrt().max((square - mean * mean).max(0.0).sqrt())
    };
    let model = Model::new(data.signals.context, &[]);
    let hypothesis = Hypothesis::unfitted(model, data.start.to_vec());
    let experiment = data.whole(&hypothesis);
    data.floors.iter().any(|f| spread(&experiment.measured(f.channel)) > LEAST_SIGNAL * f.sensor)
}

/// Electrical base parameters that the recording does not determine although its equations contain them.
pub fn weak_parameters(data: &Data, base: &Hypothesis) -> Vec<String> {
    let experiment = data.whole(base);
    let free: Vec<usize> =
        base.free.iter().copied().filter(|k| *k < BaseParameter::ELECTRICAL.len()).collect();
    if free.is_empty() || !data.has_electrical() {
        return Vec::new();
    }
    let linear = experiment.linearise(&base.parameters, &free);
    let information = linear.jacobian.tr_mul(&linear.jacobian);
    let covariance = least_squares::covariance(&information, None, &vec![true; free.len()]);
    let names = BaseParameter::ALL;
    free.iter()
        .enumerate()
        .filter(|(column, index)| {
            let value = base.parameters[**index].abs();
            // A parameter that changes nothing at all (a magnet at standstill) is no lack of the manoeuvre.
            let matters = linear.jacobian.column(*column).norm() * value > MATTERS;
            matters && covariance[(*column, *column)].sqrt() > POOR * value
        })
        .map(|(_, index)| names[*index].name().to_string())
        .collect()
}

/// Whether effects are hard to tell apart on this recording, which does not determine the parameters `weak`. Only one effect is then looked
/// for. A grid of operating points is not poor for want of r_s: its voltage drop may be small there, or subtracted.
pub fn is_poor(data: &Data, weak: &[String]) -> bool {
    let small = |name: &String| data.is_steady() && name == BaseParameter::RS.name();
    !weak.iter().all(small) || coverage::stays_at_one_point(&data.signals)
}

#[cfg(test)]
mod tests {
    use super::super::testing::{self, choice, prepared, setup, speeds};
    use super::super::verdict;
    use super::*;
    use crate::drive::{Schedule, Setup, Shape, simulate};
    use crate::experiment::Channel;
    use crate::machine::Machine;
    use crate::monitor::Silent;
    use crate::noise::whitening::{Bench, Whitening};
    use crate::numerics::random::normal_pair;
    use crate::recording::Recording;
    use crate::signals::Signals;

    /// A quarter of a per cent of the link voltage, V.
    const NOISE: f64 = 1.4;

    /// A recording whose logged voltages carry that noise.
    fn with_noisy_voltages(setup: &Setup) -> Data {
        let recording = simulate(setup, &Silent).unwrap().recording;
        let mut signals = Signals::new(&recording, &setup.nameplate).unwrap();
        let noise = |k: usize| normal_pair(3, [k as u32, 0, 0, 0]);
        let [v_d, v_q] = signals.v.as_mut().unwrap();
        for k in 0..v_d.len() {
            v_d[k] += NOISE * noise(k).0;
            v_q[k] += NOISE * noise(k).1;
        }
        Data::new(signals, &setup.nameplate, &Default::default()).unwrap()
    }

    #[test]
    fn noise_of_the_voltages_does_not_bias_the_inductances() {
        // With it plain least squares make l_q a tenth too large.
        let mut manoeuvre = speeds(1.1, &[(0.1, 80.0), (0.5, -60.0), (0.9, 90.0)]);
        let steps = (0..10).map(|k| (0.1 * f64::from(k), [-4.0, 3.0][k as usize % 2])).collect();
        manoeuvre.i_d = Some(Schedule::new(steps, Shape::Steps).unwrap());
        let setup = setup(manoeuvre, Vec::new());
        let mut data = with_noisy_voltages(&setup);
        let base = fit(&mut data, &Silent).unwrap();
        assert!((data.input.voltage / NOISE - 1.0).abs() < 0.05, "{}", data.input.voltage);
        for l in [BaseParameter::LD, BaseParameter::LQ] {
            let ratio = base.own()[l.index()] / setup.nameplate.get(l).unwrap();
            assert!((ratio - 1.0).abs() < 0.05, "{} {ratio}", l.name());
        }
        assert!(verdict::largest_excess(&base) < data.options.mismatch);
    }

    #[test]
    fn friction_that_is_missing_does_not_bend_a_flux_that_noisy_voltages_show() {
        // Under a constant load a flux that is 1 % too large stands in for friction of 1 % of the load.
        let path = [(0.1, 20.0), (0.6, 110.0), (1.0, 110.0), (1.5, -90.0), (2.0, -20.0)];
        let mut manoeuvre = speeds(2.0, &path);
        manoeuvre.tau_load = Some(Schedule::constant(3.0).unwrap());
        manoeuvre.load_kind = Some("known_constant".into());
        let setup = setup(manoeuvre, vec![choice("asymmetric_friction", "tau_a", 0.03)]);
        let mut data = with_noisy_voltages(&setup);
        let base = fit(&mut data, &Silent).unwrap();
        assert!((data.input.voltage / NOISE - 1.0).abs() < 0.1, "{}", data.input.voltage);
        assert!(base.square(Channel::OmegaE) > 4.0, "the motion lacks its friction");
        let ratio = base.own()[BaseParameter::PsiM.index()] / setup.machine.get(BaseParameter::PsiM).unwrap();
        assert!((ratio - 1.0).abs() < 1e-3, "{ratio}");
    }

    #[test]
    fn the_noise_of_a_torque_sensor_is_no_mismatch() {
        let mut manoeuvre = speeds(1.1, &[(0.1, 80.0), (0.5, -60.0), (0.9, 90.0)]);
        manoeuvre.tau_load = Some(Schedule::new(vec![(0.0, 0.5)], Shape::Steps).unwrap());
        manoeuvre.load_kind = Some("measured".into());
        let setup = setup(manoeuvre, Vec::new());
        let recording = simulate(&setup, &Silent).unwrap().recording;
        let mut signals = Signals::new(&recording, &setup.nameplate).unwrap();
        for (k, load) in signals.tau_m.as_mut().unwrap().iter_mut().enumerate() {
            *load += 0.2 * normal_pair(7, [k as u32, 0, 0, 0]).0;
        }
        let mut data = Data::new(signals, &setup.nameplate, &Default::default()).unwrap();
        let base = fit(&mut data, &Silent).unwrap();
        let speed = data.floors.iter().find(|f| f.channel == Channel::OmegaE).unwrap();
        assert!(speed.driven > 0.5 * speed.sensor, "{speed:?}");
        let square = base.square(speed.channel);
        assert!((square - 1.0).abs() < data.options.mismatch, "{square}");
    }

    #[test]
    fn currents_that_a_noisy_speed_lets_wander_may_lie_above_their_floor_by_chance_unless_that_is_taken_out()
    {
        let fitted = |noise: f64, gap: bool| {
            let mut manoeuvre = speeds(1.0, &[(0.1, 80.0), (0.5, -60.0), (0.9, 70.0)]);
            manoeuvre.tau_load = Some(Schedule::constant(6.0).unwrap());
            let mut setup = setup(manoeuvre, Vec::new());
            setup.drive.sensors.noise_omega_e = noise;
            let recording = simulate(&setup, &Silent).unwrap().recording;
            let logged = |k: usize| !(gap && (1000..1200).contains(&k));
            let columns = recording.names().into_iter().map(|name| {
                let x = recording.column(name).unwrap();
                (name.to_string(), (0..x.len()).filter(|k| logged(*k)).map(|k| x[k]).collect())
            });
            let recording = Recording::new(columns.collect(), Some(recording.load())).unwrap();
            let mut data = prepared(&recording, &setup);
            let base = fit(&mut data, &Silent).unwrap();
            let current = *data.floors.iter().find(|f| f.channel == Channel::ID).unwrap();
            (current, base.square(Channel::ID), data.whitening.is_some_and(|w| w.wanders()))
        };
        let (quiet, ..) = fitted(0.03, false);
        assert_eq!(quiet.chance(), 0.0);
        let (loud, square, whitened) = fitted(0.5, false);
        assert!(loud.driven > 0.2 * loud.sensor && loud.chance() > 0.0 && !whitened, "{loud:?}");
        assert!((square - 1.0).abs() < loud.chance() + 0.05, "{square} {loud:?}");
        let (behind, square, whitened) = fitted(0.5, true);
        assert!(whitened && behind.chance() == 0.0 && (square - 1.0).abs() < 0.1, "{square} {behind:?}");
        // Nothing is hidden under more noise than there is.
        let (_, square, _) = fitted(4.0, true);
        assert!(square > 0.95, "{square}");
    }

    #[test]
    fn a_speed_that_noisy_currents_let_wander_is_no_mismatch_but_weak_friction_under_it_is() {
        let fitted = |effects| {
            let path: Vec<(f64, f64)> =
                (0..8).map(|k| (0.1 + 0.25 * f64::from(k), [90.0, -70.0][k as usize % 2])).collect();
            let mut setup = setup(speeds(2.0, &path), effects);
            setup.drive.sensors.noise_i = 0.3;
            let recording = simulate(&setup, &Silent).unwrap().recording;
            let mut data = prepared(&recording, &setup);
            let base = fit(&mut data, &Silent).unwrap();
            (data, base)
        };
        let (data, base) = fitted(Vec::new());
        let speed = data.floors.iter().find(|f| f.channel == Channel::OmegaE).unwrap();
        assert!(speed.wander.is_some() && speed.chance() == 0.0, "{speed:?}");
        let square = base.square(Channel::OmegaE);
        assert!((square - 1.0).abs() < 0.5 * data.options.mismatch, "{square}");

        let (data, base) = fitted(vec![choice("coulomb_friction", "tau_c", 0.08)]);
        assert!(verdict::largest_excess(&base) > data.options.mismatch, "{:?}", base.squares);
        // What is told of the residual is how large it is, not what the filter leaves of it.
        let experiment = data.whole(&base).plain();
        let plain = experiment.relative_rms(&experiment.residual(&base.parameters));
        assert!(plain[2] > 1.3 && plain[2].powi(2) != base.square(Channel::OmegaE), "{plain:?}");
    }

    #[test]
    fn the_nameplate_holds_what_is_hardly_shown_and_leaves_alone_what_is_shown_well() {
        let fitted = |points: &[(f64, f64)], j: Option<f64>| {
            let mut setup = setup(speeds(1.0, points), Vec::new());
            let off = |machine: Machine, p: BaseParameter, share: f64| {
                let value = share * machine.get(p).unwrap();
                machine.with(p, value).unwrap()
            };
            let plate = off(off(setup.nameplate.clone(), BaseParameter::PsiM, 1.2), BaseParameter::J, 0.8);
            let recording = simulate(&setup, &Silent).unwrap().recording;
            setup.nameplate = plate;
            setup.nameplate.base[BaseParameter::J.index()] =
                j.map(|share| share * setup.machine.get(BaseParameter::J).unwrap());
            let mut data = prepared(&recording, &setup);
            let base = fit(&mut data, &Silent).unwrap();
            BaseParameter::ALL.map(|p| base.own()[p.index()] / setup.machine.get(p).unwrap())
        };
        let shown = [(0.1, 80.0), (0.4, -60.0), (0.8, 90.0)];
        for j in [Some(0.8), None] {
            let found = fitted(&shown, j);
            assert!((found[3] - 1.0).abs() < 2e-3 && (found[4] - 1.0).abs() < 0.02, "{found:?}");
        }
        // One speed shows no inertia: it stays within a factor of three of the nameplate, whatever noise says of it.
        let steady = fitted(&[(0.0, 60.0)], Some(0.8));
        assert!((0.8 / 3.0..0.8 * 3.0).contains(&steady[4]), "{steady:?}");
        let open = fitted(&[(0.0, 60.0)], None);
        assert!((0.01..100.0).contains(&open[4]), "{open:?}");
    }

    #[test]
    fn derivatives_follow_the_filter_that_whitens() {
        let setup = setup(speeds(0.6, &[(0.1, 80.0), (0.5, -60.0)]), Vec::new());
        let (mut data, base) = testing::data(&setup);
        data.input.voltage = 6.0;
        let l = [BaseParameter::LD, BaseParameter::LQ].map(|l| base.own()[l.index()]);
        let (r_s, psi_m, input) = (base.own()[0], base.own()[3], data.input.clone());
        let bench = Bench { r_s, psi_m, sensor: [0.05; 2], speed: 0.0, input };
        data.whitening = Some(Whitening::new(&data.signals, l, bench));
        let experiment = data.whole(&base);
        let free = [BaseParameter::LD.index(), BaseParameter::LQ.index()];
        let linear = experiment.linearise(&base.parameters, &free);
        for (column, index) in free.into_iter().enumerate() {
            let at = |x: f64| {
                let mut p = base.parameters.clone();
                p[index] *= x;
                experiment.residual(&p)
            };
            let step = 1e-4;
            let secant = (at(1.0 + step) - at(1.0 - step)) / (2.0 * step * base.parameters[index]);
            let off = (&secant - linear.jacobian.column(column)).norm() / secant.norm();
            assert!(off < 0.01, "{index}: {off}");
        }
    }
}
