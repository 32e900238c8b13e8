//! Linear colour: `Rgb` in the sRGB / Rec. 709 primaries, and its transfer curve.

mod rgb;

pub use rgb::{Rgb, linear_to_srgb, srgb_to_linear};
