use rayon::prelude::*;

use super::*;
use crate::sample::{Key, Purpose, Sampler, Sequence};

const FILTERS: [&str; 6] = ["box", "tent", "gaussian", "mitchell", "catmullrom", "lanczos"];

fn filter(name: &str) -> ReconstructionFilter {
    ReconstructionFilter::from_name(name).expect("a known name")
}

/// Renders `f` with four jittered samples per pixel, tiles in parallel and merged in order.
fn render(film: &mut Film, f: impl Fn(Vec2) -> Rgb + Sync) {
    let tiles: Vec<FilmTile> = (0..film.tile_count())
        .into_par_iter()
        .map(|i| {
            let mut tile = film.tile(i);
            for (x, y) in tile.pixels() {
                for s in 0..4 {
                    let mut sampler =
                        Sampler::new(Sequence::Sobol, Key::new((x + 1000 * y) as u64, Purpose::Test, 0), s);
                    let p = Vec2::new(x as f32, y as f32) + sampler.next_2d();
                    tile.add_sample(p, f(p));
                }
            }
            tile
        })
        .collect();
    tiles.iter().for_each(|t| film.merge(t));
}

const CROP: FilmWindow = FilmWindow { size: (100, 80), crop_offset: (13, 7), crop_size: (53, 38) };

#[test]
fn filters_have_unit_integral_or_a_stated_one() {
    for name in FILTERS {
        let integral = filter(name).integral();
        // The Gaussian loses what it is lowered by: σ√(2π)·erf(4/√2) − 8σ e⁻⁸; Lanczos 3 integrates to 0.997.
        let expected = match name {
            "gaussian" => 0.5 * (2.0 * std::f64::consts::PI).sqrt() * 0.999_936_657 - 4.0 * (-8.0f64).exp(),
            "lanczos" => 0.997_056,
            _ => 1.0,
        };
        assert!((integral - expected).abs() < 2e-5, "{name}: {integral} for {expected}");
    }
}

#[test]
fn interpolating_filters_are_a_partition_of_unity() {
    for name in ["box", "tent", "mitchell", "catmullrom"] {
        let f = filter(name);
        for i in 0..64 {
            let x = (i as f32 + 0.5) / 64.0;
            let sum: f32 = (-4..=4).map(|k| f.eval(x - 0.5 + k as f32)).sum();
            assert!((sum - 1.0).abs() < 1e-6, "{name} at {x}: {sum}");
        }
    }
    // The published values of the cubics at the nodes.
    assert!((filter("mitchell").eval(0.0) - 8.0 / 9.0).abs() < 1e-6);
    assert!((filter("mitchell").eval(1.0) - 1.0 / 18.0).abs() < 1e-6);
    assert_eq!((filter("catmullrom").eval(0.0), filter("catmullrom").eval(1.0)), (1.0, 0.0));
    assert!(filter("lanczos").eval(1.0).abs() < 1e-6 && filter("lanczos").eval(3.0) == 0.0);
    assert_eq!(filter("gaussian").eval(2.0), 0.0);
}

#[test]
fn constant_light_gives_a_constant_picture() {
    let value = Rgb::new(0.1, 1.0, 12345.678);
    for name in FILTERS {
        let mut film = Film::new(CROP, filter(name));
        render(&mut film, |_| value);
        let image = film.develop(0.0);
        assert_eq!((image.width(), image.height()), CROP.crop_size);
        for p in image.pixels() {
            for (a, b) in p.to_array().into_iter().zip(value.to_array()) {
                assert!((a - b).abs() <= b * f32::EPSILON, "{name}: {p:?}");
            }
        }
    }
}

#[test]
fn tiles_and_single_samples_give_the_same_picture() {
    let f = |p: Vec2| Rgb::new((0.3 * p.x).sin().abs(), (0.2 * p.y).cos().abs(), 1.0);
    for name in FILTERS {
        let mut by_tiles = Film::new(CROP, filter(name));
        render(&mut by_tiles, f);
        let mut one_by_one = Film::new(CROP, filter(name));
        for i in 0..one_by_one.tile_count() {
            for (x, y) in one_by_one.tile(i).pixels() {
                for s in 0..4 {
                    let mut sampler =
                        Sampler::new(Sequence::Sobol, Key::new((x + 1000 * y) as u64, Purpose::Test, 0), s);
                    let p = Vec2::new(x as f32, y as f32) + sampler.next_2d();
                    assert!(one_by_one.add_sample(p, f(p)));
                }
            }
        }
        let (a, b) = (by_tiles.develop(0.0), one_by_one.develop(0.0));
        for (a, b) in a.pixels().iter().zip(b.pixels()) {
            assert!((*a - *b).max_channel().abs() < 1e-6, "{name}: {a:?} for {b:?}");
        }
    }
}

#[test]
fn thread_count_does_not_show() {
    let f = |p: Vec2| Rgb::splat((p.x * 12.9898 + p.y * 78.233).sin() * 43758.547);
    let picture = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let mut film = Film::new(CROP, filter("gaussian"));
        pool.install(|| render(&mut film, f));
        film.develop(0.0)
    };
    let one = picture(1);
    assert!([2, 3, 8].into_iter().all(|n| picture(n) == one));
}

#[test]
fn crop_window_equals_the_same_part_of_the_whole() {
    // The box filter looks at nothing outside; a cropped film then equals the part exactly.
    let f = |p: Vec2| Rgb::new(p.x, p.y, p.x * p.y);
    let (mut whole, mut part) =
        (Film::new(FilmWindow::full(100, 80), ReconstructionFilter::Box), Film::new(CROP, ReconstructionFilter::Box));
    render(&mut whole, f);
    render(&mut part, f);
    let (whole, part) = (whole.develop(0.0), part.develop(0.0));
    for y in 0..38 {
        for x in 0..53 {
            assert_eq!(part.pixel(x, y), whole.pixel(x + 13, y + 7));
        }
    }
}

#[test]
fn non_finite_samples_are_counted_and_not_added() {
    let mut film = Film::new(FilmWindow::full(4, 4), filter("tent"));
    let mut tile = film.tile(0);
    assert!(tile.add_sample(Vec2::splat(1.5), Rgb::WHITE));
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        assert!(!tile.add_sample(Vec2::splat(1.5), Rgb::new(1.0, bad, 1.0)));
        assert!(!film.splat(Vec2::splat(1.5), Rgb::splat(bad)));
    }
    film.merge(&tile);
    assert_eq!(film.non_finite(), 6);
    assert_eq!(film.develop(1.0).pixel(1, 1), Rgb::WHITE);
    assert_eq!(film.develop(1.0).pixel(3, 3), Rgb::BLACK);
}

#[test]
fn splats_keep_their_energy() {
    for name in FILTERS {
        let mut film = Film::new(FilmWindow::full(32, 32), filter(name));
        let mut batch = SplatBuffer::default();
        for i in 0..256 {
            let mut s = Sampler::new(Sequence::Sobol, Key::new(2, Purpose::Test, 0), i);
            batch.push(Vec2::splat(16.0) + s.next_2d(), Rgb::splat(0.5));
        }
        film.merge_splats(&batch);
        let sum: f32 = film.develop(2.0).pixels().iter().map(|p| p.g).sum();
        assert!((sum - 256.0).abs() < 0.5, "{name}: {sum}");
    }
}

#[test]
fn splats_and_samples_agree_up_to_the_border() {
    for name in FILTERS {
        let mut film = Film::new(FilmWindow::full(6, 5), filter(name));
        // The same uniform light by samples and by splats.
        let n = 1 << 16;
        for i in 0..n {
            let mut s = Sampler::new(Sequence::Sobol, Key::new(3, Purpose::Test, 0), i);
            let at = s.next_2d() * Vec2::new(6.0, 5.0);
            film.add_sample(at, Rgb::WHITE);
            film.splat(at, Rgb::splat(30.0 / n as f32));
        }
        for (i, p) in film.develop(1.0).pixels().iter().enumerate() {
            assert!((p.g - 2.0).abs() < 0.01, "{name}, pixel {i}: {}", p.g);
        }
    }
}

#[test]
fn films_of_two_passes_add_up_to_one_of_both() {
    let window = FilmWindow::full(5, 3);
    let at = |i: usize| Vec2::new((i % 5) as f32 + 0.3, (i / 5) as f32 + 0.6);
    let mut both = Film::new(window, filter("gaussian"));
    let mut parts = [both.clone(), both.clone()];
    for i in 0..30 {
        let value = Rgb::splat(0.25 * (i % 7) as f32);
        both.add_sample(at(i % 15), value);
        parts[i / 15].add_sample(at(i % 15), value);
        parts[1].splat(at(i % 15), value);
        both.splat(at(i % 15), value);
    }
    let [mut first, second] = parts;
    first.add(&second);
    for (a, b) in first.develop(0.5).pixels().iter().zip(both.develop(0.5).pixels()) {
        assert!((a.g - b.g).abs() < 1e-6, "{a:?} {b:?}");
    }
}

#[test]
fn sums_do_not_stop_at_two_to_the_24() {
    let mut film = Film::new(FilmWindow::full(1, 1), ReconstructionFilter::Box);
    let tile_of = |film: &Film, value: f32| {
        let mut tile = film.tile(0);
        for _ in 0..1 << 12 {
            tile.add_sample(Vec2::splat(0.5), Rgb::splat(value));
        }
        tile
    };
    let one = tile_of(&film, 1.0);
    for _ in 0..1 << 13 {
        film.merge(&one);
    }
    let two = tile_of(&film, 3.0);
    for _ in 0..1 << 13 {
        film.merge(&two);
    }
    assert_eq!(film.develop(0.0).pixel(0, 0), Rgb::splat(2.0));
}
