//! Plane dielectric interfaces and slabs.

use super::super::case::{Case, Check, Item, Outcome};
use super::super::methods::Light;
use super::super::optics::*;
use super::super::probe::Probe;
use super::super::xml::*;
use crate::bsdf::{Ior, diffuse_reflectance};
use std::f64::consts::PI;

pub fn cases() -> Vec<Case> {
    vec![
        Case { name: "slab", about: "lossless slab n = 1.5: T = (1 − R)/(1 + R)", items: slabs },
        Case {
            name: "slab-over-floor",
            about: "diffuse floor under a slab, seen through it (light through specular, diffuse, specular)",
            items: floors,
        },
        Case { name: "fresnel-grazing", about: "reflectance of n = 1.5 up to 89.9999°", items: grazing },
        Case { name: "fresnel-indices", about: "normal reflectance of indices 1 ± 1e-7 … 1000", items: indices },
        Case {
            name: "diffuse-interface",
            about: "hemispherical reflectance from outside and from inside",
            items: hemispheres,
        },
        Case {
            name: "light-guide",
            about: "a glass rod of any length: total reflection loses nothing, T = (1 − R)/(1 + R)",
            items: guides,
        },
    ]
}

const SEEN_THROUGH: Light = Light::MIRRORED;

/// A camera of parallel rays at `degrees` from the normal +z, that look at the origin from `distance`.
fn slanted(degrees: f64, distance: f64, half: f64) -> String {
    let (sin, cos) = degrees.to_radians().sin_cos();
    parallel_camera([distance * sin, 0.0, distance * cos], [0.0; 3], half, 4)
}

/// A light of radiance 1 seen through a slab at an angle: T. Behind, the sky is black.
fn slabs() -> Vec<Item> {
    let of = |degrees: f64| {
        // The light reaches as far as internal reflections carry the rays.
        let xml = scene(&[
            depth(-1),
            slanted(degrees, 4.0, 1e-3),
            cuboid([0.0, 0.0, 0.0], [60.0, 60.0, 0.05], &glass(1.5)),
            square([0.0, 0.0, -0.2], 80.0, [0.0, 0.0, 1.0], &lamp(1.0)),
        ]);
        Probe::new(format!("{degrees}°"), xml, slab(1.5, degrees.to_radians().cos()), SEEN_THROUGH)
            .photons(20)
            .spp(256)
            .relative(0.02)
    };
    let mut items: Vec<Item> =
        [0.0, 30.0, 45.0, 60.0, 80.0].map(|d| Item::from(if d == 60.0 { of(d).fast() } else { of(d) })).into();
    items.push(of(89.0).spp(1024).relative(0.05).into());
    items
}

/// The floor gets E₀T from the sun, and from itself by way of the slab ρ R_d of what it sends; through the slab T of its
/// radiance is seen, whose n² cancels: `L = (ρ/π) E₀ T₀² / (1 − ρ R_d)`. A uniform sky of radiance 1 gives the floor
/// π(1 − R_d) and is itself seen in the slab: `L = R₀ + T₀ ρ (1 − R_d)/(1 − ρ R_d)`.
fn floors() -> Vec<Item> {
    let (t0, rd) = (slab(1.5, 1.0), diffuse_slab_reflectance(1.5));
    let of = |rho: f64, light: String| {
        scene(&[
            depth(-1),
            parallel_camera([0.0, 0.0, 2.0], [0.0; 3], 1.0, 8),
            square([0.0; 3], 10.0, [0.0, 0.0, 1.0], &diffuse(rho)),
            cuboid([0.0, 0.0, 0.2], [12.0, 12.0, 0.1], &glass(1.5)),
            light,
        ])
    };
    let sunny = |rho: f64| {
        let truth = rho * t0 * t0 / (1.0 - rho * rd);
        let xml = of(rho, sun([0.0, 0.0, -1.0], PI));
        Probe::new(format!("sun, ρ = {rho}"), xml, truth, Light::POINT_SDS | Light::BEHIND_GLASS)
            .photons(40_000)
            .relative(0.02)
            .bias(0.01)
    };
    // What a pass of vcm merges are the light paths of 64 pixels: it takes many passes.
    let merged: &[&str] = &["vcm"];
    let cloudy = |rho: f64| {
        let truth = (1.0 - t0) + t0 * rho * (1.0 - rd) / (1.0 - rho * rd);
        let xml = of(rho, sky(1.0));
        let light = Light::MIRRORED | Light::BEHIND_GLASS | Light::CAUSTIC | Light::INDIRECT;
        Probe::new(format!("sky, ρ = {rho}"), xml, truth, light).spp(32).photons(40_000).relative(0.02).bias(0.01)
    };
    // The side walls of the slab and the open sides of the gap are twelve slab thicknesses away.
    vec![
        sunny(0.5).except(merged).fast().into(),
        sunny(0.5).only(merged).spp(512).fast().once().into(),
        sunny(1.0).except(merged).into(),
        sunny(1.0).only(merged).spp(512).into(),
        cloudy(0.5).fast().once().into(),
        cloudy(1.0).into(),
    ]
}

/// The sky of radiance 1 in a plane of glass over darkness: R.
fn grazing() -> Vec<Item> {
    let of = |degrees: f64| {
        let xml = scene(&[
            depth(-1),
            slanted(degrees, 1.0, 1e-7),
            square([0.0; 3], 2.0, [0.0, 0.0, 1.0], &glass(1.5)),
            square([0.0, 0.0, -1.0], 3.0, [0.0, 0.0, 1.0], &black()),
            rectangle([-2.5, 0.0, -0.5], (0.5, 3.0), [1.0, 0.0, 0.0], &black()),
            sky(1.0),
        ]);
        let r = fresnel(1.5, degrees.to_radians().cos());
        Probe::new(format!("{degrees}°"), xml, r, SEEN_THROUGH).photons(20).spp(256).relative(0.02)
    };
    let mut items: Vec<Item> =
        [85.0, 89.0, 89.9, 89.99, 89.999].map(|d| Item::from(if d == 89.0 { of(d).fast() } else { of(d) })).into();
    // The function itself, with all its digits: R and what is left of 1.
    for degrees in [85.0, 89.0, 89.9, 89.99, 89.999, 89.9999f64] {
        let c = degrees.to_radians().cos();
        let (r, t) = (fresnel(1.5, c), 1.0 - fresnel(1.5, c));
        items.push(
            Check::plain(format!("R at {degrees}°"), "fresnel", move |_| {
                Outcome::exact(r, Ior::new(1.5, 1.0).fresnel(c as f32).r as f64)
            })
            .relative(2e-7)
            .into(),
        );
        items.push(
            Check::plain(format!("1 − R at {degrees}°"), "fresnel", move |_| {
                Outcome::exact(t, 1.0 - Ior::new(1.5, 1.0).fresnel(c as f32).r as f64)
            })
            .absolute(2e-7)
            .into(),
        );
    }
    items
}

/// `R = ((n − 1)/(n + 1))²`, from both sides; and the sky in a plane of it.
fn indices() -> Vec<Item> {
    let mut items: Vec<Item> = Vec::new();
    for n in [1.0 - 1e-7, 1.0, 1.0 + 1e-7, 1.000001, 1.0003, 1.33, 1.5, 2.42, 4.0, 1000.0f64] {
        let r = ((n - 1.0) / (n + 1.0)).powi(2);
        for inside in [false, true] {
            let side = if inside { "inside" } else { "outside" };
            items.push(
                Check::plain(format!("n = {n}, from {side}"), "fresnel", move |_| {
                    let ior = Ior::new(n, 1.0);
                    let ior = if inside { ior.flipped() } else { ior };
                    Outcome::exact(r, ior.fresnel(1.0).r as f64)
                })
                .relative(3e-4)
                .into(),
            );
        }
    }
    for n in [1.5, 2.42, 4.0, 1000.0f64] {
        let r = ((n - 1.0) / (n + 1.0)).powi(2);
        let xml = scene(&[
            depth(-1),
            slanted(0.0, 1.0, 1e-3),
            square([0.0; 3], 1.0, [0.0, 0.0, 1.0], &glass(n)),
            square([0.0, 0.0, -0.5], 3.0, [0.0, 0.0, 1.0], &black()),
            sky(1.0),
        ]);
        let probe = Probe::new(format!("n = {n}, picture"), xml, r, SEEN_THROUGH).photons(20).spp(1024).relative(0.05);
        items.push(if n == 1000.0 { probe.fast() } else { probe }.into());
    }
    items
}

/// `∫ R(μ) 2μ dμ` from outside; from inside `1 − (1 − R_ext)/n²`, since as much power leaves as enters in equilibrium.
fn hemispheres() -> Vec<Item> {
    let mut items: Vec<Item> = Vec::new();
    for n in [1.0, 1.0 + 1e-7, 1.33, 1.5, 2.42, 10.0, 1000.0] {
        let outside = integrate(0.0, 1.0, |u| fresnel(n, u * u * u) * 2.0 * u.powi(3) * 3.0 * u * u);
        let inside = 1.0 - (1.0 - outside) / (n * n);
        items.push(
            Check::plain(format!("n = {n}, outside"), "fresnel", move |_| {
                Outcome::exact(outside, diffuse_reflectance(n))
            })
            .relative(1e-5)
            .absolute(1e-12)
            .into(),
        );
        items.push(
            Check::plain(format!("n = {n}, inside"), "fresnel", move |_| {
                Outcome::exact(inside, diffuse_reflectance(1.0 / n))
            })
            .relative(1e-5)
            .absolute(1e-9)
            .into(),
        );
    }
    items
}

/// Whatever enters an end of a rod of n > √2 meets its sides beyond the critical angle: sin θ_side = √(1 − sin²θ/n²) > 1/n.
/// So the rod is a slab as thick as it is long.
fn guides() -> Vec<Item> {
    let of = |length: f64, degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let eye = [0.2 * sin, 0.0, 0.2 * cos];
        let xml = scene(&[
            depth(-1),
            parallel_camera(eye, [0.0; 3], 0.1, 4),
            cuboid([0.0, 0.0, -0.5 * length], [0.5, 0.5, 0.5 * length], &glass(1.5)),
            square([0.0, 0.0, -length - 0.1], 100.0, [0.0, 0.0, 1.0], &lamp(1.0)),
        ]);
        Probe::new(format!("length {length}, {degrees}°"), xml, slab(1.5, cos), SEEN_THROUGH)
            .photons(20)
            .spp(256)
            .relative(0.02)
    };
    vec![
        of(10.0, 30.0).fast().into(),
        of(100.0, 60.0).into(),
        of(1000.0, 30.0).into(),
        of(1000.0, 60.0).limit(60.0).into(),
    ]
}
