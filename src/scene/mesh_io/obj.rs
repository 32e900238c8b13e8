use std::io::{self, BufRead, Read};
use std::path::Path;

use glam::{Vec2, Vec3};

use super::error::quote;
use super::mapped::FileBytes;
use super::{MeshData, MeshError, MeshErrorKind, Place, Positions};

/// Reads an OBJ file as one mesh: groups, objects, materials, points and lines are left out, as in Mitsuba. `flip_v`
/// turns texture coordinates upside down (Mitsuba's `flip_tex_coords`, on by default for OBJ).
pub fn read_obj(path: &Path, flip_v: bool) -> Result<MeshData, MeshError> {
    let bytes = FileBytes::open(path)?;
    parse_obj(&bytes, path, flip_v)
}

/// Reads an OBJ file from memory; `path` is for messages.
pub fn parse_obj(bytes: &[u8], path: &Path, flip_v: bool) -> Result<MeshData, MeshError> {
    let mut feed = Feed::new(bytes, path);
    let options = tobj::LoadOptions { triangulate: true, ..tobj::LoadOptions::default() };
    let result = tobj::load_obj_buf(&mut feed, &options, |_| Err(tobj::LoadError::OpenFileFailed));
    if let Some(error) = feed.error {
        return Err(error);
    }
    let (models, _) = result.map_err(|e| {
        let expected = "an OBJ file that tobj accepts";
        MeshError::new(path, Place::Whole, MeshErrorKind::Malformed, format!("\"{e}\""), expected, "export it again")
    })?;
    let mut data = MeshData { path: path.to_path_buf(), skipped_faces: feed.skipped_faces, ..MeshData::default() };
    // The feed lets no group through, so that there is one model at most.
    if let Some(model) = models.into_iter().next() {
        join_indices(model.mesh, feed.any_uv, feed.any_normal, flip_v, &mut data);
    }
    Ok(data)
}

/// One index for position, texture coordinate and normal together: splits a position where they differ.
fn join_indices(mesh: tobj::Mesh, has_uv: bool, has_normal: bool, flip_v: bool, data: &mut MeshData) {
    const NONE: u32 = u32::MAX;
    let points = mesh.positions.len() / 3;
    let vec3 = |a: &[f32], i: u32| Vec3::from_slice(&a[3 * i as usize..]);
    let uv_of = |corner: usize| if has_uv { mesh.texcoord_indices[corner] } else { 0 };
    let normal_of = |corner: usize| if has_normal { mesh.normal_indices[corner] } else { 0 };

    // The vertices of one point form a list: (texture coordinate, normal, next).
    let mut heads = vec![NONE; points];
    let mut vertices: Vec<(u32, u32, u32)> = Vec::with_capacity(points);
    let mut point_of: Vec<u32> = Vec::with_capacity(points);
    let mut indices = Vec::with_capacity(mesh.indices.len());
    for (corner, &point) in mesh.indices.iter().enumerate() {
        let key = (uv_of(corner), normal_of(corner));
        let mut vertex = heads[point as usize];
        while vertex != NONE && (vertices[vertex as usize].0, vertices[vertex as usize].1) != key {
            vertex = vertices[vertex as usize].2;
        }
        if vertex == NONE {
            vertex = vertices.len() as u32;
            vertices.push((key.0, key.1, heads[point as usize]));
            point_of.push(point);
            heads[point as usize] = vertex;
        }
        indices.push(vertex);
    }

    data.positions = Positions::F32(point_of.iter().map(|&p| vec3(&mesh.positions, p)).collect());
    data.indices = indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
    data.normals = has_normal.then(|| vertices.iter().map(|v| vec3(&mesh.normals, v.1)).collect());
    data.uvs = has_uv.then(|| {
        let uv = |i: u32| Vec2::from_slice(&mesh.texcoords[2 * i as usize..]);
        let flip = |uv: Vec2| if flip_v { Vec2::new(uv.x, 1.0 - uv.y) } else { uv };
        vertices.iter().map(|v| flip(uv(v.0))).collect()
    });
    // Points are numbered like the positions were; there are at most as many as vertices.
    data.points = (vertices.len() > points).then_some(point_of);
}

/// Lines are passed on in pieces of about this size.
const PIECE: usize = 1 << 16;

/// Passes the lines that describe the surface on to tobj, checked and in a form that it reads safely: tobj 4 does not
/// check that numbers are finite, overflows on wild indices, leaves texture coordinates and vertices out of step when only
/// some corners have them, takes lines for faces, and says of an error neither line nor text.
///
/// Texture coordinate 1 and normal 1 of what tobj sees are zeros put before the file, for corners that have none.
struct Feed<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
    line: u64,
    /// Checked text, and how much of it tobj has taken.
    piece: Vec<u8>,
    taken: usize,
    /// Positions, texture coordinates and normals so far.
    counts: [i64; 3],
    any_uv: bool,
    any_normal: bool,
    skipped_faces: u64,
    error: Option<MeshError>,
}

impl<'a> Feed<'a> {
    fn new(bytes: &'a [u8], path: &'a Path) -> Self {
        Self {
            path,
            bytes,
            at: 0,
            line: 0,
            piece: b"vt 0 0\nvn 0 0 0\n".to_vec(),
            taken: 0,
            counts: [0; 3],
            any_uv: false,
            any_normal: false,
            skipped_faces: 0,
            error: None,
        }
    }

    fn fail(&self, kind: MeshErrorKind, found: &[u8], expected: impl Into<String>) -> MeshError {
        let fix = "correct the line or export the mesh again";
        MeshError::new(self.path, Place::Line(self.line), kind, quote(found), expected, fix)
    }

    /// Checks lines until there is a piece of text to pass on or the file ends.
    fn refill(&mut self) -> Result<(), MeshError> {
        self.piece.clear();
        self.taken = 0;
        while self.piece.len() < PIECE && self.at < self.bytes.len() {
            let rest = &self.bytes[self.at..];
            let length = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
            self.at += length + 1;
            self.line += 1;
            let line = rest[..length].trim_ascii();
            match line.strip_suffix(b"\\") {
                None => self.line(line)?,
                Some(start) => self.continued(start)?,
            }
        }
        Ok(())
    }

    /// A line that goes on behind a backslash.
    fn continued(&mut self, start: &[u8]) -> Result<(), MeshError> {
        let mut joined = start.to_vec();
        let mut more = 0;
        loop {
            let rest = self.bytes.get(self.at..).unwrap_or_default();
            let length = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
            let next = rest[..length].trim_ascii();
            let ends = self.at + length >= self.bytes.len();
            self.at += length + 1;
            more += 1;
            joined.push(b' ');
            joined.extend_from_slice(next.strip_suffix(b"\\").unwrap_or(next));
            if ends || !next.ends_with(b"\\") {
                break;
            }
        }
        let result = self.line(&joined);
        self.line += more;
        result
    }

    fn line(&mut self, line: &[u8]) -> Result<(), MeshError> {
        let split = line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len());
        let (keyword, rest) = line.split_at(split);
        match keyword {
            b"v" => self.numbers(line, keyword, rest, 3, 0),
            b"vt" => self.numbers(line, keyword, rest, 1, 1),
            b"vn" => self.numbers(line, keyword, rest, 3, 2),
            b"f" => self.face(rest),
            _ => Ok(()),
        }
    }

    /// Passes a line of at least `least` finite numbers on; weights and colours behind them are left out, as in Mitsuba.
    fn numbers(
        &mut self,
        line: &[u8],
        keyword: &[u8],
        rest: &[u8],
        least: usize,
        what: usize,
    ) -> Result<(), MeshError> {
        let wanted = if what == 1 { 2 } else { 3 };
        self.piece.extend_from_slice(keyword);
        let mut count = 0;
        for word in words(rest).take(wanted) {
            let number = std::str::from_utf8(word).ok().and_then(|w| w.parse::<f32>().ok());
            match number {
                Some(x) if x.is_finite() => {}
                Some(_) => return Err(self.fail(MeshErrorKind::NotFinite, line, "finite numbers")),
                None => return Err(self.fail(MeshErrorKind::Malformed, line, format!("{least} numbers"))),
            }
            self.piece.push(b' ');
            self.piece.extend_from_slice(word);
            count += 1;
        }
        if count < least {
            return Err(self.fail(MeshErrorKind::Malformed, line, format!("{least} numbers")));
        }
        if count < wanted {
            self.piece.extend_from_slice(b" 0");
        }
        self.piece.push(b'\n');
        self.counts[what] += 1;
        if self.counts[what] >= i64::from(u32::MAX) - 1 {
            return Err(self.fail(MeshErrorKind::TooLarge, line, "fewer than 2³² vertices"));
        }
        Ok(())
    }

    /// Passes a face on with absolute indices.
    fn face(&mut self, rest: &[u8]) -> Result<(), MeshError> {
        let start = self.piece.len();
        self.piece.push(b'f');
        let mut corners = 0;
        for word in words(rest) {
            let [v, vt, vn] = self.corner(word)?;
            self.any_uv |= vt > 0;
            self.any_normal |= vn > 0;
            push_number(&mut self.piece, b' ', v);
            // Index 0 becomes 1, the zeros before the file; before the first vt (vn) line tobj falls back on them itself.
            self.piece.push(b'/');
            if self.counts[1] > 0 {
                push_digits(&mut self.piece, vt + 1);
            }
            if self.counts[2] > 0 {
                push_number(&mut self.piece, b'/', vn + 1);
            }
            corners += 1;
        }
        if corners < 3 {
            self.piece.truncate(start);
            self.skipped_faces += 1;
            return Ok(());
        }
        self.piece.push(b'\n');
        Ok(())
    }

    /// `v`, `v/vt`, `v//vn` or `v/vt/vn` as indices from 1, 0 where there is none.
    fn corner(&self, word: &[u8]) -> Result<[u64; 3], MeshError> {
        let mut indices = [0; 3];
        let names = ["vertex", "texture coordinate", "normal"];
        for (i, part) in word.split(|&b| b == b'/').enumerate() {
            if part.is_empty() && (i > 0) {
                continue;
            }
            let index = std::str::from_utf8(part).ok().and_then(|w| w.parse::<i64>().ok());
            let (Some(index), Some(&count)) = (index, self.counts.get(i)) else {
                return Err(self.fail(MeshErrorKind::Malformed, word, "a corner v, v/vt, v//vn or v/vt/vn"));
            };
            let absolute = if index < 0 { count.checked_add(index).map_or(-1, |a| a + 1) } else { index };
            let least = if index == 0 && i > 0 { 0 } else { 1 };
            if absolute < least || absolute > count {
                let expected = format!("the index of one of the {count} {} lines before it", names[i]);
                return Err(self.fail(MeshErrorKind::OutOfRange, word, expected));
            }
            indices[i] = absolute as u64;
        }
        Ok(indices)
    }
}

fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty())
}

fn push_number(out: &mut Vec<u8>, separator: u8, number: u64) {
    out.push(separator);
    push_digits(out, number);
}

fn push_digits(out: &mut Vec<u8>, mut number: u64) {
    let mut digits = [0; 20];
    let mut first = digits.len();
    loop {
        first -= 1;
        digits[first] = b'0' + (number % 10) as u8;
        number /= 10;
        if number == 0 {
            break;
        }
    }
    out.extend_from_slice(&digits[first..]);
}

impl Read for Feed<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let n = self.fill_buf()?.read(out)?;
        self.consume(n);
        Ok(n)
    }
}

impl BufRead for Feed<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.taken == self.piece.len()
            && let Err(error) = self.refill()
        {
            self.error = Some(error);
            return Err(io::Error::from(io::ErrorKind::InvalidData));
        }
        Ok(&self.piece[self.taken..])
    }

    fn consume(&mut self, n: usize) {
        self.taken += n;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<MeshData, MeshError> {
        parse_obj(text.as_bytes(), Path::new("test.obj"), false)
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
        let text = format!(
            "mtllib no.mtl\no one\n{SQUARE}g a\nusemtl m\ns 1\nf 1 2 3\no two\nusemtl n\nf 1 3 4\nl 1 2 3\np 1\n"
        );
        assert_eq!(corners(&parse(&text).unwrap()), [[P[0], P[1], P[2]], [P[0], P[2], P[3]]]);
    }

    #[test]
    fn polygons_become_fans() {
        let text = format!("{SQUARE}v 0 0.5 0\nf 1 2 3 4 5\n");
        let q = Vec3::new(0.0, 0.5, 0.0);
        assert_eq!(corners(&parse(&text).unwrap()), [[P[0], P[1], P[2]], [P[0], P[2], P[3]], [P[0], P[3], q]]);
    }

    #[test]
    fn negative_indices_count_back() {
        let text = format!("{SQUARE}f -4 -3 -2\nv 0 0 1\nf -1 1 2\n");
        assert_eq!(corners(&parse(&text).unwrap()), [[P[0], P[1], P[2]], [Vec3::Z, P[0], P[1]]]);
    }

    #[test]
    fn faces_with_few_corners_are_skipped_and_counted() {
        let data = parse(&format!("{SQUARE}f 1 2\nf\nf 1 2 3\n")).unwrap();
        assert_eq!((data.indices.len(), data.skipped_faces), (1, 2));
    }

    #[test]
    fn continued_lines_crlf_weights_and_odd_bytes() {
        let text = b"# caf\xe9\r\nv 0 0 0 2\r\nv 1 0 0 0.1 0.2 0.3\r\nv 1 1 0\r\nf 1 \\\r\n 2 3\r\n";
        let data = parse_obj(text, Path::new("test.obj"), false).unwrap();
        assert_eq!(corners(&data), [[P[0], P[1], P[2]]]);
    }

    #[test]
    fn texture_coordinates_split_vertices_but_not_points() {
        let text = format!("{SQUARE}vt 0 0\nvt 1 0.25\nvt 0.5\nf 1/1 2/2 3/3\nf 1/2 3/3 4/1\n");
        let data = parse(&text).unwrap();
        let uvs = data.uvs.as_ref().unwrap();
        let per_corner: Vec<Vec2> = data.indices.iter().flatten().map(|&i| uvs[i as usize]).collect();
        let [a, b, c] = [Vec2::ZERO, Vec2::new(1.0, 0.25), Vec2::new(0.5, 0.0)];
        assert_eq!(per_corner, [a, b, c, b, c, a]);
        assert_eq!(corners(&data), [[P[0], P[1], P[2]], [P[0], P[2], P[3]]]);
        // Five vertices: only the first corner was split, and both halves stand on the same point.
        let points = data.points.unwrap();
        assert_eq!(points.len(), 5);
        assert_eq!(points[data.indices[0][0] as usize], points[data.indices[1][0] as usize]);
        let flipped = parse_obj(text.as_bytes(), Path::new("test.obj"), true).unwrap();
        assert_eq!(flipped.uvs.unwrap()[data.indices[0][1] as usize], Vec2::new(1.0, 0.75));
    }

    #[test]
    fn corners_without_texture_or_normal_get_zeros() {
        // tobj alone would put the texture coordinates out of step here.
        let text = format!("{SQUARE}f 1 2 3\nvt 0.5 0.5\nvn 0 0 1\nf 1/1/1 3 4//1\n");
        let data = parse(&text).unwrap();
        let (uvs, normals) = (data.uvs.as_ref().unwrap(), data.normals.as_ref().unwrap());
        let of = |face: usize, corner: usize| data.indices[face][corner] as usize;
        assert_eq!((uvs[of(0, 0)], normals[of(0, 0)]), (Vec2::ZERO, Vec3::ZERO));
        assert_eq!((uvs[of(1, 0)], normals[of(1, 0)]), (Vec2::splat(0.5), Vec3::Z));
        assert_eq!((uvs[of(1, 1)], normals[of(1, 1)]), (Vec2::ZERO, Vec3::ZERO));
        assert_eq!((uvs[of(1, 2)], normals[of(1, 2)]), (Vec2::ZERO, Vec3::Z));
    }

    #[test]
    fn unused_texture_coordinates_and_normals_are_left_out() {
        let data = parse(&format!("{SQUARE}vt 0 0\nvn 0 0 1\nf 1 2 3\n")).unwrap();
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
            ("f 1 2 -9223372036854775808", OutOfRange),
            ("f 1 2 99999999999999999999", Malformed),
        ] {
            let error = parse(&format!("{SQUARE}\n{line}\nf 1 2 3\n")).unwrap_err();
            assert_eq!((error.kind(), error.place()), (kind, Place::Line(6)), "{line}: {error}");
        }
    }

    #[test]
    fn nothing_gives_nothing() {
        for text in ["", "\n", "# only a comment", "v 0 0 0"] {
            assert!(parse(text).unwrap().indices.is_empty());
        }
    }
}
