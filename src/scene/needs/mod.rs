//! What rendering a scene needs, and why: derived from its lights, materials and geometry.
//!
//! Nothing is left out that is not proven to be useless. The proofs use kinds and places: which lobes a material has
//! anywhere (textures by their least and greatest texel), which half-spaces a light shines into, which surfaces cannot
//! face each other. No probe with rays takes part, because rays that miss something prove nothing.

mod surfaces;
#[cfg(test)]
mod tests;

use std::fmt;
use std::str::FromStr;

use serde::Serialize;

use super::Scene;
use surfaces::Surfaces;

/// Something that a render may need or do without.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Item {
    /// Tracing anything at all.
    Light,
    /// Light scattered by surfaces.
    Direct,
    /// Light scattered more than once.
    Indirect,
    /// The caustic map.
    Caustics,
    /// The global photon map.
    Global,
    /// Gather rays over the global map.
    Gather,
    /// Irradiance computed beforehand for Lambertian surfaces.
    Irradiance,
    /// The directions of stored photons.
    Directions,
    /// Texture coordinates.
    Uv,
    /// Shading normals.
    Normals,
}

impl Item {
    /// All items, in the order in which they are decided.
    pub const ALL: [Self; 10] = [
        Self::Light,
        Self::Direct,
        Self::Indirect,
        Self::Caustics,
        Self::Global,
        Self::Gather,
        Self::Irradiance,
        Self::Directions,
        Self::Uv,
        Self::Normals,
    ];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Light => "light",
            Self::Direct => "direct",
            Self::Indirect => "indirect",
            Self::Caustics => "caustics",
            Self::Global => "global",
            Self::Gather => "gather",
            Self::Irradiance => "irradiance",
            Self::Directions => "directions",
            Self::Uv => "uv",
            Self::Normals => "normals",
        }
    }
}

impl fmt::Display for Item {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Item {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        Self::ALL.into_iter().find(|i| i.name() == s).ok_or_else(|| {
            let names: Vec<_> = Self::ALL.iter().map(|i| i.name()).collect();
            format!("unknown need {s:?}; known are {}", names.join(", "))
        })
    }
}

/// One decision.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Need {
    pub item: Item,
    pub wanted: bool,
    /// A sentence without its full stop.
    pub reason: String,
    /// Somebody decided otherwise.
    pub forced: bool,
}

/// What somebody wants in place of what is derived.
pub type NeedOverride = (Item, bool);

/// All decisions about one scene.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct Needs {
    list: Vec<Need>,
}

impl Needs {
    /// Derives the needs of a scene for paths of at most `max_depth` edges; `overrides` win over what is derived, the last
    /// of an item over those before it, and what depends on an item follows the decision.
    pub fn of(scene: &Scene, max_depth: Option<u32>, overrides: &[NeedOverride]) -> Self {
        let mut needs = Self { list: Vec::with_capacity(Item::ALL.len()) };
        let surfaces = Surfaces::of(scene);
        for item in Item::ALL {
            let (wanted, reason) = needs.decide(item, scene, &surfaces, max_depth);
            let forced = overrides.iter().rev().find(|(i, _)| *i == item).map(|(_, on)| *on).filter(|on| *on != wanted);
            needs.list.push(Need {
                item,
                wanted: forced.unwrap_or(wanted),
                reason: match forced {
                    Some(_) => format!("as asked for; otherwise: {reason}"),
                    None => reason.to_owned(),
                },
                forced: forced.is_some(),
            });
        }
        needs
    }

    /// Whether an item is wanted.
    pub fn wants(&self, item: Item) -> bool {
        self.list.iter().find(|n| n.item == item).is_none_or(|n| n.wanted)
    }

    /// All decisions, in the order of [`Item::ALL`].
    pub fn iter(&self) -> impl Iterator<Item = &Need> {
        self.list.iter()
    }

    /// Edges that no longer path needs to have; `None` when nothing bounds them.
    pub fn longest_path(&self) -> Option<u32> {
        let bounds = [(Item::Light, 0), (Item::Direct, 1), (Item::Indirect, 2)];
        bounds.into_iter().find(|(item, _)| !self.wants(*item)).map(|(_, edges)| edges)
    }

    fn decide(&self, item: Item, scene: &Scene, surfaces: &Surfaces, max_depth: Option<u32>) -> (bool, &'static str) {
        let allows = |edges: u32| max_depth.is_none_or(|d| d >= edges);
        match item {
            Item::Light => {
                let ctx = scene.light_context();
                match scene.lights.iter().any(|l| !l.is_dark(&ctx)) {
                    true if allows(1) => (true, "some light emits"),
                    true => (false, "max_depth allows no path"),
                    false => (false, "no light emits anything: the picture is black"),
                }
            }
            Item::Direct if !self.wants(Item::Light) => (false, "there is no light"),
            Item::Direct if !allows(2) => (false, "max_depth shows emitters only"),
            Item::Direct => match surfaces.list.is_empty() {
                true => (false, "all surfaces are black"),
                false => (true, "some surface scatters light"),
            },
            Item::Indirect if !self.wants(Item::Direct) => (false, "no surface is to scatter light"),
            Item::Indirect if !allows(3) => (false, "max_depth allows direct light only"),
            Item::Indirect => match surfaces.interreflect() {
                true => (true, "light may go from surface to surface"),
                false => (false, "no surface that scatters light faces another one, or itself"),
            },
            Item::Caustics => self.decide_caustics(scene, surfaces),
            Item::Global if !self.wants(Item::Indirect) => (false, "there is no indirect light"),
            Item::Global => match surfaces.receivers().next() {
                Some(_) => (true, "indirect light falls on surfaces that store photons"),
                None => (false, "no surface stores photons: none is diffuse or widely glossy"),
            },
            Item::Gather if !self.wants(Item::Global) => (false, "there is no global map to read"),
            Item::Gather => (true, "the global map is too coarse to be seen directly"),
            Item::Irradiance if !self.wants(Item::Gather) => (false, "there are no gather rays to look it up"),
            Item::Irradiance => match surfaces.receivers().any(|s| s.can.lambertian) {
                true => (true, "gather rays may end on Lambertian surfaces"),
                false => (false, "no surface is Lambertian"),
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
        }
    }

    fn decide_caustics(&self, scene: &Scene, surfaces: &Surfaces) -> (bool, &'static str) {
        if !self.wants(Item::Indirect) {
            return (false, "there is no indirect light");
        }
        if surfaces.casters().next().is_none() {
            return (false, "no surface is specular or sharply glossy");
        }
        if surfaces.receivers().next().is_none() {
            return (false, "no surface stores photons: none is diffuse or widely glossy");
        }
        if !surfaces.casters_are_lit(scene) {
            return (false, "no specular surface is reachable from a light");
        }
        if !surfaces.cast() {
            return (false, "no specular surface faces one that stores photons");
        }
        (true, "light may reach a specular surface, and from there one that stores photons")
    }
}
