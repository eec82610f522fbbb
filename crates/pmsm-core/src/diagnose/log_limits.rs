//! Whether the log itself, and not the machine, may have caused what a model leaves. Missing physics is a function of what moves the machine:
//! a map of it predicts other data. What a log cannot hold, such as the voltage between its rows or the error of an angle in steps, is none.

use super::data::Data;
use super::unmodelled::Unmodelled;
use crate::signals::Finding;

/// Why nothing can be said of what is left, where no map predicts it and the log is limited.
pub fn may_have_caused(data: &Data, rest: &Unmodelled) -> Option<String> {
    let of_run = |run: &Data| run.signals.limits.first().cloned().or_else(|| run.input.of_rows(&run.signals));
    let Finding { finding, fix, .. } =
        data.runs().iter().find_map(of_run).filter(|_| rest.terms.is_empty())?;
    Some(format!(
        "the dq-model has a residual above the noise, no function of speed, angle, currents and time predicts it, and the log may have caused it: {finding}; {fix}"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::answer::Verdict;
    use crate::diagnose::diagnose;
    use crate::diagnose::testing::{choice, data, setup, speeds};
    use crate::drive::{Choice, simulate};
    use crate::monitor::Silent;
    use crate::numerics::random::normal;
    use crate::recording::Recording;

    #[test]
    fn what_a_limited_log_may_have_caused_is_not_said_of_a_full_one_nor_of_what_a_map_predicts() {
        let (mut data, _) = data(&setup(speeds(1.0, &[(0.1, 80.0), (0.4, -60.0), (0.8, 70.0)]), Vec::new()));
        let rest = Unmodelled { sentence: "The rest stays.".into(), gain_held_out: None, terms: Vec::new() };
        assert_eq!(may_have_caused(&data, &rest), None);
        let said = |text: &str| text.to_string();
        data.signals.limits.found.push(Finding {
            finding: said("the speed is held"),
            consequence: said("its error counts as noise"),
            fix: said("log it in every row"),
        });
        let why = may_have_caused(&data, &rest).unwrap();
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
