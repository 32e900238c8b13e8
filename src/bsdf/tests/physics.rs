use super::cases::{self, conductor, diffuse, glass, id, rough, rough_conductor, rough_glass, white};
use super::*;
use crate::color::Rgb;
use crate::sample::warp;

const MODES: [Mode; 2] = [Mode::Radiance, Mode::Importance];

fn angles(both_sides: bool) -> Vec<Vec3> {
    let front = [(0.0, 0.0), (20.0, 1.0), (55.0, 2.5), (80.0, 4.0), (89.0, 5.5)].map(|(d, a)| at_angle(d, a));
    let back = front.map(|w| -w);
    if both_sides { [front, back].concat() } else { front.to_vec() }
}

fn relative(a: f32, b: f32) -> f32 {
    (a - b).abs() / a.abs().max(b.abs()).max(1e-6)
}

/// The sample's weight is eval/pdf and its density is `pdf`, for smooth lobes.
#[test]
fn weights_are_eval_over_pdf() {
    for case in cases::all() {
        for wo in angles(case.both_sides) {
            let (si, _) = point(wo, case.bend);
            let bsdf = bsdf_at(&case.materials, &si);
            for mode in MODES {
                let mut worst = 0.0f32;
                for i in 0..2000 {
                    let mut s = stream(7, i);
                    let Some(x) = bsdf.sample(si.wo, s.next_1d(), s.next_2d(), mode, LobeMask::ALL) else { continue };
                    assert!(x.wi.is_normalized() && x.weight.is_finite() && x.pdf.is_finite() && x.pdf > 0.0);
                    assert_eq!(x.transmit, x.wi.dot(si.ng) * si.wo.dot(si.ng) < 0.0, "{}", case.name);
                    if !x.lobe.intersects(LobeMask::SMOOTH) {
                        continue;
                    }
                    let f = bsdf.eval(si.wo, x.wi, mode, LobeMask::ALL);
                    let pdf = bsdf.pdf(si.wo, x.wi, mode, LobeMask::ALL);
                    let (both, there, back) = bsdf.eval_with_pdfs(si.wo, x.wi, mode);
                    let alone = [f[0], f[1], f[2], pdf, bsdf.pdf(x.wi, si.wo, mode, LobeMask::ALL)];
                    for (a, b) in alone.into_iter().zip([both[0], both[1], both[2], there, back]) {
                        assert!(relative(a, b) < 1e-5, "{}: {a} alone, {b} together", case.name);
                    }
                    // Rounding of wi moves narrow lobes by 1e-7/alpha, and grazing cosines by 1e-7/cos.
                    let slack = 1e-3 + 3e-7 / x.wi.dot(si.ns).abs();
                    worst = worst.max(relative(pdf, x.pdf) / slack);
                    for c in 0..3 {
                        worst = worst.max(relative(f[c] / pdf, x.weight[c]) / slack);
                    }
                }
                assert!(worst < 3.0, "{} from {wo} {mode:?}: {worst}", case.name);
            }
        }
    }
}

/// What goes back is never more than what came, and the estimate of it is exact where it is said to be.
#[test]
fn white_furnace_gains_nothing() {
    const N: u64 = 20_000;
    for case in cases::all().into_iter().filter(|c| c.white) {
        for wo in angles(case.both_sides) {
            let (si, _) = point(wo, case.bend);
            let bsdf = bsdf_at(&case.materials, &si);
            let (mut sum, mut sum_sq) = (0.0f64, 0.0f64);
            for i in 0..N {
                let mut s = Sampler::new(Sequence::Sobol, Key::new(11, Purpose::Test, 0), i);
                // Power is conserved; radiance is not, across a refraction.
                if let Some(x) = bsdf.sample(si.wo, s.next_1d(), s.next_2d(), Mode::Importance, LobeMask::ALL) {
                    let w = x.weight.max_channel() as f64;
                    sum += w;
                    sum_sq += w * w;
                }
            }
            let mean = sum / N as f64;
            let error = ((sum_sq / N as f64 - mean * mean).max(0.0) / N as f64).sqrt();
            assert!(mean < 1.0 + 4.0 * error + 1e-5, "{} from {wo}: albedo {mean} ± {error}", case.name);
            let smooth_only = bsdf.lobes() & !(LobeMask::DIFFUSE | LobeMask::DELTA | LobeMask::NULL);
            if smooth_only.is_empty() {
                let estimate = bsdf.albedo(si.wo, LobeMask::ALL).max_channel() as f64;
                assert!((mean - estimate).abs() < 4.0 * error + 2e-3, "{} from {wo}: {mean}, {estimate}", case.name);
            }
        }
    }
}

/// Lossless materials lose nothing.
#[test]
fn lossless_materials_have_albedo_one() {
    let plastic = Material::plastic(1.49, 1.0, white(), white(), true);
    let thin = Material::ThinDielectric { ior: Ior::new(1.5, 1.0), reflectance: white(), transmittance: white() };
    for m in [plastic, thin, glass(1.5), glass(1.000001), glass(1000.0), conductor("none"), diffuse(white())] {
        for wo in angles(false) {
            let (si, _) = point(wo, 0.0);
            let albedo = bsdf_at(std::slice::from_ref(&m), &si).albedo(si.wo, LobeMask::ALL);
            assert!((albedo - Rgb::WHITE).max_channel().abs() < 2e-5, "{m:?} {wo} {albedo:?}");
        }
    }
}

/// A walk from the camera and one from the light see the same material [Veach 1997, §5.3]:
/// `f(a,b)/|b·ng|` of the one is `f*(b,a)/|a·ng|` of the other, with refraction and shading normals.
#[test]
fn radiance_and_importance_are_adjoint() {
    for case in cases::all() {
        let mut compared = 0;
        for i in 0..4000 {
            let mut s = stream(21, i);
            let mut a = warp::uniform_sphere(s.next_2d());
            if !case.both_sides {
                a.z = a.z.abs();
            }
            let (si, _) = point(a, case.bend);
            let bsdf = bsdf_at(&case.materials, &si);
            // Half of the partners where the lobes are.
            let b = match bsdf.sample(si.wo, s.next_1d(), s.next_2d(), Mode::Radiance, LobeMask::SMOOTH) {
                Some(x) if i % 2 == 0 => x.wi,
                _ => warp::uniform_sphere(s.next_2d()),
            };
            let ng = si.ng;
            let forward = bsdf.eval(si.wo, b, Mode::Radiance, LobeMask::ALL) / b.dot(ng).abs();
            let backward = bsdf.eval(b, si.wo, Mode::Importance, LobeMask::ALL) / si.wo.dot(ng).abs();
            for c in 0..3 {
                assert!(
                    relative(forward[c], backward[c]) < 5e-3 || (forward[c] - backward[c]).abs() < 1e-5,
                    "{}: {a} → {b}: {forward:?} {backward:?}",
                    case.name
                );
                compared += (forward[c] > 0.0) as u32;
            }
        }
        let first = bsdf_at(&case.materials, &point(at_angle(10.0, 0.0), case.bend).0);
        assert!(compared > 500 || !first.lobes().intersects(LobeMask::SMOOTH), "{}: {compared}", case.name);
    }
}

/// Refraction scales radiance by 1/η² and power not at all.
#[test]
fn refraction_scales_radiance_only() {
    for (wo, eta) in [(at_angle(40.0, 1.0), 1.5f32), (-at_angle(20.0, 1.0), 1.0 / 1.5)] {
        for m in [glass(1.5), rough_glass(rough(Distribution::Ggx, 0.01, 0.01), 1.5)] {
            let (si, _) = point(wo, 0.0);
            let bsdf = bsdf_at(std::slice::from_ref(&m), &si);
            let mut seen = 0;
            for i in 0..50 {
                let mut s = stream(3, i);
                let (l, u) = (s.next_1d(), s.next_2d());
                let sample = |mode| bsdf.sample(si.wo, l, u, mode, LobeMask::ALL);
                let (Some(r), Some(p)) = (sample(Mode::Radiance), sample(Mode::Importance)) else { continue };
                let ratio = if r.transmit { 1.0 / (eta * eta) } else { 1.0 };
                assert!(relative(r.weight.g, p.weight.g * ratio) < 1e-5);
                assert!(relative(r.eta, if r.transmit { eta } else { 1.0 }) < 1e-6);
                seen += r.transmit as u32;
            }
            assert!(seen > 20);
        }
    }
}

/// Snell's law, and the exact directions of reflection and of no refraction at all.
#[test]
fn smooth_directions_are_exact() {
    for (n, side) in [(1.5, 1.0), (1.5, -1.0), (1.000001, 1.0), (2.42, 1.0), (1.0, 1.0)] {
        for degrees in [0.0f32, 10.0, 35.0, 60.0, 89.0] {
            let (si, frame) = point(at_angle(degrees, 2.0) * side, 0.0);
            let wo = frame.to_local(si.wo);
            let bsdf = bsdf_at(&[glass(n)], &si);
            for l in [0.0, 0.999] {
                let Some(s) = bsdf.sample(si.wo, l, Vec2::ZERO, Mode::Radiance, LobeMask::ALL) else { continue };
                let wi = frame.to_local(s.wi);
                let across = Vec2::new(wo.x, wo.y) + s.eta * Vec2::new(wi.x, wi.y);
                assert!(across.length() < 1e-6, "{n} {degrees} {across}");
                assert!(s.wi.is_normalized());
                if n == 1.0 {
                    assert!(s.transmit && (s.wi + si.wo).length() < 2e-7, "{s:?}");
                }
            }
        }
    }
}

/// Transmittance of a lossless slab of n = 1.5: (1−R)/(1+R).
#[test]
fn thin_plate_transmits_like_a_slab() {
    let m = Material::ThinDielectric { ior: Ior::new(1.5, 1.0), reflectance: white(), transmittance: white() };
    for (degrees, t) in
        [(0.0, 0.923077), (30.0, 0.920266), (45.0, 0.904327), (60.0, 0.836232), (80.0, 0.441229), (89.0, 0.050318)]
    {
        let (si, _) = point(at_angle(degrees, 1.0), 0.0);
        let bsdf = bsdf_at(std::slice::from_ref(&m), &si);
        let got = bsdf.transmittance(si.wo).g;
        assert!((got - t).abs() < 3e-6, "{degrees}: {got}");
        let s = bsdf.sample(si.wo, 0.99, Vec2::ZERO, Mode::Radiance, LobeMask::NULL).expect("goes through");
        assert!(s.wi == -si.wo && s.lobe == LobeMask::NULL && relative(s.weight.g, t) < 1e-5);
    }
}

/// One-sided materials are black behind, two-sided ones show the side they are seen from, masks and blends weigh.
#[test]
fn sides_masks_and_blends_mean_what_they_say() {
    let (front, _) = point(at_angle(30.0, 0.0), 0.0);
    let (back, _) = point(-at_angle(30.0, 0.0), 0.0);
    let rho = |v: f32| diffuse(Rgb::splat(v).into());
    for case in cases::reflective() {
        let bsdf = bsdf_at(&case.materials, &back);
        assert!(matches!(bsdf, Bsdf::Black) && bsdf.lobes().is_empty(), "{}", case.name);
    }
    let two = [rho(0.2), rho(0.7), Material::TwoSided { front: id(0), back: id(1) }];
    assert_eq!(bsdf_at(&two, &front).albedo(front.wo, LobeMask::ALL).r, 0.2);
    assert_eq!(bsdf_at(&two, &back).albedo(back.wo, LobeMask::ALL).r, 0.7);
    assert!(matches!(bsdf_at(&two, &back), Bsdf::Diffuse(_)));

    let mask = [rho(0.8), Material::Mask { opacity: 0.25.into(), nested: id(0) }];
    let bsdf = bsdf_at(&mask, &front);
    assert_eq!(bsdf.lobes(), LobeMask::DIFFUSE | LobeMask::NULL);
    assert!(relative(bsdf.transmittance(front.wo).r, 0.75) < 1e-6);
    assert!(relative(bsdf.albedo(front.wo, LobeMask::DIFFUSE).r, 0.2) < 1e-6);
    assert_eq!(bsdf_at(&mask, &back).lobes(), LobeMask::NULL);

    let blend = [rho(0.8), rho(0.4), Material::Blend { weight: 0.25.into(), first: id(0), second: id(1) }];
    assert!(relative(bsdf_at(&blend, &front).albedo(front.wo, LobeMask::ALL).r, 0.7) < 1e-6);
}

/// A height field of slope tan θ tilts the normal by θ, on both sides of a two-sided surface, whatever the uv scale.
#[test]
fn bump_maps_tilt_normals() {
    use crate::image::Image;
    use crate::texture::{Bitmap, BitmapSettings, FloatParam, Texture};
    // Height u in uv; dp/du has length 2, so the slope is scale/2.
    let ramp = Image::rgb(64, 1, (0..64).map(|x| Rgb::splat((x as f32 + 0.5) / 64.0)).collect());
    let mut textures = Textures::default();
    let height = FloatParam::Texture(textures.add(Texture::Bitmap(Bitmap::new(&ramp, BitmapSettings::default()))));
    let materials = [
        conductor("none"),
        Material::BumpMap { height, scale: 0.6, nested: id(0) },
        Material::TwoSided { front: id(1), back: id(1) },
    ];
    let slope = 0.3f32;
    let expected = Vec3::new(-slope, 0.0, 1.0).normalize();
    for side in [1.0f32, -1.0] {
        let (mut si, _) = point(Vec3::Z, 0.0);
        (si.ng, si.ns, si.dpdu, si.dpdv) = (Vec3::Z, Vec3::Z, Vec3::X * 2.0, Vec3::Y * 0.7);
        si.uv = Vec2::new(0.4, 0.5);
        si.wo = at_angle(20.0, 1.0) * Vec3::new(1.0, 1.0, side);
        let bsdf = evaluate(&materials, &textures, id(2), &si, &GeometrySet::default(), None);
        let s = bsdf.sample(si.wo, 0.5, Vec2::ZERO, Mode::Radiance, LobeMask::ALL).expect("reflects");
        let n = expected * Vec3::new(1.0, 1.0, side);
        let mirrored = 2.0 * si.wo.dot(n) * n - si.wo;
        assert!((s.wi - mirrored).length() < 1e-4, "{side} {} {mirrored}", s.wi);
        // Shadowing: tan²θ/8 as squared roughness.
        let tan_sq = (1.0 - s.wi.z * s.wi.z) / (s.wi.z * s.wi.z);
        let shadow = 2.0 / (1.0 + (1.0 + slope * slope / 8.0 * tan_sq).sqrt());
        assert!((s.weight.g - shadow).abs() < 1e-4);
    }
}

/// Light does not get through a surface because its shading normal is tilted.
#[test]
fn shading_normals_do_not_leak() {
    for case in cases::all().into_iter().filter(|c| !c.both_sides) {
        for i in 0..2000 {
            let mut s = stream(5, i);
            let mut wo = warp::uniform_sphere(s.next_2d());
            wo.z = wo.z.abs();
            let (si, _) = point(wo, 0.6);
            let bsdf = bsdf_at(&case.materials, &si);
            if let Some(x) = bsdf.sample(si.wo, s.next_1d(), s.next_2d(), Mode::Radiance, !LobeMask::NULL) {
                assert!(x.wi.dot(si.ng) * si.wo.dot(si.ng) > 0.0, "{}", case.name);
            }
            let wi = warp::uniform_sphere(s.next_2d());
            if wi.dot(si.ng) * si.wo.dot(si.ng) <= 0.0 {
                assert!(bsdf.eval(si.wo, wi, Mode::Radiance, LobeMask::ALL).is_black(), "{}", case.name);
            }
        }
    }
}

/// Roughness chooses the class: 0 and 1e-7 are delta, then sharp, then glossy, of which some are narrow.
#[test]
fn roughness_chooses_the_class() {
    let (si, _) = point(at_angle(30.0, 0.0), 0.0);
    for d in [Distribution::Beckmann, Distribution::Ggx] {
        for (alpha, class) in [
            (0.0, LobeMask::DELTA),
            (1e-7, LobeMask::DELTA),
            (2e-4, LobeMask::SHARP),
            (0.05, LobeMask::SHARP),
            (0.07, LobeMask::NARROW),
            (0.39, LobeMask::NARROW),
            (0.41, LobeMask::GLOSSY & !LobeMask::NARROW),
            (1.0, LobeMask::GLOSSY & !LobeMask::NARROW),
        ] {
            let r = rough(d, alpha, alpha);
            assert_eq!(bsdf_at(&[rough_conductor(r, "Au")], &si).lobes(), class);
            assert_eq!(bsdf_at(&[rough_glass(r, 1.5)], &si).lobes(), class);
            let plastic = Material::rough_plastic((d, alpha), (1.5, 1.0), white(), white(), false);
            assert_eq!(bsdf_at(&[plastic], &si).lobes(), class | LobeMask::DIFFUSE);
            // Nothing to refract at: there is no rough lobe either.
            assert_eq!(bsdf_at(&[rough_glass(r, 1.0)], &si).lobes(), LobeMask::DELTA);
        }
    }
}

/// Directions and parameters at the edge of what there is: everything stays finite and not negative.
#[test]
fn nothing_is_ever_not_a_number() {
    let mut materials: Vec<Vec<Material>> = cases::all().into_iter().map(|c| c.materials).collect();
    for d in [Distribution::Beckmann, Distribution::Ggx] {
        for alpha in [0.0, 1e-7, 1e-4, 1e-3, 1.0, 5.0] {
            for n in [1.0, 1.000001, 1.0003, 1.5, 1000.0, 0.001] {
                materials.push(vec![rough_glass(rough(d, alpha, alpha), n)]);
            }
            materials.push(vec![rough_conductor(rough(d, alpha, 0.5), "Au")]);
        }
    }
    let z = [1.0f32, 0.3, 1e-3, 1e-6, 1e-20, 0.0];
    let mut directions = Vec::new();
    for z in z {
        for side in [1.0, -1.0] {
            directions.push(Vec3::new((1.0 - z * z).max(0.0).sqrt(), 0.0, z * side));
        }
    }
    for m in &materials {
        for &wo in &directions {
            for bend in [0.0, 0.5] {
                let (mut si, frame) = point(wo, bend);
                si.wo = frame.to_world(wo);
                let bsdf = bsdf_at(m, &si);
                for mode in MODES {
                    for &wi in &directions {
                        let wi = frame.to_world(wi);
                        let f = bsdf.eval(si.wo, wi, mode, LobeMask::ALL);
                        let pdf = bsdf.pdf(si.wo, wi, mode, LobeMask::ALL);
                        assert!(f.is_finite() && f.min_channel() >= 0.0, "{m:?} {wo} {wi} {f:?}");
                        assert!(pdf.is_finite() && pdf >= 0.0, "{m:?} {wo} {wi} {pdf}");
                    }
                    for u in [Vec2::ZERO, Vec2::splat(0.5), Vec2::splat(1.0 - f32::EPSILON), Vec2::new(0.3, 0.0)] {
                        for l in [0.0, 0.5, 1.0 - f32::EPSILON] {
                            let Some(s) = bsdf.sample(si.wo, l, u, mode, LobeMask::ALL) else { continue };
                            assert!(s.weight.is_finite() && s.weight.min_channel() >= 0.0, "{m:?} {wo} {s:?}");
                            assert!(s.pdf.is_finite() && s.pdf > 0.0 && s.wi.is_normalized(), "{m:?} {wo} {s:?}");
                        }
                    }
                    let albedo = bsdf.albedo(si.wo, LobeMask::ALL);
                    assert!(albedo.is_finite() && albedo.min_channel() >= 0.0, "{m:?} {wo} {albedo:?}");
                }
            }
        }
    }
}

/// The common case stays small, the general one bounded.
#[test]
fn sizes_are_as_planned() {
    assert!(size_of::<super::super::diffuse::DiffuseBsdf>() <= 36);
    assert!(size_of::<Lobe>() <= 112, "{}", size_of::<Lobe>());
    assert!(size_of::<Bsdf>() <= 928, "{}", size_of::<Bsdf>());
}
