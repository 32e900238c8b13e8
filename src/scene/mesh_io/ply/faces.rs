use rayon::prelude::*;

use super::super::{MeshData, MeshError, MeshErrorKind};
use super::attributes::{self, AttributePlan};
use super::header::{Element, Kind, Scalar};
use super::{Body, header_error};
use crate::geometry::VertexAttribute;

/// Faces that one task decodes.
const CHUNK: usize = 1 << 14;

/// The list of corners among the properties of a face.
#[derive(Clone, Copy)]
pub(super) struct Corners {
    property: usize,
    count: Scalar,
    pub item: Scalar,
}

impl Corners {
    pub(super) fn of(body: &Body, element: &Element) -> Result<Self, MeshError> {
        let list = ["vertex_indices", "vertex_index"].into_iter().find_map(|name| element.find(name));
        let corners = list.and_then(|property| match element.properties[property].kind {
            Kind::List { count, item } if item.is_integer() => Some(Self { property, count, item }),
            _ => None,
        });
        corners.ok_or_else(|| header_error(body, element.line, "faces without an integer list vertex_indices".into()))
    }
}

/// Decodes the face records at `at` into `data`, cut into triangles; gives the offset behind them.
pub(super) fn decode(
    body: &Body,
    element: &Element,
    at: usize,
    vertices: u64,
    data: &mut MeshData,
) -> Result<usize, MeshError> {
    let corners = Corners::of(body, element)?;
    if element.count == 0 {
        return Ok(at);
    }
    match uniform(body, element, corners, at, vertices, data)? {
        Some(end) => Ok(end),
        None => walk(body, element, corners, at, vertices, data),
    }
}

/// The fast path for records of one size: the corner list is the only list, and all of them are as long as the first.
/// `None` when the file is not like that.
fn uniform(
    body: &Body,
    element: &Element,
    corners: Corners,
    at: usize,
    vertices: u64,
    data: &mut MeshData,
) -> Result<Option<usize>, MeshError> {
    let lists = element.properties.iter().filter(|p| matches!(p.kind, Kind::List { .. })).count();
    if lists != 1 {
        return Ok(None);
    }
    let before: usize = element.properties[..corners.property].iter().map(|p| p.least_size()).sum();
    let (n, _) = body.list(at + before, corners.count, corners.item)?;
    let stride = element.least_size() + n * corners.item.size();
    let faces = element.count as usize;
    let Some(bytes) = stride.checked_mul(faces).and_then(|length| body.bytes.get(at..at.checked_add(length)?)) else {
        return Ok(None);
    };
    if n < 3 {
        return Ok(None);
    }
    let per_face = n - 2;
    if faces.saturating_mul(per_face) > u32::MAX as usize {
        return Err(too_many(body, at));
    }
    let first = before + corners.count.size();

    // Decode and check a chunk while it is in the cache.
    let plain_triangles = n == 3
        && corners.count.size() == 1
        && matches!(corners.item, Scalar::I32 | Scalar::U32)
        && !body.big
        && cfg!(target_endian = "little");
    let mut triangles = vec![[0_u32; 3]; faces * per_face];
    let verdict = triangles
        .par_chunks_mut(CHUNK * per_face)
        .zip(bytes.par_chunks(CHUNK * stride))
        .map(|(out, bytes)| {
            if plain_triangles {
                decode_plain(out, bytes, stride, first, vertices)
            } else {
                decode_polygons(out, bytes, stride, before, n, corners, body.big, vertices)
            }
        })
        .reduce(|| Verdict::Good, Verdict::worse);
    match verdict {
        Verdict::Good => {}
        // The walk finds the place and says what is wrong there.
        Verdict::OtherLength | Verdict::OutOfRange => return Ok(None),
    }

    for plan in attributes::plan(element) {
        let fields: Vec<(usize, Scalar)> = plan
            .fields
            .iter()
            .map(|&i| {
                let offset: usize = element.properties[..i].iter().map(|p| p.least_size()).sum();
                let behind_list = if i > corners.property { n * corners.item.size() } else { 0 };
                (offset + behind_list, scalar_of(element, i))
            })
            .collect();
        let values = bytes.chunks_exact(stride).flat_map(|record| {
            let value = |&(offset, scalar): &(usize, Scalar)| {
                attributes::value(scalar, scalar.read(body.big, &record[offset..]))
            };
            std::iter::repeat_n(fields.iter().map(value), per_face).flatten()
        });
        let data_values = values.collect();
        data.attributes.push(face_attribute(plan, data_values));
    }
    data.indices = triangles;
    Ok(Some(at + bytes.len()))
}

#[derive(Clone, Copy, PartialEq)]
enum Verdict {
    Good,
    OtherLength,
    OutOfRange,
}

impl Verdict {
    fn worse(self, other: Self) -> Self {
        if self == Self::Good { other } else { self }
    }
}

/// One-byte length, three little-endian 32-bit indices: nearly every large file.
fn decode_plain(out: &mut [[u32; 3]], bytes: &[u8], stride: usize, first: usize, vertices: u64) -> Verdict {
    let (mut largest, mut other_length) = (0_u32, 0_u8);
    for (out, record) in out.iter_mut().zip(bytes.chunks_exact(stride)) {
        let body = &record[first - 1..first + 12];
        other_length |= body[0] ^ 3;
        *out = bytemuck::pod_read_unaligned(&body[1..13]);
        largest = largest.max(out[0]).max(out[1]).max(out[2]);
    }
    match (other_length, u64::from(largest) < vertices) {
        (0, true) => Verdict::Good,
        (0, false) => Verdict::OutOfRange,
        _ => Verdict::OtherLength,
    }
}

/// Any integer types, any common number of corners.
#[expect(clippy::too_many_arguments, reason = "one call site, and all of them vary between files")]
fn decode_polygons(
    out: &mut [[u32; 3]],
    bytes: &[u8],
    stride: usize,
    before: usize,
    n: usize,
    corners: Corners,
    big: bool,
    vertices: u64,
) -> Verdict {
    let size = corners.item.size();
    for (out, record) in out.chunks_exact_mut(n - 2).zip(bytes.chunks_exact(stride)) {
        let record = &record[before..];
        if corners.count.read(big, record) != n as f64 {
            return Verdict::OtherLength;
        }
        let items = &record[corners.count.size()..];
        let corner = |i: usize| index(corners.item, big, &items[i * size..], vertices);
        for (i, t) in out.iter_mut().enumerate() {
            match (corner(0), corner(i + 1), corner(i + 2)) {
                (Some(a), Some(b), Some(c)) => *t = [a, b, c],
                _ => return Verdict::OutOfRange,
            }
        }
    }
    Verdict::Good
}

/// An index that refers to a vertex.
#[inline]
fn index(item: Scalar, big: bool, bytes: &[u8], vertices: u64) -> Option<u32> {
    let value = item.read(big, bytes);
    (value >= 0.0 && value < vertices as f64).then_some(value as u32)
}

/// The general path: records of any size, one after the other.
fn walk(
    body: &Body,
    element: &Element,
    corners: Corners,
    mut at: usize,
    vertices: u64,
    data: &mut MeshData,
) -> Result<usize, MeshError> {
    let plans = attributes::plan(element);
    let mut values: Vec<Vec<f32>> = vec![Vec::new(); plans.len()];
    let mut offsets = vec![0; element.properties.len()];
    for _ in 0..element.count {
        // Find where each property of this record stands.
        let mut length = 0;
        let mut first = 0;
        for (i, p) in element.properties.iter().enumerate() {
            offsets[i] = at;
            at = match p.kind {
                Kind::Scalar(s) => {
                    body.get(at, s.size())?;
                    at + s.size()
                }
                Kind::List { count, item } => {
                    let (n, items) = body.list(at, count, item)?;
                    if i == corners.property {
                        (length, first) = (n, items);
                    }
                    items + n * item.size()
                }
            };
        }
        if length < 3 {
            data.skipped_faces += 1;
            continue;
        }

        // Cut the polygon into a fan of triangles around its first corner.
        let size = corners.item.size();
        let corner = |i: usize| {
            let place = first + i * size;
            index(corners.item, body.big, &body.bytes[place..], vertices).ok_or_else(|| {
                let found = format!("vertex index {}", corners.item.read(body.big, &body.bytes[place..]));
                let expected = format!("an index below the vertex count {vertices}");
                body.error(place, MeshErrorKind::OutOfRange, found, expected)
            })
        };
        let start = corner(0)?;
        let mut last = corner(1)?;
        for i in 2..length {
            let next = corner(i)?;
            data.indices.push([start, last, next]);
            last = next;
        }
        if data.indices.len() > u32::MAX as usize {
            return Err(too_many(body, at));
        }
        for (plan, out) in plans.iter().zip(&mut values) {
            for _ in 2..length {
                out.extend(plan.fields.iter().map(|&i| {
                    let scalar = scalar_of(element, i);
                    attributes::value(scalar, scalar.read(body.big, &body.bytes[offsets[i]..]))
                }));
            }
        }
    }
    for (plan, values) in plans.into_iter().zip(values) {
        data.attributes.push(face_attribute(plan, values));
    }
    Ok(at)
}

fn scalar_of(element: &Element, property: usize) -> Scalar {
    match element.properties[property].kind {
        Kind::Scalar(scalar) => scalar,
        Kind::List { .. } => unreachable!("attributes are made of scalar properties only"),
    }
}

fn face_attribute(plan: AttributePlan, data: Vec<f32>) -> VertexAttribute {
    VertexAttribute { channels: plan.fields.len(), name: plan.name, per_vertex: false, data }
}

fn too_many(body: &Body, at: usize) -> MeshError {
    body.error(at, MeshErrorKind::TooLarge, "2³² triangles or more", "fewer than 2³² triangles")
}
