use glam::{Vec2, Vec3};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

use super::super::normals::smooth_normals;
use super::super::{MeshErrorKind, Place, Positions};
use super::*;

fn path() -> &'static Path {
    Path::new("test.obj")
}

/// Through tobj and in parallel pieces of several sizes; all must agree.
fn both(text: &[u8], flip_v: bool) -> Result<MeshData, MeshError> {
    let result = feed::parse(text, path(), flip_v);
    for piece in [1, 7, 40, 1 << 20] {
        agree(&result, &parallel::parse(text, path(), flip_v, piece));
    }
    result
}

fn parse(text: &str) -> Result<MeshData, MeshError> {
    both(text.as_bytes(), false)
}

/// Position, texture coordinate, normal.
type Corner = (Vec3, Option<Vec2>, Option<Vec3>);

/// All that a mesh says about its triangles, whatever the numbering of the vertices.
fn soup(data: &MeshData) -> Vec<[Corner; 3]> {
    let of = |i: u32| {
        let i = i as usize;
        (positions(data)[i], data.uvs.as_ref().map(|u| u[i]), data.normals.as_ref().map(|n| n[i]))
    };
    data.indices.iter().map(|t| t.map(of)).collect()
}

fn agree(a: &Result<MeshData, MeshError>, b: &Result<MeshData, MeshError>) {
    match (a, b) {
        (Ok(a), Ok(b)) => {
            assert_eq!(soup(a), soup(b));
            assert_eq!(a.skipped_faces, b.skipped_faces);
            // Smooth normals depend on which vertices share a point.
            let smooth = |d: &MeshData| {
                let normals = smooth_normals(positions(d), &d.indices, d.points.as_deref());
                d.indices.iter().map(|t| t.map(|i| normals[i as usize])).collect::<Vec<_>>()
            };
            assert_eq!(smooth(a), smooth(b));
        }
        (Err(a), Err(b)) => assert_eq!(a.to_string(), b.to_string()),
        _ => panic!("{a:?} but {b:?}"),
    }
}

fn positions(data: &MeshData) -> &[Vec3] {
    match &data.positions {
        Positions::F32(p) => p,
        Positions::F64(_) => panic!("OBJ positions are f32"),
    }
}

/// The corners of all triangles, whatever the numbering of the vertices.
fn corners(data: &MeshData) -> Vec<[Vec3; 3]> {
    data.indices.iter().map(|t| t.map(|i| positions(data)[i as usize])).collect()
}

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
const P: [Vec3; 4] = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];

#[test]
fn groups_objects_and_materials_are_one_mesh() {
    let text =
        format!("mtllib no.mtl\no one\n{SQUARE}g a\nusemtl m\ns 1\nf 1 2 3\no two\nusemtl n\nf 1 3 4\nl 1 2 3\np 1\n");
    assert_eq!(corners(&parse(&text).expect("a well-formed file")), [[P[0], P[1], P[2]], [P[0], P[2], P[3]]]);
}

#[test]
fn polygons_become_fans() {
    let text = format!("{SQUARE}v 0 0.5 0\nf 1 2 3 4 5\n");
    let q = Vec3::new(0.0, 0.5, 0.0);
    assert_eq!(
        corners(&parse(&text).expect("a well-formed file")),
        [[P[0], P[1], P[2]], [P[0], P[2], P[3]], [P[0], P[3], q]]
    );
}

#[test]
fn negative_indices_count_back() {
    let text = format!("{SQUARE}f -4 -3 -2\nv 0 0 1\nf -1 1 2\n");
    assert_eq!(corners(&parse(&text).expect("a well-formed file")), [[P[0], P[1], P[2]], [Vec3::Z, P[0], P[1]]]);
}

#[test]
fn faces_with_few_corners_are_skipped_and_counted() {
    let data = parse(&format!("{SQUARE}f 1 2\nf\nf 1 2 3\n")).expect("faces with too few corners are left out");
    assert_eq!((data.indices.len(), data.skipped_faces), (1, 2));
}

#[test]
fn continued_lines_crlf_weights_and_odd_bytes() {
    let text = b"# caf\xe9\r\nv 0 0 0 2\r\nv 1 0 0 0.1 0.2 0.3\r\nv 1 1 0\r\nf 1 \\\r\n 2 3\r\n";
    let data = both(text, false).expect("odd bytes stand in comments only");
    assert_eq!(corners(&data), [[P[0], P[1], P[2]]]);
}

#[test]
fn texture_coordinates_split_vertices_but_not_points() {
    let text = format!("{SQUARE}vt 0 0\nvt 1 0.25\nvt 0.5\nf 1/1 2/2 3/3\nf 1/2 3/3 4/1\n");
    let data = parse(&text).expect("a well-formed file");
    let uvs = data.uvs.as_ref().expect("the file has texture coordinates");
    let per_corner: Vec<Vec2> = data.indices.iter().flatten().map(|&i| uvs[i as usize]).collect();
    let [a, b, c] = [Vec2::ZERO, Vec2::new(1.0, 0.25), Vec2::new(0.5, 0.0)];
    assert_eq!(per_corner, [a, b, c, b, c, a]);
    assert_eq!(corners(&data), [[P[0], P[1], P[2]], [P[0], P[2], P[3]]]);
    // Five vertices: only the first corner was split, and both halves stand on the same point.
    let points = data.points.expect("corners that share a point were split");
    assert_eq!(points.len(), 5);
    assert_eq!(points[data.indices[0][0] as usize], points[data.indices[1][0] as usize]);
    let flipped = both(text.as_bytes(), true).expect("a well-formed file");
    assert_eq!(
        flipped.uvs.expect("the file has texture coordinates")[data.indices[0][1] as usize],
        Vec2::new(1.0, 0.75)
    );
}

#[test]
fn corners_without_texture_or_normal_get_zeros() {
    // tobj alone would put the texture coordinates out of step here.
    let text = format!("{SQUARE}f 1 2 3\nvt 0.5 0.5\nvn 0 0 1\nf 1/1/1 3 4//1\n");
    let data = parse(&text).expect("a well-formed file");
    let (uvs, normals) = (
        data.uvs.as_ref().expect("the file has texture coordinates"),
        data.normals.as_ref().expect("the file has normals"),
    );
    let of = |face: usize, corner: usize| data.indices[face][corner] as usize;
    assert_eq!((uvs[of(0, 0)], normals[of(0, 0)]), (Vec2::ZERO, Vec3::ZERO));
    assert_eq!((uvs[of(1, 0)], normals[of(1, 0)]), (Vec2::splat(0.5), Vec3::Z));
    assert_eq!((uvs[of(1, 1)], normals[of(1, 1)]), (Vec2::ZERO, Vec3::ZERO));
    assert_eq!((uvs[of(1, 2)], normals[of(1, 2)]), (Vec2::ZERO, Vec3::Z));
}

#[test]
fn unused_texture_coordinates_and_normals_are_left_out() {
    let data = parse(&format!("{SQUARE}vt 0 0\nvn 0 0 1\nf 1 2 3\n")).expect("a well-formed file");
    assert!(data.uvs.is_none() && data.normals.is_none() && data.points.is_none());
}

#[test]
fn errors_name_the_line() {
    use MeshErrorKind::{Malformed, NotFinite, OutOfRange};
    for (line, kind) in [
        ("v 1 2", Malformed),
        ("v 1 2 x", Malformed),
        ("v nan 0 0", NotFinite),
        ("v 0 inf 0", NotFinite),
        ("v 0 0 1e99", NotFinite),
        ("vt nan 0", NotFinite),
        ("vn 0 0", Malformed),
        ("f 1 2 5", OutOfRange),
        ("f 0 1 2", OutOfRange),
        ("f -5 1 2", OutOfRange),
        ("f 1/1 2 3", OutOfRange),
        ("f 1//1 2 3", OutOfRange),
        ("f 1 2 three", Malformed),
        ("f 1 2 3///6", Malformed),
        ("f /1 2 3", Malformed),
        ("f 1 2 -999999999999999999", OutOfRange),
        ("f 1 2 -9223372036854775808", Malformed),
        ("f 1 2 99999999999999999999", Malformed),
    ] {
        let error = parse(&format!("{SQUARE}\n{line}\nf 1 2 3\n")).unwrap_err();
        assert_eq!((error.kind(), error.place()), (kind, Place::Line(6)), "{line}: {error}");
    }
}

#[test]
fn nothing_gives_nothing() {
    for text in ["", "\n", "# only a comment", "v 0 0 0"] {
        assert!(parse(text).expect("no faces, no mistake").indices.is_empty());
    }
}

#[test]
fn missing_texture_coordinates_are_zero_when_flipped_too() {
    let data = both(format!("{SQUARE}vt 0.5 0.25\nf 1/1 2/1 3\n").as_bytes(), true).expect("a well-formed file");
    let uvs = data.uvs.as_ref().expect("the file has texture coordinates");
    let of = |corner: usize| uvs[data.indices[0][corner] as usize];
    assert_eq!((of(0), of(2)), (Vec2::new(0.5, 0.75), Vec2::ZERO));
}

#[test]
fn equal_indices_need_no_splitting() {
    let text = "v 0 0 0\nvt 0 0\nvn 0 0 1\nv 1 0 0\nvt 1 0\nvn 0 0 1\nv 0 1 0\nvt 0 1\nvn 0 0 1\nf 1/1/1 2/2/2 3/3/3\n";
    let data = parse(text).expect("a well-formed file");
    assert!(
        data.points.is_none()
            && data.indices == [[0, 1, 2]]
            && data.uvs.expect("the file has texture coordinates")[1] == Vec2::X
    );
}

/// Lines of which random files are made; most of them are good.
const LINES: [&str; 24] = [
    "v 0 0 0",
    "v 1 0 0",
    "v 0 1 0.5 1",
    "v 1 1 1 0.1 0.2 0.3",
    "v -1 2 1e-3",
    "vt 0 0",
    "vt 0.5 0.25",
    "vt 1",
    "vn 0 0 1",
    "vn 0 1 0",
    "f 1 2 3",
    "f 1/1 2/2 3/1",
    "f 1//1 2//2 3",
    "f -1 -2 -3 -4",
    "f 1/1/1 2/2/2 3/3/3",
    "f -1/-1/-1 1/1 2",
    "f 2 3",
    "g a",
    "# note",
    "f 1 2 \\",
    "v 3 3 \\",
    "3",
    "",
    "l 1 2 3",
];

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, rng_seed: RngSeed::Fixed(1), ..ProptestConfig::default() })]

    #[test]
    fn both_ways_agree_on_random_files(start in 0..12_usize, lines in prop::collection::vec(0..LINES.len(), 0..40), piece in 1..200_usize, flip: bool) {
        let text: String = LINES[..start].iter().copied().chain(lines.iter().map(|&l| LINES[l])).map(|l| format!("{l}\n")).collect();
        let by_tobj = feed::parse(text.as_bytes(), path(), flip);
        agree(&by_tobj, &parallel::parse(text.as_bytes(), path(), flip, piece));
    }
}
