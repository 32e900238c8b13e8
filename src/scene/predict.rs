//! How much memory a scene will take, told from headers before anything of its size exists.

use std::path::{Path, PathBuf};

use glam::{Vec2, Vec3};
use serde::Serialize;

use super::load;
use super::mesh_io::MeshCounts;
use super::xml::{Document, ParseOptions};
use super::{FilmSettings, LoadOptions, SceneError};
use crate::color::Rgb;
use crate::film::Film;
use crate::geometry::{Instance, Shape};
use crate::image::ImageSize;

const MIB: f64 = 1024.0 * 1024.0;

/// Bytes per triangle of the Rust BVH: 534.3 MiB for the 10.008·10⁶ triangles of `scene terrain --triangles 10M`
/// (`info --accel bvh`).
pub const BVH_BYTES_PER_TRIANGLE: f64 = 534.3 * MIB / 10.008e6;

/// Bytes per triangle of Embree 3.13 at MEDIUM quality with the robust flag: 610 MiB for the same mesh
/// (`info --accel embree`).
pub const EMBREE_BYTES_PER_TRIANGLE: f64 = 610.0 * MIB / 10.008e6;

/// Peak memory of the process while the Rust BVH is built, relative to buffers and tree, for a binary PLY of 10⁷ triangles
/// (benches/RESULTS.md, "Small and large scenes").
pub const BVH_PEAK: f64 = 1.48;

/// The same of Embree.
pub const EMBREE_PEAK: f64 = 1.35;

/// A mesh as loading would keep it.
#[derive(Clone, Debug, Serialize)]
pub struct MeshPrediction {
    pub file: PathBuf,
    pub vertices: u64,
    /// Those without area included, which loading drops.
    pub triangles: u64,
    pub vertex_memory: u64,
    pub index_memory: u64,
    /// Normals of the file, or those that loading computes. It drops them from meshes of flat faces.
    pub normal_memory: u64,
    /// Zero where nothing depends on texture coordinates.
    pub uv_memory: u64,
    pub attribute_memory: u64,
    /// The counts are those that loading finds; otherwise they are estimated.
    pub exact: bool,
    /// Where the counts come from.
    pub counted_by: &'static str,
    /// The file is shorter than its header announces for faces of three corners: it is cut off, or has faces of fewer.
    pub cut_short: bool,
}

impl MeshPrediction {
    /// With or without `normals` and `uvs` in memory.
    pub(super) fn new(counts: &MeshCounts, normals: bool, uvs: bool) -> Self {
        let of = |count: u64, bytes: usize| count.saturating_mul(bytes as u64);
        let values = of(counts.vertices, 4).saturating_mul(counts.vertex_values);
        Self {
            file: counts.path.clone(),
            vertices: counts.vertices,
            triangles: counts.triangles,
            // One vertex of padding.
            vertex_memory: of(counts.vertices.saturating_add(1), size_of::<Vec3>()),
            index_memory: of(counts.triangles, size_of::<[u32; 3]>()),
            normal_memory: if normals { of(counts.vertices, size_of::<Vec3>()) } else { 0 },
            uv_memory: if uvs { of(counts.vertices, size_of::<Vec2>()) } else { 0 },
            attribute_memory: values.saturating_add(of(counts.triangles, 4).saturating_mul(counts.face_values)),
            exact: counts.exact,
            counted_by: counts.how,
            cut_short: counts.cut_short,
        }
    }

    /// False for the rectangle and the cube.
    pub fn is_file(&self) -> bool {
        self.counted_by != MeshCounts::BUILT_IN
    }

    /// Bytes of all buffers.
    pub fn memory(&self) -> u64 {
        let parts = [self.index_memory, self.normal_memory, self.uv_memory, self.attribute_memory];
        parts.into_iter().fold(self.vertex_memory, u64::saturating_add)
    }
}

/// A texture or environment map.
#[derive(Clone, Debug, Serialize)]
pub struct PicturePrediction {
    pub file: PathBuf,
    pub width: u32,
    pub height: u32,
    /// At most: colours that turn out to be greys take a third.
    pub memory: u64,
}

impl PicturePrediction {
    pub(super) fn texture(file: PathBuf, size: ImageSize) -> Self {
        Self::new(file, size, if size.grey { size_of::<f32>() } else { size_of::<Rgb>() })
    }

    /// Colours and the distribution that directions are chosen by.
    pub(super) fn envmap(file: PathBuf, size: ImageSize) -> Self {
        Self::new(file, size, size_of::<Rgb>() + size_of::<f32>())
    }

    fn new(file: PathBuf, size: ImageSize, texel: usize) -> Self {
        let ImageSize { width, height, .. } = size;
        Self { file, width, height, memory: u64::from(width) * u64::from(height) * texel as u64 }
    }
}

/// Memory of ray queries by one back end.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct AccelPrediction {
    pub name: &'static str,
    /// Bytes of the structure.
    pub memory: u64,
    /// Bytes of the whole process at the most while it is built, mesh buffers, pictures and film included.
    pub peak: u64,
}

/// What a scene will take, in bytes.
#[derive(Clone, Debug, Serialize)]
pub struct Prediction {
    /// Each mesh once, however often its group is placed.
    pub meshes: Vec<MeshPrediction>,
    pub pictures: Vec<PicturePrediction>,
    pub shapes: u64,
    pub instances: u64,
    pub triangles: u64,
    /// All counts are exact.
    pub exact: bool,
    pub geometry_memory: u64,
    pub picture_memory: u64,
    pub width: u32,
    pub height: u32,
    /// Sums of samples; light tracing adds splats, three quarters of it again.
    pub film_memory: u64,
    /// Embree, then the Rust BVH.
    pub accel: [AccelPrediction; 2],
    pub warnings: Vec<String>,
}

impl Prediction {
    /// Predicts from a scene file and the headers of the files that it names.
    pub fn read(path: &Path, options: &LoadOptions) -> Result<Self, SceneError> {
        let doc = Document::read(path, &ParseOptions { defines: options.defines.clone() })?;
        load::predict(&doc, options)
    }

    /// Predicts from text; other files are looked for beside `path`, which need not exist.
    pub fn from_text(text: &str, path: &Path, options: &LoadOptions) -> Result<Self, SceneError> {
        let doc = Document::parse(text, path, &ParseOptions { defines: options.defines.clone() })?;
        load::predict(&doc, options)
    }

    pub(super) fn new(
        meshes: Vec<MeshPrediction>,
        other_shapes: u64,
        instances: u64,
        pictures: Vec<PicturePrediction>,
        film: &FilmSettings,
        mut warnings: Vec<String>,
    ) -> Self {
        let sum = |numbers: &mut dyn Iterator<Item = u64>| numbers.fold(0, u64::saturating_add);
        let triangles = sum(&mut meshes.iter().map(|m| m.triangles));
        let shapes = meshes.len() as u64 + other_shapes;
        let tables = shapes * size_of::<Shape>() as u64 + instances * size_of::<Instance>() as u64;
        let geometry_memory = sum(&mut meshes.iter().map(MeshPrediction::memory)).saturating_add(tables);
        let picture_memory = sum(&mut pictures.iter().map(|p| p.memory));
        let film_memory = u64::from(film.width) * u64::from(film.height) * Film::BYTES_PER_PIXEL as u64;
        // What is no triangle takes the place of one.
        let primitives = triangles.saturating_add(other_shapes + instances) as f64;
        let accel = |(name, per_triangle, peak): (&'static str, f64, f64)| {
            let memory = (primitives * per_triangle) as u64;
            let building = (peak * (geometry_memory as f64 + memory as f64)) as u64;
            AccelPrediction { name, memory, peak: building.saturating_add(picture_memory + film_memory) }
        };
        let short = meshes.iter().filter(|m| m.cut_short);
        let message = "the file is shorter than its header announces for faces of three corners";
        warnings.extend(short.map(|m| format!("{}: {message}", m.file.display())));
        Self {
            exact: meshes.iter().all(|m| m.exact),
            shapes,
            instances,
            triangles,
            geometry_memory,
            picture_memory,
            width: film.width,
            height: film.height,
            film_memory,
            accel: [("embree", EMBREE_BYTES_PER_TRIANGLE, EMBREE_PEAK), ("bvh", BVH_BYTES_PER_TRIANGLE, BVH_PEAK)]
                .map(accel),
            warnings,
            meshes,
            pictures,
        }
    }
}
