//! What a ray meets first, for certain: every triangle is tried in f64 with bounds on the rounding.

use caustica::geometry::{Ray, TriangleMesh};
use caustica::math::DVec3;

/// A triangle beside a ray.
enum Side {
    Inside,
    Outside,
    /// The ray passes within the rounding error of f64 of an edge, or almost in the plane.
    Unclear,
}

/// The sign of `d · (p × q)`, positive or negative for certain, else zero.
fn turn(d: DVec3, p: DVec3, q: DVec3) -> i32 {
    let value = d.dot(p.cross(q));
    // Differences of coordinates are good to ε, products of three of them to 5 ε, and nine are added.
    let error = 16.0 * f64::EPSILON * d.length() * p.length() * q.length();
    if value > error {
        1
    } else if value < -error {
        -1
    } else {
        0
    }
}

fn side(d: DVec3, [a, b, c]: [DVec3; 3]) -> Side {
    let turns = [turn(d, b, c), turn(d, c, a), turn(d, a, b)];
    if turns.contains(&1) && turns.contains(&-1) {
        Side::Outside
    } else if turns.contains(&0) {
        Side::Unclear
    } else {
        Side::Inside
    }
}

/// Distance and index of the nearest triangle, `None` for no hit; an error where f64 cannot tell, or where the ray starts or
/// ends on a triangle.
///
/// A triangle at an unclear place does no harm beyond a nearer hit that is clear.
pub fn first_hit(mesh: &TriangleMesh, ray: &Ray) -> Result<Option<(f64, u32)>, &'static str> {
    let (o, d) = (ray.o.as_dvec3(), ray.d.as_dvec3());
    let mut nearest: Option<(f64, u32)> = None;
    let mut unclear = f64::INFINITY;
    for prim in 0..mesh.indices.len() as u32 {
        let [a, b, c] = mesh.triangle(prim).map(|p| p.as_dvec3() - o);
        let side = side(d, [a, b, c]);
        if let Side::Outside = side {
            continue;
        }
        let n = (b - a).cross(c - a);
        let t = a.dot(n) / d.dot(n);
        let margin = 1e-9 * t.abs() + 1e-12 * a.length() / d.length();
        match side {
            _ if t + margin < 0.0 || t - margin > f64::from(ray.tmax) => {}
            _ if t - margin < 0.0 || t + margin > f64::from(ray.tmax) || t.is_nan() => {
                return Err("at an end of the ray");
            }
            Side::Inside if nearest.is_none_or(|(best, _)| t < best) => nearest = Some((t, prim)),
            Side::Unclear => unclear = unclear.min(t - margin),
            _ => {}
        }
    }
    if unclear < nearest.map_or(f64::INFINITY, |(t, _)| t) {
        return Err("on an edge");
    }
    Ok(nearest)
}
