//! Free-run simulations of a model, each driven by what was measured on the other side.
//!
//! - [`environment`]: time, speed, angles and temperatures at a sample.
//! - [`inductances`]: incremental inductances along a recording.
//! - [`electrical`]: currents from the logged voltage and the measured speed and angle.
//! - [`watched`]: the same, for those who look on at every sample.
//! - [`mechanical`]: speed from the torque of the measured currents, in windows.
//! - [`quasi_static`]: voltage left unexplained at each steady operating point.
//! - [`coupled`]: currents and speed from voltage and load alone, the model (1)–(3) as the paper runs it.
//! - [`response`]: the same without a recording, from voltages and a load of one's own.

pub mod coupled;
pub mod electrical;
pub mod environment;
mod forms;
pub mod inductances;
pub mod mechanical;
pub mod quasi_static;
pub mod response;
pub mod watched;
