//! Mesh files: OBJ, PLY and Mitsuba's serialized format in, binary PLY out.
//!
//! A reader gives a [`MeshData`] in the space of the file. [`finish`] moves it into scene space and turns it into the
//! [`TriangleMesh`](crate::geometry::TriangleMesh) that everybody else sees; only there do the Mitsuba switches
//! `face_normals` and `flip_normals` act.
//!
//! OBJ goes through the `tobj` crate behind a check that numbers lines. The PLY reader is our own because the crates
//! that read PLY build one record at a time: ours maps the file and decodes it in parallel straight into the buffers
//! that shading and both ray tracers share.
//!
//! No count in a file is believed: before memory is reserved, every size is compared with what the bytes that are
//! there can hold.

mod counts;
mod data;
mod error;
mod finish;
mod mapped;
mod normals;
mod obj;
mod ply;
mod serialized;
mod write;

pub use counts::MeshCounts;
pub use data::{MeshData, Positions};
pub use error::{MeshError, MeshErrorKind, Place};
pub use finish::{FinishOptions, MeshReport, finish};
pub use obj::{count_obj, parse_obj, read_obj};
pub use ply::{count_ply, parse_ply, read_ply};
pub use serialized::{count_serialized, parse_serialized, read_serialized};
pub use write::{PlyMesh, write_ply, write_ply_to};
