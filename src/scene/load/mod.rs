//! From the typed tree to a scene.

mod bsdfs;
mod emitters;
mod integrators;
mod photons;
mod predict;
mod sensors;
mod shapes;
mod textures;
mod unused;
mod world;

use std::collections::{HashMap, HashSet};
use std::path::Path;

use glam::{DMat4, DVec3, Vec3};

use super::xml::{Document, Node, NodeId};
use super::{PicturePrediction, Position, SceneError};
use crate::bsdf::{Material, MaterialId};
use crate::texture::{TextureId, Textures};

pub(super) use predict::predict;
pub(super) use world::{light_contrast, load};

/// The map from the world of the scene file to the unit box in which everything is computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToScene {
    /// The point of the world that becomes the origin.
    pub center: DVec3,
    /// A power of two: lengths in scene units per length in the world.
    pub scale: f64,
}

impl ToScene {
    /// Centres a box and scales its diagonal into [1, 2).
    pub fn of_box(min: DVec3, max: DVec3) -> Self {
        let diagonal = (max - min).length();
        let center = 0.5 * min + 0.5 * max;
        Self { center, scale: if diagonal.is_normal() { power_of_two_below(diagonal).recip() } else { 1.0 } }
    }

    /// World to scene.
    pub fn matrix(&self) -> DMat4 {
        DMat4::from_scale(DVec3::splat(self.scale)) * DMat4::from_translation(-self.center)
    }

    /// A point of the world in the scene.
    pub fn point(&self, p: DVec3) -> Vec3 {
        (self.scale * (p - self.center)).as_vec3()
    }

    /// A point of the scene in the world.
    pub fn to_world(&self, p: Vec3) -> DVec3 {
        p.as_dvec3() / self.scale + self.center
    }
}

/// The largest power of two that is not above a normal positive number: its bits without the mantissa.
fn power_of_two_below(v: f64) -> f64 {
    f64::from_bits(v.to_bits() & 0x7ff0_0000_0000_0000)
}

/// A mesh attribute that a material or light looks up.
struct AttributeUse {
    name: String,
    pos: Position,
}

/// What is gathered while the tree is read.
struct Loader<'d> {
    doc: &'d Document,
    materials: Vec<Material>,
    /// The node of each material, for messages.
    material_nodes: Vec<Option<NodeId>>,
    /// Leaves of each material when nesting is flattened, saturating.
    material_leaves: Vec<u32>,
    material_ids: HashMap<NodeId, MaterialId>,
    default_material: Option<MaterialId>,
    textures: Textures,
    texture_ids: HashMap<NodeId, TextureId>,
    /// Textures that are declared on their own, to be referred to.
    declared: HashSet<NodeId>,
    /// What is read now is not used: its parameters are checked, its files stay closed.
    unused: bool,
    /// The pictures named so far when memory is to be predicted: then nothing but headers is read.
    pictures: Option<Vec<PicturePrediction>>,
    /// What somebody wants of vertex normals and texture coordinates.
    keep: Keep,
}

/// Parts of meshes that are kept, or dropped, whether or not they are used; `None` where use decides.
#[derive(Clone, Copy, Default)]
struct Keep {
    uv: Option<bool>,
    normals: Option<bool>,
}

impl<'d> Loader<'d> {
    fn new(doc: &'d Document) -> Self {
        Self {
            doc,
            materials: Vec::new(),
            material_nodes: Vec::new(),
            material_leaves: Vec::new(),
            material_ids: HashMap::new(),
            default_material: None,
            textures: Textures::default(),
            texture_ids: HashMap::new(),
            declared: HashSet::new(),
            unused: false,
            pictures: None,
            keep: Keep::default(),
        }
    }

    /// Adds a file to the content hash.
    fn hash_file(&self, path: &Path, pos: &Position) -> Result<(), SceneError> {
        self.doc.hash_file(path).map_err(|e| SceneError::at(pos, format!("cannot read \"{}\": {e}", path.display())))
    }
}

/// An element that Mitsuba has and this program will have.
fn not_yet(pos: &Position, node: &Node) -> SceneError {
    SceneError::at(pos, format!("<{} type=\"{}\"> is not yet supported", node.tag.name(), node.plugin))
        .help("remove the element to render without it")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn box_is_centred_and_scaled_by_a_power_of_two() {
        let t = ToScene::of_box(DVec3::new(10.0, 0.0, 0.0), DVec3::new(13.0, 4.0, 0.0));
        assert_eq!((t.center, t.scale), (DVec3::new(11.5, 2.0, 0.0), 0.25));
        assert_eq!(t.point(DVec3::new(13.0, 4.0, 0.0)), Vec3::new(0.375, 0.5, 0.0));
        // Twice the scene gives the same box.
        let twice = ToScene::of_box(DVec3::new(20.0, 0.0, 0.0), DVec3::new(26.0, 8.0, 0.0));
        assert_eq!(twice.point(DVec3::new(26.0, 8.0, 0.0)), t.point(DVec3::new(13.0, 4.0, 0.0)));
        assert_eq!(ToScene::of_box(DVec3::ONE, DVec3::ONE).scale, 1.0);
        let m = t.matrix().transform_point3(DVec3::new(13.0, 4.0, 0.0));
        assert_eq!(m.as_vec3(), Vec3::new(0.375, 0.5, 0.0));
    }
}
