//! All metrics of a pair of images at once.

use super::Image;
use super::flip;
use super::metrics::{self, Metric, MetricError};

/// How far an image is from a reference. Everything serialises; `null` stands for an undefined value.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Comparison {
    pub width: u32,
    pub height: u32,
    /// Mean of each channel.
    pub mean_image: [f64; 3],
    pub mean_reference: [f64; 3],
    /// Mean of all channels of the image over that of the reference, minus 1; `None` for a reference of mean 0.
    pub mean_difference: Option<f64>,
    pub rmse: Metric,
    pub relmse: Metric,
    /// `None` if the reference is black and the image is not.
    pub mrse: Option<Metric>,
    pub smape: Metric,
    /// Mean ꟻLIP of the pictures as a screen shows them, without exposure or tone curve.
    pub flip: Metric,
    /// Largest difference of any channel, and the pixel (x, y) where it is.
    pub max_difference: f64,
    pub max_at: (u32, u32),
}

/// Compares an image with a reference of the same size.
pub fn compare(image: &Image, reference: &Image) -> Result<Comparison, MetricError> {
    metrics::check(image, reference)?;
    let (mean_image, mean_reference) = (metrics::mean_rgb(image)?, metrics::mean_rgb(reference)?);
    let total = |m: [f64; 3]| m.iter().sum::<f64>();
    let mean_difference = (total(mean_reference) != 0.0).then(|| total(mean_image) / total(mean_reference) - 1.0);
    let (mut max_difference, mut max_index) = (0.0, 0);
    for (i, (x, r)) in image.pixels().iter().zip(reference.pixels()).enumerate() {
        for k in 0..3 {
            let difference = (f64::from(x[k]) - f64::from(r[k])).abs();
            if difference > max_difference {
                (max_difference, max_index) = (difference, i as u32);
            }
        }
    }
    Ok(Comparison {
        width: image.width(),
        height: image.height(),
        mean_image,
        mean_reference,
        mean_difference,
        rmse: metrics::rmse(image, reference)?,
        relmse: metrics::relmse(image, reference)?,
        mrse: metrics::mrse(image, reference)?,
        smape: metrics::smape(image, reference)?,
        flip: flip::flip(image, reference)?,
        max_difference,
        max_at: (max_index % image.width(), max_index / image.width()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Rgb;

    #[test]
    fn equal_images_have_no_error() {
        let image = Image::from_fn(8, 4, |x, y| Rgb::new(x as f32, y as f32, 1.0));
        let c = compare(&image, &image).expect("images of one size");
        assert_eq!((c.rmse.value, c.relmse.value, c.smape.value, c.max_difference), (0.0, 0.0, 0.0, 0.0));
        assert_eq!(c.mean_image, [3.5, 1.5, 1.0]);
        assert_eq!(c.mean_difference, Some(0.0));
    }

    #[test]
    fn the_comparison_serialises_with_null_for_undefined() {
        let black = Image::constant(2, 2, Rgb::BLACK);
        let mut lit = black.clone();
        lit.pixels_mut()[3] = Rgb::new(0.0, 2.0, 0.0);
        let c = compare(&lit, &black).expect("images of one size");
        assert_eq!((c.max_difference, c.max_at), (2.0, (1, 1)));
        let json = serde_json::to_value(c).expect("plain structures");
        assert!(json["mrse"].is_null() && json["mean_difference"].is_null());
        assert_eq!(json["rmse"]["trimmed"]["pixels"], 0);
        // One channel of twelve differs by 2.
        assert!((json["rmse"]["value"].as_f64().expect("a number") - (4.0f64 / 12.0).sqrt()).abs() < 1e-12);
    }
}
