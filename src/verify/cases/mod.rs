//! The cases by family.

mod exchange;
mod furnace;
mod geometry;
mod later;
mod lenses;
mod nested;
mod photons;
mod scale;
mod slab;
mod views;

use super::case::Case;

/// All cases, in the order of the table.
pub fn all() -> Vec<Case> {
    [
        furnace::cases(),
        exchange::cases(),
        slab::cases(),
        lenses::cases(),
        nested::cases(),
        photons::cases(),
        scale::cases(),
        geometry::cases(),
        views::cases(),
        super::stiff::cases(),
        later::cases(),
    ]
    .into_iter()
    .flatten()
    .collect()
}
