//! `efficiency_aware`: a pilot leaves out techniques that cost more than they gain, the same ones each time.

mod common;

use caustica::accel::AccelKind;
use caustica::integrator::vcm::{Technique, TechniqueChoice};
use caustica::render::{Method, Plan, PlanOverrides};
use caustica::scene::Scene;
use common::{Estimate, floor_under_a_pane, run, scene};

/// A mirror ring on a floor under a small lamp.
fn ring(integrator: &str, lamp: &str) -> String {
    format!(
        r#"<scene version="3.0.0">
  <integrator type="{integrator}"><boolean name="efficiency_aware" value="true"/></integrator>
  <sensor type="perspective"><float name="fov" value="32"/>
    <transform name="to_world"><lookat origin="-0.5, -1.9, 4" target="0, 0, 0" up="0, 0, 1"/></transform>
    <film type="hdrfilm"><integer name="width" value="48"/><integer name="height" value="36"/>
      <rfilter type="box"/></film>
    <sampler type="independent"><integer name="sample_count" value="8"/></sampler></sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="4"/></transform><bsdf type="diffuse"/></shape>
  <shape type="cylinder"><point name="p0" x="0" y="0" z="0"/><point name="p1" x="0" y="0" z="0.45"/>
    <bsdf type="twosided"><bsdf type="conductor"/></bsdf></shape>
  {lamp}
</scene>"#
    )
}

/// The same from a wider angle, where the pilot expects 0.3 to 0.5 of error × cost without the light image (three seeds).
fn wide_ring() -> String {
    ring("vcm", BALL).replace(r#"name="fov" value="32""#, r#"name="fov" value="70""#)
}

const BALL: &str = r#"<shape type="sphere"><point name="center" x="1" y="0" z="1"/><float name="radius" value="0.03"/>
    <emitter type="area"><rgb name="radiance" value="1000"/></emitter></shape>"#;

const POINT: &str = r#"<emitter type="point"><point name="position" x="1" y="0" z="1"/></emitter>"#;

fn plan(s: &Scene, o: &PlanOverrides) -> Plan {
    Plan::new(s, o).expect("a plan")
}

fn techniques(xml: &str) -> Vec<TechniqueChoice> {
    plan(&scene(xml, AccelKind::Bvh), &PlanOverrides::default()).techniques
}

fn uses(choices: &[TechniqueChoice], technique: Technique) -> bool {
    choices.iter().any(|c| c.technique == technique && c.used)
}

#[test]
fn what_finds_the_light_stays_and_what_does_not_pay_goes() {
    // Light samples find all of the light image but the cardioid, and only merging finds that often.
    let found = techniques(&wide_ring());
    assert!(uses(&found, Technique::Merging) && !uses(&found, Technique::LightImage), "{found:?}");
    // Without merging the light image is what finds it.
    let found = techniques(&ring("bdpt", BALL));
    assert!(found.len() == 2 && uses(&found, Technique::LightImage), "{found:?}");
}

#[test]
fn nothing_is_left_out_that_may_be_alone_in_finding_light() {
    // The light of a point behind a mirror: no pilot may decide about that.
    let found = techniques(&ring("vcm", POINT));
    assert!(uses(&found, Technique::Merging), "{found:?}");
    let found = techniques(&ring("bdpt", POINT));
    assert!(found.iter().all(|c| c.used), "{found:?}");
    // A point under glass, seen through it.
    let pane = floor_under_a_pane(r#"<boolean name="efficiency_aware" value="true"/>"#).replace("\"sppm\"", "\"vcm\"");
    let found = techniques(&pane);
    assert!(uses(&found, Technique::Merging), "{found:?}");
}

#[test]
fn it_is_off_unless_asked_for() {
    let off = ring("vcm", BALL).replace(r#"value="true""#, r#"value="false""#);
    assert!(techniques(&off).is_empty());
    let s = scene(&ring("vcm", BALL), AccelKind::Bvh);
    let o = PlanOverrides { integrator: Some("ptracer".into()), ..PlanOverrides::default() };
    assert!(plan(&s, &o).techniques.is_empty(), "light tracing has nothing to choose from");
}

#[test]
fn the_choice_depends_on_scene_and_seed_alone() {
    let s = scene(&wide_ring(), AccelKind::Bvh);
    let whole = plan(&s, &PlanOverrides::default());
    let told = |p: &Plan| (p.techniques.clone(), format!("{:?}", p.method));
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let o = PlanOverrides { pass_range: Some(1..3), ..PlanOverrides::default() };
        let part = pool.install(|| plan(&s, &o));
        assert_eq!(told(&whole), told(&part), "{threads} threads");
    }
    let Method::Vcm(settings) = whole.method else { panic!("vcm was asked for") };
    assert!(!settings.light_image && settings.efficiency_aware);
}

/// Means over 12 seeds: Student's t with 11 degrees of freedom at 99.9 %.
#[test]
fn the_mean_stays() {
    let s = scene(&wide_ring(), AccelKind::Bvh);
    let full = scene(&wide_ring().replace(r#"value="true""#, r#"value="false""#), AccelKind::Bvh);
    let mean = |s: &Scene| {
        Estimate::of((1..=12).map(|seed| {
            let image = run(s, PlanOverrides { seed: Some(seed), spp: Some(16), ..PlanOverrides::default() }).image;
            image.pixels().iter().map(|p| f64::from(p.mean())).sum::<f64>() / image.pixels().len() as f64
        }))
    };
    let (a, b) = (mean(&s), mean(&full));
    let error = (a.error.powi(2) + b.error.powi(2)).sqrt();
    assert!((a.mean - b.mean).abs() < 4.44 * error, "{a:?} {b:?}");
}
