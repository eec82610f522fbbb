//! Search, least squares and the uncertainty of what they find: nothing here knows a motor.

pub mod least_squares;
pub mod swarm;
pub mod uncertainty;
