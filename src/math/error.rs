use glam::Vec3;

/// Bound on the relative error of `n` successive f32 roundings, `nε/(1−nε)` with `ε = 2⁻²⁴` [Higham 2002, §3.1].
#[inline(always)]
pub const fn gamma(n: u32) -> f32 {
    let ne = n as f32 * (f32::EPSILON * 0.5);
    ne / (1.0 - ne)
}

/// Moves a ray origin off its surface, to the side that `w` points to, by more than the rounding error of `p`.
///
/// `err` bounds |error| of each coordinate of `p`; `n` is the geometric normal of either orientation
/// [Pharr, Jakob, Humphreys, "Physically Based Rendering", 4th ed., §6.8.6]. In place of rounding the sum away from the
/// surface, the offset is lengthened by what rounding may take back: at most an ulp of each coordinate along the normal.
#[inline(always)]
pub fn offset_ray_origin(p: Vec3, err: Vec3, n: Vec3, w: Vec3) -> Vec3 {
    let d = n.abs().dot(err + p.abs() * f32::EPSILON) + f32::MIN_POSITIVE;
    p + n * d.copysign(w.dot(n))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_offset_outlives_its_rounding() {
        for p in [Vec3::ZERO, Vec3::new(1e6, -3.0, 1e-6), Vec3::splat(-1e-8), Vec3::new(0.1, 7e7, -0.3)] {
            for n in [Vec3::Z, Vec3::new(0.6, -0.8, 0.0), Vec3::new(1e-4, 1e-4, 1.0).normalize()] {
                let err = p.abs() * gamma(7);
                for w in [n, -n] {
                    let o = offset_ray_origin(p, err, n, w).as_dvec3() - p.as_dvec3();
                    let along = o.dot(w.as_dvec3());
                    assert!(along > err.dot(n.abs()) as f64 && along > 0.0, "{p} {n}: {along:e}");
                }
            }
        }
    }
}
