//! What the currents show of sensors that err: currents that lag, and an angle that is late over the speed or flawed over the turn.

use super::{Answering, Step};
use crate::effect::Env;
use crate::experiment::{Channel, Experiment, Linearisation};
use nalgebra::DMatrix;
use std::array::from_fn;

/// Ways in which current sensors lag.
pub const LAGS: usize = 3;
/// Functions of the speed, odd ones, by which the frame of an angle that is late may be turned.
pub const LATE: usize = 3;
/// Functions of the speed, even ones, that half the square of such a turn consists of: at 0.3 rad a seventh of the turn's voltage.
pub const LATE_SQUARED: usize = 3;
/// Harmonics of the turn by which the frame of a flawed angle may be turned, each a cosine and a sine, beside the mean of the flaw.
const FLAWED: usize = 8;
/// Columns of a frame that is turned: over the speed first, to first and to second order, then over the turn.
pub const TURNED: usize = LATE + LATE_SQUARED + 1 + 2 * FLAWED;

impl Experiment<'_> {
    /// Derivatives of the weighted residuals with respect to how the current sensors lag behind, to first order in the lag: by the current's
    /// change over a sample, by its change of change, and by the turn of a frame that lags. Shape: as many rows as [`Self::residual`] has,
    /// [`LAGS`] columns.
    pub fn lag_columns(&self, p: &[f64], answering: &Answering) -> DMatrix<f64> {
        let mut linear = Linearisation::zeros(self.channels.len() * self.samples(), LAGS);
        let (mut electrical, _) = linear.split_rows(self.electrical_rows());
        if let (Some(d), Some(q)) = (self.row_of(Channel::ID), self.row_of(Channel::IQ)) {
            for (at, steps) in answering.steps.windows(3).enumerate() {
                // Across a gap nothing is told.
                if steps[..2].iter().any(|step| step.held.is_none()) {
                    continue;
                }
                let [before, last, here] = [&steps[0], &steps[1], &steps[2]];
                let turn = here.env.omega_e * self.signals.period;
                for (axis, (row, weight)) in [d, q].into_iter().enumerate() {
                    let other = [-here.i[1], here.i[0]][axis];
                    let change = here.i[axis] - last.i[axis];
                    let bend = change - (last.i[axis] - before.i[axis]);
                    for (column, x) in electrical.columns.iter_mut().zip([change, bend, turn * other]) {
                        column[row + answering.steps[at + 2].sample] = x * weight;
                    }
                }
            }
            let every: Vec<usize> = (0..LAGS).collect();
            self.whiten_residual(p, || vec![[0.0; 2]; LAGS], &every, &mut electrical);
        }
        self.mask(&mut linear);
        linear.jacobian
    }

    /// Derivatives of the weighted residuals with respect to the coefficients of an error of the rotor angle over speed and turn, all of them
    /// zero: logged voltages and currents stand in a frame that is turned by it. Shape: as many rows as [`Self::residual`] has, [`TURNED`]
    /// columns, the first [`LATE`] of them over the speed. The next [`LATE_SQUARED`] are of second order. There the turns of voltage and
    /// current together leave only what is induced: (R(−δ)·G·R(δ) − G)·v is of first order in what tells the axes of the winding G apart.
    pub fn turned_columns(&self, p: &[f64], answering: &Answering) -> DMatrix<f64> {
        let mut linear = Linearisation::zeros(self.channels.len() * self.samples(), TURNED);
        let (mut electrical, _) = linear.split_rows(self.electrical_rows());
        if let (Some(d), Some(q)) = (self.row_of(Channel::ID), self.row_of(Channel::IQ)) {
            let fastest = self.signals.context.omega_e_max;
            let each = [0, 1].map(|axis| answering.turned(axis, fastest));
            let of_axes = each.each_ref().map(|values| Some(&values[..]));
            answering.respond(of_axes, TURNED, [d, q], &mut electrical.columns);
            for step in &answering.steps {
                let turned = turned(&step.env, fastest, step.i.map(|x| -x), [step.i[1], -step.i[0]]);
                for ((row, weight), turned) in [d, q].into_iter().zip(turned) {
                    for (column, x) in electrical.columns.iter_mut().zip(turned) {
                        column[row + step.sample] += x * weight;
                    }
                }
            }
            let every: Vec<usize> = (0..TURNED).collect();
            self.whiten_residual(p, || vec![[0.0; 2]; TURNED], &every, &mut electrical);
        }
        self.mask(&mut linear);
        linear.jacobian
    }
}

/// How a vector d, q changes with each coefficient of the angle error, at one place. Coefficients of first order scale `across`, the vector
/// turned by 90°. Those of second order scale `along`, the vector itself, with half the square of the angle. See [`TURNED`].
fn turned(env: &Env<f64>, omega_e_max: f64, along: [f64; 2], across: [f64; 2]) -> [[f64; TURNED]; 2] {
    let x = env.omega_e / omega_e_max;
    let size = x.abs();
    let late = [x, x * size, x.powi(3)];
    let squared = [x * x, size.powi(3), x.powi(4)].map(|square| 0.5 * square);
    let values: [f64; TURNED] = from_fn(|k| match k.checked_sub(LATE + LATE_SQUARED) {
        None if k < LATE => late[k],
        None => squared[k - LATE],
        Some(n) => {
            let (sin, cos) = (n.div_ceil(2) as f64 * env.theta_m).sin_cos();
            if n % 2 == 0 { cos } else { sin }
        }
    });
    let second = LATE..LATE + LATE_SQUARED;
    [0, 1].map(|axis: usize| from_fn(|k| values[k] * if second.contains(&k) { along } else { across }[axis]))
}

impl Answering {
    /// What an error of the rotor angle takes from the voltage on one axis over each step, by each of its coefficients.
    fn turned(&self, axis: usize, omega_e_max: f64) -> Vec<f64> {
        let of_step = |step: &Step| {
            let v = step.held.unwrap_or_default();
            // The logged voltage stands in the turned frame; the true one is ahead by the error.
            turned(&step.env, omega_e_max, v.map(|x| -x), [v[1], -v[0]])[axis]
        };
        self.steps.iter().flat_map(of_step).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::of_currents;
    use super::*;
    use crate::effects::EffectId;
    use crate::experiment::testing::reversing;
    use crate::model::Model;
    use crate::simulate::mechanical;

    #[test]
    fn an_angle_error_turns_voltages_and_currents_as_a_wrong_zero_of_the_encoder_does() {
        let signals = reversing(1e-4, &(0.31..0.32));
        let windows = mechanical::windows(&signals);
        let model = Model::new(signals.context, &[]);
        // Two axes alike, for which the second order is exact where speed is constant.
        let p = vec![0.5, 8e-3, 8e-3, 0.1, 2e-3, 1e-3];
        let experiment = of_currents(&model, &signals, &windows);
        let columns = experiment.turned_columns(&p, &experiment.answering(&p).unwrap());
        // At a constant speed an error in proportion to the speed is a wrong zero.
        let offset = Model::new(signals.context, &[EffectId::EncoderAngleOffset]);
        let of_offset = of_currents(&offset, &signals, &windows);
        let exact = of_offset.linearise(&[&p[..], &[0.0]].concat(), &[6]).jacobian;
        let small = 0.05;
        let [less, none, more] = [-small, 0.0, small].map(|x| of_offset.residual(&[&p[..], &[x]].concat()));
        let second = |row: usize| (less[row] + more[row] - 2.0 * none[row]) / (small * small);
        let omega = |row: usize| signals.omega_e[row % signals.len()] / signals.context.omega_e_max;
        let steady: Vec<usize> = (100..exact.nrows())
            .filter(|row| row % signals.len() >= 100 && (omega(*row) - omega(*row - 100)).abs() < 1e-3)
            .filter(|row| omega(*row).abs() > 0.2)
            .collect();
        assert!(steady.len() >= 100, "{}", steady.len());
        let largest = |of: &dyn Fn(usize) -> f64| steady.iter().map(|row| of(*row).abs()).fold(0.0, f64::max);
        let (scale, scale_of_second) = (largest(&|row| exact[(row, 0)]), largest(&second));
        for row in steady.iter().copied() {
            let off = columns[(row, 0)] / omega(row) - exact[(row, 0)];
            // The speed changes by up to half a per cent per 100 rows, and the currents answer over several times that.
            assert!(off.abs() < 0.05 * scale, "row {row}: {off} of {scale}");
            let off = columns[(row, LATE)] / (0.5 * omega(row).powi(2)) - second(row);
            assert!(off.abs() < 0.1 * scale_of_second, "row {row}: {off} of {scale_of_second}");
        }
    }

    #[test]
    fn a_lag_shows_as_far_as_a_current_changes_and_its_frame_turns() {
        let signals = reversing(1e-4, &(0.31..0.32));
        let windows = mechanical::windows(&signals);
        let model = Model::new(signals.context, &[]);
        let p = vec![0.5, 6e-3, 9e-3, 0.1, 2e-3, 1e-3];
        let experiment = of_currents(&model, &signals, &windows);
        let answering = experiment.answering(&p).unwrap();
        let columns = experiment.lag_columns(&p, &answering);
        let at = answering.steps.len() / 3;
        let [last, here] = [&answering.steps[at - 1], &answering.steps[at]];
        let (n, weight) = (signals.len(), [1.0 / 0.05, 1.0 / 0.02]);
        for axis in 0..2 {
            let row = axis * n + here.sample;
            let change = (here.i[axis] - last.i[axis]) * weight[axis];
            let turned = here.env.omega_e * signals.period * [-here.i[1], here.i[0]][axis] * weight[axis];
            assert!((columns[(row, 0)] - change).abs() < 1e-9 * change.abs().max(1e-9), "axis {axis}");
            assert!((columns[(row, 2)] - turned).abs() < 1e-9 * turned.abs().max(1e-9), "axis {axis}");
        }
    }
}
