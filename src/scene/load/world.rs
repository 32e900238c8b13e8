//! Puts a scene together: read everything, find its box, move it there, build what answers rays.

use std::collections::HashMap;
use std::sync::Arc;

use glam::DVec3;

use super::super::nested::Nested;
use super::super::xml::{Child, Document, NodeId, Query, Tag};
use super::super::{
    IntegratorSettings, LoadOptions, PhotonAims, PhotonTarget, Position, Scene, SceneError, SceneStats,
};
use super::sensors::View;
use super::shapes::{ShapeDesc, invertible};
use super::{Keep, Loader, ToScene, integrators, not_yet};
use crate::accel::Accel;
use crate::bsdf::{self, Material, MaterialId};
use crate::color::Rgb;
use crate::geometry::{GeometrySet, Instance, Shape};
use crate::light::{AreaLight, Light, LightContext, LightSelector, NearLights};
use crate::math::{Bounds3, Transform};
use crate::texture::ColorParam;

type Box64 = Option<(DVec3, DVec3)>;

fn join(a: Box64, b: Box64) -> Box64 {
    match (a, b) {
        (Some(a), Some(b)) => Some((a.0.min(b.0), a.1.max(b.1))),
        (a, b) => a.or(b),
    }
}

/// Shapes that exist only through instances.
struct Group<'d> {
    shapes: Vec<ShapeDesc<'d>>,
    bounds: Box64,
}

struct InstanceDesc {
    group: usize,
    to_world: Transform,
    pos: Position,
}

/// All shapes of a scene in its own world.
#[derive(Default)]
pub(super) struct World<'d> {
    shapes: Vec<ShapeDesc<'d>>,
    groups: Vec<Group<'d>>,
    pub(super) group_ids: HashMap<NodeId, usize>,
    instances: Vec<InstanceDesc>,
}

impl<'d> World<'d> {
    /// Each shape once, however often its group is placed.
    pub(super) fn each_shape(&self) -> impl Iterator<Item = &ShapeDesc<'d>> {
        self.shapes.iter().chain(self.groups.iter().flat_map(|g| &g.shapes))
    }

    pub(super) fn instance_count(&self) -> usize {
        self.instances.len()
    }
}

/// Geometry with what belongs to each of its shapes.
#[derive(Default)]
struct Placed<'d> {
    set: GeometrySet,
    materials: Vec<MaterialId>,
    emitters: Vec<Option<&'d Child>>,
    targets: Vec<PhotonTarget>,
}

/// What stands in a scene, its shapes read with all that they refer to.
pub(super) struct Contents<'d> {
    integrator: IntegratorSettings,
    pub world: World<'d>,
    bsdfs: Vec<&'d Child>,
    textures: Vec<&'d Child>,
    shapes: Vec<&'d Child>,
    pub emitters: Vec<&'d Child>,
    pub sensors: Vec<&'d Child>,
}

/// Builds the scene that a document describes.
pub fn load(doc: &Document, options: &LoadOptions) -> Result<Scene, SceneError> {
    let mut loader = Loader::new(doc);
    let mut stats = SceneStats::default();
    let Contents { integrator, world, bsdfs, textures, shapes, emitters, sensors } = loader.contents(options)?;

    // Move everything into the unit box.
    let to_scene = match world.bounds() {
        Some((min, max)) => ToScene::of_box(min, max),
        None => ToScene { center: DVec3::ZERO, scale: 1.0 },
    };
    let used = loader.used();
    loader.check_unused_groups(&shapes, &world, &mut stats)?;
    loader.check_unused_materials(&bsdfs, &mut stats)?;
    loader.check_materials()?;
    loader.forget(used);
    let placed = loader.place(world, &to_scene, &mut stats)?;
    loader.scale_heights(to_scene.scale as f32);
    let geometry = Arc::new(placed.set);
    let bounds = match geometry.bounds() {
        b if b.is_empty() => Bounds3::new(glam::Vec3::splat(-0.5), glam::Vec3::splat(0.5)),
        b => b,
    };
    let scene_sphere = scene_sphere(&bounds);
    let view = View { to_scene: &to_scene, bounds };
    let sensor = loader.sensor(&sensors, &view, options)?;

    // Lights on shapes first, then those that stand alone, both in the order of the file.
    let hides_emitters = integrator.boolean("hide_emitters") == Some(true);
    let (mut lights, mut shares) = (Vec::new(), Vec::new());
    let mut shape_lights = vec![None; geometry.shapes.len()];
    for (shape, emitter) in placed.emitters.iter().enumerate() {
        if let Some(child) = emitter {
            shape_lights[shape] = Some(lights.len() as u32);
            let radiance = loader.area_radiance(child)?;
            // A dark lamp is a surface like any other, unless lamps are to be hidden.
            if radiance == ColorParam::Const(Rgb::BLACK) && !hides_emitters {
                shape_lights[shape] = None;
                continue;
            }
            shares.extend(loader.photon_share(child, lights.len())?);
            lights.push(Light::Area(AreaLight::new(&geometry, &loader.textures, shape as u32, radiance)));
        }
    }
    let (mut environment, mut environments) = (None, 0);
    for child in emitters {
        let light = loader.emitter(child, &to_scene, &geometry)?;
        environments += u32::from(light.is_environment());
        if environments > 1 {
            return Err(SceneError::at(&child.pos, "a second environment light")
                .help("a scene has at most one envmap or constant emitter"));
        }
        if light.is_dark(&LightContext { geometry: &geometry, textures: &loader.textures, scene_sphere, sky: None }) {
            continue;
        }
        shares.extend(loader.photon_share(child, lights.len())?);
        if light.is_environment() {
            environment = Some(lights.len() as u32);
        }
        lights.push(light);
    }
    let used = loader.used();
    loader.check_unused_textures(&textures, &mut stats)?;
    loader.forget(used);
    let context = LightContext { geometry: &geometry, textures: &loader.textures, scene_sphere, sky: None };
    let selector = LightSelector::new(lights.iter().map(|l| l.power(&context)));
    let near_lights = NearLights::new(&lights, &context);
    loader.check_shares(&shares, &selector)?;
    let photon_aims = PhotonAims::new(lights.len(), geometry.shapes.len(), shares, placed.targets);

    let nested = Nested::of(&loader.materials, &placed.materials, &geometry).map_err(|count| {
        SceneError::at(&doc.node(doc.root()).pos, format!("{count} different dielectrics have a priority"))
            .help("255 can be told apart; leave out the priority where nothing overlaps")
    })?;
    let accel = Accel::build_with(options.accel, options.accel_options, geometry.clone())
        .map_err(|e| SceneError::at(&doc.node(doc.root()).pos, e.to_string()))?;
    // Where shapes may overlap, a surface is not what its material says.
    let plain = if nested.is_none() { bsdf::plain(&loader.materials) } else { Vec::new() };
    let mut scene = Scene {
        accel,
        shape_materials: placed.materials,
        shape_lights,
        light_contrast: light_contrast(&lights, &context),
        lights,
        environment,
        photon_selector: photon_aims.selector(&selector),
        photon_aims,
        selector,
        near_lights,
        camera: sensor.camera,
        film: sensor.film,
        sampler: sensor.sampler,
        integrator,
        bounds,
        scene_sphere,
        to_scene,
        stats,
        hash: doc.hash().to_hex().to_string(),
        warnings: doc.warnings(),
        materials: loader.materials,
        plain,
        textures: loader.textures,
        geometry,
        nested,
        sky: None,
    };
    scene.place_lens();
    scene.look_at_sky();
    Ok(scene)
}

/// How much brighter the brightest of `lights` is than what all of them make of white surfaces in the open.
pub fn light_contrast(lights: &[Light], context: &LightContext) -> f32 {
    let peak = lights.iter().map(Light::peak_radiance).fold(0.0, f32::max);
    let power: f64 = lights.iter().map(|l| f64::from(l.power(context).mean())).sum();
    let even = power / (4.0 * std::f64::consts::PI * context.disc_area());
    if even > 0.0 { (f64::from(peak) / even) as f32 } else { 0.0 }
}

/// A sphere around the box, a little larger so that rounding leaves no corner outside.
fn scene_sphere(bounds: &Bounds3) -> (glam::Vec3, f32) {
    let (center, radius) = bounds.bounding_sphere();
    (center, (radius * (1.0 + 1e-5)).max(1e-6))
}

fn refuse_media(doc: &Document, root: &Query) -> Result<(), SceneError> {
    let medium = root
        .node()
        .children
        .iter()
        .find(|c| matches!(doc.node(c.node).tag, Tag::Medium | Tag::Volume | Tag::Phase | Tag::Subsurface));
    medium.map_or(Ok(()), |c| Err(not_yet(&c.pos, doc.node(c.node))))
}

impl World<'_> {
    fn bounds(&self) -> Box64 {
        let shapes = self.shapes.iter().map(ShapeDesc::bounds);
        let instances = self.instances.iter().map(|i| {
            let (min, max) = self.groups[i.group].bounds?;
            let corner = |k: usize| {
                let pick = |bit: usize, lo: f64, hi: f64| if k & bit == 0 { lo } else { hi };
                DVec3::new(pick(1, min.x, max.x), pick(2, min.y, max.y), pick(4, min.z, max.z))
            };
            (0..8).map(|k| i.to_world.point_f64(corner(k))).fold(None, |b, p| join(b, Some((p, p))))
        });
        shapes.chain(instances).fold(None, join)
    }
}

impl<'d> Loader<'d> {
    /// Reads what stands in the scene.
    pub(super) fn contents(&mut self, options: &LoadOptions) -> Result<Contents<'d>, SceneError> {
        let doc = self.doc;
        let root = Query::new(doc, doc.root());
        refuse_media(doc, &root)?;
        let integrator = integrators::of_scene(&root)?;
        let (bsdfs, textures) = (root.children(Tag::Bsdf), root.children(Tag::Texture));
        let shapes = root.children(Tag::Shape);
        self.declared.extend(textures.iter().map(|c| c.node));
        self.keep = Keep::of(&options.needs);
        let mut world = World::default();
        for child in &shapes {
            self.add_shape(Query::new(doc, child.node), &mut world)?;
        }
        let (emitters, sensors) = (root.children(Tag::Emitter), root.children(Tag::Sensor));
        root.finish()?;
        Ok(Contents { integrator, world, bsdfs, textures, shapes, emitters, sensors })
    }

    /// Adds a shape, group or instance that stands in the scene.
    fn add_shape(&mut self, q: Query<'d>, world: &mut World<'d>) -> Result<(), SceneError> {
        match q.plugin() {
            // Groups are nowhere until an instance places them.
            "shapegroup" => Ok(()),
            "instance" => self.instance(q, world),
            _ => {
                world.shapes.push(self.bounded_shape(q)?);
                Ok(())
            }
        }
    }

    /// A shape whose box is finite.
    fn bounded_shape(&mut self, q: Query<'d>) -> Result<ShapeDesc<'d>, SceneError> {
        let desc = self.shape(q)?;
        match desc.bounds() {
            Some((min, max)) if !(min.is_finite() && max.is_finite() && (max - min).is_finite()) => {
                Err(SceneError::at(&desc.pos, "the shape reaches to infinity").help("check to_world and the vertices"))
            }
            _ => Ok(desc),
        }
    }

    pub(super) fn group(&mut self, q: Query<'d>, world: &mut World<'d>) -> Result<usize, SceneError> {
        if let Some(&group) = world.group_ids.get(&q.id()) {
            return Ok(group);
        }
        let id = q.id();
        let mut shapes = Vec::new();
        for child in q.children(Tag::Shape) {
            let inner = Query::new(self.doc, child.node);
            if matches!(inner.plugin(), "shapegroup" | "instance") {
                return Err(SceneError::at(&child.pos, format!("a {} inside of a shapegroup", inner.plugin()))
                    .help("groups hold plain shapes only"));
            }
            let desc = self.bounded_shape(inner)?;
            if let Some(emitter) = desc.emitter {
                return Err(SceneError::at(&emitter.pos, "an emitter inside of a shapegroup")
                    .help("lights cannot be instanced; put the emitting shape into the scene"));
            }
            shapes.push(desc);
        }
        if shapes.is_empty() {
            return Err(q.error("the shapegroup is empty").help("put a <shape> into it"));
        }
        q.finish()?;
        let bounds = shapes.iter().map(ShapeDesc::bounds).fold(None, join);
        world.groups.push(Group { shapes, bounds });
        world.group_ids.insert(id, world.groups.len() - 1);
        Ok(world.groups.len() - 1)
    }

    fn instance(&mut self, q: Query<'d>, world: &mut World<'d>) -> Result<(), SceneError> {
        let to_world = invertible(&q, "to_world", q.transform("to_world")?)?;
        let help = "put <ref id=\"…\"/> to a shapegroup into it";
        let Some(child) = q.child(Tag::Shape)? else {
            return Err(q.error("the instance holds no shapegroup").help(help));
        };
        let inner = Query::new(self.doc, child.node);
        if inner.plugin() != "shapegroup" {
            let message = format!("the instance holds a {}", inner.plugin());
            return Err(SceneError::at(&child.pos, message).help(help));
        }
        let group = self.group(inner, world)?;
        world.instances.push(InstanceDesc { group, to_world, pos: q.node().pos.clone() });
        q.finish()
    }

    /// Moves the world into the scene's box, and every group into a box of its own.
    fn place(&self, world: World<'d>, to_scene: &ToScene, stats: &mut SceneStats) -> Result<Placed<'d>, SceneError> {
        let mut placed = Placed::default();
        let map = similarity(to_scene);
        for desc in world.shapes {
            let shape = self.place_shape(desc, &map, &mut placed, stats)?;
            placed.set.top.push(shape);
        }
        let mut group_maps = Vec::new();
        for group in world.groups {
            let (min, max) = group.bounds.unwrap_or_default();
            let map = similarity(&ToScene::of_box(min, max));
            let mut shapes = Vec::new();
            for desc in group.shapes {
                shapes.push(self.place_shape(desc, &map, &mut placed, stats)?);
            }
            placed.set.groups.push(shapes);
            group_maps.push(map);
        }
        for i in world.instances {
            let to_world = map.after(&i.to_world).after(&group_maps[i.group].inverse());
            if !to_world.matrix().as_mat4().is_finite() {
                return Err(SceneError::at(&i.pos, "the instance's transform exceeds the range of floats")
                    .help("check to_world"));
            }
            placed.set.instances.push(Instance { group: i.group as u32, to_world });
        }
        stats.shapes = placed.set.shapes.len() as u64;
        stats.instances = placed.set.instances.len() as u64;
        Ok(placed)
    }

    fn place_shape(
        &self,
        desc: ShapeDesc<'d>,
        map: &Transform,
        placed: &mut Placed<'d>,
        stats: &mut SceneStats,
    ) -> Result<u32, SceneError> {
        let (material, emitter, pos) = (desc.material, desc.emitter, desc.pos.clone());
        let target = desc.photon_target;
        let nodes = [desc.material_node, emitter.map(|e| e.node)];
        self.check_priority(material, emitter, &pos)?;
        let mut shape = desc.finish(map, stats)?;
        for node in nodes.into_iter().flatten() {
            self.check_attributes(node, &shape, &pos)?;
        }
        stats.left_out_bytes += self.strip(&mut shape, material, emitter) as u64;
        placed.targets.extend(target.map(|t| self.photon_target(t, material, placed.set.shapes.len(), &pos)));
        placed.set.shapes.push(shape);
        placed.materials.push(material);
        placed.emitters.push(emitter);
        Ok(placed.set.shapes.len() as u32 - 1)
    }

    /// A priority is for shapes that are full of one dielectric.
    fn check_priority(&self, material: MaterialId, emitter: Option<&Child>, pos: &Position) -> Result<(), SceneError> {
        if Material::filling(&self.materials, material).is_some() {
            return match emitter {
                None => Ok(()),
                Some(_) => Err(SceneError::at(pos, "the shape is a lamp, and its dielectric has a \"priority\"")
                    .help("put the lamp inside of a shape of its own")),
            };
        }
        if Material::names_filling(&self.materials, material) {
            return Err(SceneError::at(
                pos,
                "a dielectric with a \"priority\" is only a part of this shape's material",
            )
            .help("leave out the priority, or give the shape the dielectric itself"));
        }
        Ok(())
    }

    /// A mesh attribute must exist on the shapes that look it up.
    fn check_attributes(&self, node: NodeId, shape: &Shape, pos: &Position) -> Result<(), SceneError> {
        let known: Vec<&str> = match shape {
            Shape::Mesh(mesh) => mesh.attributes.iter().map(|a| a.name.as_str()).collect(),
            _ => Vec::new(),
        };
        match self.attributes_below(node).into_iter().find(|a| !known.contains(&a.name.as_str())) {
            None => Ok(()),
            Some(missing) => {
                let message = format!("the shape at {pos} has no attribute \"{}\"", missing.name);
                let error = SceneError::at(&missing.pos, message);
                Err(if known.is_empty() {
                    error.help("attributes are named vertex_… and face_… and come from a ply file")
                } else {
                    error.suggest(&missing.name, &known)
                })
            }
        }
    }

    /// Bump heights are lengths of the world.
    fn scale_heights(&mut self, to_scene: f32) {
        for m in &mut self.materials {
            if let Material::BumpMap { scale, .. } = m {
                *scale *= to_scene;
            }
        }
    }

    /// What evaluation relies on, told at the material that breaks it.
    fn check_materials(&self) -> Result<(), SceneError> {
        let Err(error) = bsdf::check(&self.materials) else { return Ok(()) };
        let id = error.material();
        let node = self.material_nodes.get(id.0 as usize).copied().flatten().unwrap_or(self.doc.root());
        Err(SceneError::at(&self.doc.node(node).pos, error.to_string()))
    }
}

/// The map of a box as a transform; it always has an inverse.
fn similarity(to_scene: &ToScene) -> Transform {
    Transform::new(to_scene.matrix()).expect("a translation and a power of two have an inverse")
}
