//! Linear colour: `Rgb` in the sRGB / Rec. 709 primaries, and its transfer curve.

mod rgb;
pub mod rgbe;
mod spectrum;

pub use rgb::{Rgb, linear_to_srgb, srgb_to_linear};
pub use spectrum::{Illuminant, blackbody_to_rgb, cie_xyz, spectrum_to_rgb, xyz_to_rgb};
