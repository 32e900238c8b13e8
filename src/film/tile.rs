use std::ops::AddAssign;

use arrayvec::ArrayVec;
use glam::Vec2;

use super::{Clamp, MAX_RADIUS, ReconstructionFilter};
use crate::color::Rgb;
use crate::image::FilmWindow;

/// Side of a tile in pixels. Part of the promise of equal bits: changing it changes the order of sums.
pub const TILE_SIZE: u32 = 16;

/// Most pixels in a row that one sample reaches.
const MAX_REACH: usize = 2 * MAX_RADIUS as usize + 1;

/// A weighted sum of colours.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sum {
    rgb: [f64; 3],
    weight: f64,
}

impl Sum {
    #[inline]
    pub fn add(&mut self, value: Rgb, weight: f64) {
        for (sum, v) in self.rgb.iter_mut().zip(value.to_array()) {
            *sum += weight * v as f64;
        }
        self.weight += weight;
    }

    pub fn to_array(self) -> [f64; 4] {
        let [r, g, b] = self.rgb;
        [r, g, b, self.weight]
    }

    pub fn from_array([r, g, b, weight]: [f64; 4]) -> Self {
        Self { rgb: [r, g, b], weight }
    }

    /// Black without weight.
    pub fn mean(&self) -> [f64; 3] {
        if self.weight != 0.0 { self.rgb.map(|v| v / self.weight) } else { [0.0; 3] }
    }
}

impl AddAssign for Sum {
    fn add_assign(&mut self, o: Self) {
        for (sum, v) in self.rgb.iter_mut().zip(o.rgb) {
            *sum += v;
        }
        self.weight += o.weight;
    }
}

/// The pixels around a sample and their weights, in coordinates of the crop window.
pub(super) struct Reach {
    /// The sample in pixels from the corner of the crop window.
    at: Vec2,
    filter: ReconstructionFilter,
}

impl Reach {
    #[inline]
    pub fn new(window: &FilmWindow, filter: ReconstructionFilter, film_pos: Vec2) -> Self {
        let at = film_pos - Vec2::new(window.crop_offset.0 as f32, window.crop_offset.1 as f32);
        Self { at, filter }
    }

    /// Calls `f(x, y, weight)` for the pixels with weight in `low..high`.
    #[inline(always)]
    pub fn for_each(&self, low: (i32, i32), high: (i32, i32), mut f: impl FnMut(i32, i32, f32)) {
        if self.filter == ReconstructionFilter::Box {
            let (x, y) = (self.at.x.floor() as i32, self.at.y.floor() as i32);
            if (low.0..high.0).contains(&x) && (low.1..high.1).contains(&y) {
                f(x, y, 1.0);
            }
            return;
        }
        let (x0, wx) = self.weights(self.at.x, low.0, high.0);
        let (y0, wy) = self.weights(self.at.y, low.1, high.1);
        for (y, wy) in (y0..).zip(&wy) {
            for (x, wx) in (x0..).zip(&wx) {
                f(x, y, wx * wy);
            }
        }
    }

    /// The first pixel in `low..high` within reach of `x` along one axis, and the weights from there on.
    fn weights(&self, x: f32, low: i32, high: i32) -> (i32, ArrayVec<f32, MAX_REACH>) {
        let r = self.filter.radius();
        let first = ((x - 0.5 - r).ceil() as i32).max(low);
        let last = ((x - 0.5 + r).floor() as i32).min(high - 1);
        let weights = (first..=last).take(MAX_REACH).map(|i| self.filter.eval(i as f32 + 0.5 - x)).collect();
        (first, weights)
    }
}

/// The samples of one tile, with a border as wide as the filter reaches.
#[derive(Clone, Debug)]
pub struct FilmTile {
    window: FilmWindow,
    filter: ReconstructionFilter,
    /// Pixels of the tile itself, in the crop window; the end is exclusive.
    low: (u32, u32),
    high: (u32, u32),
    border: i32,
    sums: Vec<Sum>,
    non_finite: u64,
    clamp: Clamp,
}

impl FilmTile {
    pub(super) fn new(
        window: &FilmWindow,
        filter: ReconstructionFilter,
        low: (u32, u32),
        high: (u32, u32),
        clamp: Option<f32>,
    ) -> Self {
        let border = (filter.radius() - 0.5).max(0.0).ceil() as i32;
        let (w, h) = ((high.0 - low.0) as usize, (high.1 - low.1) as usize);
        let sums = vec![Sum::default(); (w + 2 * border as usize) * (h + 2 * border as usize)];
        Self { window: *window, filter, low, high, border, sums, non_finite: 0, clamp: Clamp::new(clamp) }
    }

    /// The pixels to render, row by row, as integer coordinates in the whole film.
    pub fn pixels(&self) -> impl Iterator<Item = (u32, u32)> + use<> {
        let (ox, oy) = self.window.crop_offset;
        let (low, high) = (self.low, self.high);
        (low.1..high.1).flat_map(move |y| (low.0..high.0).map(move |x| (x + ox, y + oy)))
    }

    /// Samples dropped because a channel was not finite.
    pub fn non_finite(&self) -> u64 {
        self.non_finite
    }

    /// What the clamp has taken away.
    pub fn clamp(&self) -> Clamp {
        self.clamp
    }

    /// Adds a sample at a film position in pixels of the whole film; true unless it was dropped.
    #[inline]
    pub fn add_sample(&mut self, film_pos: Vec2, value: Rgb) -> bool {
        if !value.is_finite() {
            self.non_finite += 1;
            return false;
        }
        let value = self.clamp.apply(value);
        let (low, high, width) = self.extent();
        Reach::new(&self.window, self.filter, film_pos).for_each(low, high, |x, y, weight| {
            self.sums[(y - low.1) as usize * width + (x - low.0) as usize].add(value, weight as f64);
        });
        true
    }

    /// Corners of the buffer in the crop window, and its width.
    fn extent(&self) -> ((i32, i32), (i32, i32), usize) {
        let low = (self.low.0 as i32 - self.border, self.low.1 as i32 - self.border);
        let high = (self.high.0 as i32 + self.border, self.high.1 as i32 + self.border);
        (low, high, (high.0 - low.0) as usize)
    }

    pub(super) fn sums(&self) -> impl Iterator<Item = (i32, i32, &Sum)> {
        let (low, _, width) = self.extent();
        let place = move |i: usize| (low.0 + (i % width) as i32, low.1 + (i / width) as i32);
        self.sums.iter().enumerate().map(move |(i, sum)| {
            let (x, y) = place(i);
            (x, y, sum)
        })
    }
}
