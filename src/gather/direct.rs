//! Direct light by next-event estimation.

use crate::bsdf::{Bsdf, LobeMask, Mode};
use crate::color::Rgb;
use crate::geometry::SurfaceInteraction;
use crate::math::Vec3;
use crate::sample::Sampler;
use crate::scene::Scene;
use crate::tally::Counters;

/// Power heuristic with exponent 2 for one sample of each technique [Veach 1997, §9.2.4]; the ratio form cannot overflow.
#[inline]
pub fn power_heuristic(pdf: f32, other: f32) -> f32 {
    if pdf == f32::INFINITY {
        return 1.0;
    }
    let r = other / pdf;
    1.0 / (1.0 + r * r)
}

/// Radiance (W·m⁻²·sr⁻¹) reflected at `si` towards `si.wo` from one light sample, visibility included.
///
/// `bsdf_share` is the number of directions sampled from the lobes `mask` for each light sample: the estimate carries the
/// power-heuristic weight against them, and the caller adds their half where such a ray reaches a light. 0 leaves all to
/// light sampling.
#[inline(always)]
pub fn sample_direct(
    scene: &Scene,
    si: &SurfaceInteraction,
    bsdf: &Bsdf,
    mask: LobeMask,
    bsdf_share: f32,
    sampler: &mut Sampler,
    counters: &mut Counters,
) -> Rgb {
    sample_direct_unless(scene, si, bsdf, mask, bsdf_share, sampler, counters, |_, _| None)
}

/// As [`sample_direct`], without a shadow ray where `known(light, direction)` tells whether the light is visible.
#[allow(clippy::too_many_arguments)]
#[inline(always)]
pub fn sample_direct_unless(
    scene: &Scene,
    si: &SurfaceInteraction,
    bsdf: &Bsdf,
    mask: LobeMask,
    bsdf_share: f32,
    sampler: &mut Sampler,
    counters: &mut Counters,
    known: impl Fn(usize, Vec3) -> Option<bool>,
) -> Rgb {
    // Choose a light and a point on it.
    let (u_light, u) = (sampler.next_1d(), sampler.next_2d());
    let Some((index, pmf)) = scene.selector.sample(u_light) else { return Rgb::BLACK };
    let Some(li) = scene.lights[index].sample_li(&scene.light_context(), si.p, u) else { return Rgb::BLACK };
    // Scatter its light towards the viewer.
    let f = bsdf.eval(si.wo, li.wi, Mode::Radiance, mask);
    if f.is_black() || li.radiance.is_black() {
        return Rgb::BLACK;
    }
    let visible = known(index, li.wi).unwrap_or_else(|| {
        counters.shadow_rays += 1;
        scene.unoccluded(si, &li)
    });
    if !visible {
        return Rgb::BLACK;
    }
    let pdf_light = pmf * li.pdf_w;
    let weight = if li.delta || bsdf_share == 0.0 {
        1.0
    } else {
        power_heuristic(pdf_light, bsdf_share * bsdf.pdf(si.wo, li.wi, Mode::Radiance, mask))
    };
    f * li.radiance * (weight / pdf_light)
}

/// Emitted light that a ray has met.
#[derive(Clone, Copy, Debug)]
pub struct MetLight {
    /// W·m⁻²·sr⁻¹.
    pub emitted: Rgb,
    /// Power-heuristic weight against light sampling.
    pub weight: f32,
}

/// The light that a ray from `p` along `d` meets at `hit`, or in the environment where it meets no surface.
///
/// `pdf` is the density (sr⁻¹) with which `d` was chosen, infinite for a discrete choice, and `light_samples` the number of
/// light samples for each such ray. `None` where there is no light.
#[inline]
pub fn met_light(
    scene: &Scene,
    p: Vec3,
    d: Vec3,
    hit: Option<&SurfaceInteraction>,
    pdf: f32,
    light_samples: f32,
) -> Option<MetLight> {
    let (emitted, pdf_light) = match hit {
        Some(hit) if scene.is_emitter(hit) => (scene.emitted(hit, hit.wo), scene.pdf_direct(p, hit)),
        Some(_) => return None,
        None => (scene.environment_radiance(d), scene.pdf_environment(p, d)),
    };
    (!emitted.is_black()).then(|| MetLight { emitted, weight: power_heuristic(pdf, pdf_light * light_samples) })
}

/// The other half of [`sample_direct`]: one ray that the lobes `mask` at `si` choose, and the light that it meets.
///
/// Returns the weight of the choice, `f·|cos|/pdf`, apart from the light, which is shared with `light_samples` light
/// samples for each ray.
#[inline]
pub fn sample_lobe_light(
    scene: &Scene,
    si: &SurfaceInteraction,
    bsdf: &Bsdf,
    mask: LobeMask,
    light_samples: f32,
    sampler: &mut Sampler,
    counters: &mut Counters,
) -> Option<(Rgb, MetLight)> {
    let (u_lobe, u) = (sampler.next_1d(), sampler.next_2d());
    let s = bsdf.sample(si.wo, u_lobe, u, Mode::Radiance, mask)?;
    counters.camera_rays += 1;
    let mut ray = si.spawn_ray(s.wi);
    let hit = match scene.hit(&mut ray) {
        Some(hit) if scene.shape_lights[hit.shape as usize].is_none() => return None,
        hit => hit.map(|hit| scene.interaction(&ray, &hit)),
    };
    // Light sampling cannot make the directions of discrete lobes.
    let pdf = if s.lobe.intersects(LobeMask::SMOOTH) { s.pdf } else { f32::INFINITY };
    Some((s.weight, met_light(scene, si.p, s.wi, hit.as_ref(), pdf, light_samples)?))
}
