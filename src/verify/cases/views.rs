//! Unusual cameras, films and lights: nothing to see, nothing to see it with, everything on top of something else.

use super::super::case::{Case, Check, Item, Outcome};
use super::super::methods::Light;
use super::super::optics::integrate;
use super::super::probe::Probe;
use super::super::xml::*;
use crate::camera::FilmWindow;
use crate::color::Rgb;
use crate::film::{Film, ReconstructionFilter};
use crate::math::Vec2;
use std::f64::consts::PI;

pub fn cases() -> Vec<Case> {
    vec![
        Case { name: "empty", about: "scenes without lights, without geometry, with lights of no power", items: empty },
        Case { name: "films", about: "pictures of 1×1 and 16384×1 pixels", items: films },
        Case { name: "on-surfaces", about: "cameras and lights on surfaces and inside objects", items: surfaces },
        Case {
            name: "delta",
            about: "point lights before mirrors: images of lights, and nothing to see",
            items: deltas,
        },
        Case {
            name: "roughness",
            about: "rough metal of roughness 0, 1e-7 and 1 under a uniform sky",
            items: roughness,
        },
    ]
}

const DIFFUSE: Light = Light::DIRECT;

fn eye() -> String {
    camera([0.0, 0.0, 2.0], [0.0; 3], 30.0, (4, 4))
}

fn empty() -> Vec<Item> {
    let floor = || square([0.0; 3], 3.0, [0.0, 0.0, 1.0], &diffuse(0.5));
    let of = |what: &str, pieces: &[String], truth: f64, light: Light| {
        let mut all = vec![depth(-1), eye()];
        all.extend_from_slice(pieces);
        Probe::new(what, scene(&all), truth, light).spp(4).photons(500).fast()
    };
    let dark_lamp = || square([2.5, 0.0, 3.0], 0.2, [0.0, 0.0, -1.0], &lamp(0.0));
    // Below a lamp of radiance 1: ρ times the form factor; see the case square-light.
    let lamp_above = || square([0.0, 0.0, 3.0], 1.0, [0.0, 0.0, -1.0], &lamp(1.0));
    vec![
        of("no light", &[floor()], 0.0, Light::NONE).into(),
        of(
            "no light, glass and a mirror",
            &[floor(), sphere([0.3, 0.0, 0.3], 0.2, &glass(1.5)), sphere([-0.3, 0.0, 0.3], 0.2, &mirror())],
            0.0,
            Light::NONE,
        )
        .into(),
        of("nothing at all", &[], 0.0, Light::NONE).into(),
        of("only a sky", &[sky(1.0)], 1.0, Light::SEEN).into(),
        of("only a point light", &[point_light([0.0; 3], 1.0)], 0.0, Light::NONE).into(),
        of("only a sun", &[sun([0.0, 0.0, -1.0], 1.0)], 0.0, Light::NONE).into(),
        of("point light without power", &[floor(), point_light([0.0, 0.0, 1.0], 0.0)], 0.0, DIFFUSE).into(),
        of("lamp without power", &[floor(), dark_lamp()], 0.0, DIFFUSE).into(),
        of("sun without power", &[floor(), sun([0.0, 0.0, -1.0], 0.0)], 0.0, DIFFUSE).into(),
        of("sky without power", &[floor(), sky(0.0)], 0.0, DIFFUSE).into(),
        // ρE/π.
        of(
            "lights with and without power",
            &[floor(), dark_lamp(), point_light([0.0, 0.0, 1.0], 0.0), sun([0.0, 0.0, -1.0], PI)],
            0.5,
            DIFFUSE,
        )
        .except(&["ptracer"]) // few paths of the sun meet what is in view
        .into(),
        of("lamp above", &[floor(), lamp_above()], mean_below_lamp(0.5), DIFFUSE)
            .spp(64)
            .except(&["ptracer"])
            .relative(0.01)
            .into(),
    ]
}

/// Mean radiance over the view of [`eye`] of a floor of albedo `rho`, 3 below a 2×2 lamp of radiance 1: the form factors of
/// its four corners averaged over the square in view, whose half side is 2 tan 15°.
fn mean_below_lamp(rho: f64) -> f64 {
    use super::super::optics::corner_factor;
    let half = 2.0 * 15f64.to_radians().tan();
    // Signed corner factors add up for points outside of the lamp's outline as well.
    let at = |x: f64, y: f64| {
        let corner = |a: f64, b: f64| a.signum() * b.signum() * corner_factor(a.abs(), b.abs(), 3.0);
        corner(1.0 - x, 1.0 - y) + corner(1.0 + x, 1.0 - y) + corner(1.0 - x, 1.0 + y) + corner(1.0 + x, 1.0 + y)
    };
    // Equal steps of a pinhole camera's film are equal steps on the floor. A coarse midpoint rule is exact to 1e-6 here.
    const STEPS: usize = 64;
    let coordinate = |i: usize| half * ((2 * i + 1) as f64 / STEPS as f64 - 1.0);
    let sum: f64 = (0..STEPS * STEPS).map(|i| at(coordinate(i % STEPS), coordinate(i / STEPS))).sum();
    rho * sum / (STEPS * STEPS) as f64
}

fn films() -> Vec<Item> {
    let of = |size: (u32, u32), spp: u64| {
        // Without gathering: a picture of so many pixels is long.
        let xml = scene(&[
            photon_mapper(&[
                ("boolean", "final_gather", "false".into()),
                ("float", "global_lookup_radius", "0.25".into()),
            ]),
            // 90° the long way, whichever way that is.
            camera([0.1, 0.2, -0.3], [0.5, 0.1, 1.0], 90.0, size).replacen(
                '>',
                r#"><string name="fov_axis" value="larger"/>"#,
                1,
            ),
            hollow([0.0; 3], 1.0, &(diffuse(0.5) + &emits(0.5))),
        ]);
        Probe::new(format!("{}×{}", size.0, size.1), xml, 1.0, Light::SEEN | Light::DIRECT | Light::INDIRECT).spp(spp)
    };
    // A float stops absorbing unit samples at 2²⁴.
    let sums = |n: u64| {
        Check::plain(format!("mean of {n} samples of 1"), "film", move |_| {
            let mut film = Film::new(FilmWindow::full(1, 1), ReconstructionFilter::Box);
            for _ in 0..n {
                film.add_sample(Vec2::splat(0.5), Rgb::WHITE);
            }
            Outcome::exact(1.0, film.develop(1.0 / n as f64).pixel(0, 0).g as f64)
        })
    };
    vec![
        sums((1 << 25) + 2).into(),
        of((1, 1), 1024).fast().into(),
        of((16384, 1), 1).except(&["ptracer"]).photons(40_000).fast().once().into(),
        of((1, 16384), 1).except(&["ptracer"]).photons(40_000).into(),
        of((3, 5), 64).into(),
    ]
}

fn surfaces() -> Vec<Item> {
    let all = Light::SEEN | Light::DIRECT | Light::INDIRECT;
    let glassy = all | Light::MIRRORED | Light::BEHIND_GLASS | Light::CAUSTIC;
    let room = || {
        cuboid(
            [0.0; 3],
            [1.0; 3],
            &format!(r#"<boolean name="flip_normals" value="true"/>{}{}"#, diffuse(0.5), emits(0.5)),
        )
    };
    let of = |what: &str, origin: V3, target: V3, more: String, truth: f64, light: Light| {
        // From a corner of the room the walls begin 35° off its diagonal.
        Probe::new(what, scene(&[depth(-1), camera(origin, target, 40.0, (8, 8)), room(), more]), truth, light)
            .spp(32)
            .bias(0.025)
    };
    let ball = |n: f64| sphere([0.0; 3], 0.5, &glass(n));
    let wall_light = |z: f64| {
        // A point light on a black wall: the opposite side gets I cos⁴/d².
        scene(&[
            depth(-1),
            parallel_camera([0.0, 0.0, 0.5], [0.0; 3], 1e-4, 4),
            square([0.0; 3], 1.0, [0.0, 0.0, 1.0], &diffuse(1.0)),
            square([0.0, 0.0, 1.0], 1.0, [0.0, 0.0, -1.0], &black()),
            point_light([0.0, 0.0, z], PI),
        ])
    };
    vec![
        of("camera on a wall", [-1.0, 0.1, 0.2], [1.0, 0.0, 0.0], String::new(), 1.0, all).fast().into(),
        of("camera in a corner", [-1.0, -1.0, -1.0], [1.0, 1.0, 1.0], String::new(), 1.0, all).into(),
        of("camera on glass, looking away", [-0.5, 0.0, 0.0], [-1.0, 0.1, 0.0], ball(1.5), 1.0, glassy).into(),
        of("camera in glass", [0.0; 3], [1.0, 0.2, 0.0], ball(1.5), 2.25, glassy).fast().into(),
        of("camera in glass n = 1", [0.0; 3], [1.0, 0.2, 0.0], ball(1.0), 1.0, glassy).into(),
        Probe::new("light on a wall", wall_light(1.0 - 1e-3), (1.0 - 1e-3f64).powi(-2), Light::DIRECT)
            .except(&["ptracer"])
            .photons(500)
            .relative(1e-3)
            .into(),
        // Seen from far away, a hit point found along the ray is up to a hundredth of a metre off, and half of such points
        // are below the floor and in its shadow. The floor leans: on one along the axes roundings cancel.
        Probe::new(
            "leaning floor seen from 1e5 m",
            scene(&[
                depth(-1),
                parallel_camera([3.6e4, 4.8e4, 8e4], [0.0; 3], 0.1, 8),
                format!(
                    r#"<shape type="rectangle"><transform name="to_world"><rotate y="1" angle="30"/></transform>{}</shape>"#,
                    diffuse(0.5)
                ),
                sun([-0.5, 0.0, -0.75f64.sqrt()], 2.0 * PI),
            ]),
            1.0,
            Light::DIRECT,
        )
        .photons(200)
        .relative(1e-3)
        .except(&["ptracer"]) // the view is too small to be hit
        .fast()
        .into(),
        // Seen from outside, a lamp in a closed diffuse ball is dark.
        Probe::new(
            "light in a closed ball",
            scene(&[depth(-1), eye(), sphere([0.0; 3], 0.5, &diffuse(0.8)), point_light([0.1, 0.0, 0.0], 10.0)]),
            0.0,
            all,
        )
        .photons(2000)
        .fast()
        .into(),
        Probe::new(
            "lamp in a closed ball",
            scene(&[depth(-1), eye(), sphere([0.0; 3], 0.5, &diffuse(0.8)), sphere([0.1, 0.0, 0.0], 0.2, &lamp(10.0))]),
            0.0,
            all,
        )
        .photons(2000)
        .into(),
    ]
}

/// A plane mirror doubles a light: `E = I h/d³` from the light and from its image. Without a diffuse surface a point light
/// is invisible.
fn deltas() -> Vec<Item> {
    let (h, a) = (1.0f64, 0.5f64);
    // The light stands at height h above the origin, the mirror at x = a, the image at x = 2a.
    let direct = 1.0 / (h * h);
    let image = h / (h * h + 4.0 * a * a).powf(1.5);
    let mirrored = scene(&[
        depth(3),
        parallel_camera([0.0, 0.0, 0.2], [0.0; 3], 0.02, 4),
        square([0.0; 3], 3.0, [0.0, 0.0, 1.0], &diffuse(1.0)),
        square([a, 0.0, 0.0], 4.0, [-1.0, 0.0, 0.0], &mirror()),
        point_light([0.0, 0.0, h], PI),
    ]);
    let light = Light::DIRECT | Light::POINT_CAUSTIC;
    let truth = direct + image;
    let image =
        |xml: String| Probe::new("light and its image", xml, truth, light).bias(0.01).relative(0.02).limit(60.0);
    let dark = |what: &str, pieces: &[String]| {
        let mut all = vec![depth(-1), eye()];
        all.extend_from_slice(pieces);
        Probe::new(what, scene(&all), 0.0, Light::NONE).spp(16).photons(200).fast()
    };
    vec![
        // Of the paths of light without density estimation one in ten thousand meets the view.
        image(mirrored.clone()).except(&["ptracer", "bdpt", "vcm"]).photons(20_000).into(),
        image(mirrored).only(&["bdpt", "vcm"]).spp(8192).photons(200).relative(0.1).into(),
        dark(
            "point light, mirror",
            &[square([0.0; 3], 1.0, [0.0, 0.0, 1.0], &mirror()), point_light([0.0, 0.0, 1.0], 1.0)],
        )
        .into(),
        dark("sun, glass ball", &[sphere([0.0; 3], 0.5, &glass(1.5)), sun([0.0, 0.0, -1.0], 1.0)]).into(),
        dark("point light in a glass ball", &[sphere([0.0; 3], 0.5, &glass(1.5)), point_light([0.0, 0.0, 0.0], 1.0)])
            .into(),
        dark(
            "point light between two mirrors",
            &[
                square([0.0; 3], 1.0, [0.0, 0.0, 1.0], &mirror()),
                square([0.0, 0.0, 3.0], 1.0, [0.0, 0.0, -1.0], &mirror()),
                point_light([0.0, 0.0, 1.0], 1.0),
            ],
        )
        .into(),
    ]
}

/// Share of a uniform sky that perfectly reflecting GGX facets send along their normal, single scattering:
/// `∫ D G₁ cos θh dωh` over facets less than 45° from the normal, with θi = 2θh and G₁ of the incoming direction alone
/// [Walter et al. 2007, eq. 20, 33, 34].
fn ggx_albedo(alpha: f64) -> f64 {
    let a2 = alpha * alpha;
    integrate(0.0, std::f64::consts::FRAC_PI_4, |t| {
        let (sin, cos) = t.sin_cos();
        let d = a2 / (PI * (cos * cos * (a2 - 1.0) + 1.0).powi(2));
        let tan_i = (2.0 * t).tan();
        let g1 = 2.0 / (1.0 + (1.0 + a2 * tan_i * tan_i).sqrt());
        d * g1 * cos * 2.0 * PI * sin
    })
}

fn roughness() -> Vec<Item> {
    let of = |alpha: f64, truth: f64| {
        let bsdf = format!(
            r#"<bsdf type="roughconductor"><string name="distribution" value="ggx"/><string name="material" value="none"/><float name="alpha" value="{alpha}"/></bsdf>"#
        );
        let xml = scene(&[
            depth(-1),
            parallel_camera([0.0, 0.0, 1.0], [0.0; 3], 0.1, 4),
            square([0.0; 3], 1.0, [0.0, 0.0, 1.0], &bsdf),
            sky(1.0),
        ]);
        Probe::new(format!("α = {alpha}"), xml, truth, Light::DIRECT | Light::MIRRORED)
            .photons(500)
            .spp(256)
            .relative(0.01)
    };
    vec![
        of(0.0, 1.0).fast().into(),
        of(1e-7, 1.0).fast().into(),
        of(1e-3, 1.0).into(),
        of(0.1, ggx_albedo(0.1)).into(),
        of(0.5, ggx_albedo(0.5)).into(),
        of(1.0, ggx_albedo(1.0)).fast().into(),
    ]
}
