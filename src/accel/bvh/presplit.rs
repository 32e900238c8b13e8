//! Cuts the boxes of large triangles before a tree is built, so that they overlap less
//! [Karras, Aila 2013, "Fast Parallel Construction of High-Quality Bounding Volume Hierarchies", §4].
//!
//! A triangle then has several references, each with the box of its part on one side of planes. The planes are those of
//! repeated halving of the whole scene, so that neighbours are cut at the same places. Which boxes are cut does not depend
//! on the number of threads.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::binned::{Box8, PrimRef};
use super::parts::{KIND_TRIANGLE, Parts};
use crate::math::Bounds3;
use crate::pages::Pages;

/// References that may be added, relative to those that are there.
const BUDGET: f64 = 0.3;
/// Cuts of one triangle.
const MOST_CUTS: u32 = 63;
/// Boxes are cut that have more than this many times the area of the median box.
const LARGE: f64 = 16.0;
/// Boxes that the median is taken of.
const SAMPLES: usize = 1 << 12;
/// Cells on each axis of the finest grid of planes, as a power of two.
const LEVELS: u32 = 16;

/// Planes that halve the scene, its halves, and so on.
struct Grid {
    origin: DVec3,
    /// Extent of the scene on each axis.
    extent: DVec3,
}

impl Grid {
    fn new(b: &Bounds3) -> Self {
        Self { origin: b.min.as_dvec3(), extent: (b.max - b.min).as_dvec3() }
    }

    /// The coarsest plane strictly inside a box on the axis where it is longest: level (0 for the whole scene's), axis and
    /// place.
    fn plane(&self, b: &Bounds3) -> Option<(u32, usize, f32)> {
        let axis = (b.max - b.min).max_position();
        let cells = f64::from(1u32 << LEVELS);
        let cell =
            |x: f32| ((f64::from(x) - self.origin[axis]) / self.extent[axis] * cells).clamp(0.0, cells - 1.0) as u32;
        let (first, last) = (cell(b.min[axis]), cell(b.max[axis]));
        // The highest bit in which they differ names the level.
        let differ = first ^ last;
        if differ == 0 {
            return None;
        }
        let bit = differ.ilog2();
        let place = last >> bit << bit;
        let at = (self.origin[axis] + f64::from(place) / cells * self.extent[axis]) as f32;
        (b.min[axis] < at && at < b.max[axis]).then_some((LEVELS - 1 - bit, axis, at))
    }
}

fn area(b: &Bounds3) -> f64 {
    let e = (b.max - b.min).as_dvec3();
    2.0 * (e.x * e.y + e.y * e.z + e.z * e.x)
}

/// How much a triangle gains from a cut.
fn priority(b: &Bounds3, triangle: [Vec3; 3], grid: &Grid, small: f64) -> f64 {
    let area = area(b);
    if area <= small {
        return 0.0;
    }
    let Some((level, _, _)) = grid.plane(b) else { return 0.0 };
    // Twice the least area that boxes around small enough parts have together.
    let [x, y, z] = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]).abs().to_array();
    let least = f64::from(x) + f64::from(y) + f64::from(z);
    ((area - least).max(0.0) * 0.5f64.powi(level as i32)).cbrt()
}

/// The boxes of the two parts of a triangle within a box, rounded outwards.
fn cut(b: &Bounds3, triangle: [Vec3; 3], axis: usize, at: f32) -> [Bounds3; 2] {
    let (mut left, mut right) = (Bounds3::EMPTY, Bounds3::EMPTY);
    for i in 0..3 {
        let (p, q) = (triangle[i], triangle[(i + 1) % 3]);
        if p[axis] <= at {
            left = left.union(Bounds3::new(p, p));
        }
        if p[axis] >= at {
            right = right.union(Bounds3::new(p, p));
        }
        if (p[axis] < at) != (q[axis] < at) && p[axis] != q[axis] {
            let (p, q) = (p.as_dvec3(), q.as_dvec3());
            let x = p + (q - p) * ((f64::from(at) - p[axis]) / (q[axis] - p[axis]));
            // One more than the rounding to f32 can be off.
            let x = x.as_vec3();
            let part = Bounds3::new(x.map(f32::next_down), x.map(f32::next_up));
            (left, right) = (left.union(part), right.union(part));
        }
    }
    left.max[axis] = left.max[axis].min(at);
    right.min[axis] = right.min[axis].max(at);
    let within = |part: Bounds3| Bounds3::new(part.min.max(b.min), part.max.min(b.max));
    [within(left), within(right)]
}

/// Cuts a box into at most `cuts + 1` parts.
fn parts_of(b: Bounds3, triangle: [Vec3; 3], cuts: u32, grid: &Grid, give: &mut impl FnMut(Bounds3)) {
    let plane = if cuts == 0 { None } else { grid.plane(&b) };
    let Some((_, axis, at)) = plane else { return give(b) };
    let [left, right] = cut(&b, triangle, axis, at);
    let longest = |b: &Bounds3| (b.max - b.min).max_element().max(0.0);
    match (is_box(&left), is_box(&right)) {
        (true, true) => {}
        // All of what lies in the box is on one side.
        (true, false) => return parts_of(left, triangle, cuts - 1, grid, give),
        (false, true) => return parts_of(right, triangle, cuts - 1, grid, give),
        (false, false) => return give(b),
    }
    // The larger part gets the more of what is left.
    let share = longest(&left) / (longest(&left) + longest(&right));
    let first = (((cuts - 1) as f32 * share).round() as u32).min(cuts - 1);
    parts_of(left, triangle, first, grid, give);
    parts_of(right, triangle, cuts - 1 - first, grid, give);
}

fn is_box(b: &Bounds3) -> bool {
    b.min.cmple(b.max).all()
}

/// References in which large triangles have several, each with the box of a part; `bounds` is the box of all. `None` where
/// no triangle is much larger than the others.
pub(super) fn split(refs: &[PrimRef], bounds: &Box8, parts: &Parts) -> Option<Pages<PrimRef>> {
    if refs.is_empty() {
        return None;
    }
    let grid = Grid::new(&bounds.bounds());
    let step = refs.len().div_ceil(SAMPLES);
    let mut areas: Vec<f64> = refs.iter().step_by(step).map(|r| area(&r.bounds().bounds())).collect();
    areas.sort_unstable_by(f64::total_cmp);
    let small = LARGE * areas[areas.len() / 2];
    let priority = |r: &PrimRef| match r.kind() {
        KIND_TRIANGLE => priority(&r.bounds().bounds(), parts.triangle(r.id()), &grid, small),
        _ => 0.0,
    };
    let priorities: Vec<f32> = refs.par_iter().map(|r| priority(r) as f32).collect();
    let cuts = |p: f32, scale: f64| ((f64::from(p) * scale) as u32).min(MOST_CUTS);
    let total = |scale: f64| priorities.par_iter().map(|&p| u64::from(cuts(p, scale))).sum::<u64>();
    // The largest scale within the budget.
    let budget = (BUDGET * refs.len() as f64) as u64;
    let largest = priorities.par_iter().copied().reduce(|| 0.0, f32::max);
    if largest <= 0.0 {
        return None;
    }
    let (mut low, mut high) = (0.0, f64::from(MOST_CUTS + 1) / f64::from(largest));
    while total(high) <= budget && total(high) > total(low) {
        (low, high) = (high, 2.0 * high);
    }
    for _ in 0..24 {
        let middle = 0.5 * (low + high);
        if total(middle) <= budget { low = middle } else { high = middle }
    }
    // A cut may not be possible: count what comes of it, then write it.
    let each = |r: &PrimRef, p: f32, give: &mut dyn FnMut(Bounds3)| match cuts(p, low) {
        0 => give(r.bounds().bounds()),
        n => parts_of(r.bounds().bounds(), parts.triangle(r.id()), n, &grid, &mut |b| give(b)),
    };
    const CHUNK: usize = 1 << 12;
    let chunks = || refs.par_chunks(CHUNK).zip(priorities.par_chunks(CHUNK));
    let counts: Vec<usize> = chunks()
        .map(|(refs, priorities)| {
            let mut n = 0;
            refs.iter().zip(priorities).for_each(|(r, &p)| each(r, p, &mut |_| n += 1));
            n
        })
        .collect();
    let mut all = Pages::<PrimRef>::zeroed(counts.iter().sum());
    let mut rest = &mut all[..];
    let mut places = Vec::with_capacity(counts.len());
    for n in counts {
        let (mine, others) = rest.split_at_mut(n);
        places.push(mine);
        rest = others;
    }
    places.into_par_iter().zip(chunks()).for_each(|(place, (refs, priorities))| {
        let mut at = 0;
        for (r, &p) in refs.iter().zip(priorities) {
            each(r, p, &mut |b| {
                place[at] = PrimRef::new(b, r.id(), r.kind());
                at += 1;
            });
        }
    });
    Some(all)
}
