//! The film: weighted f64 sums per pixel, filled tile by tile in a fixed order so that no thread count shows.

mod clamp;
mod filter;
mod state;
#[cfg(test)]
mod tests;
mod tile;

use glam::Vec2;

pub use clamp::Clamp;
pub use filter::{MAX_RADIUS, ReconstructionFilter};
pub use state::FilmState;
pub use tile::{FilmTile, TILE_SIZE};

use crate::color::Rgb;
use crate::image::{FilmWindow, Image};
use tile::{Reach, Sum};

/// Sums of weighted samples and of splats for every pixel of the crop window.
#[derive(Clone, Debug)]
pub struct Film {
    window: FilmWindow,
    filter: ReconstructionFilter,
    sums: Vec<Sum>,
    /// Sums of colours that came with their own weight, allocated with the first one.
    splats: Vec<[f64; 3]>,
    /// One over the filter's integral around each column and each row.
    splat_norm: [Vec<f64>; 2],
    non_finite: u64,
    clamp: Clamp,
}

/// Splats of one batch of light paths, to be merged in the order of the batches.
#[derive(Clone, Debug, Default)]
pub struct SplatBuffer {
    splats: Vec<(Vec2, Rgb)>,
}

impl SplatBuffer {
    /// Adds `value` at a film position in pixels of the whole film.
    #[inline]
    pub fn push(&mut self, film_pos: Vec2, value: Rgb) {
        self.splats.push((film_pos, value));
    }

    pub fn len(&self) -> usize {
        self.splats.len()
    }

    pub fn is_empty(&self) -> bool {
        self.splats.is_empty()
    }

    /// All splats with their film positions.
    pub fn iter(&self) -> impl Iterator<Item = &(Vec2, Rgb)> {
        self.splats.iter()
    }

    /// Empties it and keeps its memory.
    pub fn clear(&mut self) {
        self.splats.clear();
    }
}

impl Film {
    /// Bytes of the sums of one pixel, without splats.
    pub const BYTES_PER_PIXEL: usize = size_of::<Sum>();

    /// An empty film over the crop window.
    pub fn new(window: FilmWindow, filter: ReconstructionFilter) -> Self {
        let pixels = window.crop_size.0 as usize * window.crop_size.1 as usize;
        Self {
            window,
            filter,
            sums: vec![Sum::default(); pixels],
            splats: Vec::new(),
            splat_norm: [window.crop_size.0, window.crop_size.1].map(|pixels| splat_norms(filter, pixels)),
            non_finite: 0,
            clamp: Clamp::default(),
        }
    }

    /// An empty film of the same window, filter and clamp.
    pub fn fresh(&self) -> Self {
        Self::new(self.window, self.filter).with_clamp(self.clamp.limit)
    }

    /// Dims samples and splats whose largest channel is above `limit`, and counts what that takes away.
    pub fn with_clamp(mut self, limit: Option<f32>) -> Self {
        self.clamp = Clamp::new(limit);
        self
    }

    /// What the clamp has taken away.
    pub fn clamp(&self) -> Clamp {
        self.clamp
    }

    pub fn window(&self) -> FilmWindow {
        self.window
    }

    pub fn filter(&self) -> ReconstructionFilter {
        self.filter
    }

    /// Width and height of the picture: those of the crop window.
    pub fn crop_size(&self) -> (u32, u32) {
        self.window.crop_size
    }

    /// Samples and splats that were dropped because a channel was not finite.
    pub fn non_finite(&self) -> u64 {
        self.non_finite
    }

    /// Number of tiles that cover the crop window.
    pub fn tile_count(&self) -> usize {
        let (w, h) = self.crop_size();
        w.div_ceil(TILE_SIZE) as usize * h.div_ceil(TILE_SIZE) as usize
    }

    /// An empty buffer for tile `index`, in rows from the top left.
    pub fn tile(&self, index: usize) -> FilmTile {
        let (w, h) = self.crop_size();
        let columns = w.div_ceil(TILE_SIZE);
        let (x, y) = (index as u32 % columns * TILE_SIZE, index as u32 / columns * TILE_SIZE);
        let (x1, y1) = ((x + TILE_SIZE).min(w), (y + TILE_SIZE).min(h));
        FilmTile::new(&self.window, self.filter, (x, y), (x1, y1), self.clamp.limit)
    }

    /// Adds the sums of another film of the same window and filter, for example of another pass.
    pub fn add(&mut self, other: &Film) {
        for (sum, o) in self.sums.iter_mut().zip(&other.sums) {
            *sum += *o;
        }
        if !other.splats.is_empty() {
            self.splats.resize(self.sums.len(), [0.0; 3]);
            for (sum, o) in self.splats.iter_mut().zip(&other.splats) {
                for (sum, o) in sum.iter_mut().zip(o) {
                    *sum += o;
                }
            }
        }
        self.non_finite += other.non_finite;
        self.clamp += other.clamp;
    }

    /// Adds a tile. Tiles must come in a fixed order for the sums to be the same bits every time.
    pub fn merge(&mut self, tile: &FilmTile) {
        let (w, h) = self.crop_size();
        for (x, y, sum) in tile.sums() {
            if (0..w as i32).contains(&x) && (0..h as i32).contains(&y) {
                self.sums[y as usize * w as usize + x as usize] += *sum;
            }
        }
        self.non_finite += tile.non_finite();
        self.clamp += tile.clamp();
    }

    /// Adds one sample at a film position in pixels of the whole film; true unless it was dropped. For single-threaded
    /// use: parallel code fills tiles.
    pub fn add_sample(&mut self, film_pos: Vec2, value: Rgb) -> bool {
        if !value.is_finite() {
            self.non_finite += 1;
            return false;
        }
        let value = self.clamp.apply(value);
        let (w, h) = self.crop_size();
        Reach::new(&self.window, self.filter, film_pos).for_each((0, 0), (w as i32, h as i32), |x, y, weight| {
            self.sums[y as usize * w as usize + x as usize].add(value, weight as f64);
        });
        true
    }

    /// Adds light at a film position without a sample's weight; true unless it was dropped. A pixel's value is the sum
    /// of what falls on it, divided by the filter's integral over the crop window: like the mean of the samples, which all
    /// lie in the window too, it does not fade towards the border.
    pub fn splat(&mut self, film_pos: Vec2, value: Rgb) -> bool {
        if !value.is_finite() {
            self.non_finite += 1;
            return false;
        }
        let value = self.clamp.apply(value);
        let (w, h) = self.crop_size();
        self.splats.resize(self.sums.len(), [0.0; 3]);
        let (splats, [columns, rows]) = (&mut self.splats, &self.splat_norm);
        Reach::new(&self.window, self.filter, film_pos).for_each((0, 0), (w as i32, h as i32), |x, y, weight| {
            let pixel = &mut splats[y as usize * w as usize + x as usize];
            let norm = columns[x as usize] * rows[y as usize];
            for (sum, v) in pixel.iter_mut().zip(value.to_array()) {
                *sum += norm * weight as f64 * v as f64;
            }
        });
        true
    }

    /// Adds a batch of splats. Batches must come in a fixed order.
    pub fn merge_splats(&mut self, batch: &SplatBuffer) {
        for &(film_pos, value) in &batch.splats {
            self.splat(film_pos, value);
        }
    }

    /// The picture: weighted means of the samples plus `splat_scale` times the splats. Pixels without samples are black.
    pub fn develop(&self, splat_scale: f64) -> Image {
        let (w, h) = self.crop_size();
        let pixel = |i: usize| {
            let mut c = self.sums[i].mean();
            if let Some(splat) = self.splats.get(i) {
                for (c, s) in c.iter_mut().zip(splat) {
                    *c += splat_scale * s;
                }
            }
            Rgb::from(c.map(|v| v as f32))
        };
        Image::rgb(w, h, (0..self.sums.len()).map(pixel).collect())
    }
}

/// One over the filter's integral around each of `pixels` pixels in a row, over the row alone.
fn splat_norms(filter: ReconstructionFilter, pixels: u32) -> Vec<f64> {
    let (radius, half) = (filter.radius(), 0.5 * filter.integral());
    let reach = |distance: f32| if distance >= radius { half } else { filter.integral_to(distance) };
    let norm = |i: u32| 1.0 / (reach(i as f32 + 0.5) + reach(pixels as f32 - i as f32 - 0.5));
    (0..pixels).map(norm).collect()
}
