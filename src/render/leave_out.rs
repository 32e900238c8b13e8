use super::Method;
use crate::gather::cache::CacheSettings;
use crate::integrator::MaxDepth;
use crate::scene::{Item, Needs};

/// Rays from lights where shadow photons are asked for and the scene file says no number.
const SHADOW_PHOTONS: u64 = 1_000_000;

impl Method {
    /// Takes out of the recipe what the scene does not need, and puts in what is made only where it is asked for.
    pub(super) fn leave_out(&mut self, needs: &Needs) {
        let cut = |max_depth: &mut MaxDepth| {
            *max_depth = [*max_depth, needs.longest_path()].into_iter().flatten().min();
        };
        match self {
            Method::Path(p) => cut(&mut p.max_depth),
            Method::Direct(d) => {
                // Without light, not even lamps are seen.
                d.hide_emitters |= !needs.wants(Item::Light);
                let scattered = u32::from(needs.wants(Item::Direct));
                d.emitter_samples *= scattered;
                d.bsdf_samples *= scattered;
            }
            Method::PhotonMapper(p) => {
                cut(&mut p.max_depth);
                p.caustic_photons *= u64::from(needs.wants(Item::Caustics));
                p.guided_emission &= needs.wants(Item::Projection);
                p.global_photons *= u64::from(needs.wants(Item::Global));
                p.final_gather &= needs.wants(Item::Gather);
                p.irradiance_photons &= needs.wants(Item::Irradiance);
                let cache = p.irradiance_cache.unwrap_or_else(CacheSettings::default);
                p.irradiance_cache = needs.wants(Item::Cache).then_some(cache);
                let shadows = if p.shadow_photons > 0 { p.shadow_photons } else { SHADOW_PHOTONS };
                p.shadow_photons = if needs.wants(Item::Shadows) { shadows } else { 0 };
            }
            Method::Ppm(p) | Method::Sppm(p) => {
                cut(&mut p.max_depth);
                p.caustics &= needs.wants(Item::Caustics);
                p.guided_emission &= needs.wants(Item::Projection);
                p.indirect &= needs.wants(Item::Global);
            }
            Method::LightTracer(p) | Method::Bidirectional(p) | Method::Vcm(p) => cut(&mut p.max_depth),
        }
    }

    /// Whether the recipe has a use for `item`, so that the decision about it changes anything.
    pub fn knows(&self, item: Item) -> bool {
        use Item::{Cache, Caustics, Directions, Gather, Global, Indirect, Irradiance, Projection, Shadows};
        match self {
            Method::Path(_) | Method::LightTracer(_) | Method::Bidirectional(_) | Method::Vcm(_) => {
                !matches!(item, Caustics | Projection | Global | Gather | Irradiance | Cache | Shadows | Directions)
            }
            Method::Direct(_) => !matches!(
                item,
                Indirect | Caustics | Projection | Global | Gather | Irradiance | Cache | Shadows | Directions
            ),
            Method::PhotonMapper(_) => true,
            Method::Ppm(_) | Method::Sppm(_) => !matches!(item, Gather | Irradiance | Cache | Shadows),
        }
    }
}
