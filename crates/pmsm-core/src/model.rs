//! A machine with any set of omitted effects: right-hand sides, torque and measurement map.
//!
//! The bare machine is the dq-model (1)–(3) of Liu, Liu & Cartes (2008), written in flux linkages (see
//! [`crate::effect`]). Every simulation of this crate, whatever drives it, goes through the functions here.

mod motion;
mod sensing;
mod steady;
mod winding;

use crate::base::{BASE, Base};
use crate::effect::{Context, Need, Site};
use crate::effects::EffectId;
use crate::machine::BaseParameter;
use crate::map::Map;
use crate::numerics::real::Real;
use std::ops::Range;

pub use steady::Known;
pub use winding::{Magnetic, Standing};

/// Where one effect's parameters and states sit.
#[derive(Debug, Clone)]
pub struct Slot {
    /// The effect.
    pub effect: EffectId,
    /// Its parameters in the parameter vector.
    pub parameters: Range<usize>,
    /// Its states among the electrical extra states.
    pub electrical: Range<usize>,
    /// Its states among the mechanical extra states.
    pub mechanical: Range<usize>,
}

/// The bare machine plus chosen effects.
#[derive(Debug, Clone)]
pub struct Model {
    context: Context,
    slots: Vec<Slot>,
    uses_angle: bool,
    has_sensor: bool,
    electrical_count: usize,
    is_magnetic: bool,
    bypassed: bool,
    map: Option<Map>,
    mapped: Range<usize>,
}

impl Model {
    /// The machine with these effects, each of them once, at the scales of one recording.
    pub fn new(context: Context, effects: &[EffectId]) -> Self {
        let (mut at, mut electrical, mut mechanical) = (BASE, 0, 0);
        let mut slots = Vec::with_capacity(effects.len());
        for &effect in effects {
            let (count, e, m) = (
                effect.info().parameters.len(),
                effect.electrical_state_count(),
                effect.mechanical_state_count(),
            );
            slots.push(Slot {
                effect,
                parameters: at..at + count,
                electrical: electrical..electrical + e,
                mechanical: mechanical..mechanical + m,
            });
            (at, electrical, mechanical) = (at + count, electrical + e, mechanical + m);
        }
        let uses_angle = effects
            .iter()
            .any(|e| e.info().needs.iter().any(|n| matches!(n, Need::Angle | Need::AngleOrSteady)));
        let has_sensor = effects.iter().any(|e| e.info().site == Site::Sensor);
        let is_magnetic = effects.iter().any(|e| e.is_magnetic());
        let bypassed = effects.iter().any(|e| e.is_magnetic() && e.electrical_state_count() > 0);
        Self {
            context,
            slots,
            uses_angle,
            has_sensor,
            electrical_count: electrical,
            is_magnetic,
            bypassed,
            map: None,
            mapped: at..at,
        }
    }

    /// The same with a map of missing voltage or torque, or of the angle's error, whose coefficients follow the effects' parameters.
    pub fn with_map(self, map: Map) -> Self {
        let start = self.mapped.start;
        let has_sensor = self.has_sensor || map.has_angle();
        Self { mapped: start..start + map.count(), has_sensor, map: Some(map), ..self }
    }

    /// Its map, if it has one.
    pub fn map(&self) -> Option<&Map> {
        self.map.as_ref()
    }

    /// Place of the map's coefficients in the parameter vector; empty without one.
    pub fn map_parameters(&self) -> Range<usize> {
        self.mapped.clone()
    }

    /// The scales it was built for.
    pub fn context(&self) -> &Context {
        &self.context
    }

    /// Its effects with their places.
    pub fn slots(&self) -> &[Slot] {
        &self.slots
    }

    /// Its effects.
    pub fn effects(&self) -> Vec<EffectId> {
        self.slots.iter().map(|s| s.effect).collect()
    }

    /// Length of the parameter vector: six base parameters, then each effect's, then the coefficients of a map.
    pub fn parameter_count(&self) -> usize {
        self.mapped.end
    }

    /// Number of electrical extra states.
    pub fn electrical_states(&self) -> usize {
        self.electrical_count
    }

    /// Whether the flux of a current must be iterated for.
    pub fn is_magnetic(&self) -> bool {
        self.is_magnetic
    }

    /// Whether current bypasses the winding as states that follow the flux say.
    pub fn is_bypassed(&self) -> bool {
        self.bypassed
    }

    /// Whether the torque of given currents depends on parameter `index` of the winding or of an effect.
    pub fn turns(&self, index: usize) -> bool {
        let slot = self.slots.iter().find(|s| s.parameters.contains(&index));
        self.bypassed || index != BaseParameter::RS.index() && slot.is_none_or(|s| s.effect.turns())
    }

    /// Number of mechanical extra states.
    pub fn mechanical_states(&self) -> usize {
        self.slots.last().map_or(0, |s| s.mechanical.end)
    }

    /// Fastest angular frequency (rad/s) at which the rotor rings by itself at these parameters; zero if it does not.
    pub fn ringing<T: Real>(&self, p: &[T]) -> f64 {
        let frequency = |s: &Slot| s.effect.ringing(&p[s.parameters.clone()]).size();
        self.slots.iter().map(frequency).fold(0.0, f64::max) * std::f64::consts::TAU
    }

    /// Rate (1/s) at which the currents follow the steepest characteristic of an effect at these parameters; zero without one.
    pub fn steep_rate<T: Real>(&self, p: &[T], base: &Base<T>) -> f64 {
        let steepness = |s: &Slot| s.effect.steepness(&p[s.parameters.clone()], &self.context).size();
        let steepest = self.slots.iter().map(steepness).fold(0.0, f64::max);
        steepest * base.inverse_l_d.size().max(base.inverse_l_q.size())
    }

    /// True if an effect or the map changes what the sensors show.
    pub fn has_sensor(&self) -> bool {
        self.has_sensor
    }

    /// Physical bounds of parameter `index`.
    pub fn bounds(&self, index: usize) -> (f64, f64) {
        if index < BASE {
            return BaseParameter::ALL[index].physical_range();
        }
        if self.mapped.contains(&index) {
            return (f64::NEG_INFINITY, f64::INFINITY);
        }
        let slot =
            self.slots.iter().find(|s| s.parameters.contains(&index)).expect("index within the vector");
        let info = &slot.effect.info().parameters[index - slot.parameters.start];
        ((info.low)(&self.context), (info.high)(&self.context))
    }

    /// The voltage that acts, given the commands of this and the two samples before in their own frames.
    #[inline(always)]
    pub fn command<T: Real>(&self, p: &[T], taps: &[[T; 2]; 3], turn: T) -> [T; 2] {
        let mut v = taps[0];
        for s in &self.slots {
            s.effect.command(&p[s.parameters.clone()], taps, turn, &self.context, &mut v);
        }
        v
    }

    /// The same model seen from a mechanical zero that lies `shift` (rad) further, or `None` if it knows no turns.
    pub fn turned(&self, p: &[f64], shift: f64) -> Option<Vec<f64>> {
        let mut turned = p.to_vec();
        let mut any = false;
        for s in &self.slots {
            any |= s.effect.turned(&mut turned[s.parameters.clone()], shift);
        }
        if let Some(map) = &self.map {
            any |= map.turned(&mut turned[self.mapped.clone()], shift);
        }
        any.then_some(turned)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Base;
    use crate::effects::testing::{CX, MACHINE, env};
    use crate::map::{Equation, Factor, Part, Spline, Variable};

    fn map() -> Map {
        let line = Spline {
            variable: Variable::IQ,
            low: -8.0,
            high: 8.0,
            degree: 3,
            pieces: 4,
            warp: 0.0,
            odd: false,
        };
        let wave = Factor::Harmonics { angle: Variable::ThetaM, order: 1, count: 3 };
        let both = vec![Equation::D, Equation::Q];
        let voltage = Part { equations: both, first: wave, second: Some(Factor::Spline(line)) };
        let torque = Part { equations: vec![Equation::Mechanical], first: wave, second: None };
        Map { parts: vec![voltage, torque] }
    }

    /// Derivatives of the electrical and of the mechanical state at some point.
    fn slopes(model: &Model, p: &[f64]) -> ([f64; 12], [f64; 9]) {
        let (base, env) = (Base::new(p), env(2.3, 410.0));
        let electrical = model.electrical_rhs(p, &base, &[0.21; 12], [13.0, -40.0], &env);
        (electrical, model.mechanical_rhs(p, &base, &[136.7; 9], 4.1, 1.3, &env))
    }

    #[test]
    fn a_map_without_strength_changes_no_bit() {
        for effects in [vec![], vec![EffectId::DeadTime, EffectId::CoulombFriction]] {
            let plain = Model::new(CX, &effects);
            let mapped = plain.clone().with_map(map());
            let mut p = MACHINE.to_vec();
            p.extend(effects.iter().flat_map(|e| e.info().parameters).map(|x| (x.typical)(&CX)));
            let before = slopes(&plain, &p);
            assert_eq!(plain.parameter_count(), p.len());
            p.resize(mapped.parameter_count(), 0.0);
            let after = slopes(&mapped, &p);
            assert!(before.0.iter().zip(after.0).all(|(a, b)| a.to_bits() == b.to_bits()));
            assert!(before.1.iter().zip(after.1).all(|(a, b)| a.to_bits() == b.to_bits()));
            assert_eq!(mapped.map_parameters().len(), 2 * 6 * 7 + 6);
        }
    }

    #[test]
    fn a_map_takes_voltage_from_the_winding_and_torque_from_the_shaft() {
        let plain = Model::new(CX, &[]);
        let mapped = plain.clone().with_map(map());
        let mut p = MACHINE.to_vec();
        let before = slopes(&plain, &p);
        p.resize(mapped.parameter_count(), 0.0);
        let last = p.len() - 6;
        // q voltage: 2 V · cos θ_m at any i_q, the splines being a partition of unity; torque: 0.5 N·m · sin θ_m.
        p[BASE + 42..BASE + 49].fill(2.0);
        p[last + 1] = 0.5;
        let after = slopes(&mapped, &p);
        let theta = 2.3 / CX.n_p;
        assert_eq!(before.0[0], after.0[0]);
        assert!((before.0[1] - after.0[1] - 2.0 * theta.cos()).abs() < 1e-12);
        assert!((before.1[0] - after.1[0] - 0.5 * theta.sin() / MACHINE[4]).abs() < 1e-9);
    }
}
