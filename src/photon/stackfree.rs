//! A traversal without a stack, kept as a reference to check the fast one against.
//!
//! Two integers, the present and the previous slot, tell where the walk is [Wald 2022, "A Stack-Free Traversal Algorithm
//! for Left-Balanced k-d Trees"]. It uses only the heap arithmetic, the positions and the axis flags.

use super::map::PhotonMap;
use crate::math::Vec3;

/// Calls `visit(index, d_sq)` for photons whose squared distance from `p` is at most `r_sq`; what it returns is the squared
/// radius to go on with.
pub fn visit(map: &PhotonMap, p: Vec3, mut r_sq: f32, mut visit: impl FnMut(u32, f32) -> f32) {
    let (mut current, mut previous) = (1, 0);
    while current != 0 {
        let parent = current / 2;
        // A missing child: go back up.
        if current > map.len() {
            (previous, current) = (current, parent);
            continue;
        }
        // On the way down, take the photon of this node.
        let index = map.index_of_slot(current);
        let position = map.position(index);
        let from_parent = previous < current;
        if from_parent {
            let d = position - p;
            let d_sq = d.x * d.x + d.y * d.y + d.z * d.z;
            if d_sq <= r_sq {
                r_sq = visit(index, d_sq);
            }
        }
        // Then the near child, then the far one if the plane is within the radius, then up.
        let axis = map.flags(index).axis();
        let d = p[axis] - position[axis];
        let near = 2 * current + usize::from(d > 0.0);
        let next = if from_parent {
            near
        } else if previous == near && d * d <= r_sq {
            near ^ 1
        } else {
            parent
        };
        (previous, current) = (current, next);
    }
}

/// The `k` photons nearest to `p` within the squared radius, as sorted pairs of squared distance and index.
pub fn nearest(map: &PhotonMap, p: Vec3, k: usize, max_r_sq: f32) -> Vec<(f32, u32)> {
    let mut found: Vec<(f32, u32)> = Vec::new();
    if k == 0 || map.is_empty() {
        return found;
    }
    visit(map, p, max_r_sq, |index, d_sq| {
        let place = found.partition_point(|&(d, i)| (d, i) < (d_sq, index));
        found.insert(place, (d_sq, index));
        found.truncate(k);
        if found.len() == k { found[k - 1].0 } else { max_r_sq }
    });
    found
}
