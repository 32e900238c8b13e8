//! Maps against brute force, shapes of trees, and the traps that other renderers fell into.

use super::simd::Level;
use super::*;
use crate::math::Vec3;
use crate::sample::mix64;

/// A uniform number in [0, 1) named by an integer.
fn uniform(i: u64) -> f32 {
    (mix64(i) >> 40) as f32 / (1u64 << 24) as f32
}

fn vector(i: u64) -> Vec3 {
    Vec3::new(uniform(3 * i), uniform(3 * i + 1), uniform(3 * i + 2))
}

#[derive(Clone, Copy, Debug)]
enum Shape {
    Random,
    Clustered,
    Coplanar,
    Collinear,
    Duplicate,
    Identical,
}

impl Shape {
    const ALL: [Self; 6] =
        [Self::Random, Self::Clustered, Self::Coplanar, Self::Collinear, Self::Duplicate, Self::Identical];

    fn point(self, i: u64) -> Vec3 {
        match self {
            Self::Random => vector(i),
            Self::Clustered => vector(i % 7 + 1_000_000) + 1e-3 * (vector(i) - 0.5),
            Self::Coplanar => vector(i) * Vec3::new(1.0, 0.0, 1.0) + Vec3::Y,
            Self::Collinear => Vec3::new(1.0, -2.0, 0.5) * uniform(i),
            Self::Duplicate => (vector(i) * 4.0).floor() * 0.25,
            Self::Identical => Vec3::new(0.1, 0.2, 0.3),
        }
    }
}

/// A photon that carries its emission index in its power bytes.
fn photon(p: Vec3, i: usize) -> Photon {
    Photon { position: p.to_array(), power: (i as u32).to_le_bytes(), ..Photon::default() }
}

fn build(points: &[Vec3]) -> PhotonMap {
    PhotonMap::build(points.iter().enumerate().map(|(i, &p)| photon(p, i)).collect())
}

fn id(map: &PhotonMap, index: u32) -> usize {
    u32::from_le_bytes(map.photon(index).power) as usize
}

/// Squared distance with the rounding of the queries.
fn distance_sq(a: Vec3, b: Vec3) -> f32 {
    let d = a - b;
    d.x * d.x + d.y * d.y + d.z * d.z
}

/// Sorted squared distances of the k nearest within the radius.
fn brute(points: &[Vec3], q: Vec3, k: usize, r_sq: f32) -> Vec<f32> {
    let mut d: Vec<f32> = points.iter().map(|&p| distance_sq(p, q)).filter(|&d| d <= r_sq).collect();
    d.sort_unstable_by(f32::total_cmp);
    d.truncate(k);
    d
}

/// Asks for the k nearest by every way there is and compares with brute force.
fn check_nearest(map: &PhotonMap, points: &[Vec3], q: Vec3, k: usize, r_sq: f32, scratch: &mut KnnScratch) {
    let expected = brute(points, q, k, r_sq);
    let answer = map.nearest(q, k, r_sq, scratch);
    let mut d_sq: Vec<f32> = answer.d_sq.to_vec();
    d_sq.sort_unstable_by(f32::total_cmp);
    assert_eq!(d_sq, expected, "n = {}, k = {k}, r² = {r_sq}", points.len());
    assert_eq!(answer.full, k > 0 && expected.len() == k);
    assert_eq!(answer.radius_sq, if answer.full { expected[k - 1] } else { r_sq });
    // Every index is a different photon, at the distance told.
    let mut ids: Vec<usize> = answer.iter().map(|(index, _)| id(map, index)).collect();
    for (&i, (index, d)) in ids.iter().zip(answer.iter()) {
        assert_eq!((points[i], d), (map.position(index), distance_sq(points[i], q)));
    }
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), expected.len());
}

fn check_within(map: &PhotonMap, points: &[Vec3], q: Vec3, r_sq: f32, scratch: &mut KnnScratch) {
    let mut ids = Vec::new();
    map.within(q, r_sq, scratch, |index, d_sq| {
        assert_eq!(d_sq, distance_sq(map.position(index), q));
        ids.push(id(map, index));
    });
    ids.sort_unstable();
    let expected: Vec<usize> = (0..points.len()).filter(|&i| distance_sq(points[i], q) <= r_sq).collect();
    assert_eq!(ids, expected, "n = {}, r² = {r_sq}", points.len());
}

#[test]
fn queries_equal_brute_force_for_every_small_n() {
    for level in Level::available() {
        let (mut scratch, mut range) = (KnnScratch::with_level(level), KnnScratch::with_level(level));
        for shape in Shape::ALL {
            for n in 0..=200u64 {
                let points: Vec<Vec3> = (0..n).map(|i| shape.point(i + n * 1000)).collect();
                let map = build(&points);
                assert_eq!(map.len(), points.len());
                for j in 0..4 {
                    // A photon's own place, a place near by, and one outside.
                    let q = match j {
                        0 if n > 0 => points[n as usize / 2],
                        3 => Vec3::new(-3.0, 0.4, 9.0),
                        _ => shape.point(j + 77) + 0.01 * vector(j),
                    };
                    for k in [0, 1, 2, 7, 50, 300] {
                        for r_sq in [0.0, 1e-4, 0.05, f32::INFINITY] {
                            check_nearest(&map, &points, q, k, r_sq, &mut scratch);
                        }
                    }
                    for r_sq in [0.0, 1e-4, 0.05, f32::INFINITY] {
                        check_within(&map, &points, q, r_sq, &mut range);
                    }
                }
            }
        }
    }
}

#[test]
fn queries_equal_brute_force_on_larger_maps() {
    for level in Level::available() {
        let (mut scratch, mut range) = (KnnScratch::with_level(level), KnnScratch::with_level(level));
        for shape in Shape::ALL {
            for n in [1023u64, 1024, 3000] {
                let points: Vec<Vec3> = (0..n).map(|i| shape.point(i)).collect();
                let map = build(&points);
                for j in 0..40 {
                    // Neighbouring queries, so that the last answer's bound is at work.
                    let q = shape.point(j / 8) + 0.002 * (j % 8) as f32;
                    let k = [50, 10, 49, 1, 200][j as usize % 5];
                    check_nearest(&map, &points, q, k, f32::INFINITY, &mut scratch);
                    check_nearest(&map, &points, q, k, 0.01, &mut scratch);
                    check_within(&map, &points, q, 0.003, &mut range);
                    let reference = stackfree::nearest(&map, q, k, 0.01);
                    let d_sq: Vec<f32> = reference.iter().map(|r| r.0).collect();
                    assert_eq!(d_sq, brute(&points, q, k, 0.01));
                }
            }
        }
    }
}

#[test]
fn the_shape_is_left_balanced_for_every_n() {
    for n in 0..=4096u64 {
        // Coordinates on a coarse grid, so that ties are everywhere; NaN never.
        let points: Vec<Vec3> = (0..n).map(|i| (vector(i + n) * 8.0).floor()).collect();
        let map = build(&points);
        assert!(map.len() == n as usize && map.is_heap(), "n = {n}");
    }
}

#[test]
fn the_widest_extent_is_split() {
    // On a plane y is never split; round-robin axes would waste every third level.
    let points: Vec<Vec3> = (0..1000).map(|i| Shape::Coplanar.point(i)).collect();
    let map = build(&points);
    assert!((1..500).all(|slot| map.flags(map.index_of_slot(slot)).axis() != 1));
    let line: Vec<Vec3> = (0..1000).map(|i| Vec3::new(uniform(i), 0.0, 3.0 * uniform(i + 5000))).collect();
    assert_eq!(build(&line).splits.axis(1), 2);
}

#[test]
fn a_million_identical_photons() {
    let p = Vec3::new(0.5, -0.25, 0.125);
    let n = 1_000_000;
    let map = build(&vec![p; n]);
    let mut scratch = KnnScratch::new();
    for r_sq in [0.0, f32::INFINITY] {
        let answer = map.nearest(p, 50, r_sq, &mut scratch);
        assert!(answer.full && answer.d_sq.iter().all(|&d| d == 0.0));
    }
    let mut count = 0;
    map.within(p, 0.0, &mut scratch, |_, _| count += 1);
    assert_eq!(count, n);
    // Ties by emission index: read from left to right the photons are in emission order.
    assert!((1..=n).all(|slot| id(&map, map.index_of_slot(slot)) == heap::rank(slot, n)));
    assert!(map.memory() as f64 <= 20.5 * n as f64);
    // Buckets are smallest for a power of two.
    let n = 1 << 18;
    assert!(build(&vec![p; n]).memory() as f64 <= 20.5 * n as f64);
}

#[test]
fn bad_positions_are_rejected_and_counted() {
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 2e18];
    let mut points: Vec<Vec3> = (0..100).map(vector).collect();
    for (i, &b) in bad.iter().enumerate() {
        points.insert(i * 20, Vec3::new(0.5, 0.5, 0.5).with_y(b));
    }
    let map = build(&points);
    assert_eq!((map.len(), map.rejected()), (100, 4));
    let good: Vec<Vec3> = points.iter().copied().filter(|&p| packed::storable(p)).collect();
    assert_eq!(map.nearest(Vec3::ZERO, 100, f32::INFINITY, &mut KnnScratch::new()).len(), good.len());
    // A query that is not a number finds nothing instead of hanging or panicking.
    let mut scratch = KnnScratch::new();
    assert!(map.nearest(Vec3::NAN, 5, f32::INFINITY, &mut scratch).is_empty());
    assert!(map.nearest(Vec3::ZERO, 5, f32::NAN, &mut scratch).is_empty());
    assert!(map.nearest(Vec3::ZERO, 5, -1.0, &mut scratch).is_empty());
    map.within(Vec3::NAN, 1.0, &mut scratch, |_, _| panic!("nothing is within a radius of NaN"));
}

#[test]
fn maps_and_answers_do_not_depend_on_threads() {
    // Enough for nodes that all threads divide together.
    let points: Vec<Vec3> = (0..600_000).map(|i| Shape::Duplicate.point(i) + 0.1 * Shape::Coplanar.point(i)).collect();
    let build_with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a small pool");
        pool.install(|| build(&points))
    };
    let one = build_with(1);
    for threads in [2, 3, 8] {
        let other = build_with(threads);
        assert!((0..points.len() as u32).all(|i| one.photon(i) == other.photon(i)));
    }
}

#[test]
fn a_used_scratch_gives_the_same_answer_as_a_new_one() {
    // Also after another map, another k, and with ties on every shell.
    let points: Vec<Vec3> = (0..20_000).map(|i| (vector(i) * 16.0).floor() / 16.0).collect();
    let (map, other) = (build(&points), build(&points[..300]));
    let mut used = KnnScratch::new();
    for j in 0..500u64 {
        let q = Vec3::splat(j as f32 * 1e-3);
        let k = [20, 50, 3][j as usize % 3];
        if j % 7 == 0 {
            other.nearest(q, k, f32::INFINITY, &mut used);
        }
        let expected: Vec<u32> = map.nearest(q, k, f32::INFINITY, &mut KnnScratch::new()).index.to_vec();
        assert_eq!(map.nearest(q, k, f32::INFINITY, &mut used).index, expected);
    }
}

#[test]
fn the_nearest_are_the_first_ones_met_of_those_near_enough() {
    // Whatever radii are guessed: `within` has none to guess. Duplicates have many ties at the rim.
    for shape in Shape::ALL {
        let points: Vec<Vec3> = (0..20_000).map(|i| shape.point(i)).collect();
        let map = build(&points);
        let mut scratch = KnnScratch::new();
        for j in 0..200u64 {
            let q = shape.point(j) + vector(j) * [0.0, 1e-4, 1e-2, 1.0][j as usize % 4];
            let k = [1, 5, 50, 200, 3000][j as usize % 5];
            let answer = map.nearest(q, k, f32::INFINITY, &mut scratch);
            let (index, kth) = (answer.index.to_vec(), answer.radius_sq);
            let mut met = Vec::new();
            map.within(q, kth, &mut scratch, |i, d_sq| met.push((i, d_sq)));
            let mut ties = k - met.iter().filter(|m| m.1 < kth).count();
            met.retain(|&(_, d_sq)| {
                let tie = d_sq == kth && ties > 0;
                ties -= usize::from(tie);
                d_sq < kth || tie
            });
            assert!(index.iter().eq(met.iter().map(|(i, _)| i)), "{shape:?}, query {j}, k = {k}");
        }
    }
}

#[test]
fn every_instruction_set_gives_the_same_bits() {
    let points: Vec<Vec3> = (0..30_000).map(|i| Shape::Clustered.point(i)).collect();
    let map = build(&points);
    let mut portable = KnnScratch::with_level(Level::Portable);
    for level in Level::available() {
        let mut scratch = KnnScratch::with_level(level);
        for j in 0..200 {
            let q = Shape::Clustered.point(j) + 1e-4 * vector(j);
            let a = map.nearest(q, 60, f32::INFINITY, &mut portable);
            let b = map.nearest(q, 60, f32::INFINITY, &mut scratch);
            assert_eq!((a.index, a.d_sq, a.radius_sq), (b.index, b.d_sq, b.radius_sq), "{level:?}");
        }
    }
}

#[test]
fn filtered_neighbours_equal_filtered_brute_force() {
    let points: Vec<Vec3> = (0..5000).map(vector).collect();
    let map = build(&points);
    let thirds: Vec<Vec3> = points.iter().copied().step_by(3).collect();
    let mut scratch = KnnScratch::new();
    for j in 0..100u64 {
        let q = vector(j + 90_000);
        for k in [1, 50, 2000] {
            let answer = map.nearest_where(q, k, 0.3, &mut scratch, |index| id(&map, index).is_multiple_of(3));
            let mut d_sq = answer.d_sq.to_vec();
            d_sq.sort_unstable_by(f32::total_cmp);
            assert_eq!(d_sq, brute(&thirds, q, k, 0.3));
        }
        check_nearest(&map, &points, q, 50, f32::INFINITY, &mut scratch);
    }
}

#[test]
fn the_nearest_of_those_found_are_what_a_search_finds() {
    for shape in Shape::ALL {
        let points: Vec<Vec3> = (0..3000).map(|i| shape.point(i)).collect();
        let (map, mut scratch, mut narrow_scratch) = (build(&points), KnnScratch::new(), KnnScratch::new());
        for q in (0..60).map(|i| shape.point(i * 41) + 0.01 * vector(i + 77)) {
            for (k, r_sq) in [(100, 4.0), (100, 0.01), (7, 1e-3), (2, 1e-6)] {
                let fewer = map.nearest(q, k, r_sq, &mut scratch).nearest(k / 2, r_sq / 2.0);
                let (got, wanted) = (fewer.as_neighbours(), map.nearest(q, k / 2, r_sq / 2.0, &mut narrow_scratch));
                let sorted = |n: &Neighbours| {
                    let mut d_sq = n.d_sq.to_vec();
                    d_sq.sort_unstable_by(f32::total_cmp);
                    d_sq
                };
                assert_eq!((got.full, got.radius_sq), (wanted.full, wanted.radius_sq), "{shape:?} {k} {r_sq}");
                assert_eq!(sorted(&got), sorted(&wanted), "{shape:?} {k} {r_sq}");
                assert!(got.iter().all(|(i, d_sq)| distance_sq(map.position(i), q) == d_sq));
            }
        }
    }
}

#[test]
fn a_map_read_in_heap_order_is_the_same_map() {
    let points: Vec<Vec3> = (0..3000).map(vector).collect();
    let map = build(&points);
    let photons: Vec<Photon> = map.heap_order().collect();
    let copy = PhotonMap::from_heap_order(&photons).expect("it was a heap");
    assert!((0..map.len() as u32).all(|i| map.photon(i) == copy.photon(i)));
    // Two photons of different sides exchanged: not a heap any more.
    let mut wrong = photons;
    wrong.swap(1, 2);
    assert!(PhotonMap::from_heap_order(&wrong).is_none());
}

#[test]
fn a_map_without_directions_is_two_bytes_smaller_and_else_the_same() {
    let points: Vec<Vec3> = (0..3000).map(vector).collect();
    let photons: Vec<Photon> = points.iter().enumerate().map(|(i, &p)| photon(p, i)).collect();
    let (full, lean) = (PhotonMap::build(photons.clone()), PhotonMap::build_with(photons, false));
    assert_eq!(full.memory() - lean.memory(), 2 * 3000);
    for i in 0..3000 {
        assert_eq!((full.position(i), full.power(i), full.flags(i)), (lean.position(i), lean.power(i), lean.flags(i)));
        let towards = if lean.side(i) { lean.normal(i) } else { -lean.normal(i) };
        assert_eq!(lean.direction(i), towards);
    }
}

/// The photons of every slot by sorting the whole node at every level.
fn balance_by_sorting(points: &[Vec3], mut ids: Vec<usize>, slot: usize, heap: &mut [usize]) {
    if ids.is_empty() {
        return;
    }
    let extent = |a: usize| {
        let (lo, hi) = ids
            .iter()
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), &i| (lo.min(points[i][a]), hi.max(points[i][a])));
        hi - lo
    };
    let axis = (1..3).fold(0, |best, a| if extent(a) > extent(best) { a } else { best });
    ids.sort_by(|&i, &j| points[i][axis].total_cmp(&points[j][axis]).then(i.cmp(&j)));
    let right = ids.split_off(super::heap::left_size(ids.len()) + 1);
    heap[slot] = ids.pop().expect("a median");
    balance_by_sorting(points, ids, 2 * slot, heap);
    balance_by_sorting(points, right, 2 * slot + 1, heap);
}

/// Builds by every instruction set's loops and compares with [`balance_by_sorting`].
fn check_builds(points: &[Vec3], set: usize) {
    let n = points.len();
    let mut heap = vec![0; n + 1];
    balance_by_sorting(points, (0..n).collect(), 1, &mut heap);
    for level in Level::available() {
        let photons = points.iter().enumerate().map(|(i, &p)| photon(p, i)).collect();
        let map = PhotonMap::build_on(level, photons, true);
        for (slot, &expected) in heap.iter().enumerate().skip(1) {
            let index = map.index_of_slot(slot);
            assert_eq!(id(&map, index), expected, "slot {slot} of {n}, set {set}, {level:?}");
            assert_eq!(map.position(index).to_array().map(f32::to_bits), points[expected].to_array().map(f32::to_bits));
        }
        assert_eq!(map.bounds(), crate::math::Bounds3::from_points(points.iter().copied()));
    }
}

#[test]
fn every_instruction_set_builds_the_map_that_sorting_gives() {
    // Sizes around a bucket's, of one step and of two; coordinates with and without ties, around zero, and both zeros.
    let sets: [fn(u64) -> Vec3; 4] = [
        |i| vector(i) - 0.5,
        |i| (vector(i) * 8.0).floor() - 4.0,
        |i| (vector(i) * Vec3::new(3.0, 2000.0, 1.0)).floor() * Vec3::new(0.1, -1e-5, 0.0),
        |i| if i % 3 == 0 { vector(i) } else { Vec3::splat(0.25) },
    ];
    for n in [0, 1, 2, 62, 63, 64, 95, 96, 127, 128, 1000, 5000, 20_000, 33_333] {
        for (set, point) in sets.iter().enumerate() {
            check_builds(&(0..n).map(point).collect::<Vec<_>>(), set);
        }
    }
    // Nodes that are divided in pieces; the median of the first one is among ties in many pieces.
    for set in [0, 3] {
        check_builds(&(0..530_000).map(sets[set]).collect::<Vec<_>>(), set);
    }
}
