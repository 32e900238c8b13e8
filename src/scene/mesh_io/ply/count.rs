use std::path::Path;

use super::super::MeshError;
use super::super::counts::MeshCounts;
use super::super::mapped::FileBytes;
use super::attributes;
use super::faces::Corners;
use super::header::{self, Element, Format, Header, Kind};
use super::vertices::Columns;
use super::{Body, the_one};

/// Tells from the header and the length of a PLY file what it holds.
pub fn count_ply(path: &Path) -> Result<MeshCounts, MeshError> {
    let bytes = FileBytes::open(path)?;
    let header = header::parse_text(&bytes, path)?;
    header::check_sizes(&header, None, path)?;
    let body = Body { path, bytes: &bytes[header.data..], offset: header.data, big: header.format == Format::Big };
    let (vertex, face) = (the_one(&body, &header, "vertex")?, the_one(&body, &header, "face")?);
    let (columns, corners) = (Columns::of(&body, vertex)?, Corners::of(&body, face)?);
    let length = lengths(&header, face, corners, body.bytes.len());
    let least = header::check_sizes(&header, Some(body.bytes.len()), path);
    let values = |element| attributes::plan(element).iter().map(|plan| plan.fields.len() as u64).sum();
    let (triangles, exact, how) = match length {
        Length::Whole(triangles) => (triangles, true, "header and length of the file"),
        _ => (face.count, false, "header; every face taken for a triangle"),
    };
    Ok(MeshCounts {
        path: path.to_path_buf(),
        vertices: vertex.count,
        triangles,
        normals: columns.normal.is_some(),
        uvs: columns.uv.is_some(),
        vertex_values: values(vertex),
        face_values: values(face),
        face_normals: false,
        exact,
        how,
        cut_short: least.is_err() || length == Length::TooShort,
    })
}

#[derive(Clone, Copy, PartialEq)]
enum Length {
    /// As long as faces make it that are this many triangles.
    Whole(u64),
    /// Shorter than faces of three corners make it.
    TooShort,
    /// It says nothing.
    Unknown,
}

/// What the length of the body says: the items of the lists are all that a binary header leaves open.
fn lengths(header: &Header, face: &Element, corners: Corners, length: usize) -> Length {
    let lists = |e: &Element| e.properties.iter().filter(|p| matches!(p.kind, Kind::List { .. })).count();
    if header.format == Format::Ascii || header.elements.iter().map(lists).sum::<usize>() != 1 {
        return Length::Unknown;
    }
    let fixed: u128 = header.elements.iter().map(|e| e.least_size() as u128 * u128::from(e.count)).sum();
    let (faces, item) = (u128::from(face.count), corners.item.size() as u128);
    let Some(items) = (length as u128).checked_sub(fixed).filter(|&rest| rest >= 3 * faces * item) else {
        return Length::TooShort;
    };
    match u64::try_from(items / item - 2 * faces) {
        Ok(triangles) if items % item == 0 => Length::Whole(triangles),
        _ => Length::Unknown,
    }
}
