use arrayvec::ArrayVec;
use glam::Vec3;

use super::conductor::{Metal, Mirror};
use super::dielectric::{Dielectric, ThinReflection, ThinTransmission};
use super::diffuse::{DiffuseBsdf, Lambert};
use super::lobe::{Kind, Lobe};
use super::material::{Plastic, Principled, PrincipledThin, RoughPlastic, Roughness};
use super::microfacet::{Distribution, Microfacet};
use super::phong::Phong;
use super::plastic::{PlasticBase, PlasticCoat};
use super::principled::{ClearCoat, DiffuseTransmission, PrincipledDiffuse, PrincipledSpecular, ThinSpecular, tint_of};
use super::rough::{RoughConductor, RoughDielectric};
use super::rough_plastic::{RoughBase, RoughCoat};
use super::scatter::{Normals, from_lobes};
use super::{Bsdf, DELTA_ALPHA, Ior, LobeMask, MAX_LOBES, Material, MaterialId};
use crate::color::Rgb;
use crate::geometry::{GeometrySet, SurfaceInteraction};
use crate::math::{Frame, sqr};
use crate::texture::{ColorParam, FloatParam, Textures};

/// Looks up everything that the material says at `si` and decides its sides for `si.wo`.
///
/// The result answers for that `wo`, and for swapped pairs that have it as `wi`. `materials` must have passed
/// [`check`](super::check). `met` is the ratio of indices between the media that meet here, where overlaps decide it rather
/// than the material.
#[inline(always)]
pub fn evaluate(
    materials: &[Material],
    textures: &Textures,
    id: MaterialId,
    si: &SurfaceInteraction,
    geometry: &GeometrySet,
    met: Option<Ior>,
) -> Bsdf {
    let mut id = id;
    let mut front = si.wo.dot(si.ng) > 0.0;
    let mut flip = 1.0;

    // Diffuse surfaces, two-sided or not, need nothing of the general case.
    let diffuse =
        |reflectance, flip: f32| Bsdf::Diffuse(DiffuseBsdf { ns: si.ns * flip, ng: si.ng * flip, reflectance });
    loop {
        match &materials[id.0 as usize] {
            Material::TwoSided { front: a, back: b } => {
                (id, flip) = if front { (*a, flip) } else { (*b, -flip) };
                front = true;
            }
            Material::Diffuse { .. } | Material::TexturedDiffuse { .. } if !front => return Bsdf::Black,
            Material::Diffuse { reflectance } => return diffuse(*reflectance, flip),
            Material::TexturedDiffuse { reflectance } => {
                return diffuse(textures.eval(*reflectance, si, geometry), flip);
            }
            _ => return evaluate_lobes(materials, textures, (id, front, flip), si, geometry, met),
        }
    }
}

/// A material that is the same everywhere, and simple enough to be done for many hits at once.
#[derive(Clone, Copy, Debug)]
pub enum Plain {
    /// Reflectances of both sides: [`evaluate`] gives [`Bsdf::Diffuse`], or [`Bsdf::Black`], which is `None`.
    Diffuse([Option<Rgb>; 2]),
    /// A smooth interface.
    Interface(Dielectric),
    /// A conductor, and whether it is one on both sides.
    Metal((Metal, bool)),
}

/// Of all materials those that are plain.
pub fn plain(materials: &[Material]) -> Vec<Option<Plain>> {
    let color = |id: MaterialId| match &materials[id.0 as usize] {
        Material::Diffuse { reflectance } => Some(*reflectance),
        _ => None,
    };
    let plain = |material: &Material| match material {
        Material::TwoSided { front, back } => match (color(*front), color(*back)) {
            (Some(a), Some(b)) => Some(Plain::Diffuse([Some(a), Some(b)])),
            _ if front == back => plain_metal(&materials[front.0 as usize], true),
            _ => None,
        },
        Material::Diffuse { reflectance } => Some(Plain::Diffuse([Some(*reflectance), None])),
        Material::Dielectric {
            ior,
            reflectance: ColorParam::Const(reflectance),
            transmittance: ColorParam::Const(transmittance),
            ..
        } => Some(Plain::Interface(Dielectric { ior: *ior, reflectance: *reflectance, transmittance: *transmittance })),
        material => plain_metal(material, false),
    };
    materials.iter().map(plain).collect()
}

/// A conductor without textures as [`Metal`].
fn plain_metal(material: &Material, two_sided: bool) -> Option<Plain> {
    let (alpha, colors) = match material {
        Material::Conductor { eta, k, specular } => (0.0, (eta, k, specular)),
        Material::RoughConductor { roughness, eta, k, specular } => (roughness.plain_ggx()?, (eta, k, specular)),
        _ => return None,
    };
    let (&ColorParam::Const(eta), &ColorParam::Const(k), &ColorParam::Const(specular)) = colors else { return None };
    Some(Plain::Metal((Metal { alpha, eta, k, specular }, two_sided)))
}

/// [`evaluate`] of a material that is not diffuse, from where its two-sided shells end: the nested material, whether the
/// viewer is in front of it, and whether its normal is turned.
#[inline(never)]
fn evaluate_lobes(
    materials: &[Material],
    textures: &Textures,
    (id, front, flip): (MaterialId, bool, f32),
    si: &SurfaceInteraction,
    geometry: &GeometrySet,
    met: Option<Ior>,
) -> Bsdf {
    let mut frame = Frame::from_normal_tangent(si.ns, si.dpdu);
    frame.n *= flip;
    let mut point = Point { materials, textures, si, geometry, met, lobes: ArrayVec::new() };
    point.flatten(id, Place { frame, front, weight: 1.0, shadow: 0.0 });
    from_lobes(Normals { ng: si.ng, ns: si.ns }, &point.lobes)
}

/// The point that is being evaluated, and the lobes found so far.
struct Point<'a> {
    materials: &'a [Material],
    textures: &'a Textures,
    si: &'a SurfaceInteraction,
    geometry: &'a GeometrySet,
    met: Option<Ior>,
    lobes: ArrayVec<Lobe, MAX_LOBES>,
}

/// Where in the nest of materials the walk is. A frame may be left-handed: two-sided materials mirror it.
#[derive(Clone, Copy)]
struct Place {
    frame: Frame,
    /// The viewer is on the side of the frame's normal.
    front: bool,
    weight: f32,
    /// See [`Lobe`]: the shadowing of bent normals.
    shadow: f32,
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
            let _ = self.lobes.try_push(Lobe {
                frame: place.frame,
                weight: place.weight,
                shadow: place.shadow,
                class,
                kind,
            });
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
            Material::BumpMap { height, scale, nested } => {
                let n = self.bump_normal(*height, *scale);
                self.flatten(*nested, self.bend(place, n));
            }
            Material::NormalMap { normals, nested } => {
                let [x, y, z] = (self.color(*normals) * 2.0 - Rgb::WHITE).to_array();
                self.flatten(*nested, self.bend(place, Vec3::new(x, y, z)));
            }
            Material::Null => self.push(place, LobeMask::NULL, Kind::Null),
            material => {
                self.transmissive(material, place);
                if place.front {
                    self.reflective(material, place);
                }
            }
        }
    }

    fn two_sided(&mut self, front: MaterialId, back: MaterialId, place: Place) {
        if place.front {
            return self.flatten(front, place);
        }
        let frame = Frame { n: -place.frame.n, ..place.frame };
        self.flatten(back, Place { frame, front: true, ..place });
    }

    /// The normal of the surface displaced by `scale·height`, in the shading frame [Blinn 1978].
    fn bump_normal(&self, height: FloatParam, scale: f32) -> Vec3 {
        let si = self.si;
        let gradient = self.textures.gradient(height, si, self.geometry) * scale;
        let dpdu = si.dpdu + si.ns * (gradient.x - si.ns.dot(si.dpdu));
        let dpdv = si.dpdv + si.ns * (gradient.y - si.ns.dot(si.dpdv));
        let n = dpdu.cross(dpdv);
        let n = if n.dot(si.ng) < 0.0 { -n } else { n };
        Frame::from_normal_tangent(si.ns, si.dpdu).to_local(n)
    }

    /// The place with its normal bent to `n`, given in its frame, of any length.
    fn bend(&self, place: Place, n: Vec3) -> Place {
        let n = n.normalize_or(Vec3::Z);
        // A normal that faces away from the viewer is turned about the pole, towards it.
        let wo = place.frame.to_local(self.si.wo);
        let n = if wo.z * wo.dot(n) <= 0.0 { Vec3::new(-n.x, -n.y, n.z) } else { n };
        let tan_sq = (n.x * n.x + n.y * n.y) / (n.z * n.z).max(1e-20);
        let s = (Vec3::X - n * n.x).normalize_or(Vec3::Y);
        let world = |v: Vec3| place.frame.to_world(v).normalize_or(place.frame.n);
        let frame = Frame { s: world(s), t: world(n.cross(s)), n: world(n) };
        Place { frame, shadow: (0.125 * tan_sq).min(1.0), ..place }
    }

    fn interface(&self, ior: Ior, reflectance: ColorParam, transmittance: ColorParam) -> Dielectric {
        Dielectric { ior, reflectance: self.color(reflectance), transmittance: self.color(transmittance) }
    }

    /// The facets of `roughness` at this point; `None` if so smooth that the lobes are delta.
    fn facets(&self, roughness: &Roughness) -> Option<Microfacet> {
        let alpha = |p| self.textures.float(p, self.si, self.geometry);
        let (ax, ay) = (alpha(roughness.alpha_u), alpha(roughness.alpha_v));
        // One smooth direction beside a rough one is as smooth as facets can be; NaN counts as smooth.
        let rough = ax >= DELTA_ALPHA || ay >= DELTA_ALPHA;
        rough.then(|| Microfacet {
            distribution: roughness.distribution,
            ax: ax.max(DELTA_ALPHA),
            ay: ay.max(DELTA_ALPHA),
        })
    }

    /// Adds the lobes of a material that works on both sides.
    fn transmissive(&mut self, material: &Material, place: Place) {
        match material {
            Material::Dielectric { ior, reflectance, transmittance, .. } => {
                let lobe = self.interface(self.met.unwrap_or(*ior), *reflectance, *transmittance);
                self.push(place, LobeMask::DELTA, Kind::Dielectric(lobe));
            }
            Material::RoughDielectric { roughness, ior, reflectance, transmittance, .. } => {
                let smooth = self.interface(self.met.unwrap_or(*ior), *reflectance, *transmittance);
                // Between nearly equal media refraction bends by less than directions resolve.
                match self.facets(roughness).filter(|f| f.sharpness() * smooth.ior.m.abs() > 2.0 * DELTA_ALPHA) {
                    Some(facets) => {
                        let Dielectric { ior, reflectance, transmittance } = smooth;
                        let lobe = RoughDielectric { facets, ior, reflectance, transmittance };
                        let class = LobeMask::of_roughness(facets.sharpness());
                        self.push(place, class, Kind::RoughDielectric(lobe));
                    }
                    None => self.push(place, LobeMask::DELTA, Kind::Dielectric(smooth)),
                }
            }
            Material::ThinDielectric { ior, reflectance, transmittance } => {
                let (ior, r, t) = (*ior, self.color(*reflectance), self.color(*transmittance));
                self.push(place, LobeMask::DELTA, Kind::ThinReflection(ThinReflection { ior, tint: r }));
                self.push(place, LobeMask::NULL, Kind::ThinTransmission(ThinTransmission { ior, tint: t }));
            }
            Material::Principled(p) => self.principled(p, place),
            Material::PrincipledThin(p) => self.principled_thin(p, place),
            _ => {}
        }
    }

    /// Adds the lobes of a material that reflects on its front only, seen from there.
    fn reflective(&mut self, material: &Material, place: Place) {
        match material {
            Material::Diffuse { reflectance } => {
                self.push(place, LobeMask::DIFFUSE, Kind::Lambert(Lambert { reflectance: *reflectance }));
            }
            Material::TexturedDiffuse { reflectance } => {
                let reflectance = self.color(ColorParam::Texture(*reflectance));
                self.push(place, LobeMask::DIFFUSE, Kind::Lambert(Lambert { reflectance }));
            }
            Material::Conductor { eta, k, specular } => {
                let lobe = Mirror { eta: self.color(*eta), k: self.color(*k), specular: self.color(*specular) };
                self.push(place, LobeMask::DELTA, Kind::Mirror(lobe));
            }
            Material::RoughConductor { roughness, eta, k, specular } => {
                let (eta, k, specular) = (self.color(*eta), self.color(*k), self.color(*specular));
                match self.facets(roughness) {
                    Some(facets) => {
                        let lobe = RoughConductor { facets, eta, k, specular };
                        self.push(place, LobeMask::of_roughness(facets.sharpness()), Kind::RoughConductor(lobe));
                    }
                    None => self.push(place, LobeMask::DELTA, Kind::Mirror(Mirror { eta, k, specular })),
                }
            }
            Material::Plastic(p) => self.plastic(p, place),
            Material::RoughPlastic(p) => self.rough_plastic(p, place),
            Material::Phong { diffuse, specular, exponent } => {
                let exponent = self.textures.float(*exponent, self.si, self.geometry).max(0.0);
                let lobe = Phong { exponent, tint: self.color(*specular) };
                let reflectance = self.color(*diffuse);
                // The roughness whose facets are about as wide [Walter et al. 2007, §5.2].
                let class = LobeMask::of_roughness(super::phong::roughness(exponent));
                self.push(place, class, Kind::Phong(lobe));
                self.push(place, LobeMask::DIFFUSE, Kind::Lambert(Lambert { reflectance }));
            }
            _ => {}
        }
    }

    fn plastic(&mut self, p: &Plastic, place: Place) {
        let coat = PlasticCoat { ior: p.ior, tint: self.color(p.specular) };
        let base = PlasticBase { ior: p.ior, strength: p.strength(self.color(p.diffuse)), t_ext: p.t_ext };
        self.push(place, LobeMask::DELTA, Kind::PlasticCoat(coat));
        self.push(place, LobeMask::DIFFUSE, Kind::PlasticBase(base));
    }

    fn rough_plastic(&mut self, p: &RoughPlastic, place: Place) {
        let coat = RoughCoat { facets: p.facets, ior: p.plastic.ior, tint: self.color(p.plastic.specular) };
        let strength = p.plastic.strength(self.color(p.plastic.diffuse));
        let base = RoughBase { transmittance: p.transmittance, strength, t_ext: p.plastic.t_ext };
        self.push(place, LobeMask::of_roughness(p.facets.ax), Kind::RoughCoat(coat));
        self.push(place, LobeMask::DIFFUSE, Kind::RoughBase(base));
    }

    fn principled(&mut self, p: &Principled, place: Place) {
        let base = self.color(p.base_color);
        let (metallic, spec_trans) = (self.unit(p.metallic), self.unit(p.spec_trans));
        let bsdf = (1.0 - metallic) * spec_trans;
        // An interface of index 1 would not refract at all.
        let eta = if bsdf > 0.0 && p.eta == 1.0 { 1.001 } else { p.eta };
        let ior = Ior::new(eta as f64, 1.0);
        let facets = self.disney_facets(p.roughness, p.anisotropic, 1.0);

        let class = LobeMask::of_roughness(facets.sharpness());
        let spec_tint = self.unit(p.spec_tint);
        if place.front || bsdf > 0.0 {
            let lobe = PrincipledSpecular { facets, ior, base, metallic, spec_tint, bsdf };
            self.push(place, class, Kind::PrincipledSpecular(lobe));
        }
        if !place.front {
            return;
        }
        let share = (1.0 - metallic) * (1.0 - spec_trans);
        if share > 0.0 {
            let lobe = PrincipledDiffuse {
                base: base * share,
                roughness: self.unit(p.roughness),
                flatness: self.unit(p.flatness),
                sheen: self.sheen(base, p.sheen, p.sheen_tint) * (1.0 - metallic),
                both_sides: false,
            };
            self.push(place, LobeMask::DIFFUSE, Kind::PrincipledDiffuse(lobe));
        }
        let clearcoat = self.unit(p.clearcoat);
        if clearcoat > 0.0 {
            let alpha = 0.1 + (0.001 - 0.1) * self.unit(p.clearcoat_gloss);
            let lobe = ClearCoat { strength: 0.25 * clearcoat, alpha, ior };
            self.push(place, LobeMask::of_roughness(alpha), Kind::ClearCoat(lobe));
        }
    }

    fn principled_thin(&mut self, p: &PrincipledThin, place: Place) {
        let base = self.color(p.base_color);
        let eta = self.textures.float(p.eta, self.si, self.geometry);
        let (strength, spec_tint) = (self.unit(p.spec_trans), self.unit(p.spec_tint));
        let diff_trans = 0.5 * self.textures.float(p.diff_trans, self.si, self.geometry).clamp(0.0, 2.0);

        // Diffuse reflection and transmission share what the specular lobes leave.
        let share = (1.0 - strength) * (1.0 - diff_trans);
        if share > 0.0 {
            let lobe = PrincipledDiffuse {
                base: base * share,
                roughness: self.unit(p.roughness),
                flatness: self.unit(p.flatness),
                sheen: self.sheen(base, p.sheen, p.sheen_tint) * share,
                both_sides: true,
            };
            self.push(place, LobeMask::DIFFUSE, Kind::PrincipledDiffuse(lobe));
        }
        if (1.0 - strength) * diff_trans > 0.0 {
            let lobe = DiffuseTransmission { transmittance: base * ((1.0 - strength) * diff_trans) };
            self.push(place, LobeMask::DIFFUSE, Kind::DiffuseTransmission(lobe));
        }
        if strength <= 0.0 {
            return;
        }
        // Transmission has a roughness of its own [Burley 2015, figure 15].
        for (transmit, scale) in [(false, 1.0), (true, 0.65 * eta - 0.35)] {
            let facets = self.disney_facets(p.roughness, p.anisotropic, scale);
            let ior = Ior::new(eta as f64, 1.0);
            let lobe = ThinSpecular { facets, ior, strength, base, spec_tint, transmit };
            self.push(place, LobeMask::of_roughness(facets.sharpness()), Kind::ThinSpecular(lobe));
        }
    }

    fn sheen(&self, base: Rgb, sheen: FloatParam, tint: FloatParam) -> Rgb {
        Rgb::WHITE.lerp(tint_of(base), self.unit(tint)) * self.unit(sheen)
    }

    /// Roughness squared, stretched by the anisotropy [Burley 2012, §5.4].
    fn disney_facets(&self, roughness: FloatParam, anisotropic: FloatParam, scale: f32) -> Microfacet {
        let alpha = sqr(scale * self.unit(roughness));
        let aspect = (1.0 - 0.9 * self.unit(anisotropic)).sqrt();
        let (ax, ay) = ((alpha / aspect).max(0.001), (alpha * aspect).max(0.001));
        Microfacet { distribution: Distribution::Ggx, ax, ay }
    }
}
