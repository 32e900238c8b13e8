use std::sync::Arc;

use glam::{DMat4, DVec3, Vec3};

use super::*;
use crate::geometry::{NO_INSTANCE, Shape, TriangleMesh, VertexAttribute};
use crate::image::Image;

fn at(uv: Vec2, prim: u32, barycentric: Vec2) -> SurfaceInteraction {
    SurfaceInteraction {
        p: Vec3::ZERO,
        p_err: Vec3::ZERO,
        ng: Vec3::Z,
        ns: Vec3::Z,
        uv,
        dpdu: Vec3::X,
        dpdv: Vec3::Y,
        wo: Vec3::Z,
        t: 1.0,
        shape: 0,
        prim,
        instance: NO_INSTANCE,
        barycentric,
        near: Default::default(),
        far: Default::default(),
    }
}

fn quad() -> GeometrySet {
    let attribute = |name: &str, channels, per_vertex, data: &[f32]| VertexAttribute {
        name: name.into(),
        channels,
        per_vertex,
        data: data.to_vec(),
    };
    let mesh = TriangleMesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y].into(),
        indices: vec![[0, 1, 2], [0, 2, 3]],
        attributes: vec![
            attribute("vertex_color", 3, true, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
            attribute("face_heat", 1, false, &[2.0, 4.0]),
        ],
        ..Default::default()
    };
    GeometrySet { shapes: vec![Shape::Mesh(Arc::new(mesh))], ..Default::default() }
}

#[test]
fn constants_need_no_texture() {
    let (textures, geometry) = (Textures::default(), GeometrySet::default());
    let si = at(Vec2::ZERO, 0, Vec2::ZERO);
    assert_eq!(textures.color(Rgb::new(1.0, 2.0, 3.0).into(), &si, &geometry), Rgb::new(1.0, 2.0, 3.0));
    assert_eq!(textures.float(0.5.into(), &si, &geometry), 0.5);
    assert_eq!(textures.gradient(0.5.into(), &si, &geometry), Vec2::ZERO);
    assert_eq!(textures.texel_grid(Rgb::WHITE.into()), None);
    assert!(textures.is_empty());
}

/// Barycentric (¼, ½) on triangle (0, 1, 2): ¼ red + ¼ green + ½ blue.
#[test]
fn mesh_attributes_interpolate_or_stay_per_face() {
    let geometry = quad();
    let mut textures = Textures::default();
    let attribute = |name: &str, scale| Texture::MeshAttribute(MeshAttribute { name: name.into(), scale });
    let color = textures.add(attribute("vertex_color", 2.0));
    let heat = textures.add(attribute("face_heat", 1.0));
    let missing = textures.add(attribute("vertex_none", 1.0));
    let si = at(Vec2::ZERO, 0, Vec2::new(0.25, 0.5));
    assert_eq!(textures.eval(color, &si, &geometry), Rgb::new(0.5, 0.5, 1.0));
    assert_eq!(textures.eval_scalar(heat, &si, &geometry), 2.0);
    assert_eq!(textures.eval_scalar(heat, &at(Vec2::ZERO, 1, Vec2::ZERO), &geometry), 4.0);
    assert_eq!(textures.eval(missing, &si, &geometry), Rgb::BLACK);
    assert_eq!(textures.mean_float(FloatParam::Texture(heat), &geometry), 3.0);
    assert_eq!(textures.mean_color(ColorParam::Texture(color), &geometry), Rgb::splat(0.5));
    assert_eq!(textures.mean_color(ColorParam::Texture(missing), &geometry), Rgb::BLACK);
}

#[test]
fn checkerboards_alternate_and_nest() {
    let geometry = GeometrySet::default();
    let mut textures = Textures::default();
    let image = Image::constant(2, 2, Rgb::new(0.0, 1.0, 0.0));
    let green = textures.add(Texture::Bitmap(Bitmap::new(&image, BitmapSettings::default())));
    let to_uv = uv_transform(&DMat4::from_scale(DVec3::new(2.0, 2.0, 1.0)));
    let board = Checkerboard { color0: Rgb::WHITE.into(), color1: ColorParam::Texture(green), to_uv };
    let board = textures.add(Texture::Checkerboard(board));
    let color = |u, v| textures.eval(board, &at(Vec2::new(u, v), 0, Vec2::ZERO), &geometry);
    // Scaled by two: squares of a quarter.
    assert_eq!([color(0.1, 0.1), color(0.3, 0.1)], [Rgb::WHITE, Rgb::new(0.0, 1.0, 0.0)]);
    assert_eq!([color(0.3, 0.3), color(-0.1, 0.1)], [Rgb::WHITE, Rgb::new(0.0, 1.0, 0.0)]);
    assert_eq!(textures.mean_color(ColorParam::Texture(board), &geometry), Rgb::new(0.5, 1.0, 0.5));
}

/// Each quarter of the board's unit square is one colour; 64 cells resolve it exactly, black ones get the 1 % floor.
#[test]
fn a_checkerboard_light_has_a_grid() {
    let mut textures = Textures::default();
    let board = Checkerboard { color0: Rgb::splat(3.0).into(), color1: Rgb::BLACK.into(), ..Default::default() };
    let id = textures.add(Texture::Checkerboard(board));
    let grid = textures.texel_grid(ColorParam::Texture(id)).expect("a checkerboard has a grid of texels");
    assert_eq!(grid.luminance.len(), 64 * 64);
    assert!((grid.luminance[0] - 3.0).abs() < 1e-5 && (grid.luminance[63] - 0.03).abs() < 1e-6);
}

#[test]
#[should_panic(expected = "earlier ones")]
fn a_texture_cannot_refer_to_itself() {
    let board = Checkerboard { color0: ColorParam::Texture(TextureId(0)), ..Default::default() };
    Textures::default().add(Texture::Checkerboard(board));
}

#[test]
fn the_uv_matrix_keeps_rotation_scale_and_shift() {
    let m = DMat4::from_translation(DVec3::new(0.25, 0.5, 9.0)) * DMat4::from_scale(DVec3::new(2.0, 3.0, 7.0));
    assert_eq!(uv_transform(&m).transform_point2(Vec2::new(1.0, 1.0)), Vec2::new(2.25, 3.5));
}
