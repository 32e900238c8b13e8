use std::cell::RefCell;

use glam::{DMat4, DVec3};

use super::super::{Position, SceneError};
use super::{Child, ColorSource, Document, Node, NodeId, Prop, Tag, Value};
use crate::color::{Illuminant, Rgb, blackbody_to_rgb, spectrum_to_rgb};

/// What a colour stands for; a spectrum is converted accordingly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorUse {
    /// Seen under D65, each channel within [0, 1].
    Reflectance,
    /// Seen under D65, without bounds; for example a metal's index of refraction.
    Unbounded,
    /// Light by itself, not negative.
    Emission,
}

/// A colour-valued parameter.
#[derive(Clone, Debug)]
pub enum ColorArg<'d> {
    Value(Rgb),
    Texture(&'d Child),
}

/// Reads one object's properties. What was asked for is what is known: [`Query::finish`] refuses the rest.
pub struct Query<'d> {
    doc: &'d Document,
    node: &'d Node,
    id: NodeId,
    asked: RefCell<Vec<String>>,
    taken: RefCell<Vec<usize>>,
}

impl<'d> Query<'d> {
    pub fn new(doc: &'d Document, id: NodeId) -> Self {
        Self { doc, node: doc.node(id), id, asked: RefCell::default(), taken: RefCell::default() }
    }

    pub fn node(&self) -> &'d Node {
        self.node
    }

    pub fn id(&self) -> NodeId {
        self.id
    }

    pub fn doc(&self) -> &'d Document {
        self.doc
    }

    pub fn plugin(&self) -> &'d str {
        &self.node.plugin
    }

    /// An error at this object.
    pub fn error(&self, message: impl Into<String>) -> SceneError {
        SceneError::at(&self.node.pos, message)
    }

    /// An error at one of its properties or named children, or at the object when it has none of that name.
    pub fn error_at(&self, name: &str, message: impl Into<String>) -> SceneError {
        SceneError::at(self.pos(name), message)
    }

    /// Where a property or named child stands; the object itself when it has none of that name.
    pub fn pos(&self, name: &str) -> &'d Position {
        let prop = self.node.props.iter().find(|p| p.name == name).map(|p| &p.pos);
        let child = || self.node.children.iter().find(|c| c.name.as_deref() == Some(name)).map(|c| &c.pos);
        prop.or_else(child).unwrap_or(&self.node.pos)
    }

    pub fn has(&self, name: &str) -> bool {
        self.node.props.iter().any(|p| p.name == name)
            || self.node.children.iter().any(|c| c.name.as_deref() == Some(name))
    }

    pub fn prop(&self, name: &str) -> Option<&'d Prop> {
        self.asked.borrow_mut().push(name.to_owned());
        self.node.props.iter().find(|p| p.name == name)
    }

    fn mismatch<T>(&self, p: &Prop, wanted: &str) -> Result<T, SceneError> {
        let message = format!("\"{}\" is {}", p.name, p.value.kind());
        Err(SceneError::at(&p.pos, message).help(format!(
            "the {} plugin \"{}\" needs {wanted}",
            self.kind(),
            self.plugin()
        )))
    }

    /// The element name of this object.
    pub fn kind(&self) -> &'static str {
        self.node.tag.name()
    }

    pub fn bool(&self, name: &str, default: bool) -> Result<bool, SceneError> {
        match self.prop(name) {
            None => Ok(default),
            Some(Prop { value: Value::Bool(v), .. }) => Ok(*v),
            Some(p) => self.mismatch(p, "a boolean here"),
        }
    }

    pub fn int(&self, name: &str) -> Result<Option<i64>, SceneError> {
        match self.prop(name) {
            None => Ok(None),
            Some(Prop { value: Value::Int(v), .. }) => Ok(Some(*v)),
            Some(Prop { value: Value::Float(v), .. }) if v.fract() == 0.0 && v.abs() < 1e15 => Ok(Some(*v as i64)),
            Some(p) => self.mismatch(p, "an integer here"),
        }
    }

    /// An integer within a range.
    pub fn int_in(&self, name: &str, range: std::ops::RangeInclusive<i64>) -> Result<Option<i64>, SceneError> {
        match self.int(name)? {
            Some(v) if !range.contains(&v) => Err(self.error_at(name, format!("\"{name}\" is {v}")).help(format!(
                "it must be between {} and {}",
                range.start(),
                range.end()
            ))),
            v => Ok(v),
        }
    }

    pub fn float(&self, name: &str) -> Result<Option<f64>, SceneError> {
        match self.prop(name) {
            None => Ok(None),
            Some(Prop { value: Value::Float(v), .. }) => Ok(Some(*v)),
            Some(Prop { value: Value::Int(v), .. }) => Ok(Some(*v as f64)),
            Some(p) => self.mismatch(p, "a number here"),
        }
    }

    pub fn float_or(&self, name: &str, default: f64) -> Result<f64, SceneError> {
        Ok(self.float(name)?.unwrap_or(default))
    }

    /// A number above zero.
    pub fn positive(&self, name: &str, default: f64) -> Result<f64, SceneError> {
        match self.float_or(name, default)? {
            v if v > 0.0 => Ok(v),
            v => Err(self.error_at(name, format!("\"{name}\" is {v}")).help("it must be above zero")),
        }
    }

    pub fn string(&self, name: &str) -> Result<Option<&'d str>, SceneError> {
        match self.prop(name) {
            None => Ok(None),
            Some(Prop { value: Value::String(v), .. }) => Ok(Some(v)),
            Some(p) => self.mismatch(p, "a string here"),
        }
    }

    /// One of a closed set of words.
    pub fn choice<T: Copy>(&self, name: &str, default: T, known: &[(&str, T)]) -> Result<T, SceneError> {
        let Some(found) = self.string(name)? else { return Ok(default) };
        known.iter().find(|(word, _)| word.eq_ignore_ascii_case(found.trim())).map(|k| k.1).ok_or_else(|| {
            let words: Vec<&str> = known.iter().map(|k| k.0).collect();
            self.error_at(name, format!("unknown {name} \"{found}\"")).suggest(found, &words)
        })
    }

    pub fn vector(&self, name: &str) -> Result<Option<DVec3>, SceneError> {
        match self.prop(name) {
            None => Ok(None),
            Some(Prop { value: Value::Vector(v), .. }) => Ok(Some(*v)),
            Some(p) => self.mismatch(p, "a point or vector here"),
        }
    }

    pub fn transform(&self, name: &str) -> Result<DMat4, SceneError> {
        match self.prop(name) {
            None => Ok(DMat4::IDENTITY),
            Some(Prop { value: Value::Transform(m), .. }) => Ok(*m),
            Some(p) => self.mismatch(p, "a transform here"),
        }
    }

    /// A colour or a texture.
    pub fn color_arg(&self, name: &str, usage: ColorUse) -> Result<Option<ColorArg<'d>>, SceneError> {
        if let Some(child) = self.named_child(name) {
            return Ok(Some(match self.constant_spectrum(child, usage)? {
                Some(rgb) => ColorArg::Value(rgb),
                None => ColorArg::Texture(child),
            }));
        }
        let Some(p) = self.prop(name) else { return Ok(None) };
        let source = match &p.value {
            Value::Color(c) => c.clone(),
            Value::Float(v) => ColorSource::Constant(*v),
            Value::Int(v) => ColorSource::Constant(*v as f64),
            _ => return self.mismatch(p, "a colour or a texture here"),
        };
        to_rgb(&source, usage)
            .map(ColorArg::Value)
            .map(Some)
            .map_err(|m| SceneError::at(&p.pos, format!("\"{name}\": {}", m.0)).help(m.1))
    }

    /// A colour that cannot be a texture.
    pub fn color(&self, name: &str, usage: ColorUse) -> Result<Option<Rgb>, SceneError> {
        match self.color_arg(name, usage)? {
            None => Ok(None),
            Some(ColorArg::Value(rgb)) => Ok(Some(rgb)),
            Some(ColorArg::Texture(child)) => {
                Err(SceneError::at(&child.pos, format!("\"{name}\" is a texture"))
                    .help("only a colour is possible here"))
            }
        }
    }

    /// The value of a texture that is the same everywhere: `uniform`, `blackbody`, `d65`, `regular`, `irregular`, ….
    pub fn constant_spectrum(&self, child: &Child, usage: ColorUse) -> Result<Option<Rgb>, SceneError> {
        let q = Query::new(self.doc, child.node);
        let source = match q.plugin() {
            _ if q.node.tag != Tag::Texture => return Ok(None),
            "uniform" | "constant" | "rawconstant" => {
                let value = q.color("value", ColorUse::Unbounded)?.unwrap_or(Rgb::WHITE);
                ColorSource::Rgb(value.to_array().map(f64::from))
            }
            "srgb" => {
                let value = q.color("color", ColorUse::Unbounded)?.unwrap_or(Rgb::WHITE);
                ColorSource::Rgb(value.to_array().map(f64::from))
            }
            "blackbody" => {
                let temperature = q.positive("temperature", 5000.0)?;
                q.ignore(&["wavelength_min", "wavelength_max"]);
                ColorSource::Blackbody { temperature, scale: q.float_or("scale", 1.0)? }
            }
            "d65" => ColorSource::D65 { scale: q.float_or("scale", 1.0)? },
            "regular" | "irregular" => q.sampled_spectrum()?,
            _ => return Ok(None),
        };
        q.finish()?;
        to_rgb(&source, usage).map(Some).map_err(|m| SceneError::at(&child.pos, m.0).help(m.1))
    }

    fn sampled_spectrum(&self) -> Result<ColorSource, SceneError> {
        let list = |name: &str| -> Result<Vec<f64>, SceneError> {
            let Some(text) = self.string(name)? else {
                return Err(self.error(format!("the spectrum has no \"{name}\"")).help("give a list of numbers"));
            };
            super::value::floats(text).map_err(|m| self.error_at(name, m).help("give a list of numbers"))
        };
        let values = list("values")?;
        let wavelengths = if self.plugin() == "irregular" {
            list("wavelengths")?
        } else {
            let (lo, hi) = (self.float_or("wavelength_min", 360.0)?, self.float_or("wavelength_max", 830.0)?);
            let step = (hi - lo) / (values.len().max(2) - 1) as f64;
            (0..values.len()).map(|i| lo + step * i as f64).collect()
        };
        if wavelengths.len() != values.len() {
            let message = format!("{} wavelengths but {} values", wavelengths.len(), values.len());
            return Err(self.error(message).help("give as many values as wavelengths"));
        }
        let samples = wavelengths.into_iter().zip(values).collect();
        super::value::check_samples(samples).map(ColorSource::Samples).map_err(|m| self.error(m))
    }

    pub fn named_child(&self, name: &str) -> Option<&'d Child> {
        self.asked.borrow_mut().push(name.to_owned());
        let i = self.node.children.iter().position(|c| c.name.as_deref() == Some(name))?;
        self.taken.borrow_mut().push(i);
        Some(&self.node.children[i])
    }

    /// All children of one kind that nobody has asked for by name.
    pub fn children(&self, tag: Tag) -> Vec<&'d Child> {
        let mut taken = self.taken.borrow_mut();
        let mut found = Vec::new();
        for (i, c) in self.node.children.iter().enumerate() {
            if self.doc.node(c.node).tag == tag && !taken.contains(&i) {
                taken.push(i);
                found.push(c);
            }
        }
        found
    }

    /// The only child of a kind, if there is one.
    pub fn child(&self, tag: Tag) -> Result<Option<&'d Child>, SceneError> {
        match self.children(tag)[..] {
            [] => Ok(None),
            [one] => Ok(Some(one)),
            [_, second, ..] => {
                let message = format!("a second <{}> in the {} plugin \"{}\"", tag.name(), self.kind(), self.plugin());
                Err(SceneError::at(&second.pos, message).help("only one is possible"))
            }
        }
    }

    /// The file that a string property names.
    pub fn file(&self, name: &str) -> Result<Option<std::path::PathBuf>, SceneError> {
        let Some(file) = self.string(name)? else { return Ok(None) };
        self.doc.resolve(file, self.pos(name)).map(Some)
    }

    /// Properties that mean nothing here but are harmless.
    pub fn ignore(&self, names: &[&str]) {
        for name in names {
            if self.prop(name).is_some() {
                self.doc.warn(self.pos(name), format_args!("\"{name}\" is ignored"));
            }
        }
    }

    /// The object type is not one of `known`.
    pub fn unknown_plugin(&self, known: &[&str], planned: &[&str]) -> SceneError {
        let (kind, plugin) = (self.kind(), self.plugin());
        if planned.contains(&plugin) {
            return self
                .error(format!("the {kind} plugin \"{plugin}\" is not yet supported"))
                .help(format!("supported are {}", known.join(", ")));
        }
        self.error(format!("unknown {kind} plugin \"{plugin}\"")).suggest(plugin, known)
    }

    /// Refuses what nobody asked for.
    pub fn finish(self) -> Result<(), SceneError> {
        let asked = self.asked.into_inner();
        let mut known: Vec<&str> = asked.iter().map(String::as_str).collect();
        known.sort_unstable();
        known.dedup();
        let (kind, plugin) = (self.node.tag.name(), &self.node.plugin);
        let what =
            if self.node.tag == Tag::Scene { "the scene".into() } else { format!("the {kind} plugin \"{plugin}\"") };
        if let Some(p) = self.node.props.iter().find(|p| !known.contains(&p.name.as_str())) {
            let message = format!("{what} has no parameter \"{}\"", super::value::brief(&p.name));
            return Err(SceneError::at(&p.pos, message).suggest(&p.name, &known));
        }
        let taken = self.taken.into_inner();
        let Some((_, extra)) = self.node.children.iter().enumerate().find(|(i, _)| !taken.contains(i)) else {
            return Ok(());
        };
        let child = self.doc.node(extra.node);
        if let Some(name) = &extra.name {
            let message = format!("{what} has no parameter \"{}\"", super::value::brief(name));
            return Err(SceneError::at(&extra.pos, message).suggest(name, &known));
        }
        let message = format!("{what} has no use for a <{}>", child.tag.name());
        Err(SceneError::at(&extra.pos, message).help("remove it, or give it the name of a parameter"))
    }
}

/// (message, help) when the colour is impossible for its use.
fn to_rgb(source: &ColorSource, usage: ColorUse) -> Result<Rgb, (String, &'static str)> {
    let illuminant = if usage == ColorUse::Emission { Illuminant::EqualEnergy } else { Illuminant::D65 };
    let mut measured = false;
    let rgb = match source {
        ColorSource::Rgb(c) => Rgb::from(c.map(|v| v as f32)),
        ColorSource::Constant(v) => Rgb::splat(*v as f32),
        ColorSource::D65 { scale } => Rgb::splat(*scale as f32),
        ColorSource::Samples(samples) => {
            measured = true;
            spectrum_to_rgb(samples, illuminant)
        }
        ColorSource::Blackbody { temperature, scale } => {
            measured = true;
            blackbody_to_rgb(*temperature) * *scale as f32
        }
    };
    if !rgb.is_finite() {
        return Err(("the colour is not finite".into(), "use smaller numbers"));
    }
    let [r, g, b] = rgb.to_array();
    match usage {
        // Saturated spectra leave the gamut of the primaries: bring them to its border.
        ColorUse::Reflectance if measured => Ok(rgb.map(|v| v.clamp(0.0, 1.0))),
        ColorUse::Emission if measured => Ok(rgb.map(|v| v.max(0.0))),
        ColorUse::Reflectance if rgb.min_channel() < 0.0 || rgb.max_channel() > 1.0 => {
            Err((format!("the reflectance ({r}, {g}, {b}) is out of range"), "each channel must be between 0 and 1"))
        }
        ColorUse::Emission if rgb.min_channel() < 0.0 => {
            Err((format!("the emission ({r}, {g}, {b}) is negative"), "each channel must be 0 or more"))
        }
        _ => Ok(rgb),
    }
}
