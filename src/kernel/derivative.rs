//! Derivatives of samples by separable filters, for normals: smoothing along two axes and a slope along the third.

/// The distance in voxels, to either side, up to which the normal of a scalar depends on others.
pub(crate) const NORMAL_REACH: usize = 2;

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
        let gauss: Vec<f64> = (0..=reach).map(|k| (-0.5 * (k as f64 / deviation).powi(2)).exp()).collect();
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
    fn normals_keep_the_direction_of_an_edge() {
        let central = DerivativeFilter { smooth: vec![1.0, 0.0], slope: vec![0.0, 0.5] };
        let [normals, central] = [DerivativeFilter::of_normals(), central].map(|filter| largest_angle(&filter));
        println!("{normals} and {central} degrees");
        assert!(normals < 1.0 && central > 5.0, "{normals} and {central} degrees");
    }
}
