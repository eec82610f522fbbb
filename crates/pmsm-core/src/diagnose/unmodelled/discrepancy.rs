//! The discrepancy of an equation: a smooth torque over speed and turn, or a smooth voltage over speed, currents and turn.
//!
//! An effect that such a term replaces is not named: an eddy brake resembles Stribeck friction, and is none. Evidence decides how smooth the
//! term is, for each set anew: friction that jumps at standstill beside a smooth torque is simpler than a torque as steep as a jump. A smooth
//! torque describes neither a high order nor a frequency. Sensors may err, too: current sensors lag, and the angle is late or flawed.
//!
//! In integral form along the measured speed the motion is linear in all of this, so that one least-squares solution per set suffices. With a
//! shaft, and for the currents, it is linear to first order. The recording and the validation run are solved for together.

use super::integral::{Integral, TORQUE_CONSTANTS};
use super::linear::Linear;
use super::{Side, candidates, sides};
use crate::diagnose::data::Data;
use crate::diagnose::evidence::{Evidence, price};
use crate::diagnose::hypothesis::{Hypothesis, independent_samples};
use crate::diagnose::options::DiagnosisOptions;
use crate::effect::Role;
use crate::effects::EffectId;
use crate::experiment::{LAGS, LATE, LATE_SQUARED, TURNED};
use crate::map::Part;
use crate::model::Slot;
use crate::numerics::basis::orthonormal;
use crate::numerics::tall;
use crate::recording::Kind;
use nalgebra::{DMatrix, DVector};

/// Weight of a coefficient of the discrepancy at zero, share of its own square: what no row shows stays there.
const UNSHOWN: f64 = 1e-9;

/// Most nats of an effect that a smooth term or the remainder may replace: less than an even chance.
const NOT_NAMED: f64 = -1e-9;
/// Error of the columns of sensors, share of an effect that is taken back as far as it goes: they are of first order, and of a turn by 0.3 rad
/// the second one is 0.15. `cargo test -p pmsm-core columns_of_a_late_angle` tells the error of the first order, which is far less.
const SENSORS_KNOWN_TO: f64 = 0.15;
/// The choice of no discrepancy.
const NONE: usize = 0;
/// Time over which a missing effect counts as one independent sample, s: that of a window of the motion.
const LASTS: f64 = 0.25;
/// Most numbers held of one run.
const CELLS: usize = 20_000_000;

/// A recording with a set of effects fitted to it, or transferred to it.
pub(super) type Seen<'a> = (&'a Data, &'a Hypothesis);

/// Gain of each effect on one side of a set beside the discrepancy, nats; zero, an even chance, where there is no solution. A shaft is not
/// compared: its trace changes with its strength, and no smooth term replaces it. Nor are names that cover any function. `runs`
/// are the recording and the validation run, each with the same set.
pub(super) fn beside_discrepancy(runs: &[Seen], side: Side) -> Vec<(EffectId, f64)> {
    let (data, set) = runs[0];
    let choices = Choices::new(data, set, side);
    let machine = machine_parameters(data, set, side);
    let normals: Vec<Normal> = runs.iter().map(|run| Normal::new(*run, side, &machine, &choices)).collect();
    let asked = |slot: &&Slot| side.has(slot.effect) && slot.effect.is_first_order();
    let solved = || {
        let samples = samples(&normals)?;
        let (whole, beside) = choices.least(&normals, machine.len(), &samples)?;
        let remains = choices.excess(&normals, machine.len(), beside)?;
        let alone = choices.excess(&normals, machine.len(), NONE)?;
        Some((samples, whole, beside, remains, alone))
    };
    let solved = solved();
    let worth = |slot: &Slot| -> Option<f64> {
        let (samples, whole, beside, remains, alone) = solved.as_ref()?;
        let own: Vec<usize> = (0..machine.len()).filter(|k| slot.parameters.contains(&machine[*k])).collect();
        // The set without an effect has it at zero strength, where its shapes do not matter.
        let back = |k: &usize| {
            let parameter = machine[*k];
            let role = slot.effect.info().parameters[parameter - slot.parameters.start].role;
            if role == Role::Amplitude { -set.parameters[parameter] } else { 0.0 }
        };
        let back: Vec<(usize, f64)> = own.iter().map(|k| (*k, back(k))).collect();
        let without: Vec<Normal> = normals.iter().map(|normal| normal.moved(&back)).collect();
        let (fewer, _) = choices.least(&without, machine.len() - own.len(), samples)?;
        let lost = choices.excess(&without, machine.len() - own.len(), NONE)?;
        let explained = choices.excess(&without, machine.len() - own.len(), *beside)? - remains;
        // A smooth term is an approximation, as the form of an effect is. An effect that explains less than its error is not named.
        let of_form = explained < slot.effect.form().powi(2) * (alone - remains);
        // The remainder is of unknown cause, which may be the cause of this part, too.
        let of_remainder = lost - alone < data.options.beside_remainder * remains;
        // Of the forms that were tried one is there.
        let forms = slot.effect.probes(set.model.context()).len().max(1) as f64;
        // An oscillation in time has another phase on the clock of each run.
        let clocked = slot.effect.info().parameters.iter().any(|p| p.unit == "Hz");
        let times = if clocked { normals.len() } else { 1 };
        let options = &data.options;
        let cost = options.effect_cost + forms.ln() + price(samples, options) * (times * own.len()) as f64;
        // A wrong angle may turn the frame far. The columns of sensors then explain an effect up to their second order.
        let others: Vec<usize> = (0..machine.len()).filter(|k| !own.contains(k)).collect();
        let by_sensors = choices.of_sensors(*beside)
            && outside(&normals, &back, &[&others[..], &choices.places(machine.len(), *beside)].concat())?
                < SENSORS_KNOWN_TO.powi(2) * outside(&normals, &back, &others)?;
        let nats = match slot.effect.is_smooth() {
            _ if by_sensors => -cost,
            // A curve that spares a smooth term some coefficients is not the cause that the term describes.
            true => {
                let best = choices.best_fit(&without, machine.len() - own.len(), samples)?;
                best - left(&choices.beside(&normals, machine.len(), *beside), samples)? - cost
            }
            false => fewer - whole - cost,
        };
        // Not named either way; the gain orders those that are dropped.
        Some(if of_form || of_remainder { nats.min(NOT_NAMED) } else { nats })
    };
    let known = |slot: &Slot| (slot.effect, worth(slot).filter(|nats| !nats.is_nan()).unwrap_or(0.0));
    set.model.slots().iter().filter(asked).map(known).collect()
}

/// Sum of squares over the runs of the part of a step of some columns that is orthogonal to the `others`.
fn outside(normals: &[Normal], step: &[(usize, f64)], others: &[usize]) -> Option<f64> {
    let gram = total(normals).0;
    let product = |k: usize| step.iter().map(|(own, x)| gram[(k, *own)] * x).sum::<f64>();
    let square: f64 = step.iter().map(|(own, x)| product(*own) * x).sum();
    let along = DVector::from_iterator(others.len(), others.iter().map(|k| product(*k)));
    let taken = self::step(gram.select_rows(others).select_columns(others), &along)?;
    Some((square + along.dot(&taken)).max(0.0))
}

/// The fitted parameters of the machine and its effects in the equations of one side. What makes the torque of given currents is among those
/// of the motion where the voltage equations leave more than noise: whatever is missing there has biased it.
fn machine_parameters(data: &Data, set: &Hypothesis, side: Side) -> Vec<usize> {
    let fitted = side.parameters(data, set);
    let mut own: Vec<usize> = fitted.into_iter().filter(|k| *k < set.model.parameter_count()).collect();
    let biased = side == Side::Mechanical && sides(data, set).contains(&Side::Electrical);
    if biased && Integral::applies(data, set) {
        own.extend(TORQUE_CONSTANTS.iter().map(|p| p.index()).filter(|k| set.free.contains(k)));
    }
    own
}

/// Cost of a set for the motion beside its best discrepancy, its own parameters included, nats.
pub(super) fn cost_beside_discrepancy(runs: &[Seen], samples_of: &[Seen]) -> Option<f64> {
    let ((data, set), side) = (runs[0], Side::Mechanical);
    let choices = Choices::new(data, set, side);
    let normals_of = |runs: &[Seen]| -> (Vec<Normal>, usize) {
        let machine = machine_parameters(data, runs[0].1, side);
        (runs.iter().map(|run| Normal::new(*run, side, &machine, &choices)).collect(), machine.len())
    };
    let samples = samples(&normals_of(samples_of).0)?;
    let (normals, count) = normals_of(runs);
    let (left, _) = choices.least(&normals, count, &samples)?;
    Some(left + price(&samples, &data.options) * count as f64)
}

/// Whether an effect is more likely there than not.
pub(super) fn likely(nats: f64) -> bool {
    nats >= 0.0
}

/// Independent samples of the mean square on each of the runs, from the variance of noise and missing effect together. Noise has many. Of a
/// missing effect a window of the motion, or as long a stretch of the currents, is one.
fn samples(normals: &[Normal]) -> Option<Vec<f64>> {
    let each = excesses(normals)?;
    let count = |(normal, excess): (&Normal, f64)| {
        let more = excess.max(0.0);
        (1.0 + more).powi(2) / (1.0 / normal.noise + more * more / normal.windows)
    };
    Some(normals.iter().zip(each).map(count).collect())
}

/// The terms that may be there beside a set: any one of the smooth ones, or none; any one over the turn, or none; currents that lag, or none; an
/// angle that is late, or is flawed over the turn, or neither.
struct Choices {
    parts: Vec<Part>,
    /// Whether sensors may err: their columns follow those of the parts.
    sensors: bool,
    /// Columns of each choice, counted from the first one of the parts.
    columns: Vec<Vec<usize>>,
    options: DiagnosisOptions,
}

impl Choices {
    fn new(data: &Data, set: &Hypothesis, side: Side) -> Self {
        let (smooth, turn) = match side {
            Side::Mechanical => candidates::lost_torques(data, set),
            Side::Electrical => candidates::lost_voltages(data, set),
        };
        let mut at = 0;
        let mut place = |count: usize| {
            at += count;
            (at - count..at).collect::<Vec<usize>>()
        };
        let count = |parts: &Vec<Part>| parts.iter().map(Part::count).sum::<usize>();
        let each: Vec<Vec<usize>> = smooth.iter().map(|parts| place(count(parts))).collect();
        let mut columns: Vec<Vec<usize>> = std::iter::once(Vec::new()).chain(each).collect();
        let sensors = side == Side::Electrical && data.has_electrical() && !data.is_steady();
        let mut with = |any_of: &[Vec<usize>]| {
            let own = columns.clone();
            for more in any_of.iter().filter(|more| !more.is_empty()) {
                columns.extend(own.iter().map(|own| [&own[..], more].concat()));
            }
        };
        let of_turn: Vec<Vec<usize>> = turn.iter().map(|parts| place(count(parts))).collect();
        with(&of_turn);
        if sensors {
            with(&[place(LAGS)]);
            let late = place(LATE);
            let squared = [&late[..], &place(LATE_SQUARED)].concat();
            with(&[late, squared, place(TURNED - LATE - LATE_SQUARED)]);
        }
        Self { parts: [smooth.concat(), turn.concat()].concat(), sensors, columns, options: data.options }
    }

    /// Columns of all terms together.
    fn count(&self) -> usize {
        self.parts.iter().map(Part::count).sum::<usize>() + if self.sensors { LAGS + TURNED } else { 0 }
    }

    /// Cost of a set of so many parameters beside its best term, the term included, nats; and which term that is.
    fn least(&self, normals: &[Normal], parameters: usize, samples: &[f64]) -> Option<(f64, usize)> {
        let cost = |choice: usize| {
            let left = left(&self.beside(normals, parameters, choice), samples)?;
            // Physics that no catalogue holds is as rare as an effect of the catalogue.
            let prior = if choice == NONE { 0.0 } else { self.options.effect_cost };
            let price = price(samples, &self.options) * self.columns[choice].len() as f64;
            Some((left + prior + price, choice))
        };
        (0..self.columns.len()).filter_map(cost).min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// The same of its residual alone, whatever the term takes to describe.
    fn best_fit(&self, normals: &[Normal], parameters: usize, samples: &[f64]) -> Option<f64> {
        let cost = |choice: usize| left(&self.beside(normals, parameters, choice), samples);
        (0..self.columns.len()).filter_map(cost).min_by(f64::total_cmp)
    }

    /// Excess mean square of such a set beside one of the terms, summed over the runs.
    fn excess(&self, normals: &[Normal], parameters: usize, choice: usize) -> Option<f64> {
        let each = excesses(&self.beside(normals, parameters, choice))?;
        Some(each.iter().map(|excess| excess.max(0.0)).sum())
    }

    /// Places of the terms of a choice behind so many parameters.
    fn places(&self, parameters: usize, choice: usize) -> Vec<usize> {
        self.columns[choice].iter().map(|k| parameters + k).collect()
    }

    /// Whether sensors err by a choice.
    fn of_sensors(&self, choice: usize) -> bool {
        let first = self.count() - if self.sensors { LAGS + TURNED } else { 0 };
        self.columns[choice].iter().any(|k| *k >= first)
    }

    fn beside(&self, normals: &[Normal], parameters: usize, choice: usize) -> Vec<Normal> {
        let kept: Vec<usize> = (0..parameters).chain(self.places(parameters, choice)).collect();
        normals.iter().map(|normal| normal.only(&kept)).collect()
    }
}

/// Cost of the residual of a set with the discrepancy on all runs, nats.
fn left(normals: &[Normal], samples: &[f64]) -> Option<f64> {
    // A residual below the noise gains nothing.
    let nats = |(excess, samples): (&f64, &f64)| 0.5 * samples * excess.max(0.0).ln_1p();
    Some(excesses(normals)?.iter().zip(samples).map(nats).sum())
}

/// Excess mean square of each run, in units of the floor's.
fn excesses(normals: &[Normal]) -> Option<Vec<f64>> {
    let (gram, along) = total(normals);
    let step = step(gram, &along)?;
    let excess = |normal: &Normal| {
        let square = normal.square + 2.0 * step.dot(&normal.along) + step.dot(&(&normal.gram * &step));
        square / normal.rows - 1.0
    };
    Some(normals.iter().map(excess).collect())
}

/// The normal equations of all runs together.
fn total(normals: &[Normal]) -> (DMatrix<f64>, DVector<f64>) {
    let size = normals[0].along.len();
    let (mut gram, mut along) = (DMatrix::zeros(size, size), DVector::zeros(size));
    for normal in normals {
        gram += &normal.gram;
        along += &normal.along;
    }
    (gram, along)
}

/// Least-squares step of all columns, held at zero as far as no row shows them.
fn step(mut gram: DMatrix<f64>, along: &DVector<f64>) -> Option<DVector<f64>> {
    for k in 0..along.len() {
        gram[(k, k)] += UNSHOWN * gram[(k, k)] + f64::MIN_POSITIVE.sqrt();
    }
    Some(-gram.cholesky()?.solve(along))
}

/// Normal equations of one run, its own load and initial speeds taken out.
struct Normal {
    gram: DMatrix<f64>,
    along: DVector<f64>,
    square: f64,
    rows: f64,
    /// Independent samples of noise, and windows.
    noise: f64,
    windows: f64,
}

impl Normal {
    fn new((data, set): Seen, side: Side, machine: &[usize], choices: &Choices) -> Self {
        let torque = candidates::torque(data, set);
        let open = set.model.parameter_count()..set.parameters.len();
        let own: Vec<usize> = match side {
            Side::Mechanical => open.collect(),
            Side::Electrical => side.parameters(data, set).into_iter().filter(|k| open.contains(k)).collect(),
        };
        let view = Linear::new(data, set, side, &torque);
        let count = machine.len() + choices.count();
        // A long recording is decimated: neighbouring rows hardly differ.
        let (residual, known) = view.at(&[machine, &own].concat());
        let stride = (residual.len() * count).div_ceil(CELLS).max(1);
        let kept = residual.len().div_ceil(stride);
        let sparse = |block: &DMatrix<f64>| block.rows_with_step(0, kept, stride - 1).into_owned();
        let mut all = DMatrix::zeros(kept, count);
        all.columns_mut(0, machine.len()).copy_from(&sparse(&known).columns(0, machine.len()));
        let mut at = machine.len();
        for part in &choices.parts {
            all.columns_mut(at, part.count()).copy_from(&sparse(&view.columns(part)));
            at += part.count();
        }
        if let Some(errs) = view.sensor_columns().filter(|_| choices.sensors) {
            all.columns_mut(at, LAGS + TURNED).copy_from(&sparse(&errs));
        }
        let mut residual = DVector::from_fn(kept, |k, _| residual[k * stride]);
        let basis = orthonormal(&sparse(&known).columns(machine.len(), own.len()).into_owned());
        if basis.ncols() > 0 {
            all -= &basis * tall::tr_mul(&basis, &all);
            residual -= &basis * tall::tr_mul_vector(&basis, &residual);
        }
        let (gram, along) = (tall::gram(&all), tall::tr_mul_vector(&all, &residual));
        let seen = data.runs().iter().map(|run| run.floors.iter().filter(|f| side.shows(f.channel)).count());
        let channels = seen.max().unwrap_or(0).max(1) as f64;
        let rows = data.counted() as f64 * channels / stride as f64;
        let windows = match data.signals.kind {
            // Successive points are often alike: as many count as have independent values beside all terms.
            Kind::OperatingPoints => {
                let left =
                    step(gram.clone(), &along).map_or(residual.clone(), |step| &residual + &all * step);
                let each = left.as_slice().chunks(kept.div_ceil(channels as usize));
                each.map(independent_samples).sum::<f64>().clamp(1.0, rows)
            }
            _ => channels * (data.windows.len() as f64).max(data.signals.context.duration / LASTS).max(1.0),
        };
        let shown = data.runs().iter().flat_map(|run| &run.floors).map(|floor| floor.channel);
        let evidence = Evidence::new(data, &[]);
        let own = shown.zip(evidence.samples()).filter(|(channel, _)| side.shows(*channel));
        let noise = own.map(|(_, n)| n).sum::<f64>().max(windows);
        Self { gram, along, square: residual.norm_squared(), rows, noise, windows }
    }

    /// Of these columns alone.
    fn only(&self, kept: &[usize]) -> Self {
        let gram = self.gram.select_columns(kept).select_rows(kept);
        Self { gram, along: self.along.select_rows(kept), ..*self }
    }

    /// Where some parameters have been moved by so much, and are fitted no more.
    fn moved(&self, by: &[(usize, f64)]) -> Self {
        let mut step = DVector::zeros(self.along.len());
        by.iter().for_each(|(k, x)| step[*k] = *x);
        let along = &self.along + &self.gram * &step;
        let square = self.square + step.dot(&(&self.along + &along));
        let gone: Vec<usize> = by.iter().map(|(k, _)| *k).collect();
        Self {
            gram: self.gram.clone().remove_columns_at(&gone).remove_rows_at(&gone),
            along: along.remove_rows_at(&gone),
            square,
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{choice, data, fitted, setup, speeds};
    use crate::drive::{Schedule, Shape};

    #[test]
    fn columns_of_a_late_angle_do_what_a_delayed_encoder_does() {
        let path: Vec<(f64, f64)> =
            (0..10).map(|k| (0.05 + 0.2 * f64::from(k), [90.0, -70.0, 40.0][k as usize % 3])).collect();
        let mut manoeuvre = speeds(2.0, &path);
        manoeuvre.i_d = Some(Schedule::new(vec![(0.0, 0.0), (0.4, -4.0), (1.4, 2.0)], Shape::Steps).unwrap());
        let encoder = EffectId::EncoderDelay;
        let (data, base) = data(&setup(manoeuvre, vec![choice("encoder_delay", "t_delay", 2.5e-4)]));
        let set = fitted(&data, &base, encoder);
        let turned = set.own()[crate::base::BASE] * data.signals.context.omega_e_max;
        assert!((turned - 0.09).abs() < 0.02, "{turned} rad");
        let side = Side::Electrical;
        let choices = Choices::new(&data, &set, side);
        let machine = machine_parameters(&data, &set, side);
        let normals = [Normal::new((&data, &set), side, &machine, &choices)];
        let own = machine.iter().position(|k| *k == crate::base::BASE).unwrap();
        let others: Vec<usize> = (0..machine.len()).filter(|k| *k != own).collect();
        let back = [(own, -set.own()[crate::base::BASE])];
        let whole = outside(&normals, &back, &others).unwrap();
        let first = choices.count() - TURNED;
        let late = (0..choices.columns.len()).find(|k| choices.columns[*k] == [first, first + 1, first + 2]);
        let late = choices.places(machine.len(), late.unwrap());
        let left = (outside(&normals, &back, &[&others[..], &late].concat()).unwrap() / whole).sqrt();
        assert!(left < SENSORS_KNOWN_TO, "{left}");
    }
}
