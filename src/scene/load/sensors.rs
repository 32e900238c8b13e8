//! Sensors with their film, reconstruction filter and sampler.

use glam::{DMat4, DVec3, Vec2};

use super::super::xml::{Child, Query, Tag};
use super::super::{FilmSettings, LoadOptions, SamplerSettings, SceneError};
use super::shapes::invertible;
use super::{Loader, ToScene, integrators};
use crate::camera::{Camera, CameraSettings, FilmWindow, FovAxis, Lens, fov_from_focal_length};
use crate::film::{MAX_RADIUS, ReconstructionFilter};
use crate::math::{Bounds3, Transform};

const SENSORS: [&str; 3] = ["perspective", "thinlens", "orthographic"];
const PLANNED_SENSORS: [&str; 12] = [
    "batch",
    "distant",
    "irradiancemeter",
    "radiancemeter",
    "fluencemeter",
    "telecentric",
    "spherical",
    "perspective_rdist",
    "orthographic_rdist",
    "thinlens_rdist",
    "mradiancemeter",
    "environment",
];

/// The horizontal field of view in radians, as Mitsuba finds it from fov and fov_axis or focal_length.
pub(super) fn fov_x(q: &Query, aspect: f64) -> Result<f64, SceneError> {
    let axes = [
        ("x", FovAxis::X),
        ("y", FovAxis::Y),
        ("diagonal", FovAxis::Diagonal),
        ("smaller", FovAxis::Smaller),
        ("larger", FovAxis::Larger),
    ];
    let axis = q.choice("fov_axis", FovAxis::X, &axes)?;
    let (name, fov, axis) = match (q.float("fov")?, q.string("focal_length")?) {
        (Some(_), Some(_)) => {
            return Err(q.error_at("focal_length", "both \"fov\" and \"focal_length\"").help("give one of them"));
        }
        (Some(fov), None) => ("fov", fov.to_radians(), axis),
        (None, length) => {
            let text = length.unwrap_or("50mm").trim();
            let number = text.strip_suffix("mm").unwrap_or(text).trim().parse::<f64>();
            let Some(mm) = number.ok().filter(|f| f.is_finite() && *f > 0.0) else {
                return Err(q
                    .error_at("focal_length", format!("\"{text}\" is not a focal length"))
                    .help("write it as \"50mm\""));
            };
            ("focal_length", fov_from_focal_length(mm), FovAxis::Diagonal)
        }
    };
    let wide = || axis.fov_x(fov, aspect);
    if !(fov > 0.0 && fov < std::f64::consts::PI && wide() > 0.0) {
        return Err(q
            .error_at(name, format!("the field of view is {} degrees", fov.to_degrees()))
            .help("it must be between 0 and 180 degrees"));
    }
    Ok(wide())
}

/// The view of a scene.
pub(super) struct Sensor {
    pub camera: Camera,
    pub film: FilmSettings,
    pub sampler: SamplerSettings,
}

impl<'d> Loader<'d> {
    /// The first sensor of the scene, as in Mitsuba; without one a perspective camera that sees everything.
    pub(super) fn sensor(
        &mut self,
        sensors: &[&'d Child],
        view: &View,
        options: &LoadOptions,
    ) -> Result<Sensor, SceneError> {
        for extra in sensors.iter().skip(1) {
            self.doc.warn(&extra.pos, "the scene has another sensor before this one, which is used");
        }
        let Some(child) = sensors.first() else { return Ok(default_sensor(view, options)) };
        let q = Query::new(self.doc, child.node);
        self.refuse_media(&q)?;
        if !SENSORS.contains(&q.plugin()) {
            return Err(q.unknown_plugin(&SENSORS, &PLANNED_SENSORS));
        }
        let film = match q.child(Tag::Film)? {
            Some(film) => film_settings(Query::new(self.doc, film.node), options)?,
            None => default_film(options),
        };
        let sampler = match q.child(Tag::Sampler)? {
            Some(sampler) => integrators::sampler(Query::new(self.doc, sampler.node))?,
            None => SamplerSettings::default(),
        };
        let camera = camera(&q, film.window, view.to_scene)?;
        q.ignore(&["shutter_open", "shutter_close", "kc", "srf"]);
        q.finish()?;
        Ok(Sensor { camera, film, sampler })
    }
}

/// What a sensor needs to know of the scene.
pub(super) struct View<'a> {
    pub to_scene: &'a ToScene,
    /// The scene's box, in scene units.
    pub bounds: Bounds3,
}

fn camera(q: &Query, window: FilmWindow, to_scene: &ToScene) -> Result<Camera, SceneError> {
    let length = |name: &str, default: f64| -> Result<f32, SceneError> {
        match q.float(name)? {
            None => Ok((default * to_scene.scale) as f32),
            Some(v) if v > 0.0 => Ok((v * to_scene.scale) as f32),
            Some(v) => Err(q.error_at(name, format!("\"{name}\" is {v}")).help("it must be above zero")),
        }
    };
    let settings = CameraSettings {
        to_world: invertible(q, "to_world", to_scene.matrix() * q.transform("to_world")?)?,
        window,
        // Mitsuba's own default distances are of no use in a scene of another size.
        near_clip: length("near_clip", 0.0)?,
        far_clip: length("far_clip", f64::INFINITY)?,
    };
    if settings.near_clip >= settings.far_clip {
        return Err(q
            .error_at("far_clip", "far_clip is not beyond near_clip")
            .help("near_clip must be the smaller one"));
    }
    if q.plugin() == "orthographic" {
        return Ok(Camera::orthographic(&settings));
    }
    let offset = |name| q.float_or(name, 0.0).map(|v| v as f32);
    let principal = Vec2::new(offset("principal_point_offset_x")?, offset("principal_point_offset_y")?);
    let lens = if q.plugin() == "thinlens" {
        if !q.has("aperture_radius") {
            return Err(q.error("the thinlens has no \"aperture_radius\"").help("add a float of that name"));
        }
        // Without a focus distance Mitsuba focuses on the far clipping plane, by default at 10⁴.
        let far = q.float_or("far_clip", 1e4)?;
        Some(Lens { aperture_radius: length("aperture_radius", 0.0)?, focus_distance: length("focus_distance", far)? })
    } else {
        None
    };
    Ok(Camera::perspective(&settings, fov_x(q, window.aspect())?, principal, lens))
}

/// Like Mitsuba without a sensor: from before the scene's box along +z, 45 degrees wide; with all of the box in view.
fn default_sensor(view: &View, options: &LoadOptions) -> Sensor {
    let film = default_film(options);
    let (center, extent) = (view.bounds.center().as_dvec3(), view.bounds.extent().as_dvec3());
    let fov_x = 45f64.to_radians();
    let tan_x = (0.5 * fov_x).tan();
    let reach = f64::max(extent.x, extent.y * film.window.aspect());
    let distance = 0.55 * reach.max(0.1 * extent.z) / tan_x;
    let eye = DVec3::new(center.x, center.y, f64::from(view.bounds.min.z) - distance);
    let to_world = Transform::new(DMat4::from_translation(eye)).expect("a translation has an inverse");
    let settings = CameraSettings { to_world, window: film.window, near_clip: 0.0, far_clip: f32::INFINITY };
    let camera = Camera::perspective(&settings, fov_x, Vec2::ZERO, None);
    Sensor { camera, film, sampler: SamplerSettings::default() }
}

/// Size of the film and of its crop window, in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct FilmSize {
    full: [u32; 2],
    crop: [u32; 2],
    offset: [u32; 2],
}

/// Mitsuba's film without parameters.
const DEFAULT_SIZE: [u32; 2] = [768, 576];

/// No side is longer, and no film has more pixels than this.
const MAX_SIDE: i64 = 1 << 20;
const MAX_PIXELS: u64 = 1 << 30;

impl FilmSize {
    fn whole(full: [u32; 2]) -> Self {
        Self { full, crop: full, offset: [0, 0] }
    }

    fn read(q: &Query) -> Result<Self, SceneError> {
        let side = |name: &str, default: u32, least: i64| -> Result<u32, SceneError> {
            Ok(q.int_in(name, least..=MAX_SIDE)?.map_or(default, |v| v as u32))
        };
        let full = [side("width", DEFAULT_SIZE[0], 1)?, side("height", DEFAULT_SIZE[1], 1)?];
        let offset = [side("crop_offset_x", 0, 0)?, side("crop_offset_y", 0, 0)?];
        let crop = [side("crop_width", full[0], 1)?, side("crop_height", full[1], 1)?];
        for (i, name) in [(0, "crop_width"), (1, "crop_height")] {
            if u64::from(offset[i]) + u64::from(crop[i]) > u64::from(full[i]) {
                let message = format!("the crop window ends at {} of {} pixels", offset[i] + crop[i], full[i]);
                return Err(q.error_at(name, message).help("offset plus size must stay within the film"));
            }
        }
        if u64::from(crop[0]) * u64::from(crop[1]) > MAX_PIXELS {
            let message = format!("the film has {} x {} pixels", crop[0], crop[1]);
            return Err(q.error_at("width", message).help(format!("at most {MAX_PIXELS} are possible")));
        }
        Ok(Self { full, crop, offset })
    }

    /// The size that the command line asks for; a crop window keeps its place in the picture.
    fn overridden(self, options: &LoadOptions) -> Self {
        let [w, h] = self.full.map(u64::from);
        let side = |v: u64| v.clamp(1, MAX_SIDE as u64) as u32;
        let full = match (options.width, options.height) {
            (None, None) => return self,
            (Some(nw), Some(nh)) => [side(nw.into()), side(nh.into())],
            (Some(nw), None) => [side(nw.into()), side((u64::from(nw) * h + w / 2) / w)],
            (None, Some(nh)) => [side((u64::from(nh) * w + h / 2) / h), side(nh.into())],
        };
        let rescaled = |i: usize, v: u32| (u64::from(v) * u64::from(full[i]) / u64::from(self.full[i])) as u32;
        let offset = [rescaled(0, self.offset[0]), rescaled(1, self.offset[1])];
        let end = |i: usize| rescaled(i, self.offset[i] + self.crop[i]).max(offset[i] + 1).min(full[i]);
        let offset = [offset[0].min(full[0] - 1), offset[1].min(full[1] - 1)];
        Self { full, crop: [end(0) - offset[0], end(1) - offset[1]], offset }
    }
}

const FILMS: [&str; 2] = ["hdrfilm", "ldrfilm"];
const FILTERS: [&str; 6] = ["box", "tent", "gaussian", "mitchell", "catmullrom", "lanczos"];

fn film_settings(q: Query, options: &LoadOptions) -> Result<FilmSettings, SceneError> {
    if !FILMS.contains(&q.plugin()) {
        return Err(q.unknown_plugin(&FILMS, &["specfilm", "mfilm", "tiledhdrfilm"]));
    }
    let size = FilmSize::read(&q)?.overridden(options);
    let filter = match q.child(Tag::Rfilter)? {
        Some(child) => filter(Query::new(q.doc(), child.node))?,
        None => ReconstructionFilter::default(),
    };
    // How a file is written is said on the command line.
    for name in ["file_format", "pixel_format", "component_format", "variable", "metadata"] {
        q.string(name)?;
    }
    for name in ["banner", "attach_log", "compensate", "sample_border", "high_quality_edges"] {
        q.bool(name, false)?;
    }
    q.ignore(&["gamma", "exposure", "tonemap_method", "key", "burn", "label"]);
    q.finish()?;
    Ok(film_of(size, filter))
}

fn filter(q: Query) -> Result<ReconstructionFilter, SceneError> {
    let filter = match q.plugin() {
        "box" => ReconstructionFilter::Box,
        "tent" => ReconstructionFilter::Tent { radius: q.positive("radius", 1.0)? as f32 },
        "gaussian" => ReconstructionFilter::Gaussian { stddev: q.positive("stddev", 0.5)? as f32 },
        "mitchell" => ReconstructionFilter::Mitchell { b: mitchell(&q, "B", "b")?, c: mitchell(&q, "C", "c")? },
        "catmullrom" => ReconstructionFilter::CatmullRom,
        "lanczos" => ReconstructionFilter::Lanczos { lobes: q.int_in("lobes", 1..=15)?.unwrap_or(3) as u32 },
        _ => return Err(q.unknown_plugin(&FILTERS, &[])),
    };
    let (name, reach) = match filter {
        ReconstructionFilter::Tent { radius } => ("radius", radius),
        ReconstructionFilter::Gaussian { stddev } => ("stddev", 4.0 * stddev),
        _ => ("radius", filter.radius()),
    };
    if reach > MAX_RADIUS {
        return Err(q
            .error_at(name, format!("the filter reaches {reach} pixels far"))
            .help(format!("at most {MAX_RADIUS} are possible")));
    }
    q.finish()?;
    Ok(filter)
}

/// Mitsuba names the parameters in capitals.
fn mitchell(q: &Query, name: &str, lower: &str) -> Result<f32, SceneError> {
    let third = 1.0 / 3.0;
    Ok(match q.float(name)? {
        Some(v) => v as f32,
        None => q.float_or(lower, third)? as f32,
    })
}

fn default_film(options: &LoadOptions) -> FilmSettings {
    film_of(FilmSize::whole(DEFAULT_SIZE).overridden(options), ReconstructionFilter::default())
}

fn film_of(size: FilmSize, filter: ReconstructionFilter) -> FilmSettings {
    let pair = |v: [u32; 2]| (v[0], v[1]);
    let window = FilmWindow { size: pair(size.full), crop_offset: pair(size.offset), crop_size: pair(size.crop) };
    FilmSettings { width: size.crop[0], height: size.crop[1], window, filter }
}
