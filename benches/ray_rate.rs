//! What does the layer above Embree cost? Ray rate through `Accel` against a bare loop over `rtcIntersect1` and
//! `rtcOccluded1` with the raw bindings, on the same rays: diffuse rays inside a bumpy ball of a million triangles.
//!
//! Metric: median over rounds of the ratio of the two rates, measured in turn; the aim is at least 0.90.
//! The Rust BVH is shown beside it. One thread.
#[cfg(not(embree))]
fn main() {
    println!("this build has no Embree to compare with");
}

#[cfg(embree)]
#[path = "../tests/meshes/mod.rs"]
mod meshes;

#[cfg(embree)]
fn main() {
    with_embree::main();
}

#[cfg(embree)]
mod with_embree {
    use std::hint::black_box;
    use std::time::Instant;

    use caustica::accel::{Accel, AccelKind};
    use caustica::geometry::Ray;
    use embree4_sys::{Coherence, Packet16, raw};

    use super::meshes::{Class, bumpy_ball, ray, set_of};

    const RAYS: u64 = 100_000;
    const ROUNDS: usize = 11;

    pub fn main() {
        let set = set_of(bumpy_ball(501));
        let embree = Accel::build(AccelKind::Embree, set.clone()).expect("Embree");
        let bvh = Accel::build(AccelKind::Bvh, set.clone()).expect("BVH");
        println!("{} triangles; {}; {}", set.shapes[0].primitives(), embree.description(), bvh.description());
        println!("memory: {} MB; {} MB", embree.memory() >> 20, bvh.memory() >> 20);
        for class in [Class::Primary, Class::Diffuse, Class::Shadow] {
            let mut rays: Vec<Ray> = (0..RAYS).filter_map(|i| ray(class, &set, &embree, RAYS, i)).collect();
            if !matches!(class, Class::Primary) {
                shuffle(&mut rays);
            }
            compare(class, &embree, &bvh, &rays);
        }
    }

    fn compare(class: Class, embree: &Accel, bvh: &Accel, rays: &[Ray]) {
        let Accel::Embree(inner) = embree else { unreachable!("asked for Embree") };
        let scene = inner.scene();
        let any = matches!(class, Class::Shadow);
        let through = |accel: &Accel| {
            let hit = |r: &&Ray| if any { accel.occluded(r) } else { accel.intersect(r).is_some() };
            rays.iter().filter(hit).count()
        };
        let bare = || {
            rays.iter().filter(|r| if any { bare_occluded(scene.raw(), r) } else { bare_hit(scene.raw(), r) }).count()
        };
        let packets = || {
            let mut packet = Packet16::default();
            let trace = |chunk: &[Ray]| {
                packet.set(chunk.iter().map(query));
                if any {
                    scene.occluded16(&mut packet);
                    (0..packet.len()).filter(|&i| packet.is_occluded(i)).count()
                } else {
                    scene.intersect16(&mut packet, Coherence::Coherent);
                    (0..packet.len()).filter(|&i| packet.hit(i).is_some()).count()
                }
            };
            rays.chunks(16).map(trace).sum()
        };
        assert_eq!(bare(), through(embree));
        let mut rates: [Vec<f64>; 4] = Default::default();
        let mut ratios = Vec::new();
        for _ in 0..ROUNDS {
            let bare = rate(rays, bare);
            let layered = rate(rays, || through(embree));
            ratios.push(layered / bare);
            for (list, r) in rates.iter_mut().zip([bare, layered, rate(rays, packets), rate(rays, || through(bvh))]) {
                list.push(r);
            }
        }
        let [bare, layered, packets, bvh] = rates.map(median);
        println!(
            "{class:?}: bare {bare:.2} Mray/s, Accel::Embree {layered:.2}, ratio {:.3}; packets of 16 {packets:.2}; BVH {bvh:.2}",
            median(ratios)
        );
    }

    fn query(r: &Ray) -> embree4_sys::Ray {
        embree4_sys::Ray { origin: r.o.to_array(), direction: r.d.to_array(), tnear: 0.0, tfar: r.tmax }
    }

    fn raw_ray(r: &Ray) -> raw::RTCRay {
        raw::RTCRay {
            org_x: r.o.x,
            org_y: r.o.y,
            org_z: r.o.z,
            tnear: 0.0,
            dir_x: r.d.x,
            dir_y: r.d.y,
            dir_z: r.d.z,
            time: 0.0,
            tfar: r.tmax,
            mask: u32::MAX,
            id: 0,
            flags: 0,
        }
    }

    fn bare_hit(scene: raw::RTCScene, r: &Ray) -> bool {
        // SAFETY: integers and floats, for which zero bytes are valid.
        let mut query: raw::RTCRayHit = unsafe { std::mem::zeroed() };
        query.ray = raw_ray(r);
        query.hit.geomID = raw::INVALID_ID;
        query.hit.instID[0] = raw::INVALID_ID;
        // SAFETY: the scene is committed and lives through the measurement; the query is initialised.
        unsafe { raw::intersect1(scene, &mut query) };
        query.hit.geomID != raw::INVALID_ID
    }

    fn bare_occluded(scene: raw::RTCScene, r: &Ray) -> bool {
        let mut query = raw_ray(r);
        // SAFETY: as above.
        unsafe { raw::occluded1(scene, &mut query) };
        query.tfar < 0.0
    }

    /// Millions of rays per second.
    fn rate(rays: &[Ray], mut work: impl FnMut() -> usize) -> f64 {
        let start = Instant::now();
        black_box(work());
        rays.len() as f64 / start.elapsed().as_secs_f64() * 1e-6
    }

    fn median(mut values: Vec<f64>) -> f64 {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    }

    /// Takes the order out of the rays, as a path tracer's depth does.
    fn shuffle(rays: &mut [Ray]) {
        for i in (1..rays.len()).rev() {
            rays.swap(i, (caustica::sample::mix64(i as u64) % (i as u64 + 1)) as usize);
        }
    }
}
