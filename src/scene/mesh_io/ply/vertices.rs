use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

use super::super::{MeshData, MeshError, MeshErrorKind, Positions};
use super::attributes::{self, scalar};
use super::header::{Element, Kind, Scalar};
use super::{Body, header_error};
use crate::geometry::VertexAttribute;

/// Vertices that one task decodes.
const CHUNK: usize = 1 << 14;

/// One number of each record.
#[derive(Clone, Copy)]
pub(super) struct Column {
    offset: usize,
    scalar: Scalar,
}

/// Where a vertex record has what a mesh is made of.
pub(super) struct Columns {
    xyz: [Column; 3],
    pub normal: Option<[Column; 3]>,
    pub uv: Option<[Column; 2]>,
    /// Bytes of a record.
    stride: usize,
}

impl Columns {
    pub(super) fn of(body: &Body, element: &Element) -> Result<Self, MeshError> {
        let Some(stride) = element.stride() else {
            return Err(header_error(body, element.line, "a list among the properties of the vertices".into()));
        };
        let Some(xyz) = columns(element, ["x", "y", "z"]) else {
            return Err(header_error(body, element.line, "vertices without x, y and z".into()));
        };
        let uvs = [["u", "v"], ["s", "t"], ["texture_u", "texture_v"]];
        Ok(Self {
            xyz,
            normal: columns(element, ["nx", "ny", "nz"]),
            uv: uvs.into_iter().find_map(|names| columns(element, names)),
            stride,
        })
    }
}

/// Decodes the vertex records at `at` into `data`; gives the offset behind them.
pub(super) fn decode(
    body: &Body,
    element: &Element,
    at: usize,
    flip_v: bool,
    data: &mut MeshData,
) -> Result<usize, MeshError> {
    let Columns { xyz, normal, uv, stride } = Columns::of(body, element)?;
    let end = body.skip_all(element, at)?;
    let records = Records { bytes: &body.bytes[at..end], stride, big: body.big };

    data.positions = records.positions(xyz);
    let bad = match &data.positions {
        Positions::F32(p) => p.par_iter().with_min_len(CHUNK).position_first(|p| !p.is_finite()),
        Positions::F64(p) => p.par_iter().with_min_len(CHUNK).position_first(|p| !p.is_finite()),
    };
    if let Some(i) = bad {
        let found = format!("vertex {i} at {}", data.positions.get(i));
        return Err(body.error(at + i * stride, MeshErrorKind::NotFinite, found, "finite coordinates"));
    }

    if let Some(n) = normal {
        data.normals = Some(records.vectors(n));
    }
    if let Some([u, v]) = uv {
        data.uvs = Some(records.map(|r| {
            let (u, v) = (r.number(u) as f32, r.number(v) as f32);
            Vec2::new(u, if flip_v { 1.0 - v } else { v })
        }));
    }
    for plan in attributes::plan(element) {
        let fields: Vec<Column> = plan.fields.iter().map(|&i| column(element, i)).collect();
        let mut values = vec![0.0; records.len() * fields.len()];
        values.par_chunks_mut(fields.len() * CHUNK).enumerate().for_each(|(chunk, out)| {
            for (i, out) in out.chunks_mut(fields.len()).enumerate() {
                let record = records.get(chunk * CHUNK + i);
                for (out, &c) in out.iter_mut().zip(&fields) {
                    *out = attributes::value(c.scalar, record.number(c));
                }
            }
        });
        let channels = fields.len();
        data.attributes.push(VertexAttribute { name: plan.name, channels, per_vertex: true, data: values });
    }
    Ok(end)
}

fn columns<const N: usize>(element: &Element, names: [&str; N]) -> Option<[Column; N]> {
    let mut found = [Column { offset: 0, scalar: Scalar::F32 }; N];
    for (out, name) in found.iter_mut().zip(names) {
        *out = column(element, scalar(element, name)?);
    }
    Some(found)
}

fn column(element: &Element, property: usize) -> Column {
    let offset = element.properties[..property].iter().map(|p| p.least_size()).sum();
    match element.properties[property].kind {
        Kind::Scalar(scalar) => Column { offset, scalar },
        Kind::List { .. } => unreachable!("columns are made of scalar properties only"),
    }
}

/// Records of one size, side by side.
struct Records<'a> {
    bytes: &'a [u8],
    stride: usize,
    big: bool,
}

struct Record<'a> {
    bytes: &'a [u8],
    big: bool,
}

impl Record<'_> {
    #[inline]
    fn number(&self, c: Column) -> f64 {
        c.scalar.read(self.big, &self.bytes[c.offset..])
    }
}

impl Records<'_> {
    fn len(&self) -> usize {
        self.bytes.len() / self.stride
    }

    #[inline]
    fn get(&self, i: usize) -> Record<'_> {
        Record { bytes: &self.bytes[i * self.stride..(i + 1) * self.stride], big: self.big }
    }

    fn map<T: Send>(&self, f: impl Fn(Record) -> T + Sync) -> Vec<T> {
        (0..self.len()).into_par_iter().with_min_len(CHUNK).map(|i| f(self.get(i))).collect()
    }

    /// Positions in f32 when that loses nothing.
    fn positions(&self, xyz: [Column; 3]) -> Positions {
        let exact = |s| matches!(s, Scalar::F32 | Scalar::I8 | Scalar::U8 | Scalar::I16 | Scalar::U16);
        if xyz.iter().all(|c| exact(c.scalar)) {
            Positions::F32(self.vectors(xyz))
        } else {
            Positions::F64(self.map(|r| DVec3::from_array(xyz.map(|c| r.number(c)))))
        }
    }

    fn vectors(&self, xyz: [Column; 3]) -> Vec<Vec3> {
        let [x, y, z] = xyz;
        let packed = y.offset == x.offset + 4 && z.offset == x.offset + 8;
        if !(packed && xyz.iter().all(|c| c.scalar == Scalar::F32) && !self.big && cfg!(target_endian = "little")) {
            return self.map(|r| Vec3::from_array(xyz.map(|c| r.number(c) as f32)));
        }
        // The common case: three little-endian floats in a row are a Vec3 as they stand.
        let mut out = vec![Vec3::ZERO; self.len()];
        out.par_chunks_mut(CHUNK).zip(self.bytes.par_chunks(CHUNK * self.stride)).for_each(|(out, bytes)| {
            if self.stride == size_of::<Vec3>() {
                bytemuck::cast_slice_mut(out).copy_from_slice(bytes);
            } else {
                for (out, record) in out.iter_mut().zip(bytes.chunks_exact(self.stride)) {
                    *out = bytemuck::pod_read_unaligned(&record[x.offset..x.offset + 12]);
                }
            }
        });
        out
    }
}
