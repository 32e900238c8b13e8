//! Weights against brute force: every technique's density of a full path, multiplied up vertex by vertex.

mod means;
pub(super) mod scenes;

use std::f64::consts::PI;

use scenes::{DISTANT, FINITE, load};

use super::camera_path::{CameraWalk, connection_sums, escape_densities, hit_densities, next_event_sums};
use super::correlation::{self, Link, Trails};
use super::emission::{Emission, Learnt};
use super::event::{Event, Pdf};
use super::light_path::{LightVertex, LightWalk, lens_sums};
use super::step::{CameraVertex, Scattered, pdf_back};
use super::weights::{Mis, emitter_hit, merged_side, side, weight};
use super::{Merging, Recipe, VcmSettings};
use crate::bsdf::{Bsdf, LobeMask, Mode};
use crate::geometry::SurfaceInteraction;
use crate::light::Light;
use crate::math::{Vec2, Vec3};
use crate::sample::{Key, Purpose, Sampler, Sequence};
use crate::scene::Scene;
use crate::tally::Counters;

/// Index of refraction of the glass in these scenes.
const GLASS: f64 = 1.5;

/// Light and camera paths for each variant: about 6·10⁴ full paths in all, twice as many with `slow-tests`. Of 1.2·10⁶ one
/// was 1.06e-5 off: walks carry directions in f32, and it passed eight glass surfaces.
const TRIALS: u64 = if cfg!(feature = "slow-tests") { 2_000 } else { 1_000 };

/// A vertex of a full path.
#[derive(Clone, Copy)]
struct Vertex {
    p: Vec3,
    n: Vec3,
    /// `None` for the ends of the path.
    si: Option<SurfaceInteraction>,
    delta: bool,
}

/// A path from a light, vertex 0, to the camera, its last vertex.
struct FullPath {
    light: usize,
    x: Vec<Vertex>,
    /// Unit vectors from each vertex to the next.
    dir: Vec<Vec3>,
}

/// What each technique would have sampled a path with. `light[i]` and `camera[i]` are densities per area of vertex `i`
/// (per steradian for a light at infinity), sampled from the light's and from the camera's side.
struct Densities {
    light: Vec<f64>,
    camera: Vec<f64>,
    /// Of vertex 0 by light sampling.
    direct: f64,
}

/// The techniques, by the number of vertices from the light and for merges by the vertex that both sides sample.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Technique {
    Connect(usize),
    Merge(usize),
}

fn cos(n: Vec3, w: Vec3) -> f64 {
    n.dot(w).abs() as f64
}

fn dist_sq(a: Vec3, b: Vec3) -> f64 {
    (a.as_dvec3() - b.as_dvec3()).length_squared()
}

impl FullPath {
    fn bsdf(&self, scene: &Scene, i: usize, wo: Vec3) -> Bsdf {
        scene.bsdf(&SurfaceInteraction { wo, ..self.x[i].si.expect("a surface") })
    }

    /// Densities of leaving vertex `i` towards the camera having come from the light, and the other way. Of the two deltas
    /// of a discrete choice the first is left out and the second written in terms of it.
    fn scattering(&self, scene: &Scene, i: usize) -> (f64, f64) {
        let (wl, wc) = (-self.dir[i - 1], self.dir[i]);
        let (from_light, from_camera) = (self.bsdf(scene, i, wl), self.bsdf(scene, i, wc));
        let ng = self.x[i].n;
        if !self.x[i].delta {
            let pdf = |b: &Bsdf, wo, wi| b.pdf(wo, wi, Mode::Radiance, LobeMask::ALL) as f64;
            return (pdf(&from_light, wl, wc), pdf(&from_camera, wc, wl));
        }
        let transmit = ng.dot(wl) * ng.dot(wc) < 0.0;
        let straight = wl.dot(wc) < -1.0 + 1e-6 && from_light.lobes().intersects(LobeMask::NULL);
        let class = if straight { LobeMask::NULL } else { LobeMask::DELTA };
        let index = |w: Vec3| if ng.dot(w) > 0.0 || straight { 1.0 } else { GLASS };
        let compression =
            if transmit { cos(ng, wl) * index(wl).powi(2) / (cos(ng, wc) * index(wc).powi(2)) } else { 1.0 };
        (
            from_light.discrete_pdf(wl, class, transmit) as f64,
            from_camera.discrete_pdf(wc, class, transmit) as f64 * compression,
        )
    }

    fn densities(&self, recipe: &Recipe) -> Densities {
        let scene = recipe.scene;
        let k = self.x.len() - 1;
        let mut d = Densities { light: vec![0.0; k], camera: vec![0.0; k], direct: 0.0 };
        let x = &self.x;
        let (pmf, emits) = (scene.selector.pmf(self.light) as f64, scene.photon_selector.pmf(self.light) as f64);
        let radius = scene.bounding_sphere().1 as f64;
        let to_camera = |i: usize, w: Vec3| cos(x[i].n, w) / dist_sq(x[i].p, x[i + 1].p);
        let to_light = |i: usize, w: Vec3| cos(x[i].n, w) / dist_sq(x[i].p, x[i - 1].p);
        // The light's end.
        let cos_light = cos(x[0].n, self.dir[0]);
        let mut infinite = false;
        match &scene.lights[self.light] {
            Light::Area(a) => {
                d.light[0] = emits / a.area();
                d.light[1] = cos_light / PI * to_light(1, self.dir[0]);
                d.direct = match &scene.geometry.shapes[a.shape as usize] {
                    crate::geometry::Shape::Sphere(s) => {
                        let sin_sq = (s.radius as f64).powi(2) / dist_sq(s.center, x[1].p);
                        let cone = 2.0 * PI * (1.0 - (1.0 - sin_sq).sqrt());
                        pmf / cone * to_camera(0, self.dir[0])
                    }
                    _ => pmf / a.area(),
                };
            }
            Light::Point(_) => {
                d.light[0] = emits;
                d.light[1] = 0.25 / PI * to_light(1, self.dir[0]);
                d.direct = pmf;
            }
            Light::Directional(_) | Light::Constant(_) => {
                infinite = true;
                let light = &scene.lights[self.light];
                d.light[0] = if light.is_delta() { emits } else { emits * 0.25 / PI };
                d.light[1] = cos(x[1].n, self.dir[0]) / (PI * radius * radius);
                // Light samples follow where the sky is seen from; `light/` tests that density.
                let seen = || light.pdf_li_env(&scene.light_context(), x[1].p, -self.dir[0]) as f64;
                d.direct = if light.is_delta() { pmf } else { pmf * seen() };
            }
            _ => unreachable!("not in these scenes"),
        }
        d.light[0] *= recipe.emission_density(self.light, x[0].p, x[0].n, self.dir[0]);
        // The camera's end.
        let last = k - 1;
        d.camera[last] = if scene.camera.is_orthographic() {
            scene.camera.pdf_lens() as f64 * cos(x[last].n, self.dir[last])
        } else {
            let (_, pdf_w) = scene.camera.pdf_we(x[k].p, -self.dir[last]).expect("on the film");
            pdf_w as f64 * to_camera(last, self.dir[last])
        };
        // All in between.
        for i in 1..k {
            let (towards_camera, towards_light) = self.scattering(scene, i);
            if i < last {
                d.light[i + 1] = towards_camera * to_light(i + 1, self.dir[i]);
            }
            d.camera[i - 1] = match i {
                1 if scene.lights[self.light].is_delta() => 0.0,
                1 if infinite => towards_light,
                _ => towards_light * to_camera(i - 1, self.dir[i - 1]),
            };
        }
        d
    }

    /// The factor of a merge at vertex `i` [Grittmann 2021].
    fn correlation(&self, recipe: &Recipe, d: &Densities, i: usize) -> f64 {
        let k = self.x.len() - 1;
        if i == k - 1 {
            return 1.0;
        }
        let a = PI * dist_sq(self.x[k].p, self.x[k - 1].p) * 1f64.to_radians().tan().powi(2);
        // Mirrors leave no choice of the next vertex.
        let chance = |density: f64, from: usize| if self.x[from].delta { 1.0 } else { (density * a).min(1.0) };
        let camera: f64 = (i..k).map(|j| chance(d.camera[j], j + 1)).product();
        let light = &recipe.scene.lights[self.light];
        let end = if light.is_delta() || light.is_distant() { a } else { a * a };
        let light =
            (2..=i).map(|j| chance(d.light[j], j - 1)).product::<f64>() * (d.light[0] * d.light[1] * end).min(1.0);
        camera / (camera + light - camera * light)
    }

    /// Light paths that weights take to splat such paths.
    fn image_count(&self, recipe: &Recipe) -> f64 {
        recipe.light_paths as f64 * if self.x.len() == 3 { recipe.direct_image } else { 1.0 }
    }

    /// All techniques with the number of times that each is tried times its density.
    fn techniques(&self, recipe: &Recipe, d: &Densities, eta: f64) -> Vec<(Technique, f64)> {
        let k = self.x.len() - 1;
        let smooth = |i: usize| !self.x[i].delta;
        let mut all = Vec::new();
        let camera = |first: usize| d.camera[first..].iter().product::<f64>();
        let light = |end: usize| d.light[..end].iter().product::<f64>();
        if recipe.settings.connect {
            all.push((Technique::Connect(0), camera(0)));
            if k >= 2 && smooth(1) {
                all.push((Technique::Connect(1), d.direct * camera(1)));
            }
            for s in 2..k {
                if smooth(s - 1) && smooth(s) && recipe.settings.connect_vertices {
                    all.push((Technique::Connect(s), light(s) * camera(s)));
                }
            }
            if k >= 2 && smooth(k - 1) && recipe.settings.light_image {
                all.push((Technique::Connect(k), light(k) * self.image_count(recipe)));
            }
        }
        for i in 1..k {
            let si = self.x[i].si.expect("a surface");
            let focused =
                if i == 1 { recipe.merges_direct() } else { recipe.focuses(&self.x[i - 1].si.expect("a surface")) };
            if smooth(i) && recipe.mergeable(&si) && focused {
                let rho = if recipe.settings.correlation_aware { self.correlation(recipe, d, i) } else { 1.0 };
                all.push((Technique::Merge(i), light(i + 1) * camera(i) * eta * rho));
            }
        }
        all
    }

    /// The partial sums that walks from both ends have on arrival at each vertex.
    fn replay(&self, recipe: &Recipe, d: &Densities, eta: f64) -> (Vec<Mis>, Vec<Mis>) {
        let scene = recipe.scene;
        let k = self.x.len() - 1;
        let merge_at = |i: usize, from: usize| {
            let focused = self.x[from].si.map_or(recipe.merges_direct(), |si| recipe.focuses(&si));
            if focused && recipe.mergeable(&self.x[i].si.expect("a surface")) { eta } else { 0.0 }
        };
        let scatter = |mis: &mut Mis, i: usize, out: Vec3, (fwd, rev): (f64, f64), now: f64, later: f64| {
            if self.x[i].delta {
                mis.scatter_delta(cos(self.x[i].n, out) * rev / fwd);
            } else {
                mis.scatter(cos(self.x[i].n, out), (fwd, rev), recipe.connect, (now, later));
            }
        };
        // From the light: emission is what would have sampled vertices 0 and 1.
        let mut light = vec![Mis::default(); k];
        if k > 1 {
            let emit = d.light[0] * d.light[1];
            let hit = if scene.lights[self.light].is_delta() {
                0.0
            } else if scene.lights[self.light].is_distant() {
                1.0
            } else {
                cos(self.x[0].n, self.dir[0]) / dist_sq(self.x[0].p, self.x[1].p)
            };
            light[1] = Mis { dvcm: d.direct / emit, dvc: recipe.connect * hit / emit, pending: 0.0 };
            for i in 1..k - 1 {
                let mut mis = light[i];
                scatter(&mut mis, i, self.dir[i], self.scattering(scene, i), merge_at(i, i - 1), 0.0);
                mis.arrive(dist_sq(self.x[i].p, self.x[i + 1].p), cos(self.x[i + 1].n, self.dir[i]));
                recipe.settle(&mut mis, i as u32 + 1);
                light[i + 1] = mis;
            }
        }
        // From the camera.
        let mut camera = vec![Mis::default(); k];
        let image = recipe.settings.light_image as u8 as f64;
        camera[k - 1].dvcm = image * self.image_count(recipe) / d.camera[k - 1];
        for i in (1..k).rev() {
            let mut mis = camera[i];
            let (fwd, rev) = self.scattering(scene, i);
            scatter(&mut mis, i, self.dir[i - 1], (rev, fwd), 0.0, merge_at(i, i - 1));
            if i > 1 || !scene.lights[self.light].is_distant() {
                mis.arrive(dist_sq(self.x[i].p, self.x[i - 1].p), cos(self.x[i - 1].n, self.dir[i - 1]));
            }
            mis.resolve(true);
            if i > 1 {
                recipe.settle(&mut mis, (k - i + 1) as u32);
            }
            camera[i - 1] = mis;
        }
        (light, camera)
    }

    /// The weight of one technique by the recurrences.
    fn weight_of(&self, recipe: &Recipe, t: Technique, d: &Densities, eta: f64) -> f64 {
        let k = self.x.len() - 1;
        let (light, camera) = self.replay(recipe, d, eta);
        let merge_at = |i: usize| {
            let focused = self.x[i - 1].si.map_or(recipe.merges_direct(), |si| recipe.focuses(&si));
            if focused && recipe.mergeable(&self.x[i].si.expect("a surface")) { eta } else { 0.0 }
        };
        let rev = |i: usize| self.scattering(recipe.scene, i);
        weight(match t {
            Technique::Connect(0) => {
                // Light sampling counts like the end of the path does: per area, or per steradian at infinity.
                let emit = if recipe.scene.lights[self.light].is_distant() {
                    d.light[0] * d.light[1] / cos(self.x[1].n, self.dir[0])
                } else {
                    d.light[0] * d.light[1] * dist_sq(self.x[0].p, self.x[1].p) / cos(self.x[1].n, self.dir[0])
                };
                emitter_hit(&camera[0], d.direct, emit)
            }
            Technique::Connect(1) => {
                let hit = d.camera[0] / d.direct;
                hit + side(&camera[1], d.light[0] * d.light[1] / d.direct, rev(1).0, merge_at(1))
            }
            Technique::Connect(s) if s == k => {
                side(&light[k - 1], d.camera[k - 1] / self.image_count(recipe), rev(k - 1).1, merge_at(k - 1))
            }
            Technique::Connect(s) => {
                side(&light[s - 1], d.camera[s - 1], rev(s - 1).1, merge_at(s - 1))
                    + side(&camera[s], d.light[s], rev(s).0, merge_at(s))
            }
            Technique::Merge(i) => {
                merged_side(&light[i], rev(i).1, recipe.connect, eta)
                    + merged_side(&camera[i], rev(i).0, recipe.connect, eta)
            }
        })
    }
}

/// A sub-path as it was walked.
struct Walked {
    /// Vertex 0 is the light's or the camera's.
    x: Vec<Vertex>,
    /// Leaving each vertex.
    dir: Vec<Vec3>,
    /// On arrival at each vertex but the first.
    mis: Vec<Mis>,
    light: usize,
    links: Vec<Link>,
}

const LONGEST: usize = 6;

fn vertex(si: &SurfaceInteraction) -> Vertex {
    Vertex { p: si.p, n: si.ng, si: Some(*si), delta: false }
}

fn walk_from_light(recipe: &Recipe, eta: f64, sampler: &mut Sampler) -> Option<Walked> {
    let mut walk = LightWalk::start(recipe, sampler)?;
    let end = Vertex { p: walk.le.p, n: walk.le.n, si: None, delta: false };
    let mut w =
        Walked { x: vec![end], dir: vec![walk.ray.d], mis: vec![Mis::default()], light: walk.light.0, links: vec![] };
    while w.x.len() < LONGEST {
        let Some(si) = walk.advance(recipe, &mut Counters::default()) else { break };
        w.x.push(vertex(&si));
        w.mis.push(walk.mis);
        correlation::arrive_from_light(recipe, &mut w.links, 0, &walk, &si);
        if !walk.scatter(recipe, &si, &recipe.scene.bsdf(&si), eta, sampler) {
            break;
        }
        correlation::leave(&mut w.links, &walk.last, &si, walk.ray.d);
        w.x.last_mut().expect("just pushed").delta = walk.mis.dvcm == 0.0;
        w.dir.push(walk.ray.d);
    }
    Some(w)
}

/// The paths that a walk from the camera and what it meets make.
struct Trial<'a> {
    recipe: &'a Recipe<'a>,
    eta: f64,
    /// Paths by technique: connections, light sampling, light tracing, lights met.
    counts: [u64; 4],
    worst: f64,
    /// Merges whose weights were compared.
    merges: u64,
}

impl Trial<'_> {
    fn smooth(&self, v: &Vertex, wo: Vec3, wi: Vec3, mode: Mode) -> bool {
        let si = SurfaceInteraction { wo, ..v.si.expect("a surface") };
        !self.recipe.scene.bsdf(&si).eval(wo, wi, mode, LobeMask::ALL).is_black()
    }

    fn pdf(&self, si: &SurfaceInteraction, wi: Vec3, mode: Mode) -> Pdf {
        Event::new(self.recipe, si, &self.recipe.scene.bsdf(si), wi, mode).expect("it scatters").pdf
    }

    /// The path of light vertices `..s` and camera vertices `..t` (the camera counts), joined along `w` from light to
    /// camera. The vertices at the joint scatter by a density.
    fn join(&self, light: &Walked, s: usize, camera: &Walked, t: usize, w: Vec3) -> FullPath {
        let mut x: Vec<Vertex> = light.x[..s].to_vec();
        let mut dir = light.dir[..s - 1].to_vec();
        x[s - 1].delta = false;
        dir.push(w);
        let mut first = true;
        for i in (0..t).rev() {
            x.push(Vertex { delta: camera.x[i].delta && !first, ..camera.x[i] });
            first = false;
            if i > 0 {
                dir.push(-camera.dir[i - 1]);
            }
        }
        FullPath { light: light.light, x, dir }
    }

    /// Compares the weight of a path with brute force, and all weights of that path with one another.
    fn check(&mut self, path: &FullPath, technique: Technique, measured: f64) {
        let d = path.densities(self.recipe);
        let all = path.techniques(self.recipe, &d, self.eta);
        let total: f64 = all.iter().map(|t| t.1).sum();
        if !(total > 0.0 && total.is_finite()) {
            return;
        }
        let brute = |t: Technique| all.iter().find(|a| a.0 == t).map_or(0.0, |a| a.1 / total);
        if self.recipe.settings.connect {
            let off = (brute(technique) - measured).abs();
            assert!(
                off < 1e-5,
                "{technique:?} of {}: {} by brute force, {measured}",
                path.describe(),
                brute(technique)
            );
            self.worst = self.worst.max(off);
        }
        let mut sum = if self.recipe.settings.correlation_aware { 1.0 } else { 0.0 };
        // Without partial sums there is nothing to replay.
        let replayed = if sum == 0.0 { &all[..] } else { &[] };
        for &(t, density) in replayed.iter().filter(|t| t.1 > 0.0) {
            let w = path.weight_of(self.recipe, t, &d, self.eta);
            assert!((w - density / total).abs() < 1e-5, "{t:?} of {}: {} and {w}", path.describe(), density / total);
            sum += w;
        }
        assert!((sum - 1.0).abs() < 1e-5, "{}: weights sum to {sum}", path.describe());
        self.counts[match technique {
            Technique::Connect(0) => 3,
            Technique::Connect(1) => 1,
            Technique::Connect(s) if s == path.x.len() - 1 => 2,
            _ => 0,
        }] += 1;
    }

    /// Compares the sums that a walk carried with those of the path's densities.
    fn check_sums(&self, path: &FullPath, light: &Walked, s: usize) {
        let d = path.densities(self.recipe);
        let (replayed, _) = path.replay(self.recipe, &d, self.eta);
        for (i, (a, b)) in replayed.iter().zip(&light.mis).enumerate().take(s).skip(1) {
            // Walks carry points and directions in f32.
            let alike = |a: f64, b: f64| (a - b).abs() <= 1e-4 * a.abs().max(b.abs());
            assert!(alike(a.dvcm, b.dvcm) && alike(a.dvc, b.dvc), "vertex {i} of {}: {a:?}, {b:?}", path.describe());
        }
    }

    /// One light path with one camera path.
    fn run(&mut self, index: u64) {
        let (recipe, scene) = (self.recipe, self.recipe.scene);
        let sampler = |purpose| Sampler::new(Sequence::Independent, Key::new(7, purpose, 0), index);
        let mut numbers = sampler(Purpose::Test);
        let light = walk_from_light(recipe, self.eta, &mut sampler(Purpose::LightPath));
        // Light tracing.
        if let (Some(l), true) = (&light, recipe.settings.light_image) {
            for s in 2..=l.x.len() {
                let v = &l.x[s - 1];
                let si = v.si.expect("a surface");
                let Some(we) = scene.camera.we(v.p, Vec2::splat(0.5)) else { continue };
                if self.smooth(v, si.wo, we.wi, Mode::Importance) {
                    let camera = Walked {
                        x: vec![Vertex { p: we.lens, n: Vec3::ZERO, si: None, delta: false }],
                        dir: vec![],
                        mis: vec![],
                        light: 0,
                        links: vec![],
                    };
                    let path = self.join(l, s, &camera, 1, we.wi);
                    let sums = lens_sums(
                        recipe,
                        self.eta,
                        &self.light_vertex(l, s - 1),
                        (we.wi, we.importance),
                        self.pdf(&si, we.wi, Mode::Importance),
                        recipe.settings.correlation_aware.then_some((&l.links[..], we.dist as f64)),
                    );
                    self.check(&path, Technique::Connect(s), weight(sums));
                    self.check_sums(&path, l, s);
                }
            }
        }
        // Walk from the camera and use every vertex.
        let mut random = sampler(Purpose::Camera);
        let camera_ray = scene.camera_ray(random.next_2d() * 16.0, random.next_2d());
        let mut walk = CameraWalk::start(recipe, &camera_ray);
        let lens = Vertex { p: camera_ray.lens, n: Vec3::ZERO, si: None, delta: false };
        let mut c = Walked { x: vec![lens], dir: vec![], mis: vec![], light: 0, links: vec![] };
        while c.x.len() < LONGEST {
            c.dir.push(walk.ray.d);
            let from = walk.from;
            let Some(si) = scene.intersect(&mut walk.ray) else {
                if let (Some(index), true) = (scene.environment, c.x.len() > 1) {
                    let d = walk.ray.d;
                    let end = Vertex { p: from, n: -d, si: None, delta: false };
                    let l = Walked { x: vec![end], dir: vec![], mis: vec![], light: index as usize, links: vec![] };
                    let (direct, emit) = escape_densities(recipe, from, d);
                    walk.depth += 1;
                    let path = self.join_hit(&l, &c, -d);
                    let w = walk.hit_weight(recipe, self.eta, &c.links, (direct, emit), true);
                    self.check(&path, Technique::Connect(0), w as f64);
                }
                break;
            };
            correlation::arrive_from_camera(recipe, &mut c.links, &walk, &si);
            walk.arrive(&si);
            if let (Some(index), true) = (scene.shape_lights[si.shape as usize], c.x.len() > 1)
                && si.wo.dot(si.ng) > 0.0
            {
                let end = Vertex { p: si.p, n: si.ng, si: None, delta: false };
                let l = Walked { x: vec![end], dir: vec![], mis: vec![], light: index as usize, links: vec![] };
                let (direct, emit) = hit_densities(recipe, &si, from);
                let path = self.join_hit(&l, &c, si.wo);
                let w = walk.hit_weight(recipe, self.eta, &c.links, (direct, emit), false);
                self.check(&path, Technique::Connect(0), w as f64);
            }
            walk.mis.resolve(recipe.focuses(&si));
            recipe.settle(&mut walk.mis, walk.depth);
            c.x.push(vertex(&si));
            self.use_vertex(&c, &walk, &si, light.as_ref(), &mut numbers);
            if !walk.scatter(recipe, &si, &scene.bsdf(&si), self.eta, &mut random) {
                break;
            }
            correlation::leave(&mut c.links, &walk.last, &si, walk.ray.d);
            c.x.last_mut().expect("just pushed").delta = walk.mis.dvcm == 0.0;
        }
    }

    /// A path that ends on a light; all its surfaces scatter as they did.
    fn join_hit(&self, light: &Walked, camera: &Walked, w: Vec3) -> FullPath {
        let t = camera.x.len();
        let mut path = self.join(light, 1, camera, t, w);
        path.x[1].delta = camera.x[t - 1].delta;
        path
    }

    fn light_vertex(&self, l: &Walked, i: usize) -> LightVertex {
        let si = l.x[i].si.expect("a surface");
        let focused = l.x[i - 1].si.map_or(self.recipe.merges_direct(), |si| self.recipe.focuses(&si));
        let merges = focused && self.recipe.mergeable(&si);
        LightVertex { si, beta: crate::color::Rgb::WHITE, mis: l.mis[i], depth: i as u32, merges, links: 0 }
    }

    /// Light sampling and connections from the last vertex of `c`.
    fn use_vertex(
        &mut self,
        c: &Walked,
        walk: &CameraWalk,
        si: &SurfaceInteraction,
        light: Option<&Walked>,
        numbers: &mut Sampler,
    ) {
        let (recipe, scene) = (self.recipe, self.recipe.scene);
        let t = c.x.len();
        let bsdf = scene.bsdf(si);
        let merge = if recipe.mergeable(si) { self.eta } else { 0.0 };
        let links = light.map_or(&[][..], |l| &l.links);
        let trails = recipe.settings.correlation_aware.then_some(Trails { camera: &c.links, light: links });
        let v = CameraVertex { si, bsdf: &bsdf, mis: &walk.mis, depth: walk.depth, merge, trails };
        if let Some((index, _)) = scene.selector.sample(numbers.next_1d())
            && let Some(li) = scene.lights[index].sample_li(&scene.light_context(), si.p, numbers.next_2d())
            && self.smooth(&c.x[t - 1], si.wo, li.wi, Mode::Radiance)
        {
            let end = Vertex { p: li.p, n: li.n, si: None, delta: false };
            let l = Walked { x: vec![end], dir: vec![], mis: vec![], light: index, links: vec![] };
            let path = self.join(&l, 1, c, t, -li.wi);
            let pdf = self.pdf(si, li.wi, Mode::Radiance);
            let sums = next_event_sums(recipe, &v, self.eta, (index, &li), pdf);
            self.check(&path, Technique::Connect(1), weight(sums));
        }
        let Some(l) = light else { return };
        if recipe.settings.connect && !recipe.settings.connect_vertices {
            return;
        }
        for s in 2..=l.x.len() {
            let end = l.x[s - 1].si.expect("a surface");
            let d = end.p - si.p;
            let w = d / d.length();
            if self.smooth(&c.x[t - 1], si.wo, w, Mode::Radiance)
                && self.smooth(&l.x[s - 1], end.wo, -w, Mode::Importance)
            {
                let path = self.join(l, s, c, t, -w);
                let z = self.light_vertex(l, s - 1);
                let between = (w, d.length_squared() as f64);
                let pdfs = (self.pdf(si, w, Mode::Radiance), self.pdf(&end, -w, Mode::Importance));
                let sums = connection_sums(recipe, &v, &z, pdfs, between, self.eta);
                self.check(&path, Technique::Connect(s), weight(sums));
                self.check_sums(&path, l, s);
                if recipe.settings.correlation_aware {
                    self.check_merge(&path, &v, &c.links, (l, s), w);
                }
            }
        }
    }

    /// The light path goes on to the camera's vertex `v`, along −`w`, and is merged there.
    fn check_merge(&mut self, path: &FullPath, v: &CameraVertex, camera: &[Link], (l, s): (&Walked, usize), w: Vec3) {
        let recipe = self.recipe;
        let d = path.densities(recipe);
        let all = path.techniques(recipe, &d, self.eta);
        let total: f64 = all.iter().map(|t| t.1).sum();
        let Some((_, density)) = all.iter().find(|t| t.0 == Technique::Merge(s)) else { return };
        let y = l.x[s - 1].si.expect("a surface");
        let bsdf = recipe.scene.bsdf(&y);
        let last = Scattered {
            fwd: bsdf.pdf(y.wo, -w, Mode::Importance, LobeMask::ALL) as f64,
            rev: pdf_back(recipe, &y, &bsdf, -w, y.wo),
            delta: false,
        };
        let mut links = l.links[..s].to_vec();
        correlation::leave(&mut links, &last, &y, -w);
        let photon = SurfaceInteraction { wo: w, ..*v.si };
        correlation::arrive(recipe, &mut links, &last, (y.p - v.si.p).length_squared() as f64, &photon);
        let (measured, brute) = (weight(correlation::merge_sums(recipe, v, camera, &links, w)), density / total);
        assert!((measured - brute).abs() < 1e-5, "merge {s} of {}: {brute}, {measured}", path.describe());
        self.merges += 1;
    }
}

impl FullPath {
    fn describe(&self) -> String {
        let name =
            |v: &Vertex| v.si.map_or("end".into(), |si| format!("{}{}", si.shape, if v.delta { "δ" } else { "" }));
        format!("light {} {:?}", self.light, self.x.iter().map(name).collect::<Vec<_>>())
    }
}

fn check_all(scene: &Scene) {
    let any = VcmSettings { initial_radius: Some(0.05), guided_emission: false, ..VcmSettings::default() };
    let variants = [
        ("focused", any),
        ("all", VcmSettings { merging: Merging::All, ..any }),
        ("bdpt", VcmSettings { merging: Merging::Off, ..any }),
        ("no light image", VcmSettings { light_image: false, ..any }),
        ("no vertices connected", VcmSettings { connect_vertices: false, ..any }),
        ("no vertices connected, all", VcmSettings { connect_vertices: false, merging: Merging::All, ..any }),
        ("light samples", VcmSettings { connect_vertices: false, light_image: false, merging: Merging::Off, ..any }),
        ("bpm", VcmSettings { connect: false, ..any }),
        ("guided", VcmSettings { guided_emission: true, ..any }),
        ("more light paths", VcmSettings { light_paths: Some(3), ..any }),
        (
            "guided, correlated, all",
            VcmSettings { guided_emission: true, merging: Merging::All, correlation_aware: true, ..any },
        ),
        ("correlated, focused", VcmSettings { correlation_aware: true, ..any }),
        ("correlated, all", VcmSettings { correlation_aware: true, merging: Merging::All, ..any }),
        ("correlated, no light image", VcmSettings { correlation_aware: true, light_image: false, ..any }),
        ("correlated, bpm", VcmSettings { correlation_aware: true, connect: false, ..any }),
    ];
    for (name, settings) in variants {
        let mut recipe = Recipe::new(scene, &settings);
        let emission = Emission::try_out(&recipe).map(|e| e.0);
        assert_eq!(emission.is_some(), settings.guided_emission, "{name}");
        recipe.learn(&Learnt { emission, guidance: None, per_pixel: settings.light_paths.unwrap_or(1) });
        let eta = PI * recipe.first_radius.powi(2) * recipe.light_paths as f64;
        let mut trial = Trial { recipe: &recipe, eta, counts: [0; 4], worst: 0.0, merges: 0 };
        for index in 0..TRIALS {
            trial.run(index);
        }
        let connected = trial.counts[0] > TRIALS / 10 || (settings.connect && !settings.connect_vertices);
        assert!(trial.merges > TRIALS / 10 || !settings.correlation_aware, "{name}: {} merges", trial.merges);
        assert!(connected && trial.counts[1] > TRIALS / 10, "{name}: {:?}", trial.counts);
    }
}

#[test]
fn weights_are_those_of_brute_force() {
    check_all(&load("perspective", FINITE));
}

#[test]
fn weights_are_those_of_brute_force_at_infinity() {
    check_all(&load("orthographic", DISTANT));
}

/// Light paths leave the lamps in other proportions than light sampling picks them.
#[test]
fn weights_are_those_of_brute_force_where_photons_are_shared_out() {
    let share = r#"<float name="photon_share" value="0.55"/></emitter>"#;
    let point = FINITE.rfind("</emitter>").expect("the point light is the last");
    check_all(&load("perspective", &format!("{}{share}", &FINITE[..point])));
    check_all(&load("orthographic", &DISTANT.replacen("</emitter>", share, 1)));
}
