//! caustica: a photon-mapping renderer for the CPU.
//!
//! The rooms stand in the order in which light travels; see `ARCHITECTURE.md`.

pub mod accel;
pub mod bench;
pub mod bsdf;
pub mod camera;
pub mod cli;
pub mod color;
pub mod film;
pub mod gather;
pub mod geometry;
pub mod image;
pub mod integrator;
pub mod light;
pub mod math;
mod pages;
pub mod photon;
pub mod render;
pub mod report;
pub mod sample;
pub mod scene;
pub mod shoot;
pub mod tally;
pub mod texture;
pub mod verify;
