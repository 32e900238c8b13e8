use glam::Vec3;

/// By how much of the largest distance from the origin a ray must miss a box to be given up.
const MISS: f32 = 1e-5;

/// An axis-aligned box; empty when `min > max` on some axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds3 {
    pub min: Vec3,
    pub max: Vec3,
}

impl Default for Bounds3 {
    fn default() -> Self {
        Self::EMPTY
    }
}

impl Bounds3 {
    /// The neutral element of [`Bounds3::union`].
    pub const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    #[inline]
    pub fn new(min: Vec3, max: Vec3) -> Self {
        Self { min, max }
    }

    pub fn from_points(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| b.extend(p))
    }

    #[inline]
    pub fn extend(self, p: Vec3) -> Self {
        Self { min: self.min.min(p), max: self.max.max(p) }
    }

    #[inline]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    #[inline]
    pub fn is_empty(&self) -> bool {
        !self.min.cmple(self.max).all()
    }

    #[inline]
    pub fn center(&self) -> Vec3 {
        0.5 * self.min + 0.5 * self.max
    }

    #[inline]
    pub fn extent(&self) -> Vec3 {
        self.max - self.min
    }

    /// Length of the diagonal; 0 for an empty box.
    #[inline]
    pub fn diagonal(&self) -> f32 {
        if self.is_empty() { 0.0 } else { self.extent().length() }
    }

    #[inline]
    pub fn contains(&self, p: Vec3) -> bool {
        self.min.cmple(p).all() && p.cmple(self.max).all()
    }

    /// Half of the surface area; 0 for an empty box.
    #[inline]
    pub fn half_area(&self) -> f32 {
        if self.is_empty() {
            return 0.0;
        }
        let e = self.extent();
        e.x * e.y + e.y * e.z + e.z * e.x
    }

    /// Whether the ray from `o` along `d` surely misses the box, by more than rounding. Lights at infinity start on a disc as
    /// wide as the sphere around the scene, and of what they emit over a flat one most does.
    #[inline(always)]
    pub fn is_missed(&self, o: Vec3, d: Vec3) -> bool {
        let margin = MISS * o.abs().max(self.min.abs()).max(self.max.abs()).max_element();
        let (a, b) = ((self.min - margin - o) / d, (self.max + margin - o) / d);
        a.min(b).max_element() > a.max(b).min_element().max(0.0)
    }

    /// Centre and radius of a sphere around the box; radius 0 for an empty box.
    pub fn bounding_sphere(&self) -> (Vec3, f32) {
        if self.is_empty() { (Vec3::ZERO, 0.0) } else { (self.center(), 0.5 * self.diagonal()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{Key, Purpose, Sampler, Sequence, warp};

    /// Rays that are aimed at points of a box, most of them at its faces, edges and corners, or that run along one of its faces.
    #[test]
    fn no_ray_that_meets_the_box_is_given_up() {
        let given_up = |scale: f32, flat: bool, wide: f32| {
            let extent = Vec3::new(3.0, if flat { 0.0 } else { 0.5 }, 2.0) * scale;
            let bounds = Bounds3 { min: -extent, max: extent };
            let passes = (0..20_000).filter(|&i| {
                let mut s = Sampler::new(Sequence::Independent, Key::new(3, Purpose::Test, 0), i);
                let mut side = || [-1.0, 0.3, 1.0][(3.0 * s.next_1d()) as usize];
                let target = wide * extent * Vec3::new(side(), side(), side());
                let o = 9.0 * scale * warp::uniform_sphere(s.next_2d());
                let o = if i % 5 == 0 { o.with_y(target.y) } else { o };
                bounds.is_missed(o, (target - o).normalize())
            });
            passes.count()
        };
        for (scale, flat) in [(1.0, false), (1.0, true), (1e-3, false), (700.0, true)] {
            assert_eq!(given_up(scale, flat, 1.0), 0, "scale {scale}");
            assert!(given_up(scale, flat, 1.5) > 2_000, "scale {scale}");
        }
    }
}
