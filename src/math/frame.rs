use glam::Vec3;

/// A right-handed orthonormal frame; `n` is its local z axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    pub s: Vec3,
    pub t: Vec3,
    pub n: Vec3,
}

impl Frame {
    /// A frame around the unit vector `n` [Duff et al. 2017, "Building an Orthonormal Basis, Revisited"].
    #[inline(always)]
    pub fn from_normal(n: Vec3) -> Self {
        let sign = 1.0f32.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        Self {
            s: Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
            t: Vec3::new(b, sign + n.y * n.y * a, -n.y),
            n,
        }
    }

    /// A frame around the unit vector `n` whose `s` follows `tangent` as far as it is perpendicular to `n`.
    #[inline(always)]
    pub fn from_normal_tangent(n: Vec3, tangent: Vec3) -> Self {
        let s = tangent - n * n.dot(tangent);
        let len_sq = s.length_squared();
        if len_sq > 1e-12 * tangent.length_squared() && len_sq.is_finite() {
            let s = s / len_sq.sqrt();
            Self { s, t: n.cross(s), n }
        } else {
            Self::from_normal(n)
        }
    }

    /// World to local.
    #[inline(always)]
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(self.s.dot(v), self.t.dot(v), self.n.dot(v))
    }

    /// Local to world.
    #[inline(always)]
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.s * v.x + self.t * v.y + self.n * v.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_is_orthonormal_for_every_octant_and_pole() {
        for n in
            [Vec3::Z, -Vec3::Z, Vec3::X, Vec3::new(1.0, -2.0, -3.0).normalize(), Vec3::new(1e-6, 0.0, -1.0).normalize()]
        {
            let f = Frame::from_normal(n);
            assert!(f.s.dot(f.t).abs() < 1e-6 && f.s.dot(f.n).abs() < 1e-6);
            assert!((f.s.cross(f.t) - f.n).length() < 1e-5);
            let v = Vec3::new(0.3, -0.5, 0.7);
            assert!((f.to_local(f.to_world(v)) - v).length() < 1e-6);
        }
    }
}
