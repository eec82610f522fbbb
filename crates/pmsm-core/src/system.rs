//! Own systems: the parameters of any x' = f(x, u, p) from a recording of its inputs and outputs, by the same swarm and
//! the same least squares as a motor's.
//!
//! A system is written once over [`Real`], so that least squares gets exact derivatives. A direct-current motor:
//!
//! ```
//! use pmsm_core::monitor::Silent;
//! use pmsm_core::numerics::real::Real;
//! use pmsm_core::system::{Observations, Request, System, identify};
//!
//! /// l·di/dt = v − r·i − k·ω, j·dω/dt = k·i − b·ω with p = [r, k, j]; l and b are known.
//! struct DcMotor;
//!
//! impl System<2, 2> for DcMotor {
//!     fn start<T: Real>(&self, _: &[T]) -> [T; 2] {
//!         [T::zero(); 2]
//!     }
//!     fn rhs<T: Real>(&self, p: &[T], _: f64, x: &[T; 2], u: &[f64]) -> [T; 2] {
//!         let [i, omega] = *x;
//!         let voltage = T::constant(u[0]) - p[0] * i - p[1] * omega;
//!         [voltage * (1.0 / 2e-3), (p[1] * i - omega * 1e-5) / p[2]]
//!     }
//!     fn output<T: Real>(&self, _: &[T], _: f64, x: &[T; 2], _: &[f64]) -> [T; 2] {
//!         *x
//!     }
//! }
//!
//! let t: Vec<f64> = (0..400).map(|k| f64::from(k) * 1e-3).collect();
//! let voltage: Vec<f64> = t.iter().map(|t| if *t < 0.2 { 12.0 } else { 4.0 }).collect();
//! let run = Observations::new(t.clone(), vec![voltage], vec![vec![0.0; 400]; 2])?;
//! // In place of a bench: the motor itself with r = 0.8 ohm, k = 0.05 V s, j = 2e-5 kg m^2.
//! let measured = run.simulate(&DcMotor, &[0.8, 0.05, 2e-5]);
//! let run = Observations::new(t, run.inputs().to_vec(), measured)?;
//!
//! let parameters = [("r", (0.1, 5.0)), ("k", (0.01, 0.2)), ("j", (1e-6, 1e-4))];
//! let fit = identify(&DcMotor, &run, &parameters, &Request::default(), &Silent)?;
//! let r = fit.get("r").unwrap().value.unwrap();
//! assert!((r / 0.8 - 1.0).abs() < 1e-6);
//! # Ok::<(), pmsm_core::error::Error>(())
//! ```
//!
//! [`fit`] does the same for residuals that come from anywhere else, with [`Differences`] in place of derivatives where
//! a model shows nothing but its values.

mod differences;
mod fit;
mod observations;
mod simulated;

pub use differences::{Differences, Errors};
pub use fit::{Request, Residuals, SystemFit, fit};
pub use observations::{Between, Observations};

use crate::error::Result;
use crate::monitor::Monitor;
use crate::numerics::real::Real;
use simulated::Simulated;

/// A system of `N` states and `M` outputs.
pub trait System<const N: usize, const M: usize>: Sync {
    /// The state at the first sample. What is not known of it may be among the parameters.
    fn start<T: Real>(&self, p: &[T]) -> [T; N];
    /// dx/dt at time `t` (s) in state `x` under the inputs `u`.
    fn rhs<T: Real>(&self, p: &[T], t: f64, x: &[T; N], u: &[f64]) -> [T; N];
    /// What is measured of state `x`.
    fn output<T: Real>(&self, p: &[T], t: f64, x: &[T; N], u: &[f64]) -> [T; M];
}

/// Finds the parameters, named with their bounds, with which `system` reproduces `observations`. The same call gives the
/// same bits for any number of threads. Once `monitor` says stop, the best so far is returned.
///
/// # Errors
/// [`crate::error::Error::Unusable`] where the observations have not `M` outputs, for bounds that are no range, and where the system
/// cannot be simulated anywhere within them; [`crate::error::Error::Quantity`] for absurd settings of the swarm.
pub fn identify<const N: usize, const M: usize>(
    system: &impl System<N, M>,
    observations: &Observations,
    parameters: &[(&str, (f64, f64))],
    request: &Request,
    monitor: &dyn Monitor,
) -> Result<SystemFit> {
    let simulated = Simulated::new(system, observations, parameters.len())?;
    let names: Vec<&str> = parameters.iter().map(|p| p.0).collect();
    let bounds: Vec<(f64, f64)> = parameters.iter().map(|p| p.1).collect();
    fit(&simulated, &names, &bounds, request, monitor)
}
