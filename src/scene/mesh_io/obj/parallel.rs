use std::borrow::Cow;
use std::path::Path;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::super::{MeshData, MeshError, MeshErrorKind, Place};
use super::join::{Corners, join};
use super::text::{Fault, Keyword, Lines, NONE, corner, keyword, numbers, words};

/// Parses pieces of about `piece` bytes at the same time.
pub(super) fn parse(bytes: &[u8], path: &Path, flip_v: bool, piece: usize) -> Result<MeshData, MeshError> {
    // Count what each piece defines, so that every piece knows how many lines and vertices come before it.
    let pieces = cut(bytes, piece);
    let counts: Vec<Counts> = pieces.par_iter().map(|p| count(p)).collect();
    let mut total = Counts::default();
    let before: Vec<Counts> = counts
        .iter()
        .map(|c| {
            let before = total;
            total = total.plus(c);
            before
        })
        .collect();
    let Some(defined) = total.fit() else {
        let found = format!("{:?} positions, texture coordinates and normals", total.defined);
        let (expected, fix) = ("fewer than 2³² of each", "split the mesh into several files");
        return Err(MeshError::new(path, Place::Whole, MeshErrorKind::TooLarge, found, expected, fix));
    };

    // Parse numbers straight to their places, and faces into one list per piece.
    let [v, vt, vn] = defined.map(|n| n as usize);
    let mut all = Corners {
        positions: vec![Vec3::ZERO; v],
        uvs: vec![Vec2::ZERO; vt],
        normals: vec![Vec3::ZERO; vn],
        ..Corners::default()
    };
    let positions = split(&mut all.positions, &counts, 0);
    let uvs = split(&mut all.uvs, &counts, 1);
    let normals = split(&mut all.normals, &counts, 2);
    let parsed: Vec<Result<Faces, MeshError>> = (pieces, before, positions, uvs, normals)
        .into_par_iter()
        .map(|(text, before, positions, uvs, normals)| {
            let counts = before.fit().expect("a part of a total that fits");
            let mut piece = Piece { counts, positions, uvs, normals, flip_v, faces: Faces::default() };
            let mut lines = Lines::new(text, before.lines);
            lines.try_for_each(|(number, line)| piece.line(&line).map_err(|fault| fault.at(path, number)))?;
            Ok(piece.faces)
        })
        .collect();

    // Join the lists in the order of the file; the first error in that order counts.
    let faces = parsed.into_iter().collect::<Result<Vec<Faces>, MeshError>>()?;
    all.position_of = faces.iter().flat_map(|f| &f.positions).copied().collect();
    if faces.iter().any(|f| f.any_uv) {
        all.uv_of = faces.iter().flat_map(|f| &f.uvs).copied().collect();
    }
    if faces.iter().any(|f| f.any_normal) {
        all.normal_of = faces.iter().flat_map(|f| &f.normals).copied().collect();
    }
    let skipped_faces = faces.iter().map(|f| f.skipped).sum();
    drop(faces);
    let mut data = MeshData { path: path.to_path_buf(), skipped_faces, ..MeshData::default() };
    join(all, &mut data);
    Ok(data)
}

/// How many positions, texture coordinates and normals a text defines, and how many triangles.
pub(super) fn tally(bytes: &[u8], piece: usize) -> ([u64; 3], u64) {
    let triangles = |text: &&[u8]| -> u64 {
        let corners = |(_, line): (u64, Cow<[u8]>)| match keyword(&line) {
            (Keyword::Face, rest) => words(rest).count() as u64,
            _ => 0,
        };
        Lines::new(text, 0).map(corners).map(|n| n.saturating_sub(2)).sum()
    };
    let pieces = cut(bytes, piece);
    let counts: Vec<Counts> = pieces.par_iter().map(|p| count(p)).collect();
    let total = counts.iter().fold(Counts::default(), |sum, c| sum.plus(c));
    (total.defined, pieces.par_iter().map(triangles).sum())
}

/// Cuts text at line ends into pieces of about `size` bytes, but not between lines that a backslash joins.
fn cut(text: &[u8], size: usize) -> Vec<&[u8]> {
    let mut pieces = Vec::new();
    let mut rest = text;
    while !rest.is_empty() {
        let mut end = size.min(rest.len());
        while end < rest.len() {
            end += rest[end..].iter().position(|&b| b == b'\n').map_or(rest.len() - end, |n| n + 1);
            if !rest[..end].trim_ascii_end().ends_with(b"\\") {
                break;
            }
        }
        let (piece, tail) = rest.split_at(end);
        pieces.push(piece);
        rest = tail;
    }
    pieces
}

/// What a piece of text defines.
#[derive(Clone, Copy, Default)]
struct Counts {
    lines: u64,
    /// Positions, texture coordinates and normals.
    defined: [u64; 3],
}

impl Counts {
    fn plus(&self, other: &Self) -> Self {
        let sum = |i: usize| self.defined[i] + other.defined[i];
        Self { lines: self.lines + other.lines, defined: [sum(0), sum(1), sum(2)] }
    }

    /// The numbers as 32-bit ones, of which the largest means "none".
    fn fit(&self) -> Option<[u32; 3]> {
        let [v, vt, vn] = self.defined.map(|n| u32::try_from(n).ok().filter(|&n| n < NONE));
        Some([v?, vt?, vn?])
    }
}

fn count(text: &[u8]) -> Counts {
    let mut counts = Counts::default();
    let mut lines = Lines::new(text, 0);
    for (_, line) in &mut lines {
        match keyword(&line).0 {
            Keyword::Position => counts.defined[0] += 1,
            Keyword::Uv => counts.defined[1] += 1,
            Keyword::Normal => counts.defined[2] += 1,
            Keyword::Face | Keyword::Other => {}
        }
    }
    counts.lines = lines.seen;
    counts
}

/// The part of a buffer that each piece fills.
fn split<'a, T>(mut all: &'a mut [T], counts: &[Counts], what: usize) -> Vec<&'a mut [T]> {
    let mut parts = Vec::with_capacity(counts.len());
    for c in counts {
        let (part, rest) = all.split_at_mut(c.defined[what] as usize);
        parts.push(part);
        all = rest;
    }
    parts
}

/// The triangles of one piece.
#[derive(Default)]
struct Faces {
    positions: Vec<[u32; 3]>,
    uvs: Vec<[u32; 3]>,
    normals: Vec<[u32; 3]>,
    any_uv: bool,
    any_normal: bool,
    skipped: u64,
}

struct Piece<'a> {
    /// Positions, texture coordinates and normals so far.
    counts: [u32; 3],
    /// Where the next ones of this piece go.
    positions: &'a mut [Vec3],
    uvs: &'a mut [Vec2],
    normals: &'a mut [Vec3],
    flip_v: bool,
    faces: Faces,
}

impl Piece<'_> {
    fn line(&mut self, line: &[u8]) -> Result<(), Fault> {
        let (keyword, rest) = keyword(line);
        match keyword {
            Keyword::Position => put(&mut self.positions, &mut self.counts[0], Vec3::from(numbers(rest, 3)?)),
            Keyword::Uv => {
                let [u, v] = numbers(rest, 1)?;
                let v = if self.flip_v { 1.0 - v } else { v };
                put(&mut self.uvs, &mut self.counts[1], Vec2::new(u, v));
            }
            Keyword::Normal => put(&mut self.normals, &mut self.counts[2], Vec3::from(numbers(rest, 3)?)),
            Keyword::Face => self.face(rest)?,
            Keyword::Other => {}
        }
        Ok(())
    }

    /// Cuts a face into a fan of triangles around its first corner.
    fn face(&mut self, rest: &[u8]) -> Result<(), Fault> {
        let faces = &mut self.faces;
        let (mut corners, mut first, mut last) = (0, [NONE; 3], [NONE; 3]);
        for word in words(rest) {
            let next = corner(word, &self.counts)?;
            if corners >= 2 {
                let of = |i: usize| [first[i], last[i], next[i]];
                faces.positions.push(of(0));
                faces.uvs.push(of(1));
                faces.normals.push(of(2));
            }
            faces.any_uv |= next[1] != NONE;
            faces.any_normal |= next[2] != NONE;
            if corners == 0 {
                first = next;
            }
            last = next;
            corners += 1;
        }
        faces.skipped += u64::from(corners < 3);
        Ok(())
    }
}

/// Puts a value at the front of what is left of a buffer, and counts it.
fn put<T>(left: &mut &mut [T], count: &mut u32, value: T) {
    if let Some((place, rest)) = std::mem::take(left).split_first_mut() {
        *place = value;
        *left = rest;
        *count += 1;
    }
}
