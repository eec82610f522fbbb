//! What the rotor does at one point of the parameters, and how that answers to what drives it.

use crate::simulate::mechanical::Stations;
use std::sync::OnceLock;

/// What the rotor does at one point of the parameters.
#[derive(Debug, Clone)]
pub struct Course {
    /// Motor torque per sample, N·m.
    pub(super) torque: Vec<f64>,
    /// Initial electrical speed of each window, rad/s.
    pub(super) starts: Vec<f64>,
    pub(super) run: Run,
    /// How the acceleration answers to the torque, once somebody has asked.
    pub(super) gains: OnceLock<Gains>,
    /// Where effects take torque from it, once somebody has asked.
    pub(super) stations: OnceLock<Stations>,
}

/// The speed in free run.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Run {
    /// Electrical speed per sample, rad/s.
    pub(super) shown: Vec<f64>,
    /// Its derivative with respect to the initial speed of its window.
    pub(super) slope: Vec<f64>,
}

impl Run {
    /// Room for so many samples.
    pub(super) fn new(samples: usize) -> Self {
        Self { shown: vec![0.0; samples], slope: vec![0.0; samples] }
    }
}

/// How the acceleration (rad/s², electrical) answers to the motor's torque (N·m) along a course of the speed.
#[derive(Debug, Clone)]
pub(super) struct Gains {
    /// At each sample.
    pub(super) here: Vec<f64>,
    /// Halfway to the next, where a step has its middle there.
    pub(super) between: Vec<Option<f64>>,
}
