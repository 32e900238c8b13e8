//! Learns from where an environment is seen, where most of it is hidden: rooms with windows, open boxes.

use std::ops::Range;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::Scene;
use super::load::light_contrast;
use crate::light::{Cells, DIRECTIONS, SkyView, View, around, direction_index};
use crate::math::{Bounds3, Frame};
use crate::sample::{Key, Purpose, Sampler, Sequence, warp};

/// Cells along the longest edge of the box around the places that are seen, but for a hundredth at each of its faces.
const CELLS: u32 = 12;

/// How far the box reaches beyond them, in units of its longest edge.
const MARGIN: f32 = 1e-3;

/// Walks from the camera, surfaces of each at most, and directions tried at each surface.
const WALKS: u64 = 1 << 14;
const SURFACES: u32 = 3;
const TRIED: u32 = 8;

/// Walks of one task; those of the first tell whether more are worth while.
const CHUNK: u64 = 256;

/// Directions tried in a cell, for it to have a view of its own.
const LEAST: u32 = 64;

/// Where more than this part of the light arrives, samples of the environment alone do.
const OPEN: f64 = 0.4;

/// An environment with a brighter spot than so many times the mean has a finer density than the map of directions.
const EVEN: f32 = 10.0;

/// A direction tried from a surface.
struct Look {
    p: Vec3,
    direction: u32,
    /// What arrives, cosine included.
    light: f32,
    /// What would, if nothing hid the environment.
    whole: f32,
}

impl Scene {
    /// Looks where the environment is seen, if there is one and most of it is hidden. What is seen through an opening is as much
    /// brighter than what it lights as a lamp is.
    pub(super) fn look_at_sky(&mut self) {
        let Some(environment) = self.environment else { return };
        let light = std::slice::from_ref(&self.lights[environment as usize]);
        if self.nested.is_some() || light_contrast(light, &self.light_context()) > EVEN {
            return;
        }
        if !is_hidden(&self.look(0..CHUNK)) {
            return;
        }
        let chunks = (0..WALKS / CHUNK).into_par_iter();
        let looks: Vec<Look> = chunks.flat_map_iter(|i| self.look(i * CHUNK..(i + 1) * CHUNK)).collect();
        if is_hidden(&looks) {
            let cells = Cells::new(&surroundings(&looks), CELLS);
            self.sky = Some(SkyView::new(cells, views(&cells, &looks)));
            self.light_contrast = f32::INFINITY;
        }
    }

    /// Tries directions at the surfaces of such `walks`.
    fn look(&self, walks: Range<u64>) -> Vec<Look> {
        let mut looks = Vec::new();
        let (width, height) = self.camera.window().size;
        let film = Vec2::new(width as f32, height as f32);
        for walk in walks {
            let mut s = Sampler::new(Sequence::Independent, Key::new(0, Purpose::Sky, 0), walk);
            let mut ray = self.camera.generate_ray(s.next_2d() * film, s.next_2d()).ray;
            for _ in 0..SURFACES {
                let Some(si) = self.intersect(&mut ray) else { break };
                let n = if si.wo.dot(si.ng) < 0.0 { -si.ng } else { si.ng };
                let frame = Frame::from_normal(n);
                for _ in 0..TRIED {
                    let local = warp::uniform_hemisphere(s.next_2d());
                    let d = frame.to_world(local);
                    let whole = self.environment_radiance(d).mean() * local.z;
                    let hidden = self.accel.occluded(&si.spawn_ray(d));
                    looks.push(Look {
                        p: si.p,
                        direction: direction_index(d) as u32,
                        light: if hidden { 0.0 } else { whole },
                        whole,
                    });
                }
                ray = si.spawn_ray(frame.to_world(warp::cosine_hemisphere(s.next_2d())));
            }
        }
        looks
    }
}

/// True if little of the light arrives.
fn is_hidden(looks: &[Look]) -> bool {
    let sum = |part: fn(&Look) -> f32| looks.iter().map(|l| f64::from(part(l))).sum::<f64>();
    let (light, whole) = (sum(|l| l.light), sum(|l| l.whole));
    light > 0.0 && light < OPEN * whole
}

/// The box around nearly all places: what is seen far outside of a room must not make its cells coarse.
fn surroundings(looks: &[Look]) -> Bounds3 {
    let ends: [(f32, f32); 3] = std::array::from_fn(|axis| {
        let mut all: Vec<f32> = looks.iter().step_by(TRIED as usize).map(|l| l.p[axis]).collect();
        let (few, last) = (all.len() / 100, all.len() - 1);
        let mut nth = |n: usize| *all.select_nth_unstable_by(n, f32::total_cmp).1;
        (nth(few), nth(last - few))
    });
    let (min, max) = (Vec3::from(ends.map(|e| e.0)), Vec3::from(ends.map(|e| e.1)));
    // Places on a floor are a little above or below it.
    let margin = MARGIN * (max - min).max_element();
    Bounds3 { min: min - margin, max: max + margin }
}

/// The view of each cell where enough was tried.
fn views(cells: &Cells, looks: &[Look]) -> impl Iterator<Item = Option<View>> {
    let mut sums = vec![([0.0f32; DIRECTIONS], [0u32; DIRECTIONS]); cells.count()];
    for l in looks {
        let Some(cell) = cells.index(l.p) else { continue };
        let (light, tried) = &mut sums[cell];
        light[l.direction as usize] += l.light;
        tried[l.direction as usize] += 1;
    }
    sums.into_iter().map(|(light, tried)| {
        if tried.iter().sum::<u32>() < LEAST {
            return None;
        }
        // The neighbours tell as well what a direction brings that was hardly tried.
        let mean = |i: usize| {
            let own = (2.0 * light[i], 2 * tried[i]);
            let (light, tried) = around(i).fold(own, |(l, t), k| (l + light[k], t + tried[k]));
            if tried > 0 { light / tried as f32 } else { 0.0 }
        };
        View::new(&std::array::from_fn(mean))
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::geometry::Ray;
    use crate::math::DVec3;
    use crate::scene::LoadOptions;

    /// A box of side 2 around the eye, with a square window of side `2 opening` in one wall if that is not 0, and what else there is.
    fn room(opening: f32, more: &str) -> Scene {
        let wall = |place: &str, turn: &str| {
            let to_world = format!(r#"<transform name="to_world">{place}<translate z="-1"/>{turn}</transform>"#);
            format!(r#"<shape type="rectangle">{to_world}</shape>"#)
        };
        let turns = [("x", 0), ("x", 90), ("x", -90), ("y", 90), ("y", -90)];
        let mut walls: String =
            turns.map(|(axis, by)| wall("", &format!(r#"<rotate {axis}="1" angle="{by}"/>"#))).concat();
        let front = r#"<rotate x="1" angle="180"/>"#;
        if opening == 0.0 {
            walls += &wall("", front);
        } else {
            let (half, middle) = (0.5 * (1.0 - opening), 0.5 * (1.0 + opening));
            for side in [-middle, middle] {
                walls += &wall(&format!(r#"<scale x="{half}"/><translate x="{side}"/>"#), front);
                walls += &wall(&format!(r#"<scale x="{opening}" y="{half}"/><translate y="{side}"/>"#), front);
            }
        }
        let sensor = r#"<sensor type="perspective"><float name="fov" value="90"/></sensor>"#;
        let text = format!(r#"<scene version="3.0.0">{sensor}{walls}{more}</scene>"#);
        Scene::from_text(&text, Path::new("test.xml"), &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"))
    }

    const SKY: &str = r#"<emitter type="constant"/>"#;

    /// Irradiance from the sky at `p` with the normal `n`, and the variance of one light sample.
    fn irradiance(scene: &Scene, (p, n): (Vec3, Vec3)) -> (f64, f64) {
        const SAMPLES: u64 = 1 << 14;
        let (mut sum, mut squares) = (0.0, 0.0);
        for i in 0..SAMPLES {
            let mut s = Sampler::new(Sequence::Independent, Key::new(5, Purpose::Test, 0), i);
            let Some(li) = scene.lights[0].sample_li(&scene.light_context(), p, s.next_2d()) else { continue };
            if !scene.accel.occluded(&Ray::new(p, li.wi)) {
                let x = f64::from(li.radiance.g * li.wi.dot(n).max(0.0) / li.pdf_w);
                (sum, squares) = (sum + x, squares + x * x);
            }
        }
        let mean = sum / SAMPLES as f64;
        (mean, squares / SAMPLES as f64 - mean * mean)
    }

    /// In a room light samples find the window: the mean is the same within five standard errors (a right program fails once in
    /// 10⁶), the variance a fraction.
    #[test]
    fn a_window_is_found() {
        let mut scene = room(0.2, SKY);
        assert!(scene.sky.is_some() && scene.light_contrast() > 1e6);
        let at =
            |p: [f32; 3]| ((DVec3::from(p.map(f64::from)) - scene.to_scene.center) * scene.to_scene.scale).as_vec3();
        let places =
            [(at([0.3, -0.99, 0.1]), Vec3::Y), (at([0.99, 0.5, -0.4]), Vec3::NEG_X), (at([-0.4, 0.3, -0.99]), Vec3::Z)];
        let seen = places.map(|place| irradiance(&scene, place));
        scene.sky = None;
        for (place, (mean, variance)) in places.into_iter().zip(seen) {
            let (plain_mean, plain) = irradiance(&scene, place);
            let error = ((variance + plain) / (1u64 << 14) as f64).sqrt();
            assert!(mean > 0.0 && (mean - plain_mean).abs() < 5.0 * error, "{mean} {plain_mean} ± {error}");
            assert!(variance < 0.2 * plain, "{variance} {plain}");
        }
    }

    /// A plain around the house makes the cells of the room no coarser.
    #[test]
    fn what_is_far_away_is_left_out() {
        let plain = r#"<shape type="rectangle"><transform name="to_world"><scale value="40"/><rotate x="1" angle="-90"/>
            <translate y="-1.01"/></transform></shape>"#;
        let scene = room(0.2, &format!("{plain}{SKY}"));
        let looks = scene.look(0..4 * CHUNK);
        let bounds = surroundings(&looks);
        let size = (bounds.max - bounds.min) / scene.to_scene.scale as f32;
        assert!(size.cmpge(Vec3::splat(1.9)).all() && size.max_element() < 8.0, "{size}");
        let cells = Cells::new(&bounds, CELLS);
        let known = looks.iter().filter(|l| cells.index(l.p).is_some()).count();
        assert!(known as f64 > 0.93 * looks.len() as f64, "{known} of {}", looks.len());
    }

    /// Where the environment is in the open, or is nowhere, nothing is learnt.
    #[test]
    fn only_what_is_hidden_is_looked_for() {
        let ball = r#"<scene version="3.0.0"><sensor type="perspective"/><shape type="sphere"><point name="center" x="0" y="0" z="5"/></shape>"#;
        for text in [format!("{ball}{SKY}</scene>"), format!("{ball}</scene>")] {
            let scene = Scene::from_text(&text, Path::new("test.xml"), &LoadOptions::default());
            assert!(scene.unwrap_or_else(|e| panic!("{e}")).sky.is_none(), "{text}");
        }
        assert!(room(0.0, SKY).sky.is_none(), "no window");
        let lamp = r#"<emitter type="point"><point name="position" x="0" y="0.5" z="0"/></emitter>"#;
        assert!(room(0.2, lamp).sky.is_none(), "no environment");
    }

    /// What is learnt does not depend on the number of threads.
    #[test]
    fn views_are_the_same_with_any_threads() {
        let view = |scene: &Scene| format!("{:?}", scene.sky);
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread").install(|| room(0.2, SKY));
        let three = rayon::ThreadPoolBuilder::new().num_threads(3).build().expect("threads").install(|| room(0.2, SKY));
        assert!(view(&one) != "None" && view(&one) == view(&three));
    }
}
