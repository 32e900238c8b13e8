use glam::{DVec3, Vec2, Vec3};

use super::super::write::{PlyMesh, write_ply_to};
use super::super::{MeshErrorKind, Positions};
use super::*;

fn parse(bytes: &[u8]) -> Result<MeshData, MeshError> {
    parse_ply(bytes, Path::new("test.ply"), false)
}

/// A value of a test file.
enum V {
    F(f32),
    D(f64),
    I(i32),
    H(i16),
    B(u8),
}

/// The same file as text and in both byte orders.
fn all_formats(header: &str, values: &[V]) -> [(&'static str, Vec<u8>); 3] {
    let make = |format: &str, body: Vec<u8>| {
        [format!("ply\nformat {format} 1.0\n{header}end_header\n").as_bytes(), &body].concat()
    };
    let binary = |big: bool| {
        let order = |mut b: Vec<u8>| {
            if big {
                b.reverse();
            }
            b
        };
        values
            .iter()
            .flat_map(|v| match v {
                V::F(x) => order(x.to_le_bytes().to_vec()),
                V::D(x) => order(x.to_le_bytes().to_vec()),
                V::I(x) => order(x.to_le_bytes().to_vec()),
                V::H(x) => order(x.to_le_bytes().to_vec()),
                V::B(x) => vec![*x],
            })
            .collect()
    };
    let text = values.iter().map(|v| match v {
        V::F(x) => format!("{x}\n"),
        V::D(x) => format!("{x} "),
        V::I(x) => format!("{x} "),
        V::H(x) => format!("{x} "),
        V::B(x) => format!("{x} "),
    });
    [
        ("ascii", make("ascii", text.collect::<String>().into_bytes())),
        ("little", make("binary_little_endian", binary(false))),
        ("big", make("binary_big_endian", binary(true))),
    ]
}

const XYZ: &str = "property float x\nproperty float y\nproperty float z\n";

/// The four corners of the unit square as floats.
fn square() -> Vec<V> {
    [0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0].map(|x| V::F(x as f32)).into()
}

#[test]
fn triangles_in_all_formats() {
    let header =
        format!("comment hello\nelement vertex 4\n{XYZ}element face 2\nproperty list uchar int vertex_indices\n");
    let mut values = square();
    values.extend([V::B(3), V::I(0), V::I(1), V::I(2), V::B(3), V::I(0), V::I(2), V::I(3)]);
    for (name, bytes) in all_formats(&header, &values) {
        let data = parse(&bytes).expect("a well-formed file");
        assert_eq!(data.indices, [[0, 1, 2], [0, 2, 3]], "{name}");
        assert_eq!(data.positions.get(2), DVec3::new(1.0, 1.0, 0.0), "{name}");
        assert!(data.normals.is_none() && data.uvs.is_none() && data.attributes.is_empty());
    }
}

#[test]
fn mixed_polygons_with_odd_types_and_extra_properties() {
    let header = format!(
        "element junk 1\nproperty list uchar uchar bytes\nproperty double d\nelement vertex 4\n{XYZ}element face 4\n\
         property uchar flags\nproperty list short short vertex_index\nproperty list uchar float texcoord\n"
    );
    let mut values = vec![V::B(2), V::B(7), V::B(8), V::D(0.5)];
    values.extend(square());
    for polygon in [&[0, 1, 2][..], &[0, 1], &[0, 1, 2, 3], &[]] {
        values.extend([V::B(9), V::H(polygon.len() as i16)]);
        values.extend(polygon.iter().map(|&i| V::H(i)));
        values.extend([V::B(2), V::F(0.25), V::F(0.5)]);
    }
    for (name, bytes) in all_formats(&header, &values) {
        let data = parse(&bytes).expect("a well-formed file");
        assert_eq!(data.indices, [[0, 1, 2], [0, 1, 2], [0, 2, 3]], "{name}");
        assert_eq!(data.skipped_faces, 2, "{name}");
    }
}

#[test]
fn quads_keep_their_face_attribute() {
    let header = format!(
        "element vertex 4\n{XYZ}element face 2\nproperty float w_0\nproperty list uchar int vertex_indices\nproperty uchar id_1\n"
    );
    let mut values = square();
    for w in [1.5, 2.5] {
        values.extend([V::F(w), V::B(4), V::I(0), V::I(1), V::I(2), V::I(3), V::B(255)]);
    }
    for (name, bytes) in all_formats(&header, &values) {
        let data = parse(&bytes).expect("a well-formed file");
        assert_eq!(data.indices.len(), 4, "{name}");
        let attribute = |n: &str| data.attributes.iter().find(|a| a.name == n).expect("an attribute of the file");
        assert_eq!(attribute("face_w").data, [1.5, 1.5, 2.5, 2.5], "{name}");
        assert_eq!(attribute("face_id").data, [1.0; 4], "{name}");
        assert!(!attribute("face_w").per_vertex);
    }
}

#[test]
fn normals_uvs_and_attributes_in_any_order() {
    let header = "element vertex 3\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n\
        property float s\nproperty float t\nproperty float nx\nproperty float ny\nproperty float nz\n\
        property double x\nproperty double y\nproperty double z\nproperty float heat_0\n\
        property float tint_r\nproperty float tint_g\nproperty float tint_b\nproperty float two_x\nproperty float two_y\n\
        element face 1\nproperty list int int vertex_indices\n";
    let mut values = Vec::new();
    for i in 0..3 {
        values.extend([
            V::B(255),
            V::B(0),
            V::B(188),
            V::B(9),
            V::F(0.25),
            V::F(0.75),
            V::F(0.0),
            V::F(0.0),
            V::F(2.0),
        ]);
        values.extend([V::D(0.1 + f64::from(i)), V::D(0.2), V::D(if i == 1 { 5.0 } else { 0.3 }), V::F(i as f32)]);
        values.extend([V::F(0.1), V::F(0.2), V::F(0.3), V::F(8.0), V::F(9.0)]);
    }
    values.extend([V::I(3), V::I(0), V::I(1), V::I(2)]);
    for (name, bytes) in all_formats(header, &values) {
        let data = parse(&bytes).expect("a well-formed file");
        assert!(matches!(data.positions, Positions::F64(_)), "{name}");
        assert_eq!(data.positions.get(1), DVec3::new(1.1, 0.2, 5.0), "{name}");
        assert_eq!(data.normals.expect("the file has normals"), [Vec3::new(0.0, 0.0, 2.0); 3], "{name}");
        assert_eq!(data.uvs.expect("the file has texture coordinates"), [Vec2::new(0.25, 0.75); 3], "{name}");
        let names: Vec<&str> = data.attributes.iter().map(|a| &a.name[..]).collect();
        assert_eq!(names, ["vertex_color", "vertex_heat", "vertex_tint_color"], "{name}");
        // sRGB 188 is linear 0.5029.
        let c = &data.attributes[0].data;
        assert!(c[0] == 1.0 && c[1] == 0.0 && (c[2] - 0.5029).abs() < 1e-4, "{name}: {c:?}");
        assert_eq!(data.attributes[1].data, [0.0, 1.0, 2.0], "{name}");
        assert_eq!(data.attributes[2].data[3..6], [0.1, 0.2, 0.3], "{name}");
        let flipped = parse_ply(&bytes, Path::new("test.ply"), true).expect("a well-formed file");
        assert_eq!(flipped.uvs.expect("the file has texture coordinates")[0], Vec2::new(0.25, 0.25), "{name}");
    }
}

#[test]
fn what_is_written_is_read_back() {
    let n = 100_000_u32;
    let positions: Vec<Vec3> = (0..n).map(|i| Vec3::new(i as f32, 0.5 * i as f32, -1.0)).collect();
    let normals = vec![Vec3::Z; n as usize];
    let uvs: Vec<Vec2> = (0..n).map(|i| Vec2::new(i as f32, 1.0)).collect();
    let indices: Vec<[u32; 3]> = (2..n).map(|i| [i - 2, i - 1, i]).collect();
    for extra in [false, true] {
        let mesh = PlyMesh {
            positions: &positions,
            normals: extra.then_some(&normals[..]),
            uvs: extra.then_some(&uvs[..]),
            indices: &indices,
            comments: &["made by\na test"],
        };
        let mut bytes = Vec::new();
        write_ply_to(&mut bytes, &mesh).expect("memory takes all that is written");
        let data = parse(&bytes).expect("a well-formed file");
        assert!(matches!(&data.positions, Positions::F32(p) if *p == positions));
        assert_eq!(data.indices, indices);
        assert_eq!(data.normals, extra.then(|| normals.clone()));
        assert_eq!(data.uvs, extra.then(|| uvs.clone()));
    }
}

#[test]
fn header_mistakes_name_the_line() {
    use MeshErrorKind::{Malformed, TooLarge, Unsupported};
    let face = "element face 0\nproperty list uchar int vertex_indices\n";
    for (text, line, kind) in [
        ("", 1, Malformed),
        ("PLY\n", 1, Malformed),
        ("ply\nformat ascii 1.0\n", 3, Malformed),
        ("ply\nformat ascii 2.0\nend_header\n", 2, Malformed),
        ("ply\nformat binary 1.0\nend_header\n", 2, Malformed),
        ("ply\nend_header\n", 2, Malformed),
        ("ply\nformat ascii 1.0\nelement vertex many\nend_header\n", 3, Malformed),
        ("ply\nformat ascii 1.0\nelement vertex -1\nend_header\n", 3, Malformed),
        ("ply\nformat ascii 1.0\nproperty float x\nend_header\n", 3, Malformed),
        ("ply\nformat ascii 1.0\nelement vertex 0\nproperty real x\nend_header\n", 4, Malformed),
        ("ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float x\nend_header\n", 5, Malformed),
        ("ply\nformat ascii 1.0\nelement face 0\nproperty list float int vertex_indices\nend_header\n", 4, Malformed),
        ("ply\nformat ascii 1.0\nelement vertex 0\nend_header\n", 4, Unsupported),
        (&format!("ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\n{face}end_header\n"), 3, Unsupported),
        (
            &format!("ply\nformat binary_little_endian 1.0\nelement vertex 900000000\n{XYZ}{face}end_header\n"),
            3,
            TooLarge,
        ),
        (&format!("ply\nformat ascii 1.0\nelement vertex 18446744073709551615\n{XYZ}{face}end_header\n"), 3, TooLarge),
    ] {
        let error = parse(text.as_bytes()).unwrap_err();
        assert_eq!((error.kind(), error.place()), (kind, Place::Line(line)), "{text}: {error}");
    }
}

#[test]
fn body_mistakes_name_the_place() {
    use MeshErrorKind::{Malformed, NotFinite, OutOfRange, Truncated};
    let header = format!("element vertex 4\n{XYZ}element face 1\nproperty list char int vertex_indices\n");
    let with_face = |face: Vec<V>| {
        let mut values = square();
        values.extend(face);
        values
    };
    let spoiled = |x: f32| {
        let mut values = with_face(vec![V::B(3), V::I(0), V::I(1), V::I(2)]);
        values[7] = V::F(x);
        values
    };
    for (values, kind) in [
        (with_face(vec![V::B(3), V::I(0), V::I(1), V::I(4)]), OutOfRange),
        (with_face(vec![V::B(3), V::I(0), V::I(-1), V::I(2)]), OutOfRange),
        (with_face(vec![V::B(4), V::I(0), V::I(1), V::I(2)]), Truncated),
        (with_face(vec![V::B(100), V::I(0), V::I(1), V::I(2)]), Truncated),
        (spoiled(f32::NAN), NotFinite),
        (spoiled(f32::INFINITY), NotFinite),
    ] {
        for (name, bytes) in all_formats(&header, &values) {
            let error = parse(&bytes).unwrap_err();
            assert_eq!(error.kind(), kind, "{name}: {error}");
            match (name, error.place()) {
                ("ascii", Place::Line(line)) => assert!(line > 8, "{error}"),
                ("ascii", place) => panic!("{place:?}"),
                (_, place) => assert!(matches!(place, Place::Byte(_)), "{error}"),
            }
        }
    }
    let negative = with_face(vec![V::B(0xff), V::I(0), V::I(1), V::I(2)]);
    assert_eq!(parse(&all_formats(&header, &negative)[1].1).unwrap_err().kind(), Malformed);
    let text = format!("ply\nformat ascii 1.0\n{header}end_header\n0 0 0\n1 0 0\n1 one 0\n0 1 0\n3 0 1 2\n");
    let error = parse(text.as_bytes()).unwrap_err();
    assert_eq!((error.kind(), error.place()), (Malformed, Place::Line(12)), "{error}");
}

#[test]
fn every_cut_is_an_error_and_no_panic() {
    let header = format!("element vertex 4\n{XYZ}element face 2\nproperty list uchar int vertex_indices\n");
    let mut values = square();
    values.extend([V::B(3), V::I(0), V::I(1), V::I(2), V::B(4), V::I(0), V::I(1), V::I(2), V::I(3)]);
    for (name, bytes) in all_formats(&header, &values) {
        assert_eq!(parse(&bytes).expect("a well-formed file").indices.len(), 3);
        // The last digit and separator of a text may go without harm.
        for cut in 0..bytes.len() - 2 {
            assert!(parse(&bytes[..cut]).is_err(), "{name} cut at {cut}");
        }
    }
}
