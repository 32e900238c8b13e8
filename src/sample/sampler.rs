use glam::Vec2;
use rand::rand_core::{Infallible, TryRng};

use super::hash::{hash_premixed, premix};
use super::{Key, Purpose, hash_u64, sobol};

/// Which point set a [`Sampler`] draws from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sequence {
    /// Independent uniform numbers.
    Independent,
    /// Owen-scrambled Sobol' pairs; the first 2ᵏ indices of a key are stratified in every dimension pair.
    #[default]
    Sobol,
}

/// The numbers of one sample or photon path: a pure function of `(sequence, key, index, dimension)`.
#[derive(Clone, Copy, Debug)]
pub struct Sampler {
    key: u64,
    /// What the sequence makes of the index: its hash, or its bits in reverse.
    prepared: u64,
    dim: u32,
    sequence: Sequence,
}

/// What drives a path: a [`Sampler`], or numbers that remember others.
pub trait Numbers {
    /// The next number in [0, 1).
    fn next_1d(&mut self) -> f32;

    /// The next point in [0, 1)².
    fn next_2d(&mut self) -> Vec2;
}

impl Numbers for Sampler {
    #[inline(always)]
    fn next_1d(&mut self) -> f32 {
        Sampler::next_1d(self)
    }

    #[inline(always)]
    fn next_2d(&mut self) -> Vec2 {
        Sampler::next_2d(self)
    }
}

/// Hashes of the first dimensions.
const DIMENSIONS: [u64; 64] = {
    let mut table = [0; 64];
    let mut dim = 0;
    while dim < table.len() {
        table[dim] = premix(dim as u64);
        dim += 1;
    }
    table
};

#[inline(always)]
fn dimension(dim: u32) -> u64 {
    DIMENSIONS.get(dim as usize).copied().unwrap_or_else(|| premix(dim as u64))
}

/// Streams of one sequence side by side, of which each gives a point next and then a number: computed together, by loops that
/// the compiler makes vectors of, they are the bits that each stream gives.
#[derive(Clone, Copy, Debug)]
pub struct Streams<const N: usize> {
    sequence: Sequence,
    key: [u64; N],
    prepared: [u64; N],
    /// Hashes of the dimensions of the point and of the number.
    dimensions: [[u64; N]; 2],
}

impl<const N: usize> Streams<N> {
    pub fn new(sequence: Sequence) -> Self {
        Self { sequence, key: [0; N], prepared: [0; N], dimensions: [[0; N]; 2] }
    }

    /// Puts a stream of the same sequence, as it is, into lane `i`.
    #[inline(always)]
    pub fn set(&mut self, i: usize, stream: &Sampler) {
        debug_assert_eq!(self.sequence, stream.sequence);
        (self.key[i], self.prepared[i]) = (stream.key, stream.prepared);
        (self.dimensions[0][i], self.dimensions[1][i]) = (dimension(stream.dim), dimension(stream.dim.wrapping_add(1)));
    }

    /// Puts a stream that gives a number next, then `skipped` others and then a number, into lane `i`, for
    /// [`Streams::draw_numbers`].
    #[inline(always)]
    pub fn set_numbers(&mut self, i: usize, stream: &Sampler, skipped: u32) {
        self.set(i, stream);
        self.dimensions[1][i] = dimension(stream.dim.wrapping_add(1 + skipped));
    }

    /// The numbers of the first `len` lanes that [`Streams::set_numbers`] has set.
    #[inline(always)]
    pub fn draw_numbers(&self, len: usize, numbers: [&mut [f32; N]; 2]) {
        assert!(len <= N);
        for (dimensions, numbers) in self.dimensions.iter().zip(numbers) {
            for i in 0..len {
                let hash = hash_premixed(self.key[i], dimensions[i]);
                numbers[i] = to_unit(match self.sequence {
                    Sequence::Independent => hash_premixed(hash, self.prepared[i]) as u32,
                    Sequence::Sobol => sobol::sample_1d(self.prepared[i] as u32, hash),
                });
            }
        }
    }

    /// The points of the first `len` lanes, coordinate by coordinate, and the numbers behind them.
    #[inline(always)]
    pub fn draw(&self, len: usize, point: &mut [[f32; N]; 2], number: &mut [f32; N]) {
        assert!(len <= N);
        let [of_point, of_number] = &self.dimensions;
        for i in 0..len {
            let (a, b) = (hash_premixed(self.key[i], of_point[i]), hash_premixed(self.key[i], of_number[i]));
            let (x, y, z) = match self.sequence {
                Sequence::Independent => {
                    let point = hash_premixed(a, self.prepared[i]);
                    (point as u32, (point >> 32) as u32, hash_premixed(b, self.prepared[i]) as u32)
                }
                Sequence::Sobol => {
                    let reversed = self.prepared[i] as u32;
                    let (x, y) = sobol::sample_2d(reversed, a);
                    (x, y, sobol::sample_1d(reversed, b))
                }
            };
            (point[0][i], point[1][i], number[i]) = (to_unit(x), to_unit(y), to_unit(z));
        }
    }
}

impl Sampler {
    /// The stream of sample `index` of the family `key`. Indices beyond 2³² start further scrambles.
    #[inline]
    pub fn new(sequence: Sequence, key: Key, index: u64) -> Self {
        let high = index >> 32;
        let key = if high == 0 { key.0 } else { hash_u64(key.0, high) };
        let index = index as u32;
        let prepared = match sequence {
            Sequence::Independent => premix(index as u64),
            Sequence::Sobol => index.reverse_bits() as u64,
        };
        Self { key, prepared, dim: 0, sequence }
    }

    /// The stream behind its first `numbers` numbers and points.
    #[inline(always)]
    pub fn skip(self, numbers: u32) -> Self {
        Self { dim: self.dim.wrapping_add(numbers), ..self }
    }

    /// The first number and the two points behind it of the `N` streams from `first` on, coordinate by coordinate: the bits
    /// that each stream gives, by loops that the compiler makes vectors of.
    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // Columns side by side, as the compiler makes vectors of them.
    pub fn first_of_many<const N: usize>(sequence: Sequence, key: Key, first: u64, out: &mut [[f32; N]; 5]) {
        // All have the same key; where the index passes 2³², they have not.
        let at = |index: u64| Self::new(sequence, key, index);
        if first >> 32 != (first + N as u64) >> 32 {
            for i in 0..N {
                let mut stream = at(first + i as u64);
                let (u, a, b) = (stream.next_1d(), stream.next_2d(), stream.next_2d());
                [out[0][i], out[1][i], out[2][i], out[3][i], out[4][i]] = [u, a.x, a.y, b.x, b.y];
            }
            return;
        }
        let mut any = at(first);
        let hashes = [any.next_hash(), any.next_hash(), any.next_hash()];
        match sequence {
            Sequence::Independent => {
                for i in 0..N {
                    let prepared = premix((first as u32 as u64) + i as u64);
                    let (u, a) = (hash_premixed(hashes[0], prepared), hash_premixed(hashes[1], prepared));
                    let b = hash_premixed(hashes[2], prepared);
                    out[0][i] = to_unit(u as u32);
                    (out[1][i], out[2][i]) = (to_unit(a as u32), to_unit((a >> 32) as u32));
                    (out[3][i], out[4][i]) = (to_unit(b as u32), to_unit((b >> 32) as u32));
                }
            }
            Sequence::Sobol => {
                for i in 0..N {
                    let reversed = (first as u32 + i as u32).reverse_bits();
                    out[0][i] = to_unit(sobol::sample_1d(reversed, hashes[0]));
                    let (a, b) = (sobol::sample_2d(reversed, hashes[1]), sobol::sample_2d(reversed, hashes[2]));
                    (out[1][i], out[2][i]) = (to_unit(a.0), to_unit(a.1));
                    (out[3][i], out[4][i]) = (to_unit(b.0), to_unit(b.1));
                }
            }
        }
    }

    /// The next number in [0, 1). Inlined, so that numbers that a branch does not use are not computed.
    #[inline(always)]
    pub fn next_1d(&mut self) -> f32 {
        to_unit(self.next_word())
    }

    /// The next point in [0, 1)².
    #[inline(always)]
    pub fn next_2d(&mut self) -> Vec2 {
        let hash = self.next_hash();
        let (x, y) = match self.sequence {
            Sequence::Independent => {
                let h = hash_premixed(hash, self.prepared);
                (h as u32, (h >> 32) as u32)
            }
            Sequence::Sobol => sobol::sample_2d(self.prepared as u32, hash),
        };
        Vec2::new(to_unit(x), to_unit(y))
    }

    /// The streams of `count` samples that are to be averaged at this point of the path, stratified among each other.
    ///
    /// Where the path itself is one of a stratified set, so are all the samples of the set together.
    #[inline]
    pub fn split(&mut self, count: u32) -> impl Iterator<Item = Self> + use<> {
        let hash = self.next_hash();
        let (key, first) = match self.sequence {
            Sequence::Independent => (hash_premixed(hash, self.prepared), 0),
            Sequence::Sobol => (hash, (self.prepared as u32).reverse_bits() as u64 * count as u64),
        };
        // A lone sample stays what the sequence makes it.
        let sequence = if count > 1 { Sequence::Sobol } else { self.sequence };
        (0..count as u64).map(move |i| Self::new(sequence, Key(key), first + i))
    }

    /// As [`Sampler::split`] for numbers that are used besides, for `purpose`: the stream itself stays where it is.
    #[inline]
    pub fn aside(&self, purpose: Purpose, count: u32) -> impl Iterator<Item = Self> + use<> {
        Self { key: hash_u64(self.key, !(purpose as u64)), ..*self }.split(count)
    }

    /// Random bits for `purpose` besides, always the same ones; the stream itself stays where it is.
    #[inline]
    pub fn bits_aside(&self, purpose: Purpose) -> u64 {
        hash_u64(hash_u64(self.key, !(purpose as u64)), self.prepared)
    }

    #[inline(always)]
    fn next_hash(&mut self) -> u64 {
        let hash = hash_premixed(self.key, dimension(self.dim));
        self.dim = self.dim.wrapping_add(1);
        hash
    }

    #[inline(always)]
    fn next_word(&mut self) -> u32 {
        let hash = self.next_hash();
        match self.sequence {
            Sequence::Independent => hash_premixed(hash, self.prepared) as u32,
            Sequence::Sobol => sobol::sample_1d(self.prepared as u32, hash),
        }
    }
}

/// The top 24 bits as a float in [0, 1); 1 is never reached.
#[inline(always)]
fn to_unit(x: u32) -> f32 {
    (x >> 8) as f32 * (1.0 / 16_777_216.0)
}

impl TryRng for Sampler {
    type Error = Infallible;

    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        Ok(self.next_word())
    }

    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        Ok((self.next_word() as u64) << 32 | self.next_word() as u64)
    }

    fn try_fill_bytes(&mut self, dst: &mut [u8]) -> Result<(), Infallible> {
        for chunk in dst.chunks_mut(4) {
            chunk.copy_from_slice(&self.next_word().to_le_bytes()[..chunk.len()]);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;

    #[test]
    fn streams_are_uniform_and_below_one() {
        for sequence in [Sequence::Independent, Sequence::Sobol] {
            let (mut sum, n) = (0.0f64, 1 << 16);
            for i in 0..n {
                let mut s = Sampler::new(sequence, Key::new(1, Purpose::Test, 0), i);
                s.next_2d();
                let x = s.next_1d();
                assert!((0.0..1.0).contains(&x));
                sum += x as f64;
            }
            // Standard error of the mean is 1/sqrt(12 n) = 0.0011; 4 of them.
            assert!((sum / n as f64 - 0.5).abs() < 0.0045, "{sequence:?}: {}", sum / n as f64);
        }
    }

    #[test]
    fn many_streams_go_on_as_each_does_alone() {
        for sequence in [Sequence::Independent, Sequence::Sobol] {
            let mut streams = Streams::<24>::new(sequence);
            // At different places, also behind the dimensions that have been hashed before.
            let at = |i: usize| Sampler::new(sequence, Key::new(4, Purpose::Test, i as u64 % 3), 1000 + i as u64);
            let lanes: Vec<Sampler> = (0..24).map(|i| at(i).skip(i as u32 * 5)).collect();
            lanes.iter().enumerate().for_each(|(i, stream)| streams.set(i, stream));
            let (mut point, mut number) = ([[0.0; 24]; 2], [0.0; 24]);
            streams.draw(24, &mut point, &mut number);
            for (i, mut stream) in lanes.into_iter().enumerate() {
                assert_eq!(Vec2::new(point[0][i], point[1][i]), stream.next_2d());
                assert_eq!(number[i], stream.next_1d());
            }
            let streams_of = |i: usize| at(i).skip(i as u32 * 7);
            (0..24).for_each(|i| streams.set_numbers(i, &streams_of(i), 1));
            let [mut first, mut second] = [[0.0; 24]; 2];
            streams.draw_numbers(24, [&mut first, &mut second]);
            for i in 0..24 {
                let mut stream = streams_of(i);
                let (a, _, b) = (stream.next_1d(), stream.next_2d(), stream.next_1d());
                assert_eq!([first[i], second[i]], [a, b]);
            }
        }
    }

    #[test]
    fn many_streams_begin_as_each_does_alone() {
        for sequence in [Sequence::Independent, Sequence::Sobol] {
            for first in [0, 77, (1 << 32) - 5, (1 << 32) - 32, (1 << 32) + 9] {
                let key = Key::new(2, Purpose::Test, 0);
                let mut many = [[0.0; 32]; 5];
                Sampler::first_of_many(sequence, key, first, &mut many);
                for i in 0..32 {
                    let mut alone = Sampler::new(sequence, key, first + i as u64);
                    let behind = alone.skip(3);
                    let (u, a, b) = (alone.next_1d(), alone.next_2d(), alone.next_2d());
                    assert_eq!(many.map(|column| column[i]), [u, a.x, a.y, b.x, b.y], "{sequence:?} {first} {i}");
                    assert_eq!(alone.next_1d(), { behind }.next_1d());
                }
            }
        }
    }

    #[test]
    fn indices_beyond_32_bits_differ() {
        let key = Key::new(1, Purpose::Photon, 0);
        let mut a = Sampler::new(Sequence::Sobol, key, 7);
        let mut b = Sampler::new(Sequence::Sobol, key, 7 + (1 << 32));
        assert_ne!(a.next_2d(), b.next_2d());
    }

    #[test]
    fn splits_are_stratified() {
        // 16 samples of one path, or four of each of four Sobol' paths: one in each of 16 strata, in every dimension.
        for (sequence, paths, count) in [(Sequence::Independent, 1, 16), (Sequence::Sobol, 4, 4)] {
            let mut strata = [[0u32; 16]; 3];
            for path in 0..paths {
                let mut s = Sampler::new(sequence, Key::new(5, Purpose::Test, 0), path);
                s.next_2d();
                for mut part in s.split(count) {
                    let (x, p) = (part.next_1d(), part.next_2d());
                    strata[0][(x * 16.0) as usize] += 1;
                    strata[1][(p.x * 16.0) as usize] += 1;
                    strata[2][(p.y * 4.0) as usize * 4 + (p.x * 4.0) as usize] += 1;
                }
            }
            assert_eq!(strata, [[1; 16]; 3], "{sequence:?}");
        }
    }

    #[test]
    fn implements_the_rand_traits() {
        let mut s = Sampler::new(Sequence::Independent, Key::new(3, Purpose::Test, 0), 0);
        let x: f64 = s.random();
        assert!((0.0..1.0).contains(&x));
    }
}
