//! One more effect refitted beside a set, from where the score sees it.

use super::Search;
use super::sets::{
    explained, far_behind, hopeless_currents, least_beside, moves_as_measured, spares_currents,
};
use crate::diagnose::data::Data;
use crate::diagnose::fitting::{self, Currents};
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
/// held until the rest has settled, and then from this share of the strength. Beside other effects what scores too little to be worth a fit
/// promises nothing.
const KEPT_PROMISE: f64 = 0.5;
const LEAST_PROMISE: f64 = 0.02;
const FAINTER: f64 = 0.1;
/// Two fits whose parameters of the effect differ by no more than this share have come to the same place.
const ALIKE: f64 = 0.01;

/// What a refit has to come up to.
#[derive(Clone, Copy)]
pub(super) enum Claim<'a> {
    /// Nothing.
    Open,
    /// Not to lose against this set, whatever it does elsewhere.
    Beside(&'a Judged),
    /// The same where this set explains the recordings and promised more than twice as much.
    Outdone(&'a Judged),
    /// Not to leave so much more in the currents than this set that no larger one is grown from it.
    Behind(&'a Judged),
}

impl Claim<'_> {
    /// Whether what a fit leaves in its channels, of the currents alone where only they are final, costs the claim.
    fn lost(self, fitted: &Hypothesis, currents: bool) -> bool {
        match self {
            Self::Open => false,
            Self::Beside(best) | Self::Outdone(best) => scale::loses(fitted, currents, best),
            Self::Behind(best) => hopeless_currents(fitted, best),
        }
    }
}

/// What a refit has to do for it to be gone on with.
#[derive(Clone, Copy)]
struct Bar<'a> {
    /// What it has to come up to.
    claim: Claim<'a>,
    /// The set from whose currents it must take something away: one that leaves them alone, and whose motion is explained, has nothing else.
    beside: Option<&'a Hypothesis>,
}

impl Bar<'_> {
    /// Whether what a fit leaves in its channels, of the currents alone where only they are final, is not enough.
    fn missed(self, fitted: &Hypothesis, currents: bool) -> bool {
        self.claim.lost(fitted, currents) || self.beside.is_some_and(|parent| spares_currents(fitted, parent))
    }

    fn is_none(self) -> bool {
        matches!(self.claim, Claim::Open) && self.beside.is_none()
    }
}

impl Search<'_> {
    /// Whether nothing that moves the rotor can bring `parent` up to the claim: it takes nothing away from what the currents leave, at least
    /// in a fit to them alone.
    ///
    /// # Errors
    /// Those of the least-squares fit.
    pub(super) fn rotor_is_lost(&self, parent: &Judged, claim: Claim) -> Result<bool> {
        let fitted = &parent.fitted;
        if matches!(claim, Claim::Open) {
            return Ok(false);
        }
        if self.data.has(true) && fitting::together(self.data, &fitted.model) {
            let alone = fitting::currents_alone(self.data, fitted, self.monitor)?;
            return Ok(claim.lost(&alone, true));
        }
        Ok(claim.lost(fitted, true))
    }

    /// Whether nothing that moves the rotor need be tried beside `parent` yet: `ahead` explains the motion, and `parent` leaves far more of the
    /// currents, which no such effect changes. What moves the rotor all the same shows beside `ahead`.
    pub(super) fn rotor_waits(&self, parent: &Judged, ahead: &Judged) -> bool {
        let both = self.data.has(true) && fitting::together(self.data, &parent.fitted.model);
        !both && moves_as_measured(ahead) && far_behind(&parent.fitted, ahead)
    }

    /// The part of a [`Search::refit`] that no claim decides about: where its first fit to the currents leads, if it has one.
    pub(super) fn begin(&self, parent: &Judged, prospect: &Prospect) -> Result<Option<Vec<f64>>> {
        if prospect.effect.info().site == Site::Mechanical || !self.data.has(true) {
            return Ok(None);
        }
        let model = with(&parent.fitted, prospect.effect);
        let start = [parent.fitted.own(), &prospect.start].concat();
        fitting::to_currents(self.data, &model, &start, &[], self.monitor).map(Some)
    }

    /// The set of `parent` with one effect more, judged on all recordings; nothing where the effect vanishes, or does not come up to
    /// the `claim`. It may have `begun`.
    pub(super) fn refit(
        &self,
        parent: &Judged,
        prospect: &Prospect,
        begun: Option<&[f64]>,
        claim: Claim,
    ) -> Result<Option<Judged>> {
        let promises = prospect.score > LEAST_PROMISE.max(least_beside(parent));
        let thorough = promises && parent.excess() > MISMATCH && !matches!(claim, Claim::Outdone(_));
        let moves = prospect.effect.info().site == Site::Mechanical;
        let grown = !parent.fitted.effects().is_empty() && self.data.has(true);
        let explained = grown && !moves && moves_as_measured(parent);
        let bar = Bar { claim, beside: explained.then_some(&parent.fitted) };
        let fitted = beside(self.data, &parent.fitted, prospect, begun, (thorough, bar), self.monitor)?;
        if bar.missed(&fitted, false) || fitted.vanishes(prospect.effect) {
            return Ok(None);
        }
        self.judge(fitted).map(Some)
    }
}

/// The model of `parent` with one effect more.
fn with(parent: &Hypothesis, effect: EffectId) -> Model {
    let mut effects = parent.effects();
    effects.push(effect);
    Model::new(*parent.model.context(), &effects)
}

/// `parent` with one effect more, fitted to `data`; what falls short of its promise is fitted from other starts if `thorough`. What cannot
/// come over the `bar` by what it leaves of the currents is not fitted to the motion.
///
/// A score lets the parameters of the parent give way to the effect, while a fit starts from them as they are, and to first order a
/// strength may come out far too large where shapes matter: either may lead a shape astray.
fn beside(
    data: &Data,
    parent: &Hypothesis,
    prospect: &Prospect,
    begun: Option<&[f64]>,
    (thorough, bar): (bool, Bar),
    monitor: &dyn Monitor,
) -> Result<Hypothesis> {
    let model = with(parent, prospect.effect);
    let parameters = prospect.effect.info().parameters;
    let first = model.parameter_count() - parameters.len();
    let currents =
        if prospect.effect.info().site == Site::Mechanical { Currents::Done } else { Currents::Open };
    let start = |own: &[f64]| [parent.own(), own].concat();
    let lost = |fitted: &Hypothesis| bar.missed(fitted, true);
    let may_lose: Option<&dyn Fn(&Hypothesis) -> bool> = if bar.is_none() { None } else { Some(&lost) };
    let from = |own: &[f64], currents: Currents, held: &[usize], under: Option<&Hypothesis>| {
        fitting::fit_unless(may_lose, (held, under), data, &model, (&start(own), currents), monitor)
    };
    // What moves beside the rotor is no step of a load, which need not be found anew for it; nor a second time.
    let fit = |own: &[f64], held: &[usize]| from(own, currents, held, Some(parent));
    let under = (prospect.effect.mechanical_state_count() > 0).then_some(parent);
    let mut best = from(&prospect.start, begun.map_or(currents, Currents::Fitted), &[], under)?;

    let shapes: Vec<usize> =
        (0..parameters.len()).filter(|k| parameters[*k].role == Role::Shape).map(|k| first + k).collect();
    let hopeful = thorough && !shapes.is_empty();
    let short = |fitted: &Hypothesis| explained(parent, fitted) < KEPT_PROMISE * prospect.score;
    let broken = |fitted: &Hypothesis| hopeful && (lost(fitted) || short(fitted)) && !monitor.cancelled();
    let better = |a: Hypothesis, b: Hypothesis| {
        if lost(&a) || (!lost(&b) && explained(parent, &b) > explained(parent, &a)) { b } else { a }
    };
    let mut alike = false;
    if broken(&best) {
        let again = fit(&prospect.start, &shapes)?;
        // Two ways that lead to the same place have not led astray, unless nothing of the effect is left there.
        alike = !best.vanishes(prospect.effect) && agree(&best.own()[first..], &again.own()[first..]);
        best = better(best, again);
    }
    if broken(&best) && !alike {
        let strength = |p: &Parameter| if p.role == Role::Amplitude { FAINTER } else { 1.0 };
        let fainter: Vec<f64> = prospect.start.iter().zip(parameters).map(|(x, p)| x * strength(p)).collect();
        best = better(best, fit(&fainter, &[])?);
    }
    Ok(best)
}

/// Whether two fits have come to the same place.
fn agree(one: &[f64], other: &[f64]) -> bool {
    one.iter().zip(other).all(|(a, b)| (a - b).abs() <= ALIKE * a.abs().max(b.abs()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::shortlist::Scorer;
    use crate::diagnose::testing::{choice, data, fitted, setup, speeds};
    use crate::drive::{Choice, Schedule};
    use crate::experiment::Channel;
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
        let open = Bar { claim: Claim::Open, beside: None };
        for prospect in [seen, far] {
            let fitted = beside(&data, &base, &prospect, None, (true, open), &Silent).unwrap();
            let (explained, f) = (explained(&base, &fitted), fitted.own()[fitted.own().len() - 1]);
            assert!(explained > 0.95 * prospect.score && (f / 4.8 - 1.0).abs() < 0.03, "{explained}, {f} Hz");
        }
    }

    #[test]
    fn fits_agree_where_each_parameter_does_whatever_its_size() {
        assert!(agree(&[1e-6, -300.0, 0.0], &[1.009e-6, -298.0, 0.0]));
        assert!(!agree(&[1e-6, -300.0], &[1.02e-6, -300.0]));
        assert!(!agree(&[1e-6, -300.0], &[1e-6, 300.0]));
        assert!(!agree(&[0.0], &[1e-9]) && !agree(&[1e-9], &[0.0]));
        assert!(!agree(&[1.0], &[f64::NAN]));
    }

    #[test]
    fn a_refit_that_has_begun_comes_to_the_same() {
        let manoeuvre = speeds(0.4, &[(0.05, 90.0), (0.2, -80.0), (0.35, 60.0)]);
        let (data, base) = data(&setup(manoeuvre, vec![choice("dead_time", "v_err", 4.0)]));
        let search =
            Search { data: &data, held_out: Vec::new(), refuting: Vec::new(), most: 3, monitor: &Silent };
        let scorer = Scorer::new(&data, &base);
        let [dead_time, friction] =
            [EffectId::DeadTime, EffectId::CoulombFriction].map(|effect| scorer.score(effect));
        let base = Judged { fitted: base.clone(), held_out: Vec::new(), refuted: false };
        let begun = search.begin(&base, &dead_time).unwrap().unwrap();
        let parameters = |begun: Option<&[f64]>| {
            let judged = search.refit(&base, &dead_time, begun, Claim::Open).unwrap().unwrap();
            judged.fitted.parameters
        };
        assert_eq!(parameters(Some(&begun)), parameters(None));
        assert!(search.begin(&base, &friction).unwrap().is_none());
    }

    #[test]
    fn what_the_currents_tell_is_enough_where_they_tell_that_a_set_is_lost() {
        let manoeuvre = speeds(0.4, &[(0.05, 90.0), (0.2, -80.0), (0.35, 60.0)]);
        let (data, base) = data(&setup(manoeuvre, vec![choice("dead_time", "v_err", 4.0)]));
        let judged = |fitted| Judged { fitted, held_out: Vec::new(), refuted: false };
        let best = judged(fitted(&data, &base, EffectId::DeadTime));
        let prospect = Scorer::new(&data, &base).score(EffectId::BackEmfHarmonics);
        let (base, search) = (
            judged(base),
            Search { data: &data, held_out: Vec::new(), refuting: Vec::new(), most: 3, monitor: &Silent },
        );
        let leaves = |claim| {
            let fitted =
                beside(&data, &base.fitted, &prospect, None, (false, Bar { claim, beside: None }), &Silent)
                    .unwrap();
            [Channel::ID, Channel::IQ, Channel::OmegaE].map(|channel| fitted.square(channel))
        };
        let whole = leaves(Claim::Open);
        assert!(whole[1] > 30.0 && whole[2] > 0.5 && whole[2] != 1.0, "{whole:?}");
        assert!(search.refit(&base, &prospect, None, Claim::Open).unwrap().is_some());
        assert!(!search.rotor_is_lost(&base, Claim::Open).unwrap());
        assert!(search.rotor_waits(&base, &best) && !search.rotor_waits(&best, &base));
        for claim in [Claim::Behind(&best), Claim::Outdone(&best), Claim::Beside(&best)] {
            assert_eq!(leaves(claim), [whole[0], whole[1], 1.0]);
            assert!(search.refit(&base, &prospect, None, claim).unwrap().is_none());
            assert!(search.rotor_is_lost(&base, claim).unwrap());
            assert!(!search.rotor_is_lost(&best, claim).unwrap());
        }
        // Beside what explains the motion, an effect that leaves the currents alone has nothing to add, whatever it is held to.
        let prospect = Scorer::new(&data, &best.fitted).score(EffectId::BackEmfHarmonics);
        let open = Bar { claim: Claim::Open, beside: None };
        let whole = beside(&data, &best.fitted, &prospect, None, (false, open), &Silent).unwrap();
        assert!(moves_as_measured(&best) && !whole.vanishes(EffectId::BackEmfHarmonics));
        assert!(search.refit(&best, &prospect, None, Claim::Open).unwrap().is_none());
    }
}
