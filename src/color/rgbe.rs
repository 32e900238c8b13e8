//! Four-byte colour: three mantissas and one shared exponent [Ward 1991, "Real Pixels"], rounded without bias.
//!
//! Plain truncation loses up to all of a weak channel and plain rounding still loses a channel 500 times weaker than the
//! strongest one. Here every mantissa is rounded up with the probability of its fraction, so that the mean of many packed
//! colours is their true mean; the caller supplies the random bits. An exact zero stays zero.

use super::Rgb;

/// Largest channel that can be packed, 255 · 2^119.
pub const RGBE_MAX: f32 = 255.0 * (1u128 << 119) as f32;
/// Colours whose every channel is below this are stored as black.
pub const RGBE_MIN: f32 = 1e-38;

/// `SCALE[e] = 2^(e − 136)`, the value of one mantissa step; 0 for the exponent byte 0, which means black.
const SCALE: [f32; 256] = {
    let mut table = [0.0; 256];
    let mut e = 1;
    while e < 256 {
        // Below 2^-126 the number is subnormal: one set bit at weight 2^-149.
        let bits = if e >= 10 { ((e - 9) as u32) << 23 } else { 1u32 << (e + 13) };
        table[e] = f32::from_bits(bits);
        e += 1;
    }
    table
};

/// Packs a colour as `[r, g, b, exponent]` with stochastic rounding; `hash` supplies 63 random bits, 21 a channel.
///
/// `None` when a channel is negative, not finite, or above [`RGBE_MAX`].
pub fn pack(c: Rgb, hash: u64) -> Option<[u8; 4]> {
    pack_word(c, hash).map(u32::to_le_bytes)
}

/// [`pack`] as a little-endian word, without calls and with few branches, for loops over many colours.
#[inline(always)]
pub fn pack_word(c: Rgb, hash: u64) -> Option<u32> {
    // Written so that a NaN fails the test.
    let fits = |v: f32| (0.0..=RGBE_MAX).contains(&v);
    if !(fits(c.r) & fits(c.g) & fits(c.b)) {
        return None;
    }
    // The exponent of frexp: max = m · 2^e with m in [1/2, 1).
    let max = c.max_channel();
    let e = (max.to_bits() >> 23) as i32 - 126;
    // A channel's mantissa is ⌊v · 2^(8−e) + u⌋, u being 21 of the hash's bits: in units of 2⁻²¹ both are whole, but for
    // digits of v that the sum cannot carry. The factor may be beyond f32, its root is not.
    let half = (29 - e) >> 1;
    let power_of_two = |k: i32| f32::from_bits(((127 + k) as u32) << 23);
    let (low, high) = (power_of_two(half), power_of_two(29 - e - half));
    let fixed = |v: f32| (v * low * high) as i32;
    let (r, g, b) = (fixed(c.r), fixed(c.g), fixed(c.b));
    let chance = |k: u32| (hash >> (21 * k)) as i32 & 0x1f_ffff;
    let (ur, ug, ub) = (chance(0), chance(1), chance(2));
    // A mantissa that became 256 does not fit: take the next exponent and round again with the same bits, which
    // keeps the mean (the channel that overflowed always lands on 128).
    let over = ((r + ur) | (g + ug) | (b + ub)) >= 256 << 21;
    let mantissa = |v: i32, u: i32| ((if over { v >> 1 } else { v } + u) >> 21) as u32;
    let exponent = (e + 128 + over as i32) as u32;
    let word = mantissa(r, ur) | mantissa(g, ug) << 8 | mantissa(b, ub) << 16 | exponent << 24;
    Some(if max < RGBE_MIN { 0 } else { word })
}

/// The colour that [`pack`] stored.
#[inline]
pub fn unpack(p: [u8; 4]) -> Rgb {
    let s = SCALE[p[3] as usize];
    Rgb::new(f32::from(p[0]) * s, f32::from(p[1]) * s, f32::from(p[2]) * s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::mix64;

    /// The i-th of n strata of every channel's rounding variable, so that means converge like 1/n.
    fn stratified(i: u64) -> u64 {
        let u =
            |shift: u32| (i.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(mix64(u64::from(shift))) >> 43) << shift;
        u(0) | u(21) | u(42)
    }

    #[test]
    fn mean_is_kept_down_to_a_thousandth() {
        // Per channel within 1e-4 of the truth: the strata bring the sampling error of the 0.001 channel (216 % rms
        // for independent bits) below the bound with few samples.
        for ratio in [1.0f32, 0.1, 0.01, 0.001] {
            let n = 1u64 << 20;
            let (mut sum, mut truth) = ([0f64; 3], [0f64; 3]);
            for i in 0..n {
                let scale = 2f32.powf((i % 16) as f32 * 2.53 - 20.0);
                let c = Rgb::new(scale, scale * ratio, scale * ratio * 0.7);
                let d = unpack(pack(c, stratified(i / 16)).expect("in range"));
                for k in 0..3 {
                    sum[k] += f64::from(d[k]) / f64::from(scale);
                    truth[k] += f64::from(c[k]) / f64::from(scale);
                }
            }
            for k in 0..3 {
                let bias = sum[k] / truth[k] - 1.0;
                assert!(bias.abs() < 1e-4, "ratio {ratio}, channel {k}: bias {bias:e}");
            }
        }
    }

    #[test]
    fn hashed_bits_keep_the_mean_power() {
        // A million hashed photons, ratio 1:0.001: the summed power is within 1e-4 (σ of the mean is 3e-6),
        // and the weak channel within 5 σ of its own mean, σ = 2.16 / √n.
        let n = 1_000_000u64;
        let (mut sum, mut weak, mut truth) = (0f64, 0f64, 0f64);
        for i in 0..n {
            let v = 1.0 + (mix64(i) >> 40) as f32 / (1u64 << 24) as f32;
            let d = unpack(pack(Rgb::new(v, 0.001 * v, 0.0), mix64(i ^ 0x1234_5678)).expect("in range"));
            sum += f64::from(d.r) + f64::from(d.g);
            weak += f64::from(d.g);
            truth += f64::from(v);
        }
        assert!((sum / (1.001 * truth) - 1.0).abs() < 1e-4);
        assert!((weak / (0.001 * truth) - 1.0).abs() < 5.0 * 2.16 / (n as f64).sqrt());
    }

    #[test]
    fn relative_error_of_the_strongest_channel() {
        // Table of stochastic rounding over 2^±20: 0.24 % rms for the maximum channel, mean zero.
        let n = 400_000;
        let (mut mean, mut square) = (0f64, 0f64);
        for i in 0..n {
            let v = 2f32.powf((mix64(i) >> 40) as f32 / (1u64 << 24) as f32 * 40.0 - 20.0);
            let d = unpack(pack(Rgb::splat(v), mix64(i + (1 << 40))).expect("in range")).r;
            let e = f64::from(d) / f64::from(v) - 1.0;
            mean += e / n as f64;
            square += e * e / n as f64;
        }
        assert!(mean.abs() < 5.0 * 0.0024 / (n as f64).sqrt(), "{mean:e}");
        assert!((square.sqrt() - 0.0024).abs() < 0.0001, "{}", square.sqrt());
    }

    #[test]
    fn zero_stays_zero_and_bad_values_are_refused() {
        for i in 0..1000 {
            let d = unpack(pack(Rgb::new(3.7, 0.0, 1e-30), mix64(i)).expect("in range"));
            assert_eq!(d.g, 0.0);
            assert_eq!(unpack(pack(Rgb::BLACK, mix64(i)).expect("black")), Rgb::BLACK);
        }
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, -1e-30, f32::MAX] {
            assert_eq!(pack(Rgb::new(1.0, bad, 0.0), 0), None, "{bad}");
        }
        assert_eq!(pack(Rgb::splat(9e-39), !0), Some([0; 4]));
    }

    #[test]
    fn the_ends_of_the_range_survive() {
        for v in [RGBE_MAX, 1e38, 1.0, 0.998, 255.0 / 256.0, 1e-12, 2e-38] {
            for h in [0, !0, 0x0f0f_0f0f_0f0f_0f0f] {
                let d = unpack(pack(Rgb::splat(v), h).expect("in range")).r;
                assert!((d / v - 1.0).abs() <= 1.0 / 127.0, "{v:e} became {d:e}");
            }
        }
        // The bump: 255.9/256 with all bits set rounds to 256, which is the mantissa 128 of the next exponent.
        assert_eq!(pack(Rgb::splat(255.9 / 256.0), !0), Some([128, 128, 128, 129]));
    }
}
