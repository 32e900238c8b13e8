use glam::Vec3;
use rayon::prelude::*;

/// Triangles whose corner weights are computed in parallel before they are added in order.
const BATCH: usize = 1 << 16;

/// Smooth vertex normals: the unit normals of the triangles around a point, weighted by their interior angles there
/// [Thürmer and Wüthrich 1998], as Mitsuba computes them when a file has none. `points` says which vertices share a
/// point. A vertex without a proper triangle gets +x, as in Mitsuba.
///
/// The sums run in triangle order whatever the number of threads.
pub(super) fn smooth_normals(positions: &[Vec3], indices: &[[u32; 3]], points: Option<&[u32]>) -> Vec<Vec3> {
    let point = |vertex: u32| points.map_or(vertex, |p| p[vertex as usize]) as usize;
    let mut sums = vec![Vec3::ZERO; positions.len()];
    let mut weighted = vec![[Vec3::ZERO; 3]; indices.len().min(BATCH)];
    for batch in indices.chunks(BATCH) {
        // Weight the normal of each triangle by its three angles.
        let weighted = &mut weighted[..batch.len()];
        weighted.par_iter_mut().zip(batch).with_min_len(1024).for_each(|(out, corners)| {
            *out = corner_normals(corners.map(|i| positions[i as usize]));
        });
        // Add in a fixed order.
        for (corners, normals) in batch.iter().zip(weighted.iter()) {
            for (&corner, &n) in corners.iter().zip(normals) {
                sums[point(corner)] += n;
            }
        }
    }
    sums.par_iter_mut().for_each(|n| *n = n.try_normalize().unwrap_or(Vec3::X));
    match points {
        None => sums,
        Some(points) => points.iter().map(|&p| sums[p as usize]).collect(),
    }
}

/// The triangle's unit normal times the interior angle at each corner.
fn corner_normals(p: [Vec3; 3]) -> [Vec3; 3] {
    let [a, b, c] = [p[1] - p[0], p[2] - p[1], p[0] - p[2]];
    // The largest coordinate difference comes out as 1, so that no product over- or underflows.
    let largest = a.abs().max(b.abs()).max(c.abs()).max_element();
    if !(largest > 0.0 && largest.is_finite()) {
        return [Vec3::ZERO; 3];
    }
    let (a, b, c) = (a / largest, b / largest, c / largest);
    let n = a.cross(-c);
    let length = n.length();
    if length == 0.0 {
        return [Vec3::ZERO; 3];
    }
    let unit = n / length;
    // The cross product of any two edges has the same length: tan of an angle is that over their dot product.
    [-(c.dot(a)), -(a.dot(b)), -(b.dot(c))].map(|cosine| unit * length.atan2(cosine))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_of_a_triangle_sum_to_pi() {
        for scale in [1e-20_f32, 1.0, 1e18] {
            let p = [Vec3::new(0.1, 0.2, 0.3), Vec3::new(2.0, -0.5, 0.7), Vec3::new(-0.4, 1.5, 0.2)].map(|v| v * scale);
            let total: f32 = corner_normals(p).iter().map(|n| n.length()).sum();
            assert!((total - std::f32::consts::PI).abs() < 1e-5, "scale {scale}: {total}");
        }
    }

    #[test]
    fn a_cube_has_diagonal_normals() {
        // Each square is cut along one diagonal; weights by angle hide where, weights by count would not.
        let positions: Vec<Vec3> =
            (0..8).map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32)).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5_u32]];
        let indices: Vec<_> = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        for (p, n) in positions.iter().zip(smooth_normals(&positions, &indices, None)) {
            let expected = (*p - Vec3::splat(0.5)).normalize();
            assert!(n.distance(expected) < 1e-6, "{p}: {n}");
        }
    }

    #[test]
    fn split_vertices_share_their_point() {
        let positions = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ZERO, Vec3::Y, Vec3::Z];
        let indices = [[0, 1, 2], [3, 4, 5]];
        let split = smooth_normals(&positions, &indices, None);
        assert_eq!((split[0], split[3]), (Vec3::Z, Vec3::X));
        let joined = smooth_normals(&positions, &indices, Some(&[0, 1, 2, 0, 2, 5]));
        let expected = Vec3::new(1.0, 0.0, 1.0).normalize();
        assert!(joined[0].distance(expected) < 1e-6 && joined[3] == joined[0] && joined[4] == joined[2]);
    }
}
