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
use quantities::{VARIABLES, Variable};

/// Share of its strength by which its parameters scatter with the form of its equation, as for most of the catalogue.
pub(super) const FORM: f64 = 0.005;

/// An effect given as text, as the inner loops need it.
#[derive(Debug)]
pub struct Text {
    /// As the user gave it.
    pub definition: Definition,
    info: Info,
    code: Bytecode,
    slots: Slots,
    /// Parameters that formulas use, with their registers, and widths of the signs of variables.
    parameters: Vec<(u8, u8)>,
    widths: Vec<(Variable, u8)>,
    probes: Vec<Vec<f64>>,
    first_order: bool,
    jumps: bool,
}

/// Where an effect as text is, from which the variables of its formulas come.
trait Place<T> {
    /// Writes the variables of this side that the formulas use to their registers.
    fn fill(&self, slots: &Slots, registers: &mut [T]);
}

/// The register of each variable; [`UNUSED`] where no formula uses it.
type Slots = [u8; VARIABLES];
const UNUSED: u8 = u8::MAX;

/// Writes the value of a variable to its register, if it has one.
macro_rules! put {
    ($slots:ident, $registers:ident, $($variable:ident = $value:expr),+ $(,)?) => {
        $(if let Some(place) = $registers.get_mut(usize::from($slots[Variable::$variable as usize])) {
            *place = $value;
        })+
    };
}

/// The inputs of a formula at a place.
struct At<'a, T, P> {
    text: &'a Text,
    p: &'a [T],
    cx: &'a Context,
    place: P,
}

impl<T: Real, P: Place<T>> Inputs<T> for At<'_, T, P> {
    #[inline(always)]
    fn fill(&self, registers: &mut [T]) {
        let (cx, slots) = (self.cx, &self.text.slots);
        for (k, register) in &self.text.parameters {
            registers[usize::from(*register)] = self.p[usize::from(*k)];
        }
        for (variable, register) in &self.text.widths {
            let width = (SMOOTHING * variable.scale(cx)).max(f64::MIN_POSITIVE);
            registers[usize::from(*register)] = T::constant(width);
        }
        put!(slots, registers, PolePairs = T::constant(cx.n_p));
        self.place.fill(slots, registers);
    }
}

impl<T: Real> Place<T> for &Env<T> {
    #[inline(always)]
    fn fill(&self, slots: &Slots, registers: &mut [T]) {
        put!(
            slots,
            registers,
            OmegaE = self.omega_e,
            ThetaM = self.theta_m,
            ThetaE = self.theta_e,
            Time = self.t
        );
    }
}

impl<T: Real> Place<T> for &Mechanical<T> {
    #[inline(always)]
    fn fill(&self, slots: &Slots, registers: &mut [T]) {
        put!(slots, registers, OmegaM = self.omega_m, TauE = self.tau_e);
        (&self.env).fill(slots, registers);
    }
}

/// The winding, whose speed is electrical.
struct Electric<'a, T> {
    at: &'a Electrical<T>,
    n_p: f64,
}

impl<T: Real> Place<T> for Electric<'_, T> {
    #[inline(always)]
    fn fill(&self, slots: &Slots, registers: &mut [T]) {
        let at = self.at;
        put!(
            slots,
            registers,
            OmegaM = at.env.omega_e * (1.0 / self.n_p),
            CurrentD = at.i[0],
            CurrentQ = at.i[1],
            VoltageD = at.v[0],
            VoltageQ = at.v[1],
        );
        let phases = [Variable::CurrentA, Variable::CurrentB, Variable::CurrentC];
        if phases.into_iter().any(|phase| slots[phase as usize] != UNUSED) {
            let [a, b, c] = inverse_park(at.i, at.sin_cos.1, at.sin_cos.0);
            put!(slots, registers, CurrentA = a, CurrentB = b, CurrentC = c);
        }
        (&at.env).fill(slots, registers);
    }
}

/// A sensor at the angle that it shows.
struct Shown<'a, T> {
    env: &'a Env<T>,
    n_p: f64,
}

impl<T: Real> Place<T> for Shown<'_, T> {
    #[inline(always)]
    fn fill(&self, slots: &Slots, registers: &mut [T]) {
        put!(slots, registers, OmegaM = self.env.omega_e * (1.0 / self.n_p));
        self.env.fill(slots, registers);
    }
}

/// The magnet's flux at an angle.
struct Magnets<'a, T> {
    env: &'a Env<T>,
    psi_m: T,
}

impl<T: Real> Place<T> for Magnets<'_, T> {
    #[inline(always)]
    fn fill(&self, slots: &Slots, registers: &mut [T]) {
        put!(slots, registers, PsiM = self.psi_m);
        self.env.fill(slots, registers);
    }
}

/// The field at a flux linkage.
struct Fields<'a, T> {
    at: &'a FieldPoint<T>,
    base: &'a Base<T>,
}

impl<T: Real> Place<T> for Fields<'_, T> {
    #[inline(always)]
    fn fill(&self, slots: &Slots, registers: &mut [T]) {
        put!(
            slots,
            registers,
            FluxD = self.at.flux[0] - self.at.magnet[0],
            FluxQ = self.at.flux[1] - self.at.magnet[1],
            InductanceD = T::one() / self.base.inverse_l_d,
            InductanceQ = T::one() / self.base.inverse_l_q,
        );
    }
}

impl Text {
    #[inline(always)]
    fn at<T: Real, P: Place<T>>(&self, p: &[T], cx: &Context, place: P) -> [T; OUTPUTS] {
        self.code.run(At { text: self, p, cx, place })
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
    #[inline(always)]
    pub(super) fn steepness<T: Real>(self, _: &[T], _: &Context) -> T {
        T::zero()
    }
}
