//! Turned meshes: a brandy glass with its drink.

use std::f64::consts::TAU;
use std::ops::Range;

use glam::{DVec2, Vec3};

use super::TriangleMesh;

/// The three surfaces of a filled brandy glass, each between two media. They meet in rings of the same vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Snifter {
    /// Glass against air: the outside, the rim and the inside above the drink. Normals point into the air.
    Glass,
    /// Glass against the drink. Normals point into the drink.
    Wet,
    /// The drink against air, flat. Normals point up.
    Drink,
}

/// Radius and height of the outside, from the middle of the foot up to the rim.
const OUTSIDE: [(f64, f64); 19] = [
    (0.0, 0.0),
    (0.4, 0.0),
    (0.68, 0.0),
    (0.73, 0.004),
    (0.75, 0.02),
    (0.73, 0.038),
    (0.68, 0.046),
    (0.4, 0.085),
    (0.14, 0.17),
    (0.08, 0.42),
    (0.08, 0.78),
    (0.16, 0.98),
    (0.62, 1.22),
    (0.96, 1.78),
    (0.86, 2.33),
    (0.66, 2.74),
    (0.657, 2.78),
    (0.65, 2.795),
    (0.64, 2.8),
];

/// The inside from the rim down to the drink, and on to the middle of the bottom.
const INSIDE: [(f64, f64); 8] = [
    (0.63, 2.795),
    (0.623, 2.78),
    (0.62, 2.74),
    (0.82, 2.33),
    (0.92, 1.78),
    (DRINK_RADIUS, DRINK_HEIGHT),
    (0.58, 1.26),
    (0.0, 1.08),
];

/// Place of the drink's surface in [`INSIDE`].
const LEVEL: usize = 5;
const DRINK_RADIUS: f64 = 0.84;
const DRINK_HEIGHT: f64 = 1.53;

/// One surface of a brandy glass 2.8 units high that stands near the plane z = 0, with smooth normals. The glass surface has
/// about `triangles` triangles, the others fewer; made with the same number, they meet.
pub fn snifter(part: Snifter, triangles: usize) -> TriangleMesh {
    let points = |p: &[(f64, f64)]| p.iter().map(|&(r, z)| DVec2::new(r, z)).collect::<Vec<_>>();
    // Half as many rows as columns on the glass.
    let intervals = OUTSIDE.len() + LEVEL;
    let steps = ((triangles as f64 / 4.0).sqrt() / intervals as f64).round().max(1.0) as usize;
    let cuts = (steps, (triangles / (2 * intervals * steps)).max(8));
    let level = OUTSIDE.len() + LEVEL;
    let mut profile = points(&OUTSIDE);
    profile.extend(points(&INSIDE));
    match part {
        Snifter::Glass => turn(&profile, 0..level, cuts),
        Snifter::Wet => turn(&profile, level..profile.len() - 1, cuts),
        Snifter::Drink => turn(&points(&[(DRINK_RADIUS, DRINK_HEIGHT), (0.0, DRINK_HEIGHT)]), 0..1, cuts),
    }
}

/// Turns some intervals of a smooth curve through `points` (radius, height) about the z axis; normals are on its right hand.
/// There are `steps` rows of triangles to an interval, and `around` columns.
fn turn(points: &[DVec2], intervals: Range<usize>, (steps, around): (usize, usize)) -> TriangleMesh {
    let rows = steps * intervals.len();
    let curve: Vec<(DVec2, DVec2)> = (0..=rows).map(|i| on_curve(points, intervals.start * steps + i, steps)).collect();
    let mut mesh = TriangleMesh::default();
    let (mut positions, mut normals) = (Vec::new(), Vec::new());
    for (p, tangent) in &curve {
        let out = DVec2::new(tangent.y, -tangent.x).normalize_or(DVec2::Y);
        for j in 0..around {
            let (sin, cos) = (TAU * j as f64 / around as f64).sin_cos();
            positions.push(Vec3::new((p.x * cos) as f32, (p.x * sin) as f32, p.y as f32));
            normals.push(Vec3::new((out.x * cos) as f32, (out.x * sin) as f32, out.y as f32));
        }
    }
    for i in 0..rows {
        for j in 0..around {
            let at = |row: usize, column: usize| (row * around + column % around) as u32;
            let (a, b, c, d) = (at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j));
            // On the axis a row is one point, and a quad one triangle.
            if curve[i].0.x > 0.0 {
                mesh.indices.push([a, b, c]);
            }
            if curve[i + 1].0.x > 0.0 {
                mesh.indices.push([a, c, d]);
            }
        }
    }
    mesh.positions = positions.into();
    mesh.normals = Some(normals);
    mesh
}

/// Point `i` and a tangent there of a cubic spline through `points`, with `steps` points to an interval.
fn on_curve(points: &[DVec2], i: usize, steps: usize) -> (DVec2, DVec2) {
    let last = points.len() - 1;
    let k = (i / steps).min(last - 1);
    let t = (i - k * steps) as f64 / steps as f64;
    let (p, q) = (points[k], points[k + 1]);
    let chord = (q - p).length();
    let (m, n) = (slope(points, k) * chord, slope(points, k + 1) * chord);
    // Cubic Hermite interpolation and its derivative.
    let (t2, t3) = (t * t, t * t * t);
    let at = p * (2.0 * t3 - 3.0 * t2 + 1.0) + m * (t3 - 2.0 * t2 + t) + q * (3.0 * t2 - 2.0 * t3) + n * (t3 - t2);
    let along = p * 6.0 * (t2 - t) + m * (3.0 * t2 - 4.0 * t + 1.0) + q * 6.0 * (t - t2) + n * (3.0 * t2 - 2.0 * t);
    // The ends of intervals are the points themselves, so that surfaces meet.
    let exact = match t {
        0.0 => p,
        1.0 => q,
        _ => DVec2::new(at.x.max(0.0), at.y),
    };
    (exact, along)
}

/// Direction of the spline at a point: that of the parabola through it and its neighbours. On the axis it is level.
fn slope(points: &[DVec2], k: usize) -> DVec2 {
    let to = |j: usize| (points[j + 1] - points[j], (points[j + 1] - points[j]).length());
    let last = points.len() - 1;
    let (before, after) = (to(k.max(1) - 1), to(k.min(last - 1)));
    let slope = (before.0 / before.1 * after.1 + after.0 / after.1 * before.1) / (before.1 + after.1);
    if points[k].x == 0.0 { DVec2::new(slope.x.signum(), 0.0) } else { slope }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARTS: [Snifter; 3] = [Snifter::Glass, Snifter::Wet, Snifter::Drink];

    /// Volume between a surface and the axis, positive where normals point away from it.
    fn volume(m: &TriangleMesh) -> f64 {
        let p = |i: u32| m.positions.as_slice()[i as usize].as_dvec3();
        m.indices.iter().map(|&[a, b, c]| p(a).dot(p(b).cross(p(c))) / 6.0).sum()
    }

    #[test]
    fn faces_and_normals_agree_and_have_unit_length() {
        for part in PARTS {
            let m = snifter(part, 4000);
            let least = if part == Snifter::Glass { 3000 } else { 30 };
            assert!((least..5000).contains(&m.indices.len()), "{part:?}: {}", m.indices.len());
            let normals = m.normals.as_ref().expect("smooth normals");
            let mut wrong = 0;
            for face in &m.indices {
                let [a, b, c] = face.map(|i| m.positions.as_slice()[i as usize]);
                let g = (b - a).cross(c - a);
                assert!(g.length() > 0.0, "{part:?}: an empty triangle");
                let n = normals[face[0] as usize] + normals[face[1] as usize] + normals[face[2] as usize];
                wrong += usize::from(g.dot(n) <= 0.0);
            }
            // At the sharp edge of the foot the curve turns within one step.
            assert!(wrong * 50 <= m.indices.len(), "{part:?}: {wrong} of {} faces", m.indices.len());
            assert!(normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-5));
        }
    }

    #[test]
    fn glass_and_drink_are_closed_where_they_meet() {
        let [glass, wet, drink] = PARTS.map(|p| snifter(p, 20_000));
        let (glass, wet, drink) = (volume(&glass), volume(&wet), volume(&drink));
        // The normals of the wet part point into the drink: with the glass they enclose glass, against the lid drink.
        let (solid, liquid) = (glass + wet, drink - wet);
        assert!(solid > 0.2 && solid < 1.2, "{solid} of glass");
        assert!(liquid > 0.4 && liquid < 1.0, "{liquid} of drink");
        // All parts share the vertices of the ring at the level.
        let ring = |part| {
            let m = snifter(part, 4000);
            let at = |p: &&Vec3| (f64::from(p.z) - DRINK_HEIGHT).abs() < 1e-6;
            let ring = m.positions.as_slice().iter().filter(at).map(|p| p.to_array().map(f32::to_bits));
            ring.collect::<std::collections::BTreeSet<_>>()
        };
        let [glass, wet, drink] = PARTS.map(ring);
        assert!(wet.len() >= 20 && glass == wet && drink.is_superset(&wet));
    }
}
