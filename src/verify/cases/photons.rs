//! Photon maps: density estimates, kernels, degenerate trees, what 20 bytes keep.

use super::super::case::{Case, Check, Item, Outcome};
use super::super::methods::Light;
use super::super::optics::integrate;
use super::super::probe::Probe;
use super::super::xml::*;
use crate::color::Rgb;
use crate::math::Vec3;
use crate::photon::{Kernel, KnnScratch, Photon, PhotonClass, PhotonMap, PhotonRecord};
use crate::sample::{Key, Purpose, Sampler, Sequence, hash_u64};
use std::f64::consts::PI;

pub fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "knn-density",
            about: "uniform photons: (k − 1)/(πr²) has no bias, k/(πr²) is k/(k − 1) too large",
            items: density,
        },
        Case {
            name: "kernels", about: "kernels hold all power; their bias in E = 1 + x² at radius 1", items: kernels
        },
        Case {
            name: "photon-trees",
            about: "empty, tiny, coincident, collinear and undefined photons against brute force",
            items: trees,
        },
        Case {
            name: "saturated-light",
            about: "20 bytes keep (1, 0.001, 0) on average, and an exact 0",
            items: saturated,
        },
        Case {
            name: "small-maps",
            about: "photon mapping with 0 or 1 photons, k = 1, k = N, extreme radii",
            items: small,
        },
    ]
}

fn stream(seed: u64, index: u64) -> Sampler {
    Sampler::new(Sequence::Independent, Key::new(seed, Purpose::Test, 0), index)
}

fn photon(p: Vec3, power: Rgb, hash: u64) -> Option<Photon> {
    let record =
        PhotonRecord { p, power, wi: Vec3::Z, side: true, normal: Vec3::Z, class: PhotonClass::Global, mark: false };
    Photon::pack(&record, hash).ok()
}

/// `n` photons of equal power in the unit square.
fn uniform(n: u64, seed: u64) -> PhotonMap {
    let mut s = stream(seed, 0);
    let mut one = |i| photon(s.next_2d().extend(0.0), Rgb::WHITE, i).expect("a finite photon");
    PhotonMap::build((0..n).map(&mut one).collect())
}

/// Estimates of the relative density around points of the middle, far enough from one another to be independent.
fn densities(seed: u64, k: usize) -> Vec<f64> {
    const N: u64 = 40_000;
    let map = uniform(N, seed);
    let mut scratch = KnnScratch::new();
    (0..25)
        .map(|i| {
            let p = Vec3::new(0.1 + 0.2 * (i % 5) as f32, 0.1 + 0.2 * (i / 5) as f32, 0.0);
            let found = map.nearest(p, k, f32::INFINITY, &mut scratch);
            (k - 1) as f64 / (PI * found.radius_sq as f64) / N as f64
        })
        .collect()
}

/// The photons nearer than the k-th are uniform in its disc, whose area A has E[1/A] = λ/(k − 1) and relative variance
/// 1/(k − 2).
fn density() -> Vec<Item> {
    let mut items: Vec<Item> = Vec::new();
    for k in [5, 20, 50, 100usize] {
        let mean = move |seeds: u64| (1..=4 * seeds).map(move |s| densities(s, k).iter().sum::<f64>() / 25.0);
        items.push(
            Check::plain(format!("(k − 1)/(πr²), k = {k}"), "photon map", move |n| {
                Outcome::estimates(1.0, mean(n))
            })
            .statistical(0.1)
            .into(),
        );
        let plain = k as f64 / (k as f64 - 1.0);
        items.push(
            Check::plain(format!("k/(πr²), k = {k}"), "photon map", move |n| {
                Outcome::estimates(plain, mean(n).map(|m| m * plain))
            })
            .statistical(0.1)
            .into(),
        );
        let square = move |s| densities(s, k).iter().map(|d| (d - 1.0).powi(2)).sum::<f64>() / 25.0;
        if k >= 20 {
            items.push(
                Check::plain(format!("variance, k = {k}"), "photon map", move |n| {
                    Outcome::estimates(1.0 / (k as f64 - 2.0), (1..=4 * n).map(square))
                })
                .statistical(0.25)
                .into(),
            );
        }
        // The renderer's own estimate, seen without gathering. On a sphere πr² is the cap's area for a chord r, exactly.
        let xml = scene(&[
            photon_mapper(&[
                ("boolean", "final_gather", "false".into()),
                ("integer", "lookup_size", k.to_string()),
                ("float", "global_lookup_radius", "0.5".into()),
            ]),
            camera([0.1, 0.2, -0.3], [0.5, 0.1, 1.0], 90.0, (8, 8)),
            hollow([0.0; 3], 1.0, &(diffuse(0.8) + &emits(0.2))),
        ]);
        items.push(
            Probe::new(
                format!("furnace from the map, k = {k}"),
                xml,
                1.0,
                Light::SEEN | Light::DIRECT | Light::INDIRECT,
            )
            .only(&["photonmapper"])
            .spp(4)
            .photons(20_000)
            .bias(0.0)
            .relative(0.01)
            .fast()
            .once()
            .into(),
        );
    }
    items
}

/// `∫K = 1`; `∫K x² = ¼, ⅙, ⅛` for disc, Epanechnikov and biweight; half of the power on either side of an edge.
fn kernels() -> Vec<Item> {
    let of = |name: &str, kernel: Kernel, second: Option<f64>| {
        let moment = move |power: i32| {
            integrate(0.0, 1.0, |d| kernel.weight((d * d) as f32, 1.0) as f64 * d.powi(power) * 2.0 * PI * d)
        };
        let mut items = vec![
            Item::from(
                Check::plain(format!("{name}: power"), "kernel", move |_| Outcome::exact(1.0, moment(0)))
                    .relative(1e-5),
            ),
            // As for a radius of a nanometre and of a thousand kilometres.
            Item::from(
                Check::plain(format!("{name}: radius 1e-9"), "kernel", move |_| {
                    Outcome::exact(kernel.weight(0.25, 1.0) as f64, kernel.weight(0.25e-18, 1e-18) as f64 * 1e-18)
                })
                .relative(1e-5),
            ),
            Item::from(
                Check::plain(format!("{name}: radius 1e6"), "kernel", move |_| {
                    Outcome::exact(kernel.weight(0.25, 1.0) as f64, kernel.weight(0.25e12, 1e12) as f64 * 1e12)
                })
                .relative(1e-5),
            ),
            Item::from(Check::plain(format!("{name}: radius 0"), "kernel", move |_| {
                Outcome::exact(0.0, kernel.weight(0.0, 0.0) as f64)
            })),
        ];
        if let Some(second) = second {
            // The mean of x² around a circle of radius d is d²/2.
            items.push(
                Check::plain(format!("{name}: bias in 1 + x²"), "kernel", move |_| {
                    Outcome::exact(second, 0.5 * moment(2))
                })
                .relative(1e-5)
                .into(),
            );
        }
        items
    };
    [
        of("disc", Kernel::Disc, Some(0.25)),
        of("epanechnikov", Kernel::Epanechnikov, Some(1.0 / 6.0)),
        of("biweight", Kernel::Biweight, Some(0.125)),
        of("cone 1.1", Kernel::Cone(1.1), None),
        of("gaussian", Kernel::Gaussian, None),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// Queries whose squared distances differ from those of a search through all photons.
fn differences(positions: &[Vec3], k: usize, r_sq: f32) -> u64 {
    let map =
        PhotonMap::build(positions.iter().enumerate().filter_map(|(i, p)| photon(*p, Rgb::WHITE, i as u64)).collect());
    let mut scratch = KnnScratch::new();
    let mut s = stream(7, 1);
    let mut wrong = 0;
    for i in 0..50 {
        let p = match i {
            0 => Vec3::ZERO,
            i if i % 2 == 0 && !positions.is_empty() => positions[i * 7919 % positions.len()],
            _ => 2.0 * Vec3::new(s.next_1d(), s.next_1d(), s.next_1d()) - 1.0,
        };
        let mut all: Vec<f32> = positions.iter().map(|q| (*q - p).length_squared()).filter(|d| *d <= r_sq).collect();
        all.sort_by(f32::total_cmp);
        all.truncate(k);
        let found = map.nearest(p, k, r_sq, &mut scratch);
        let mut got: Vec<f32> = found.iter().map(|(_, d_sq)| d_sq).collect();
        got.sort_by(f32::total_cmp);
        let near = |a: &f32, b: &f32| (a - b).abs() <= 1e-5 * a.max(*b);
        wrong += (got.len() != all.len() || !got.iter().zip(&all).all(|(a, b)| near(a, b))) as u64;
    }
    wrong
}

fn trees() -> Vec<Item> {
    type Points = fn(u64) -> Vec<Vec3>;
    let random: Points = |n| {
        let mut s = stream(3, n);
        (0..n).map(|_| 2.0 * Vec3::new(s.next_1d(), s.next_1d(), s.next_1d()) - 1.0).collect()
    };
    let identical: Points = |n| vec![Vec3::splat(0.25); n as usize];
    let line: Points = |n| (0..n).map(|i| Vec3::X * (i as f32 / n as f32)).collect();
    let plane: Points =
        |n| (0..n).map(|i| Vec3::new((i % 100) as f32 / 100.0, (i / 100) as f32 / 100.0, 0.0)).collect();
    let of = |name: &str, points: Points, n: u64, k: usize, r_sq: f32| {
        let radius = if r_sq == 0.0 {
            "0"
        } else if r_sq.is_infinite() {
            "∞"
        } else {
            "0.3"
        };
        let what = format!("{name}, N = {n}, k = {k}, r = {radius}");
        Item::from(Check::plain(what, "photon map", move |_| {
            Outcome::exact(0.0, differences(&points(n), k, r_sq) as f64)
        }))
    };
    let mut items: Vec<Item> = Vec::new();
    for n in [0, 1, 2, 3] {
        items.push(of("random", random, n, 5, f32::INFINITY));
    }
    for (k, r_sq) in [(1, f32::INFINITY), (1, 0.0), (50, 0.0), (50, 0.09), (1000, f32::INFINITY), (2000, f32::INFINITY)]
    {
        items.push(of("random", random, 1000, k, r_sq));
    }
    for r_sq in [0.0, 0.09, f32::INFINITY] {
        items.push(of("identical", identical, 1_000_000, 100, r_sq));
        items.push(of("on a line", line, 10_000, 20, r_sq));
        items.push(of("in a plane", plane, 10_000, 20, r_sq));
    }
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30];
    items.push(
        Check::plain("undefined positions are counted", "photon map", move |_| {
            let mut photons: Vec<Photon> =
                (0..10).filter_map(|i| photon(Vec3::splat(i as f32), Rgb::WHITE, i)).collect();
            photons.extend(bad.map(|x| Photon { position: [x, 0.0, 0.0], ..photons[0] }));
            let map = PhotonMap::build(photons);
            Outcome::exact(4.0, if map.len() == 10 { map.rejected() as f64 } else { f64::NAN })
        })
        .into(),
    );
    items.push(
        Check::plain("undefined powers are refused", "photon map", move |_| {
            let refused = [Rgb::splat(f32::NAN), Rgb::splat(f32::INFINITY), Rgb::new(-1.0, 0.0, 0.0)];
            Outcome::exact(3.0, refused.into_iter().filter(|p| photon(Vec3::ZERO, *p, 0).is_none()).count() as f64)
        })
        .into(),
    );
    items
}

/// Stochastic rounding keeps the mean of every channel; truncation would lose all of a thousandth.
fn saturated() -> Vec<Item> {
    let stored = |scale: f32, channel: usize| {
        move |n: u64| {
            let one = |seed: u64| {
                let sum: f64 = (0..20_000)
                    .filter_map(|i| photon(Vec3::ZERO, scale * Rgb::new(1.0, 0.001, 0.0), hash_u64(seed, i)))
                    .map(|p| p.unpack().power.to_array()[channel] as f64 / scale as f64)
                    .sum();
                sum / 20_000.0
            };
            (1..=n).map(one).collect::<Vec<f64>>()
        }
    };
    let mut items: Vec<Item> = Vec::new();
    for exponent in [-30, 0, 30] {
        let scale = 10f32.powi(exponent);
        for (channel, (name, truth)) in [("red", 1.0), ("green", 0.001), ("blue", 0.0)].into_iter().enumerate() {
            let values = stored(scale, channel);
            items.push(
                Check::plain(format!("{name} at 1e{exponent}"), "photon", move |n| {
                    Outcome::estimates(truth, values(n))
                })
                .statistical(0.05)
                .into(),
            );
        }
    }
    items
}

/// Fixed radii are unbiased in uniform light however few photons there are; a tiny radius finds none and leaves direct light.
fn small() -> Vec<Item> {
    let of = |what: &str, photons: u64, k: u64, radius: f64, truth: f64| {
        let xml = scene(&[
            photon_mapper(&[
                ("boolean", "final_gather", "false".into()),
                ("integer", "lookup_size", k.to_string()),
                ("float", "global_lookup_radius", radius.to_string()),
            ]),
            camera([0.1, 0.2, -0.3], [0.5, 0.1, 1.0], 90.0, (4, 4)),
            hollow([0.0; 3], 1.0, &(diffuse(0.5) + &emits(0.5))),
        ]);
        Probe::new(what, xml, truth, Light::SEEN | Light::DIRECT | Light::INDIRECT)
            .only(&["photonmapper"])
            .spp(4)
            .photons(photons)
            .bias(0.0)
            .fast()
    };
    // Without indirect photons: Le(1 + ρ).
    vec![
        of("no photons", 0, 100, 0.2, 0.75).relative(1e-3).into(),
        of("one photon", 1, 100, 0.2, 1.0).relative(1.0).into(),
        // The k-th photon only sets the radius, so with k = 1 none counts.
        of("k = 1", 2000, 1, 0.2, 0.75).relative(1e-3).into(),
        of("radius 1e-20", 2000, 100, 1e-20, 0.75).relative(1e-3).into(),
        of("radius 0.2, k never reached", 2000, 1_000_000, 0.2, 1.0).relative(0.05).into(),
    ]
}
