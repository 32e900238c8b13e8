use std::sync::Arc;

use super::emission::{Emission, Learnt};
use super::radius::automatic_radius;
use super::weights::{Mis, light_image_share};
use crate::bsdf::{LobeMask, may_have};
use crate::geometry::SurfaceInteraction;
use crate::integrator::MaxDepth;
use crate::math::Vec3;
use crate::scene::Scene;

/// Where light vertices are merged with camera vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Merging {
    Off,
    /// Where light arrives from a surface that can focus it: a vertex with mirror-like, see-through or narrow lobes. Other merges
    /// are what connections do better.
    Focused,
    /// At every diffuse or wide glossy vertex.
    All,
}

/// Edges after which Russian roulette may end a sub-path, if nothing else is asked for. Sooner than in other methods: long
/// sub-paths find little that short ones of the other side do not.
const RR_DEPTH: u32 = 2;

/// Parameters of the bidirectional methods, named as in Mitsuba 0.6.
#[derive(Clone, Copy, Debug)]
pub struct VcmSettings {
    pub max_depth: MaxDepth,
    /// Edges after which Russian roulette may end a sub-path.
    pub rr_depth: u32,
    /// Leaves out light that reaches the camera straight from an emitter.
    pub hide_emitters: bool,
    /// Camera paths go beyond their first edge; false is light tracing.
    pub camera_paths: bool,
    /// Connections, next-event estimation and light tracing.
    pub connect: bool,
    /// Connections of light vertices to camera vertices.
    pub connect_vertices: bool,
    /// Connections of light vertices to the lens.
    pub light_image: bool,
    pub merging: Merging,
    /// Share of the photons that a merging radius keeps from pass to pass, between 0 and 1.
    pub alpha: f64,
    /// The merging radius of the first pass in units of the scene file; `None` fits it to the picture.
    pub initial_radius: Option<f32>,
    /// A radius that was fitted is multiplied by this.
    pub radius_scale: f32,
    /// Light paths for each camera path, where vertices are merged; `None` fits them to what both cost, as
    /// [`super::render_pass`] says.
    pub light_paths: Option<u32>,
    /// A short pilot finds where light paths should start, and whether that is worth its rays; see [`super::render_pass`].
    pub guided_emission: bool,
    /// Counts merges for less where they share a camera path [Grittmann 2021].
    pub correlation_aware: bool,
    /// A short pilot decides which techniques are worth their cost; see [`super::choose_techniques`].
    pub efficiency_aware: bool,
}

impl Default for VcmSettings {
    /// Everything, with merging where it helps.
    fn default() -> Self {
        Self {
            max_depth: None,
            rr_depth: RR_DEPTH,
            hide_emitters: false,
            camera_paths: true,
            connect: true,
            connect_vertices: true,
            light_image: true,
            merging: Merging::Focused,
            alpha: 2.0 / 3.0,
            initial_radius: None,
            radius_scale: 1.0,
            light_paths: None,
            guided_emission: true,
            correlation_aware: false,
            efficiency_aware: false,
        }
    }
}

impl VcmSettings {
    /// Light tracing: light paths connected to the lens, and lights that the camera sees at once. Roulette waits as long as in
    /// `path`: no other technique takes the weight off a survivor that lands before the lens.
    pub fn ptracer() -> Self {
        Self { camera_paths: false, rr_depth: 5, ..Self::bdpt() }
    }

    /// Bidirectional path tracing.
    pub fn bdpt() -> Self {
        Self { merging: Merging::Off, ..Self::default() }
    }

    /// The same with merging radii multiplied by `scale`.
    pub fn with_radius_scaled(mut self, scale: f32) -> Self {
        self.initial_radius = self.initial_radius.map(|r| r * scale);
        self.radius_scale *= scale;
        self
    }

    /// Bidirectional photon mapping: merging alone.
    pub fn bpm() -> Self {
        Self { connect: false, light_image: false, merging: Merging::All, ..Self::default() }
    }
}

/// What is fixed about a surface, whatever side it is looked at from.
#[derive(Clone, Copy, Debug, Default)]
struct SurfaceClass {
    mergeable: bool,
    focusing: bool,
    /// The lobes seen from its two sides may differ.
    two_faced: bool,
}

/// The settings with everything that the scene decides.
#[derive(Clone)]
pub struct Recipe<'s> {
    pub scene: &'s Scene,
    pub settings: VcmSettings,
    pub max_depth: u32,
    /// Light paths of one iteration: one for each pixel, unless a pilot has found that more are worth their rays.
    pub light_paths: u64,
    /// Radius of the first pass, scene units.
    pub first_radius: f64,
    /// 1 when vertices are connected.
    pub connect: f64,
    /// Of light straight from a light, what the density of the light image counts for in weights.
    pub direct_image: f64,
    /// Where light paths start, if that is guided.
    pub(super) emission: Option<Arc<Emission>>,
    classes: Vec<SurfaceClass>,
}

impl<'s> Recipe<'s> {
    /// Leaves out what the scene does not need.
    pub fn new(scene: &'s Scene, settings: &VcmSettings) -> Self {
        let mut settings = *settings;
        if !settings.connect {
            settings.connect_vertices = false;
            settings.light_image = false;
            settings.merging = Merging::All;
        }
        let classes: Vec<SurfaceClass> = scene
            .shape_materials
            .iter()
            .map(|&id| SurfaceClass {
                mergeable: may_have(&scene.materials, id, LobeMask::SMOOTH_WIDE),
                focusing: may_have(&scene.materials, id, LobeMask::SPECULAR | LobeMask::NARROW),
                two_faced: scene.materials[id.0 as usize].is_composite(),
            })
            .collect();
        let mergeable = classes.iter().any(|c| c.mergeable);
        let focusing = classes.iter().any(|c| c.focusing);
        if !mergeable || (settings.merging == Merging::Focused && !focusing) {
            settings.merging = Merging::Off;
        }
        settings.correlation_aware &= settings.merging != Merging::Off;
        let first_radius = match settings.initial_radius {
            _ if settings.merging == Merging::Off => 0.0,
            Some(r) => r as f64 * scene.to_scene.scale,
            None => (automatic_radius(scene) * settings.radius_scale) as f64,
        };
        let (w, h) = scene.camera.window().crop_size;
        Self {
            scene,
            settings,
            max_depth: settings.max_depth.unwrap_or(u32::MAX),
            light_paths: w as u64 * h as u64,
            first_radius,
            connect: settings.connect as u8 as f64,
            // Merges do not ask what they merge: where light straight from lights is merged, all count alike.
            direct_image: match settings.merging {
                Merging::All => 1.0,
                _ => light_image_share((0..scene.selector.len()).map(|i| scene.selector.pmf(i) as f64)),
            },
            emission: None,
            classes,
        }
    }

    /// Takes what a pilot has found of light paths.
    pub(super) fn learn(&mut self, learnt: &Learnt) {
        self.emission.clone_from(&learnt.emission);
        self.light_paths = self.pixels() * u64::from(learnt.per_pixel);
    }

    /// Camera paths of one iteration.
    pub(super) fn pixels(&self) -> u64 {
        let (w, h) = self.scene.camera.window().crop_size;
        u64::from(w) * u64::from(h)
    }

    /// The same with other techniques.
    pub(super) fn with(&self, settings: VcmSettings) -> Self {
        Self { settings, ..self.clone() }
    }

    /// Density of light paths from light `index` that start at `p` along `w`, `n` being the light's normal, relative to that
    /// of `sample_le`.
    #[inline(always)]
    pub(super) fn emission_density(&self, index: usize, p: Vec3, n: Vec3, w: Vec3) -> f64 {
        self.emission.as_ref().map_or(1.0, |e| e.density(self.scene, index, p, n, w))
    }

    /// Whether light leaves vertices for anybody.
    pub fn traces_light(&self) -> bool {
        let used = self.settings.light_image || self.settings.merging != Merging::Off || self.connects();
        used && !self.scene.selector.is_empty()
    }

    /// Whether camera vertices are connected to light vertices.
    pub fn connects(&self) -> bool {
        self.settings.connect_vertices && self.settings.camera_paths
    }

    /// Settles the sums of a walk at vertex `depth`: beyond the first one, `dvcm` stands for a connection of the edge before.
    #[inline]
    pub(super) fn settle(&self, mis: &mut Mis, depth: u32) {
        if depth > 1 && !self.settings.connect_vertices {
            mis.dvcm = 0.0;
        }
    }

    /// Whether some surface can focus light.
    pub(super) fn has_focusing(&self) -> bool {
        self.classes.iter().any(|c| c.focusing)
    }

    /// Whether light leaving `si` can be merged at the next vertex.
    pub fn focuses(&self, si: &SurfaceInteraction) -> bool {
        self.settings.merging == Merging::All || self.classes[si.shape as usize].focusing
    }

    /// Whether light straight from a light can be merged.
    pub fn merges_direct(&self) -> bool {
        self.settings.merging == Merging::All
    }

    /// Whether light vertices at `si` can be merged at all.
    pub fn mergeable(&self, si: &SurfaceInteraction) -> bool {
        self.settings.merging != Merging::Off && self.classes[si.shape as usize].mergeable
    }

    /// Whether the lobes at `si` may differ with the side from which they are looked at.
    pub(super) fn two_faced(&self, si: &SurfaceInteraction) -> bool {
        self.classes[si.shape as usize].two_faced
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::LoadOptions;

    /// What a narrow lobe throws on a wall, connections find with much noise; there is nothing to merge where lobes are wide.
    #[test]
    fn light_from_narrow_lobes_is_merged() {
        let merging = |alpha: &str| {
            let text = format!(
                r#"<scene version="3.0.0"><sensor type="perspective"/>
                <shape type="rectangle"><bsdf type="roughconductor"><float name="alpha" value="{alpha}"/></bsdf></shape>
                <shape type="rectangle"><bsdf type="diffuse"/></shape>
                <shape type="sphere"><emitter type="area"/></shape></scene>"#
            );
            let scene = Scene::from_text(&text, std::path::Path::new("test.xml"), &LoadOptions::default());
            Recipe::new(&scene.unwrap_or_else(|e| panic!("{e}")), &VcmSettings::default()).settings.merging
        };
        assert_eq!((merging("0.05"), merging("0.3")), (Merging::Focused, Merging::Focused));
        assert_eq!(merging("0.5"), Merging::Off);
    }
}
