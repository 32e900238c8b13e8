//! What pilots promise beside each other.

use super::pilot::Pilot;
use super::{BLUR, GOAL, Trial};
use crate::color::Rgb;
use crate::image::metrics::RELMSE_EPSILON;
use crate::image::{BLOCK_SIZE, Image, block_means};
use crate::integrator::sppm::radius_sq_ratio;

/// Share of the picture's light, where it stands out from noise by so many standard errors, that a method may have missed;
/// light that is rare and bright makes noise that has not been seen yet.
const LEAST_LIGHT: f64 = 0.002;
const SURE: f64 = 5.0;

/// Standard errors where two methods that know nothing of each other have to say so.
const SURE_TWICE: f64 = 3.0;

/// Share of the goal that light which a method has not found may take; beyond, its noise cannot be believed.
const LEAST_MISSING: f64 = 0.25;

/// Pixels around one that tell what rare bright samples are beside.
const AROUND: u32 = 3;

/// The noise of photons of `sppm` at least, as a share of what rare light adds to a camera sample: it is as rare, and two passes
/// tell as little of it. In cognac, 0.1 to 0.2 a pass beside 0.5 to 0.6 of samples (fitted to errors with 1, 4 and 16
/// samples a pass).
const RARE_PHOTONS: f64 = 0.25;

/// Camera samples of a pixel that a pass of `sppm` may take.
const SAMPLES_OF_A_PASS: [u64; 5] = [1, 2, 4, 8, 16];

/// How far a pilot's picture is smoothed, in pixels, and the relative variance that is left where it is far enough.
const REACHES: [u32; 4] = [1, 3, 5, 8];
const SMOOTH_ENOUGH: f64 = 0.1;

/// Share of the goal that the blur of `photonmapper` may take, since passes do not take it away.
const MOST_BLUR: f64 = 0.5;

/// The picture as far as it is known, for errors to be relative to: what those methods have whose pictures take the least
/// [smoothing](Pilot::smoothed).
pub(super) struct Guide(Vec<Known>);

struct Known {
    method: &'static str,
    image: Image,
    /// Over more pixels, for the method itself: a bright sample hides in what it brightens.
    around: Image,
}

impl Guide {
    pub fn new(pilots: &[Pilot]) -> Self {
        let smoothed: Vec<(u32, Image)> = pilots.iter().map(Pilot::smoothed).collect();
        let least = smoothed.iter().map(|s| s.0).min().expect("there are candidates");
        let known = pilots.iter().zip(smoothed).filter(|(_, s)| s.0 == least).map(|(pilot, (_, image))| Known {
            method: pilot.method,
            image,
            around: smooth(&pilot.image, least.max(AROUND)),
        });
        Self(known.collect())
    }

    /// Squares of what errors of a method are relative to, the medians of what is known.
    pub fn of(&self, method: &str) -> Vec<[f64; 3]> {
        let images: Vec<&Image> =
            self.0.iter().map(|k| if k.method == method { &k.around } else { &k.image }).collect();
        let median = |i: usize, c: usize| {
            let mut values: Vec<f32> = images.iter().map(|image| image.pixels()[i][c]).collect();
            values.sort_unstable_by(f32::total_cmp);
            values[values.len() / 2]
        };
        (0..images[0].pixels().len()).map(|i| [0, 1, 2].map(|c| square(median(i, c)))).collect()
    }
}

/// What a squared error of a pixel is relative to.
fn square(value: f32) -> f64 {
    f64::from(value).powi(2) + RELMSE_EPSILON * RELMSE_EPSILON
}

/// Variances over squares of the picture, on the average.
fn relative(variance: &[Rgb], squares: impl Iterator<Item = [f64; 3]>) -> f64 {
    let of = |(v, s): (&Rgb, [f64; 3])| (0..3).map(|c| f64::from(v[c]) / s[c]).sum::<f64>() / 3.0;
    variance.iter().zip(squares).map(of).sum::<f64>() / variance.len() as f64
}

/// relMSE of one of several passes, so told that rare bright samples count: each pass is relative to what the others have in
/// the pixel or to what is around it, in all passes or in `picture`, whichever is brightest.
///
/// In the mean of all passes a bright sample of a pixel would hide itself: it is met once in the pixel, and looks as if it was
/// met in one pass of so many. What is around, more samples by far, tells how rare it is. Beside it is its standard error, as the
/// passes tell it.
pub(super) fn noise_with_rare(passes: &[Image], picture: &Image) -> (f64, f64) {
    let n = passes.len() as f32;
    let sum = |i: usize| passes.iter().map(|pass| pass.pixels()[i]).sum::<Rgb>();
    let means = (0..passes[0].pixels().len()).map(|i| sum(i) * (1.0 / n)).collect();
    let means = Image::rgb(picture.width(), picture.height(), means);
    let [around, picture] = [&means, picture].map(|image| smooth(image, AROUND));
    let of_channel = |i: usize, c: usize, value: f32| {
        let mean = means.pixels()[i][c];
        let others = (n * mean - value) / (n - 1.0);
        let brightest = others.max(around.pixels()[i][c]).max(picture.pixels()[i][c]);
        f64::from((value - mean).powi(2)) / square(brightest)
    };
    let of_pixel = |(i, value): (usize, &Rgb)| (0..3).map(|c| of_channel(i, c, value[c])).sum::<f64>();
    let of_pass = |pass: &Image| pass.pixels().iter().enumerate().map(of_pixel).sum::<f64>();
    let noise: Vec<f64> = passes.iter().map(of_pass).collect();
    let (n, pixels) = (f64::from(n), means.pixels().len() as f64);
    let mean = noise.iter().sum::<f64>() / n;
    let doubt = (noise.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt();
    let scale = n / (n - 1.0) / (3.0 * pixels);
    (mean * scale, doubt * scale)
}

/// Means over each pixel and those up to `reach` rows and columns away.
fn smooth(image: &Image, reach: u32) -> Image {
    let around = |x: u32, end: u32| x.saturating_sub(reach)..(x + reach + 1).min(end);
    let rows = Image::from_fn(image.width(), image.height(), |x, y| {
        let columns = around(x, image.width());
        let n = columns.len();
        columns.map(|x| image.pixel(x, y)).sum::<Rgb>() * (1.0 / n as f32)
    });
    Image::from_fn(image.width(), image.height(), |x, y| {
        let lines = around(y, image.height());
        let n = lines.len();
        lines.map(|y| rows.pixel(x, y)).sum::<Rgb>() * (1.0 / n as f32)
    })
}

impl Pilot {
    /// The picture over as few pixels as leave little noise, and how far that reaches.
    ///
    /// Rare bright samples make a pixel's noise and the pixel itself: over too few pixels such noise looks small, and what the
    /// others have there, mostly darkness, makes that of a better method look large.
    fn smoothed(&self) -> (u32, Image) {
        let mut smoothed = None;
        for reach in REACHES {
            let image = smooth(&self.image, reach);
            let noise = relative(&self.noise, image.pixels().iter().map(|p| [0, 1, 2].map(|c| square(p[c]))));
            let samples = (self.passes * u64::from(2 * reach + 1).pow(2)) as f64;
            smoothed = Some((reach, image));
            if noise <= SMOOTH_ENOUGH * samples {
                break;
            }
        }
        smoothed.expect("there are reaches")
    }

    /// What this promises beside all, the widest last, with errors relative to `guide` and the noise that
    /// [rare light](super::Rare) adds to every camera sample.
    pub fn against(&self, all: &[Self], guide: &Guide, rare: f64) -> Trial {
        let guide = &guide.of(self.method)[..];
        let widest = all.last().expect("there are candidates");
        let mut noise = relative(&self.noise, guide.iter().copied());
        let factor = if self.common_factor { factor(&self.means, &widest.means) } else { 1.0 };
        let mut offs = vec![0.0; self.variance.len()];
        for (i, off) in offs.iter_mut().enumerate() {
            for c in 0..3 {
                let of = |image: &Image| f64::from(image.pixels()[i][c]);
                let (a, b) = (factor * of(&self.means), of(&widest.means));
                let doubt = factor * factor * f64::from(self.variance[i][c]) + f64::from(widest.variance[i][c]);
                *off += ((a - b).powi(2) - doubt) / (3.0 * square(b as f32));
            }
        }
        let (off, missing) =
            if std::ptr::eq(self, widest) { (0.0, 0.0) } else { (above_noise(&offs), self.missing(all)) };
        let (mut photon_noise, mut blur, mut alpha) = (0.0, 0.0, 1.0);
        if let Some(discs) = &self.discs {
            photon_noise = (relative(&discs.narrow, guide.iter().copied()) - noise).clamp(0.0, noise);
            if discs.alpha < 1.0 {
                // Radii that have shrunk meanwhile add noise.
                noise -= photon_noise * (1.0 - 1.0 / discs.area);
                photon_noise /= discs.area;
            }
            blur = discs.blurred(self.passes, guide) * discs.blur;
            alpha = discs.alpha;
        }
        let of_samples = noise - photon_noise + rare;
        if self.method == "sppm" {
            // What camera samples seldom meet, photons seldom bring.
            photon_noise = photon_noise.max(RARE_PHOTONS * rare);
        }
        // Samples of a pass see the same photons.
        let with = |samples: u64| {
            let noise = of_samples / samples as f64;
            let passes = match self.method {
                "sppm" => passes_to_goal(noise, photon_noise, off.max(blur), alpha),
                "photonmapper" if blur > MOST_BLUR * GOAL => f64::INFINITY,
                "photonmapper" => passes_to_goal(noise, photon_noise, blur, alpha),
                _ if off > LEAST_MISSING * GOAL || missing > LEAST_LIGHT => f64::INFINITY,
                _ => passes_to_goal(noise, photon_noise, blur, alpha),
            };
            let (work, preparation) = (self.work_of(samples), self.preparation);
            let noise = noise + photon_noise;
            Trial { method: self.method, samples, noise, photon_noise, blur, off, missing, work, preparation, passes }
        };
        if self.method != "sppm" {
            return with(self.samples);
        }
        let trials = SAMPLES_OF_A_PASS.map(with);
        trials.into_iter().min_by(|a, b| a.work_to_goal().total_cmp(&b.work_to_goal())).expect("there are some")
    }

    /// The work of a pass with so many samples of a pixel, in place of those that the render would take.
    fn work_of(&self, samples: u64) -> f64 {
        let seen = self.work - self.photon_work;
        self.photon_work + seen * samples as f64 / self.samples as f64
    }

    /// Share of the picture's light that the widest of `all` finds, and this does not, in blocks where it surely has more
    /// or where another that knows the block better has.
    fn missing(&self, all: &[Self]) -> f64 {
        let widest = all.last().expect("there are candidates");
        let others = all.iter().filter(|p| !std::ptr::eq(*p, self) && !p.common_factor);
        others.map(|other| self.missing_where(other, widest)).fold(0.0, f64::max)
    }

    /// Share of the picture's light that `widest` finds, and this does not, in blocks where `other` surely finds more.
    ///
    /// What photon maps find they also blur, so that they only say where to look.
    fn missing_where(&self, other: &Self, widest: &Self) -> f64 {
        let sum = |p: &Rgb| (0..3).map(|c| f64::from(p[c])).sum::<f64>();
        let sums = |p: &Self| p.means.pixels().iter().map(sum).zip(p.block_doubts()).collect::<Vec<_>>();
        let sure = if std::ptr::eq(other, widest) { SURE } else { SURE_TWICE };
        let (mut missing, mut doubts, mut all) = (0.0, 0.0, 0.0);
        for (((here, doubt), (there, other_doubt)), (wide, wide_doubt)) in
            sums(self).into_iter().zip(sums(other)).zip(sums(widest))
        {
            if there - here > sure * (doubt + other_doubt).sqrt() {
                missing += wide - here;
                doubts += doubt + wide_doubt;
            }
            all += wide;
        }
        if all > 0.0 && missing > SURE_TWICE * doubts.sqrt() { missing / all } else { 0.0 }
    }

    /// Variances of the blocks' means, channels summed up: of a block's pixels, as two passes tell little of a block, times what
    /// pixels that err together add to it in all blocks.
    fn block_doubts(&self) -> Vec<f64> {
        // Channels err together at worst.
        let sum = |v: &Rgb| (0..3).map(|c| f64::from(v[c]).sqrt()).sum::<f64>().powi(2);
        let (width, height) = (self.image.width(), self.image.height());
        let pixels = Image::from_fn(width, height, |x, y| self.noise[(y * width + x) as usize]);
        let samples = self.passes as f64 * f64::from(BLOCK_SIZE * BLOCK_SIZE);
        let apart: Vec<f64> = block_means(&pixels).pixels().iter().map(|v| sum(v) / samples).collect();
        let (together, total) = (self.variance.iter().map(sum).sum::<f64>(), apart.iter().sum::<f64>());
        let factor = if total > 0.0 { (together / total).max(1.0) } else { 1.0 };
        apart.into_iter().map(|v| v * factor).collect()
    }
}

/// The factor that brings `image` closest to `other`, by relative squares.
fn factor(image: &Image, other: &Image) -> f64 {
    let mut sums = (0.0, 0.0);
    for (a, b) in image.pixels().iter().zip(other.pixels()) {
        for (a, b) in [0, 1, 2].map(|c| (f64::from(a[c]), f64::from(b[c]))) {
            sums.0 += a * b / square(b as f32);
            sums.1 += a * a / square(b as f32);
        }
    }
    if sums.1 > 0.0 { sums.0 / sums.1 } else { 1.0 }
}

/// The mean of values from blocks, less two of its standard errors; at least 0.
fn above_noise(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (mean - 2.0 * (squares / (n * (n - 1.0).max(1.0))).sqrt()).max(0.0)
}

/// Passes until noise and blur together are below the goal.
///
/// The noise of camera samples falls with the passes. That of photons grows meanwhile with one over the area that they are
/// sought in, and what discs blur falls with their radius. The radius of the middle pass stands for all.
fn passes_to_goal(noise: f64, photon_noise: f64, blur: f64, alpha: f64) -> f64 {
    let error = |n: f64| {
        let area = radius_sq_ratio((n / 2.0) as u64, alpha);
        (noise + photon_noise / area) / n + blur * area.powf(BLUR)
    };
    let (mut low, mut high) = (1.0f64, 1e12f64);
    while high > 1.001 * low {
        let n = (low * high).sqrt();
        *(if error(n) > GOAL { &mut low } else { &mut high }) = n;
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{Key, Purpose, Sampler, Sequence};

    /// A method that finds light of 1 everywhere with one sample in `rarity`, and as much more in it.
    fn sparse(method: &'static str, rarity: f32, key: u64) -> Pilot {
        let (width, height, passes) = (96, 96, 3);
        let mut s = Sampler::new(Sequence::Independent, Key::new(3, Purpose::Test, key), 0);
        let mut noise = Vec::new();
        let image = Image::from_fn(width, height, |_, _| {
            let found = (0..passes).filter(|_| s.next_1d() < 1.0 / rarity).count() as f32;
            let mean = found / passes as f32;
            // The variance of one sample, as three tell it.
            noise.push(Rgb::splat(rarity * rarity * mean * (1.0 - mean) * passes as f32 / (passes as f32 - 1.0)));
            Rgb::splat(rarity * mean)
        });
        let (means, work) = (block_means(&image), 1.0);
        let variance = vec![Rgb::BLACK; means.pixels().len()];
        Pilot {
            method,
            passes,
            samples: 1,
            work,
            photon_work: 0.0,
            preparation: 0.0,
            rays: 0.0,
            common_factor: false,
            image,
            noise,
            means,
            variance,
            discs: None,
        }
    }

    /// The variance over the square is rarity − 1. Rare samples also make most of the picture that it is relative to, if that
    /// is taken over few pixels.
    #[test]
    fn rare_light_is_as_noisy_as_it_is() {
        for rarity in [2.0f32, 10.0, 50.0] {
            let pilots = [sparse("path", rarity, 1), sparse("sppm", 1.1, 2), sparse("vcm", rarity, 3)];
            let guide = Guide::new(&pilots);
            for (pilot, truth) in pilots.iter().zip([rarity - 1.0, 0.1, rarity - 1.0]) {
                let told = relative(&pilot.noise, guide.of(pilot.method).into_iter()) / f64::from(truth);
                assert!((0.8..1.3).contains(&told), "{} of {rarity}: {told} of the noise", pilot.method);
            }
        }
    }

    /// One sample in a thousand is 300 times as bright as the rest: a variance of 89 over the square of the rest, 53 over that of
    /// the mean, of which some 30 are told by 16 passes; relative to the 16 samples of such a pixel, it would be 0.25.
    /// An edge is little rare light, once there are passes enough to see it: a tenth of each pixel in every eighth column is a
    /// hundred times as bright, 7.4 over the square of that pixel and 0.9 on the average; what varies in the squares doubles it.
    /// In even light nothing is rare: a third of the square.
    #[test]
    fn rare_samples_are_not_what_they_are_relative_to() {
        let (width, height) = (96, 96);
        let mut s = Sampler::new(Sequence::Independent, Key::new(3, Purpose::Test, 0), 0);
        let mut passes = |n: usize, f: &dyn Fn(u32, f32) -> f32| -> Vec<Image> {
            (0..n).map(|_| Image::from_fn(width, height, |x, _| Rgb::splat(f(x, s.next_1d())))).collect()
        };
        let even = Image::from_fn(width, height, |_, _| Rgb::splat(1.0));
        let least = |passes: Vec<Image>| {
            let (noise, doubt) = noise_with_rare(&passes, &even);
            noise - doubt
        };
        let told = least(passes(16, &|_, u| if u < 1e-3 { 300.0 } else { 1.0 }));
        assert!((20.0..45.0).contains(&told), "{told}");
        let edges = |x: u32, u: f32| if x.is_multiple_of(8) && u < 0.1 { 100.0 } else { 1.0 };
        let told = least(passes(48, &edges));
        assert!((0.9..2.5).contains(&told), "{told}");
        let ordinary = least(passes(4, &|_, u| 2.0 * u));
        assert!((0.2..0.4).contains(&ordinary), "{ordinary}");
    }

    /// Camera samples alone need noise over goal; photons alone N^(1 − α) times as many, less what the middle radius stands
    /// for; blur alone what shrinks its radius.
    #[test]
    fn passes_follow_what_the_error_is_of() {
        let goal = |noise, photons, blur| passes_to_goal(noise, photons, blur, 2.0 / 3.0);
        assert!((goal(0.5, 0.0, 0.0) / 50.0 - 1.0).abs() < 0.01);
        // Σ 1/area over N² is 3/4 Γ(5/3) N^(−2/3).
        let photons = (0.5 * 0.75 * 0.9027 / GOAL).powf(1.5);
        assert!((goal(0.0, 0.5, 0.0) / photons - 1.0).abs() < 0.2, "{}", goal(0.0, 0.5, 0.0));
        assert!(goal(0.2, 0.3, 0.0) > goal(0.5, 0.0, 0.0) && goal(0.2, 0.3, 0.0) < goal(0.0, 0.5, 0.0));
        let blurred = goal(1e-6, 0.0, 0.05);
        assert!((radius_sq_ratio((blurred / 2.0) as u64, 2.0 / 3.0).powf(BLUR) * 0.05 / GOAL - 1.0).abs() < 0.05);
        assert_eq!(goal(1e-9, 0.0, 0.0).round(), 1.0);
    }

    /// A picture that is too bright everywhere has no light missing; one that is dark in places has.
    #[test]
    fn a_common_factor_is_found() {
        let shades = |f: fn(u32) -> f32| Image::from_fn(8, 8, |x, y| Rgb::splat(f(x) * (1.0 + y as f32)));
        let truth = shades(|_| 1.0);
        assert!((factor(&shades(|_| 1.25), &truth) - 0.8).abs() < 1e-6);
        assert!((factor(&shades(|x| (x % 2) as f32), &truth) - 1.0).abs() < 1e-2);
        assert!((factor(&shades(|_| 0.0), &truth) - 1.0).abs() < 1e-6);
    }
}
