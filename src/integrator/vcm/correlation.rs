//! Correlation-aware weights [Grittmann, Georgiev and Slusallek 2021, "Correlation-aware multiple importance sampling for
//! bidirectional rendering algorithms", §5].
//!
//! All merges at a camera vertex share the camera's path up to there: the balance heuristic takes `n` photons for `n`
//! independent samples, which they are not where the camera's path has less chance to come by than light has. The number of a merge at vertex
//! `i` is multiplied by `ρ = P_c / (P_c + P_l − P_c P_l)`, where `P_c` and `P_l` are the chances that paths from the camera and
//! from the light pass within a small area of each vertex up to `i`, products of `min(p A, 1)`. `A` is a disc of one degree as
//! seen from the camera, at the distance of the first vertex. Merges there are not correlated: `ρ = 1`.
//!
//! `ρ` depends on both ends, so that no sums can be carried along. Walks keep the densities of all their vertices, and weights
//! are computed from those of the full path. After a mirror the next vertex is certain, and its factor is 1.

use std::f64::consts::PI;

use super::Recipe;
use super::camera_path::CameraWalk;
use super::light_path::{LightVertex, LightWalk};
use super::step::{CameraVertex, Scattered, cosine};
use crate::bsdf::{LobeMask, Mode};
use crate::geometry::SurfaceInteraction;
use crate::light::LightLi;
use crate::math::Vec3;

/// `tan 1°`: radius of the area in question over the distance from the camera.
const SPREAD: f64 = 0.017_455_064_928_217_585;

/// What a walk knows of one of its vertices. The first link of a walk is its end on the light or the lens.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Link {
    /// Density per area with which the walk came here. At the lens: the distance of the first vertex. At a light: the density
    /// of light sampling.
    own: f64,
    /// Density per area with which a walk from the other end would come here, once the walk has left the next vertex.
    opposite: f64,
    /// What makes a density per steradian at the next vertex one per area of this one.
    back: f64,
    /// Scatters by a density. At a light: has an area.
    smooth: bool,
    mergeable: bool,
    focuses: bool,
}

/// The densities of a camera path, and of the light path that it is connected to.
#[derive(Clone, Copy)]
pub(super) struct Trails<'a> {
    pub camera: &'a [Link],
    /// Of all paths of a batch, one after the other.
    pub light: &'a [Link],
}

/// The surface reached, with the density of its coming about.
fn surface(recipe: &Recipe, si: &SurfaceInteraction, own: f64) -> Link {
    Link { own, mergeable: recipe.mergeable(si), focuses: recipe.focuses(si), ..Link::default() }
}

/// Carries `links` over the edge to the next surface; `last` is how the walk left the one before.
pub(super) fn arrive(recipe: &Recipe, links: &mut Vec<Link>, last: &Scattered, dist_sq: f64, si: &SurfaceInteraction) {
    links.last_mut().expect("links have a first one").back /= dist_sq;
    links.push(surface(recipe, si, last.fwd * cosine(si, si.wo) / dist_sq));
}

/// A walk leaves its last surface along `w`.
pub(super) fn leave(links: &mut [Link], last: &Scattered, si: &SurfaceInteraction, w: Vec3) {
    let [.., before, here] = links else { return };
    before.opposite = last.rev * before.back;
    here.smooth = !last.delta;
    here.back = cosine(si, w);
}

/// The camera's walk is about to come to `si`.
pub(super) fn arrive_from_camera(recipe: &Recipe, links: &mut Vec<Link>, walk: &CameraWalk, si: &SurfaceInteraction) {
    let dist_sq = walk.from.distance_squared(si.p) as f64;
    if links.is_empty() {
        let pdf = walk.first_pdf * cosine(si, si.wo) / if walk.parallel { 1.0 } else { dist_sq };
        links.push(Link { own: dist_sq.sqrt(), ..Link::default() });
        links.push(surface(recipe, si, pdf));
    } else {
        arrive(recipe, links, &walk.last, dist_sq, si);
    }
}

/// The light's walk, before it leaves, has come to `si`; its links begin at `start`.
pub(super) fn arrive_from_light(
    recipe: &Recipe,
    links: &mut Vec<Link>,
    start: usize,
    walk: &LightWalk,
    si: &SurfaceInteraction,
) {
    let dist_sq = walk.from.distance_squared(si.p) as f64;
    if links.len() > start {
        return arrive(recipe, links, &walk.last, dist_sq, si);
    }
    // The density of emission counts for both ends of the first edge.
    let (le, (index, pmf)) = (&walk.le, walk.light);
    let cos = cosine(si, si.wo);
    let (pdf_a, pdf_w) = (le.pdf_a as f64, le.pdf_w as f64);
    let picked = recipe.scene.selector.pmf(index) as f64;
    let emit = pmf as f64 * cos;
    let (direct, back, own) = if le.delta_position {
        (1.0, 0.0, emit * pdf_w / dist_sq)
    } else if le.delta_direction {
        (1.0, 0.0, emit * pdf_a)
    } else {
        let direct = recipe.scene.lights[index].pdf_li_le(&recipe.scene.light_context(), si.p, le) as f64;
        let back = if le.finite { le.n.dot(le.ray.d) as f64 / dist_sq } else { 1.0 };
        (direct * back, back, emit * pdf_a * pdf_w / if le.finite { dist_sq } else { 1.0 })
    };
    let area = le.finite && back > 0.0;
    links.push(Link { own: picked * direct, back, smooth: area, ..Link::default() });
    links.push(surface(recipe, si, own));
}

/// A full path, its surfaces from the light to the camera.
struct FullPath {
    x: Vec<Node>,
    /// Density of light sampling, and of the camera's walk meeting the light.
    direct: f64,
    hit: f64,
    /// Of the first surface from the camera.
    distance: f64,
    /// The light has an area.
    area: bool,
}

#[derive(Clone, Copy)]
struct Node {
    light: f64,
    camera: f64,
    smooth: bool,
    mergeable: bool,
    focuses: bool,
}

/// How a path was found.
#[derive(Clone, Copy)]
enum Found {
    Hit,
    /// By connecting the first so many vertices, the light's included, with the rest.
    Connected(usize),
    Lens,
    /// At this surface, counted from 1.
    Merged(usize),
}

impl Node {
    fn of_light(l: &Link) -> Self {
        Self { light: l.own, camera: l.opposite, smooth: l.smooth, mergeable: l.mergeable, focuses: l.focuses }
    }

    fn of_camera(l: &Link) -> Self {
        Self { light: l.opposite, camera: l.own, ..Self::of_light(l) }
    }
}

impl FullPath {
    /// The path of some surfaces from each end; what the ends know of each other is still missing.
    fn join(light: &[Link], camera: &[Link], distance: f64) -> Self {
        let from_light = light.iter().skip(1).map(Node::of_light);
        let x = from_light.chain(camera.iter().skip(1).rev().map(Node::of_camera)).collect();
        let end = light.first().copied().unwrap_or_default();
        Self { x, direct: end.own, hit: end.opposite, distance, area: end.smooth }
    }

    /// Sets what the camera's side makes of the vertex before surface `i` (from 1), or of the light.
    fn seen_from_camera(&mut self, i: usize, density: f64) {
        match i {
            1 => self.hit = density,
            _ => self.x[i - 2].camera = density,
        }
    }

    /// The factors of merges.
    fn correlation(&self) -> Vec<f64> {
        let x = &self.x;
        let a = PI * (self.distance * SPREAD).powi(2);
        let mut rho = vec![1.0; x.len()];
        let mut p = 1.0;
        for i in (0..x.len()).rev() {
            if x.get(i + 1).is_none_or(|next| next.smooth) {
                p *= (x[i].camera * a).min(1.0);
            }
            rho[i] = p;
        }
        let mut p = 1.0;
        for i in 0..x.len() {
            if i == 0 {
                p *= (x[0].light * a * if self.area { a } else { 1.0 }).min(1.0);
            } else if x[i - 1].smooth {
                p *= (x[i].light * a).min(1.0);
            }
            let both = rho[i] + p - rho[i] * p;
            rho[i] = if both > 0.0 && i + 1 < x.len() { rho[i] / both } else { 1.0 };
        }
        rho
    }

    /// What the other techniques amount to, relative to the one that found the path.
    fn others(&self, recipe: &Recipe, eta: f64, found: Found) -> f64 {
        let (x, k) = (&self.x, self.x.len() + 1);
        let rho = self.correlation();
        let count = recipe.light_paths as f64 * if x.len() == 1 { recipe.direct_image } else { 1.0 };
        let s = match found {
            Found::Hit => 1,
            Found::Connected(s) | Found::Merged(s) => s,
            Found::Lens => k,
        };
        let own = match found {
            Found::Hit => self.hit,
            Found::Connected(1) => self.direct,
            Found::Connected(_) => 1.0,
            Found::Lens => count,
            Found::Merged(i) => x[i - 1].light * eta * rho[i - 1],
        };
        // Densities of sampling the first vertices from the light and the others from the camera, over that at `s`.
        let mut r = vec![1.0; k + 1];
        for i in s..k {
            r[i + 1] = r[i] * x[i - 1].light / x[i - 1].camera;
        }
        for i in (1..s).rev() {
            r[i] = r[i + 1] * x[i - 1].camera / x[i - 1].light;
        }
        let mut sum = 0.0;
        if recipe.settings.connect {
            sum += r[1] * self.hit;
            if x[0].smooth {
                sum += r[1] * self.direct;
            }
            if recipe.settings.connect_vertices {
                sum += (2..k).filter(|&s| x[s - 2].smooth && x[s - 1].smooth).map(|s| r[s]).sum::<f64>();
            }
            if recipe.settings.light_image && x[k - 2].smooth {
                sum += r[k] * count;
            }
        }
        for i in 1..k {
            let focused = if i == 1 { recipe.merges_direct() } else { x[i - 2].focuses };
            if x[i - 1].smooth && x[i - 1].mergeable && focused {
                sum += r[i] * x[i - 1].light * eta * rho[i - 1];
            }
        }
        // The technique itself is among them, unless a merge joined surfaces of different kinds.
        (sum / own - 1.0).max(0.0)
    }
}

/// For a camera walk that met a light: `direct` and `emit` as for [`super::weights::emitter_hit`]. A distant light is no surface,
/// and the walk met it with the density `distant`.
pub(super) fn hit_sums(
    recipe: &Recipe,
    eta: f64,
    links: &[Link],
    (direct, emit): (f64, f64),
    distant: Option<f64>,
) -> f64 {
    let surfaces = if distant.is_some() { links } else { &links[..links.len() - 1] };
    let mut path = FullPath::join(&[], surfaces, links[0].own);
    path.direct = direct;
    path.hit = distant.unwrap_or(links[links.len() - 1].own);
    path.area = distant.is_none();
    path.x[0].light = emit * surfaces[surfaces.len() - 1].back;
    path.others(recipe, eta, Found::Hit)
}

/// As [`super::camera_path::next_event_sums`], from the densities that it has: emission and meeting the light, over light
/// sampling, and continuing to the vertex before.
pub(super) fn next_event_sums(
    recipe: &Recipe,
    trails: &Trails,
    eta: f64,
    index: usize,
    li: &LightLi,
    (ratio, hit, rev): (f64, f64, f64),
) -> f64 {
    let pmf = recipe.scene.selector.pmf(index) as f64;
    let (mut path, n) = (FullPath::join(&[], trails.camera, trails.camera[0].own), trails.camera.len());
    path.direct = if li.delta { pmf } else { pmf * li.pdf_w as f64 };
    path.area = !li.delta && li.dist.is_finite();
    if path.area {
        path.direct *= -li.n.dot(li.wi) as f64 / (li.dist as f64 * li.dist as f64);
    }
    path.hit = hit * path.direct;
    path.x[0].light = ratio * path.direct;
    path.x[0].smooth = true;
    if n > 2 {
        path.x[1].light = rev * trails.camera[n - 2].back;
    }
    path.others(recipe, eta, Found::Connected(1))
}

/// The links of a light path up to `light`.
fn links_of<'a>(all: &'a [Link], light: &LightVertex) -> &'a [Link] {
    &all[light.links as usize..][..light.depth as usize + 1]
}

/// As [`super::camera_path::connection_sums`]; `to_light` and `to_camera` are densities per area of either end by the other.
pub(super) fn connection_sums(
    recipe: &Recipe,
    trails: &Trails,
    eta: f64,
    light: &LightVertex,
    (to_light, light_rev): (f64, f64),
    (to_camera, camera_rev): (f64, f64),
) -> f64 {
    let (from_light, camera) = (links_of(trails.light, light), trails.camera);
    let mut path = FullPath::join(from_light, camera, camera[0].own);
    let s = light.depth as usize;
    path.x[s - 1].camera = to_light;
    path.x[s - 1].smooth = true;
    path.seen_from_camera(s, light_rev * from_light[s - 1].back);
    path.x[s].light = to_camera;
    path.x[s].smooth = true;
    if camera.len() > 2 {
        path.x[s + 1].light = camera_rev * camera[camera.len() - 2].back;
    }
    path.others(recipe, eta, Found::Connected(s + 1))
}

/// As [`super::light_path::lens_sums`]: `pdf_a` is the density of the vertex by camera rays, `distance` that of the lens.
pub(super) fn lens_sums(
    recipe: &Recipe,
    eta: f64,
    links: &[Link],
    light: &LightVertex,
    (pdf_a, rev): (f64, f64),
    distance: f64,
) -> f64 {
    let links = links_of(links, light);
    let mut path = FullPath::join(links, &[], distance);
    let s = light.depth as usize;
    path.x[s - 1].camera = pdf_a;
    path.x[s - 1].smooth = true;
    path.seen_from_camera(s, rev * links[s - 1].back);
    path.others(recipe, eta, Found::Lens)
}

/// What the techniques other than a merge of `v` with the last vertex of a light path amount to.
pub(super) fn merge_sums(recipe: &Recipe, v: &CameraVertex, camera: &[Link], light: &[Link], wi: Vec3) -> f64 {
    let bsdf = v.bsdf;
    let fwd = bsdf.pdf(v.si.wo, wi, Mode::Radiance, LobeMask::ALL) as f64;
    let rev = bsdf.pdf(wi, v.si.wo, Mode::Importance, LobeMask::ALL) as f64;
    let s = light.len() - 1;
    let mut path = FullPath::join(&light[..s], camera, camera[0].own);
    path.x[s - 1].light = light[s].own;
    path.x[s - 1].smooth = true;
    path.x[s - 1].mergeable = true;
    path.seen_from_camera(s, fwd * light[s - 1].back);
    if camera.len() > 2 {
        path.x[s].light = rev * camera[camera.len() - 2].back;
    }
    path.others(recipe, v.merge, Found::Merged(s))
}
