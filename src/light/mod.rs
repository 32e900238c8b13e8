//! Lights: next-event sampling from a point (`sample_li`), emission of photons (`sample_le`), and selection among them.
//!
//! Directions are unit vectors in scene space. `pdf_w` is per steradian, `pdf_a` per square scene unit. Lights are
//! one-sided: an area light emits on the side of its geometric normal only, as in Mitsuba.

mod area;
mod distant;
mod envmap;
mod inverse;
mod near;
mod point;
mod projector;
mod reach;
mod selector;
mod sky;
mod spot;
mod starts;
mod surface;
mod table;
#[cfg(test)]
mod tests;

use glam::{Mat3, Vec2, Vec3};

pub use area::AreaLight;
pub use distant::{Constant, Directional};
pub use envmap::EnvMap;
pub use near::NearLights;
pub use point::Point;
pub use projector::Projector;
pub use selector::LightSelector;
pub use sky::{Cells, DIRECTIONS, SkyView, View, around, direction_index};
pub use spot::Spot;
pub use starts::{STARTS, StartNumbers, Starts};

use crate::color::Rgb;
use crate::geometry::{GeometrySet, Ray, SurfaceInteraction};
use crate::math::{Transform, offset_ray_origin};
use crate::texture::{ColorParam, Textures};

/// What lights look things up in.
#[derive(Clone, Copy, Debug)]
pub struct LightContext<'a> {
    pub geometry: &'a GeometrySet,
    pub textures: &'a Textures,
    /// Centre and radius of a sphere around all geometry; distant lights shine from outside it.
    pub scene_sphere: (Vec3, f32),
    /// Where the environment is seen, if most of it is hidden.
    pub sky: Option<&'a SkyView>,
}

impl LightContext<'_> {
    /// Area of the disc through which a distant light reaches the scene, square scene units.
    #[inline(always)]
    pub fn disc_area(&self) -> f64 {
        let r = self.scene_sphere.1 as f64;
        std::f64::consts::PI * r * r
    }
}

/// Light arriving at a point from a sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct LightLi {
    /// From the point towards the light.
    pub wi: Vec3,
    /// Distance to `p`; infinite for distant lights.
    pub dist: f32,
    /// Radiance in W·m⁻²·sr⁻¹, not divided by the density; for `delta` the irradiance on a plane facing the light, W·m⁻².
    pub radiance: Rgb,
    /// Density per steradian; 1 for `delta`.
    pub pdf_w: f32,
    /// The light has no solid angle: no other technique can find it.
    pub delta: bool,
    /// Sampled point on the light, or a point beyond the scene for distant lights.
    pub p: Vec3,
    /// Normal of the light at `p`, on the emitting side.
    pub n: Vec3,
    /// Bound on the absolute rounding error of each coordinate of `p`.
    pub p_err: Vec3,
}

/// The start of a photon's path.
#[derive(Clone, Copy, Debug)]
pub struct LightLe {
    /// Leaves the light; its origin is already moved off the surface.
    pub ray: Ray,
    /// The sampled point itself.
    pub p: Vec3,
    /// Normal of the light on the emitting side; the travel direction for distant and point lights.
    pub n: Vec3,
    pub p_err: Vec3,
    /// Radiance along the ray, W·m⁻²·sr⁻¹; intensity (W·sr⁻¹) for point-like and irradiance (W·m⁻²) for directional lights.
    pub radiance: Rgb,
    /// Flux carried by one emitted path, `Le·cos θ / (pdf_a·pdf_w)` in W, before the probability of picking the light.
    pub weight: Rgb,
    /// Density of the position; 1 for `delta_position`.
    pub pdf_a: f32,
    /// Density of the direction; 1 for `delta_direction`.
    pub pdf_w: f32,
    pub delta_position: bool,
    pub delta_direction: bool,
    /// False for lights at infinite distance.
    pub finite: bool,
}

/// The closed set of lights.
#[derive(Clone, Debug)]
pub enum Light {
    Area(AreaLight),
    Point(Point),
    Spot(Spot),
    Directional(Directional),
    Constant(Constant),
    EnvMap(EnvMap),
    Projector(Projector),
}

impl Light {
    /// Samples light arriving at `p`; radiance in W·m⁻²·sr⁻¹. `None` when nothing arrives from the sampled direction.
    #[inline(always)]
    pub fn sample_li(&self, ctx: &LightContext, p: Vec3, u: Vec2) -> Option<LightLi> {
        match self {
            Light::Area(l) => l.sample_li(ctx, p, u),
            Light::Point(l) => l.sample_li(p),
            Light::Spot(l) => l.sample_li(ctx, p),
            Light::Directional(l) => l.sample_li(ctx, p),
            Light::Constant(_) | Light::EnvMap(_) => self.sample_sky(ctx, p, u),
            Light::Projector(l) => l.sample_li(ctx, p),
        }
    }

    /// [`Light::sample_li`] of an environment.
    #[inline]
    fn sample_sky(&self, ctx: &LightContext, p: Vec3, mut u: Vec2) -> Option<LightLi> {
        let own = |u: Vec2| match self {
            Light::Constant(l) => l.sample_li(ctx, p, u),
            Light::EnvMap(l) => l.sample_li(ctx, p, u),
            _ => None,
        };
        let Some(view) = ctx.sky.and_then(|sky| sky.at(p)) else { return own(u) };
        let mut li = if u.x < sky::OWN_SHARE {
            u.x /= sky::OWN_SHARE;
            own(u)?
        } else {
            u.x = ((u.x - sky::OWN_SHARE) / (1.0 - sky::OWN_SHARE)).min(1.0f32.next_down());
            let d = view.sample(u)?;
            distant::arrive_from_infinity(ctx, p, d, self.radiance_env(ctx, d), 1.0, false)
        };
        li.pdf_w = self.pdf_li_env(ctx, p, li.wi);
        Some(li)
    }

    /// Density per steradian with which [`Light::sample_li`] from `p` picks the point `si` on this light; 0 for lights
    /// without a surface.
    #[inline]
    pub fn pdf_li(&self, ctx: &LightContext, p: Vec3, si: &SurfaceInteraction) -> f32 {
        match self {
            Light::Area(l) => l.pdf_li(ctx, p, si),
            _ => 0.0,
        }
    }

    /// Density per steradian with which [`Light::sample_li`] from `p` picks the direction `wi` towards infinity; 0 for lights
    /// that are not environments.
    #[inline]
    pub fn pdf_li_env(&self, ctx: &LightContext, p: Vec3, wi: Vec3) -> f32 {
        let own = match self {
            Light::Constant(l) => l.pdf(),
            Light::EnvMap(l) => l.pdf(wi),
            _ => return 0.0,
        };
        match ctx.sky.and_then(|sky| sky.at(p)) {
            Some(view) => sky::OWN_SHARE * own + (1.0 - sky::OWN_SHARE) * view.density(wi),
            None => own,
        }
    }

    /// Radiance in W·m⁻²·sr⁻¹ that leaves the surface point `si` of this light along `w`.
    #[inline]
    pub fn radiance_at(&self, ctx: &LightContext, si: &SurfaceInteraction, w: Vec3) -> Rgb {
        match self {
            Light::Area(l) => l.radiance_at(ctx, si, w),
            _ => Rgb::BLACK,
        }
    }

    /// Radiance in W·m⁻²·sr⁻¹ seen by a ray that escapes along `d`.
    #[inline]
    pub fn radiance_env(&self, _ctx: &LightContext, d: Vec3) -> Rgb {
        match self {
            Light::Constant(l) => l.radiance,
            Light::EnvMap(l) => l.radiance(d),
            _ => Rgb::BLACK,
        }
    }

    /// Samples the start of a photon's path; its weight is flux in W. `None` when the light emits nothing there.
    #[inline(always)]
    pub fn sample_le(&self, ctx: &LightContext, u_pos: Vec2, u_dir: Vec2) -> Option<LightLe> {
        match self {
            Light::Area(l) => l.sample_le(ctx, u_pos, u_dir),
            Light::Point(l) => l.sample_le(u_dir),
            Light::Spot(l) => l.sample_le(ctx, u_dir),
            Light::Directional(l) => l.sample_le(ctx, u_pos),
            Light::Constant(l) => l.sample_le(ctx, u_pos, u_dir),
            Light::EnvMap(l) => l.sample_le(ctx, u_pos, u_dir),
            Light::Projector(l) => l.sample_le(ctx, u_dir),
        }
    }

    /// Densities `(pdf_a, pdf_w)` with which [`Light::sample_le`] starts at `p` with normal `n` and leaves along `w`;
    /// 1 stands for the delta part of a delta light, 0 for what the light cannot emit.
    ///
    /// On textured meshes the density of the position depends on the triangle; use [`Light::pdf_le_at`] there.
    pub fn pdf_le(&self, ctx: &LightContext, p: Vec3, n: Vec3, w: Vec3) -> (f32, f32) {
        match self {
            Light::Area(l) => l.pdf_le(ctx, p, n, w),
            Light::Point(l) => l.pdf_le(),
            Light::Spot(l) => (1.0, l.pdf_direction(w)),
            Light::Directional(_) => ((1.0 / ctx.disc_area()) as f32, 1.0),
            Light::Constant(l) => ((1.0 / ctx.disc_area()) as f32, l.pdf()),
            Light::EnvMap(l) => ((1.0 / ctx.disc_area()) as f32, l.pdf(-w)),
            Light::Projector(l) => (1.0, l.pdf_direction(w)),
        }
    }

    /// [`Light::pdf_le`] for a point on this light that a ray has hit.
    pub fn pdf_le_at(&self, ctx: &LightContext, si: &SurfaceInteraction, w: Vec3) -> (f32, f32) {
        match self {
            Light::Area(l) => l.pdf_le_at(ctx, si, w),
            _ => self.pdf_le(ctx, si.p, si.ng, w),
        }
    }

    /// [`Light::pdf_le`] for the sampled point of `li` and the way from there to where `li` was sampled from.
    pub fn pdf_le_li(&self, ctx: &LightContext, li: &LightLi) -> (f32, f32) {
        match self {
            Light::Area(l) => l.pdf_le_li(li),
            _ => self.pdf_le(ctx, li.p, li.n, -li.wi),
        }
    }

    /// Density per steradian with which [`Light::sample_li`] from `p`, which the path of `le` reaches first, picks the
    /// start of that path; 1 for lights without solid angle.
    pub fn pdf_li_le(&self, ctx: &LightContext, p: Vec3, le: &LightLe) -> f32 {
        match self {
            Light::Area(l) => l.pdf_li_le(p, le),
            Light::Constant(_) | Light::EnvMap(_) => self.pdf_li_env(ctx, p, -le.ray.d),
            _ => 1.0,
        }
    }

    /// Total emitted power, W; for distant lights what passes through the scene's bounding sphere.
    pub fn power(&self, ctx: &LightContext) -> Rgb {
        match self {
            Light::Area(l) => l.power(),
            Light::Point(l) => l.power(),
            Light::Spot(l) => l.power(),
            Light::Directional(l) => l.power(ctx),
            Light::Constant(l) => l.power(ctx),
            Light::EnvMap(l) => l.power(ctx),
            Light::Projector(l) => l.power(),
        }
    }

    /// The most that a ray can meet, the mean of the channels (W·m⁻²·sr⁻¹); of a textured surface the mean over it. 0 for
    /// lights that no ray meets.
    pub fn peak_radiance(&self) -> f32 {
        match self {
            Light::Area(l) => l.mean_radiance().mean(),
            Light::Constant(l) => l.radiance.mean(),
            Light::EnvMap(l) => l.peak(),
            Light::Point(_) | Light::Spot(_) | Light::Directional(_) | Light::Projector(_) => 0.0,
        }
    }

    /// True for lights without solid angle as seen from any point, which only `sample_li` finds.
    pub fn is_delta(&self) -> bool {
        matches!(self, Light::Point(_) | Light::Spot(_) | Light::Directional(_) | Light::Projector(_))
    }

    /// True when the radiance of a surface follows a texture.
    pub fn is_textured(&self) -> bool {
        matches!(self, Light::Area(l) if matches!(l.radiance(), ColorParam::Texture(_)))
    }

    /// True for lights that a ray finds by escaping.
    pub fn is_environment(&self) -> bool {
        matches!(self, Light::Constant(_) | Light::EnvMap(_))
    }

    /// True for lights at infinite distance.
    pub fn is_distant(&self) -> bool {
        matches!(self, Light::Directional(_) | Light::Constant(_) | Light::EnvMap(_))
    }
}

/// The rotation (or reflection) part of a placement: its axes, normalised. Lights with a direction ignore scale.
fn axes(to_world: &Transform) -> Mat3 {
    let axis = |v: Vec3| to_world.vector_f64(v.as_dvec3()).normalize_or_zero().as_vec3();
    Mat3::from_cols(axis(Vec3::X), axis(Vec3::Y), axis(Vec3::Z))
}

/// The start of a path from a point-like light of intensity `intensity` (W·sr⁻¹).
#[inline(always)]
fn emit_from_point(p: Vec3, d: Vec3, intensity: Rgb, pdf_w: f32) -> LightLe {
    LightLe {
        ray: Ray::new(p, d),
        p,
        n: d,
        p_err: Vec3::ZERO,
        radiance: intensity,
        weight: intensity / pdf_w,
        pdf_a: 1.0,
        pdf_w,
        delta_position: true,
        delta_direction: false,
        finite: true,
    }
}

/// Light from a point-like source at `origin` with intensity given by the unit direction of travel.
fn arrive_from_point(origin: Vec3, p: Vec3, intensity: impl Fn(Vec3) -> Rgb) -> Option<LightLi> {
    let d = origin - p;
    let dist_sq = d.length_squared();
    let dist = dist_sq.sqrt();
    let wi = d / dist;
    if !wi.is_finite() {
        return None;
    }
    let radiance = intensity(-wi) / dist_sq;
    let li = LightLi { wi, dist, radiance, pdf_w: 1.0, delta: true, p: origin, n: -wi, p_err: Vec3::ZERO };
    (!radiance.is_black()).then_some(li)
}

/// The start of a path from a surface point.
#[inline(always)]
fn emit_from_surface(p: Vec3, n: Vec3, p_err: Vec3, d: Vec3) -> Ray {
    Ray::new(offset_ray_origin(p, p_err, n, d), d)
}
