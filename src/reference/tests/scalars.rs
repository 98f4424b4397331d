//! Scalars, reconstructed and then classified, against their definition summed up the plain way.

use super::*;

/// The fields of post-shading by their definition, sum by sum.
struct Plain<'a> {
    volume: &'a Volume,
    kernel: Kernel,
    divisor: f64,
    base: f64,
    /// The scale of the kernel at a world point.
    scale: &'a dyn Fn(DVec3) -> f64,
    layers: i64,
    /// The differences at the points of the lattice and its layers, x fastest.
    differences: Vec<DVec3>,
}

impl Plain<'_> {
    /// Returns f, and its gradient in the world.
    fn at(&self, world: DVec3) -> (f64, DVec3) {
        let grid = self.volume.grid();
        let x = grid.to_lattice().transform_point3(world);
        let d = grid.dims().map(i64::from);
        // No kernel is twice as large as those that layers are meant for.
        let near = |a: usize| (x[a].round() as i64 - 2 * self.layers, x[a].round() as i64 + 2 * self.layers);
        let range = |a: usize| near(a).0.max(-self.layers)..near(a).1.min(d[a] + self.layers);
        let [across, down] = [0, 1].map(|axis| d[axis] + 2 * self.layers);
        let (mut f, mut g) = (self.base, DVec3::ZERO);
        for k in range(2) {
            for j in range(1) {
                for i in range(0) {
                    let p = DVec3::new(i as f64, j as f64, k as f64);
                    let s = (self.scale)(grid.to_world().transform_point3(p));
                    let h = self.kernel.value(x.distance_squared(p) / (s * s)) / s.powi(3) / self.divisor;
                    if h == 0.0 {
                        continue;
                    }
                    f += (sample(self.volume, [i, j, k]) - self.base) * h;
                    let [x, y, z] = [i, j, k].map(|n| n + self.layers);
                    g += h * self.differences[(x + across * (y + down * z)) as usize];
                }
            }
        }
        (f, grid.to_lattice().matrix3.transpose() * g)
    }

    /// Returns the part of a ray inside the box, as world lengths from its origin. The ray starts at `first`.
    fn span(&self, origin: DVec3, direction: DVec3, first: f64) -> Option<(f64, f64)> {
        let grid = self.volume.grid();
        let (o, d) = (grid.to_lattice().transform_point3(origin), grid.to_lattice().transform_vector3(direction));
        let (mut from, mut to) = (first, f64::INFINITY);
        for a in 0..3 {
            let (p, q) = ((-0.5 - o[a]) / d[a], (f64::from(grid.dims()[a]) - 0.5 - o[a]) / d[a]);
            (from, to) = (from.max(p.min(q)), to.min(p.max(q)));
        }
        (from < to).then_some((from, to))
    }

    /// Composites by the midpoint rule of `steps` steps.
    fn composite(
        &self,
        transfer: &TransferFunction,
        lighting: Option<&Lighting>,
        (origin, direction, first): (DVec3, DVec3, f64),
        steps: u32,
    ) -> [f64; 4] {
        let unit = transfer.unit_or(self.volume.grid().min_spacing());
        let Some((from, to)) = self.span(origin, direction, first) else { return [0.0; 4] };
        let length = (to - from) / f64::from(steps);
        let (mut color, mut depth) = (DVec3::ZERO, 0.0_f64);
        for i in 0..steps {
            let place = origin + direction * (from + (f64::from(i) + 0.5) * length);
            let (f, g) = self.at(place);
            let (c, opacity) = transfer.sample(f);
            let c = lighting.map_or(c, |l| l.shade(c, g, place, -direction, &Visibility::FULL));
            let d = TransferFunction::extinction(opacity, unit) * length;
            color += DVec3::from_array(c) * -(-d).exp_m1() * (-depth).exp();
            depth += d;
        }
        [color.x, color.y, color.z, -(-depth).exp_m1()]
    }

    fn maximum(&self, (origin, direction, first): (DVec3, DVec3, f64), steps: u32) -> Option<f64> {
        let (from, to) = self.span(origin, direction, first)?;
        let at = |i: u32| from + (to - from) * f64::from(i) / f64::from(steps);
        (0..=steps).map(|i| self.at(origin + direction * at(i)).0).reduce(f64::max)
    }
}

fn sample(volume: &Volume, p: [i64; 3]) -> f64 {
    let d = volume.grid().dims().map(i64::from);
    let [x, y, z]: [i64; 3] = std::array::from_fn(|a| p[a].clamp(0, d[a] - 1));
    volume.in_memory().unwrap().value((x + d[0] * (y + d[1] * z)) as usize)
}

/// Returns half the differences of neighbours along each axis, smoothed along the other two by 1, 4, 1 over 6.
fn differences(volume: &Volume, p: [i64; 3]) -> DVec3 {
    let smooth = [(-1, 1.0 / 6.0), (0, 4.0 / 6.0), (1, 1.0 / 6.0)];
    let along = |axis: usize| {
        let mut sum = 0.0;
        for (across, w) in smooth {
            for (down, v) in smooth {
                let mut place = p;
                place[(axis + 1) % 3] += across;
                place[(axis + 2) % 3] += down;
                let [mut ahead, mut behind] = [place; 2];
                ahead[axis] += 1;
                behind[axis] -= 1;
                sum += w * v * (sample(volume, ahead) - sample(volume, behind)) / 2.0;
            }
        }
        sum
    };
    DVec3::from_array([0, 1, 2].map(along))
}

fn plain(volume: &Volume, kernel: Kernel, base: f64) -> Plain<'_> {
    let layers = kernel.radius().ceil() as i64;
    let [nx, ny, nz] = volume.grid().dims().map(|d| i64::from(d) + layers);
    let mut points = Vec::new();
    for z in -layers..nz {
        for y in -layers..ny {
            points.extend((-layers..nx).map(|x| differences(volume, [x, y, z])));
        }
    }
    Plain { volume, kernel, divisor: kernel.integral(), base, scale: &|_| 1.0, layers, differences: points }
}

/// A kernel that ripples little.
const WIDE: Kernel = Kernel::Gaussian { sigma: 1.0, radius: 5.0 };

#[test]
#[ignore = "slow: sums over all kernels at every step"]
fn post_shading_is_its_definition() {
    let volume = bumps();
    let transfer = ramp(&[(-0.6, 0.5), (-0.3, 0.0), (0.1, 0.0), (0.4, 0.8), (0.5, 0.1), (0.9, 0.9)], 0.5);
    let lighting = Lighting {
        lights: vec![Light::directional(DVec3::new(0.2, -1.0, 0.5)), Light::at(DVec3::new(3.0, -8.0, 5.0))],
        ..Lighting::default()
    };
    for (kernel, normalization, lighting) in [
        (Kernel::default(), Normalization::Unit, None),
        (WIDE, Normalization::Unit, Some(lighting)),
        (Kernel::Gaussian { sigma: 0.5, radius: 1.2 }, Normalization::Peak, None),
    ] {
        let how =
            Settings { lighting: lighting.clone(), normalization, ..settings(kernel, Model::Composite, Shading::Post) };
        let scene = Reference::new(&volume, &transfer, &how).unwrap();
        let plain = Plain { divisor: normalization.divisor(&kernel), ..plain(&volume, kernel, transfer.base()) };
        let center = volume.grid().center();
        for (i, two_sided) in [true, false, true].into_iter().enumerate() {
            let turn = DQuat::from_scaled_axis(DVec3::new(0.3, 1.2, -0.7) * (i as f64 + 0.4));
            let direction = turn * DVec3::Y;
            // The one-sided ray starts inside.
            let origin = center + turn * DVec3::new(0.3, 0.2 - 0.6 * f64::from(u8::from(two_sided)), -0.4);
            let first = if two_sided { f64::NEG_INFINITY } else { 0.0 };
            let got = scene.ray(origin, direction, two_sided).rgba();
            let expected = plain.composite(&transfer, lighting.as_ref(), (origin, direction, first), 60_000);
            assert!(expected[3] > 0.1, "{expected:?}");
            assert_close(got, expected, 1e-5, &format!("{kernel:?}, ray {i}"));
        }
    }
}

#[test]
fn what_shows_everywhere_ends_with_the_box() {
    // Nothing is clear: the ray ends in the middle of a step, at its base.
    let volume = floats(Grid::axis_parallel([12, 10, 14], [1.0; 3]).unwrap(), |_| 0.25);
    let transfer = ramp(&[(0.0, 0.1), (1.0, 0.1)], 1.0);
    let direction = DVec3::new(0.3, 0.9, -0.2).normalize();
    for (shading, model) in [(Shading::Post, Model::Composite), (Shading::Post, Model::Mip)] {
        let scene = Reference::new(&volume, &transfer, &settings(WIDE, model, shading)).unwrap();
        let got = scene.ray(volume.grid().center(), direction, true).alpha();
        let chord = 10.0 / direction.y;
        let expected = if model == Model::Mip { 1.0 } else { 1.0 - 0.9_f64.powf(chord) };
        assert!((got - expected).abs() < 1e-9, "{model}: {got} is not {expected}");
    }
}

#[test]
fn post_shading_of_a_linear_ramp_is_the_ramp() {
    // So wide a kernel reconstructs linear functions where it does not reach the edge.
    let volume = floats(Grid::axis_parallel([24, 24, 24], [1.0; 3]).unwrap(), |p| p.x);
    let transfer = ramp(&[(9.0, 0.0), (11.0, 0.8), (13.0, 0.0)], 1.0);
    let scene = Reference::new(&volume, &transfer, &settings(WIDE, Model::Composite, Shading::Post)).unwrap();
    let got = scene.ray(DVec3::new(-5.0, 11.3, 11.6), DVec3::X, true);
    // The extinction of opacities 0 to 0.8 and back: 2 integral_0^0.8 -ln(1 - o) do / 0.4.
    let expected = 2.0 / 0.4 * (0.2 * 0.2_f64.ln() + 0.8);
    // Its integral errs as sums of the kernel do: by 2e-5 for the cut at 5.
    assert!((got.optical_depth - expected).abs() < 3e-4, "{} is not {expected}", got.optical_depth);
}

#[test]
fn a_constant_volume_has_no_rim() {
    let volume = floats(Grid::axis_parallel([6, 7, 8], [1.0; 3]).unwrap(), |_| 2.0);
    let transfer = ramp(&[(0.0, 0.0), (1.0, 0.0), (3.0, 0.5)], 1.0);
    let scene = Reference::new(&volume, &transfer, &settings(WIDE, Model::Composite, Shading::Post)).unwrap();
    let tau = TransferFunction::extinction(0.25, 1.0);
    for (origin, length) in
        [(DVec3::new(2.3, 0.0, 4.1), 7.0), (DVec3::new(-0.499, 0.0, 7.499), 7.0), (DVec3::new(-0.501, 0.0, 4.0), 0.0)]
    {
        let got = scene.ray(origin, DVec3::Y, true).alpha();
        let expected = 1.0 - (-tau * length).exp();
        assert!((got - expected).abs() < 1e-4, "{origin}: {got} is not {expected}");
    }
}

#[test]
fn a_visible_base_fills_the_box() {
    // No value is clear: the base is the first, which all voxels have.
    let volume = floats(Grid::axis_parallel([3, 4, 3], [1.0; 3]).unwrap(), |_| 0.0);
    let transfer = ramp(&[(0.0, 0.4), (1.0, 0.9)], 1.0);
    let scene = Reference::new(&volume, &transfer, &settings(WIDE, Model::Composite, Shading::Post)).unwrap();
    let got = scene.ray(DVec3::ONE, DVec3::Y, true).rgba();
    let alpha = 1.0 - 0.6_f64.powi(4);
    assert_close(got, [0.0, 0.5 * alpha, 0.25 * alpha, alpha], 1e-12, "base");
}

#[test]
fn a_narrow_peak_is_found() {
    let volume = floats(Grid::axis_parallel([24, 24, 24], [1.0; 3]).unwrap(), |p| p.x);
    // 1e-5 wide: its optical depth is that of the ramp, but for ripple.
    let width = 1e-5;
    let transfer = ramp(&[(11.0, 0.0), (11.0 + width, 0.5), (11.0 + 2.0 * width, 0.0)], width);
    let scene = Reference::new(&volume, &transfer, &settings(WIDE, Model::Composite, Shading::Post)).unwrap();
    // 2 integral_0^0.5 -ln(1 - o) do / 0.5.
    let expected = 2.0 / 0.5 * (0.5 * 0.5_f64.ln() + 0.5);
    let got = scene.ray(DVec3::new(-5.0, 11.3, 11.6), DVec3::X, true).optical_depth;
    assert!((got / expected - 1.0).abs() < 1e-3, "{got} is not {expected}");
    // Jumps instead of slopes: an optical depth of 2 ln 2.
    let jumps = ramp(&[(11.0, 0.0), (11.0, 0.5), (11.0 + 2.0 * width, 0.5), (11.0 + 2.0 * width, 0.0)], width);
    let scene = Reference::new(&volume, &jumps, &settings(WIDE, Model::Composite, Shading::Post)).unwrap();
    let got = scene.ray(DVec3::new(-5.0, 11.3, 11.6), DVec3::X, true).optical_depth;
    assert!((got / (2.0 * 2.0_f64.ln()) - 1.0).abs() < 1e-3, "{got}");
}

#[test]
fn gradients_are_smoothed_central_differences_of_the_field() {
    let volume = bumps();
    let plain = plain(&volume, Kernel::default(), 0.3);
    let lit = Settings {
        lighting: Some(Lighting::default()),
        ..settings(Kernel::default(), Model::Composite, Shading::Post)
    };
    let transfer = ramp(&[(0.3, 0.0), (1.0, 1.0)], 1.0);
    let splats = VoxelValues::new(&Layers::of_volume(&volume, &transfer), &lit).unwrap();
    let bricks = ClassifiedBricks::new(&splats, Viewer::Towards(DVec3::X));
    // What the walk adds up at a point, against f one voxel ahead and behind, smoothed across by 1, 4, 1 over 6.
    let to_world = volume.grid().to_world();
    let x = DVec3::new(2.2, 2.7, 1.6);
    let mut sums = [0.0; 4];
    for k in -2..6 {
        for j in -2..8 {
            for i in -2..7 {
                let weights = bricks.get(&splats, [i, j, k], &mut None);
                let h = Kernel::default().value(x.distance_squared(DVec3::new(i as f64, j as f64, k as f64)));
                for (sum, w) in sums.iter_mut().zip(weights) {
                    *sum += w * h / plain.divisor;
                }
            }
        }
    }
    let f = |lattice: DVec3| plain.at(to_world.transform_point3(lattice)).0;
    assert!((sums[0] + 0.3 - f(x)).abs() < 1e-13);
    for (axis, got) in sums[1..].iter().enumerate() {
        let [step, across, down] = [0, 1, 2].map(|n| DVec3::AXES[(axis + n) % 3]);
        let difference = |x: DVec3| (f(x + step) - f(x - step)) / 2.0;
        let line = |x: DVec3| (difference(x - across) + 4.0 * difference(x) + difference(x + across)) / 6.0;
        let expected = (line(x - down) + 4.0 * line(x) + line(x + down)) / 6.0;
        assert!((got - expected).abs() < 1e-13, "axis {axis}: {got} is not {expected}");
    }
}

#[test]
#[ignore = "slow: sums over all kernels at every step"]
fn maximum_intensity_is_its_definition() {
    let volume = bumps();
    // The base is 0, above some of the values.
    let transfer = ramp(&[(-2.0, 0.3), (0.0, 0.0), (0.2, 0.4), (1.0, 0.8)], 1.0);
    for kernel in [Kernel::default(), Kernel::KAISER_BESSEL] {
        let scene = Reference::new(&volume, &transfer, &settings(kernel, Model::Mip, Shading::Pre)).unwrap();
        let plain = plain(&volume, kernel, transfer.base());
        for i in 0..6 {
            let turn = DQuat::from_scaled_axis(DVec3::new(0.3, 1.2, -0.7) * (f64::from(i) + 0.4));
            let direction = turn * DVec3::Y;
            let origin = volume.grid().center() + turn * DVec3::new(0.2 * f64::from(i) - 0.5, 0.1, -0.2);
            let two_sided = i % 2 == 0;
            let first = if two_sided { f64::NEG_INFINITY } else { 0.0 };
            let m = plain.maximum((origin, direction, first), 60_000).unwrap();
            let (color, opacity) = transfer.sample(m);
            let alpha = opacity / 0.8;
            let [r, g, b] = color.map(|c| c * alpha);
            let got = scene.ray(origin, direction, two_sided).rgba();
            assert_close(got, [r, g, b, alpha], 1e-5, &format!("{kernel:?}, ray {i}"));
        }
        assert_eq!(scene.ray(DVec3::splat(-50.0), DVec3::Y, true), RayIntegral::default());
    }
}

#[test]
fn the_largest_value_is_fully_opaque() {
    let volume = floats(Grid::axis_parallel([3, 3, 3], [1.0; 3]).unwrap(), |_| 5.0);
    let transfer = ramp(&[(0.0, 0.0), (1.0, 0.25)], 1.0);
    let scene = Reference::new(&volume, &transfer, &settings(WIDE, Model::Mip, Shading::Pre)).unwrap();
    assert_eq!(scene.ray(DVec3::ONE, DVec3::Y, true).rgba(), [1.0, 0.5, 0.25, 1.0]);
    let clear = ramp(&[(0.0, 0.0), (1.0, 0.0)], 1.0);
    let scene = Reference::new(&volume, &clear, &settings(WIDE, Model::Mip, Shading::Pre)).unwrap();
    assert_eq!(scene.ray(DVec3::ONE, DVec3::Y, true).rgba(), [0.0; 4]);
}

#[test]
#[ignore = "slow: sums over all kernels at every step"]
fn grown_kernels_of_post_shading_are_their_definition() {
    let volume = bumps();
    let transfer = ramp(&[(-0.3, 0.0), (0.0, 0.5), (0.4, 0.9)], 0.5);
    for (projection, model) in [
        (ProjectionKind::Orthographic, Model::Composite),
        (ProjectionKind::Perspective { fov: 70.0 }, Model::Composite),
        (ProjectionKind::Perspective { fov: 70.0 }, Model::Mip),
    ] {
        let view = View { azimuth: 30.0, elevation: 20.0, projection, ..View::default() };
        let camera = Camera::new(&view, volume.grid(), [4, 4]).unwrap();
        let growth = camera.growth(volume.grid());
        let (eye, _) = camera.ray(0.0, 0.0);
        let scale = |p: DVec3| growth.at((p - eye).dot(camera.forward));
        assert!(scale(volume.grid().center()) > 1.5, "{growth:?}");
        let kernel = Kernel::default();
        let scene = Reference::new(&volume, &transfer, &settings(kernel, model, Shading::Post)).unwrap();
        let largest = volume.grid().corners(0.0).map(scale).into_iter().fold(1.0, f64::max);
        let layers = (2.0 * largest).ceil() as i64;
        let plain = Plain { scale: &scale, layers, ..plain(&volume, kernel, transfer.base()) };
        let picture = scene.render(&camera).unwrap();
        let parallel = projection == ProjectionKind::Orthographic;
        for pixel in [[1, 1], [2, 3], [3, 2]] {
            let (sx, sy) = camera.image_coordinates(pixel);
            let (origin, direction) = camera.ray(sx, sy);
            let ray = (origin, direction, if parallel { f64::NEG_INFINITY } else { 0.0 });
            let expected = if model == Model::Mip {
                plain.maximum(ray, 2000).map_or([0.0; 4], |m| {
                    let (color, opacity) = transfer.sample(m);
                    let [r, g, b] = color.map(|c| c * opacity / 0.9);
                    [r, g, b, opacity / 0.9]
                })
            } else {
                plain.composite(&transfer, None, ray, 2000)
            };
            let got = picture.pixels()[(pixel[1] * 4 + pixel[0]) as usize].map(f64::from);
            assert_close(got, expected, 1e-4, &format!("{projection:?} {model:?} {pixel:?}"));
        }
    }
}
