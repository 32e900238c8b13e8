//! Shapes in the world of the scene file, in f64, until the whole scene's box is known.

use glam::{DMat3, DMat4, DVec3, Vec2, Vec3};

use super::super::mesh_io::{self, FinishOptions, MeshCounts, MeshData, MeshError, Positions};
use super::super::xml::{Child, NodeId, Query, Tag};
use super::super::{Position, SceneError, SceneStats};
use super::Loader;
use crate::bsdf::MaterialId;
use crate::geometry::{Cylinder, Disk, Shape, Sphere};
use crate::math::Transform;
use std::sync::Arc;

/// The geometry of a shape in the space of its file, or of its unit form.
enum Source {
    Mesh(Box<MeshData>, FinishOptions),
    /// A mesh file of which only the header was read.
    Counted(Box<MeshCounts>, FinishOptions),
    Sphere {
        flip_normals: bool,
    },
    Disk {
        flip_normals: bool,
    },
    Cylinder {
        flip_normals: bool,
    },
}

/// A shape before the scene is moved into its unit box.
pub(super) struct ShapeDesc<'d> {
    source: Source,
    pub to_world: Transform,
    pub material: MaterialId,
    pub material_node: Option<NodeId>,
    pub emitter: Option<&'d Child>,
    /// Importance as a target of caustic photons, where it is given.
    pub photon_target: Option<f32>,
    pub pos: Position,
}

const MESHES: [&str; 5] = ["obj", "ply", "serialized", "rectangle", "cube"];
const SHAPES: [&str; 10] =
    ["obj", "ply", "serialized", "rectangle", "cube", "sphere", "disk", "cylinder", "shapegroup", "instance"];
const PLANNED: [&str; 11] = [
    "linearcurve",
    "bsplinecurve",
    "hair",
    "sdfgrid",
    "ellipsoids",
    "ellipsoidsmesh",
    "merge",
    "heightfield",
    "deformable",
    "shapenet",
    "blender",
];

/// The matrix of a property as an invertible map.
pub(super) fn invertible(q: &Query, name: &str, m: DMat4) -> Result<Transform, SceneError> {
    let row = m.transpose().w_axis;
    if (row - glam::DVec4::W).abs().max_element() > 1e-9 {
        return Err(q
            .error_at(name, format!("\"{name}\" is a projective transform"))
            .help("the last row of the matrix must be 0 0 0 1"));
    }
    Transform::new(m).ok_or_else(|| {
        q.error_at(name, format!("\"{name}\" cannot be inverted"))
            .help("a scale factor is zero, or two axes are parallel; use small numbers for flat things, not 0")
    })
}

impl<'d> Loader<'d> {
    /// Reads any shape but a group or an instance.
    pub(super) fn shape(&mut self, q: Query<'d>) -> Result<ShapeDesc<'d>, SceneError> {
        self.refuse_media(&q)?;
        let mut to_world = invertible(&q, "to_world", q.transform("to_world")?)?;
        let source = match q.plugin() {
            plugin if MESHES.contains(&plugin) => self.mesh(&q)?,
            "sphere" => {
                let center = q.vector("center")?.unwrap_or(DVec3::ZERO);
                let radius = q.positive("radius", 1.0)?;
                let unit = DMat4::from_translation(center) * DMat4::from_scale(DVec3::splat(radius));
                to_world = invertible(&q, "radius", *to_world.matrix() * unit)?;
                refuse_stretched_sphere(&q, &to_world)?;
                Source::Sphere { flip_normals: q.bool("flip_normals", false)? }
            }
            "disk" => Source::Disk { flip_normals: q.bool("flip_normals", false)? },
            "cylinder" => {
                to_world = invertible(&q, "radius", *to_world.matrix() * cylinder_frame(&q)?)?;
                refuse_stretched_cylinder(&q, &to_world)?;
                Source::Cylinder { flip_normals: q.bool("flip_normals", false)? }
            }
            _ => return Err(q.unknown_plugin(&SHAPES, &PLANNED)),
        };
        q.ignore(&["silhouette_sampling_weight"]);
        let material_node = q.child(Tag::Bsdf)?.map(|c| c.node);
        let material = match material_node {
            Some(node) => self.material(node)?,
            None => self.default_material(),
        };
        let photon_target = photon_target(&q)?;
        let (emitter, pos) = (q.child(Tag::Emitter)?, q.node().pos.clone());
        let desc = ShapeDesc { source, to_world, material, material_node, emitter, photon_target, pos };
        q.finish()?;
        Ok(desc)
    }

    fn mesh(&mut self, q: &Query) -> Result<Source, SceneError> {
        let options = FinishOptions {
            flip_normals: q.bool("flip_normals", false)?,
            face_normals: q.plugin() != "rectangle" && q.bool("face_normals", false)?,
        };
        let data = match q.plugin() {
            "rectangle" => rectangle(),
            "cube" => cube(),
            kind => {
                let Some(path) = q.file("filename")? else {
                    return Err(q
                        .error(format!("the {kind} shape has no \"filename\""))
                        .help("add <string name=\"filename\" value=\"…\"/>"));
                };
                q.ignore(&["collapse", "max_smooth_angle", "srgb", "load_materials", "vertex_colors"]);
                let flip = match kind {
                    "obj" => q.bool("flip_tex_coords", true)?,
                    "ply" => q.bool("flip_tex_coords", false)?,
                    _ => false,
                };
                let index = if kind == "serialized" { q.int_in("shape_index", 0..=i64::from(u32::MAX))? } else { None };
                if self.unused {
                    return Ok(Source::Mesh(Box::default(), options));
                }
                if self.pictures.is_some() {
                    let counts = match kind {
                        "obj" => mesh_io::count_obj(&path),
                        "ply" => mesh_io::count_ply(&path),
                        _ => mesh_io::count_serialized(&path, index.unwrap_or(0) as u32),
                    };
                    let counts = counts.map_err(|e| mesh_error(q.pos("filename"), &e))?;
                    return Ok(Source::Counted(Box::new(counts), options));
                }
                let read = match kind {
                    "obj" => mesh_io::read_obj(&path, flip),
                    "ply" => mesh_io::read_ply(&path, flip),
                    _ => mesh_io::read_serialized(&path, index.unwrap_or(0) as u32),
                };
                let data = read.map_err(|e| mesh_error(q.pos("filename"), &e))?;
                self.hash_file(&path, q.pos("filename"))?;
                data
            }
        };
        Ok(Source::Mesh(Box::new(data), options))
    }

    /// Media and subsurface scattering are refused by name.
    pub(super) fn refuse_media(&self, q: &Query) -> Result<(), SceneError> {
        let inner = q.node().children.iter().find(|c| {
            matches!(self.doc.node(c.node).tag, Tag::Medium | Tag::Subsurface | Tag::Volume | Tag::Phase)
                || matches!(c.name.as_deref(), Some("interior" | "exterior"))
        });
        match inner {
            Some(c) => Err(super::not_yet(&c.pos, self.doc.node(c.node))),
            None => Ok(()),
        }
    }
}

impl ShapeDesc<'_> {
    /// The box of the shape in the world, or in its group's space.
    pub(super) fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let m = self.to_world.matrix();
        let center = m.w_axis.truncate();
        let around = |reach: DVec3| Some((center - reach, center + reach));
        // A circle spanned by two vectors reaches as far as the root of the sum of their squares.
        let circle = |a: DVec3, b: DVec3| (a * a + b * b).map(f64::sqrt);
        let (x, y, z) = (m.x_axis.truncate(), m.y_axis.truncate(), m.z_axis.truncate());
        match &self.source {
            Source::Mesh(data, _) => data.bounds(&self.to_world),
            Source::Counted(..) => None,
            Source::Sphere { .. } => around((x * x + y * y + z * z).map(f64::sqrt)),
            Source::Disk { .. } => around(circle(x, y)),
            Source::Cylinder { .. } => {
                let (reach, top) = (circle(x, y), center + z);
                Some((center.min(top) - reach, center.max(top) + reach))
            }
        }
    }

    /// What a mesh holds, and whether it is shaded flat; `None` for other shapes.
    pub(super) fn counts(&self) -> Option<(MeshCounts, bool)> {
        let (counts, options) = match &self.source {
            Source::Mesh(data, options) => (MeshCounts::of(data), options),
            Source::Counted(counts, options) => ((**counts).clone(), options),
            _ => return None,
        };
        let flat = options.face_normals || counts.face_normals;
        Some((counts, flat))
    }

    /// The shape moved by `to_scene`, which follows its own transform.
    pub(super) fn finish(self, to_scene: &Transform, stats: &mut SceneStats) -> Result<Shape, SceneError> {
        let to_world = to_scene.after(&self.to_world);
        let m = to_world.matrix();
        if !m.as_mat4().is_finite() {
            return Err(
                SceneError::at(&self.pos, "the shape's transform exceeds the range of floats").help("check to_world")
            );
        }
        Ok(match self.source {
            Source::Mesh(data, options) => {
                let (mesh, report) =
                    mesh_io::finish(*data, &to_world, options).map_err(|e| mesh_error(&self.pos, &e))?;
                stats.triangles += report.triangles;
                stats.dropped_triangles += report.dropped_zero_area;
                stats.skipped_faces += report.skipped_faces;
                stats.repaired_normals += report.repaired_normals;
                Shape::Mesh(Arc::new(mesh))
            }
            Source::Counted(..) => unreachable!("what is only predicted is not placed"),
            Source::Sphere { flip_normals } => {
                // The mean of three equal lengths; equal is checked to 1e-4.
                let radius = DMat3::from_mat4(*m).determinant().abs().cbrt();
                let center = m.w_axis.truncate().as_vec3();
                Shape::Sphere(Sphere { center, radius: radius as f32, flip_normals, uv: true, to_world })
            }
            Source::Disk { flip_normals } => Shape::Disk(Disk { to_world, flip_normals }),
            Source::Cylinder { flip_normals } => Shape::Cylinder(Cylinder {
                to_world,
                radius: m.x_axis.truncate().length() as f32,
                length: m.z_axis.truncate().length() as f32,
                flip_normals,
            }),
        })
    }
}

/// How important a shape is as a target of caustic photons.
fn photon_target(q: &Query) -> Result<Option<f32>, SceneError> {
    match q.float("photon_target")? {
        Some(v) if !(0.0..=1e6).contains(&v) => Err(q
            .error_at("photon_target", format!("\"photon_target\" is {v}"))
            .help("it must be between 0 (no photons are aimed at the shape) and 1e6; other shapes have 1")),
        v => Ok(v.map(|v| v as f32)),
    }
}

/// The trouble of a mesh file, at the place where the scene names it.
fn mesh_error(pos: &Position, e: &MeshError) -> SceneError {
    SceneError::at(pos, e.to_string())
}

/// Mitsuba's rectangle: [−1, 1]² in the xy plane, normal +z.
fn rectangle() -> MeshData {
    let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
    MeshData {
        path: "rectangle".into(),
        positions: Positions::F32(corners.map(|(u, v)| Vec3::new(2.0 * u - 1.0, 2.0 * v - 1.0, 0.0)).to_vec()),
        indices: vec![[0, 1, 2], [2, 3, 0]],
        uvs: Some(corners.map(Vec2::from).to_vec()),
        face_normals: true,
        ..MeshData::default()
    }
}

/// Mitsuba's cube: [−1, 1]³, each side with its own unit square of texture coordinates.
fn cube() -> MeshData {
    // Per side: its normal and the direction of u; v runs down n × u.
    let sides = [
        (Vec3::NEG_Y, Vec3::X),
        (Vec3::Y, Vec3::X),
        (Vec3::X, Vec3::Y),
        (Vec3::Z, Vec3::Y),
        (Vec3::NEG_X, Vec3::Z),
        (Vec3::NEG_Z, Vec3::NEG_Y),
    ];
    let mut data = MeshData { path: "cube".into(), ..MeshData::default() };
    let (mut positions, mut normals, mut uvs) = (Vec::new(), Vec::new(), Vec::new());
    for (n, u) in sides {
        let first = positions.len() as u32;
        let v = n.cross(u);
        for (s, t) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
            positions.push(n + (2.0 * s - 1.0) * u + (2.0 * t - 1.0) * v);
            normals.push(n);
            uvs.push(Vec2::new(s, t));
        }
        data.indices.extend([[0, 1, 2], [2, 3, 0]].map(|t| t.map(|i| first + i)));
    }
    data.positions = Positions::F32(positions);
    data.normals = Some(normals);
    data.uvs = Some(uvs);
    data
}

/// The map from the unit cylinder along z to the one between p0 and p1.
fn cylinder_frame(q: &Query) -> Result<DMat4, SceneError> {
    let p0 = q.vector("p0")?.unwrap_or(DVec3::ZERO);
    let p1 = q.vector("p1")?.unwrap_or(DVec3::Z);
    let radius = q.positive("radius", 1.0)?;
    let Some(axis) = (p1 - p0).try_normalize() else {
        return Err(q.error_at("p1", "the cylinder's ends p0 and p1 coincide").help("move one of them"));
    };
    let (s, t) = axis.any_orthonormal_pair();
    Ok(DMat4::from_cols((radius * s).extend(0.0), (radius * t).extend(0.0), (p1 - p0).extend(0.0), p0.extend(1.0)))
}

/// True when the lengths are equal and the vectors perpendicular, to 1e-4 of the lengths.
fn circular(a: DVec3, b: DVec3) -> bool {
    let (la, lb) = (a.length(), b.length());
    (la - lb).abs() <= 1e-4 * la.max(lb) && a.dot(b).abs() <= 1e-4 * la * lb
}

fn refuse_stretched_sphere(q: &Query, to_world: &Transform) -> Result<(), SceneError> {
    let m = to_world.matrix();
    let (x, y, z) = (m.x_axis.truncate(), m.y_axis.truncate(), m.z_axis.truncate());
    if circular(x, y) && circular(y, z) && circular(x, z) {
        return Ok(());
    }
    Err(q
        .error_at("to_world", "to_world stretches a sphere into an ellipsoid")
        .help("scale all axes alike, or use a mesh for an ellipsoid"))
}

fn refuse_stretched_cylinder(q: &Query, to_world: &Transform) -> Result<(), SceneError> {
    let m = to_world.matrix();
    let (x, y, z) = (m.x_axis.truncate(), m.y_axis.truncate(), m.z_axis.truncate());
    let square = |v: DVec3| v.dot(z).abs() <= 1e-4 * v.length() * z.length();
    if circular(x, y) && square(x) && square(y) {
        return Ok(());
    }
    Err(q
        .error_at("to_world", "to_world makes the cylinder's cross-section an ellipse, or slants it")
        .help("scale the axes across the cylinder alike, or use a mesh"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cube_faces_point_outwards_and_have_area_24() {
        let (mesh, report) = mesh_io::finish(cube(), &Transform::IDENTITY, FinishOptions::default()).expect("valid");
        assert_eq!(report.triangles, 12);
        let mut area = 0.0;
        for i in 0..12 {
            let [a, b, c] = mesh.triangle(i);
            let n = (b - a).cross(c - a);
            area += 0.5 * n.length();
            assert!(n.dot(a + b + c) > 0.0);
            let normals = mesh.normals.as_ref().expect("given");
            assert!(n.normalize().dot(normals[mesh.indices[i as usize][0] as usize]) > 0.999);
        }
        assert_eq!(area, 24.0);
    }

    #[test]
    fn rectangle_looks_along_z() {
        let (mesh, _) = mesh_io::finish(rectangle(), &Transform::IDENTITY, FinishOptions::default()).expect("valid");
        let [a, b, c] = mesh.triangle(1);
        assert_eq!((b - a).cross(c - a), 4.0 * Vec3::Z);
    }
}
