//! Finds when an unknown, piecewise constant load torque changes.
//!
//! The equation of motion is integrated at the *measured* speed,
//!
//! > y(t) = ∫J·a dt − J·(ω_m(t) − ω_m(0)),  a = acceleration of the model without load,
//!
//! in which a load step at s is a hinge Δτ·max(0, t − s) under little noise. In this form a wrong inertia adds the speed
//! itself, which no load resembles. Steps are added where a hinge explains
//! most, together with corrections of the model's own mechanical parameters, moved, and pruned again; how much a step
//! must explain follows from the effective number of independent samples in what is left.

use crate::base::Base;
use crate::basis;
use crate::dual::Dual;
use crate::effect::Site;
use crate::effects::EffectId;
use crate::model::Model;
use crate::monitor::Monitor;
use crate::real::Real;
use crate::signals::Signals;
use crate::simulate::electrical::measured_env;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Points of the grid on which y(t) is looked at.
const POINTS: usize = 1200;
/// Instants tried in the first scan.
const SCAN: usize = 240;
/// What a step must gain in the log-likelihood-like n_eff·ln(SSE ratio): two parameters and the freedom to choose.
const GAIN: f64 = 30.0;
/// Steps allowed per second, and at least.
const RATE: (f64, usize) = (4.0, 4);
/// Closest distance of two steps, share of the duration.
pub const CLOSEST: f64 = 0.004;
/// Strides in which steps are moved, one after the other, in units of the first scan's: down to where the noise would leave them, lest
/// a second step be needed to put the first one right.
const STRIDES: [f64; 4] = [0.5, 0.12, 0.03, 0.007];
/// Mechanical parameters of the model that may be corrected at once.
const LANES: usize = 8;

/// Instants (s from the first sample, ascending) at which the load changes, given the motor torque per sample
/// `tau_e` and the mechanical parameters `free` that may still be wrong. Effects with states of their own are
/// taken as rigid here. Once `monitor` says stop, those that have been found by then.
pub fn find(
    model: &Model,
    signals: &Signals,
    p: &[f64],
    tau_e: &[f64],
    free: &[usize],
    monitor: &dyn Monitor,
) -> Vec<f64> {
    let grid = Grid::new(model, signals, p, tau_e, free);
    let most = RATE.1.max((RATE.0 * signals.context.duration) as usize);
    // Steps are added without asking what they are worth, because with some of them missing what is left is too
    // coloured to tell; those that do not pay in the end are pruned.
    let mut steps: Vec<f64> = Vec::new();
    while steps.len() < most && !monitor.cancelled() {
        let Some(step) = Fit::new(&grid, &steps).best_hinge(&grid, &steps) else { break };
        steps.push(step);
        grid.move_each(&mut steps, &STRIDES[..2], monitor);
    }
    grid.move_each(&mut steps, &STRIDES, monitor);
    grid.prune(&mut steps, monitor);
    steps
}

/// y(t), and the columns that may take part of it, on a coarse grid.
struct Grid {
    t: Vec<f64>,
    /// Half the time over which each point is an average, s.
    half: Vec<f64>,
    /// y(t) without what the columns can do.
    y: DVector<f64>,
    /// Orthonormal basis of the columns.
    basis: DMatrix<f64>,
    closest: f64,
}

impl Grid {
    fn new(model: &Model, signals: &Signals, p: &[f64], tau_e: &[f64], free: &[usize]) -> Self {
        let rigid: Vec<EffectId> =
            model.effects().into_iter().filter(|e| e.mechanical_state_count() == 0).collect();
        let mut kept = Model::new(*model.context(), &rigid);
        if let Some(map) = model.map() {
            kept = kept.with_map(map.clone());
        }
        let (values, places) = restrict(model, &kept, p);
        let seeds: Vec<usize> =
            free.iter().filter_map(|k| places.get(*k).copied().flatten()).take(LANES).collect();
        let mut seeded: Vec<Dual<LANES>> = values.iter().map(|x| Dual::constant(*x)).collect();
        for (slot, place) in seeds.iter().enumerate() {
            seeded[*place] = Dual::variable(values[*place], slot);
        }
        let base = Base::new(&seeded);
        let n = signals.len();
        let block = n.div_ceil(POINTS).max(1);
        let count = n.div_ceil(block);
        let (mut t, mut y) = (Vec::with_capacity(count), DVector::zeros(count));
        let mut half = Vec::with_capacity(count);
        let mut columns = DMatrix::zeros(count, 2 + seeds.len());
        let n_p = signals.n_p;
        let acceleration = |k: usize| -> Dual<LANES> {
            let env = measured_env(signals, k);
            let tau = Dual::constant(tau_e[k]);
            let load = known_load(signals, k);
            kept.mechanical_rhs(&seeded, &base, &[env.omega_e * (1.0 / n_p)], tau, Dual::constant(load), &env)
                [0]
                * base.j
        };
        let mut sum = Dual::<LANES>::zero();
        let mut last = acceleration(0);
        for k in 0..n {
            if k > 0 {
                let now = acceleration(k);
                sum += (last + now) * (0.5 * (signals.t[k] - signals.t[k - 1]));
                last = now;
            }
            let row = k / block;
            let weight = 1.0 / (block.min(n - row * block)) as f64;
            if k % block == 0 {
                t.push(0.0);
                let last = (k + block).min(n) - 1;
                half.push(0.5 * (signals.t[last] - signals.t[k]));
            }
            t[row] += signals.t[k] * weight;
            let rest = sum - base.j * ((signals.omega_e[k] - signals.omega_e[0]) / n_p);
            y[row] += rest.re * weight;
            for slot in 0..seeds.len() {
                columns[(row, 2 + slot)] += rest.eps[slot] * weight;
            }
        }
        for row in 0..count {
            columns[(row, 0)] = 1.0;
            columns[(row, 1)] = t[row];
        }
        for slot in model.slots() {
            let f = slot.effect.ringing(&p[slot.parameters.clone()]);
            if f > 0.0 {
                let step = (t[count - 1] - t[0]) / (count - 1) as f64;
                let half = (0.5 / (f * step)).round() as usize;
                smooth(y.as_mut_slice(), half);
                columns.column_iter_mut().for_each(|mut column| smooth(column.as_mut_slice(), half));
            }
        }
        let basis = basis::orthonormal(&columns);
        y -= &basis * basis.tr_mul(&y);
        Self { t, half, y, basis, closest: CLOSEST * signals.context.duration }
    }

    /// The hinges of steps, one column each.
    fn hinges(&self, steps: &[f64]) -> DMatrix<f64> {
        DMatrix::from_fn(self.t.len(), steps.len(), |row, column| {
            let (behind, half) = (self.t[row] - steps[column], self.half[row]);
            if behind.abs() < half { (behind + half).powi(2) / (4.0 * half) } else { behind.max(0.0) }
        })
    }

    /// Moves each step to where it explains most, in ever finer strides.
    fn move_each(&self, steps: &mut [f64], strides: &[f64], monitor: &dyn Monitor) {
        let duration = self.t[self.t.len() - 1];
        for stride in strides.iter().map(|s| s / SCAN as f64) {
            for at in (0..steps.len()).take_while(|_| !monitor.cancelled()) {
                let others: Vec<f64> =
                    steps.iter().enumerate().filter(|(k, _)| *k != at).map(|(_, s)| *s).collect();
                let fit = Fit::new(self, &others);
                let tried = (-4..=4).map(|k| steps[at] + f64::from(k) * stride * duration);
                if let Some(best) = fit.best_of(self, tried, &others) {
                    steps[at] = best;
                }
            }
        }
        steps.sort_by(f64::total_cmp);
    }

    /// Takes away every step that does not pay for itself once the others are in place.
    fn prune(&self, steps: &mut Vec<f64>, monitor: &dyn Monitor) {
        while !monitor.cancelled() {
            let whole = Fit::new(self, steps);
            let worth = |at: usize| {
                let mut others = steps.clone();
                others.remove(at);
                (at, gain(&Fit::new(self, &others), &whole))
            };
            let worths: Vec<(usize, f64)> = (0..steps.len()).into_par_iter().map(worth).collect();
            let weakest = worths.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
            match weakest {
                Some((at, worth)) if worth < GAIN => {
                    steps.remove(at);
                    self.move_each(steps, &STRIDES, monitor);
                }
                _ => return,
            }
        }
    }
}

/// Takes a ringing out by averaging over its period, twice `half` points; a hinge stays a hinge but for its corner.
fn smooth(x: &mut [f64], half: usize) {
    let n = x.len();
    if half == 0 || 4 * half > n {
        return;
    }
    let mut sums = vec![0.0; n + 1];
    for k in 0..n {
        sums[k + 1] = sums[k] + x[k];
    }
    for (k, x) in x.iter_mut().enumerate() {
        // Symmetric everywhere, so that a straight line stays one at the ends.
        let reach = half.min(k).min(n - 1 - k);
        *x = (sums[k + reach + 1] - sums[k - reach]) / (2 * reach + 1) as f64;
    }
}

/// Least-squares fit of y(t) by the columns and the hinges of some steps.
struct Fit {
    /// Orthonormal basis of both.
    basis: DMatrix<f64>,
    residual: DVector<f64>,
}

impl Fit {
    fn new(grid: &Grid, steps: &[f64]) -> Self {
        let own = basis::orthonormal_beside(&grid.basis, &grid.hinges(steps));
        let residual = &grid.y - &own * own.tr_mul(&grid.y);
        let columns: Vec<_> = grid.basis.column_iter().chain(own.column_iter()).collect();
        Self { basis: DMatrix::from_columns(&columns), residual }
    }

    fn best_hinge(&self, grid: &Grid, steps: &[f64]) -> Option<f64> {
        let (start, end) = (grid.t[0], grid.t[grid.t.len() - 1]);
        self.best_of(grid, (1..SCAN).map(|k| start + (end - start) * k as f64 / SCAN as f64), steps)
    }

    fn best_of(&self, grid: &Grid, tried: impl Iterator<Item = f64>, others: &[f64]) -> Option<f64> {
        let (start, end) = (grid.t[0] + grid.closest, grid.t[grid.t.len() - 1] - grid.closest);
        let apart = |s: &f64| others.iter().all(|o| (o - s).abs() > grid.closest);
        let tried: Vec<f64> = tried.filter(|s| *s > start && *s < end && apart(s)).collect();
        let gains = basis::gains(&self.basis, &grid.hinges(&tried), &self.residual);
        tried.into_iter().zip(gains).max_by(|a, b| a.1.total_cmp(&b.1)).map(|(s, _)| s)
    }
}

/// n_eff·ln(SSE before / SSE after), n_eff from the colour of what is left afterwards.
fn gain(before: &Fit, after: &Fit) -> f64 {
    let (a, b) = (before.residual.norm_squared(), after.residual.norm_squared());
    if b <= 0.0 {
        return 0.0;
    }
    effective_samples(after.residual.as_slice()) * (a / b).ln()
}

/// Effective number of independent samples of a coloured series: n/(1 + 2Σρ), summed up to the first ρ < 0.05.
pub fn effective_samples(x: &[f64]) -> f64 {
    let n = x.len();
    let energy: f64 = x.iter().map(|v| v * v).sum();
    if energy <= 0.0 {
        return n as f64;
    }
    let correlation = |lag: usize| (0..n - lag).map(|k| x[k] * x[k + lag]).sum::<f64>() / energy;
    // Every lag at first; then ever longer strides, the correlation being smooth by then.
    let (mut colour, mut lag, mut last) = (1.0, 1, 1.0);
    let mut before = 0;
    while lag < n / 2 {
        let rho = correlation(lag);
        if rho < 0.05 {
            break;
        }
        let stride = (lag - before) as f64;
        colour += 2.0 * (rho + (stride - 1.0) * 0.5 * (last + rho));
        (before, last) = (lag, rho);
        lag += 1 + lag / 16;
    }
    (n as f64 / colour).max(2.0)
}

fn known_load(signals: &Signals, k: usize) -> f64 {
    match signals.load {
        crate::recording::Load::KnownConstant(value) => value,
        crate::recording::Load::Measured => signals.tau_m.as_ref().map_or(0.0, |tau| tau[k]),
        _ => 0.0,
    }
}

/// The parameters of `kept` out of those of `model`, and where each of the latter went.
fn restrict(model: &Model, kept: &Model, p: &[f64]) -> (Vec<f64>, Vec<Option<usize>>) {
    let mut values = p[..crate::base::BASE].to_vec();
    let mut places: Vec<Option<usize>> = (0..crate::base::BASE).map(Some).collect();
    for slot in model.slots() {
        let stays = kept.slots().iter().any(|s| s.effect == slot.effect);
        let mechanical = slot.effect.info().site == Site::Mechanical;
        for k in slot.parameters.clone() {
            if stays {
                places.push(mechanical.then_some(values.len()));
                values.push(p[k]);
            } else {
                places.push(None);
            }
        }
    }
    for k in model.map_parameters() {
        places.push(Some(values.len()));
        values.push(p[k]);
    }
    (values, places)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::{BaseParameter, Machine};
    use crate::monitor::{Silent, StopFlag};
    use crate::recording::{Load, Recording};

    const J: f64 = 0.01;
    const B: f64 = 0.002;

    /// A deterministic stand-in for white noise between −1 and 1.
    fn noise(k: i32) -> f64 {
        let x = (f64::from(k) * 12.9898).sin() * 43_758.545_3;
        2.0 * (x - x.floor()) - 1.0
    }

    /// Speed and torque of a rigid machine that swings while its load changes at `steps`, integrated in fine Euler steps.
    fn run(levels: &[f64], steps: &[f64]) -> (Recording, Machine) {
        let (n, h) = (8000, 2.5e-4);
        let (mut t, mut speed, mut torque) = (Vec::new(), Vec::new(), Vec::new());
        let mut omega = 0.0;
        for k in 0..n {
            let now = f64::from(k) * h;
            let drive = |time: f64| 2.0 * (8.0 * time).sin() + 1.0;
            t.push(now);
            speed.push(omega + 0.05 * noise(k));
            torque.push(drive(now));
            for fine in 0..20 {
                let time = now + f64::from(fine) * h / 20.0;
                let load = levels[steps.iter().filter(|s| **s <= time).count()];
                omega += (drive(time) - B * omega - load) / J * h / 20.0;
            }
        }
        let columns = vec![("t".into(), t), ("omega_m".into(), speed), ("tau_e".into(), torque)];
        let recording = Recording::new(columns, Some(Load::UnknownPiecewise)).unwrap();
        // The nameplate is off, as nameplates are.
        let machine = Machine::new(1).unwrap().with(BaseParameter::J, 0.012).unwrap();
        (recording, machine.with(BaseParameter::B, 0.0025).unwrap())
    }

    fn found(levels: &[f64], steps: &[f64]) -> Vec<f64> {
        let (recording, machine) = run(levels, steps);
        let signals = Signals::new(&recording, &machine).unwrap();
        let model = Model::new(signals.context, &[]);
        let torque = signals.tau_e.clone().unwrap();
        let p = [1.0, 1e-3, 1e-3, 0.1, 0.012, 0.0025];
        find(&model, &signals, &p, &torque, &[4, 5], &Silent)
    }

    #[test]
    fn steps_are_found_in_spite_of_a_wrong_nameplate() {
        let steps = [0.4, 0.9, 1.45];
        let found = found(&[0.8, 1.6, 0.5, 1.2], &steps);
        assert_eq!(found.len(), steps.len(), "{found:?}");
        for (found, step) in found.iter().zip(steps) {
            assert!((found - step).abs() < 0.001, "{step}: {found}");
        }
    }

    #[test]
    fn nothing_is_sought_once_it_is_to_stop() {
        let (recording, machine) = run(&[0.8, 1.6], &[0.9]);
        let signals = Signals::new(&recording, &machine).unwrap();
        let stop = StopFlag::default();
        stop.stop();
        let (model, torque) = (Model::new(signals.context, &[]), signals.tau_e.clone().unwrap());
        let p = [1.0, 1e-3, 1e-3, 0.1, 0.012, 0.0025];
        assert!(find(&model, &signals, &p, &torque, &[4, 5], &stop).is_empty());
    }

    #[test]
    fn a_constant_load_has_no_steps() {
        assert_eq!(found(&[0.8], &[]), Vec::<f64>::new());
    }

    #[test]
    fn coloured_series_are_worth_fewer_samples() {
        let white: Vec<f64> = (0..2000).map(noise).collect();
        let slow: Vec<f64> = (0..2000).map(|k| (f64::from(k) / 50.0).sin()).collect();
        assert!(effective_samples(&white) > 1500.0);
        assert!(effective_samples(&slow) < 60.0);
    }
}
