use glam::Vec3;

/// Bound on the relative error of `n` successive f32 roundings, `nε/(1−nε)` with `ε = 2⁻²⁴` [Higham 2002, §3.1].
#[inline]
pub const fn gamma(n: u32) -> f32 {
    let ne = n as f32 * (f32::EPSILON * 0.5);
    ne / (1.0 - ne)
}

/// Moves a ray origin off its surface, to the side that `w` points to, by more than the rounding error of `p`.
///
/// `err` bounds |error| of each coordinate of `p`; `n` is the geometric normal of either orientation
/// [Pharr, Jakob, Humphreys, "Physically Based Rendering", 4th ed., §6.8.6].
#[inline]
pub fn offset_ray_origin(p: Vec3, err: Vec3, n: Vec3, w: Vec3) -> Vec3 {
    let d = n.abs().dot(err);
    let offset = if w.dot(n) < 0.0 { -d * n } else { d * n };
    let moved = p + offset;
    let away = |x: f32, o: f32| {
        if o > 0.0 {
            x.next_up()
        } else if o < 0.0 {
            x.next_down()
        } else {
            x
        }
    };
    Vec3::new(away(moved.x, offset.x), away(moved.y, offset.y), away(moved.z, offset.z))
}
