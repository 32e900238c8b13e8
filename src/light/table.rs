use glam::{DVec3, Vec2};

use crate::color::Rgb;
use crate::geometry::{NO_INSTANCE, SurfaceInteraction};
use crate::sample::Distribution2d;
use crate::texture::{ColorParam, Texture, Textures};

/// Share of uniform density that every cell gets, so that what falls between the probes is still found.
const DEFENSIVE: f32 = 0.1;

/// Probes a function of the unit square at 2×2 points of every cell: a density that follows its mean channel, and its mean.
pub(super) fn tabulate(width: usize, height: usize, f: impl Fn(Vec2) -> Rgb) -> (Distribution2d, Rgb) {
    let mut sum = DVec3::ZERO;
    let mut weights = Vec::with_capacity(width * height);
    for i in 0..width * height {
        let corner = Vec2::new((i % width) as f32, (i / width) as f32);
        let probe = |k: usize| {
            let inside = Vec2::new(0.25 + 0.5 * (k % 2) as f32, 0.25 + 0.5 * (k / 2) as f32);
            f((corner + inside) / Vec2::new(width as f32, height as f32))
        };
        let cell = (0..4).map(probe).sum::<Rgb>() * 0.25;
        sum += DVec3::new(cell.r as f64, cell.g as f64, cell.b as f64);
        weights.push(cell.mean());
    }
    let mean = sum / (width * height) as f64;
    let floor = DEFENSIVE * (mean.element_sum() / 3.0) as f32;
    weights.iter_mut().for_each(|w| *w += floor);
    (Distribution2d::new(width, height, &weights), Rgb::new(mean.x as f32, mean.y as f32, mean.z as f32))
}

/// Cells for the uv square of a texture: a multiple of its texels, over which probing a bilinear bitmap is exact.
pub(super) fn grid_size(textures: &Textures, param: ColorParam) -> (usize, usize) {
    const LEAST: usize = 128;
    const MOST: usize = 2048;
    let (w, h) = match param {
        ColorParam::Texture(id) => match textures.get(id) {
            Texture::Bitmap(b) => b.resolution(),
            _ => (LEAST as u32, LEAST as u32),
        },
        ColorParam::Const(_) => (1, 1),
    };
    let cells = |n: usize| (n * LEAST.div_ceil(n)).min(MOST);
    (cells(w as usize), cells(h as usize))
}

/// A place that only has texture coordinates.
pub(super) fn at_uv(uv: Vec2) -> SurfaceInteraction {
    use glam::Vec3;
    SurfaceInteraction {
        p: Vec3::ZERO,
        p_err: Vec3::ZERO,
        ng: Vec3::Z,
        ns: Vec3::Z,
        uv,
        dpdu: Vec3::X,
        dpdv: Vec3::Y,
        wo: Vec3::Z,
        t: 0.0,
        shape: 0,
        prim: 0,
        instance: NO_INSTANCE,
        barycentric: Vec2::ZERO,
        near: Default::default(),
        far: Default::default(),
    }
}
