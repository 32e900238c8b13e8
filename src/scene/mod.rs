//! From a scene file to a validated, immutable [`Scene`](crate::scene): the description and its errors.
//!
//! [`xml`] turns Mitsuba's XML language into a typed tree with source positions.

mod error;
pub mod xml;

pub use error::{Position, SceneError};
