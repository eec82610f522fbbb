//! An unknown load as the derivatives of the speed see it.

use super::Experiment;

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
