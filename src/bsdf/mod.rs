//! How surfaces scatter light.
//!
//! A [`Material`] is what a scene file says; [`evaluate`] looks its textures up at one point and flattens nesting
//! (two-sided, mask, blend, bump and normal maps) into a [`Bsdf`]: a few weighted lobes in world space, `Copy`, ready
//! for `eval`, `sample` and `pdf`.
//!
//! All directions are unit vectors that point away from the surface. `wo` goes back to where the walk came from (the
//! viewer, or the light for photons), `wi` is the other one. Densities are per steradian.

mod check;
mod conductor;
mod dielectric;
mod diffuse;
mod evaluate;
mod fresnel;
mod ior;
mod lobe;
mod material;
mod metal;
mod microfacet;
mod phong;
mod plastic;
mod principled;
mod rough;
mod rough_plastic;
mod scatter;
mod survey;
#[cfg(test)]
mod tests;

pub use check::{MaterialError, check, may_have};
pub use conductor::Metal;
pub use dielectric::Dielectric;
pub use diffuse::DiffuseBsdf;
pub use evaluate::{Plain, evaluate, plain};
pub use fresnel::{Fresnel, Ior, diffuse_reflectance, fresnel_conductor};
pub use ior::{IOR_NAMES, ior_by_name};
pub use lobe::{Lobe, LobeMask};
pub use material::{Filling, Material, MaterialId, Plastic, Principled, PrincipledThin, RoughPlastic, Roughness};
pub use metal::{METAL_NAMES, metal_by_name};
pub use microfacet::Distribution;
pub use scatter::{Bsdf, BsdfSample, MAX_LOBES, Mode};
pub use survey::{Abilities, survey};

/// Roughness below which a microfacet surface is smooth: its lobes are delta.
pub const DELTA_ALPHA: f32 = 1e-4;

/// Roughness below which a lobe is [`LobeMask::SHARP`]: narrower than the directions that photons store.
pub const SHARP_ALPHA: f32 = 0.06;

/// Roughness below which a lobe is [`LobeMask::NARROW`]. After the same time `sppm` has 0.7 of the error on metal of
/// roughness 0.3 if its reflections are found by rays, and 1.85 times as much on metal of 0.6 (gallery/glossy.xml).
pub const NARROW_ALPHA: f32 = 0.4;
