//! Recipes: how the pieces below make the radiance of one camera ray.

mod branches;
mod direct;
mod lobe_walk;
mod path;
mod photonmapper;
pub mod sppm;
pub mod vcm;

pub use direct::Direct;
pub use path::Path;
pub use photonmapper::{Layer, LayerView, PhotonMapper, PhotonMapperSettings};
pub use sppm::{Sppm, SppmSettings};
pub use vcm::VcmSettings;

use crate::bsdf::{Bsdf, BsdfSample, LobeMask, Mode};
use crate::camera::CameraRay;
use crate::color::Rgb;
use crate::geometry::{Ray, SurfaceInteraction};
use crate::sample::Sampler;
use crate::scene::Scene;
use crate::shoot::{MANY_EDGES, survival};
use crate::tally::Counters;

/// One sample of the film.
#[derive(Clone, Copy, Debug)]
pub struct CameraSample {
    pub camera_ray: CameraRay,
    /// The pixel it belongs to, in coordinates of the whole film.
    pub pixel: (u32, u32),
}

/// The radiance that arrives along a camera ray; one implementation per recipe, dispatched statically.
pub trait Integrator: Sync {
    /// Radiance (W·m⁻²·sr⁻¹), one estimate.
    fn li(&self, scene: &Scene, sample: &CameraSample, sampler: &mut Sampler, counters: &mut Counters) -> Rgb;
}

/// Several pictures by the same camera paths.
pub trait Outputs<const N: usize>: Sync {
    /// One estimate of each (W·m⁻²·sr⁻¹).
    fn see(&self, scene: &Scene, sample: &CameraSample, sampler: &mut Sampler, counters: &mut Counters) -> [Rgb; N];
}

impl<I: Integrator> Outputs<1> for I {
    #[inline(always)]
    fn see(&self, scene: &Scene, sample: &CameraSample, sampler: &mut Sampler, counters: &mut Counters) -> [Rgb; 1] {
        [self.li(scene, sample, sampler, counters)]
    }
}

/// Longest path in edges; `None` is unlimited. Mitsuba's convention: 1 shows emitters only, 2 adds direct light.
pub type MaxDepth = Option<u32>;

/// Russian roulette on the largest channel from `rr_depth` edges on, `beta` readjusted; false ends the path.
///
/// Paths that carry more than `faint` ≤ 1 go on for certain, and those that carry less weigh that much when they do.
/// `eta` is the product of the relative indices crossed: its square undoes the scaling of radiance inside dielectrics.
/// Survivors never weigh more than 1: ending at least one path in twenty whatever its weight, as is often done, lets the
/// weight grow without bound where albedos exceed 0.95, and the variance with it. See [`survival`] for paths without loss.
#[inline]
fn roulette(beta: &mut Rgb, eta: f32, depth: u32, (rr_depth, faint): (u32, f32), sampler: &mut Sampler) -> bool {
    let largest = beta.max_channel();
    if largest <= 0.0 || largest.is_nan() {
        return false;
    }
    // What is trapped has to end some day.
    let faint = if depth < MANY_EDGES { faint } else { 1.0 };
    let survive = survival(largest * eta * eta / faint, depth, rr_depth);
    if survive < 1.0 {
        if sampler.next_1d() >= survive {
            return false;
        }
        *beta *= 1.0 / survive;
    }
    true
}

/// Continues a path through the specular and sharp glossy lobes.
#[inline]
fn specular_bounce(si: &SurfaceInteraction, bsdf: &Bsdf, sampler: &mut Sampler) -> Option<(Ray, BsdfSample)> {
    bounce(si, bsdf, LobeMask::SPECULAR, sampler)
}

/// Continues a path through the lobes in `mask`.
#[inline]
fn bounce(si: &SurfaceInteraction, bsdf: &Bsdf, mask: LobeMask, sampler: &mut Sampler) -> Option<(Ray, BsdfSample)> {
    let (u_lobe, u) = (sampler.next_1d(), sampler.next_2d());
    let s = bsdf.sample(si.wo, u_lobe, u, Mode::Radiance, mask)?;
    Some((si.spawn_ray(s.wi), s))
}
