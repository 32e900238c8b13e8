/// What a random stream is used for; part of every key, so that two uses never share numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum Purpose {
    /// Camera paths: pixel position, lens and everything after.
    Camera = 1,
    /// Photon paths for the global map.
    Photon = 2,
    /// Photon paths for the caustic map.
    CausticPhoton = 3,
    /// Bits for the stochastic rounding of stored photons.
    Quantize = 4,
    /// Final-gather rays.
    Gather = 5,
    /// Irradiance-cache records.
    Cache = 6,
    /// Pilot passes that measure, and put nothing into the image.
    Pilot = 7,
    /// Test and benchmark rays.
    Test = 8,
    /// Markov chains.
    Chain = 9,
    /// Light sub-paths of bidirectional methods.
    LightPath = 10,
    /// Rays that find where lights cast shadows.
    Shadow = 11,
    /// Rays that find where surfaces end.
    Boundary = 12,
    /// Which connections of bidirectional methods are worth a shadow ray.
    Connection = 13,
    /// Which branches of a camera path that splits are worth following.
    Branch = 14,
    /// Rays that find where an environment is seen.
    Sky = 15,
}

/// A bijective 64-bit mixer with full avalanche (the finaliser of SplitMix64 [Steele et al. 2014]).
#[inline(always)]
pub const fn mix64(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// Hash of a word under a key.
#[inline(always)]
pub const fn hash_u64(key: u64, x: u64) -> u64 {
    hash_premixed(key, premix(x))
}

/// The half of [`hash_u64`] that depends on the word alone.
#[inline(always)]
pub(super) const fn premix(x: u64) -> u64 {
    mix64(x.wrapping_add(0x9e37_79b9_7f4a_7c15))
}

/// The other half of [`hash_u64`].
#[inline(always)]
pub(super) const fn hash_premixed(key: u64, premixed: u64) -> u64 {
    mix64(key ^ premixed)
}

/// Names one family of random numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Key(pub u64);

impl Key {
    #[inline(always)]
    pub const fn new(seed: u64, purpose: Purpose, pass: u64) -> Self {
        Self(hash_u64(hash_u64(mix64(seed ^ 0x6a09_e667_f3bc_c908), purpose as u64), pass))
    }

    /// The key of one member of the family, for example a pixel.
    #[inline(always)]
    pub const fn with(self, x: u64) -> Self {
        Self(hash_u64(self.0, x))
    }
}
