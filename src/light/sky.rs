//! Where an environment is seen from inside of what hides most of it.
//!
//! Light samples that follow an environment alone are lost on walls where it is seen through a window. Here is a grid of places
//! over the scene, each with a map of the directions from which light arrives there, as in "practical path guiding"
//! [Müller et al. 2017] but of the environment alone and learnt once. Samples follow the map but for [`OWN_SHARE`], which the
//! environment's own density keeps, so that all of it is found from everywhere. The density of any direction is looked up:
//! the weights of other techniques are exact.

use std::f32::consts::FRAC_1_PI;

use glam::{UVec3, Vec2, Vec3};

use crate::math::Bounds3;
use crate::sample::warp;

/// Rows and columns of the map of directions, of equal solid angles.
pub const SIDE: usize = 16;

/// Directions of a map.
pub const DIRECTIONS: usize = SIDE * SIDE;

/// Share of samples that follow the environment's own density.
pub(super) const OWN_SHARE: f32 = 0.1;

/// Places from which too little is known.
const UNKNOWN: u32 = u32::MAX;

/// The maps of all places.
#[derive(Clone, Debug)]
pub struct SkyView {
    cells: Cells,
    /// By cell, which of `views` is its.
    of_cell: Vec<u32>,
    views: Vec<View>,
}

/// A grid of places: cubes, or nearly.
#[derive(Clone, Copy, Debug)]
pub struct Cells {
    origin: Vec3,
    /// Cells per unit of length.
    scale: Vec3,
    count: UVec3,
}

/// What is seen from a place: the part of the light above each row of the map of directions, and within each row before each
/// column.
#[derive(Clone, Debug)]
pub struct View {
    rows: [f32; SIDE],
    columns: [[f32; SIDE]; SIDE],
}

impl Cells {
    /// A grid over `bounds` with `longest` cells along its longest edge.
    pub fn new(bounds: &Bounds3, longest: u32) -> Self {
        let size = bounds.max - bounds.min;
        let edge = size.max_element() / longest as f32;
        // Flat boxes have one layer, whose coordinates do not count.
        let count = (size / edge).ceil().clamp(Vec3::ONE, Vec3::splat(longest as f32));
        let scale = Vec3::select(size.cmpgt(Vec3::ZERO), count / size, Vec3::ZERO);
        Self { origin: bounds.min, scale, count: count.as_uvec3() }
    }

    /// Number of cells.
    pub fn count(&self) -> usize {
        self.count.element_product() as usize
    }

    /// The cell of `p`, unless that is outside of all.
    #[inline]
    pub fn index(&self, p: Vec3) -> Option<usize> {
        let (c, count) = ((p - self.origin) * self.scale, self.count.as_vec3());
        // The faces belong to the cells behind them.
        let inside = c.cmpge(Vec3::ZERO).all() && c.cmple(count).all();
        let c = c.min(count - 1.0).as_uvec3();
        inside.then(|| ((c.z * self.count.y + c.y) * self.count.x + c.x) as usize)
    }
}

/// The direction of a point of the map.
#[inline]
fn direction(u: Vec2) -> Vec3 {
    warp::uniform_sphere(Vec2::new(u.y, u.x))
}

/// Row and column of a direction.
#[inline]
fn place(d: Vec3) -> (usize, usize) {
    let u = warp::uniform_sphere_inverse(d) * SIDE as f32;
    ((u.x as usize).min(SIDE - 1), (u.y as usize).min(SIDE - 1))
}

/// The part of the map of directions that `d` belongs to, below [`DIRECTIONS`].
#[inline]
pub fn direction_index(d: Vec3) -> usize {
    let (row, column) = place(d);
    row * SIDE + column
}

/// The parts of the map around `index` and itself, those beside the poles twice.
pub fn around(index: usize) -> impl Iterator<Item = usize> {
    let (row, column) = (index / SIDE, index % SIDE);
    let rows = [row.saturating_sub(1), row, (row + 1).min(SIDE - 1)];
    let columns = [(column + SIDE - 1) % SIDE, column, (column + 1) % SIDE];
    rows.into_iter().flat_map(move |r| columns.map(|c| r * SIDE + c))
}

/// For each of `weights` the part of their sum that is before it.
fn parts_before(weights: &[f32]) -> [f32; SIDE] {
    let total = weights.iter().map(|&w| w as f64).sum::<f64>();
    let mut sum = 0.0;
    std::array::from_fn(|i| {
        let before = if total > 0.0 { (sum / total) as f32 } else { 0.0 };
        sum += weights[i] as f64;
        before
    })
}

/// Part of the sum that `i` has.
#[inline]
fn part(before: &[f32; SIDE], i: usize) -> f32 {
    before.get(i + 1).unwrap_or(&1.0) - before[i]
}

/// What is picked by `u` in [0, 1), and what is left over of that. Counts, without a branch.
#[inline]
fn pick(before: &[f32; SIDE], u: f32) -> Option<(usize, f32)> {
    let i = before.iter().map(|&b| i32::from(b <= u)).sum::<i32>() as usize - 1;
    let p = part(before, i);
    (p > 0.0).then(|| (i, ((u - before[i]) / p).min(1.0f32.next_down())))
}

impl View {
    /// Density in proportion to `weights` ≥ 0 of the parts of the map. `None` if all are zero.
    pub fn new(weights: &[f32; DIRECTIONS]) -> Option<Self> {
        let row = |y: usize| &weights[y * SIDE..(y + 1) * SIDE];
        let rows: [f32; SIDE] = std::array::from_fn(|y| row(y).iter().sum());
        (rows.iter().sum::<f32>() > 0.0)
            .then(|| Self { rows: parts_before(&rows), columns: std::array::from_fn(|y| parts_before(row(y))) })
    }

    /// A direction.
    #[inline]
    pub(super) fn sample(&self, u: Vec2) -> Option<Vec3> {
        let (row, v) = pick(&self.rows, u.y)?;
        let (column, u) = pick(&self.columns[row], u.x)?;
        Some(direction(Vec2::new(column as f32 + u, row as f32 + v) / SIDE as f32))
    }

    /// Density of [`View::sample`] per steradian.
    #[inline]
    pub(super) fn density(&self, d: Vec3) -> f32 {
        let (row, column) = place(d);
        part(&self.rows, row) * part(&self.columns[row], column) * (DIRECTIONS as f32 * 0.25 * FRAC_1_PI)
    }
}

impl SkyView {
    /// By cell, what is seen from there, if that is known.
    pub fn new(cells: Cells, by_cell: impl Iterator<Item = Option<View>>) -> Self {
        let (mut of_cell, mut views) = (Vec::with_capacity(cells.count()), Vec::new());
        for view in by_cell {
            of_cell.push(if view.is_some() { views.len() as u32 } else { UNKNOWN });
            views.extend(view);
        }
        assert_eq!(of_cell.len(), cells.count(), "one view for each cell");
        Self { cells, of_cell, views }
    }

    /// What is seen from `p`, if that is known.
    #[inline]
    pub(super) fn at(&self, p: Vec3) -> Option<&View> {
        self.views.get(self.of_cell[self.cells.index(p)?] as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{Key, Purpose, Sampler, Sequence};

    /// As many directions come from each part of the map as its weight says, none where that is zero, and each has the density
    /// that is stated; chi² with 1 % against a right program failing, for this seed once and for all.
    #[test]
    fn directions_follow_the_weights() {
        let mut s = Sampler::new(Sequence::Independent, Key::new(3, Purpose::Test, 0), 0);
        let mut weights = [0.0f32; DIRECTIONS];
        for (i, w) in weights.iter_mut().enumerate() {
            *w = if i % 3 == 0 || i / SIDE == 5 || i / SIDE == SIDE - 1 { 0.0 } else { s.next_1d() + 0.1 };
        }
        let view = View::new(&weights).expect("light");
        let total = weights.iter().sum::<f32>();
        let samples = 200_000;
        let mut found = [0u32; DIRECTIONS];
        for _ in 0..samples {
            let d = view.sample(s.next_2d()).expect("a direction");
            let i = direction_index(d);
            found[i] += 1;
            let density = weights[i] / total * DIRECTIONS as f32 * 0.25 * FRAC_1_PI;
            // A direction may be rounded over an edge of its part.
            assert!((view.density(d) - density).abs() <= 1e-4 * density, "{i}: {} {density}", view.density(d));
        }
        let rounded = (0..DIRECTIONS).filter(|&i| weights[i] == 0.0).map(|i| found[i]).sum::<u32>();
        assert!(rounded < samples / 10_000, "{rounded} directions from parts without light");
        let (mut chi2, mut parts) = (0.0, 0);
        for (&f, &w) in found.iter().zip(&weights).filter(|(_, w)| **w > 0.0) {
            let expected = f64::from(samples) * f64::from(w / total);
            chi2 += (f64::from(f) - expected).powi(2) / expected;
            parts += 1;
        }
        let freedom = f64::from(parts - 1);
        assert!(chi2 < freedom + 2.33 * (2.0 * freedom).sqrt() + 2.0, "{chi2} with {freedom} degrees of freedom");
        assert!(View::new(&[0.0; DIRECTIONS]).is_none());
    }

    #[test]
    fn each_part_is_a_neighbour_of_its_neighbours() {
        for i in 0..DIRECTIONS {
            assert_eq!(around(i).count(), 9);
            assert!(around(i).all(|k| k < DIRECTIONS && around(k).any(|j| j == i)), "{i}");
        }
        for d in [Vec3::Z, Vec3::NEG_Z, Vec3::X, Vec3::NEG_X, Vec3::new(-1.0, -0.0, 0.0), Vec3::NEG_Y] {
            assert!(direction_index(d) < DIRECTIONS, "{d}");
        }
    }

    #[test]
    fn every_place_has_a_cell() {
        let bounds = Bounds3 { min: Vec3::new(-1.0, -0.5, 0.25), max: Vec3::new(2.0, 0.5, 0.25) };
        let cells = Cells::new(&bounds, 12);
        assert_eq!(cells.count(), 12 * 4);
        let mut seen = vec![false; cells.count()];
        let mut s = Sampler::new(Sequence::Independent, Key::new(4, Purpose::Test, 0), 0);
        for _ in 0..2000 {
            let (u, z) = (s.next_2d(), s.next_1d());
            seen[cells.index(bounds.min + u.extend(z) * (bounds.max - bounds.min)).expect("inside")] = true;
        }
        assert!(seen.iter().all(|&s| s));
        assert_eq!((cells.index(bounds.min), cells.index(bounds.max)), (Some(0), Some(cells.count() - 1)));
        for outside in [Vec3::splat(-9.0), Vec3::splat(9.0), Vec3::splat(f32::NAN), Vec3::new(0.0, 0.51, 0.25)] {
            assert_eq!(cells.index(outside), None, "{outside}");
        }
        let point = Cells::new(&Bounds3 { min: Vec3::ONE, max: Vec3::ONE }, 12);
        assert_eq!((point.count(), point.index(Vec3::ONE)), (1, Some(0)));
    }
}
