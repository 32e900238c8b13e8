use super::hessian::{Corner, Derivatives};
use super::*;
use crate::math::{DVec3, Frame};
use crate::sample::{Key, Purpose, Sampler, Sequence, mix64};

/// Irradiance at `p` under the unit normal `n` from the unit square around (0, 0, 1) that shines downwards with radiance 1,
/// by the midpoint rule in f64.
fn square_light(p: DVec3, n: DVec3) -> f64 {
    const N: usize = 200;
    let h = 1.0 / N as f64;
    let mut sum = 0.0;
    for i in 0..N {
        for j in 0..N {
            let q = DVec3::new((i as f64 + 0.5) * h - 0.5, (j as f64 + 0.5) * h - 0.5, 1.0);
            let d = q - p;
            let r_sq = d.length_squared();
            sum += d.dot(n).max(0.0) * d.z / (r_sq * r_sq);
        }
    }
    sum * h * h
}

/// What a ray from `p` sees of that square; everything else is black and far away.
fn look(p: Vec3, wi: Vec3) -> Seen {
    let t = (1.0 - p.z) / wi.z;
    let q = p + wi * t;
    if wi.z > 0.0 && q.x.abs() < 0.5 && q.y.abs() < 0.5 {
        Seen { wi, radiance: Rgb::splat(1.0), distance: t }
    } else {
        Seen { wi, radiance: Rgb::BLACK, distance: f32::INFINITY }
    }
}

fn record(p: Vec3, n: Vec3, rows: u32, seed: u64) -> CacheRecord {
    let hemisphere = Hemisphere::new(n, rows);
    let seen: Vec<Seen> = (0..hemisphere.len())
        .map(|i| {
            let mut s = Sampler::new(Sequence::Independent, Key::new(seed, Purpose::Test, 0), i as u64);
            look(p, hemisphere.direction(i, s.next_2d()))
        })
        .collect();
    hemisphere.record(p, &seen, CacheMetric::SplitSphere)
}

/// Means of 32 records with 20·63 strata each; their standard errors are below 1 % of the values compared, and the bound is
/// 5 % of the length of the gradient [Ward and Heckbert 1992].
#[test]
fn gradients_of_a_square_light() {
    for (p, n) in
        [(Vec3::new(0.3, 0.1, 0.0), Vec3::Z), (Vec3::new(-0.6, 0.4, 0.2), Vec3::new(0.2, -0.1, 1.0).normalize())]
    {
        let seeds = 32;
        let (mut e, mut turn, mut step) = (0.0f64, DVec3::ZERO, DVec3::ZERO);
        for seed in 0..seeds {
            let r = record(p, n, 20, seed);
            e += r.irradiance.g as f64 / seeds as f64;
            turn += r.rotation[1].as_dvec3() / seeds as f64;
            step += r.translation[1].as_dvec3() / seeds as f64;
        }
        let (p, n) = (p.as_dvec3(), n.as_dvec3());
        let expected = square_light(p, n);
        assert!((e / expected - 1.0).abs() < 0.01, "irradiance {e}, not {expected}");
        // Differences along two tangents.
        let s = n.cross(DVec3::Y).normalize();
        let h = 1e-3;
        let mut wrong_step = DVec3::ZERO;
        let mut wrong_turn = DVec3::ZERO;
        let (mut length_step, mut length_turn) = (0.0f64, 0.0f64);
        for axis in [s, n.cross(s)] {
            let d = (square_light(p + axis * h, n) - square_light(p - axis * h, n)) / (2.0 * h);
            wrong_step += axis * (step.dot(axis) - d);
            length_step = length_step.hypot(d);
            // A turn about `axis` moves n along axis × n.
            let towards = |a: f64| (n + axis.cross(n) * a).normalize();
            let d = (square_light(p, towards(h)) - square_light(p, towards(-h))) / (2.0 * h);
            wrong_turn += axis * (turn.dot(axis) - d);
            length_turn = length_turn.hypot(d);
        }
        assert!(wrong_step.length() < 0.05 * length_step, "step: off by {wrong_step} of {length_step}");
        assert!(wrong_turn.length() < 0.05 * length_turn, "turn: off by {wrong_turn} of {length_turn}");
    }
}

/// Triangles with the radiance of their farthest corner leave out the rim of the square, on average half a stratum of 64 rows
/// all around: 15 % are allowed for, of the means of 8 records.
#[test]
fn second_derivatives_of_a_square_light() {
    let p = Vec3::new(0.3, 0.1, 0.0);
    let (mut hessian, mut gradient, seeds) = ([0.0f64; 3], Vec3::ZERO, 8);
    let frame = Frame::from_normal(Vec3::Z);
    for seed in 0..seeds {
        let hemisphere = Hemisphere::new(Vec3::Z, 64);
        let corners: Vec<Corner> = (0..hemisphere.len())
            .map(|i| {
                let mut s = Sampler::new(Sequence::Independent, Key::new(seed, Purpose::Test, 0), i as u64);
                let seen = look(p, hemisphere.direction(i, s.next_2d()));
                Corner::new(seen.wi, seen.distance, seen.radiance)
            })
            .collect();
        let d = Derivatives::of(&frame, 64, hemisphere.len() as usize / 64, &corners);
        hessian.iter_mut().zip(d.hessian).for_each(|(sum, h)| *sum += h / seeds as f64);
        gradient += d.gradient[1] / seeds as f32;
    }
    let h = 1e-2;
    let (s, t) = (frame.s.as_dvec3() * h, frame.t.as_dvec3() * h);
    let at = |d: DVec3| square_light(p.as_dvec3() + d, DVec3::Z);
    let middle = at(DVec3::ZERO);
    let expected = [
        at(s) + at(-s) - 2.0 * middle,
        0.25 * (at(s + t) + at(-s - t) - at(s - t) - at(t - s)),
        at(t) + at(-t) - 2.0 * middle,
    ]
    .map(|d| d / (h * h));
    let size = expected.iter().map(|e| e * e).sum::<f64>().sqrt();
    let off = hessian.iter().zip(expected).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    assert!(off < 0.15 * size, "{hessian:?}, not {expected:?}");
    let slope = DVec3::new((at(s) - at(-s)) / (2.0 * h), (at(t) - at(-t)) / (2.0 * h), 0.0);
    let local = DVec3::new(gradient.dot(frame.s) as f64, gradient.dot(frame.t) as f64, 0.0);
    assert!((local - slope).length() < 0.15 * slope.length(), "{local}, not {slope}");
}

/// At equal records the gradients must at least halve the error of the interpolation.
#[test]
fn gradients_halve_the_error() {
    let bounds = Bounds3::new(Vec3::splat(-1.0), Vec3::splat(1.0));
    let rms = |gradients: bool| {
        let settings = CacheSettings { gradients, clamp_screen: false, clamp_neighbor: false, ..Default::default() };
        let mut cache = IrradianceCache::new(settings, &bounds);
        for i in 0..70u64 {
            let p = Vec3::new(1.2 * uniform(2 * i) - 0.6, 1.2 * uniform(2 * i + 1) - 0.6, 0.0);
            let mut r = record(p, Vec3::Z, 64, i);
            // One radius for all, so that both caches use the same records everywhere.
            r.radius = 0.3;
            r.irradiance = Rgb::splat(square_light(p.as_dvec3(), DVec3::Z) as f32);
            cache.insert(r, f32::INFINITY);
        }
        let (mut sum, mut known) = (0.0, 0);
        for i in 0..64 {
            let p = Vec3::new((i % 8) as f32 * 0.1 - 0.35, (i / 8) as f32 * 0.1 - 0.35, 0.0);
            let Some(found) = cache.interpolate(p, Vec3::Z) else { continue };
            let expected = square_light(p.as_dvec3(), DVec3::Z);
            sum += (found.g as f64 / expected - 1.0).powi(2);
            known += 1;
        }
        assert!(known > 50, "{known} of 64 points are near a record");
        (sum / known as f64).sqrt()
    };
    let (with, without) = (rms(true), rms(false));
    assert!(with < 0.5 * without, "{with} with gradients, {without} without");
}

fn uniform(i: u64) -> f32 {
    (mix64(i) >> 40) as f32 / (1u64 << 24) as f32
}

#[test]
fn the_octree_finds_every_record_that_reaches_a_point() {
    let point = |i: u64| Vec3::new(uniform(3 * i), uniform(3 * i + 1), uniform(3 * i + 2)) * 2.0 - 1.0;
    let mut tree = octree::Octree::new(&Bounds3::new(Vec3::splat(-1.0), Vec3::splat(1.0)));
    let spheres: Vec<(Vec3, f32)> = (0..500).map(|i| (point(i), 0.5 * uniform(9000 + i).powi(4))).collect();
    for (i, &(p, r)) in spheres.iter().enumerate() {
        tree.insert(i as u32, p, r);
    }
    for i in 1000..3000 {
        let p = point(i);
        let mut found = Vec::new();
        tree.visit(p, |r| found.push(r));
        let unique = found.len();
        found.sort_unstable();
        found.dedup();
        assert_eq!(found.len(), unique, "a record came twice");
        for (j, &(centre, r)) in spheres.iter().enumerate() {
            assert!(p.distance(centre) >= r || found.contains(&(j as u32)), "record {j} at {p}");
        }
    }
}

#[test]
fn records_are_used_where_they_are_good_and_nowhere_else() {
    let bounds = Bounds3::new(Vec3::splat(-1.0), Vec3::splat(1.0));
    let settings = CacheSettings { clamp_screen: false, ..Default::default() };
    let mut cache = IrradianceCache::new(settings, &bounds);
    let flat = CacheRecord { n: Vec3::Z, radius: 0.2, irradiance: Rgb::new(1.0, 2.0, 3.0), ..Default::default() };
    cache.insert(flat, f32::INFINITY);
    let at = |x: f32, z: f32, n: Vec3| cache.interpolate(Vec3::new(x, 0.0, z), n);
    assert_eq!(at(0.09, 0.0, Vec3::Z), Some(flat.irradiance));
    assert_eq!(at(0.11, 0.0, Vec3::Z), None, "too far");
    assert_eq!(at(0.0, 0.0, -Vec3::Z), None, "the other side");
    assert_eq!(at(0.0, 0.0, Vec3::X), None, "turned away");
    assert_eq!(at(0.0, -0.05, Vec3::Z), None, "behind the record");
    assert!(at(0.0, 0.005, Vec3::Z).is_some());
    // A neighbour that sees something near shortens the first one's reach.
    let corner = CacheRecord { p: Vec3::new(0.05, 0.0, 0.0), radius: 0.02, ..flat };
    cache.insert(corner, f32::INFINITY);
    assert!((cache.records()[0].radius - 0.07).abs() < 1e-6);
    // On the screen, a record reaches between 1.5 and 20 pixels.
    let mut cache = IrradianceCache::new(CacheSettings::default(), &bounds);
    cache.insert(flat, 0.001);
    cache.insert(CacheRecord { p: Vec3::X, radius: 1e-6, ..flat }, 0.001);
    let reach: Vec<f32> = cache.records().iter().map(|r| r.radius * REACH).collect();
    assert!((reach[0] - 0.02).abs() < 1e-6 && (reach[1] - 0.0015).abs() < 1e-6, "{reach:?}");
}
