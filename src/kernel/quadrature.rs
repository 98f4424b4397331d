//! Gauss-Legendre quadrature.

/// Nodes and weights of the five-point rule on [-1, 1] (Abramowitz and Stegun, table 25.4): exact to degree 9.
const NODES: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
    (-0.538_469_310_105_683, 0.478_628_670_499_366_47),
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683, 0.478_628_670_499_366_47),
    (0.906_179_845_938_664, 0.236_926_885_056_189_08),
];

/// The integral of `f` from `a` to `b` by `panels` equal five-point panels.
pub(super) fn integrate(a: f64, b: f64, panels: u32, f: impl Fn(f64) -> f64) -> f64 {
    let half = (b - a) / f64::from(panels) / 2.0;
    (0..panels)
        .map(|p| {
            let mid = a + half * f64::from(2 * p + 1);
            NODES.iter().map(|&(x, w)| w * f(mid + half * x)).sum::<f64>() * half
        })
        .sum()
}
