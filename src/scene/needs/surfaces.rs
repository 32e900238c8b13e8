//! What the surfaces of a scene can do to light, and where it can go from one to another.

use glam::Vec3;

use crate::bsdf::{Abilities, LobeMask, MaterialId, survey};
use crate::geometry::{Outlook, Shape, corners};
use crate::light::Light;
use crate::math::Bounds3;
use crate::scene::Scene;

/// Surfaces up to which all pairs are looked at; with more, each may see each.
const MOST_SURFACES: usize = 256;

/// Pairs of lights and surfaces that are looked at; with more, every light reaches every surface.
const MOST_PAIRS: usize = 1 << 20;

/// A shape with all places where it stands.
pub struct Surface {
    pub shape: usize,
    pub can: Abilities,
    /// The shape has normals that differ from its geometry's.
    pub smooth: bool,
    bounds: Bounds3,
    hull: Vec<Vec3>,
    outlook: Outlook,
}

impl Surface {
    pub fn scatters(&self) -> bool {
        !self.can.classes.is_empty()
    }

    /// Photons are stored here.
    pub fn receives(&self) -> bool {
        self.can.classes.intersects(LobeMask::SMOOTH_WIDE)
    }

    /// Light leaves here as a caustic.
    pub fn focuses(&self) -> bool {
        self.can.classes.intersects(LobeMask::SPECULAR)
    }

    /// False when no light scattered here goes straight to `other`.
    fn may_send_to(&self, other: &Surface) -> bool {
        if self.shape == other.shape {
            return !self.outlook.misses_itself(&self.hull, self.can.both_sides);
        }
        !self.outlook.misses(&other.hull, self.can.both_sides)
            && !other.outlook.misses(&self.hull, other.can.both_sides)
    }
}

/// The surfaces of a scene that scatter light.
pub struct Surfaces {
    pub list: Vec<Surface>,
}

impl Surfaces {
    /// Looks at every shape that stands in the scene, by itself or through instances.
    pub fn of(scene: &Scene) -> Self {
        let set = &scene.geometry;
        // Materials are shared by many shapes.
        let mut abilities: Vec<Option<Abilities>> = vec![None; scene.materials.len()];
        let mut can = |id: MaterialId| {
            *abilities[id.0 as usize].get_or_insert_with(|| survey(&scene.materials, &scene.textures, id))
        };
        let smooth = |shape: &Shape| matches!(shape, Shape::Mesh(m) if m.normals.is_some());
        let mut list = Vec::new();
        for &index in &set.top {
            let shape = &set.shapes[index as usize];
            list.push(Surface {
                shape: index as usize,
                can: can(scene.shape_materials[index as usize]),
                smooth: smooth(shape),
                bounds: shape.bounds(),
                hull: shape.hull(),
                outlook: Outlook::of(shape),
            });
        }
        // Of what is instanced only the box around all copies is known.
        let mut boxes = vec![Bounds3::EMPTY; set.groups.len()];
        let groups: Vec<Bounds3> = (0..set.groups.len() as u32).map(|g| set.group_bounds(g)).collect();
        for i in &set.instances {
            boxes[i.group as usize] = boxes[i.group as usize].union(i.bounds(&groups[i.group as usize]));
        }
        for (group, bounds) in set.groups.iter().zip(boxes).filter(|(_, b)| !b.is_empty()) {
            list.extend(group.iter().map(|&index| Surface {
                shape: index as usize,
                can: can(scene.shape_materials[index as usize]),
                smooth: smooth(&set.shapes[index as usize]),
                bounds,
                hull: corners(&bounds),
                outlook: Outlook::Anywhere,
            }));
        }
        list.retain(Surface::scatters);
        Self { list }
    }

    pub fn receivers(&self) -> impl Iterator<Item = &Surface> {
        self.list.iter().filter(|s| s.receives())
    }

    pub fn casters(&self) -> impl Iterator<Item = &Surface> {
        self.list.iter().filter(|s| s.focuses())
    }

    /// False when light scattered by one surface meets no other, nor itself.
    pub fn interreflect(&self) -> bool {
        self.some_pair(&self.list.iter().collect::<Vec<_>>(), &self.list.iter().collect::<Vec<_>>())
    }

    /// False when no caustic falls straight onto any surface that stores photons.
    pub fn cast(&self) -> bool {
        self.some_pair(&self.casters().collect::<Vec<_>>(), &self.receivers().collect::<Vec<_>>())
    }

    fn some_pair(&self, from: &[&Surface], to: &[&Surface]) -> bool {
        if self.list.len() > MOST_SURFACES {
            return !from.is_empty() && !to.is_empty();
        }
        from.iter().any(|a| to.iter().any(|b| a.may_send_to(b)))
    }

    /// False when no light shines straight onto a surface that focuses it.
    pub fn casters_are_lit(&self, scene: &Scene) -> bool {
        let ctx = scene.light_context();
        let lights: Vec<&Light> = scene.lights.iter().filter(|l| !l.is_dark(&ctx)).collect();
        if lights.len() * self.list.len() > MOST_PAIRS {
            return !lights.is_empty() && self.casters().next().is_some();
        }
        self.casters().any(|c| lights.iter().any(|l| l.may_reach(&ctx, &c.bounds)))
    }
}
