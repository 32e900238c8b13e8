use arrayvec::ArrayVec;

use super::conductor::Mirror;
use super::dielectric::{Dielectric, ThinReflection, ThinTransmission};
use super::diffuse::{DiffuseBsdf, Lambert};
use super::lobe::{Kind, Lobe};
use super::material::Plastic;
use super::plastic::{PlasticBase, PlasticCoat};
use super::scatter::from_lobes;
use super::{Bsdf, LobeMask, MAX_LOBES, Material, MaterialId};
use crate::color::Rgb;
use crate::geometry::{GeometrySet, SurfaceInteraction};
use crate::math::Frame;
use crate::texture::{ColorParam, FloatParam, Textures};

/// Looks up everything that the material says at `si` and decides its sides for `si.wo`.
///
/// The result answers for that `wo`, and for swapped pairs that have it as `wi`. `materials` must have passed
/// [`check`](super::check).
#[inline]
pub fn evaluate(
    materials: &[Material],
    textures: &Textures,
    id: MaterialId,
    si: &SurfaceInteraction,
    geometry: &GeometrySet,
) -> Bsdf {
    let mut id = id;
    let mut front = si.wo.dot(si.ng) > 0.0;
    let mut flip = 1.0;

    // Diffuse surfaces, two-sided or not, need nothing of the general case.
    loop {
        match &materials[id.0 as usize] {
            Material::TwoSided { front: a, back: b } => {
                (id, flip) = if front { (*a, flip) } else { (*b, -flip) };
                front = true;
            }
            Material::Diffuse { .. } if !front => return Bsdf::Black,
            Material::Diffuse { reflectance } => {
                let reflectance = textures.color(*reflectance, si, geometry);
                return Bsdf::Diffuse(DiffuseBsdf { ns: si.ns * flip, ng: si.ng * flip, reflectance });
            }
            _ => break,
        }
    }
    let mut frame = Frame::from_normal_tangent(si.ns, si.dpdu);
    frame.n *= flip;
    let mut point = Point { materials, textures, si, geometry, lobes: ArrayVec::new() };
    point.flatten(id, Place { frame, front, weight: 1.0 });
    from_lobes(si.ng, &point.lobes)
}

/// The point that is being evaluated, and the lobes found so far.
struct Point<'a> {
    materials: &'a [Material],
    textures: &'a Textures,
    si: &'a SurfaceInteraction,
    geometry: &'a GeometrySet,
    lobes: ArrayVec<Lobe, MAX_LOBES>,
}

/// Where in the nest of materials the walk is. A frame may be left-handed: two-sided materials mirror it.
#[derive(Clone, Copy)]
struct Place {
    frame: Frame,
    /// The viewer is on the side of the frame's normal.
    front: bool,
    weight: f32,
}

impl Point<'_> {
    fn color(&self, p: ColorParam) -> Rgb {
        self.textures.color(p, self.si, self.geometry)
    }

    fn unit(&self, p: FloatParam) -> f32 {
        self.textures.float(p, self.si, self.geometry).clamp(0.0, 1.0)
    }

    fn push(&mut self, place: Place, class: LobeMask, kind: Kind) {
        if place.weight > 0.0 {
            // `check` bounds the count; a lobe beyond it would be dropped rather than panic.
            let _ = self.lobes.try_push(Lobe { frame: place.frame, weight: place.weight, class, kind });
        }
    }

    /// Adds the lobes of `id`.
    fn flatten(&mut self, id: MaterialId, place: Place) {
        let materials = self.materials;
        match &materials[id.0 as usize] {
            Material::TwoSided { front, back } => self.two_sided(*front, *back, place),
            Material::Mask { opacity, nested } => {
                let opacity = self.unit(*opacity);
                self.push(Place { weight: place.weight * (1.0 - opacity), ..place }, LobeMask::NULL, Kind::Null);
                self.flatten(*nested, Place { weight: place.weight * opacity, ..place });
            }
            Material::Blend { weight, first, second } => {
                let t = self.unit(*weight);
                self.flatten(*first, Place { weight: place.weight * (1.0 - t), ..place });
                self.flatten(*second, Place { weight: place.weight * t, ..place });
            }
            Material::Null => self.push(place, LobeMask::NULL, Kind::Null),
            Material::Dielectric { ior, reflectance, transmittance } => {
                let (reflectance, transmittance) = (self.color(*reflectance), self.color(*transmittance));
                let lobe = Dielectric { ior: *ior, reflectance, transmittance };
                self.push(place, LobeMask::DELTA, Kind::Dielectric(lobe));
            }
            Material::ThinDielectric { ior, reflectance, transmittance } => {
                let (ior, r, t) = (*ior, self.color(*reflectance), self.color(*transmittance));
                self.push(place, LobeMask::DELTA, Kind::ThinReflection(ThinReflection { ior, tint: r }));
                self.push(place, LobeMask::NULL, Kind::ThinTransmission(ThinTransmission { ior, tint: t }));
            }
            one_sided if place.front => self.reflective(one_sided, place),
            _ => {}
        }
    }

    fn two_sided(&mut self, front: MaterialId, back: MaterialId, place: Place) {
        if place.front {
            return self.flatten(front, place);
        }
        let frame = Frame { n: -place.frame.n, ..place.frame };
        self.flatten(back, Place { frame, front: true, ..place });
    }

    /// Adds the lobes of a material that reflects on its front only, seen from there.
    fn reflective(&mut self, material: &Material, place: Place) {
        match material {
            Material::Diffuse { reflectance } => {
                let reflectance = self.color(*reflectance);
                self.push(place, LobeMask::DIFFUSE, Kind::Lambert(Lambert { reflectance }));
            }
            Material::Conductor { eta, k, specular } => {
                let lobe = Mirror { eta: self.color(*eta), k: self.color(*k), specular: self.color(*specular) };
                self.push(place, LobeMask::DELTA, Kind::Mirror(lobe));
            }
            Material::Plastic(p) => self.plastic(p, place),
            _ => {}
        }
    }

    fn plastic(&mut self, p: &Plastic, place: Place) {
        let coat = PlasticCoat { ior: p.ior, tint: self.color(p.specular) };
        let strength = PlasticBase::strength(self.color(p.diffuse), p.ior, p.r_int, p.nonlinear);
        let base = PlasticBase { ior: p.ior, strength, t_ext: p.t_ext };
        self.push(place, LobeMask::DELTA, Kind::PlasticCoat(coat));
        self.push(place, LobeMask::DIFFUSE, Kind::PlasticBase(base));
    }
}
