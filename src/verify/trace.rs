//! Single rays through smooth surfaces.

use crate::bsdf::{LobeMask, Mode};
use crate::geometry::Ray;
use crate::math::{DVec3, Vec2};
use crate::scene::Scene;

/// What a ray does at a smooth surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    Reflect,
    Refract,
}

/// Follows a ray of the world through the turns; the ray behind the last, in the world. `None` when a surface is missing
/// or does not do the turn.
pub fn follow(scene: &Scene, origin: DVec3, direction: DVec3, turns: &[Turn]) -> Option<(DVec3, DVec3)> {
    let mut ray = Ray::new(scene.to_scene.point(origin), direction.normalize().as_vec3());
    let mut p = ray.o;
    for turn in turns {
        let si = scene.intersect(&mut ray)?;
        // Smooth dielectrics reflect for small random numbers and refract for large ones.
        let u = if *turn == Turn::Reflect { 0.0 } else { 1f32.next_down() };
        let s = scene.bsdf(&si).sample(si.wo, u, Vec2::splat(0.5), Mode::Radiance, LobeMask::ALL)?;
        let through = s.wi.dot(si.ng) * si.wo.dot(si.ng) < 0.0;
        if through != (*turn == Turn::Refract) {
            return None;
        }
        p = si.p;
        ray = si.spawn_ray(s.wi);
    }
    Some((scene.to_scene.to_world(p), ray.d.as_dvec3()))
}

/// The angle between two directions in radians, accurate for small ones.
pub fn angle(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}
