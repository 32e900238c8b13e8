use super::*;
use crate::bsdf::{Dielectric, DiffuseBsdf, Ior, Metal};
use crate::geometry::{GeometrySet, Hit, NO_INSTANCE, Ray, Shape, TriangleMesh};
use crate::math::Vec2;
use crate::photon::Level;
use crate::sample::{Key, Purpose, Sampler, Sequence, warp};
use crate::shoot::walk::WalkSettings;

/// A point that no shape has.
fn spot(p: Vec3, ng: Vec3, ns: Vec3, wo: Vec3) -> SurfaceInteraction {
    SurfaceInteraction {
        p,
        p_err: p.abs() * 1e-6,
        ng,
        ns: if ns.dot(ng) < 0.0 { -ns } else { ns },
        uv: Vec2::ZERO,
        dpdu: Vec3::X,
        dpdv: Vec3::Y,
        wo,
        t: 1.0,
        shape: 0,
        prim: 0,
        instance: 0,
        barycentric: Vec2::ZERO,
        near: Default::default(),
        far: Default::default(),
    }
}

/// What becomes of photons with random surfaces, powers and numbers, all that is computed of them.
fn run(level: Level, sequence: Sequence, len: usize) -> String {
    let walk = WalkSettings { max_depth: None, rr_depth: 1, sequence };
    let (mut diffuse, mut interfaces) = (DiffuseLanes::new(&walk), InterfaceLanes::new(&walk));
    let mut metals = MetalLanes::new(&walk);
    diffuse.set_level(level);
    interfaces.set_level(level);
    metals.set_level(level);
    for i in 0..len {
        let mut s = Sampler::new(Sequence::Independent, Key::new(7, Purpose::Test, 0), i as u64);
        let [normal, bent, wo, p] = std::array::from_fn(|_| warp::uniform_sphere(s.next_2d()));
        let path = Key::new(8, Purpose::Test, i as u64);
        let mut flight = Flight::none(Sampler::new(sequence, path, 70 + i as u64), path);
        flight.depth = i as u32 % 3;
        // The first has a power that can be neither stored nor scattered.
        flight.flux = Rgb::new(s.next_1d(), 1e-3 * s.next_1d(), if i % 3 == 0 { 0.0 } else { 1.0 });
        let whole = if i == 0 { Rgb::splat(2.0) } else { Rgb::new(s.next_1d(), 1.0, 0.5) };
        if i == 0 {
            flight.flux = Rgb::new(f32::MAX, 1.0, 1.0);
        }
        // Some absorb all; media that are nearly or just equal, thinner and denser.
        let colors = [Some(whole), (i % 5 > 0).then_some(Rgb::new(1.0, 0.0, s.next_1d()))];
        let ior = Ior::new([1.5, 1.0, 0.7, 1.0 + 1e-5][i % 4], 1.0);
        let glass = Dielectric { ior, reflectance: whole, transmittance: Rgb::new(0.0, 0.5, 1.0) };
        let alpha = [0.0, 0.02, 0.3, 1.0][i / 2 % 4];
        let silver = Metal { alpha, eta: Rgb::splat(0.1), k: Rgb::new(4.0, s.next_1d(), 0.0), specular: whole };
        let metal = (silver, i % 6 < 3);
        if i % 4 > 0 {
            // A face, some of them needles, some with normals of their corners.
            let thin = if i % 7 == 0 { 1e-4 } else { 1.0 };
            let side = if wo.dot(normal) < 0.0 { -normal } else { normal };
            let mesh = TriangleMesh {
                positions: vec![p, p + bent, p + bent * 0.5 + side * thin].into(),
                indices: vec![[0, 1, 2]],
                normals: (i % 3 > 0).then(|| vec![normal, bent, wo]),
                flip_normals: i % 8 > 3,
                ..TriangleMesh::default()
            };
            let d = -wo * if i % 3 == 0 { 2.0 } else { 1.0 };
            let face = Face { mesh: &mesh, prim: 0, weights: [s.next_1d() * 0.5, s.next_1d() * 0.5], d };
            diffuse.push_face(i, &mut { flight }, &face, &colors);
            interfaces.push_face(i, &mut { flight }, &face, &glass);
            metals.push_face(i, &mut { flight }, &face, &metal);
        } else {
            let si = spot(p, normal, (normal + 0.5 * bent).normalize(), wo);
            let turn = if wo.dot(normal) < 0.0 { -1.0 } else { 1.0 };
            let bsdf = DiffuseBsdf::new(si.ns * turn, si.ng * turn, whole);
            diffuse.push(i, &mut { flight }, &si, &bsdf);
            interfaces.push(i, &mut { flight }, &si, &glass);
            metals.push(i, &mut { flight }, &si, &metal);
        }
    }
    diffuse.run();
    interfaces.run();
    metals.run();
    let photons: Vec<_> = (0..len).flat_map(|i| [diffuse.photon(i), metals.photon(i)]).collect();
    let leaving: Vec<_> = (0..len)
        .flat_map(|i| [diffuse.batch.leaving(i), interfaces.batch.leaving(i), metals.batch.leaving(i)])
        .collect();
    let mut balance = EnergyBalance::default();
    diffuse.batch.move_to(&mut balance);
    interfaces.batch.move_to(&mut balance);
    metals.batch.move_to(&mut balance);
    format!("{photons:?} {leaving:?} {balance:?}")
}

#[test]
fn every_instruction_set_gives_the_same_bits() {
    for len in [1, 15, 16, 17, WAVE] {
        for sequence in [Sequence::Independent, Sequence::Sobol] {
            let results: Vec<String> = Level::available().into_iter().map(|level| run(level, sequence, len)).collect();
            assert!(results.iter().all(|r| *r == results[0]), "{len} photons: {results:#?}");
            assert!(results[0].contains("None") && (len == 1 || results[0].contains("Some")));
        }
    }
}

/// Faces are met as their mesh says: with normals of their corners on either side of that of the triangle, turned, and needles.
#[test]
fn faces_are_met_as_by_their_mesh() {
    let walk = WalkSettings { max_depth: None, rr_depth: 1, sequence: Sequence::Independent };
    let (mut diffuse, mut interfaces) =
        ([0; 2].map(|_| DiffuseLanes::new(&walk)), [0; 2].map(|_| InterfaceLanes::new(&walk)));
    let mut metals = [0; 2].map(|_| MetalLanes::new(&walk));
    let mut sides = [0; 2];
    for i in 0..WAVE {
        let mut s = Sampler::new(Sequence::Independent, Key::new(9, Purpose::Test, 0), i as u64);
        let [a, b, c, p, d] = std::array::from_fn(|_| warp::uniform_sphere(s.next_2d()));
        let third = if i % 9 == 0 { p + 0.5 * a + 1e-5 * b } else { p + b };
        let mesh = TriangleMesh {
            positions: vec![p, p + a, third].into(),
            indices: vec![[0, 1, 2]],
            normals: (i % 3 > 0).then(|| vec![a, b, c]),
            flip_normals: i % 5 == 0,
            ..TriangleMesh::default()
        };
        let weights = [0.6 * s.next_1d(), 0.4 * s.next_1d()];
        let [u, v] = weights;
        let hit = Hit { t: 1.0, u, v, shape: 0, prim: 0, instance: NO_INSTANCE };
        let set =
            GeometrySet { shapes: vec![Shape::Mesh(mesh.clone().into())], top: vec![0], ..GeometrySet::default() };
        let si = set.interaction(&Ray::new(p - d, d), &hit);
        let n = (1.0 - u - v) * a + u * b + v * c;
        sides[(n.dot(si.ng) < 0.0) as usize] += (i % 3 > 0) as u32;
        let face = Face { mesh: &mesh, prim: 0, weights, d };
        let mut flight = Flight::none(Sampler::new(Sequence::Independent, Key(3), i as u64), Key(i as u64));
        flight.flux = Rgb::new(1.0, 0.5, 0.1);
        let colors = [Rgb::new(0.9, 0.5, 0.1), Rgb::new(0.1, 0.2, 0.3)];
        let turn = if si.wo.dot(si.ng) > 0.0 { 1.0 } else { -1.0 };
        let bsdf = DiffuseBsdf::new(si.ns * turn, si.ng * turn, colors[(turn < 0.0) as usize]);
        diffuse[0].push_face(i, &mut { flight }, &face, &colors.map(Some));
        diffuse[1].push(i, &mut { flight }, &si, &bsdf);
        let glass = Dielectric { ior: Ior::new(1.5, 1.0), reflectance: colors[0], transmittance: Rgb::WHITE };
        interfaces[0].push_face(i, &mut { flight }, &face, &glass);
        interfaces[1].push(i, &mut { flight }, &si, &glass);
        let silver = Metal { alpha: 0.3, eta: Rgb::splat(0.1), k: Rgb::splat(4.0), specular: colors[0] };
        metals[0].push_face(i, &mut { flight }, &face, &(silver, true));
        metals[1].push(i, &mut { flight }, &si, &(silver, true));
    }
    diffuse.iter_mut().for_each(DiffuseLanes::run);
    interfaces.iter_mut().for_each(InterfaceLanes::run);
    metals.iter_mut().for_each(MetalLanes::run);
    for i in 0..WAVE {
        let of = |lanes: &DiffuseLanes| format!("{:?} {:?}", lanes.photon(i), lanes.batch.leaving(i));
        assert_eq!(of(&diffuse[0]), of(&diffuse[1]), "{i}");
        let of = |lanes: &InterfaceLanes| format!("{:?}", lanes.batch.leaving(i));
        assert_eq!(of(&interfaces[0]), of(&interfaces[1]), "{i}");
        let of = |lanes: &MetalLanes| format!("{:?} {:?}", lanes.photon(i), lanes.batch.leaving(i));
        assert_eq!(of(&metals[0]), of(&metals[1]), "{i}");
    }
    assert!(sides.iter().all(|&n| n > 20), "{sides:?}");
}
