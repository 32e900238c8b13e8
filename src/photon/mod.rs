//! Photon maps: storing photons in twenty bytes and finding them again. Nothing here knows what a scene is.
//!
//! A [`PhotonRecord`] is packed into a [`Photon`]; [`PhotonMap::build`] balances photons into a left-balanced heap
//! [Jensen 2001, chapter 6]; [`PhotonMap::nearest`] and [`PhotonMap::within`] ask it; [`Kernel`] weighs what they find.
//!
//! The records live as separate streams, twenty bytes in all. The heap's bottom subtrees of up to 63 photons are kept
//! together (see `layout`), so that a query walks only the upper planes and scans the subtrees with vector instructions.

mod build;
pub mod direction;
mod file;
mod found;
mod heap;
mod kernel;
mod layout;
mod map;
mod order;
mod packed;
mod ply;
mod query;
mod simd;
mod simd_partition;
pub mod stackfree;
#[cfg(test)]
mod tests;
#[cfg(target_arch = "x86_64")]
mod x86;
#[cfg(target_arch = "x86_64")]
mod x86_partition;

pub use file::{MapFile, MapFileError, MapFileInfo};
pub use kernel::{GAUSSIAN_ALPHA, GAUSSIAN_BETA, Hull, Kernel, convex_hull};
pub use map::PhotonMap;
pub use order::{morton_code, morton_order};
pub use packed::{Flags, MAX_COORDINATE, Photon, PhotonClass, PhotonRecord, Rejected};
pub use ply::write_ply;
pub use query::{Fewer, KnnScratch, Neighbours};
pub(crate) use simd::{Level, Simd, Task};
