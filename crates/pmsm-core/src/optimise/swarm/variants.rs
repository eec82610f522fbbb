//! What the literature that the paper cites changes in eq. (5): how the inertia goes, how a velocity is made, and whom a
//! particle listens to. The default of each is the paper's own form.

use serde::{Deserialize, Serialize};

/// How the inertia weight w goes over the iterations; it starts at [`super::SwarmSettings::inertia`].
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Inertia {
    /// It stays.
    #[default]
    Constant,
    /// In a straight line to `last`: Shi & Eberhart, "A modified particle swarm optimizer", IEEE ICEC (1998).
    Linear {
        /// w of the last move, ≥ 0.
        last: f64,
    },
    /// Drawn anew between the first value and `last` for each move: Eberhart & Shi, "Tracking and optimizing dynamic
    /// systems with particle swarms", IEEE CEC (2001).
    Random {
        /// The other end of the range, ≥ 0.
        last: f64,
    },
    /// `last` plus the rest in proportion to the share of particles that have just bettered their own best:
    /// Nickabadi, Ebadzadeh & Safabakhsh, Applied Soft Computing 11 (2011) 3658.
    Adaptive {
        /// w where no particle betters itself, ≥ 0.
        last: f64,
    },
}

/// How a velocity is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Update {
    /// Eq. (5): w·v + c₁·r₁·(pbest − x) + c₂·r₂·(gbest − x).
    #[default]
    Inertia,
    /// χ·(v + c₁·r₁·(pbest − x) + c₂·r₂·(gbest − x)) with χ = 2/|2 − φ − √(φ² − 4φ)|, φ = c₁ + c₂ > 4: Clerc & Kennedy,
    /// IEEE Trans. Evolutionary Computation 6 (2002) 58. The inertia is not used.
    Constriction,
    /// χ·(v + Σ_n φ/N·r_n·(pbest_n − x)) over the N neighbours, the particle itself not among them: Mendes, Kennedy & Neves,
    /// IEEE Trans. Evolutionary Computation 8 (2004) 204. χ and φ as above.
    FullyInformed,
}

/// Whom a particle listens to: the best of these takes the place of gbest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Neighbourhood {
    /// Everyone, as in the paper.
    #[default]
    All,
    /// The one before and the one behind: Kennedy & Mendes, IEEE Trans. Systems, Man and Cybernetics C 36 (2006) 515.
    Ring,
    /// Left, right, above and below on a grid whose edges meet, as square as the number of particles allows (same
    /// source). A prime number of particles makes it a ring.
    VonNeumann,
}

impl Neighbourhood {
    /// The neighbours of particle `i` among `n`, without itself and each once, in ascending order.
    pub(super) fn of(self, i: usize, n: usize) -> Vec<usize> {
        let around = |size: usize, at: usize| [(at + size - 1) % size, (at + 1) % size];
        let mut list: Vec<usize> = match self {
            Self::All => (0..n).collect(),
            Self::Ring => around(n, i).to_vec(),
            Self::VonNeumann => {
                let width =
                    (1..=n).take_while(|w| w * w <= n).filter(|w| n.is_multiple_of(*w)).last().unwrap_or(1);
                let (row, column) = (i / width, i % width);
                let beside = around(width, column).map(|c| row * width + c);
                let above = around(n / width, row).map(|r| r * width + column);
                [beside, above].concat()
            }
        };
        list.sort_unstable();
        list.dedup();
        list.retain(|k| *k != i);
        list
    }
}

/// χ of Clerc & Kennedy for φ > 4.
pub(super) fn constriction(phi: f64) -> f64 {
    2.0 / (2.0 - phi - (phi * phi - 4.0 * phi).sqrt()).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_are_those_of_the_drawings() {
        assert_eq!(Neighbourhood::Ring.of(0, 5), [1, 4]);
        assert_eq!(Neighbourhood::All.of(1, 4), [0, 2, 3]);
        // 0 1 2
        // 3 4 5   three wide is the most that squares to no more than twelve.
        // 6 7 8
        // 9 …
        assert_eq!(Neighbourhood::VonNeumann.of(4, 12), [1, 3, 5, 7]);
        assert_eq!(Neighbourhood::VonNeumann.of(0, 12), [1, 2, 3, 9]);
        assert_eq!(Neighbourhood::VonNeumann.of(0, 7), [1, 6]);
        for kind in [Neighbourhood::All, Neighbourhood::Ring, Neighbourhood::VonNeumann] {
            assert!(kind.of(0, 1).is_empty());
            assert_eq!(kind.of(1, 2), [0]);
        }
    }

    #[test]
    fn the_usual_constriction_is_0_73() {
        assert!((constriction(4.1) - 0.729_843_788).abs() < 1e-9);
    }
}
