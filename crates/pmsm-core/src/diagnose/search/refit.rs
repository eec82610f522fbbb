//! One more effect refitted beside a set, from where the score sees it.

use super::Search;
use super::sets::explained;
use crate::diagnose::data::Data;
use crate::diagnose::fitting;
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::scale;
use crate::diagnose::shortlist::Prospect;
use crate::diagnose::verdict::{Judged, MISMATCH};
use crate::effect::{Parameter, Role, Site};
use crate::effects::EffectId;
use crate::error::Result;
use crate::model::Model;
use crate::monitor::Monitor;

/// A fit that takes away less than this share of what its score promised, if it promised something, is tried once more: with the shapes
/// held until the rest has settled, and then from this share of the strength.
const KEPT_PROMISE: f64 = 0.5;
const LEAST_PROMISE: f64 = 0.02;
const FAINTER: f64 = 0.1;

/// What a refit has to come up to.
#[derive(Clone, Copy)]
pub(super) enum Claim<'a> {
    /// Nothing.
    Open,
    /// Not to lose against this set, whatever it does elsewhere.
    Beside(&'a Judged),
    /// The same where this set explains the recordings and promised more than twice as much.
    Outdone(&'a Judged),
}

impl Claim<'_> {
    /// Whether what a fit leaves in its channels, of the currents alone where only they are final, costs the claim.
    fn lost(self, fitted: &Hypothesis, currents: bool) -> bool {
        match self {
            Self::Open => false,
            Self::Beside(best) | Self::Outdone(best) => scale::loses(fitted, currents, best),
        }
    }
}

impl Search<'_> {
    /// Whether `effect` beside `parent` cannot come up to the claim: what moves the rotor leaves the currents as they are, unless both
    /// are fitted at once.
    pub(super) fn out_of_question(&self, parent: &Judged, effect: EffectId, claim: Claim) -> bool {
        let apart = !fitting::together(self.data, &parent.fitted.model);
        effect.info().site == Site::Mechanical && apart && claim.lost(&parent.fitted, true)
    }

    /// The set of `parent` with one effect more, judged on all recordings; nothing where the effect vanishes, or does not come up to
    /// the `claim`.
    pub(super) fn refit(&self, parent: &Judged, prospect: &Prospect, claim: Claim) -> Result<Option<Judged>> {
        if self.out_of_question(parent, prospect.effect, claim) {
            return Ok(None);
        }
        let thorough = parent.excess() > MISMATCH && !matches!(claim, Claim::Outdone(_));
        let fitted = beside(self.data, &parent.fitted, prospect, thorough, self.monitor)?;
        if claim.lost(&fitted, false) || fitted.vanishes(prospect.effect) {
            return Ok(None);
        }
        self.judge(fitted).map(Some)
    }
}

/// `parent` with one effect more, fitted to `data`; what falls short of its promise is fitted from other starts if `thorough`.
///
/// A score lets the parameters of the parent give way to the effect, while a fit starts from them as they are, and to first order a
/// strength may come out far too large where shapes matter: either may lead a shape astray.
fn beside(
    data: &Data,
    parent: &Hypothesis,
    prospect: &Prospect,
    thorough: bool,
    monitor: &dyn Monitor,
) -> Result<Hypothesis> {
    let mut effects = parent.effects();
    effects.push(prospect.effect);
    let model = Model::new(*parent.model.context(), &effects);
    let parameters = prospect.effect.info().parameters;
    let first = model.parameter_count() - parameters.len();
    let electrical_done = prospect.effect.info().site == Site::Mechanical;
    let start = |own: &[f64]| [parent.own(), own].concat();
    let mut best = fitting::fit(data, &model, &start(&prospect.start), electrical_done, monitor)?;

    let shapes: Vec<usize> =
        (0..parameters.len()).filter(|k| parameters[*k].role == Role::Shape).map(|k| first + k).collect();
    let hopeful = thorough && prospect.score > LEAST_PROMISE && !shapes.is_empty();
    let broken = |fitted: &Hypothesis| {
        hopeful && explained(parent, fitted) < KEPT_PROMISE * prospect.score && !monitor.cancelled()
    };
    let better =
        |a: Hypothesis, b: Hypothesis| if explained(parent, &b) > explained(parent, &a) { b } else { a };
    if broken(&best) {
        let start = start(&prospect.start);
        let held = fitting::fit_holding_first(&shapes, data, &model, &start, electrical_done, monitor)?;
        best = better(best, held);
    }
    if broken(&best) {
        let strength = |p: &Parameter| if p.role == Role::Amplitude { FAINTER } else { 1.0 };
        let fainter: Vec<f64> = prospect.start.iter().zip(parameters).map(|(x, p)| x * strength(p)).collect();
        best = better(best, fitting::fit(data, &model, &start(&fainter), electrical_done, monitor)?);
    }
    Ok(best)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::shortlist::Scorer;
    use crate::diagnose::testing::{data, setup, speeds};
    use crate::drive::{Choice, Schedule};
    use crate::effects::EffectId;
    use crate::monitor::Silent;

    #[test]
    fn a_promise_is_kept_from_a_start_that_leads_astray() {
        // Two swings of a faint load beside a large one that is unknown.
        let mut manoeuvre = speeds(0.4, &[(0.05, 90.0), (0.2, -80.0), (0.35, 60.0)]);
        manoeuvre.tau_load = Some(Schedule::constant(-4.0).unwrap());
        manoeuvre.load_kind = Some("unknown_constant".into());
        let parameters = [("a", 0.03), ("b", -0.02), ("f", 4.8)].map(|(name, x)| (name.to_string(), x));
        let swing = Choice { effect: "time_varying_load".into(), parameters: parameters.into() };
        let (data, base) = data(&setup(manoeuvre, vec![swing]));
        let seen = Scorer::new(&data, &base).score(EffectId::TimeVaryingLoad);
        assert!((seen.start[3] / 4.8 - 1.0).abs() < 0.1, "{:?}", seen.start);
        // A swing of the load that is as large as the load itself is not found from everywhere.
        let mut far = seen.clone();
        (far.start[0], far.start[1]) = (4.0, 4.0);
        for prospect in [seen, far] {
            let fitted = beside(&data, &base, &prospect, true, &Silent).unwrap();
            let (explained, f) = (explained(&base, &fitted), fitted.own()[fitted.own().len() - 1]);
            assert!(explained > 0.95 * prospect.score && (f / 4.8 - 1.0).abs() < 0.03, "{explained}, {f} Hz");
        }
    }
}
