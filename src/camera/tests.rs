use std::f64::consts::PI;

use glam::{DMat4, DVec3};

use super::*;
use crate::sample::{Key, Purpose, Sampler, Sequence};

const WINDOW: FilmWindow = FilmWindow { size: (40, 20), crop_offset: (0, 0), crop_size: (40, 20) };

fn settings(to_world: DMat4, window: FilmWindow) -> CameraSettings {
    let to_world = Transform::new(to_world).expect("invertible");
    CameraSettings { to_world, window, near_clip: 0.0, far_clip: f32::INFINITY }
}

fn placed() -> DMat4 {
    DMat4::from_translation(DVec3::new(0.3, -0.2, 0.1)) * DMat4::from_euler(glam::EulerRot::XYZ, 0.5, -1.1, 0.7)
}

fn cameras(window: FilmWindow) -> Vec<(&'static str, Camera)> {
    let s = settings(placed(), window);
    let scaled = settings(placed() * DMat4::from_scale(DVec3::new(0.5, 0.5, 1.0)), window);
    let lens = Some(Lens { aperture_radius: 0.05, focus_distance: 0.8 });
    vec![
        ("pinhole", Camera::perspective(&s, 1.2, Vec2::ZERO, None)),
        ("shifted", Camera::perspective(&s, 0.9, Vec2::new(0.1, -0.2), None)),
        ("thin lens", Camera::perspective(&s, 1.2, Vec2::ZERO, lens)),
        ("orthographic", Camera::orthographic(&scaled)),
    ]
}

fn sampler(i: u64) -> Sampler {
    Sampler::new(Sequence::Sobol, Key::new(8, Purpose::Test, 0), i)
}

#[test]
fn looks_along_z_with_x_to_the_left_and_y_up() {
    let s = settings(DMat4::IDENTITY, WINDOW);
    for camera in [Camera::perspective(&s, PI / 2.0, Vec2::ZERO, None), Camera::orthographic(&s)] {
        // See points one unit ahead: the film is 2 wide and 1 high there.
        let raster = |p: Vec3| camera.we(p, Vec2::ZERO).expect("in view").raster;
        assert!((raster(Vec3::Z) - Vec2::new(20.0, 10.0)).length() < 1e-4);
        assert!((raster(Vec3::new(0.5, 0.25, 1.0)) - Vec2::new(10.0, 5.0)).length() < 1e-4);
        assert!(camera.we(Vec3::new(1.1, 0.0, 1.0), Vec2::ZERO).is_none());
        assert!(camera.we(-Vec3::Z, Vec2::ZERO).is_none());
    }
}

#[test]
fn field_of_view_follows_its_axis() {
    let deg = |d: f64| d.to_radians();
    for (axis, aspect, expected) in [
        (FovAxis::X, 2.0, 40.0),
        (FovAxis::Y, 2.0, 2.0 * (2.0 * deg(20.0).tan()).atan().to_degrees()),
        (FovAxis::Smaller, 2.0, 2.0 * (2.0 * deg(20.0).tan()).atan().to_degrees()),
        (FovAxis::Larger, 2.0, 40.0),
        (FovAxis::Smaller, 0.5, 40.0),
        (FovAxis::Diagonal, 4.0 / 3.0, 2.0 * (0.8 * deg(20.0).tan()).atan().to_degrees()),
    ] {
        let fov = axis.fov_x(deg(40.0), aspect).to_degrees();
        assert!((fov - expected).abs() < 1e-9, "{axis:?} at {aspect}: {fov} for {expected}");
    }
    // A 50 mm lens sees 46.79° along the diagonal and 39.60° across a 3:2 frame.
    let fov = fov_from_focal_length(50.0);
    assert!((fov.to_degrees() - 46.793).abs() < 1e-3);
    assert!((FovAxis::Diagonal.fov_x(fov, 1.5).to_degrees() - 39.598).abs() < 1e-3);
}

#[test]
fn principal_point_shifts_the_picture() {
    let s = settings(DMat4::IDENTITY, WINDOW);
    let camera = Camera::perspective(&s, 1.0, Vec2::new(0.25, 0.1), None);
    let raster = camera.we(Vec3::Z, Vec2::ZERO).expect("in view").raster;
    assert!((raster - Vec2::new(10.0, 8.0)).length() < 1e-4, "{raster}");
}

#[test]
fn connections_undo_generated_rays() {
    for (name, camera) in cameras(WINDOW) {
        for i in 0..500 {
            let mut s = sampler(i);
            let film = s.next_2d() * Vec2::new(40.0, 20.0);
            let u = s.next_2d();
            let r = camera.generate_ray(film, u);
            assert!((r.ray.d.length() - 1.0).abs() < 1e-6 && r.weight == 1.0);
            let dist = 0.3 + 2.0 * s.next_1d();
            let Some(we) = camera.we(r.ray.at(dist), u) else {
                // Only rounding at the border may lose the point.
                let edge = film.min(Vec2::new(40.0, 20.0) - film).min_element();
                assert!(edge < 1e-3, "{name}: {film}");
                continue;
            };
            assert!((we.raster - film).length() < 1e-3, "{name}: {} for {film}", we.raster);
            assert!((we.wi + r.ray.d).length() < 1e-5 && (we.dist - dist).abs() < 1e-5, "{name}");
            assert!((we.pdf_w / r.pdf_w - 1.0).abs() < 1e-4, "{name}: {} for {}", we.pdf_w, r.pdf_w);
            let (_, pdf_w) = camera.pdf_we(r.lens, r.ray.d).expect("on the film");
            assert!((pdf_w / r.pdf_w - 1.0).abs() < 1e-4 && (camera.pdf_lens() - r.pdf_a).abs() < 1e-6 * r.pdf_a);
        }
    }
}

#[test]
fn importance_integrates_to_the_number_of_pixels() {
    // ∫ W_e cos dω over the film is 1 per pixel; a crop window keeps the measure of each pixel.
    let crop = FilmWindow { size: (40, 20), crop_offset: (5, 10), crop_size: (20, 5) };
    for (window, pixels) in [(WINDOW, 800.0), (crop, 100.0)] {
        for (name, camera) in cameras(window).into_iter().filter(|c| c.0 != "orthographic") {
            let n = 1 << 18;
            let mut sum = 0.0;
            for i in 0..n {
                let mut s = sampler(i);
                let d = warp::uniform_sphere(s.next_2d());
                let lens = camera.generate_ray(Vec2::ZERO, s.next_2d()).lens;
                sum += camera.pdf_we(lens, d).map_or(0.0, |(_, pdf_w)| pdf_w as f64 * 4.0 * PI);
            }
            assert!((sum / n as f64 / pixels - 1.0).abs() < 0.01, "{name}: {} for {pixels}", sum / n as f64);
        }
    }
}

#[test]
fn light_tracing_onto_a_plane_measures_its_radiance() {
    // A plane at distance 1 with radiance 1: every pixel of every camera must get 1, also by connections from the plane.
    for (name, camera) in cameras(WINDOW) {
        let n = camera.forward();
        let frame = crate::math::Frame::from_normal(n);
        let (samples, side) = (1u64 << 18, 6.0f32);
        let mut sum = 0.0;
        for i in 0..samples {
            let mut s = sampler(i);
            let q = (s.next_2d() - 0.5) * side;
            let p = camera.position() + frame.to_world(q.extend(1.0));
            if let Some(we) = camera.we(p, s.next_2d()) {
                sum += (n.dot(-we.wi) * we.importance) as f64 * (side * side) as f64;
            }
        }
        let mean = sum / samples as f64 / 800.0;
        assert!((mean - 1.0).abs() < 0.01, "{name}: {mean}");
    }
}

#[test]
fn lens_rays_meet_in_the_plane_of_focus() {
    let camera = cameras(WINDOW)[2].1;
    let film = Vec2::new(33.0, 4.0);
    let at_focus = |u| {
        let r = camera.generate_ray(film, u);
        r.lens + r.ray.d * (0.8 / camera.forward().dot(r.ray.d))
    };
    let p = at_focus(Vec2::ZERO);
    for i in 0..32 {
        assert!((at_focus(sampler(i).next_2d()) - p).length() < 1e-5);
    }
    // A lens of no size is a pinhole.
    let flat = Lens { aperture_radius: 0.0, focus_distance: 1.0 };
    assert!(!Camera::perspective(&settings(placed(), WINDOW), 1.0, Vec2::ZERO, Some(flat)).has_lens());
}

#[test]
fn footprint_predicts_the_next_pixel() {
    for (name, camera) in cameras(WINDOW) {
        let (film, u) = (Vec2::new(11.0, 7.0), Vec2::new(0.2, 0.7));
        let (r, step) = (camera.generate_ray(film, u), 0.05);
        let x = camera.generate_ray(film + Vec2::X * step, u).ray;
        let y = camera.generate_ray(film + Vec2::Y * step, u).ray;
        for (next, o, d) in
            [(x, r.footprint.origin_dx, r.footprint.dir_dx), (y, r.footprint.origin_dy, r.footprint.dir_dy)]
        {
            assert!((next.o - r.ray.o - step * o).length() < 1e-5, "{name}");
            assert!((next.d - r.ray.d - step * d).length() < 1e-5, "{name}");
        }
    }
}

#[test]
fn clipping_planes_bound_the_ray() {
    let s = CameraSettings { near_clip: 0.5, far_clip: 2.0, ..settings(DMat4::IDENTITY, WINDOW) };
    for camera in [Camera::perspective(&s, 1.0, Vec2::ZERO, None), Camera::orthographic(&s)] {
        let r = camera.generate_ray(Vec2::new(3.0, 4.0), Vec2::ZERO).ray;
        assert!((r.o.z - 0.5).abs() < 1e-6 && (r.at(r.tmax).z - 2.0).abs() < 1e-5, "{r:?}");
        assert!(camera.we(Vec3::Z * 0.4, Vec2::ZERO).is_none() && camera.we(Vec3::Z * 2.1, Vec2::ZERO).is_none());
        assert!(camera.we(Vec3::Z, Vec2::ZERO).is_some());
    }
}
