//! Error images: values in false colour above a scale bar with numbers.

use super::Image;
use super::palette::scale_color;
use crate::color::Rgb;

/// How values become colours.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HeatmapOptions {
    /// Values at the two ends of the scale; without it 0 (or the smallest positive value, if logarithmic) to the value
    /// that 99.9 % of the pixels stay below.
    pub range: Option<(f64, f64)>,
    /// Equal factors instead of equal differences are equally far apart.
    pub log: bool,
}

/// The false-colour picture of one value per pixel, with a scale bar below that tells the values at its ends and in its
/// middle. Pictures less than 256 pixels wide are enlarged by a whole factor. NaN is red.
///
/// # Panics
/// If there are not `width · height` values, or none.
pub fn heatmap(values: &[f64], width: u32, height: u32, options: &HeatmapOptions) -> Image {
    assert!(!values.is_empty() && values.len() == width as usize * height as usize, "one value per pixel");
    let scale = Scale::new(values, options);
    let zoom = 256u32.div_ceil(width).max(1);
    let (w, h) = (width * zoom, height * zoom);
    // Make the text larger with the picture: letters of 3 × 5 dots.
    let dot = (w / 300).max(1);
    let (gap, bar, text) = (2 * dot, 8 * dot, 5 * dot);
    let mut image = Image::from_fn(w, h + gap + bar + gap + text + gap, |x, y| {
        if y < h {
            scale_color(scale.position(values[(y / zoom) as usize * width as usize + (x / zoom) as usize]))
        } else if (h + gap..h + gap + bar).contains(&y) {
            scale_color(f64::from(x) / f64::from((w - 1).max(1)))
        } else {
            Rgb::WHITE
        }
    });
    let top = h + gap + bar + gap;
    for (t, anchor) in [(0.0, 0), (0.5, 1), (1.0, 2)] {
        let label = label(scale.value(t));
        let length = label.len() as u32 * 4 * dot;
        let left = match anchor {
            0 => dot,
            1 => (w / 2).saturating_sub(length / 2),
            _ => w.saturating_sub(length + dot),
        };
        draw(&mut image, &label, left, top, dot);
    }
    image
}

/// The map from values to positions on the scale.
struct Scale {
    low: f64,
    high: f64,
    log: bool,
}

impl Scale {
    fn new(values: &[f64], options: &HeatmapOptions) -> Self {
        let log = options.log;
        let (mut low, mut high) = options.range.unwrap_or_else(|| {
            let mut finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite() && (!log || *v > 0.0)).collect();
            finite.sort_unstable_by(f64::total_cmp);
            let at = |share: f64| finite.get((share * finite.len() as f64) as usize).or(finite.last()).copied();
            let low = if log { at(0.001).unwrap_or(1e-6) } else { at(0.0).unwrap_or(0.0).min(0.0) };
            (low, at(0.999).unwrap_or(1.0))
        });
        if log {
            low = low.max(1e-300);
        }
        if high.is_nan() || high <= low {
            high = if log { low * 10.0 } else { low + 1.0 };
        }
        Self { low, high, log }
    }

    fn position(&self, v: f64) -> f64 {
        match self.log {
            // Zero has no logarithm: it is below any scale.
            true if v <= 0.0 => 0.0,
            true => (v / self.low).ln() / (self.high / self.low).ln(),
            false => (v - self.low) / (self.high - self.low),
        }
    }

    fn value(&self, t: f64) -> f64 {
        match self.log {
            true => self.low * (self.high / self.low).powf(t),
            false => self.low + (self.high - self.low) * t,
        }
    }
}

/// Three significant digits, short.
fn label(v: f64) -> String {
    if v == 0.0 {
        return "0".into();
    }
    if (0.001..10_000.0).contains(&v.abs()) {
        let digits = (2 - v.abs().log10().floor() as i32).max(0) as usize;
        let text = format!("{v:.digits$}");
        return if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text };
    }
    format!("{v:.2e}")
}

/// Rows of three dots, from the top, for the characters of a number.
fn glyph(c: char) -> [u8; 5] {
    match c {
        '0' => [0b111, 0b101, 0b101, 0b101, 0b111],
        '1' => [0b010, 0b110, 0b010, 0b010, 0b111],
        '2' => [0b111, 0b001, 0b111, 0b100, 0b111],
        '3' => [0b111, 0b001, 0b111, 0b001, 0b111],
        '4' => [0b101, 0b101, 0b111, 0b001, 0b001],
        '5' => [0b111, 0b100, 0b111, 0b001, 0b111],
        '6' => [0b111, 0b100, 0b111, 0b101, 0b111],
        '7' => [0b111, 0b001, 0b010, 0b010, 0b010],
        '8' => [0b111, 0b101, 0b111, 0b101, 0b111],
        '9' => [0b111, 0b101, 0b111, 0b001, 0b111],
        'e' => [0b000, 0b111, 0b110, 0b100, 0b111],
        '-' => [0b000, 0b000, 0b111, 0b000, 0b000],
        '.' => [0b000, 0b000, 0b000, 0b000, 0b010],
        _ => [0; 5],
    }
}

fn draw(image: &mut Image, text: &str, left: u32, top: u32, dot: u32) {
    let (width, height) = (image.width(), image.height());
    for (i, c) in text.chars().enumerate() {
        for (row, bits) in glyph(c).into_iter().enumerate() {
            for column in (0..3u32).filter(|k| bits & (0b100 >> k) != 0) {
                let (x0, y0) = (left + (4 * i as u32 + column) * dot, top + row as u32 * dot);
                for (x, y) in (y0..y0 + dot).flat_map(|y| (x0..x0 + dot).map(move |x| (x, y))) {
                    if x < width && y < height {
                        image.pixels_mut()[(y * width + x) as usize] = Rgb::BLACK;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_take_their_place_on_the_scale() {
        let values: Vec<f64> = (0..300 * 10).map(|i| f64::from(i % 300)).collect();
        let options = HeatmapOptions { range: Some((0.0, 299.0)), log: false };
        let image = heatmap(&values, 300, 10, &options);
        assert_eq!(image.width(), 300);
        assert_eq!(image.height(), 10 + 2 + 8 + 2 + 5 + 2);
        for x in [0, 100, 299] {
            // The picture is a ramp, and the bar below shows the same ramp.
            assert_eq!(image.pixel(x, 3), scale_color(f64::from(x) / 299.0));
            assert_eq!(image.pixel(x, 15), image.pixel(x, 3));
        }
        // The label at the left is a zero: its corner is black, its middle white.
        assert_eq!((image.pixel(1, 22), image.pixel(2, 24)), (Rgb::BLACK, Rgb::WHITE));
    }

    #[test]
    fn logarithmic_scales_put_factors_at_equal_distance() {
        let scale = Scale::new(&[], &HeatmapOptions { range: Some((0.01, 100.0)), log: true });
        assert!((scale.position(1.0) - 0.5).abs() < 1e-12 && scale.position(0.0) == 0.0);
        assert!((scale.value(0.75) - 10.0).abs() < 1e-9);
    }

    #[test]
    fn odd_values_have_defined_colours() {
        for log in [false, true] {
            for values in [[0.0; 4], [f64::NAN; 4], [f64::INFINITY; 4], [-1.0, 0.0, 1e-320, 1e300]] {
                let image = heatmap(&values, 2, 2, &HeatmapOptions { range: None, log });
                assert_eq!(image.width(), 256);
                assert!(image.first_non_finite().is_none());
            }
        }
        assert_eq!(heatmap(&[f64::NAN], 1, 1, &HeatmapOptions::default()).pixel(9, 9), Rgb::new(1.0, 0.0, 0.0));
    }

    #[test]
    fn labels_are_short() {
        let labels = [0.0, 1.0, 0.5, 12.345, 9999.0, 0.001234, 1.5e-7, -2.5e9].map(label);
        assert_eq!(labels, ["0", "1", "0.5", "12.3", "9999", "0.00123", "1.50e-7", "-2.50e9"]);
    }
}
