//! A colour scale from dark violet over teal to yellow: lightness rises evenly, so that it reads the same in grey print
//! and to a colour-blind eye. Computed as an arc in Oklab [Ottosson 2020].

use std::sync::OnceLock;

use crate::color::Rgb;

const STEPS: usize = 256;

/// The linear colour for `t` from 0 to 1; outside it the nearest end, and red for NaN.
pub fn scale_color(t: f64) -> Rgb {
    static TABLE: OnceLock<Vec<Rgb>> = OnceLock::new();
    if t.is_nan() {
        return Rgb::new(1.0, 0.0, 0.0);
    }
    let table = TABLE.get_or_init(|| (0..STEPS).map(|i| arc(i as f64 / (STEPS - 1) as f64)).collect());
    table[(t.clamp(0.0, 1.0) * (STEPS - 1) as f64).round() as usize]
}

/// Lightness 0.25 to 0.93, hue from 300° (violet) down to 105° (yellow), as much chroma up to 0.16 as sRGB can show.
fn arc(t: f64) -> Rgb {
    let lightness = 0.25 + 0.68 * t;
    let hue = (300.0 - 195.0 * t).to_radians();
    // Halve the interval of chroma until the colour just fits into the cube.
    let (mut low, mut high) = (0.0, 0.16);
    for _ in 0..24 {
        let chroma = 0.5 * (low + high);
        let c = from_oklab(lightness, chroma * hue.cos(), chroma * hue.sin());
        if c.iter().all(|v| (0.0..=1.0).contains(v)) {
            low = chroma;
        } else {
            high = chroma;
        }
    }
    Rgb::from(from_oklab(lightness, low * hue.cos(), low * hue.sin()).map(|v| v.clamp(0.0, 1.0) as f32))
}

/// Oklab to linear Rec. 709.
fn from_oklab(l: f64, a: f64, b: f64) -> [f64; 3] {
    let cube = |v: f64| v * v * v;
    let l_ = cube(l + 0.396_337_777_4 * a + 0.215_803_757_3 * b);
    let m_ = cube(l - 0.105_561_345_8 * a - 0.063_854_172_8 * b);
    let s_ = cube(l - 0.089_484_177_5 * a - 1.291_485_548_0 * b);
    [
        4.076_741_662_1 * l_ - 3.307_711_591_3 * m_ + 0.230_969_929_2 * s_,
        -1.268_438_004_6 * l_ + 2.609_757_401_1 * m_ - 0.341_319_396_5 * s_,
        -0.004_196_086_3 * l_ - 0.703_418_614_7 * m_ + 1.707_614_701_0 * s_,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn luminance_rises_all_the_way() {
        let y: Vec<f32> = (0..STEPS).map(|i| scale_color(i as f64 / 255.0).luminance()).collect();
        assert!(y.windows(2).all(|w| w[1] > w[0]));
        assert!(y[0] < 0.03 && y[255] > 0.7);
        assert_eq!(scale_color(-3.0), scale_color(0.0));
        assert_eq!(scale_color(f64::INFINITY), scale_color(1.0));
        assert_eq!(scale_color(f64::NAN), Rgb::new(1.0, 0.0, 0.0));
    }
}
