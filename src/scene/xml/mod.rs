//! Mitsuba's XML language as a typed property tree.
//!
//! [`Document::read`] follows includes, substitutes `$name`s, resolves references and upgrades files written for
//! Mitsuba 0.5 and 0.6. It knows the grammar, not the plugins: these are the business of [`Query`]'s callers.

mod document;
mod node;
mod parse;
mod query;
mod transform;
mod upgrade;
mod value;

pub use document::{Document, ParseOptions};
pub use node::{Child, ColorSource, Node, NodeId, Prop, Tag, Value};
pub use query::{ColorArg, ColorUse, Query};

#[cfg(test)]
mod tests;
