use super::*;
use crate::color::Rgb;
use crate::texture::{ColorParam, FloatParam};

/// A named material (the last one of the list).
pub struct Case {
    pub name: &'static str,
    pub materials: Vec<Material>,
    /// Works on both sides.
    pub both_sides: bool,
    /// Tilt of the shading normal, radians.
    pub bend: f32,
    /// Known to conserve energy with white parameters, which it has here.
    pub white: bool,
}

impl Case {
    fn new(name: &'static str, materials: Vec<Material>) -> Self {
        Self { name, materials, both_sides: false, bend: 0.0, white: false }
    }
    fn both_sides(self) -> Self {
        Self { both_sides: true, ..self }
    }
    fn bend(self, bend: f32) -> Self {
        Self { bend, ..self }
    }
    fn white(self) -> Self {
        Self { white: true, ..self }
    }
}

pub fn white() -> ColorParam {
    Rgb::WHITE.into()
}

pub fn color() -> ColorParam {
    Rgb::new(0.8, 0.5, 0.2).into()
}

pub fn diffuse(reflectance: ColorParam) -> Material {
    Material::diffuse(reflectance)
}

pub fn glass(n: f64) -> Material {
    Material::Dielectric { ior: Ior::new(n, 1.0), filling: None, reflectance: white(), transmittance: white() }
}

pub fn rough(distribution: Distribution, u: f32, v: f32) -> Roughness {
    Roughness { distribution, alpha_u: u.into(), alpha_v: v.into() }
}

pub fn rough_glass(roughness: Roughness, n: f64) -> Material {
    Material::RoughDielectric {
        roughness,
        ior: Ior::new(n, 1.0),
        filling: None,
        reflectance: white(),
        transmittance: white(),
    }
}

pub fn metal(name: &str) -> (ColorParam, ColorParam) {
    let (eta, k) = metal_by_name(name).expect("a metal of the table");
    (eta.into(), k.into())
}

pub fn conductor(name: &str) -> Material {
    let (eta, k) = metal(name);
    Material::Conductor { eta, k, specular: white() }
}

pub fn rough_conductor(roughness: Roughness, name: &str) -> Material {
    let (eta, k) = metal(name);
    Material::RoughConductor { roughness, eta, k, specular: white() }
}

pub fn id(i: u32) -> MaterialId {
    MaterialId(i)
}

/// Every material, smooth and delta ones too.
pub fn all() -> Vec<Case> {
    let mut cases = reflective();
    cases.extend(transmissive());
    cases.extend(nested());
    cases.extend(principled());
    cases
}

pub fn reflective() -> Vec<Case> {
    use Distribution::{Beckmann, Ggx};
    vec![
        Case::new("diffuse", vec![diffuse(white())]).white(),
        Case::new("diffuse, bent normal", vec![diffuse(color())]).bend(0.4),
        Case::new("conductor", vec![conductor("Au")]).white(),
        Case::new("roughconductor beckmann 0.1", vec![rough_conductor(rough(Beckmann, 0.1, 0.1), "Cu")]).white(),
        Case::new("roughconductor beckmann 0.3/0.05", vec![rough_conductor(rough(Beckmann, 0.3, 0.05), "none")])
            .white(),
        Case::new("roughconductor beckmann 1", vec![rough_conductor(rough(Beckmann, 1.0, 1.0), "none")]).white(),
        Case::new("roughconductor ggx 0.01", vec![rough_conductor(rough(Ggx, 0.01, 0.01), "Ag")]).white(),
        Case::new("roughconductor ggx 0.1/0.4", vec![rough_conductor(rough(Ggx, 0.1, 0.4), "none")]).white(),
        Case::new("roughconductor ggx 1", vec![rough_conductor(rough(Ggx, 1.0, 1.0), "none")]).white(),
        Case::new("roughconductor ggx 0.5, bent normal", vec![rough_conductor(rough(Ggx, 0.5, 0.5), "Al")]).bend(0.3),
        Case::new("plastic", vec![Material::plastic(1.49, 1.000277, white(), white(), false)]),
        Case::new("plastic nonlinear", vec![Material::plastic(1.49, 1.0, white(), white(), true)]).white(),
        Case::new("plastic, tinted", vec![Material::plastic(1.8, 1.0, color(), color(), true)]).white(),
        Case::new(
            "roughplastic beckmann 0.1",
            vec![Material::rough_plastic((Beckmann, 0.1), (1.49, 1.000277), white(), white(), true)],
        )
        .white(),
        Case::new(
            "roughplastic ggx 0.4",
            vec![Material::rough_plastic((Ggx, 0.4), (1.9, 1.0), color(), white(), false)],
        )
        .white(),
        Case::new("phong", vec![phong(30.0, 0.2)]).white(),
        Case::new("phong 800", vec![phong(800.0, 0.5)]).white(),
        Case::new("phong 0.5", vec![phong(0.5, 0.5)]).white(),
    ]
}

fn phong(exponent: f32, specular: f32) -> Material {
    Material::Phong {
        diffuse: Rgb::splat(0.5).into(),
        specular: Rgb::splat(specular).into(),
        exponent: FloatParam::Const(exponent),
    }
}

pub fn transmissive() -> Vec<Case> {
    use Distribution::{Beckmann, Ggx};
    let thin =
        Material::ThinDielectric { ior: Ior::new(1.5046, 1.000277), reflectance: white(), transmittance: white() };
    let tinted = Material::RoughDielectric {
        roughness: rough(Ggx, 0.25, 0.25),
        ior: Ior::new(1.33, 1.0),
        filling: None,
        reflectance: color(),
        transmittance: Rgb::new(0.2, 0.7, 0.9).into(),
    };
    vec![
        Case::new("dielectric", vec![glass(1.5)]).both_sides().white(),
        Case::new("dielectric, bent normal", vec![glass(1.5)]).both_sides().bend(0.2),
        Case::new("thindielectric", vec![thin]).both_sides().white(),
        Case::new("roughdielectric beckmann 0.1", vec![rough_glass(rough(Beckmann, 0.1, 0.1), 1.5046)])
            .both_sides()
            .white(),
        Case::new("roughdielectric ggx 0.3/0.1", vec![rough_glass(rough(Ggx, 0.3, 0.1), 1.5)]).both_sides().white(),
        Case::new("roughdielectric ggx 1", vec![rough_glass(rough(Ggx, 1.0, 1.0), 2.4)]).both_sides().white(),
        Case::new("roughdielectric beckmann 0.7", vec![rough_glass(rough(Beckmann, 0.7, 0.7), 1.2)])
            .both_sides()
            .white(),
        Case::new("roughdielectric ggx, denser outside", vec![rough_glass(rough(Ggx, 0.2, 0.2), 0.75)])
            .both_sides()
            .white(),
        Case::new("roughdielectric ggx, n = 1.02", vec![rough_glass(rough(Ggx, 0.5, 0.5), 1.02)]).both_sides().white(),
        Case::new("roughdielectric tinted", vec![tinted]).both_sides().white(),
        Case::new("roughdielectric, bent normal", vec![rough_glass(rough(Ggx, 0.3, 0.3), 1.5)]).both_sides().bend(0.3),
        Case::new("null", vec![Material::Null]).both_sides().white(),
    ]
}

pub fn nested() -> Vec<Case> {
    use Distribution::Ggx;
    let two = |a, b| Material::TwoSided { front: id(a), back: id(b) };
    let blend = |w: f32, a, b| Material::Blend { weight: w.into(), first: id(a), second: id(b) };
    let mask = |o: f32, a| Material::Mask { opacity: o.into(), nested: id(a) };
    let map = |a| Material::NormalMap { normals: Rgb::new(0.65, 0.4, 0.9).into(), nested: id(a) };
    let gloss = || rough_conductor(rough(Ggx, 0.2, 0.3), "Al");
    vec![
        Case::new("twosided", vec![diffuse(white()), gloss(), two(1, 0)]).both_sides().white(),
        Case::new("mask of twosided", vec![gloss(), two(0, 0), mask(0.7, 1)]).both_sides().white(),
        Case::new("blend", vec![gloss(), diffuse(color()), blend(0.3, 0, 1)]).white(),
        Case::new("blend with delta", vec![conductor("Ag"), diffuse(color()), blend(0.6, 0, 1)]).white(),
        Case::new("blend of glass and twosided", vec![glass(1.5), diffuse(white()), two(1, 1), blend(0.4, 0, 2)])
            .both_sides()
            .white(),
        Case::new("normalmap", vec![gloss(), map(0)]),
        Case::new("twosided normalmap", vec![gloss(), map(0), two(1, 1)]).both_sides(),
        Case::new("normalmap of roughdielectric", vec![rough_glass(rough(Ggx, 0.3, 0.3), 1.5), map(0)]).both_sides(),
        Case::new("blend of normalmap and plain", vec![diffuse(color()), gloss(), map(1), blend(0.5, 0, 2)]).bend(0.2),
    ]
}

pub fn principled() -> Vec<Case> {
    let p = |p: Principled| Material::Principled(Box::new(p));
    let metallic = Principled {
        metallic: 0.8.into(),
        anisotropic: 0.7.into(),
        roughness: 0.4.into(),
        base_color: color(),
        spec_tint: 0.5.into(),
        ..Default::default()
    };
    let cloth = Principled {
        sheen: 0.9.into(),
        sheen_tint: 0.5.into(),
        flatness: 0.6.into(),
        clearcoat: 1.0.into(),
        clearcoat_gloss: 0.2.into(),
        base_color: color(),
        ..Default::default()
    };
    let glassy = Principled {
        spec_trans: 0.8.into(),
        metallic: 0.1.into(),
        roughness: 0.5.into(),
        eta: 1.5,
        base_color: color(),
        clearcoat: 0.5.into(),
        ..Default::default()
    };
    let thin = PrincipledThin {
        spec_trans: 0.5.into(),
        diff_trans: 0.6.into(),
        sheen: 0.5.into(),
        spec_tint: 0.4.into(),
        flatness: 0.3.into(),
        anisotropic: 0.5.into(),
        base_color: color(),
        ..Default::default()
    };
    vec![
        Case::new("principled", vec![p(Principled::default())]),
        Case::new("principled metal", vec![p(metallic)]),
        Case::new("principled cloth with coat", vec![p(cloth)]),
        Case::new("principled glass", vec![p(glassy.clone())]).both_sides(),
        Case::new("principled glass, bent normal", vec![p(glassy)]).both_sides().bend(0.2),
        Case::new("principledthin", vec![Material::PrincipledThin(Box::new(thin))]).both_sides(),
    ]
}
