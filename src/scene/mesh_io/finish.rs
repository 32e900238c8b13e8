use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::normals::smooth_normals;
use super::{MeshData, MeshError, MeshErrorKind, Place, Positions};
use crate::geometry::{PaddedVec3s, TriangleMesh, VertexAttribute};
use crate::math::Transform;

/// Mitsuba's switches for a mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FinishOptions {
    /// Turn the surface inside out.
    pub flip_normals: bool,
    /// Shade flat: drop vertex normals and compute none.
    pub face_normals: bool,
}

/// What [`finish`] did to a mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MeshReport {
    /// Triangles that are left.
    pub triangles: u64,
    pub vertices: u64,
    /// Triangles dropped because their area is zero: `area² ≤ (1e-8 · len²)²` with the longest edge as `len`.
    pub dropped_zero_area: u64,
    /// Faces with fewer than three corners, which the reader left out.
    pub skipped_faces: u64,
    /// Vertex normals of zero length or not finite, replaced by computed ones.
    pub repaired_normals: u64,
}

/// Moves a mesh into scene space and makes it ready for ray tracing and shading.
///
/// Positions are transformed in f64 and rounded once. Normals go through the inverse transpose and are made unit. A
/// mirroring transform and `flip_normals` each reverse the order of the corners, so that the geometric normal always
/// stays on the side on which the file's own winding (or, flipped, its opposite) puts it; `flip_normals` also negates
/// the vertex normals. Without vertex normals smooth ones are computed unless `face_normals` is set: for OBJ, PLY and
/// serialized alike, as Mitsuba does.
pub fn finish(
    data: MeshData,
    to_scene: &Transform,
    options: FinishOptions,
) -> Result<(TriangleMesh, MeshReport), MeshError> {
    check(&data)?;
    let MeshData { path, positions, mut indices, normals, uvs, mut attributes, points, skipped_faces, face_normals } =
        data;
    let mut report = MeshReport { skipped_faces, ..MeshReport::default() };

    // Transform and round; a coordinate may leave the range of f32.
    let positions = transform_positions(positions, to_scene);
    if let Some(i) = positions.par_iter().position_first(|p| !p.is_finite()) {
        return Err(MeshError::new(
            &path,
            Place::Whole,
            MeshErrorKind::NotFinite,
            format!("vertex {i} at {} after its transform", positions[i]),
            "coordinates that fit a float",
            "check to_world and the size of the mesh",
        ));
    }

    // Drop what has no area, then turn the corners so that the normal is on the wanted side.
    report.dropped_zero_area = drop_zero_area(&positions, &mut indices, &mut attributes);
    if indices.is_empty() {
        return Err(empty(&path, report.dropped_zero_area));
    }
    if to_scene.flips_handedness() != options.flip_normals {
        indices.par_iter_mut().with_min_len(4096).for_each(|t| t.swap(0, 2));
    }

    let normals = if options.face_normals || face_normals {
        None
    } else if let Some(mut normals) = normals {
        report.repaired_normals =
            transform_normals(&mut normals, to_scene, options.flip_normals, &positions, &indices, points.as_deref());
        Some(normals)
    } else {
        Some(smooth_normals(&positions, &indices, points.as_deref()))
    };

    report.triangles = indices.len() as u64;
    report.vertices = positions.len() as u64;
    let mesh =
        TriangleMesh { positions: PaddedVec3s::new(positions), indices, normals, uvs, attributes, flip_normals: false };
    Ok((mesh, report))
}

fn empty(path: &std::path::Path, dropped: u64) -> MeshError {
    let found = match dropped {
        0 => "no faces".to_owned(),
        n => format!("only triangles without area ({n} of them)"),
    };
    MeshError::new(
        path,
        Place::Whole,
        MeshErrorKind::Empty,
        found,
        "at least one triangle",
        "export the surface with faces, or take the shape out of the scene",
    )
}

/// The promises that the rest of the program relies on, for meshes that no reader has checked.
fn check(data: &MeshData) -> Result<(), MeshError> {
    let error = |kind, found: String, expected: &str| {
        Err(MeshError::new(&data.path, Place::Whole, kind, found, expected, "correct the mesh"))
    };
    let count = data.positions.len();
    if data.indices.is_empty() {
        return Err(empty(&data.path, 0));
    }
    if count > u32::MAX as usize || data.indices.len() > u32::MAX as usize {
        return error(MeshErrorKind::TooLarge, format!("{count} vertices"), "fewer than 2³² vertices and triangles");
    }
    if let Some(f) = data.indices.par_iter().position_first(|t| t.iter().any(|&i| i as usize >= count)) {
        let found = format!("triangle {f} with corners {:?}", data.indices[f]);
        return error(MeshErrorKind::OutOfRange, found, &format!("indices below the vertex count {count}"));
    }
    let lengths =
        [data.normals.as_ref().map(Vec::len), data.uvs.as_ref().map(Vec::len), data.points.as_ref().map(Vec::len)];
    if let Some(n) = lengths.into_iter().flatten().find(|&n| n != count) {
        return error(MeshErrorKind::Malformed, format!("{n} values per vertex"), &format!("{count}, one per vertex"));
    }
    if data.points.iter().flatten().any(|&p| p as usize >= count) {
        return error(MeshErrorKind::OutOfRange, "a vertex on a missing point".into(), "points below the vertex count");
    }
    for a in &data.attributes {
        let elements = if a.per_vertex { count } else { data.indices.len() };
        if a.data.len() != elements * a.channels {
            let found = format!("attribute {} with {} values", a.name, a.data.len());
            return error(MeshErrorKind::Malformed, found, &format!("{}", elements * a.channels));
        }
    }
    Ok(())
}

fn transform_positions(positions: Positions, to_scene: &Transform) -> Vec<Vec3> {
    let identity = *to_scene.matrix() == glam::DMat4::IDENTITY;
    match positions {
        Positions::F32(p) if identity => p,
        Positions::F32(mut p) => {
            p.par_iter_mut().with_min_len(4096).for_each(|p| *p = to_scene.point_f64(p.as_dvec3()).as_vec3());
            p
        }
        Positions::F64(p) => p.par_iter().with_min_len(4096).map(|&p| to_scene.point_f64(p).as_vec3()).collect(),
    }
}

/// Makes normals unit in scene space and gives the computed normal to vertices that have none; returns their number.
fn transform_normals(
    normals: &mut [Vec3],
    to_scene: &Transform,
    flip: bool,
    positions: &[Vec3],
    indices: &[[u32; 3]],
    points: Option<&[u32]>,
) -> u64 {
    let inverse_transpose = glam::DMat3::from_mat4(*to_scene.inverse_matrix()).transpose();
    let sign = if flip { -1.0 } else { 1.0 };
    let bad: u64 = normals
        .par_iter_mut()
        .with_min_len(4096)
        .map(|n| {
            let mapped = inverse_transpose * n.as_dvec3();
            // The largest component is taken out first: the squares of tiny normals would vanish.
            let unit = (mapped / mapped.abs().max_element()).try_normalize().filter(|u| u.is_finite());
            *n = unit.map_or(Vec3::ZERO, |u| (u * sign).as_vec3());
            u64::from(unit.is_none())
        })
        .sum();
    if bad > 0 {
        let smooth = smooth_normals(positions, indices, points);
        normals.par_iter_mut().zip(smooth).filter(|(n, _)| **n == Vec3::ZERO).for_each(|(n, s)| *n = s);
    }
    bad
}

/// True when the area is zero to working precision: `area² ≤ (1e-8 · len²)²`, `len` the longest edge.
fn has_no_area(p: [Vec3; 3]) -> bool {
    // Where f32 is far from doubt it decides: its error is about 1e-6 len², and this asks for an area above 5e-5 len².
    let (a, b) = (p[1] - p[0], p[2] - p[0]);
    let longest_sq = a.length_squared().max(b.length_squared()).max((b - a).length_squared());
    if longest_sq > 1e-15 && a.cross(b).length_squared() > 1e-8 * longest_sq * longest_sq {
        return false;
    }
    let [p0, p1, p2] = p.map(Vec3::as_dvec3);
    let (a, b, c): (DVec3, DVec3, DVec3) = (p1 - p0, p2 - p0, p2 - p1);
    let longest_sq = a.length_squared().max(b.length_squared()).max(c.length_squared());
    let area_sq = 0.25 * a.cross(b).length_squared();
    area_sq <= (1e-8 * longest_sq) * (1e-8 * longest_sq)
}

/// Takes triangles without area out, with their face attributes; returns how many.
fn drop_zero_area(positions: &[Vec3], indices: &mut Vec<[u32; 3]>, attributes: &mut [VertexAttribute]) -> u64 {
    let flat = |t: &[u32; 3]| has_no_area(t.map(|i| positions[i as usize]));
    let dropped = indices.par_iter().with_min_len(4096).filter(|t| flat(t)).count();
    if dropped == 0 {
        return 0;
    }
    let keep: Vec<bool> = indices.par_iter().map(|t| !flat(t)).collect();
    for a in attributes.iter_mut().filter(|a| !a.per_vertex) {
        let kept = a.data.chunks(a.channels).zip(&keep).filter(|(_, k)| **k).flat_map(|(v, _)| v);
        a.data = kept.copied().collect();
    }
    let mut flags = keep.iter();
    indices.retain(|_| *flags.next().expect("one flag per triangle"));
    dropped as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat4, Vec2};

    fn triangle() -> MeshData {
        MeshData {
            path: "test".into(),
            positions: Positions::F32(vec![Vec3::ZERO, Vec3::X, Vec3::Y]),
            indices: vec![[0, 1, 2]],
            ..MeshData::default()
        }
    }

    fn geometric(m: &TriangleMesh) -> Vec3 {
        let [a, b, c] = m.triangle(0);
        (b - a).cross(c - a).normalize()
    }

    #[test]
    fn normals_follow_mirrors_and_flips() {
        let mirror = Transform::new(DMat4::from_scale(DVec3::new(-2.0, 1.0, 1.0))).expect("an invertible matrix");
        for (transform, flip, expected) in [
            (Transform::IDENTITY, false, Vec3::Z),
            (Transform::IDENTITY, true, Vec3::NEG_Z),
            (mirror, false, Vec3::Z),
            (mirror, true, Vec3::NEG_Z),
        ] {
            for given in [None, Some(vec![Vec3::Z * 5.0; 3])] {
                let data = MeshData { normals: given, ..triangle() };
                let options = FinishOptions { flip_normals: flip, ..FinishOptions::default() };
                let (mesh, _) = finish(data, &transform, options).expect("a mesh within the limits");
                assert_eq!(geometric(&mesh), expected);
                assert!(mesh.normals.expect("the mesh keeps its normals").iter().all(|&n| n == expected));
            }
        }
    }

    #[test]
    fn normals_use_the_inverse_transpose() {
        let squash = Transform::new(DMat4::from_scale(DVec3::new(1.0, 1.0, 0.5))).expect("an invertible matrix");
        let slope = Vec3::new(1.0, 0.0, 1.0);
        let data = MeshData { normals: Some(vec![slope; 3]), ..triangle() };
        let (mesh, _) = finish(data, &squash, FinishOptions::default()).expect("a mesh within the limits");
        let expected = Vec3::new(1.0, 0.0, 2.0).normalize();
        assert!(mesh.normals.expect("the mesh keeps its normals").iter().all(|n| n.distance(expected) < 1e-6));
    }

    #[test]
    fn face_normals_drop_vertex_normals() {
        let data = MeshData { normals: Some(vec![Vec3::X; 3]), ..triangle() };
        let options = FinishOptions { face_normals: true, ..FinishOptions::default() };
        assert!(finish(data, &Transform::IDENTITY, options).expect("a mesh within the limits").0.normals.is_none());
    }

    #[test]
    fn zero_area_is_dropped_and_counted_with_its_attribute() {
        let data = MeshData {
            positions: Positions::F32(vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::X * 0.5, Vec3::new(0.5, 1e-8, 0.0)]),
            // Repeated corner, collinear, collinear within rounding, and two good ones.
            indices: vec![[0, 0, 1], [0, 1, 2], [0, 1, 3], [0, 1, 4], [0, 2, 3]],
            attributes: vec![VertexAttribute {
                name: "face_id".into(),
                channels: 1,
                per_vertex: false,
                data: vec![0.0, 1.0, 2.0, 3.0, 4.0],
            }],
            ..triangle()
        };
        let (mesh, report) =
            finish(data, &Transform::IDENTITY, FinishOptions::default()).expect("a mesh within the limits");
        assert_eq!((report.dropped_zero_area, report.triangles), (3, 2));
        assert_eq!(mesh.attributes[0].data, [1.0, 4.0]);
        assert_eq!(mesh.indices, [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn thin_but_real_triangles_stay() {
        // Aspect 1e7: area² = 2.5e-15 len⁴ is above 1e-16 len⁴.
        assert!(!has_no_area([Vec3::ZERO, Vec3::X, Vec3::new(0.5, 1e-7, 0.0)]));
        assert!(has_no_area([Vec3::ZERO, Vec3::X, Vec3::new(0.5, 1e-8, 0.0)]));
    }

    #[test]
    fn positions_are_transformed_in_double_precision() {
        // 1e9 + 0.25 does not fit a float; the difference to the centre does.
        let far = DVec3::splat(1e9);
        let p = |x, y| far + DVec3::new(x, y, 0.0);
        let data = MeshData { positions: Positions::F64(vec![p(0.25, 0.0), p(1.0, 0.0), p(0.0, 1.0)]), ..triangle() };
        let back = Transform::new(DMat4::from_translation(-far)).expect("an invertible matrix");
        assert_eq!(data.bounds(&back).expect("the mesh has vertices"), (DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0)));
        let (mesh, _) = finish(data, &back, FinishOptions::default()).expect("a mesh within the limits");
        assert_eq!(mesh.positions.as_slice()[0], Vec3::new(0.25, 0.0, 0.0));
    }

    #[test]
    fn repairs_missing_normals() {
        let data = MeshData { normals: Some(vec![Vec3::X, Vec3::ZERO, Vec3::NAN]), ..triangle() };
        let (mesh, report) =
            finish(data, &Transform::IDENTITY, FinishOptions::default()).expect("a mesh within the limits");
        assert_eq!(report.repaired_normals, 2);
        assert_eq!(mesh.normals.expect("the mesh keeps its normals"), [Vec3::X, Vec3::Z, Vec3::Z]);
    }

    #[test]
    fn refuses_what_breaks_promises() {
        let kind = |d: MeshData, t: &Transform| finish(d, t, FinishOptions::default()).unwrap_err().kind();
        let one = &Transform::IDENTITY;
        assert_eq!(kind(MeshData { indices: vec![], ..triangle() }, one), MeshErrorKind::Empty);
        assert_eq!(kind(MeshData { indices: vec![[0, 1, 1]], ..triangle() }, one), MeshErrorKind::Empty);
        assert_eq!(kind(MeshData { indices: vec![[0, 1, 3]], ..triangle() }, one), MeshErrorKind::OutOfRange);
        assert_eq!(kind(MeshData { uvs: Some(vec![Vec2::ZERO]), ..triangle() }, one), MeshErrorKind::Malformed);
        let huge = Transform::new(DMat4::from_scale(DVec3::splat(1e39))).expect("an invertible matrix");
        assert_eq!(kind(triangle(), &huge), MeshErrorKind::NotFinite);
    }
}
