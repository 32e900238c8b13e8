//! What the program cannot do yet; listed so that nobody takes it for passed.

use super::super::case::{Case, Item};

pub fn cases() -> Vec<Case> {
    vec![
        Case { name: "media", about: "participating media", items: media },
        Case { name: "dispersion", about: "dispersing glass", items: dispersion },
    ]
}

const NO_MEDIA: &str = "media are not rendered yet";

fn media() -> Vec<Item> {
    [
        "Beer-Lambert, τ = 1e-4 … 1e6",
        "single scattering in a slab",
        "half-space, isotropic, c = 0.5 … 0.999",
        "lossless slab lit diffusely, τ = 1e-4 … 1e6",
        "absorbing slab, c = 0.5, 0.9",
        "point source in an infinite medium",
        "diffusion against transport",
        "Henyey-Greenstein, g = 0, ±0.9, ±0.9999",
        "mean path length 4V/S",
        "furnace with a lossless medium",
        "a scene with only a medium",
    ]
    .map(|parameter| Item::NotYet { parameter, why: NO_MEDIA })
    .into()
}

fn dispersion() -> Vec<Item> {
    vec![Item::NotYet {
        parameter: "60° prism of BK7 at the C, d, F lines",
        why: "glass has one index for all colours",
    }]
}
