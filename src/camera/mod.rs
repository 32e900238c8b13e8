//! Cameras: rays through film positions, and the way back from scene points to the film.
//!
//! Mitsuba's orientation: the camera looks along its local +z, with x to the left and y up in the image. Film positions
//! are in pixels of the whole film, (0, 0) at the top left; a crop window keeps these coordinates.
//!
//! **Measure of importance.** A camera path starts in one pixel, so densities and importance are those of one pixel:
//! `pdf_w` integrates to the number of pixels over the film, and a light path that reaches the camera with throughput
//! `beta` adds `beta·f·cos·importance / paths` to the pixel at `raster`, as in [Veach 1997] §10.3 with `W_e` scaled so
//! that it integrates to 1 over every pixel.

mod lens;
#[cfg(test)]
mod tests;

use glam::{Mat3, Vec2, Vec3};

pub use lens::{FovAxis, fov_from_focal_length};

use crate::geometry::Ray;
pub use crate::image::FilmWindow;
use crate::math::Transform;
use crate::sample::warp;

/// A thin lens; without it a perspective camera is a pinhole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Scene units.
    pub aperture_radius: f32,
    /// Distance of the plane in focus along the axis, scene units.
    pub focus_distance: f32,
}

/// What a camera is made from. Lengths are in scene units.
#[derive(Clone, Copy, Debug)]
pub struct CameraSettings {
    /// Camera to scene space. Perspective cameras ignore its scale; an orthographic one scales its film by it.
    pub to_world: Transform,
    pub window: FilmWindow,
    /// Distances along the axis between which things are seen; 0 and infinity see everything.
    pub near_clip: f32,
    pub far_clip: f32,
}

/// How a ray changes from one pixel to the next, per pixel in x and in y.
#[derive(Clone, Copy, Debug, Default)]
pub struct Footprint {
    pub origin_dx: Vec3,
    pub origin_dy: Vec3,
    pub dir_dx: Vec3,
    pub dir_dy: Vec3,
}

/// A ray through the film.
#[derive(Clone, Copy, Debug)]
pub struct CameraRay {
    /// Unit direction; starts on the near clipping plane.
    pub ray: Ray,
    /// Radiance along the ray times this is the pixel's sample; 1 for these cameras.
    pub weight: f32,
    pub footprint: Footprint,
    /// Where the ray crosses the lens.
    pub lens: Vec3,
    /// Density of the lens point per square scene unit (1 for a pinhole) and of the direction per steradian, of one pixel.
    pub pdf_a: f32,
    pub pdf_w: f32,
}

/// A connection from a scene point to the camera.
#[derive(Clone, Copy, Debug)]
pub struct CameraWe {
    /// Film position in pixels.
    pub raster: Vec2,
    /// Point on the lens or film plane.
    pub lens: Vec3,
    /// Where the camera's ray to the scene point starts: on the near clipping plane.
    pub start: Vec3,
    /// Unit vector from the scene point to `lens`.
    pub wi: Vec3,
    pub dist: f32,
    /// Density of this direction among the camera's rays of the pixel; per steradian, 1 for orthographic cameras.
    pub pdf_w: f32,
    /// What `f·cos` at the scene point is multiplied by: importance over the density of `lens`, with the geometry term
    /// except for the cosine at the scene point; m⁻².
    pub importance: f32,
}

/// The closed set of projections.
#[derive(Clone, Copy, Debug)]
enum Projection {
    /// Film positions are directions `corner + x·dx + y·dy` with local z = 1.
    Perspective { lens: Option<Lens> },
    /// Film positions are origins `corner + x·dx + y·dy`.
    Orthographic,
}

/// A perspective (pinhole or thin-lens) or orthographic camera.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    projection: Projection,
    window: FilmWindow,
    position: Vec3,
    /// Unit axes: left, up, forward.
    axes: Mat3,
    /// Film position to scene space, see [`Projection`].
    corner: Vec3,
    dx: Vec3,
    dy: Vec3,
    /// Area of a pixel: at z = 1, or on the film plane.
    pixel_area: f32,
    near: f32,
    far: f32,
}

impl Camera {
    /// A perspective camera with a horizontal field of view of `fov_x` radians (see [`FovAxis::fov_x`]). The principal
    /// point is moved from the centre of the film by `principal_point` (shares of its width and height).
    pub fn perspective(settings: &CameraSettings, fov_x: f64, principal_point: Vec2, lens: Option<Lens>) -> Self {
        let axes = unit_axes(&settings.to_world);
        let half_x = (0.5 * fov_x).tan();
        let half_y = half_x / settings.window.aspect();
        let shift = principal_point.as_dvec2();
        let (w, h) = (settings.window.size.0 as f64, settings.window.size.1 as f64);
        let corner = Vec3::new((half_x * (1.0 - 2.0 * shift.x)) as f32, (half_y * (1.0 - 2.0 * shift.y)) as f32, 1.0);
        Self {
            projection: Projection::Perspective { lens: lens.filter(|l| l.aperture_radius > 0.0) },
            window: settings.window,
            position: settings.to_world.point(Vec3::ZERO),
            axes,
            corner: axes * corner,
            dx: axes.x_axis * (-2.0 * half_x / w) as f32,
            dy: axes.y_axis * (-2.0 * half_y / h) as f32,
            pixel_area: (4.0 * half_x * half_y / (w * h)) as f32,
            near: settings.near_clip,
            far: settings.far_clip,
        }
    }

    /// An orthographic camera whose film is as wide as local x from −1 to 1.
    pub fn orthographic(settings: &CameraSettings) -> Self {
        let m = &settings.to_world;
        let half_y = 1.0 / settings.window.aspect();
        let (w, h) = (settings.window.size.0 as f64, settings.window.size.1 as f64);
        let axis = |v: Vec3| m.vector_f64(v.as_dvec3());
        let (dx, dy) = (axis(Vec3::X) * (-2.0 / w), axis(Vec3::Y) * (-2.0 * half_y / h));
        Self {
            projection: Projection::Orthographic,
            window: settings.window,
            position: m.point(Vec3::ZERO),
            axes: unit_axes(m),
            corner: m.point_f64(glam::DVec3::new(1.0, half_y, 0.0)).as_vec3(),
            dx: dx.as_vec3(),
            dy: dy.as_vec3(),
            pixel_area: (dx.length() * dy.length()) as f32,
            near: settings.near_clip,
            far: settings.far_clip,
        }
    }

    /// The film that the camera was made for.
    pub fn window(&self) -> FilmWindow {
        self.window
    }

    /// The same view on a film of other pixels.
    pub fn with_film(self, window: FilmWindow) -> Self {
        let (sx, sy) =
            (self.window.size.0 as f32 / window.size.0 as f32, self.window.size.1 as f32 / window.size.1 as f32);
        Self { window, dx: self.dx * sx, dy: self.dy * sy, pixel_area: self.pixel_area * sx * sy, ..self }
    }

    /// Centre of the lens, or the middle of an orthographic film.
    pub fn position(&self) -> Vec3 {
        self.position
    }

    /// Unit vector along which the camera looks.
    pub fn forward(&self) -> Vec3 {
        self.axes.z_axis
    }

    /// True when all rays are parallel.
    pub fn is_orthographic(&self) -> bool {
        matches!(self.projection, Projection::Orthographic)
    }

    /// True when rays through one film position differ by where they cross the lens.
    pub fn has_lens(&self) -> bool {
        matches!(self.projection, Projection::Perspective { lens: Some(_) })
    }

    /// The ray through `film_pos` (pixels of the whole film); `u` picks the point on the lens.
    #[inline(always)]
    pub fn generate_ray(&self, film_pos: Vec2, u: Vec2) -> CameraRay {
        let at = self.corner + film_pos.x * self.dx + film_pos.y * self.dy;
        let Projection::Perspective { lens } = self.projection else {
            return self.parallel_ray(at);
        };
        // Aim from the lens point at the plane in focus; all directions keep local z = 1.
        let (p, d, pdf_a) = match lens {
            None => (self.position, at, 1.0),
            Some(l) => {
                let (p, offset) = self.lens_point(&l, u);
                (p, at - offset / l.focus_distance, l.pdf_a())
            }
        };
        let inv = 1.0 / d.length();
        let dir = d * inv;
        // The derivative of a normalised vector has no component along it.
        let change = |v: Vec3| inv * (v - dir * dir.dot(v));
        CameraRay {
            ray: Ray::segment(p + self.near * d, dir, (self.far - self.near) / inv),
            weight: 1.0,
            footprint: Footprint { dir_dx: change(self.dx), dir_dy: change(self.dy), ..Default::default() },
            lens: p,
            pdf_a,
            pdf_w: self.direction_pdf(inv),
        }
    }

    fn parallel_ray(&self, p: Vec3) -> CameraRay {
        let dir = self.forward();
        CameraRay {
            ray: Ray::segment(p + self.near * dir, dir, self.far - self.near),
            weight: 1.0,
            footprint: Footprint { origin_dx: self.dx, origin_dy: self.dy, ..Default::default() },
            lens: p,
            pdf_a: 1.0 / self.pixel_area,
            pdf_w: 1.0,
        }
    }

    /// A point on the lens and its offset from the centre.
    fn lens_point(&self, lens: &Lens, u: Vec2) -> (Vec3, Vec3) {
        let q = lens.aperture_radius * warp::concentric_disk(u);
        let offset = q.x * self.axes.x_axis + q.y * self.axes.y_axis;
        (self.position + offset, offset)
    }

    /// Density per steradian of the directions of a pixel at `cos` to the axis: `1 / (A_pixel cos³)`.
    #[inline]
    fn direction_pdf(&self, cos: f32) -> f32 {
        1.0 / (self.pixel_area * cos * cos * cos)
    }

    /// Connects the scene point `p` to the camera; `u` picks the point on the lens. `None` when the film does not see it.
    pub fn we(&self, p: Vec3, u: Vec2) -> Option<CameraWe> {
        match self.projection {
            Projection::Perspective { lens } => {
                let q = lens.map_or(self.position, |l| self.lens_point(&l, u).0);
                let d = p - q;
                let dist_sq = d.length_squared();
                let dist = dist_sq.sqrt();
                let depth = self.forward().dot(d);
                if !self.in_depth(depth) {
                    return None;
                }
                let (raster, pdf_w) = self.pdf_we(q, d / dist)?;
                let start = q + d * (self.near / depth);
                Some(CameraWe { raster, lens: q, start, wi: -d / dist, dist, pdf_w, importance: pdf_w / dist_sq })
            }
            Projection::Orthographic => {
                let dist = self.forward().dot(p - self.corner);
                let q = p - dist * self.forward();
                let raster = self.film_position(q - self.corner);
                let seen = self.in_depth(dist) && self.window.contains(raster);
                let importance = 1.0 / self.pixel_area;
                let start = q + self.near * self.forward();
                seen.then_some(CameraWe { raster, lens: q, start, wi: -self.forward(), dist, pdf_w: 1.0, importance })
            }
        }
    }

    /// Film position and density per steradian of the direction `d` from the lens point `q`; 1 stands for the delta
    /// direction of an orthographic camera. `None` outside the film.
    pub fn pdf_we(&self, q: Vec3, d: Vec3) -> Option<(Vec2, f32)> {
        let cos = self.forward().dot(d);
        let (raster, pdf_w) = match self.projection {
            Projection::Perspective { lens } => {
                // Undo the aim: the direction with local z = 1 from the centre to the same point in focus.
                let aim = lens.map_or(Vec3::ZERO, |l| (q - self.position) / l.focus_distance);
                (self.film_position(d / cos + aim - self.corner), self.direction_pdf(cos))
            }
            Projection::Orthographic => (self.film_position(q - self.corner), 1.0),
        };
        (cos > 0.0 && self.window.contains(raster)).then_some((raster, pdf_w))
    }

    /// Density of lens points per square scene unit: 1 for a pinhole, one pixel's film for an orthographic camera.
    pub fn pdf_lens(&self) -> f32 {
        match self.projection {
            Projection::Perspective { lens } => lens.map_or(1.0, |l| l.pdf_a()),
            Projection::Orthographic => 1.0 / self.pixel_area,
        }
    }

    /// The coordinates of a vector in the film's plane, in pixels.
    fn film_position(&self, v: Vec3) -> Vec2 {
        Vec2::new(v.dot(self.dx) / self.dx.length_squared(), v.dot(self.dy) / self.dy.length_squared())
    }

    fn in_depth(&self, z: f32) -> bool {
        z > 0.0 && z >= self.near && z <= self.far
    }
}

fn unit_axes(to_world: &Transform) -> Mat3 {
    let axis = |v: Vec3| to_world.vector_f64(v.as_dvec3()).normalize_or_zero().as_vec3();
    Mat3::from_cols(axis(Vec3::X), axis(Vec3::Y), axis(Vec3::Z))
}
