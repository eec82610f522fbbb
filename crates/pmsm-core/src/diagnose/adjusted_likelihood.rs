//! Evidence for one effect of a set that leaves more than noise.
//!
//! There the residual is no white noise, so the likelihood of one set over another is too sure. Divided by the factor by which the colour of
//! the residual widens the variance of the effect's parameters it holds again: Kent, "Robust properties of likelihood ratio tests",
//! Biometrika 69 (1982) 19; Rotnitzky & Jewell, Biometrika 77 (1990) 485. The form of an equation widens it once more, as it widens intervals.

use super::data::Data;
use super::evidence::price;
use super::fitting;
use super::hypothesis::Hypothesis;
use super::outputs::FORM;
use super::select::reduced;
use crate::effect::Role;
use crate::effects::EffectId;
use crate::error::Result;
use crate::model::Slot;
use crate::monitor::Monitor;
use crate::optimise::uncertainty::{Spread, spread};

/// A set with the covariance of its parameters, as they would be with white residuals and as they are.
pub struct AdjustedLikelihood<'a> {
    data: &'a Data,
    set: &'a Hypothesis,
    sides: Vec<Side>,
}

/// The channels of the voltage equations or of the motion, with the parameters that are fitted to them: what remains in one says nothing of
/// the other.
struct Side {
    electrical: bool,
    free: Vec<usize>,
    spread: Spread,
}

impl<'a> AdjustedLikelihood<'a> {
    pub fn new(data: &'a Data, set: &'a Hypothesis) -> Self {
        let (experiment, n) = (data.whole(set), data.signals.len());
        let linear = experiment.linearise(&set.parameters, &set.free);
        let channels = experiment.channels();
        let side = |electrical: bool| -> Option<Side> {
            let held: Vec<usize> =
                (0..channels.len()).filter(|c| channels[*c].is_electrical() == electrical).collect();
            let rows: Vec<usize> = held.into_iter().flat_map(|c| c * n..(c + 1) * n).collect();
            let own =
                |k: &usize| !data.has_electrical() || experiment.is_electrical(set.free[*k]) == electrical;
            let places: Vec<usize> = (0..set.free.len()).filter(own).collect();
            if rows.is_empty() || places.is_empty() {
                return None;
            }
            let jacobian = linear.jacobian.select_columns(&places).select_rows(&rows);
            let spread = spread(&jacobian, &linear.residual.select_rows(&rows), n);
            Some(Side { electrical, free: places.into_iter().map(|k| set.free[k]).collect(), spread })
        };
        Self { data, set, sides: [true, false].into_iter().filter_map(side).collect() }
    }

    /// What each effect is worth against its absence, nats: infinite where its strengths exceed their errors so far that no fit is needed, or
    /// where the recording does not tell the errors.
    ///
    /// # Errors
    /// Those of the least-squares fits.
    pub fn of_effects(&self, monitor: &dyn Monitor) -> Result<Vec<(EffectId, f64)>> {
        let nats = |slot: &Slot| {
            monitor.go_on()?;
            Ok((slot.effect, self.of(slot, monitor)?.unwrap_or(f64::INFINITY)))
        };
        self.set.model.slots().iter().map(nats).collect()
    }

    fn of(&self, slot: &Slot, monitor: &dyn Monitor) -> Result<Option<f64>> {
        let (data, options) = (self.data, &self.data.options);
        let has = |side: &&Side| slot.parameters.clone().any(|k| side.free.contains(&k));
        let Some(side) = self.sides.iter().find(has) else { return Ok(None) };
        let place = |k: usize| side.free.iter().position(|free| *free == k);
        let role = |k: usize| slot.effect.info().parameters[k - slot.parameters.start].role;
        let fitted: Vec<usize> = slot.parameters.clone().filter_map(place).collect();
        let Some(wider) = side.spread.widened(&fitted).map(|wider| wider * FORM * FORM) else {
            return Ok(None);
        };
        let samples = data.counted() as f64 / options.rows_per_sample;
        let cost = options.effect_cost + price(&[samples], options) * fitted.len() as f64;
        let strengths: Vec<(usize, f64)> = slot
            .parameters
            .clone()
            .filter(|k| role(*k) == Role::Amplitude)
            .filter_map(|k| Some((place(k)?, self.set.parameters[k])))
            .collect();
        if side.spread.square(&strengths).is_some_and(|square| 0.5 * square / (FORM * FORM) > cost) {
            return Ok(None);
        }
        let (model, start) = reduced(self.set, slot.effect);
        let without = fitting::fit(data, &model, &start, false, monitor)?;
        let sum = |set: &Hypothesis| self.sum_of_squares(set, side.electrical);
        Ok(Some(0.5 * (sum(&without) - sum(self.set)) / wider - cost))
    }

    /// Sum over the rows of the `electrical` channels, or of the motion, of the squares of the residual over the noise.
    fn sum_of_squares(&self, set: &Hypothesis, electrical: bool) -> f64 {
        let rows = self.data.runs().iter().flat_map(|run| run.floors.iter().map(|_| run.counted() as f64));
        let own =
            set.squares.iter().zip(rows).filter(|((channel, _), _)| channel.is_electrical() == electrical);
        own.map(|((_, square), rows)| square * rows).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{choice, data, fitted, setup, speeds};
    use crate::model::Model;
    use crate::monitor::Silent;

    #[test]
    fn beside_a_remainder_a_small_gain_is_chance_and_friction_is_not() {
        // A swing of the load that no set holds.
        let manoeuvre =
            speeds(2.4, &[(0.1, 90.0), (0.4, -80.0), (0.8, 60.0), (1.2, -90.0), (1.6, 80.0), (2.0, -50.0)]);
        let effects = vec![choice("time_varying_load", "a", 0.05), choice("coulomb_friction", "tau_c", 0.3)];
        let (data, base) = data(&setup(manoeuvre, effects));
        let of = |effects: &[EffectId]| {
            let typical = effects.iter().flat_map(|e| e.info().parameters);
            let start = typical.map(|p| (p.typical)(&data.signals.context));
            let start: Vec<f64> = base.own().iter().copied().chain(start).collect();
            let model = Model::new(data.signals.context, effects);
            fitting::fit(&data, &model, &start, false, &Silent).unwrap()
        };
        let (friction, other) = (EffectId::CoulombFriction, EffectId::AsymmetricFriction);
        let set = of(&[friction, other]);
        let likelihood = AdjustedLikelihood::new(&data, &set);
        let worth = likelihood.of_effects(&Silent).unwrap();
        assert_eq!(worth[0].0, friction);
        assert!(worth[0].1 > 3.0 && worth[1].1 < 0.0, "{worth:?}");
        // The likelihood alone takes the other one for shown.
        let sum = |set: &Hypothesis| likelihood.sum_of_squares(set, false);
        let gain = sum(&of(&[friction])) - sum(&set);
        assert!(0.5 * gain > 10.0, "{gain} {worth:?}");
    }

    #[test]
    fn what_remains_of_the_motion_says_nothing_of_an_effect_in_the_currents() {
        let manoeuvre = speeds(1.2, &[(0.1, 90.0), (0.4, -80.0), (0.8, 60.0)]);
        let worth = |swing: f64| {
            let effects = vec![choice("time_varying_load", "a", swing), choice("dead_time", "v_err", 2.0)];
            let (data, base) = data(&setup(manoeuvre.clone(), effects));
            let set = fitted(&data, &base, EffectId::DeadTime);
            let likelihood = AdjustedLikelihood::new(&data, &set);
            let [slot] = set.model.slots() else { panic!("one effect") };
            let side = likelihood.sides.iter().find(|side| side.electrical).unwrap();
            let strength = side.free.iter().position(|k| *k == slot.parameters.start).unwrap();
            assert!(likelihood.of_effects(&Silent).unwrap()[0].1 > 3.0);
            side.spread.widened(&[strength]).unwrap()
        };
        let (still, swings) = (worth(0.0), worth(0.5));
        assert!(swings < 2.0 * still, "{still} {swings}");
    }
}
