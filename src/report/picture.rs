//! Pictures inside a page.

use std::path::Path;

use super::experiment::Experiment;
use crate::image::diff::{HeatmapOptions, heatmap};
use crate::image::metrics::{RELMSE_EPSILON, error_map};
use crate::image::{Format, Image, WriteOptions, encode};

/// An image as a `data:` URI of its PNG.
pub fn data_uri(image: &Image, exposure: f32) -> Option<String> {
    let options = WriteOptions { exposure, ..WriteOptions::default() };
    let png = encode(image, Format::Png, &options, Path::new("report.html")).ok()?;
    Some(format!("data:image/png;base64,{}", base64(&png)))
}

/// For each series the error of its picture, √ of relMSE's terms, in false colour; all on one logarithmic scale, the ends
/// of which are returned too.
pub fn error_pictures(experiment: &Experiment) -> (Vec<Option<Image>>, (f64, f64)) {
    let reference = &experiment.reference.image;
    let relative = |x: f64, r: f64| (x - r).powi(2) / (r * r + RELMSE_EPSILON * RELMSE_EPSILON);
    let maps: Vec<Option<Vec<f64>>> = experiment
        .series
        .iter()
        .map(|s| {
            let map = error_map(s.picture.as_ref()?, reference, relative).ok()?;
            Some(map.into_iter().map(f64::sqrt).collect())
        })
        .collect();
    // Let the scale end where 99.9 % of all pixels are below it, and reach over three decades.
    let mut all: Vec<f64> = maps.iter().flatten().flatten().copied().filter(|v| *v > 0.0).collect();
    all.sort_unstable_by(f64::total_cmp);
    let high = super::stats::quantile(&all, 0.999);
    let high = if high > 0.0 { 10f64.powf((10.0 * high.log10()).ceil() / 10.0) } else { 1.0 };
    let range = (high / 1000.0, high);
    let options = HeatmapOptions { range: Some(range), log: true };
    let (w, h) = (reference.width(), reference.height());
    (maps.into_iter().map(|m| m.map(|m| heatmap(&m, w, h, &options))).collect(), range)
}

/// Base 64 of RFC 4648.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let at = |i: usize| u32::from(chunk.get(i).copied().unwrap_or(0));
        let bits = at(0) << 16 | at(1) << 8 | at(2);
        for k in 0..4 {
            let digit = DIGITS[(bits >> (18 - 6 * k)) as usize & 63];
            text.push(if k <= chunk.len() { char::from(digit) } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The examples of RFC 4648, section 10.
    #[test]
    fn base64_of_the_standards_examples() {
        for (plain, coded) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")] {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
        assert_eq!(base64(&[0xff, 0xef, 0xbe]), "/+++");
    }
}
