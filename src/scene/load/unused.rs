//! What a scene file declares and does not use: checked like everything else, but its files are not read and nothing of
//! it is kept.

use std::sync::Arc;

use super::super::xml::{Child, Query, Tag};
use super::super::{Item, NeedOverride, SceneError, SceneStats};
use super::world::World;
use super::{Keep, Loader};
use crate::bsdf::{MaterialId, survey};
use crate::geometry::Shape;

impl Keep {
    /// What was asked to stay or to go.
    pub(super) fn of(overrides: &[NeedOverride]) -> Self {
        let asked = |item| overrides.iter().rev().find(|(i, _)| *i == item).map(|(_, on)| *on);
        Self { uv: asked(Item::Uv), normals: asked(Item::Normals) }
    }
}

/// Lengths of the lists of a loader at some moment.
pub(super) struct Used {
    materials: usize,
    textures: usize,
}

impl<'d> Loader<'d> {
    /// Marks what has been read so far as used.
    pub(super) fn used(&self) -> Used {
        Used { materials: self.materials.len(), textures: self.textures.len() }
    }

    /// Forgets all that was read since.
    pub(super) fn forget(&mut self, used: Used) {
        self.materials.truncate(used.materials);
        self.material_nodes.truncate(used.materials);
        self.material_leaves.truncate(used.materials);
        self.textures.truncate(used.textures);
        self.material_ids.retain(|_, id| (id.0 as usize) < used.materials);
        self.texture_ids.retain(|_, id| (id.0 as usize) < used.textures);
        self.default_material = self.default_material.filter(|id| (id.0 as usize) < used.materials);
        self.unused = false;
    }

    /// Checks groups that no instance places.
    pub(super) fn check_unused_groups(
        &mut self,
        shapes: &[&'d Child],
        world: &World<'d>,
        stats: &mut SceneStats,
    ) -> Result<(), SceneError> {
        self.unused = true;
        for child in shapes {
            let q = Query::new(self.doc, child.node);
            if q.plugin() == "shapegroup" && !world.group_ids.contains_key(&child.node) {
                stats.unplaced_groups += 1;
                self.group(q, &mut World::default())?;
            }
        }
        Ok(())
    }

    /// Checks materials that no shape has.
    pub(super) fn check_unused_materials(
        &mut self,
        bsdfs: &[&'d Child],
        stats: &mut SceneStats,
    ) -> Result<(), SceneError> {
        self.unused = true;
        for child in bsdfs {
            stats.unused += u64::from(!self.material_ids.contains_key(&child.node));
            self.material(child.node)?;
        }
        Ok(())
    }

    /// Checks textures that nothing refers to.
    pub(super) fn check_unused_textures(
        &mut self,
        textures: &[&'d Child],
        stats: &mut SceneStats,
    ) -> Result<(), SceneError> {
        self.unused = true;
        for child in textures {
            stats.unused += u64::from(!self.texture_ids.contains_key(&child.node));
            self.declared_texture(child)?;
        }
        Ok(())
    }

    /// True when a material or light depends on texture coordinates.
    pub(super) fn uses_uv(&self, material: MaterialId, emitter: Option<&'d Child>) -> bool {
        let textured =
            |e: &Child| self.doc.node(e.node).children.iter().any(|c| self.doc.node(c.node).tag == Tag::Texture);
        survey(&self.materials, &self.textures, material).uv || emitter.is_some_and(textured)
    }

    /// Drops texture coordinates and normals that nothing on the shape depends on, or that somebody wants to go; the bytes
    /// that were saved.
    pub(super) fn strip(&self, shape: &mut Shape, material: MaterialId, emitter: Option<&'d Child>) -> usize {
        let used = || self.uses_uv(material, emitter);
        let mesh = match shape {
            Shape::Mesh(mesh) => mesh,
            Shape::Sphere(sphere) => {
                sphere.uv = self.keep.uv.unwrap_or_else(used);
                return 0;
            }
            Shape::Disk(_) | Shape::Cylinder(_) => return 0,
        };
        let Some(mesh) = Arc::get_mut(mesh) else { return 0 };
        let before = mesh.memory();
        if !self.keep.uv.unwrap_or_else(used) {
            mesh.uvs = None;
        }
        match self.keep.normals {
            Some(true) => {}
            Some(false) => mesh.normals = None,
            None => _ = mesh.drop_flat_normals(),
        }
        before - mesh.memory()
    }
}
