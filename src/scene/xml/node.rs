use glam::{DMat4, DVec3};

use super::super::Position;

/// Index of a [`Node`] in its [`Document`](super::Document).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeId(pub(super) u32);

/// The kinds of objects that a scene file declares.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Tag {
    Scene,
    Shape,
    Bsdf,
    Texture,
    Emitter,
    Sensor,
    Film,
    Sampler,
    Rfilter,
    Integrator,
    Medium,
    Volume,
    Phase,
    Subsurface,
}

impl Tag {
    /// The element names, newest first; `luminaire` and `camera` are those of Mitsuba 0.2.
    pub(super) const NAMES: [(&'static str, Tag); 16] = [
        ("scene", Tag::Scene),
        ("shape", Tag::Shape),
        ("bsdf", Tag::Bsdf),
        ("texture", Tag::Texture),
        ("emitter", Tag::Emitter),
        ("sensor", Tag::Sensor),
        ("film", Tag::Film),
        ("sampler", Tag::Sampler),
        ("rfilter", Tag::Rfilter),
        ("integrator", Tag::Integrator),
        ("medium", Tag::Medium),
        ("volume", Tag::Volume),
        ("phase", Tag::Phase),
        ("subsurface", Tag::Subsurface),
        ("luminaire", Tag::Emitter),
        ("camera", Tag::Sensor),
    ];

    pub(super) fn from_name(name: &str) -> Option<Self> {
        Self::NAMES.iter().find(|(n, _)| *n == name).map(|&(_, tag)| tag)
    }

    /// The element's name in a scene file.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, tag)| *tag == self).map_or("object", |(n, _)| n)
    }
}

/// A colour as written, before it is known whether it is a reflectance or an emission.
#[derive(Clone, Debug, PartialEq)]
pub enum ColorSource {
    /// Linear Rec. 709.
    Rgb([f64; 3]),
    /// The same value at every wavelength.
    Constant(f64),
    /// (wavelength in nm, value), in rising order, linear in between and zero outside.
    Samples(Vec<(f64, f64)>),
    /// Planck's law, temperature in kelvin.
    Blackbody { temperature: f64, scale: f64 },
    /// CIE standard illuminant D65, scaled so that it is white of luminance `scale`.
    D65 { scale: f64 },
}

/// The typed value of a property.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    Bool(bool),
    Int(i64),
    Float(f64),
    String(String),
    Vector(DVec3),
    Transform(DMat4),
    Color(ColorSource),
}

impl Value {
    pub(super) fn kind(&self) -> &'static str {
        match self {
            Value::Bool(_) => "a boolean",
            Value::Int(_) => "an integer",
            Value::Float(_) => "a float",
            Value::String(_) => "a string",
            Value::Vector(_) => "a vector",
            Value::Transform(_) => "a transform",
            Value::Color(_) => "a colour",
        }
    }
}

/// A named value of an object.
#[derive(Clone, Debug)]
pub struct Prop {
    pub name: String,
    pub value: Value,
    pub pos: Position,
}

/// An object inside an object, written in place or referred to.
#[derive(Clone, Debug)]
pub struct Child {
    pub name: Option<String>,
    pub node: NodeId,
    /// Where the child or the reference to it is written.
    pub pos: Position,
}

/// One object of a scene file.
#[derive(Clone, Debug)]
pub struct Node {
    pub tag: Tag,
    /// The value of `type`; `scene` for the root.
    pub plugin: String,
    pub id: Option<String>,
    pub pos: Position,
    pub props: Vec<Prop>,
    pub children: Vec<Child>,
    /// Written for Mitsuba 0.x.
    pub legacy: bool,
}
