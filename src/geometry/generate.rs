//! Deterministic meshes of any size, so that anybody can reproduce a measurement without downloads.

use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::TriangleMesh;

/// A random number in [0, 1) at an integer lattice point.
fn lattice(seed: u64, x: i64, y: i64, z: i64) -> f64 {
    let mut h = seed ^ 0x9e37_79b9_7f4a_7c15;
    for v in [x, y, z] {
        h = (h ^ v as u64).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        h ^= h >> 29;
    }
    h = h.wrapping_mul(0x94d0_49bb_1331_11eb);
    (h >> 11) as f64 / (1u64 << 53) as f64
}

/// Smoothly interpolated lattice noise in [−1, 1].
fn noise(seed: u64, p: DVec3) -> f64 {
    let cell = p.floor();
    let f = p - cell;
    let s = f * f * (DVec3::splat(3.0) - 2.0 * f);
    let [x, y, z] = cell.to_array().map(|c| c as i64);
    let mut sum = 0.0;
    for corner in 0..8 {
        let [i, j, k] = [corner & 1, corner >> 1 & 1, corner >> 2];
        let weight = |bit: i64, s: f64| if bit == 1 { s } else { 1.0 - s };
        sum += weight(i, s.x) * weight(j, s.y) * weight(k, s.z) * lattice(seed, x + i, y + j, z + k);
    }
    2.0 * sum - 1.0
}

/// Sum of octaves of halved wavelength; the amplitude falls by 0.55, which leaves fine detail visible.
fn fractal(seed: u64, p: DVec3, octaves: u32) -> f64 {
    let (mut sum, mut amplitude, mut p) = (0.0, 1.0, p);
    for octave in 0..octaves {
        sum += amplitude * noise(seed.wrapping_add(octave as u64), p);
        amplitude *= 0.55;
        p *= 2.0;
    }
    sum
}

/// A mountainous square `[−1, 1]²` in x and y, heights along z, of about (never fewer than) `triangles` triangles.
pub fn terrain(triangles: usize, seed: u64) -> TriangleMesh {
    field(triangles, |x, y| 0.25 * fractal(seed, DVec3::new(2.5 * x, 2.5 * y, 0.5), 10))
}

/// A lone peak with four ridges over the square `[−1, 1]²`, about 1.1 high along z, of about (never fewer than) `triangles`
/// triangles.
pub fn mountain(triangles: usize, seed: u64) -> TriangleMesh {
    field(triangles, |x, y| {
        // Bend the ridges a little, as a real mountain's are, more so towards the foot.
        let bend = |k: f64| 0.12 * fractal(seed, DVec3::new(1.5 * x, 1.5 * y, k), 3) * (x * x + y * y).sqrt();
        let (u, v) = (x + bend(11.5), y + bend(23.5));
        // Ridges where a coordinate is 0; the flanks between them are hollow.
        let d = (u.abs() + v.abs()).hypot(0.03);
        let rocks = 0.16 * fractal(seed, DVec3::new(3.0 * x, 3.0 * y, 0.5), 9) * (0.25 + d.min(1.0));
        1.15 * (-2.1 * d).exp() + rocks
    })
}

/// Heights over the square `[−1, 1]²`.
fn field(triangles: usize, height: impl Fn(f64, f64) -> f64 + Sync) -> TriangleMesh {
    let n = (((triangles as f64 / 2.0).sqrt().ceil()) as usize).max(1);
    let row = n + 1;
    let point = |i: usize| {
        let (x, y) = ((i % row) as f64 / n as f64 * 2.0 - 1.0, (i / row) as f64 / n as f64 * 2.0 - 1.0);
        DVec3::new(x, y, height(x, y)).as_vec3()
    };
    let positions: Vec<Vec3> = (0..row * row).into_par_iter().map(point).collect();
    let cell = |i: usize| {
        let (x, y) = (i % n, i / n);
        let at = |dx: usize, dy: usize| ((y + dy) * row + x + dx) as u32;
        [[at(0, 0), at(1, 0), at(1, 1)], [at(0, 0), at(1, 1), at(0, 1)]]
    };
    let indices = (0..n * n).into_par_iter().flat_map_iter(cell).collect();
    TriangleMesh { positions: positions.into(), indices, ..Default::default() }
}

/// A unit sphere with bumps, closed, of about (never fewer than) `triangles` triangles.
pub fn displaced_sphere(triangles: usize, seed: u64) -> TriangleMesh {
    let n = ((triangles as f64 / 8.0).sqrt().ceil() as usize).max(1);
    let (directions, indices) = octahedron(n);
    let bump = |d: &DVec3| (*d * (1.0 + 0.12 * fractal(seed, 2.0 * *d, 9))).as_vec3();
    let positions: Vec<Vec3> = directions.par_iter().map(bump).collect();
    TriangleMesh { positions: positions.into(), indices, ..Default::default() }
}

/// Haines' sphereflake as one mesh: a sphere with nine spheres of a third of its radius, and so on, of at least
/// `triangles` triangles. Spheres interpenetrate only by rounding.
pub fn sphereflake(triangles: usize) -> TriangleMesh {
    // Spend the triangles on levels until a sphere has between 128 and 1152 of them.
    let mut levels = 0;
    while flake_spheres(levels + 1) * 128 <= triangles {
        levels += 1;
    }
    let per_sphere = triangles.div_ceil(flake_spheres(levels));
    let n = ((per_sphere as f64 / 8.0).sqrt().ceil() as usize).max(1);
    let (directions, faces) = octahedron(n);
    let spheres = sphereflake_spheres(levels);
    let positions: Vec<Vec3> = spheres
        .par_iter()
        .flat_map_iter(|(c, r)| directions.iter().map(|d| (c.as_dvec3() + *d * *r as f64).as_vec3()))
        .collect();
    let count = directions.len() as u32;
    let indices = (0..spheres.len() as u32)
        .into_par_iter()
        .flat_map_iter(|s| faces.iter().map(move |f| f.map(|i| i + s * count)))
        .collect();
    TriangleMesh { positions: positions.into(), indices, ..Default::default() }
}

/// Number of spheres of a sphereflake with `levels` generations of children.
fn flake_spheres(levels: u32) -> usize {
    (0..=levels).map(|l| 9usize.pow(l)).sum()
}

/// Centres and radii of a sphereflake around the origin, the first sphere of radius ½.
pub fn sphereflake_spheres(levels: u32) -> Vec<(Vec3, f32)> {
    // Six children around the equator, three towards the pole, which points away from the parent.
    let children: Vec<DVec3> = (0..6)
        .map(|i| (0.0, TAU * i as f64 / 6.0))
        .chain((0..3).map(|i| (PI / 3.0, TAU * (i as f64 + 0.25) / 3.0)))
        .map(|(up, around): (f64, f64)| DVec3::new(up.cos() * around.cos(), up.cos() * around.sin(), up.sin()))
        .collect();
    let mut spheres = vec![(DVec3::ZERO, 0.5f64, DVec3::Z)];
    let mut parents = 0..1;
    for _ in 0..levels {
        for i in parents.clone() {
            let (c, r, axis) = spheres[i];
            let (s, t) = axis.any_orthonormal_pair();
            for d in &children {
                let d = (s * d.x + t * d.y + axis * d.z).normalize();
                spheres.push((c + d * (r * 4.0 / 3.0), r / 3.0, d));
            }
        }
        parents = parents.end..spheres.len();
    }
    spheres.into_iter().map(|(c, r, _)| (c.as_vec3(), r as f32)).collect()
}

/// Unit directions and faces of an octahedron whose edges are cut into `n`: 8n² triangles, closed, outward.
fn octahedron(n: usize) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    // Ring r has 4·min(r, 2n−r) vertices; the two poles have one.
    let ring_len = |r: usize| (4 * r.min(2 * n - r)).max(1);
    let mut first = vec![0usize; 2 * n + 2];
    for r in 0..=2 * n {
        first[r + 1] = first[r] + ring_len(r);
    }
    let axis = [DVec3::X, DVec3::Y, -DVec3::X, -DVec3::Y];
    let mut directions = Vec::with_capacity(first[2 * n + 1]);
    for r in 0..=2 * n {
        let m = r.min(2 * n - r);
        for i in 0..ring_len(r) {
            let (q, i) = (i.checked_div(m).unwrap_or(0), i.checked_rem(m).unwrap_or(0));
            let p = axis[q] * (m - i) as f64 + axis[(q + 1) % 4] * i as f64 + DVec3::Z * (n as f64 - r as f64);
            // The sine spreads the vertices more evenly than plain normalising.
            let even = (p / n as f64).to_array().map(|c| (c * PI / 2.0).sin());
            directions.push(DVec3::from_array(even).try_normalize().unwrap_or(DVec3::splat(FRAC_1_SQRT_2)));
        }
    }
    let at = |r: usize, q: usize, i: usize| (first[r] + (q * r.min(2 * n - r) + i) % ring_len(r)) as u32;
    let mut faces = Vec::with_capacity(8 * n * n);
    for r in 1..=n {
        for q in 0..4 {
            for i in 0..r {
                // Between ring r−1 and r, and mirrored in the lower half.
                let (lower, mirror) = (2 * n - r, 2 * n - r + 1);
                faces.push([at(r - 1, q, i), at(r, q, i), at(r, q, i + 1)]);
                faces.push([at(mirror, q, i), at(lower, q, i + 1), at(lower, q, i)]);
                if i + 1 < r {
                    faces.push([at(r - 1, q, i), at(r, q, i + 1), at(r - 1, q, i + 1)]);
                    faces.push([at(mirror, q, i), at(mirror, q, i + 1), at(lower, q, i + 1)]);
                }
            }
        }
    }
    (directions, faces)
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;

    /// Every edge of a closed oriented mesh is used once in each direction.
    fn assert_closed(m: &TriangleMesh) {
        let mut edges = HashMap::new();
        for t in &m.indices {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                assert_eq!(edges.insert((a, b), ()), None, "edge {a} {b} twice");
            }
        }
        assert!(edges.keys().all(|&(a, b)| edges.contains_key(&(b, a))));
    }

    /// Volume by the divergence theorem; positive when the triangles face outward.
    fn volume(m: &TriangleMesh) -> f64 {
        (0..m.indices.len() as u32)
            .map(|i| {
                let [a, b, c] = m.triangle(i).map(|p| p.as_dvec3());
                a.dot(b.cross(c)) / 6.0
            })
            .sum()
    }

    #[test]
    fn meshes_have_the_size_asked_for_and_no_slivers() {
        for n in [1, 100, 12_345] {
            for m in [terrain(n, 7), displaced_sphere(n, 7), sphereflake(n)] {
                assert!(m.indices.len() >= n && m.indices.len() < 2 * n + 200, "{} for {n}", m.indices.len());
                let vertices = m.positions.len() as u32;
                assert!(m.indices.iter().flatten().all(|&i| i < vertices));
                assert!((0..m.indices.len() as u32).all(|i| m.triangle_area(i) > 0.0));
            }
        }
    }

    #[test]
    fn spheres_are_closed_and_outward() {
        let m = displaced_sphere(5000, 3);
        assert_closed(&m);
        assert!(volume(&m) > 2.0 && volume(&m) < 8.0);
        let flake = sphereflake(10_000);
        assert_closed(&flake);
        // Nine children of a 27th of the volume each: the sum is geometric with ratio 1/3.
        let one = 4.0 / 3.0 * PI / 8.0;
        let expected = one * (1.0 + 1.0 / 3.0);
        assert!((volume(&flake) / expected - 1.0).abs() < 0.1, "{} {expected}", volume(&flake));
    }

    #[test]
    fn a_mountain_has_one_top_near_its_middle() {
        for seed in 0..4 {
            let m = mountain(5000, seed);
            assert!(m.indices.len() >= 5000);
            let top = m.positions.as_slice().iter().copied().max_by(|a, b| a.z.total_cmp(&b.z)).expect("vertices");
            assert!(top.z > 0.9 && top.z < 1.3 && top.truncate().length() < 0.2, "seed {seed}: {top}");
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_mesh() {
        let same = |a: &TriangleMesh, b: &TriangleMesh| a.positions.as_slice() == b.positions.as_slice();
        assert!(same(&terrain(1000, 1), &terrain(1000, 1)) && !same(&terrain(1000, 1), &terrain(1000, 2)));
    }
}
