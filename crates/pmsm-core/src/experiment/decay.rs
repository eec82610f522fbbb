//! How a change of the speed decays along a recording, and what a changed acceleration adds to it.

/// Share of a change of the speed at sample `k` of a window that is left some samples later.
#[inline(always)]
pub(super) fn kept(slope: &[f64], k: usize, later: usize) -> f64 {
    if slope[k] == 0.0 { 0.0 } else { slope[k + later] / slope[k] }
}

/// The share that is left halfway.
#[inline(always)]
pub(super) fn root(kept: f64) -> f64 {
    kept.max(0.0).sqrt()
}

/// What is left of a response, and what came to it.
#[inline(always)]
pub(super) fn added<const N: usize>(
    response: &[f64; N],
    kept: f64,
    [a, b, c]: [f64; 3],
    [x, y, z]: [&[f64; N]; 3],
) -> [f64; N] {
    let mut out = [0.0; N];
    for n in 0..N {
        out[n] = response[n] * kept + a * x[n] + b * y[n] + c * z[n];
    }
    out
}
