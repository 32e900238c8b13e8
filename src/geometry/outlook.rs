use glam::{DVec3, Vec3};

use super::{Shape, TriangleMesh};
use crate::math::Bounds3;

/// Meshes with more triangles or points than this are not examined one by one.
const MOST: usize = 64;

/// Height above a plane within which a point counts as on it, as a share of the coordinates: less than the distance by
/// which rays that leave a surface are moved off it.
const ON_PLANE: f64 = 1.0 / (1 << 22) as f64;

/// The part of space that lies before the front of a surface: where a straight line that leaves it can lead.
#[derive(Clone, Debug, PartialEq)]
pub enum Outlook {
    /// Nothing is known.
    Anywhere,
    /// Above one of some planes, each by a point and its unit normal.
    Above(Vec<(DVec3, DVec3)>),
    /// Outside of a ball, by centre and radius.
    Outside(DVec3, f64),
}

impl Outlook {
    /// What the front of a shape, where its geometric normals point, can see.
    pub fn of(shape: &Shape) -> Self {
        match shape {
            Shape::Mesh(mesh) if mesh.indices.len() <= MOST => Self::above(mesh),
            Shape::Disk(disk) => {
                let m = disk.to_world.matrix();
                let n = m.x_axis.truncate().cross(m.y_axis.truncate()).normalize_or_zero();
                // The normal is the image of +z, which a mirroring map turns round.
                let towards = if n.dot(m.z_axis.truncate()) < 0.0 { -n } else { n };
                let n = if disk.flip_normals { -towards } else { towards };
                if n == DVec3::ZERO { Self::Anywhere } else { Self::Above(vec![(m.w_axis.truncate(), n)]) }
            }
            Shape::Sphere(s) if !s.flip_normals => Self::Outside(s.center.as_dvec3(), f64::from(s.radius)),
            _ => Self::Anywhere,
        }
    }

    fn above(mesh: &TriangleMesh) -> Self {
        let side = if mesh.flip_normals { -1.0 } else { 1.0 };
        let plane = |i: u32| {
            let [a, b, c] = mesh.triangle(i).map(|p| p.as_dvec3());
            let n = side * (b - a).cross(c - a).try_normalize()?;
            Some((a, n))
        };
        let planes: Option<Vec<_>> = (0..mesh.indices.len() as u32).map(plane).collect();
        planes.map_or(Self::Anywhere, Self::Above)
    }

    /// True when no straight line from the front of the surface reaches the hull of `points`; with `both_sides`, none from
    /// its back either. Points on the surface's own plane are not reached.
    pub fn misses(&self, points: &[Vec3], both_sides: bool) -> bool {
        if points.is_empty() {
            return true;
        }
        match self {
            Self::Anywhere => false,
            Self::Above(planes) => planes.iter().all(|&(origin, n)| {
                let slack = |p: DVec3| ON_PLANE * p.abs().max(origin.abs()).max_element();
                let behind = |p: &Vec3| {
                    let p = p.as_dvec3();
                    let height = n.dot(p - origin);
                    height <= slack(p) && (!both_sides || height >= -slack(p))
                };
                points.iter().all(behind)
            }),
            Self::Outside(center, radius) => {
                let inside = |p: &Vec3| p.as_dvec3().distance(*center) < radius * (1.0 - ON_PLANE);
                !both_sides && points.iter().all(inside)
            }
        }
    }

    /// True when no straight line that leaves the front of the surface comes back to its front.
    pub fn misses_itself(&self, own: &[Vec3], both_sides: bool) -> bool {
        match self {
            // A ball is convex.
            Self::Outside(..) => !both_sides,
            _ => self.misses(own, both_sides),
        }
    }
}

/// The corners of a box.
pub fn corners(b: &Bounds3) -> Vec<Vec3> {
    if b.is_empty() {
        return Vec::new();
    }
    let pick = |k: u32, bit: u32, lo: f32, hi: f32| if k & bit == 0 { lo } else { hi };
    (0..8)
        .map(|k| Vec3::new(pick(k, 1, b.min.x, b.max.x), pick(k, 2, b.min.y, b.max.y), pick(k, 4, b.min.z, b.max.z)))
        .collect()
}

impl Shape {
    /// Points whose convex hull holds the shape: the vertices of a small mesh, else the corners of a box.
    pub fn hull(&self) -> Vec<Vec3> {
        match self {
            Shape::Mesh(m) if m.positions.len() <= MOST => m.positions.as_slice().to_vec(),
            Shape::Disk(d) => {
                let m = d.to_world.matrix();
                let (x, y, o) = (m.x_axis.truncate(), m.y_axis.truncate(), m.w_axis.truncate());
                [x + y, x - y, -x + y, -x - y].map(|p| (o + p).as_vec3()).to_vec()
            }
            _ => corners(&self.bounds()),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::{Disk, Sphere};
    use super::*;
    use crate::math::Transform;

    fn mesh(positions: &[[f32; 3]], indices: &[[u32; 3]]) -> Shape {
        Shape::Mesh(Arc::new(TriangleMesh {
            positions: positions.iter().map(|&p| Vec3::from(p)).collect::<Vec<_>>().into(),
            indices: indices.to_vec(),
            ..TriangleMesh::default()
        }))
    }

    /// The unit square at height z, facing up.
    fn square(z: f32) -> Shape {
        mesh(&[[0., 0., z], [1., 0., z], [1., 1., z], [0., 1., z]], &[[0, 1, 2], [0, 2, 3]])
    }

    #[test]
    fn a_square_sees_what_is_above_it_only() {
        let (low, high) = (square(0.0), square(0.5));
        let outlook = Outlook::of(&low);
        assert!(!outlook.misses(&high.hull(), false));
        assert!(Outlook::of(&high).misses(&low.hull(), false));
        assert!(!Outlook::of(&high).misses(&low.hull(), true));
        assert!(outlook.misses_itself(&low.hull(), true));
        // One corner above is enough, however little.
        assert!(!outlook.misses(&[Vec3::new(0.5, 0.5, -1.0), Vec3::new(0.5, 0.5, 1e-5)], false));
        // Sheets a millionth apart face each other.
        assert!(!outlook.misses(&square(1e-6).hull(), false));
    }

    #[test]
    fn a_box_sees_outwards_and_a_room_sees_itself() {
        let p = [
            [0., 0., 0.],
            [1., 0., 0.],
            [1., 1., 0.],
            [0., 1., 0.],
            [0., 0., 1.],
            [1., 0., 1.],
            [1., 1., 1.],
            [0., 1., 1.],
        ];
        let out = [
            [0, 2, 1],
            [0, 3, 2],
            [4, 5, 6],
            [4, 6, 7],
            [0, 1, 5],
            [0, 5, 4],
            [2, 3, 7],
            [2, 7, 6],
            [1, 2, 6],
            [1, 6, 5],
            [0, 4, 7],
            [0, 7, 3],
        ];
        let cube = mesh(&p, &out);
        let room = mesh(&p, &out.map(|[a, b, c]| [a, c, b]));
        assert!(Outlook::of(&cube).misses_itself(&cube.hull(), false));
        assert!(!Outlook::of(&cube).misses_itself(&cube.hull(), true));
        assert!(!Outlook::of(&room).misses_itself(&room.hull(), false));
        // An open book, seen from inside and from outside.
        let book = mesh(&[[0., 0., 0.], [1., 0., 0.], [0., 1., 0.5], [0., -1., 0.5]], &[[0, 1, 2], [0, 3, 1]]);
        assert!(!Outlook::of(&book).misses_itself(&book.hull(), false));
        let spine = mesh(&[[0., 0., 0.], [1., 0., 0.], [0., 1., -0.5], [0., -1., -0.5]], &[[0, 1, 2], [0, 3, 1]]);
        assert!(Outlook::of(&spine).misses_itself(&spine.hull(), false));
    }

    #[test]
    fn balls_and_discs() {
        let ball = |flip_normals| {
            let to_world = Transform::IDENTITY;
            Shape::Sphere(Sphere { center: Vec3::ZERO, radius: 1.0, flip_normals, uv: true, to_world })
        };
        let (out, inward) = (Outlook::of(&ball(false)), Outlook::of(&ball(true)));
        let own = ball(false).hull();
        assert!(out.misses_itself(&own, false) && !out.misses_itself(&own, true) && !inward.misses_itself(&own, false));
        assert!(out.misses(&[Vec3::splat(0.1), Vec3::splat(-0.5)], false));
        assert!(!out.misses(&[Vec3::splat(0.1), Vec3::X], false));
        let disk = |flip_normals| Shape::Disk(Disk { to_world: Transform::IDENTITY, flip_normals });
        assert!(
            !Outlook::of(&disk(false)).misses(&[Vec3::Z], false)
                && Outlook::of(&disk(false)).misses(&[-Vec3::Z], false)
        );
        assert!(
            Outlook::of(&disk(true)).misses(&[Vec3::Z], false) && !Outlook::of(&disk(true)).misses(&[-Vec3::Z], false)
        );
        let far = disk(false);
        assert!(Outlook::of(&far).misses_itself(&far.hull(), true));
    }
}
