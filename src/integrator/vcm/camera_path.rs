//! Camera sub-paths: lights that they meet, next-event estimation, connections and merges.

use super::Recipe;
use super::correlation::{self, Link, Trails};
use super::event::{Event, Pdf};
use super::faint::Faint;
use super::grid::Grid;
use super::light_path::LightVertex;
use super::step::{CameraVertex, Scattered, cosine};
use super::weights::{Mis, emitter_hit, side, weight};
use crate::bsdf::{Bsdf, BsdfSample, LobeMask, Mode};
use crate::camera::CameraRay;
use crate::color::Rgb;
use crate::geometry::{Ray, SurfaceInteraction};
use crate::integrator::branches::{Discrete, LEAST, Place};
use crate::integrator::roulette;
use crate::light::LightLi;
use crate::math::Vec3;
use crate::sample::Sampler;
use crate::tally::Counters;

/// Camera paths that carry less are left to Russian roulette. It is below 1 since they have paid for what they gather at all
/// their vertices when they arrive; between a quarter and a half there is little to choose.
const FAINT: f32 = 1.0 / 3.0;

/// A walk from the camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct CameraWalk {
    pub ray: Ray,
    pub beta: Rgb,
    pub mis: Mis,
    /// Edges from the camera to the vertex reached.
    pub depth: u32,
    pub from: Vec3,
    eta: f32,
    /// No vertex so far could have been merged.
    unmerged: bool,
    pub parallel: bool,
    /// Density of the ray that the camera sent, per steradian or, of parallel rays, per area.
    pub first_pdf: f64,
    /// How it left the last vertex.
    pub last: Scattered,
    /// What of the lights that it meets branches find.
    discrete: Discrete,
    /// The direction in which it left the last vertex, and with what weight.
    chosen: Option<BsdfSample>,
}

impl CameraWalk {
    #[inline(always)]
    pub fn start(recipe: &Recipe, camera_ray: &CameraRay) -> Self {
        let parallel = recipe.scene.camera.is_orthographic();
        let pdf = if parallel { camera_ray.pdf_a } else { camera_ray.pdf_w };
        let dvcm = if recipe.settings.light_image { recipe.light_paths as f64 / pdf as f64 } else { 0.0 };
        Self {
            ray: camera_ray.ray,
            beta: Rgb::splat(camera_ray.weight),
            mis: Mis { dvcm, ..Mis::default() },
            depth: 0,
            from: camera_ray.lens,
            eta: 1.0,
            unmerged: true,
            parallel,
            first_pdf: pdf as f64,
            last: Scattered::default(),
            discrete: Discrete::start(recipe.scene, LEAST),
            chosen: None,
        }
    }

    /// Carries the sums over the edge to `si`; what waits to be decided stays until then.
    #[inline(always)]
    pub fn arrive(&mut self, si: &SurfaceInteraction) {
        let dist_sq = if self.parallel { 1.0 } else { self.from.distance_squared(si.p) as f64 };
        self.mis.arrive(dist_sq, cosine(si, si.wo));
        self.depth += 1;
    }

    /// Weight of light that the emitter at the end of the walk sends; `direct` and `emit` as for [`emitter_hit`].
    pub fn emitter_weight(&self, recipe: &Recipe, direct: f64, emit: f64) -> f32 {
        if self.depth == 1 {
            return 1.0;
        }
        if !recipe.settings.connect {
            return self.unmerged as u8 as f32;
        }
        let mut mis = self.mis;
        // All that is summed up of direct light is its image.
        if self.depth == 2 {
            mis.dvc *= recipe.direct_image;
        }
        mis.resolve(recipe.merges_direct());
        weight(emitter_hit(&mis, direct, emit)) as f32
    }

    /// [`CameraWalk::emitter_weight`], aware of correlation where that is asked for. A distant light is no surface.
    pub fn hit_weight(&self, recipe: &Recipe, eta: f64, links: &[Link], pdfs: (f64, f64), distant: bool) -> f32 {
        if !recipe.settings.correlation_aware || self.depth == 1 || !recipe.settings.connect {
            return self.emitter_weight(recipe, pdfs.0, pdfs.1);
        }
        weight(correlation::hit_sums(recipe, eta, links, pdfs, distant.then_some(self.last.fwd))) as f32
    }

    /// Scatters at `si`; false ends the walk.
    #[inline(always)]
    pub fn scatter(
        &mut self,
        recipe: &Recipe,
        si: &SurfaceInteraction,
        bsdf: &Bsdf,
        eta: f64,
        sampler: &mut Sampler,
    ) -> bool {
        let (u_lobe, u) = (sampler.next_1d(), sampler.next_2d());
        self.chosen = bsdf.sample(si.wo, u_lobe, u, Mode::Radiance, LobeMask::ALL);
        let Some(s) = self.chosen else { return false };
        self.beta *= s.weight;
        self.eta *= s.eta;
        let merge = if recipe.mergeable(si) { eta } else { 0.0 };
        self.last = recipe.scatter(&mut self.mis, si, bsdf, &s, (0.0, merge));
        if s.lobe.intersects(LobeMask::SMOOTH) && recipe.mergeable(si) {
            self.unmerged = false;
        }
        self.parallel = false;
        self.from = si.p;
        self.ray = si.spawn_ray(s.wi);
        roulette(&mut self.beta, self.eta, self.depth, (recipe.settings.rr_depth, FAINT), sampler)
    }
}

/// The light that one iteration has for a camera path.
pub(super) struct LightField<'a> {
    /// Vertices of the light path that belongs to this camera path.
    pub vertices: &'a [LightVertex],
    /// Their bsdfs.
    pub bsdfs: &'a [Bsdf],
    pub grid: Option<&'a Grid>,
    pub eta: f64,
    /// What `vertices` refer to.
    pub links: &'a [Link],
}

/// Radiance (W·m⁻²·sr⁻¹) along a camera ray by all techniques with camera vertices.
#[inline(always)]
pub(super) fn radiance(
    recipe: &Recipe,
    camera_ray: &CameraRay,
    field: &LightField,
    sampler: &mut Sampler,
    counters: &mut Counters,
) -> Rgb {
    let scene = recipe.scene;
    let mut sum = Rgb::BLACK;
    let mut walk = CameraWalk::start(recipe, camera_ray);
    let mut hide = recipe.settings.hide_emitters;
    let correlated = recipe.settings.correlation_aware;
    let mut links = Vec::new();
    let mut faint = Faint::new(sampler);
    while walk.depth < recipe.max_depth {
        // Find the next surface; what leaves the scene sees the environment.
        counters.camera_rays += 1;
        let Some(hit) = scene.hit(&mut walk.ray) else {
            if !hide {
                sum += escaped(recipe, &mut walk, (field.eta, &links)) * walk.discrete.share();
            }
            break;
        };
        let si = scene.interaction(&walk.ray, &hit);
        let emitter = scene.is_emitter(&si);
        if emitter && hide {
            walk.ray = Ray { tmax: walk.ray.tmax, ..si.spawn_ray(walk.ray.d) };
            continue;
        }
        hide = false;
        let from = walk.from;
        if correlated {
            correlation::arrive_from_camera(recipe, &mut links, &walk, &si);
        }
        walk.arrive(&si);
        if emitter {
            sum += met_light(recipe, &walk, &si, from, (field.eta, &links)) * walk.discrete.share();
        }
        if walk.depth >= recipe.max_depth || !recipe.settings.camera_paths {
            break;
        }
        // Settle what the last vertex could not know.
        walk.mis.resolve(recipe.focuses(&si));
        recipe.settle(&mut walk.mis, walk.depth);
        let bsdf = scene.bsdf(&si);
        if bsdf.lobes().intersects(LobeMask::SMOOTH) {
            let merge = if recipe.mergeable(&si) { field.eta } else { 0.0 };
            let trails = correlated.then_some(Trails { camera: &links, light: field.links });
            let v = CameraVertex { si: &si, bsdf: &bsdf, mis: &walk.mis, depth: walk.depth, merge, trails };
            if recipe.settings.connect {
                faint.compare_with(sum);
                sum += next_event(recipe, &v, (field.eta, walk.beta), sampler, &mut faint, counters);
                let pairs = field.vertices.iter().zip(field.bsdfs);
                for light in pairs.take_while(|(l, _)| l.depth + v.depth < recipe.max_depth) {
                    faint.compare_with(sum);
                    sum += connect(recipe, &v, light, (field.eta, walk.beta), &mut faint, counters);
                }
            }
            if let (Some(grid), true) = (field.grid, merge > 0.0) {
                counters.photon_queries += 1;
                let merged = grid.merge(recipe, &v, recipe.max_depth - v.depth);
                sum += walk.beta * merged / recipe.light_paths as f32;
            }
        }
        let max_depth = recipe.settings.max_depth;
        let place = Place { si: &si, bsdf: &bsdf, beta: walk.beta, eta: walk.eta, depth: walk.depth, max_depth };
        let goes_on = walk.scatter(recipe, &si, &bsdf, field.eta, sampler);
        sum += walk.discrete.scatter(scene, &place, walk.chosen.as_ref(), sampler, counters);
        if !goes_on {
            break;
        }
        if correlated {
            correlation::leave(&mut links, &walk.last, &si, walk.ray.d);
        }
    }
    sum
}

/// Light from the environment at the end of a walk.
fn escaped(recipe: &Recipe, walk: &mut CameraWalk, (eta, links): (f64, &[Link])) -> Rgb {
    let d = walk.ray.d;
    let radiance = recipe.scene.environment_radiance(d);
    if radiance.is_black() {
        return Rgb::BLACK;
    }
    let (direct, emit) = escape_densities(recipe, walk.from, d);
    walk.depth += 1;
    walk.beta * radiance * walk.hit_weight(recipe, eta, links, (direct, emit), true)
}

/// What [`emitter_hit`] asks of a ray that leaves the scene along `d`.
pub(super) fn escape_densities(recipe: &Recipe, from: Vec3, d: Vec3) -> (f64, f64) {
    let scene = recipe.scene;
    let Some(index) = scene.environment else { return (0.0, 0.0) };
    let light = &scene.lights[index as usize];
    let (pdf_a, pdf_w) = light.pdf_le(&scene.light_context(), from, -d, -d);
    let guided = recipe.emission_density(index as usize, from, -d, -d);
    let emit = scene.photon_selector.pmf(index as usize) as f64 * guided * pdf_a as f64 * pdf_w as f64;
    (scene.pdf_environment(from, d) as f64, emit)
}

/// Light from the surface that a walk has come to, `from` being the vertex before.
fn met_light(
    recipe: &Recipe,
    walk: &CameraWalk,
    si: &SurfaceInteraction,
    from: Vec3,
    (eta, links): (f64, &[Link]),
) -> Rgb {
    let emitted = recipe.scene.emitted(si, si.wo);
    if emitted.is_black() {
        return Rgb::BLACK;
    }
    let (direct, emit) = hit_densities(recipe, si, from);
    walk.beta * emitted * walk.hit_weight(recipe, eta, links, (direct, emit), false)
}

/// What [`emitter_hit`] asks of a light that was hit at `si` from `from`.
pub(super) fn hit_densities(recipe: &Recipe, si: &SurfaceInteraction, from: Vec3) -> (f64, f64) {
    let scene = recipe.scene;
    let Some(index) = scene.shape_lights[si.shape as usize] else { return (0.0, 0.0) };
    // Light sampling counts per area of the light here.
    let direct = scene.pdf_direct(from, si) as f64 * cosine(si, si.wo) / from.distance_squared(si.p) as f64;
    let (pdf_a, pdf_w) = scene.lights[index as usize].pdf_le_at(&scene.light_context(), si, si.wo);
    let guided = recipe.emission_density(index as usize, si.p, si.ng, si.wo);
    (direct, scene.photon_selector.pmf(index as usize) as f64 * guided * pdf_a as f64 * pdf_w as f64)
}

/// Next-event estimation: light from a sampled light, towards the eye along a path of weight `beta`.
#[inline(always)]
fn next_event(
    recipe: &Recipe,
    v: &CameraVertex,
    (eta, beta): (f64, Rgb),
    sampler: &mut Sampler,
    faint: &mut Faint,
    counters: &mut Counters,
) -> Rgb {
    let scene = recipe.scene;
    let (u_light, u) = (sampler.next_1d(), sampler.next_2d());
    let Some((index, pmf)) = scene.selector.sample(u_light) else { return Rgb::BLACK };
    let Some(li) = scene.lights[index].sample_li(&scene.light_context(), v.si.p, u) else { return Rgb::BLACK };
    if li.radiance.is_black() {
        return Rgb::BLACK;
    }
    let Some(event) = Event::new(recipe, v.si, v.bsdf, li.wi, Mode::Radiance) else { return Rgb::BLACK };
    let w = weight(next_event_sums(recipe, v, eta, (index, &li), event.pdf));
    let value = beta * event.f * li.radiance * (w / (pmf as f64 * li.pdf_w as f64)) as f32;
    faint.unless_occluded(value, || {
        counters.shadow_rays += 1;
        scene.unoccluded(v.si, &li)
    })
}

/// What the other techniques of a path that next-event estimation found amount to; `pdf` are the densities towards the
/// light.
#[inline(always)]
pub(super) fn next_event_sums(
    recipe: &Recipe,
    v: &CameraVertex,
    eta: f64,
    (index, li): (usize, &LightLi),
    pdf: Pdf,
) -> f64 {
    let scene = recipe.scene;
    let light = &scene.lights[index];
    let pmf = scene.selector.pmf(index) as f64;
    let cos = cosine(v.si, li.wi);
    let (pdf_a, pdf_w) = light.pdf_le_li(&scene.light_context(), li);
    // Emission over light sampling, per area of the vertex.
    let guided = recipe.emission_density(index, li.p, li.n, -li.wi);
    let ratio = guided * scene.photon_selector.pmf(index) as f64 / pmf;
    let ratio = ratio
        * match (li.delta, li.dist.is_infinite()) {
            (true, true) => pdf_a as f64 * cos,
            (true, false) => pdf_w as f64 * cos / (li.dist as f64 * li.dist as f64),
            (false, true) => pdf_a as f64 * pdf_w as f64 * cos / li.pdf_w as f64,
            (false, false) => pdf_a as f64 * pdf_w as f64 * cos / (li.pdf_w as f64 * -li.n.dot(li.wi) as f64),
        };
    let hit = if li.delta { 0.0 } else { pdf.fwd / (pmf * li.pdf_w as f64) };
    if let Some(trails) = &v.trails {
        return correlation::next_event_sums(recipe, trails, eta, index, li, (ratio, hit, pdf.rev));
    }
    let merge = if recipe.merges_direct() { v.merge } else { 0.0 };
    let image = if v.depth == 1 { recipe.direct_image } else { 1.0 };
    hit + side(&Mis { dvcm: image * v.mis.dvcm, ..*v.mis }, ratio, pdf.rev, merge)
}

/// Connects a camera vertex at the end of a path of weight `beta` with a light vertex.
#[inline(always)]
fn connect(
    recipe: &Recipe,
    v: &CameraVertex,
    (light, light_bsdf): (&LightVertex, &Bsdf),
    (eta, beta): (f64, Rgb),
    faint: &mut Faint,
    counters: &mut Counters,
) -> Rgb {
    let d = light.si.p - v.si.p;
    let dist_sq = d.length_squared();
    let w = d / dist_sq.sqrt();
    let Some(here) = Event::new(recipe, v.si, v.bsdf, w, Mode::Radiance) else { return Rgb::BLACK };
    let Some(there) = Event::new(recipe, &light.si, light_bsdf, -w, Mode::Importance) else { return Rgb::BLACK };
    let sums = connection_sums(recipe, v, light, (here.pdf, there.pdf), (w, dist_sq as f64), eta);
    let value = beta * here.f * there.f * light.beta * (weight(sums) as f32 / dist_sq);
    faint.unless_occluded(value, || {
        counters.shadow_rays += 1;
        recipe.scene.visible(v.si, (light.si.p, light.si.p_err, light.si.ng))
    })
}

/// What the other techniques of a connected path amount to; `w` points from the camera's vertex to the light's, `here` are
/// the camera vertex's densities in this direction and `there` the light vertex's in the opposite one.
#[inline(always)]
pub(super) fn connection_sums(
    recipe: &Recipe,
    v: &CameraVertex,
    light: &LightVertex,
    (here, there): (Pdf, Pdf),
    (w, dist_sq): (Vec3, f64),
    eta: f64,
) -> f64 {
    // Densities with which each side would have sampled the vertex of the other, per area.
    let per_dist_sq = 1.0 / dist_sq;
    let to_light = here.fwd * cosine(&light.si, w) * per_dist_sq;
    let to_camera = there.fwd * cosine(v.si, w) * per_dist_sq;
    if let Some(trails) = &v.trails {
        let (light_pdfs, camera_pdfs) = ((to_light, there.rev), (to_camera, here.rev));
        return correlation::connection_sums(recipe, trails, eta, light, light_pdfs, camera_pdfs);
    }
    let light_merge = if light.merges { eta } else { 0.0 };
    let camera_merge = if recipe.focuses(&light.si) { v.merge } else { 0.0 };
    side(&light.mis, to_light, there.rev, light_merge) + side(v.mis, to_camera, here.rev, camera_merge)
}
