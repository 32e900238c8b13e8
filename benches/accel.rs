//! How fast are the ray queries? Millions of rays per second, build seconds and bytes of the Rust BVH, Embree and the
//! crates `obvhs` and `bvh`, on generated meshes and on OBJ files named on the command line.
//!
//! Metric: per ray class, rays per second of processor time (all cores busy), and the median over rounds of the ratio to
//! the first rival; rivals take turns within a round, so that a disturbance of the machine meets all of them.
//!
//! `cargo bench --features rivals --bench accel -- [--meshes terrain:100000,flake:1000000] [--rays N] [--rounds N] [--classes a,b] [--rivals a,b]
//! [--sorted] [FILE.obj]…`
//! with the rivals `embree`, `bvh` (this crate), `isa` (its other instruction sets), `obvhs`, `obvhs-best`, `crate-bvh`;
//! `--sorted` tells what closest-hit rays would gain from being sorted first;
//! `embree` and `bvh` may be followed by `:fast` or `:high` (quality of the tree) and `:f32` (the fast mode).

#[path = "../tests/truth/mod.rs"]
mod truth;

use std::sync::Arc;
use std::time::{Duration, Instant};

use caustica::accel::{Accel, AccelKind, AccelOptions, Bvh, Isa, Mode, Quality};
use caustica::geometry::{GeometrySet, Ray, Shape, TriangleMesh, generate};
use caustica::math::{Bounds3, Frame, Vec2, Vec3};
use caustica::sample::{mix64, warp};
use rayon::prelude::*;
use rustix::time::{ClockId, clock_gettime};

/// Processor time, which other programs on the machine do not add to.
fn cpu_seconds(clock: ClockId) -> f64 {
    let t = clock_gettime(clock);
    t.tv_sec as f64 + t.tv_nsec as f64 * 1e-9
}

struct Options {
    meshes: Vec<String>,
    rays: usize,
    rounds: usize,
    rivals: Vec<String>,
    /// All of them when empty.
    classes: Vec<String>,
    /// Measure sorted rays too.
    sorted: bool,
}

impl Options {
    fn parse() -> Self {
        let defaults = "terrain:10000,sphere:100000,flake:300000,terrain:1000000,sphere:3000000,terrain:10000000";
        let split = |s: &str| s.split(',').map(str::to_owned).collect::<Vec<_>>();
        let mut o = Self {
            meshes: split(defaults),
            rays: 1 << 20,
            rounds: 5,
            rivals: split("embree,bvh,obvhs,obvhs-best,crate-bvh"),
            classes: Vec::new(),
            sorted: false,
        };
        let mut files = Vec::new();
        let mut args = std::env::args().skip(1);
        while let Some(arg) = args.next() {
            let mut value = || args.next().unwrap_or_else(|| panic!("{arg} needs a value"));
            match arg.as_str() {
                "--bench" => {}
                "--meshes" => o.meshes = split(&value()),
                "--rays" => o.rays = value().parse().expect("a number of rays"),
                "--rounds" => o.rounds = value().parse().expect("a number of rounds"),
                "--sorted" => o.sorted = true,
                "--classes" => o.classes = split(&value()),
                "--rivals" => o.rivals = split(&value()),
                file => files.push(file.to_owned()),
            }
        }
        o.meshes.retain(|m| !m.is_empty());
        o.meshes.extend(files);
        o
    }
}

fn load(name: &str) -> TriangleMesh {
    if let Some((kind, n)) = name.split_once(':') {
        let n = n.parse().expect("a number of triangles");
        return match kind {
            "terrain" => generate::terrain(n, 1),
            "sphere" => generate::displaced_sphere(n, 1),
            "flake" => generate::sphereflake(n),
            _ => panic!("unknown generator {kind}: terrain, sphere or flake"),
        };
    }
    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    let (models, _) = tobj::load_obj(name, &options).expect("a readable OBJ file");
    let (mut points, mut indices) = (Vec::new(), Vec::new());
    for m in models {
        let first = points.len() as u32;
        points.extend(m.mesh.positions.chunks_exact(3).map(Vec3::from_slice));
        indices.extend(m.mesh.indices.chunks_exact(3).map(|i| [i[0] + first, i[1] + first, i[2] + first]));
    }
    TriangleMesh { positions: points.into(), indices, ..Default::default() }
}

struct Random(u64);

impl Random {
    fn unit(&mut self) -> f32 {
        self.0 += 1;
        (mix64(self.0) >> 40) as f32 / (1u64 << 24) as f32
    }

    fn vec2(&mut self) -> Vec2 {
        Vec2::new(self.unit(), self.unit())
    }
}

struct Class {
    name: &'static str,
    any: bool,
    rays: Vec<Ray>,
}

/// Real paths through the mesh: from a camera, towards a light, and from the light.
fn ray_classes(set: &GeometrySet, accel: &Accel, count: usize) -> Vec<Class> {
    let (center, radius) = set.bounds().bounding_sphere();
    let mut rng = Random(1 << 40);
    let eye = center + radius * Vec3::new(1.1, -1.5, 0.9);
    let light = center + radius * Vec3::new(-0.9, -1.0, 1.3);
    let frame = Frame::from_normal((center - eye).normalize());
    // Pixels in tiles of 16 × 16, as a renderer visits them.
    let side = (count as f64).sqrt().ceil() as usize / 16 * 16;
    let primary: Vec<Ray> = (0..side * side)
        .map(|i| {
            let (tile, pixel) = (i / 256, i % 256);
            let x = tile % (side / 16) * 16 + pixel % 16;
            let y = tile / (side / 16) * 16 + pixel / 16;
            let film = (Vec2::new(x as f32, y as f32) + rng.vec2()) / side as f32 - 0.5;
            Ray::new(eye, (frame.n + 0.8 * (film.x * frame.s + film.y * frame.t)).normalize())
        })
        .collect();
    let mut classes = vec![
        Class { name: "primary", any: false, rays: primary.clone() },
        Class { name: "shadow", any: true, rays: Vec::new() },
        Class { name: "ambient", any: true, rays: Vec::new() },
        Class { name: "diffuse", any: false, rays: Vec::new() },
        Class { name: "diffuse-n", any: false, rays: Vec::new() },
        Class { name: "photon", any: false, rays: Vec::new() },
    ];
    let mut bounce = |ray: &Ray| {
        let hit = accel.intersect(ray)?;
        let si = set.interaction(ray, &hit);
        let n = if si.ng.dot(si.wo) < 0.0 { -si.ng } else { si.ng };
        let d = Frame::from_normal(n).to_world(warp::cosine_hemisphere(rng.vec2()));
        Some((si.spawn_origin(n), d.normalize()))
    };
    for ray in &primary {
        let mut path = *ray;
        for depth in 0..4 {
            let Some((o, d)) = bounce(&path) else { break };
            path = Ray::new(o, d);
            if depth == 0 {
                classes[1].rays.push(Ray::segment(o, light - o, 1.0 - 1e-4));
                classes[2].rays.push(Ray::segment(o, d, 0.5 * radius));
                classes[3].rays.push(path);
            } else {
                classes[4].rays.push(path);
            }
        }
    }
    let mut aim = Random(2 << 40);
    while classes[5].rays.len() < count {
        let target = center + radius * warp::uniform_sphere(aim.vec2()) * aim.unit().cbrt();
        let mut path = Ray::new(light, (target - light).normalize());
        for _ in 0..5 {
            classes[5].rays.push(path);
            let Some((o, d)) = bounce(&path) else { break };
            path = Ray::new(o, d);
        }
    }
    for class in &mut classes {
        class.rays.truncate(count);
        // Too few hits: go round again, so that every class takes long enough to be timed.
        let n = class.rays.len();
        assert!(n > 0, "no {} rays", class.name);
        for i in n..count {
            class.rays.push(class.rays[i - n]);
        }
    }
    classes
}

/// The rays along a Morton curve of their origins, and of their directions where origins are in one cell.
fn sorted(rays: &[Ray], bounds: &Bounds3) -> Vec<(u64, u32)> {
    let morton = |p: Vec3| {
        let spread = |x: f32| {
            let x = ((x * 1024.0) as u64).min(1023);
            let x = (x | x << 16) & 0x030000ff;
            let x = (x | x << 8) & 0x0300f00f;
            let x = (x | x << 4) & 0x030c30c3;
            (x | x << 2) & 0x09249249
        };
        spread(p.x) | spread(p.y) << 1 | spread(p.z) << 2
    };
    let key = |r: &Ray| {
        let direction = r.d / r.d.abs().max_element() * 0.5 + 0.5;
        morton((r.o - bounds.min) / bounds.extent()) << 30 | morton(direction)
    };
    let mut keys: Vec<(u64, u32)> = rays.par_iter().zip(0..rays.len() as u32).map(|(r, i)| (key(r), i)).collect();
    keys.par_sort_unstable();
    keys
}

/// One contender: a finished tree.
trait Rival: Sync {
    fn closest(&self, ray: &Ray) -> Option<(f32, u32)>;
    fn any(&self, ray: &Ray) -> bool;
    fn bytes(&self) -> usize;
    /// Processor seconds of all queries of a class, and how many hit; a method so that every rival's loop is compiled
    /// for it.
    fn run(&self, class: &Class) -> (f64, u64) {
        let chunks = class.rays.par_chunks(4096).map(|rays| {
            let start = cpu_seconds(ClockId::ThreadCPUTime);
            let hits = if class.any {
                rays.iter().map(|r| u64::from(self.any(r))).sum::<u64>()
            } else {
                rays.iter().map(|r| u64::from(self.closest(r).is_some())).sum()
            };
            (cpu_seconds(ClockId::ThreadCPUTime) - start, hits)
        });
        chunks.reduce(|| (0.0, 0), |a, b| (a.0 + b.0, a.1 + b.1))
    }
}

impl Rival for Accel {
    #[inline]
    fn closest(&self, ray: &Ray) -> Option<(f32, u32)> {
        self.intersect(ray).map(|h| (h.t, h.prim))
    }

    #[inline]
    fn any(&self, ray: &Ray) -> bool {
        self.occluded(ray)
    }

    fn bytes(&self) -> usize {
        self.memory()
    }
}

struct Obvhs {
    tree: obvhs::cwbvh::CwBvh,
    triangles: Vec<obvhs::rt_triangle::RtTriangle>,
}

impl Obvhs {
    fn build(set: &GeometrySet, best: bool) -> Self {
        let Shape::Mesh(mesh) = &set.shapes[0] else { unreachable!("the benchmark has one mesh") };
        let all: Vec<_> = (0..mesh.indices.len() as u32)
            .into_par_iter()
            .map(|i| {
                let [v0, v1, v2] = mesh.triangle(i).map(Into::into);
                obvhs::triangle::Triangle { v0, v1, v2 }
            })
            .collect();
        let preset =
            if best { obvhs::BvhBuildParams::very_slow_build() } else { obvhs::BvhBuildParams::medium_build() };
        let tree = obvhs::cwbvh::builder::build_cwbvh_from_tris(&all, preset, &mut Duration::default());
        let triangles = tree.primitive_indices.iter().map(|&i| (&all[i as usize]).into()).collect();
        Self { tree, triangles }
    }

    fn ray(ray: &Ray) -> obvhs::ray::Ray {
        obvhs::ray::Ray::new(ray.o.into(), ray.d.into(), 0.0, ray.tmax)
    }
}

impl Rival for Obvhs {
    fn closest(&self, ray: &Ray) -> Option<(f32, u32)> {
        let mut hit = obvhs::ray::RayHit::none();
        let test = |r: &obvhs::ray::Ray, i: usize| self.triangles[i].intersect(r);
        let found = self.tree.ray_traverse(Self::ray(ray), &mut hit, test);
        found.then(|| (hit.t, self.tree.primitive_indices[hit.primitive_id as usize]))
    }

    fn any(&self, ray: &Ray) -> bool {
        !self.tree.ray_traverse_miss(Self::ray(ray), |r, i| self.triangles[i].intersect(r))
    }

    fn bytes(&self) -> usize {
        size_of_val(&self.tree.nodes[..]) + size_of_val(&self.triangles[..])
    }
}

type Point3 = nalgebra::Point3<f32>;

struct CrateTriangle {
    corners: [Point3; 3],
    node: usize,
}

impl bvh::aabb::Bounded<f32, 3> for CrateTriangle {
    fn aabb(&self) -> bvh::aabb::Aabb<f32, 3> {
        let [a, b, c] = &self.corners;
        bvh::aabb::Aabb::empty().grow(a).grow(b).grow(c)
    }
}

impl bvh::bounding_hierarchy::BHShape<f32, 3> for CrateTriangle {
    fn set_bh_node_index(&mut self, index: usize) {
        self.node = index;
    }

    fn bh_node_index(&self) -> usize {
        self.node
    }
}

struct CrateBvh {
    tree: bvh::bvh::Bvh<f32, 3>,
    triangles: Vec<CrateTriangle>,
}

impl CrateBvh {
    fn build(set: &GeometrySet) -> Self {
        let Shape::Mesh(mesh) = &set.shapes[0] else { unreachable!("the benchmark has one mesh") };
        let point = |p: Vec3| Point3::new(p.x, p.y, p.z);
        let mut triangles: Vec<_> = (0..mesh.indices.len() as u32)
            .map(|i| CrateTriangle { corners: mesh.triangle(i).map(point), node: 0 })
            .collect();
        let tree = bvh::bvh::Bvh::build_with_executor(&mut triangles, bvh::bvh::rayon_executor);
        Self { tree, triangles }
    }

    fn ray(ray: &Ray) -> bvh::ray::Ray<f32, 3> {
        // This crate normalises; distances are scaled back where they are used.
        bvh::ray::Ray::new(Point3::new(ray.o.x, ray.o.y, ray.o.z), nalgebra::Vector3::new(ray.d.x, ray.d.y, ray.d.z))
    }
}

impl Rival for CrateBvh {
    fn closest(&self, ray: &Ray) -> Option<(f32, u32)> {
        let (r, scale) = (Self::ray(ray), ray.d.length());
        let mut best: Option<(f32, u32)> = None;
        for shape in self.tree.nearest_child_traverse_iterator(&r, &self.triangles) {
            let [a, b, c] = &shape.corners;
            let t = r.intersects_triangle(a, b, c).distance / scale;
            if t > 0.0 && t < best.map_or(ray.tmax, |b| b.0) {
                let first = self.triangles.as_ptr() as usize;
                let index = (shape as *const CrateTriangle as usize - first) / size_of::<CrateTriangle>();
                best = Some((t, index as u32));
            }
        }
        best
    }

    fn any(&self, ray: &Ray) -> bool {
        let (r, scale) = (Self::ray(ray), ray.d.length());
        self.tree.traverse_iterator(&r, &self.triangles).any(|shape| {
            let [a, b, c] = &shape.corners;
            let t = r.intersects_triangle(a, b, c).distance / scale;
            t > 0.0 && t < ray.tmax
        })
    }

    fn bytes(&self) -> usize {
        size_of_val(&self.tree.nodes[..]) + size_of_val(&self.triangles[..])
    }
}

/// Name, tree, and build seconds: wall clock and processor.
type Contender = (String, Box<dyn Rival>, (f64, f64));

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The back end and the options that a name on the command line stands for.
fn own(rival: &str) -> Option<(AccelKind, AccelOptions)> {
    let mut words = rival.split(':');
    let kind = match words.next()? {
        "embree" => AccelKind::Embree,
        "bvh" => AccelKind::Bvh,
        _ => return None,
    };
    let mut options = AccelOptions::default();
    for word in words {
        match word {
            "fast" => options.quality = Quality::Fast,
            "high" => options.quality = Quality::High,
            "f32" => options.mode = Mode::Fast,
            _ => panic!("unknown option {word}: fast, high or f32"),
        }
    }
    Some((kind, options))
}

/// The contenders in the order of the command line, with the median build time.
fn build_all(options: &Options, set: &Arc<GeometrySet>, triangles: usize) -> Vec<Contender> {
    let mut rivals: Vec<Contender> = Vec::new();
    let mut build = |name: String, once: bool, make: &dyn Fn() -> Box<dyn Rival>| {
        let mut times = Vec::new();
        let mut last = None;
        for _ in 0..if once { 1 } else { options.rounds } {
            drop(last.take());
            let start = (Instant::now(), cpu_seconds(ClockId::ProcessCPUTime));
            last = Some(make());
            times.push((start.0.elapsed().as_secs_f64(), cpu_seconds(ClockId::ProcessCPUTime) - start.1));
        }
        let (wall, cpu) = times.into_iter().unzip::<f64, f64, Vec<_>, Vec<_>>();
        rivals.push((name, last.expect("built at least once"), (median(wall), median(cpu))));
    };
    for rival in &options.rivals {
        if let Some((kind, options)) = own(rival) {
            match Accel::build_with(kind, options, set.clone()) {
                Ok(a) => {
                    let name = format!("{}{}", a.description(), rival.trim_start_matches(|c| c != ':'));
                    drop(a);
                    build(name, false, &|| {
                        Box::new(Accel::build_with(kind, options, set.clone()).expect("built before"))
                    });
                }
                Err(e) => println!("no {rival}: {e}"),
            }
            continue;
        }
        match rival.as_str() {
            "isa" => {
                for isa in Isa::ALL.into_iter().filter(|i| i.is_available() && *i != Isa::detect()) {
                    build(format!("Rust BVH {}", isa.name()), true, &|| {
                        let tree = Bvh::build(set.clone()).and_then(|b| b.with_isa(isa));
                        Box::new(Accel::Bvh(tree.expect("available and small enough")))
                    });
                }
            }
            "obvhs" => build("obvhs medium".into(), true, &|| Box::new(Obvhs::build(set, false))),
            "obvhs-best" if triangles <= 3_500_000 => {
                build("obvhs very slow".into(), true, &|| Box::new(Obvhs::build(set, true)));
            }
            "crate-bvh" if triangles <= 3_500_000 => {
                build("bvh crate".into(), true, &|| Box::new(CrateBvh::build(set)));
            }
            "obvhs-best" | "crate-bvh" => println!("{rival} left out: it takes minutes on this mesh"),
            other => panic!("unknown rival {other}"),
        }
    }
    rivals
}

/// Rays on which two rivals disagree about the triangle.
struct Disagreement {
    share: f64,
    /// The largest relative difference in t among these.
    worst: f64,
    /// How many of these were judged, and how many of those each of the two has right for certain.
    judged: usize,
    right: (usize, usize),
}

/// Most triangles that rays are judged against.
const TRIALS: usize = 1 << 30;

fn disagreement(a: &dyn Rival, b: &dyn Rival, mesh: &TriangleMesh, class: &Class) -> Disagreement {
    let different = class.rays.par_iter().filter_map(|r| match (a.closest(r), b.closest(r)) {
        (None, None) => None,
        (Some(x), Some(y)) if x.1 == y.1 => None,
        (Some(x), Some(y)) => Some((r, ((x.0 - y.0).abs() / x.0.max(y.0)) as f64)),
        _ => Some((r, f64::INFINITY)),
    });
    let all: Vec<(&Ray, f64)> = different.collect();
    let judge = |(ray, _): &(&Ray, f64)| {
        let right = |tree: &dyn Rival| {
            truth::first_hit(mesh, ray).is_ok_and(|hit| hit.map(|h| h.1) == tree.closest(ray).map(|h| h.1))
        };
        (right(a) as usize, right(b) as usize)
    };
    let judged = &all[..all.len().min(TRIALS / mesh.indices.len())];
    Disagreement {
        share: all.len() as f64 / class.rays.len() as f64,
        worst: all.iter().fold(0.0, |worst, x| worst.max(x.1)),
        judged: judged.len(),
        right: judged.par_iter().map(judge).reduce(|| (0, 0), |x, y| (x.0 + y.0, x.1 + y.1)),
    }
}

fn main() {
    let options = Options::parse();
    println!("{} threads, {} rays per class, {} rounds", rayon::current_num_threads(), options.rays, options.rounds);
    for name in &options.meshes {
        let mesh = Arc::new(load(name));
        let triangles = mesh.indices.len();
        let shapes = vec![Shape::Mesh(mesh.clone())];
        let set = Arc::new(GeometrySet { shapes, top: vec![0], ..Default::default() });
        println!("\n{name}: {triangles} triangles");
        let rivals = build_all(&options, &set, triangles);
        for (rival, tree, (wall, cpu)) in &rivals {
            let bytes = tree.bytes() as f64 / triangles as f64;
            println!("  {rival:28} build {wall:8.4} s, {cpu:8.4} s of processor, {bytes:7.1} B/triangle");
        }
        let reference = Accel::build(AccelKind::Bvh, set.clone()).expect("small enough");
        for class in ray_classes(&set, &reference, options.rays) {
            if !options.classes.is_empty() && !options.classes.iter().any(|c| c == class.name) {
                continue;
            }
            let mut seconds = vec![Vec::new(); rivals.len()];
            for _ in 0..options.rounds {
                for (i, rival) in rivals.iter().enumerate() {
                    seconds[i].push(rival.1.run(&class).0);
                }
            }
            for (i, (rival, tree, _)) in rivals.iter().enumerate() {
                let rate = class.rays.len() as f64 / 1e6 / median(seconds[i].clone());
                let ratio = median(seconds[0].iter().zip(&seconds[i]).map(|(a, b)| a / b).collect());
                let mut differ = String::new();
                if i > 0 && !class.any {
                    let d = disagreement(&*rivals[0].1, &**tree, &mesh, &class);
                    differ = format!("  differ {:.1e} by {:.1e}", d.share, d.worst);
                    if d.judged > 0 {
                        differ += &format!("; of {}, right {} and {}", d.judged, d.right.0, d.right.1);
                    }
                }
                println!("  {:10} {rival:28} {rate:8.3} M/s per core {ratio:6.3}{differ}", class.name);
            }
            if !options.sorted || class.any {
                continue;
            }
            for (rival, tree, _) in &rivals {
                // On the wall, as what sorting is to save is time of both threads waiting for memory.
                let wall = |class: &Class| {
                    let start = Instant::now();
                    tree.run(class);
                    start.elapsed().as_secs_f64()
                };
                let mut gains = vec![Vec::new(); 2];
                for _ in 0..options.rounds {
                    let start = Instant::now();
                    let order = sorted(&class.rays, &set.bounds());
                    let rays = order.par_iter().map(|&(_, i)| class.rays[i as usize]).collect();
                    let sort = start.elapsed().as_secs_f64();
                    let (plain, sorted) = (wall(&class), wall(&Class { rays, ..class }));
                    gains[0].push(plain / sorted);
                    gains[1].push(plain / (sort + sorted));
                }
                let [traced, whole] = [0, 1].map(|i| median(gains[i].clone()));
                println!("  {:10} {rival:28} sorted {traced:.2} times as fast, with the sort {whole:.2}", class.name);
            }
        }
    }
}
