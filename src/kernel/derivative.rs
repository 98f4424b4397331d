//! Derivatives of samples by separable filters, for normals: smoothing along two axes and a slope along the third.

/// The distance in voxels, to either side, up to which the normal of a scalar depends on others.
pub(crate) const NORMAL_REACH: usize = 2;

/// The weight of the voxels to either side by which slopes of post-shading are smoothed along the other two axes.
///
/// Slopes by central differences are those of f + f'' / 6 along their own axis, and so smoothed those of f + (Laplacian
/// of f) / 6, up to the fourth derivative: gradients keep their direction. `component` in shaders/pack_scalars.wgsl has
/// the same weight.
pub(crate) const BESIDE: f64 = 1.0 / 6.0;

/// A pair of filters of one axis. The slopes of a field are the filter `slope` along an axis and `smooth` along the
/// other two.
pub(crate) struct DerivativeFilter {
    /// The weights of the voxels at distances 0, 1, .. to either side; they add up to 1.
    smooth: Vec<f32>,
    /// The weights of the differences of voxels at these distances; 1 for a ramp of slope 1.
    slope: Vec<f32>,
}

impl DerivativeFilter {
    /// Returns the filter of the normals of scalars: five taps whose gradients keep their direction (Farid and
    /// Simoncelli 2004, "Differentiation of discrete multidimensional signals"), scaled to slope 1. `smoothed` and
    /// `slope` in shaders/common/classified.wgsl have the same weights.
    ///
    /// Central differences turn with the place of a voxel between lattice planes, and keep the noise of six samples:
    /// docs/measurements/2026-11-24-grain.md.
    pub(crate) fn of_normals() -> Self {
        Self { smooth: vec![0.426_375, 0.249_153, 0.037_659], slope: vec![0.0, 0.278_979, 0.110_51] }
    }

    /// Makes the derivative of a Gaussian of a standard deviation in voxels, cut off after `reach` voxels.
    pub(crate) fn gaussian(deviation: f64, reach: usize) -> Self {
        let gauss: Vec<f64> = (0..=reach).map(|k| libm::exp(-0.5 * (k as f64 / deviation).powi(2))).collect();
        let sum = gauss[0] + 2.0 * gauss[1..].iter().sum::<f64>();
        let moment: f64 = gauss.iter().enumerate().map(|(k, g)| 2.0 * (k * k) as f64 * g).sum();
        Self {
            smooth: gauss.iter().map(|g| (g / sum) as f32).collect(),
            slope: gauss.iter().enumerate().map(|(k, g)| (k as f64 * g / moment) as f32).collect(),
        }
    }

    /// Smooths lines across an axis: `taps` returns the line at a distance along the axis.
    pub(crate) fn smooth<'a>(&self, taps: impl Fn(isize) -> &'a [f32], out: &mut [f32]) {
        out.iter_mut().zip(taps(0)).for_each(|(out, v)| *out = self.smooth[0] * v);
        for (k, weight) in (1..).zip(&self.smooth[1..]) {
            let pairs = taps(k).iter().zip(taps(-k));
            out.iter_mut().zip(pairs).for_each(|(out, (b, a))| *out += weight * (b + a));
        }
    }

    /// Finds the slopes of lines across an axis, given as in [`Self::smooth`]. Equal lines have the slope 0 exactly.
    pub(crate) fn slope<'a>(&self, taps: impl Fn(isize) -> &'a [f32], out: &mut [f32]) {
        out.fill(0.0);
        for (k, weight) in (1..).zip(&self.slope[1..]) {
            let pairs = taps(k).iter().zip(taps(-k));
            out.iter_mut().zip(pairs).for_each(|(out, (b, a))| *out += weight * (b - a));
        }
    }

    /// Returns the slopes along x, y and z of a cube of `edge`^3 voxels, x fastest, given its values with `halo` voxels
    /// around them: at least as many as the filter reaches.
    pub(crate) fn slopes(&self, field: &[f32], edge: usize, halo: usize) -> [Vec<f32>; 3] {
        let (wide, reach, plane) = (edge + 2 * halo, self.smooth.len() - 1, edge * edge);
        let beside = halo - reach..halo + edge + reach;
        // Each plane is filtered along x and y, and waits until the planes around it are filtered.
        let [mut sloping, mut smooth] = [vec![0.0; wide * edge], vec![0.0; wide * edge]];
        let waiting = 2 * reach + 1;
        let mut planes = vec![0.0; waiting * 3 * plane];
        let mut slopes = [0, 1, 2].map(|_| vec![0.0; edge * plane]);
        for z in beside.clone() {
            for y in beside.clone() {
                let row = &field[wide * (y + wide * z)..][..wide];
                let taps = |k: isize| &row[halo.saturating_add_signed(k)..][..edge];
                self.slope(taps, &mut sloping[edge * y..][..edge]);
                self.smooth(taps, &mut smooth[edge * y..][..edge]);
            }
            let rows = |k: isize| edge * halo.saturating_add_signed(k)..edge * (edge + halo).saturating_add_signed(k);
            let place = 3 * plane * (z % waiting);
            let (x, rest) = planes[place..][..3 * plane].split_at_mut(plane);
            let (y, smoothed) = rest.split_at_mut(plane);
            self.smooth(|k| &sloping[rows(k)], x);
            self.slope(|k| &smooth[rows(k)], y);
            self.smooth(|k| &smooth[rows(k)], smoothed);
            if z >= halo + reach {
                let middle = z - reach;
                let taps = |axis: usize| {
                    let planes = &planes;
                    move |k: isize| &planes[plane * (3 * (middle.saturating_add_signed(k) % waiting) + axis)..][..plane]
                };
                let [x, y, z] = slopes.each_mut().map(|slopes| &mut slopes[plane * (middle - halo)..][..plane]);
                self.smooth(taps(0), x);
                self.smooth(taps(1), y);
                self.slope(taps(2), z);
            }
        }
        slopes
    }
}

/// The filter of the gradients of places of a lattice: slopes of voxels along an axis, smoothed along the other two.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Slopes {
    /// The weights of the differences of places 1, 2 and 3 to either side along an axis.
    pub(crate) differences: [f32; 3],
    /// The weight of the slopes to either side along each of the other axes, over that of the own slope. The weights of
    /// voxels are powers of 2 up to `own`, so that all orders of their sums round alike.
    pub(crate) beside: f32,
    /// The weight of the own slope.
    pub(crate) own: f32,
}

impl Slopes {
    /// Returns the filter of cells that have this number of voxels along each axis. Its slopes are the central
    /// differences of voxels up to the fifth derivative, and it smooths as much as [`BESIDE`].
    pub(crate) fn of_cells(voxels: f64) -> Self {
        let square = voxels.powi(-2);
        let nodes = [1.0, 4.0, 9.0];
        let differences = nodes.map(|node: f64| {
            let others = nodes.into_iter().filter(|&other| other != node);
            let weight = others.map(|other| (square - other) / (node - other)).product::<f64>();
            (weight / (2.0 * node.sqrt())) as f32
        });
        let beside = square * BESIDE;
        let own = 1.0 - 2.0 * beside;
        Self { differences, beside: (beside / own) as f32, own: (own * own) as f32 }
    }

    /// Returns the distance of the farthest places on which gradients depend.
    pub(crate) fn reach(&self) -> usize {
        self.differences.iter().rposition(|&weight| weight != 0.0).map_or(0, |last| last + 1)
    }

    /// Returns the gradient at place number `at` of a cube of `edge` places a side, x fastest. It is zero where all
    /// places around are equal, so that no light falls there.
    pub(crate) fn gradient(&self, scalars: &[f32], at: usize, edge: usize) -> [f32; 3] {
        let weights = &self.differences[..self.reach()];
        let slope = |at: usize, step: usize| -> f32 {
            // Multiplied first: no difference of numbers overflows.
            let difference = |n: usize, weight: f32| weight * scalars[at + n * step] - weight * scalars[at - n * step];
            (1..).zip(weights).map(|(n, &weight)| difference(n, weight)).sum()
        };
        let steps = [1, edge, edge * edge];
        [0, 1, 2].map(|axis| {
            let [step, across, down] = [0, 1, 2].map(|n| steps[(axis + n) % 3]);
            let line = |at| slope(at, step) + self.beside * (slope(at - across, step) + slope(at + across, step));
            self.own * (line(at) + self.beside * (line(at - down) + line(at + down)))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EDGE: usize = 8;

    fn slopes(filter: &DerivativeFilter, halo: usize, value: impl Fn([f32; 3]) -> f32) -> [Vec<f32>; 3] {
        let with_halo = EDGE + 2 * halo;
        let place = |i: usize| [i % with_halo, i / with_halo % with_halo, i / with_halo.pow(2)].map(|c| c as f32);
        let field: Vec<f32> = (0..with_halo.pow(3)).map(|i| value(place(i))).collect();
        filter.slopes(&field, EDGE, halo)
    }

    #[test]
    fn slopes_of_a_ramp_are_its_own() {
        // A halo as wide as the filter reaches, and a wider one.
        for (filter, halos) in [(DerivativeFilter::of_normals(), [2, 4]), (DerivativeFilter::gaussian(1.5, 4), [4, 5])]
        {
            for halo in halos {
                let ramp = slopes(&filter, halo, |[x, y, _]| x + 2.0 * y);
                for (slopes, expected) in ramp.iter().zip([1.0, 2.0, 0.0]) {
                    assert_eq!(slopes.len(), EDGE.pow(3));
                    assert!(slopes.iter().all(|slope| (slope - expected).abs() < 1e-4), "{halo} {expected}");
                }
                let flat = slopes(&filter, halo, |_| 0.3);
                assert!(flat.iter().flatten().all(|&slope| slope == 0.0));
            }
        }
    }

    /// Returns the largest angle, in degrees, between slopes and the normal of edges as steep as in a scan.
    fn largest_angle(filter: &DerivativeFilter) -> f32 {
        let mut largest = 0.0_f32;
        for normal in [[0.3, 0.5, 0.81], [0.1, 0.2, 0.97], [0.58, 0.57, 0.58], [0.7, 0.71, 0.05]] {
            let normal = glam::Vec3::from_array(normal).normalize();
            // The distance of a voxel in front of the edge.
            let distance = |p: [f32; 3]| normal.dot(glam::Vec3::from_array(p) - 5.5);
            let [x, y, z] = slopes(filter, 2, |p| 1.0 / (1.0 + (-distance(p) / 0.4).exp()));
            for (i, slope) in x.iter().zip(&y).zip(&z).map(|((&x, &y), &z)| glam::Vec3::new(x, y, z)).enumerate() {
                let place = [i % EDGE, i / EDGE % EDGE, i / EDGE.pow(2)].map(|c| c as f32 + 2.0);
                if distance(place).abs() < 1.5 {
                    largest = largest.max(slope.angle_between(normal).to_degrees());
                }
            }
        }
        largest
    }

    #[test]
    fn slopes_of_cells_keep_the_direction_of_an_edge_and_are_those_of_voxels() {
        // An edge as steep as a kernel makes it: a Gaussian of the deviation 1.2.
        let normal = glam::Vec3::new(0.3, 0.5, 0.81).normalize();
        let edge = 9;
        let cube = |size: f32| -> Vec<f32> {
            let place = |i: usize| [i % edge, i / edge % edge, i / (edge * edge)].map(|c| (c as f32 - 4.0) * size);
            (0..edge.pow(3)).map(|i| (1.0 + (-1.4 * normal.dot(place(i).into())).exp()).recip()).collect()
        };
        let middle = 4 * (1 + edge + edge * edge);
        let of_voxels = glam::Vec3::from(Slopes::of_cells(1.0).gradient(&cube(1.0), middle, edge));
        let central = glam::Vec3::from(Slopes { differences: [0.5, 0.0, 0.0], beside: 0.0, own: 1.0 }.gradient(
            &cube(1.0),
            middle,
            edge,
        ));
        let [angle, of_central] = [of_voxels, central].map(|g| g.angle_between(normal).to_degrees());
        println!("{angle} and {of_central} degrees");
        assert!(angle < 0.2 && of_central > 1.0, "{angle} and {of_central} degrees");
        for size in [1.5, 2.0] {
            let of_cells = Slopes::of_cells(f64::from(size)).gradient(&cube(size), middle, edge);
            let change = (glam::Vec3::from(of_cells) / size - of_voxels).length() / of_voxels.length();
            assert!(change < 0.1, "{size}: {change}");
        }
        let flat = Slopes::of_cells(1.5).gradient(&vec![0.3; edge.pow(3)], middle, edge);
        assert_eq!(flat, [0.0; 3]);
    }

    #[test]
    fn normals_keep_the_direction_of_an_edge() {
        let central = DerivativeFilter { smooth: vec![1.0, 0.0], slope: vec![0.0, 0.5] };
        let [normals, central] = [DerivativeFilter::of_normals(), central].map(|filter| largest_angle(&filter));
        println!("{normals} and {central} degrees");
        assert!(normals < 1.0 && central > 5.0, "{normals} and {central} degrees");
    }
}
