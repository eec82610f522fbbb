//! The fitness of many parameter sets at once: the kernels of the swarm.

pub mod bare;
pub mod objective;
