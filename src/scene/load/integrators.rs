//! Integrators and samplers: names and parameters, checked but not interpreted.

use super::super::settings::ParamValue;
use super::super::xml::{Query, Tag};
use super::super::{IntegratorSettings, SamplerSettings, SceneError};
use crate::sample::Sequence;

/// What kind of value a parameter has.
#[derive(Clone, Copy)]
enum Kind {
    /// −1 or a count.
    Depth,
    Count,
    /// Above zero.
    Size,
    /// Zero or above.
    Length,
    /// Between 0 and 1.
    Fraction,
    Switch,
    /// One of these words.
    Word(&'static [&'static str]),
    /// Of Mitsuba, without meaning here.
    Ignored,
}

use Kind::*;

type Params = &'static [(&'static str, Kind)];

const COMMON: Params = &[
    ("max_depth", Depth),
    ("rr_depth", Count),
    ("hide_emitters", Switch),
    ("timeout", Ignored),
    ("samples_per_pass", Ignored),
    ("block_size", Ignored),
    ("strict_normals", Ignored),
    ("granularity", Ignored),
    ("auto_cancel_gathering", Ignored),
];

const INTEGRATORS: &[(&str, Params)] = &[
    ("path", &[]),
    ("direct", &[("shading_samples", Count), ("emitter_samples", Count), ("bsdf_samples", Count)]),
    (
        "photonmapper",
        &[
            ("direct_samples", Count),
            ("glossy_samples", Count),
            ("global_photons", Count),
            ("caustic_photons", Count),
            ("volume_photons", Count),
            ("shadow_photons", Count),
            ("global_lookup_radius", Size),
            ("caustic_lookup_radius", Size),
            ("lookup_size", Count),
            ("caustic_lookup_size", Count),
            ("disc_height", Size),
            ("convex_hull", Switch),
            ("even_photons", Switch),
            ("final_gather", Switch),
            ("final_gather_samples", Count),
            ("guided_emission", Switch),
            ("irradiance_photons", Switch),
            ("irradiance_cache", Switch),
            ("resolution", Count),
            ("quality", Size),
            ("cache_metric", Word(&["split_sphere", "hessian"])),
            ("gradients", Switch),
            ("clamp_neighbor", Switch),
            ("clamp_screen", Switch),
        ],
    ),
    ("ppm", PROGRESSIVE),
    ("sppm", PROGRESSIVE),
    (
        "vcm",
        &[
            ("initial_radius", Size),
            ("radius_scale", Size),
            ("alpha", Fraction),
            ("max_passes", Depth),
            ("light_image", Switch),
            ("connect", Switch),
            ("connect_vertices", Switch),
            ("correlation_aware", Switch),
            ("efficiency_aware", Switch),
            ("guided_emission", Switch),
            ("light_paths", Count),
            ("merge", Switch),
            ("merge_all", Switch),
        ],
    ),
    (
        "bdpt",
        &[
            ("light_image", Switch),
            ("connect_vertices", Switch),
            ("efficiency_aware", Switch),
            ("guided_emission", Switch),
            ("sample_direct", Switch),
        ],
    ),
    ("ptracer", &[("samples_per_pass", Ignored), ("guided_emission", Switch)]),
    ("volpath", &[]),
    ("volpathmis", &[]),
    ("auto", &[]),
];

const PROGRESSIVE: Params = &[
    ("photon_count", Count),
    ("initial_radius", Length),
    ("radius_scale", Size),
    ("alpha", Fraction),
    ("max_passes", Depth),
    ("photons_per_pass", Count),
    ("samples_per_pass", Count),
    ("lookup_size", Count),
    ("radius_floor", Length),
    ("shared_statistics", Switch),
    ("chi_squared_radius", Switch),
    ("boundary_correction", Switch),
    ("photon_sampling", Word(&["independent", "visibility"])),
];

/// Integrators of Mitsuba that are known and not here.
const PLANNED: &[&str] = &[
    "aov",
    "depth",
    "moment",
    "stokes",
    "prb",
    "volpath_simple",
    "mlt",
    "pssmlt",
    "erpt",
    "vpl",
    "adaptive",
    "irrcache",
    "multichannel",
    "prb_basic",
    "direct_projective",
];

pub(super) fn integrator(q: Query) -> Result<IntegratorSettings, SceneError> {
    let known: Vec<&str> = INTEGRATORS.iter().map(|i| i.0).collect();
    let Some((name, own)) = INTEGRATORS.iter().find(|i| i.0 == q.plugin()) else {
        return Err(q.unknown_plugin(&known, PLANNED));
    };
    let mut settings = IntegratorSettings { name: (*name).into(), ..Default::default() };
    for &(param, kind) in own.iter().chain(COMMON) {
        if let Some(value) = parameter(&q, param, kind)? {
            settings.params.insert(param.into(), value);
        }
    }
    if q.has("shading_samples") && (q.has("emitter_samples") || q.has("bsdf_samples")) {
        return Err(q
            .error_at("shading_samples", "both \"shading_samples\" and a count for one of the techniques")
            .help("give shading_samples, or emitter_samples and bsdf_samples"));
    }
    if settings.integer("emitter_samples") == Some(0) && settings.integer("bsdf_samples") == Some(0) {
        return Err(q.error("neither emitter_samples nor bsdf_samples is above zero").help("take at least one sample"));
    }
    if settings.boolean("chi_squared_radius") == Some(true) && settings.boolean("shared_statistics") == Some(false) {
        return Err(q.error_at("chi_squared_radius", "\"chi_squared_radius\" without \"shared_statistics\"").help(
            "radii that follow a test of all photons found so far need statistics: leave shared_statistics out",
        ));
    }
    if settings.boolean("chi_squared_radius") == Some(true) && settings.string("photon_sampling") == Some("visibility")
    {
        return Err(q.error_at("chi_squared_radius", "\"chi_squared_radius\" with photon_sampling \"visibility\"").help(
            "photons of Markov chains are not independent, so that a test would find them uneven: leave one of the two out",
        ));
    }
    if settings.boolean("correlation_aware") == Some(true)
        && settings.boolean("merge") == Some(false)
        && settings.boolean("merge_all") != Some(true)
        && settings.boolean("connect") != Some(false)
    {
        return Err(q
            .error_at("correlation_aware", "\"correlation_aware\" without merging")
            .help("it weighs merges, and \"merge\" is false here: leave one of the two out"));
    }
    q.finish()?;
    Ok(settings)
}

fn parameter(q: &Query, name: &str, kind: Kind) -> Result<Option<ParamValue>, SceneError> {
    const MOST: i64 = 1 << 40;
    Ok(match kind {
        Depth => q.int_in(name, -1..=i64::from(u32::MAX))?.map(ParamValue::Integer),
        Count => q.int_in(name, 0..=MOST)?.map(ParamValue::Integer),
        Size if !q.has(name) => {
            q.prop(name);
            None
        }
        Size => Some(ParamValue::Float(q.positive(name, 1.0)?)),
        Length => match q.float(name)? {
            Some(v) if !(v >= 0.0 && v.is_finite()) => {
                return Err(q.error_at(name, format!("\"{name}\" is {v}")).help("it must be zero or above"));
            }
            v => v.map(ParamValue::Float),
        },
        Fraction => match q.float(name)? {
            Some(v) if !(0.0..=1.0).contains(&v) => {
                return Err(q.error_at(name, format!("\"{name}\" is {v}")).help("it must be between 0 and 1"));
            }
            v => v.map(ParamValue::Float),
        },
        Switch if !q.has(name) => {
            q.prop(name);
            None
        }
        Switch => Some(ParamValue::Boolean(q.bool(name, false)?)),
        Word(known) => {
            let words: Vec<(&str, &str)> = known.iter().map(|&w| (w, w)).collect();
            let word = q.choice(name, "", &words)?;
            (!word.is_empty()).then(|| ParamValue::String(word.to_owned()))
        }
        Ignored => {
            q.ignore(&[name]);
            None
        }
    })
}

const SAMPLERS: &[&str] =
    &["independent", "stratified", "multijitter", "orthogonal", "ldsampler", "halton", "hammersley", "sobol"];

/// Mitsuba's samplers map to our keyed sequences: `independent` to independent numbers, all others to Owen-scrambled
/// Sobol' points.
pub(super) fn sampler(q: Query) -> Result<SamplerSettings, SceneError> {
    if !SAMPLERS.contains(&q.plugin()) {
        return Err(q.unknown_plugin(SAMPLERS, &["pssmlt"]));
    }
    let sequence = if q.plugin() == "independent" { Sequence::Independent } else { Sequence::Sobol };
    let spp = q.int_in("sample_count", 1..=i64::from(u32::MAX))?.unwrap_or(4) as u64;
    let seed = q.int_in("seed", 0..=i64::MAX)?.unwrap_or(0) as u64;
    q.ignore(&["jitter", "strength", "dimension", "scramble"]);
    q.finish()?;
    Ok(SamplerSettings { sequence, spp, seed })
}

/// The scene's only integrator; Mitsuba's default without one.
pub(super) fn of_scene(scene: &Query) -> Result<IntegratorSettings, SceneError> {
    match scene.child(Tag::Integrator)? {
        Some(child) => integrator(Query::new(scene.doc(), child.node)),
        None => Ok(IntegratorSettings::default()),
    }
}
