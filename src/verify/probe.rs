//! A scene to render whose mean radiance is known.

use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::judge::{Judge, Row, Spread, Verdict};
use super::methods::{Light, can_render};
use crate::accel::AccelKind;
use crate::geometry::TriangleMesh;
use crate::image::Image;
use crate::render::{Control, Plan, PlanOverrides, Rendering, Silent, render};
use crate::scene::mesh_io::{PlyMesh, write_ply};
use crate::scene::{LoadOptions, Scene, SceneError};

/// Seeds are multiplied by this for a second look at a row that noise may have failed.
const SECOND_LOOK: u64 = 4;

/// Photon paths may lose or gain this share of their energy by rounding.
const ENERGY_ROUNDING: f64 = 1e-6;

/// A scene, its settings and the mean over its pixels and channels that it must have.
pub struct Probe {
    pub parameter: String,
    pub fast: bool,
    /// Fast runs put it to one back end only.
    pub once: bool,
    xml: String,
    meshes: Vec<(&'static str, TriangleMesh)>,
    expected: f64,
    light: Light,
    only: &'static [&'static str],
    except: &'static [&'static str],
    /// Renders are compared to the truth within this relative difference.
    relative: f64,
    absolute: f64,
    /// Relative bias of methods that estimate densities.
    bias: f64,
    spp: u64,
    photons: u64,
    limit: f64,
}

/// Methods whose estimates have bias that shrinks with the radius.
const BIASED: [&str; 4] = ["photonmapper", "ppm", "sppm", "vcm"];

impl Probe {
    /// A scene whose mean radiance is `expected`, carried by the paths `light`.
    pub fn new(parameter: impl Into<String>, xml: String, expected: f64, light: Light) -> Self {
        Self {
            parameter: parameter.into(),
            fast: false,
            once: false,
            xml,
            meshes: Vec::new(),
            expected,
            light,
            only: &[],
            except: &[],
            relative: 0.01,
            absolute: 0.0,
            bias: 0.005,
            spp: 16,
            photons: 5_000,
            limit: 60.0,
        }
    }

    /// Also in fast runs.
    pub fn fast(mut self) -> Self {
        self.fast = true;
        self
    }

    /// In fast runs on one back end only: what it asks does not depend on that, or other rows ask it too.
    pub fn once(mut self) -> Self {
        self.once = true;
        self
    }

    /// Largest relative difference.
    pub fn relative(mut self, relative: f64) -> Self {
        self.relative = relative;
        self
    }

    /// Absolute difference that is always allowed.
    pub fn absolute(mut self, absolute: f64) -> Self {
        self.absolute = absolute;
        self
    }

    /// Relative bias that methods with density estimates may have here, in place of half a per cent: their radius is finite,
    /// and irradiance that is computed beforehand at photons is too large by 24/k² in uniform light.
    pub fn bias(mut self, bias: f64) -> Self {
        self.bias = bias;
        self
    }

    pub fn spp(mut self, spp: u64) -> Self {
        self.spp = spp;
        self
    }

    pub fn photons(mut self, photons: u64) -> Self {
        self.photons = photons;
        self
    }

    /// Seconds for all seeds of one method.
    pub fn limit(mut self, seconds: f64) -> Self {
        self.limit = seconds;
        self
    }

    /// Only these methods, where the scene asks for what the others do not have.
    pub fn only(mut self, methods: &'static [&'static str]) -> Self {
        self.only = methods;
        self
    }

    /// Not these methods, for a reason told where this is called.
    pub fn except(mut self, methods: &'static [&'static str]) -> Self {
        self.except = methods;
        self
    }

    /// A mesh that the scene names as a file.
    pub fn mesh(mut self, file: &'static str, mesh: TriangleMesh) -> Self {
        self.meshes.push((file, mesh));
        self
    }

    /// Whether a method is put to this scene.
    pub fn applies(&self, method: &str) -> bool {
        can_render(method, self.light)
            && (self.only.is_empty() || self.only.contains(&method))
            && !self.except.contains(&method)
    }

    /// Builds the scene; meshes pass through files of their own.
    pub fn load(&self, accel: AccelKind) -> Result<Scene, SceneError> {
        load(&self.xml, &self.meshes, accel)
    }

    /// Renders with one method under `seeds` seeds and judges the mean.
    pub fn run(&self, case: &'static str, scene: &Scene, method: &str, accel: &'static str, seeds: u64) -> Row {
        let bias = if BIASED.contains(&method) { self.bias } else { 0.0 };
        let judge = Judge { relative: self.relative, bias, absolute: self.absolute };
        let started = Instant::now();
        let mut runs = self.renders(scene, method, 1..=seeds);
        let mut row = self.judged(case, method, accel, &runs, &judge);
        // Noise fails one row in some hundreds: look again, with more and other seeds.
        if row.verdict == Verdict::Fail {
            runs = self.renders(scene, method, 1001..=1000 + SECOND_LOOK * seeds);
            row = self.judged(case, method, accel, &runs, &judge).with_note("second look");
        }
        for why in runs.iter().filter_map(|r| r.trouble.as_deref()).take(1) {
            row = row.failed(why);
        }
        row.timed(started.elapsed().as_secs_f64(), self.limit)
    }

    fn judged(&self, case: &'static str, method: &str, accel: &'static str, runs: &[Run], judge: &Judge) -> Row {
        let spread = Spread::of(runs.iter().map(|r| r.mean));
        Row::judge(case, &self.parameter, method, accel, self.expected, &spread, judge)
    }

    /// Samples of a pixel and photons of a map. Progressive photon mapping shoots its photons anew for each sample, and
    /// counts the paths rather than what they store; most paths of a light tracer miss the view.
    fn effort(&self, method: &str) -> (u64, u64) {
        match method {
            "ppm" | "sppm" if self.photons > 500 => ((self.spp / 16).clamp(2, 4), self.photons / 4),
            "ptracer" => (8 * self.spp, self.photons),
            _ => (self.spp, self.photons),
        }
    }

    fn renders(&self, scene: &Scene, method: &str, seeds: std::ops::RangeInclusive<u64>) -> Vec<Run> {
        let limit = Duration::from_secs_f64(self.limit);
        let (spp, photons) = self.effort(method);
        let one = |seed| Run::of(&render_once(scene, method, spp, photons, seed, Some(limit)));
        seeds.into_par_iter().map(one).collect()
    }
}

/// Builds a scene from text and meshes.
pub fn load(xml: &str, meshes: &[(&'static str, TriangleMesh)], accel: AccelKind) -> Result<Scene, SceneError> {
    let options = LoadOptions { accel, ..LoadOptions::default() };
    if meshes.is_empty() {
        return Scene::from_text(xml, Path::new("verify.xml"), &options);
    }
    let dir = tempfile::tempdir().expect("a folder for temporary files");
    for (file, mesh) in meshes {
        let ply = PlyMesh {
            positions: mesh.positions.as_slice(),
            normals: mesh.normals.as_deref(),
            indices: &mesh.indices,
            ..PlyMesh::default()
        };
        write_ply(&dir.path().join(file), &ply).expect("room for a temporary file");
    }
    Scene::from_text(xml, &dir.path().join("verify.xml"), &options)
}

/// One render of a scene.
pub fn render_once(
    scene: &Scene,
    method: &str,
    spp: u64,
    photons: u64,
    seed: u64,
    limit: Option<Duration>,
) -> Rendering {
    let overrides = PlanOverrides {
        integrator: Some(method.into()),
        spp: Some(spp),
        photons: Some(photons),
        seed: Some(seed),
        ..PlanOverrides::default()
    };
    let plan = Plan::new(scene, &overrides).expect("a method from the list of methods");
    let stop = AtomicBool::new(false);
    render(scene, &plan, &Control { stop: &stop, time: limit, started: Instant::now(), progress: &Silent })
}

/// Mean over pixels and channels, in f64.
pub fn mean(image: &Image) -> f64 {
    crate::image::metrics::mean(image).unwrap_or(f64::NAN)
}

/// What is kept of one render.
struct Run {
    mean: f64,
    /// What no render may do.
    trouble: Option<String>,
}

impl Run {
    fn of(rendering: &Rendering) -> Self {
        let s = &rendering.summary;
        let negative = rendering.image.pixels().iter().any(|p| p.min_channel() < 0.0);
        let rejected: u64 = s.maps.iter().map(|m| m.rejected).sum();
        let energy = s.maps.iter().map(|m| m.energy_error).fold(0.0, f64::max);
        let trouble = if s.counters.non_finite() > 0 {
            Some(format!("{} samples were not finite", s.counters.non_finite()))
        } else if negative {
            Some("a pixel is negative".into())
        } else if rejected > 0 {
            Some(format!("{rejected} photons were not finite"))
        } else if energy > ENERGY_ROUNDING {
            Some(format!("the photons' energy balance is off by {energy:.1e}"))
        } else {
            None
        };
        Self { mean: mean(&rendering.image), trouble }
    }
}
