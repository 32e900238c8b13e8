//! From a scene file to a validated, immutable [`Scene`]: the description and its errors.
//!
//! [`xml`] turns Mitsuba's XML language into a typed tree with source positions; `load` gives the tree its meaning;
//! [`mesh_io`] reads mesh files.

mod aims;
mod error;
mod load;
pub mod mesh_io;
pub mod needs;
mod nested;
mod predict;
#[expect(clippy::module_inception)]
mod scene;
mod settings;
mod sky;
pub mod xml;

pub use aims::{PhotonAims, PhotonShare, PhotonTarget};
pub use error::{Position, SceneError};
pub use load::ToScene;
pub use needs::{Item, Need, NeedOverride, Needs};
pub use nested::NestingFaults;
pub use predict::{AccelPrediction, MeshPrediction, PicturePrediction, Prediction};
pub use scene::{LoadOptions, Scene, SceneStats};
pub use settings::{FilmSettings, IntegratorSettings, ParamValue, SamplerSettings};

#[cfg(test)]
mod tests;
