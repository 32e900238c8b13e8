//! Keyed random streams, Owen-scrambled sequences, warps with their densities, discrete distributions.
//!
//! There is one door to randomness: a [`Sampler`] made from a key that hashes `(seed, purpose, pass, …)` and an index
//! that counts pixels' samples or photon paths. No thread or task number ever enters, so results do not depend on them.

mod discrete;
mod hash;
mod sampler;
mod sobol;
pub mod warp;

pub use discrete::{AliasTable, Cdf, Distribution2d};
pub use hash::{Key, Purpose, hash_u64, mix64};
pub use sampler::{Numbers, Sampler, Sequence, Streams};
