//! Models of smaller sets and where their fits start: without one of the effects, or with a special case in its place.

use crate::base::BASE;
use crate::diagnose::hypothesis::Hypothesis;
use crate::effects::{self, EffectId};
use crate::model::Model;

/// Effects that an effect contains.
pub fn special_cases(wide: EffectId) -> impl Iterator<Item = EffectId> {
    effects::ALL.iter().copied().filter(move |e| wide.contains(*e))
}

/// Model and parameters without one of the effects.
pub fn reduced(hypothesis: &Hypothesis, drop: EffectId) -> (Model, Vec<f64>) {
    let kept: Vec<EffectId> = hypothesis.effects().into_iter().filter(|e| *e != drop).collect();
    let mut start = hypothesis.own()[..BASE].to_vec();
    for slot in hypothesis.model.slots().iter().filter(|s| s.effect != drop) {
        start.extend(&hypothesis.parameters[slot.parameters.clone()]);
    }
    (keeping_the_map(hypothesis, &kept, &mut start), start)
}

/// A model with these effects and the map of a set, whose coefficients are put behind the effects' parameters.
fn keeping_the_map(hypothesis: &Hypothesis, effects: &[EffectId], start: &mut Vec<f64>) -> Model {
    let model = Model::new(*hypothesis.model.context(), effects);
    start.extend(&hypothesis.parameters[hypothesis.model.map_parameters()]);
    match hypothesis.model.map() {
        Some(map) => model.with_map(map.clone()),
        None => model,
    }
}

/// Model, all parameters and which of them are fitted without one of the effects, everything else being as it is: nothing where the
/// effect has a part in what a recording leaves open.
pub(super) fn left_out(hypothesis: &Hypothesis, drop: EffectId) -> Option<(Model, Vec<f64>, Vec<usize>)> {
    let slot = hypothesis.model.slots().iter().find(|s| s.effect == drop)?;
    let own = slot.parameters.clone();
    let (model, mut parameters) = reduced(hypothesis, drop);
    parameters.extend(&hypothesis.parameters[hypothesis.own().len()..]);
    let others = hypothesis.free.iter().filter(|k| !own.contains(k));
    let free = others.map(|k| if *k < own.start { *k } else { k - own.len() }).collect();
    (drop.mechanical_state_count() == 0).then_some((model, parameters, free))
}

/// Model and parameters with the special case `narrow` in place of the effect `wide`; parameters of the same name keep their values.
pub fn in_place(hypothesis: &Hypothesis, wide: EffectId, narrow: EffectId) -> (Model, Vec<f64>) {
    let (rest, mut start) = reduced(hypothesis, wide);
    start.truncate(rest.map_parameters().start);
    let slot = hypothesis.model.slots().iter().find(|s| s.effect == wide).expect("it is in the set");
    let own = &hypothesis.parameters[slot.parameters.clone()];
    let mut shared = narrow.probes(rest.context()).into_iter().next().unwrap_or_default();
    for (x, info) in shared.iter_mut().zip(narrow.info().parameters) {
        if let Some(k) = wide.info().parameters.iter().position(|p| p.name == info.name) {
            *x = own[k];
        }
    }
    start.extend(shared);
    let mut effects = rest.effects();
    effects.push(narrow);
    (keeping_the_map(hypothesis, &effects, &mut start), start)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing::CX;

    #[test]
    fn what_stays_keeps_its_values() {
        let (drag, stribeck) = (EffectId::QuadraticDrag, EffectId::StribeckFriction);
        let model = Model::new(CX, &[stribeck, drag]);
        let mut own: Vec<f64> = (0..BASE).map(|k| 1.0 + k as f64).collect();
        let friction: Vec<f64> = (0..stribeck.info().parameters.len()).map(|k| 20.0 + k as f64).collect();
        own.extend(&friction);
        own.push(0.5);
        let hypothesis = Hypothesis::unfitted(model, own.clone());

        let whole = Hypothesis {
            parameters: [&own[..], &[7.0, 8.0]].concat(),
            free: vec![0, BASE + 1, own.len() - 1, own.len(), own.len() + 1],
            ..hypothesis.clone()
        };
        let (without, parameters, free) = left_out(&whole, stribeck).unwrap();
        assert_eq!((without.effects(), &parameters[BASE..]), (vec![drag], &[0.5, 7.0, 8.0][..]));
        assert_eq!(free, [0, BASE, BASE + 1, BASE + 2]);
        let shaft = Hypothesis::unfitted(Model::new(CX, &[EffectId::TwoMassShaft]), vec![1.0; BASE + 3]);
        assert!(left_out(&shaft, EffectId::TwoMassShaft).is_none());

        let (without, start) = reduced(&hypothesis, stribeck);
        assert_eq!(without.effects(), [drag]);
        assert_eq!(start, [&own[..BASE], &[0.5]].concat());

        let coulomb = EffectId::CoulombFriction;
        assert!(special_cases(stribeck).any(|e| e == coulomb) && special_cases(drag).next().is_none());
        let (narrower, start) = in_place(&hypothesis, stribeck, coulomb);
        assert_eq!(narrower.effects(), [drag, coulomb]);
        assert_eq!(start[..=BASE], [&own[..BASE], &[0.5]].concat());
        for (info, x) in coulomb.info().parameters.iter().zip(&start[BASE + 1..]) {
            let k = stribeck.info().parameters.iter().position(|p| p.name == info.name);
            assert_eq!(*x, friction[k.expect("Stribeck's curve contains Coulomb friction")], "{}", info.name);
        }
    }
}
