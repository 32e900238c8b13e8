//! ꟻLIP: the difference that a person would see when flipping between two pictures [Andersson et al. 2020, "FLIP: A
//! Difference Evaluator for Alternating Images"]; section numbers in the comments are those of the paper.
//!
//! Written from the paper, in f64. The crate `nv-flip` binds the authors' C++ and would need its compiler.

use rayon::prelude::*;

use super::Image;
use super::metrics::{self, Metric, MetricError};

/// Pixels per degree of visual angle: 0.7 m from a screen 0.7 m and 3840 pixels wide, the paper's default.
pub const PIXELS_PER_DEGREE: f64 = 0.7 * (3840.0 / 0.7) * std::f64::consts::PI / 180.0;

/// Exponents and the bend of the error map, sections 4.1.4 and 4.3.
const QC: f64 = 0.7;
const PC: f64 = 0.4;
const PT: f64 = 0.95;
const QF: f64 = 0.5;
/// Width in degrees of the features that count, section 4.2.
const FEATURE_WIDTH: f64 = 0.082;
/// Contrast sensitivity as sums of two Gaussians (a₁, b₁, a₂, b₂) for lightness, red–green, blue–yellow, section 4.1.1.
const SENSITIVITY: [[f64; 4]; 3] = [[1.0, 0.0047, 0.0, 1e-5], [1.0, 0.0053, 0.0, 1e-5], [34.1, 0.04, 13.5, 0.025]];

type Triple = [f64; 3];

/// The ꟻLIP error of each pixel, 0 (none) to 1, of two pictures as a screen shows them: linear values after
/// `exposure` stops, clamped to 0…1.
pub fn flip_map(
    image: &Image,
    reference: &Image,
    exposure: f64,
    pixels_per_degree: f64,
) -> Result<Vec<f64>, MetricError> {
    metrics::check(image, reference)?;
    let gain = exposure.exp2();
    let shown = |i: &Image| -> Vec<Triple> {
        i.pixels().par_iter().map(|p| p.to_array().map(|v| (f64::from(v) * gain).clamp(0.0, 1.0))).collect()
    };
    let width = image.width() as usize;
    Ok(flip_shown(&shown(image), &shown(reference), width, pixels_per_degree))
}

/// Mean ꟻLIP at no exposure and the default viewing distance, plain and trimmed.
pub fn flip(image: &Image, reference: &Image) -> Result<Metric, MetricError> {
    flip_map(image, reference, 0.0, PIXELS_PER_DEGREE).map(metrics::summarise)
}

/// HDR-ꟻLIP: the largest ꟻLIP error over a range of exposures [Andersson et al. 2021, "Visualizing Errors in Rendered
/// High Dynamic Range Images"].
#[derive(Clone, Debug, PartialEq)]
pub struct HdrFlip {
    /// The error of each pixel, 0 to 1.
    pub map: Vec<f64>,
    /// First and last exposure in stops and how many there are, evenly spaced.
    pub start: f64,
    pub stop: f64,
    pub exposures: usize,
}

/// Compares two linear pictures under every exposure from that which leaves the reference's brightest pixel just below
/// white to that which does so for its median, through the ACES tone curve. Negative values count as 0; a black reference
/// is shown at exposure 0.
pub fn flip_hdr(image: &Image, reference: &Image, pixels_per_degree: f64) -> Result<HdrFlip, MetricError> {
    metrics::check(image, reference)?;
    let (start, stop) = exposure_range(reference);
    let exposures = if start < stop { ((stop - start).ceil() as usize).max(2) } else { 1 };
    let step = if exposures > 1 { (stop - start) / (exposures - 1) as f64 } else { 0.0 };
    let width = image.width() as usize;
    let mut map = vec![0f64; image.pixels().len()];
    for k in 0..exposures {
        let gain = (start + k as f64 * step).exp2();
        let shown = |i: &Image| -> Vec<Triple> {
            i.pixels().par_iter().map(|p| p.to_array().map(|v| aces(f64::from(v).max(0.0) * gain))).collect()
        };
        let errors = flip_shown(&shown(image), &shown(reference), width, pixels_per_degree);
        for (m, e) in map.iter_mut().zip(errors) {
            *m = m.max(e);
        }
    }
    Ok(HdrFlip { map, start, stop, exposures })
}

/// Numerator and denominator of the ACES curve fit, the exposure of 0.6 multiplied in, highest power first.
const ACES: [Triple; 2] = [[0.36 * 2.51, 0.6 * 0.03, 0.0], [0.36 * 2.43, 0.6 * 0.59, 0.14]];

fn aces(v: f64) -> f64 {
    // Beyond this the curve is at its end already, and squares stay finite.
    let v = v.min(1e30);
    let at = |[a, b, c]: Triple| (a * v + b) * v + c;
    (at(ACES[0]) / at(ACES[1])).clamp(0.0, 1.0)
}

/// Where the tone curve gives 0.85 for the brightest and for the median luminance of the reference.
fn exposure_range(reference: &Image) -> (f64, f64) {
    const TARGET: f64 = 0.85;
    let luminance = |p: &crate::color::Rgb| 0.2126 * f64::from(p.r) + 0.7152 * f64::from(p.g) + 0.0722 * f64::from(p.b);
    let mut luminances: Vec<f64> = reference.pixels().iter().map(luminance).collect();
    luminances.sort_unstable_by(f64::total_cmp);
    let (largest, median) = (luminances[luminances.len() - 1], luminances[luminances.len() / 2]);
    if largest <= 0.0 {
        return (0.0, 0.0);
    }
    // Solve curve(x) = 0.85, a quadratic equation.
    let [a, b, c] = [0, 1, 2].map(|i| ACES[0][i] - TARGET * ACES[1][i]);
    let half = -0.5 * b / a;
    let x = half + (half * half - c / a).sqrt();
    let start = (x / largest).log2();
    (start, (x / median.max(f64::from(f32::EPSILON))).log2().max(start))
}

/// ꟻLIP of linear colours between 0 and 1.
fn flip_shown(image: &[Triple], reference: &[Triple], width: usize, ppd: f64) -> Vec<f64> {
    let (opponent_x, opponent_r) = (map(image, to_opponent), map(reference, to_opponent));
    let (seen_x, seen_r) = (perceived(&opponent_x, width, ppd), perceived(&opponent_r, width, ppd));
    let (features_x, features_r) = (features(&opponent_x, width, ppd), features(&opponent_r, width, ppd));
    let scale = ColorScale::new();
    (0..image.len())
        .into_par_iter()
        .map(|i| {
            let color = scale.error(seen_x[i], seen_r[i]);
            // Section 4.2: edges and points that are in one picture only.
            let difference = |k: usize| (features_x[i][k] - features_r[i][k]).abs();
            let feature = (difference(0).max(difference(1)) / std::f64::consts::SQRT_2).powf(QF);
            // Section 4.3: features make colour differences count more.
            color.powf(1.0 - feature)
        })
        .collect()
}

/// Section 4.1.1 and 4.1.2: blurs as the eye does at this distance and goes to Hunt-adjusted L*a*b*.
fn perceived(opponent: &[Triple], width: usize, ppd: f64) -> Vec<Triple> {
    use std::f64::consts::PI;
    let broadest = SENSITIVITY[2][1];
    let radius = (3.0 * (broadest / (2.0 * PI * PI)).sqrt() * ppd).ceil() as i64;
    // Each kernel is a sum of two separable Gaussians; the second is used by blue–yellow alone.
    let gauss =
        |b: f64| -> Vec<f64> { (-radius..=radius).map(|x| (-PI * PI * (x as f64 / ppd).powi(2) / b).exp()).collect() };
    let (mut first, mut second) = ([(); 3].map(|()| Vec::new()), Vec::new());
    for (channel, [a1, b1, a2, b2]) in SENSITIVITY.into_iter().enumerate() {
        let (g1, g2) = (gauss(b1), gauss(b2));
        let (s1, s2): (f64, f64) = (g1.iter().sum(), g2.iter().sum());
        let (w1, w2) = (a1 * (PI / b1).sqrt() * s1 * s1, a2 * (PI / b2).sqrt() * s2 * s2);
        // Share the weight of each two-dimensional Gaussian between its two passes.
        let normalised = |g: Vec<f64>, s: f64, w: f64| -> Vec<f64> {
            let factor = (w / (w1 + w2)).sqrt() / s;
            g.into_iter().map(|v| v * factor).collect()
        };
        first[channel] = normalised(g1, s1, w1);
        if channel == 2 {
            second = normalised(g2, s2, w2);
        }
    }
    let across: Vec<[f64; 4]> = filter(opponent, width, radius, Axis::X, |tap, [l, rg, by], sum: &mut [f64; 4]| {
        sum[0] += first[0][tap] * l;
        sum[1] += first[1][tap] * rg;
        sum[2] += first[2][tap] * by;
        sum[3] += second[tap] * by;
    });
    let both: Vec<[f64; 4]> = filter(&across, width, radius, Axis::Y, |tap, [l, rg, by1, by2], sum: &mut [f64; 4]| {
        sum[0] += first[0][tap] * l;
        sum[1] += first[1][tap] * rg;
        sum[2] += first[2][tap] * by1;
        sum[3] += second[tap] * by2;
    });
    both.into_par_iter()
        .map(|[l, rg, by1, by2]| hunt(to_lab(from_opponent([l, rg, by1 + by2]).map(|v| v.clamp(0.0, 1.0)))))
        .collect()
}

/// Section 4.2: strength of edges and of points in the lightness, by first and second Gaussian derivatives.
fn features(opponent: &[Triple], width: usize, ppd: f64) -> Vec<[f64; 2]> {
    let deviation = 0.5 * FEATURE_WIDTH * ppd;
    let radius = (3.0 * deviation).ceil() as i64;
    let kernel = |f: &dyn Fn(f64) -> f64| -> Vec<f64> {
        let g = |x: f64| (-x * x / (2.0 * deviation * deviation)).exp();
        let mut taps: Vec<f64> = (-radius..=radius).map(|x| f(x as f64) * g(x as f64)).collect();
        // Scale the positive and the negative taps to a sum of 1 each.
        let positive: f64 = taps.iter().filter(|t| **t > 0.0).sum();
        let negative: f64 = -taps.iter().filter(|t| **t < 0.0).sum::<f64>();
        for t in &mut taps {
            *t /= if *t > 0.0 { positive } else { negative.max(f64::MIN_POSITIVE) };
        }
        taps
    };
    let smooth = kernel(&|_| 1.0);
    let edge = kernel(&|x| -x);
    let point = kernel(&|x| x * x / (deviation * deviation) - 1.0);

    let lightness: Vec<f64> = opponent.par_iter().map(|[l, ..]| (l + 16.0) / 116.0).collect();
    let across: Vec<Triple> = filter(&lightness, width, radius, Axis::X, |tap, l, sum: &mut Triple| {
        sum[0] += smooth[tap] * l;
        sum[1] += edge[tap] * l;
        sum[2] += point[tap] * l;
    });
    let both: Vec<[f64; 4]> = filter(&across, width, radius, Axis::Y, |tap, [s, e, p], sum: &mut [f64; 4]| {
        sum[0] += smooth[tap] * e;
        sum[1] += edge[tap] * s;
        sum[2] += smooth[tap] * p;
        sum[3] += point[tap] * s;
    });
    both.into_par_iter().map(|[ex, ey, px, py]| [ex.hypot(ey), px.hypot(py)]).collect()
}

#[derive(Clone, Copy, PartialEq)]
enum Axis {
    X,
    Y,
}

/// For every pixel, calls `add(tap, value, sum)` with the values in a row or column around it; edges are continued.
fn filter<T: Copy + Sync, S: Default + Send>(
    values: &[T],
    width: usize,
    radius: i64,
    axis: Axis,
    add: impl Fn(usize, T, &mut S) + Sync,
) -> Vec<S> {
    let height = values.len() / width;
    (0..values.len())
        .into_par_iter()
        .with_min_len(4096)
        .map(|i| {
            let (x, y) = ((i % width) as i64, (i / width) as i64);
            let mut sum = S::default();
            for (tap, d) in (-radius..=radius).enumerate() {
                let at = match axis {
                    Axis::X => y as usize * width + (x + d).clamp(0, width as i64 - 1) as usize,
                    Axis::Y => (y + d).clamp(0, height as i64 - 1) as usize * width + x as usize,
                };
                add(tap, values[at], &mut sum);
            }
            sum
        })
        .collect()
}

/// Section 4.1.3 and 4.1.4: the distance of two colours as an error between 0 and 1.
struct ColorScale {
    largest: f64,
}

impl ColorScale {
    fn new() -> Self {
        let seen = |c| hunt(to_lab(c));
        Self { largest: hyab(seen([0.0, 1.0, 0.0]), seen([0.0, 0.0, 1.0])).powf(QC) }
    }

    fn error(&self, a: Triple, b: Triple) -> f64 {
        let distance = hyab(a, b).powf(QC);
        let bend = PC * self.largest;
        if distance < bend { PT * distance / bend } else { PT + (1.0 - PT) * (distance - bend) / (self.largest - bend) }
    }
}

/// City-block distance of lightness plus Euclidean distance of chroma.
fn hyab(a: Triple, b: Triple) -> f64 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}

/// Chroma counts less in the dark.
fn hunt([l, a, b]: Triple) -> Triple {
    [l, 0.01 * l * a, 0.01 * l * b]
}

/// Linear Rec. 709 to XYZ, exact for the primaries and the white point (0.3127, 0.3290).
const TO_XYZ: [Triple; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];

/// XYZ relative to white.
fn to_relative_xyz(c: Triple) -> Triple {
    TO_XYZ.map(|row| (row[0] * c[0] + row[1] * c[1] + row[2] * c[2]) / (row[0] + row[1] + row[2]))
}

fn from_relative_xyz(c: Triple) -> Triple {
    let m = glam::DMat3::from_cols_array_2d(&TO_XYZ).transpose();
    let white = m * glam::DVec3::ONE;
    (m.inverse() * (glam::DVec3::from(c) * white)).to_array()
}

/// The linear opponent space YCxCz.
fn to_opponent(c: Triple) -> Triple {
    let [x, y, z] = to_relative_xyz(c);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn from_opponent([l, cx, cz]: Triple) -> Triple {
    let y = (l + 16.0) / 116.0;
    from_relative_xyz([y + cx / 500.0, y, y - cz / 200.0])
}

fn to_lab(c: Triple) -> Triple {
    const DELTA: f64 = 6.0 / 29.0;
    let f = |t: f64| if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 };
    let [x, y, z] = to_relative_xyz(c).map(f);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn map(values: &[Triple], f: impl Fn(Triple) -> Triple + Sync) -> Vec<Triple> {
    values.par_iter().map(|&v| f(v)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::{Rgb, srgb_to_linear};

    /// A pair of 40 × 30 pictures of 8 bits: a pattern, and the same with red disturbed and a rectangle of other green.
    fn pair(decode: impl Fn(u32) -> f32) -> [Image; 2] {
        let reference = |x: u32, y: u32| [(13 * x + 7 * y) % 256, (x * y) % 256, 6 * x];
        let disturbed = |x: u32, y: u32| {
            let [r, g, b] = reference(x, y);
            let inside = (10..25).contains(&x) && (10..20).contains(&y);
            [r ^ ((x * y) % 32), if inside { 200 } else { g }, b]
        };
        let image = |f: &dyn Fn(u32, u32) -> [u32; 3]| Image::from_fn(40, 30, |x, y| Rgb::from(f(x, y).map(&decode)));
        [image(&disturbed), image(&reference)]
    }

    fn check(map: &[f64], mean: f64, pixels: [f64; 4]) {
        let found = metrics::summarise(map.to_vec()).value;
        assert!((found - mean).abs() < 1e-6, "mean {found}, expected {mean}");
        for ((x, y), expected) in [(0, 0), (12, 15), (31, 22), (39, 29)].into_iter().zip(pixels) {
            let found = map[y * 40 + x];
            assert!((found - expected).abs() < 1e-5, "pixel ({x}, {y}) {found}, expected {expected}");
        }
    }

    /// Numbers of the authors' implementation: PyPI's flip-evaluator 1.7, `evaluate(r / 255, t / 255, "LDR",
    /// applyMagma=False)` with the pair above as float32 arrays; the mean of its map was taken in f64.
    #[test]
    fn agrees_with_the_authors_implementation() {
        let [image, reference] = pair(|v| srgb_to_linear(v as f32 / 255.0));
        let map = flip_map(&image, &reference, 0.0, PIXELS_PER_DEGREE).expect("images of one size");
        check(&map, 0.163_246_642, [0.001_637_208, 0.413_117_349, 0.029_400_414, 0.071_587_242]);
    }

    /// The same with `"HDR"` for linear pictures (v / 255)²·8; it reports 3 exposures from −1.8500562 to 0.2711277.
    #[test]
    fn agrees_with_the_authors_implementation_for_high_dynamic_range() {
        let [image, reference] = pair(|v| (v as f32 / 255.0).powi(2) * 8.0);
        let hdr = flip_hdr(&image, &reference, PIXELS_PER_DEGREE).expect("images of one size");
        assert_eq!(hdr.exposures, 3);
        assert!((hdr.start + 1.850_056_2).abs() < 1e-5 && (hdr.stop - 0.271_127_7).abs() < 1e-5);
        check(&hdr.map, 0.165_964_562, [0.013_072_886, 0.351_216_227, 0.112_291_574, 0.028_395_060]);
    }

    #[test]
    fn no_difference_is_zero_and_the_largest_is_one() {
        let [image, _] = pair(|v| srgb_to_linear(v as f32 / 255.0));
        assert_eq!(flip(&image, &image).expect("images of one size").value, 0.0);
        // Pure green against pure blue is the scale's end: the colour error alone is 1, whatever the features.
        let (green, blue) = (Rgb::new(0.0, 1.0, 0.0), Rgb::new(0.0, 0.0, 1.0));
        let one = flip(&Image::constant(8, 8, green), &Image::constant(8, 8, blue)).expect("images of one size");
        assert!((one.value - 1.0).abs() < 1e-9, "{}", one.value);
    }

    #[test]
    fn odd_pictures_have_defined_errors() {
        let (black, white) = (Image::constant(3, 1, Rgb::BLACK), Image::constant(3, 1, Rgb::splat(1e38)));
        let hdr = flip_hdr(&white, &black, PIXELS_PER_DEGREE).expect("images of one size");
        assert!(hdr.exposures == 1 && hdr.map.iter().all(|e| (0.9..=1.0).contains(e)));
        let hdr = flip_hdr(&black, &white, PIXELS_PER_DEGREE).expect("images of one size");
        assert!(hdr.exposures == 1 && hdr.map.iter().all(|e| e.is_finite()));
        assert!(flip(&black, &Image::constant(1, 3, Rgb::BLACK)).is_err());
        assert!(flip(&black, &Image::constant(3, 1, Rgb::splat(f32::NAN))).is_err());
    }
}
