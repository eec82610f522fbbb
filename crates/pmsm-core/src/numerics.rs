//! Numbers, vectors of numbers, and what is computed with them: nothing here knows a motor.

pub(crate) mod basis;
pub mod bytecode;
pub mod derivative;
pub(crate) mod differences;
pub mod dimension;
pub mod dual;
pub mod expression;
pub(crate) mod extent;
pub mod lanes;
pub mod random;
pub mod real;
pub mod rk4;
pub(crate) mod robust;
pub(crate) mod steps;
pub(crate) mod student;
pub mod symbolic;
pub(crate) mod tall;
pub mod transforms;
