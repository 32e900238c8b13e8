//! The area that a density estimate divides by, other than the disc of the sphere that its photons are found in.

use super::bins::Bins;
use crate::color::Rgb;
use crate::math::{DVec2, Frame, Vec3};
use crate::photon::{Kernel, Neighbours, PhotonMap, convex_hull};

/// What to do about photons that a disc on the surface does not describe; nothing unless asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AreaSettings {
    /// Leave out photons further from the tangent plane than this share of the radius: a flattened disc in place of the
    /// sphere, which keeps the light of one step of a stair off the next [Jensen 2001, §7.2].
    pub disc_height: Option<f32>,
    /// Divide by the area of the photons' convex hull: estimates at borders and in corners do not darken.
    pub convex_hull: bool,
    /// Halve the number of photons until they are spread evenly, or are too few to tell [Lin et al. 2020].
    pub even: bool,
}

/// A photon seen from the point of the estimate.
struct Near {
    index: u32,
    d_sq: f32,
    /// In the tangent plane.
    at: DVec2,
    /// Above it.
    height: f32,
}

/// `Σ term·K` over photons that were `found` around `p` on a surface with normal `ng`, and the squared radius.
pub(super) fn sum(
    settings: &AreaSettings,
    (map, found): (&PhotonMap, &Neighbours),
    (p, ng): (Vec3, Vec3),
    kernel: Kernel,
    term: impl Fn(u32) -> Rgb,
) -> (Rgb, f32) {
    let frame = Frame::from_normal(ng);
    // The k-th photon only sets the radius.
    let rim = if found.full { found.radius_sq } else { f32::INFINITY };
    let near = |(index, d_sq): (u32, f32)| {
        let d = frame.to_local(map.position(index) - p);
        Near { index, d_sq, at: DVec2::new(d.x.into(), d.y.into()), height: d.z.abs() }
    };
    let mut photons: Vec<Near> = found.iter().filter(|&(_, d_sq)| d_sq < rim).map(near).collect();
    let mut radius_sq = found.radius_sq;
    flatten(&mut photons, settings, radius_sq);
    if settings.even {
        photons.sort_unstable_by(|a, b| a.d_sq.total_cmp(&b.d_sq).then(a.index.cmp(&b.index)));
        while count(&photons, radius_sq).uneven() {
            // Now the next photon sets the radius.
            let half = photons.len() / 2;
            radius_sq = photons[half].d_sq;
            photons.truncate(half);
            flatten(&mut photons, settings, radius_sq);
        }
    }
    let sum = match settings.convex_hull.then(|| over_hull(&photons, &term)).flatten() {
        Some(sum) => sum,
        None => photons.iter().map(|n| term(n.index) * kernel.weight(n.d_sq, radius_sq)).sum(),
    };
    (sum, radius_sq)
}

/// Leaves out what is too far from the tangent plane.
fn flatten(photons: &mut Vec<Near>, settings: &AreaSettings, radius_sq: f32) {
    if let Some(height) = settings.disc_height {
        let limit = height * radius_sq.sqrt();
        photons.retain(|n| n.height <= limit);
    }
}

/// How the photons lie in the disc.
fn count(photons: &[Near], radius_sq: f32) -> Bins {
    let mut bins = Bins::default();
    for n in photons {
        bins.count((n.at.x < 0.0, n.at.y < 0.0), n.d_sq, radius_sq);
    }
    bins
}

/// The sum over the photons inside their convex hull, divided by its area; `None` where it has none.
///
/// Given the hull, those inside are uniform in it, and its own vertices are not: leaving them out makes the estimate exact
/// on average in uniform light, as leaving out the k-th photon does for discs.
fn over_hull(photons: &[Near], term: &impl Fn(u32) -> Rgb) -> Option<Rgb> {
    let at: Vec<DVec2> = photons.iter().map(|n| n.at).collect();
    let hull = convex_hull(&at);
    if hull.area <= 0.0 {
        return None;
    }
    let all: Rgb = photons.iter().map(|n| term(n.index)).sum();
    let rim: Rgb = hull.vertices.iter().map(|&i| term(photons[i as usize].index)).sum();
    Some((all - rim).map(|v| v.max(0.0)) * (1.0 / hull.area) as f32)
}

#[cfg(test)]
mod tests {
    use super::super::photons::Lookup;
    use super::*;
    use crate::photon::{KnnScratch, Photon, PhotonClass, PhotonRecord};
    use crate::sample::mix64;

    fn uniform(i: u64) -> f32 {
        (mix64(i) >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Photons of one watt each on z = 0, over 0 < x < 2 and |y| < 1.
    fn sheet(seed: u64, photons: u64, place: impl Fn(Vec3) -> Vec3) -> Vec<Photon> {
        let record = |i: u64| {
            let n = (seed << 32) | (2 * i);
            let p = place(Vec3::new(2.0 * uniform(n), 2.0 * uniform(n + 1) - 1.0, 0.0));
            let (power, class) = (Rgb::splat(1.0), PhotonClass::Global);
            PhotonRecord { p, power, wi: Vec3::Z, side: true, normal: Vec3::Z, class, mark: false }
        };
        (0..photons).map(|i| Photon::pack(&record(i), i).expect("a storable photon")).collect()
    }

    fn lookup(photons: Vec<Photon>, size: u32, area: AreaSettings) -> Lookup {
        Lookup::new(PhotonMap::build(photons), size, 0.5, Kernel::Disc).expect("photons").with_area(area)
    }

    /// Mean estimate at `p` over sheets of `photons` photons, relative to `truth`, and the mean squared radius.
    fn estimate(area: AreaSettings, photons: u64, size: u32, p: Vec3, place: impl Fn(Vec3) -> Vec3) -> (f64, f64) {
        let mut scratch = KnnScratch::new();
        let (mut sum, mut radius) = (0.0, 0.0);
        for seed in 0..SEEDS {
            let map = lookup(sheet(seed, photons, &place), size, area);
            let (e, radius_sq) = map.irradiance(p, Vec3::Z, true, &mut scratch).expect("photons");
            sum += f64::from(e.g);
            radius += f64::from(radius_sq);
        }
        (sum / SEEDS as f64, radius / SEEDS as f64)
    }

    const SEEDS: u64 = 100;
    const PLAIN: AreaSettings = AreaSettings { disc_height: None, convex_hull: false, even: false };
    const DISC: AreaSettings = AreaSettings { disc_height: Some(0.2), ..PLAIN };
    const HULL: AreaSettings = AreaSettings { convex_hull: true, ..PLAIN };
    const EVEN: AreaSettings = AreaSettings { even: true, ..PLAIN };

    /// 2000 photons on 4 units of area: 500 per unit. With 80 photons an estimate has a relative σ of 0.113, the mean of
    /// 100 of them 1.1 %; 4 of these. Counting the hull's own vertices would be off by about 15 %.
    #[test]
    fn no_option_changes_uniform_light() {
        let middle = Vec3::new(1.0, 0.0, 0.0);
        for area in [PLAIN, DISC, HULL, AreaSettings { disc_height: Some(0.2), ..HULL }] {
            let (mean, _) = estimate(area, 2000, 80, middle, |p| p);
            assert!((mean / 500.0 - 1.0).abs() < 0.045, "{area:?}: {mean}");
        }
        // The test for evenness errs in one estimate of a hundred: its radius hardly changes, nor does the mean.
        let (mean, radius_sq) = estimate(EVEN, 2000, 80, middle, |p| p);
        let whole = 80.0 / (std::f64::consts::PI * 500.0);
        assert!((mean / 500.0 - 1.0).abs() < 0.045, "{mean}");
        assert!((radius_sq / whole - 1.0).abs() < 0.05, "{radius_sq}, not {whole}");
    }

    /// On the border half of the disc is empty, in the corner three quarters.
    #[test]
    fn a_hull_does_not_darken_borders_and_corners() {
        for (p, share) in [(Vec3::ZERO, 0.5), (Vec3::new(0.0, 1.0, 0.0), 0.25)] {
            let (plain, _) = estimate(PLAIN, 2000, 80, p, |p| p);
            assert!((plain / 500.0 - share).abs() < 0.03, "{plain} of 500 by the disc");
            let (hull, _) = estimate(HULL, 2000, 80, p, |p| p);
            assert!((hull / 500.0 - 1.0).abs() < 0.04, "{hull} of 500 by the hull");
        }
    }

    /// Every second photon lies on a step that is higher by half a radius.
    #[test]
    fn a_flattened_disc_keeps_steps_apart() {
        let middle = Vec3::new(1.0, 0.0, 0.0);
        let step = |p: Vec3| if ((p.x * 4096.0) as u32).is_multiple_of(2) { p } else { p + 0.12 * Vec3::Z };
        let (plain, radius_sq) = estimate(PLAIN, 2000, 80, middle, step);
        assert!(radius_sq.sqrt() > 0.2 && radius_sq.sqrt() < 0.3, "radius² {radius_sq}");
        assert!(plain > 1.5 * 250.0, "{plain}");
        let (disc, _) = estimate(DISC, 2000, 80, middle, step);
        // Discs of two heights are not one of uniform density: the radius is chosen by both. 10 % is what that may cost.
        assert!((disc / 250.0 - 1.0).abs() < 0.1, "{disc}, not 250");
    }

    /// Density falls to a quarter at x = 1. Just beyond it, the wide estimate takes half of the bright side.
    #[test]
    fn uneven_photons_narrow_the_estimate() {
        // Bright side: 4/5 of the photons on half of the area.
        let squeeze = |p: Vec3| {
            let u = 0.5 * p.x;
            Vec3::new(if u < 0.8 { u / 0.8 } else { 1.0 + (u - 0.8) / 0.2 }, p.y, 0.0)
        };
        let (p, truth) = (Vec3::new(1.12, 0.0, 0.0), 10_000.0 * 0.2 / 2.0);
        let (plain, wide) = estimate(PLAIN, 10_000, 400, p, squeeze);
        let (even, narrow) = estimate(EVEN, 10_000, 400, p, squeeze);
        assert!(plain > 1.4 * truth, "{plain}, not {truth}, without the test");
        assert!(narrow < 0.5 * wide && (even - truth).abs() < 0.4 * (plain - truth), "{even}: {narrow} of {wide}");
    }
}
