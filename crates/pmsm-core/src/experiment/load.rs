//! Derivatives of the speed with respect to an unknown load.

use super::Experiment;
use super::decay::{kept, root};
use crate::machine::BaseParameter;

/// Levels and instants of an unknown load, followed along the recording.
pub(super) struct Profile<'p> {
    levels: &'p [f64],
    instants: &'p [f64],
    /// The columns that belong to them, where they are wanted.
    of_level: Vec<Option<usize>>,
    of_instant: Vec<Option<usize>>,
    /// Number of the level that holds where the profile has been followed to.
    level: usize,
}

/// Numbers of columns, and what one of their parameter adds to the mean load of an interval: two levels and the instant between them at most.
pub(super) type Pushes = [Option<(usize, f64)>; 3];

impl<'p> Profile<'p> {
    /// The load of `experiment` at `p`, whose derivatives are wanted for `columns` of the parameters `free`, and are numbered as these.
    pub(super) fn new(experiment: &Experiment, p: &'p [f64], free: &[usize], columns: &[usize]) -> Self {
        let count = experiment.model.parameter_count();
        let (levels, rest) = p[count..].split_at(experiment.nuisance.levels);
        let instants = &rest[..experiment.nuisance.steps()];
        let place = |index: usize| columns.iter().position(|c| free[*c] == count + index);
        Self {
            levels,
            instants,
            of_level: (0..levels.len()).map(place).collect(),
            of_instant: (levels.len()..levels.len() + instants.len()).map(place).collect(),
            level: 0,
        }
    }

    /// What acts from `start` to `end`, s, which does not lie before what was asked for last.
    pub(super) fn pushes(&mut self, start: f64, end: f64) -> Pushes {
        let (instants, h) = (self.instants, end - start);
        let behind = |level: usize| instants.get(level).map_or(0.0, |instant| (end - instant) / h);
        while behind(self.level) > 1.0 {
            self.level += 1;
        }
        let (level, share) = (self.level, behind(self.level));
        let mut pushes = [self.of_level[level].map(|c| (c, 1.0 - share.max(0.0))), None, None];
        if share > 0.0 {
            let higher = self.levels[level + 1] - self.levels[level];
            pushes[1] = self.of_level[level + 1].map(|c| (c, share));
            pushes[2] = self.of_instant[level].map(|c| (c, -higher / h));
        }
        pushes
    }
}

impl Experiment<'_> {
    /// Derivatives of the speed with respect to the levels and instants of the load, from its derivative `slope` with respect
    /// to the initial speed of the window: what a torque adds over one sample fades as an initial speed does.
    pub(super) fn load_columns(
        &self,
        (p, free, columns): (&[f64], &[usize], &[usize]),
        slope: &[f64],
        mut rows: Vec<&mut [f64]>,
    ) {
        let weight = self.speed_weight();
        let per_torque = -self.signals.n_p / p[BaseParameter::J.index()];
        let mut profile = Profile::new(self, p, free, columns);
        let t = &self.signals.t;
        let mut responses = vec![0.0; columns.len()];
        // Columns that have acted in this window; the others' rows are zeros as they came.
        let mut acting: Vec<usize> = Vec::new();
        for window in self.windows {
            acting.drain(..).for_each(|column| responses[column] = 0.0);
            for k in window.clone() {
                for column in &acting {
                    rows[*column][k] = responses[*column] * weight;
                }
                if k + 1 >= window.end {
                    break;
                }
                let kept = kept(slope, k, 1);
                for column in &acting {
                    responses[*column] *= kept;
                }
                let gain = per_torque * root(kept) * (t[k + 1] - t[k]);
                for (column, push) in profile.pushes(t[k], t[k + 1]).into_iter().flatten() {
                    responses[column] += gain * push;
                    if !acting.contains(&column) {
                        acting.push(column);
                    }
                }
            }
        }
    }
}
