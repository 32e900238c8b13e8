use std::io::{self, BufRead, Read};
use std::path::Path;

use glam::{Vec2, Vec3};

use super::super::{MeshData, MeshError, MeshErrorKind, Place};
use super::join::{Corners, join};
use super::text::{Fault, Keyword, Lines, NONE, corner, keyword, numbers, words};

/// Parses through tobj.
pub(super) fn parse(bytes: &[u8], path: &Path, flip_v: bool) -> Result<MeshData, MeshError> {
    let mut feed = Feed::new(bytes, path, flip_v);
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
        let mesh = model.mesh;
        let triangles = |of: &[u32]| of.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
        let flip = |uv: &[f32]| Vec2::new(uv[0], if flip_v { 1.0 - uv[1] } else { uv[1] });
        let corners = Corners {
            positions: mesh.positions.chunks_exact(3).map(Vec3::from_slice).collect(),
            uvs: mesh.texcoords.chunks_exact(2).map(flip).collect(),
            normals: mesh.normals.chunks_exact(3).map(Vec3::from_slice).collect(),
            position_of: triangles(&mesh.indices),
            uv_of: if feed.any_uv { triangles(&mesh.texcoord_indices) } else { Vec::new() },
            normal_of: if feed.any_normal { triangles(&mesh.normal_indices) } else { Vec::new() },
        };
        join(corners, &mut data);
    }
    Ok(data)
}

/// Lines are passed on in pieces of about this size.
const PIECE: usize = 1 << 16;

/// Passes the lines that describe the surface on to tobj, checked and in a form that it reads safely: tobj 4 does not
/// check that numbers are finite, overflows on wild indices, leaves texture coordinates and vertices out of step when only
/// some corners have them, takes lines for faces, and says of an error neither line nor text.
///
/// Texture coordinate 1 and normal 1 of what tobj sees are put before the file, for corners that have none; they come out
/// as zeros.
struct Feed<'a> {
    path: &'a Path,
    lines: Lines<'a>,
    /// Checked text, and how much of it tobj has taken.
    piece: Vec<u8>,
    taken: usize,
    /// Positions, texture coordinates and normals so far.
    counts: [u32; 3],
    any_uv: bool,
    any_normal: bool,
    skipped_faces: u64,
    error: Option<MeshError>,
}

impl<'a> Feed<'a> {
    fn new(bytes: &'a [u8], path: &'a Path, flip_v: bool) -> Self {
        Self {
            path,
            lines: Lines::new(bytes, 0),
            piece: if flip_v { b"vt 0 1\nvn 0 0 0\n".to_vec() } else { b"vt 0 0\nvn 0 0 0\n".to_vec() },
            taken: 0,
            counts: [0; 3],
            any_uv: false,
            any_normal: false,
            skipped_faces: 0,
            error: None,
        }
    }

    /// Checks lines until there is a piece of text to pass on or the file ends.
    fn refill(&mut self) -> Result<(), MeshError> {
        self.piece.clear();
        self.taken = 0;
        while self.piece.len() < PIECE
            && let Some((number, line)) = self.lines.next()
        {
            self.line(&line).map_err(|fault| fault.at(self.path, number))?;
        }
        Ok(())
    }

    fn line(&mut self, line: &[u8]) -> Result<(), Fault> {
        let (keyword, rest) = keyword(line);
        match keyword {
            Keyword::Position => {
                numbers::<3>(rest, 3)?;
                self.pass_on(b"v", rest, 3, 0);
            }
            Keyword::Uv => {
                numbers::<2>(rest, 1)?;
                self.pass_on(b"vt", rest, 2, 1);
            }
            Keyword::Normal => {
                numbers::<3>(rest, 3)?;
                self.pass_on(b"vn", rest, 3, 2);
            }
            Keyword::Face => self.face(rest)?,
            Keyword::Other => {}
        }
        Ok(())
    }

    /// Passes exactly `wanted` numbers on, zeros for missing ones.
    fn pass_on(&mut self, keyword: &[u8], rest: &[u8], wanted: usize, what: usize) {
        self.piece.extend_from_slice(keyword);
        for word in words(rest).chain(std::iter::repeat(&b"0"[..])).take(wanted) {
            self.piece.push(b' ');
            self.piece.extend_from_slice(word);
        }
        self.piece.push(b'\n');
        self.counts[what] += 1;
    }

    /// Passes a face on with absolute indices.
    fn face(&mut self, rest: &[u8]) -> Result<(), Fault> {
        let start = self.piece.len();
        self.piece.push(b'f');
        let mut corners = 0;
        for word in words(rest) {
            let [v, vt, vn] = corner(word, &self.counts)?;
            self.any_uv |= vt != NONE;
            self.any_normal |= vn != NONE;
            // None becomes 1, which stands before the file; before the first vt (vn) line tobj falls back on it itself.
            let from_one = |index: u32| if index == NONE { 1 } else { index + 2 };
            self.number(b' ', v + 1);
            self.piece.push(b'/');
            if self.counts[1] > 0 {
                self.piece.pop();
                self.number(b'/', from_one(vt));
            }
            if self.counts[2] > 0 {
                self.number(b'/', from_one(vn));
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

    fn number(&mut self, separator: u8, mut number: u32) {
        let mut digits = [0; 10];
        let mut first = digits.len();
        loop {
            first -= 1;
            digits[first] = b'0' + (number % 10) as u8;
            number /= 10;
            if number == 0 {
                break;
            }
        }
        self.piece.push(separator);
        self.piece.extend_from_slice(&digits[first..]);
    }
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
