//! What a picture frames.

use glam::DVec3;

use crate::error::Result;
use crate::transfer::TransferFunction;
use crate::volume::Volume;

/// A ball in the world. A view that is fitted around one is as far away whatever its direction, so a turntable keeps
/// its scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ball {
    /// Its middle.
    pub center: DVec3,
    /// Its radius, world units.
    pub radius: f64,
}

/// The least opacity that counts as visible, as a share of the largest of the transfer function.
const VISIBLE: f64 = 0.01;

/// Steps towards the smallest ball: its radius then is mostly within a hundredth of the smallest.
const STEPS: u32 = 200;

impl Ball {
    /// A ball around the voxels that a transfer function shows, hardly larger than the smallest; `None` if it shows
    /// none. Voxels of less than a hundredth of the function's largest opacity do not count. Reads every sample.
    ///
    /// # Errors
    /// [`Error::Read`](crate::error::Error::Read) and [`Error::Memory`](crate::error::Error::Memory) if samples left in
    /// a file cannot be read.
    pub fn of_visible(volume: &Volume, transfer: &TransferFunction) -> Result<Option<Self>> {
        let most = transfer.max_opacity();
        if most <= 0.0 {
            return Ok(None);
        }
        let grid = volume.grid();
        // In a unit in which squares neither overflow nor vanish.
        let to_world = grid.local().to_world();
        let mut points = volume.outline(&transfer.values_over(VISIBLE * most))?;
        points.iter_mut().for_each(|point| *point = to_world.transform_point3(*point));
        let Some(ball) = around(&points) else { return Ok(None) };
        // Kernels reach beyond their voxels.
        let [x, y, z] = grid.spacing();
        let center = grid.center() + ball.center * grid.unit();
        Ok(Some(Self { center, radius: ball.radius * grid.unit() + x.max(y).max(z) }))
    }
}

/// A small ball around points (Badoiu and Clarkson 2003, "Smaller core-sets for balls"); `None` if there are none.
fn around(points: &[DVec3]) -> Option<Ball> {
    let least = points.iter().copied().reduce(DVec3::min)?;
    let most = points.iter().copied().reduce(DVec3::max)?;
    let farthest = |center: DVec3| {
        let distances = points.iter().map(|&point| (center.distance_squared(point), point));
        distances.fold((0.0, center), |best, next| if next.0 > best.0 { next } else { best })
    };
    let mut center = least.midpoint(most);
    let mut best = Ball { center, radius: f64::INFINITY };
    for step in 1..=STEPS {
        let (squared, point) = farthest(center);
        if squared.sqrt() < best.radius {
            best = Ball { center, radius: squared.sqrt() };
        }
        center += (point - center) / f64::from(step + 1);
    }
    Some(best)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer::ControlPoint;
    use crate::volume::Grid;
    use glam::{DAffine3, DMat3};

    #[test]
    fn balls_are_hardly_larger_than_the_smallest() {
        let corners: Vec<DVec3> =
            (0..8).map(|i| DVec3::new((i & 1).into(), (i >> 1 & 1).into(), (i >> 2).into())).collect();
        let found = around(&corners).unwrap();
        assert!(found.center.distance(DVec3::splat(0.5)) < 0.01 && found.radius < 1.01 * 0.75_f64.sqrt());
        // A cluster far from the middle of the box of all.
        let line = [DVec3::ZERO, DVec3::X * 10.0, DVec3::new(5.0, 4.0, 0.0), DVec3::new(5.0, 4.0, 0.1)];
        let found = around(&line).unwrap();
        assert!(found.radius < 5.05 && line.iter().all(|p| p.distance(found.center) <= found.radius), "{found:?}");
        assert_eq!(around(&[]), None);
        assert_eq!(around(&[DVec3::ONE]), Some(Ball { center: DVec3::ONE, radius: 0.0 }));
    }

    #[test]
    fn what_is_nearly_clear_is_not_framed() {
        let mut samples = vec![0_u8; 20 * 20 * 20];
        let at = |x: usize, y: usize, z: usize| (z * 20 + y) * 20 + x;
        for (x, y, z) in [(4, 5, 6), (8, 5, 6)] {
            samples[at(x, y, z)] = 100;
        }
        samples[at(19, 19, 19)] = 1;
        let point = |value, opacity| ControlPoint { value, color: [1.0; 3], opacity };
        let transfer = TransferFunction::new(vec![point(0.0, 0.0), point(200.0, 1.0)], None).unwrap();
        for unit in [1e-90, 1.0, 1e90] {
            let world = DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::splat(unit)), DVec3::X * unit);
            let grid = Grid::new([20; 3], world).unwrap();
            let volume = Volume::from_slice([20; 3], [1.0; 3], &samples).unwrap().with_grid(grid).unwrap();
            let ball = Ball::of_visible(&volume, &transfer).unwrap().unwrap();
            assert!((ball.center / unit).distance(DVec3::new(7.0, 5.0, 6.0)) < 0.03, "{ball:?}");
            assert!((ball.radius / unit - 3.0).abs() < 0.03, "{ball:?}");
        }
        let clear = TransferFunction::new(vec![point(150.0, 0.0), point(200.0, 1.0)], None).unwrap();
        let volume = Volume::from_slice([20; 3], [1.0; 3], &samples).unwrap();
        assert_eq!(Ball::of_visible(&volume, &clear).unwrap(), None);
    }
}
