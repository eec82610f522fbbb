//! How far noise of the measured currents moves the fitted motion. It drives the simulated rotor by way of the torque, adds up over a
//! window of free run. It stays below the noise of the speed, so that the residual hardly shows it.

use super::data::Data;
use super::hypothesis::Hypothesis;
use crate::experiment::Channel;
use crate::machine::BaseParameter;
use nalgebra::{DMatrix, DVector};

/// Covariance of the scores Jᵀr of the motion that this noise causes; `slopes` are the rows J of the speed, weighted, one column per
/// parameter.
///
/// A torque that is off by δ during one sample leaves the speed off by n_p·h·δ/j to the end of the window, friction being slow to undo
/// it. Where the speed is compared by its innovations, the residual holds all of this noise, and nothing is added.
pub fn scores(data: &Data, hypothesis: &Hypothesis, slopes: &DMatrix<f64>) -> DMatrix<f64> {
    let value = |p: BaseParameter| hypothesis.parameters[p.index()];
    let (psi_m, j) = (value(BaseParameter::PsiM), value(BaseParameter::J));
    let saliency = value(BaseParameter::LD) - value(BaseParameter::LQ);
    let dim = slopes.ncols();
    let mut out = DMatrix::zeros(dim, dim);
    for (run, part) in data.runs().iter().enumerate() {
        let floor = |channel| part.floors.iter().find(|f| f.channel == channel);
        let plain = floor(Channel::OmegaE).filter(|f| f.wander.is_none());
        let (Some(speed), Some([i_d, i_q]), None) = (plain, &part.signals.i, &part.signals.tau_e) else {
            continue;
        };
        let noise = |channel| floor(channel).map_or(0.0, |f| f.sensor);
        let (noise_d, noise_q) = (noise(Channel::ID), noise(Channel::IQ));
        let (n_p, first) = (part.signals.n_p, data.samples_of(run).start);
        let step = n_p * part.signals.period / (j * speed.total());
        for window in &part.windows {
            let mut after = DVector::zeros(dim);
            for k in window.clone().rev() {
                let by_q = noise_q * (psi_m + saliency * i_d[k]);
                let by_d = noise_d * saliency * i_q[k];
                let kick = 1.5 * n_p * step * by_q.hypot(by_d);
                out.ger(kick * kick, &after, &after, 1.0);
                for (sum, slope) in after.iter_mut().zip(slopes.row(first + k).iter()) {
                    *sum += slope;
                }
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{data, setup, speeds};
    use crate::numerics::random::normal_pair;

    #[test]
    fn noise_of_the_torque_moves_the_scores_as_far_as_it_does_in_simulation() {
        let mut setup = setup(speeds(1.0, &[(0.1, 90.0), (0.4, -80.0), (0.7, 90.0)]), Vec::new());
        setup.drive.sensors.noise_i = 0.02;
        let (data, base) = data(&setup);
        assert!(data.floors.iter().all(|f| f.wander.is_none()), "{:?}", data.floors);
        let torque = data.torque(&base.model, base.own());
        let moving = [BaseParameter::J.index(), BaseParameter::B.index()];
        let known = data.motion(&base.model, &base.nuisances, &torque);
        let slopes = known.linearise(&base.parameters, &moving).jacobian;
        let told = scores(&data, &base, &slopes);
        // Without saliency all of it comes by way of i_q.
        let noise = data.floors.iter().find(|f| f.channel == Channel::IQ).unwrap().sensor;
        let size = 1.5 * data.signals.n_p * base.parameters[BaseParameter::PsiM.index()] * noise;
        let still = known.residual(&base.parameters);
        let mut squares = [0.0; 2];
        const DRAWS: u32 = 60;
        for draw in 0..DRAWS {
            let shaken: Vec<f64> = torque
                .iter()
                .enumerate()
                .map(|(k, x)| x + size * normal_pair(1, [k as u32, draw, 0, 0]).0)
                .collect();
            let moved =
                data.motion(&base.model, &base.nuisances, &shaken).residual(&base.parameters) - &still;
            for (square, slope) in squares.iter_mut().zip(slopes.column_iter()) {
                *square += slope.dot(&moved).powi(2) / f64::from(DRAWS);
            }
        }
        for c in 0..2 {
            let ratio = told[(c, c)] / squares[c];
            assert!((0.6..1.7).contains(&ratio), "{c}: {ratio}");
        }
    }
}
