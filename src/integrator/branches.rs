//! Lights seen in glass: camera paths that split where a surface both mirrors and lets through.
//!
//! A path that picks one way at each interface meets the image of a small lamp behind a chain of unlikely ways now and then, and
//! brings its whole radiance: a bright pixel that passes do not average out. Light that comes from an emitter by discrete choices
//! alone is therefore summed over all ways, as in Whitted's ray tracing, from the first vertex with two of them. The path itself
//! goes one of them, for everything else and for this light with the share that it has; branches go the others. Branches that
//! carry little end by Russian roulette: those that survive weigh a set share of what came to the first vertex. As reflection
//! and transmission share what there is, there are at most as many branches of one length, on average, as the inverse of that
//! share. It is the smaller the brighter the lights are beside what they light ([`Scene::light_contrast`]); where they are hardly
//! brighter nothing is split.

use super::MaxDepth;
use crate::bsdf::{Bsdf, BsdfSample, LobeMask, Mode};
use crate::color::Rgb;
use crate::geometry::{Ray, SurfaceInteraction};
use crate::sample::{Purpose, Sampler, mix64};
use crate::scene::Scene;
use crate::shoot::survival;
use crate::tally::Counters;

/// Branches below this share of the path that split are left to Russian roulette.
pub(super) const LEAST: f32 = 0.1;
/// The same where a camera sample costs much else, so that there are few of them.
pub(super) const LEAST_OF_FEW: f32 = 0.03;

/// A light counts as bright that is so many times as bright as what the scene's lights make of white surfaces.
const BRIGHT: f32 = 20.0;

/// Follows the light that comes to the camera by discrete choices alone.
#[derive(Clone, Copy, Debug)]
pub(super) struct Discrete {
    state: State,
    /// What lights that the path meets now count: the probability of its choices since it split.
    share: f32,
    /// Branches that carry less are left to Russian roulette; until it splits, as a share of the path.
    least: f32,
    bits: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// The path has made discrete choices only, none of them between two ways.
    Whole,
    /// It went one way, and branches went the others.
    Split,
    /// It has made another choice, or no light is bright enough.
    Over,
}

/// Where a camera path is, and what it carries.
pub(super) struct Place<'a> {
    pub si: &'a SurfaceInteraction,
    pub bsdf: &'a Bsdf,
    pub beta: Rgb,
    /// Relative indices crossed, multiplied.
    pub eta: f32,
    /// Edges from the camera.
    pub depth: u32,
    pub max_depth: MaxDepth,
}

impl Discrete {
    /// At the camera; `least` is [`LEAST`] or [`LEAST_OF_FEW`].
    #[inline(always)]
    pub fn start(scene: &Scene, least: f32) -> Self {
        let state = if scene.light_contrast() > BRIGHT { State::Whole } else { State::Over };
        Self { state, least, ..Self::off() }
    }

    /// Never splits.
    #[inline(always)]
    pub fn off() -> Self {
        Self { state: State::Over, share: 1.0, least: 0.0, bits: 0 }
    }

    /// What a light counts that the path meets now; branches have found the rest.
    #[inline(always)]
    pub fn share(&self) -> f32 {
        self.share
    }

    /// Tells how the path goes on at a vertex, if it does; the light that branches into the other ways find, one estimate.
    #[inline(always)]
    pub fn scatter(
        &mut self,
        scene: &Scene,
        at: &Place,
        chosen: Option<&BsdfSample>,
        sampler: &Sampler,
        counters: &mut Counters,
    ) -> Rgb {
        if self.state == State::Over {
            return Rgb::BLACK;
        }
        let mut light = Rgb::BLACK;
        if at.bsdf.lobes().intersects(!LobeMask::SMOOTH) {
            light = self.branch(scene, at, chosen, sampler, counters);
        }
        if chosen.is_none_or(|s| s.lobe.intersects(LobeMask::SMOOTH)) {
            *self = Self::off();
        }
        light
    }

    #[inline(never)]
    fn branch(
        &mut self,
        scene: &Scene,
        at: &Place,
        chosen: Option<&BsdfSample>,
        sampler: &Sampler,
        counters: &mut Counters,
    ) -> Rgb {
        if self.state == State::Whole {
            if !at.bsdf.has_discrete_ways() {
                return Rgb::BLACK;
            }
            self.state = State::Split;
            self.least = self.least.max(BRIGHT / scene.light_contrast()) * at.beta.max_channel() * at.eta * at.eta;
            self.bits = sampler.bits_aside(Purpose::Branch);
        }
        let mut waiting = Vec::new();
        let followed = self.fork(&Place { beta: at.beta * self.share, ..*at }, chosen, &mut waiting);
        self.share *= if followed { chosen.map_or(0.0, |s| s.pdf) } else { 0.0 };
        let max_depth = at.max_depth.unwrap_or(u32::MAX);
        let mut sum = Rgb::BLACK;
        while let Some(Branch { mut ray, beta, eta, depth }) = waiting.pop() {
            if depth >= max_depth {
                continue;
            }
            counters.camera_rays += 1;
            let Some(hit) = scene.hit(&mut ray) else {
                sum += beta * scene.environment_radiance(ray.d);
                continue;
            };
            let si = scene.interaction(&ray, &hit);
            if scene.is_emitter(&si) {
                sum += beta * scene.emitted(&si, si.wo);
            }
            if depth + 1 < max_depth {
                let bsdf = scene.bsdf(&si);
                let place = Place { si: &si, bsdf: &bsdf, beta, eta, depth: depth + 1, max_depth: at.max_depth };
                self.fork(&place, None, &mut waiting);
            }
        }
        sum
    }

    /// Sends branches all ways that are worth it, but the one that was chosen; tells whether that is among them.
    fn fork(&mut self, at: &Place, chosen: Option<&BsdfSample>, waiting: &mut Vec<Branch>) -> bool {
        let u = [self.number(), self.number()];
        at.bsdf.other_discrete_ways(at.si.wo, u.into(), Mode::Radiance, chosen, |s| {
            let (mut beta, eta) = (at.beta * s.weight, at.eta * s.eta);
            let largest = beta.max_channel() * eta * eta;
            // Trapped without loss, it has to end some day.
            let kept = (largest / self.least).min(1.0) * survival(largest, at.depth, u32::MAX);
            if largest.is_nan() || self.number() >= kept {
                return;
            }
            beta *= 1.0 / kept;
            waiting.push(Branch { ray: at.si.spawn_ray(s.wi), beta, eta, depth: at.depth });
        })
    }

    /// In [0, 1).
    fn number(&mut self) -> f32 {
        self.bits = mix64(self.bits.wrapping_add(0x9e37_79b9_7f4a_7c15));
        (self.bits >> 40) as f32 * (1.0 / 16_777_216.0)
    }
}

/// A way that is still to be gone.
struct Branch {
    ray: Ray,
    beta: Rgb,
    eta: f32,
    depth: u32,
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::math::Vec3;
    use crate::sample::{Key, Sequence};
    use crate::scene::LoadOptions;

    /// A ball in front of a lamp, a lamp behind the eye, a dim sky, and something far away beside which the lamps are small.
    fn load(bsdf: &str) -> Scene {
        let text = format!(
            r#"<scene version="3.0.0"><sensor type="perspective"/>
            <shape type="sphere"><point name="center" x="0" y="0" z="3"/>{bsdf}</shape>
            <shape type="sphere"><point name="center" x="-3" y="0" z="9"/><float name="radius" value="1.5"/>
                <emitter type="area"><rgb name="radiance" value="2, 1, 1"/></emitter></shape>
            <shape type="sphere"><point name="center" x="9" y="0" z="-4"/><float name="radius" value="6"/>
                <emitter type="area"><rgb name="radiance" value="90, 100, 80"/></emitter></shape>
            <shape type="sphere"><point name="center" x="0" y="250" z="0"/></shape>
            <emitter type="constant"><rgb name="radiance" value="0.1"/></emitter></scene>"#
        );
        Scene::from_text(&text, Path::new("test.xml"), &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"))
    }

    fn ray(scene: &Scene) -> Ray {
        let o = -scene.to_scene.center * scene.to_scene.scale;
        Ray::new(o.as_vec3(), Vec3::new(0.2, 0.05, 1.0).normalize())
    }

    /// Light at the ends of a path that makes one choice at each vertex, and of its branches if it may have any; rays counted.
    fn walk(scene: &Scene, mut discrete: Discrete, max_depth: MaxDepth, sampler: &mut Sampler) -> (Rgb, u64) {
        let (mut ray, mut beta, mut eta, mut sum) = (ray(scene), Rgb::WHITE, 1.0, Rgb::BLACK);
        let mut counters = Counters::default();
        for depth in 1..=max_depth.unwrap_or(1000) {
            counters.camera_rays += 1;
            let Some(si) = scene.intersect(&mut ray) else {
                sum += beta * scene.environment_radiance(ray.d) * discrete.share();
                break;
            };
            sum += beta * scene.emitted(&si, si.wo) * discrete.share();
            let bsdf = scene.bsdf(&si);
            let (u_lobe, u) = (sampler.next_1d(), sampler.next_2d());
            let chosen = bsdf.sample(si.wo, u_lobe, u, Mode::Radiance, LobeMask::ALL);
            let place = Place { si: &si, bsdf: &bsdf, beta, eta, depth, max_depth };
            if max_depth.is_none_or(|d| depth < d) {
                sum += discrete.scatter(scene, &place, chosen.as_ref(), sampler, &mut counters);
            }
            let Some(s) = chosen.filter(|s| !s.lobe.intersects(LobeMask::SMOOTH)) else { break };
            beta *= s.weight;
            eta *= s.eta;
            ray = si.spawn_ray(s.wi);
        }
        (sum, counters.camera_rays)
    }

    /// Mean and its variance of 20 000 estimates.
    fn estimate(mut f: impl FnMut(&mut Sampler) -> Rgb) -> (f64, f64) {
        const TRIALS: u64 = 20_000;
        let values = (0..TRIALS).map(|i| {
            let mut sampler = Sampler::new(Sequence::Independent, Key::new(1, Purpose::Test, 0), i);
            f64::from(f(&mut sampler).mean())
        });
        let (sum, squares) = values.fold((0.0, 0.0), |(a, b), v| (a + v, b + v * v));
        let mean = sum / TRIALS as f64;
        (mean, (squares / TRIALS as f64 - mean * mean) / TRIALS as f64)
    }

    /// Branches find what single ways find, with less noise: within five standard errors, which a right program misses once in
    /// 10⁵ runs.
    #[test]
    fn branches_keep_the_mean() {
        let glass = r#"<bsdf type="dielectric"><rgb name="specular_transmittance" value="0.9, 1, 0.7"/></bsdf>"#;
        let blend =
            |a: &str, b: &str| format!(r#"<bsdf type="blendbsdf"><float name="weight" value="0.4"/>{a}{b}</bsdf>"#);
        for (name, least_gain, bsdf) in [
            ("glass", 3.0, glass.to_string()),
            ("pane", 3.0, r#"<bsdf type="thindielectric"/>"#.to_string()),
            ("mask", 3.0, format!(r#"<bsdf type="mask"><float name="opacity" value="0.7"/>{glass}</bsdf>"#)),
            ("glass and plastic", 3.0, blend(glass, r#"<bsdf type="plastic"/>"#)),
            ("the same twice", 3.0, blend(glass, glass)),
            ("glass and metal", 1.5, blend(glass, r#"<bsdf type="conductor"/>"#)),
            ("plastic", 1.0, r#"<bsdf type="plastic"/>"#.to_string()),
        ] {
            let scene = load(&bsdf);
            let (single, a) = estimate(|sampler| walk(&scene, Discrete::off(), None, sampler).0);
            for least in [LEAST, LEAST_OF_FEW] {
                let (split, b) = estimate(|sampler| walk(&scene, Discrete::start(&scene, least), None, sampler).0);
                assert!((single - split).abs() <= 5.0 * (a + b).sqrt(), "{name}: {single} {split} {}", (a + b).sqrt());
                assert!(a >= least_gain * b, "{name}: variances {a} {b}");
            }
        }
    }

    /// A limit ends branches where it ends the path: after two edges light comes from where the ball mirrors to, or from nothing.
    #[test]
    fn limits_count_edges() {
        let scene = load(r#"<bsdf type="dielectric"/>"#);
        let rays = |max_depth| {
            let mut total = 0;
            let (light, _) = estimate(|sampler| {
                let (light, rays) = walk(&scene, Discrete::start(&scene, LEAST), Some(max_depth), sampler);
                total += rays;
                light
            });
            (light, total as f64 / 20_000.0)
        };
        assert_eq!(rays(1), (0.0, 1.0));
        let (two, three) = (rays(2), rays(3));
        assert!(two.1 > 2.0 && two.1 <= 3.0 && three.1 > two.1, "{two:?} {three:?}");
        let mirrored = estimate(|sampler| walk(&scene, Discrete::off(), Some(2), sampler).0);
        assert!((mirrored.0 - two.0).abs() <= 5.0 * mirrored.1.sqrt(), "{mirrored:?} {two:?}");
    }

    /// Where lights are hardly brighter than what they light there is nothing to split for.
    #[test]
    fn an_even_sky_is_not_split_for() {
        let sky = r#"<scene version="3.0.0"><sensor type="perspective"/>
            <shape type="sphere"><point name="center" x="0" y="0" z="3"/><bsdf type="dielectric"/></shape>
            <emitter type="constant"/></scene>"#;
        let scene =
            Scene::from_text(sky, Path::new("test.xml"), &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
        assert!((scene.light_contrast() - 1.0).abs() < 1e-3, "{}", scene.light_contrast());
        assert_eq!(Discrete::start(&scene, LEAST).state, State::Over);
    }
}
