use super::surfaces::Surfaces;
use super::{Item, Needs};
use crate::scene::Scene;

/// A decision and its reason, a sentence without its full stop.
type Decision = (bool, &'static str);

impl Needs {
    /// Decides about `item`, given the decisions before it.
    pub(super) fn decide(&self, item: Item, scene: &Scene, surfaces: &Surfaces, max_depth: Option<u32>) -> Decision {
        match item {
            Item::Light => decide_light(scene, max_depth),
            Item::Direct => self.decide_direct(surfaces, max_depth),
            Item::Indirect => self.decide_indirect(surfaces, max_depth),
            Item::Caustics => self.decide_caustics(scene, surfaces),
            Item::Projection if !self.wants(Item::Caustics) => (false, "there are no caustic photons to aim"),
            Item::Projection => (true, "caustic photons are to be aimed at what focuses light"),
            Item::Global if !self.wants(Item::Indirect) => (false, "there is no indirect light"),
            Item::Global => match surfaces.receivers().next() {
                Some(_) => (true, "indirect light falls on surfaces that store photons"),
                None => (false, NO_RECEIVER),
            },
            Item::Gather if !self.wants(Item::Global) => (false, "there is no global map to read"),
            Item::Gather => (true, "the global map is too coarse to be seen directly"),
            Item::Irradiance if !self.wants(Item::Gather) => (false, "there are no gather rays to look it up"),
            Item::Irradiance => match surfaces.receivers().any(|s| s.can.lambertian) {
                true => (true, "gather rays may end on Lambertian surfaces"),
                false => (false, "no surface is Lambertian"),
            },
            Item::Cache => self.decide_cache(scene, surfaces),
            Item::Shadows if !self.wants(Item::Direct) => (false, "there are no shadow rays to spare"),
            Item::Shadows => match scene.integrator.integer("shadow_photons").is_some_and(|n| n > 0) {
                true => (true, "the scene file asks for it"),
                false => (false, "the scene file does not ask for it, and it guesses between photons"),
            },
            Item::Directions => {
                let maps = self.wants(Item::Global) || self.wants(Item::Caustics);
                match surfaces.receivers().any(|s| s.can.other || s.smooth) {
                    _ if !maps => (false, "there is no photon map"),
                    true => (true, "estimates at some surfaces depend on where photons came from"),
                    false => (false, "all surfaces that store photons are Lambertian and flat"),
                }
            }
            Item::Uv => match surfaces.list.iter().any(|s| s.can.uv) || scene.lights.iter().any(|l| l.is_textured()) {
                true => (true, "some surface has a texture or a tangent"),
                false => (false, "no surface has a texture or a tangent"),
            },
            Item::Normals => match surfaces.list.iter().any(|s| s.smooth) {
                true => (true, "some mesh has vertex normals"),
                false => (false, "no mesh that scatters light has vertex normals of its own"),
            },
            Item::Volume => (false, "not applicable: scenes with media are refused so far"),
            Item::Transmittance => (false, "not applicable: there are no media for rays to cross so far"),
            Item::Spectral => (false, "not applicable: light is three colours, no material disperses it so far"),
            Item::Motion => (false, "not applicable: shapes and cameras stand still so far"),
        }
    }

    fn decide_direct(&self, surfaces: &Surfaces, max_depth: Option<u32>) -> Decision {
        if !self.wants(Item::Light) {
            (false, "there is no light")
        } else if !allows(max_depth, 2) {
            (false, "max_depth shows emitters only")
        } else if surfaces.list.is_empty() {
            (false, "all surfaces are black")
        } else {
            (true, "some surface scatters light")
        }
    }

    fn decide_indirect(&self, surfaces: &Surfaces, max_depth: Option<u32>) -> Decision {
        if !self.wants(Item::Direct) {
            (false, "no surface is to scatter light")
        } else if !allows(max_depth, 3) {
            (false, "max_depth allows direct light only")
        } else if surfaces.interreflect() {
            (true, "light may go from surface to surface")
        } else {
            (false, "no surface that scatters light faces another one, or itself")
        }
    }

    fn decide_caustics(&self, scene: &Scene, surfaces: &Surfaces) -> Decision {
        if !self.wants(Item::Indirect) {
            (false, "there is no indirect light")
        } else if surfaces.casters().next().is_none() {
            (false, "no surface is specular or sharply glossy")
        } else if surfaces.receivers().next().is_none() {
            (false, NO_RECEIVER)
        } else if !surfaces.casters_are_lit(scene) {
            (false, "no specular surface is reachable from a light")
        } else if !surfaces.cast() {
            (false, "no specular surface faces one that stores photons")
        } else {
            (true, "light may reach a specular surface, and from there one that stores photons")
        }
    }

    fn decide_cache(&self, scene: &Scene, surfaces: &Surfaces) -> Decision {
        if !self.wants(Item::Gather) {
            (false, "there is no gathered light to interpolate")
        } else if !surfaces.receivers().any(|s| s.can.lambertian) {
            (false, "no surface is Lambertian")
        } else if scene.integrator.boolean("irradiance_cache") == Some(true) {
            (true, "the scene file asks for it")
        } else {
            (false, "the scene file does not ask for it, and it interpolates")
        }
    }
}

const NO_RECEIVER: &str = "no surface stores photons: none is diffuse or widely glossy";

fn decide_light(scene: &Scene, max_depth: Option<u32>) -> Decision {
    let ctx = scene.light_context();
    match scene.lights.iter().any(|l| !l.is_dark(&ctx)) {
        true if allows(max_depth, 1) => (true, "some light emits"),
        true => (false, "max_depth allows no path"),
        false => (false, "no light emits anything: the picture is black"),
    }
}

/// Whether paths may have so many edges.
fn allows(max_depth: Option<u32>, edges: u32) -> bool {
    max_depth.is_none_or(|d| d >= edges)
}
