//! Orders in which neighbouring queries follow each other.

use crate::math::{Bounds3, Vec3};
use rayon::prelude::*;

/// Spreads the low ten bits to every third bit.
#[inline]
fn spread(v: u32) -> u32 {
    let v = v & 0x3ff;
    let v = (v | v << 16) & 0x0300_00ff;
    let v = (v | v << 8) & 0x0300_f00f;
    let v = (v | v << 4) & 0x030c_30c3;
    (v | v << 2) & 0x0924_9249
}

/// The 30-bit Morton code of a point's cell in a grid of 1024³ cells over the box.
#[inline]
pub fn morton_code(p: Vec3, bounds: &Bounds3) -> u32 {
    let extent = bounds.extent().max_element().max(f32::MIN_POSITIVE);
    let cell = (p - bounds.min) * (1024.0 / extent);
    // The cast saturates, so points outside the box, or NaN, get a border cell.
    let at = |v: f32| spread((v as u32).min(1023));
    at(cell.x) | at(cell.y) << 1 | at(cell.z) << 2
}

/// Indices of the points along the Morton curve over the box, ties in index order: the order in which to ask a map.
pub fn morton_order(points: &[Vec3], bounds: &Bounds3) -> Vec<u32> {
    let mut keys: Vec<u64> =
        (points.par_iter().enumerate()).map(|(i, &p)| u64::from(morton_code(p, bounds)) << 32 | i as u64).collect();
    keys.par_sort_unstable();
    keys.into_iter().map(|key| key as u32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_visits_octants_in_order() {
        let bounds = Bounds3::new(Vec3::ZERO, Vec3::ONE);
        let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32);
        let points: Vec<Vec3> = (0..8).rev().map(|i| 0.25 + 0.5 * corner(i)).collect();
        assert_eq!(morton_order(&points, &bounds), [7, 6, 5, 4, 3, 2, 1, 0]);
        assert_eq!(morton_code(Vec3::ONE, &bounds), (1 << 30) - 1);
        assert_eq!(morton_code(Vec3::splat(f32::NAN), &bounds), 0);
        assert_eq!(morton_code(Vec3::ONE, &Bounds3::new(Vec3::ONE, Vec3::ONE)), 0);
    }
}
