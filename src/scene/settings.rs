use std::collections::BTreeMap;

use crate::camera::FilmWindow;
use crate::film::ReconstructionFilter;
use crate::sample::Sequence;

/// A parameter of an integrator.
#[derive(Clone, Debug, PartialEq)]
pub enum ParamValue {
    Integer(i64),
    Float(f64),
    Boolean(bool),
    String(String),
}

/// The integrator that a scene file asks for: its name and the parameters that were given.
#[derive(Clone, Debug, PartialEq)]
pub struct IntegratorSettings {
    pub name: String,
    pub params: BTreeMap<String, ParamValue>,
}

impl Default for IntegratorSettings {
    /// Mitsuba's default.
    fn default() -> Self {
        Self { name: "path".into(), params: BTreeMap::new() }
    }
}

impl IntegratorSettings {
    /// An integer parameter, when it was given.
    pub fn integer(&self, name: &str) -> Option<i64> {
        match self.params.get(name) {
            Some(ParamValue::Integer(v)) => Some(*v),
            _ => None,
        }
    }

    /// A number, when it was given.
    pub fn float(&self, name: &str) -> Option<f32> {
        match self.params.get(name) {
            Some(ParamValue::Float(v)) => Some(*v as f32),
            Some(ParamValue::Integer(v)) => Some(*v as f32),
            _ => None,
        }
    }

    /// A switch, when it was given.
    pub fn boolean(&self, name: &str) -> Option<bool> {
        match self.params.get(name) {
            Some(ParamValue::Boolean(v)) => Some(*v),
            _ => None,
        }
    }

    /// A word, when it was given.
    pub fn string(&self, name: &str) -> Option<&str> {
        match self.params.get(name) {
            Some(ParamValue::String(v)) => Some(v),
            _ => None,
        }
    }
}

/// The camera samples that a scene file asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SamplerSettings {
    pub sequence: Sequence,
    /// Samples per pixel.
    pub spp: u64,
    pub seed: u64,
}

impl Default for SamplerSettings {
    fn default() -> Self {
        Self { sequence: Sequence::Sobol, spp: 4, seed: 0 }
    }
}

/// The film that a scene file asks for, after the command line's say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmSettings {
    /// Pixels of the picture: those of the crop window.
    pub width: u32,
    pub height: u32,
    /// The crop window in the whole film.
    pub window: FilmWindow,
    pub filter: ReconstructionFilter,
}
