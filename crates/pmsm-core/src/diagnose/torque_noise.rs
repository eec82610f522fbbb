//! How far noise of the measured currents moves the fitted motion. It drives the simulated rotor by way of the torque, adds up over a
//! window of free run, and hides there below the noise of the speed, so that the residual hardly tells of it.

use super::data::Data;
use super::hypothesis::Hypothesis;
use crate::experiment::Channel;
use crate::machine::BaseParameter;
use nalgebra::{DMatrix, DVector};

/// Covariance of the scores Jᵀr of the motion that this noise causes; `slopes` are the rows J of the speed, weighted, one column per
/// parameter.
///
/// A torque that is off by δ during one sample leaves the speed off by n_p·h·δ/j to the end of the window, friction being slow to undo
/// it. Where the driven noise is so large that the speed is judged by its innovations, the residual holds it all and nothing is added.
pub fn scores(data: &Data, hypothesis: &Hypothesis, slopes: &DMatrix<f64>) -> DMatrix<f64> {
    let value = |p: BaseParameter| hypothesis.parameters[p.index()];
    let (psi_m, j) = (value(BaseParameter::PsiM), value(BaseParameter::J));
    let saliency = value(BaseParameter::LD) - value(BaseParameter::LQ);
    let dim = slopes.ncols();
    let mut out = DMatrix::zeros(dim, dim);
    for (run, part) in data.runs().iter().enumerate() {
        let floor = |channel| part.floors.iter().find(|f| f.channel == channel);
        let judged = floor(Channel::OmegaE).filter(|f| f.wander.is_none());
        let (Some(speed), Some([i_d, i_q]), None) = (judged, &part.signals.i, &part.signals.tau_e) else {
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
    use crate::diagnose::outputs::Outputs;
    use crate::diagnose::testing::{data, setup, speeds};
    use crate::machine::BaseParameter;

    #[test]
    fn the_error_of_the_inertia_knows_of_the_noise_of_the_currents() {
        let mut sum = 0.0;
        const SEEDS: u64 = 12;
        for seed in 0..SEEDS {
            let mut setup = setup(speeds(1.0, &[(0.1, 90.0), (0.4, -80.0), (0.7, 90.0)]), Vec::new());
            setup.seed = seed;
            let (data, base) = data(&setup);
            assert!(data.floors.iter().all(|f| f.wander.is_none()), "{:?}", data.floors);
            let found = &Outputs::new(&data, &base).base()["j"];
            let error = found.value.unwrap() - setup.machine.get(BaseParameter::J).unwrap();
            sum += (error / found.stderr.unwrap()).powi(2);
        }
        let pull = (sum / SEEDS as f64).sqrt();
        assert!((0.5..1.5).contains(&pull), "{pull}");
    }
}
