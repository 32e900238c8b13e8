//! The merging radius: its schedule over passes and a first value that fits the picture.

use super::Recipe;
use crate::bsdf::{LobeMask, Mode};
use crate::math::{Vec2, Vec3};
use crate::sample::{Key, Purpose, Sampler, Sequence};
use crate::scene::Scene;

/// Pilot rays along each side of the film.
const PILOT: u32 = 32;

/// The first radius in widths of a pixel where it meets a diffuse surface.
const FOOTPRINTS: f32 = 2.0;

/// The first radius as a share of the scene's where no camera ray meets anything, as in SmallVCM.
const FALLBACK: f32 = 0.003;

/// `ln Γ(b+d) − ln Γ(b)` for large `b` and small `d`, by Stirling's series; the logarithms are subtracted before they are
/// multiplied, so that nothing cancels.
fn ln_gamma_difference(b: f64, d: f64) -> f64 {
    let a = b + d;
    let tail = |x: f64| (1.0 / 12.0 - (1.0 / 360.0 - 1.0 / (1260.0 * x * x)) / (x * x)) / x;
    (a - 0.5) * (d / b).ln_1p() + d * b.ln() - d + tail(a) - tail(b)
}

/// Squared radius of pass `pass` (from 1) over that of the first: `Γ(i+α) / (Γ(1+α) Γ(i+1))`, the closed form of
/// `r²ᵢ₊₁ = r²ᵢ (i+α)/(i+1)` [Knaus and Zwicker 2011, eq. 20].
pub fn radius_sq_ratio(pass: u64, alpha: f64) -> f64 {
    const SMALL: u64 = 64;
    let product: f64 = (1..pass.min(SMALL)).map(|i| (i as f64 + alpha) / (i as f64 + 1.0)).product();
    if pass <= SMALL {
        return product;
    }
    // Continue from the product by the ratio of gamma functions.
    let ln = |i: u64| ln_gamma_difference(i as f64 + 1.0, alpha - 1.0);
    product * (ln(pass) - ln(SMALL)).exp()
}

/// A first radius (scene units) that fits the picture, whatever the unit of the scene: twice the median width of a pixel
/// on the first surfaces that photons are merged on, mirrors and glass passed.
pub fn automatic_radius(scene: &Scene) -> f32 {
    let (ox, oy) = scene.camera.window().crop_offset;
    let (w, h) = scene.camera.window().crop_size;
    let key = Key::new(0, Purpose::Pilot, Purpose::LightPath as u64);
    let mut widths: Vec<f32> = (0..PILOT * PILOT)
        .filter_map(|i| {
            let cell = Vec2::new((i % PILOT) as f32, (i / PILOT) as f32) + 0.5;
            let at = Vec2::new(ox as f32, oy as f32) + cell / PILOT as f32 * Vec2::new(w as f32, h as f32);
            footprint(scene, at, Sampler::new(Sequence::Independent, key, i as u64))
        })
        .collect();
    widths.sort_unstable_by(f32::total_cmp);
    match widths.get(widths.len() / 2) {
        Some(&median) => FOOTPRINTS * median,
        None => FALLBACK * scene.bounding_sphere().1,
    }
}

/// Width of a pixel at the first wide surface seen through film position `at`.
fn footprint(scene: &Scene, at: Vec2, mut sampler: Sampler) -> Option<f32> {
    const MOST_BOUNCES: u32 = 16;
    let start = scene.camera_ray(at, Vec2::splat(0.5));
    let (mut ray, mut from, mut length) = (start.ray, start.lens, 0.0);
    for _ in 0..MOST_BOUNCES {
        let si = scene.intersect(&mut ray)?;
        length += Vec3::distance(si.p, from);
        let bsdf = scene.bsdf(&si);
        if bsdf.lobes().intersects(LobeMask::SMOOTH_WIDE) {
            let area = if scene.camera.is_orthographic() { 1.0 / start.pdf_a } else { length * length / start.pdf_w };
            return (area > 0.0 && area.is_finite()).then(|| area.sqrt());
        }
        let (u_lobe, u) = (sampler.next_1d(), sampler.next_2d());
        let s = bsdf.sample(si.wo, u_lobe, u, Mode::Radiance, LobeMask::ALL)?;
        from = si.p;
        ray = si.spawn_ray(s.wi);
    }
    None
}

impl Recipe<'_> {
    /// The merging radius of pass `pass` (from 0), scene units.
    pub fn radius(&self, pass: u64) -> f64 {
        self.first_radius * radius_sq_ratio(pass + 1, self.settings.alpha).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrator::VcmSettings;

    #[test]
    fn the_schedule_is_its_closed_form() {
        // Step by step; the running product is good to about its number of roundings.
        for alpha in [0.5, 2.0 / 3.0, 0.7, 0.75] {
            let mut ratio = 1.0;
            for i in 1..=20_000u64 {
                if [1, 10, 63, 64, 65, 100, 1000, 20_000].contains(&i) {
                    let closed = radius_sq_ratio(i, alpha);
                    assert!((closed / ratio - 1.0).abs() < 1e-11, "pass {i}, alpha {alpha}: {closed} for {ratio}");
                }
                ratio *= (i as f64 + alpha) / (i as f64 + 1.0);
            }
        }
    }

    #[test]
    fn the_schedule_has_the_published_values() {
        let cases =
            [(2.0 / 3.0, [0.7131, 0.4883, 0.3328]), (0.7, [0.7388, 0.5255, 0.3722]), (0.75, [0.7786, 0.5863, 0.4399])];
        for (alpha, radii) in cases {
            for (pass, r) in [10, 100, 1000].into_iter().zip(radii) {
                assert!((radius_sq_ratio(pass, alpha).sqrt() - r).abs() < 6e-5, "pass {pass}, alpha {alpha}");
            }
        }
    }

    #[test]
    fn radius_scale_multiplies_the_radius_that_was_fitted() {
        let text = r#"<scene version="3.0.0"><sensor type="perspective"><film type="hdrfilm"><integer name="width" value="16"/>
            <integer name="height" value="16"/></film></sensor><shape type="rectangle"><transform name="to_world">
            <translate z="3"/></transform><bsdf type="twosided"><bsdf type="plastic"/></bsdf></shape>
            <shape type="sphere"><point name="center" x="0" y="0" z="5"/><bsdf type="dielectric"/></shape></scene>"#;
        let scene = Scene::from_text(text, std::path::Path::new("test.xml"), &Default::default()).expect("a scene");
        let radius = |s| Recipe::new(&scene, &VcmSettings { radius_scale: s, ..VcmSettings::default() }).first_radius;
        assert!(radius(1.0) > 0.0 && radius(0.25) == 0.25 * radius(1.0));
    }
}
