//! Light sub-paths: emission, vertices, connections to the lens.

use super::Recipe;
use super::correlation::{self, Link};
use super::event::{Event, Pdf};
use super::grid::Photon;
use super::step::{Scattered, cosine};
use super::weights::{Mis, side, weight};
use crate::bsdf::{Bsdf, LobeMask, Mode};
use crate::color::Rgb;
use crate::film::SplatBuffer;
use crate::geometry::{Ray, SurfaceInteraction};
use crate::light::LightLe;
use crate::math::{Vec2, Vec3};
use crate::sample::Sampler;
use crate::shoot::survival;
use crate::tally::Counters;

/// A vertex that camera vertices are connected to.
#[derive(Clone, Copy, Debug)]
pub(super) struct LightVertex {
    pub si: SurfaceInteraction,
    /// Flux of the light path before it is scattered here, W.
    pub beta: Rgb,
    pub mis: Mis,
    /// Edges from the light.
    pub depth: u32,
    /// Light comes here from a surface that can focus it, and merging counts such vertices.
    pub merges: bool,
    /// Where the links of its path begin, if there are any.
    pub links: u32,
}

/// A walk from a light.
#[derive(Clone, Copy, Debug)]
pub(super) struct LightWalk {
    pub ray: Ray,
    beta: Rgb,
    pub mis: Mis,
    depth: u32,
    pub from: Vec3,
    /// How it left the last vertex.
    pub last: Scattered,
    /// The last vertex can focus light.
    focused: bool,
    /// Index and probability of the light.
    pub light: (usize, f32),
    pub le: LightLe,
}

impl LightWalk {
    /// Leaves a light.
    #[inline(always)]
    pub fn start(recipe: &Recipe, sampler: &mut Sampler) -> Option<Self> {
        let scene = recipe.scene;
        let (u_light, u_pos, u_dir) = (sampler.next_1d(), sampler.next_2d(), sampler.next_2d());
        let (light, pmf) = scene.photon_selector.sample(u_light)?;
        let le = match &recipe.emission {
            Some(emission) => emission.start(scene, light, u_pos, u_dir)?,
            None => scene.lights[light].sample_le(&scene.light_context(), u_pos, u_dir)?,
        };
        let beta = le.weight / pmf;
        (beta.is_finite() && !beta.is_black()).then_some(Self {
            ray: scene.from_light(le.ray),
            beta,
            mis: Mis::default(),
            depth: 0,
            from: le.p,
            last: Scattered::default(),
            focused: recipe.merges_direct(),
            light: (light, pmf),
            le,
        })
    }

    /// Walks to the next surface.
    #[inline(always)]
    pub fn advance(&mut self, recipe: &Recipe, counters: &mut Counters) -> Option<SurfaceInteraction> {
        counters.photon_rays += 1;
        if self.depth == 0 && recipe.scene.bounds.is_missed(self.ray.o, self.ray.d) {
            return None;
        }
        let hit = recipe.scene.hit(&mut self.ray)?;
        let si = recipe.scene.interaction(&self.ray, &hit);
        self.arrive(recipe, &si);
        Some(si)
    }

    /// Carries the sums over the edge to `si`.
    #[inline(always)]
    pub fn arrive(&mut self, recipe: &Recipe, si: &SurfaceInteraction) {
        let cos = cosine(si, si.wo);
        if self.depth == 0 {
            self.mis = self.first_sums(recipe, si, cos);
        } else {
            self.mis.arrive(self.from.distance_squared(si.p) as f64, cos);
        }
        self.depth += 1;
        recipe.settle(&mut self.mis, self.depth);
    }

    /// The sums at the first vertex, where `cos` is that of the edge from the light.
    ///
    /// `dvcm` is the density of light sampling over that of emission, `dvc` stands for the path that the camera would end
    /// on the light; both per area of the first vertex [Georgiev 2012, eqs. 31-33 with one edge taken].
    fn first_sums(&self, recipe: &Recipe, si: &SurfaceInteraction, cos: f64) -> Mis {
        let (le, pmf) = (&self.le, self.light.1 as f64);
        let (pdf_a, pdf_w) = (le.pdf_a as f64, le.pdf_w as f64);
        let dist_sq = le.p.distance_squared(si.p) as f64;
        // Light sampling may pick the light more or less often than emission does.
        let picks = recipe.scene.selector.pmf(self.light.0) as f64 / pmf;
        let direct = recipe.scene.lights[self.light.0].pdf_li_le(&recipe.scene.light_context(), si.p, le) as f64;
        let cos_light = if le.finite { le.n.dot(le.ray.d) as f64 } else { 1.0 };
        let (dvcm, dvc) = if le.delta_position {
            (dist_sq / pdf_w, 0.0)
        } else if le.delta_direction {
            (1.0 / pdf_a, 0.0)
        } else {
            (direct * cos_light / (pdf_a * pdf_w), cos_light / (pmf * pdf_a * pdf_w))
        };
        Mis { dvcm: picks * dvcm / cos, dvc: recipe.connect * dvc / cos, pending: 0.0 }
    }

    /// The vertex just reached.
    #[inline(always)]
    pub fn vertex(&self, recipe: &Recipe, si: &SurfaceInteraction) -> LightVertex {
        let merges = self.focused && recipe.mergeable(si);
        LightVertex { si: *si, beta: self.beta, mis: self.mis, depth: self.depth, merges, links: 0 }
    }

    /// Scatters at `si` with Russian roulette; false ends the walk.
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
        let Some(s) = bsdf.sample(si.wo, u_lobe, u, Mode::Importance, LobeMask::ALL) else { return false };
        let before = self.beta;
        self.beta *= s.weight;
        if !self.beta.is_finite() || self.beta.is_black() {
            return false;
        }
        // Keep the powers of survivors alike.
        let kept = self.beta.max_channel() / before.max_channel();
        let survive = survival(kept, self.depth, recipe.settings.rr_depth);
        if survive < 1.0 {
            if sampler.next_1d() >= survive {
                return false;
            }
            self.beta *= 1.0 / survive;
        }
        let merge = if self.focused && recipe.mergeable(si) { eta } else { 0.0 };
        self.last = recipe.scatter(&mut self.mis, si, bsdf, &s, (merge, 0.0));
        self.from = si.p;
        self.focused = recipe.focuses(si);
        self.ray = si.spawn_ray(s.wi);
        true
    }
}

/// Where light paths leave what they find.
#[derive(Default)]
pub(super) struct LightSink {
    /// Vertices for connections, path after path.
    pub vertices: Vec<LightVertex>,
    /// Their bsdfs, where they are wanted.
    pub bsdfs: Vec<Bsdf>,
    /// Vertices for merging.
    pub photons: Vec<Photon>,
    /// Densities of all vertices, where weights are aware of correlation.
    pub links: Vec<Link>,
    pub splats: SplatBuffer,
    pub counters: Counters,
}

impl LightSink {
    /// Empties it and keeps its memory.
    pub fn clear(&mut self) {
        self.vertices.clear();
        self.bsdfs.clear();
        self.photons.clear();
        self.links.clear();
        self.splats.clear();
        self.counters = Counters::default();
    }
}

/// What [`trace`] is to collect.
#[derive(Clone, Copy)]
pub(super) struct Collect {
    pub vertices: bool,
    pub bsdfs: bool,
    pub splats: bool,
}

/// Follows one light path to its end.
#[inline(always)]
pub(super) fn trace(recipe: &Recipe, eta: f64, mut sampler: Sampler, collect: Collect, sink: &mut LightSink) {
    let Some(mut walk) = LightWalk::start(recipe, &mut sampler) else { return };
    let (correlated, links) = (recipe.settings.correlation_aware, sink.links.len());
    // A vertex is of use while one more edge fits into the longest path.
    while walk.depth + 1 < recipe.max_depth {
        let Some(si) = walk.advance(recipe, &mut sink.counters) else { return };
        if correlated {
            correlation::arrive_from_light(recipe, &mut sink.links, links, &walk, &si);
        }
        let bsdf = recipe.scene.bsdf(&si);
        if bsdf.lobes().intersects(LobeMask::SMOOTH) {
            let vertex = LightVertex { links: links as u32, ..walk.vertex(recipe, &si) };
            if collect.splats && recipe.settings.light_image {
                let u = if recipe.scene.camera.has_lens() { sampler.next_2d() } else { Default::default() };
                connect_to_lens(recipe, eta, &vertex, &bsdf, u, sink);
            }
            if collect.vertices {
                sink.vertices.push(vertex);
                if collect.bsdfs {
                    sink.bsdfs.push(bsdf);
                }
            }
            if vertex.merges {
                sink.photons.push(Photon {
                    p: si.p,
                    depth: vertex.depth,
                    wi: si.wo,
                    ng: si.ng,
                    beta: vertex.beta,
                    mis: vertex.mis,
                    links: vertex.links,
                });
            }
        }
        if !walk.scatter(recipe, &si, &bsdf, eta, &mut sampler) {
            return;
        }
        if correlated {
            correlation::leave(&mut sink.links, &walk.last, &si, walk.ray.d);
        }
    }
}

/// Splats what the lens receives from a light vertex, W·m⁻²·sr⁻¹ of a pixel.
#[inline(always)]
fn connect_to_lens(recipe: &Recipe, eta: f64, v: &LightVertex, bsdf: &Bsdf, u: Vec2, sink: &mut LightSink) {
    let (scene, si) = (recipe.scene, &v.si);
    // Light scattered off a hidden emitter does not show.
    if recipe.settings.hide_emitters && scene.is_emitter(si) {
        return;
    }
    let Some(we) = scene.camera.we(si.p, u) else { return };
    let Some(event) = Event::new(recipe, si, bsdf, we.wi, Mode::Importance) else { return };
    let w = match recipe.settings.camera_paths {
        true => {
            let links = recipe.settings.correlation_aware.then_some((&sink.links[..], we.dist as f64));
            weight(lens_sums(recipe, eta, v, (we.wi, we.importance), event.pdf, links))
        }
        false => 1.0,
    };
    let value = v.beta * event.f * (we.importance * w as f32 / recipe.light_paths as f32);
    sink.counters.shadow_rays += 1;
    if !lens_sees(recipe, si, we.start) {
        return;
    }
    if value.is_finite() {
        sink.splats.push(we.raster, value);
    } else {
        sink.counters.infinite_samples += 1;
    }
}

/// What the other techniques of a path that light tracing found amount to; `pdf` are the densities towards the lens. Weights
/// that are aware of correlation need the links of the path and the distance of the lens.
#[inline(always)]
pub(super) fn lens_sums(
    recipe: &Recipe,
    eta: f64,
    v: &LightVertex,
    (to_lens, importance): (Vec3, f32),
    pdf: Pdf,
    links: Option<(&[Link], f64)>,
) -> f64 {
    let pdf_a = importance as f64 * cosine(&v.si, to_lens);
    if let Some((links, distance)) = links {
        return correlation::lens_sums(recipe, eta, links, v, (pdf_a, pdf.rev), distance);
    }
    let merge = if v.merges { eta } else { 0.0 };
    let image = if v.depth == 1 { recipe.direct_image } else { 1.0 };
    side(&v.mis, pdf_a / (image * recipe.light_paths as f64), pdf.rev, merge)
}

/// Whether nothing stands between a vertex and the camera's near plane; hidden emitters do not.
pub(super) fn lens_sees(recipe: &Recipe, si: &SurfaceInteraction, start: Vec3) -> bool {
    let scene = recipe.scene;
    if !recipe.settings.hide_emitters {
        return scene.visible(si, (start, Vec3::ZERO, Vec3::ZERO));
    }
    let leave = |from: &SurfaceInteraction, w: Vec3| {
        let o = from.spawn_origin(w);
        Ray { inside: from.inside(w), ..Ray::segment(o, start - o, 1.0 - 1e-4) }
    };
    let mut ray = leave(si, start - si.p);
    loop {
        match scene.intersect(&mut ray) {
            None => return true,
            Some(hit) if scene.is_emitter(&hit) => ray = leave(&hit, ray.d),
            Some(_) => return false,
        }
    }
}
