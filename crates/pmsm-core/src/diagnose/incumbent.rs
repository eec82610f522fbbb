//! The incumbent, the best set that a search has found so far, and the answer that it gives when the diagnosis is interrupted.

use super::answer::{Answer, Estimate, FoundModel, Step};
use super::conclude;
use super::data::Data;
use super::hypothesis::Hypothesis;
use crate::base::Base;
use crate::machine::BaseParameter;
use crate::signals::Finding;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// The best set so far.
#[derive(Debug, Default)]
pub struct Incumbent(Mutex<Option<Hypothesis>>);

impl Incumbent {
    /// Keeps a set in place of the one before.
    pub fn note(&self, set: &Hypothesis) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(set.clone());
    }

    /// The answer that is `undetermined` because it was interrupted, with the values of the best set so far.
    pub fn answer(self, data: &Data) -> Answer {
        let set = self.0.into_inner().unwrap_or_else(PoisonError::into_inner);
        let effects: Vec<String> =
            set.iter().flat_map(Hypothesis::effects).map(|e| e.id().to_string()).collect();
        let best = match (&set, effects.is_empty()) {
            (None, _) => "before the dq-model was fitted".to_string(),
            (Some(_), true) => "when the dq-model was fitted and no effect was taken up".to_string(),
            (Some(_), false) => format!("when the best set of effects was {}", effects.join(", ")),
        };
        let finding = Finding {
            finding: format!("the diagnosis was interrupted {best}"),
            consequence: "what had not been tried is neither named nor excluded".into(),
            fix: "let it run to its end".into(),
        };
        let mut answer = conclude::undetermined(data, finding, None);
        if let Some(set) = set {
            let base = base(data, &set);
            let parameters = set.effects().into_iter().map(|e| (e.id().to_string(), own(&set, e))).collect();
            let step =
                Step { effects: effects.clone(), base: base.clone(), parameters, rms: BTreeMap::new() };
            answer.model = FoundModel { effects, base, ..answer.model };
            answer.path = vec![step];
        }
        answer
    }
}

/// Base parameters that the recordings can show, without uncertainties.
fn base(data: &Data, set: &Hypothesis) -> BTreeMap<String, Estimate> {
    let shown = BaseParameter::ALL.into_iter().filter(|p| data.needs(*p));
    shown.map(|p| (p.name().to_string(), plain(set.own()[p.index()], p.unit()))).collect()
}

/// Parameters of one effect of a set, without uncertainties.
fn own(set: &Hypothesis, effect: crate::effects::EffectId) -> BTreeMap<String, Estimate> {
    let slots = set.model.slots().iter().filter(|slot| slot.effect == effect);
    let outputs = slots.flat_map(|slot| {
        effect.outputs(&set.parameters[slot.parameters.clone()], &Base::new(set.own()), set.model.context())
    });
    outputs.map(|(name, unit, value)| (name.to_string(), plain(value, unit))).collect()
}

fn plain(value: f64, unit: &str) -> Estimate {
    Estimate {
        value: value.is_finite().then_some(value),
        stderr: None,
        ci95: None,
        unit: unit.to_string(),
        why_none: Some("the diagnosis was interrupted before it was computed".into()),
    }
}

#[cfg(test)]
mod tests {
    use crate::diagnose::answer::{Answer, Verdict};
    use crate::diagnose::diagnose;
    use crate::diagnose::testing::{choice, setup, speeds};
    use crate::drive::simulate;
    use crate::experiment::passes;
    use crate::machine::Machine;
    use crate::monitor::{Monitor, Silent};
    use crate::recording::Recording;
    use rayon::ThreadPoolBuilder;
    use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

    /// Says stop from a certain ask on, and keeps how many passes had been made by then.
    struct After {
        most: usize,
        asks: AtomicUsize,
        passes: AtomicUsize,
    }

    impl Monitor for After {
        fn cancelled(&self) -> bool {
            let asked = self.asks.fetch_add(1, Relaxed);
            if asked == self.most {
                self.passes.store(passes::count(), Relaxed);
            }
            asked >= self.most
        }
    }

    /// Number of asks, passes after the stop, and the answer of a diagnosis that is stopped after so many asks, on one thread.
    fn stopped(recordings: &[&Recording; 2], machine: &Machine, most: usize) -> (usize, usize, Answer) {
        let pool = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        pool.install(|| {
            let monitor = After { most, asks: AtomicUsize::new(0), passes: AtomicUsize::new(0) };
            let [one, other] = recordings;
            let answer = diagnose(&[one], machine, Some(other), &Default::default(), &monitor).unwrap();
            let after = passes::count() - monitor.passes.into_inner();
            (monitor.asks.into_inner(), after, answer)
        })
    }

    #[test]
    fn after_a_stop_no_pass_is_made_and_the_answer_says_how_far_it_came() {
        let present = vec![choice("coulomb_friction", "tau_c", 0.3)];
        let setup = setup(speeds(1.1, &[(0.1, 80.0), (0.5, -60.0), (0.9, 90.0)]), present);
        let other = crate::drive::Setup { seed: setup.seed + 1, ..setup.clone() };
        let [one, other] = [&setup, &other].map(|s| simulate(s, &Silent).unwrap().recording);
        let runs = [&one, &other];
        let (asks, passes, whole) = stopped(&runs, &setup.nameplate, usize::MAX);
        assert!(asks > 100 && passes > asks / 20, "{asks} asks in {passes} passes");
        assert_ne!(whole.verdict, Verdict::Undetermined);
        // Each at another stage; where the last asks are made, everything is known.
        let mut furthest = 0;
        for k in 0..12 {
            let most = asks * k / 12;
            let (asked, passes, answer) = stopped(&runs, &setup.nameplate, most);
            assert_eq!(passes, 0, "{asked} of {asks}");
            assert_eq!(answer.verdict, Verdict::Undetermined);
            let reason = answer.reason.unwrap();
            assert!(reason.starts_with("the diagnosis was interrupted"), "{reason}");
            assert_eq!(k == 0, answer.model.base.is_empty());
            assert_eq!(answer.path.len(), usize::from(k > 0));
            let named = answer.model.effects.iter().all(|effect| reason.contains(effect));
            assert!(named, "{reason} {:?}", answer.model.effects);
            furthest = furthest.max(answer.model.effects.len());
        }
        assert_eq!(furthest, whole.model.effects.len());
    }
}
