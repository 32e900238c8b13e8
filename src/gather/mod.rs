//! Estimates of radiance at a point: direct light, density of photons, final gather.

mod area;
mod bins;
mod boundary;
pub mod cache;
mod cells;
mod direct;
mod fixed;
mod irradiance;
mod photons;
mod shadows;

pub use area::AreaSettings;
pub use bins::{BINS, Bins, LEAST_PHOTONS};
pub use boundary::{Clearing, Patch};
pub use direct::{MetLight, met_light, power_heuristic, sample_direct, sample_direct_unless, sample_lobe_light};
pub use fixed::{Lobes, RadiusEstimate, RadiusMap, takes_in};
pub use photons::{Both, LookupSettings, MapEstimate, NARROW, PhotonMaps, Reading};
pub use shadows::ShadowMap;
