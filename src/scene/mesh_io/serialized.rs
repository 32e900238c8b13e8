use std::io::{BufRead, ErrorKind, Read};
use std::path::Path;

use bytemuck::Pod;
use flate2::bufread::ZlibDecoder;
use glam::{DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;

use super::mapped::FileBytes;
use super::{MeshCounts, MeshData, MeshError, MeshErrorKind, Place, Positions};
use crate::geometry::VertexAttribute;

/// The first two bytes of every sub-mesh.
const MAGIC: u16 = 0x041C;

const HAS_NORMALS: u32 = 0x0001;
const HAS_UVS: u32 = 0x0002;
const HAS_COLORS: u32 = 0x0008;
const FACE_NORMALS: u32 = 0x0010;
const DOUBLE_PRECISION: u32 = 0x2000;

/// DEFLATE cannot shrink data by more than this factor, so a header that announces more is false.
const LARGEST_RATIO: u64 = 1032;

/// The longest shape name.
const LONGEST_NAME: usize = 1 << 16;

/// Reads sub-mesh `shape_index` of a file in Mitsuba's serialized format, version 3 or 4.
pub fn read_serialized(path: &Path, shape_index: u32) -> Result<MeshData, MeshError> {
    let bytes = FileBytes::open(path)?;
    parse_serialized(&bytes, path, shape_index)
}

/// Reads a serialized mesh from memory; `path` is for messages.
pub fn parse_serialized(bytes: &[u8], path: &Path, shape_index: u32) -> Result<MeshData, MeshError> {
    let (mut stream, Head { flags, vertices, faces }) = open(bytes, path, shape_index)?;

    // The arrays follow each other.
    let (vertices, faces) = (vertices as usize, faces as usize);
    let double = flags & DOUBLE_PRECISION != 0;
    let mut data =
        MeshData { path: path.to_path_buf(), face_normals: flags & FACE_NORMALS != 0, ..MeshData::default() };
    data.positions = if double {
        Positions::F64(stream.numbers::<DVec3, 8>(vertices)?)
    } else {
        Positions::F32(stream.numbers::<Vec3, 4>(vertices)?)
    };
    if flags & HAS_NORMALS != 0 {
        data.normals = Some(stream.vectors(vertices, double)?);
    }
    if flags & HAS_UVS != 0 {
        data.uvs = Some(if double {
            stream.numbers::<DVec2, 8>(vertices)?.into_iter().map(DVec2::as_vec2).collect()
        } else {
            stream.numbers::<Vec2, 4>(vertices)?
        });
    }
    if flags & HAS_COLORS != 0 {
        let colors = stream.vectors(vertices, double)?;
        data.attributes.push(VertexAttribute {
            name: "vertex_color".to_owned(),
            channels: 3,
            per_vertex: true,
            data: bytemuck::cast_slice(&colors).to_vec(),
        });
    }
    data.indices = stream.numbers::<[u32; 3], 4>(faces)?;
    stream.check_contents(&data)?;
    Ok(data)
}

/// Tells from the first inflated bytes of a sub-mesh what it holds.
pub fn count_serialized(path: &Path, shape_index: u32) -> Result<MeshCounts, MeshError> {
    let bytes = FileBytes::open(path)?;
    let (_, head) = open(&bytes, path, shape_index)?;
    let has = |flag: u32| head.flags & flag != 0;
    Ok(MeshCounts {
        path: path.to_path_buf(),
        vertices: head.vertices,
        triangles: head.faces,
        normals: has(HAS_NORMALS),
        uvs: has(HAS_UVS),
        vertex_values: if has(HAS_COLORS) { 3 } else { 0 },
        face_values: 0,
        face_normals: has(FACE_NORMALS),
        exact: true,
        how: "header",
        cut_short: false,
    })
}

/// What stands before the arrays of a sub-mesh.
struct Head {
    flags: u32,
    vertices: u64,
    faces: u64,
}

/// Finds a sub-mesh and reads its flags and counts; the stream then stands at its arrays.
fn open<'a>(bytes: &'a [u8], path: &'a Path, shape_index: u32) -> Result<(Stream<'a, &'a [u8]>, Head), MeshError> {
    let (version, start, end) = locate(bytes, path, shape_index)?;
    let zlib = &bytes[start + 4..end];
    let mut stream = Stream { path, start, stream: ZlibDecoder::new(zlib) };
    let flags = u32::from_le_bytes(stream.array()?);
    if version == 4 {
        stream.skip_name()?;
    }
    let (vertices, faces) = (u64::from_le_bytes(stream.array()?), u64::from_le_bytes(stream.array()?));
    let number = if flags & DOUBLE_PRECISION != 0 { 8 } else { 4 };
    let has = |flag: u32, numbers: u64| if flags & flag != 0 { numbers } else { 0 };
    let per_vertex = 3 + has(HAS_NORMALS, 3) + has(HAS_UVS, 2) + has(HAS_COLORS, 3);
    stream.check_size(vertices, faces, per_vertex * number, zlib.len() as u64)?;
    Ok((stream, Head { flags, vertices, faces }))
}

/// Finds a sub-mesh: its format version, and where it begins and ends.
fn locate(bytes: &[u8], path: &Path, shape_index: u32) -> Result<(u16, usize, usize), MeshError> {
    let error = |at: usize, kind, found: String, expected: &str, fix: &str| {
        MeshError::new(path, Place::Byte(at as u64), kind, found, expected, fix)
    };
    let word = |at: usize| Some(u16::from_le_bytes([*bytes.get(at)?, *bytes.get(at + 1)?]));
    let header = |at: usize| match (word(at), word(at.saturating_add(2))) {
        (Some(MAGIC), Some(version @ (3 | 4))) => Ok(version),
        (Some(MAGIC), Some(version)) => Err(error(
            at,
            MeshErrorKind::Unsupported,
            format!("version {version} of the serialized format"),
            "version 3 or 4",
            "convert the mesh to PLY",
        )),
        (Some(other), _) => Err(error(
            at,
            MeshErrorKind::Malformed,
            format!("{other:#06x}"),
            "0x041c, the mark of a serialized mesh",
            "check the type of the shape",
        )),
        (None, _) => Err(error(
            at,
            MeshErrorKind::Truncated,
            "the end of the file".into(),
            "a serialized mesh",
            "export the mesh again",
        )),
    };
    let version = header(0)?;

    // The last four bytes are the number of sub-meshes; before them stand their offsets, of which the first is 0.
    let unsigned = |at: usize, size: usize| {
        let mut raw = [0; 8];
        raw[..size].copy_from_slice(bytes.get(at..at.checked_add(size)?)?);
        Some(u64::from_le_bytes(raw))
    };
    let offset_size = if version == 4 { 8 } else { 4 };
    let tail = bytes.len().saturating_sub(4);
    let count = unsigned(tail, 4).unwrap_or(0);
    let table = usize::try_from(count).ok().and_then(|n| tail.checked_sub(n.checked_mul(offset_size)?));
    let Some(table) = table.filter(|&t| count > 0 && t >= 4 && unsigned(t, offset_size) == Some(0)) else {
        // A single mesh is readable without its dictionary.
        if shape_index == 0 {
            return Ok((version, 0, bytes.len()));
        }
        let found = format!("a dictionary of {count} meshes at the end");
        return Err(error(tail, MeshErrorKind::Malformed, found, "one that fits the file", "export the mesh again"));
    };
    if u64::from(shape_index) >= count {
        let (found, expected) = (format!("{count} meshes"), format!("more than shape_index = {shape_index}"));
        return Err(error(tail, MeshErrorKind::OutOfRange, found, &expected, "use a smaller shape_index"));
    }
    let offset = |i: u64| {
        let at = table + i as usize * offset_size;
        unsigned(at, offset_size).and_then(|o| usize::try_from(o).ok()).filter(|&o| o < table)
    };
    let start = if shape_index == 0 { Some(0) } else { offset(u64::from(shape_index)) };
    let Some(start) = start else {
        let at = table + shape_index as usize * offset_size;
        return Err(error(
            at,
            MeshErrorKind::Malformed,
            "an offset beyond the meshes".into(),
            "one inside the file",
            "export the mesh again",
        ));
    };
    let version = header(start)?;
    let next = offset(u64::from(shape_index) + 1).filter(|_| u64::from(shape_index) + 1 < count);
    Ok((version, start, next.filter(|&n| n >= start + 4).unwrap_or(table).max(start + 4)))
}

/// The inflated bytes of one sub-mesh.
struct Stream<'a, R> {
    path: &'a Path,
    start: usize,
    stream: ZlibDecoder<R>,
}

impl<R: BufRead> Stream<'_, R> {
    fn error(&self, kind: MeshErrorKind, found: impl Into<String>, expected: impl Into<String>) -> MeshError {
        let fix = "the file is damaged: export the mesh again";
        MeshError::new(self.path, Place::Byte(self.start as u64), kind, found, expected, fix)
    }

    fn fill(&mut self, out: &mut [u8]) -> Result<(), MeshError> {
        self.stream.read_exact(out).map_err(|e| match e.kind() {
            ErrorKind::UnexpectedEof => {
                let found = format!("the end of the compressed data after {} bytes", self.stream.total_out());
                self.error(MeshErrorKind::Truncated, found, format!("{} more bytes of the mesh here", out.len()))
            }
            _ => self.error(MeshErrorKind::Malformed, format!("\"{e}\""), "zlib data"),
        })
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], MeshError> {
        let mut out = [0; N];
        self.fill(&mut out)?;
        Ok(out)
    }

    fn skip_name(&mut self) -> Result<(), MeshError> {
        for _ in 0..LONGEST_NAME {
            if self.array::<1>()? == [0] {
                return Ok(());
            }
        }
        Err(self.error(MeshErrorKind::TooLarge, format!("a name of more than {LONGEST_NAME} bytes"), "a shorter one"))
    }

    /// Refuses counts that the compressed bytes cannot hold, before anything is allocated.
    fn check_size(&self, vertices: u64, faces: u64, vertex_bytes: u64, compressed: u64) -> Result<(), MeshError> {
        let bytes = u128::from(vertices) * u128::from(vertex_bytes) + u128::from(faces) * 12;
        let most = compressed * LARGEST_RATIO;
        let found = format!("{vertices} vertices and {faces} triangles");
        if bytes > u128::from(most) {
            let expected = format!("at most {most} bytes, {LARGEST_RATIO} times the {compressed} compressed ones");
            return Err(self.error(MeshErrorKind::TooLarge, format!("{found}, {bytes} bytes"), expected));
        }
        if vertices.max(faces) > u64::from(u32::MAX) {
            return Err(self.error(MeshErrorKind::TooLarge, found, "fewer than 2³² of each"));
        }
        Ok(())
    }

    /// `count` values made of little-endian numbers of `N` bytes, inflated straight into their buffer.
    fn numbers<T: Pod, const N: usize>(&mut self, count: usize) -> Result<Vec<T>, MeshError> {
        let mut out = vec![T::zeroed(); count];
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut out);
        self.fill(bytes)?;
        if cfg!(target_endian = "big") {
            bytes.chunks_exact_mut(N).for_each(<[u8]>::reverse);
        }
        Ok(out)
    }

    fn vectors(&mut self, count: usize, double: bool) -> Result<Vec<Vec3>, MeshError> {
        if !double {
            return self.numbers::<Vec3, 4>(count);
        }
        Ok(self.numbers::<DVec3, 8>(count)?.into_iter().map(DVec3::as_vec3).collect())
    }

    fn check_contents(&self, data: &MeshData) -> Result<(), MeshError> {
        let bad = match &data.positions {
            Positions::F32(p) => p.par_iter().position_first(|p| !p.is_finite()),
            Positions::F64(p) => p.par_iter().position_first(|p| !p.is_finite()),
        };
        if let Some(i) = bad {
            let found = format!("vertex {i} at {}", data.positions.get(i));
            return Err(self.error(MeshErrorKind::NotFinite, found, "finite coordinates"));
        }
        let vertices = data.positions.len();
        if let Some(f) = data.indices.par_iter().position_first(|t| t.iter().any(|&i| i as usize >= vertices)) {
            let found = format!("triangle {f} with corners {:?}", data.indices[f]);
            return Err(self.error(
                MeshErrorKind::OutOfRange,
                found,
                format!("indices below the vertex count {vertices}"),
            ));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::{Compression, write::ZlibEncoder};
    use std::io::Write;

    /// One sub-mesh: a triangle with everything that the flags ask for.
    fn sub_mesh(version: u16, flags: u32, z: f64) -> Vec<u8> {
        let mut body = flags.to_le_bytes().to_vec();
        if version == 4 {
            body.extend_from_slice(b"name\0");
        }
        body.extend_from_slice(&3_u64.to_le_bytes());
        body.extend_from_slice(&1_u64.to_le_bytes());
        let mut push = |numbers: &[f64]| {
            for &x in numbers {
                if flags & DOUBLE_PRECISION != 0 {
                    body.extend_from_slice(&x.to_le_bytes());
                } else {
                    body.extend_from_slice(&(x as f32).to_le_bytes());
                }
            }
        };
        push(&[0.0, 0.0, z, 1.0, 0.0, z, 0.0, 1.0, z]);
        if flags & HAS_NORMALS != 0 {
            push(&[0.0, 0.0, 1.0].repeat(3));
        }
        if flags & HAS_UVS != 0 {
            push(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
        }
        if flags & HAS_COLORS != 0 {
            push(&[0.25, 0.5, 0.75].repeat(3));
        }
        for i in 0..3_u32 {
            body.extend_from_slice(&i.to_le_bytes());
        }
        pack(version, &body)
    }

    fn pack(version: u16, body: &[u8]) -> Vec<u8> {
        let mut out = MAGIC.to_le_bytes().to_vec();
        out.extend_from_slice(&version.to_le_bytes());
        let mut zlib = ZlibEncoder::new(out, Compression::best());
        zlib.write_all(body).expect("memory takes all that is written");
        zlib.finish().expect("memory takes all that is written")
    }

    fn file(version: u16, meshes: &[Vec<u8>]) -> Vec<u8> {
        let (mut out, mut dictionary) = (Vec::new(), Vec::new());
        for m in meshes {
            let offset = (out.len() as u64).to_le_bytes();
            dictionary.extend_from_slice(&offset[..if version == 4 { 8 } else { 4 }]);
            out.extend_from_slice(m);
        }
        out.extend_from_slice(&dictionary);
        out.extend_from_slice(&(meshes.len() as u32).to_le_bytes());
        out
    }

    fn parse(bytes: &[u8], index: u32) -> Result<MeshData, MeshError> {
        parse_serialized(bytes, Path::new("test.serialized"), index)
    }

    #[test]
    fn reads_every_sub_mesh_of_both_versions() {
        let all = HAS_NORMALS | HAS_UVS | HAS_COLORS;
        for version in [3, 4] {
            let flags = [0x1000, 0x1000 | all, DOUBLE_PRECISION | all, 0x1000 | FACE_NORMALS];
            let meshes: Vec<_> = flags.iter().enumerate().map(|(i, &f)| sub_mesh(version, f, i as f64 + 0.1)).collect();
            let bytes = file(version, &meshes);
            for (i, &f) in flags.iter().enumerate() {
                let data = parse(&bytes, i as u32).expect("a well-formed file");
                assert_eq!(data.indices, [[0, 1, 2]]);
                let z = data.positions.get(2).z;
                let exact = if f & DOUBLE_PRECISION != 0 { i as f64 + 0.1 } else { f64::from(i as f32 + 0.1) };
                assert_eq!(z, exact);
                assert_eq!(data.normals.is_some_and(|n| n == [Vec3::Z; 3]), f & HAS_NORMALS != 0);
                assert_eq!(data.uvs.is_some_and(|u| u[1] == Vec2::X), f & HAS_UVS != 0);
                assert_eq!(data.attributes.first().is_some_and(|a| a.data[5] == 0.75), f & HAS_COLORS != 0);
                assert_eq!(data.face_normals, f & FACE_NORMALS != 0);
            }
            assert_eq!(parse(&bytes, 4).unwrap_err().kind(), MeshErrorKind::OutOfRange);
        }
    }

    #[test]
    fn a_single_mesh_needs_no_dictionary() {
        assert_eq!(parse(&sub_mesh(4, 0x1000, 0.0), 0).expect("a well-formed file").indices.len(), 1);
    }

    #[test]
    fn refuses_what_is_not_a_mesh() {
        use MeshErrorKind::{Malformed, NotFinite, OutOfRange, TooLarge, Truncated, Unsupported};
        let good = file(4, &[sub_mesh(4, 0x1000, 0.0)]);
        let kind = |bytes: &[u8]| parse(bytes, 0).unwrap_err().kind();
        assert_eq!(kind(b""), Truncated);
        assert_eq!(kind(b"ply\nformat"), Malformed);
        assert_eq!(kind(&pack(5, b"")), Unsupported);
        assert_eq!(kind(&good[..good.len() / 2]), Truncated);
        assert_eq!(kind(&[&good[..4], &[0xff; 60]].concat()), Malformed);
        assert_eq!(kind(&file(4, &[sub_mesh(4, 0x1000, f64::NAN)])), NotFinite);

        // A huge count in a small file, a name without end, an index beyond the vertices.
        let mut bomb =
            [&0x1000_u32.to_le_bytes()[..], b"\0", &(10_u64 << 30).to_le_bytes(), &1_u64.to_le_bytes()].concat();
        assert_eq!(kind(&pack(4, &bomb)), TooLarge);
        bomb[5..21].fill(0xff);
        assert_eq!(kind(&pack(4, &bomb)), TooLarge);
        assert_eq!(kind(&pack(4, &[b'a'; 1 << 17])), TooLarge);
        let mut body = [&0x1000_u32.to_le_bytes()[..], b"\0", &1_u64.to_le_bytes(), &1_u64.to_le_bytes()].concat();
        body.extend_from_slice(&[0; 12]);
        body.extend_from_slice(&[1; 12]);
        assert_eq!(kind(&pack(4, &body)), OutOfRange);
    }

    #[test]
    fn a_false_dictionary_is_an_error() {
        let mut bytes = file(4, &[sub_mesh(4, 0x1000, 0.0), sub_mesh(4, 0x1000, 1.0)]);
        let place = bytes.len() - 12;
        bytes[place..place + 8].fill(0xff);
        assert_eq!(parse(&bytes, 1).unwrap_err().kind(), MeshErrorKind::Malformed);
        assert!(parse(&bytes, 0).is_ok());
    }
}
