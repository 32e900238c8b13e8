//! Lights. Intensities that carry lengths are converted to the unit of the scene box.

use glam::DVec3;

use super::super::xml::{Child, ColorUse, Query};
use super::super::{PicturePrediction, SceneError};
use super::shapes::invertible;
use super::{Loader, ToScene};
use crate::color::Rgb;
use crate::geometry::GeometrySet;
use crate::light::{Constant, Directional, EnvMap, Light, Point, Projector, Spot};
use crate::math::Transform;
use crate::texture::{ColorParam, Texture};

const EMITTERS: [&str; 7] = ["area", "point", "spot", "directional", "constant", "envmap", "projector"];
const PLANNED: [&str; 7] = ["directionalarea", "sunsky", "sun", "sky", "collimated", "timed_sunsky", "blackbody"];

impl<'d> Loader<'d> {
    /// The radiance of an emitting shape (W·m⁻²·sr⁻¹).
    pub(super) fn area_radiance(&mut self, child: &'d Child) -> Result<ColorParam, SceneError> {
        let q = Query::new(self.doc, child.node);
        if q.plugin() != "area" {
            if !EMITTERS.contains(&q.plugin()) {
                return Err(q.unknown_plugin(&["area"], &PLANNED));
            }
            return Err(q
                .error(format!("the emitter \"{}\" inside of a shape", q.plugin()))
                .help("only \"area\" belongs to a shape; move this one to the scene"));
        }
        let radiance = self.color_param(&q, "radiance", Rgb::WHITE, ColorUse::Emission)?;
        photon_share(&q)?;
        q.ignore(&["sampling_weight"]);
        q.finish()?;
        Ok(radiance)
    }

    /// A light that stands in the scene by itself.
    pub(super) fn emitter(
        &mut self,
        child: &'d Child,
        to_scene: &ToScene,
        geometry: &GeometrySet,
    ) -> Result<Light, SceneError> {
        let q = Query::new(self.doc, child.node);
        let s = to_scene.scale as f32;
        let light = match q.plugin() {
            "area" => {
                return Err(q.error("an area emitter outside of a shape").help("move it into the <shape> that emits"));
            }
            "point" => {
                let position = match q.vector("position")? {
                    Some(p) if !q.has("to_world") => p,
                    Some(_) => return Err(both(&q, "position")),
                    None => q.transform("to_world")?.transform_point3(DVec3::ZERO),
                };
                let intensity = self.emission(&q, "intensity")? * (s * s);
                Light::Point(Point { position: to_scene.point(position), intensity })
            }
            "spot" => {
                let cutoff = angle(&q, "cutoff_angle", 20.0)?;
                let beam = match q.float("beam_width")? {
                    None => 0.75 * cutoff,
                    Some(b) if (0.0..=cutoff).contains(&b) => b,
                    Some(b) => {
                        return Err(q
                            .error_at("beam_width", format!("\"beam_width\" is {b}"))
                            .help("it must be between 0 and cutoff_angle"));
                    }
                };
                let to_world = self.placed(&q, to_scene)?;
                let intensity = self.emission(&q, "intensity")? * (s * s);
                let spot = Spot::new(&to_world, intensity, cutoff.to_radians() as f32, beam.to_radians() as f32);
                match self.slide(&q, "texture", intensity.is_black())? {
                    ColorParam::Const(c) if c == Rgb::WHITE || intensity.is_black() => Light::Spot(spot),
                    slide => Light::Spot(spot.with_slide(geometry, &self.textures, slide)),
                }
            }
            "directional" => {
                let direction = match q.vector("direction")? {
                    Some(d) if !q.has("to_world") => d,
                    Some(_) => return Err(both(&q, "direction")),
                    None => q.transform("to_world")?.transform_vector3(DVec3::Z),
                };
                let Some(direction) = direction.try_normalize() else {
                    return Err(q.error_at("direction", "the direction is zero").help("give a vector with a length"));
                };
                Light::Directional(Directional {
                    direction: direction.as_vec3(),
                    irradiance: self.emission(&q, "irradiance")?,
                })
            }
            "constant" => Light::Constant(Constant { radiance: self.emission(&q, "radiance")? }),
            "envmap" => self.envmap(&q)?,
            "projector" => self.projector(&q, to_scene, geometry)?,
            _ => return Err(q.unknown_plugin(&EMITTERS, &PLANNED)),
        };
        photon_share(&q)?;
        q.ignore(&["sampling_weight"]);
        q.finish()?;
        Ok(light)
    }

    /// What colours a light. That of one that emits nothing is checked, and its file is not read.
    fn slide(&mut self, q: &Query<'d>, name: &str, dark: bool) -> Result<ColorParam, SceneError> {
        let used = self.used();
        self.unused |= dark;
        let slide = self.color_param(q, name, Rgb::WHITE, ColorUse::Emission)?;
        if !dark {
            return Ok(slide);
        }
        self.forget(used);
        Ok(ColorParam::Const(Rgb::BLACK))
    }

    fn emission(&self, q: &Query, name: &str) -> Result<Rgb, SceneError> {
        Ok(q.color(name, ColorUse::Emission)?.unwrap_or(Rgb::WHITE))
    }

    /// `to_world` of a light, into the scene box.
    fn placed(&self, q: &Query, to_scene: &ToScene) -> Result<Transform, SceneError> {
        invertible(q, "to_world", to_scene.matrix() * q.transform("to_world")?)
    }

    fn envmap(&mut self, q: &Query) -> Result<Light, SceneError> {
        let Some(path) = q.file("filename")? else {
            return Err(q.error("the envmap has no \"filename\"").help("add <string name=\"filename\" value=\"…\"/>"));
        };
        let scale = q.float_or("scale", 1.0)?;
        if scale < 0.0 {
            return Err(q.error_at("scale", format!("\"scale\" is {scale}")).help("it must not be negative"));
        }
        let rotation = invertible(q, "to_world", q.transform("to_world")?)?;
        q.ignore(&["mis_compensation", "cache", "gamma"]);
        // Nothing of a picture that is scaled to black is seen.
        if scale == 0.0 {
            return Ok(Light::Constant(Constant { radiance: Rgb::BLACK }));
        }
        if let Some(pictures) = &mut self.pictures {
            let size = crate::image::size(&path).map_err(|e| SceneError::at(q.pos("filename"), e.to_string()))?;
            pictures.push(PicturePrediction::envmap(path, size));
            return Ok(Light::Constant(Constant { radiance: Rgb::WHITE }));
        }
        let image = crate::image::read(&path).map_err(|e| SceneError::at(q.pos("filename"), e.to_string()))?;
        self.hash_file(&path, q.pos("filename"))?;
        let (width, height) = (image.width(), image.height());
        if let Some(i) = image.pixels().iter().position(|p| !(p.is_finite() && p.min_channel() >= 0.0)) {
            let (x, y) = (i % width as usize, i / width as usize);
            let message = format!("\"{}\": the pixel at column {x}, row {y} is negative or not finite", path.display());
            return Err(SceneError::at(q.pos("filename"), message).help("light is 0 or more"));
        }
        let pixels = image.pixels().to_vec();
        Ok(Light::EnvMap(EnvMap::new(width as usize, height as usize, pixels, scale as f32, &rotation)))
    }

    fn projector(&mut self, q: &Query<'d>, to_scene: &ToScene, geometry: &GeometrySet) -> Result<Light, SceneError> {
        let to_world = self.placed(q, to_scene)?;
        let s = to_scene.scale as f32;
        let scale = q.float_or("scale", 1.0)? as f32 * s * s;
        let slide = self.slide(q, "irradiance", scale == 0.0)?;
        // A bitmap has the proportions of its pixels, anything else is square.
        let aspect = match slide {
            ColorParam::Texture(id) => match self.textures.get(id) {
                Texture::Bitmap(b) => f64::from(b.resolution().0) / f64::from(b.resolution().1),
                _ => 1.0,
            },
            ColorParam::Const(_) => 1.0,
        };
        let fov_x = super::sensors::fov_x(q, aspect)?;
        Ok(Light::Projector(Projector::new(geometry, &self.textures, &to_world, (fov_x, aspect), slide, scale)))
    }
}

/// The share of the emitted photons that a light asks for.
pub(super) fn photon_share(q: &Query) -> Result<Option<f64>, SceneError> {
    match q.float("photon_share")? {
        Some(v) if !(0.0..=1.0).contains(&v) => Err(q
            .error_at("photon_share", format!("\"photon_share\" is {v}"))
            .help("it must be between 0 and 1: the share of all photons that this light emits")),
        v => Ok(v),
    }
}

fn angle(q: &Query, name: &str, default: f64) -> Result<f64, SceneError> {
    match q.float_or(name, default)? {
        v if v > 0.0 && v < 180.0 => Ok(v),
        v => Err(q.error_at(name, format!("\"{name}\" is {v}")).help("it must be between 0 and 180 degrees")),
    }
}

fn both(q: &Query, name: &str) -> SceneError {
    q.error_at(name, format!("both \"{name}\" and \"to_world\"")).help("give one of them")
}
