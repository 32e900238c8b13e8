use std::ops::Range;

use rayon::prelude::*;

use super::pass::{camera_sample, pixel_key};
use crate::color::Rgb;
use crate::film::{Film, FilmState, ReconstructionFilter};
use crate::image::{FilmWindow, Image};
use crate::integrator::{Layer, LayerView, PhotonMapper};
use crate::sample::{Key, Purpose};
use crate::scene::Scene;
use crate::tally::Counters;

/// A film for each layer that a photon mapper shows beside its picture.
pub(super) struct LayerFilms {
    layers: Vec<Layer>,
    films: Vec<Film>,
}

impl LayerFilms {
    /// Films like that of the picture.
    pub fn new(picture: &Film, layers: &[Layer]) -> Self {
        let film = Film::new(picture.window(), picture.filter());
        Self { layers: layers.to_vec(), films: vec![film; layers.len()] }
    }

    /// Films that go on from kept sums, which fit the window.
    pub fn from_states(window: FilmWindow, filter: ReconstructionFilter, states: &[(Layer, FilmState)]) -> Self {
        let film = |state: &FilmState| {
            let mut film = Film::new(window, filter);
            assert!(film.set_state(state), "checked when it was read");
            film
        };
        let (layers, films) = states.iter().map(|(layer, state)| (*layer, film(state))).unzip();
        Self { layers, films }
    }

    /// The sums of each layer.
    pub fn states(&self) -> Vec<(Layer, FilmState)> {
        self.layers.iter().copied().zip(self.films.iter().map(Film::state)).collect()
    }

    /// Adds the sums of other passes over the same layers.
    pub fn add(&mut self, other: &Self) {
        for (film, more) in self.films.iter_mut().zip(&other.films) {
            film.add(more);
        }
    }

    /// Adds the camera samples `samples` of every pixel, the same paths as in the picture. Returns the rays traced.
    pub fn add_pass(&mut self, scene: &Scene, mapper: PhotonMapper, seed: u64, samples: Range<u64>) -> Counters {
        let view = LayerView { mapper, layers: &self.layers };
        let (films, layers) = (&self.films, &self.layers);
        let key = Key::new(seed, Purpose::Camera, 0);
        let rendered: Vec<_> = (0..films.first().map_or(0, Film::tile_count))
            .into_par_iter()
            .map(|index| {
                let mut tiles: Vec<_> = films.iter().map(|film| film.tile(index)).collect();
                let (mut counters, mut values) = (Counters::default(), vec![Rgb::BLACK; layers.len()]);
                for pixel in tiles[0].pixels() {
                    for index in samples.clone() {
                        let (film_pos, sample, mut sampler) = camera_sample(scene, pixel_key(key, pixel), pixel, index);
                        view.see(scene, &sample, &mut sampler, &mut counters, &mut values);
                        for (tile, value) in tiles.iter_mut().zip(&values) {
                            tile.add_sample(film_pos, *value);
                        }
                    }
                }
                (tiles, counters)
            })
            .collect();
        // Merge in the order of the tiles.
        let mut counters = Counters::default();
        for (tiles, c) in &rendered {
            for (film, tile) in self.films.iter_mut().zip(tiles) {
                film.merge(tile);
            }
            counters += *c;
        }
        counters
    }

    /// Adds the layers to the picture under their names; those of numbers have the one channel `Y`.
    pub fn add_to(&self, image: &mut Image) {
        for (layer, film) in self.layers.iter().zip(&self.films) {
            let seen = film.develop(1.0);
            if layer.is_number() {
                image.set_channel(format!("{}.Y", layer.name()), seen.pixels().iter().map(|c| c.g).collect());
            } else {
                image.set_layer(layer.name(), seen.pixels());
            }
        }
    }
}
