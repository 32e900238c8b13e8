//! Statistical and physical tests of every material.
//!
//! `chi_square`: the histogram of [`Bsdf::sample`](super::Bsdf::sample) against the integral of
//! [`Bsdf::pdf`](super::Bsdf::pdf) over the bins. `physics`: weights, energy, adjointness, finiteness, known values.

mod cases;
mod chi_square;
mod golden;
mod histogram;
mod physics;

use glam::{Vec2, Vec3};

use super::*;
use crate::geometry::{GeometrySet, NO_INSTANCE, SurfaceInteraction};
use crate::math::Frame;
use crate::sample::{Key, Purpose, Sampler, Sequence};
use crate::texture::Textures;

/// A point with an oblique frame, looked at from `wo` given in that frame; `bend` tilts the shading normal from the
/// geometric one by so many radians.
fn point(wo_local: Vec3, bend: f32) -> (SurfaceInteraction, Frame) {
    let ng = Vec3::new(0.3, -0.5, 0.8).normalize();
    let tangent = Vec3::new(0.9, 0.1, -0.3);
    let g = Frame::from_normal_tangent(ng, tangent);
    let ns = (ng * bend.cos() + g.to_world(Vec3::new(0.6, 0.8, 0.0)) * bend.sin()).normalize();
    let frame = Frame::from_normal_tangent(ns, tangent);
    let si = SurfaceInteraction {
        p: Vec3::ZERO,
        p_err: Vec3::ZERO,
        ng,
        ns,
        uv: Vec2::new(0.3, 0.7),
        dpdu: tangent,
        dpdv: frame.t,
        wo: frame.to_world(wo_local).normalize(),
        t: 1.0,
        shape: 0,
        prim: 0,
        instance: NO_INSTANCE,
        barycentric: Vec2::ZERO,
        near: Default::default(),
        far: Default::default(),
    };
    (si, frame)
}

/// The last material at a point.
fn bsdf_at(materials: &[Material], si: &SurfaceInteraction) -> Bsdf {
    check(materials).expect("test materials are valid");
    let id = MaterialId(materials.len() as u32 - 1);
    evaluate(materials, &Textures::default(), id, si, &GeometrySet::default(), None)
}

/// A direction at `degrees` from the pole.
fn at_angle(degrees: f32, azimuth: f32) -> Vec3 {
    let t = degrees.to_radians();
    (t.sin() * Vec2::from_angle(azimuth)).extend(t.cos())
}

fn stream(seed: u64, i: u64) -> Sampler {
    Sampler::new(Sequence::Independent, Key::new(seed, Purpose::Test, 0), i)
}
