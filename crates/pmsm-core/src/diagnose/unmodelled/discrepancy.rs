//! The discrepancy of the equation of motion: what any smooth torque over speed and angle could explain.
//!
//! An effect that such a torque replaces has no claim to its name: an eddy brake looks much like Stribeck friction, and is none. How smooth
//! the torque is, evidence decides for each set: friction that jumps at standstill beside a smooth torque is simpler than a torque that is as
//! steep as a jump. What a smooth torque cannot do at all is a high order or a frequency. In integral form along the measured speed all of
//! this is linear, so that one least-squares solution per set tells; beside a shaft it is so to first order. The recording and the validation
//! run are solved for together.

use super::linear::Linear;
use super::{Side, candidates};
use crate::basis::orthonormal;
use crate::diagnose::data::Data;
use crate::diagnose::evidence::{Evidence, price};
use crate::diagnose::hypothesis::Hypothesis;
use crate::diagnose::options::DiagnosisOptions;
use crate::effect::{Role, Site};
use crate::effects::EffectId;
use crate::experiment::Channel;
use crate::map::Part;
use crate::model::Slot;
use crate::tall;
use nalgebra::{DMatrix, DVector};

/// Weight of a coefficient of the discrepancy at zero, share of its own square: what no row shows stays there.
const UNSHOWN: f64 = 1e-9;

/// The choice of no smooth torque.
const NO_TORQUE: usize = 0;
/// Most numbers held of one run.
const CELLS: usize = 20_000_000;

/// A recording with a set of effects fitted to it, or transferred to it.
pub(super) type Seen<'a> = (&'a Data, &'a Hypothesis);

/// What each mechanical effect of a set explains beside the discrepancy, nats; zero, an even chance, where no solution tells. It is not asked
/// of effects with states of their own, which nothing smooth replaces. `runs` are the recording and the validation run, each with the same set.
pub(super) fn beside_discrepancy(runs: &[Seen]) -> Vec<(EffectId, f64)> {
    let (data, set) = runs[0];
    let choices = Choices::new(data, set);
    let machine = machine_parameters(data, set);
    let normals: Vec<Normal> = runs.iter().map(|run| Normal::new(*run, &machine, &choices.parts)).collect();
    let asked = |slot: &&Slot| {
        slot.effect.info().site == Site::Mechanical && slot.effect.mechanical_state_count() == 0
    };
    let solved = || {
        let samples = samples(&normals)?;
        let (whole, beside) = choices.least(&normals, machine.len(), &samples)?;
        let remains = choices.excess(&normals, machine.len(), beside)?;
        let alone = choices.excess(&normals, machine.len(), NO_TORQUE)?;
        Some((samples, whole, remains, alone))
    };
    let solved = solved();
    let worth = |slot: &Slot| -> Option<f64> {
        let (samples, whole, remains, alone) = solved.as_ref()?;
        let own: Vec<usize> = (0..machine.len()).filter(|k| slot.parameters.contains(&machine[*k])).collect();
        // At zero strength an effect is not there: its strengths go all the way back, and its shapes tell nothing any more.
        let back = |k: &usize| {
            let parameter = machine[*k];
            let role = slot.effect.info().parameters[parameter - slot.parameters.start].role;
            if role == Role::Amplitude { -set.parameters[parameter] } else { 0.0 }
        };
        let back: Vec<(usize, f64)> = own.iter().map(|k| (*k, back(k))).collect();
        let without: Vec<Normal> = normals.iter().map(|normal| normal.moved(&back)).collect();
        let (fewer, _) = choices.least(&without, machine.len() - own.len(), samples)?;
        let lost = choices.excess(&without, machine.len() - own.len(), NO_TORQUE)?;
        if lost - alone < *remains {
            // It is no larger than what remains of unknown cause, which may well be that of this part, too.
            return Some(f64::NEG_INFINITY);
        }
        // Of the forms that were tried one is there.
        let forms = slot.effect.probes(set.model.context()).len().max(1) as f64;
        // What swings in time has its own phase by the clock of each run.
        let clocked = slot.effect.info().parameters.iter().any(|p| p.unit == "Hz");
        let times = if clocked { normals.len() } else { 1 };
        let options = &data.options;
        let cost = options.effect_cost + forms.ln() + price(samples, options) * (times * own.len()) as f64;
        Some(fewer - whole - cost)
    };
    let known = |slot: &Slot| (slot.effect, worth(slot).filter(|nats| !nats.is_nan()).unwrap_or(0.0));
    set.model.slots().iter().filter(asked).map(known).collect()
}

/// The fitted parameters of the machine and its effects in the equation of motion.
fn machine_parameters(data: &Data, set: &Hypothesis) -> Vec<usize> {
    let fitted = Side::Mechanical.parameters(data, set);
    fitted.into_iter().filter(|k| *k < set.model.parameter_count()).collect()
}

/// What a set leaves beside the discrepancy that suits it best, with the price of its own parameters, nats.
pub(super) fn cost_beside_discrepancy(runs: &[Seen], samples_of: &[Seen]) -> Option<f64> {
    let (data, set) = runs[0];
    let choices = Choices::new(data, set);
    let normals_of = |runs: &[Seen]| -> (Vec<Normal>, usize) {
        let machine = machine_parameters(data, runs[0].1);
        (runs.iter().map(|run| Normal::new(*run, &machine, &choices.parts)).collect(), machine.len())
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

/// Independent samples of the mean square of the speed on each of the runs. Noise has many; of a torque that is missing the integral over a
/// window is one. The variance of the sum of both tells.
fn samples(normals: &[Normal]) -> Option<Vec<f64>> {
    let each = excesses(normals)?;
    let count = |(normal, excess): (&Normal, f64)| {
        let more = excess.max(0.0);
        (1.0 + more).powi(2) / (1.0 / normal.noise + more * more / normal.windows)
    };
    Some(normals.iter().zip(each).map(count).collect())
}

/// The torques that may be there beside a set: any one over the speed, or none, and all over the turn, or none.
struct Choices {
    parts: Vec<Part>,
    /// Columns of each choice, counted from the first one of the parts.
    columns: Vec<Vec<usize>>,
    options: DiagnosisOptions,
}

impl Choices {
    fn new(data: &Data, set: &Hypothesis) -> Self {
        let (speed, turn) = candidates::discrepancies(data, set);
        let mut at = 0;
        let mut place = |parts: &Vec<Part>| {
            let from = at;
            at += parts.iter().map(Part::count).sum::<usize>();
            (from..at).collect::<Vec<usize>>()
        };
        let over_speed: Vec<Vec<usize>> = speed.iter().map(&mut place).collect();
        let over_turn = place(&turn);
        let mut columns = Vec::new();
        for speed in std::iter::once(Vec::new()).chain(over_speed) {
            columns.extend([speed.clone(), [&speed[..], &over_turn].concat()]);
        }
        Self { parts: [speed.concat(), turn].concat(), columns, options: data.options }
    }

    /// What a set of so many parameters leaves beside the torque that suits it best, with the price of that torque, nats; and which it is.
    fn least(&self, normals: &[Normal], parameters: usize, samples: &[f64]) -> Option<(f64, usize)> {
        let cost = |choice: usize| {
            let left = left(&self.beside(normals, parameters, choice), samples)?;
            // Physics that no catalogue holds is as rare as an effect of the catalogue.
            let prior = if choice == NO_TORQUE { 0.0 } else { self.options.effect_cost };
            let price = price(samples, &self.options) * self.columns[choice].len() as f64;
            Some((left + prior + price, choice))
        };
        (0..self.columns.len()).filter_map(cost).min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Mean squares beyond the noise that such a set leaves beside one of the torques, summed over the runs.
    fn excess(&self, normals: &[Normal], parameters: usize, choice: usize) -> Option<f64> {
        let each = excesses(&self.beside(normals, parameters, choice))?;
        Some(each.iter().map(|excess| excess.max(0.0)).sum())
    }

    fn beside(&self, normals: &[Normal], parameters: usize, choice: usize) -> Vec<Normal> {
        let torque = self.columns[choice].iter().map(|k| parameters + k);
        let kept: Vec<usize> = (0..parameters).chain(torque).collect();
        normals.iter().map(|normal| normal.only(&kept)).collect()
    }
}

/// What a set and the discrepancy together leave of the speed on all runs, nats.
fn left(normals: &[Normal], samples: &[f64]) -> Option<f64> {
    // Below the noise nothing is earned.
    let nats = |(excess, samples): (&f64, &f64)| 0.5 * samples * excess.max(0.0).ln_1p();
    Some(excesses(normals)?.iter().zip(samples).map(nats).sum())
}

/// Mean square of the speed that is left on each run, over the floor's and beyond one.
fn excesses(normals: &[Normal]) -> Option<Vec<f64>> {
    let size = normals[0].along.len();
    let (mut gram, mut along) = (DMatrix::zeros(size, size), DVector::zeros(size));
    for normal in normals {
        gram += &normal.gram;
        along += &normal.along;
    }
    for k in 0..size {
        gram[(k, k)] += UNSHOWN * gram[(k, k)] + f64::MIN_POSITIVE.sqrt();
    }
    let step = -gram.cholesky()?.solve(&along);
    let excess = |normal: &Normal| {
        let square = normal.square + 2.0 * step.dot(&normal.along) + step.dot(&(&normal.gram * &step));
        square / normal.rows - 1.0
    };
    Some(normals.iter().map(excess).collect())
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
    fn new((data, set): Seen, machine: &[usize], parts: &[Part]) -> Self {
        let torque = candidates::torque(data, set);
        let own: Vec<usize> = (set.model.parameter_count()..set.parameters.len()).collect();
        let view = Linear::new(data, set, Side::Mechanical, &torque);
        let count = machine.len() + parts.iter().map(Part::count).sum::<usize>();
        // Of a long recording every so many rows say the same: neighbours of an integral hardly differ.
        let stride = (data.signals.len() * count).div_ceil(CELLS).max(1);
        let kept = data.signals.len().div_ceil(stride);
        let sparse = |block: &DMatrix<f64>| block.rows_with_step(0, kept, stride - 1).into_owned();
        let (residual, known) = view.at(&[machine, &own].concat());
        let mut all = DMatrix::zeros(kept, count);
        all.columns_mut(0, machine.len()).copy_from(&sparse(&known).columns(0, machine.len()));
        let mut at = machine.len();
        for part in parts {
            all.columns_mut(at, part.count()).copy_from(&sparse(&view.columns(part)));
            at += part.count();
        }
        let mut residual = DVector::from_fn(kept, |k, _| residual[k * stride]);
        let basis = orthonormal(&sparse(&known).columns(machine.len(), own.len()).into_owned());
        if basis.ncols() > 0 {
            all -= &basis * tall::tr_mul(&basis, &all);
            residual -= &basis * tall::tr_mul_vector(&basis, &residual);
        }
        let (gram, along) = (tall::gram(&all), tall::tr_mul_vector(&all, &residual));
        let rows = data.counted() as f64 / stride as f64;
        let windows = data.windows.len() as f64;
        let channels = data.runs().iter().flat_map(|run| &run.floors).map(|floor| floor.channel);
        let evidence = Evidence::new(data, &[]);
        let speeds = channels.zip(evidence.samples()).filter(|(channel, _)| *channel == Channel::OmegaE);
        let noise = speeds.map(|(_, n)| n).sum::<f64>().max(windows);
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
