//! From a definition to an effect: dimensions, values, strengths, and the instructions for the inner loops.

mod samples;

use super::quantities::{self, Entry, VARIABLES};
use super::{Definition, Quantity, Side, Slots, Text, UNUSED};
use crate::effect::{Context, Info, Need, Parameter, Role};
use crate::error::Result;
use crate::numerics::bytecode::Bytecode;
use crate::numerics::derivative::along;
use crate::numerics::dimension::Dimension;
use crate::numerics::expression::{Expression, Fault, Function, Given, dimension, parse};
use crate::numerics::real::Real;
use crate::numerics::symbolic::{Program, Symbol, trace};
use quantities::Variable;

/// Values of each shape from which a search starts, and sets of them at most.
const PROBES: usize = 3;
const MOST_PROBES: usize = 64;
/// Share of its largest size that a strength usually has, where nothing else is said.
const USUAL: f64 = 0.02;
/// Ratio of the bounds from which a shape is tried in steps of equal ratio.
const WIDE: f64 = 8.0;

/// The formulas of a definition with what they are made of.
pub(super) struct Formulas<'a> {
    pub definition: &'a Definition,
    pub entries: Vec<Entry>,
    pub terms: Vec<Expression>,
}

/// A definition whose names are right as an effect.
pub(super) fn text(definition: &Definition) -> Result<Text> {
    let formulas = Formulas::read(definition)?;
    for (k, parameter) in definition.parameters.iter().enumerate() {
        if !formulas.uses(formulas.entries.len() + k) {
            let problem = format!("no formula has the parameter '{}'", parameter.name);
            return Err(definition.wrong(problem, "leave it out, or use it"));
        }
    }
    formulas.stays_finite()?;
    let strengths = formulas.strengths()?;
    if definition.side == Side::Energy {
        formulas.calls_for_nothing()?;
    }
    let program = formulas.program();
    let code = Bytecode::of(&program).ok_or_else(|| {
        definition
            .wrong("its formulas need more than 32 numbers at once", "write them shorter, or as two effects")
    })?;
    let roles: Vec<Role> = (0..definition.parameters.len())
        .map(|k| match strengths.contains(&k) {
            true => Role::Amplitude,
            false if definition.parameters[k].values.is_empty() => Role::Shape,
            false => Role::Fixed,
        })
        .collect();
    let first_order = strengths.iter().all(|k| formulas.slopes(*k, &strengths));
    // Torques that turn over with the speed within a fraction of a sample step, as friction does.
    let speed = formulas.has(Variable::OmegaM) || formulas.has(Variable::OmegaE);
    let turning = [Function::Tanh, Function::Sign, Function::Atan, Function::Sqrt, Function::Abs];
    let jumps = definition.side == Side::Torque
        && speed
        && formulas.terms.iter().any(|term| turning.iter().any(|f| term.calls(*f)));
    let usual: Vec<f64> = definition.parameters.iter().zip(&roles).map(|(p, role)| usual(p, *role)).collect();
    Ok(Text {
        slots: formulas.slots(&code),
        parameters: formulas.parameters(&code),
        widths: formulas.widths(&code),
        probes: probes(definition, &roles, &usual),
        info: formulas.info(&roles, &usual),
        definition: definition.clone(),
        code,
        first_order,
        jumps,
    })
}

impl<'a> Formulas<'a> {
    fn read(definition: &'a Definition) -> Result<Self> {
        let entries = quantities::of_side(definition.side);
        let names: Vec<&str> = entries
            .iter()
            .map(|(name, ..)| *name)
            .chain(definition.parameters.iter().map(|p| p.name.as_str()))
            .collect();
        let units = entries.iter().map(|(_, _, unit, ..)| *unit);
        let dimensions: Vec<Dimension> = units
            .chain(definition.parameters.iter().map(|p| p.unit.as_str()))
            .map(|unit| Dimension::parse(unit).map_err(|(problem, fix)| definition.wrong(problem, fix)))
            .collect::<Result<_>>()?;
        let scaled = |k: usize| entries.get(k).is_some_and(|(_, variable, ..)| variable.has_scale());
        let given: Vec<Given<'_>> = (0..names.len())
            .map(|k| Given { name: names[k], dimension: dimensions[k], scaled: scaled(k) })
            .collect();
        let wanted = Dimension::parse(definition.side.unit()).unwrap_or(Dimension::NUMBER);
        let mut terms = Vec::new();
        for (k, text) in definition.terms.iter().enumerate() {
            let elsewhere = |mut fault: Fault| {
                let name = fault.problem.split('\'').nth(1).unwrap_or_default();
                if quantities::ALL.iter().any(|(known, ..)| *known == name) && !names.contains(&name) {
                    fault.problem =
                        format!("'{name}' is not known where {} is computed", definition.side.name());
                    let known: Vec<&str> = entries.iter().map(|(name, ..)| *name).collect();
                    fault.fix = format!("use {}", known.join(", "));
                }
                definition.fault(k, fault)
            };
            let term = parse(text, &names).map_err(elsewhere)?;
            let own = dimension(&term, &given).map_err(|fault| definition.fault(k, fault))?;
            if let Some(own) = own.filter(|own| *own != wanted) {
                let missing = wanted.over(own);
                let problem = format!(
                    "it is in {own}, and {} is in {}",
                    definition.side.name(),
                    definition.side.unit()
                );
                let fix = format!("multiply it by a parameter in {missing}, or correct the unit of one");
                return Err(definition.fault(k, Fault { at: 1, problem, fix }));
            }
            terms.push(term);
        }
        Ok(Self { definition, entries, terms })
    }

    fn uses(&self, name: usize) -> bool {
        self.terms.iter().any(|term| term.uses(name))
    }

    /// Whether a formula uses a variable.
    fn has(&self, variable: Variable) -> bool {
        let places = (0..self.entries.len()).filter(|k| self.entries[*k].1 == variable);
        places.into_iter().any(|k| self.uses(k))
    }

    /// The register of each variable.
    fn slots(&self, code: &Bytecode) -> Slots {
        let mut slots = [UNUSED; VARIABLES];
        for (k, (_, variable, ..)) in self.entries.iter().enumerate() {
            if let Some(register) = code.register(k) {
                slots[*variable as usize] = register;
            }
        }
        slots
    }

    /// Parameters with their registers; parameters follow the variables among the inputs of the program.
    fn parameters(&self, code: &Bytecode) -> Vec<(u8, u8)> {
        let count = 0..self.definition.parameters.len();
        let placed = count.filter_map(|k| Some((k as u8, code.register(self.entries.len() + k)?)));
        placed.collect()
    }

    /// Variables whose sign is taken, with the registers of its widths, which are the last inputs of the program.
    fn widths(&self, code: &Bytecode) -> Vec<(Variable, u8)> {
        let first = self.entries.len() + self.definition.parameters.len();
        let all = self.entries.iter().enumerate();
        all.filter_map(|(k, (_, variable, ..))| Some((*variable, code.register(first + k)?))).collect()
    }

    /// The formulas and the derivatives that the model needs of them.
    fn program(&self) -> Program {
        let (variables, names) = (self.entries.len(), self.entries.len() + self.definition.parameters.len());
        let inputs = || (0..names + variables).map(|k| k.to_string()).collect::<Vec<_>>();
        let named = |all: Vec<Symbol>| all.into_iter().map(|x| (String::new(), x)).collect::<Vec<_>>();
        let direction = |x: &[Symbol], of: &[(Variable, Symbol)]| -> Vec<Symbol> {
            let mut direction = vec![Symbol::zero(); x.len()];
            for (k, (_, variable, ..)) in self.entries.iter().enumerate() {
                if let Some((_, slope)) = of.iter().find(|(v, _)| v == variable) {
                    direction[k] = *slope;
                }
            }
            direction
        };
        let plain = trace(inputs(), |x| {
            let mut widths = x[names..].to_vec();
            widths.resize(names, Symbol::one());
            // Names of one variable are one input.
            let mut x = x[..names].to_vec();
            for k in 1..variables {
                if let Some(first) = (0..k).find(|j| self.entries[*j].1 == self.entries[k].1) {
                    (x[k], widths[k]) = (x[first], widths[first]);
                }
            }
            named(self.terms.iter().map(|term| term.value(&x, &widths)).collect())
        });
        match self.definition.side {
            Side::Torque | Side::Voltage | Side::Current => plain,
            Side::Flux | Side::Angle => trace(inputs(), |x| {
                let pairs = self.entries.iter().position(|(_, v, ..)| *v == Variable::PolePairs);
                let per_pair = pairs.map_or(Symbol::one(), |k| Symbol::one() / x[k]);
                let turning = [(Variable::ThetaE, Symbol::one()), (Variable::ThetaM, per_pair)];
                let (mut values, slopes) = along(&plain, x, &direction(x, &turning));
                values.extend(slopes);
                named(values)
            }),
            Side::Energy => {
                let axes = [Variable::FluxD, Variable::FluxQ];
                let first = trace(inputs(), |x| {
                    let slope = |v| along(&plain, x, &direction(x, &[(v, Symbol::one())])).1[0];
                    named(axes.map(slope).to_vec())
                });
                trace(inputs(), |x| {
                    let [(i, d), (_, q)] =
                        axes.map(|v| along(&first, x, &direction(x, &[(v, Symbol::one())])));
                    named(vec![i[0], i[1], d[0], d[1], q[1]])
                })
            }
        }
    }

    fn needs(&self) -> Vec<Need> {
        let used = |wanted: fn(Variable) -> bool| {
            self.entries.iter().enumerate().any(|(k, (_, v, ..))| wanted(*v) && self.uses(k))
        };
        let mut needs = Vec::new();
        if used(Variable::needs_angle) {
            needs.extend([Need::Angle, Need::Transients]);
        }
        if used(|v| v == Variable::Time) && !needs.contains(&Need::Transients) {
            needs.push(Need::Transients);
        }
        let currents = [Variable::CurrentA, Variable::CurrentB, Variable::CurrentC];
        let flows = [Variable::CurrentD, Variable::CurrentQ];
        let current = currents.into_iter().chain(flows).any(|v| self.has(v));
        match self.definition.side {
            Side::Energy => needs.push(Need::Current),
            Side::Current => needs = vec![Need::Angle, Need::Transients, Need::Current],
            Side::Flux | Side::Angle => needs.push(Need::Motion),
            Side::Voltage if current => needs.push(Need::Current),
            _ => {}
        }
        needs
    }

    /// The description, which lives as long as the process.
    fn info(&self, roles: &[Role], usual: &[f64]) -> Info {
        let definition = self.definition;
        let parameters: Vec<Parameter> = definition
            .parameters
            .iter()
            .zip(roles)
            .zip(usual)
            .map(|((p, role), usual)| Parameter {
                name: kept(&p.name),
                unit: kept(&p.unit),
                meaning: kept(p.meaning.as_deref().unwrap_or(match role {
                    Role::Amplitude => "strength of the formula",
                    _ => "parameter of the formula",
                })),
                role: *role,
                low: number(p.low),
                high: number(p.high),
                typical: number(*usual),
            })
            .collect();
        let equation = definition.equation();
        Info {
            id: kept(&definition.name),
            title: kept(definition.title.as_deref().unwrap_or(&definition.name)),
            sentence: kept(&format!("An effect given as text: {equation}.")),
            equation: kept(&equation),
            source: "given as text",
            fingerprint: "What its formula says",
            look_alikes: &[],
            contains: &[],
            site: definition.side.site(),
            needs: self.needs().leak(),
            parameters: parameters.leak(),
        }
    }
}

/// A text that lives as long as the process.
fn kept(text: &str) -> &'static str {
    text.to_string().leak()
}

/// A bound that does not depend on the machine.
fn number(x: f64) -> &'static (dyn Fn(&Context) -> f64 + Send + Sync) {
    Box::leak(Box::new(move |_: &Context| x))
}

/// The usual value of a parameter.
fn usual(p: &Quantity, role: Role) -> f64 {
    p.typical.or(p.values.first().copied()).unwrap_or_else(|| match role {
        Role::Amplitude => {
            let most = if p.high >= -p.low { p.high } else { p.low };
            USUAL * most
        }
        _ if p.low > 0.0 => (p.low * p.high).sqrt(),
        _ => 0.5 * (p.low + p.high),
    })
}

/// Sets of parameters from which a search starts: each shape at a few values of its range.
fn probes(definition: &Definition, roles: &[Role], usual: &[f64]) -> Vec<Vec<f64>> {
    let mut sets = vec![usual.to_vec()];
    for (k, (p, role)) in definition.parameters.iter().zip(roles).enumerate() {
        let values = match role {
            Role::Amplitude => continue,
            Role::Fixed => p.values.clone(),
            Role::Shape => spread(p, usual[k]),
        };
        if sets.len() * values.len() > MOST_PROBES {
            continue;
        }
        let with = |set: &Vec<f64>, x: f64| {
            let mut set = set.clone();
            set[k] = x;
            set
        };
        sets = values.iter().flat_map(|x| sets.iter().map(|set| with(set, *x)).collect::<Vec<_>>()).collect();
    }
    sets
}

/// The usual value of a shape among values over its range.
fn spread(p: &Quantity, usual: f64) -> Vec<f64> {
    let share = |k: usize| (k as f64 + 0.5) / PROBES as f64;
    let even = p.low > 0.0 && p.high / p.low > WIDE;
    let value = |k: usize| match even {
        true => p.low * (p.high / p.low).powf(share(k)),
        false => p.low + (p.high - p.low) * share(k),
    };
    let mut values: Vec<f64> = (0..PROBES).map(value).collect();
    let near = |x: &f64| (x - usual).abs() <= 1e-6 * (p.high - p.low);
    if !values.iter().any(near) {
        values.push(usual);
    }
    values
}
