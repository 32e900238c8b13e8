//! `<transform>` blocks: each step is applied after the ones above it.

use glam::{DMat4, DVec3, DVec4};

/// The rows of a 4×4 or 3×3 matrix. A 3×3 matrix acts on (x, y, z), or on (u, v, 1) when `planar`.
pub(super) fn matrix(values: &[f64], planar: bool) -> Result<DMat4, String> {
    match *values {
        [a, b, c, d, e, f, g, h, i] if planar => {
            Ok(from_rows([[a, b, 0.0, c], [d, e, 0.0, f], [0.0, 0.0, 1.0, 0.0], [g, h, 0.0, i]]))
        }
        [a, b, c, d, e, f, g, h, i] => {
            Ok(from_rows([[a, b, c, 0.0], [d, e, f, 0.0], [g, h, i, 0.0], [0.0, 0.0, 0.0, 1.0]]))
        }
        _ => match values.as_chunks::<4>() {
            (&[r0, r1, r2, r3], []) => Ok(from_rows([r0, r1, r2, r3])),
            _ => Err(format!("a matrix has 16 or 9 numbers, not {}", values.len())),
        },
    }
}

fn from_rows(rows: [[f64; 4]; 4]) -> DMat4 {
    DMat4::from_cols_array_2d(&rows).transpose()
}

/// A rotation of `angle` degrees about `axis`, which need not be a unit vector.
pub(super) fn rotate(axis: DVec3, angle: f64) -> Result<DMat4, String> {
    let Some(axis) = axis.try_normalize() else {
        return Err("the rotation axis is zero".into());
    };
    // Right angles stay exact.
    let (sin, cos) = match angle.rem_euclid(360.0) {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        a => a.to_radians().sin_cos(),
    };
    // Rodrigues' formula, one column per rotated basis vector.
    let column = |e: DVec3| (cos * e + sin * axis.cross(e) + (1.0 - cos) * axis.dot(e) * axis).extend(0.0);
    Ok(DMat4::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z), DVec4::W))
}

/// The camera frame at `origin`: +z looks at `target`, +y is near `up`, +x is to the left.
pub(super) fn look_at(origin: DVec3, target: DVec3, up: Option<DVec3>) -> Result<DMat4, String> {
    let Some(dir) = (target - origin).try_normalize() else {
        return Err("lookat: origin and target coincide".into());
    };
    let up = up.filter(|u| *u != DVec3::ZERO).unwrap_or_else(|| dir.any_orthonormal_vector());
    let left = up.try_normalize().unwrap_or(DVec3::ZERO).cross(dir);
    if left.length_squared() < 1e-20 {
        return Err("lookat: up is parallel to the viewing direction".into());
    }
    let left = left.normalize();
    Ok(DMat4::from_cols(left.extend(0.0), dir.cross(left).extend(0.0), dir.extend(0.0), origin.extend(1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotation_of_right_angles_is_exact() {
        let m = rotate(DVec3::new(0.0, 2.0, 0.0), 90.0).expect("axis is not zero");
        assert_eq!(m.transform_vector3(DVec3::Z), DVec3::X);
        let m = rotate(DVec3::Z, 30.0).expect("axis is not zero");
        let v = m.transform_vector3(DVec3::X);
        assert!((v - DVec3::new(0.75f64.sqrt(), 0.5, 0.0)).length() < 1e-15);
        assert!(rotate(DVec3::ZERO, 30.0).is_err());
    }

    #[test]
    fn look_at_maps_z_to_the_target() {
        let (o, t) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.0, 2.0, 13.0));
        let m = look_at(o, t, Some(DVec3::Y)).expect("a valid frame");
        assert_eq!(m.transform_point3(DVec3::new(0.0, 0.0, 10.0)), t);
        assert_eq!(m.transform_vector3(DVec3::X), DVec3::X);
        assert!(look_at(o, o, None).is_err() && look_at(o, t, Some(DVec3::Z)).is_err());
        assert!(look_at(o, t, None).is_ok());
    }

    #[test]
    fn matrices_are_row_major() {
        let m = matrix(&[1., 0., 0., 5., 0., 1., 0., 6., 0., 0., 1., 7., 0., 0., 0., 1.], false).expect("16 numbers");
        assert_eq!(m.transform_point3(DVec3::ZERO), DVec3::new(5.0, 6.0, 7.0));
        let uv = matrix(&[2., 0., 5., 0., 3., 6., 0., 0., 1.], true).expect("9 numbers");
        assert_eq!(uv.transform_point3(DVec3::new(1.0, 1.0, 0.0)), DVec3::new(7.0, 9.0, 0.0));
        assert!(matrix(&[1.0; 10], false).is_err() && matrix(&[], false).is_err());
    }
}
