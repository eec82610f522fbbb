//! Decimation of a recording whose motor is slow compared with its sampling rate.

use super::{Limits, Signals, turned};
use crate::numerics::transforms::rotate;

/// The voltages and currents of the log within each sample of a decimated recording.
#[derive(Debug, Clone)]
pub struct Within {
    /// Samples of the log for each: the decimation factor.
    pub factor: usize,
    /// The voltage (d, q) of each sample of the log, V.
    pub v: [Vec<f64>; 2],
    /// What acts over each picked sample if the voltage of the log acts one sample of it later, and two, V.
    pub later: [[Vec<f64>; 2]; 2],
    /// Mean current (d, q) around each picked sample, A, which moves the rotor.
    pub i: [Vec<f64>; 2],
    /// The phase currents that it is made of, A.
    pub phases: [Vec<f64>; 3],
}

impl Signals {
    /// Every `factor`th sample of a recording without a gap, as a slower clock would have logged them. Measured values are those of the sample.
    /// The voltage is the one under which the flux ends as under all voltages up to the next sample. Scales and the period in the context, in
    /// which effects count, stay those of the log. It is meant for recordings with voltages and currents: only those know the factor.
    ///
    /// # Panics
    /// If the recording has gaps, or fewer samples than twice the factor.
    #[must_use]
    pub fn decimated_by(&self, factor: usize) -> Self {
        assert!(self.segments.len() == 1 && self.len() >= 2 * factor, "a run of samples without a gap");
        let picked = |x: &Vec<f64>| x.iter().step_by(factor).copied().collect::<Vec<f64>>();
        let t = picked(&self.t);
        let later = |v: &[Vec<f64>; 2], by: usize| {
            let late = v.each_ref().map(|x| (0..x.len()).map(|k| x[k.saturating_sub(by)]).collect());
            self.held_over(&late, factor)
        };
        let theta_e = picked(&self.theta_e);
        let within = match (&self.v, &self.i, &self.phases) {
            (Some(v), Some(i), Some([a, b, c])) if factor > 1 => {
                let around =
                    |x: &Vec<f64>| (0..x.len()).step_by(factor).map(|k| mean_around(x, k, factor)).collect();
                let i: [Vec<f64>; 2] = i.each_ref().map(around);
                let mut phases = turned::to_phases([&i[0], &i[1]], &theta_e);
                let common: Vec<f64> = (0..a.len()).map(|k| (a[k] + b[k] + c[k]) / 3.0).collect();
                for (k, common) in around(&common).into_iter().enumerate() {
                    phases.iter_mut().for_each(|x| x[k] += common);
                }
                Some(Within { factor, v: v.clone(), later: [1, 2].map(|by| later(v, by)), i, phases })
            }
            _ => None,
        };
        let whole = 0..t.len();
        Self {
            t,
            within,
            segments: vec![whole],
            period: self.period * factor as f64,
            control_period: Some(self.held_period()),
            v: self.v.as_ref().map(|v| self.held_over(v, factor)),
            i: self.i.as_ref().map(|i| i.each_ref().map(picked)),
            phases: self.phases.as_ref().map(|i| i.each_ref().map(picked)),
            theta_e,
            theta_m: picked(&self.theta_m),
            omega_e: picked(&self.omega_e),
            limits: Limits {
                speed: picked(&self.limits.speed),
                angle: picked(&self.limits.angle),
                current_noise: self.limits.current_noise.as_ref().map(|noise| noise.decimated_by(factor)),
                speed_noise: self.limits.speed_noise.as_ref().map(|noise| noise.decimated_by(factor)),
                ..self.limits.clone()
            },
            tau_e: self.tau_e.as_ref().map(picked),
            tau_m: self.tau_m.as_ref().map(picked),
            heating: self.heating.as_ref().map(picked),
            magnet_heating: self.magnet_heating.as_ref().map(picked),
            ..self.clone()
        }
    }

    /// The voltage (d, q) that, held in the rotor's frame over `factor` samples, leaves the flux where those of the single ones leave it. Each
    /// turns on with the rotor: about the middle of all of them by δ, v·e^{jδ}, and held over a turn of 2x it moves the flux by the share
    /// sin x/x.
    fn held_over(&self, [v_d, v_q]: &[Vec<f64>; 2], factor: usize) -> [Vec<f64>; 2] {
        let share = |x: f64| if x == 0.0 { 1.0 } else { x.sin() / x };
        let held = |first: usize| {
            let all = first..(first + factor).min(self.len());
            let count = all.len() as f64;
            let turn = self.period * self.omega_e[all.clone()].iter().sum::<f64>() / count;
            let longer = share(0.5 * turn) / share(0.5 * turn * count) / count;
            let mut sum = [0.0; 2];
            for (number, k) in all.enumerate() {
                let (s, c) = ((number as f64 + 0.5 - 0.5 * count) * turn).sin_cos();
                let on = rotate([v_d[k], v_q[k]], c, s);
                sum = [sum[0] + longer * on[0], sum[1] + longer * on[1]];
            }
            sum
        };
        let held: Vec<[f64; 2]> = (0..self.len()).step_by(factor).map(held).collect();
        [0, 1].map(|axis| held.iter().map(|v| v[axis]).collect())
    }
}

/// Mean of what lies within half a `factor` of place `k`, as far as there is any.
fn mean_around(x: &[f64], k: usize, factor: usize) -> f64 {
    let reach = (factor / 2).min(k).min(x.len() - 1 - k);
    if reach == 0 {
        return x[k];
    }
    let around = &x[k - reach..=k + reach];
    let sum = around.iter().sum::<f64>();
    // An even number of them lies between two that count half.
    match factor % 2 {
        0 => (sum - 0.5 * (around[0] + around[2 * reach])) / (2 * reach) as f64,
        _ => sum / around.len() as f64,
    }
}

#[cfg(test)]
mod tests {
    use crate::machine::Machine;
    use crate::recording::Recording;
    use crate::signals::Signals;

    fn ramp(n: usize) -> Signals {
        let of = |f: fn(f64) -> f64| (0..n).map(|k| f(k as f64)).collect::<Vec<f64>>();
        let columns = vec![
            ("t".into(), of(|k| 1e-4 * k)),
            ("theta_e".into(), of(|k| 0.03 * k)),
            ("omega_e".into(), of(|_| 300.0)),
            ("v_d".into(), of(|k| k)),
            ("v_q".into(), of(|k| -k)),
            ("i_d".into(), of(|k| 2.0 * k)),
            ("i_q".into(), of(|k| 3.0 * k)),
        ];
        Signals::new(&Recording::new(columns, None).unwrap(), &Machine::new(4).unwrap()).unwrap()
    }

    #[test]
    fn measurements_are_picked_and_voltages_held() {
        let whole = ramp(1000);
        let fewer = whole.decimated_by(3);
        assert_eq!((fewer.len(), fewer.segments.first()), (334, Some(&(0..334))));
        assert!((fewer.period - 3e-4).abs() < 1e-12 && (fewer.t[7] - 2.1e-3).abs() < 1e-12);
        assert!((fewer.context.period - 1e-4).abs() < 1e-12 && (fewer.held_period() - 1e-4).abs() < 1e-12);
        let ([d, q], [v_d, v_q]) = (fewer.i.unwrap(), fewer.v.unwrap());
        assert_eq!((d[5], q[5], fewer.theta_e[5]), (30.0, 45.0, whole.theta_e[15]));
        assert!((v_d[5] - 16.0).abs() < 0.03 && (v_q[5] + 16.0).abs() < 0.03, "{} {}", v_d[5], v_q[5]);
        // The last interval is as short as the log leaves it.
        assert_eq!(v_d[333], 999.0);
        assert_eq!(fewer.phases.unwrap()[1][4], whole.phases.as_ref().unwrap()[1][12]);
    }

    #[test]
    fn at_a_pace_of_one_nothing_changes() {
        let whole = ramp(500);
        let same = whole.decimated_by(1);
        assert_eq!((same.t, same.v, same.i), (whole.t, whole.v, whole.i));
    }
}
