//! Estimates of radiance at a point: direct light, density of photons, final gather.

pub mod cache;
mod direct;
mod fixed;
mod irradiance;
mod photons;

pub use direct::{power_heuristic, sample_direct};
pub use fixed::{RadiusEstimate, RadiusMap};
pub use photons::{LookupSettings, MapEstimate, PhotonMaps};
