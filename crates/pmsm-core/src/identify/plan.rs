//! What a recording lets one fit: what drives the model, which parameters, from where and within which bounds.

use super::{Target, Warm};
use crate::base::BASE;
use crate::error::{Error, Result};
use crate::kernels::objective::Drive;
use crate::machine::{BaseParameter, Machine};
use crate::optimise::uncertainty::NotShown;
use crate::recording::{Kind, Load};
use crate::signals::Signals;
use crate::start;

/// Default bounds reach from the first value over this factor to that times this factor.
const REACH: f64 = 5.0;
/// Default bounds of the load torque, in rated torques to either side.
const RATED_TORQUES: f64 = 3.0;
/// A best point this close to the edge of its range, as a share of the range, lies on it.
const EDGE: f64 = 0.01;
/// Share of the largest torque below which a load, or the friction at the highest speed, hardly matters.
const MATTERS: f64 = 0.05;

/// What will be fitted.
#[derive(Debug, Clone)]
pub struct Plan {
    /// What drives the model.
    pub drive: Drive,
    /// The parameters that are fitted.
    pub targets: Vec<Target>,
    /// Their bounds, SI.
    pub bounds: Vec<(f64, f64)>,
    /// The whole point to start from: base parameters and load torque.
    pub start: Vec<f64>,
    /// What was asked for and is not in the equations of this recording, and other limits of the answer.
    pub refused: Vec<NotShown>,
}

impl Plan {
    /// Lays out the fit of what is asked for; nothing asked for means all that the recording's equations contain.
    /// `signals` is marked as purely electrical where the measured speed drives the model.
    ///
    /// # Errors
    /// [`Error::Unusable`] if none of the parameters is in the recording's equations, or a first value is neither on the
    /// nameplate nor visible; [`Error::Quantity`] for bounds outside the physical range.
    pub fn new(
        signals: &mut Signals,
        machine: &Machine,
        fit: &[(Target, Option<(f64, f64)>)],
    ) -> Result<Self> {
        let drive = drive(signals, machine, fit);
        if drive == Drive::MeasuredSpeed {
            signals.kind = Kind::Electrical;
        }
        let mut start = start::values(signals, machine)?.to_vec();
        start.push(0.0);
        let unknown_load = matches!(signals.load, Load::UnknownConstant | Load::UnknownPiecewise);
        let mut asked: Vec<(Target, Option<(f64, f64)>)> = fit.to_vec();
        if asked.is_empty() {
            let all = Target::ALL.into_iter().filter(|t| by_default(*t, drive, unknown_load));
            asked = all.map(|t| (t, None)).collect();
        }
        let mechanical = matches!(drive, Drive::Coupled | Drive::MeasuredTorque);
        if mechanical && unknown_load && !asked.iter().any(|(t, _)| *t == Target::TauLoad) {
            // An unknown load cannot be left at zero.
            asked.push((Target::TauLoad, None));
        }
        let mut plan = Self { drive, targets: Vec::new(), bounds: Vec::new(), start, refused: Vec::new() };
        for (target, bounds) in asked {
            if plan.targets.contains(&target) {
                return Err(Error::unusable(format!("{} is named twice", target.name()), "name it once"));
            }
            if let Some(why) = missing(target, drive, signals) {
                plan.refused.push(NotShown { parameters: vec![target.name().into()], why });
                continue;
            }
            let bounds = match bounds {
                Some(given) => check(target, given)?,
                None => default_bounds(target, plan.start[target.index()], signals, machine),
            };
            let first = &mut plan.start[target.index()];
            *first = first.clamp(bounds.0, bounds.1);
            plan.targets.push(target);
            plan.bounds.push(bounds);
        }
        if plan.targets.is_empty() {
            let names: Vec<&str> = fit.iter().map(|(t, _)| t.name()).collect();
            let why = plan.refused.first().map_or("", |r| r.why.as_str());
            return Err(Error::unusable(format!("{} cannot be fitted: {why}", names.join(", ")), FIX));
        }
        if signals.load == Load::UnknownPiecewise && plan.targets.contains(&Target::TauLoad) {
            plan.refused.push(NotShown {
                parameters: vec!["tau_load".into()],
                why: "the load is said to change in steps; what is fitted is one constant for the whole recording; \
                      fit the stretches between the steps one by one"
                    .into(),
            });
        }
        Ok(plan)
    }

    /// Starts from these values, as far as they are fitted and within their bounds.
    pub fn begin(&mut self, values: &[(Target, f64)]) {
        for (target, value) in values {
            if let Some(k) = self.targets.iter().position(|t| t == target) {
                self.start[target.index()] = value.clamp(self.bounds[k].0, self.bounds[k].1);
            }
        }
    }

    /// Starts what `warm` does not know, and for which `asked` gives no bounds, from a regression of the equations, if the `cost` of the
    /// whole point is then lower.
    pub fn begin_unknown(
        &mut self,
        warm: Warm,
        asked: &[(Target, Option<(f64, f64)>)],
        signals: &Signals,
        cost: impl Fn(&[f64]) -> f64,
    ) {
        let known = |target: &Target| {
            let bounded = asked.iter().any(|(t, bounds)| t == target && bounds.is_some());
            bounded || warm.values.iter().any(|(t, _)| t == target)
        };
        let unknown: Vec<Target> = self.targets.iter().copied().filter(|t| !known(t)).collect();
        if unknown.is_empty() {
            return;
        }
        let indices: Vec<usize> = unknown.iter().map(|t| t.index()).collect();
        let point = start::regressed(signals, &self.start, &indices);
        let mut other = self.clone();
        other.begin(&unknown.iter().map(|t| (*t, point[t.index()])).collect::<Vec<_>>());
        if cost(&other.start) < cost(&self.start) {
            *self = other;
        }
    }

    /// The same plan with the bounds of what `warm` knows drawn in around its start.
    pub fn narrowed(&self, warm: Warm, signals: &Signals) -> Self {
        let mut narrow = self.clone();
        for (target, (low, high)) in self.targets.iter().zip(&mut narrow.bounds) {
            if warm.values.iter().any(|(t, _)| t == target) {
                let first = self.start[target.index()];
                let reach = warm.share * size(*target, first, signals);
                (*low, *high) = (low.max(first - reach), high.min(first + reach));
            }
        }
        narrow
    }

    /// Whether `values` lie on an edge of these bounds that is none of the plan's this one was drawn from.
    pub fn on_edge(&self, values: &[f64], wide: &Self) -> bool {
        (0..values.len()).any(|k| {
            let ((low, high), (least, most)) = (self.bounds[k], wide.bounds[k]);
            let margin = EDGE * (high - low);
            (low > least && values[k] - low <= margin) || (high < most && high - values[k] <= margin)
        })
    }

    /// Positions of the fitted parameters in the point.
    pub fn free(&self) -> Vec<usize> {
        self.targets.iter().map(|t| t.index()).collect()
    }

    /// The whole point with the fitted parameters at `values`.
    pub fn point(&self, values: &[f64]) -> Vec<f64> {
        let mut point = self.start.clone();
        for (target, value) in self.targets.iter().zip(values) {
            point[target.index()] = *value;
        }
        point
    }

    /// The fitted parameters from a regression of the equations around the starting point.
    pub fn regressed(&self, signals: &Signals) -> Vec<f64> {
        let point = start::regressed(signals, &self.start, &self.free());
        self.targets.iter().map(|t| point[t.index()]).collect()
    }

    /// The fitted parameters of the starting point.
    pub fn first(&self) -> Vec<f64> {
        self.targets.iter().map(|t| self.start[t.index()]).collect()
    }
}

const FIX: &str = "record voltages, currents and speed of a running machine, or name other parameters";

fn drive(signals: &Signals, machine: &Machine, fit: &[(Target, Option<(f64, f64)>)]) -> Drive {
    match signals.kind {
        Kind::OperatingPoints => Drive::OperatingPoints,
        Kind::OpenCircuit => Drive::OpenCircuit,
        Kind::Mechanical => Drive::MeasuredTorque,
        Kind::Electrical => Drive::MeasuredSpeed,
        Kind::Full => {
            let unknown_load = matches!(signals.load, Load::UnknownConstant | Load::UnknownPiecewise);
            let rotor_known =
                BaseParameter::MECHANICAL.iter().all(|p| machine.get(*p).is_some()) && !unknown_load;
            let rotor_asked = fit.is_empty() || fit.iter().any(|(t, _)| t.is_mechanical());
            if rotor_known || rotor_asked { Drive::Coupled } else { Drive::MeasuredSpeed }
        }
    }
}

fn by_default(target: Target, drive: Drive, unknown_load: bool) -> bool {
    match (target, drive) {
        (Target::TauLoad, Drive::Coupled | Drive::MeasuredTorque) => unknown_load,
        (_, Drive::Coupled) => true,
        (_, Drive::MeasuredTorque) => target.is_mechanical(),
        (_, Drive::OpenCircuit) => target == Target::Base(BaseParameter::PsiM),
        _ => !target.is_mechanical(),
    }
}

/// Why the equations of this recording do not contain a parameter, if they do not.
fn missing(target: Target, drive: Drive, signals: &Signals) -> Option<String> {
    let name = target.name();
    match drive {
        Drive::Coupled => None,
        Drive::MeasuredSpeed if target.is_mechanical() => {
            Some(format!("{name} acts on the speed alone, and the rotor is held"))
        }
        Drive::OperatingPoints if target.is_mechanical() => Some(format!(
            "{name} acts on the speed alone, and steady operating points show no change of speed"
        )),
        Drive::OpenCircuit if target != Target::Base(BaseParameter::PsiM) => {
            Some(format!("{name} does not show in the voltages of open terminals"))
        }
        Drive::MeasuredTorque if !target.is_mechanical() => {
            let torque = target == Target::Base(BaseParameter::PsiM) && signals.tau_e.is_none();
            (!torque).then(|| format!("{name} acts on the voltages, which were not recorded"))
        }
        _ => None,
    }
}

fn check(target: Target, (low, high): (f64, f64)) -> Result<(f64, f64)> {
    let (least, most) = match target {
        Target::Base(p) => p.physical_range(),
        Target::TauLoad => (f64::MIN, f64::MAX),
    };
    let bounds = (low.max(least), high.min(most));
    if low.is_finite() && high.is_finite() && bounds.0 < bounds.1 {
        return Ok(bounds);
    }
    let expected =
        format!("give two finite bounds, the lower one first, that reach into {least:e} to {most:e}");
    Err(Error::quantity(&format!("bound of {}", target.name()), low, target.unit(), &expected))
}

fn default_bounds(target: Target, first: f64, signals: &Signals, machine: &Machine) -> (f64, f64) {
    let cx = &signals.context;
    let Target::Base(p) = target else {
        let psi_m = machine.get(BaseParameter::PsiM);
        let rated = psi_m.zip(machine.i_rated).map_or(0.0, |(psi, i)| 1.5 * cx.n_p * psi * i);
        let reach = RATED_TORQUES * rated.max(cx.tau_max);
        return (-reach, reach);
    };
    let (least, most) = p.physical_range();
    let scale = match p {
        // Friction may be far from its nameplate value, or zero.
        BaseParameter::B => first.max(MATTERS * cx.tau_max / cx.omega_m_max()),
        _ => first,
    };
    let low = if p == BaseParameter::B { 0.0 } else { scale / REACH };
    (low.max(least), (scale * REACH).min(most).max(least * REACH))
}

/// How large a change of the parameter matters, in its unit.
pub fn size(target: Target, value: f64, signals: &Signals) -> f64 {
    let cx = &signals.context;
    match target {
        Target::TauLoad => value.abs().max(MATTERS * cx.tau_max),
        Target::Base(BaseParameter::B) => value.abs().max(MATTERS * cx.tau_max / cx.omega_m_max()),
        Target::Base(_) => value.abs(),
    }
}

/// What kind of recording shows a parameter.
pub fn advice(name: &str) -> String {
    let what = match name {
        "r_s" => "run slowly with a large current",
        "l_d" => "step i_d, or run fast with i_d away from zero",
        "l_q" => "step i_q, or run fast under load",
        "psi_m" => "run at different speeds",
        "j" => "accelerate and brake",
        "b" => "run at different steady speeds",
        _ => "accelerate, and run at different steady speeds",
    };
    format!("to see {name}, {what}")
}

// Index of the load torque: behind the base parameters of the bare machine.
pub(super) const LOAD: usize = BASE;
