//! The walk over a scene that reads headers alone.

use glam::{DVec3, Vec3};

use super::super::predict::{MeshPrediction, Prediction};
use super::super::xml::Document;
use super::super::{LoadOptions, SceneError};
use super::sensors::View;
use super::{Loader, ToScene};
use crate::geometry::GeometrySet;
use crate::math::Bounds3;

/// Predicts the memory of the scene that a document describes.
pub fn predict(doc: &Document, options: &LoadOptions) -> Result<Prediction, SceneError> {
    let mut loader = Loader::new(doc);
    loader.pictures = Some(Vec::new());
    let contents = loader.contents(options)?;
    let world = contents.world;

    // Where things are and how large is not known, and not asked.
    let to_scene = ToScene { center: DVec3::ZERO, scale: 1.0 };
    let view = View { to_scene: &to_scene, bounds: Bounds3::new(Vec3::splat(-0.5), Vec3::splat(0.5)) };
    let film = loader.sensor(&contents.sensors, &view, options)?.film;
    for emitter in world.each_shape().filter_map(|s| s.emitter) {
        loader.area_radiance(emitter)?;
    }
    for child in contents.emitters {
        loader.emitter(child, &to_scene, &GeometrySet::default())?;
    }

    let (mut meshes, mut others) = (Vec::new(), 0);
    for shape in world.each_shape() {
        let Some((counts, flat)) = shape.counts() else {
            others += 1;
            continue;
        };
        let uvs = counts.uvs && loader.keep.uv.unwrap_or_else(|| loader.uses_uv(shape.material, shape.emitter));
        let normals = !flat && loader.keep.normals != Some(false);
        meshes.push(MeshPrediction::new(&counts, normals, uvs));
    }
    let instances = world.instance_count() as u64;
    Ok(Prediction::new(meshes, others, instances, loader.pictures.unwrap_or_default(), &film, doc.warnings()))
}
