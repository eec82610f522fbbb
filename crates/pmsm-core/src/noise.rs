//! What a log can tell: noise of the logged inputs, the colour of residuals, and how both are taken out.

pub mod colour;
pub mod input;
pub mod lasting;
pub mod wander;
pub mod whitening;
