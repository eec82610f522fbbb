//! The catalogue of omitted effects: the only registry. An effect is one file below `effects/` and one line here. Effects that a user gives
//! [as text](text) stand beside it and are passed on by whoever has them.

use crate::base::Base;
use crate::effect::{
    Context, Derived, Drift, Effect, Electrical, Env, Field, FieldPoint, Info, Magnet, Mechanical, Output,
    Rotor, Sensor,
};
use crate::error::{Error, Result};
use crate::numerics::real::Real;

macro_rules! catalogue {
    ($($module:ident :: $name:ident),+ $(,)?) => {
        $(pub mod $module;)+

        /// An effect of the catalogue, or one given as text.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum EffectId {
            $(#[doc = concat!("See [`", stringify!($module), "`].")] $name,)+
            /// See [`text`].
            Text(TextId),
        }

        /// Electrical states of a machine with all effects: the flux linkages d and q, and what each effect adds.
        pub const ELECTRICAL_STATES: usize = 2 $(+ <$module::$name as Effect>::ELECTRICAL_STATES)+;
        /// Mechanical states of a machine with all effects: the speed, and what each effect adds.
        pub const MECHANICAL_STATES: usize = 1 $(+ <$module::$name as Effect>::MECHANICAL_STATES)+;

        /// States of such a machine in one piece, with its angle.
        pub const STATES: usize = ELECTRICAL_STATES + MECHANICAL_STATES + 1;

        /// All effects, in the order of the registry.
        pub const ALL: &[EffectId] = &[$(EffectId::$name),+];

        impl EffectId {
            /// Its description.
            pub fn info(self) -> &'static Info {
                match self { $(Self::$name => &<$module::$name as Effect>::INFO,)+ Self::Text(text) => text.info() }
            }
            /// Number of its own electrical or thermal states.
            pub fn electrical_state_count(self) -> usize {
                match self { $(Self::$name => <$module::$name as Effect>::ELECTRICAL_STATES,)+ Self::Text(_) => 0 }
            }
            /// Number of its own mechanical states.
            pub fn mechanical_state_count(self) -> usize {
                match self { $(Self::$name => <$module::$name as Effect>::MECHANICAL_STATES,)+ Self::Text(_) => 0 }
            }
            /// Results that are none of its parameters.
            pub fn derived(self) -> &'static [Derived] {
                match self { $(Self::$name => <$module::$name as Effect>::DERIVED,)+ Self::Text(text) => text.derived() }
            }
            /// Whether it has `narrow` as a special case, so that fitting as well is no rivalry.
            pub fn contains(self, narrow: Self) -> bool {
                let contains = |id: &str| self.info().contains.contains(&id);
                contains(narrow.id())
                    || narrow.definition().is_some_and(|own| own.replaces.iter().any(|id| contains(id)))
            }
            /// The effect of which this one is the finer part.
            pub fn refines(self) -> Option<&'static str> {
                match self { $(Self::$name => <$module::$name as Effect>::REFINES,)+ Self::Text(_) => None }
            }
            /// Share of its strength by which its parameters scatter with the form of its equation.
            pub fn form(self) -> f64 {
                match self { $(Self::$name => <$module::$name as Effect>::FORM,)+ Self::Text(_) => text::FORM }
            }
            /// Whether its derivative at zero strength tells how much it can explain.
            pub fn is_first_order(self) -> bool {
                match self { $(Self::$name => <$module::$name as Effect>::FIRST_ORDER,)+ Self::Text(text) => text.is_first_order() }
            }
            /// Whether its fit has many minima, so that a swarm looks for its parameters.
            pub fn is_multimodal(self) -> bool {
                match self { $(Self::$name => <$module::$name as Effect>::MULTIMODAL,)+ Self::Text(_) => false }
            }
            /// Whether its name covers every function of its variables.
            pub fn is_general(self) -> bool {
                match self { $(Self::$name => <$module::$name as Effect>::GENERAL,)+ Self::Text(_) => false }
            }
            /// Whether its torque jumps where the speed changes its sign.
            pub fn jumps(self) -> bool {
                match self { $(Self::$name => <$module::$name as Effect>::JUMPS,)+ Self::Text(text) => text.jumps() }
            }
            /// Whether a smooth term over the speed describes it as well but for standstill.
            pub fn is_smooth(self) -> bool {
                match self { $(Self::$name => <$module::$name as Effect>::SMOOTH,)+ Self::Text(_) => false }
            }
            /// Whether its electrical states are temperatures.
            pub fn is_thermal(self) -> bool {
                match self { $(Self::$name => <$module::$name as Effect>::THERMAL,)+ Self::Text(_) => false }
            }
            /// Whether the torque of given currents depends on it.
            pub fn turns(self) -> bool {
                match self { $(Self::$name => <$module::$name as Effect>::TURNS,)+ Self::Text(own) => own.side() != text::Side::Voltage }
            }
            /// Whether the flux of a current must be iterated for.
            pub fn is_magnetic(self) -> bool {
                match self { $(Self::$name => <$module::$name as Effect>::MAGNETIC,)+ Self::Text(own) => own.side() == text::Side::Energy }
            }
            dispatch! { [$($module::$name),+]
                fn probes[](cx: &Context) -> Vec<Vec<f64>>;
                fn fitted[](cx: &Context, index: usize) -> bool;
                fn idles[](p: &[f64], cx: &Context) -> bool;
                fn drift[T](p: &[T], x: &[T], env: &Env<T>, cx: &Context, out: &mut Drift<T>) -> ();
                fn magnet[T](p: &[T], psi_m: T, env: &Env<T>, cx: &Context, out: &mut Magnet<T>) -> ();
                fn field[T](p: &[T], at: &FieldPoint<T>, base: &Base<T>, cx: &Context, out: &mut Field<T>) -> ();
                fn command[T](p: &[T], taps: &[[T; 2]; 3], turn: T, cx: &Context, v: &mut [T; 2]) -> ();
                fn shunt[T](p: &[T], x: &[T], sin_cos: (T, T), cx: &Context, i: &mut [T; 2]) -> ();
                fn electrical_start[T](p: &[T], at: &Electrical<T>, cx: &Context, x: &mut [T]) -> ();
                fn turned[](p: &mut [f64], shift: f64) -> bool;
                fn voltage[T](p: &[T], x: &[T], at: &Electrical<T>, cx: &Context, lost: &mut [T; 2]) -> ();
                fn electrical_states[T](p: &[T], x: &[T], at: &Electrical<T>, cx: &Context, dx: &mut [T]) -> ();
                fn rotor[T](p: &[T], x: &[T], at: &Mechanical<T>, cx: &Context, out: &mut Rotor<T>) -> ();
                fn mechanical_states[T](
                    p: &[T], x: &[T], at: &Mechanical<T>, acceleration: T, cx: &Context, dx: &mut [T]) -> ();
                fn mechanical_start[T](p: &[T], at: &Mechanical<T>, acceleration: T, cx: &Context, x: &mut [T]) -> ();
                fn ringing[T](p: &[T]) -> T;
                fn steepness[T](p: &[T], cx: &Context) -> T;
                fn sensor[T](p: &[T], env: &Env<T>, cx: &Context, out: &mut Sensor<T>) -> ();
                fn outputs[T](p: &[T], base: &Base<T>, cx: &Context) -> Vec<Output<T>>;
            }
        }
    };
}

/// One method per hook of [`Effect`], passed on to the effect's own implementation. Numbers that are called and not inlined
/// share one copy of it, all others take it into the loop that asks.
macro_rules! dispatch {
    ($list:tt $(fn $hook:ident $generic:tt ($($arg:ident: $type:ty),* $(,)?) -> $ret:ty;)+) => {
        $(dispatch! { @one $list $hook $generic ($($arg: $type),*) ($($arg),*) $ret })+
    };
    (@one $list:tt $hook:ident [] ($($arg:ident: $type:ty),*) $call:tt $ret:ty) => {
        #[doc = concat!("[`Effect::", stringify!($hook), "`] of this effect.")]
        pub fn $hook(self, $($arg: $type),*) -> $ret {
            dispatch! { @each $list $hook self $call }
        }
    };
    (@one $list:tt $hook:ident [$t:ident] ($($arg:ident: $type:ty),*) $call:tt $ret:ty) => {
        #[doc = concat!("[`Effect::", stringify!($hook), "`] of this effect.")]
        #[inline(always)]
        pub fn $hook<$t: Real>(self, $($arg: $type),*) -> $ret {
            #[inline(never)]
            fn called<$t: Real>(effect: EffectId, $($arg: $type),*) -> $ret {
                dispatch! { @each $list $hook effect $call }
            }
            if const { $t::CALLED } {
                return called(self, $($arg),*);
            }
            dispatch! { @each $list $hook self $call }
        }
    };
    (@each [$($module:ident :: $name:ident),+] $hook:ident $effect:ident $call:tt) => {
        match $effect {
            $(EffectId::$name => <$module::$name as Effect>::$hook $call,)+
            EffectId::Text(text) => text.$hook $call,
        }
    };
}

#[cfg(test)]
pub(crate) mod testing;
pub mod text;

use text::TextId;

catalogue! {
    coulomb_friction::CoulombFriction,
    stribeck_friction::StribeckFriction,
    asymmetric_friction::AsymmetricFriction,
    concave_friction::ConcaveFriction,
    presliding_friction::PreslidingFriction,
    load_dependent_friction::LoadDependentFriction,
    quadratic_drag::QuadraticDrag,
    cogging_torque::CoggingTorque,
    cogging_asymmetry::CoggingAsymmetry,
    load_torque_pulsation::LoadTorquePulsation,
    gravity_torque::GravityTorque,
    time_varying_load::TimeVaryingLoad,
    two_mass_shaft::TwoMassShaft,
    backlash::Backlash,
    back_emf_harmonics::BackEmfHarmonics,
    saturation_d::SaturationD,
    saturation_q::SaturationQ,
    cross_saturation::CrossSaturation,
    inductance_harmonics::InductanceHarmonics,
    rs_thermal_drift::RsThermalDrift,
    magnet_thermal_drift::MagnetThermalDrift,
    iron_loss::IronLoss,
    dead_time::DeadTime,
    voltage_delay::VoltageDelay,
    dc_link_sag::DcLinkSag,
    phase_resistance_imbalance::PhaseResistanceImbalance,
    inter_turn_short::InterTurnShort,
    current_offset::CurrentOffset,
    current_gain_imbalance::CurrentGainImbalance,
    encoder_angle_offset::EncoderAngleOffset,
    encoder_delay::EncoderDelay,
    encoder_eccentricity::EncoderEccentricity,
    encoder_harmonics::EncoderHarmonics,
}

impl EffectId {
    /// Identifier in files and answers; it never changes its meaning.
    pub fn id(self) -> &'static str {
        self.info().id
    }

    /// What its user gave, where it was given as text.
    pub fn definition(self) -> Option<&'static text::Definition> {
        match self {
            Self::Text(own) => Some(own.definition()),
            _ => None,
        }
    }

    /// The effect of the catalogue with this identifier.
    ///
    /// # Errors
    /// [`Error::Unknown`] with the list of known identifiers.
    pub fn parse(id: &str) -> Result<Self> {
        ALL.iter().copied().find(|effect| effect.id() == id).ok_or_else(|| Error::Unknown {
            kind: "effect",
            name: id.into(),
            known: ALL.iter().map(|e| e.id()).collect::<Vec<_>>().join(", "),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::Context;
    use crate::effects::testing::{CX, shaft};

    #[test]
    fn what_has_no_states_of_its_own_adds_to_the_torque_that_the_rotor_loses_and_to_nothing_else() {
        let at = shaft(0.7, 30.0, -2.0);
        let mut changing = 0;
        for effect in ALL.iter().filter(|e| e.mechanical_state_count() == 0) {
            let p: Vec<f64> = effect.info().parameters.iter().map(|p| (p.typical)(&CX)).collect();
            let lost = [0.0, 5.0].map(|before| {
                let mut rotor = Rotor { inverse_inertia: 2.0, loss: before, load: 3.0 };
                effect.rotor(&p, &[], &at, &CX, &mut rotor);
                assert_eq!((rotor.inverse_inertia, rotor.load), (2.0, 3.0), "{}", effect.id());
                rotor.loss - before
            });
            assert!((lost[0] - lost[1]).abs() <= 1e-14, "{}", effect.id());
            changing += usize::from(lost[0] != 0.0);
        }
        assert!(changing > 5);
    }

    #[test]
    fn bounds_hold_what_is_typical_on_the_shortest_and_slowest_of_logs_too() {
        for cx in [
            CX,
            Context { period: 0.1, duration: 1.6, ..CX },
            Context { period: 1e-5, duration: 600.0, ..CX },
        ] {
            for effect in ALL {
                for parameter in effect.info().parameters {
                    let [low, typical, high] =
                        [parameter.low, parameter.typical, parameter.high].map(|f| f(&cx));
                    let name = parameter.name;
                    assert!(
                        low <= typical.abs() && typical <= high,
                        "{} {name}: {low} {typical} {high}",
                        effect.id()
                    );
                }
                let inside = |probe: &Vec<f64>| {
                    let mut both = effect.info().parameters.iter().zip(probe);
                    both.all(|(p, x)| (p.low)(&cx) <= *x && *x <= (p.high)(&cx))
                };
                assert!(effect.probes(&cx).iter().all(inside), "{}", effect.id());
            }
        }
    }
}
