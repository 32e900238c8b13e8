//! The grammar: elements to nodes and properties.

use std::cell::RefCell;
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat4, DVec3};

use super::super::{Position, SceneError};
use super::document::{MAX_FILE_BYTES, SourceFile, hash_block, read_limited, resolve, unreadable};
use super::value::{self, brief};
use super::{Child, ColorSource, Document, Node, NodeId, ParseOptions, Prop, Tag, Value, transform, upgrade};

type Element<'a> = roxmltree::Node<'a, 'a>;

const MAX_DEPTH: usize = 64;
const MAX_INCLUDE_DEPTH: usize = 16;
const MAX_INCLUDES: usize = 4096;
const MAX_NODES: usize = 1 << 22;
const MAX_XML_NODES: u32 = 1 << 25;
const MAX_ATTRIBUTE_BYTES: usize = 1 << 24;
const MAX_SPECTRUM_BYTES: u64 = 16 << 20;

/// Elements that are neither objects nor steps of a transform.
const PROPERTY_TAGS: [&str; 16] = [
    "boolean",
    "integer",
    "float",
    "string",
    "point",
    "vector",
    "transform",
    "rgb",
    "spectrum",
    "blackbody",
    "ref",
    "alias",
    "default",
    "include",
    "path",
    "srgb",
];
const TRANSFORM_TAGS: [&str; 6] = ["translate", "rotate", "scale", "matrix", "lookat", "lookAt"];

struct Define {
    value: String,
    /// Set on the command line and not needed so far.
    unused: bool,
}

struct PendingRef {
    parent: NodeId,
    child: usize,
    id: String,
    pos: Position,
}

/// What is gathered while the files are read.
pub(super) struct Parser {
    path: PathBuf,
    nodes: Vec<Node>,
    ids: HashMap<String, (NodeId, Position)>,
    aliases: Vec<(String, String, Position)>,
    refs: Vec<PendingRef>,
    defines: BTreeMap<String, Define>,
    search: Vec<PathBuf>,
    includes: Vec<PathBuf>,
    included: usize,
    hasher: blake3::Hasher,
    warnings: Vec<String>,
}

impl Parser {
    pub fn new(path: &Path, options: &ParseOptions) -> Self {
        let mut hasher = blake3::Hasher::new();
        let defines: BTreeMap<String, Define> =
            options.defines.iter().map(|(k, v)| (k.clone(), Define { value: v.clone(), unused: true })).collect();
        for (key, define) in &defines {
            hash_block(&mut hasher, key.as_bytes());
            hash_block(&mut hasher, define.value.as_bytes());
        }
        Self {
            path: path.to_path_buf(),
            nodes: Vec::new(),
            ids: HashMap::new(),
            aliases: Vec::new(),
            refs: Vec::new(),
            defines,
            search: vec![path.parent().unwrap_or(Path::new("")).to_path_buf()],
            includes: Vec::new(),
            included: 0,
            hasher,
            warnings: Vec::new(),
        }
    }

    pub fn run(mut self, text: Option<&str>) -> Result<Document, SceneError> {
        let path = self.path.clone();
        let start = Position { file: path.as_path().into(), line: 1, col: 1 };
        let read = match text {
            Some(text) => text.to_owned(),
            None => read_text(&path).map_err(|e| unreadable(&start, &e))?,
        };
        let root = self.file(&path, &read, None, 0)?;
        self.resolve_references()?;
        self.refuse_cycles(root)?;
        self.refuse_unused_defines(&start)?;
        Ok(Document {
            nodes: self.nodes,
            root,
            search: self.search,
            hasher: RefCell::new(self.hasher),
            warnings: RefCell::new(self.warnings),
        })
    }

    /// Parses one file. Without a parent its root must be `<scene>`; with one, what it holds goes into the parent.
    fn file(&mut self, path: &Path, text: &str, parent: Option<NodeId>, depth: usize) -> Result<NodeId, SceneError> {
        hash_block(&mut self.hasher, text.as_bytes());
        let source = SourceFile::new(Arc::from(path), text);
        let options = roxmltree::ParsingOptions { nodes_limit: MAX_XML_NODES, ..Default::default() };
        let xml = roxmltree::Document::parse_with_options(text, options).map_err(|e| xml_error(&source, &e))?;
        let root = xml.root_element();
        let scope = Scope { source: &source, legacy: version(&source, root)? < (2, 0) };

        if parent.is_none() && root.tag_name().name() != "scene" {
            let message = format!("the root element is <{}>", brief(root.tag_name().name()));
            return Err(
                SceneError::at(&scope.pos(root), message).help("a scene file starts with <scene version=\"…\">")
            );
        }
        match parent {
            // An included scene pours its content into the parent, any other object becomes a child.
            Some(parent) if root.tag_name().name() == "scene" => {
                self.allowed(&scope, root, &["version"], &[])?;
                for child in elements(&scope, root)? {
                    self.element(&scope, child, parent, depth + 1)?;
                }
                Ok(parent)
            }
            Some(parent) => {
                self.element(&scope, root, parent, depth + 1)?;
                Ok(parent)
            }
            None => self.object(&scope, root, Tag::Scene, depth),
        }
    }

    /// Adds an object and all below it.
    fn object(&mut self, scope: &Scope, e: Element, tag: Tag, depth: usize) -> Result<NodeId, SceneError> {
        let pos = scope.pos(e);
        if depth > MAX_DEPTH {
            return Err(SceneError::at(&pos, format!("objects are nested deeper than {MAX_DEPTH} levels"))
                .help("move objects to the top and use <ref>"));
        }
        if self.nodes.len() >= MAX_NODES {
            return Err(SceneError::at(&pos, format!("the scene has more than {MAX_NODES} objects")));
        }
        let plugin = if tag == Tag::Scene {
            self.allowed(scope, e, &["version", "id", "name", "type"], &[])?;
            "scene".to_owned()
        } else {
            self.allowed(scope, e, &["type", "id", "name", "version"], &["type"])?;
            self.attribute(scope, e, "type")?.unwrap_or_default()
        };
        let id = NodeId(self.nodes.len() as u32);
        let name = self.attribute(scope, e, "id")?;
        if let Some(name) = &name {
            self.register(name, id, &pos)?;
        }
        self.nodes.push(Node {
            tag,
            plugin,
            id: name,
            pos,
            props: Vec::new(),
            children: Vec::new(),
            legacy: scope.legacy,
        });
        for child in elements(scope, e)? {
            self.element(scope, child, id, depth + 1)?;
        }
        if scope.legacy {
            upgrade::upgrade(&mut self.nodes[id.0 as usize]);
        }
        self.refuse_duplicates(id)?;
        Ok(id)
    }

    /// Adds one element to the object it stands in.
    fn element(&mut self, scope: &Scope, e: Element, parent: NodeId, depth: usize) -> Result<(), SceneError> {
        let tag_name = e.tag_name().name();
        if let Some(tag) = Tag::from_name(tag_name).filter(|&t| t != Tag::Scene) {
            return self.child_object(scope, e, tag, parent, depth);
        }
        if tag_name == "spectrum" && e.has_attribute("type") {
            return self.child_object(scope, e, Tag::Texture, parent, depth);
        }
        let steps = tag_name == "transform";
        let value = match tag_name {
            "default" => return self.default(scope, e),
            "include" => return self.include(scope, e, parent, depth),
            "path" => return self.search_path(scope, e),
            "alias" => return self.alias(scope, e),
            "ref" => return self.reference(scope, e, parent),
            "transform" => Value::Transform(self.transform(scope, e)?),
            "spectrum" => Value::Color(self.spectrum(scope, e)?),
            "blackbody" => Value::Color(self.blackbody(scope, e)?),
            "point" | "vector" => Value::Vector(self.vector(scope, e)?),
            "boolean" | "integer" | "float" | "string" | "rgb" | "srgb" => self.simple(scope, e, tag_name)?,
            other => return Err(unknown_element(scope, e, other)),
        };
        if !steps && let Some(inner) = elements(scope, e)?.first() {
            let message = format!("<{}> inside of <{tag_name}>", brief(inner.tag_name().name()));
            return Err(SceneError::at(&scope.pos(*inner), message).help("a property holds no other elements"));
        }
        let Some(name) = self.attribute(scope, e, "name")?.filter(|n| !n.is_empty()) else {
            return Err(SceneError::at(&scope.pos(e), format!("<{tag_name}> without a name"))
                .help(format!("write <{tag_name} name=\"…\" …/>")));
        };
        self.nodes[parent.0 as usize].props.push(Prop { name, value, pos: scope.pos(e) });
        Ok(())
    }

    fn child_object(
        &mut self,
        scope: &Scope,
        e: Element,
        tag: Tag,
        parent: NodeId,
        depth: usize,
    ) -> Result<(), SceneError> {
        let node = self.object(scope, e, tag, depth)?;
        let name = self.attribute(scope, e, "name")?;
        self.nodes[parent.0 as usize].children.push(Child { name, node, pos: scope.pos(e) });
        Ok(())
    }

    fn simple(&mut self, scope: &Scope, e: Element, tag: &str) -> Result<Value, SceneError> {
        self.allowed(scope, e, &["name", "value"], &["name", "value"])?;
        let text = self.attribute(scope, e, "value")?.unwrap_or_default();
        let parsed = match tag {
            "boolean" => value::boolean(&text).map(Value::Bool),
            "integer" => value::integer(&text).map(Value::Int),
            "float" => value::float(&text).map(Value::Float),
            "string" => return Ok(Value::String(text)),
            "srgb" => value::rgb(&text)
                .map(|c| Value::Color(ColorSource::Rgb(c.map(|v| f64::from(crate::color::srgb_to_linear(v as f32)))))),
            _ => value::rgb(&text).map(|c| Value::Color(ColorSource::Rgb(c))),
        };
        parsed.map_err(|m| SceneError::at(&scope.attribute_pos(e, "value"), m).help(expected(tag)))
    }

    fn vector(&mut self, scope: &Scope, e: Element) -> Result<DVec3, SceneError> {
        if e.has_attribute("value") {
            self.allowed(scope, e, &["name", "value"], &["name"])?;
            self.triple(scope, e, "value")
        } else {
            self.allowed(scope, e, &["name", "x", "y", "z"], &["name", "x", "y", "z"])?;
            self.xyz(scope, e, 0.0)
        }
    }

    fn blackbody(&mut self, scope: &Scope, e: Element) -> Result<ColorSource, SceneError> {
        self.allowed(scope, e, &["name", "temperature", "scale"], &["name", "temperature"])?;
        // The unit may be written, as in "5000K".
        let text = self.attribute(scope, e, "temperature")?.unwrap_or_default();
        let temperature = value::float(text.trim().trim_end_matches(['K', 'k']))
            .map_err(|m| SceneError::at(&scope.attribute_pos(e, "temperature"), m).help("give it in kelvin"))?;
        let scale = self.number(scope, e, "scale")?.unwrap_or(1.0);
        if temperature <= 0.0 {
            return Err(SceneError::at(&scope.attribute_pos(e, "temperature"), "the temperature is not positive")
                .help("give it in kelvin"));
        }
        Ok(ColorSource::Blackbody { temperature, scale })
    }

    fn spectrum(&mut self, scope: &Scope, e: Element) -> Result<ColorSource, SceneError> {
        self.allowed(scope, e, &["name", "value", "filename", "intent"], &["name"])?;
        if let Some(file) = self.attribute(scope, e, "filename")? {
            let pos = scope.attribute_pos(e, "filename");
            let path = resolve(&file, &pos, &self.search)?;
            let bytes = read_limited(&path, MAX_SPECTRUM_BYTES);
            let bytes = bytes.map_err(|m| SceneError::at(&pos, format!("cannot read \"{file}\": {m}")))?;
            hash_block(&mut self.hasher, &bytes);
            let samples = value::spectrum_file(&String::from_utf8_lossy(&bytes));
            return samples.map(ColorSource::Samples).map_err(|m| {
                SceneError::at(&pos, format!("\"{file}\": {m}")).help("a .spd file has lines of wavelength and value")
            });
        }
        self.allowed(scope, e, &["name", "value", "intent"], &["value"])?;
        let text = self.attribute(scope, e, "value")?.unwrap_or_default();
        let parsed = if text.contains(':') {
            value::spectrum_samples(&text).map(ColorSource::Samples)
        } else if text.trim().starts_with('#') {
            value::rgb(&text).map(ColorSource::Rgb)
        } else {
            match value::floats(&text) {
                Ok(v) if v.len() == 1 => Ok(ColorSource::Constant(v[0])),
                // Mitsuba 0.6 reads three numbers as linear RGB.
                Ok(v) if v.len() == 3 => Ok(ColorSource::Rgb([v[0], v[1], v[2]])),
                Ok(v) => Err(format!("\"{}\" has {} numbers", brief(&text), v.len())),
                Err(m) => Err(m),
            }
        };
        parsed.map_err(|m| SceneError::at(&scope.attribute_pos(e, "value"), m).help(expected("spectrum")))
    }

    fn transform(&mut self, scope: &Scope, e: Element) -> Result<DMat4, SceneError> {
        self.allowed(scope, e, &["name"], &["name"])?;
        let planar = matches!(self.attribute(scope, e, "name")?.as_deref(), Some("to_uv" | "toUV"));
        let mut total = DMat4::IDENTITY;
        for step in elements(scope, e)? {
            total = self.step(scope, step, planar)? * total;
        }
        if !total.is_finite() {
            return Err(SceneError::at(&scope.pos(e), "the transform overflows").help("use smaller numbers"));
        }
        Ok(total)
    }

    fn step(&mut self, scope: &Scope, e: Element, planar: bool) -> Result<DMat4, SceneError> {
        if let Some(inner) = elements(scope, e)?.first() {
            return Err(SceneError::at(&scope.pos(*inner), "an element inside of a transform's step")
                .help("write the steps one after the other"));
        }
        let step = match e.tag_name().name() {
            "translate" => {
                self.allowed(scope, e, &["x", "y", "z", "value"], &[])?;
                Ok(DMat4::from_translation(self.xyz(scope, e, 0.0)?))
            }
            "scale" => {
                self.allowed(scope, e, &["x", "y", "z", "value"], &[])?;
                Ok(DMat4::from_scale(self.xyz(scope, e, 1.0)?))
            }
            "rotate" => {
                self.allowed(scope, e, &["x", "y", "z", "value", "angle"], &["angle"])?;
                let angle = self.number(scope, e, "angle")?.unwrap_or(0.0);
                transform::rotate(self.xyz(scope, e, 0.0)?, angle)
            }
            "matrix" => {
                self.allowed(scope, e, &["value"], &["value"])?;
                let text = self.attribute(scope, e, "value")?.unwrap_or_default();
                value::floats(&text).and_then(|v| transform::matrix(&v, planar))
            }
            "lookat" | "lookAt" => {
                self.allowed(scope, e, &["origin", "target", "up"], &["origin", "target"])?;
                let (origin, target) = (self.triple(scope, e, "origin")?, self.triple(scope, e, "target")?);
                let up = if e.has_attribute("up") { Some(self.triple(scope, e, "up")?) } else { None };
                transform::look_at(origin, target, up)
            }
            other => {
                let message = format!("<{}> is not a step of a transform", brief(other));
                return Err(SceneError::at(&scope.pos(e), message).suggest(other, &TRANSFORM_TAGS[..5]));
            }
        };
        step.map_err(|m| SceneError::at(&scope.pos(e), m))
    }

    fn default(&mut self, scope: &Scope, e: Element) -> Result<(), SceneError> {
        self.allowed(scope, e, &["name", "value"], &["name", "value"])?;
        let name = self.attribute(scope, e, "name")?.unwrap_or_default();
        if name.is_empty() || !name.chars().all(|c| c.is_alphanumeric() || "_-.".contains(c)) {
            let message = format!("\"{}\" is not a parameter name", brief(&name));
            return Err(SceneError::at(&scope.attribute_pos(e, "name"), message).help("use letters, digits and _"));
        }
        let value = self.attribute(scope, e, "value")?.unwrap_or_default();
        match self.defines.get_mut(&name) {
            Some(define) => define.unused = false,
            None => {
                self.defines.insert(name, Define { value, unused: false });
            }
        }
        Ok(())
    }

    fn include(&mut self, scope: &Scope, e: Element, parent: NodeId, depth: usize) -> Result<(), SceneError> {
        self.allowed(scope, e, &["filename", "name"], &["filename"])?;
        let pos = scope.attribute_pos(e, "filename");
        let name = self.attribute(scope, e, "filename")?.unwrap_or_default();
        let path = resolve(&name, &pos, &self.search)?;
        let real = path.canonicalize().unwrap_or_else(|_| path.clone());
        let main = self.path.canonicalize().unwrap_or_else(|_| self.path.clone());
        if self.includes.contains(&real) || real == main {
            return Err(SceneError::at(&pos, format!("\"{name}\" includes itself")).help("remove one <include>"));
        }
        self.included += 1;
        if self.includes.len() >= MAX_INCLUDE_DEPTH || self.included > MAX_INCLUDES {
            let message = format!("includes are nested deeper than {MAX_INCLUDE_DEPTH} or more than {MAX_INCLUDES}");
            return Err(SceneError::at(&pos, message).help("put the content into fewer files"));
        }
        let text = read_text(&path).map_err(|m| SceneError::at(&pos, format!("cannot read \"{name}\": {m}")))?;
        self.includes.push(real);
        let result = self.file(&path, &text, Some(parent), depth);
        self.includes.pop();
        result.map(|_| ())
    }

    fn search_path(&mut self, scope: &Scope, e: Element) -> Result<(), SceneError> {
        self.allowed(scope, e, &["value"], &["value"])?;
        let pos = scope.attribute_pos(e, "value");
        let name = self.attribute(scope, e, "value")?.unwrap_or_default();
        let beside = pos.file.parent().unwrap_or(Path::new("")).to_path_buf();
        let folder = std::iter::once(&beside).chain(&self.search).map(|d| d.join(&name)).find(|p| p.is_dir());
        let folder = folder.ok_or_else(|| {
            SceneError::at(&pos, format!("folder \"{name}\" not found")).help("<path> is relative to the scene file")
        })?;
        self.search.insert(0, folder);
        Ok(())
    }

    fn alias(&mut self, scope: &Scope, e: Element) -> Result<(), SceneError> {
        self.allowed(scope, e, &["id", "as"], &["id", "as"])?;
        let id = self.attribute(scope, e, "id")?.unwrap_or_default();
        let alias = self.attribute(scope, e, "as")?.unwrap_or_default();
        self.aliases.push((id, alias, scope.pos(e)));
        Ok(())
    }

    fn reference(&mut self, scope: &Scope, e: Element, parent: NodeId) -> Result<(), SceneError> {
        self.allowed(scope, e, &["id", "name"], &["id"])?;
        let id = self.attribute(scope, e, "id")?.unwrap_or_default();
        let name = self.attribute(scope, e, "name")?;
        let pos = scope.attribute_pos(e, "id");
        let children = &mut self.nodes[parent.0 as usize].children;
        self.refs.push(PendingRef { parent, child: children.len(), id, pos: pos.clone() });
        children.push(Child { name, node: parent, pos });
        Ok(())
    }

    fn register(&mut self, id: &str, node: NodeId, pos: &Position) -> Result<(), SceneError> {
        if let Some((_, first)) = self.ids.get(id) {
            return Err(SceneError::at(pos, format!("duplicate id \"{}\"", brief(id)))
                .help(format!("it is used first at {first}")));
        }
        self.ids.insert(id.to_owned(), (node, pos.clone()));
        Ok(())
    }

    fn resolve_references(&mut self) -> Result<(), SceneError> {
        for (id, alias, pos) in std::mem::take(&mut self.aliases) {
            let node = self.lookup(&id, &pos)?;
            self.register(&alias, node, &pos)?;
        }
        for r in std::mem::take(&mut self.refs) {
            let node = self.lookup(&r.id, &r.pos)?;
            self.nodes[r.parent.0 as usize].children[r.child].node = node;
        }
        Ok(())
    }

    fn lookup(&self, id: &str, pos: &Position) -> Result<NodeId, SceneError> {
        self.ids.get(id).map(|(node, _)| *node).ok_or_else(|| {
            let mut known: Vec<&String> = self.ids.keys().collect();
            known.sort();
            SceneError::at(pos, format!("no object has the id \"{}\"", brief(id))).suggest(id, &known)
        })
    }

    /// An object must not contain itself. Depth-first with an explicit stack; grey nodes are on the way down.
    fn refuse_cycles(&self, root: NodeId) -> Result<(), SceneError> {
        const WHITE: u8 = 0;
        const GREY: u8 = 1;
        const BLACK: u8 = 2;
        let mut color = vec![WHITE; self.nodes.len()];
        let mut stack = vec![(root, 0)];
        color[root.0 as usize] = GREY;
        while let Some((node, next)) = stack.pop() {
            let Some(child) = self.nodes[node.0 as usize].children.get(next) else {
                color[node.0 as usize] = BLACK;
                continue;
            };
            stack.push((node, next + 1));
            match color[child.node.0 as usize] {
                GREY => {
                    return Err(SceneError::at(&child.pos, "the reference makes an object contain itself")
                        .help("refer to an object that is declared outside of this one"));
                }
                WHITE => {
                    color[child.node.0 as usize] = GREY;
                    stack.push((child.node, 0));
                }
                _ => {}
            }
            if stack.len() > 4 * MAX_DEPTH {
                return Err(SceneError::at(&child.pos, "the chain of references is too long")
                    .help(format!("use fewer than {} levels", 4 * MAX_DEPTH)));
            }
        }
        Ok(())
    }

    fn refuse_duplicates(&self, id: NodeId) -> Result<(), SceneError> {
        let node = &self.nodes[id.0 as usize];
        let names = node.props.iter().map(|p| (p.name.as_str(), &p.pos));
        let named_children = node.children.iter().filter_map(|c| Some((c.name.as_deref()?, &c.pos)));
        let mut seen: HashMap<&str, &Position> = HashMap::new();
        for (name, pos) in names.chain(named_children) {
            // Names of the scene's own children have no meaning.
            if let Some(first) = seen.insert(name, pos)
                && node.tag != Tag::Scene
            {
                return Err(SceneError::at(pos, format!("\"{}\" is given twice", brief(name)))
                    .help(format!("it is given first at {first}")));
            }
        }
        Ok(())
    }

    fn refuse_unused_defines(&self, start: &Position) -> Result<(), SceneError> {
        let Some((key, _)) = self.defines.iter().find(|(_, d)| d.unused) else { return Ok(()) };
        let known: Vec<&String> = self.defines.iter().filter(|(_, d)| !d.unused).map(|(k, _)| k).collect();
        Err(SceneError::at(start, format!("the scene has no parameter \"{}\" (-D)", brief(key))).suggest(key, &known))
    }

    /// An attribute's value with every `$name` replaced.
    fn attribute(&mut self, scope: &Scope, e: Element, name: &str) -> Result<Option<String>, SceneError> {
        match e.attribute(name) {
            Some(text) if text.contains('$') => self
                .substitute(text)
                .map(Some)
                .map_err(|(message, help)| SceneError::at(&scope.attribute_pos(e, name), message).help(help)),
            text => Ok(text.map(str::to_owned)),
        }
    }

    /// The text with every `$name` replaced, or a message and help.
    fn substitute(&mut self, text: &str) -> Result<String, (String, String)> {
        let mut out = String::new();
        let mut rest = text;
        while let Some(at) = rest.find('$') {
            out.push_str(&rest[..at]);
            rest = &rest[at + 1..];
            let braced = rest.starts_with('{');
            // The longest defined name wins, so that "$width_px" can be "width" followed by "_px".
            let word: &str = match rest.strip_prefix('{').and_then(|r| r.split_once('}')) {
                Some((name, _)) => name,
                None => {
                    let end = rest.find(|c: char| !(c.is_alphanumeric() || "_-.".contains(c))).unwrap_or(rest.len());
                    &rest[..end]
                }
            };
            let ends = word.char_indices().map(|(i, c)| i + c.len_utf8()).rev();
            let name = ends
                .map(|end| &word[..end])
                .take_while(|n| !braced || n.len() == word.len())
                .find(|n| self.defines.contains_key(*n));
            let Some((name, define)) = name.and_then(|n| Some((n, self.defines.get_mut(n)?))) else {
                let word = brief(word.trim_end_matches(['.', '-']));
                let known: Vec<String> = self.defines.keys().cloned().collect();
                let help = match known.is_empty() {
                    true => format!("add <default name=\"{word}\" value=\"…\"/> above, or -D {word}=…"),
                    false => super::super::error::suggestion(&word, &known),
                };
                return Err((format!("the parameter \"${word}\" is not defined"), help));
            };
            define.unused = false;
            out.push_str(&define.value);
            rest = &rest[name.len() + if braced { 2 } else { 0 }..];
            if out.len() + rest.len() > MAX_ATTRIBUTE_BYTES {
                let message = format!("the substituted text exceeds {MAX_ATTRIBUTE_BYTES} bytes");
                return Err((message, "shorten the chain of <default>s".into()));
            }
        }
        out.push_str(rest);
        Ok(out)
    }

    fn number(&mut self, scope: &Scope, e: Element, name: &str) -> Result<Option<f64>, SceneError> {
        let Some(text) = self.attribute(scope, e, name)? else { return Ok(None) };
        value::float(&text).map(Some).map_err(|m| SceneError::at(&scope.attribute_pos(e, name), m))
    }

    fn triple(&mut self, scope: &Scope, e: Element, name: &str) -> Result<DVec3, SceneError> {
        let text = self.attribute(scope, e, name)?.unwrap_or_default();
        let pos = scope.attribute_pos(e, name);
        value::triple(&text).map_err(|m| SceneError::at(&pos, m).help(format!("write {name}=\"x, y, z\"")))
    }

    /// `value="x, y, z"` or the attributes x, y and z.
    fn xyz(&mut self, scope: &Scope, e: Element, default: f64) -> Result<DVec3, SceneError> {
        if !e.has_attribute("value") {
            let mut component = |name| Ok(self.number(scope, e, name)?.unwrap_or(default));
            return Ok(DVec3::new(component("x")?, component("y")?, component("z")?));
        }
        if let Some(extra) = ["x", "y", "z"].into_iter().find(|n| e.has_attribute(*n)) {
            return Err(SceneError::at(&scope.attribute_pos(e, extra), format!("both \"value\" and \"{extra}\""))
                .help("give either value or x, y and z"));
        }
        self.triple(scope, e, "value")
    }

    /// Refuses attributes that are not known and misses those that are required.
    fn allowed(&self, scope: &Scope, e: Element, known: &[&str], required: &[&str]) -> Result<(), SceneError> {
        let tag = brief(e.tag_name().name());
        if let Some(a) = e.attributes().find(|a| !known.contains(&a.name())) {
            let message = format!("unknown attribute \"{}\" of <{tag}>", brief(a.name()));
            return Err(SceneError::at(&scope.source.position(a.range().start), message).suggest(a.name(), known));
        }
        if let Some(missing) = required.iter().find(|r| !e.has_attribute(**r)) {
            return Err(SceneError::at(&scope.pos(e), format!("<{tag}> has no attribute \"{missing}\""))
                .help(format!("write <{tag} {missing}=\"…\" …>")));
        }
        Ok(())
    }
}

/// The file that is being parsed.
struct Scope<'s> {
    source: &'s SourceFile<'s>,
    legacy: bool,
}

impl Scope<'_> {
    fn pos(&self, e: Element) -> Position {
        self.source.position(e.range().start)
    }

    fn attribute_pos(&self, e: Element, name: &str) -> Position {
        e.attribute_node(name).map_or_else(|| self.pos(e), |a| self.source.position(a.range().start))
    }
}

/// The element's child elements; text between them is an error.
fn elements<'a>(scope: &Scope, e: Element<'a>) -> Result<Vec<Element<'a>>, SceneError> {
    let stray = e.children().find(|n| n.is_text() && n.text().is_some_and(|t| !t.trim().is_empty()));
    if let Some(stray) = stray {
        let text = stray.text().unwrap_or_default();
        let start = stray.range().start + text.len() - text.trim_start().len();
        return Err(SceneError::at(&scope.source.position(start), format!("stray text \"{}\"", brief(text)))
            .help("values are written in attributes, remarks in <!-- comments -->"));
    }
    Ok(e.children().filter(|n| n.is_element()).collect())
}

fn unknown_element(scope: &Scope, e: Element, name: &str) -> SceneError {
    let pos = scope.pos(e);
    if TRANSFORM_TAGS.contains(&name) {
        return SceneError::at(&pos, format!("<{name}> outside of a <transform>"))
            .help("write it inside of <transform name=\"to_world\">");
    }
    let known: Vec<&str> = Tag::NAMES.iter().map(|(n, _)| *n).chain(PROPERTY_TAGS).collect();
    SceneError::at(&pos, format!("unknown element <{}>", brief(name))).suggest(name, &known)
}

fn expected(tag: &str) -> &'static str {
    match tag {
        "boolean" => "write value=\"true\" or value=\"false\"",
        "integer" => "write a whole number such as value=\"64\"",
        "float" => "write a number such as value=\"0.5\"",
        "spectrum" => "write one value, or pairs such as value=\"400:0.1, 700:0.9\"",
        _ => "write value=\"r, g, b\", one grey value, or value=\"#rrggbb\"",
    }
}

/// (major, minor) of the root's version attribute.
fn version(source: &SourceFile, root: Element) -> Result<(u32, u32), SceneError> {
    let help = "write version=\"3.0.0\", or the version of Mitsuba that the file was written for";
    let Some(attribute) = root.attribute_node("version") else {
        let message = format!("<{}> has no version", brief(root.tag_name().name()));
        return Err(SceneError::at(&source.position(root.range().start), message).help(help));
    };
    let mut parts = attribute.value().trim().split('.').map(|p| p.parse::<u32>());
    match (parts.next(), parts.next().unwrap_or(Ok(0)), parts.all(|p| p.is_ok())) {
        (Some(Ok(major)), Ok(minor), true) => Ok((major, minor)),
        _ => {
            let message = format!("\"{}\" is not a version", brief(attribute.value()));
            Err(SceneError::at(&source.position(attribute.range().start), message).help(help))
        }
    }
}

fn xml_error(source: &SourceFile, error: &roxmltree::Error) -> SceneError {
    // The library appends "at line:column" itself; the place is at the front here.
    let text = error.to_string();
    let message = text.rsplit_once(" at ").map_or(text.as_str(), |(m, _)| m);
    let at = error.pos();
    let pos = Position { file: source.path.clone(), line: at.row, col: at.col };
    let help = match error {
        roxmltree::Error::DtdDetected => "remove the <!DOCTYPE …> block; scene files need none",
        roxmltree::Error::UnclosedRootNode | roxmltree::Error::UnexpectedEndOfStream => "is the file cut off?",
        _ => "",
    };
    SceneError::at(&pos, format!("not well-formed XML: {message}")).help(help)
}

fn read_text(path: &Path) -> Result<String, String> {
    let bytes = read_limited(path, MAX_FILE_BYTES)?;
    let text = String::from_utf8(bytes)
        .map_err(|e| format!("it is not UTF-8 text (byte {} is the first wrong one)", e.utf8_error().valid_up_to()))?;
    Ok(text.strip_prefix('\u{feff}').map_or(text.clone(), str::to_owned))
}
