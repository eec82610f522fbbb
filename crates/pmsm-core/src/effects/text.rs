//! Effects that a user gives as text: a formula with its parameters, which is then searched, ranked, fitted, simulated and exported as those of
//! the catalogue are.
//!
//! | side | terms | what they are | variables |
//! |---|---|---|---|
//! | torque | τ | taken from the rotor against positive rotation | omega_m (w), omega_e, theta_m, theta_e, tau_e, t |
//! | voltage | d, q | lost between command and winding | i_d, i_q, i_a, i_b, i_c, v_d, v_q, omega_m (w), omega_e, theta_m, theta_e, t |
//! | flux | d, q | added to the magnet's flux | theta_m, theta_e, psi_m |
//! | energy | W | added to the field energy per 3/2, W(λ_d, λ_q) above the magnet | lambda_d, lambda_q, l_d, l_q |
//! | angle | δ | measured minus true electrical angle | theta_m, theta_e |
//! | current | a, b, c | measured minus true current of each phase | theta_m, theta_e, omega_m (w), omega_e |
//!
//! `n_p` are the pole pairs everywhere. Strengths are the parameters at whose zero the formula is zero: the first whose range includes zero, or the
//! first few of them together.

mod definition;
mod inspected;
mod known;
mod own;
mod quantities;
#[cfg(test)]
mod tests;

pub use definition::{Definition, Quantity, Side};
pub use known::{MOST_KNOWN, TextId};
pub use own::{MOST_OWN, OwnEffects};

use crate::base::Base;
use crate::effect::{
    Context, Derived, Drift, Electrical, Env, Field, FieldPoint, Info, Magnet, Mechanical, Output, Role,
    Rotor, Sensor,
};
use crate::numerics::bytecode::{Bytecode, Inputs, OUTPUTS};
use crate::numerics::real::Real;
use crate::numerics::transforms::inverse_park;
use crate::terms::SMOOTHING;
use quantities::{Source, Variable};

/// Share of its strength by which its parameters scatter with the form of its equation, as for most of the catalogue.
pub(super) const FORM: f64 = 0.005;

/// An effect given as text, as the inner loops need it.
#[derive(Debug)]
pub struct Text {
    /// As the user gave it.
    pub definition: Definition,
    info: Info,
    code: Bytecode,
    sources: Vec<Source>,
    probes: Vec<Vec<f64>>,
    first_order: bool,
    jumps: bool,
}

/// Where a formula finds its inputs.
trait Place<T> {
    /// The value of a variable of this side.
    fn variable(&self, variable: Variable) -> T;
}

/// The inputs of a formula at a place.
struct At<'a, T, P> {
    sources: &'a [Source],
    p: &'a [T],
    cx: &'a Context,
    place: P,
}

impl<T: Real, P: Place<T>> Inputs<T> for At<'_, T, P> {
    #[inline(always)]
    fn input(&self, number: usize) -> T {
        match self.sources[number] {
            Source::Parameter(k) => self.p[k],
            Source::Width(variable) => {
                T::constant((SMOOTHING * variable.scale(self.cx)).max(f64::MIN_POSITIVE))
            }
            Source::Variable(Variable::PolePairs) => T::constant(self.cx.n_p),
            Source::Variable(variable) => self.place.variable(variable),
        }
    }
}

impl<T: Real> Place<T> for &Env<T> {
    #[inline(always)]
    fn variable(&self, variable: Variable) -> T {
        match variable {
            Variable::OmegaE => self.omega_e,
            Variable::ThetaM => self.theta_m,
            Variable::ThetaE => self.theta_e,
            Variable::Time => self.t,
            _ => T::zero(),
        }
    }
}

impl<T: Real> Place<T> for &Mechanical<T> {
    #[inline(always)]
    fn variable(&self, variable: Variable) -> T {
        match variable {
            Variable::OmegaM => self.omega_m,
            Variable::TauE => self.tau_e,
            other => (&self.env).variable(other),
        }
    }
}

/// The winding or a sensor, whose speed is electrical.
struct Electric<'a, T> {
    at: &'a Electrical<T>,
    n_p: f64,
}

impl<T: Real> Place<T> for Electric<'_, T> {
    #[inline(always)]
    fn variable(&self, variable: Variable) -> T {
        let phase = |k: usize| inverse_park(self.at.i, self.at.sin_cos.1, self.at.sin_cos.0)[k];
        match variable {
            Variable::OmegaM => self.at.env.omega_e * (1.0 / self.n_p),
            Variable::CurrentD => self.at.i[0],
            Variable::CurrentQ => self.at.i[1],
            Variable::CurrentA => phase(0),
            Variable::CurrentB => phase(1),
            Variable::CurrentC => phase(2),
            Variable::VoltageD => self.at.v[0],
            Variable::VoltageQ => self.at.v[1],
            other => (&self.at.env).variable(other),
        }
    }
}

/// A sensor at the angle that it shows.
struct Shown<'a, T> {
    env: &'a Env<T>,
    n_p: f64,
}

impl<T: Real> Place<T> for Shown<'_, T> {
    #[inline(always)]
    fn variable(&self, variable: Variable) -> T {
        match variable {
            Variable::OmegaM => self.env.omega_e * (1.0 / self.n_p),
            other => self.env.variable(other),
        }
    }
}

/// The magnet's flux at an angle.
struct Magnets<'a, T> {
    env: &'a Env<T>,
    psi_m: T,
}

impl<T: Real> Place<T> for Magnets<'_, T> {
    #[inline(always)]
    fn variable(&self, variable: Variable) -> T {
        match variable {
            Variable::PsiM => self.psi_m,
            other => self.env.variable(other),
        }
    }
}

/// The field at a flux linkage.
struct Fields<'a, T> {
    at: &'a FieldPoint<T>,
    base: &'a Base<T>,
}

impl<T: Real> Place<T> for Fields<'_, T> {
    #[inline(always)]
    fn variable(&self, variable: Variable) -> T {
        match variable {
            Variable::FluxD => self.at.flux[0] - self.at.magnet[0],
            Variable::FluxQ => self.at.flux[1] - self.at.magnet[1],
            Variable::InductanceD => T::one() / self.base.inverse_l_d,
            Variable::InductanceQ => T::one() / self.base.inverse_l_q,
            _ => T::zero(),
        }
    }
}

impl Text {
    #[inline(always)]
    fn at<T: Real, P: Place<T>>(&self, p: &[T], cx: &Context, place: P) -> [T; OUTPUTS] {
        self.code.run(At { sources: &self.sources, p, cx, place })
    }
}

/// The hooks of [`crate::effect::Effect`]: those of its side do what its formula says, the others nothing.
impl TextId {
    /// Its description.
    pub fn info(self) -> &'static Info {
        &self.text().info
    }
    /// As the user gave it.
    pub fn definition(self) -> &'static Definition {
        &self.text().definition
    }
    pub(super) fn side(self) -> Side {
        self.text().definition.side
    }
    pub(super) fn derived(self) -> &'static [Derived] {
        &[]
    }
    pub(super) fn is_first_order(self) -> bool {
        self.text().first_order
    }
    pub(super) fn jumps(self) -> bool {
        self.text().jumps
    }
    pub(super) fn probes(self, _: &Context) -> Vec<Vec<f64>> {
        self.text().probes.clone()
    }
    pub(super) fn fitted(self, _: &Context, index: usize) -> bool {
        self.info().parameters[index].role != Role::Fixed
    }
    pub(super) fn idles(self, _: &[f64], _: &Context) -> bool {
        false
    }
    pub(super) fn turned(self, _: &mut [f64], _: f64) -> bool {
        false
    }
    pub(super) fn outputs<T: Real>(self, p: &[T], _: &Base<T>, _: &Context) -> Vec<Output<T>> {
        self.info().parameters.iter().zip(p).map(|(info, value)| (info.name, info.unit, *value)).collect()
    }
    #[inline(always)]
    pub(super) fn rotor<T: Real>(
        self,
        p: &[T],
        _: &[T],
        at: &Mechanical<T>,
        cx: &Context,
        out: &mut Rotor<T>,
    ) {
        if self.side() == Side::Torque {
            out.loss += self.text().at(p, cx, at)[0];
        }
    }
    #[inline(always)]
    pub(super) fn voltage<T: Real>(
        self,
        p: &[T],
        _: &[T],
        at: &Electrical<T>,
        cx: &Context,
        lost: &mut [T; 2],
    ) {
        if self.side() == Side::Voltage {
            let [d, q, ..] = self.text().at(p, cx, Electric { at, n_p: cx.n_p });
            lost[0] += d;
            lost[1] += q;
        }
    }
    #[inline(always)]
    pub(super) fn magnet<T: Real>(self, p: &[T], psi_m: T, env: &Env<T>, cx: &Context, out: &mut Magnet<T>) {
        if self.side() == Side::Flux {
            let [d, q, d_slope, q_slope, _] = self.text().at(p, cx, Magnets { env, psi_m });
            out.flux[0] += d;
            out.flux[1] += q;
            out.slope[0] += d_slope;
            out.slope[1] += q_slope;
        }
    }
    #[inline(always)]
    pub(super) fn field<T: Real>(
        self,
        p: &[T],
        at: &FieldPoint<T>,
        base: &Base<T>,
        cx: &Context,
        out: &mut Field<T>,
    ) {
        if self.side() == Side::Energy {
            let [d, q, dd, dq, qq] = self.text().at(p, cx, Fields { at, base });
            out.i[0] += d;
            out.i[1] += q;
            out.inverse[0] += dd;
            out.inverse[1] += dq;
            out.inverse[2] += qq;
        }
    }
    #[inline(always)]
    pub(super) fn sensor<T: Real>(self, p: &[T], env: &Env<T>, cx: &Context, out: &mut Sensor<T>) {
        match self.side() {
            Side::Angle => {
                let [error, slope, ..] = self.text().at(p, cx, Shown { env, n_p: cx.n_p });
                out.angle += error;
                out.angle_slope += slope;
            }
            Side::Current => {
                let [a, b, c, ..] = self.text().at(p, cx, Shown { env, n_p: cx.n_p });
                out.offset[0] += a;
                out.offset[1] += b;
                out.offset[2] += c;
            }
            _ => {}
        }
    }
    #[inline(always)]
    pub(super) fn drift<T: Real>(self, _: &[T], _: &[T], _: &Env<T>, _: &Context, _: &mut Drift<T>) {}
    #[inline(always)]
    pub(super) fn command<T: Real>(self, _: &[T], _: &[[T; 2]; 3], _: T, _: &Context, _: &mut [T; 2]) {}
    #[inline(always)]
    pub(super) fn shunt<T: Real>(self, _: &[T], _: &[T], _: (T, T), _: &Context, _: &mut [T; 2]) {}
    #[inline(always)]
    pub(super) fn electrical_start<T: Real>(self, _: &[T], _: &Electrical<T>, _: &Context, _: &mut [T]) {}
    #[inline(always)]
    pub(super) fn electrical_states<T: Real>(
        self,
        _: &[T],
        _: &[T],
        _: &Electrical<T>,
        _: &Context,
        _: &mut [T],
    ) {
    }
    #[inline(always)]
    pub(super) fn mechanical_states<T: Real>(
        self,
        _: &[T],
        _: &[T],
        _: &Mechanical<T>,
        _: T,
        _: &Context,
        _: &mut [T],
    ) {
    }
    #[inline(always)]
    pub(super) fn mechanical_start<T: Real>(
        self,
        _: &[T],
        _: &Mechanical<T>,
        _: T,
        _: &Context,
        _: &mut [T],
    ) {
    }
    #[inline(always)]
    pub(super) fn ringing<T: Real>(self, _: &[T]) -> T {
        T::zero()
    }
}
