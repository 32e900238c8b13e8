use std::path::Path;

use super::*;
use crate::accel::AccelKind;
use crate::scene::LoadOptions;

const FLOOR: &str = r#"<shape type="rectangle"><bsdf type="diffuse"/></shape>"#;
const POINT: &str = r#"<emitter type="point"><point name="position" x="0" y="0" z="3"/></emitter>"#;
const MIRROR_BALL: &str = r#"<shape type="sphere"><float name="radius" value="0.2"/><point name="center" x="0" y="0" z="1"/>
       <bsdf type="conductor"/></shape>"#;

fn needs_with(body: &str, max_depth: Option<u32>, overrides: &[NeedOverride]) -> Needs {
    let text = format!("<scene version=\"3.0.0\">{body}</scene>");
    let options = LoadOptions { accel: AccelKind::Bvh, ..LoadOptions::default() };
    let scene = Scene::from_text(&text, Path::new("scene.xml"), &options).expect("a valid scene");
    Needs::of(&scene, max_depth, overrides)
}

fn needs(body: &str) -> Needs {
    needs_with(body, None, &[])
}

/// The items that are not wanted.
fn left_out(n: &Needs) -> Vec<Item> {
    n.iter().filter(|n| !n.wanted).map(|n| n.item).collect()
}

#[test]
fn an_empty_or_dark_scene_needs_nothing() {
    assert_eq!(left_out(&needs("")), Item::ALL);
    let dark = r#"<emitter type="point"><rgb name="intensity" value="0"/></emitter>"#;
    assert_eq!(needs(&format!("{FLOOR}{MIRROR_BALL}{dark}")).longest_path(), Some(0));
}

#[test]
fn a_floor_has_direct_light_only() {
    let n = needs(&format!("{FLOOR}{POINT}"));
    assert!(n.wants(Item::Direct) && !n.wants(Item::Indirect) && !n.wants(Item::Global) && !n.wants(Item::Caustics));
    assert_eq!(n.longest_path(), Some(2));
    // A second floor that faces it, or a wall that leans over it, reflects.
    let turned = |angle: u32| {
        format!(
            r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="{angle}"/>
            <translate z="1"/></transform></shape>"#
        )
    };
    for (angle, indirect) in [(0, false), (180, true), (90, true), (60, true), (30, false)] {
        let n = needs(&format!("{FLOOR}{}{POINT}", turned(angle)));
        assert_eq!(n.wants(Item::Indirect), indirect, "{angle}");
    }
}

#[test]
fn caustics_need_caster_light_and_receiver() {
    assert!(needs(&format!("{FLOOR}{MIRROR_BALL}{POINT}")).wants(Item::Caustics));
    assert!(!needs(&format!("{MIRROR_BALL}{POINT}")).wants(Item::Caustics));
    assert!(!needs(&format!("{FLOOR}{POINT}")).wants(Item::Caustics));
    assert!(!needs(&format!("{FLOOR}{MIRROR_BALL}")).wants(Item::Caustics));
    assert!(!needs_with(&format!("{FLOOR}{MIRROR_BALL}{POINT}"), Some(2), &[]).wants(Item::Caustics));
    // A spot that looks away from the ball, and one that looks at it.
    let spot = |z: i32| {
        format!(
            r#"<emitter type="spot"><transform name="to_world">
            <lookat origin="3 0 1" target="{}" up="0 0 1"/></transform></emitter>"#,
            if z > 0 { "0 0 1" } else { "1 0 -1" }
        )
    };
    assert!(needs(&format!("{FLOOR}{MIRROR_BALL}{}", spot(1))).wants(Item::Caustics));
    let away = needs(&format!("{FLOOR}{MIRROR_BALL}{}", spot(-1)));
    assert!(!away.wants(Item::Caustics) && away.wants(Item::Global), "{away:?}");
    // A lamp that shines away from the ball.
    let lamp = |angle: u32| {
        format!(
            r#"<shape type="rectangle"><transform name="to_world"><scale value="0.1"/><rotate x="1" angle="{angle}"/>
            <translate z="2"/></transform><bsdf type="diffuse"/><emitter type="area"/></shape>"#
        )
    };
    assert!(needs(&format!("{FLOOR}{MIRROR_BALL}{}", lamp(180))).wants(Item::Caustics));
    assert!(!needs(&format!("{FLOOR}{MIRROR_BALL}{}", lamp(0))).wants(Item::Caustics));
}

#[test]
fn a_mirror_below_the_floor_casts_nothing_on_it() {
    let below = r#"<shape type="rectangle"><transform name="to_world"><translate z="-1"/></transform>
                   <bsdf type="conductor"/></shape>"#;
    let n = needs(&format!("{FLOOR}{below}{POINT}"));
    assert!(!n.wants(Item::Caustics), "{n:?}");
}

#[test]
fn masks_and_instances_count() {
    let masked = r#"<shape type="rectangle"><transform name="to_world"><translate z="1"/></transform>
                    <bsdf type="mask"><bsdf type="diffuse"/></bsdf></shape>"#;
    assert!(needs(&format!("{FLOOR}{masked}{POINT}")).wants(Item::Caustics));
    let instanced = r#"<shape type="shapegroup" id="g"><shape type="sphere"><bsdf type="dielectric"/></shape></shape>
        <shape type="instance"><ref id="g"/><transform name="to_world"><translate x="1000" z="5"/></transform></shape>"#;
    assert!(needs(&format!("{FLOOR}{instanced}{POINT}")).wants(Item::Caustics));
    // A group that no instance places is nowhere.
    let group = instanced.split("<shape type=\"instance\"").next().expect("the group");
    assert!(!needs(&format!("{FLOOR}{group}{POINT}")).wants(Item::Caustics));
}

#[test]
fn coordinates_normals_and_directions() {
    let ball = r#"<shape type="sphere"><point name="center" x="0" y="0" z="2"/></shape>"#;
    let n = needs(&format!("{FLOOR}{ball}{POINT}"));
    assert!(!n.wants(Item::Uv) && !n.wants(Item::Normals) && !n.wants(Item::Directions) && n.wants(Item::Irradiance));
    let checks = r#"<shape type="sphere"><point name="center" x="0" y="0" z="2"/>
        <bsdf type="diffuse"><texture type="checkerboard" name="reflectance"/></bsdf></shape>"#;
    assert!(needs(&format!("{FLOOR}{checks}{POINT}")).wants(Item::Uv));
    let glossy = r#"<shape type="sphere"><point name="center" x="0" y="0" z="2"/>
        <bsdf type="roughconductor"><float name="alpha" value="0.3"/></bsdf></shape>"#;
    let n = needs(&format!("{FLOOR}{glossy}{POINT}"));
    assert!(n.wants(Item::Directions) && !n.wants(Item::Caustics));
    let n = needs(&format!("{glossy}{}{POINT}", glossy.replace("z=\"2\"", "z=\"5\"")));
    assert!(n.wants(Item::Global) && !n.wants(Item::Irradiance));
}

#[test]
fn overrides_win_and_others_follow() {
    let body = format!("{FLOOR}{MIRROR_BALL}{POINT}");
    let n = needs_with(&body, None, &[(Item::Caustics, false)]);
    let caustics = n.iter().find(|n| n.item == Item::Caustics).expect("all items are there");
    assert!(!caustics.wanted && caustics.forced && caustics.reason.starts_with("as asked for; otherwise: light may"));
    let n = needs_with(&body, None, &[(Item::Global, false)]);
    assert!(!n.wants(Item::Gather) && !n.wants(Item::Irradiance) && n.wants(Item::Caustics));
    let n = needs_with(&format!("{FLOOR}{POINT}"), None, &[(Item::Indirect, true)]);
    assert!(n.wants(Item::Global) && n.longest_path().is_none());
    // The last of two wins; agreeing is not forcing.
    let n = needs_with(&body, None, &[(Item::Caustics, false), (Item::Caustics, true)]);
    assert!(n.wants(Item::Caustics) && n.iter().all(|n| !n.forced));
}

#[test]
fn names_are_read_back() {
    for item in Item::ALL {
        assert_eq!(item.name().parse(), Ok(item));
    }
    assert!("caustic".parse::<Item>().expect_err("unknown").contains("caustics"));
}
