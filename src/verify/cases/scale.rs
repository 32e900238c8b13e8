//! Scenes of any size, anywhere, lit by any power.

use super::super::case::{Case, Check, Item, Outcome};
use super::super::methods::Light;
use super::super::probe::{Probe, load, mean, render_once};
use super::super::xml::*;
use crate::accel::AccelKind;
use crate::color::Rgb;
use crate::image::Image;
use crate::render::METHODS;
use std::f64::consts::PI;

pub fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "invariance",
            about: "the same bits at 2^±20 times the size and 2^±40 times the light",
            items: invariance,
        },
        Case { name: "power-ratio", about: "two sealed rooms whose lights differ by 1e24", items: rooms },
        Case { name: "dynamic-range", about: "lights of 30 stops in one picture", items: stops },
        Case { name: "small-in-large", about: "millimetres in a kilometre", items: dwarfs },
        Case { name: "threads", about: "the same bits on 1, 2, 3 and 8 threads", items: threads },
    ]
}

/// A box with a lamp, a point light, a mirror, a glass ball and a rough floor, at a size, a place and a power.
fn box_of_things(size: f64, offset: f64, power: f64) -> String {
    let at = |p: V3| p.map(|x| size * x + offset);
    let wall = |center: V3, normal: V3, inside: &str| square(at(center), size, normal, inside);
    scene(&[
        depth(-1),
        camera(at([0.0, -0.9, 0.0]), at([0.0, 1.0, -0.2]), 70.0, (8, 8)),
        wall(
            [0.0, 0.0, -1.0],
            [0.0, 0.0, 1.0],
            r#"<bsdf type="roughplastic"><float name="alpha" value="0.3"/></bsdf>"#,
        ),
        wall([0.0, 0.0, 1.0], [0.0, 0.0, -1.0], &diffuse(0.7)),
        wall([0.0, 1.0, 0.0], [0.0, -1.0, 0.0], &diffuse(0.4)),
        wall([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], &mirror()),
        wall([-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], &diffuse(0.5)),
        square(at([0.0, 0.0, 0.9]), 0.3 * size, [0.0, 0.0, -1.0], &lamp(power)),
        sphere(at([-0.3, 0.4, -0.5]), 0.4 * size, &glass(1.5)),
        point_light(at([0.6, -0.3, 0.2]), 0.3 * power * size * size),
    ])
}

fn picture(xml: &str, accel: AccelKind, method: &str, seed: u64) -> Image {
    let scene = load(xml, &[], accel).unwrap_or_else(|e| panic!("the program's own scene: {e}"));
    render_once(&scene, method, 4, 1000, seed, None).image
}

/// Pixels of which a channel differs from `scale` times the other's.
fn differing(a: &Image, b: &Image, scale: f32) -> u64 {
    let same = |(x, y): (&Rgb, &Rgb)| (scale * *x).to_array().map(f32::to_bits) == y.to_array().map(f32::to_bits);
    a.pixels().iter().zip(b.pixels()).filter(|p| !same(*p)).count() as u64
}

fn invariance() -> Vec<Item> {
    let mut items: Vec<Item> = Vec::new();
    for method in METHODS {
        for exponent in [-20, 20] {
            items.push(
                Check::new(format!("size 2^{exponent}, pixels that differ"), method, move |accel, _| {
                    let reference = picture(&box_of_things(1.0, 0.0, 1.0), accel, method, 1);
                    let scaled = picture(&box_of_things(2f64.powi(exponent), 0.0, 1.0), accel, method, 1);
                    Outcome::exact(0.0, differing(&reference, &scaled, 1.0) as f64)
                })
                .into(),
            );
        }
        for exponent in [-40, 40] {
            items.push(
                Check::new(format!("light 2^{exponent}, pixels that differ"), method, move |accel, _| {
                    let reference = picture(&box_of_things(1.0, 0.0, 1.0), accel, method, 1);
                    let scaled = picture(&box_of_things(1.0, 0.0, 2f64.powi(exponent)), accel, method, 1);
                    Outcome::exact(0.0, differing(&reference, &scaled, 2f32.powi(exponent)) as f64)
                })
                .once()
                .into(),
            );
        }
        // Other factors round the geometry, so that now and then a ray passes an edge on its other side; the mean of some
        // pictures of the same random numbers hardly moves.
        let nearly = |what: String, size: f64, offset: f64, power: f64, relative: f64| {
            Check::new(what, method, move |accel, seeds| {
                let total = |xml: &str| (1..=seeds / 4).map(|s| mean(&picture(xml, accel, method, s))).sum::<f64>();
                let reference = total(&box_of_things(1.0, 0.0, 1.0));
                Outcome::exact(reference, total(&box_of_things(size, offset, power)) / power)
            })
            .relative(relative)
        };
        for size in [1e-9, 1e-6, 1e6, 1e9] {
            items.push(nearly(format!("size {size:e}"), size, 0.0, 1.0, 2e-3).slow().into());
        }
        for power in [1e-12, 1e12] {
            items.push(nearly(format!("light {power:e}"), 1.0, 0.0, power, 1e-4).once().into());
        }
        for offset in [1e3, 1e5, 1e7] {
            let check = nearly(format!("{offset:e} m away"), 1.0, offset, 1.0, 1e-4);
            items.push(if offset == 1e7 { check.once() } else { check.slow() }.into());
        }
    }
    items
}

/// Each room is an integrating sphere of its own: L = ρ/π · I/(1 − ρ).
fn rooms() -> Vec<Item> {
    let of = |seen: f64, other: f64| {
        let rho = 0.5;
        let xml = scene(&[
            depth(-1),
            camera([0.1, 0.2, -0.3], [0.5, 0.1, 1.0], 90.0, (8, 8)),
            hollow([0.0; 3], 1.0, &diffuse(rho)),
            point_light([0.0; 3], seen * PI),
            hollow([3.0, 0.0, 0.0], 1.0, &diffuse(rho)),
            point_light([3.0, 0.0, 0.0], other * PI),
        ]);
        Probe::new(format!("{seen:e} W beside {other:e} W"), xml, seen, Light::DIRECT | Light::INDIRECT)
            .spp(256)
            .photons(40_000)
            .relative(0.05)
    };
    vec![of(1.0, 1.0).into(), of(1e-12, 1e12).fast().once().into(), of(1e12, 1e-12).into(), of(1e-6, 1.0).into()]
}

/// Thirty-one lamps beside one another, one for each column of the picture.
fn stops() -> Vec<Item> {
    let xml = || {
        let lamps: String = (0..31)
            .map(|i| rectangle([i as f64 + 0.5, 0.0, 0.0], (0.5, 1.0), [0.0, 0.0, 1.0], &lamp(2f64.powi(i - 15))))
            .collect();
        scene(&[
            depth(-1),
            // Mitsuba's parallel camera has x to the left: the picture's first column is the last lamp.
            parallel_camera([15.5, 0.0, 5.0], [15.5, 0.0, 0.0], 15.5, 31),
            lamps,
        ])
    };
    METHODS
        .into_iter()
        .filter(|m| *m != "ptracer")
        .map(|method| {
            Check::new("largest error of a column", method, move |accel, _| {
                let image = picture(&xml(), accel, method, 1);
                let row = image.height() / 2;
                let error = |x: u32| {
                    let found = image.pixel(x, row).mean() as f64;
                    let truth = |i: i32| 2f64.powi(i - 15);
                    let (there, back) = (found / truth(x as i32) - 1.0, found / truth(30 - x as i32) - 1.0);
                    (there.abs(), back.abs())
                };
                let errors: Vec<(f64, f64)> = (0..31).map(error).collect();
                // Either orientation of the picture will do, the same for all columns.
                let largest = |f: fn(&(f64, f64)) -> f64| errors.iter().map(f).fold(0.0, f64::max);
                Outcome::exact(0.0, largest(|e| e.0).min(largest(|e| e.1)))
            })
            .absolute(1e-6)
            .into()
        })
        .collect()
}

/// The form factor of squares of a millimetre and a furnace with a ball of a millimetre, in a hall of a kilometre.
fn dwarfs() -> Vec<Item> {
    // A float has 30 µm left at 256 m: the sides are a binary fraction, so that none of them moves.
    const SIDE: f64 = 1.0 / 1024.0;
    let squares = |at: f64| {
        let place = |z: f64| [at, 0.0, SIDE * z];
        let xml = scene(&[
            depth(-1),
            parallel_camera(place(0.5), place(0.0), 0.5 * SIDE, 8),
            square(place(0.0), 0.5 * SIDE, [0.0, 0.0, 1.0], &diffuse(1.0)),
            square(place(1.0), 0.5 * SIDE, [0.0, 0.0, -1.0], &lamp(1.0)),
            hollow([0.0; 3], 500.0, &black()),
        ]);
        let truth = super::super::optics::parallel_factor(1.0, 1.0);
        Probe::new(format!("squares of 1 mm, {at} m from the middle"), xml, truth, Light::DIRECT)
            .photons(200)
            .spp(64)
            .relative(0.005)
    };
    let ball = |at: f64| {
        let xml = scene(&[
            depth(-1),
            camera([at - 5e-3, 0.0, 0.0], [at, 0.0, 0.0], 15.0, (8, 8)),
            sphere([at, 0.0, 0.0], 1e-3, &mirror()),
            hollow([0.0; 3], 500.0, &(diffuse(0.5) + &emits(0.5))),
        ]);
        let light = Light::SEEN | Light::DIRECT | Light::INDIRECT | Light::MIRRORED | Light::BEHIND_GLASS;
        Probe::new(format!("mirror ball of 1 mm, {at} m from the middle"), xml, 1.0, light).spp(64).relative(0.02)
    };
    // Hit points have 32 places along a side at 256 m; those that round to its far end are beyond the film of light that is
    // splatted.
    let far = squares(256.0).except(&["ptracer", "bdpt"]);
    vec![squares(0.0).fast().into(), far.into(), ball(0.0).fast().into(), ball(300.0).into()]
}

fn threads() -> Vec<Item> {
    METHODS
        .into_iter()
        .map(|method| {
            Check::new("pixels that differ", method, move |accel, _| {
                let xml = box_of_things(1.0, 0.0, 1.0);
                let on = |threads: usize| {
                    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                    pool.install(|| picture(&xml, accel, method, 1))
                };
                let reference = on(1);
                Outcome::exact(0.0, [2, 3, 8].map(|n| differing(&reference, &on(n), 1.0)).iter().sum::<u64>() as f64)
            })
            .into()
        })
        .collect()
}
