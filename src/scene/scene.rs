use std::path::Path;
use std::sync::Arc;

use glam::Vec3;

use super::load::{self, ToScene};
use super::nested::Nested;
use super::xml::{Document, ParseOptions};
use super::{FilmSettings, IntegratorSettings, NeedOverride, PhotonAims, SamplerSettings, SceneError};
use crate::accel::{Accel, AccelKind, AccelOptions};
use crate::bsdf::{self, Bsdf, LobeMask, Material, MaterialId, Plain};
use crate::camera::Camera;
use crate::color::Rgb;
use crate::geometry::{GeometrySet, Hit, Ray, SurfaceInteraction};
use crate::light::{Light, LightContext, LightLi, LightSelector, NearLights, SkyView};
use crate::math::{Bounds3, offset_ray_origin};
use crate::texture::Textures;

/// What comes from outside the scene file.
#[derive(Clone, Debug, Default)]
pub struct LoadOptions {
    /// `-D key=value` pairs; they win over `<default>`.
    pub defines: Vec<(String, String)>,
    pub accel: AccelKind,
    pub accel_options: AccelOptions,
    /// Film size in place of the file's; with one of them the proportions stay.
    pub width: Option<u32>,
    pub height: Option<u32>,
    /// `uv=on` and `normals=on` keep the texture coordinates and vertex normals of meshes that have no use for them, `off`
    /// drops those of all meshes.
    pub needs: Vec<NeedOverride>,
}

/// What was counted while a scene was loaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SceneStats {
    pub shapes: u64,
    pub instances: u64,
    /// Triangles of all meshes, each counted once however often it is instanced.
    pub triangles: u64,
    /// Triangles without area, left out.
    pub dropped_triangles: u64,
    /// Faces of mesh files with fewer than three corners, left out.
    pub skipped_faces: u64,
    /// Vertex normals without direction, replaced.
    pub repaired_normals: u64,
    /// Materials and textures that are declared and not used; their files were not read.
    pub unused: u64,
    /// Shape groups without an instance; their files were not read.
    pub unplaced_groups: u64,
    /// Bytes of texture coordinates and vertex normals that no material has a use for, left out.
    pub left_out_bytes: u64,
}

/// A validated, immutable scene: rendering it cannot fail and does no I/O.
///
/// All lengths below the scene are in scene units: [`Scene::to_scene`] has centred the world and scaled it by a power
/// of two.
pub struct Scene {
    pub geometry: Arc<GeometrySet>,
    pub accel: Accel,
    pub materials: Vec<Material>,
    /// Which of them are plain; empty where shapes may overlap.
    pub(super) plain: Vec<Option<Plain>>,
    pub textures: Textures,
    /// The material of each shape.
    pub shape_materials: Vec<MaterialId>,
    /// The area light of each shape that has one.
    pub shape_lights: Vec<Option<u32>>,
    /// The media with priorities, if there are any.
    pub(super) nested: Option<Nested>,
    pub lights: Vec<Light>,
    /// The light at infinity that escaping rays see.
    pub environment: Option<u32>,
    pub(super) light_contrast: f32,
    /// Where the environment is seen, if most of it is hidden.
    pub(super) sky: Option<SkyView>,
    /// Picks lights by their power.
    pub selector: LightSelector,
    /// Picks the lights that emit photons and light paths; as `selector` where the scene file says nothing of their shares.
    pub photon_selector: LightSelector,
    /// What the scene file says of photons.
    pub photon_aims: PhotonAims,
    /// Where lights are near in relation to their size.
    pub near_lights: NearLights,
    pub camera: Camera,
    pub film: FilmSettings,
    pub sampler: SamplerSettings,
    pub integrator: IntegratorSettings,
    /// Box of all geometry; the unit cube around the origin when there is none.
    pub bounds: Bounds3,
    pub(super) scene_sphere: (Vec3, f32),
    pub to_scene: ToScene,
    pub stats: SceneStats,
    /// BLAKE3 of all files that were read and of the defines, in hexadecimal digits.
    pub hash: String,
    /// What was ignored, with its place.
    pub warnings: Vec<String>,
}

impl Scene {
    /// Reads a scene file and everything that it names.
    pub fn load(path: &Path, options: &LoadOptions) -> Result<Self, SceneError> {
        let doc = Document::read(path, &ParseOptions { defines: options.defines.clone() })?;
        load::load(&doc, options)
    }

    /// Reads a scene from text; other files are looked for beside `path`, which need not exist.
    pub fn from_text(text: &str, path: &Path, options: &LoadOptions) -> Result<Self, SceneError> {
        let doc = Document::parse(text, path, &ParseOptions { defines: options.defines.clone() })?;
        load::load(&doc, options)
    }

    /// How much brighter than what its lights would make of the inside of the scene's sphere, were it white, the brightest of
    /// them is that rays can meet: 1 for an even sky alone, thousands for a small lamp, infinite for a sky of which little arrives.
    #[inline(always)]
    pub fn light_contrast(&self) -> f32 {
        self.light_contrast
    }

    /// The nearest surface along `ray`, as [`hit`](Self::hit) finds it.
    #[inline(always)]
    pub fn intersect(&self, ray: &mut Ray) -> Option<SurfaceInteraction> {
        self.hit(ray).map(|hit| self.interaction(ray, &hit))
    }

    /// The nearest hit along `ray`. Loops that are hot ask for its [`interaction`](Self::interaction) themselves: without
    /// an `Option` around it, it is written once.
    ///
    /// Surfaces inside of a medium with a higher priority are passed: `ray` then starts behind the last of them.
    #[inline(always)]
    pub fn hit(&self, ray: &mut Ray) -> Option<Hit> {
        match &self.nested {
            None => self.accel.intersect(ray),
            Some(nested) => {
                let (rest, hit) = self.hit_something(nested, *ray);
                *ray = rest;
                hit
            }
        }
    }

    /// [`Scene::hit`] of many rays at once: as many of `rays` as there is room for in `hits`.
    #[inline(always)]
    pub fn hit_all<'a>(&self, rays: impl Iterator<Item = &'a mut Ray>, hits: &mut [Option<Hit>]) {
        if self.nested.is_none() {
            self.accel.intersect_all(rays.map(|ray| &*ray), hits);
        } else {
            for (ray, hit) in rays.zip(hits) {
                *hit = self.hit(ray);
            }
        }
    }

    /// What is known about a hit of `ray`.
    #[inline(always)]
    pub fn interaction(&self, ray: &Ray, hit: &Hit) -> SurfaceInteraction {
        let mut si = self.geometry.interaction(ray, hit);
        if self.nested.is_some() {
            (si.near, si.far) = self.sides(ray.inside, hit.shape, si.wo.dot(si.ng) > 0.0);
            si.t += ray.passed;
        }
        si
    }

    /// True when the light sample `li` reaches the surface point `si`.
    #[inline(always)]
    pub fn unoccluded(&self, si: &SurfaceInteraction, li: &LightLi) -> bool {
        if li.dist.is_infinite() {
            return self.free(si.spawn_ray(li.wi), None);
        }
        self.visible(si, (li.p, li.p_err, li.n))
    }

    /// True when nothing stands between a surface and a point, which is given with its error bound and its normal (of either
    /// side, zero for points that are not on a surface). Both ends are moved off their surfaces.
    #[inline(always)]
    pub fn visible(&self, from: &SurfaceInteraction, to: (Vec3, Vec3, Vec3)) -> bool {
        let w = to.0 - from.p;
        let a = from.spawn_origin(w);
        let b = offset_ray_origin(to.0, to.1, to.2, -w);
        let ray = Ray { inside: from.inside(w), ..Ray::segment(a, b - a, 1.0 - 4.0 * f32::EPSILON) };
        self.free(ray, Some(b))
    }

    /// True when nothing is on the ray, up to `end` if it has one.
    #[inline(always)]
    fn free(&self, ray: Ray, end: Option<Vec3>) -> bool {
        match &self.nested {
            None => !self.accel.occluded(&ray),
            Some(nested) => self.clear(nested, ray, end),
        }
    }

    /// The material at a point, ready for use.
    #[inline(always)]
    pub fn bsdf(&self, si: &SurfaceInteraction) -> Bsdf {
        let id = self.shape_materials[si.shape as usize];
        bsdf::evaluate(&self.materials, &self.textures, id, si, &self.geometry, self.met(si.near, si.far))
    }

    /// The material of a shape if it is a plain one; `None` also where shapes may overlap.
    #[inline(always)]
    pub fn plain_material(&self, shape: u32) -> Option<&Plain> {
        self.plain.get(self.shape_materials[shape as usize].0 as usize)?.as_ref()
    }

    /// What lights look things up in.
    #[inline]
    pub fn light_context(&self) -> LightContext<'_> {
        LightContext {
            geometry: &self.geometry,
            textures: &self.textures,
            scene_sphere: self.scene_sphere,
            sky: self.sky.as_ref(),
        }
    }

    /// The light on the shape at `si`.
    #[inline]
    fn light_at(&self, si: &SurfaceInteraction) -> Option<(usize, &Light)> {
        let index = self.shape_lights[si.shape as usize]? as usize;
        Some((index, &self.lights[index]))
    }

    /// True when the shape at `si` is an area light.
    #[inline]
    pub fn is_emitter(&self, si: &SurfaceInteraction) -> bool {
        self.shape_lights[si.shape as usize].is_some()
    }

    /// Radiance (W·m⁻²·sr⁻¹) that the surface itself sends from `si` along `w`.
    #[inline]
    pub fn emitted(&self, si: &SurfaceInteraction, w: Vec3) -> Rgb {
        self.light_at(si).map_or(Rgb::BLACK, |(_, light)| light.radiance_at(&self.light_context(), si, w))
    }

    /// Radiance (W·m⁻²·sr⁻¹) seen by a ray that leaves the scene along `d`.
    #[inline]
    pub fn environment_radiance(&self, d: Vec3) -> Rgb {
        match self.environment {
            Some(i) => self.lights[i as usize].radiance_env(&self.light_context(), d),
            None => Rgb::BLACK,
        }
    }

    /// Density per steradian with which a light is picked and then the point `si` on it, seen from `p`; 0 when `si` is
    /// not on a light.
    #[inline]
    pub fn pdf_direct(&self, p: Vec3, si: &SurfaceInteraction) -> f32 {
        match self.light_at(si) {
            Some((i, light)) => self.selector.pmf(i) * light.pdf_li(&self.light_context(), p, si),
            None => 0.0,
        }
    }

    /// Density per steradian with which the environment is picked and then the direction `d`, seen from `p`.
    #[inline]
    pub fn pdf_environment(&self, p: Vec3, d: Vec3) -> f32 {
        match self.environment {
            Some(i) => self.selector.pmf(i as usize) * self.lights[i as usize].pdf_li_env(&self.light_context(), p, d),
            None => 0.0,
        }
    }

    /// Centre and radius of a sphere around all geometry.
    pub fn bounding_sphere(&self) -> (Vec3, f32) {
        self.scene_sphere
    }

    /// True when some surface may have one of these lobes.
    pub fn may_have(&self, mask: LobeMask) -> bool {
        // Many shapes share few materials.
        let mut used: Vec<u32> = self.shape_materials.iter().map(|m| m.0).collect();
        used.sort_unstable();
        used.dedup();
        used.into_iter().any(|m| bsdf::may_have(&self.materials, MaterialId(m), mask))
    }

    /// True when some surface focuses light: mirrors, glass and what is nearly so.
    pub fn has_specular(&self) -> bool {
        self.may_have(LobeMask::DELTA | LobeMask::SHARP)
    }
}
