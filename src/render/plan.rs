use std::ops::Range;
use std::sync::Arc;

use super::auto::AUTO;
use crate::gather::cache::{CacheMetric, CacheSettings};
use crate::gather::{AreaSettings, LookupSettings};
use crate::integrator::sppm::PhotonSampling;
use crate::integrator::vcm::{self, Merging, TechniqueChoice};
use crate::integrator::{Direct, Layer, MaxDepth, Path, PhotonMapperSettings, SppmSettings, VcmSettings};
use crate::photon::MapFile;
use crate::scene::{IntegratorSettings, NeedOverride, Needs, Scene};

/// The recipe of a render with all its parameters.
#[derive(Clone, Copy, Debug)]
pub enum Method {
    Path(Path),
    Direct(Direct),
    PhotonMapper(PhotonMapperSettings),
    Ppm(SppmSettings),
    Sppm(SppmSettings),
    LightTracer(VcmSettings),
    Bidirectional(VcmSettings),
    Vcm(VcmSettings),
}

impl Method {
    pub fn name(&self) -> &'static str {
        match self {
            Method::Path(_) => "path",
            Method::Direct(_) => "direct",
            Method::PhotonMapper(_) => "photonmapper",
            Method::Ppm(_) => "ppm",
            Method::Sppm(_) => "sppm",
            Method::LightTracer(_) => "ptracer",
            Method::Bidirectional(_) => "bdpt",
            Method::Vcm(_) => "vcm",
        }
    }

    /// Multiplies the first radii of progressive methods.
    fn scale_radii(&mut self, scale: f32) {
        match self {
            Method::Ppm(s) | Method::Sppm(s) => s.radius_scale *= scale,
            Method::Vcm(s) => s.radius_scale *= scale,
            _ => {}
        }
    }
}

/// The names that [`Plan::new`] knows.
pub const METHODS: [&str; 8] = ["path", "direct", "photonmapper", "ppm", "sppm", "ptracer", "bdpt", "vcm"];

/// What the command line says in place of the scene file.
#[derive(Clone, Debug, Default)]
pub struct PlanOverrides {
    pub integrator: Option<String>,
    pub spp: Option<u64>,
    pub photons: Option<u64>,
    /// Bytes that the photon maps of a pass may take; sets the number of photons where `photons` does not.
    pub photon_memory: Option<u64>,
    pub passes: Option<u64>,
    /// Camera samples per pixel in each pass of `ppm` and `sppm`, where the number of passes does not say it.
    pub samples_per_pass: Option<u64>,
    /// The passes to make of those.
    pub pass_range: Option<Range<u64>>,
    pub seed: Option<u64>,
    /// The render ends by the clock, so that without `spp` or `passes` it has no other end.
    pub timed: bool,
    /// As [`Plan::clamp`].
    pub clamp: Option<f32>,
    /// As [`Plan::track_error`].
    pub track_error: bool,
    /// Tell the bias of every pass.
    pub track_bias: bool,
    /// As [`Plan::target_error`].
    pub target_error: Option<f64>,
    /// Make the photon maps of `photonmapper` anew every few samples, also where nothing else asks for passes.
    pub fresh_maps: bool,
    /// Multiplies the first radii that progressive methods measure once more.
    pub radius_scale: Option<f32>,
    /// As [`Plan::layers`].
    pub layers: Vec<Layer>,
    /// What to make, or to leave out, whatever the scene needs.
    pub needs: Vec<NeedOverride>,
}

/// A plan that cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    #[error("unknown integrator {found:?}; known are {}{}", METHODS.join(", "), hint(.found))]
    UnknownIntegrator { found: String },
    #[error("the integrator \"auto\" is chosen where a picture is rendered; name one here: {}", METHODS.join(", "))]
    NotChosen,
    #[error("integrator {found:?} is not yet supported; known are {}", METHODS.join(", "))]
    NotYetSupported { found: String },
    #[error(
        "the passes {found:?} are not within the {passes} of this render: give --passes or --spp for all machines together"
    )]
    PassRange { found: Range<u64>, passes: u64 },
    #[error(
        "passes that share statistics depend on those before them: --pass-range must begin with 0 unless the scene leaves out \
         shared_statistics and chi_squared_radius"
    )]
    DependentPasses,
    #[error("the layer {layer} shows photon maps, and {integrator} keeps none: use --integrator photonmapper")]
    NoLayers { layer: &'static str, integrator: &'static str },
    #[error(
        "the layer cache shows an irradiance cache, and this render has none: give the scene's photonmapper \
         irradiance_cache = true (with final_gather)"
    )]
    NoCache,
}

fn hint(found: &str) -> String {
    METHODS
        .iter()
        .map(|m| (strsim::damerau_levenshtein(m, found), m))
        .min()
        .filter(|(distance, _)| *distance <= 3)
        .map_or_else(String::new, |(_, m)| format!("; did you mean {m:?}?"))
}

/// Everything that decides the picture, resolved.
#[derive(Clone, Debug)]
pub struct Plan {
    pub method: Method,
    /// What the scene needs, and why.
    pub needs: Needs,
    pub seed: u64,
    /// The numbers of the passes to make.
    pub passes: Range<u64>,
    /// Camera samples per pixel of each pass.
    pub spp_per_pass: u64,
    /// Camera samples per pixel of all passes from 0 on, the last of which may be smaller; `None` where time ends them.
    pub spp: Option<u64>,
    /// Dim samples above this radiance, which removes fireflies and some of the light; the summary tells how much.
    pub clamp: Option<f32>,
    /// Keep what is needed to tell the noise of every pixel.
    pub track_error: bool,
    /// Photon maps to read in place of shooting photons, by the names of their targets; every pass reads the same.
    pub stored_maps: Option<Arc<MapFile>>,
    /// In passes whose number this divides, read photon maps again, without precomputed irradiance and in half the area, to
    /// tell the bias of every pixel.
    pub bias_every: Option<u64>,
    /// The bias told is also that of precomputed irradiance and of what gather rays read; otherwise only of what camera paths read
    /// themselves, which takes no second render.
    pub bias_of_irradiance: bool,
    /// The render ends when its own estimate of relMSE is below this.
    pub target_error: Option<f64>,
    /// What to show of the photon maps beside the picture.
    pub layers: Vec<Layer>,
    /// Which techniques a pilot of the method left in its recipe, where it was asked for.
    pub techniques: Vec<TechniqueChoice>,
}

impl Plan {
    /// Combines what the scene file says with what the command line says.
    pub fn new(scene: &Scene, o: &PlanOverrides) -> Result<Self, PlanError> {
        let settings = &scene.integrator;
        let name = o.integrator.as_deref().unwrap_or(&settings.name);
        // Parameters of another integrator in the file do not apply.
        let own = settings.name == name;
        let spp = o.spp.unwrap_or(scene.sampler.spp).max(1);
        let photons = o.photons.or(o.photon_memory.map(|bytes| photons_within(bytes, name)));
        let mut method = match name {
            "path" => Method::Path(path(settings)),
            "direct" => Method::Direct(direct(settings, own)),
            "photonmapper" => Method::PhotonMapper(photonmapper(settings, own, photons, spp)),
            "ppm" => Method::Ppm(sppm(scene, own, photons)),
            "sppm" => Method::Sppm(sppm(scene, own, photons)),
            "ptracer" => Method::LightTracer(bidirectional(settings, own, VcmSettings::ptracer())),
            "bdpt" => Method::Bidirectional(bidirectional(settings, own, VcmSettings::bdpt())),
            "vcm" => Method::Vcm(bidirectional(settings, own, VcmSettings::default())),
            AUTO => return Err(PlanError::NotChosen),
            other if KNOWN_LATER.contains(&other) => {
                return Err(PlanError::NotYetSupported { found: other.to_owned() });
            }
            other => return Err(PlanError::UnknownIntegrator { found: other.to_owned() }),
        };
        method.scale_radii(o.radius_scale.unwrap_or(1.0));
        let needs = Needs::of(scene, max_depth(settings), &o.needs);
        method.leave_out(&needs);
        // Time and a wanted error end a render between passes.
        let open = o.timed || o.target_error.is_some();
        let max_passes = settings.integer("max_passes").filter(|_| own).and_then(|n| u64::try_from(n).ok());
        let (spp, spp_per_pass) = match (&method, o.passes) {
            // A pass of fresh photons takes one camera sample, unless more are asked for.
            (Method::Ppm(_) | Method::Sppm(_), passes) => {
                let in_file = settings.integer("samples_per_pass").filter(|_| own).and_then(|n| u64::try_from(n).ok());
                let each = o.samples_per_pass.or(in_file).unwrap_or(1).max(1);
                match (passes.or(max_passes), o.spp) {
                    (Some(passes), Some(spp)) => (spp, spp.div_ceil(passes.max(1))),
                    (Some(passes), None) => (passes.max(1).saturating_mul(each), each),
                    (None, _) => (spp, each.min(spp)),
                }
            }
            (_, Some(passes)) => (spp, spp.div_ceil(passes)),
            // New maps for each pass are worth having only where somebody asked for passes, time or error.
            (Method::PhotonMapper(_), None) if !open && !o.track_error && !o.fresh_maps => (spp, spp),
            // Short passes, so that a render can be stopped; powers of two keep the samples stratified.
            _ => (spp, (spp / 8).next_power_of_two().clamp(1, 16).min(spp)),
        };
        let bounded = !open || o.spp.is_some() || o.passes.is_some();
        let all = if bounded { spp.div_ceil(spp_per_pass) } else { u64::MAX };
        let passes = o.pass_range.clone().unwrap_or(0..all);
        if passes.is_empty() || passes.end > all {
            return Err(PlanError::PassRange { found: passes, passes: all });
        }
        let seed = o.seed.unwrap_or(scene.sampler.seed);
        let techniques = match &mut method {
            Method::Bidirectional(v) | Method::Vcm(v) if v.efficiency_aware => vcm::choose_techniques(scene, v, seed),
            _ => Vec::new(),
        };
        let plan = Self {
            needs,
            seed,
            techniques,
            passes,
            spp_per_pass,
            spp: bounded.then_some(spp),
            stored_maps: None,
            clamp: o.clamp,
            track_error: o.track_error || o.track_bias || o.target_error.is_some(),
            bias_every: bias_every(&method, o),
            bias_of_irradiance: true,
            target_error: o.target_error,
            layers: o.layers.clone(),
            method,
        };
        plan.check_layers()?;
        if plan.passes.start > 0 && !plan.independent() {
            return Err(PlanError::DependentPasses);
        }
        Ok(plan)
    }

    /// Refuses layers that the method has nothing to show in.
    fn check_layers(&self) -> Result<(), PlanError> {
        let Some(first) = self.layers.first() else { return Ok(()) };
        let Method::PhotonMapper(settings) = self.method else {
            return Err(PlanError::NoLayers { layer: first.name(), integrator: self.method.name() });
        };
        let cached = settings.final_gather && settings.irradiance_cache.is_some();
        if self.layers.contains(&Layer::Cache) && !cached {
            return Err(PlanError::NoCache);
        }
        Ok(())
    }

    /// Whether what a pass adds does not depend on the passes before it.
    pub fn independent(&self) -> bool {
        !matches!(self.method, Method::Ppm(s) | Method::Sppm(s) if s.shares())
    }

    /// Whether the bias of this pass is to be told.
    pub fn tells_bias(&self, pass: u64) -> bool {
        self.bias_every.is_some_and(|every| pass.is_multiple_of(every))
    }

    /// The camera samples of one pass.
    pub fn samples_of(&self, pass: u64) -> Range<u64> {
        let first = pass * self.spp_per_pass;
        let last = first + self.spp_per_pass;
        first..self.spp.map_or(last, |spp| last.min(spp))
    }
}

/// Where a wanted error ends the render, a few passes are enough to tell what is blur.
const BIAS_EVERY: u64 = 4;

/// Every how many passes bias is to be told; a wanted error needs to know it where estimates of density blur.
fn bias_every(method: &Method, o: &PlanOverrides) -> Option<u64> {
    let blurs = match method {
        Method::PhotonMapper(_) | Method::Ppm(_) | Method::Sppm(_) => true,
        Method::Vcm(v) => v.merging != Merging::Off,
        Method::Path(_) | Method::Direct(_) | Method::LightTracer(_) | Method::Bidirectional(_) => false,
    };
    o.track_bias.then_some(1).or((o.target_error.is_some() && blurs).then_some(BIAS_EVERY))
}

/// Integrators that the scene format names and that are not built yet.
const KNOWN_LATER: [&str; 2] = ["volpath", "volpathmis"];

fn max_depth(s: &IntegratorSettings) -> MaxDepth {
    let d = s.integer("max_depth").unwrap_or(-1);
    u32::try_from(d).ok()
}

fn path(s: &IntegratorSettings) -> Path {
    Path {
        max_depth: max_depth(s),
        rr_depth: s.integer("rr_depth").unwrap_or(5).max(1) as u32,
        hide_emitters: s.boolean("hide_emitters").unwrap_or(false),
    }
}

fn sppm(scene: &Scene, own: bool, photons: Option<u64>) -> SppmSettings {
    let s = &scene.integrator;
    let integer = |name: &str| s.integer(name).filter(|_| own).and_then(|v| u64::try_from(v).ok()).filter(|&v| v > 0);
    let float = |name: &str| s.float(name).filter(|_| own);
    let pixels = (scene.film.width as u64 * scene.film.height as u64).clamp(16_384, 1 << 22);
    let chi_squared_radius = s.boolean("chi_squared_radius").filter(|_| own).unwrap_or(false);
    SppmSettings {
        max_depth: max_depth(s),
        rr_depth: s.integer("rr_depth").unwrap_or(5).max(1) as u32,
        hide_emitters: s.boolean("hide_emitters").unwrap_or(false),
        photon_count: photons.or(integer("photon_count")).or(integer("photons_per_pass")).unwrap_or(pixels),
        alpha: float("alpha").map_or(2.0 / 3.0, f64::from),
        // Given in the lengths of the scene file; 0 measures it.
        initial_radius: float("initial_radius").filter(|&r| r > 0.0).map(|r| (r as f64 * scene.to_scene.scale) as f32),
        radius_scale: float("radius_scale").unwrap_or(1.0),
        lookup_size: integer("lookup_size").unwrap_or(40).min(1 << 20) as u32,
        clamp: (0.5, 4.0),
        radius_floor: float("radius_floor").unwrap_or(0.0),
        shared_statistics: s.boolean("shared_statistics").filter(|_| own).unwrap_or(false),
        chi_squared_radius,
        boundary_correction: s.boolean("boundary_correction").filter(|_| own).unwrap_or(true),
        caustics: true,
        indirect: true,
        // Of photons that are aimed, numbers are uneven where their powers are not.
        guided_emission: !chi_squared_radius,
        photon_sampling: match s.string("photon_sampling").filter(|_| own) {
            Some("visibility") => PhotonSampling::Visibility,
            _ => PhotonSampling::Independent,
        },
    }
}

fn direct(s: &IntegratorSettings, own: bool) -> Direct {
    let count = |name| {
        let shading = s.integer("shading_samples").unwrap_or(1);
        if own { s.integer(name).unwrap_or(shading).clamp(0, 65536) as u32 } else { 1 }
    };
    Direct {
        emitter_samples: count("emitter_samples"),
        bsdf_samples: count("bsdf_samples"),
        hide_emitters: s.boolean("hide_emitters").unwrap_or(false),
    }
}

fn bidirectional(s: &IntegratorSettings, own: bool, method: VcmSettings) -> VcmSettings {
    let switch = |name: &str, default: bool| s.boolean(name).filter(|_| own).unwrap_or(default);
    let connect = switch("connect", true);
    let merging = match method.merging {
        Merging::Off => Merging::Off,
        _ if !connect || switch("merge_all", false) => Merging::All,
        _ if !switch("merge", true) => Merging::Off,
        m => m,
    };
    VcmSettings {
        max_depth: max_depth(s),
        rr_depth: s.integer("rr_depth").filter(|_| own).map_or(method.rr_depth, |d| d.max(1) as u32),
        hide_emitters: s.boolean("hide_emitters").unwrap_or(false),
        connect,
        connect_vertices: switch("connect_vertices", true),
        light_image: switch("light_image", true),
        merging,
        alpha: s.float("alpha").filter(|_| own).map_or(method.alpha, f64::from),
        initial_radius: s.float("initial_radius").filter(|_| own),
        radius_scale: s.float("radius_scale").filter(|_| own).unwrap_or(1.0),
        light_paths: s.integer("light_paths").filter(|_| own).map(|n| n.clamp(1, i64::from(u32::MAX)) as u32),
        guided_emission: switch("guided_emission", true),
        correlation_aware: switch("correlation_aware", false),
        efficiency_aware: method.camera_paths && switch("efficiency_aware", false),
        ..method
    }
}

/// Photons in each map so that all maps of a pass fit into so many bytes.
fn photons_within(bytes: u64, integrator: &str) -> u64 {
    // Two maps of 20.5 bytes a photon; precomputed irradiance takes 32 bytes for each photon of the global map at most.
    let each = if integrator == "photonmapper" { 73.0 } else { 41.0 };
    // The number stored is near the number wanted, not equal to it.
    (0.9 * bytes as f64 / each) as u64
}

fn photonmapper(s: &IntegratorSettings, own: bool, photons: Option<u64>, spp: u64) -> PhotonMapperSettings {
    let integer = |name: &str, default: u64| {
        s.integer(name).filter(|_| own).and_then(|v| u64::try_from(v).ok()).unwrap_or(default)
    };
    let float = |name: &str, default: f32| s.float(name).filter(|_| own).unwrap_or(default);
    let switch = |name: &str, default: bool| s.boolean(name).filter(|_| own).unwrap_or(default);
    let lookup_size = integer("lookup_size", 100) as u32;
    PhotonMapperSettings {
        max_depth: max_depth(s),
        rr_depth: s.integer("rr_depth").unwrap_or(5).max(1) as u32,
        hide_emitters: s.boolean("hide_emitters").unwrap_or(false),
        direct_samples: integer("direct_samples", 1).max(1) as u32,
        global_photons: photons.unwrap_or_else(|| integer("global_photons", 250_000)),
        caustic_photons: photons.unwrap_or_else(|| integer("caustic_photons", 250_000)),
        final_gather: switch("final_gather", true),
        // About 64 gather rays a pixel at least, whatever the number of camera samples.
        final_gather_samples: integer("final_gather_samples", (64 / spp).max(1)) as u32,
        guided_emission: switch("guided_emission", true),
        shadow_photons: integer("shadow_photons", 0),
        short_gather: 2.0,
        irradiance_photons: switch("irradiance_photons", true),
        irradiance_cache: s.boolean("irradiance_cache").filter(|&on| own && on).map(|_| cache(s)),
        lookup: LookupSettings {
            global_size: lookup_size,
            caustic_size: integer("caustic_lookup_size", lookup_size as u64) as u32,
            global_radius: float("global_lookup_radius", 0.05),
            caustic_radius: float("caustic_lookup_radius", 0.0125),
            kernel: crate::photon::Kernel::Epanechnikov,
            area: AreaSettings {
                disc_height: Some(float("disc_height", 0.0)).filter(|&h| h > 0.0),
                convex_hull: switch("convex_hull", false),
                even: switch("even_photons", false),
            },
        },
    }
}

fn cache(s: &IntegratorSettings) -> CacheSettings {
    let d = CacheSettings::default();
    CacheSettings {
        resolution: s.integer("resolution").map_or(d.resolution, |v| v.clamp(2, 1024) as u32),
        quality: s.float("quality").unwrap_or(d.quality),
        metric: CacheMetric::NAMES.iter().find(|n| Some(n.0) == s.string("cache_metric")).map_or(d.metric, |n| n.1),
        gradients: s.boolean("gradients").unwrap_or(d.gradients),
        clamp_neighbor: s.boolean("clamp_neighbor").unwrap_or(d.clamp_neighbor),
        clamp_screen: s.boolean("clamp_screen").unwrap_or(d.clamp_screen),
    }
}
