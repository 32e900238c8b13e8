//! What rendering a scene needs, and why: derived from its lights, materials and geometry.
//!
//! Nothing is left out that is not proven to be useless. The proofs use kinds and places: which lobes a material has
//! anywhere (textures by their least and greatest texel), which half-spaces a light shines into, which surfaces cannot
//! face each other. No probe with rays takes part, because rays that miss something prove nothing.

mod decide;
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
    /// Projection maps: where to aim caustic photons.
    Projection,
    /// The global photon map.
    Global,
    /// Gather rays over the global map.
    Gather,
    /// Irradiance computed beforehand for Lambertian surfaces.
    Irradiance,
    /// The irradiance cache, which interpolates: only where it is asked for.
    Cache,
    /// Shadow photons, which interpolate too.
    Shadows,
    /// The directions of stored photons.
    Directions,
    /// Texture coordinates.
    Uv,
    /// Shading normals.
    Normals,
    /// Photons scattered in media.
    Volume,
    /// What media let pass along a ray.
    Transmittance,
    /// Wavelengths in place of three colours.
    Spectral,
    /// Geometry and cameras that move.
    Motion,
}

impl Item {
    /// All items, in the order in which they are decided.
    pub const ALL: [Self; 17] = [
        Self::Light,
        Self::Direct,
        Self::Indirect,
        Self::Caustics,
        Self::Projection,
        Self::Global,
        Self::Gather,
        Self::Irradiance,
        Self::Cache,
        Self::Shadows,
        Self::Directions,
        Self::Uv,
        Self::Normals,
        Self::Volume,
        Self::Transmittance,
        Self::Spectral,
        Self::Motion,
    ];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Light => "light",
            Self::Direct => "direct",
            Self::Indirect => "indirect",
            Self::Caustics => "caustics",
            Self::Projection => "projection",
            Self::Global => "global",
            Self::Gather => "gather",
            Self::Irradiance => "irradiance",
            Self::Cache => "cache",
            Self::Shadows => "shadows",
            Self::Directions => "directions",
            Self::Uv => "uv",
            Self::Normals => "normals",
            Self::Volume => "volume",
            Self::Transmittance => "transmittance",
            Self::Spectral => "spectral",
            Self::Motion => "motion",
        }
    }

    /// False for what this version cannot make. No scene that loads needs it, and nobody can ask for it.
    pub fn is_built(self) -> bool {
        !matches!(self, Self::Volume | Self::Transmittance | Self::Spectral | Self::Motion)
    }

    /// True for what trades exactness for time: made where it is asked for, never because a scene needs it.
    pub fn is_opt_in(self) -> bool {
        matches!(self, Self::Cache | Self::Shadows)
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
    /// of an item over those before it, and what depends on an item follows the decision. What cannot be made stays out.
    pub fn of(scene: &Scene, max_depth: Option<u32>, overrides: &[NeedOverride]) -> Self {
        let mut needs = Self { list: Vec::with_capacity(Item::ALL.len()) };
        let surfaces = Surfaces::of(scene);
        for item in Item::ALL {
            let (wanted, reason) = needs.decide(item, scene, &surfaces, max_depth);
            let asked = overrides.iter().rev().find(|(i, _)| *i == item).map(|(_, on)| *on);
            let forced = asked.filter(|on| *on != wanted && item.is_built());
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
}
