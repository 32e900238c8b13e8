//! How far an image x is from a reference r. Sums are f64; every mean runs over pixels and colour channels alike.
//!
//! | metric | definition |
//! |---|---|
//! | RMSE   | √ mean (x−r)² |
//! | relMSE | mean (x−r)² / (r² + ε²), ε = [`RELMSE_EPSILON`] [Rousselle et al. 2011, with ε² added] |
//! | MRSE   | mean (x−r)² / (r + 0.01·mean r)², the same for any exposure |
//! | SMAPE  | mean of abs(x−r) / (abs x + abs r + 0.01·mean r), between 0 and 1 |
//!
//! The trimmed variants leave out the [`TRIM`] share of pixels that have the largest error and say how much of the
//! whole error those pixels hold. Defined cases: a black reference has no scale, so MRSE is 0 for an equally black image
//! and undefined (`None`) for any other, and a 0/0 term of SMAPE is 0. NaN, infinities, unequal sizes and empty images
//! are errors.

use std::fmt;

use super::Image;
use crate::color::Rgb;

/// ε of relMSE, in the unit of the pixels.
pub const RELMSE_EPSILON: f64 = 0.01;
/// The part of the reference's mean that MRSE and SMAPE add to their denominators.
pub const MEAN_SHARE: f64 = 0.01;
/// The share of pixels that the trimmed variants leave out, rounded down to whole pixels.
pub const TRIM: f64 = 0.001;

/// Why two images cannot be compared.
#[derive(Clone, Debug, PartialEq)]
pub enum MetricError {
    /// Width and height of the image and of the reference.
    SizeMismatch { image: (u32, u32), reference: (u32, u32) },
    /// An image without pixels.
    Empty,
    /// NaN or infinity: how many pixels have one, and the first of them.
    NotFinite { reference: bool, count: usize, x: u32, y: u32 },
}

impl fmt::Display for MetricError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::SizeMismatch { image: (w, h), reference: (rw, rh) } => {
                write!(f, "the image has {w} × {h} pixels, the reference {rw} × {rh}: render both at one size")
            }
            Self::Empty => write!(f, "there is no pixel to compare"),
            Self::NotFinite { reference, count, x, y } => {
                let which = if *reference { "the reference" } else { "the image" };
                write!(f, "{which} has {count} pixels with NaN or infinity, the first at ({x}, {y})")
            }
        }
    }
}

impl std::error::Error for MetricError {}

/// A mean error without its largest pixels.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Trimmed {
    pub value: f64,
    /// Pixels left out.
    pub pixels: usize,
    /// Their share of the sum of all errors (of squared errors for the squared metrics), 0 to 1.
    pub energy: f64,
}

/// One metric, over all pixels and trimmed.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Metric {
    pub value: f64,
    pub trimmed: Trimmed,
}

/// √ mean (x−r)², in the unit of the pixels.
pub fn rmse(x: &Image, r: &Image) -> Result<Metric, MetricError> {
    let m = mean_error(x, r, |x, r| sqr(x - r))?;
    let trimmed = Trimmed { value: m.trimmed.value.sqrt(), ..m.trimmed };
    Ok(Metric { value: m.value.sqrt(), trimmed })
}

/// mean (x−r)² / (r² + ε²).
pub fn relmse(x: &Image, r: &Image) -> Result<Metric, MetricError> {
    mean_error(x, r, |x, r| sqr(x - r) / (r * r + sqr(RELMSE_EPSILON)))
}

/// mean (x−r)² / (r + 0.01·mean r)²; `None` for a black reference and an image that is not.
pub fn mrse(x: &Image, r: &Image) -> Result<Option<Metric>, MetricError> {
    check(x, r)?;
    let offset = MEAN_SHARE * mean(r)?;
    let black = |image: &Image| image.pixels().iter().all(|p| p.is_black());
    if offset == 0.0 && black(r) && !black(x) {
        return Ok(None);
    }
    mean_error(x, r, |x, r| ratio(sqr(x - r), sqr(r + offset))).map(Some)
}

/// mean |x−r| / (|x| + |r| + 0.01·mean r).
pub fn smape(x: &Image, r: &Image) -> Result<Metric, MetricError> {
    check(x, r)?;
    let offset = MEAN_SHARE * mean(r)?.abs();
    mean_error(x, r, |x, r| ratio((x - r).abs(), x.abs() + r.abs() + offset))
}

/// The mean over all pixels and channels.
pub fn mean(image: &Image) -> Result<f64, MetricError> {
    let [r, g, b] = mean_rgb(image)?;
    Ok((r + g + b) / 3.0)
}

/// The mean of each channel.
pub fn mean_rgb(image: &Image) -> Result<[f64; 3], MetricError> {
    if image.pixels().is_empty() {
        return Err(MetricError::Empty);
    }
    check_finite(image, false)?;
    let mut sum = [0.0; 3];
    for p in image.pixels() {
        for (s, v) in sum.iter_mut().zip(p.to_array()) {
            *s += f64::from(v);
        }
    }
    Ok(sum.map(|s| s / image.pixels().len() as f64))
}

/// The error of each pixel, mean over its channels of `f(x, r)`; the base of every metric and of error images.
pub fn error_map(x: &Image, r: &Image, f: impl Fn(f64, f64) -> f64) -> Result<Vec<f64>, MetricError> {
    check(x, r)?;
    let pixel = |(x, r): (&Rgb, &Rgb)| (0..3).map(|k| f(f64::from(x[k]), f64::from(r[k]))).sum::<f64>() / 3.0;
    Ok(x.pixels().iter().zip(r.pixels()).map(pixel).collect())
}

/// Mean of per-pixel errors, plain and trimmed.
pub fn summarise(mut errors: Vec<f64>) -> Metric {
    let n = errors.len();
    let total: f64 = errors.iter().sum();
    let dropped = (TRIM * n as f64).floor() as usize;
    let mut rest = total;
    if dropped > 0 {
        // Bring the largest errors behind the others, then sum what stays in front.
        errors.select_nth_unstable_by(n - dropped, f64::total_cmp);
        rest = errors[..n - dropped].iter().sum();
    }
    let energy = if total > 0.0 { ((total - rest) / total).clamp(0.0, 1.0) } else { 0.0 };
    let trimmed = Trimmed { value: rest / (n - dropped).max(1) as f64, pixels: dropped, energy };
    Metric { value: total / n.max(1) as f64, trimmed }
}

fn mean_error(x: &Image, r: &Image, f: impl Fn(f64, f64) -> f64) -> Result<Metric, MetricError> {
    error_map(x, r, f).map(summarise)
}

pub(super) fn check(x: &Image, r: &Image) -> Result<(), MetricError> {
    let (image, reference) = ((x.width(), x.height()), (r.width(), r.height()));
    if image != reference {
        return Err(MetricError::SizeMismatch { image, reference });
    }
    if x.pixels().is_empty() {
        return Err(MetricError::Empty);
    }
    check_finite(r, true)?;
    check_finite(x, false)
}

fn check_finite(image: &Image, reference: bool) -> Result<(), MetricError> {
    let Some((x, y)) = image.first_non_finite() else { return Ok(()) };
    let count = image.pixels().iter().filter(|p| !p.is_finite()).count();
    Err(MetricError::NotFinite { reference, count, x, y })
}

fn ratio(a: f64, b: f64) -> f64 {
    if a == 0.0 { 0.0 } else { a / b }
}

fn sqr(v: f64) -> f64 {
    v * v
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(values: &[f32]) -> Image {
        Image::rgb(values.len() as u32, 1, values.iter().map(|&v| Rgb::splat(v)).collect())
    }

    fn close(a: f64, b: f64) {
        assert!((a - b).abs() <= 1e-12 * b.abs().max(1e-3), "{a} is not {b}");
    }

    /// x = (1, 3), r = (2, 1): differences −1 and 2, mean of r 1.5, offset 0.015.
    #[test]
    fn hand_computed_values() {
        let (x, r) = (grey(&[1.0, 3.0]), grey(&[2.0, 1.0]));
        close(rmse(&x, &r).expect("images of one size").value, 2.5f64.sqrt());
        close(relmse(&x, &r).expect("images of one size").value, 0.5 * (1.0 / 4.0001 + 4.0 / 1.0001));
        close(
            mrse(&x, &r).expect("images of one size").expect("a reference with light").value,
            0.5 * (1.0 / 2.015f64.powi(2) + 4.0 / 1.015f64.powi(2)),
        );
        close(smape(&x, &r).expect("images of one size").value, 0.5 * (1.0 / 3.015 + 2.0 / 4.015));
        close(mean(&x).expect("finite pixels"), 2.0);
    }

    /// One channel of one pixel differs by 3: the mean runs over channels too, so MSE = 9 / 3.
    #[test]
    fn channels_count_alike() {
        let x = Image::rgb(1, 1, vec![Rgb::new(4.0, 1.0, 1.0)]);
        let r = Image::rgb(1, 1, vec![Rgb::splat(1.0)]);
        close(rmse(&x, &r).expect("images of one size").value, 3f64.sqrt());
        assert_eq!(mean_rgb(&x).expect("finite pixels"), [4.0, 1.0, 1.0]);
    }

    /// 2000 pixels with error 1, two of them with error 100: trimming leaves out exactly those two.
    #[test]
    fn trimming_leaves_out_the_largest_and_says_their_share() {
        let mut values = vec![2.0f32; 2000];
        values[17] = 101.0;
        values[1200] = 101.0;
        let m = rmse(&grey(&values), &grey(&vec![1.0; 2000])).expect("images of one size");
        close(m.value, ((1998.0 + 2.0 * 10_000.0) / 2000.0f64).sqrt());
        close(m.trimmed.value, 1.0);
        assert_eq!(m.trimmed.pixels, 2);
        close(m.trimmed.energy, 20_000.0 / 21_998.0);
    }

    #[test]
    fn exposure_does_not_move_mrse_and_smape() {
        let (x, r) = (grey(&[0.25, 3.0, 0.0, 1.0]), grey(&[0.5, 1.0, 0.125, 0.0]));
        let scaled = |i: &Image| grey(&i.pixels().iter().map(|p| p.r * 1024.0).collect::<Vec<_>>());
        let (xs, rs) = (scaled(&x), scaled(&r));
        close(
            mrse(&xs, &rs).expect("images of one size").expect("a reference with light").value,
            mrse(&x, &r).expect("images of one size").expect("a reference with light").value,
        );
        close(smape(&xs, &rs).expect("images of one size").value, smape(&x, &r).expect("images of one size").value);
    }

    #[test]
    fn black_references_have_defined_values() {
        let (black, lit) = (grey(&[0.0, 0.0]), grey(&[1.0, 0.0]));
        assert_eq!(
            mrse(&black, &black).expect("images of one size").expect("no error, so no division by zero").value,
            0.0
        );
        assert_eq!(mrse(&lit, &black).expect("images of one size"), None);
        close(relmse(&lit, &black).expect("images of one size").value, 0.5 / 1e-4);
        close(smape(&lit, &black).expect("images of one size").value, 0.5);
        assert_eq!(rmse(&black, &black).expect("images of one size").trimmed.energy, 0.0);
    }

    #[test]
    fn what_cannot_be_compared_says_why() {
        let two = grey(&[1.0, 1.0]);
        let error = rmse(&two, &grey(&[1.0])).unwrap_err();
        assert_eq!(error, MetricError::SizeMismatch { image: (2, 1), reference: (1, 1) });
        assert_eq!(mean(&Image::default()).unwrap_err(), MetricError::Empty);
        assert_eq!(smape(&Image::default(), &Image::default()).unwrap_err(), MetricError::Empty);
        let nan = grey(&[1.0, f32::NAN]);
        let error = mrse(&nan, &two).unwrap_err();
        assert_eq!(error, MetricError::NotFinite { reference: false, count: 1, x: 1, y: 0 });
        assert!(relmse(&two, &nan).unwrap_err().to_string().contains("reference has 1 pixels"));
        assert!(rmse(&grey(&[f32::INFINITY, 0.0]), &two).is_err());
    }
}
