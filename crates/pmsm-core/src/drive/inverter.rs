//! The inverter: how a commanded voltage reaches the winding during one sampling period.
//!
//! Switching legs follow a triangular carrier at whose turning points the currents are sampled. With the common voltage
//! v_0 = −(max v_x + min v_x)/2 the vector may be as long as v_dc/√3 (van der Broeck, Skudelny & Stanke, IEEE Trans.
//! Industry Applications 24 (1988) 142; Zhou & Wang, IEEE Trans. Industrial Electronics 49 (2002) 186).

use crate::numerics::transforms::{clarke, inverse_clarke};

/// A voltage that stands still for a while.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Applied {
    /// In the rotor frame, d, q, V.
    Rotor([f64; 2]),
    /// In the stator frame, α, β, V.
    Stator([f64; 2]),
}

/// Longest voltage vector of a link of `v_dc` volts.
pub(super) fn longest(v_dc: f64) -> f64 {
    v_dc / 3f64.sqrt()
}

/// Share of the time in which each leg lies at the upper rail.
fn duties(v: [f64; 2], v_dc: f64) -> [f64; 3] {
    let legs = inverse_clarke(v);
    let most = legs.iter().fold(f64::MIN, |m, x| m.max(*x));
    let least = legs.iter().fold(f64::MAX, |m, x| m.min(*x));
    let common = -0.5 * (most + least);
    legs.map(|x| (0.5 + (x + common) / v_dc).clamp(0.0, 1.0))
}

/// Cuts sampling period `number` (s long) at the switching edges: into `pieces` go duration (s) and voltage of each
/// piece. `carriers` is the number of carrier periods in it: whole, or ½ (then the carrier rises and falls in turn).
pub(super) fn switch(
    v: [f64; 2],
    v_dc: f64,
    period: f64,
    carriers: f64,
    number: usize,
    pieces: &mut Vec<(f64, Applied)>,
) {
    pieces.clear();
    let duty = duties(v, v_dc);
    // Where each leg is up, in shares of one repetition.
    let up = duty.map(|d| {
        if carriers >= 1.0 {
            (0.5 - 0.5 * d, 0.5 + 0.5 * d)
        } else if number.is_multiple_of(2) {
            (1.0 - d, 1.0)
        } else {
            (0.0, d)
        }
    });
    let mut edges = [0.0, up[0].0, up[1].0, up[2].0, up[0].1, up[1].1, up[2].1, 1.0];
    edges.sort_by(f64::total_cmp);
    let repetitions = carriers.max(1.0);
    for _ in 0..repetitions as usize {
        for pair in edges.windows(2).filter(|pair| pair[1] > pair[0]) {
            let middle = 0.5 * (pair[0] + pair[1]);
            let legs = up.map(|(on, off)| if on <= middle && middle < off { v_dc } else { 0.0 });
            pieces.push(((pair[1] - pair[0]) * period / repetitions, Applied::Stator(clarke(legs))));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_mean_of_the_pieces_is_the_command(
            size in 0.0..1.0f64, angle in -4.0..4.0f64, carriers in 0usize..4, number in 0usize..2
        ) {
            let v_dc = 560.0;
            let v = [size * longest(v_dc) * angle.cos(), size * longest(v_dc) * angle.sin()];
            let carriers = if carriers == 0 { 0.5 } else { carriers as f64 };
            let mut pieces = Vec::new();
            switch(v, v_dc, 1e-4, carriers, number, &mut pieces);
            let (mut time, mut sum) = (0.0, [0.0; 2]);
            // Up to three carrier periods of seven pieces; each piece and each sum rounds once or twice.
            let allowed = 2.0 * 21.0 * f64::EPSILON;
            for (h, applied) in &pieces {
                let Applied::Stator(x) = applied else { panic!("legs stand in the stator") };
                time += h;
                sum = [sum[0] + h * x[0], sum[1] + h * x[1]];
                // Zero, or one of the six corners.
                let length = x[0].hypot(x[1]);
                prop_assert!(length <= allowed * v_dc || (length - 2.0 / 3.0 * v_dc).abs() <= allowed * v_dc);
            }
            prop_assert!((time - 1e-4).abs() <= allowed * 1e-4);
            let near = |a: f64, b: f64| (a - b).abs() <= allowed * v_dc;
            prop_assert!(near(sum[0] / time, v[0]) && near(sum[1] / time, v[1]));
        }
    }

    #[test]
    fn a_longer_vector_than_the_link_gives_is_cut_by_the_legs() {
        let d = duties([1000.0, 0.0], 560.0);
        assert_eq!((d[0], d[1], d[2]), (1.0, 0.0, 0.0));
    }
}
