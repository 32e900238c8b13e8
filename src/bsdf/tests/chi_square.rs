//! Every material, every angle, both modes: do `sample` and `pdf` agree?
//!
//! Significance: the whole family of at most `FAMILY` tests rejects a correct program with probability 1 %; each test
//! has the Šidák-corrected level `1 − 0.99^(1/FAMILY)` = 1.7e-5. Seeds are fixed.

use std::collections::BTreeMap;

use super::cases::Case;
use super::histogram::{Histogram, p_value};
use super::*;

const FAMILY: f64 = 600.0;
const SAMPLES: u64 = if cfg!(feature = "slow-tests") { 1_000_000 } else { 100_000 };
const PILOT: u64 = 20_000;

/// Tests one material seen from `wo`; `mask` restricts the lobes.
fn agree(case: &Case, wo_local: Vec3, mode: Mode, mask: LobeMask, seed: u64) {
    let (si, frame) = point(wo_local, case.bend);
    let bsdf = bsdf_at(&case.materials, &si);
    let draw = |seed, i| {
        let mut s = stream(seed, i);
        bsdf.sample(si.wo, s.next_1d(), s.next_2d(), mode, mask)
    };

    // Bins from a pilot run.
    let smooth = |s: BsdfSample| s.lobe.intersects(LobeMask::SMOOTH).then(|| frame.to_local(s.wi));
    let pilot: Vec<Vec3> = (0..PILOT).filter_map(|i| draw(seed ^ 0x5eed, i).and_then(smooth)).collect();
    let histogram = Histogram::new(&pilot, 80);

    // Count: a bin for every cell, one for "no sample", one for each discrete choice.
    let mut observed = vec![0.0; histogram.len() + 1];
    let mut discrete: BTreeMap<(u8, bool), (f64, f64)> = BTreeMap::new();
    for i in 0..SAMPLES {
        match draw(seed, i) {
            None => observed[histogram.len()] += 1.0,
            Some(s) if s.lobe.intersects(LobeMask::SMOOTH) => observed[histogram.bin(frame.to_local(s.wi))] += 1.0,
            Some(s) => {
                let entry = discrete.entry((s.lobe.0, s.transmit)).or_insert((0.0, s.pdf as f64));
                assert_eq!(entry.1, s.pdf as f64, "{}: a discrete choice with two probabilities", case.name);
                entry.0 += 1.0;
            }
        }
    }

    // Compare with the integral of the density.
    let density = |w: Vec3| bsdf.pdf(si.wo, frame.to_world(w).normalize(), mode, mask) as f64;
    let mut expected = histogram.integrate(&density);
    let total: f64 = expected.iter().sum::<f64>() + discrete.values().map(|d| d.1).sum::<f64>();
    assert!(total < 1.0 + 2e-4, "{} from {wo_local} {mode:?}: probabilities sum to {total}", case.name);
    expected.push((1.0 - total).max(0.0));
    for (count, p) in discrete.values() {
        observed.push(*count);
        expected.push(*p);
    }
    let expected: Vec<f64> = expected.iter().map(|e| e * SAMPLES as f64).collect();
    let p = p_value(&observed, &expected);
    let level = 1.0 - 0.99f64.powf(1.0 / FAMILY);
    assert!(p > level, "{} from {wo_local} {mode:?} {mask:?}: p = {p:e}, total {total}", case.name);
}

fn all_agree(cases: Vec<Case>) {
    for (i, case) in cases.iter().enumerate() {
        let mut seed = 1000 * i as u64;
        for (degrees, azimuth) in [(0.0, 0.0), (30.0, 0.7), (63.0, 2.9), (85.0, 4.0), (89.5, 1.0)] {
            for side in [1.0, -1.0] {
                if side < 0.0 && !case.both_sides {
                    continue;
                }
                let wo = at_angle(degrees, azimuth) * side;
                // The density knows no mode; one angle checks that.
                let modes = if degrees == 30.0 { &[Mode::Radiance, Mode::Importance][..] } else { &[Mode::Radiance] };
                for &mode in modes {
                    seed += 1;
                    agree(case, wo, mode, LobeMask::ALL, seed);
                }
            }
        }
        // Every class of lobes for itself.
        for bit in [LobeMask::DIFFUSE, LobeMask::GLOSSY, LobeMask::SHARP] {
            agree(case, at_angle(50.0, 5.0), Mode::Radiance, bit, seed + 100 + bit.0 as u64);
        }
    }
}

#[test]
fn reflective_materials_sample_their_density() {
    all_agree(cases::reflective());
}

#[test]
fn transmissive_materials_sample_their_density() {
    all_agree(cases::transmissive());
}

#[test]
fn nested_materials_sample_their_density() {
    all_agree(cases::nested());
}

#[test]
fn principled_materials_sample_their_density() {
    all_agree(cases::principled());
}
