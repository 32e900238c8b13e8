use super::*;
use crate::bsdf::{Dielectric, DiffuseBsdf, Ior, Metal};
use crate::geometry::TriangleMesh;
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
    let leaving: Vec<_> =
        (0..len).flat_map(|i| [diffuse.leaving(i), interfaces.leaving(i), metals.leaving(i)]).collect();
    let mut balance = EnergyBalance::default();
    diffuse.add_to(&mut balance);
    interfaces.add_to(&mut balance);
    metals.add_to(&mut balance);
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
