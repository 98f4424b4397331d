//! Gauss-Legendre quadrature, and interpolation at Chebyshev's points.

use std::f64::consts::PI;

/// The nodes and weights of the five-point rule on [-1, 1] (Abramowitz and Stegun, table 25.4): exact to degree 9.
pub(crate) const NODES: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
    (-0.538_469_310_105_683, 0.478_628_670_499_366_47),
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683, 0.478_628_670_499_366_47),
    (0.906_179_845_938_664, 0.236_926_885_056_189_08),
];

/// Integrates `f` from `a` to `b` by `panels` equal five-point panels.
pub(crate) fn integrate(a: f64, b: f64, panels: u32, f: impl Fn(f64) -> f64) -> f64 {
    let half = (b - a) / f64::from(panels) / 2.0;
    (0..panels)
        .map(|p| {
            let mid = a + half * f64::from(2 * p + 1);
            NODES.iter().map(|&(x, w)| w * f(mid + half * x)).sum::<f64>() * half
        })
        .sum()
}

/// Returns the Chebyshev coefficients, lowest first, of the polynomial of `terms` terms that meets a function on
/// [-1, 1] at the zeros of the Chebyshev polynomial T_terms.
pub(crate) fn chebyshev(terms: usize, function: impl Fn(f64) -> f64) -> Vec<f64> {
    let angle = |node: usize| PI * (node as f64 + 0.5) / terms as f64;
    let values: Vec<f64> = (0..terms).map(|node| function(libm::cos(angle(node)))).collect();
    let coefficient = |m: usize| {
        let sum: f64 = values.iter().enumerate().map(|(node, v)| v * libm::cos(m as f64 * angle(node))).sum();
        sum * if m == 0 { 1.0 } else { 2.0 } / terms as f64
    };
    (0..terms).map(coefficient).collect()
}
