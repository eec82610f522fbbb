//! Core of pmsm-rs: models of permanent-magnet synchronous motors, identification of their parameters, and the
//! diagnosis of what a model leaves out.
//!
//! Layers, each using only those above it in this list:
//!
//! - [`error`], [`monitor`], [`real`] (number types), [`transforms`], [`rk4`], [`swarm`], [`least_squares`]: know no motor.
//! - [`machine`] (nameplate), [`recording`] (checked columns).
//! - [`effect`] (what an omitted effect is), [`effects`] (the catalogue), [`model`] (machine plus effects).
//!
//! Units are SI throughout, the Park transform is amplitude-invariant, the d axis lies on the magnet flux, and the
//! sign convention is the motor's.

pub mod diagnose;
pub mod effect;
pub mod effects;
pub mod error;
pub mod experiment;
pub mod identify;
pub mod least_squares;
pub mod load_steps;
pub mod machine;
pub mod model;
pub mod monitor;
pub mod noise;
pub mod objective;
pub mod real;
pub mod recording;
pub mod rk4;
pub mod signals;
pub mod simulate;
pub mod start;
pub mod swarm;
pub mod transforms;
pub mod uncertainty;
