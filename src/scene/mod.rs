//! From a scene file to a validated, immutable [`Scene`](crate::scene): the description and its errors.
//!
//! [`xml`] turns Mitsuba's XML language into a typed tree with source positions; [`mesh_io`] reads mesh files.

mod error;
pub mod mesh_io;
pub mod xml;

pub use error::{Position, SceneError};
