use glam::{Affine2, Vec2};

use super::{TexelGrid, scalar};
use crate::color::Rgb;
use crate::image::Image;

/// What lies outside the unit square.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wrap {
    /// The picture again.
    #[default]
    Repeat,
    /// The picture again, mirrored every other time.
    Mirror,
    /// The nearest edge texel.
    Clamp,
}

/// How values between texel centres are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Filter {
    #[default]
    Bilinear,
    Nearest,
}

/// How a bitmap is laid onto a surface; Mitsuba's defaults.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BitmapSettings {
    pub wrap: Wrap,
    pub filter: Filter,
    /// From the surface's uv to the bitmap's.
    pub to_uv: Affine2,
}

#[derive(Clone, Debug)]
enum Texels {
    Grey(Vec<f32>),
    Color(Vec<Rgb>),
}

/// A picture on a surface. Whether its numbers are colours or raw data was decided when the image was read.
#[derive(Clone, Debug)]
pub struct Bitmap {
    width: u32,
    height: u32,
    texels: Texels,
    settings: BitmapSettings,
    mean: Rgb,
}

/// The four texels around a point and the bilinear weights (x, y) of the right and lower ones.
struct Footprint {
    texels: [usize; 4],
    weight: Vec2,
}

impl Bitmap {
    /// A texture from the colours of an image. Grey images keep one number per texel.
    ///
    /// # Panics
    /// If the image has no pixels.
    pub fn new(image: &Image, settings: BitmapSettings) -> Self {
        let pixels = image.pixels();
        assert!(!pixels.is_empty(), "a bitmap texture needs at least one pixel");
        let grey = pixels.iter().all(|c| c.r == c.g && c.g == c.b);
        let texels = match grey {
            true => Texels::Grey(pixels.iter().map(|c| c.r).collect()),
            false => Texels::Color(pixels.to_vec()),
        };
        let mut sum = [0f64; 3];
        for p in pixels {
            for (s, v) in sum.iter_mut().zip(p.to_array()) {
                *s += f64::from(v);
            }
        }
        let mean = Rgb::from(sum.map(|s| (s / pixels.len() as f64) as f32));
        Self { width: image.width(), height: image.height(), texels, settings, mean }
    }

    /// Texels in a row and rows.
    pub fn resolution(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// True when every texel is a grey.
    pub fn is_grey(&self) -> bool {
        matches!(self.texels, Texels::Grey(_))
    }

    /// The mean of all texels.
    pub fn mean(&self) -> Rgb {
        self.mean
    }

    /// The least and the greatest value of any texel, channel by channel.
    pub(super) fn color_range(&self) -> (Rgb, Rgb) {
        let none = (f32::INFINITY, f32::NEG_INFINITY);
        match &self.texels {
            Texels::Grey(t) => {
                let (low, high) = t.iter().fold(none, |(low, high), &v| (low.min(v), high.max(v)));
                (Rgb::splat(low), Rgb::splat(high))
            }
            Texels::Color(t) => t.iter().fold((Rgb::splat(none.0), Rgb::splat(none.1)), |(low, high), &c| {
                (low.zip(c, f32::min), high.zip(c, f32::max))
            }),
        }
    }

    /// Heap bytes of the texels.
    pub fn memory(&self) -> usize {
        match &self.texels {
            Texels::Grey(t) => size_of_val(&t[..]),
            Texels::Color(t) => size_of_val(&t[..]),
        }
    }

    /// The texel in column `x` of row `y` from the top.
    pub fn texel(&self, x: u32, y: u32) -> Rgb {
        self.at(y as usize * self.width as usize + x as usize)
    }

    /// The colour at the surface's `uv`.
    #[inline]
    pub fn eval(&self, uv: Vec2) -> Rgb {
        let uv = self.settings.to_uv.transform_point2(uv);
        match (self.settings.filter, &self.texels) {
            (Filter::Nearest, _) => self.at(self.nearest(uv)),
            (Filter::Bilinear, Texels::Grey(t)) => {
                let f = self.footprint(uv);
                Rgb::splat(bilinear(f.texels.map(|i| t[i]), f.weight))
            }
            (Filter::Bilinear, Texels::Color(t)) => {
                let f = self.footprint(uv);
                let [a, b, c, d] = f.texels.map(|i| t[i]);
                a.lerp(b, f.weight.x).lerp(c.lerp(d, f.weight.x), f.weight.y)
            }
        }
    }

    /// The luminance at the surface's `uv`; the value itself where it is grey.
    #[inline]
    pub fn eval_scalar(&self, uv: Vec2) -> f32 {
        let uv = self.settings.to_uv.transform_point2(uv);
        match self.settings.filter {
            Filter::Nearest => self.scalar_at(self.nearest(uv)),
            Filter::Bilinear => {
                let f = self.footprint(uv);
                bilinear(f.texels.map(|i| self.scalar_at(i)), f.weight)
            }
        }
    }

    /// (∂/∂u, ∂/∂v) of the luminance with respect to the surface's `uv`; 0 without interpolation.
    pub fn gradient(&self, uv: Vec2) -> Vec2 {
        if self.settings.filter == Filter::Nearest {
            return Vec2::ZERO;
        }
        let f = self.footprint(self.settings.to_uv.transform_point2(uv));
        let [a, b, c, d] = f.texels.map(|i| self.scalar_at(i));
        let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
        // Differentiate the bilinear patch per texel, go to the bitmap's uv, then by the chain rule to the surface's.
        let per_texel = Vec2::new(lerp(b - a, d - c, f.weight.y), lerp(c - a, d - b, f.weight.x));
        let per_uv = per_texel * Vec2::new(self.width as f32, self.height as f32);
        self.settings.to_uv.matrix2.transpose() * per_uv
    }

    /// Mean luminance over cells of the surface's unit uv square: exact per texel where `to_uv` is the identity,
    /// otherwise estimated from 4 × 4 points per cell with a floor of 1 % of the mean.
    pub fn texel_grid(&self) -> TexelGrid {
        let (width, height) = (self.width as usize, self.height as usize);
        if self.settings.to_uv == Affine2::IDENTITY {
            let luminance = (0..width * height).map(|i| self.cell_mean(i % width, i / width).max(0.0)).collect();
            return TexelGrid { width, height, luminance };
        }
        const POINTS: usize = 4;
        let floor = 0.01 * self.mean.luminance();
        let cell = |i: usize| {
            let point = |k: usize| {
                let x = (i % width) as f32 + ((k % POINTS) as f32 + 0.5) / POINTS as f32;
                let y = (i / width) as f32 + ((k / POINTS) as f32 + 0.5) / POINTS as f32;
                self.eval_scalar(Vec2::new(x / width as f32, y / height as f32))
            };
            ((0..POINTS * POINTS).map(point).sum::<f32>() / (POINTS * POINTS) as f32).max(floor)
        };
        TexelGrid { width, height, luminance: (0..width * height).map(cell).collect() }
    }

    /// The integral of the interpolated luminance over one texel's square: per axis it weighs the texel 3/4 and each
    /// neighbour 1/8, the mean of the tent over half of its base.
    fn cell_mean(&self, x: usize, y: usize) -> f32 {
        if self.settings.filter == Filter::Nearest {
            return self.scalar_at(y * self.width as usize + x);
        }
        let mut sum = 0.0;
        for (dy, wy) in [(-1, 0.125), (0, 0.75), (1, 0.125)] {
            for (dx, wx) in [(-1, 0.125), (0, 0.75), (1, 0.125)] {
                sum += wx * wy * self.scalar_at(self.index(x as i64 + dx, y as i64 + dy));
            }
        }
        sum
    }

    #[inline]
    fn nearest(&self, uv: Vec2) -> usize {
        let uv = self.reduce(uv) * Vec2::new(self.width as f32, self.height as f32);
        self.index(uv.x.floor() as i64, uv.y.floor() as i64)
    }

    #[inline]
    fn footprint(&self, uv: Vec2) -> Footprint {
        // Texel centres lie at half-integers.
        let p = self.reduce(uv) * Vec2::new(self.width as f32, self.height as f32) - 0.5;
        let corner = p.floor();
        let (x, y) = (corner.x as i64, corner.y as i64);
        let texels = [self.index(x, y), self.index(x + 1, y), self.index(x, y + 1), self.index(x + 1, y + 1)];
        Footprint { texels, weight: p - corner }
    }

    /// Takes off whole periods while the coordinate still has its fraction; what is not finite goes to 0.
    #[inline]
    fn reduce(&self, uv: Vec2) -> Vec2 {
        let uv = Vec2::select(uv.is_finite_mask(), uv, Vec2::ZERO);
        match self.settings.wrap {
            Wrap::Repeat => uv - uv.floor(),
            Wrap::Mirror => uv - 2.0 * (0.5 * uv).floor(),
            Wrap::Clamp => uv.clamp(Vec2::splat(-1.0), Vec2::splat(2.0)),
        }
    }

    /// The index of a texel that may lie outside.
    #[inline]
    fn index(&self, x: i64, y: i64) -> usize {
        let wrap = |i: i64, n: u32| {
            let n = i64::from(n);
            match self.settings.wrap {
                Wrap::Repeat => i.rem_euclid(n),
                Wrap::Mirror => {
                    let i = i.rem_euclid(2 * n);
                    if i < n { i } else { 2 * n - 1 - i }
                }
                Wrap::Clamp => i.clamp(0, n - 1),
            }
        };
        (wrap(y, self.height) * i64::from(self.width) + wrap(x, self.width)) as usize
    }

    #[inline]
    fn at(&self, index: usize) -> Rgb {
        match &self.texels {
            Texels::Grey(t) => Rgb::splat(t[index]),
            Texels::Color(t) => t[index],
        }
    }

    #[inline]
    fn scalar_at(&self, index: usize) -> f32 {
        match &self.texels {
            Texels::Grey(t) => t[index],
            Texels::Color(t) => scalar(t[index]),
        }
    }
}

#[inline]
fn bilinear([a, b, c, d]: [f32; 4], w: Vec2) -> f32 {
    (a * (1.0 - w.x) + b * w.x) * (1.0 - w.y) + (c * (1.0 - w.x) + d * w.x) * w.y
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 4 × 2 texels with values 0…7.
    fn ramp(settings: BitmapSettings) -> Bitmap {
        Bitmap::new(&Image::from_fn(4, 2, |x, y| Rgb::splat((4 * y + x) as f32)), settings)
    }

    fn nearest(wrap: Wrap) -> Bitmap {
        ramp(BitmapSettings { wrap, filter: Filter::Nearest, ..Default::default() })
    }

    #[test]
    fn wrap_modes_outside_the_unit_square() {
        let at = |wrap, u: f32, v: f32| nearest(wrap).eval_scalar(Vec2::new(u, v));
        // One texel to the left of the picture, and one to the right of it.
        assert_eq!([at(Wrap::Repeat, -0.1, 0.1), at(Wrap::Repeat, 1.1, 0.1)], [3.0, 0.0]);
        assert_eq!([at(Wrap::Mirror, -0.1, 0.1), at(Wrap::Mirror, 1.1, 0.1)], [0.0, 3.0]);
        assert_eq!([at(Wrap::Clamp, -5.0, 0.1), at(Wrap::Clamp, 7.0, 0.9)], [0.0, 7.0]);
        assert_eq!([at(Wrap::Mirror, -1.1, 0.1), at(Wrap::Mirror, 2.1, 1.1)], [3.0, 4.0]);
        // v = 0 is the top row; exactly 1 is again the first texel of the next copy.
        assert_eq!(
            [at(Wrap::Repeat, 0.0, 0.0), at(Wrap::Repeat, 0.0, 0.6), at(Wrap::Repeat, 1.0, 0.0)],
            [0.0, 4.0, 0.0]
        );
        assert_eq!(at(Wrap::Clamp, 1.0, 1.0), 7.0);
    }

    #[test]
    fn wild_coordinates_stay_inside() {
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            for filter in [Filter::Nearest, Filter::Bilinear] {
                let b = ramp(BitmapSettings { wrap, filter, ..Default::default() });
                for v in [f32::NAN, f32::INFINITY, -f32::INFINITY, 1e30, -1e30, 1e9, -1e-20, 0.999_999_94] {
                    assert!((0.0..=7.0).contains(&b.eval_scalar(Vec2::new(v, -v))));
                }
            }
        }
    }

    /// Texel centres give the texels, half-way between two their mean; left of the first centre repeat blends with the
    /// last texel.
    #[test]
    fn bilinear_between_centres() {
        let b = ramp(BitmapSettings::default());
        assert_eq!(b.eval_scalar(Vec2::new(0.125, 0.25)), 0.0);
        assert_eq!(b.eval_scalar(Vec2::new(0.25, 0.25)), 0.5);
        assert_eq!(b.eval_scalar(Vec2::new(0.25, 0.5)), 2.5);
        assert_eq!(b.eval_scalar(Vec2::new(0.0, 0.25)), 1.5);
        let clamp = ramp(BitmapSettings { wrap: Wrap::Clamp, ..Default::default() });
        assert_eq!(clamp.eval_scalar(Vec2::new(0.0, 0.25)), 0.0);
        assert_eq!(b.mean(), Rgb::splat(3.5));
        assert!(b.is_grey() && b.memory() == 32);
    }

    #[test]
    fn colours_interpolate_per_channel_and_scalars_are_luminance() {
        let image = Image::rgb(2, 1, vec![Rgb::new(1.0, 0.0, 0.0), Rgb::new(0.0, 2.0, 0.0)]);
        let b = Bitmap::new(&image, BitmapSettings::default());
        let c = b.eval(Vec2::new(0.375, 0.5));
        assert!((c - Rgb::new(0.75, 0.5, 0.0)).map(f32::abs).max_channel() < 1e-6);
        assert!((b.eval_scalar(Vec2::new(0.375, 0.5)) - c.luminance()).abs() < 1e-6);
    }

    /// Against central differences, with a rotated, scaled and shifted uv. The patch is bilinear, so the difference
    /// inside one patch is exact up to rounding.
    #[test]
    fn gradient_is_the_derivative() {
        let to_uv = Affine2::from_scale_angle_translation(Vec2::new(0.7, 1.3), 0.6, Vec2::new(0.2, -0.1));
        let image = Image::from_fn(5, 7, |x, y| Rgb::splat(((3 * x + 5 * y * y) % 11) as f32));
        let b = Bitmap::new(&image, BitmapSettings { to_uv, ..Default::default() });
        let (mut checked, h) = (0, 1e-3);
        for i in 0..400 {
            let uv = Vec2::new(i as f32 * 0.618_034 % 1.0, i as f32 * 0.754_878 % 1.0);
            let along = |d: Vec2| (b.eval_scalar(uv + d) - b.eval_scalar(uv - d)) / (2.0 * h);
            // Skip points whose difference would straddle two patches.
            let texel = |d: Vec2| {
                let p = to_uv.transform_point2(uv + d);
                (Vec2::new(p.x * 5.0, p.y * 7.0) - 0.5).floor()
            };
            let (du, dv) = (Vec2::new(h, 0.0), Vec2::new(0.0, h));
            if [du, -du, dv, -dv].iter().any(|&d| texel(d) != texel(Vec2::ZERO)) {
                continue;
            }
            let (g, reference) = (b.gradient(uv), Vec2::new(along(du), along(dv)));
            assert!((g - reference).length() < 0.02 * (1.0 + reference.length()), "{g} is not {reference}");
            checked += 1;
        }
        assert!(checked > 300, "only {checked} points checked");
    }

    /// The grid is the exact cell mean: against 64 × 64 points per cell, whose midpoint rule is exact for a function
    /// that is bilinear on quarters of the cell.
    #[test]
    fn grid_is_the_mean_of_each_cell() {
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            let b = ramp(BitmapSettings { wrap, ..Default::default() });
            let grid = b.texel_grid();
            assert_eq!((grid.width, grid.height), (4, 2));
            for (i, &l) in grid.luminance.iter().enumerate() {
                let mut sum = 0.0;
                for k in 0..4096 {
                    let x = (i % 4) as f32 + (k % 64) as f32 / 64.0 + 1.0 / 128.0;
                    let y = (i / 4) as f32 + (k / 64) as f32 / 64.0 + 1.0 / 128.0;
                    sum += f64::from(b.eval_scalar(Vec2::new(x / 4.0, y / 2.0)));
                }
                assert!((f64::from(l) - sum / 4096.0).abs() < 1e-4, "cell {i}: {l} is not {}", sum / 4096.0);
            }
        }
        // A lone bright texel lights its neighbours' cells too.
        let image = Image::from_fn(5, 5, |x, y| Rgb::splat(if (x, y) == (2, 2) { 1.0 } else { 0.0 }));
        let grid = Bitmap::new(&image, BitmapSettings::default()).texel_grid();
        assert_eq!(grid.luminance[12], 0.5625);
        assert_eq!(grid.luminance[6], 0.015_625);
    }
}
