//! Bindings to the installed Embree, with a thin safe wrapper.
//!
//! Embree 4 and Embree 3 stand behind the same types. The build script looks for either and sets `cfg(embree)`;
//! without it this crate holds nothing but [`HEADER_VERSION`], which is then `None`.
//!
//! A [`Device`] makes [`Scene`]s; geometry goes in; [`Scene::commit`] builds the tree and gives a [`CommittedScene`],
//! which is immutable and can be asked by many threads at once. Buffers are shared, not copied: a scene keeps
//! their owners alive.
//!
//! Unless told otherwise a scene is built at MEDIUM quality, since HIGH is not deterministic, and with the ROBUST flag.

/// Version of the headers that the bindings were made from; `None` when the crate was built without Embree.
pub const HEADER_VERSION: Option<&str> = option_env!("EMBREE_HEADER_VERSION");

#[cfg(embree)]
mod committed;
#[cfg(embree)]
mod device;
#[cfg(embree)]
mod error;
#[cfg(embree)]
mod packet;
#[cfg(embree)]
pub mod raw;
#[cfg(embree)]
mod ray;
#[cfg(embree)]
mod scene;
#[cfg(embree)]
mod user;

#[cfg(embree)]
pub use committed::CommittedScene;
#[cfg(embree)]
pub use device::Device;
#[cfg(embree)]
pub use error::{Error, ErrorKind};
#[cfg(embree)]
pub use packet::Packet16;
#[cfg(embree)]
pub use raw::Coherence;
#[cfg(embree)]
pub use ray::{Hit, NO_INSTANCE, Ray};
#[cfg(embree)]
pub use scene::{Quality, Scene, TriangleBuffers};
#[cfg(embree)]
pub use user::{UserGeometry, UserHit};
