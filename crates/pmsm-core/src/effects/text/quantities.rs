//! The quantities that formulas may use, and where the inner loops find them.

use super::Side;
use crate::effect::Context;

/// A variable of the machine, or a constant of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Variable {
    OmegaM,
    OmegaE,
    ThetaM,
    ThetaE,
    TauE,
    Time,
    CurrentD,
    CurrentQ,
    CurrentA,
    CurrentB,
    CurrentC,
    VoltageD,
    VoltageQ,
    FluxD,
    FluxQ,
    InductanceD,
    InductanceQ,
    PsiM,
    PolePairs,
}

/// How many variables there are.
pub const VARIABLES: usize = PolePairs as usize + 1;

use Variable::*;

/// Name, variable, unit, a value that is usual, and whether it has both signs.
pub type Entry = (&'static str, Variable, &'static str, f64, bool);

/// All of them. The first name of a variable is its own.
pub const ALL: [Entry; 20] = [
    ("omega_m", OmegaM, "rad/s", 100.0, true),
    ("w", OmegaM, "rad/s", 100.0, true),
    ("omega_e", OmegaE, "rad/s", 300.0, true),
    ("theta_m", ThetaM, "rad", 2.0, true),
    ("theta_e", ThetaE, "rad", 6.0, true),
    ("tau_e", TauE, "N m", 5.0, true),
    ("t", Time, "s", 1.0, false),
    ("i_d", CurrentD, "A", 8.0, true),
    ("i_q", CurrentQ, "A", 8.0, true),
    ("i_a", CurrentA, "A", 8.0, true),
    ("i_b", CurrentB, "A", 8.0, true),
    ("i_c", CurrentC, "A", 8.0, true),
    ("v_d", VoltageD, "V", 100.0, true),
    ("v_q", VoltageQ, "V", 100.0, true),
    ("lambda_d", FluxD, "V s", 0.1, true),
    ("lambda_q", FluxQ, "V s", 0.1, true),
    ("l_d", InductanceD, "H", 1e-2, false),
    ("l_q", InductanceQ, "H", 1e-2, false),
    ("psi_m", PsiM, "V s", 0.2, false),
    ("n_p", PolePairs, "1", 3.0, false),
];

impl Variable {
    /// Its largest size on a recording, over a small share of which its sign turns over; zero where none is known.
    pub fn scale(self, cx: &Context) -> f64 {
        match self {
            OmegaM => cx.omega_m_max(),
            OmegaE => cx.omega_e_max,
            TauE => cx.tau_max,
            CurrentD | CurrentQ | CurrentA | CurrentB | CurrentC => cx.i_max,
            VoltageD | VoltageQ => cx.v_max,
            FluxD | FluxQ => cx.psi_max,
            _ => 0.0,
        }
    }

    /// Whether its scale is known.
    pub fn has_scale(self) -> bool {
        !matches!(self, ThetaM | ThetaE | Time | InductanceD | InductanceQ | PsiM | PolePairs)
    }

    /// Whether the electrical angle is needed for it.
    pub fn needs_angle(self) -> bool {
        matches!(self, ThetaM | ThetaE | CurrentA | CurrentB | CurrentC)
    }
}

/// The quantities of a side.
pub fn of_side(side: Side) -> Vec<Entry> {
    let known: &[Variable] = match side {
        Side::Torque => &[OmegaM, OmegaE, ThetaM, ThetaE, TauE, Time, PolePairs],
        Side::Voltage => &[
            CurrentD, CurrentQ, CurrentA, CurrentB, CurrentC, VoltageD, VoltageQ, OmegaM, OmegaE, ThetaM,
            ThetaE, Time, PolePairs,
        ],
        Side::Flux => &[ThetaM, ThetaE, PsiM, PolePairs],
        Side::Energy => &[FluxD, FluxQ, InductanceD, InductanceQ, PolePairs],
        Side::Angle => &[ThetaM, ThetaE, PolePairs],
        Side::Current => &[ThetaM, ThetaE, OmegaM, OmegaE, PolePairs],
    };
    ALL.into_iter().filter(|(_, variable, ..)| known.contains(variable)).collect()
}
