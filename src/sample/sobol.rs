//! Owen-scrambled (0,2)-sequence in base 2, padded: each pair of dimensions is scrambled and shuffled on its own
//! [Burley 2020, "Practical Hash-based Owen Scrambling"].

/// Nested uniform scramble of bit-reversed words [Laine and Karras 2011, with the constants of Vegdahl 2021].
#[inline(always)]
fn laine_karras(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^= x.wrapping_mul(0x53a2_2864);
    x
}

/// The second Sobol' dimension of an index, bit-reversed, as the Pascal matrix modulo 2 applied by halves.
#[inline(always)]
fn reversed_dim1(index: u32) -> u32 {
    let mut v = index;
    v ^= v >> 16;
    v ^= (v & 0xff00_ff00) >> 8;
    v ^= (v & 0xf0f0_f0f0) >> 4;
    v ^= (v & 0xcccc_cccc) >> 2;
    v ^= (v & 0xaaaa_aaaa) >> 1;
    v
}

/// Index shuffled within its power-of-two blocks, from its bits in reverse.
#[inline(always)]
fn shuffle(reversed: u32, seed: u32) -> u32 {
    laine_karras(reversed, seed).reverse_bits()
}

/// One scrambled van der Corput value of the index whose bits in reverse are given.
#[inline(always)]
pub(super) fn sample_1d(reversed: u32, hash: u64) -> u32 {
    let i = shuffle(reversed, hash as u32);
    laine_karras(i, (hash >> 32) as u32).reverse_bits()
}

/// One scrambled point of the (0,2)-sequence, as [`sample_1d`].
#[inline(always)]
pub(super) fn sample_2d(reversed: u32, hash: u64) -> (u32, u32) {
    let i = shuffle(reversed, hash as u32);
    let x = laine_karras(i, (hash >> 32) as u32).reverse_bits();
    let second = super::mix64(hash) as u32;
    let y = laine_karras(reversed_dim1(i), second).reverse_bits();
    (x, y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn second_dimension_equals_direction_numbers() {
        for index in (0..4096u32).chain([u32::MAX, 0x8000_0001, 0x1234_5678]) {
            let (mut v, mut r, mut i) = (1u32 << 31, 0u32, index);
            while i != 0 {
                if i & 1 != 0 {
                    r ^= v;
                }
                v ^= v >> 1;
                i >>= 1;
            }
            assert_eq!(reversed_dim1(index).reverse_bits(), r, "index {index:#x}");
        }
    }

    #[test]
    fn every_power_of_two_prefix_is_a_net() {
        for hash in [0u64, 0x0123_4567_89ab_cdef, u64::MAX] {
            for log_n in 0..9u32 {
                // Every elementary interval of area 1/n holds exactly one of the first n points.
                for a in 0..=log_n {
                    let mut seen = vec![false; 1 << log_n];
                    for i in 0..1u32 << log_n {
                        let (x, y) = sample_2d(i.reverse_bits(), hash);
                        let cx = (x as u64 >> (32 - a)) as usize;
                        let cy = (y as u64 >> (32 - (log_n - a))) as usize;
                        let cell = (cx << (log_n - a)) | cy;
                        assert!(!seen[cell], "hash {hash:#x}, 2^{log_n} points, a = {a}");
                        seen[cell] = true;
                    }
                }
            }
        }
    }
}
