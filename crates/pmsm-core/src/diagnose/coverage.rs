//! Coverage of operating points by a recording, and how far another one goes beyond.

use super::data::Data;
use super::locate::Region;
use crate::recording::{Kind, Load};
use crate::signals::{Finding, Signals};

/// Time over which signals are averaged, so that ripple does not count as a change of the operating point, s.
const BLOCK: f64 = 0.05;
/// Fewest such means; of a short recording they are taken over less.
const FEWEST: usize = 8;
/// A recording stays at one operating point if these means change by less than this share of the largest value: controllers and slow
/// drifts change less, any manoeuvre changes more.
const ONE: f64 = 0.1;
/// Share of the points that a level holds at least.
const ON_THE_WAY: f64 = 0.02;
/// Share of the larger run's largest value by which it must go beyond the other for that to be told.
const BEYOND: f64 = 0.2;

/// Whether a running machine was recorded at one speed and one current only: what differs elsewhere cannot be told there.
pub fn stays_at_one_point(signals: &Signals) -> bool {
    if matches!(signals.kind, Kind::OperatingPoints | Kind::OpenCircuit) {
        return false;
    }
    let block = ((BLOCK / signals.period) as usize).min(signals.len() / FEWEST).max(1);
    let change = |x: &[f64]| {
        let means = || x.chunks_exact(block).map(|x| x.iter().sum::<f64>() / block as f64);
        means().fold(f64::NEG_INFINITY, f64::max) - means().fold(f64::INFINITY, f64::min)
    };
    let cx = &signals.context;
    let currents = || signals.i.iter().flatten().map(|x| change(x) / cx.i_max);
    let torque = || signals.tau_e.iter().map(|x| change(x) / cx.tau_max);
    change(&signals.omega_e) <= ONE * cx.omega_e_max && currents().chain(torque()).all(|change| change <= ONE)
}

/// A finding if steady points of a held rotor lie at one or two levels of i_q only.
pub fn held_at_few_currents(data: &Data) -> Option<Finding> {
    let signals = &data.signals;
    if signals.load != Load::Locked || !data.is_steady() {
        return None;
    }
    let [_, q] = signals.i.as_ref()?;
    let mut sorted: Vec<f64> = q.iter().copied().filter(|x| x.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    // Levels lie apart by more than what counts as the same point; a few points on the way between them are none.
    let levels = sorted.chunk_by(|a, b| b - a <= ONE * signals.context.i_max);
    let count = levels.filter(|level| level.len() as f64 > ON_THE_WAY * sorted.len() as f64).count();
    (count <= 2).then(|| Finding {
        finding: format!(
            "the held rotor was recorded at {count} level{} of i_q only",
            if count == 1 { "" } else { "s" }
        ),
        consequence:
            "r_s, a dead time and an offset of current or voltage cannot be told apart: r_s holds all of them"
                .into(),
        fix: "hold at least three levels of i_q in each direction".into(),
    })
}

/// What makes up an operating point.
struct Quantity<'a> {
    name: &'static str,
    unit: &'static str,
    values: &'a [f64],
    /// Largest magnitude.
    largest: f64,
}

impl Quantity<'_> {
    fn ends(&self) -> [f64; 2] {
        self.values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(*x), b.max(*x)])
    }

    fn words(&self) -> String {
        let [low, high] = self.ends();
        Region { variable: self.name.into(), low, high, unit: self.unit.into() }.words()
    }
}

fn quantities(s: &Signals) -> Vec<Quantity<'_>> {
    let cx = &s.context;
    let current = |name, values| Quantity { name, unit: "A", values, largest: cx.i_max };
    let currents = s.i.iter().flat_map(|[d, q]| [current("i_d", &d[..]), current("i_q", q)]);
    let speed = Quantity { name: "omega_e", unit: "rad/s", values: &s.omega_e, largest: cx.omega_e_max };
    currents.chain([speed]).collect()
}

/// The quantity in which the `validation` run goes furthest beyond the recording, where it does by much.
pub fn beyond(recording: &Signals, validation: &Signals) -> Option<Finding> {
    let own = quantities(recording);
    let further = quantities(validation).into_iter().filter_map(|there| {
        let here = own.iter().find(|here| here.name == there.name)?;
        let ([low, high], [least, most]) = (here.ends(), there.ends());
        let share = (most - high).max(low - least) / there.largest;
        (share > BEYOND).then(|| (share, there.words(), here.words()))
    });
    let (_, there, here) = further.max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(Finding {
        finding: format!("the validation run has {there}, the recording only {here}"),
        consequence: "there the model extrapolates, which may cause its residual".into(),
        fix: "record as far as the model is to hold, or give both recordings to the diagnosis".into(),
    })
}

/// A finding if the `validation` run has no voltages, or none that can be used, so that it checks less than the recording shows.
pub fn validates_the_motion_alone(recording: &Data, validation: &Data) -> Option<Finding> {
    let coarse = validation.signals.limits.coarse.is_some();
    let (finding, fix) = match coarse {
        true => (
            "in the validation run the rows lie too far apart for the voltage equations",
            "log every period of the drive in the validation run, too",
        ),
        false => ("the validation run has no voltages", "log the voltages of the validation run, too"),
    };
    (recording.has_electrical() && !validation.has_electrical()).then(|| Finding {
        finding: finding.into(),
        consequence: "it checks the motion alone; the voltage equations are checked on the recording only"
            .into(),
        fix: fix.into(),
    })
}

#[cfg(test)]
mod tests {
    use super::super::testing::{data, setup, speeds};
    use super::*;

    fn run(points: &[(f64, f64)]) -> Signals {
        data(&setup(speeds(0.6, points), Vec::new())).0.signals
    }

    #[test]
    fn a_machine_that_stays_where_it_is_shows_one_point() {
        assert!(!stays_at_one_point(&run(&[(0.1, 65.0), (0.5, -65.0)])));
        assert!(!stays_at_one_point(&run(&[(0.0, 40.0), (0.5, 60.0)])));
        let mut still = run(&[(0.1, 65.0), (0.5, -65.0)]);
        // Ripple around one speed and one current.
        let ripple = |mean: f64| move |k: usize| mean * (1.0 + 0.3 * (0.5 * k as f64).sin());
        still.omega_e = (0..still.len()).map(ripple(200.0)).collect();
        still.i = Some([0.2, 5.0].map(|mean| (0..still.len()).map(ripple(mean)).collect()));
        assert!(stays_at_one_point(&still));
        // A held rotor whose current changes is more than one.
        still.omega_e.fill(0.0);
        let half = still.len() / 2;
        still.i.as_mut().unwrap()[1][..half].fill(0.0);
        assert!(!stays_at_one_point(&still));
    }

    #[test]
    fn a_run_that_goes_further_than_the_other_is_told() {
        let (near, far) = (run(&[(0.1, 40.0), (0.5, -40.0)]), run(&[(0.1, 40.0), (0.5, -90.0)]));
        let told = beyond(&near, &far).unwrap().finding;
        assert!(told.contains("omega_e between -"), "{told}");
        assert_eq!(beyond(&far, &near), None);
    }
}
