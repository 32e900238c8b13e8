use std::f64::consts::PI;

use glam::{DVec3, Mat3, Vec2, Vec3};

use super::distant::{arrive_from_infinity, emit_from_infinity};
use super::{LightContext, LightLe, LightLi, STARTS, StartNumbers, Starts, axes};
use crate::color::Rgb;
use crate::math::{Transform, atan2, floor, one_minus_cos, safe_sqrt, sin_cos_turns};
use crate::sample::Cdf;

/// Radiance from infinity given by a latitude-longitude image.
///
/// Mitsuba's layout: +y is up; the first row of pixels lies on the upper pole and the last on the lower one; columns
/// are centred at `(i + ½)/width` turns of `atan2(x, −z)`. Pixels are interpolated bilinearly.
///
/// The density is constant per solid angle within each cell between four pixels and proportional to the exact integral
/// of the interpolated luminance over it. Cells that the 24-bit distribution cannot resolve beside a sun are reached by
/// a small uniform share.
#[derive(Clone, Debug)]
pub struct EnvMap {
    width: usize,
    height: usize,
    pixels: Vec<Rgb>,
    axes: Mat3,
    /// Rows of cells, each a distribution over its `width` cells.
    rows: Vec<Cdf>,
    marginal: Cdf,
    /// Height of each row line above the upper pole, `1 − cos θ`, and over the lower one, `1 + cos θ`.
    from_top: Vec<f32>,
    from_bottom: Vec<f32>,
    /// Solid angle of a cell in each row.
    cell_angle: Vec<f32>,
    uniform_share: f32,
    /// ∫ L dω, W·m⁻².
    integral: Rgb,
}

/// A direction as it is chosen: the azimuth in turns, and the height from the nearer pole.
#[derive(Clone, Copy)]
struct Choice {
    /// `1 − |cos θ|`.
    h: f32,
    /// 1 above the equator, −1 below.
    side: f32,
    turns: f32,
}

/// Where a direction falls: the cell, and the position inside it.
#[derive(Clone, Copy)]
struct Cell {
    col: u32,
    row: u32,
    f: Vec2,
}

impl EnvMap {
    /// `pixels` in rows from the top (W·m⁻²·sr⁻¹), multiplied by `scale`; `to_world` rotates the map.
    pub fn new(width: usize, height: usize, mut pixels: Vec<Rgb>, scale: f32, to_world: &Transform) -> Self {
        assert!(width > 0 && height > 0 && pixels.len() == width * height, "pixels must fill the image");
        for p in &mut pixels {
            *p *= scale;
        }
        // Let a single row cover the sphere.
        let height = if height == 1 {
            pixels.extend_from_within(..);
            2
        } else {
            height
        };
        let theta = |y: usize| PI * y as f64 / (height - 1) as f64;
        let from_top: Vec<f32> = (0..height).map(|y| one_minus_cos(theta(y)) as f32).collect();
        let from_bottom: Vec<f32> = (0..height).map(|y| one_minus_cos(theta(height - 1 - y)) as f32).collect();
        let mut map = Self {
            width,
            height,
            pixels,
            axes: axes(to_world),
            rows: Vec::new(),
            marginal: Cdf::default(),
            from_top,
            from_bottom,
            cell_angle: Vec::new(),
            uniform_share: 0.0,
            integral: Rgb::BLACK,
        };
        map.build();
        map
    }

    /// Integrates every cell and makes the distribution.
    fn build(&mut self) {
        let (w, cells) = (self.width, self.height - 1);
        let d_phi = 2.0 * PI / w as f64;
        let (mut total, mut weights) = (DVec3::ZERO, vec![0.0f64; w]);
        for row in 0..cells {
            let [upper, lower] = row_weights(row, cells);
            self.cell_angle.push((d_phi * (upper + lower)) as f32);
            for (col, weight) in weights.iter_mut().enumerate() {
                let next = (col + 1) % w;
                let pair = |y: usize| to_f64(self.pixels[y * w + col]) + to_f64(self.pixels[y * w + next]);
                let integral = 0.5 * d_phi * (upper * pair(row) + lower * pair(row + 1));
                total += integral;
                // Let coloured suns count by their mean too, which no channel can take to zero.
                *weight = integral.element_sum();
            }
            self.rows.push(Cdf::new(weights.iter().copied()));
        }
        self.marginal = Cdf::new(self.rows.iter().map(Cdf::total));
        self.integral = Rgb::new(total.x as f32, total.y as f32, total.z as f32);
        self.uniform_share = if self.unresolved() > 0.0 { 0.05 } else { 0.0 };
    }

    /// Share of the light in cells that the distribution gives less than half of what they deserve.
    fn unresolved(&self) -> f64 {
        let w = self.width;
        let total = self.marginal.total();
        let lost = |row: usize| {
            let cell = |col: usize| {
                let pair = |y: usize| to_f64(self.pixels[y * w + col] + self.pixels[y * w + (col + 1) % w]);
                let [upper, lower] = row_weights(row, self.height - 1);
                let due = PI / w as f64 * (upper * pair(row) + lower * pair(row + 1)).element_sum() / total;
                let got = self.rows[row].pmf(col) as f64 * self.marginal.pmf(row) as f64;
                if got < 0.5 * due { due } else { 0.0 }
            };
            (0..w).map(cell).sum::<f64>()
        };
        if total > 0.0 { (0..self.height - 1).map(lost).sum() } else { 0.0 }
    }

    #[inline(always)]
    fn cell(&self, wi: Vec3) -> Cell {
        let d = self.axes.transpose() * wi;
        let sin_theta = Vec2::new(d.x, d.z).length();
        let x = (atan2(d.x, -d.z) * (0.5 / PI) as f32) * self.width as f32 - 0.5;
        let y = atan2(sin_theta, d.y) * (1.0 / PI) as f32 * (self.height - 1) as f32;
        // Columns begin half a turn before the first and one pixel. Not `clamp`, which may panic: a loop with that is no vector.
        let (w, (left, x0), (above, y0)) = (self.width as i32, floor(x), floor(y));
        let col = (if left < 0 { left + w } else { left }).min(w - 1).max(0);
        let row = above.min(self.height as i32 - 2).max(0);
        // The last row keeps its lower edge.
        let fy = if above > row { 1.0 } else { y - y0 };
        Cell { col: col as u32, row: row as u32, f: Vec2::new(x - x0, fy) }
    }

    /// The brightest pixel, the mean of its channels.
    pub(super) fn peak(&self) -> f32 {
        self.pixels.iter().map(|p| p.mean()).fold(0.0, f32::max)
    }

    /// Radiance from the direction `d`, W·m⁻²·sr⁻¹.
    pub fn radiance(&self, d: Vec3) -> Rgb {
        self.radiance_in(self.cell(d))
    }

    #[inline(always)]
    fn radiance_in(&self, Cell { col, row, f }: Cell) -> Rgb {
        let (col, row) = (col as usize, row as usize);
        let next = if col + 1 == self.width { 0 } else { col + 1 };
        let at = |x: usize, y: usize| self.pixels[y * self.width + x];
        at(col, row).lerp(at(next, row), f.x).lerp(at(col, row + 1).lerp(at(next, row + 1), f.x), f.y)
    }

    /// Density per steradian of the sampled directions.
    pub(super) fn pdf(&self, wi: Vec3) -> f32 {
        if self.marginal.total() <= 0.0 {
            return 0.0;
        }
        self.pdf_in(&self.cell(wi))
    }

    #[inline(always)]
    fn pdf_in(&self, &Cell { col, row, .. }: &Cell) -> f32 {
        let (col, row) = (col as usize, row as usize);
        let cell = self.marginal.pmf(row) * self.rows[row].pmf(col) / self.cell_angle[row];
        (1.0 - self.uniform_share) * cell + self.uniform_share * (0.25 / PI) as f32
    }

    /// Chooses a direction towards the light, where there is any.
    #[inline(always)]
    fn choose(&self, u: Vec2) -> Option<Choice> {
        // Take the uniform share from the top of the second number.
        let guided = 1.0 - self.uniform_share;
        if u.y >= guided {
            let turns = ((u.y - guided) / self.uniform_share).min(1.0f32.next_down());
            let (h, side) = if u.x < 0.5 { (2.0 * u.x, 1.0) } else { (2.0 * (1.0 - u.x), -1.0) };
            return Some(Choice { h, side, turns });
        }
        let (row, _, fy) = self.marginal.sample(u.y / guided)?;
        let (col, _, fx) = self.rows[row].sample(u.x)?;
        // Measure the height from the nearer pole, where 1 − |cos θ| is small.
        let upper = 2 * row + 1 < self.height;
        let heights = if upper { &self.from_top } else { &self.from_bottom };
        let h = heights[row] + fy * (heights[row + 1] - heights[row]);
        Some(Choice { h, side: if upper { 1.0 } else { -1.0 }, turns: (col as f32 + 0.5 + fx) / self.width as f32 })
    }

    #[inline(always)]
    fn direction(&self, Choice { h, side, turns }: Choice) -> Vec3 {
        let (sin_phi, cos_phi) = sin_cos_turns(turns);
        let r = safe_sqrt(h * (2.0 - h));
        self.axes * Vec3::new(r * sin_phi, side * (1.0 - h), -r * cos_phi)
    }

    /// A direction towards the light with its density and its radiance, which is not black.
    #[inline(always)]
    fn sample_direction(&self, u: Vec2) -> Option<(Vec3, f32, Rgb)> {
        if self.marginal.total() <= 0.0 {
            return None;
        }
        let wi = self.direction(self.choose(u)?);
        // Ask for the density of the rounded direction, so that both techniques agree.
        let cell = self.cell(wi);
        let pdf = self.pdf_in(&cell);
        let radiance = self.radiance_in(cell);
        (pdf > 0.0 && !radiance.is_black()).then_some((wi, pdf, radiance))
    }

    pub(super) fn sample_li(&self, ctx: &LightContext, p: Vec3, u: Vec2) -> Option<LightLi> {
        let (wi, pdf_w, radiance) = self.sample_direction(u)?;
        Some(arrive_from_infinity(ctx, p, wi, radiance, pdf_w, false))
    }

    #[inline]
    pub(super) fn sample_le(&self, ctx: &LightContext, u_pos: Vec2, u_dir: Vec2) -> Option<LightLe> {
        let (wi, pdf_w, radiance) = self.sample_direction(u_dir)?;
        Some(emit_from_infinity(ctx, -wi, radiance, pdf_w, false, u_pos))
    }

    /// [`EnvMap::sample_le`] for many paths at once: what is looked up in tables, and in loops apart from it what is computed.
    #[inline(always)]
    pub(super) fn sample_le_all(&self, ctx: &LightContext, numbers: &StartNumbers, out: &mut Starts) {
        let (mut h, mut side, mut turns) = ([0.0; STARTS], [0.0; STARTS], [0.0; STARTS]);
        let mut chosen = [self.marginal.total() > 0.0; STARTS];
        for i in (0..STARTS).filter(|_| self.marginal.total() > 0.0) {
            match self.choose(numbers.dir(i)) {
                Some(choice) => (h[i], side[i], turns[i]) = (choice.h, choice.side, choice.turns),
                None => chosen[i] = false,
            }
        }
        let mut wi = [[0.0; STARTS]; 3];
        let (mut col, mut row) = ([0; STARTS], [0; STARTS]);
        let mut f = [[0.0; STARTS]; 2];
        for i in 0..STARTS {
            let d = self.direction(Choice { h: h[i], side: side[i], turns: turns[i] });
            [wi[0][i], wi[1][i], wi[2][i]] = d.to_array();
            let cell = self.cell(d);
            (col[i], row[i]) = (cell.col, cell.row);
            (f[0][i], f[1][i]) = (cell.f.x, cell.f.y);
        }
        let mut pdf = [0.0; STARTS];
        let mut radiance = [[0.0; STARTS]; 3];
        for i in 0..STARTS {
            let cell = Cell { col: col[i], row: row[i], f: Vec2::new(f[0][i], f[1][i]) };
            pdf[i] = self.pdf_in(&cell);
            [radiance[0][i], radiance[1][i], radiance[2][i]] = self.radiance_in(cell).to_array();
        }
        for i in 0..STARTS {
            let radiance = Rgb::new(radiance[0][i], radiance[1][i], radiance[2][i]);
            let wi = Vec3::new(wi[0][i], wi[1][i], wi[2][i]);
            let le = emit_from_infinity(ctx, -wi, radiance, pdf[i], false, numbers.pos(i));
            out.put(i, (chosen[i] & (pdf[i] > 0.0) & !radiance.is_black()).then_some(le));
        }
    }

    pub(super) fn power(&self, ctx: &LightContext) -> Rgb {
        self.integral * ctx.disc_area() as f32
    }
}

/// ∫ (1−t)·sin θ dθ and ∫ t·sin θ dθ over the cell row between pixel rows `row` and `row + 1`, with `t` rising from 0 to 1.
fn row_weights(row: usize, cells: usize) -> [f64; 2] {
    let step = PI / cells as f64;
    let (a, b) = (row as f64 * step, (row + 1) as f64 * step);
    let whole = 2.0 * (0.5 * (a + b)).sin() * (0.5 * (b - a)).sin();
    let lower = (b.sin() - a.sin()) / step - b.cos();
    [whole - lower, lower]
}

fn to_f64(c: Rgb) -> DVec3 {
    DVec3::new(c.r as f64, c.g as f64, c.b as f64)
}
