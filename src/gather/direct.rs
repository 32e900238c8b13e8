//! Direct light by next-event estimation.

use crate::bsdf::{Bsdf, LobeMask, Mode};
use crate::color::Rgb;
use crate::geometry::SurfaceInteraction;
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
    // Choose a light and a point on it.
    let (u_light, u) = (sampler.next_1d(), sampler.next_2d());
    let Some((index, pmf)) = scene.selector.sample(u_light) else { return Rgb::BLACK };
    let Some(li) = scene.lights[index].sample_li(&scene.light_context(), si.p, u) else { return Rgb::BLACK };
    // Scatter its light towards the viewer.
    let f = bsdf.eval(si.wo, li.wi, Mode::Radiance, mask);
    if f.is_black() || li.radiance.is_black() {
        return Rgb::BLACK;
    }
    counters.shadow_rays += 1;
    if !scene.unoccluded(si, &li) {
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
