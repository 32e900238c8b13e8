//! Light tracing, bidirectional path tracing, vertex connection and merging [Georgiev, Křivánek, Davidovič, Slusallek
//! 2012; Hachisuka, Pantaleoni, Jensen 2012]: one recipe with techniques switched on and off.
//!
//! One iteration takes one camera sample of every pixel and one light path for each of them, or more where those are short.
//! Light paths leave vertices; each vertex is connected to the lens (light tracing), those of one path for each pixel to every
//! vertex of its camera path (connection), and each is found by camera vertices near it (merging). Camera paths also meet lights
//! and sample them. The balance heuristic weighs them all.

mod camera_path;
mod correlation;
mod efficiency;
mod emission;
mod event;
mod faint;
mod grid;
mod light_path;
mod pass;
mod pilot;
mod radius;
mod recipe;
mod step;
#[cfg(test)]
mod tests;
mod weights;

pub use efficiency::{Technique, TechniqueChoice, choose_techniques};
pub use emission::Guidance;
pub use pass::{Workspace, render_pass};
pub use radius::{automatic_radius, radius_sq_ratio};
pub use recipe::{Merging, Recipe, VcmSettings};
