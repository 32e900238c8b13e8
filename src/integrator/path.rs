//! Unidirectional path tracing with next-event estimation and multiple importance sampling: the reference. Bright lights seen
//! in glass are found by branches (see `branches.rs`).

use super::branches::{Discrete, LEAST, Place};
use super::{CameraSample, Integrator, MaxDepth, roulette};
use crate::bsdf::{LobeMask, Mode};
use crate::color::Rgb;
use crate::gather::{power_heuristic, sample_direct};
use crate::geometry::Ray;
use crate::math::Vec3;
use crate::sample::Sampler;
use crate::scene::Scene;
use crate::tally::Counters;

/// Path tracer; parameters as in Mitsuba 3's `path`.
#[derive(Clone, Copy, Debug)]
pub struct Path {
    pub max_depth: MaxDepth,
    /// Edges after which Russian roulette may end a path.
    pub rr_depth: u32,
    /// Leaves out light that reaches the camera straight from an emitter.
    pub hide_emitters: bool,
}

impl Default for Path {
    fn default() -> Self {
        Self { max_depth: None, rr_depth: 5, hide_emitters: false }
    }
}

/// How the last vertex chose the direction of the current ray, for the MIS weight of emitters found along it.
struct Previous {
    p: Vec3,
    pdf: f32,
    /// Light sampling could not have made this direction.
    delta: bool,
}

impl Integrator for Path {
    #[inline(always)]
    fn li(&self, scene: &Scene, sample: &CameraSample, sampler: &mut Sampler, counters: &mut Counters) -> Rgb {
        let mut radiance = Rgb::BLACK;
        let camera_ray = &sample.camera_ray;
        let mut beta = Rgb::splat(camera_ray.weight);
        let mut ray = camera_ray.ray;
        let mut eta = 1.0f32;
        let mut previous = Previous { p: ray.o, pdf: 1.0, delta: true };
        let mut depth = 0u32;
        let max_depth = self.max_depth.unwrap_or(u32::MAX);
        let mut hide = self.hide_emitters;
        let mut discrete = Discrete::start(scene, LEAST);
        while depth < max_depth {
            // Find the next surface; what leaves the scene sees the environment.
            counters.camera_rays += 1;
            let Some(hit) = scene.hit(&mut ray) else {
                if !hide {
                    let weight = if previous.delta {
                        1.0
                    } else {
                        power_heuristic(previous.pdf, scene.pdf_environment(previous.p, ray.d))
                    };
                    radiance += beta * scene.environment_radiance(ray.d) * (weight * discrete.share());
                }
                break;
            };
            let si = scene.interaction(&ray, &hit);
            // Add emitted light, shared with next-event estimation at the previous vertex.
            if scene.is_emitter(&si) {
                if hide {
                    ray = Ray { tmax: ray.tmax, ..si.spawn_ray(ray.d) };
                    continue;
                }
                let emitted = scene.emitted(&si, si.wo);
                if !emitted.is_black() {
                    let weight = if previous.delta {
                        1.0
                    } else {
                        power_heuristic(previous.pdf, scene.pdf_direct(previous.p, &si))
                    };
                    radiance += beta * emitted * (weight * discrete.share());
                }
            }
            hide = false;
            depth += 1;
            if depth >= max_depth {
                break;
            }
            // Estimate direct light.
            let bsdf = scene.bsdf(&si);
            if bsdf.lobes().intersects(LobeMask::SMOOTH) {
                radiance += beta * sample_direct(scene, &si, &bsdf, LobeMask::ALL, 1.0, sampler, counters);
            }
            // Choose the next direction.
            let (u_lobe, u) = (sampler.next_1d(), sampler.next_2d());
            let chosen = bsdf.sample(si.wo, u_lobe, u, Mode::Radiance, LobeMask::ALL);
            let place = Place { si: &si, bsdf: &bsdf, beta, eta, depth, max_depth: self.max_depth };
            radiance += discrete.scatter(scene, &place, chosen.as_ref(), sampler, counters);
            let Some(s) = chosen else { break };
            beta *= s.weight;
            eta *= s.eta;
            previous = Previous { p: si.p, pdf: s.pdf, delta: !s.lobe.intersects(LobeMask::SMOOTH) };
            ray = si.spawn_ray(s.wi);
            if !roulette(&mut beta, eta, depth, (self.rr_depth, 1.0), sampler) {
                break;
            }
        }
        radiance
    }
}
