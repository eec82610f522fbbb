//! Whether the log itself, and not the machine, may have caused what a model leaves. Missing physics is a function of what moves the machine:
//! a map of it predicts other data. What a log cannot hold, such as the voltage between its rows or the error of an angle in steps, is none.
//! The rounding of currents is a function of them, and may be mapped: it is known by its size.

use super::data::Data;
use super::hypothesis::Hypothesis;
use super::unmodelled::Unmodelled;
use crate::experiment::Channel;
use crate::figures::quantity;
use crate::machine::BaseParameter;
use crate::map::Equation;
use crate::signals::Finding;
use std::f64::consts::PI;

/// Why nothing can be said of what remains beside `best`, if so. Either no map predicts it and the log is limited, or its torque is within the
/// rounding of the currents.
pub fn may_have_caused(data: &Data, best: &Hypothesis, rest: &Unmodelled) -> Option<String> {
    let of_run = |run: &Data| run.signals.limits.first().cloned().or_else(|| run.input.of_rows(&run.signals));
    let limit = data.runs().iter().find_map(of_run).filter(|_| rest.terms.is_empty());
    if let Some(Finding { finding, fix, .. }) = limit {
        return Some(format!(
            "the dq-model has a residual above the noise, no function of speed, angle, currents and time predicts it, and the log may have caused it: {finding}; {fix}"
        ));
    }
    let mechanical = !rest.terms.is_empty() && rest.terms.iter().all(|t| t.equation == Equation::Mechanical);
    let peak = rest.terms.iter().map(|term| term.peak).fold(0.0, f64::max);
    let rounded = |run: &Data| Some((rounding_torque(run, best)?, run.signals.limits.current * 12f64.sqrt()));
    let (torque, count) = data.runs().iter().filter_map(rounded).max_by(|a, b| a.0.total_cmp(&b.0))?;
    (mechanical && peak <= torque).then(|| {
        format!(
            "a torque of up to {} is missing, which the log may have caused: current counts of {} shift the torque by up to {}; log currents with more bits",
            quantity(peak, 2, "N m"),
            quantity(count, 2, "A"),
            quantity(torque, 2, "N m")
        )
    })
}

/// Torque (N·m) by which the mean of rounded currents may be off. Noise of standard deviation σ before the rounding to counts q lets
/// q/π·exp(−2π²σ²/q²) of an error stay in the mean; see Widrow & Kollár, "Quantization noise" (2008), chapter 19. None where the currents do
/// not drive the rotor.
fn rounding_torque(run: &Data, best: &Hypothesis) -> Option<f64> {
    let rounding = run.signals.limits.current;
    if rounding == 0.0 || run.signals.tau_e.is_some() {
        return None;
    }
    let count = 12f64.sqrt() * rounding;
    let seen = run.floors.iter().find(|f| f.channel == Channel::IQ)?.sensor;
    let noise = (seen * seen - rounding * rounding).max(0.0);
    let left = count / PI * (-2.0 * PI * PI * noise / (count * count)).exp();
    Some(1.5 * run.signals.n_p * best.own()[BaseParameter::PsiM.index()] * left)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::answer::Verdict;
    use crate::diagnose::diagnose;
    use crate::diagnose::testing::{choice, data, setup, speeds};
    use crate::diagnose::unmodelled::Term;
    use crate::drive::{Choice, simulate};
    use crate::monitor::Silent;
    use crate::numerics::random::normal;
    use crate::recording::Recording;

    #[test]
    fn a_torque_within_the_rounding_of_the_currents_may_be_the_logs_unless_their_noise_averages_it_out() {
        let (mut data, base) = data(&setup(speeds(0.8, &[(0.1, 80.0), (0.4, -60.0)]), Vec::new()));
        let noise = data.floors.iter().find(|f| f.channel == Channel::IQ).unwrap().sensor;
        let peak = 0.05 * 1.5 * data.signals.n_p * base.own()[BaseParameter::PsiM.index()];
        let term = Term {
            equation: Equation::Mechanical,
            sentence: String::new(),
            formula: "",
            variables: Vec::new(),
            coefficients: Vec::new(),
            unit: "N m",
            peak,
        };
        let rest = Unmodelled { sentence: String::new(), gain_held_out: None, terms: vec![term] };
        let mut told = |count: f64, noise: f64| {
            let rounding = count / 12f64.sqrt();
            data.signals.limits.current = rounding;
            let floor = data.floors.iter_mut().find(|f| f.channel == Channel::IQ).unwrap();
            floor.sensor = noise.hypot(rounding);
            may_have_caused(&data, &base, &rest)
        };
        // The missing torque is that of 0.05 A.
        assert!(told(0.2, 0.0).unwrap().contains("counts of 0.2"));
        assert_eq!(told(0.1, 0.0), None);
        assert_eq!(told(0.2, 0.2), None);
        assert_eq!(told(0.0, noise), None);
    }

    #[test]
    fn what_a_limited_log_may_have_caused_is_not_said_of_a_full_one_nor_of_what_a_map_predicts() {
        let (mut data, base) =
            data(&setup(speeds(1.0, &[(0.1, 80.0), (0.4, -60.0), (0.8, 70.0)]), Vec::new()));
        let rest = Unmodelled { sentence: "The rest stays.".into(), gain_held_out: None, terms: Vec::new() };
        assert_eq!(may_have_caused(&data, &base, &rest), None);
        let said = |text: &str| text.to_string();
        data.signals.limits.found.push(Finding {
            finding: said("the speed is held"),
            consequence: said("its error counts as noise"),
            fix: said("log it in every row"),
        });
        let why = may_have_caused(&data, &base, &rest).unwrap();
        assert!(why.ends_with("the speed is held; log it in every row"), "{why}");
    }

    /// A run whose phase currents and speed carry noise that lasts for six rows, three times the white noise of their sensors.
    fn with_lasting_noise(path: &[(f64, f64)], effects: &[Choice]) -> Recording {
        let whole = simulate(&setup(speeds(2.0, path), effects.to_vec()), &Silent).unwrap().recording;
        let keep = (-1.0f64 / 6.0).exp();
        let columns = whole.names().into_iter().enumerate().map(|(number, name)| {
            let mut x = whole.column(name).unwrap().to_vec();
            let size = match name {
                "i_a" | "i_b" | "i_c" => 0.15,
                "omega_e" => 0.9,
                _ => 0.0,
            };
            let mut lasting = 0.0;
            for (k, x) in x.iter_mut().enumerate() {
                let new = normal(17, [k as u32, number as u32, 0, 0]);
                lasting = keep * lasting + (1.0 - keep * keep).sqrt() * new;
                *x += size * lasting;
            }
            (name.to_string(), x)
        });
        Recording::new(columns.collect(), Some(whole.load())).unwrap()
    }

    #[test]
    fn noise_that_lasts_is_no_physics_and_hides_no_friction() {
        let ways = [
            [(0.2, 80.0), (0.7, -60.0), (1.2, 90.0), (1.7, -70.0)],
            [(0.3, -70.0), (0.8, 85.0), (1.3, -50.0), (1.8, 60.0)],
        ];
        let told = |effects: &[Choice]| {
            let [recording, validation] = ways.map(|path| with_lasting_noise(&path, effects));
            let machine = setup(speeds(2.0, &ways[0]), Vec::new()).nameplate;
            diagnose(&[&recording], &machine, Some(&validation), &Default::default(), &Silent).unwrap()
        };
        let healthy = told(&[]);
        assert_eq!(healthy.verdict, Verdict::NoMismatch, "{:?} {:?}", healthy.reason, healthy.remaining);
        let lasts = healthy.data_quality.iter().filter(|f| f.finding.contains("lasts")).count();
        assert_eq!(lasts, 2, "{:?}", healthy.data_quality);
        let rubbing = told(&[choice("coulomb_friction", "tau_c", 0.5)]);
        assert_eq!(rubbing.model.effects, ["coulomb_friction"], "{:?}", rubbing.reason);
    }
}
