use glam::{DMat3, DMat4, DVec3, Mat3, Mat4, Vec3};

use super::Bounds3;

/// An affine map with its inverse, composed in f64 and applied in f32.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    m: DMat4,
    inv: DMat4,
    m32: Mat4,
    normal32: Mat3,
}

impl Default for Transform {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Transform {
    pub const IDENTITY: Self =
        Self { m: DMat4::IDENTITY, inv: DMat4::IDENTITY, m32: Mat4::IDENTITY, normal32: Mat3::IDENTITY };

    /// `None` when the matrix has no finite inverse.
    pub fn new(m: DMat4) -> Option<Self> {
        let inv = m.inverse();
        if !(m.is_finite() && inv.is_finite()) {
            return None;
        }
        // The relative determinant, so that a scene in nanometres is not mistaken for a flat one.
        let linear = DMat3::from_mat4(m);
        let scale = linear.x_axis.length() * linear.y_axis.length() * linear.z_axis.length();
        if linear.determinant().abs() <= 1e-14 * scale {
            return None;
        }
        Some(Self { m, inv, m32: m.as_mat4(), normal32: DMat3::from_mat4(inv).transpose().as_mat3() })
    }

    pub fn matrix(&self) -> &DMat4 {
        &self.m
    }

    pub fn inverse_matrix(&self) -> &DMat4 {
        &self.inv
    }

    pub fn inverse(&self) -> Self {
        Self {
            m: self.inv,
            inv: self.m,
            m32: self.inv.as_mat4(),
            normal32: DMat3::from_mat4(self.m).transpose().as_mat3(),
        }
    }

    /// `self ∘ first`: applies `first`, then `self`.
    pub fn after(&self, first: &Self) -> Self {
        let (m, inv) = (self.m * first.m, first.inv * self.inv);
        Self { m, inv, m32: m.as_mat4(), normal32: DMat3::from_mat4(inv).transpose().as_mat3() }
    }

    /// True when the map mirrors space.
    pub fn flips_handedness(&self) -> bool {
        DMat3::from_mat4(self.m).determinant() < 0.0
    }

    #[inline]
    pub fn point(&self, p: Vec3) -> Vec3 {
        self.m32.transform_point3(p)
    }

    #[inline]
    pub fn vector(&self, v: Vec3) -> Vec3 {
        self.m32.transform_vector3(v)
    }

    /// Transforms a normal by the inverse transpose; the result is not normalised.
    #[inline]
    pub fn normal(&self, n: Vec3) -> Vec3 {
        self.normal32 * n
    }

    pub fn point_f64(&self, p: DVec3) -> DVec3 {
        self.m.transform_point3(p)
    }

    pub fn vector_f64(&self, v: DVec3) -> DVec3 {
        self.m.transform_vector3(v)
    }

    /// The box around the eight transformed corners.
    pub fn bounds(&self, b: &Bounds3) -> Bounds3 {
        if b.is_empty() {
            return *b;
        }
        let corner = |i: usize| {
            Vec3::new(
                if i & 1 == 0 { b.min.x } else { b.max.x },
                if i & 2 == 0 { b.min.y } else { b.max.y },
                if i & 4 == 0 { b.min.z } else { b.max.z },
            )
        };
        Bounds3::from_points((0..8).map(|i| self.point(corner(i))))
    }
}
