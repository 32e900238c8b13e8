//! What the photon maps hold, seen directly beside the picture.

use super::PhotonMapper;
use super::cache::pixel_width;
use crate::camera::Footprint;
use crate::color::Rgb;
use crate::integrator::CameraSample;
use crate::integrator::lobe_walk::{Sight, Sights};
use crate::sample::Sampler;
use crate::scene::Scene;
use crate::tally::Counters;

/// Radius of the dots that mark records of the irradiance cache, pixels.
const DOT: f32 = 1.5;

/// One thing to be seen of what a photon mapper works with. Mirrors and glass are looked through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layer {
    /// Radiance of all photon maps, each photon path counted once.
    Photons,
    /// Radiance of the caustic map.
    Caustic,
    /// Radiance of the map that indirect light comes from: all light with final gather, else what has been scattered
    /// diffusely before.
    Global,
    /// Light of no photon: from lights to the eye, and from lights to the surface that is seen.
    Direct,
    /// Photons stored for each square unit of the scene file, all maps together.
    Density,
    /// 1 where the irradiance cache has a record, 0 elsewhere.
    Cache,
}

impl Layer {
    pub const ALL: [Self; 6] = [Self::Photons, Self::Caustic, Self::Global, Self::Direct, Self::Density, Self::Cache];

    /// Its name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Photons => "photons",
            Self::Caustic => "caustic",
            Self::Global => "global",
            Self::Direct => "direct",
            Self::Density => "density",
            Self::Cache => "cache",
        }
    }

    /// Whether its values are numbers rather than colours.
    pub fn is_number(self) -> bool {
        matches!(self, Self::Density | Self::Cache)
    }
}

/// A photon mapper that shows layers in place of the picture.
///
/// Camera paths and shadow rays get the numbers that they get in the picture. Without final gather, the layers `direct`,
/// `caustic` and `global` add up to it, sample by sample.
pub struct LayerView<'a> {
    pub mapper: PhotonMapper<'a>,
    pub layers: &'a [Layer],
}

/// The layers of one camera path.
struct LayerSums<'a> {
    view: &'a LayerView<'a>,
    scene: &'a Scene,
    footprint: &'a Footprint,
    out: &'a mut [Rgb],
    /// Whether a surface with photons has been met.
    seen: bool,
}

impl LayerView<'_> {
    /// One sample of every layer into `out`.
    pub fn see(
        &self,
        scene: &Scene,
        sample: &CameraSample,
        sampler: &mut Sampler,
        counters: &mut Counters,
        out: &mut [Rgb],
    ) {
        out.fill(Rgb::BLACK);
        let footprint = &sample.camera_ray.footprint;
        let mut sums = LayerSums { view: self, scene, footprint, out, seen: false };
        self.mapper.walk().follow(scene, &sample.camera_ray, &mut sums, sampler, counters);
    }
}

impl Sights for LayerSums<'_> {
    fn light(&mut self, radiance: Rgb) {
        for (layer, out) in self.view.layers.iter().zip(self.out.iter_mut()) {
            if *layer == Layer::Direct {
                *out += radiance;
            }
        }
    }

    fn wide(&mut self, at: &Sight, sampler: &mut Sampler, counters: &mut Counters) {
        let (mapper, scene, first) = (&self.view.mapper, self.scene, !self.seen);
        self.seen = true;
        // Traced whether or not it is a layer, so that what follows gets the same random numbers.
        let direct = mapper.direct(scene, at.si, at.bsdf, 0, sampler, counters).0;
        let marked = first && self.view.layers.contains(&Layer::Cache) && self.marked(at);
        for (layer, out) in self.view.layers.iter().zip(self.out.iter_mut()) {
            *out += match layer {
                Layer::Direct => at.beta * direct,
                Layer::Caustic => at.beta * mapper.maps.caustic_radiance::<Rgb>(at.si, at.bsdf, counters),
                Layer::Photons => at.beta * mapper.maps.photon_radiance(at.si, at.bsdf, counters),
                Layer::Global if at.edges >= 2 => at.beta * mapper.maps.plain_global_radiance(at.si, at.bsdf, counters),
                Layer::Global => Rgb::BLACK,
                Layer::Density if first => {
                    // Areas shrink by the square of the scale.
                    let scale = scene.to_scene.scale;
                    Rgb::splat((f64::from(mapper.maps.density(at.si)) * scale * scale) as f32)
                }
                Layer::Density => Rgb::BLACK,
                Layer::Cache => Rgb::splat(f32::from(marked)),
            };
        }
    }
}

impl LayerSums<'_> {
    /// Whether the point lies on the mark of a record.
    fn marked(&self, at: &Sight) -> bool {
        let known = self.view.mapper.cache.zip(at.bsdf.diffuse_only(at.si.wo));
        let distance = DOT * pixel_width(self.footprint, at.length);
        known.is_some_and(|(cache, (_, n))| cache.has_record_near(at.si.p, n, distance))
    }
}
