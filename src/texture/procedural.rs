use glam::{Affine2, Vec2};

use super::ColorParam;
use crate::color::Rgb;
use crate::geometry::{GeometrySet, Shape, SurfaceInteraction, TriangleMesh, VertexAttribute};

/// Squares of two colours, four to the unit of uv; Mitsuba's plugin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Checkerboard {
    pub color0: ColorParam,
    pub color1: ColorParam,
    pub to_uv: Affine2,
}

impl Default for Checkerboard {
    fn default() -> Self {
        Self { color0: Rgb::splat(0.4).into(), color1: Rgb::splat(0.2).into(), to_uv: Affine2::IDENTITY }
    }
}

impl Checkerboard {
    /// True on the squares of `color0`: those that hold (¼, ¼) and (¾, ¾).
    #[inline]
    pub fn is_first(&self, uv: Vec2) -> bool {
        let p = self.to_uv.transform_point2(uv);
        let f = p - p.floor();
        (f.x > 0.5) == (f.y > 0.5)
    }

    #[inline]
    pub(super) fn pick(&self, uv: Vec2) -> ColorParam {
        if self.is_first(uv) { self.color0 } else { self.color1 }
    }
}

/// Values that a mesh file stores per vertex or face, such as `vertex_color`.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshAttribute {
    pub name: String,
    /// Factor on the stored values.
    pub scale: f32,
}

impl MeshAttribute {
    /// The attribute in a mesh that has it.
    pub fn find<'a>(&self, mesh: &'a TriangleMesh) -> Option<&'a VertexAttribute> {
        mesh.attributes.iter().find(|a| a.name == self.name)
    }

    /// The interpolated value; black on a shape that lacks the attribute (the scene loader refuses those).
    pub fn eval(&self, si: &SurfaceInteraction, geometry: &GeometrySet) -> Rgb {
        let Some(Shape::Mesh(mesh)) = geometry.shapes.get(si.shape as usize) else { return Rgb::BLACK };
        let Some(attribute) = self.find(mesh) else { return Rgb::BLACK };
        let value = if attribute.per_vertex {
            let [a, b, c] = mesh.indices[si.prim as usize].map(|i| element(attribute, i as usize));
            let (u, v) = (si.barycentric.x, si.barycentric.y);
            a * (1.0 - u - v) + b * u + c * v
        } else {
            element(attribute, si.prim as usize)
        };
        value * self.scale
    }

    /// The mean over the elements of every mesh that has the attribute; black if none has.
    pub fn mean(&self, geometry: &GeometrySet) -> Rgb {
        let (mut sum, mut count) = ([0f64; 3], 0usize);
        for shape in &geometry.shapes {
            let Shape::Mesh(mesh) = shape else { continue };
            let Some(attribute) = self.find(mesh) else { continue };
            for i in 0..attribute.data.len() / attribute.channels.max(1) {
                for (s, v) in sum.iter_mut().zip(element(attribute, i).to_array()) {
                    *s += f64::from(v);
                }
                count += 1;
            }
        }
        Rgb::from(sum.map(|s| (s / count.max(1) as f64) as f32)) * self.scale
    }
}

/// One vertex's or face's value.
#[inline]
fn element(attribute: &VertexAttribute, index: usize) -> Rgb {
    match attribute.channels {
        3 => Rgb::new(attribute.data[3 * index], attribute.data[3 * index + 1], attribute.data[3 * index + 2]),
        n => Rgb::splat(attribute.data[n * index]),
    }
}
