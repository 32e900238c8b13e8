//! Damaged mesh files: the readers answer with a mesh or an error, never with a panic, whatever is in the file.
//!
//! Each test mutates good files of one format in 2000 cases, 100 000 with the feature `slow-tests`. Run under a memory
//! limit these tests also show that no size in a file is believed before it is checked.

use std::io::Write;
use std::path::Path;

use caustica::math::Transform;
use caustica::scene::mesh_io::{FinishOptions, MeshData, MeshError, finish, parse_obj, parse_ply, parse_serialized};
use flate2::{Compression, write::ZlibEncoder};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

const CASES: u32 = if cfg!(feature = "slow-tests") { 100_000 } else { 2000 };

/// The same cases in every run.
const SEED: RngSeed = RngSeed::Fixed(1);

/// Text that matters to one of the formats, to be put anywhere.
const WORDS: [&str; 40] = [
    "nan",
    "-inf",
    "1e999",
    "0",
    "-1",
    "-0",
    "4294967296",
    "18446744073709551615",
    "-9223372036854775808",
    "1e-320",
    " ",
    "\n",
    "\r\n",
    "\\\n",
    "/",
    "//",
    "f ",
    "f 1 1 1 1\n",
    "v ",
    "vt ",
    "vn ",
    "l 1 2 3\n",
    "o x\n",
    "usemtl\n",
    "mtllib \n",
    "ply\n",
    "format binary_big_endian 1.0\n",
    "element face 3\n",
    "element vertex 9999999999\n",
    "property list uchar int x\n",
    "property double x\n",
    "property float r_0\n",
    "end_header\n",
    "long",
    "uchar",
    "float",
    "\0",
    "\u{fffd}",
    "list",
    "vertex_index",
];

/// One act of damage; places are fractions of the length.
#[derive(Clone, Debug)]
enum Damage {
    Set(f64, u8),
    Flip(f64, u8),
    Number(f64, u64),
    Remove(f64, usize),
    Repeat(f64, usize),
    Insert(f64, usize),
    Cut(f64),
}

fn damage() -> impl Strategy<Value = Damage> {
    let place = 0.0..1.0_f64;
    let number = prop_oneof![
        Just(0),
        Just(u64::MAX),
        Just(1 << 31),
        Just(1 << 32),
        Just(1 << 63),
        Just(0x7fc0_0000),
        any::<u64>()
    ];
    prop_oneof![
        (place.clone(), any::<u8>()).prop_map(|(p, b)| Damage::Set(p, b)),
        (place.clone(), 0..8_u8).prop_map(|(p, b)| Damage::Flip(p, b)),
        (place.clone(), number).prop_map(|(p, n)| Damage::Number(p, n)),
        (place.clone(), 1..40_usize).prop_map(|(p, n)| Damage::Remove(p, n)),
        (place.clone(), 1..80_usize).prop_map(|(p, n)| Damage::Repeat(p, n)),
        (place.clone(), 0..WORDS.len()).prop_map(|(p, w)| Damage::Insert(p, w)),
        place.prop_map(Damage::Cut),
    ]
}

fn apply(bytes: &mut Vec<u8>, damage: &Damage) {
    let at = |p: f64| (p * bytes.len() as f64) as usize;
    match *damage {
        _ if bytes.is_empty() => {}
        Damage::Set(p, b) => {
            let i = at(p);
            bytes[i] = b;
        }
        Damage::Flip(p, b) => {
            let i = at(p);
            bytes[i] ^= 1 << b;
        }
        Damage::Number(p, n) => {
            let i = at(p);
            bytes[i..].iter_mut().zip(n.to_le_bytes()).for_each(|(out, b)| *out = b);
        }
        Damage::Remove(p, n) => {
            let i = at(p);
            bytes.drain(i..(i + n).min(bytes.len()));
        }
        Damage::Repeat(p, n) => {
            let i = at(p);
            let piece = bytes[i..(i + n).min(bytes.len())].to_vec();
            bytes.splice(i..i, piece);
        }
        Damage::Insert(p, word) => {
            let i = at(p);
            bytes.splice(i..i, WORDS[word].bytes());
        }
        Damage::Cut(p) => bytes.truncate(at(p)),
    }
}

/// Follows a result to its end: a mesh must keep its promises, an error must say something.
fn follow(result: Result<MeshData, MeshError>) {
    // A serialized mesh may say itself that it is faceted.
    let faceted = result.as_ref().is_ok_and(|data| data.face_normals);
    let finished = result.and_then(|data| {
        let vertices = data.positions.len();
        assert!(data.indices.iter().flatten().all(|&i| (i as usize) < vertices));
        finish(data, &Transform::IDENTITY, FinishOptions::default())
    });
    match finished {
        Ok((mesh, _)) => {
            let vertices = mesh.positions.len();
            assert!(mesh.positions.as_slice().iter().all(|p| p.is_finite()));
            assert!(mesh.indices.iter().flatten().all(|&i| (i as usize) < vertices));
            assert_eq!(mesh.normals.is_none(), faceted, "finish computes normals for all meshes but faceted ones");
            if let Some(normals) = mesh.normals {
                assert!(normals.len() == vertices && normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-5));
            }
            assert!(mesh.uvs.is_none_or(|u| u.len() == vertices));
            for a in &mesh.attributes {
                let elements = if a.per_vertex { vertices } else { mesh.indices.len() };
                assert_eq!(a.data.len(), elements * a.channels);
            }
        }
        Err(error) => assert!(!error.found().is_empty() && !error.expected().is_empty() && !error.fix().is_empty()),
    }
}

const OBJ: &str = "mtllib none.mtl\no first\nv 0 0 0\nv 1 0 0 1\nv 1 1 0 0.5 0.5 0.5\nv 0 1 0\nvt 0 0\nvt 1 1\nvt 0.5\nvn 0 0 1\n\
    g a b\nusemtl m\ns off\nf 1/1/1 2/2/1 3/3/1 4/1/1\nf -4//1 -3 -2/2\n# end\nf 1 2 \\\n 3 4 1\nl 1 2 3\np 4\n";

const PLY_HEADER: &str = "comment x\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    property float nx\nproperty float ny\nproperty float nz\nproperty float u\nproperty float v\nproperty uchar red\n\
    property uchar green\nproperty uchar blue\nelement face 3\nproperty list uchar int vertex_indices\nproperty float id_0\n\
    element extra 2\nproperty short a\nproperty list int double b\nend_header\n";

fn ply(format: &str) -> Vec<u8> {
    let order = |mut b: Vec<u8>| {
        if format == "binary_big_endian" {
            b.reverse();
        }
        b
    };
    let mut out = format!("ply\nformat {format} 1.0\n{PLY_HEADER}").into_bytes();
    let ascii = format == "ascii";
    let mut put = |text: String, bytes: Vec<u8>| {
        if ascii {
            out.extend_from_slice(format!("{text} ").as_bytes());
        } else {
            out.extend_from_slice(&order(bytes));
        }
    };
    for p in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0_f32]] {
        for x in [p[0], p[1], 0.0, 0.0, 0.0, 1.0, p[0], p[1]] {
            put(x.to_string(), x.to_le_bytes().to_vec());
        }
        for b in [255, 128, 0_u8] {
            put(b.to_string(), vec![b]);
        }
    }
    for face in [&[0, 1, 2][..], &[0, 2, 3], &[0, 1, 2, 3]] {
        put(face.len().to_string(), vec![face.len() as u8]);
        for i in face {
            put(i.to_string(), i32::to_le_bytes(*i).to_vec());
        }
        put("0.5".into(), 0.5_f32.to_le_bytes().to_vec());
    }
    for n in [0, 2_i32] {
        put("7".into(), 7_i16.to_le_bytes().to_vec());
        put(n.to_string(), n.to_le_bytes().to_vec());
        for _ in 0..n {
            put("1.5".into(), 1.5_f64.to_le_bytes().to_vec());
        }
    }
    out
}

/// The inflated bytes of a serialized mesh with everything in it.
fn serialized_body(double: bool) -> Vec<u8> {
    let flags = 0xb_u32 | if double { 0x2000 } else { 0x1000 };
    let mut out = flags.to_le_bytes().to_vec();
    out.extend_from_slice(b"shape\0");
    out.extend_from_slice(&3_u64.to_le_bytes());
    out.extend_from_slice(&2_u64.to_le_bytes());
    let corners = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    for x in corners.into_iter().chain([0.0, 0.0, 1.0].repeat(3)).chain([0.25; 6]).chain([0.5; 9]) {
        if double {
            out.extend_from_slice(&f64::to_le_bytes(x));
        } else {
            out.extend_from_slice(&(x as f32).to_le_bytes());
        }
    }
    for i in [0, 1, 2, 2, 1, 0_u32] {
        out.extend_from_slice(&i.to_le_bytes());
    }
    out
}

fn serialized(bodies: &[Vec<u8>]) -> Vec<u8> {
    let (mut out, mut dictionary) = (Vec::new(), Vec::new());
    for body in bodies {
        dictionary.extend_from_slice(&(out.len() as u64).to_le_bytes());
        out.extend_from_slice(&[0x1c, 0x04, 4, 0]);
        let mut zlib = ZlibEncoder::new(&mut out, Compression::fast());
        zlib.write_all(body).expect("memory takes all that is written");
        zlib.finish().expect("memory takes all that is written");
    }
    out.extend_from_slice(&dictionary);
    out.extend_from_slice(&(bodies.len() as u32).to_le_bytes());
    out
}

fn name() -> &'static Path {
    Path::new("damaged")
}

#[test]
fn the_undamaged_files_are_good() {
    for (triangles, result) in [
        (6, parse_obj(OBJ.as_bytes(), name(), true)),
        (4, parse_ply(&ply("ascii"), name(), false)),
        (4, parse_ply(&ply("binary_little_endian"), name(), false)),
        (4, parse_ply(&ply("binary_big_endian"), name(), false)),
        (2, parse_serialized(&serialized(&[serialized_body(false), serialized_body(true)]), name(), 1)),
    ] {
        assert_eq!(result.expect("the file is whole").indices.len(), triangles);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: CASES, failure_persistence: None, rng_seed: SEED, ..ProptestConfig::default() })]

    #[test]
    fn damaged_obj(acts in prop::collection::vec(damage(), 1..8)) {
        let mut bytes = OBJ.as_bytes().to_vec();
        acts.iter().for_each(|d| apply(&mut bytes, d));
        follow(parse_obj(&bytes, name(), true));
    }

    #[test]
    fn damaged_ply(format in 0..3_usize, acts in prop::collection::vec(damage(), 1..8)) {
        let mut bytes = ply(["ascii", "binary_little_endian", "binary_big_endian"][format]);
        acts.iter().for_each(|d| apply(&mut bytes, d));
        follow(parse_ply(&bytes, name(), true));
    }

    #[test]
    fn damaged_ply_body(format in 0..3_usize, acts in prop::collection::vec(damage(), 1..4)) {
        // The header stays, so that the damage reaches the records.
        let mut bytes = ply(["ascii", "binary_little_endian", "binary_big_endian"][format]);
        let end = bytes.windows(11).position(|w| w == b"end_header\n").expect("the file has a header") + 11;
        let mut body = bytes.split_off(end);
        acts.iter().for_each(|d| apply(&mut body, d));
        bytes.extend_from_slice(&body);
        follow(parse_ply(&bytes, name(), false));
    }

    #[test]
    fn damaged_serialized(index in 0..3_u32, acts in prop::collection::vec(damage(), 1..6)) {
        let mut bytes = serialized(&[serialized_body(false), serialized_body(true)]);
        acts.iter().for_each(|d| apply(&mut bytes, d));
        follow(parse_serialized(&bytes, name(), index));
    }

    #[test]
    fn damaged_inside_the_compression(double in any::<bool>(), acts in prop::collection::vec(damage(), 1..6)) {
        // The zlib frame is whole, so that the damage reaches the reader.
        let mut body = serialized_body(double);
        acts.iter().for_each(|d| apply(&mut body, d));
        follow(parse_serialized(&serialized(&[body]), name(), 0));
    }

    #[test]
    fn any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        follow(parse_obj(&bytes, name(), false));
        follow(parse_ply(&bytes, name(), false));
        follow(parse_serialized(&bytes, name(), 0));
    }
}
