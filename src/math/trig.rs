//! Sine, cosine and arc tangent by polynomials: inline, so that loops over them become vectors, and with the same bits on
//! every machine.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// Added to a number and taken away, it rounds: the nearest whole number is then in the low bits of the sum.
const ROUND: f32 = 12_582_912.0;

/// The whole number below `x` and the same as a float, |x| < 2²²; any numbers for others.
#[inline(always)]
pub fn floor(x: f32) -> (i32, f32) {
    let sum = x + ROUND;
    let (whole, near) = (sum.to_bits().wrapping_sub(ROUND.to_bits()) as i32, sum - ROUND);
    let above = near > x;
    (whole.wrapping_sub(above as i32), if above { near - 1.0 } else { near })
}

/// Sine and cosine of `t` turns, |t| < 2²⁰, within 1.5·10⁻⁷: Taylor series about the nearest quarter turn.
#[inline(always)]
pub fn sin_cos_turns(t: f32) -> (f32, f32) {
    // The reduction is exact.
    let sum = 4.0 * t + ROUND;
    let quarters = sum.to_bits();
    let x = (t - 0.25 * (sum - ROUND)) * (2.0 * PI);
    let s = x * x;
    let sin = x + x * s * (-1.0 / 6.0 + s * (1.0 / 120.0 + s * (-1.0 / 5040.0 + s * (1.0 / 362_880.0))));
    let cos = 1.0 + s * (-0.5 + s * (1.0 / 24.0 + s * (-1.0 / 720.0 + s * (1.0 / 40_320.0))));
    let (sin, cos) = if quarters & 1 == 0 { (sin, cos) } else { (cos, sin) };
    let turned = |v: f32, negative: bool| if negative { -v } else { v };
    (turned(sin, quarters & 2 != 0), turned(cos, (quarters.wrapping_add(1)) & 2 != 0))
}

/// The angle of the point `(x, y)` around the origin in −π..π, within 3·10⁻⁷, or 3·10⁻⁷ of itself below 1; 0 at
/// the origin.
#[inline(always)]
pub fn atan2(y: f32, x: f32) -> f32 {
    // tan(π/8): beyond it, turn back by π/4.
    const EIGHTH: f32 = 0.414_213_57;
    let (long, short) = (x.abs().max(y.abs()), x.abs().min(y.abs()));
    let far = short > EIGHTH * long;
    let (above, below) = if far { (short - long, short + long) } else { (short, long) };
    let t = above / below.max(f32::MIN_POSITIVE);
    let s = t * t;
    // The series of Cephes' atanf [Moshier 1989].
    let series = -0.333_329_5 + s * (0.199_777_11 + s * (-0.138_776_85 + s * 0.080_537_446));
    let arc = t + t * s * series;
    let arc = if far { FRAC_PI_4 + arc } else { arc };
    let arc = if y.abs() > x.abs() { FRAC_PI_2 - arc } else { arc };
    let arc = if x < 0.0 { PI - arc } else { arc };
    arc.copysign(y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_and_cosines_are_good_to_rounding() {
        for i in 0..200_000 {
            let t = i as f32 * 1e-5;
            let (sin, cos) = sin_cos_turns(t);
            let (s, c) = (t as f64 * std::f64::consts::TAU).sin_cos();
            assert!((sin as f64 - s).abs() < 1.5e-7 && (cos as f64 - c).abs() < 1.5e-7, "{t}: {sin} {s}, {cos} {c}");
        }
        assert_eq!(sin_cos_turns(0.0), (0.0, 1.0));
        assert_eq!(sin_cos_turns(0.5), (0.0, -1.0));
    }

    #[test]
    fn floors_are_those_of_the_library() {
        for x in [0.0, -0.0, 0.5, 1.0, 1.5, 2.5, -0.5, -1.0, -1e-9, 1e-9, 4_194_303.5, -4_194_303.5, 0.499_999_97] {
            let (whole, float) = floor(x);
            assert_eq!((whole, float), (x.floor() as i32, x.floor()), "{x}");
        }
    }

    #[test]
    fn angles_are_good_to_rounding_all_around() {
        for i in 0..100_000 {
            let angle = (i as f64 / 50_000.0 - 1.0) * std::f64::consts::PI;
            for scale in [1e-30, 1.0, 3e20] {
                let (y, x) = ((angle.sin() * scale) as f32, (angle.cos() * scale) as f32);
                let (got, want) = (atan2(y, x) as f64, (y as f64).atan2(x as f64));
                let bound = 3e-7 * want.abs().min(1.0);
                assert!((got - want).abs() <= bound, "{y} {x}: {got} {want}");
            }
        }
        assert_eq!((atan2(0.0, 0.0), atan2(0.0, 1.0), atan2(0.0, -1.0)), (0.0, 0.0, PI));
        assert_eq!((atan2(1.0, 0.0), atan2(-1.0, 0.0)), (FRAC_PI_2, -FRAC_PI_2));
    }
}
