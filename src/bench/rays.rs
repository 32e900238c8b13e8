//! The rays that rendering a scene asks for, collected from real paths.

use rayon::prelude::*;

use crate::bsdf::{LobeMask, Mode};
use crate::camera::Camera;
use crate::geometry::{Ray, SurfaceInteraction};
use crate::math::{Frame, Vec2};
use crate::sample::{Key, Purpose, Sampler, Sequence, warp};
use crate::scene::Scene;

/// Side of a tile of pixels, as rendering visits them.
const TILE: u32 = 16;
/// Edges after which a path is not followed further.
const EDGES: u32 = 8;

/// Why a ray is traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// From the camera, tile by tile.
    Primary,
    /// Any hit on the way from where a camera ray ended to a light.
    Shadow,
    /// The first diffuse bounce of a camera path.
    Diffuse,
    /// The later bounces of camera paths.
    Gather,
    /// All edges of photon paths, scattered by the scene's materials.
    Photon,
}

impl Class {
    pub const ALL: [Self; 5] = [Self::Primary, Self::Shadow, Self::Diffuse, Self::Gather, Self::Photon];

    pub fn name(self) -> &'static str {
        match self {
            Self::Primary => "primary",
            Self::Shadow => "shadow",
            Self::Diffuse => "diffuse",
            Self::Gather => "gather",
            Self::Photon => "photon",
        }
    }

    /// True where only the existence of a hit is asked for.
    pub fn is_any_hit(self) -> bool {
        self == Self::Shadow
    }
}

/// Rays of one kind.
pub struct RayClass {
    pub class: Class,
    /// Empty where the scene has none, for example photon rays without a light.
    pub rays: Vec<Ray>,
}

/// Collects up to `count` rays of every class in `classes`, the same for the same scene and seed.
pub fn collect(scene: &Scene, classes: &[Class], count: usize, seed: u64) -> Vec<RayClass> {
    classes.iter().map(|&class| RayClass { class, rays: rays_of(scene, class, count, seed) }).collect()
}

fn rays_of(scene: &Scene, class: Class, count: usize, seed: u64) -> Vec<Ray> {
    let key = Key::new(seed, Purpose::Test, class as u64);
    let batch = 4096u64;
    let one = |index: u64| {
        let mut sampler = Sampler::new(Sequence::Sobol, key, index);
        let mut rays = Vec::new();
        match class {
            Class::Photon => photon_path(scene, &mut sampler, &mut rays),
            _ => camera_path(scene, class, index, count as u64, &mut sampler, &mut rays),
        }
        rays
    };
    // Go on until there are enough, but not for ever: a scene may have none.
    let mut rays = Vec::with_capacity(count);
    let mut first = 0;
    while rays.len() < count && first < 8 * (count as u64).max(batch) {
        let more: Vec<Vec<Ray>> = (first..first + batch).into_par_iter().map(one).collect();
        rays.extend(more.into_iter().flatten());
        first += batch;
    }
    rays.truncate(count);
    rays
}

/// A camera ray through pixel number `index`, pixels counted tile by tile over a picture of about `count` samples.
fn camera_ray(camera: &Camera, index: u64, count: u64, sampler: &mut Sampler) -> Ray {
    let window = camera.window();
    let (w, h) = (window.crop_size.0.max(1), window.crop_size.1.max(1));
    // Spread the samples over the whole film whatever its size: a coarser or finer raster of the same shape.
    let side = (count as f64).sqrt().ceil().max(1.0) as u64;
    let tiles = side.div_ceil(TILE as u64).max(1);
    let (tile, pixel) = (index / (TILE * TILE) as u64 % (tiles * tiles), index % (TILE * TILE) as u64);
    let x = tile % tiles * TILE as u64 + pixel % TILE as u64;
    let y = tile / tiles * TILE as u64 + pixel / TILE as u64;
    let u = (Vec2::new(x as f32, y as f32) + sampler.next_2d()) / (tiles * TILE as u64) as f32;
    let corner = Vec2::new(window.crop_offset.0 as f32, window.crop_offset.1 as f32);
    camera.generate_ray(corner + u * Vec2::new(w as f32, h as f32), sampler.next_2d()).ray
}

fn camera_path(scene: &Scene, class: Class, index: u64, count: u64, sampler: &mut Sampler, rays: &mut Vec<Ray>) {
    let mut primary = camera_ray(&scene.camera, index, count, sampler);
    if class == Class::Primary {
        rays.push(primary);
        return;
    }
    let Some(mut si) = scene.intersect(&mut primary) else { return };
    if class == Class::Shadow {
        rays.extend(shadow_ray(scene, &si, sampler));
        return;
    }
    for edge in 0..EDGES {
        let mut ray = diffuse_ray(&si, sampler);
        if class == Class::Diffuse {
            rays.push(ray);
            return;
        }
        if edge > 0 {
            rays.push(ray);
        }
        let Some(next) = scene.intersect(&mut ray) else { return };
        si = next;
    }
}

fn diffuse_ray(si: &SurfaceInteraction, sampler: &mut Sampler) -> Ray {
    let n = if si.ng.dot(si.wo) < 0.0 { -si.ng } else { si.ng };
    let d = Frame::from_normal(n).to_world(warp::cosine_hemisphere(sampler.next_2d()));
    si.spawn_ray(d)
}

fn shadow_ray(scene: &Scene, si: &SurfaceInteraction, sampler: &mut Sampler) -> Option<Ray> {
    let (index, _) = scene.selector.sample(sampler.next_1d())?;
    let li = scene.lights[index].sample_li(&scene.light_context(), si.p, sampler.next_2d())?;
    let o = si.spawn_origin(li.wi);
    Some(if li.dist.is_infinite() { Ray::new(o, li.wi) } else { Ray::segment(o, li.p - o, 1.0 - 1e-4) })
}

fn photon_path(scene: &Scene, sampler: &mut Sampler, rays: &mut Vec<Ray>) {
    let (u_light, u_pos, u_dir) = (sampler.next_1d(), sampler.next_2d(), sampler.next_2d());
    let Some((light, _)) = scene.selector.sample(u_light) else { return };
    let Some(le) = scene.lights[light].sample_le(&scene.light_context(), u_pos, u_dir) else { return };
    let mut ray = le.ray;
    for _ in 0..EDGES {
        rays.push(ray);
        let Some(si) = scene.intersect(&mut ray) else { return };
        let (u_lobe, u) = (sampler.next_1d(), sampler.next_2d());
        let sample = scene.bsdf(&si).sample(si.wo, u_lobe, u, Mode::Importance, LobeMask::ALL);
        // Russian roulette by what is left, as photon tracing does it.
        let Some(s) = sample else { return };
        if sampler.next_1d() >= s.weight.max_channel() {
            return;
        }
        ray = si.spawn_ray(s.wi);
    }
}
