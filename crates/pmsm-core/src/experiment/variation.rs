//! How far a measured channel varies by itself, which is all that a model of it has to explain.

use super::{Channel, Experiment};

impl Experiment<'_> {
    /// Root mean square of what the simplest account of a channel leaves over the samples that count, in its unit: of the speed one
    /// constant in each window, as it runs free from one initial value there; of a current or voltage zero.
    pub fn variation(&self, channel: Channel) -> f64 {
        let x = self.measured(channel);
        let whole = 0..x.len();
        let speed = channel == Channel::OmegaE;
        let pieces = if speed { self.windows } else { std::slice::from_ref(&whole) };
        let counts = |k: &usize| self.held_out.is_none_or(|out| !out[*k]);
        let (mut square, mut count) = (0.0, 0);
        for piece in pieces {
            let kept = || piece.clone().filter(counts).map(|k| x[k]);
            let own = kept().count();
            let mean = if speed { kept().sum::<f64>() / own.max(1) as f64 } else { 0.0 };
            square += kept().map(|x| (x - mean).powi(2)).sum::<f64>();
            count += own;
        }
        (square / count.max(1) as f64).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::of_speed;
    use super::*;
    use crate::machine::Machine;
    use crate::model::Model;
    use crate::recording::Recording;
    use crate::signals::Signals;
    use crate::simulate::mechanical::Nuisance;

    #[test]
    fn a_speed_varies_about_its_mean_in_each_window() {
        let t: Vec<f64> = (0..100).map(|k| 1e-3 * f64::from(k)).collect();
        // Two plateaus, each with a wave of amplitude 2 that has no mean there.
        let wave = |k: usize| 2.0 * (std::f64::consts::TAU * k as f64 / 10.0).sin();
        let omega = (0..100).map(|k| if k < 50 { 40.0 } else { 90.0 } + wave(k)).collect();
        let columns = vec![("t".into(), t), ("omega_e".into(), omega), ("tau_e".into(), vec![1.0; 100])];
        let signals =
            Signals::new(&Recording::new(columns, None).unwrap(), &Machine::new(1).unwrap()).unwrap();
        let (model, windows) = (Model::new(signals.context, &[]), [0..50, 50..100]);
        let experiment = of_speed(&model, &signals, Nuisance::known(0), &windows);
        assert!((experiment.variation(Channel::OmegaE) - 2f64.sqrt()).abs() < 1e-9);
    }
}
